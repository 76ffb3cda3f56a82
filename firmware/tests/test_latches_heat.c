/* The heat of electromagnets, against the model of the simulated ones, and over restarts. */
#include <math.h>
#include <string.h>

#include "latch_bench.h"

/* The model of the simulated latches, in seconds. */
typedef struct {
    double on_s, duty, limit;
    bool commanded, tripped;
} model_t;

static bool model_step(model_t *model)
{
    if (model->commanded) {
        model->on_s += 0.02 * (1 - model->duty);
        if (model->duty < 1 && model->on_s >= model->limit * (1 - model->duty) - 1e-9) {
            model->commanded = false;
            model->tripped = true;
            return true;
        }
    } else {
        model->on_s = fmax(0, model->on_s - 0.02 * model->duty);
        if (model->on_s < 1e-9) {
            model->on_s = 0;
            model->tripped = false;
        }
    }
    return false;
}

static void check_against_the_model(uint32_t *seed, uint16_t duty, uint32_t max_on_ms)
{
    model_t model = {.duty = duty * 1e-3, .limit = max_on_ms * 1e-3};
    set_up(4);
    config.latch[3].duty_permille = duty;
    config.latch[3].max_on_ms = max_on_ms;
    for (unsigned n = 0; n < 600; n++) {
        if (random_below(seed, 12) == 0) {
            const bool engage = random_below(seed, 3) != 0;
            const uint8_t expected = engage && model.tripped ? ORI_REFUSED_TRIPPED : ORI_ACCEPTED;
            CHECK_EQUAL(latches_command(3, engage), expected);
            if (expected == ORI_ACCEPTED)
                model.commanded = engage;
        }
        CHECK_EQUAL(latches_step(), model_step(&model) ? 0x8 : 0);
        CHECK_EQUAL(fake.magnet[4], model.commanded);
        const mavlink_ori_latch_state_t state = report();
        CHECK_EQUAL(state.tripped, model.tripped ? 0x8 : 0);
        CHECK_EQUAL(state.commanded, model.commanded ? 0x8 : 0);
        const double capacity = model.limit * (1 - model.duty);
        const double left = duty < 1000 ? 1000 * fmax(0, 1 - model.on_s / capacity) : 1000;
        CHECK_NEAR(state.duty_left_permille[3], left, 1.0);
    }
}

static void test_electromagnets_heat_as_the_model_does(void)
{
    static const uint16_t duties[] = {0, 1, 100, 250, 500, 900, 999, 1000};
    uint32_t seed = 17;
    for (unsigned i = 0; i < sizeof duties / sizeof duties[0]; i++) {
        check_against_the_model(&seed, duties[i], 200);
        check_against_the_model(&seed, duties[i], 1010);
        check_against_the_model(&seed, duties[i], 1);
    }
}

static void test_a_magnet_lets_go_after_its_longest_time(void)
{
    set_up(4);
    CHECK_EQUAL(latches_command(0, true), ORI_ACCEPTED);
    for (unsigned i = 1; i < 50; i++) { /* 1 s */
        CHECK_EQUAL(latches_step(), 0);
        CHECK(fake.magnet[1]);
    }
    CHECK_EQUAL(latches_step(), 1);
    CHECK(!fake.magnet[1]);
    CHECK_EQUAL(report().duty_left_permille[0], 0);
    /* Cools for 750 ms / 250 per mille = 3 s. */
    for (unsigned i = 1; i < 150; i++) {
        CHECK_EQUAL(latches_step(), 0);
        CHECK_EQUAL(latches_command(0, true), ORI_REFUSED_TRIPPED);
        CHECK_EQUAL(latches_command(0, false), ORI_ACCEPTED);
    }
    CHECK_EQUAL(report().tripped, 1);
    CHECK_EQUAL(latches_step(), 0);
    CHECK_EQUAL(report().tripped, 0);
    CHECK_EQUAL(latches_command(0, true), ORI_ACCEPTED);
    CHECK(fake.magnet[1]);
}

static void test_the_longest_times_do_not_overflow(void)
{
    set_up(1);
    config.latch[0].max_on_ms = 3600000;
    config.latch[0].duty_permille = 0;
    CHECK_EQUAL(latches_command(0, true), ORI_ACCEPTED);
    unsigned frames = 1;
    while (latches_step() == 0)
        frames++;
    CHECK_EQUAL(frames, 180000);
    steps(1000);
    CHECK_EQUAL(report().tripped, 1); /* with no duty it never cools */
}

static void restart(port_reset_t cause)
{
    fake.reset_cause = cause;
    latches_init();
}

