#include "motion_limits.h"

#include "fixed.h"

static const verdict_t GOOD = {ORI_FAULT_NONE, ORI_NOBODY};

static bool inside(const mavlink_ori_config_hinge_t *hinge, int32_t position_urad)
{
    return position_urad >= hinge->min_urad && position_urad <= hinge->max_urad;
}

verdict_t limits_of_knot(const knot_t *knot)
{
    for (uint8_t k = 0; k < config.device.hinges; k++) {
        const mavlink_ori_config_hinge_t *hinge = &config.hinge[k];
        const int32_t speed = knot->velocity_mrad_s[k];
        if (!inside(hinge, knot->position_urad[k]))
            return (verdict_t){ORI_FAULT_POSITION_LIMIT, k};
        if ((speed < 0 ? -speed : speed) > (int32_t)hinge->max_velocity_mrad_s)
            return (verdict_t){ORI_FAULT_VELOCITY_LIMIT, k};
    }
    return GOOD;
}

/* Whether a parabola with Bernstein coefficients v0, b, v1 goes beyond `fastest`, when its ends do not.
 *
 * It lies within the hull of its coefficients, so b has to. Then it turns between the ends, and with p = |b - v0| and
 * q = |b - v1| its peak is p q / (p + q) short of |b|. Units of 2^8 keep the products below 2^63: no more than three
 * times the fastest can b be without the middle of the parabola, (v0 + 2 b + v1) / 4, being too fast. */
static bool is_too_fast(int64_t v0, int64_t b, int64_t v1, int64_t fastest)
{
    if (abs64(b) <= fastest)
        return false;
    if (abs64(b) > 3 * fastest)
        return true;
    const int64_t p = abs64(b - v0) >> 8, q = abs64(b - v1) >> 8, beyond = (abs64(b) - fastest) >> 8;
    return beyond * (p + q) > p * q;
}

/* Speed and acceleration of one hinge over a segment of dt.
 *
 * The velocity of a cubic is a parabola with Bernstein coefficients v0, b = 3 m - v0 - v1, v1, where m is the mean
 * velocity. The acceleration is a straight line from 2 (b - v0) / dt to 2 (v1 - b) / dt. Everything is multiplied by
 * dt, in nrad, so that nothing is divided.
 *
 * The position lies within the hull of p0, p0 + v0 dt / 3, p1 - v1 dt / 3, p1: where that leaves the range, the
 * spline may, and it is refused. */
static uint8_t judge(const mavlink_ori_config_hinge_t *hinge, const knot_t *a, const knot_t *b, uint8_t k, uint32_t dt_us,
                     uint32_t dt2)
{
    const int64_t v0 = (int64_t)a->velocity_mrad_s[k] * (int32_t)dt_us;
    const int64_t v1 = (int64_t)b->velocity_mrad_s[k] * (int32_t)dt_us;
    const int64_t way = ((int64_t)b->position_urad[k] - a->position_urad[k]) * 1000;
    const int64_t middle = 3 * way - v0 - v1;
    const int64_t fastest = (int64_t)hinge->max_velocity_mrad_s * (int32_t)dt_us;
    const int64_t steepest = ((int64_t)hinge->max_acceleration_mrad_s2 * (int32_t)dt2) >> 8;

    if (is_too_fast(v0, middle, v1, fastest))
        return ORI_FAULT_VELOCITY_LIMIT;
    if (2 * abs64(middle - v0) > steepest || 2 * abs64(v1 - middle) > steepest)
        return ORI_FAULT_ACCELERATION_LIMIT;
    const int64_t low = (int64_t)hinge->min_urad * 3000, high = (int64_t)hinge->max_urad * 3000;
    const int64_t leaving = (int64_t)a->position_urad[k] * 3000 + v0, arriving = (int64_t)b->position_urad[k] * 3000 - v1;
    if (leaving < low || leaving > high || arriving < low || arriving > high)
        return ORI_FAULT_POSITION_LIMIT;
    return ORI_FAULT_NONE;
}

verdict_t limits_of_segment(const knot_t *a, const knot_t *b)
{
    const uint32_t dt_us = b->time_us - a->time_us;
    if ((int32_t)dt_us < (int32_t)SHORTEST_SEGMENT_US || dt_us > LONGEST_SEGMENT_US)
        return (verdict_t){ORI_FAULT_KNOT_TIME, ORI_NOBODY};
    /* dt^2 in s us 2^-8: mrad/s^2 times this is nrad 2^-8. */
    const uint32_t dt2 = (uint32_t)(((uint64_t)dt_us * dt_us << 8) / 1000000U);
    for (uint8_t k = 0; k < config.device.hinges; k++) {
        const uint8_t fault = judge(&config.hinge[k], a, b, k, dt_us, dt2);
        if (fault != ORI_FAULT_NONE)
            return (verdict_t){fault, k};
    }
    return GOOD;
}
