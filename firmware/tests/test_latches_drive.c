/* Latches: outputs that go on and off, pins, and debounced sensors. */
#include <string.h>

#include "latch_bench.h"

static void test_everything_is_off_at_first(void)
{
    set_up(8);
    memset(fake.magnet, 1, sizeof fake.magnet);
    CHECK_EQUAL(latches_command(0, true), ORI_ACCEPTED);
    latches_init();
    for (unsigned i = 0; i < ORI_MAGNET_OUTPUTS; i++)
        CHECK(!fake.magnet[i]);
    const mavlink_ori_latch_state_t state = report();
    CHECK_EQUAL(state.commanded | state.closed | state.sensed | state.tripped | state.driving, 0);
    for (unsigned i = 0; i < ORI_LATCHES; i++)
        CHECK_EQUAL(state.duty_left_permille[i], 1000);
    CHECK(!latches_driven());
}

static void test_magnets_go_on_and_off(void)
{
    set_up(5);
    CHECK_EQUAL(latches_command(0, true), ORI_ACCEPTED);
    for (unsigned i = 0; i < ORI_MAGNET_OUTPUTS; i++)
        CHECK_EQUAL(fake.magnet[i], i == 1);
    CHECK_EQUAL(latches_command(3, true), ORI_ACCEPTED);
    CHECK(fake.magnet[1] && fake.magnet[4]);
    CHECK_EQUAL(report().commanded, 0x9);
    CHECK(latches_driven());
    CHECK_EQUAL(latches_command(0, false), ORI_ACCEPTED);
    CHECK(!fake.magnet[1] && fake.magnet[4]);
    CHECK(latches_driven());
    CHECK_EQUAL(latches_command(3, false), ORI_ACCEPTED);
    CHECK(!latches_driven());
    for (unsigned i = 0; i < ORI_SERVO_OUTPUTS; i++)
        CHECK_EQUAL(fake.servo[i], 0);
}

static void test_pins_are_driven_by_pulses(void)
{
    set_up(5);
    CHECK_EQUAL(latches_command(4, true), ORI_ACCEPTED);
    for (unsigned i = 0; i < ORI_SERVO_OUTPUTS; i++)
        CHECK_EQUAL(fake.servo[i], i == rig_latch(4).output ? 3800 : 0);
    CHECK(latches_driven());
    for (unsigned i = 1; i <= 10; i++) { /* 200 ms */
        CHECK_EQUAL(report().driving, 0x10);
        latches_step();
    }
    CHECK_EQUAL(report().driving, 0);
    CHECK_EQUAL(report().commanded, 0x10);
    CHECK_EQUAL(latches_command(4, false), ORI_ACCEPTED);
    CHECK_EQUAL(fake.servo[rig_latch(4).output], 2200);
    CHECK_EQUAL(report().driving, 0x10);
    CHECK_EQUAL(report().commanded, 0);
    CHECK(!latches_driven());
    config.latch[4].travel_ms = 30; /* frames are whole */
    CHECK_EQUAL(latches_command(4, true), ORI_ACCEPTED);
    latches_step();
    CHECK_EQUAL(report().driving, 0x10);
    latches_step();
    CHECK_EQUAL(report().driving, 0);
    for (unsigned i = 0; i < ORI_MAGNET_OUTPUTS; i++)
        CHECK(!fake.magnet[i]);
}

static void test_passive_magnets_have_no_output(void)
{
    set_up(3);
    const unsigned servo_calls = fake.servo_calls, magnet_calls = fake.magnet_calls;
    CHECK_EQUAL(latches_command(2, true), ORI_ACCEPTED);
    CHECK_EQUAL(fake.servo_calls, servo_calls);
    CHECK_EQUAL(fake.magnet_calls, magnet_calls);
    CHECK(!latches_driven());
    steps(1000);
    CHECK_EQUAL(report().duty_left_permille[2], 1000);
    CHECK_EQUAL(report().tripped | report().driving, 0);
}

static void test_there_are_no_others(void)
{
    set_up(3);
    CHECK_EQUAL(latches_command(2, true), ORI_ACCEPTED);
    CHECK_EQUAL(latches_command(3, true), ORI_REFUSED_INDEX);
    CHECK_EQUAL(latches_command(255, false), ORI_REFUSED_INDEX);
    CHECK_EQUAL(report().commanded, 0x4);
}

