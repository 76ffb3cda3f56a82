#include "latches.h"

#include <string.h>

#include "port.h"

#define STEP_MS ((uint32_t)(ORI_FRAME_US / 1000U))

#define NOT_KNOWN UINT32_MAX

typedef struct {
    uint16_t steady_ms; /* since the sensor last changed */
    uint16_t driving_ms;
    bool engaged;
    bool sensed; /* steady long enough to be believed */
    bool closed; /* as last believed */
    bool level;  /* closed, as the sensor says now */
} latch_t;

static latch_t latches[ORI_LATCHES];
/* Heat of an electromagnet in ms of full power times 1000: while on it grows by 1000 - duty a ms, while off it falls by
 * duty a ms; it lets go at max_on_ms (1000 - duty). */
static port_kept_t *kept;

/* At most 3.6e9, so that a step more still fits. */
static uint32_t hottest(const mavlink_ori_config_latch_t *record)
{
    return record->max_on_ms * (1000U - record->duty_permille);
}

static uint16_t magnet_bit(const mavlink_ori_config_latch_t *record)
{
    return (uint16_t)(1U << record->output);
}

static bool is_electromagnet(uint8_t index)
{
    return index < config.device.latches && config.latch[index].kind == ORI_ELECTROMAGNET;
}

static uint16_t check_of_kept(void)
{
    return crc_calculate((const uint8_t *)kept, offsetof(port_kept_t, check));
}

/* Whoever comes without a record in force waits as it is for one. */
static void recall_heat(void)
{
    kept = port_kept();
    const bool cold = port_reset_cause() == PORT_RESET_POWER;
    if (kept->check != check_of_kept()) {
        for (uint8_t i = 0; i < ORI_MAGNET_OUTPUTS; i++)
            kept->heat[i] = cold ? 0 : NOT_KNOWN;
    }
    for (uint8_t i = 0; i < ORI_LATCHES; i++) {
        const mavlink_ori_config_latch_t *record = &config.latch[i];
        if (!is_electromagnet(i))
            continue;
        uint32_t *heat = &kept->heat[record->output];
        if (*heat >= hottest(record)) {
            *heat = hottest(record);
            kept->tripped |= magnet_bit(record);
        }
        if (*heat == 0)
            kept->tripped &= (uint16_t)~magnet_bit(record);
    }
    kept->check = check_of_kept();
}

void latches_init(void)
{
    memset(latches, 0, sizeof latches);
    for (uint8_t i = 0; i < ORI_MAGNET_OUTPUTS; i++)
        port_magnet(i, false);
    recall_heat();
}

static void drive(uint8_t index, bool engage)
{
    const mavlink_ori_config_latch_t *record = &config.latch[index];
    latch_t *latch = &latches[index];
    if (record->kind == ORI_ELECTROMAGNET)
        port_magnet(record->output, engage);
    if (record->kind == ORI_LOCK_PIN) {
        const uint32_t pulse_us = engage ? record->engaged_us : record->released_us;
        port_servo(record->output, (uint16_t)(pulse_us * 1000U / ORI_TICK_NS));
        latch->driving_ms = record->travel_ms;
    }
    latch->engaged = engage;
}

static bool is_tripped(uint8_t index)
{
    return is_electromagnet(index) && (kept->tripped & magnet_bit(&config.latch[index]));
}

uint8_t latches_command(uint8_t index, bool engage)
{
    if (index >= config.device.latches)
        return ORI_REFUSED_INDEX;
    if (engage && is_tripped(index))
        return ORI_REFUSED_TRIPPED;
    drive(index, engage);
    return ORI_ACCEPTED;
}

