/* Faults: what latches them, what they do, and what ends them. */
#include "check.h"
#include "events.h"
#include "faults.h"
#include "hinges.h"
#include "machine.h"
#include "motion.h"
#include "queue.h"

static void test_a_stalled_hinge_goes_off_and_the_others_brake(void)
{
    set_moving();
    for (unsigned i = 0; i < 6; i++) { /* 40 ms of them within 0.1 rad */
        send_ahead();
        frame_passes();
        hinges_follow();
        rig_place(1, 0.2);
    }
    while (machine_state() == ORI_STREAMING) {
        send_ahead();
        frame_passes();
        hinges_follow();
        rig_place(1, 0.2);
    }
    CHECK_EQUAL(fault_latched(), ORI_FAULT_STALL);
    CHECK_EQUAL(fault_index(), 1);
    CHECK_EQUAL(hinges_on(), 0x5);
    CHECK_EQUAL(fake.servo[rig_hinge(1).channel], 0);
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    check_brakes(0);
    CHECK_EQUAL(hinges_on(), 0x5);
    CHECK_EQUAL(fake.servo[rig_hinge(1).channel], 0);
    check_rests();
    CHECK_EQUAL(host_state().stalled, 0x2);
    CHECK_EQUAL(host_clear(ORI_FAULT_STALL), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(host_state().stalled, 0);
}

static void test_a_stall_at_rest(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0x1, NULL, STREAM), ORI_ACCEPTED);
    rig_place(0, 0.5);
    for (unsigned i = 0; i < 6; i++) {
        CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
        host_polls();
        frame_passes();
    }
    CHECK_EQUAL(fault_latched(), ORI_FAULT_STALL);
    CHECK_EQUAL(fault_index(), 0);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(hinges_on(), 0);
    CHECK_EQUAL(host_clear(ORI_FAULT_STALL), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE); /* none is on any more */
}

/* A hinge may also stall behind a fault that is latched: it goes off all the same. */
static void test_a_stall_behind_another_fault(void)
{
    rig_start();
    enable_all();
    fake.estop = true;
    frames_pass(1);
    rig_place(2, 0.5);
    for (unsigned i = 0; i < 6; i++)
        frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(hinges_on(), 0x3);
}

static void test_lost_feedback_under_way_brakes(void)
{
    set_moving();
    for (unsigned i = 0; i < 5; i++) {
        fake.adc[rig_hinge(1).adc] = 0;
        send_ahead();
        frame_passes();
        CHECK_EQUAL(machine_state(), ORI_STREAMING);
        hinges_follow();
    }
    fake.adc[rig_hinge(1).adc] = 0;
    send_ahead();
    frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_FEEDBACK_LOST);
    CHECK_EQUAL(fault_index(), 1);
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    check_no_knot_is_taken();
    check_brakes(0);
    CHECK_EQUAL(hinges_on(), ALL);
    check_rests();
    CHECK_EQUAL(host_clear(ORI_FAULT_FEEDBACK_LOST), ORI_ACCEPTED); /* hinges_follow mended it */
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
}

/* At rest it is one as well: who holds and is pushed away would not be noticed. */
static void test_lost_feedback_at_rest(void)
{
    rig_start();
    enable_all();
    fake.adc[rig_hinge(2).adc] = 0;
    for (unsigned i = 0; i < 5; i++) {
        frame_passes();
        CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    }
    frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_FEEDBACK_LOST);
    CHECK_EQUAL(fault_index(), 2);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(hinges_on(), ALL);
    CHECK_EQUAL(host_clear(ORI_FAULT_FEEDBACK_LOST), ORI_REFUSED_CAUSE);
    CHECK_EQUAL(host_disable(0x4), ORI_ACCEPTED);
    CHECK_EQUAL(host_clear(ORI_FAULT_FEEDBACK_LOST), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
}

/* A supply that fails silences the servos: it is what is told. */
static void test_a_supply_that_fails_is_no_lost_feedback(void)
{
    rig_start();
    enable_all();
    fake.adc[ORI_ADC_SUPPLY] = 0;
    for (uint8_t i = 0; i < RIG_HINGES; i++)
        fake.adc[rig_hinge(i).adc] = 0;
    for (unsigned i = 0; i < 10; i++)
        frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_SUPPLY_LOW);
}

static void test_the_emergency_stop(void)
{
    set_moving();
    fake.estop = true;
    frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(fault_index(), ORI_NOBODY);
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    check_no_knot_is_taken();
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_REFUSED_STATE);
    check_brakes(0);
    check_rests();
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_REFUSED_CAUSE);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    fake.estop = false;
    CHECK_EQUAL(host_clear(ORI_FAULT_STALL), ORI_REFUSED_FAULT);
    CHECK_EQUAL(host_clear(ORI_FAULT_NONE), ORI_REFUSED_FAULT);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(host_enable(ALL, hinges_asked(), STREAM), ORI_REFUSED_FAULT);
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_ACCEPTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_ACCEPTED); /* none is latched */
}

