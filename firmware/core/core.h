/* The device: what a port calls. */
#ifndef ORI_CORE_H
#define ORI_CORE_H

#include <stdint.h>

/* Once, after the hardware stands still with every output off. */
void core_init(void);

/* As often as possible: takes in at most one message's bytes, answers, sends what waits. */
void core_poll(void);

/* Once per frame of ORI_FRAME_US, soon after it began. `frame_start_us` is when the frame that now runs began;
 * what core_frame gives to port_servo is for the frame after it, which begins at frame_start_us + ORI_FRAME_US. */
void core_frame(uint64_t frame_start_us);

#endif
