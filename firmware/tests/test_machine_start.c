/* The start: nothing moves, whatever came before. */
#include <string.h>

#include "check.h"
#include "core.h"
#include "events.h"
#include "faults.h"
#include "machine.h"
#include "motion.h"

static void test_nothing_moves_at_the_start(void)
{
    static const port_reset_t causes[] = {PORT_RESET_POWER, PORT_RESET_EXTERNAL, PORT_RESET_BROWN_OUT, PORT_RESET_WATCHDOG};
    static const uint8_t faults[] = {ORI_FAULT_NONE, ORI_FAULT_NONE, ORI_FAULT_BROWN_OUT, ORI_FAULT_WATCHDOG_RESET};
    for (unsigned i = 0; i < 4; i++) {
        rig_start();
        rig_restart(causes[i]);
        frames_pass(50);
        check_outputs_are_off();
        CHECK_EQUAL(fault_latched(), faults[i]);
        CHECK_EQUAL(machine_state(), faults[i] ? ORI_FAULTED : ORI_IDLE);
        CHECK_EQUAL(machine_contiguous() | machine_stream() | machine_queued(), 0);
    }
}

static void test_a_restart_under_way_leaves_nothing_on(void)
{
    set_moving();
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    rig_restart(PORT_RESET_WATCHDOG);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_WATCHDOG_RESET);
    CHECK_EQUAL(machine_contiguous() | machine_stream() | machine_queued(), 0);
    CHECK_EQUAL(host_state().outputs_on, 0);
    CHECK_EQUAL(host_latches().commanded, 0);
    check_no_knot_is_taken();
    frames_pass(10);
    check_outputs_are_off();
    CHECK_EQUAL(host_enable(ALL, NULL, STREAM), ORI_REFUSED_FAULT);
    CHECK_EQUAL(host_clear(ORI_FAULT_WATCHDOG_RESET), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    check_no_knot_is_taken();
    rig_restart(PORT_RESET_POWER);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
}

static void test_without_a_configuration_nothing_goes_on(void)
{
    fake_reset();
    memset(&config, 0, sizeof config);
    core_init();
    frames_pass(5);
    CHECK_EQUAL(machine_state(), ORI_UNCONFIGURED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    CHECK_EQUAL(host_enable(1, NULL, 1), ORI_REFUSED_STATE);
    CHECK_EQUAL(host_latch(0, 1), ORI_REFUSED_STATE);
    CHECK_EQUAL(host_clear(ORI_FAULT_STALL), ORI_ACCEPTED);
    fake.estop = true; /* nothing is watched yet */
    frames_pass(5);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    check_outputs_are_off();
}

static void check_event(uint8_t code, uint8_t index, int32_t value)
{
    mavlink_ori_event_t event;
    CHECK(events_take(&event));
    CHECK_EQUAL(event.code, code);
    CHECK_EQUAL(event.index, index);
    CHECK_EQUAL(event.value, value);
}

/* Whatever the memory was before. */
static void test_the_log_of_a_start(void)
{
    mavlink_ori_event_t event;
    set_moving();
    while (events_take(&event))
        ;
    rig_restart(PORT_RESET_WATCHDOG);
    check_event(ORI_EVENT_BOOT, PORT_RESET_WATCHDOG, 0);
    check_event(ORI_EVENT_FAULT, ORI_FAULT_WATCHDOG_RESET, ORI_NOBODY);
    check_event(ORI_EVENT_STATE, ORI_FAULTED, ORI_UNCONFIGURED);
    check_event(ORI_EVENT_CONFIG, 0, (int32_t)config_hash());
    CHECK(!events_take(&event));
}

SUITE(machine_start, TEST(test_nothing_moves_at_the_start), TEST(test_a_restart_under_way_leaves_nothing_on),
      TEST(test_without_a_configuration_nothing_goes_on), TEST(test_the_log_of_a_start));
