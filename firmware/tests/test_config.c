/* Configurations: what is stored is what was sent, nothing good is ever lost, and nothing damaged is ever in force. */
#include <string.h>

#include "check.h"
#include "rig.h"

#define SLOT 1536U
#define HEADER 16U

static mavlink_ori_config_device_t device;
static mavlink_ori_config_hinge_t hinges[ORI_HINGES];
static mavlink_ori_config_latch_t latches[ORI_LATCHES];

static void set_up(uint8_t hinge_count, uint8_t latch_count)
{
    fake_reset();
    CHECK_EQUAL(config_load(), CONFIG_NONE);
    device = rig_device(hinge_count, latch_count);
    for (uint8_t i = 0; i < ORI_HINGES; i++)
        hinges[i] = rig_hinge(i);
    for (uint8_t i = 0; i < ORI_LATCHES; i++) {
        latches[i] = rig_latch(i);
        if (hinge_count > 3 && latches[i].kind == ORI_LOCK_PIN)
            latches[i].kind = ORI_MAGNET; /* no servo outputs left */
    }
}

static void store(void)
{
    rig_store(&device, hinges, latches);
}

static uint32_t hash(void)
{
    return rig_hash(&device, hinges, latches);
}

/* Everything but the last step. */
static void send_records(void)
{
    CHECK_EQUAL(config_begin(&device), ORI_ACCEPTED);
    for (unsigned i = 0; i < device.hinges; i++)
        CHECK_EQUAL(config_add_hinge(&hinges[i]), ORI_ACCEPTED);
    for (unsigned i = 0; i < device.latches; i++)
        CHECK_EQUAL(config_add_latch(&latches[i]), ORI_ACCEPTED);
}

static uint8_t commit(uint32_t wanted)
{
    uint32_t found = 0;
    return config_commit(wanted, &found);
}

static void check_in_force(void)
{
    CHECK_EQUAL(config_hash(), hash());
    CHECK(memcmp(&config.device, &device, MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN) == 0);
    for (unsigned i = 0; i < device.hinges; i++)
        CHECK(memcmp(&config.hinge[i], &hinges[i], MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN) == 0);
    for (unsigned i = 0; i < device.latches; i++)
        CHECK(memcmp(&config.latch[i], &latches[i], MAVLINK_MSG_ID_ORI_CONFIG_LATCH_LEN) == 0);
}

static void test_nothing_is_stored_at_first(void)
{
    fake_reset();
    CHECK_EQUAL(config_load(), CONFIG_NONE);
    CHECK_EQUAL(config_hash(), 0);
}

static void test_what_was_sent_is_in_force(void)
{
    static const uint8_t counts[][2] = {{0, 0}, {1, 0}, {0, 1}, {3, 8}, {12, 8}, {12, 0}, {0, 8}};
    for (unsigned i = 0; i < sizeof counts / sizeof counts[0]; i++) {
        set_up(counts[i][0], counts[i][1]);
        store();
        check_in_force();
        CHECK_EQUAL(config_load(), CONFIG_GOOD);
        check_in_force();
    }
}

static void test_tokens_are_not_part_of_it(void)
{
    set_up(2, 2);
    device.token = 7;
    hinges[1].token = 8;
    latches[0].token = 9;
    store();
    CHECK_EQUAL(config.device.token | config.hinge[1].token | config.latch[0].token, 0);
    CHECK_EQUAL(config_hash(), hash());
}

static void test_records_come_in_any_order_and_again(void)
{
    set_up(3, 2);
    CHECK_EQUAL(config_begin(&device), ORI_ACCEPTED);
    hinges[0].max_velocity_mrad_s = 1;
    for (int i = 2; i >= 0; i--)
        CHECK_EQUAL(config_add_hinge(&hinges[i]), ORI_ACCEPTED);
    CHECK_EQUAL(config_add_latch(&latches[1]), ORI_ACCEPTED);
    CHECK_EQUAL(config_add_latch(&latches[0]), ORI_ACCEPTED);
    hinges[0].max_velocity_mrad_s = 1234;
    CHECK_EQUAL(config_add_hinge(&hinges[0]), ORI_ACCEPTED);
    CHECK_EQUAL(commit(hash()), ORI_ACCEPTED);
    check_in_force();
}

