/* Braking: along what is queued, gently, to rest. */
#include <string.h>

#include "check.h"
#include "events.h"
#include "faults.h"
#include "hinges.h"
#include "machine.h"
#include "motion.h"

static void test_the_host_can_brake(void)
{
    const mavlink_ori_brake_t brake = {.token = 4321};
    set_moving();
    CHECK_EQUAL(host_commands(KIND(ORI_BRAKE), &brake).result, ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_HOST_BRAKE);
    CHECK_EQUAL(fault_index(), ORI_NOBODY);
    const double from = output(0);
    CHECK_EQUAL(check_brakes(0), BRAKE_MS / 20);
    CHECK_NEAR(output(0) - from, 1.0 * BRAKE_MS * 1e-3 / 2, 5e-6);
    check_no_knot_is_taken();
    check_rests();
    CHECK_EQUAL(host_clear(ORI_FAULT_HOST_BRAKE), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    machine_brake();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
}

/* Any time of braking uses up its half of the profile, in as many frames as it has; the end is never a jerk. */
static void test_braking_takes_its_time(void)
{
    for (uint16_t brake_ms = 20; brake_ms < 110; brake_ms++) {
        set_moving();
        config.device.brake_ms = brake_ms;
        send_ahead();
        const double from = output(1);
        machine_brake();
        unsigned frames = 0;
        while (machine_state() == ORI_BRAKING) {
            frame_passes();
            hinges_follow();
            frames++;
        }
        CHECK_EQUAL(frames, (brake_ms + 19U) / 20U);
        CHECK_NEAR(output(1) - from, brake_ms * 0.5e-3, 1e-5);
    }
}

static void test_a_motion_that_has_not_begun_does_not_begin(void)
{
    rig_start();
    enable_all();
    for (uint16_t i = 0; i < 10; i++)
        send_knot(i);
    frame_passes();
    machine_brake();
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    for (unsigned i = 0; i < 10; i++)
        frame_passes();
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK(hinges_asked()[0] < 1000); /* 10 ms of 10 rad/s^2 at most */
    check_rests();
}

/* Braking may reach the end of a motion first. */
static void test_braking_ends_where_the_queue_ends(void)
{
    rig_start();
    enable_all();
    host_knot(STREAM, 0, begin_us, 0, 0);
    host_knot(STREAM, 1, begin_us + 50000, 8000, 0);
    while (fake.micros + ORI_FRAME_US + 15000 < begin_us + 50000)
        frames_pass(1);
    machine_brake();
    frames_pass(1);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(hinges_asked()[0], 8000);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_HOST_BRAKE);
}

static void test_a_second_fault_while_braking_changes_nothing(void)
{
    set_moving();
    machine_trip(ORI_FAULT_UNDERRUN, ORI_NOBODY);
    frame_passes();
    fake.estop = true;
    fake.adc[ORI_ADC_SUPPLY] = 0;
    check_brakes(1);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_UNDERRUN);
    mavlink_ori_event_t event;
    while (events_take(&event))
        ;
    check_rests();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_UNDERRUN);
    CHECK(!events_take(&event)); /* what is found again in every frame is not told again */
    /* The cleared one makes room for what is still wrong. */
    CHECK_EQUAL(host_clear(ORI_FAULT_UNDERRUN), ORI_ACCEPTED);
    frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
}

/* The host brakes for a reason: what the device finds then is what has to be known, and cleared. */
static void test_a_fault_takes_the_place_of_the_hosts_wish(void)
{
    mavlink_ori_event_t event;
    set_moving();
    machine_brake();
    frame_passes();
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    while (events_take(&event))
        ;
    fake.estop = true;
    frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    CHECK(events_take(&event));
    CHECK_EQUAL(event.code, ORI_EVENT_FAULT);
    CHECK_EQUAL(event.index, ORI_FAULT_ESTOP);
    check_brakes(0); /* as gently as before */
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_REFUSED_CAUSE);
    fake.estop = false;
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_ACCEPTED);
    set_moving(); /* and at rest */
    machine_brake();
    check_brakes(0);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_HOST_BRAKE);
    fake.estop = true;
    frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    check_rests();
}

/* A second motion after a fault runs at its full speed. */
static void test_after_braking_a_motion_runs_as_ever(void)
{
    set_moving();
    machine_brake();
    check_brakes(0);
    CHECK_EQUAL(host_clear(ORI_FAULT_HOST_BRAKE), ORI_ACCEPTED);
    check_no_knot_is_taken();
    int32_t there[ORI_HINGES];
    memcpy(there, hinges_asked(), sizeof there);
    hinges_follow();
    CHECK_EQUAL(host_enable(ALL, there, STREAM), ORI_ACCEPTED);
    CHECK_EQUAL(machine_contiguous(), 0);
    const uint64_t at = fake.micros + 60000;
    host_knot(STREAM, 0, at, there[0], 0);
    host_knot(STREAM, 1, at + 200000, there[0] + 20000, 0);
    frames_pass(7);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
    const double u = (double)(fake.micros + ORI_FRAME_US - at) / 200000;
    CHECK_NEAR(hinges_asked()[0] - there[0], 20000 * u * u * (3 - 2 * u), 2);
    frames_pass(10);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(hinges_asked()[0], there[0] + 20000);
}

static void test_the_second_time_braking_is_as_gentle(void)
{
    for (unsigned round = 0; round < 3; round++) {
        if (round == 0)
            set_moving();
        else
            stream_for(12);
        CHECK_EQUAL(machine_state(), ORI_STREAMING);
        machine_brake();
        CHECK_EQUAL(check_brakes(0), BRAKE_MS / 20);
        CHECK_EQUAL(host_clear(ORI_FAULT_HOST_BRAKE), ORI_ACCEPTED);
        CHECK_EQUAL(host_disable(ALL), ORI_ACCEPTED);
        for (uint8_t i = 0; i < RIG_HINGES; i++)
            rig_place(i, 0); /* by hand */
        enable_all();
    }
}

SUITE(machine_braking, TEST(test_the_host_can_brake), TEST(test_braking_takes_its_time),
      TEST(test_a_motion_that_has_not_begun_does_not_begin), TEST(test_braking_ends_where_the_queue_ends),
      TEST(test_a_second_fault_while_braking_changes_nothing),
      TEST(test_a_fault_takes_the_place_of_the_hosts_wish), TEST(test_after_braking_a_motion_runs_as_ever),
      TEST(test_the_second_time_braking_is_as_gentle));