/* Returns whether it lets go of itself now. */
static bool step_heat(uint8_t index)
{
    const mavlink_ori_config_latch_t *record = &config.latch[index];
    uint32_t *heat = &kept->heat[record->output];
    if (latches[index].engaged) {
        *heat += STEP_MS * (1000U - record->duty_permille);
        if (record->duty_permille < 1000 && *heat >= hottest(record)) {
            drive(index, false);
            kept->tripped |= magnet_bit(record);
            return true;
        }
        return false;
    }
    const uint32_t cooled = STEP_MS * record->duty_permille;
    *heat = *heat > cooled ? *heat - cooled : 0;
    if (*heat == 0)
        kept->tripped &= (uint16_t)~magnet_bit(record);
    return false;
}

/* In whole steps; a magnet without any duty never cools. */
static int32_t cold_in_ms(uint8_t index)
{
    const uint32_t heat = kept->heat[config.latch[index].output];
    const uint32_t cooled = STEP_MS * config.latch[index].duty_permille;
    if (heat == 0)
        return 0;
    const uint32_t steps = cooled ? (heat + cooled - 1U) / cooled : NOT_KNOWN;
    return steps > (uint32_t)INT32_MAX / STEP_MS ? INT32_MAX : (int32_t)(steps * STEP_MS);
}

int32_t latches_hot_ms(uint8_t *index)
{
    int32_t longest = 0;
    for (uint8_t i = 0; i < ORI_LATCHES; i++) {
        const int32_t ms = is_electromagnet(i) ? cold_in_ms(i) : 0;
        if (ms > longest) {
            longest = ms;
            *index = i;
        }
    }
    return longest;
}

static void step_sensor(uint8_t index)
{
    const mavlink_ori_config_latch_t *record = &config.latch[index];
    latch_t *latch = &latches[index];
    if (record->sensor == ORI_NOBODY)
        return;
    const bool high = (port_sensors() >> record->sensor) & 1U;
    const bool level = high == ((record->flags & ORI_LATCH_SENSOR_HIGH) != 0);
    if (level != latch->level) {
        latch->level = level;
        latch->steady_ms = 0;
        latch->sensed = false;
    } else if (latch->steady_ms < record->debounce_ms) {
        latch->steady_ms = (uint16_t)(latch->steady_ms + STEP_MS);
    }
    if (latch->steady_ms >= record->debounce_ms) {
        latch->sensed = true;
        latch->closed = level;
    }
}

uint8_t latches_step(void)
{
    uint8_t tripped = 0;
    for (uint8_t i = 0; i < config.device.latches; i++) {
        latch_t *latch = &latches[i];
        if (is_electromagnet(i) && step_heat(i))
            tripped |= (uint8_t)(1U << i);
        latch->driving_ms = latch->driving_ms > STEP_MS ? (uint16_t)(latch->driving_ms - STEP_MS) : 0;
        step_sensor(i);
    }
    kept->check = check_of_kept();
    return tripped;
}

bool latches_drives(uint8_t index)
{
    return index < config.device.latches && config.latch[index].kind != ORI_MAGNET;
}

bool latches_driven(void)
{
    for (uint8_t i = 0; i < config.device.latches; i++)
        if (latches[i].engaged && latches_drives(i))
            return true;
    return false;
}

static uint16_t duty_left(uint8_t index)
{
    const uint32_t limit = is_electromagnet(index) ? hottest(&config.latch[index]) : 0;
    if (limit == 0)
        return 1000;
    const uint32_t heat = kept->heat[config.latch[index].output];
    return heat >= limit ? 0 : (uint16_t)(1000U - (uint64_t)heat * 1000U / limit);
}

void latches_report(mavlink_ori_latch_state_t *report)
{
    report->commanded = report->closed = report->sensed = report->tripped = report->driving = 0;
    for (uint8_t i = 0; i < ORI_LATCHES; i++) {
        const latch_t *latch = &latches[i];
        const uint16_t bit = (uint16_t)(1U << i);
        report->duty_left_permille[i] = duty_left(i);
        report->commanded |= latch->engaged ? bit : 0;
        report->closed |= latch->sensed && latch->closed ? bit : 0;
        report->sensed |= latch->sensed ? bit : 0;
        report->tripped |= is_tripped(i) ? bit : 0;
        report->driving |= latch->driving_ms ? bit : 0;
    }
}