static void test_records_without_a_beginning_are_refused(void)
{
    set_up(1, 1);
    CHECK_EQUAL(config_add_hinge(&hinges[0]), ORI_REFUSED_STATE);
    CHECK_EQUAL(config_add_latch(&latches[0]), ORI_REFUSED_STATE);
    CHECK_EQUAL(commit(hash()), ORI_REFUSED_STATE);
    store();
    CHECK_EQUAL(config_add_hinge(&hinges[0]), ORI_REFUSED_STATE);
    CHECK_EQUAL(config_add_latch(&latches[0]), ORI_REFUSED_STATE);
    CHECK_EQUAL(commit(hash()), ORI_REFUSED_STATE);
    /* A beginning that was refused is none, nor is one before a restart. */
    CHECK_EQUAL(config_begin(&device), ORI_ACCEPTED);
    device.schema = 2;
    CHECK_EQUAL(config_begin(&device), ORI_REFUSED_RANGE);
    CHECK_EQUAL(config_add_hinge(&hinges[0]), ORI_REFUSED_STATE);
    device.schema = 1;
    CHECK_EQUAL(config_begin(&device), ORI_ACCEPTED);
    CHECK_EQUAL(config_load(), CONFIG_GOOD);
    CHECK_EQUAL(config_add_hinge(&hinges[0]), ORI_REFUSED_STATE);
}

static void test_records_beyond_the_counts_are_refused(void)
{
    set_up(2, 2);
    CHECK_EQUAL(config_begin(&device), ORI_ACCEPTED);
    hinges[0].index = 2;
    latches[0].index = 2;
    CHECK_EQUAL(config_add_hinge(&hinges[0]), ORI_REFUSED_INDEX);
    CHECK_EQUAL(config_add_latch(&latches[0]), ORI_REFUSED_INDEX);
    hinges[0].index = latches[0].index = 1;
    CHECK_EQUAL(config_add_hinge(&hinges[0]), ORI_ACCEPTED);
    CHECK_EQUAL(config_add_latch(&latches[0]), ORI_ACCEPTED);
}

static void test_missing_records_are_refused(void)
{
    for (unsigned missing = 0; missing < 20; missing++) {
        set_up(12, 8);
        CHECK_EQUAL(config_begin(&device), ORI_ACCEPTED);
        for (unsigned i = 0; i < 12; i++)
            if (i != missing)
                CHECK_EQUAL(config_add_hinge(&hinges[i]), ORI_ACCEPTED);
        for (unsigned i = 0; i < 8; i++)
            if (12 + i != missing)
                CHECK_EQUAL(config_add_latch(&latches[i]), ORI_ACCEPTED);
        CHECK_EQUAL(commit(hash()), ORI_REFUSED_INDEX);
        /* It may still come. */
        if (missing < 12)
            CHECK_EQUAL(config_add_hinge(&hinges[missing]), ORI_ACCEPTED);
        else
            CHECK_EQUAL(config_add_latch(&latches[missing - 12]), ORI_ACCEPTED);
        CHECK_EQUAL(commit(hash()), ORI_ACCEPTED);
    }
    /* A new beginning forgets what came before. */
    set_up(1, 1);
    send_records();
    CHECK_EQUAL(config_begin(&device), ORI_ACCEPTED);
    CHECK_EQUAL(config_add_latch(&latches[0]), ORI_ACCEPTED);
    CHECK_EQUAL(commit(hash()), ORI_REFUSED_INDEX);
    send_records();
    CHECK_EQUAL(config_begin(&device), ORI_ACCEPTED);
    CHECK_EQUAL(config_add_hinge(&hinges[0]), ORI_ACCEPTED);
    CHECK_EQUAL(commit(hash()), ORI_REFUSED_INDEX);
}

static void test_a_wrong_hash_is_refused_and_the_right_one_told(void)
{
    uint32_t found = 0;
    set_up(2, 2);
    send_records();
    CHECK_EQUAL(config_commit(hash() + 1, &found), ORI_REFUSED_HASH);
    CHECK_EQUAL(found, hash());
    CHECK_EQUAL(config_hash(), 0);
    CHECK_EQUAL(config_commit(0, &found), ORI_REFUSED_HASH);
    CHECK_EQUAL(config_commit(hash(), &found), ORI_ACCEPTED);
    CHECK_EQUAL(found, hash());
}