/* For any reason, and while nobody counts it does not cool. */
static void test_heat_outlasts_a_restart(void)
{
    for (port_reset_t cause = PORT_RESET_POWER; cause <= PORT_RESET_WATCHDOG; cause++) {
        set_up(4);
        CHECK_EQUAL(latches_command(0, true), ORI_ACCEPTED);
        CHECK_EQUAL(latches_command(3, true), ORI_ACCEPTED);
        steps(30);
        CHECK_EQUAL(latches_command(3, false), ORI_ACCEPTED);
        steps(20); /* the first trips */
        const mavlink_ori_latch_state_t before = report();
        CHECK_EQUAL(before.tripped, 0x1);
        CHECK(before.duty_left_permille[3] > 400 && before.duty_left_permille[3] < 600);
        restart(cause);
        const mavlink_ori_latch_state_t after = report();
        CHECK_EQUAL(after.tripped, 0x1);
        CHECK_EQUAL(after.duty_left_permille[0], 0);
        CHECK_EQUAL(after.duty_left_permille[3], before.duty_left_permille[3]);
        CHECK(!fake.magnet[1] && !fake.magnet[4]);
        CHECK_EQUAL(latches_command(0, true), ORI_REFUSED_TRIPPED);
        CHECK_EQUAL(latches_command(3, true), ORI_ACCEPTED); /* warm is not tripped */
        CHECK_EQUAL(latches_command(3, false), ORI_ACCEPTED);
        steps(149);
        CHECK_EQUAL(report().tripped, 0x1);
        steps(1);
        CHECK_EQUAL(report().tripped, 0);
        CHECK_EQUAL(latches_command(0, true), ORI_ACCEPTED);
    }
}

/* Every byte of what is kept counts. */
static void test_heat_that_is_not_known_is_full(void)
{
    for (size_t at = 0; at < sizeof fake.kept; at++)
        for (port_reset_t cause = PORT_RESET_POWER; cause <= PORT_RESET_WATCHDOG; cause++) {
            set_up(7);
            config.latch[6].duty_permille = 1000;
            config.latch[3].output = 0;
            CHECK_EQUAL(latches_command(0, true), ORI_ACCEPTED);
            steps(10);
            ((uint8_t *)&fake.kept)[at] ^= 0x10;
            restart(cause);
            const bool cold = cause == PORT_RESET_POWER;
            CHECK_EQUAL(report().tripped, cold ? 0 : 0x9);
            CHECK_EQUAL(report().duty_left_permille[0], cold ? 1000 : 0);
            CHECK_EQUAL(report().duty_left_permille[3], cold ? 1000 : 0);
            CHECK_EQUAL(report().duty_left_permille[6], 1000); /* it may be on for ever */
            CHECK_EQUAL(latches_command(3, true), cold ? ORI_ACCEPTED : ORI_REFUSED_TRIPPED);
            CHECK_EQUAL(latches_command(6, true), ORI_ACCEPTED);
            CHECK_EQUAL(latches_command(3, false), ORI_ACCEPTED);
            steps(149);
            CHECK_EQUAL(report().tripped, cold ? 0 : 0x9);
            steps(1);
            CHECK_EQUAL(report().tripped, 0);
            restart(PORT_RESET_WATCHDOG); /* what was damaged is whole again */
            CHECK_EQUAL(report().tripped, 0);
        }
}

/* Of a device that has lost its configuration it is remembered until there is one. */
static void test_heat_waits_for_a_configuration(void)
{
    set_up(1);
    memset(&fake.kept, 0x5a, sizeof fake.kept);
    config.device.latches = 0;
    restart(PORT_RESET_WATCHDOG);
    CHECK_EQUAL(report().tripped, 0);
    CHECK_EQUAL(report().duty_left_permille[0], 1000);
    steps(1000);
    config.device.latches = 1;
    latches_init();
    CHECK_EQUAL(report().tripped, 0x1);
    steps(149);
    CHECK_EQUAL(report().tripped, 0x1);
    steps(1);
    CHECK_EQUAL(report().tripped, 0);
}

/* It is the output's, and no more than its record allows. */
static void test_heat_is_the_outputs(void)
{
    set_up(1);
    CHECK_EQUAL(latches_command(0, true), ORI_ACCEPTED);
    steps(20);
    config.device.latches = 4;
    config.latch[3] = config.latch[0];
    config.latch[0].kind = ORI_MAGNET;
    restart(PORT_RESET_EXTERNAL);
    CHECK_EQUAL(report().duty_left_permille[3], 600);
    CHECK_EQUAL(report().duty_left_permille[0], 1000);
    config.latch[3].max_on_ms = 400; /* as hot as it is */
    restart(PORT_RESET_EXTERNAL);
    CHECK_EQUAL(report().duty_left_permille[3], 0);
    CHECK_EQUAL(report().tripped, 0x8);
    config.latch[3].max_on_ms = 100;
    restart(PORT_RESET_EXTERNAL);
    CHECK_EQUAL(report().duty_left_permille[3], 0);
    CHECK_EQUAL(report().tripped, 0x8);
    steps(15); /* 75 ms / 250 per mille */
    CHECK_EQUAL(report().tripped, 0);
}

