/* Hinges: pulses and positions against double, and who may go on. */
#include <math.h>
#include <string.h>

#include "hinge_bench.h"

static void test_every_output_is_off_at_first(void)
{
    set_up(4);
    memset(fake.servo, 0x55, sizeof fake.servo);
    hinges_init();
    for (unsigned i = 0; i < ORI_SERVO_OUTPUTS; i++)
        CHECK_EQUAL(fake.servo[i], 0);
    CHECK_EQUAL(hinges_on() | hinges_stalled(), 0);
}

static void test_starting_again_forgets_everything(void)
{
    set_up(4);
    CHECK_EQUAL(enable(0xf, at_zero), ORI_ACCEPTED);
    rig_place(1, 0.5);
    for (unsigned i = 0; i < 5; i++)
        sense();
    rig_place(2, 0.5);
    while (sense() == ORI_NOBODY)
        ;
    CHECK(hinges_stalled() != 0);
    const int32_t there[ORI_HINGES] = {111, 222};
    hinges_output(there);
    hinges_init();
    CHECK_EQUAL(hinges_on() | hinges_stalled(), 0);
    CHECK_EQUAL(hinges_asked()[0], 0);
    mavlink_ori_state_t report;
    config.device.hinges = 0; /* so that nothing is measured anew */
    hinges_report(&report);
    CHECK_EQUAL(report.position_urad[1], 0);
    CHECK_EQUAL(report.sensed | report.silent, 0);
    /* Nor does a hinge remember for how long it did not follow: this one for a frame. */
    set_up(4);
    CHECK_EQUAL(enable(4, at_zero), ORI_ACCEPTED);
    rig_place(2, 0.5);
    for (unsigned i = 0; i < 5; i++)
        CHECK_EQUAL(sense(), ORI_NOBODY);
}

static void test_pulses_are_where_they_should_be(void)
{
    uint32_t seed = 99;
    set_up(2);
    for (unsigned n = 0; n < 300; n++) {
        mavlink_ori_config_hinge_t *record = &config.hinge[1];
        record->pulse_zero_ns = random_between(&seed, 1300000, 1700000);
        record->pulse_slope_ns = random_between(&seed, 100000, 900000) * (n % 2 ? 1 : -1);
        hinges_init();
        const int32_t first[ORI_HINGES] = {0};
        rig_place(1, 0);
        CHECK_EQUAL(enable(2, first), ORI_ACCEPTED);
        for (unsigned m = 0; m < 20; m++) {
            int32_t position[ORI_HINGES] = {0};
            position[1] = random_between(&seed, -1000000, 1500000);
            hinges_output(position);
            const double ns = record->pulse_zero_ns + (double)record->pulse_slope_ns * position[1] * 1e-6;
            const double ticks = fmin(fmax(ns / 500.0, 1000), 5000);
            /* Half a tick, and for the slope, which has 15 bits, a part of the pulse's change. */
            CHECK_NEAR(fake.servo[record->channel], ticks, 0.51);
            CHECK_EQUAL(hinges_asked()[1], position[1]);
        }
    }
}

static void test_pulses_round_to_the_nearest_tick(void)
{
    set_up(1);
    config.hinge[0].pulse_slope_ns = 500000; /* a tick per mrad */
    hinges_init();
    CHECK_EQUAL(enable(1, at_zero), ORI_ACCEPTED);
    CHECK_EQUAL(fake.servo[rig_hinge(0).channel], 3000);
    for (int32_t mrad = -900; mrad <= 900; mrad += 50) {
        const int32_t below[ORI_HINGES] = {mrad * 1000 - 480}, above[ORI_HINGES] = {mrad * 1000 + 480};
        hinges_output(below);
        CHECK_EQUAL(fake.servo[rig_hinge(0).channel], 3000 + mrad);
        hinges_output(above);
        CHECK_EQUAL(fake.servo[rig_hinge(0).channel], 3000 + mrad);
    }
    const int32_t half[ORI_HINGES] = {500520};
    hinges_output(half);
    CHECK_EQUAL(fake.servo[rig_hinge(0).channel], 3501);
    /* At 0 the pulse is the record's to a hundredth of a tick. */
    config.hinge[0].pulse_zero_ns = 1500249;
    hinges_init();
    CHECK_EQUAL(enable(1, at_zero), ORI_ACCEPTED);
    CHECK_EQUAL(fake.servo[rig_hinge(0).channel], 3000);
    config.hinge[0].pulse_zero_ns = 1500250;
    hinges_init();
    CHECK_EQUAL(enable(1, at_zero), ORI_ACCEPTED);
    CHECK_EQUAL(fake.servo[rig_hinge(0).channel], 3001);
}