static void test_the_emergency_stop_at_rest(void)
{
    rig_start();
    fake.estop = true;
    frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    fake.estop = false;
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
}

static void test_a_sagging_supply(void)
{
    set_moving();
    fake.adc[ORI_ADC_SUPPLY] = 499;
    stream_for(4);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
    fake.adc[ORI_ADC_SUPPLY] = 500;
    stream_for(1);
    fake.adc[ORI_ADC_SUPPLY] = 499;
    stream_for(4);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
    stream_for(1);
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_SUPPLY_LOW);
    CHECK_EQUAL(fault_index(), ORI_NOBODY);
    check_brakes(0);
    CHECK_EQUAL(host_clear(ORI_FAULT_SUPPLY_LOW), ORI_REFUSED_CAUSE);
    fake.adc[ORI_ADC_SUPPLY] = 600;
    CHECK_EQUAL(host_clear(ORI_FAULT_SUPPLY_LOW), ORI_ACCEPTED);
    frames_pass(5);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
}

static void test_the_causes_of_other_faults_do_not_matter(void)
{
    rig_start();
    rig_restart(PORT_RESET_WATCHDOG);
    fake.estop = true;
    fake.adc[ORI_ADC_SUPPLY] = 0;
    CHECK_EQUAL(host_clear(ORI_FAULT_WATCHDOG_RESET), ORI_ACCEPTED);
    frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    fake.estop = false;
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_ACCEPTED);
    frames_pass(5);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE); /* nothing is driven */
}

/* The servos' supply may come after the board's own, and go before it: only what is driven needs it. */
static void test_a_supply_that_is_off_is_no_fault(void)
{
    rig_start();
    fake.adc[ORI_ADC_SUPPLY] = 0;
    frames_pass(20);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    fake.adc[ORI_ADC_SUPPLY] = 499;
    const mavlink_ori_enable_t enable = {.token = host_token(), .hinges = ALL, .stream = STREAM};
    mavlink_ori_ack_t ack = host_commands(KIND(ORI_ENABLE), &enable);
    CHECK_EQUAL(ack.result, ORI_REFUSED_SUPPLY);
    CHECK_EQUAL(ack.index, ORI_NOBODY);
    CHECK_EQUAL(ack.value, 4990);
    CHECK_EQUAL(host_enable(0, NULL, STREAM), ORI_ACCEPTED); /* drives nothing */
    CHECK_EQUAL(host_latch(2, 1), ORI_ACCEPTED);
    for (uint8_t i = 0; i < 2; i++) {
        const mavlink_ori_latch_command_t engage = {.token = host_token(), .index = i, .engage = 1};
        ack = host_commands(KIND(ORI_LATCH_COMMAND), &engage);
        CHECK_EQUAL(ack.result, ORI_REFUSED_SUPPLY);
        CHECK_EQUAL(ack.index, i);
        CHECK_EQUAL(ack.value, 4990);
        CHECK_EQUAL(host_latch(i, 0), ORI_ACCEPTED); /* what is to let go may */
    }
    CHECK_EQUAL(host_latch(3, 1), ORI_REFUSED_INDEX);
    fake.adc[ORI_ADC_SUPPLY] = 500;
    enable_all();
    frames_pass(20);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
}

/* A latch needs it as a hinge does; and what was latched can be cleared when nothing is driven any more. */
static void test_a_supply_that_goes_off_under_a_latch(void)
{
    for (uint8_t i = 0; i < 2; i++) {
        rig_start();
        CHECK_EQUAL(host_latch(i, 1), ORI_ACCEPTED);
        fake.adc[ORI_ADC_SUPPLY] = 0;
        frames_pass(4);
        CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
        frames_pass(1);
        CHECK_EQUAL(fault_latched(), ORI_FAULT_SUPPLY_LOW);
        CHECK_EQUAL(machine_state(), ORI_FAULTED);
        CHECK_EQUAL(host_clear(ORI_FAULT_SUPPLY_LOW), ORI_REFUSED_CAUSE);
        CHECK_EQUAL(host_latch(i, 0), ORI_ACCEPTED);
        CHECK_EQUAL(host_clear(ORI_FAULT_SUPPLY_LOW), ORI_ACCEPTED);
        frames_pass(10);
        CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    }
}

/* What cannot be is a fault for good. */
static void test_an_empty_queue_under_way_is_an_internal_fault(void)
{
    rig_start();
    enable_all();
    begin_us += 7000; /* so that no output is at a knot */
    stream_for(25);
    const double at = output(0);
    queue_clear();
    frame_passes();
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_INTERNAL);
    CHECK_NEAR(output(0), at, 0);
    set_moving(); /* nor is it hidden by what it brakes for */
    machine_trip(ORI_FAULT_UNDERRUN, ORI_NOBODY);
    queue_clear();
    frame_passes();
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_INTERNAL);
    rig_start();
    enable_all();
    host_knot(STREAM, 0, begin_us, 0, 0); /* a knot at rest: nothing runs low */
    queue_clear();
    frame_passes();
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_INTERNAL);
    CHECK_EQUAL(fault_index(), ORI_NOBODY);
    CHECK_EQUAL(host_clear(ORI_FAULT_INTERNAL), ORI_REFUSED_CAUSE);
}