static void test_when_it_will_be_cold_is_told(void)
{
    uint8_t index = ORI_NOBODY;
    set_up(7);
    config.latch[6].max_on_ms = 3600000;
    config.latch[6].duty_permille = 1;
    config.latch[3].duty_permille = 0; /* cold, though it would never cool */
    CHECK_EQUAL(latches_hot_ms(&index), 0);
    CHECK_EQUAL(index, ORI_NOBODY);
    config.latch[3].duty_permille = 250;
    CHECK_EQUAL(latches_command(1, true), ORI_ACCEPTED); /* a pin has no heat */
    CHECK_EQUAL(latches_command(2, true), ORI_ACCEPTED);
    steps(10);
    CHECK_EQUAL(latches_hot_ms(&index), 0);
    CHECK_EQUAL(latches_command(0, true), ORI_ACCEPTED);
    steps(1);
    CHECK_EQUAL(latches_command(0, false), ORI_ACCEPTED);
    CHECK_EQUAL(latches_hot_ms(&index), 60); /* 20 ms 0.75 / 0.25 */
    CHECK_EQUAL(index, 0);
    CHECK_EQUAL(latches_command(3, true), ORI_ACCEPTED);
    steps(2);
    CHECK_EQUAL(latches_command(3, false), ORI_ACCEPTED);
    CHECK_EQUAL(latches_hot_ms(&index), 120);
    CHECK_EQUAL(index, 3);
    for (int32_t left = 100; left >= 0; left -= 20) {
        steps(1);
        CHECK_EQUAL(latches_hot_ms(&index), left);
    }
    config.latch[0].duty_permille = 280; /* steps are whole */
    CHECK_EQUAL(latches_command(0, true), ORI_ACCEPTED);
    steps(1);
    CHECK_EQUAL(latches_command(0, false), ORI_ACCEPTED);
    CHECK_EQUAL(latches_hot_ms(&index), 60); /* 51.4 */
    CHECK_EQUAL(latches_command(6, true), ORI_ACCEPTED);
    steps(2149);
    CHECK_EQUAL(latches_hot_ms(&index), 2149 * 20 * 999);
    CHECK_EQUAL(index, 6);
    steps(105332); /* to the last step that can be told */
    CHECK_EQUAL(latches_hot_ms(&index), 107481 * 20 * 999);
    steps(1);
    CHECK_EQUAL(latches_hot_ms(&index), INT32_MAX);
    config.latch[6].duty_permille = 0;
    CHECK_EQUAL(latches_hot_ms(&index), INT32_MAX);
}

static void test_a_magnet_with_full_duty_stays_on(void)
{
    set_up(1);
    config.latch[0].duty_permille = 1000;
    config.latch[0].max_on_ms = 20;
    CHECK_EQUAL(latches_command(0, true), ORI_ACCEPTED);
    for (unsigned i = 0; i < 500; i++)
        CHECK_EQUAL(latches_step(), 0);
    CHECK(fake.magnet[1]);
}

static void test_what_is_left_is_told_to_the_per_mille(void)
{
    static const uint16_t left[] = {1000, 667, 334, 0};
    set_up(1);
    config.latch[0].max_on_ms = 60;
    CHECK_EQUAL(latches_command(0, true), ORI_ACCEPTED);
    for (unsigned i = 0; i < 4; i++) {
        CHECK_EQUAL(report().duty_left_permille[0], left[i]);
        for (unsigned other = 1; other < ORI_LATCHES; other++)
            CHECK_EQUAL(report().duty_left_permille[other], 1000);
        latches_step();
    }
}

static void test_several_trip_at_once(void)
{
    set_up(7);
    CHECK_EQUAL(latches_command(3, true), ORI_ACCEPTED);
    CHECK_EQUAL(latches_command(6, true), ORI_ACCEPTED);
    steps(49);
    CHECK_EQUAL(latches_step(), 0x48);
    CHECK_EQUAL(report().tripped, 0x48);
}

SUITE(latches_heat, TEST(test_electromagnets_heat_as_the_model_does),
      TEST(test_a_magnet_lets_go_after_its_longest_time), TEST(test_the_longest_times_do_not_overflow),
      TEST(test_heat_outlasts_a_restart), TEST(test_heat_that_is_not_known_is_full),
      TEST(test_heat_waits_for_a_configuration), TEST(test_heat_is_the_outputs),
      TEST(test_when_it_will_be_cold_is_told), TEST(test_a_magnet_with_full_duty_stays_on),
      TEST(test_what_is_left_is_told_to_the_per_mille), TEST(test_several_trip_at_once));
