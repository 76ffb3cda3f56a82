#include "wire.h"

#include "port.h"

/* At most so many bytes at a time, so that a flood of noise does not keep the frame waiting. */
#define BYTES_AT_A_TIME 64U
/* After so long without a byte what was begun will not be ended: a frame whose length was damaged is not to take the
 * next one for its rest. USB carries bytes every millisecond; two of them that go by without are no pause yet. */
#define PAUSE_US 2500U

mavlink_system_t mavlink_system = {1, 1};

static mavlink_message_t incoming;
static mavlink_status_t parser;
static uint32_t quiet_since_us;
static bool heard; /* a byte, since it was last quiet */

/* Lengths and checksum seeds of what a host may say, told by code, which costs no RAM. What is not here is no frame. */
#define FROM_THE_HOST(X) \
    X(TIMESYNC) \
    X(ORI_SETPOINTS) \
    X(ORI_POLL) \
    X(ORI_ENABLE) \
    X(ORI_DISABLE) \
    X(ORI_BRAKE) \
    X(ORI_LATCH_COMMAND) \
    X(ORI_FAULT_CLEAR) \
    X(ORI_CONFIG_DEVICE) \
    X(ORI_CONFIG_HINGE) \
    X(ORI_CONFIG_LATCH) \
    X(ORI_CONFIG_COMMIT) \
    X(ORI_CONFIG_READ)

#define ENTRY(name) \
    case MAVLINK_MSG_ID_##name: \
        entry.crc_extra = MAVLINK_MSG_ID_##name##_CRC; \
        entry.min_msg_len = MAVLINK_MSG_ID_##name##_MIN_LEN; \
        entry.max_msg_len = MAVLINK_MSG_ID_##name##_LEN; \
        break;

const mavlink_msg_entry_t *mavlink_get_msg_entry(uint32_t id)
{
    static mavlink_msg_entry_t entry;
    switch (id) {
        FROM_THE_HOST(ENTRY)
    default:
        return NULL;
    }
    entry.msgid = id;
    return &entry;
}

void wire_send_bytes(mavlink_channel_t channel, const uint8_t *data, uint16_t size)
{
    (void)channel;
    port_send(data, size);
}

bool wire_has_room(uint16_t payload)
{
    return port_send_room() >= payload + MAVLINK_NUM_NON_PAYLOAD_BYTES;
}

static bool is_from_the_host(const mavlink_message_t *message)
{
    return message->magic == MAVLINK_STX && message->incompat_flags == 0 && message->sysid == ORI_HOST_SYSTEM &&
           message->compid == ORI_HOST_COMPONENT;
}

/* No byte is there. The time counts from when that was first seen: bytes that came while the core was busy are taken
 * before it is. */
static void keep_quiet(void)
{
    const uint32_t now = (uint32_t)port_micros();
    if (heard)
        quiet_since_us = now;
    else if (now - quiet_since_us > PAUSE_US)
        parser.parse_state = MAVLINK_PARSE_STATE_IDLE;
    heard = false;
}

const mavlink_message_t *wire_receive(void)
{
    for (uint8_t n = 0; n < BYTES_AT_A_TIME; n++) {
        const int16_t byte = port_receive();
        if (byte < 0) {
            keep_quiet();
            return NULL;
        }
        heard = true;
        const uint8_t framing = mavlink_frame_char_buffer(&incoming, &parser, (uint8_t)byte, NULL, NULL);
        if (framing == MAVLINK_FRAMING_OK && is_from_the_host(&incoming))
            return &incoming;
    }
    return NULL;
}
