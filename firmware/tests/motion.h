/* The motion that most tests of the machine are about, and what they check of one. */
#ifndef ORI_MOTION_H
#define ORI_MOTION_H

#include "rig.h"

#define ALL 0x7U
#define STREAM 5U
#define STEP_US 20000U

/* The motion of most tests: all hinges from 0, 10 rad/s^2 for 100 ms, then 1 rad/s. */
extern uint64_t begin_us;
extern uint16_t sent;

double motion(double s);
double speed(double s);
void send_knot(uint16_t number);
void enable_all(void);

/* Send all knots that begin within 200 ms. */
void send_ahead(void);
void stream_for(unsigned frames);

/* A device that has been moving at 1 rad/s for a while, with 200 ms queued. */
void set_moving(void);

double output(uint8_t hinge);
void check_rests(void);

/* Goes on without the host until at rest: slower from frame to frame, and never back. Returns how many frames moved. */
unsigned check_brakes(uint8_t hinge);
void check_no_knot_is_taken(void);
void check_outputs_are_off(void);

/* A configuration of one hinge instead of the rig's. */
void configure_again(void);

#endif
