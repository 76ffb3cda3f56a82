/* The fuzz target: its input is a program of steps for a device, its port and a host.
 *
 * The first byte says how the device starts. Then every step is a byte that says what happens and bytes that say how;
 * where the input has ended, zeros are read. After every step everything is checked that must be true.
 */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "check.h"
#include "core.h"
#include "faults.h"
#include "hinges.h"
#include "machine.h"
#include "queue.h"
#include "rig.h"
#include "watch.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static const uint8_t *input;
static size_t left;

static uint8_t take(void)
{
    if (left == 0)
        return 0;
    left--;
    return *input++;
}

static uint16_t take16(void)
{
    const uint8_t low = take();
    return (uint16_t)(low | take() << 8);
}

/* From the host ------------------------------------------------------------------------------------------------ */

static const kind_t kinds[] = {
    KIND(TIMESYNC),          KIND(ORI_SETPOINTS),    KIND(ORI_POLL),         KIND(ORI_ENABLE),        KIND(ORI_DISABLE),
    KIND(ORI_BRAKE),         KIND(ORI_LATCH_COMMAND), KIND(ORI_FAULT_CLEAR), KIND(ORI_CONFIG_DEVICE), KIND(ORI_CONFIG_HINGE),
    KIND(ORI_CONFIG_LATCH),  KIND(ORI_CONFIG_COMMIT), KIND(ORI_CONFIG_READ),
};
#define KINDS (sizeof kinds / sizeof kinds[0])

static void note(step_t *step, uint32_t id, const uint8_t *payload)
{
    step->valid = true;
    step->enable |= id == MAVLINK_MSG_ID_ORI_ENABLE;
    step->disable |= id == MAVLINK_MSG_ID_ORI_DISABLE;
    step->latch |= id == MAVLINK_MSG_ID_ORI_LATCH_COMMAND;
    step->config |= id == MAVLINK_MSG_ID_ORI_CONFIG_COMMIT;
    if (id == MAVLINK_MSG_ID_ORI_FAULT_CLEAR) {
        step->clear = true;
        step->cleared = payload[offsetof(mavlink_ori_fault_clear_t, fault)];
    }
}

static void deliver(void)
{
    while (fake.to_device_taken < fake.to_device_size)
        core_poll();
    fake.from_device_size = 0;
}

/* What a spoilt frame promised is given to it, so that the next good one is seen for sure. */
static void say(step_t *step, kind_t kind, const void *payload)
{
    static const uint8_t nothing[300];
    uint8_t frame[LONGEST_FRAME];
    fake_type(nothing, sizeof nothing);
    fake_type(frame, (uint32_t)frame_make(frame, kind, payload));
    deliver();
    note(step, kind.id, payload);
}

static void say_raw(step_t *step)
{
    uint8_t bytes[256];
    const uint16_t count = take();
    for (unsigned i = 0; i < count; i++)
        bytes[i] = take();
    fake_type(bytes, count);
    deliver();
    (void)step;
}

/* Any message with any values. */
static void say_anything(step_t *step)
{
    union {
        uint8_t bytes[256];
        uint64_t align;
    } payload = {{0}};
    const kind_t kind = kinds[take() % KINDS];
    for (unsigned i = 0; i < kind.size; i++)
        payload.bytes[i] = take();
    say(step, kind, payload.bytes);
}

/* Messages that make sense, mostly: what they would say, with a few bits turned where the input says so. */
static void turn_bits(void *payload, size_t size)
{
    uint8_t *bytes = payload;
    for (unsigned n = take() % 8; n > 5 && size; n--)
        bytes[take() % size] ^= (uint8_t)(1U << (take() % 8));
}

static void say_enable(step_t *step)
{
    mavlink_ori_enable_t enable = {.token = host_token(), .hinges = take() % 8, .stream = take() % 4};
    mavlink_ori_state_t state;
    hinges_report(&state);
    for (unsigned k = 0; k < ORI_HINGES; k++)
        enable.position_urad[k] = state.position_urad[k] + take() % 64;
    turn_bits(&enable, MAVLINK_MSG_ID_ORI_ENABLE_LEN);
    say(step, KIND(ORI_ENABLE), &enable);
}

static int16_t limited(double value, double most)
{
    most = fmin(most, INT16_MAX);
    return (int16_t)fmin(fmax(value, -most), most);
}

