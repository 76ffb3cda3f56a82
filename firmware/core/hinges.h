/* Hinges: what their outputs ask for, where they are measured, and whether they follow. */
#ifndef ORI_HINGES_H
#define ORI_HINGES_H

#include "config.h"
#include "faults.h"

/* One more than the supply's: a supply that fails takes every sensor with it, and is to be told first. */
#define FEEDBACK_LOST_FRAMES 6U

/* Every output off. */
void hinges_init(void);

/* Hinges whose outputs are on. */
uint16_t hinges_on(void);

/* Hinges that did not follow and went off; they stay off until hinges_forgive. */
uint16_t hinges_stalled(void);
void hinges_forgive(void);

/* Turn hinges on at these positions, all or none. Those that are on go on asking for what they ask for: where they are
 * said to stand is judged, and steps no output. Returns an ORI_RESULT; `index` is the hinge it is about, `value` what
 * was found. */
uint8_t hinges_enable(uint16_t which, const int32_t *position_urad, uint8_t *index, int32_t *value);
void hinges_disable(uint16_t which);

/* Ask the hinges that are on for these positions from the next frame on. */
void hinges_output(const int32_t *position_urad);

/* Where the outputs are, 0 for those that are off. */
const int32_t *hinges_asked(void);

/* Take in the sensors, once a frame. Returns a hinge that stalled in it and went off, or else one that is on and has not
 * said where it is for FEEDBACK_LOST_FRAMES. */
verdict_t hinges_sense(void);

/* A hinge that is on and has not said where it is for so long, or ORI_NOBODY. */
uint8_t hinges_lost(void);

void hinges_report(mavlink_ori_state_t *report);

#endif