/* 0 stands for none: a configuration whose hash it is, is refused. */
static void test_a_hash_of_zero_is_refused(void)
{
    uint32_t found = 1;
    set_up(0, 0);
    /* Choose the four bytes of one field so that the CRC comes out as 0: it is linear in each bit. */
    const uint32_t at_none = (device.supply_uv_per_count = 0, hash());
    uint32_t effect[32], choice[32], rest = at_none, chosen = 0;
    for (unsigned i = 0; i < 32; i++) {
        device.supply_uv_per_count = UINT32_C(1) << i;
        effect[i] = hash() ^ at_none;
        choice[i] = UINT32_C(1) << i;
    }
    for (unsigned bit = 0; bit < 32; bit++) { /* Gauss */
        unsigned pivot = bit;
        while (pivot < 32 && !(effect[pivot] >> bit & 1U))
            pivot++;
        CHECK(pivot < 32);
        const uint32_t e = effect[pivot], c = choice[pivot];
        effect[pivot] = effect[bit];
        choice[pivot] = choice[bit];
        effect[bit] = e;
        choice[bit] = c;
        for (unsigned i = bit + 1; i < 32; i++)
            if (effect[i] >> bit & 1U) {
                effect[i] ^= e;
                choice[i] ^= c;
            }
        if (rest >> bit & 1U) {
            rest ^= e;
            chosen ^= c;
        }
    }
    device.supply_uv_per_count = chosen;
    CHECK_EQUAL(hash(), 0);
    send_records();
    CHECK_EQUAL(config_commit(0, &found), ORI_REFUSED_HASH);
    CHECK_EQUAL(found, 0);
}

/* One value of a record, and what it may be. */
#define HINGE_VALUE(field, value, expected) \
    do { \
        hinges[1] = rig_hinge(1); \
        hinges[1].field = (value); \
        CHECK_EQUAL(config_add_hinge(&hinges[1]), (expected) ? ORI_ACCEPTED : ORI_REFUSED_RANGE); \
    } while (0)
#define LATCH_VALUE(of, field, value, expected) \
    do { \
        latches[of] = rig_latch(of); \
        latches[of].field = (value); \
        CHECK_EQUAL(config_add_latch(&latches[of]), (expected) ? ORI_ACCEPTED : ORI_REFUSED_RANGE); \
    } while (0)
#define DEVICE_VALUE(field, value, expected) \
    do { \
        device = rig_device(3, 3); \
        device.field = (value); \
        CHECK_EQUAL(config_begin(&device), (expected) ? ORI_ACCEPTED : ORI_REFUSED_RANGE); \
    } while (0)

static void test_what_the_device_record_may_say(void)
{
    set_up(3, 3);
    DEVICE_VALUE(schema, 0, false);
    DEVICE_VALUE(schema, 2, false);
    DEVICE_VALUE(hinges, 12, true);
    DEVICE_VALUE(hinges, 13, false);
    DEVICE_VALUE(latches, 8, true);
    DEVICE_VALUE(latches, 9, false);
    DEVICE_VALUE(silence_ms, 101, true);
    DEVICE_VALUE(silence_ms, 3000, true);
    DEVICE_VALUE(silence_ms, 3001, false);
    DEVICE_VALUE(brake_ms, 20, true);
    DEVICE_VALUE(brake_ms, 19, false);
    DEVICE_VALUE(brake_ms, 0, false);
    DEVICE_VALUE(brake_ms, 109, true); /* and two frames are less than 150 */
    DEVICE_VALUE(brake_ms, 110, false);
    DEVICE_VALUE(stall_ms, 10000, true);
    DEVICE_VALUE(stall_ms, 10001, false);
    device = rig_device(3, 3);
    device.brake_ms = 20;
    device.silence_ms = 100;
    CHECK_EQUAL(config_begin(&device), ORI_ACCEPTED);
    device.silence_ms = 99;
    CHECK_EQUAL(config_begin(&device), ORI_REFUSED_RANGE);
}

