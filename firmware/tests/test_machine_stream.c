/* The stream: which knots are taken, and outputs that follow them. */
#include <math.h>

#include "check.h"
#include "core.h"
#include "faults.h"
#include "hinges.h"
#include "machine.h"
#include "motion.h"
#include "queue.h"

/* What the device computes is for the frame after the one that runs. */
static void check_follows(unsigned frames)
{
    for (unsigned i = 0; i < frames; i++) {
        stream_for(1);
        const double s = ((double)fake.micros + ORI_FRAME_US - (double)begin_us) * 1e-6;
        for (uint8_t k = 0; k < RIG_HINGES; k++) {
            CHECK_NEAR(output(k), motion(s), 2e-6);
            CHECK_NEAR(fake.servo[rig_hinge(k).channel], rig_ticks(k, motion(s)), 1);
        }
    }
}

static void test_outputs_follow_the_knots(void)
{
    rig_start();
    enable_all();
    check_follows(60);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
}

static void test_time_may_wrap_around(void)
{
    rig_start();
    fake.micros = (UINT64_C(1) << 32) - 500000;
    enable_all();
    check_follows(60);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
}

/* Frames do not fall onto the knots. */
static void test_outputs_follow_between_the_knots(void)
{
    rig_start();
    fake.micros += 7321;
    enable_all();
    begin_us += 3456;
    check_follows(60);
}

static void test_a_motion_that_ends_holds_and_the_next_one_begins(void)
{
    rig_start();
    enable_all();
    for (unsigned round = 0; round < 3; round++) {
        const int32_t from = (int32_t)round * 10000;
        const uint16_t number = (uint16_t)(2 * round);
        const uint64_t at = fake.micros + 60000;
        host_knot(STREAM, number, at, from, 0);
        host_knot(STREAM, (uint16_t)(number + 1), at + 100000, from + 10000, 0);
        CHECK_EQUAL(machine_state(), ORI_STREAMING);
        CHECK_EQUAL(machine_queued(), 2);
        frames_pass(2);
        CHECK_EQUAL(hinges_asked()[0], from);
        frames_pass(4);
        CHECK_EQUAL(machine_state(), ORI_STREAMING);
        CHECK_EQUAL(machine_queued(), 2);
        frames_pass(1);
        CHECK_EQUAL(hinges_asked()[0], from + 10000);
        CHECK_EQUAL(machine_state(), ORI_HOLDING);
        CHECK_EQUAL(machine_queued(), 0);
        CHECK_EQUAL(machine_contiguous(), number + 2);
        frames_pass(10);
    }
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
}

static void test_hinges_that_are_off_stay_off(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0x5, NULL, STREAM), ORI_ACCEPTED);
    begin_us = fake.micros + 3 * STEP_US;
    sent = 0;
    stream_for(40);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
    CHECK_EQUAL(fake.servo[rig_hinge(1).channel], 0);
    CHECK(output(0) > 0.3 && output(2) > 0.3);
}

/* Knots ------------------------------------------------------------------------------------------------------- */

static void test_knots_are_taken_once_and_in_order(void)
{
    rig_start();
    enable_all();
    send_knot(1);
    CHECK_EQUAL(machine_contiguous(), 0); /* the one before is missing */
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    send_knot(0);
    CHECK_EQUAL(machine_contiguous(), 1);
    send_knot(0);
    send_knot(0);
    CHECK_EQUAL(machine_contiguous(), 1);
    CHECK_EQUAL(machine_queued(), 1);
    send_knot(2);
    CHECK_EQUAL(machine_contiguous(), 1);
    send_knot(1);
    send_knot(2);
    CHECK_EQUAL(machine_contiguous(), 3);
    send_knot(1);
    CHECK_EQUAL(machine_contiguous(), 3);
    CHECK_EQUAL(machine_queued(), 3);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
}

static mavlink_ori_setpoints_t two_knots(uint16_t first)
{
    mavlink_ori_setpoints_t setpoints = {.first = first, .count = 2, .stream = STREAM};
    for (unsigned j = 0; j < 2; j++) {
        const double s = (first + j) * STEP_US * 1e-6;
        setpoints.time_us[j] = (uint32_t)(begin_us + (uint64_t)(first + j) * STEP_US);
        for (unsigned k = 0; k < ORI_HINGES; k++) {
            setpoints.position_urad[j * ORI_HINGES + k] = (int32_t)lround(motion(s) * 1e6) + (int32_t)(k * j);
            setpoints.velocity_mrad_s[j * ORI_HINGES + k] = (int16_t)(lround(speed(s) * 1e3) + (long)(k * j));
        }
    }
    return setpoints;
}

