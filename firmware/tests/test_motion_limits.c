/* Limits against dense sampling and exact extremes in double, and at their very boundaries. */
#include <math.h>
#include <string.h>

#include "check.h"
#include "motion_limits.h"

#define V_MAX 2000
#define A_MAX 20000U
#define LOW (-1000000)
#define HIGH 1500000

static void set_up(uint8_t hinges)
{
    memset(&config, 0, sizeof config);
    config.device.hinges = hinges;
    for (unsigned k = 0; k < ORI_HINGES; k++) {
        config.hinge[k].min_urad = LOW;
        config.hinge[k].max_urad = HIGH;
        config.hinge[k].max_velocity_mrad_s = V_MAX;
        config.hinge[k].max_acceleration_mrad_s2 = A_MAX;
    }
}

static uint8_t of_knot(unsigned hinge, int32_t position_urad, int16_t velocity_mrad_s)
{
    knot_t knot = {0};
    knot.position_urad[hinge] = position_urad;
    knot.velocity_mrad_s[hinge] = velocity_mrad_s;
    const verdict_t verdict = limits_of_knot(&knot);
    CHECK_EQUAL(verdict.hinge, verdict.fault ? hinge : ORI_NOBODY);
    return verdict.fault;
}

static void test_knots_are_within_ranges_and_speeds(void)
{
    set_up(5);
    for (unsigned k = 0; k < 5; k++) {
        CHECK_EQUAL(of_knot(k, LOW, 0), ORI_FAULT_NONE);
        CHECK_EQUAL(of_knot(k, LOW - 1, 0), ORI_FAULT_POSITION_LIMIT);
        CHECK_EQUAL(of_knot(k, HIGH, 0), ORI_FAULT_NONE);
        CHECK_EQUAL(of_knot(k, HIGH + 1, 0), ORI_FAULT_POSITION_LIMIT);
        CHECK_EQUAL(of_knot(k, 0, V_MAX), ORI_FAULT_NONE);
        CHECK_EQUAL(of_knot(k, 0, V_MAX + 1), ORI_FAULT_VELOCITY_LIMIT);
        CHECK_EQUAL(of_knot(k, 0, -V_MAX), ORI_FAULT_NONE);
        CHECK_EQUAL(of_knot(k, 0, -V_MAX - 1), ORI_FAULT_VELOCITY_LIMIT);
    }
    CHECK_EQUAL(of_knot(2, 0, INT16_MIN), ORI_FAULT_VELOCITY_LIMIT);
    CHECK_EQUAL(of_knot(5, HIGH + 1, V_MAX + 1), ORI_FAULT_NONE); /* no such hinge */
}

static void test_every_hinge_has_its_own_limits(void)
{
    set_up(3);
    config.hinge[1].min_urad = -5;
    config.hinge[1].max_velocity_mrad_s = 3;
    config.hinge[1].max_acceleration_mrad_s2 = 50;
    CHECK_EQUAL(of_knot(1, -6, 0), ORI_FAULT_POSITION_LIMIT);
    CHECK_EQUAL(of_knot(1, 0, 4), ORI_FAULT_VELOCITY_LIMIT);
    CHECK_EQUAL(of_knot(2, -6, 4), ORI_FAULT_NONE);
    const knot_t a = {0};
    knot_t b = {.time_us = 1000000};
    b.position_urad[1] = 9000;
    verdict_t verdict = limits_of_segment(&a, &b);
    CHECK_EQUAL(verdict.fault, ORI_FAULT_VELOCITY_LIMIT);
    CHECK_EQUAL(verdict.hinge, 1);
    b.position_urad[2] = 9000;
    b.position_urad[1] = 0;
    CHECK_EQUAL(limits_of_segment(&a, &b).fault, ORI_FAULT_NONE);
}

/* A segment of the last hinge; the others rest. */
static verdict_t of_segment(uint32_t dt_us, int32_t p0, int16_t v0, int32_t p1, int16_t v1)
{
    const unsigned k = config.device.hinges - 1U;
    knot_t a = {.time_us = UINT32_MAX - 500}, b = {.time_us = UINT32_MAX - 500 + dt_us};
    a.position_urad[k] = p0;
    a.velocity_mrad_s[k] = v0;
    b.position_urad[k] = p1;
    b.velocity_mrad_s[k] = v1;
    return limits_of_segment(&a, &b);
}

