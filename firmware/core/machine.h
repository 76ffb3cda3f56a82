/* The state machine: what the device does, frame by frame, and which commands it takes when. */
#ifndef ORI_MACHINE_H
#define ORI_MACHINE_H

#include "config.h"

void machine_init(void);

uint8_t machine_state(void);
uint8_t machine_stream(void);
/* Knots of this stream taken so far: the number wanted next. */
uint16_t machine_contiguous(void);
uint8_t machine_queued(void);

/* Something believable came from the host. */
void machine_heard(uint64_t now_us);

/* Take the knots of a message that are new, in order; the rest is ignored. */
void machine_setpoints(const mavlink_ori_setpoints_t *setpoints);

/* Commands; each returns an ORI_RESULT. What is found with ORI_REFUSED_STATE is machine_state. */
uint8_t machine_enable(const mavlink_ori_enable_t *enable, uint8_t *index, int32_t *value);
uint8_t machine_disable(uint16_t hinges);
void machine_brake(void);
uint8_t machine_latch(uint8_t index, bool engage, int32_t *value);
uint8_t machine_clear(uint8_t fault, int32_t *value);
uint8_t machine_config_begin(const mavlink_ori_config_device_t *device, uint8_t *index, int32_t *value);
uint8_t machine_config_commit(uint32_t hash, uint8_t *index, int32_t *value);

/* Compute the outputs of the frame that begins at `next_frame_us`. */
void machine_frame(uint64_t now_us, uint64_t next_frame_us);

/* What is wrong with the device itself is found by whoever finds it. */
void machine_trip(uint8_t fault, uint8_t index);

#endif
