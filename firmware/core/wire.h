/* The generated codec, with what it needs told, and messages in and out over the port's bytes. */
#ifndef ORI_WIRE_H
#define ORI_WIRE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* One link, no signatures: what is accepted is decided by address, length and checksum. */
#define MAVLINK_COMM_NUM_BUFFERS 1
#define MAVLINK_NO_SIGN_PACKET
#define MAVLINK_NO_SIGNATURE_CHECK
#define MAVLINK_NO_CONVERSION_HELPERS
#define MAVLINK_GET_MSG_ENTRY
#define MAVLINK_USE_CONVENIENCE_FUNCTIONS
#define MAVLINK_SEND_UART_BYTES wire_send_bytes
#define MAVLINK_START_UART_SEND(channel, size) (void)(size)
#define MAVLINK_END_UART_SEND(channel, size) (void)(size)

#include <ori_deploy/version.h>
#include <mavlink_types.h>

extern mavlink_system_t mavlink_system;
const mavlink_msg_entry_t *mavlink_get_msg_entry(uint32_t id);
void wire_send_bytes(mavlink_channel_t channel, const uint8_t *data, uint16_t size);

#include <ori_deploy/mavlink.h>

#define ORI_HINGES 12U
#define ORI_LATCHES 8U
#define ORI_NOBODY 255U

#define ORI_HOST_SYSTEM 255U
#define ORI_HOST_COMPONENT 190U

/* Take in what has arrived, up to the end of one message of the host's; NULL when none has come to its end.
 * The message is valid until the next call. */
const mavlink_message_t *wire_receive(void);

/* Whether a payload of this size can be sent now. */
bool wire_has_room(uint16_t payload);

#endif