/* At 0 a pulse would have 3000 ticks. */
static uint16_t pulse_within(uint16_t min_us, uint16_t max_us)
{
    set_up(1);
    config.hinge[0].pulse_min_us = min_us;
    config.hinge[0].pulse_max_us = max_us;
    hinges_init();
    CHECK_EQUAL(enable(1, at_zero), ORI_ACCEPTED);
    hinges_output(at_zero);
    CHECK_EQUAL(hinges_asked()[0], 0);
    return fake.servo[rig_hinge(0).channel];
}

static void test_pulses_are_kept_in_what_a_servo_may_get(void)
{
    CHECK_EQUAL(pulse_within(500, 2500), 3000);
    CHECK_EQUAL(pulse_within(1500, 2500), 3000);
    CHECK_EQUAL(pulse_within(1501, 2500), 3002);
    CHECK_EQUAL(pulse_within(500, 1500), 3000);
    CHECK_EQUAL(pulse_within(500, 1499), 2998);
    CHECK_EQUAL(pulse_within(15000, 19000), 30000);
}

static void test_the_most_that_a_record_may_say_overflows_nothing(void)
{
    set_up(1);
    config.hinge[0].pulse_slope_ns = -20000000;
    config.hinge[0].pulse_zero_ns = -20000000;
    config.hinge[0].min_urad = -100000000;
    config.hinge[0].max_urad = 100000000;
    config.hinge[0].flags = 0;
    hinges_init();
    int32_t value;
    CHECK_EQUAL(enable_one(0, 100000000, &value), ORI_ACCEPTED);
    CHECK_EQUAL(fake.servo[rig_hinge(0).channel], 1000);
    const int32_t other[ORI_HINGES] = {-100000000};
    hinges_output(other);
    CHECK_EQUAL(fake.servo[rig_hinge(0).channel], 5000);
}

static void test_feedback_is_where_the_hinge_is(void)
{
    mavlink_ori_state_t report;
    uint32_t seed = 5;
    set_up(3);
    for (unsigned n = 0; n < 500; n++) {
        config.hinge[2].feedback_zero_urad = random_between(&seed, -4000000, 4000000);
        config.hinge[2].feedback_slope_nrad = random_between(&seed, -6000000, 6000000);
        hinges_init();
        const uint16_t count = (uint16_t)(n % 2 ? 1000 : random_between(&seed, 20, 1000));
        count_of(2, count);
        hinges_report(&report);
        const double expected = config.hinge[2].feedback_zero_urad + config.hinge[2].feedback_slope_nrad * 1e-3 * count;
        /* Rounded down, after a slope that is rounded to the nearest 2^-12 urad. */
        CHECK_NEAR(report.position_urad[2], expected - 0.5, 0.5 + count * 0x1p-13 + 1e-6);
    }
}

static void test_feedback_that_cannot_be_is_not_believed(void)
{
    mavlink_ori_state_t report;
    set_up(3);
    config.hinge[1].flags = 0;
    const struct {
        uint16_t count;
        bool sensed, silent;
    } cases[] = {{0, false, true}, {19, false, true}, {20, true, false}, {500, true, false}, {1000, true, false}, {1001, false, false}};
    for (unsigned i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        count_of(0, 500);
        count_of(1, cases[i].count);
        count_of(2, cases[i].count);
        hinges_report(&report);
        CHECK_EQUAL(report.sensed, cases[i].sensed ? 0x5 : 0x1);
        CHECK_EQUAL(report.silent, cases[i].silent ? 0x4 : 0);
        CHECK_EQUAL(report.position_urad[1], 0);
        CHECK_EQUAL(report.position_urad[2], cases[i].sensed ? -2000000 + 4000 * cases[i].count : 0);
        CHECK_EQUAL(report.position_urad[0], 0);
    }
}

static void test_goes_on_within_the_seat_of_where_it_is(void)
{
    int32_t value;
    for (int sign = -1; sign <= 1; sign += 2) {
        set_up(2);
        rig_place(1, 0.2);
        CHECK_EQUAL(enable_one(1, 200000 + sign * 20001, &value), ORI_REFUSED_POSITION);
        CHECK_EQUAL(value, 200000);
        CHECK_EQUAL(hinges_on(), 0);
        CHECK_EQUAL(fake.servo[rig_hinge(1).channel], 0);
        CHECK_EQUAL(enable_one(1, 200000 + sign * 20000, &value), ORI_ACCEPTED);
        CHECK_EQUAL(hinges_on(), 2);
        CHECK_EQUAL(hinges_asked()[1], 200000 + sign * 20000);
        CHECK_EQUAL(fake.servo[rig_hinge(1).channel], rig_ticks(1, 0.2 + sign * 0.02));
    }
}

