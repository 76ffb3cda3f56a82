/* The two slots: nothing good is ever lost, and nothing damaged is ever in force. */
#include <stddef.h>
#include <string.h>

#include "check.h"
#include "records.h"

#define SLOT 1536U
#define HEADER 16U

/* So that a newer firmware knows what it finds. */
static void test_the_layout_in_the_eeprom(void)
{
    set_up(1, 1);
    store();
    const uint32_t header[4] = {0x4f524931, 1, hash(), crc32_of(0, fake.eeprom, 12)};
    CHECK(memcmp(fake.eeprom, header, sizeof header) == 0);
    CHECK(memcmp(fake.eeprom + HEADER, &device, MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN) == 0);
    store();
    CHECK_EQUAL(fake.eeprom[SLOT + 4], 2);
}

/* A first configuration that was begun and never came to its end is not nothing. */
static void test_half_of_a_first_configuration_is_damage(void)
{
    set_up(1, 1);
    CHECK_EQUAL(config_begin(&device), ORI_ACCEPTED);
    CHECK_EQUAL(config_load(), CONFIG_CORRUPT);
    store();
}

/* Store configurations one after the other that differ in one value. */
static void store_number(uint16_t number)
{
    hinges[0].max_velocity_mrad_s = number;
    store();
}

static uint16_t number_in_force(void)
{
    return config.hinge[0].max_velocity_mrad_s;
}

static void test_the_newest_is_in_force(void)
{
    set_up(2, 2);
    for (uint16_t number = 1; number <= 7; number++) {
        store_number(number);
        CHECK_EQUAL(number_in_force(), number);
        CHECK_EQUAL(config_load(), CONFIG_GOOD);
        CHECK_EQUAL(number_in_force(), number);
    }
}

static void test_a_torn_write_keeps_the_old_one(void)
{
    set_up(2, 3);
    for (unsigned before = 1; before <= 2; before++) {
        uint8_t saved[FAKE_EEPROM];
        store_number((uint16_t)before);
        memcpy(saved, fake.eeprom, sizeof saved);
        const uint32_t start = fake.eeprom_written;
        store_number(99);
        const uint32_t whole = fake.eeprom_written - start;
        for (uint32_t cut = 0; cut <= whole; cut++) {
            memcpy(fake.eeprom, saved, sizeof saved);
            fake.eeprom_left = UINT32_MAX;
            CHECK_EQUAL(config_load(), CONFIG_GOOD);
            CHECK_EQUAL(number_in_force(), before);
            fake.eeprom_left = cut;
            hinges[0].max_velocity_mrad_s = 99;
            send_records();
            const uint8_t result = commit(hash());
            CHECK_EQUAL(config_load(), CONFIG_GOOD);
            CHECK_EQUAL(number_in_force(), cut == whole ? 99 : before);
            CHECK(result != ORI_ACCEPTED || cut == whole);
        }
        memcpy(fake.eeprom, saved, sizeof saved);
        fake.eeprom_left = UINT32_MAX;
        CHECK_EQUAL(config_load(), CONFIG_GOOD);
    }
}

static void test_damage_is_found_and_the_other_is_in_force(void)
{
    set_up(2, 2);
    store_number(1); /* into the first slot */
    const uint16_t used = HEADER + MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN + 2 * MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN;
    const uint16_t unused = 10 * MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN; /* places for hinges that are not there */
    const uint16_t size = (uint16_t)(used + unused + 2 * MAVLINK_MSG_ID_ORI_CONFIG_LATCH_LEN);
    for (uint16_t at = 0; at < size; at = (uint16_t)(at + 1 == used ? used + unused : at + 1))
        for (unsigned bit = 0; bit < 8; bit += 3) {
            fake.eeprom[at] ^= (uint8_t)(1U << bit);
            CHECK_EQUAL(config_load(), CONFIG_CORRUPT);
            CHECK_EQUAL(config_hash(), 0);
            fake.eeprom[at] ^= (uint8_t)(1U << bit);
        }
    CHECK_EQUAL(config_load(), CONFIG_GOOD);
    store_number(2); /* into the second */
    for (uint16_t at = 0; at < size; at = (uint16_t)(at + 1 == used ? used + unused : at + 1)) {
        fake.eeprom[SLOT + at] ^= 0x10;
        CHECK_EQUAL(config_load(), CONFIG_GOOD);
        CHECK_EQUAL(number_in_force(), 1);
        fake.eeprom[at] ^= 0x20;
        CHECK_EQUAL(config_load(), CONFIG_CORRUPT);
        fake.eeprom[SLOT + at] ^= 0x10;
        CHECK_EQUAL(config_load(), CONFIG_GOOD);
        CHECK_EQUAL(number_in_force(), 2);
        fake.eeprom[at] ^= 0x20;
    }
}

