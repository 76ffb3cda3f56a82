/* The queue against Hermite's formula in long double, and its ring against what a ring is. */
#include <math.h>
#include <stdlib.h>

#include "check.h"
#include "queue.h"

static knot_t knot_at(uint32_t time_us, int32_t position_urad, int16_t velocity_mrad_s)
{
    knot_t knot = {.time_us = time_us};
    for (unsigned k = 0; k < ORI_HINGES; k++) {
        knot.position_urad[k] = position_urad + (int32_t)k;
        knot.velocity_mrad_s[k] = velocity_mrad_s;
    }
    return knot;
}

static void push(uint32_t time_us, int32_t position_urad, int16_t velocity_mrad_s)
{
    const knot_t knot = knot_at(time_us, position_urad, velocity_mrad_s);
    queue_push(&knot);
}

/* p(u) = (1 + 2 u)(1 - u)^2 p0 + u (1 - u)^2 dt v0 + u^2 (3 - 2 u) p1 + u^2 (u - 1) dt v1, in urad. */
static long double hermite(const knot_t *a, const knot_t *b, unsigned k, uint32_t time_us)
{
    const long double dt = (long double)(uint32_t)(b->time_us - a->time_us) * 1e-6L;
    const long double u = (long double)(uint32_t)(time_us - a->time_us) * 1e-6L / dt;
    const long double v = 1 - u;
    return (1 + 2 * u) * v * v * a->position_urad[k] + u * v * v * dt * a->velocity_mrad_s[k] * 1000 +
           u * u * (3 - 2 * u) * b->position_urad[k] - u * u * v * dt * b->velocity_mrad_s[k] * 1000;
}

static void test_counts_what_is_in_it(void)
{
    queue_clear();
    CHECK_EQUAL(queue_size(), 0);
    for (uint32_t i = 0; i < QUEUE_KNOTS; i++) {
        CHECK(!queue_full());
        push(i * 20000, 0, 0);
        CHECK_EQUAL(queue_size(), i + 1);
        CHECK_EQUAL(queue_first()->time_us, 0);
        CHECK_EQUAL(queue_last()->time_us, i * 20000);
    }
    CHECK(queue_full());
    queue_clear();
    CHECK_EQUAL(queue_size(), 0);
}

static void test_goes_around_many_times(void)
{
    queue_clear();
    push(0, 0, 0);
    for (uint32_t i = 1; i < 200; i++) {
        push(i * 1000, (int32_t)i, 0);
        if (queue_size() > 7)
            queue_pass((i - 4) * 1000);
        CHECK_EQUAL(queue_last()->position_urad[0], i);
        CHECK_EQUAL(queue_first()->position_urad[0], i - queue_size() + 1);
    }
}

static void test_forgets_what_has_passed_but_the_last(void)
{
    queue_clear();
    push(1000, 1, 0);
    push(2000, 2, 0);
    push(3000, 3, 0);
    queue_pass(1999);
    CHECK_EQUAL(queue_size(), 3);
    queue_pass(2000);
    CHECK_EQUAL(queue_size(), 2);
    CHECK_EQUAL(queue_first()->time_us, 2000);
    queue_pass(900000);
    CHECK_EQUAL(queue_size(), 1);
    CHECK_EQUAL(queue_first()->time_us, 3000);
    queue_pass(1000000);
    CHECK_EQUAL(queue_size(), 1);
}

static void test_rests_before_the_first_and_after_the_last(void)
{
    int32_t position[ORI_HINGES];
    queue_clear();
    push(500000, 1000, 100);
    queue_positions(400000, ORI_HINGES, position);
    CHECK_EQUAL(position[3], 1003);
    push(600000, 9000, 100);
    queue_positions(499999, ORI_HINGES, position);
    CHECK_EQUAL(position[11], 1011);
    queue_positions(600000, ORI_HINGES, position);
    CHECK_EQUAL(position[0], 9000);
    queue_positions(2000000, ORI_HINGES, position);
    CHECK_EQUAL(position[11], 9011);
}

static void test_goes_through_its_knots(void)
{
    int32_t position[ORI_HINGES];
    queue_clear();
    for (uint32_t i = 0; i < 5; i++)
        push(100000 * i, (int32_t)(i * i * 5000), (int16_t)(i * 10));
    for (uint32_t i = 0; i < 5; i++) {
        queue_positions(100000 * i, ORI_HINGES, position);
        CHECK_EQUAL(position[2], i * i * 5000 + 2);
    }
}

