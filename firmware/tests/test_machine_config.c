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
    uint32_t found = 0;
    rig_start();
    CHECK_EQUAL(host_enable(0x4, NULL, 1), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_begin(&device), ORI_REFUSED_STATE);
    CHECK_EQUAL(host_disable(0x4), ORI_ACCEPTED);
    CHECK_EQUAL(host_latch(1, 1), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_begin(&device), ORI_REFUSED_STATE);
    CHECK_EQUAL(host_latch(1, 0), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_begin(&device), ORI_ACCEPTED);
    CHECK_EQUAL(host_enable(0x4, NULL, 1), ORI_ACCEPTED); /* the old one is in force until the end */
    CHECK_EQUAL(machine_config_commit(hash, &found), ORI_REFUSED_STATE);
    CHECK_EQUAL(hinges_on(), 0x4);
    CHECK_EQUAL(host_disable(0x4), ORI_ACCEPTED);
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_commit(hash, &found), ORI_REFUSED_STATE);
    CHECK(fake.magnet[1]);
    CHECK_EQUAL(host_latch(0, 0), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_commit(hash, &found), ORI_ACCEPTED);
    CHECK_EQUAL(found, hash);
    CHECK_EQUAL(config_hash(), hash);
}

static void test_a_refused_configuration_changes_nothing(void)
{
    const mavlink_ori_config_device_t device = rig_device(0, 0);
    uint32_t found = 0;
    rig_start();
    const uint32_t old = config_hash();
    fake.estop = true;
    frame_passes();
    fake.estop = false;
    CHECK_EQUAL(machine_config_begin(&device), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_commit(12345, &found), ORI_REFUSED_HASH);
    CHECK_EQUAL(found, rig_hash(&device, NULL, NULL));
    CHECK_EQUAL(config_hash(), old);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
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
      TEST(test_a_refused_configuration_changes_nothing), TEST(test_a_new_configuration_begins_afresh));