/* Make every checksum of a slot good again, for so many records. */
static void seal(uint8_t *slot, unsigned hinge_count, unsigned latch_count)
{
    const uint8_t *records = slot + HEADER + MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN;
    uint32_t crc = crc32_of(0, slot + HEADER, MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN);
    crc = crc32_of(crc, records, hinge_count * MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN);
    /* Latches lie behind all places for hinges. */
    crc = crc32_of(crc, records + ORI_HINGES * MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN,
                   latch_count * MAVLINK_MSG_ID_ORI_CONFIG_LATCH_LEN);
    memcpy(slot + 8, &crc, 4);
    crc = crc32_of(0, slot, 12);
    memcpy(slot + 12, &crc, 4);
}

/* Where records of a slot lie, and how long each is. */
typedef struct {
    uint8_t *at;
    size_t size;
} place_t;

static place_t device_in(uint8_t *slot)
{
    return (place_t){slot + HEADER, MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN};
}

static place_t hinge_in(uint8_t *slot, unsigned index)
{
    const place_t before = device_in(slot);
    return (place_t){before.at + before.size + index * MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN,
                     MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN};
}

static place_t latch_in(uint8_t *slot, unsigned index)
{
    return (place_t){hinge_in(slot, ORI_HINGES).at + index * MAVLINK_MSG_ID_ORI_CONFIG_LATCH_LEN,
                     MAVLINK_MSG_ID_ORI_CONFIG_LATCH_LEN};
}

/* Change one value of a stored record. */
#define PUT(kind, place, field, value) \
    do { \
        mavlink_ori_config_##kind##_t record_; \
        const place_t place_ = (place); \
        memcpy(&record_, place_.at, place_.size); \
        record_.field = (value); \
        memcpy(place_.at, &record_, place_.size); \
    } while (0)

/* Counts that cannot be are not followed, even where every checksum is good. */
static void test_impossible_counts_are_damage(void)
{
    for (unsigned i = 0; i < 3; i++) {
        set_up(1, 1);
        store();
        if (i == 0)
            PUT(device, device_in(fake.eeprom), hinges, 13);
        else if (i == 1)
            PUT(device, device_in(fake.eeprom), latches, 9);
        else
            PUT(device, device_in(fake.eeprom), schema, 2);
        seal(fake.eeprom, i == 0 ? 13 : 1, i == 1 ? 9 : 1);
        CHECK_EQUAL(config_load(), CONFIG_CORRUPT);
    }
}

/* One value of a stored record, with every checksum good. */
#define STORED_VALUE(kind, place, field, value, expected) \
    do { \
        set_up(2, 3); \
        store(); \
        PUT(kind, place, field, value); \
        seal(fake.eeprom, 2, 3); \
        CHECK_EQUAL(config_load(), (expected) ? CONFIG_GOOD : CONFIG_CORRUPT); \
        CHECK_EQUAL(config_hash() != 0, (expected)); \
    } while (0)

/* What is found is judged by the functions that judge what is written; every record of a slot is. */
static void test_impossible_values_are_damage(void)
{
    uint8_t *slot = fake.eeprom;
    STORED_VALUE(device, device_in(slot), brake_ms, 20, true);
    STORED_VALUE(device, device_in(slot), brake_ms, 0, false);
    STORED_VALUE(device, device_in(slot), silence_ms, 99, false);
    STORED_VALUE(device, device_in(slot), stall_ms, 10001, false);
    STORED_VALUE(hinge, hinge_in(slot, 0), max_velocity_mrad_s, 77, true);
    STORED_VALUE(hinge, hinge_in(slot, 0), max_velocity_mrad_s, 0, false);
    STORED_VALUE(hinge, hinge_in(slot, 1), channel, 12, false);
    STORED_VALUE(hinge, hinge_in(slot, 1), adc, 255, false);
    STORED_VALUE(hinge, hinge_in(slot, 1), index, 0, false);
    STORED_VALUE(hinge, hinge_in(slot, 1), channel, rig_hinge(0).channel, false);
    STORED_VALUE(latch, latch_in(slot, 0), output, 8, false);
    STORED_VALUE(latch, latch_in(slot, 1), sensor, 8, false);
    STORED_VALUE(latch, latch_in(slot, 2), kind, 3, false);
    STORED_VALUE(latch, latch_in(slot, 2), index, 3, false);
    STORED_VALUE(latch, latch_in(slot, 1), output, rig_hinge(1).channel, false);
}