static void test_leaves_other_hinges_alone(void)
{
    int32_t position[ORI_HINGES] = {[2] = 77};
    queue_clear();
    push(0, 1000, 0);
    push(1000, 2000, 0);
    queue_positions(500, 2, position);
    CHECK_EQUAL(position[1], 1501);
    CHECK_EQUAL(position[2], 77);
}

/* Random segments of every length, across the wrap of time as well; the error is that of a part of the way in 16 bits. */
static void test_is_hermites_spline(void)
{
    uint32_t seed = 4711;
    for (unsigned n = 0; n < 4000; n++) {
        const uint32_t dt = 1000 + random_below(&seed, n % 2 ? 999001 : 40000);
        const uint32_t start = n % 3 ? random_below(&seed, UINT32_MAX) : UINT32_MAX - random_below(&seed, dt);
        knot_t a = {.time_us = start}, b = {.time_us = start + dt};
        for (unsigned k = 0; k < ORI_HINGES; k++) {
            const int32_t way = (int32_t)dt * 30; /* at 30 rad/s */
            a.position_urad[k] = random_between(&seed, -7000000, 7000000);
            b.position_urad[k] = a.position_urad[k] + random_between(&seed, -way, way);
            a.velocity_mrad_s[k] = (int16_t)random_between(&seed, -32000, 32000);
            b.velocity_mrad_s[k] = (int16_t)random_between(&seed, -32000, 32000);
        }
        queue_clear();
        queue_push(&a);
        queue_push(&b);
        for (unsigned m = 0; m < 4; m++) {
            const uint32_t time = start + (m == 0 ? 1 : m == 1 ? dt - 1 : random_below(&seed, dt));
            const unsigned k = random_below(&seed, ORI_HINGES);
            int32_t position[ORI_HINGES];
            queue_positions(time, ORI_HINGES, position);
            const double way = fabs((double)b.position_urad[k] - a.position_urad[k]);
            const double bend = (abs(a.velocity_mrad_s[k]) + abs(b.velocity_mrad_s[k])) * 1e-3 * dt;
            /* Long segments are reckoned in units of 16 us. */
            const double late = dt > UINT16_MAX ? 16.0 / dt * (1.5 * way + bend) : 0;
            CHECK_NEAR(position[k], hermite(&a, &b, k, time), 8 + 1.5e-4 * way + 1e-4 * bend + late);
        }
    }
}

/* Neighbouring segments meet, so a pass of the queue in small steps never jumps. */
static void test_is_smooth_from_segment_to_segment(void)
{
    int32_t position[ORI_HINGES], before[ORI_HINGES];
    queue_clear();
    for (uint32_t i = 0; i < 10; i++)
        push(20000 * i, (int32_t)(40000 * (i % 3)), (int16_t)(i % 2 ? 500 : -500));
    queue_positions(0, 1, before);
    for (uint32_t time = 100; time < 180000; time += 100) {
        queue_positions(time, 1, position);
        CHECK_NEAR(position[0], before[0], 100 * 7.0); /* at most 7 rad/s here */
        before[0] = position[0];
        queue_pass(time);
    }
}

static void test_knows_whether_a_knot_moves(void)
{
    knot_t knot = knot_at(0, 5, 0);
    CHECK(!knot_moves(&knot, ORI_HINGES));
    knot.velocity_mrad_s[4] = -1;
    CHECK(!knot_moves(&knot, 4));
    CHECK(knot_moves(&knot, 5));
    knot.velocity_mrad_s[4] = 1;
    CHECK(knot_moves(&knot, 5));
}

SUITE(queue, TEST(test_counts_what_is_in_it), TEST(test_goes_around_many_times),
      TEST(test_forgets_what_has_passed_but_the_last), TEST(test_rests_before_the_first_and_after_the_last),
      TEST(test_goes_through_its_knots), TEST(test_leaves_other_hinges_alone), TEST(test_is_hermites_spline),
      TEST(test_is_smooth_from_segment_to_segment), TEST(test_knows_whether_a_knot_moves));
