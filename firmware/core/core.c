#include "core.h"

#include "events.h"
#include "faults.h"
#include "hinges.h"
#include "latches.h"
#include "machine.h"
#include "port.h"
#include "supply.h"
#include "version.h"
#include "wire.h"

#include <string.h>

#define LINK MAVLINK_COMM_0
#define HEARTBEAT_US UINT32_C(1000000)

static uint32_t boot;
static uint64_t heartbeat_due_us;
/* Reports that were asked for and wait for room. */
static uint8_t owed;
static uint16_t owed_token;
/* The answer to the last command, for when it has to be given again. */
static mavlink_ori_ack_t last_ack;
static bool acked;

void core_init(void)
{
    owed = 0;
    acked = false;
    heartbeat_due_us = 0;
    boot = config_count_boot();
    machine_init();
}

/* Answers ------------------------------------------------------------------------------------------------------ */

static void send_ack(void)
{
    if (wire_has_room(MAVLINK_MSG_ID_ORI_ACK_LEN)) /* without room the host asks again */
        mavlink_msg_ori_ack_send_struct(LINK, &last_ack);
}

static void answer(uint16_t token, uint8_t result, uint8_t index, int32_t value)
{
    if (result == ORI_REFUSED_STATE)
        value = machine_state();
    last_ack = (mavlink_ori_ack_t){.value = value, .token = token, .result = result, .index = index};
    acked = true;
    send_ack();
}

/* Whether this command was carried out already; then its answer is given again. */
static bool is_repeated(uint16_t token)
{
    if (!acked || last_ack.token != token)
        return false;
    send_ack();
    return true;
}

static void send_state(void)
{
    mavlink_ori_state_t report = {0};
    hinges_report(&report);
    report.time_us = port_micros();
    report.token = owed_token;
    report.contiguous = machine_contiguous();
    report.supply_mv = supply_mv();
    report.temperature_count = port_adc(ORI_ADC_THERMISTOR);
    report.queued = machine_queued();
    report.stream = machine_stream();
    report.state = machine_state();
    report.fault = fault_latched();
    report.fault_index = fault_index();
    mavlink_msg_ori_state_send_struct(LINK, &report);
}

static void send_latches(void)
{
    mavlink_ori_latch_state_t report = {.time_us = port_micros(), .token = owed_token};
    latches_report(&report);
    mavlink_msg_ori_latch_state_send_struct(LINK, &report);
}

static void send_info(void)
{
    mavlink_ori_info_t info = {
        .time_us = port_micros(),
        .boot = boot,
        .firmware = ORI_FIRMWARE_VERSION,
        .config_hash = config_hash(),
        .token = owed_token,
        .reset_cause = (uint8_t)port_reset_cause(),
        .hinges = config_hash() ? config.device.hinges : 0,
        .latches = config_hash() ? config.device.latches : 0,
    };
    const char *name = port_name();
    for (uint8_t i = 0; i < sizeof info.port && name[i]; i++)
        info.port[i] = name[i];
    mavlink_msg_ori_info_send_struct(LINK, &info);
}

static void send_owed(void)
{
    if (owed & ORI_POLL_STATE && wire_has_room(MAVLINK_MSG_ID_ORI_STATE_LEN)) {
        owed &= (uint8_t)~ORI_POLL_STATE;
        send_state();
    }
    if (owed & ORI_POLL_LATCHES && wire_has_room(MAVLINK_MSG_ID_ORI_LATCH_STATE_LEN)) {
        owed &= (uint8_t)~ORI_POLL_LATCHES;
        send_latches();
    }
    if (owed & ORI_POLL_INFO && wire_has_room(MAVLINK_MSG_ID_ORI_INFO_LEN)) {
        owed &= (uint8_t)~ORI_POLL_INFO;
        send_info();
    }
}

/* Commands ----------------------------------------------------------------------------------------------------- */

static void on_poll(const mavlink_message_t *message)
{
    owed_token = mavlink_msg_ori_poll_get_token(message);
    owed = mavlink_msg_ori_poll_get_what(message);
}

static void on_timesync(const mavlink_message_t *message)
{
    mavlink_timesync_t ask;
    mavlink_msg_timesync_decode(message, &ask);
    if (ask.tc1 != 0 || !wire_has_room(MAVLINK_MSG_ID_TIMESYNC_LEN))
        return;
    mavlink_msg_timesync_send(LINK, (int64_t)(port_micros() * 1000U), ask.ts1);
}

