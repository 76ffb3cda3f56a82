#include "config.h"

#include <string.h>

#include "port.h"

#define SLOT_BYTES 1536U
#define MAGIC UINT32_C(0x4f524931) /* "ORI1" */
#define BOOT_ADDRESS (2U * SLOT_BYTES)
#define HIGHEST_COUNT 1023U
#define LONGEST_PULSE_US 19000U
#define LONGEST_DEBOUNCE_MS 10000U
#define LARGEST_POSITION_URAD INT32_C(100000000)
#define LARGEST_PULSE_NS INT32_C(20000000)
#define LARGEST_FEEDBACK_URAD INT32_C(1000000000)
#define LARGEST_FEEDBACK_SLOPE_NRAD INT32_C(100000000)

typedef struct {
    uint32_t magic;
    uint32_t generation;
    uint32_t hash;
    uint32_t check; /* of the three above */
} header_t;

/* Records lie in the EEPROM as they come over the wire, so that their hash is the host's on any machine. */
#define DEVICE_BYTES ((uint16_t)MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN)
#define HINGE_BYTES ((uint16_t)MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN)
#define LATCH_BYTES ((uint16_t)MAVLINK_MSG_ID_ORI_CONFIG_LATCH_LEN)

_Static_assert(sizeof(header_t) + DEVICE_BYTES + ORI_HINGES * HINGE_BYTES + ORI_LATCHES * LATCH_BYTES <= SLOT_BYTES,
               "a slot holds a configuration");

config_t config;

static uint32_t hash_in_force;
static uint32_t generation;
static uint8_t slot_in_force;
/* What is being written: the records that came, or nothing. */
static mavlink_ori_config_device_t pending;
static bool writing;
static uint16_t hinges_seen;
static uint8_t latches_seen;

static uint32_t crc32(uint32_t crc, const void *data, uint16_t size)
{
    const uint8_t *byte = data;
    crc = ~crc;
    while (size--) {
        crc ^= *byte++;
        for (uint8_t bit = 0; bit < 8; bit++)
            crc = (crc >> 1) ^ (crc & 1U ? UINT32_C(0xEDB88320) : 0);
    }
    return ~crc;
}

static uint16_t slot_address(uint8_t slot)
{
    return slot ? SLOT_BYTES : 0U;
}

static uint16_t device_address(uint8_t slot)
{
    return slot_address(slot) + (uint16_t)sizeof(header_t);
}

static uint16_t hinge_address(uint8_t slot, uint8_t index)
{
    return (uint16_t)(device_address(slot) + DEVICE_BYTES + index * HINGE_BYTES);
}

static uint16_t latch_address(uint8_t slot, uint8_t index)
{
    return (uint16_t)(hinge_address(slot, ORI_HINGES) + index * LATCH_BYTES);
}

/* Read a slot's hinges and latches into `into` where it is not NULL, and return the hash of all its records. */
static uint32_t read_slot(uint8_t slot, uint8_t hinges, uint8_t latches, config_t *into)
{
    mavlink_ori_config_device_t device;
    mavlink_ori_config_hinge_t hinge;
    mavlink_ori_config_latch_t latch;

    port_eeprom_read(device_address(slot), &device, DEVICE_BYTES);
    uint32_t crc = crc32(0, &device, DEVICE_BYTES);
    for (uint8_t i = 0; i < hinges; i++) {
        port_eeprom_read(hinge_address(slot, i), &hinge, HINGE_BYTES);
        crc = crc32(crc, &hinge, HINGE_BYTES);
        if (into)
            into->hinge[i] = hinge;
    }
    for (uint8_t i = 0; i < latches; i++) {
        port_eeprom_read(latch_address(slot, i), &latch, LATCH_BYTES);
        crc = crc32(crc, &latch, LATCH_BYTES);
        if (into)
            into->latch[i] = latch;
    }
    return crc;
}

/* What a record may say; the same for one that is sent and one that is found in a slot. */

static bool device_is_possible(const mavlink_ori_config_device_t *device)
{
    return device->schema == 1 && device->hinges <= ORI_HINGES && device->latches <= ORI_LATCHES &&
           device->silence_ms >= 100 && device->silence_ms <= 3000 && device->brake_ms >= 20 &&
           device->brake_ms + 2U * ORI_FRAME_US / 1000U < device->silence_ms && device->stall_ms <= 10000;
}

static bool within(int32_t value, int32_t most)
{
    return value >= -most && value <= most;
}