static void test_two_knots_come_in_a_message(void)
{
    rig_start();
    enable_all();
    mavlink_ori_setpoints_t setpoints = two_knots(0);
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(machine_contiguous(), 2);
    CHECK_EQUAL(queue_first()->position_urad[2], 0);
    CHECK_EQUAL(queue_last()->position_urad[2], setpoints.position_urad[ORI_HINGES + 2]);
    CHECK_EQUAL(queue_last()->velocity_mrad_s[2], 202);
    CHECK_EQUAL(queue_last()->time_us, setpoints.time_us[1]);
    setpoints = two_knots(1); /* the first of them it had */
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(machine_contiguous(), 3);
    CHECK_EQUAL(machine_queued(), 3);
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(machine_contiguous(), 3);
    setpoints = two_knots(4);
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(machine_contiguous(), 3);
}

static void test_messages_that_make_no_sense_are_ignored(void)
{
    static const uint8_t counts[] = {0, 3, 255};
    rig_start();
    enable_all();
    mavlink_ori_setpoints_t setpoints = two_knots(0);
    for (unsigned i = 0; i < 3; i++) {
        setpoints.count = counts[i];
        host_says(KIND(ORI_SETPOINTS), &setpoints);
        CHECK_EQUAL(machine_contiguous(), 0);
    }
    setpoints = two_knots(0);
    setpoints.stream = STREAM + 1;
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(machine_contiguous(), 0);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
}

static void test_nothing_is_taken_before_a_stream_is_open(void)
{
    rig_start();
    begin_us = fake.micros + 60000;
    host_knot(0, 0, begin_us, 0, 0);
    CHECK_EQUAL(machine_contiguous(), 0);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
}

static void test_a_full_queue_lets_the_host_repeat(void)
{
    rig_start();
    enable_all();
    for (uint16_t i = 0; i < 25; i++)
        send_knot(i);
    CHECK_EQUAL(machine_queued(), QUEUE_KNOTS);
    CHECK_EQUAL(machine_contiguous(), QUEUE_KNOTS);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    for (unsigned i = 0; i < 3; i++)
        frame_passes(); /* the third one's output is at the second knot */
    CHECK_EQUAL(machine_queued(), QUEUE_KNOTS - 1);
    send_knot(QUEUE_KNOTS);
    CHECK_EQUAL(machine_contiguous(), QUEUE_KNOTS + 1);
    CHECK_EQUAL(machine_queued(), QUEUE_KNOTS);
}

static void test_numbers_wrap_around(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0, NULL, STREAM), ORI_ACCEPTED);
    begin_us = fake.micros + 60000;
    mavlink_ori_setpoints_t setpoints = {.count = 1, .stream = STREAM};
    for (uint32_t i = 0; i < 65540; i++) {
        setpoints.first = (uint16_t)i;
        setpoints.time_us[0] = (uint32_t)(begin_us + (uint64_t)i * 1000);
        machine_setpoints(&setpoints); /* so many frames would take their time */
        machine_heard(fake.micros);
        if (machine_queued() > 15) {
            fake.micros = begin_us + (uint64_t)i * 1000 - 30000;
            core_frame(fake.micros);
        }
        CHECK_EQUAL(machine_contiguous(), (uint16_t)(i + 1));
    }
}

static uint8_t first_knot(int64_t ahead_us, int32_t position_urad, int16_t velocity_mrad_s)
{
    rig_start();
    CHECK_EQUAL(host_enable(0x6, NULL, STREAM), ORI_ACCEPTED);
    mavlink_ori_setpoints_t setpoints = {.count = 1, .stream = STREAM};
    setpoints.time_us[0] = (uint32_t)((int64_t)fake.micros + ahead_us);
    setpoints.position_urad[1] = position_urad;
    setpoints.velocity_mrad_s[1] = velocity_mrad_s;
    setpoints.position_urad[0] = 500000; /* hinge 0 is off: it matters not */
    setpoints.velocity_mrad_s[0] = 5;
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(fault_index(), fault_latched() == ORI_FAULT_DISCONTINUITY ? 1 : ORI_NOBODY);
    CHECK_EQUAL(machine_state(), fault_latched() ? ORI_FAULTED : ORI_STREAMING);
    CHECK_EQUAL(machine_contiguous(), fault_latched() ? 0 : 1);
    return fault_latched();
}

