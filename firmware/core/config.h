/* The configuration: records as the wire has them, in two slots of the EEPROM, the newer good one in force. */
#ifndef ORI_CONFIG_H
#define ORI_CONFIG_H

#include "wire.h"

typedef struct {
    mavlink_ori_config_device_t device;
    mavlink_ori_config_hinge_t hinge[ORI_HINGES];
    mavlink_ori_config_latch_t latch[ORI_LATCHES];
} config_t;

typedef enum { CONFIG_NONE, CONFIG_GOOD, CONFIG_CORRUPT } config_status_t;

/* Read the newer good slot. CONFIG_NONE when nothing was ever stored, CONFIG_CORRUPT when something was and
 * none of it is good: by its checksums, and by what its records say, which is judged as when they are written. */
config_status_t config_load(void);

/* In force; nothing but zeros unless CONFIG_GOOD. */
extern config_t config;
uint32_t config_hash(void);

/* Write a new configuration into the slot that is not in force. Records are judged one by one; nothing takes
 * effect before config_commit, which reads the slot back. Each returns an ORI_RESULT. */
uint8_t config_begin(const mavlink_ori_config_device_t *device);
uint8_t config_add_hinge(const mavlink_ori_config_hinge_t *hinge);
uint8_t config_add_latch(const mavlink_ori_config_latch_t *latch);
uint8_t config_commit(uint32_t hash, uint32_t *found);

/* Count this start, and say its number. */
uint32_t config_count_boot(void);

#endif
