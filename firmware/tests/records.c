#include "records.h"

#include <string.h>

#include "check.h"

mavlink_ori_config_device_t device;
mavlink_ori_config_hinge_t hinges[ORI_HINGES];
mavlink_ori_config_latch_t latches[ORI_LATCHES];

void set_up(uint8_t hinge_count, uint8_t latch_count)
{
    fake_reset();
    CHECK_EQUAL(config_load(), CONFIG_NONE);
    device = rig_device(hinge_count, latch_count);
    for (uint8_t i = 0; i < ORI_HINGES; i++)
        hinges[i] = rig_hinge(i);
    for (uint8_t i = 0; i < ORI_LATCHES; i++) {
        latches[i] = rig_latch(i);
        if (hinge_count > 3 && latches[i].kind == ORI_LOCK_PIN)
            latches[i].kind = ORI_MAGNET; /* no servo outputs left */
    }
}

void store(void)
{
    rig_store(&device, hinges, latches);
}

uint32_t hash(void)
{
    return rig_hash(&device, hinges, latches);
}

void send_records(void)
{
    CHECK_EQUAL(config_begin(&device), ORI_ACCEPTED);
    for (unsigned i = 0; i < device.hinges; i++)
        CHECK_EQUAL(config_add_hinge(&hinges[i]), ORI_ACCEPTED);
    for (unsigned i = 0; i < device.latches; i++)
        CHECK_EQUAL(config_add_latch(&latches[i]), ORI_ACCEPTED);
}

uint8_t commit(uint32_t wanted)
{
    uint32_t found = 0;
    return config_commit(wanted, &found);
}

void check_in_force(void)
{
    CHECK_EQUAL(config_hash(), hash());
    CHECK(memcmp(&config.device, &device, MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN) == 0);
    for (unsigned i = 0; i < device.hinges; i++)
        CHECK(memcmp(&config.hinge[i], &hinges[i], MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN) == 0);
    for (unsigned i = 0; i < device.latches; i++)
        CHECK(memcmp(&config.latch[i], &latches[i], MAVLINK_MSG_ID_ORI_CONFIG_LATCH_LEN) == 0);
}