static void test_what_a_hinge_record_may_say(void)
{
    set_up(3, 3);
    CHECK_EQUAL(config_begin(&device), ORI_ACCEPTED);
    HINGE_VALUE(channel, 11, true);
    HINGE_VALUE(channel, 12, false);
    HINGE_VALUE(adc, 11, true);
    HINGE_VALUE(adc, 12, false);
    HINGE_VALUE(min_urad, 1500000, false);
    HINGE_VALUE(min_urad, 1499999, true);
    HINGE_VALUE(min_urad, -100000000, true);
    HINGE_VALUE(min_urad, -100000001, false);
    HINGE_VALUE(max_urad, 100000000, true);
    HINGE_VALUE(max_urad, 100000001, false);
    HINGE_VALUE(max_velocity_mrad_s, 0, false);
    HINGE_VALUE(max_velocity_mrad_s, 1, true);
    HINGE_VALUE(max_acceleration_mrad_s2, 0, false);
    HINGE_VALUE(max_acceleration_mrad_s2, 1, true);
    HINGE_VALUE(pulse_zero_ns, 20000000, true);
    HINGE_VALUE(pulse_zero_ns, 20000001, false);
    HINGE_VALUE(pulse_zero_ns, -20000000, true);
    HINGE_VALUE(pulse_zero_ns, -20000001, false);
    HINGE_VALUE(pulse_slope_ns, 0, false);
    HINGE_VALUE(pulse_slope_ns, 1, true);
    HINGE_VALUE(pulse_slope_ns, -1, true);
    HINGE_VALUE(pulse_slope_ns, 20000000, true);
    HINGE_VALUE(pulse_slope_ns, 20000001, false);
    HINGE_VALUE(pulse_slope_ns, -20000000, true);
    HINGE_VALUE(pulse_slope_ns, -20000001, false);
    HINGE_VALUE(pulse_slope_ns, INT32_MIN, false);
    HINGE_VALUE(pulse_min_us, 100, true);
    HINGE_VALUE(pulse_min_us, 99, false);
    HINGE_VALUE(pulse_min_us, 2499, true);
    HINGE_VALUE(pulse_min_us, 2500, false);
    HINGE_VALUE(pulse_max_us, 19000, true);
    HINGE_VALUE(pulse_max_us, 19001, false);
    HINGE_VALUE(feedback_zero_urad, 1000000000, true);
    HINGE_VALUE(feedback_zero_urad, 1000000001, false);
    HINGE_VALUE(feedback_zero_urad, -1000000000, true);
    HINGE_VALUE(feedback_zero_urad, -1000000001, false);
    HINGE_VALUE(feedback_slope_nrad, 100000000, true);
    HINGE_VALUE(feedback_slope_nrad, 100000001, false);
    HINGE_VALUE(feedback_slope_nrad, -100000000, true);
    HINGE_VALUE(feedback_slope_nrad, -100000001, false);
    HINGE_VALUE(feedback_low, 1000, true);
    HINGE_VALUE(feedback_low, 1001, false);
    HINGE_VALUE(feedback_high, 1023, true);
    HINGE_VALUE(feedback_high, 1024, false);
}

static void test_what_a_latch_record_may_say(void)
{
    set_up(3, 3);
    CHECK_EQUAL(config_begin(&device), ORI_ACCEPTED);
    for (unsigned i = 0; i < 3; i++) {
        LATCH_VALUE(i, sensor, 7, true);
        LATCH_VALUE(i, sensor, 8, false);
        LATCH_VALUE(i, sensor, 254, false);
        LATCH_VALUE(i, sensor, 255, true);
        LATCH_VALUE(i, kind, 3, false);
        LATCH_VALUE(i, debounce_ms, 10000, true);
        LATCH_VALUE(i, debounce_ms, 10001, false);
    }
    LATCH_VALUE(0, output, 7, true);
    LATCH_VALUE(0, output, 8, false);
    LATCH_VALUE(0, duty_permille, 1000, true);
    LATCH_VALUE(0, duty_permille, 1001, false);
    LATCH_VALUE(0, max_on_ms, 0, false);
    LATCH_VALUE(0, max_on_ms, 1, true);
    LATCH_VALUE(0, max_on_ms, 3600000, true);
    LATCH_VALUE(0, max_on_ms, 3600001, false);
    LATCH_VALUE(0, engaged_us, 0, true); /* not its own */
    LATCH_VALUE(1, output, 11, true);
    LATCH_VALUE(1, output, 12, false);
    LATCH_VALUE(1, engaged_us, 100, true);
    LATCH_VALUE(1, engaged_us, 99, false);
    LATCH_VALUE(1, engaged_us, 19000, true);
    LATCH_VALUE(1, engaged_us, 19001, false);
    LATCH_VALUE(1, released_us, 100, true);
    LATCH_VALUE(1, released_us, 99, false);
    LATCH_VALUE(1, released_us, 19000, true);
    LATCH_VALUE(1, released_us, 19001, false);
    LATCH_VALUE(1, max_on_ms, 0, true);
    LATCH_VALUE(2, output, 200, true);
}

static void test_a_refused_record_is_not_stored(void)
{
    set_up(2, 1);
    send_records();
    mavlink_ori_config_hinge_t bad = hinges[1];
    bad.channel = 12;
    CHECK_EQUAL(config_add_hinge(&bad), ORI_REFUSED_RANGE);
    mavlink_ori_config_latch_t worse = latches[0];
    worse.sensor = 9;
    CHECK_EQUAL(config_add_latch(&worse), ORI_REFUSED_RANGE);
    CHECK_EQUAL(commit(hash()), ORI_ACCEPTED);
}