static void test_goes_on_only_in_its_range(void)
{
    int32_t value;
    set_up(2);
    rig_place(1, 1.5);
    CHECK_EQUAL(enable_one(1, 1500001, &value), ORI_REFUSED_RANGE);
    CHECK_EQUAL(enable_one(1, 1500000, &value), ORI_ACCEPTED);
    rig_place(0, -1.0);
    CHECK_EQUAL(enable_one(0, -1000001, &value), ORI_REFUSED_RANGE);
    CHECK_EQUAL(enable_one(0, -1000000, &value), ORI_ACCEPTED);
}

static void test_goes_on_only_if_its_sensor_tells(void)
{
    int32_t value;
    set_up(1);
    count_of(0, 19);
    CHECK_EQUAL(enable_one(0, 0, &value), ORI_REFUSED_SENSOR);
    count_of(0, 1001);
    CHECK_EQUAL(enable_one(0, 0, &value), ORI_REFUSED_SENSOR);
    config.hinge[0].flags = 0;
    CHECK_EQUAL(enable_one(0, 0, &value), ORI_ACCEPTED);
}

/* Without feedback the host's word is all there is, until the output is on: then it is where that is. */
static void test_without_feedback_the_output_is_the_position(void)
{
    int32_t value;
    set_up(1);
    config.hinge[0].flags = 0;
    CHECK_EQUAL(enable_one(0, 700000, &value), ORI_ACCEPTED);
    CHECK_EQUAL(enable_one(0, 720001, &value), ORI_REFUSED_POSITION);
    CHECK_EQUAL(value, 700000);
    CHECK_EQUAL(enable_one(0, 720000, &value), ORI_ACCEPTED);
    CHECK_EQUAL(hinges_asked()[0], 700000);
    hinges_disable(1);
    CHECK_EQUAL(enable_one(0, -500000, &value), ORI_ACCEPTED);
}

/* A hinge that is on and hangs below its output is enabled where it is measured, and does not step there. */
static void test_enabling_what_is_on_steps_no_output(void)
{
    const int32_t low[ORI_HINGES] = {-16000, -16000};
    int32_t value;
    set_up(2);
    CHECK_EQUAL(enable(1, at_zero), ORI_ACCEPTED);
    rig_place(0, -0.016);
    rig_place(1, -0.016);
    const unsigned calls = fake.servo_calls;
    CHECK_EQUAL(enable_one(0, -16000, &value), ORI_ACCEPTED);
    CHECK_EQUAL(fake.servo_calls, calls);
    CHECK_EQUAL(enable(3, low), ORI_ACCEPTED); /* the other one is off, and goes on there */
    CHECK_EQUAL(hinges_on(), 3);
    CHECK_EQUAL(hinges_asked()[0], 0);
    CHECK_EQUAL(fake.servo[rig_hinge(0).channel], rig_ticks(0, 0));
    CHECK_EQUAL(hinges_asked()[1], -16000);
    CHECK_EQUAL(fake.servo[rig_hinge(1).channel], rig_ticks(1, -0.016));
    CHECK_EQUAL(enable_one(0, 4001, &value), ORI_REFUSED_POSITION); /* it is where it is measured */
    CHECK_EQUAL(value, -16000);
}

static void test_all_go_on_or_none(void)
{
    set_up(3);
    rig_place(2, 0.3);
    CHECK_EQUAL(enable(0x7, at_zero), ORI_REFUSED_POSITION);
    CHECK_EQUAL(hinges_on(), 0);
    for (unsigned i = 0; i < ORI_SERVO_OUTPUTS; i++)
        CHECK_EQUAL(fake.servo[i], 0);
    CHECK_EQUAL(enable(0x5, at_zero), ORI_REFUSED_POSITION);
    CHECK_EQUAL(enable(0x3, at_zero), ORI_ACCEPTED);
    CHECK_EQUAL(hinges_on(), 0x3);
    CHECK_EQUAL(fake.servo[rig_hinge(2).channel], 0);
    rig_place(2, 0);
    CHECK_EQUAL(enable(0x4, at_zero), ORI_ACCEPTED);
    CHECK_EQUAL(hinges_on(), 0x7);
}

