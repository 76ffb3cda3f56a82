/* Records to be stored, and ways to store them, for tests of configurations. */
#ifndef ORI_RECORDS_H
#define ORI_RECORDS_H

#include "rig.h"

extern mavlink_ori_config_device_t device;
extern mavlink_ori_config_hinge_t hinges[ORI_HINGES];
extern mavlink_ori_config_latch_t latches[ORI_LATCHES];

/* An empty device, and so many records of the rig's. */
void set_up(uint8_t hinge_count, uint8_t latch_count);
void store(void);
uint32_t hash(void);

/* Everything but the last step. */
void send_records(void);
uint8_t commit(uint32_t wanted);
void check_in_force(void);

#endif