static void on_enable(const mavlink_message_t *message)
{
    mavlink_ori_enable_t enable;
    uint8_t index = ORI_NOBODY;
    int32_t value = 0;
    mavlink_msg_ori_enable_decode(message, &enable);
    if (is_repeated(enable.token))
        return;
    const uint8_t result = machine_enable(&enable, &index, &value);
    answer(enable.token, result, index, value);
}

static void on_disable(const mavlink_message_t *message)
{
    const uint16_t token = mavlink_msg_ori_disable_get_token(message);
    if (is_repeated(token))
        return;
    answer(token, machine_disable(mavlink_msg_ori_disable_get_hinges(message)), ORI_NOBODY, 0);
}

static void on_brake(const mavlink_message_t *message)
{
    const uint16_t token = mavlink_msg_ori_brake_get_token(message);
    if (is_repeated(token))
        return;
    machine_brake();
    answer(token, ORI_ACCEPTED, ORI_NOBODY, machine_state());
}

static void on_latch(const mavlink_message_t *message)
{
    const uint16_t token = mavlink_msg_ori_latch_command_get_token(message);
    const uint8_t index = mavlink_msg_ori_latch_command_get_index(message);
    int32_t value = 0;
    if (is_repeated(token))
        return;
    const uint8_t result = machine_latch(index, mavlink_msg_ori_latch_command_get_engage(message) != 0, &value);
    answer(token, result, index, value);
}

static void on_clear(const mavlink_message_t *message)
{
    const uint16_t token = mavlink_msg_ori_fault_clear_get_token(message);
    int32_t value = 0;
    if (is_repeated(token))
        return;
    const uint8_t result = machine_clear(mavlink_msg_ori_fault_clear_get_fault(message), &value);
    answer(token, result, fault_index(), value);
}

static void on_config_device(const mavlink_message_t *message)
{
    mavlink_ori_config_device_t record;
    uint8_t index = ORI_NOBODY;
    int32_t value = 0;
    mavlink_msg_ori_config_device_decode(message, &record);
    if (is_repeated(record.token))
        return;
    const uint8_t result = machine_config_begin(&record, &index, &value);
    answer(record.token, result, index, value);
}

static void on_config_hinge(const mavlink_message_t *message)
{
    mavlink_ori_config_hinge_t record;
    mavlink_msg_ori_config_hinge_decode(message, &record);
    if (!is_repeated(record.token))
        answer(record.token, config_add_hinge(&record), record.index, 0);
}

static void on_config_latch(const mavlink_message_t *message)
{
    mavlink_ori_config_latch_t record;
    mavlink_msg_ori_config_latch_decode(message, &record);
    if (!is_repeated(record.token))
        answer(record.token, config_add_latch(&record), record.index, 0);
}

static void on_config_commit(const mavlink_message_t *message)
{
    const uint16_t token = mavlink_msg_ori_config_commit_get_token(message);
    uint8_t index = ORI_NOBODY;
    int32_t value = 0;
    if (is_repeated(token))
        return;
    const uint8_t result = machine_config_commit(mavlink_msg_ori_config_commit_get_hash(message), &index, &value);
    answer(token, result, index, value);
}

/* Records of the configuration in force, answered by themselves: asking twice does no harm. */
static void on_config_read(const mavlink_message_t *message)
{
    const uint16_t token = mavlink_msg_ori_config_read_get_token(message);
    const uint8_t record = mavlink_msg_ori_config_read_get_record(message);
    const uint8_t index = mavlink_msg_ori_config_read_get_index(message);
    if (!wire_has_room(MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN)) /* the longest */
        return;
    if (config_hash() && record == ORI_RECORD_DEVICE) {
        mavlink_ori_config_device_t device = config.device;
        device.token = token;
        mavlink_msg_ori_config_device_send_struct(LINK, &device);
    } else if (config_hash() && record == ORI_RECORD_HINGE && index < config.device.hinges) {
        mavlink_ori_config_hinge_t hinge = config.hinge[index];
        hinge.token = token;
        mavlink_msg_ori_config_hinge_send_struct(LINK, &hinge);
    } else if (config_hash() && record == ORI_RECORD_LATCH && index < config.device.latches) {
        mavlink_ori_config_latch_t latch = config.latch[index];
        latch.token = token;
        mavlink_msg_ori_config_latch_send_struct(LINK, &latch);
    } else {
        answer(token, config_hash() ? ORI_REFUSED_INDEX : ORI_REFUSED_STATE, index, 0);
    }
}

