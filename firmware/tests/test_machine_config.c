/* Configurations: when they may be written, and what damaged ones do. */
#include <string.h>

#include "check.h"
#include "core.h"
#include "faults.h"
#include "hinges.h"
#include "machine.h"
#include "motion.h"

static void damage_both_slots(void)
{
    fake.eeprom[40] ^= 1;
    fake.eeprom[1536 + 40] ^= 1;
}

static void test_damaged_configurations_are_a_fault_until_one_is_written(void)
{
    rig_start();
    damage_both_slots();
    rig_restart(PORT_RESET_POWER);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_CONFIG_CORRUPT);
    CHECK_EQUAL(host_clear(ORI_FAULT_CONFIG_CORRUPT), ORI_REFUSED_CAUSE);
    CHECK_EQUAL(host_latch(0, 1), ORI_REFUSED_INDEX);
    CHECK_EQUAL(host_enable(1, NULL, 1), ORI_REFUSED_FAULT);
    frames_pass(3);
    check_outputs_are_off();
    configure_again();
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    CHECK_EQUAL(host_enable(1, NULL, 1), ORI_ACCEPTED);
}

/* The reset's fault hides the damage, and does not take it away with it. */
static void test_damage_behind_another_fault_is_not_forgotten(void)
{
    rig_start();
    damage_both_slots();
    rig_restart(PORT_RESET_WATCHDOG);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_WATCHDOG_RESET);
    CHECK_EQUAL(host_clear(ORI_FAULT_WATCHDOG_RESET), ORI_ACCEPTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_CONFIG_CORRUPT);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(host_clear(ORI_FAULT_CONFIG_CORRUPT), ORI_REFUSED_CAUSE);
    configure_again();
    CHECK_EQUAL(machine_state(), ORI_IDLE);
}

/* Nor does a new configuration end any other fault. */
static void test_a_configuration_ends_no_other_fault(void)
{
    rig_start();
    rig_restart(PORT_RESET_BROWN_OUT);
    configure_again();
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_BROWN_OUT);
    CHECK_EQUAL(host_clear(ORI_FAULT_BROWN_OUT), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
}

static void test_a_reset_without_a_configuration_can_be_cleared(void)
{
    fake_reset();
    memset(&config, 0, sizeof config);
    fake.reset_cause = PORT_RESET_WATCHDOG;
    core_init();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_WATCHDOG_RESET);
    CHECK_EQUAL(host_clear(ORI_FAULT_BROWN_OUT), ORI_REFUSED_FAULT);
    CHECK_EQUAL(host_clear(ORI_FAULT_WATCHDOG_RESET), ORI_ACCEPTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    CHECK_EQUAL(machine_state(), ORI_UNCONFIGURED);
    CHECK_EQUAL(host_enable(0, NULL, 1), ORI_REFUSED_STATE);
    configure_again();
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    /* Or later. */
    fake_reset();
    fake.reset_cause = PORT_RESET_WATCHDOG;
    core_init();
    configure_again();
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(host_clear(ORI_FAULT_WATCHDOG_RESET), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
}

static void test_configuring_needs_everything_off(void)
{
    const mavlink_ori_config_device_t device = rig_device(0, 0);
    const uint32_t hash = rig_hash(&device, NULL, NULL);
    uint8_t index = ORI_NOBODY;
    int32_t value = 0;
    rig_start();
    CHECK_EQUAL(host_enable(0x4, NULL, 1), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_begin(&device, &index, &value), ORI_REFUSED_STATE);
    CHECK_EQUAL(host_disable(0x4), ORI_ACCEPTED);
    CHECK_EQUAL(host_latch(1, 1), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_begin(&device, &index, &value), ORI_REFUSED_STATE);
    CHECK_EQUAL(host_latch(1, 0), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_begin(&device, &index, &value), ORI_ACCEPTED);
    CHECK_EQUAL(host_enable(0x4, NULL, 1), ORI_ACCEPTED); /* the old one is in force until the end */
    CHECK_EQUAL(machine_config_commit(hash, &index, &value), ORI_REFUSED_STATE);
    CHECK_EQUAL(hinges_on(), 0x4);
    CHECK_EQUAL(host_disable(0x4), ORI_ACCEPTED);
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_commit(hash, &index, &value), ORI_REFUSED_STATE);
    CHECK(fake.magnet[1]);
    CHECK_EQUAL(host_latch(0, 0), ORI_ACCEPTED); /* no frame passed: it is cold */
    CHECK_EQUAL(machine_config_commit(hash, &index, &value), ORI_ACCEPTED);
    CHECK_EQUAL((uint32_t)value, hash);
    CHECK_EQUAL(config_hash(), hash);
}