static void test_a_motion_begins_at_rest_where_the_outputs_are(void)
{
    CHECK_EQUAL(first_knot(100000, 0, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(first_knot(100000, 200, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(first_knot(100000, -200, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(first_knot(100000, 201, 0), ORI_FAULT_DISCONTINUITY);
    CHECK_EQUAL(first_knot(100000, -201, 0), ORI_FAULT_DISCONTINUITY);
    CHECK_EQUAL(first_knot(100000, 0, 1), ORI_FAULT_DISCONTINUITY);
    CHECK_EQUAL(first_knot(100000, 0, -1), ORI_FAULT_DISCONTINUITY);
}

/* Outputs are computed up to two frames ahead: what lies nearer would be caught up with in a jump. */
static void test_a_motion_begins_neither_late_nor_far_away(void)
{
    CHECK_EQUAL(first_knot(40000, 0, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(first_knot(39999, 0, 0), ORI_FAULT_KNOT_TIME);
    CHECK_EQUAL(first_knot(0, 0, 0), ORI_FAULT_KNOT_TIME);
    CHECK_EQUAL(first_knot(-1, 0, 0), ORI_FAULT_KNOT_TIME);
    CHECK_EQUAL(first_knot(2000000, 0, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(first_knot(2000001, 0, 0), ORI_FAULT_KNOT_TIME);
    CHECK_EQUAL(first_knot(INT64_C(1) << 31, 0, 0), ORI_FAULT_KNOT_TIME);
}

static void test_knots_beyond_the_limits_are_faults(void)
{
    static const struct {
        int32_t position_urad;
        int16_t velocity_mrad_s;
        uint32_t after_us;
        uint8_t fault;
    } cases[] = {
        {1500001, 0, 20000, ORI_FAULT_POSITION_LIMIT},
        {-1000001, 0, 20000, ORI_FAULT_POSITION_LIMIT},
        {0, 2001, 20000, ORI_FAULT_VELOCITY_LIMIT},
        {100000, 0, 20000, ORI_FAULT_VELOCITY_LIMIT},
        {3000, 0, 20000, ORI_FAULT_ACCELERATION_LIMIT},
        {0, 0, 999, ORI_FAULT_KNOT_TIME},
        {0, 0, 1000001, ORI_FAULT_KNOT_TIME},
    };
    for (unsigned i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        rig_start();
        enable_all();
        send_knot(0);
        host_knot(STREAM, 1, begin_us + cases[i].after_us, cases[i].position_urad, cases[i].velocity_mrad_s);
        CHECK_EQUAL(fault_latched(), cases[i].fault);
        CHECK_EQUAL(fault_index(), cases[i].fault == ORI_FAULT_KNOT_TIME ? ORI_NOBODY : 0);
        CHECK_EQUAL(machine_contiguous(), 1);
        CHECK_EQUAL(machine_state(), ORI_BRAKING);
        check_no_knot_is_taken();
        for (unsigned n = 0; n < 10; n++)
            frame_passes();
        CHECK_EQUAL(machine_state(), ORI_FAULTED);
        CHECK_EQUAL(hinges_asked()[0], 0);
        CHECK_EQUAL(hinges_on(), ALL);
    }
}

/* The first of a stream as well. */
static void test_the_first_knot_is_within_the_limits_too(void)
{
    rig_start();
    enable_all();
    host_knot(STREAM, 0, begin_us, 1500001, 0);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_POSITION_LIMIT);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(machine_queued(), 0);
    check_rests();
}

/* Of two knots in a message the second is not taken when the first is refused. */
static void test_a_refused_knot_ends_its_message(void)
{
    rig_start();
    enable_all();
    mavlink_ori_setpoints_t setpoints = two_knots(0);
    setpoints.position_urad[0] = 300;
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_DISCONTINUITY);
    CHECK_EQUAL(machine_contiguous(), 0);
    CHECK_EQUAL(machine_queued(), 0);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
}

SUITE(machine_stream, TEST(test_outputs_follow_the_knots), TEST(test_time_may_wrap_around),
      TEST(test_outputs_follow_between_the_knots), TEST(test_a_motion_that_ends_holds_and_the_next_one_begins),
      TEST(test_hinges_that_are_off_stay_off), TEST(test_knots_are_taken_once_and_in_order),
      TEST(test_two_knots_come_in_a_message), TEST(test_messages_that_make_no_sense_are_ignored),
      TEST(test_nothing_is_taken_before_a_stream_is_open), TEST(test_a_full_queue_lets_the_host_repeat),
      TEST(test_numbers_wrap_around), TEST(test_a_motion_begins_at_rest_where_the_outputs_are),
      TEST(test_a_motion_begins_neither_late_nor_far_away), TEST(test_knots_beyond_the_limits_are_faults),
      TEST(test_the_first_knot_is_within_the_limits_too), TEST(test_a_refused_knot_ends_its_message));
