/* Commands: turning hinges on and off. */
#include "check.h"
#include "faults.h"
#include "hinges.h"
#include "machine.h"
#include "motion.h"

static void test_enabling_holds_where_things_are(void)
{
    const int32_t there[ORI_HINGES] = {100000, -200000, 300000};
    rig_start();
    rig_place(0, 0.1);
    rig_place(1, -0.2);
    rig_place(2, 0.3);
    CHECK_EQUAL(host_enable(ALL, there, 9), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(machine_stream(), 9);
    CHECK_EQUAL(machine_contiguous(), 0);
    CHECK_EQUAL(fake.servo[rig_hinge(1).channel], rig_ticks(1, -0.2));
    check_rests();
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE); /* silence at rest is none */
}

static void test_enabling_elsewhere_is_refused_and_told(void)
{
    mavlink_ori_enable_t enable = {.token = host_token(), .hinges = ALL, .stream = 9};
    rig_start();
    rig_place(1, 0.1);
    const mavlink_ori_ack_t ack = host_commands(KIND(ORI_ENABLE), &enable);
    CHECK_EQUAL(ack.result, ORI_REFUSED_POSITION);
    CHECK_EQUAL(ack.index, 1);
    CHECK_EQUAL(ack.value, 100000);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    CHECK_EQUAL(machine_stream(), 0);
    check_outputs_are_off();
    check_no_knot_is_taken();
}

static void test_enabling_nothing_stays_idle(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0, NULL, 3), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    CHECK_EQUAL(machine_stream(), 3);
    check_outputs_are_off();
}

static void test_more_hinges_go_on_while_others_hold(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0x1, NULL, 1), ORI_ACCEPTED);
    CHECK_EQUAL(host_enable(0x6, NULL, 2), ORI_ACCEPTED);
    CHECK_EQUAL(hinges_on(), 0x7);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(machine_stream(), 2);
}

static void test_enabling_is_refused_under_way(void)
{
    mavlink_ori_enable_t enable = {.token = host_token(), .hinges = ALL, .stream = 9};
    set_moving();
    const mavlink_ori_ack_t ack = host_commands(KIND(ORI_ENABLE), &enable);
    CHECK_EQUAL(ack.result, ORI_REFUSED_STATE);
    CHECK_EQUAL(ack.value, ORI_STREAMING);
    CHECK_EQUAL(machine_stream(), STREAM);
    stream_for(3);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
}

static void test_disabling(void)
{
    rig_start();
    CHECK_EQUAL(host_disable(ALL), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    enable_all();
    CHECK_EQUAL(host_disable(0x2), ORI_ACCEPTED);
    CHECK_EQUAL(hinges_on(), 0x5);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(host_disable(0x5), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    check_outputs_are_off();
}

static void test_what_moves_is_not_disabled(void)
{
    mavlink_ori_disable_t disable = {.token = host_token(), .hinges = ALL};
    set_moving();
    mavlink_ori_ack_t ack = host_commands(KIND(ORI_DISABLE), &disable);
    CHECK_EQUAL(ack.result, ORI_REFUSED_STATE);
    CHECK_EQUAL(ack.value, ORI_STREAMING);
    CHECK_EQUAL(hinges_on(), ALL);
    machine_brake();
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    disable.token = host_token();
    ack = host_commands(KIND(ORI_DISABLE), &disable);
    CHECK_EQUAL(ack.result, ORI_REFUSED_STATE);
    CHECK_EQUAL(ack.value, ORI_BRAKING);
    CHECK_EQUAL(hinges_on(), ALL);
    check_brakes(0);
    CHECK_EQUAL(host_disable(ALL), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    check_outputs_are_off();
}

SUITE(machine_commands, TEST(test_enabling_holds_where_things_are), TEST(test_enabling_elsewhere_is_refused_and_told),
      TEST(test_enabling_nothing_stays_idle), TEST(test_more_hinges_go_on_while_others_hold),
      TEST(test_enabling_is_refused_under_way), TEST(test_disabling), TEST(test_what_moves_is_not_disabled));