static uint8_t fault_of(uint32_t dt_us, int32_t p0, int16_t v0, int32_t p1, int16_t v1)
{
    const verdict_t verdict = of_segment(dt_us, p0, v0, p1, v1);
    if (verdict.fault != ORI_FAULT_NONE && verdict.fault != ORI_FAULT_KNOT_TIME)
        CHECK_EQUAL(verdict.hinge, config.device.hinges - 1U);
    else
        CHECK_EQUAL(verdict.hinge, ORI_NOBODY);
    return verdict.fault;
}

static void test_knots_are_in_order_and_not_too_far_apart(void)
{
    set_up(4);
    CHECK_EQUAL(fault_of(0, 0, 0, 0, 0), ORI_FAULT_KNOT_TIME);
    CHECK_EQUAL(fault_of(999, 0, 0, 0, 0), ORI_FAULT_KNOT_TIME);
    CHECK_EQUAL(fault_of(1000, 0, 0, 0, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(1000000, 0, 0, 0, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(1000001, 0, 0, 0, 0), ORI_FAULT_KNOT_TIME);
    CHECK_EQUAL(fault_of((uint32_t)-20000, 0, 0, 0, 0), ORI_FAULT_KNOT_TIME);
    CHECK_EQUAL(fault_of(UINT32_C(1) << 31, 0, 0, 0, 0), ORI_FAULT_KNOT_TIME);
}

/* Cruising at the limit is allowed, and a step of the grid more is not. */
static void test_speed_at_its_limit(void)
{
    set_up(2);
    for (int sign = -1; sign <= 1; sign += 2) {
        const int16_t v = (int16_t)(sign * V_MAX);
        const int32_t way = sign * V_MAX * 100;
        CHECK_EQUAL(fault_of(100000, 0, v, way, v), ORI_FAULT_NONE);
        CHECK_EQUAL(fault_of(100000, 0, v, way + sign, v), ORI_FAULT_VELOCITY_LIMIT);
        CHECK_EQUAL(fault_of(100000, 0, v, way - sign, v), ORI_FAULT_NONE);
    }
    /* From rest to rest the mean is two thirds of the peak, in the middle. */
    config.hinge[1].max_acceleration_mrad_s2 = 1000000;
    CHECK_EQUAL(fault_of(300000, 0, 0, 400000, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(300000, 0, 0, 400001, 0), ORI_FAULT_VELOCITY_LIMIT);
    CHECK_EQUAL(fault_of(300000, 400000, 0, 0, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(300000, 400001, 0, 0, 0), ORI_FAULT_VELOCITY_LIMIT);
    /* From the fastest back to the fastest forth and back again: no curve of the velocity is steeper. */
    for (int sign = -1; sign <= 1; sign += 2) {
        const int16_t v = (int16_t)(-sign * V_MAX);
        CHECK_EQUAL(fault_of(300000, 0, v, sign * 200000, v), ORI_FAULT_NONE);
        CHECK_EQUAL(fault_of(300000, 0, v, sign * 200001, v), ORI_FAULT_VELOCITY_LIMIT);
    }
}

/* From rest with a constant acceleration, to rest with one; the acceleration's line has two ends. */
static void test_acceleration_at_its_limit(void)
{
    set_up(2);
    for (int sign = -1; sign <= 1; sign += 2) {
        CHECK_EQUAL(fault_of(50000, 0, 0, sign * 25000, (int16_t)(sign * 1000)), ORI_FAULT_NONE);
        CHECK_EQUAL(fault_of(50000, 0, 0, sign * 25001, (int16_t)(sign * 1000)), ORI_FAULT_ACCELERATION_LIMIT);
        CHECK_EQUAL(fault_of(50000, 0, 0, sign * 24999, (int16_t)(sign * 1000)), ORI_FAULT_ACCELERATION_LIMIT);
        CHECK_EQUAL(fault_of(50000, 0, (int16_t)(sign * 1000), sign * 25000, 0), ORI_FAULT_NONE);
        CHECK_EQUAL(fault_of(50000, 0, (int16_t)(sign * 1000), sign * 25001, 0), ORI_FAULT_ACCELERATION_LIMIT);
        CHECK_EQUAL(fault_of(50000, 0, (int16_t)(sign * 1000), sign * 24999, 0), ORI_FAULT_ACCELERATION_LIMIT);
    }
    /* One end alone beyond: 6 way / dt^2 - 2 v1 / dt at the beginning, and mirrored. */
    CHECK_EQUAL(fault_of(100000, 0, 0, 33333, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(100000, 0, 0, 33334, 0), ORI_FAULT_ACCELERATION_LIMIT);
    CHECK_EQUAL(fault_of(100000, 0, 0, 43333, 300), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(100000, 0, 0, 43334, 300), ORI_FAULT_ACCELERATION_LIMIT);
    CHECK_EQUAL(fault_of(100000, 0, 300, 43333, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(100000, 0, 300, 43334, 0), ORI_FAULT_ACCELERATION_LIMIT);
}

/* The hull of the position: a segment that leaves towards the end of the range, and one that comes from there. */
static void test_positions_stay_in_the_range(void)
{
    set_up(3);
    config.hinge[2].max_acceleration_mrad_s2 = 100000;
    CHECK_EQUAL(fault_of(30000, HIGH - 2000, 200, HIGH - 1000, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(30000, HIGH - 1999, 200, HIGH - 1000, 0), ORI_FAULT_POSITION_LIMIT);
    CHECK_EQUAL(fault_of(30000, HIGH - 1000, 0, HIGH - 2000, -200), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(30000, HIGH - 1000, 0, HIGH - 1999, -200), ORI_FAULT_POSITION_LIMIT);
    CHECK_EQUAL(fault_of(30000, LOW + 2000, -200, LOW + 1000, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(30000, LOW + 1999, -200, LOW + 1000, 0), ORI_FAULT_POSITION_LIMIT);
    CHECK_EQUAL(fault_of(30000, LOW + 1000, 0, LOW + 2000, 200), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(30000, LOW + 1000, 0, LOW + 1999, 200), ORI_FAULT_POSITION_LIMIT);
    CHECK_EQUAL(fault_of(1000000, LOW, 0, LOW, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(1000000, HIGH, 0, HIGH, 0), ORI_FAULT_NONE);
}

typedef struct {
    double dt, p0, v0, p1, v1; /* s, rad, rad/s */
} segment_t;

static double speed_at(const segment_t *s, double u)
{
    const double mean = (s->p1 - s->p0) / s->dt;
    return 6 * u * (1 - u) * mean + (1 - u) * (1 - 3 * u) * s->v0 + u * (3 * u - 2) * s->v1;
}

static double position_at(const segment_t *s, double u)
{
    const double v = 1 - u;
    return s->p0 * v * v * (1 + 2 * u) + s->p1 * u * u * (3 - 2 * u) + s->dt * u * v * (v * s->v0 - u * s->v1);
}

/* Largest speed, from where the derivative of the parabola is 0. */
static double peak_speed(const segment_t *s)
{
    const double mean = (s->p1 - s->p0) / s->dt;
    const double curve = 3 * (s->v0 + s->v1 - 2 * mean), slope = 6 * mean - 4 * s->v0 - 2 * s->v1;
    const double u = curve != 0 ? -slope / (2 * curve) : 0;
    double peak = fmax(fabs(s->v0), fabs(s->v1));
    if (u > 0 && u < 1)
        peak = fmax(peak, fabs(speed_at(s, u)));
    return peak;
}

static double peak_acceleration(const segment_t *s)
{
    const double mean = (s->p1 - s->p0) / s->dt;
    return fmax(fabs(6 * mean - 4 * s->v0 - 2 * s->v1), fabs(4 * s->v1 + 2 * s->v0 - 6 * mean)) / s->dt;
}

/* Whether the hull of the positions stays in the range by more than a rounding. */
static int hull_is_inside(const segment_t *s)
{
    const double leaving = s->p0 + s->v0 * s->dt / 3, arriving = s->p1 - s->v1 * s->dt / 3;
    return fmin(leaving, arriving) >= LOW * 1e-6 + 1e-6 && fmax(leaving, arriving) <= HIGH * 1e-6 - 1e-6;
}

static void check_accepted(const segment_t *s, double v_max, double a_max)
{
    for (unsigned i = 0; i <= 64; i++) {
        const double u = i / 64.0;
        CHECK(fabs(speed_at(s, u)) <= v_max * 1.0005 + 2e-6 / s->dt);
        CHECK(position_at(s, u) <= HIGH * 1e-6 + 1e-9 && position_at(s, u) >= LOW * 1e-6 - 1e-9);
    }
    CHECK(peak_speed(s) <= v_max * 1.0005 + 2e-6 / s->dt);
    CHECK(peak_acceleration(s) <= a_max * 1.0001);
}

/* Segments around the limits: none is accepted that goes beyond, none refused that stays below by 1 %. */
static void check_random_segments(uint32_t seed, unsigned count, uint16_t v_max, uint32_t a_max, uint32_t longest_us)
{
    unsigned accepted = 0, slow = 0, fast = 0, hard = 0;
    set_up(1);
    config.hinge[0].max_velocity_mrad_s = v_max;
    config.hinge[0].max_acceleration_mrad_s2 = a_max;
    for (unsigned n = 0; n < count; n++) {
        const uint32_t dt_us = 1000 + random_below(&seed, longest_us - 999);
        const double dt = dt_us * 1e-6;
        const double jump = fmin(2.2 * v_max, a_max * dt * 1.2);
        const int16_t v0 = (int16_t)random_between(&seed, -v_max, v_max);
        const double wanted = v0 + random_between(&seed, -1000, 1000) * 1e-3 * jump;
        const int16_t v1 = (int16_t)fmax(-v_max, fmin(v_max, wanted));
        const double mean = (v0 + v1) * 0.5 + random_between(&seed, -1000, 1000) * 1e-3 * fmin(0.8 * v_max, a_max * dt * 0.2);
        const int32_t p0 = random_between(&seed, LOW, HIGH);
        const int32_t p1 = p0 + (int32_t)(mean * dt * 1000);
        if (p1 < LOW || p1 > HIGH)
            continue;
        const segment_t s = {dt, p0 * 1e-6, v0 * 1e-3, p1 * 1e-6, v1 * 1e-3};
        const uint8_t fault = fault_of(dt_us, p0, v0, p1, v1);
        const double v = peak_speed(&s) / (v_max * 1e-3), a = peak_acceleration(&s) / (a_max * 1e-3);
        if (fault == ORI_FAULT_NONE) {
            accepted++;
            check_accepted(&s, v_max * 1e-3, a_max * 1e-3);
        } else if (v < 0.99 && a < 0.99 && hull_is_inside(&s)) {
            check_failed(__FILE__, __LINE__, "refused with %u: %u us, %d urad %d mrad/s to %d urad %d mrad/s: %.3f of the speed, "
                         "%.3f of the acceleration", fault, dt_us, p0, v0, p1, v1, v, a);
        }
        slow += fault == ORI_FAULT_NONE && v > 0.9;
        fast += fault == ORI_FAULT_VELOCITY_LIMIT;
        hard += fault == ORI_FAULT_ACCELERATION_LIMIT;
    }
    CHECK(accepted > count / 20 && slow > count / 100 && fast > count / 100 && hard > count / 100);
}

static void test_random_segments_of_a_quick_rig(void)
{
    check_random_segments(1, 12000, 2000, 20000, 200000);
}

static void test_random_segments_of_a_slow_rig(void)
{
    check_random_segments(2, 6000, 300, 1000, 1000000);
}

static void test_random_segments_of_the_quickest_rig(void)
{
    check_random_segments(3, 6000, 30000, 2000000, 60000);
}

/* The most that records and messages can say overflows nothing. */
static void test_extremes_overflow_nothing(void)
{
    set_up(1);
    config.hinge[0].min_urad = INT32_MIN;
    config.hinge[0].max_urad = INT32_MAX;
    config.hinge[0].max_velocity_mrad_s = UINT16_MAX;
    config.hinge[0].max_acceleration_mrad_s2 = UINT32_MAX;
    CHECK_EQUAL(of_knot(0, INT32_MIN, INT16_MIN), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(1000000, INT32_MIN, INT16_MIN, INT32_MAX, INT16_MAX), ORI_FAULT_VELOCITY_LIMIT);
    CHECK_EQUAL(fault_of(1000000, INT32_MAX, INT16_MAX, INT32_MIN, INT16_MIN), ORI_FAULT_VELOCITY_LIMIT);
    CHECK_EQUAL(fault_of(1000, INT32_MAX, 0, INT32_MAX, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_of(1000000, 0, INT16_MAX, 32767000, INT16_MAX), ORI_FAULT_NONE);
}

SUITE(motion_limits, TEST(test_knots_are_within_ranges_and_speeds), TEST(test_every_hinge_has_its_own_limits),
      TEST(test_knots_are_in_order_and_not_too_far_apart), TEST(test_speed_at_its_limit), TEST(test_acceleration_at_its_limit),
      TEST(test_positions_stay_in_the_range), TEST(test_extremes_overflow_nothing), TEST(test_random_segments_of_a_quick_rig),
      TEST(test_random_segments_of_a_slow_rig), TEST(test_random_segments_of_the_quickest_rig));
