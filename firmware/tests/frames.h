/* Frames of MAVLink 2 made and found by code that shares nothing with the generated codec but numbers and structures. */
#ifndef ORI_FRAMES_H
#define ORI_FRAMES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define LONGEST_FRAME 267U

/* Checksums by their definition, bit by bit. */
uint16_t x25(uint16_t crc, const uint8_t *data, size_t size);
uint32_t crc32_of(uint32_t crc, const void *data, size_t size);

typedef struct {
    uint32_t id;
    uint8_t extra; /* checksum seed */
    uint8_t size;  /* of the whole payload */
} kind_t;

#define KIND(name) \
    ((kind_t){MAVLINK_MSG_ID_##name, MAVLINK_MSG_ID_##name##_CRC, MAVLINK_MSG_ID_##name##_LEN})

/* Write a frame of the host's; returns its size. Zeros at the payload's end are left out. */
size_t frame_make(uint8_t *frame, kind_t kind, const void *payload);
/* The same of anyone, whole payload of `size` bytes. */
size_t frame_make_as(uint8_t *frame, kind_t kind, const void *payload, uint8_t size, uint8_t system, uint8_t component);

typedef struct {
    uint32_t id;
    uint8_t payload[255]; /* zeros that were left out filled in */
} received_t;

/* Take the next frame of the device's out of what it sent; checks every byte of its frame. */
bool frame_take(received_t *received);
/* The next one of this kind, others are dropped; false when there is none. Copies as much as the kind has. */
bool frame_take_kind(kind_t kind, void *payload);
/* How many of this kind there are; takes everything. */
unsigned frame_count(kind_t kind);

#endif