/* Latches ------------------------------------------------------------------------------------------------------ */

static void test_faults_and_silence_move_no_latch(void)
{
    set_moving();
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    CHECK_EQUAL(host_latch(1, 1), ORI_ACCEPTED);
    const uint16_t pin = fake.servo[rig_latch(1).output];
    const unsigned calls = fake.magnet_calls;
    CHECK(fake.magnet[1] && pin == 3800);
    while (machine_state() != ORI_FAULTED)
        frame_passes();
    fake.estop = true;
    for (unsigned i = 0; i < 20; i++)
        frame_passes();
    CHECK(fake.magnet[1]);
    CHECK_EQUAL(fake.servo[rig_latch(1).output], pin);
    CHECK_EQUAL(fake.magnet_calls, calls);
    /* Commands are taken all the same. */
    CHECK_EQUAL(host_latch(1, 0), ORI_ACCEPTED);
    CHECK_EQUAL(fake.servo[rig_latch(1).output], 2200);
    CHECK_EQUAL(host_latch(3, 1), ORI_REFUSED_INDEX);
}

static void test_magnets_protect_themselves_during_a_fault(void)
{
    rig_start();
    fake.estop = true;
    frame_passes();
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    for (unsigned i = 0; i < 50; i++)
        frame_passes();
    CHECK(!fake.magnet[1]);
    CHECK_EQUAL(host_latch(0, 1), ORI_REFUSED_TRIPPED);
    CHECK_EQUAL(host_latches().tripped, 0x1);
}

/* Nor does anything but time cool them: no clearing, no restart. */
static void test_nothing_forgets_the_heat_of_magnets(void)
{
    rig_start();
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    fake.estop = true;
    for (unsigned i = 0; i < 50; i++)
        frame_passes();
    fake.estop = false;
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_ACCEPTED);
    CHECK_EQUAL(host_latch(0, 1), ORI_REFUSED_TRIPPED);
    rig_restart(PORT_RESET_WATCHDOG);
    CHECK_EQUAL(host_latch(0, 1), ORI_REFUSED_TRIPPED);
    CHECK_EQUAL(host_clear(ORI_FAULT_WATCHDOG_RESET), ORI_ACCEPTED);
    CHECK_EQUAL(host_latch(0, 1), ORI_REFUSED_TRIPPED);
    frames_pass(149);
    CHECK_EQUAL(host_latch(0, 1), ORI_REFUSED_TRIPPED);
    frames_pass(1);
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
}

/* Each is told with its own number. */
static void test_magnets_that_trip_are_told_apart(void)
{
    mavlink_ori_event_t event;
    rig_start();
    config.latch[2] = rig_latch(0); /* a second magnet */
    config.latch[2].output = 5;
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    CHECK_EQUAL(host_latch(2, 1), ORI_ACCEPTED);
    while (events_take(&event))
        ;
    for (unsigned i = 0; i < 50; i++)
        frame_passes();
    for (uint8_t i = 0; i < 3; i += 2) {
        CHECK(events_take(&event));
        CHECK_EQUAL(event.code, ORI_EVENT_LATCH_TRIPPED);
        CHECK_EQUAL(event.index, i);
        CHECK_EQUAL(event.value, 0);
    }
    CHECK(!events_take(&event));
}

static void test_clearing_without_hinges_on_is_idle(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0, NULL, STREAM), ORI_ACCEPTED);
    host_knot(STREAM, 0, fake.micros + 500000, 0, 0);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
    machine_brake();
    for (unsigned i = 0; i < 10; i++)
        frame_passes();
    CHECK_EQUAL(host_clear(ORI_FAULT_HOST_BRAKE), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
}

SUITE(machine_faults, TEST(test_a_stalled_hinge_goes_off_and_the_others_brake), TEST(test_a_stall_at_rest),
      TEST(test_a_stall_behind_another_fault),
      TEST(test_lost_feedback_under_way_brakes), TEST(test_lost_feedback_at_rest),
      TEST(test_a_supply_that_fails_is_no_lost_feedback), TEST(test_the_emergency_stop), TEST(test_the_emergency_stop_at_rest),
      TEST(test_a_sagging_supply), TEST(test_the_causes_of_other_faults_do_not_matter),
      TEST(test_a_supply_that_is_off_is_no_fault), TEST(test_a_supply_that_goes_off_under_a_latch),
      TEST(test_an_empty_queue_under_way_is_an_internal_fault), TEST(test_faults_and_silence_move_no_latch),
      TEST(test_magnets_protect_themselves_during_a_fault), TEST(test_nothing_forgets_the_heat_of_magnets),
      TEST(test_magnets_that_trip_are_told_apart),
      TEST(test_clearing_without_hinges_on_is_idle));
