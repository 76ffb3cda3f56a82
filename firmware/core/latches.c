#include "latches.h"

#include <string.h>

#include "port.h"

#define STEP_MS ((uint32_t)(ORI_FRAME_US / 1000U))

typedef struct {
    /* Heat of an electromagnet in ms of full power times 1000: while on it grows by 1000 - duty a ms, while off it
     * falls by duty a ms; it lets go at max_on_ms (1000 - duty). */
    uint64_t heat;
    uint16_t steady_ms; /* since the sensor last changed */
    uint16_t driving_ms;
    bool engaged;
    bool tripped;
    bool sensed; /* steady long enough to be believed */
    bool closed; /* as last believed */
    bool level;  /* closed, as the sensor says now */
} latch_t;

static latch_t latches[ORI_LATCHES];

void latches_init(void)
{
    memset(latches, 0, sizeof latches);
    for (uint8_t i = 0; i < ORI_MAGNET_OUTPUTS; i++)
        port_magnet(i, false);
}

static uint64_t hottest(const mavlink_ori_config_latch_t *record)
{
    return (uint64_t)record->max_on_ms * (1000U - record->duty_permille);
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

uint8_t latches_command(uint8_t index, bool engage)
{
    if (index >= config.device.latches)
        return ORI_REFUSED_INDEX;
    if (engage && latches[index].tripped)
        return ORI_REFUSED_TRIPPED;
    drive(index, engage);
    return ORI_ACCEPTED;
}

/* Returns whether it lets go of itself now. */
static bool step_heat(uint8_t index)
{
    const mavlink_ori_config_latch_t *record = &config.latch[index];
    latch_t *latch = &latches[index];
    if (latch->engaged) {
        latch->heat += STEP_MS * (1000U - record->duty_permille);
        if (record->duty_permille < 1000 && latch->heat >= hottest(record)) {
            drive(index, false);
            latch->tripped = true;
            return true;
        }
        return false;
    }
    const uint32_t cooled = STEP_MS * record->duty_permille;
    latch->heat = latch->heat > cooled ? latch->heat - cooled : 0;
    if (latch->heat == 0)
        latch->tripped = false;
    return false;
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
        if (config.latch[i].kind == ORI_ELECTROMAGNET && step_heat(i))
            tripped |= (uint8_t)(1U << i);
        latch->driving_ms = latch->driving_ms > STEP_MS ? (uint16_t)(latch->driving_ms - STEP_MS) : 0;
        step_sensor(i);
    }
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
    const mavlink_ori_config_latch_t *record = &config.latch[index];
    const uint64_t limit = hottest(record);
    if (record->kind != ORI_ELECTROMAGNET || limit == 0)
        return 1000;
    return latches[index].heat >= limit ? 0 : (uint16_t)(1000U - latches[index].heat * 1000U / limit);
}

void latches_report(mavlink_ori_latch_state_t *report)
{
    report->commanded = report->closed = report->sensed = report->tripped = report->driving = 0;
    for (uint8_t i = 0; i < ORI_LATCHES; i++) {
        const latch_t *latch = &latches[i];
        const uint16_t bit = (uint16_t)(1U << i);
        report->duty_left_permille[i] = i < config.device.latches ? duty_left(i) : 1000;
        report->commanded |= latch->engaged ? bit : 0;
        report->closed |= latch->sensed && latch->closed ? bit : 0;
        report->sensed |= latch->sensed ? bit : 0;
        report->tripped |= latch->tripped ? bit : 0;
        report->driving |= latch->driving_ms ? bit : 0;
    }
}
