/* Knots of the motion to come: a ring in order of time, and cubic Hermite interpolation between two of them.
 *
 * Times are the low 32 bits of the device's microseconds; they are compared by difference, so that they may
 * wrap around. Nothing here knows of limits or states.
 */
#ifndef ORI_QUEUE_H
#define ORI_QUEUE_H

#include "wire.h"

#define QUEUE_KNOTS 20U
#define LONGEST_SEGMENT_US UINT32_C(1000000)
#define SHORTEST_SEGMENT_US UINT32_C(1000)

typedef struct {
    uint32_t time_us;
    int32_t position_urad[ORI_HINGES];
    int16_t velocity_mrad_s[ORI_HINGES];
} knot_t;

void queue_clear(void);
uint8_t queue_size(void);
bool queue_full(void);
const knot_t *queue_first(void);
const knot_t *queue_last(void);
/* The knot may point anywhere outside of the queue. Never called when full. */
void queue_push(const knot_t *knot);

/* Forget knots that a motion at `time_us` has passed: at least the last stays. */
void queue_pass(uint32_t time_us);

/* Positions of the first `hinges` hinges at a time: before the first knot and after the last the hinges rest
 * there. Never called when empty. */
void queue_positions(uint32_t time_us, uint8_t hinges, int32_t *position_urad);

/* Whether any hinge moves at a knot. */
bool knot_moves(const knot_t *knot, uint8_t hinges);

#endif