/* Another configuration would take the heat for another magnet's, or forget it. */
static void test_configuring_waits_for_magnets_to_cool(void)
{
    mavlink_ori_config_device_t device = rig_device(0, 0);
    const uint32_t hash = rig_hash(&device, NULL, NULL);
    rig_start();
    device.token = host_token();
    CHECK_EQUAL(host_commands(KIND(ORI_CONFIG_DEVICE), &device).result, ORI_ACCEPTED);
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    frames_pass(10);
    CHECK_EQUAL(host_latch(0, 0), ORI_ACCEPTED);
    mavlink_ori_config_commit_t commit = {.token = host_token(), .hash = hash};
    mavlink_ori_ack_t ack = host_commands(KIND(ORI_CONFIG_COMMIT), &commit);
    CHECK_EQUAL(ack.result, ORI_REFUSED_HOT);
    CHECK_EQUAL(ack.index, 0);
    CHECK_EQUAL(ack.value, 600); /* 200 ms 0.75 / 0.25 */
    frames_pass(29);
    device.token = host_token();
    ack = host_commands(KIND(ORI_CONFIG_DEVICE), &device);
    CHECK_EQUAL(ack.result, ORI_REFUSED_HOT);
    CHECK_EQUAL(ack.index, 0);
    CHECK_EQUAL(ack.value, 20);
    frames_pass(1);
    commit.token = host_token(); /* what was begun before is still there */
    ack = host_commands(KIND(ORI_CONFIG_COMMIT), &commit);
    CHECK_EQUAL(ack.result, ORI_ACCEPTED);
    CHECK_EQUAL((uint32_t)ack.value, hash);
    CHECK_EQUAL(ack.index, ORI_NOBODY);
}

static void test_a_refused_configuration_changes_nothing(void)
{
    const mavlink_ori_config_device_t device = rig_device(0, 0);
    uint8_t index = ORI_NOBODY;
    int32_t value = 0;
    rig_start();
    const uint32_t old = config_hash();
    fake.estop = true;
    frame_passes();
    fake.estop = false;
    CHECK_EQUAL(machine_config_begin(&device, &index, &value), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_commit(12345, &index, &value), ORI_REFUSED_HASH);
    CHECK_EQUAL((uint32_t)value, rig_hash(&device, NULL, NULL));
    CHECK_EQUAL(config_hash(), old);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
}

static void test_a_configuration_that_is_not_whole_has_no_hash(void)
{
    const mavlink_ori_config_device_t device = rig_device(1, 0);
    uint8_t index = ORI_NOBODY;
    int32_t value = 0;
    rig_start();
    CHECK_EQUAL(machine_config_begin(&device, &index, &value), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_commit(12345, &index, &value), ORI_REFUSED_INDEX);
    CHECK_EQUAL(value, 0);
}

static void test_a_new_configuration_begins_afresh(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0, NULL, STREAM), ORI_ACCEPTED);
    begin_us = fake.micros + 100000;
    host_knot(STREAM, 0, begin_us, 0, 0);
    CHECK_EQUAL(machine_queued(), 1);
    configure_again();
    CHECK_EQUAL(machine_queued(), 0);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    host_knot(STREAM, 1, begin_us + 20000, 0, 0); /* the stream is closed */
    CHECK_EQUAL(machine_queued(), 0);
    check_outputs_are_off();
}

SUITE(machine_config, TEST(test_damaged_configurations_are_a_fault_until_one_is_written),
      TEST(test_damage_behind_another_fault_is_not_forgotten), TEST(test_a_configuration_ends_no_other_fault),
      TEST(test_a_reset_without_a_configuration_can_be_cleared), TEST(test_configuring_needs_everything_off),
      TEST(test_configuring_waits_for_magnets_to_cool),
      TEST(test_a_refused_configuration_changes_nothing), TEST(test_a_configuration_that_is_not_whole_has_no_hash), TEST(test_a_new_configuration_begins_afresh));
