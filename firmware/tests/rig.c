#include "rig.h"

#include <math.h>
#include <string.h>

#include "check.h"
#include "core.h"

mavlink_ori_config_device_t rig_device(uint8_t hinges, uint8_t latches)
{
    return (mavlink_ori_config_device_t){
        .supply_uv_per_count = 10000,
        .stall_urad = 100000,
        .seat_urad = 20000,
        .stall_ms = 100,
        .silence_ms = SILENCE_MS,
        .brake_ms = BRAKE_MS,
        .supply_min_mv = 5000,
        .schema = 1,
        .hinges = hinges,
        .latches = latches,
    };
}

mavlink_ori_config_hinge_t rig_hinge(uint8_t index)
{
    return (mavlink_ori_config_hinge_t){
        .min_urad = -1000000,
        .max_urad = 1500000,
        .pulse_zero_ns = 1500000,
        .pulse_slope_ns = index % 2 ? -600000 : 600000,
        .feedback_zero_urad = -2000000,
        .feedback_slope_nrad = 4000000,
        .max_acceleration_mrad_s2 = 20000,
        .max_velocity_mrad_s = 2000,
        .pulse_min_us = 500,
        .pulse_max_us = 2500,
        .feedback_low = 20,
        .feedback_high = 1000,
        .index = index,
        .channel = (uint8_t)((index * 5U + 2U) % 12U),
        .adc = (uint8_t)((index * 7U + 3U) % 12U),
        .flags = ORI_HINGE_HAS_FEEDBACK,
    };
}

mavlink_ori_config_latch_t rig_latch(uint8_t index)
{
    mavlink_ori_config_latch_t latch = {.debounce_ms = 40, .index = index, .sensor = index, .flags = ORI_LATCH_SENSOR_HIGH};
    if (index % 3 == 0) {
        latch.kind = ORI_ELECTROMAGNET;
        latch.output = (uint8_t)(index + 1U);
        latch.max_on_ms = 1000;
        latch.duty_permille = 250;
    } else if (index % 3 == 1) {
        latch.kind = ORI_LOCK_PIN;
        latch.output = index < 3 ? 1 : (uint8_t)(index / 3U + 2U); /* servo outputs that three hinges leave free */
        latch.travel_ms = 200;
        latch.engaged_us = 1900;
        latch.released_us = 1100;
    } else {
        latch.kind = ORI_MAGNET;
    }
    return latch;
}

uint32_t rig_hash(const mavlink_ori_config_device_t *device, const mavlink_ori_config_hinge_t *hinges,
                  const mavlink_ori_config_latch_t *latches)
{
    mavlink_ori_config_device_t bare = *device;
    bare.token = 0;
    uint32_t crc = crc32_of(0, &bare, MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN);
    for (unsigned i = 0; i < device->hinges; i++) {
        mavlink_ori_config_hinge_t hinge = hinges[i];
        hinge.token = 0;
        crc = crc32_of(crc, &hinge, MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN);
    }
    for (unsigned i = 0; i < device->latches; i++) {
        mavlink_ori_config_latch_t latch = latches[i];
        latch.token = 0;
        crc = crc32_of(crc, &latch, MAVLINK_MSG_ID_ORI_CONFIG_LATCH_LEN);
    }
    return crc;
}

void rig_store(const mavlink_ori_config_device_t *device, const mavlink_ori_config_hinge_t *hinges,
               const mavlink_ori_config_latch_t *latches)
{
    uint32_t found = 0;
    CHECK_EQUAL(config_begin(device), ORI_ACCEPTED);
    for (unsigned i = 0; i < device->hinges; i++)
        CHECK_EQUAL(config_add_hinge(&hinges[i]), ORI_ACCEPTED);
    for (unsigned i = 0; i < device->latches; i++)
        CHECK_EQUAL(config_add_latch(&latches[i]), ORI_ACCEPTED);
    CHECK_EQUAL(config_commit(rig_hash(device, hinges, latches), &found), ORI_ACCEPTED);
}

void rig_start(void)
{
    const mavlink_ori_config_device_t device = rig_device(RIG_HINGES, RIG_LATCHES);
    mavlink_ori_config_hinge_t hinges[RIG_HINGES];
    mavlink_ori_config_latch_t latches[RIG_LATCHES];
    fake_reset();
    for (uint8_t i = 0; i < RIG_HINGES; i++)
        hinges[i] = rig_hinge(i);
    for (uint8_t i = 0; i < RIG_LATCHES; i++)
        latches[i] = rig_latch(i);
    (void)config_load();
    rig_store(&device, hinges, latches);
    rig_restart(PORT_RESET_POWER);
}

void rig_restart(port_reset_t cause)
{
    fake.reset_cause = cause;
    memset(fake.servo, 0, sizeof fake.servo); /* as the hardware comes up */
    memset(fake.magnet, 0, sizeof fake.magnet);
    fake.adc[ORI_ADC_SUPPLY] = 600; /* 6 V */
    for (uint8_t i = 0; i < RIG_HINGES; i++)
        rig_place(i, 0);
    core_init();
    fake.from_device_size = 0;
}

