#include "hinges.h"

#include <string.h>

#include "fixed.h"
#include "port.h"

#define TICKS_PER_US (1000U / ORI_TICK_NS)
#define STEP_MS ((uint16_t)(ORI_FRAME_US / 1000U))

/* What is computed once from a record, so that a frame needs no division. */
typedef struct {
    int32_t tick_zero;       /* ticks at position 0, 2^-8 */
    int32_t tick_slope;      /* ticks per urad, 2^-32 */
    int32_t feedback_slope;  /* urad per count, 2^-12 */
    uint16_t shortest;       /* ticks of a pulse */
    uint16_t longest;
    uint8_t output;
    uint16_t away_ms;        /* for how long it has not followed */
    uint8_t dark_frames;     /* for how long it has not said where it is, while on */
} hinge_t;

static hinge_t hinges[ORI_HINGES];
static int32_t asked[ORI_HINGES];
static int32_t measured[ORI_HINGES];
static uint16_t on;
static uint16_t stalled;
static uint16_t sensed;
static uint16_t silent;

static uint16_t bit_of(uint8_t hinge)
{
    return (uint16_t)(1U << hinge);
}

static bool has_feedback(uint8_t hinge)
{
    return (config.hinge[hinge].flags & ORI_HINGE_HAS_FEEDBACK) != 0;
}

static int32_t scaled(int32_t value, int32_t numerator, int32_t denominator)
{
    const int64_t product = (int64_t)value * numerator;
    return (int32_t)((product + (product < 0 ? -denominator : denominator) / 2) / denominator);
}

void hinges_init(void)
{
    memset(hinges, 0, sizeof hinges);
    memset(asked, 0, sizeof asked);
    memset(measured, 0, sizeof measured);
    on = stalled = sensed = silent = 0;
    for (uint8_t i = 0; i < ORI_SERVO_OUTPUTS; i++)
        port_servo(i, 0);
    for (uint8_t k = 0; k < config.device.hinges; k++) {
        const mavlink_ori_config_hinge_t *record = &config.hinge[k];
        hinges[k].tick_zero = scaled(record->pulse_zero_ns, 256, ORI_TICK_NS);
        /* 2^32 / (500 ns 10^6) = 2^26 / 7812500 */
        hinges[k].tick_slope = scaled(record->pulse_slope_ns, INT32_C(1) << 26, 7812500);
        hinges[k].output = record->channel;
        hinges[k].shortest = (uint16_t)(record->pulse_min_us * TICKS_PER_US);
        hinges[k].longest = (uint16_t)(record->pulse_max_us * TICKS_PER_US);
        hinges[k].feedback_slope = scaled(record->feedback_slope_nrad, 4096, 1000);
    }
}

uint16_t hinges_on(void)
{
    return on;
}

uint16_t hinges_stalled(void)
{
    return stalled;
}

void hinges_forgive(void)
{
    stalled = 0;
}

/* Pulse for a position, rounded to the nearest tick and kept within what the servo may get. */
static uint16_t ticks_of(uint8_t k, int32_t position_urad)
{
    const hinge_t *hinge = &hinges[k];
    const int32_t fine = hinge->tick_zero + (int32_t)(((int64_t)hinge->tick_slope * position_urad) >> 24);
    const int32_t ticks = (fine + 128) >> 8;
    if (ticks < (int32_t)hinge->shortest)
        return hinge->shortest;
    return ticks > (int32_t)hinge->longest ? hinge->longest : (uint16_t)ticks;
}

static void ask(uint8_t k, int32_t position_urad)
{
    asked[k] = position_urad;
    port_servo(hinges[k].output, ticks_of(k, position_urad));
}

static void turn_off(uint8_t k)
{
    on &= (uint16_t)~bit_of(k);
    asked[k] = 0;
    hinges[k].away_ms = 0;
    hinges[k].dark_frames = 0;
    port_servo(config.hinge[k].channel, 0);
}

static void measure(void)
{
    sensed = silent = 0;
    for (uint8_t k = 0; k < config.device.hinges; k++) {
        const mavlink_ori_config_hinge_t *record = &config.hinge[k];
        const uint16_t count = port_adc(record->adc);
        measured[k] = 0;
        if (!has_feedback(k))
            continue;
        if (count < record->feedback_low) {
            silent |= bit_of(k);
        } else if (count <= record->feedback_high) {
            sensed |= bit_of(k);
            measured[k] = record->feedback_zero_urad + (int32_t)(((int64_t)hinges[k].feedback_slope * count) >> 12);
        }
    }
}

