#include "frames.h"

#include <string.h>

#include "check.h"
#include "fake_port.h"
#include "wire.h"

uint16_t x25(uint16_t crc, const uint8_t *data, size_t size)
{
    for (size_t i = 0; i < size; i++)
        for (unsigned bit = 0; bit < 8; bit++) {
            const unsigned in = ((unsigned)data[i] >> bit) & 1U;
            const unsigned out = crc & 1U;
            crc = (uint16_t)((crc >> 1) ^ (in ^ out ? 0x8408U : 0U));
        }
    return crc;
}

/* Division of the message, reflected, by x^32 + ... + 1; as it is defined. */
uint32_t crc32_of(uint32_t crc, const void *data, size_t size)
{
    const uint8_t *byte = data;
    crc ^= UINT32_MAX;
    for (size_t i = 0; i < size * 8; i++) {
        const uint32_t in = ((uint32_t)byte[i / 8] >> (i % 8)) & 1U;
        const bool divides = (crc & 1U) != in;
        crc >>= 1;
        if (divides)
            crc ^= UINT32_C(0xEDB88320);
    }
    return crc ^ UINT32_MAX;
}

size_t frame_make_as(uint8_t *frame, kind_t kind, const void *payload, uint8_t size, uint8_t system, uint8_t component)
{
    static uint8_t sequence;
    const uint8_t head[10] = {0xfd,   size, 0, 0, sequence++, system, component, (uint8_t)kind.id, (uint8_t)(kind.id >> 8),
                              (uint8_t)(kind.id >> 16)};
    memcpy(frame, head, sizeof head);
    if (size)
        memcpy(frame + sizeof head, payload, size);
    uint16_t crc = x25(0xffff, frame + 1, sizeof head - 1 + size);
    crc = x25(crc, &kind.extra, 1);
    frame[sizeof head + size] = (uint8_t)crc;
    frame[sizeof head + size + 1] = (uint8_t)(crc >> 8);
    return sizeof head + size + 2U;
}

size_t frame_make(uint8_t *frame, kind_t kind, const void *payload)
{
    uint8_t size = kind.size;
    while (size > 1 && ((const uint8_t *)payload)[size - 1] == 0)
        size--;
    return frame_make_as(frame, kind, payload, size, 255, 190);
}

static const kind_t from_device[] = {
    KIND(HEARTBEAT),         KIND(TIMESYNC),         KIND(STATUSTEXT),       KIND(ORI_STATE), KIND(ORI_ACK), KIND(ORI_LATCH_STATE),
    KIND(ORI_CONFIG_DEVICE), KIND(ORI_CONFIG_HINGE), KIND(ORI_CONFIG_LATCH), KIND(ORI_INFO),  KIND(ORI_EVENT),
};

static const kind_t *kind_of(uint32_t id)
{
    for (unsigned i = 0; i < sizeof from_device / sizeof from_device[0]; i++)
        if (from_device[i].id == id)
            return &from_device[i];
    return NULL;
}

bool frame_take(received_t *received)
{
    const uint8_t *frame = fake.from_device;
    const uint32_t have = fake.from_device_size;
    if (have == 0)
        return false;
    CHECK(have >= 12);
    CHECK_EQUAL(frame[0], 0xfd);
    const uint32_t size = frame[1];
    CHECK(have >= 12 + size);
    CHECK_EQUAL(frame[2] | frame[3], 0);
    CHECK_EQUAL(frame[5], 1);
    CHECK_EQUAL(frame[6], 1);
    received->id = (uint32_t)frame[7] | (uint32_t)frame[8] << 8 | (uint32_t)frame[9] << 16;
    const kind_t *kind = kind_of(received->id);
    CHECK(kind != NULL);
    CHECK(size <= kind->size);
    const uint16_t crc = x25(x25(0xffff, frame + 1, 9 + size), &kind->extra, 1);
    CHECK_EQUAL(frame[10 + size] | frame[11 + size] << 8, crc);
    memset(received->payload, 0, sizeof received->payload);
    memcpy(received->payload, frame + 10, size);
    fake.from_device_size -= 12 + size;
    memmove(fake.from_device, fake.from_device + 12 + size, fake.from_device_size);
    return true;
}

bool frame_take_kind(kind_t kind, void *payload)
{
    received_t received;
    while (frame_take(&received)) {
        if (received.id != kind.id)
            continue;
        memcpy(payload, received.payload, kind.size);
        return true;
    }
    return false;
}

unsigned frame_count(kind_t kind)
{
    received_t received;
    unsigned count = 0;
    while (frame_take(&received))
        count += received.id == kind.id;
    return count;
}