static void test_all_eight_are_there(void)
{
    set_up(8);
    for (uint8_t i = 0; i < 8; i++) {
        CHECK(!latches_driven());
        CHECK_EQUAL(latches_command(i, true), ORI_ACCEPTED);
        latches_step();
        CHECK_EQUAL(report().commanded, 1U << i);
        CHECK_EQUAL(latches_driven(), i % 3 != 2);
        CHECK_EQUAL(latches_drives(i), i % 3 != 2);
        CHECK_EQUAL(latches_command(i, false), ORI_ACCEPTED);
    }
    CHECK_EQUAL(latches_command(8, true), ORI_REFUSED_INDEX);
    CHECK(!latches_drives(8));
}

/* Debounced for 40 ms: two frames after the one that saw it. */
static void test_sensors_are_believed_when_steady(void)
{
    set_up(3);
    fake.sensors = 0x4;
    CHECK_EQUAL(report().sensed, 0);
    latches_step();
    CHECK_EQUAL(report().sensed, 0);
    latches_step();
    CHECK_EQUAL(report().sensed, 0x3); /* open was where they began: steady from the first frame */
    CHECK_EQUAL(report().closed, 0);
    latches_step();
    CHECK_EQUAL(report().sensed, 0x7);
    CHECK_EQUAL(report().closed, 0x4);
    fake.sensors = 0;
    latches_step();
    CHECK_EQUAL(report().sensed, 0x3);
    CHECK_EQUAL(report().closed, 0);
    fake.sensors = 0x4;
    latches_step();
    latches_step();
    CHECK_EQUAL(report().sensed, 0x3);
    latches_step();
    CHECK_EQUAL(report().closed, 0x4);
    steps(100);
    CHECK_EQUAL(report().closed, 0x4);
}

static void test_bouncing_sensors_are_not_believed(void)
{
    set_up(1);
    for (unsigned i = 0; i < 40; i++) {
        fake.sensors = i % 4 < 2;
        latches_step();
        CHECK(i < 2 || report().sensed == 0);
    }
}

static void test_sensors_may_be_low_when_closed(void)
{
    set_up(2);
    config.latch[0].flags = 0;
    config.latch[0].sensor = 5;
    config.latch[1].sensor = 7;
    fake.sensors = 0x80;
    steps(5);
    CHECK_EQUAL(report().closed, 0x3);
    fake.sensors = 0x20;
    steps(5);
    CHECK_EQUAL(report().closed, 0);
    CHECK_EQUAL(report().sensed, 0x3);
}

static void test_latches_without_a_sensor_cannot_tell(void)
{
    set_up(2);
    config.latch[0].sensor = ORI_NOBODY;
    fake.sensors = 0xff;
    steps(50);
    CHECK_EQUAL(report().sensed, 0x2);
    CHECK_EQUAL(report().closed, 0x2);
}

static void test_debouncing_times(void)
{
    static const uint16_t times_ms[] = {0, 1, 20, 21, 60, 1000, 10000};
    for (unsigned i = 0; i < sizeof times_ms / sizeof times_ms[0]; i++) {
        const unsigned frames = 1 + (times_ms[i] + 19U) / 20U;
        set_up(1);
        config.latch[0].debounce_ms = times_ms[i];
        fake.sensors = 1;
        steps(frames - 1);
        CHECK_EQUAL(report().sensed, 0);
        steps(1);
        CHECK_EQUAL(report().sensed, 1);
        CHECK_EQUAL(report().closed, 1);
        steps(3500);
        CHECK_EQUAL(report().sensed, 1);
    }
}

SUITE(latches_drive, TEST(test_everything_is_off_at_first), TEST(test_magnets_go_on_and_off),
      TEST(test_pins_are_driven_by_pulses), TEST(test_passive_magnets_have_no_output), TEST(test_there_are_no_others),
      TEST(test_all_eight_are_there), TEST(test_sensors_are_believed_when_steady),
      TEST(test_bouncing_sensors_are_not_believed), TEST(test_sensors_may_be_low_when_closed),
      TEST(test_latches_without_a_sensor_cannot_tell), TEST(test_debouncing_times));