static void test_the_older_one_is_in_force_where_the_newer_cannot_be(void)
{
    set_up(2, 3);
    store_number(1);
    store_number(2);
    PUT(device, device_in(fake.eeprom + SLOT), brake_ms, 0);
    seal(fake.eeprom + SLOT, 2, 3);
    CHECK_EQUAL(config_load(), CONFIG_GOOD);
    CHECK_EQUAL(number_in_force(), 1);
}

static void test_a_new_configuration_ends_the_damage(void)
{
    set_up(2, 2);
    store_number(1);
    store_number(2);
    fake.eeprom[100] ^= 1;
    fake.eeprom[SLOT + 100] ^= 1;
    CHECK_EQUAL(config_load(), CONFIG_CORRUPT);
    CHECK_EQUAL(config_hash(), 0);
    store_number(3);
    CHECK_EQUAL(config_load(), CONFIG_GOOD);
    CHECK_EQUAL(number_in_force(), 3);
    store_number(4);
    CHECK_EQUAL(config_load(), CONFIG_GOOD);
    CHECK_EQUAL(number_in_force(), 4);
}

static void test_an_erased_header_is_nothing_but_half_of_one_is_damage(void)
{
    set_up(1, 1);
    memset(fake.eeprom, 0xff, sizeof fake.eeprom);
    fake.eeprom[0] = 0;
    CHECK_EQUAL(config_load(), CONFIG_CORRUPT);
    fake.eeprom[0] = 0xff;
    fake.eeprom[4] = 0;
    CHECK_EQUAL(config_load(), CONFIG_CORRUPT);
    fake.eeprom[4] = 0xff;
    fake.eeprom[SLOT + 1] = 0;
    CHECK_EQUAL(config_load(), CONFIG_CORRUPT);
    fake.eeprom[SLOT + 1] = 0xff;
    fake.eeprom[50] = 3; /* records without a header */
    CHECK_EQUAL(config_load(), CONFIG_NONE);
}

static void test_worn_cells_are_noticed(void)
{
    set_up(2, 2);
    store_number(1);
    fake.worn_from = SLOT + 30;
    fake.worn_to = SLOT + 31;
    hinges[0].max_velocity_mrad_s = 2;
    send_records();
    CHECK_EQUAL(commit(hash()), ORI_REFUSED_HASH);
    fake.worn_from = SLOT + 5; /* in the header */
    fake.worn_to = SLOT + 13;
    send_records();
    CHECK_EQUAL(commit(hash()), ORI_REFUSED_HASH);
    CHECK_EQUAL(config_load(), CONFIG_GOOD);
    CHECK_EQUAL(number_in_force(), 1);
}

static void test_nothing_of_the_old_one_is_left_in_force(void)
{
    set_up(3, 3);
    store();
    device = rig_device(1, 0);
    store();
    check_in_force();
    CHECK_EQUAL(config.hinge[1].max_velocity_mrad_s, 0);
    CHECK_EQUAL(config.latch[0].max_on_ms, 0);
    fake.eeprom[100] ^= 1;
    fake.eeprom[SLOT + 20] ^= 1;
    CHECK_EQUAL(config_load(), CONFIG_CORRUPT);
    CHECK_EQUAL(config.device.hinges, 0);
}

static void test_starts_are_counted(void)
{
    set_up(1, 1);
    store();
    for (uint32_t boot = 1; boot <= 300; boot++)
        CHECK_EQUAL(config_count_boot(), boot);
    CHECK_EQUAL(config_load(), CONFIG_GOOD);
    check_in_force();
    memset(fake.eeprom + 2 * SLOT, 0xff, 4);
    CHECK_EQUAL(config_count_boot(), 1);
    CHECK_EQUAL(config_count_boot(), 2);
}

SUITE(config_slots, TEST(test_the_layout_in_the_eeprom), TEST(test_half_of_a_first_configuration_is_damage),
      TEST(test_the_newest_is_in_force), TEST(test_a_torn_write_keeps_the_old_one),
      TEST(test_damage_is_found_and_the_other_is_in_force), TEST(test_impossible_counts_are_damage),
      TEST(test_impossible_values_are_damage), TEST(test_the_older_one_is_in_force_where_the_newer_cannot_be),
      TEST(test_a_new_configuration_ends_the_damage), TEST(test_an_erased_header_is_nothing_but_half_of_one_is_damage),
      TEST(test_worn_cells_are_noticed), TEST(test_nothing_of_the_old_one_is_left_in_force),
      TEST(test_starts_are_counted));