static void test_outputs_are_used_once(void)
{
    set_up(3, 8);
    hinges[2].channel = hinges[0].channel;
    send_records();
    CHECK_EQUAL(commit(hash()), ORI_REFUSED_RANGE);
    CHECK_EQUAL(config_hash(), 0);
    set_up(3, 8);
    latches[4].output = hinges[1].channel; /* a pin on a hinge's */
    send_records();
    CHECK_EQUAL(commit(hash()), ORI_REFUSED_RANGE);
    set_up(3, 8);
    latches[4].output = latches[1].output; /* two pins */
    send_records();
    CHECK_EQUAL(commit(hash()), ORI_REFUSED_RANGE);
    set_up(3, 8);
    latches[3].output = latches[0].output; /* two magnets */
    send_records();
    CHECK_EQUAL(commit(hash()), ORI_REFUSED_RANGE);
    set_up(3, 8);
    latches[3].output = hinges[0].channel; /* a magnet's outputs are others */
    latches[2].output = hinges[1].channel; /* and this is none */
    latches[5].output = latches[1].output;
    latches[0].output = latches[1].output;
    send_records();
    CHECK_EQUAL(commit(hash()), ORI_ACCEPTED);
    set_up(1, 1);
    hinges[0].channel = 0; /* the first output of each kind */
    latches[0].output = 0;
    store();
}

/* What an older configuration left behind in the slot counts for nothing. */
static void test_outputs_of_records_that_are_gone_are_free(void)
{
    set_up(2, 2);
    store();
    store();
    device = rig_device(1, 1);
    hinges[0].channel = latches[1].output;
    store();
    device = rig_device(2, 0);
    store();
    device = rig_device(1, 1);
    hinges[0].channel = rig_hinge(1).channel;
    store();
}

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

/* Counts that cannot be are not followed, even where every checksum is good. */
static void test_impossible_counts_are_damage(void)
{
    for (unsigned i = 0; i < 3; i++) {
        set_up(1, 1);
        store();
        uint8_t *slot = fake.eeprom;
        mavlink_ori_config_device_t *stored = (mavlink_ori_config_device_t *)(slot + HEADER);
        if (i == 0)
            stored->hinges = 13;
        else if (i == 1)
            stored->latches = 9;
        else
            stored->schema = 2;
        const uint32_t records = MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN +
                                 (i == 0 ? 13U : 1U) * MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN;
        /* Records in order of the wire: hinges, then latches behind all places for hinges. */
        uint32_t crc = crc32_of(0, slot + HEADER, i == 0 ? records : MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN);
        if (i != 0)
            crc = crc32_of(crc, slot + HEADER + MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN, MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN);
        crc = crc32_of(crc,
                       slot + HEADER + MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN + ORI_HINGES * MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN,
                       (i == 1 ? 9U : 1U) * MAVLINK_MSG_ID_ORI_CONFIG_LATCH_LEN);
        memcpy(slot + 8, &crc, 4);
        crc = crc32_of(0, slot, 12);
        memcpy(slot + 12, &crc, 4);
        CHECK_EQUAL(config_load(), CONFIG_CORRUPT);
    }
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

SUITE(config, TEST(test_nothing_is_stored_at_first), TEST(test_what_was_sent_is_in_force), TEST(test_tokens_are_not_part_of_it),
      TEST(test_records_come_in_any_order_and_again), TEST(test_records_without_a_beginning_are_refused),
      TEST(test_records_beyond_the_counts_are_refused), TEST(test_missing_records_are_refused),
      TEST(test_a_wrong_hash_is_refused_and_the_right_one_told), TEST(test_a_hash_of_zero_is_refused),
      TEST(test_what_the_device_record_may_say), TEST(test_what_a_hinge_record_may_say), TEST(test_what_a_latch_record_may_say),
      TEST(test_a_refused_record_is_not_stored), TEST(test_outputs_are_used_once),
      TEST(test_outputs_of_records_that_are_gone_are_free), TEST(test_the_layout_in_the_eeprom),
      TEST(test_half_of_a_first_configuration_is_damage), TEST(test_the_newest_is_in_force),
      TEST(test_a_torn_write_keeps_the_old_one), TEST(test_damage_is_found_and_the_other_is_in_force),
      TEST(test_impossible_counts_are_damage), TEST(test_a_new_configuration_ends_the_damage),
      TEST(test_an_erased_header_is_nothing_but_half_of_one_is_damage), TEST(test_worn_cells_are_noticed),
      TEST(test_nothing_of_the_old_one_is_left_in_force), TEST(test_starts_are_counted));