/* Where a motion is heading: it keeps so for several knots, or none would ever be fast. */
static double drive;

/* When the next knot is due: mostly in the host's cycle, and a motion's first one mostly not too soon. */
static uint32_t next_time(const knot_t *last, bool begins)
{
    if (begins)
        return (uint32_t)fake.micros + (take() % 8 ? 40000U + take16() : take16() % 40000U);
    const uint8_t how = take();
    return last->time_us + (how % 4 ? 20000U : how % 16 ? 1000U + take16() % 60000U : 66000U + take16());
}

/* The knot that is wanted next, from where the last one left; driven by the input, and often just within the limits. */
static void next_knot(mavlink_ori_setpoints_t *setpoints, unsigned j, knot_t *last, bool begins)
{
    const uint32_t time_us = next_time(last, begins);
    const uint32_t dt_us = begins ? 0 : time_us - last->time_us;
    const uint8_t turn = take();
    if (turn % 8 == 0)
        drive = (int8_t)take() / 100.0;
    const double stretch = turn % 16 == 1 ? 1 + take() / 512.0 : 1; /* farther than the velocities tell */
    setpoints->time_us[j] = time_us;
    for (unsigned k = 0; k < ORI_HINGES; k++) {
        const mavlink_ori_config_hinge_t *record = &config.hinge[k];
        const double room = fmin(record->max_acceleration_mrad_s2 * 0.95 * dt_us * 1e-6, record->max_velocity_mrad_s);
        const double wish = begins ? 0 : last->velocity_mrad_s[k] + room * fmin(fmax(drive + (take() % 16) / 256.0, -1), 1);
        const int16_t v = limited(wish, record->max_velocity_mrad_s);
        setpoints->velocity_mrad_s[j * ORI_HINGES + k] = v;
        const double p = last->position_urad[k] + (last->velocity_mrad_s[k] + v) * 0.5e-3 * dt_us * stretch;
        last->position_urad[k] = (int32_t)fmin(fmax(p, INT32_MIN), INT32_MAX);
        last->velocity_mrad_s[k] = v;
        setpoints->position_urad[j * ORI_HINGES + k] = last->position_urad[k];
    }
    last->time_us = time_us;
}

static void say_setpoints(step_t *step)
{
    mavlink_ori_setpoints_t setpoints = {.first = machine_contiguous(), .stream = machine_stream()};
    knot_t last = {0};
    bool begins = machine_queued() == 0;
    if (!begins)
        last = *queue_last();
    else
        memcpy(last.position_urad, hinges_asked(), sizeof last.position_urad);
    setpoints.count = (uint8_t)(1 + take() % 2);
    for (unsigned j = 0; j < setpoints.count; j++) {
        next_knot(&setpoints, j, &last, begins);
        begins = false;
    }
    turn_bits(&setpoints, MAVLINK_MSG_ID_ORI_SETPOINTS_LEN);
    say(step, KIND(ORI_SETPOINTS), &setpoints);
}

/* Enough for the host to fall silent afterwards without an underrun. */
static void say_many_setpoints(step_t *step)
{
    for (unsigned n = take() % 4 ? 1 : 1 + take() % 12; n; n--)
        say_setpoints(step);
}

static void say_command(step_t *step)
{
    const uint8_t what = take();
    if (what % 8 == 0) {
        const mavlink_ori_disable_t disable = {.token = host_token(), .hinges = take16()};
        say(step, KIND(ORI_DISABLE), &disable);
    } else if (what % 8 == 1) {
        const mavlink_ori_brake_t brake = {.token = host_token()};
        say(step, KIND(ORI_BRAKE), &brake);
    } else if (what % 8 < 4) {
        const mavlink_ori_latch_command_t latch = {.token = host_token(), .index = take() % 5, .engage = take() % 2};
        say(step, KIND(ORI_LATCH_COMMAND), &latch);
    } else {
        const mavlink_ori_fault_clear_t clear = {.token = host_token(), .fault = what < 250 ? fault_latched() : take() % 18};
        say(step, KIND(ORI_FAULT_CLEAR), &clear);
    }
}

static void say_poll(step_t *step)
{
    const mavlink_ori_poll_t poll = {.token = host_token(), .what = take()};
    say(step, KIND(ORI_POLL), &poll);
}

