#include "watch.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "faults.h"
#include "fake_port.h"
#include "hinges.h"
#include "machine.h"
#include "queue.h"

#define FRAME_S (ORI_FRAME_US * 1e-6)

typedef struct {
    int32_t asked[ORI_HINGES];
    uint16_t on;
    uint16_t servo[ORI_SERVO_OUTPUTS];
    bool magnet[ORI_MAGNET_OUTPUTS];
    uint8_t fault, state, stream, queued;
    uint16_t contiguous;
    uint32_t hash;
    uint64_t frame_us;
} seen_t;

uint64_t watch_states[6], watch_steps, watch_knots, watch_faults[ORI_FAULT_ENUM_END];

static seen_t before;
static uint64_t last_word_us;
static uint64_t late_us; /* since then */
static uint64_t magnet_on_us[ORI_MAGNET_OUTPUTS];

static void look(seen_t *seen)
{
    memcpy(seen->asked, hinges_asked(), sizeof seen->asked);
    memcpy(seen->servo, fake.servo, sizeof seen->servo);
    memcpy(seen->magnet, fake.magnet, sizeof seen->magnet);
    seen->on = hinges_on();
    seen->fault = fault_latched();
    seen->state = machine_state();
    seen->stream = machine_stream();
    seen->queued = machine_queued();
    seen->contiguous = machine_contiguous();
    seen->hash = config_hash();
}

void watch_begin(void)
{
    look(&before);
    before.frame_us = fake.micros;
    last_word_us = fake.micros;
    late_us = 0;
    CHECK_EQUAL(before.on, 0);
    for (unsigned i = 0; i < ORI_SERVO_OUTPUTS; i++)
        CHECK_EQUAL(before.servo[i], 0);
    for (unsigned i = 0; i < ORI_MAGNET_OUTPUTS; i++) {
        CHECK(!before.magnet[i]);
        magnet_on_us[i] = 0;
    }
}

static uint8_t pin_outputs_have(unsigned output)
{
    for (unsigned i = 0; i < config.device.latches; i++)
        if (config.latch[i].kind == ORI_LOCK_PIN && config.latch[i].output == output)
            return 1;
    return 0;
}

/* Pulse of a position, by the record. */
static double ticks_of(const mavlink_ori_config_hinge_t *record, int32_t position_urad)
{
    const double ticks = (record->pulse_zero_ns + (double)record->pulse_slope_ns * position_urad * 1e-6) / ORI_TICK_NS;
    return fmin(fmax(ticks, record->pulse_min_us * 2.0), record->pulse_max_us * 2.0);
}

/* Outputs never outside their limits; none but those that are on, and the pins' ones. */
static void check_outputs(const seen_t *now)
{
    bool explained[ORI_SERVO_OUTPUTS] = {false};
    CHECK((now->on >> config.device.hinges) == 0);
    for (unsigned k = 0; k < config.device.hinges; k++) {
        const mavlink_ori_config_hinge_t *record = &config.hinge[k];
        const uint16_t ticks = now->servo[record->channel];
        explained[record->channel] = true;
        if (!(now->on >> k & 1U)) {
            CHECK_EQUAL(ticks, 0);
            continue;
        }
        CHECK(now->asked[k] >= record->min_urad && now->asked[k] <= record->max_urad);
        CHECK(ticks >= record->pulse_min_us * 2U && ticks <= record->pulse_max_us * 2U);
        /* Half a tick, and for the slope, which has 15 bits, a part of the pulse's change. */
        const double expected = ticks_of(record, now->asked[k]);
        const double change = (double)record->pulse_slope_ns * now->asked[k] * 1e-6 / ORI_TICK_NS;
        CHECK_NEAR(ticks, expected, 0.6 + fabs(change) * 0x1p-14);
    }
    for (unsigned i = 0; i < ORI_SERVO_OUTPUTS; i++)
        CHECK(explained[i] || now->servo[i] == 0 || pin_outputs_have(i));
}

/* Nothing goes on but by ORI_ENABLE, and nothing moves but in a frame, no faster than it may. */
static void check_motion(const seen_t *now, const step_t *step)
{
    if (!step->enable)
        CHECK((now->on & ~before.on) == 0);
    if (!step->enable && !step->disable && !step->frame && !step->config)
        CHECK(now->on == before.on && memcmp(now->asked, before.asked, sizeof now->asked) == 0);
    for (unsigned k = 0; k < config.device.hinges && step->enable && !step->config; k++)
        CHECK(!(now->on & before.on & (1U << k)) || now->asked[k] == before.asked[k]);
    if (step->enable || step->config)
        return;
    const double frames = step->frame ? (double)(fake.micros - before.frame_us) / ORI_FRAME_US : 0;
    for (unsigned k = 0; k < config.device.hinges; k++) {
        if (!(now->on & before.on & (1U << k)))
            continue;
        const double most = config.hinge[k].max_velocity_mrad_s * 1e3 * FRAME_S * frames;
        CHECK(fabs((double)now->asked[k] - before.asked[k]) <= most * 1.001 + 203 + 4); /* how far a motion may begin away */
        if (before.state != ORI_STREAMING && before.state != ORI_BRAKING && now->state != ORI_STREAMING &&
            now->state != ORI_BRAKING)
            CHECK_EQUAL(now->asked[k], before.asked[k]);
    }
}