void rig_place(uint8_t hinge, double rad)
{
    fake.adc[rig_hinge(hinge).adc] = (uint16_t)lround((rad + 2.0) / 0.004);
}

uint16_t rig_ticks(uint8_t hinge, double rad)
{
    const double slope = hinge % 2 ? -0.6e-3 : 0.6e-3;
    return (uint16_t)lround((1.5e-3 + slope * rad) / 0.5e-6);
}

void host_says(kind_t kind, const void *payload)
{
    uint8_t frame[LONGEST_FRAME];
    fake_type(frame, (uint32_t)frame_make(frame, kind, payload));
    while (fake.to_device_taken < fake.to_device_size)
        core_poll();
}

void poll_all(void)
{
    while (fake.to_device_taken < fake.to_device_size)
        core_poll();
    core_poll();
}

mavlink_ori_ack_t host_commands(kind_t kind, const void *payload)
{
    mavlink_ori_ack_t ack = {0};
    fake.from_device_size = 0;
    host_says(kind, payload);
    CHECK(frame_take_kind(KIND(ORI_ACK), &ack));
    return ack;
}

uint16_t host_token(void)
{
    static uint16_t token;
    return ++token;
}

uint8_t host_enable(uint16_t hinges, const int32_t *position_urad, uint8_t stream)
{
    mavlink_ori_enable_t enable = {.token = host_token(), .hinges = hinges, .stream = stream};
    if (position_urad)
        memcpy(enable.position_urad, position_urad, sizeof enable.position_urad);
    const mavlink_ori_ack_t ack = host_commands(KIND(ORI_ENABLE), &enable);
    CHECK_EQUAL(ack.token, enable.token);
    return ack.result;
}

uint8_t host_disable(uint16_t hinges)
{
    const mavlink_ori_disable_t disable = {.token = host_token(), .hinges = hinges};
    return host_commands(KIND(ORI_DISABLE), &disable).result;
}

uint8_t host_clear(uint8_t fault)
{
    const mavlink_ori_fault_clear_t clear = {.token = host_token(), .fault = fault};
    return host_commands(KIND(ORI_FAULT_CLEAR), &clear).result;
}

uint8_t host_latch(uint8_t index, uint8_t engage)
{
    const mavlink_ori_latch_command_t command = {.token = host_token(), .index = index, .engage = engage};
    return host_commands(KIND(ORI_LATCH_COMMAND), &command).result;
}

void host_polls(void)
{
    const mavlink_ori_poll_t poll = {.token = host_token(), .what = 0};
    host_says(KIND(ORI_POLL), &poll);
}

mavlink_ori_state_t host_state(void)
{
    mavlink_ori_state_t state = {0};
    const mavlink_ori_poll_t poll = {.token = host_token(), .what = ORI_POLL_STATE};
    fake.from_device_size = 0;
    host_says(KIND(ORI_POLL), &poll);
    CHECK(frame_take_kind(KIND(ORI_STATE), &state));
    CHECK_EQUAL(state.token, poll.token);
    return state;
}

mavlink_ori_latch_state_t host_latches(void)
{
    mavlink_ori_latch_state_t state = {0};
    const mavlink_ori_poll_t poll = {.token = host_token(), .what = ORI_POLL_LATCHES};
    fake.from_device_size = 0;
    host_says(KIND(ORI_POLL), &poll);
    CHECK(frame_take_kind(KIND(ORI_LATCH_STATE), &state));
    CHECK_EQUAL(state.token, poll.token);
    return state;
}

void host_knot(uint8_t stream, uint16_t number, uint64_t time_us, int32_t position_urad, int16_t velocity_mrad_s)
{
    mavlink_ori_setpoints_t setpoints = {.first = number, .count = 1, .stream = stream};
    setpoints.time_us[0] = (uint32_t)time_us;
    for (unsigned k = 0; k < ORI_HINGES; k++) {
        setpoints.position_urad[k] = position_urad;
        setpoints.velocity_mrad_s[k] = velocity_mrad_s;
    }
    host_says(KIND(ORI_SETPOINTS), &setpoints);
}

void frame_passes(void)
{
    fake.micros += ORI_FRAME_US;
    core_frame(fake.micros);
}

void hinges_follow(void)
{
    for (uint8_t i = 0; i < RIG_HINGES; i++) {
        const uint16_t ticks = fake.servo[rig_hinge(i).channel];
        if (ticks)
            rig_place(i, (ticks * 0.5e-6 - 1.5e-3) / (i % 2 ? -0.6e-3 : 0.6e-3));
    }
}

void frames_pass(unsigned count)
{
    while (count--) {
        host_polls();
        frame_passes();
        hinges_follow();
    }
}