static void test_there_are_no_others(void)
{
    uint8_t index = 0;
    int32_t value = 0;
    set_up(3);
    for (uint8_t k = 3; k < 16; k++) {
        CHECK_EQUAL(hinges_enable((uint16_t)(1U << k | 1U), at_zero, &index, &value), ORI_REFUSED_INDEX);
        CHECK_EQUAL(index, k);
        CHECK_EQUAL(hinges_on(), 0);
    }
}

static void test_only_those_that_are_on_get_outputs(void)
{
    const int32_t position[ORI_HINGES] = {100000, 200000, 300000};
    set_up(3);
    CHECK_EQUAL(enable(0x5, at_zero), ORI_ACCEPTED);
    hinges_output(position);
    CHECK_EQUAL(fake.servo[rig_hinge(0).channel], rig_ticks(0, 0.1));
    CHECK_EQUAL(fake.servo[rig_hinge(1).channel], 0);
    CHECK_EQUAL(fake.servo[rig_hinge(2).channel], rig_ticks(2, 0.3));
    CHECK_EQUAL(hinges_asked()[1], 0);
    hinges_disable(0x6);
    CHECK_EQUAL(hinges_on(), 0x1);
    CHECK_EQUAL(fake.servo[rig_hinge(2).channel], 0);
    CHECK_EQUAL(hinges_asked()[2], 0);
    CHECK_EQUAL(hinges_asked()[0], 100000);
    hinges_disable(0xffff);
    CHECK_EQUAL(hinges_on(), 0);
}

static void test_all_twelve_are_there(void)
{
    const int32_t position[ORI_HINGES] = {[11] = 1000};
    set_up(12);
    CHECK_EQUAL(enable(0xfff, at_zero), ORI_ACCEPTED);
    CHECK_EQUAL(sense(), ORI_NOBODY);
    hinges_output(position);
    CHECK_EQUAL(hinges_on(), 0xfff);
    CHECK_EQUAL(hinges_asked()[11], 1000);
    hinges_disable(0xffff);
    for (unsigned i = 0; i < ORI_SERVO_OUTPUTS; i++)
        CHECK_EQUAL(fake.servo[i], 0);
}

static void test_the_report_says_it_all(void)
{
    mavlink_ori_state_t report;
    const int32_t position[ORI_HINGES] = {5000, 6000, 7000, 8000};
    set_up(4);
    CHECK_EQUAL(enable(0xb, at_zero), ORI_ACCEPTED);
    rig_place(3, 0.5);
    while (sense() == ORI_NOBODY)
        ;
    hinges_output(position);
    count_of(1, 0);
    rig_place(2, -0.4);
    hinges_report(&report);
    CHECK_EQUAL(report.outputs_on, 0x3);
    CHECK_EQUAL(report.stalled, 0x8);
    CHECK_EQUAL(report.silent, 0x2);
    CHECK_EQUAL(report.sensed, 0xd);
    CHECK_EQUAL(report.position_urad[2], -400000);
    CHECK_EQUAL(report.position_urad[3], 500000);
    CHECK_EQUAL(report.output_urad[0], 5000);
    CHECK_EQUAL(report.output_urad[1], 6000);
    CHECK_EQUAL(report.output_urad[2], 0);
    CHECK_EQUAL(report.output_urad[3], 0);
}

SUITE(hinges_drive, TEST(test_every_output_is_off_at_first), TEST(test_starting_again_forgets_everything),
      TEST(test_pulses_are_where_they_should_be), TEST(test_pulses_round_to_the_nearest_tick),
      TEST(test_pulses_are_kept_in_what_a_servo_may_get), TEST(test_the_most_that_a_record_may_say_overflows_nothing),
      TEST(test_feedback_is_where_the_hinge_is), TEST(test_feedback_that_cannot_be_is_not_believed),
      TEST(test_goes_on_within_the_seat_of_where_it_is), TEST(test_goes_on_only_in_its_range),
      TEST(test_goes_on_only_if_its_sensor_tells), TEST(test_without_feedback_the_output_is_the_position),
      TEST(test_enabling_what_is_on_steps_no_output), TEST(test_all_go_on_or_none), TEST(test_there_are_no_others),
      TEST(test_only_those_that_are_on_get_outputs), TEST(test_all_twelve_are_there),
      TEST(test_the_report_says_it_all));