static void on_setpoints(const mavlink_message_t *message)
{
    mavlink_ori_setpoints_t setpoints;
    mavlink_msg_ori_setpoints_decode(message, &setpoints);
    machine_setpoints(&setpoints);
}

/* Whether the message was one of ours: what a host cannot mean for us is no sign of its life. */
static bool dispatch(const mavlink_message_t *message)
{
    switch (message->msgid) {
    case MAVLINK_MSG_ID_ORI_SETPOINTS: on_setpoints(message); return true;
    case MAVLINK_MSG_ID_ORI_POLL: on_poll(message); return true;
    case MAVLINK_MSG_ID_TIMESYNC: on_timesync(message); return true;
    case MAVLINK_MSG_ID_ORI_ENABLE: on_enable(message); return true;
    case MAVLINK_MSG_ID_ORI_DISABLE: on_disable(message); return true;
    case MAVLINK_MSG_ID_ORI_BRAKE: on_brake(message); return true;
    case MAVLINK_MSG_ID_ORI_LATCH_COMMAND: on_latch(message); return true;
    case MAVLINK_MSG_ID_ORI_FAULT_CLEAR: on_clear(message); return true;
    case MAVLINK_MSG_ID_ORI_CONFIG_DEVICE: on_config_device(message); return true;
    case MAVLINK_MSG_ID_ORI_CONFIG_HINGE: on_config_hinge(message); return true;
    case MAVLINK_MSG_ID_ORI_CONFIG_LATCH: on_config_latch(message); return true;
    case MAVLINK_MSG_ID_ORI_CONFIG_COMMIT: on_config_commit(message); return true;
    case MAVLINK_MSG_ID_ORI_CONFIG_READ: on_config_read(message); return true;
    default: return false;
    }
}

/* Unasked -------------------------------------------------------------------------------------------------------- */

/* A fault is told in words as well, for whoever looks at the line with a tool of his own. */
static void send_fault_text(const mavlink_ori_event_t *event)
{
    mavlink_statustext_t text = {.severity = MAV_SEVERITY_CRITICAL, .text = "ori fault 00"};
    text.text[10] = (char)('0' + event->index / 10);
    text.text[11] = (char)('0' + event->index % 10);
    mavlink_msg_statustext_send_struct(LINK, &text);
}

static void send_events(void)
{
    mavlink_ori_event_t event;
    if (!wire_has_room(MAVLINK_MSG_ID_ORI_EVENT_LEN + MAVLINK_NUM_NON_PAYLOAD_BYTES + MAVLINK_MSG_ID_STATUSTEXT_LEN) ||
        !events_take(&event))
        return;
    mavlink_msg_ori_event_send_struct(LINK, &event);
    if (event.code == ORI_EVENT_FAULT)
        send_fault_text(&event);
}

static void send_heartbeat(void)
{
    const uint64_t now = port_micros();
    if (now < heartbeat_due_us || !wire_has_room(MAVLINK_MSG_ID_HEARTBEAT_LEN))
        return;
    heartbeat_due_us = now + HEARTBEAT_US;
    const uint8_t status = fault_latched() ? MAV_STATE_CRITICAL : hinges_on() ? MAV_STATE_ACTIVE : MAV_STATE_STANDBY;
    mavlink_msg_heartbeat_send(LINK, MAV_TYPE_GENERIC, MAV_AUTOPILOT_INVALID, 0, machine_state(), status);
}

void core_poll(void)
{
    const mavlink_message_t *message = wire_receive();
    if (message && dispatch(message))
        machine_heard(port_micros());
    send_owed();
    if (!owed) {
        send_events();
        send_heartbeat();
    }
}

void core_frame(uint64_t frame_start_us)
{
    port_watchdog_kick();
    machine_frame(port_micros(), frame_start_us + ORI_FRAME_US);
}