/* The first fault stays but for a graver one, ends only by its name or by a configuration, and while there is one no knot
 * is taken. */
static void check_faults(const seen_t *now, const step_t *step)
{
    const bool ends = (step->clear && step->cleared == before.fault && fault_end(before.fault) == CLEARABLE) ||
                      (step->config && before.fault == ORI_FAULT_CONFIG_CORRUPT);
    const bool graver = before.fault == ORI_FAULT_HOST_BRAKE || now->fault == ORI_FAULT_INTERNAL;
    if (before.fault != ORI_FAULT_NONE && !ends)
        CHECK(now->fault == before.fault || (graver && now->fault != ORI_FAULT_NONE));
    if (before.fault != ORI_FAULT_NONE) {
        CHECK_EQUAL(now->contiguous, before.contiguous);
        CHECK(now->queued <= before.queued);
    }
    const bool moves = now->state == ORI_STREAMING || now->state == ORI_HOLDING || now->state == ORI_IDLE;
    CHECK(!moves || now->fault == ORI_FAULT_NONE);
    CHECK((now->state != ORI_FAULTED && now->state != ORI_BRAKING) || now->fault != ORI_FAULT_NONE);
    CHECK(now->fault < ORI_FAULT_ENUM_END);
}

static void check_queue(const seen_t *now)
{
    CHECK(now->queued <= QUEUE_KNOTS);
    CHECK_EQUAL(now->queued, queue_size());
    CHECK((now->state == ORI_STREAMING || now->state == ORI_BRAKING) == (now->queued > 0));
}

/* Latches move by commands, and magnets let go by themselves in a frame; the longest time they are on is kept. */
static void check_latches(const seen_t *now, const step_t *step)
{
    for (unsigned i = 0; i < ORI_MAGNET_OUTPUTS; i++) {
        if (now->magnet[i] != before.magnet[i] && !step->latch)
            CHECK(before.magnet[i] && step->frame);
        if (now->magnet[i] && !before.magnet[i])
            magnet_on_us[i] = 0;
        else if (now->magnet[i] && step->frame)
            magnet_on_us[i] += ORI_FRAME_US; /* late frames count as one, for the device as well */
    }
    for (unsigned i = 0; i < config.device.latches; i++) {
        const mavlink_ori_config_latch_t *record = &config.latch[i];
        if (record->kind == ORI_ELECTROMAGNET && record->duty_permille < 1000 && now->magnet[record->output])
            CHECK(magnet_on_us[record->output] <= record->max_on_ms * UINT64_C(1000) + ORI_FRAME_US);
        if (record->kind == ORI_LOCK_PIN && !step->latch && !step->config)
            CHECK_EQUAL(now->servo[record->output], before.servo[record->output]);
    }
}

/* At rest no later than silence_ms and a frame after the host's last word, and as much later as frames came late. The
 * state says so another frame later. */
static void check_silence(const seen_t *now, const step_t *step)
{
    if (step->valid) {
        last_word_us = fake.micros;
        late_us = 0;
    }
    if (step->frame && fake.micros - before.frame_us > ORI_FRAME_US)
        late_us += fake.micros - before.frame_us - ORI_FRAME_US;
    const uint64_t longest = config.device.silence_ms * UINT64_C(1000) + 2 * ORI_FRAME_US + late_us;
    if (step->frame && fake.micros - last_word_us > longest)
        CHECK(now->state != ORI_STREAMING && now->state != ORI_BRAKING);
}

void watch_step(const step_t *step)
{
    seen_t now;
    look(&now);
    now.frame_us = step->frame ? fake.micros : before.frame_us;
    check_outputs(&now);
    check_motion(&now, step);
    check_faults(&now, step);
    check_queue(&now);
    check_latches(&now, step);
    check_silence(&now, step);
    watch_steps++;
    watch_states[now.state]++;
    watch_knots += (uint16_t)(now.contiguous - before.contiguous) < 3 ? (uint16_t)(now.contiguous - before.contiguous) : 0U;
    if (now.fault != before.fault)
        watch_faults[now.fault]++;
    before = now;
}