static uint8_t judge_enable(uint8_t k, int32_t position_urad, int32_t *value)
{
    const mavlink_ori_config_hinge_t *record = &config.hinge[k];
    if (stalled & bit_of(k))
        return ORI_REFUSED_TRIPPED;
    if (position_urad < record->min_urad || position_urad > record->max_urad)
        return ORI_REFUSED_RANGE;
    if (has_feedback(k) && !(sensed & bit_of(k)))
        return ORI_REFUSED_SENSOR;
    *value = has_feedback(k) ? measured[k] : asked[k];
    const bool known = has_feedback(k) || (on & bit_of(k)); /* for others the host's word is all there is */
    if (known && distance(*value, position_urad) > config.device.seat_urad)
        return ORI_REFUSED_POSITION;
    return ORI_ACCEPTED;
}

uint8_t hinges_enable(uint16_t which, const int32_t *position_urad, uint8_t *index, int32_t *value)
{
    measure();
    for (uint8_t k = 0; k < 16; k++) { /* every bit there is */
        if (!(which & bit_of(k)))
            continue;
        *index = k;
        const uint8_t result = k < config.device.hinges ? judge_enable(k, position_urad[k], value) : ORI_REFUSED_INDEX;
        if (result != ORI_ACCEPTED)
            return result;
    }
    for (uint8_t k = 0; k < config.device.hinges; k++) {
        if (which & ~on & bit_of(k)) {
            on |= bit_of(k);
            ask(k, position_urad[k]);
        }
    }
    return ORI_ACCEPTED;
}

void hinges_disable(uint16_t which)
{
    for (uint8_t k = 0; k < config.device.hinges; k++)
        if (which & bit_of(k))
            turn_off(k);
}

void hinges_output(const int32_t *position_urad)
{
    uint16_t bit = 1;
    for (uint8_t k = 0; k < config.device.hinges; k++, bit <<= 1)
        if (on & bit)
            ask(k, position_urad[k]);
}

const int32_t *hinges_asked(void)
{
    return asked;
}

/* One reading that cannot be is noise: it takes several in a row. */
static void count_dark(uint8_t k)
{
    const bool dark = (on & bit_of(k)) && has_feedback(k) && !(sensed & bit_of(k));
    if (!dark)
        hinges[k].dark_frames = 0;
    else if (hinges[k].dark_frames < FEEDBACK_LOST_FRAMES)
        hinges[k].dark_frames++;
}

uint8_t hinges_lost(void)
{
    for (uint8_t k = 0; k < config.device.hinges; k++)
        if (hinges[k].dark_frames >= FEEDBACK_LOST_FRAMES)
            return k;
    return ORI_NOBODY;
}

verdict_t hinges_sense(void)
{
    verdict_t worst = {ORI_FAULT_NONE, ORI_NOBODY};
    measure();
    for (uint8_t k = 0; k < config.device.hinges; k++) {
        count_dark(k);
        if (!(on & sensed & bit_of(k)) || distance(asked[k], measured[k]) <= config.device.stall_urad) {
            hinges[k].away_ms = 0;
            continue;
        }
        hinges[k].away_ms = (uint16_t)(hinges[k].away_ms + STEP_MS);
        if (hinges[k].away_ms > config.device.stall_ms) {
            stalled |= bit_of(k);
            turn_off(k);
            worst = (verdict_t){ORI_FAULT_STALL, k};
        }
    }
    if (worst.fault == ORI_FAULT_NONE && hinges_lost() != ORI_NOBODY)
        worst = (verdict_t){ORI_FAULT_FEEDBACK_LOST, hinges_lost()};
    return worst;
}

void hinges_report(mavlink_ori_state_t *report)
{
    measure();
    memcpy(report->position_urad, measured, sizeof measured);
    memcpy(report->output_urad, asked, sizeof asked);
    report->outputs_on = on;
    report->sensed = sensed;
    report->silent = silent;
    report->stalled = stalled;
}