/* With these the fixed point of hinges.c holds whatever may be asked for or measured. */
static bool numbers_are_possible(const mavlink_ori_config_hinge_t *hinge)
{
    return within(hinge->min_urad, LARGEST_POSITION_URAD) && within(hinge->max_urad, LARGEST_POSITION_URAD) &&
           within(hinge->pulse_zero_ns, LARGEST_PULSE_NS) && within(hinge->pulse_slope_ns, LARGEST_PULSE_NS) &&
           within(hinge->feedback_zero_urad, LARGEST_FEEDBACK_URAD) &&
           within(hinge->feedback_slope_nrad, LARGEST_FEEDBACK_SLOPE_NRAD);
}

static bool hinge_is_possible(const mavlink_ori_config_hinge_t *hinge)
{
    return numbers_are_possible(hinge) && hinge->channel < ORI_SERVO_OUTPUTS && hinge->adc < ORI_SERVO_OUTPUTS &&
           hinge->min_urad < hinge->max_urad && hinge->max_velocity_mrad_s > 0 && hinge->max_acceleration_mrad_s2 > 0 &&
           hinge->pulse_slope_ns != 0 && hinge->pulse_min_us >= 100 && hinge->pulse_min_us < hinge->pulse_max_us &&
           hinge->pulse_max_us <= LONGEST_PULSE_US && hinge->feedback_low <= hinge->feedback_high &&
           hinge->feedback_high <= HIGHEST_COUNT;
}

static bool latch_is_possible(const mavlink_ori_config_latch_t *latch)
{
    if ((latch->sensor >= ORI_SENSOR_INPUTS && latch->sensor != ORI_NOBODY) || latch->debounce_ms > LONGEST_DEBOUNCE_MS)
        return false;
    if (latch->kind == ORI_ELECTROMAGNET)
        return latch->output < ORI_MAGNET_OUTPUTS && latch->duty_permille <= 1000 && latch->max_on_ms > 0 &&
               latch->max_on_ms <= 3600000UL;
    if (latch->kind == ORI_LOCK_PIN)
        return latch->output < ORI_SERVO_OUTPUTS && latch->engaged_us >= 100 && latch->released_us >= 100 &&
               latch->engaged_us <= LONGEST_PULSE_US && latch->released_us <= LONGEST_PULSE_US;
    return latch->kind == ORI_MAGNET;
}

/* Whether every record of a slot is in its place and possible, and every output used once. */
static bool records_are_possible(uint8_t slot, uint8_t hinges, uint8_t latches)
{
    uint16_t servos = 0;
    uint8_t magnets = 0;
    for (uint8_t i = 0; i < hinges; i++) {
        mavlink_ori_config_hinge_t hinge;
        port_eeprom_read(hinge_address(slot, i), &hinge, HINGE_BYTES);
        if (hinge.index != i || !hinge_is_possible(&hinge) || servos & (1U << hinge.channel))
            return false;
        servos |= (uint16_t)(1U << hinge.channel);
    }
    for (uint8_t i = 0; i < latches; i++) {
        mavlink_ori_config_latch_t latch;
        port_eeprom_read(latch_address(slot, i), &latch, LATCH_BYTES);
        if (latch.index != i || !latch_is_possible(&latch) ||
            (latch.kind == ORI_LOCK_PIN && servos & (1U << latch.output)) ||
            (latch.kind == ORI_ELECTROMAGNET && magnets & (1U << latch.output)))
            return false;
        if (latch.kind == ORI_LOCK_PIN)
            servos |= (uint16_t)(1U << latch.output);
        if (latch.kind == ORI_ELECTROMAGNET)
            magnets |= (uint8_t)(1U << latch.output);
    }
    return true;
}

static bool read_header(uint8_t slot, header_t *header)
{
    port_eeprom_read(slot_address(slot), header, sizeof *header);
    return header->magic == MAGIC && header->check == crc32(0, header, offsetof(header_t, check));
}

/* A good checksum is not enough: another firmware may have allowed what this one cannot do. */
static bool slot_is_good(uint8_t slot, const header_t *header)
{
    mavlink_ori_config_device_t device;
    port_eeprom_read(device_address(slot), &device, DEVICE_BYTES);
    return device_is_possible(&device) && read_slot(slot, device.hinges, device.latches, NULL) == header->hash &&
           records_are_possible(slot, device.hinges, device.latches);
}

