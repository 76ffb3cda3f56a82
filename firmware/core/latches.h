/* Latches: electromagnets with a thermal limit, lock pins on a servo, passive magnets; and their sensors.
 *
 * Silence of the host and faults of the hinges move no latch. An electromagnet that is on for too long lets go by
 * itself and cools before it may be engaged again.
 *
 * Heat is a magnet output's, and outlasts a restart, in port_kept. When that was damaged the outputs count as cold if
 * power was off, and else as fully hot: tripped until they are cold. How long the restart took is not known, and does
 * not count as cooling.
 */
#ifndef ORI_LATCHES_H
#define ORI_LATCHES_H

#include "config.h"

/* Every output off, nothing sensed; heat as it was kept. */
void latches_init(void);

/* Close or open a latch. Returns an ORI_RESULT. */
uint8_t latches_command(uint8_t index, bool engage);

/* One step of ORI_FRAME_US. Returns a mask of the latches that tripped in it. */
uint8_t latches_step(void);

/* Whether any electromagnet or pin is engaged by an output. */
bool latches_driven(void);

/* Whether engaging this latch drives an output. */
bool latches_drives(uint8_t index);

/* In how many milliseconds the electromagnets will be cold if they stay off; 0: they are, INT32_MAX: not so soon.
 * `index` is the one that takes longest. */
int32_t latches_hot_ms(uint8_t *index);

void latches_report(mavlink_ori_latch_state_t *report);

#endif
