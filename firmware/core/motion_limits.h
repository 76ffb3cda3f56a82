/* What the configuration allows a hinge to be asked for. The host cannot command more. */
#ifndef ORI_MOTION_LIMITS_H
#define ORI_MOTION_LIMITS_H

#include "config.h"
#include "faults.h"
#include "queue.h"

/* A knot by itself: ranges and velocities. */
verdict_t limits_of_knot(const knot_t *knot);

/* The spline between two knots that are good by themselves: its speed and acceleration everywhere. */
verdict_t limits_of_segment(const knot_t *a, const knot_t *b);

#endif