/* Whether a slot was never written: erased EEPROM reads 0xff. */
static bool slot_is_blank(const header_t *header)
{
    return header->magic == UINT32_MAX && header->generation == UINT32_MAX;
}

config_status_t config_load(void)
{
    config_status_t status = CONFIG_NONE;
    writing = false;
    hash_in_force = 0;
    generation = 0;
    for (uint8_t slot = 0; slot < 2; slot++) {
        header_t header;
        if (!read_header(slot, &header) || !slot_is_good(slot, &header)) {
            if (!slot_is_blank(&header) && status == CONFIG_NONE)
                status = CONFIG_CORRUPT;
            continue;
        }
        if (status == CONFIG_GOOD && header.generation < generation)
            continue;
        status = CONFIG_GOOD;
        slot_in_force = slot;
        generation = header.generation;
        hash_in_force = header.hash;
    }
    memset(&config, 0, sizeof config);
    if (status == CONFIG_GOOD) {
        port_eeprom_read(device_address(slot_in_force), &config.device, DEVICE_BYTES);
        (void)read_slot(slot_in_force, config.device.hinges, config.device.latches, &config);
    }
    return status;
}

uint32_t config_hash(void)
{
    return hash_in_force;
}

static uint8_t free_slot(void)
{
    return hash_in_force ? !slot_in_force : 0;
}

uint8_t config_begin(const mavlink_ori_config_device_t *device)
{
    const header_t none = {0};
    writing = false;
    if (!device_is_possible(device))
        return ORI_REFUSED_RANGE;
    pending = *device;
    pending.token = 0;
    port_eeprom_write(slot_address(free_slot()), &none, sizeof none); /* from here on it is no configuration */
    port_eeprom_write(device_address(free_slot()), &pending, DEVICE_BYTES);
    hinges_seen = 0;
    latches_seen = 0;
    writing = true;
    return ORI_ACCEPTED;
}

uint8_t config_add_hinge(const mavlink_ori_config_hinge_t *hinge)
{
    mavlink_ori_config_hinge_t record = *hinge;
    if (!writing)
        return ORI_REFUSED_STATE;
    if (hinge->index >= pending.hinges)
        return ORI_REFUSED_INDEX;
    if (!hinge_is_possible(hinge))
        return ORI_REFUSED_RANGE;
    record.token = 0;
    port_eeprom_write(hinge_address(free_slot(), record.index), &record, HINGE_BYTES);
    hinges_seen |= (uint16_t)(1U << record.index);
    return ORI_ACCEPTED;
}

uint8_t config_add_latch(const mavlink_ori_config_latch_t *latch)
{
    mavlink_ori_config_latch_t record = *latch;
    if (!writing)
        return ORI_REFUSED_STATE;
    if (latch->index >= pending.latches)
        return ORI_REFUSED_INDEX;
    if (!latch_is_possible(latch))
        return ORI_REFUSED_RANGE;
    record.token = 0;
    port_eeprom_write(latch_address(free_slot(), record.index), &record, LATCH_BYTES);
    latches_seen |= (uint8_t)(1U << record.index);
    return ORI_ACCEPTED;
}

uint8_t config_commit(uint32_t hash, uint32_t *found)
{
    header_t header = {.magic = MAGIC, .generation = generation + 1, .hash = hash};
    if (!writing)
        return ORI_REFUSED_STATE;
    if (hinges_seen != (1U << pending.hinges) - 1U || latches_seen != (uint8_t)((1U << pending.latches) - 1U))
        return ORI_REFUSED_INDEX;
    *found = read_slot(free_slot(), pending.hinges, pending.latches, NULL);
    if (*found != hash || hash == 0)
        return ORI_REFUSED_HASH;
    if (!records_are_possible(free_slot(), pending.hinges, pending.latches))
        return ORI_REFUSED_RANGE;
    header.check = crc32(0, &header, offsetof(header_t, check));
    port_eeprom_write(slot_address(free_slot()), &header, sizeof header);
    return config_load() == CONFIG_GOOD && hash_in_force == hash ? ORI_ACCEPTED : ORI_REFUSED_HASH;
}

uint32_t config_count_boot(void)
{
    uint32_t boots;
    port_eeprom_read(BOOT_ADDRESS, &boots, sizeof boots);
    boots = boots == UINT32_MAX ? 1 : boots + 1;
    port_eeprom_write(BOOT_ADDRESS, &boots, sizeof boots);
    return boots;
}