/* A whole configuration with any values turned; what is stored has to be harmless however odd it is. */
static void say_configuration(step_t *step)
{
    mavlink_ori_config_device_t device = rig_device(take() % 4, take() % 4);
    mavlink_ori_config_hinge_t hinges[ORI_HINGES];
    mavlink_ori_config_latch_t latches[ORI_LATCHES];
    device.token = host_token();
    turn_bits(&device, MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN);
    device.hinges %= 4;
    device.latches %= 4;
    say(step, KIND(ORI_CONFIG_DEVICE), &device);
    for (uint8_t i = 0; i < device.hinges; i++) {
        hinges[i] = rig_hinge(i);
        turn_bits(&hinges[i], MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN);
        hinges[i].token = host_token();
        say(step, KIND(ORI_CONFIG_HINGE), &hinges[i]);
    }
    for (uint8_t i = 0; i < device.latches; i++) {
        latches[i] = rig_latch(i);
        turn_bits(&latches[i], MAVLINK_MSG_ID_ORI_CONFIG_LATCH_LEN);
        latches[i].token = host_token();
        say(step, KIND(ORI_CONFIG_LATCH), &latches[i]);
    }
    const mavlink_ori_config_commit_t commit = {.token = host_token(), .hash = rig_hash(&device, hinges, latches)};
    say(step, KIND(ORI_CONFIG_COMMIT), &commit);
}

/* From elsewhere ----------------------------------------------------------------------------------------------- */

static void follow(void)
{
    for (unsigned k = 0; k < config.device.hinges; k++) {
        const mavlink_ori_config_hinge_t *record = &config.hinge[k];
        const double counts = ((double)hinges_asked()[k] - record->feedback_zero_urad) * 1e3 / record->feedback_slope_nrad;
        if (hinges_on() >> k & 1U && counts > 0 && counts < 1023)
            fake.adc[record->adc] = (uint16_t)lround(counts);
    }
}

static void pass_frame(step_t *step)
{
    const uint8_t how = take();
    fake.micros += ORI_FRAME_US * (how < 250 ? 1U : how - 248U); /* some are lost */
    core_frame(fake.micros);
    step->frame = true;
    if (how < 240)
        follow();
}

/* The host says nothing for a while. */
static void fall_silent(void)
{
    for (unsigned n = take() % 16; n; n--) {
        const step_t frame = {.frame = true};
        fake.micros += ORI_FRAME_US;
        core_frame(fake.micros);
        follow();
        watch_step(&frame);
    }
}

static void change_inputs(void)
{
    const uint8_t what = take();
    if (what < 100)
        fake.sensors = take();
    else if (what < 110)
        fake.estop = !fake.estop;
    else if (what < 130)
        fake.adc[take() % 14] = take16() % 1024;
    else if (what < 150)
        fake.micros += take16() % ORI_FRAME_US;
    else if (what < 170)
        fake.send_room = what < 160 ? UINT16_MAX : take16();
    else
        fake.adc[ORI_ADC_SUPPLY] = 600;
}

static void do_step(void)
{
    step_t step = {0};
    const uint8_t what = take() % 32;
    if (what < 3)
        say_raw(&step);
    else if (what < 5)
        say_anything(&step);
    else if (what < 8)
        say_enable(&step);
    else if (what < 16)
        say_many_setpoints(&step);
    else if (what < 19)
        say_command(&step);
    else if (what < 20)
        say_poll(&step);
    else if (what < 21)
        change_inputs();
    else if (what < 22 && take() % 8 == 0)
        say_configuration(&step);
    else if (what < 23)
        fall_silent();
    else
        pass_frame(&step);
    watch_step(&step);
}

static void start(uint8_t how)
{
    rig_start();
    if (how % 16 == 15)
        memset(fake.eeprom, 0xff, sizeof fake.eeprom);
    if (how % 16 == 14)
        fake.eeprom[30] ^= 1;
    rig_restart((port_reset_t)(how % 64 < 60 ? PORT_RESET_POWER : how % 4));
    if (how >= 128) /* a rig that reaches its speed at once */
        for (unsigned k = 0; k < config.device.hinges; k++)
            config.hinge[k].max_acceleration_mrad_s2 = 2000000;
    watch_begin();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    input = data;
    left = size;
    drive = 0;
    start(take());
    while (left)
        do_step();
    return 0;
}
