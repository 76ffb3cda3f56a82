/* Configurations: what is stored is what was sent, and what a record may say. */
#include <string.h>

#include "check.h"
#include "records.h"

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

SUITE(config_records, TEST(test_nothing_is_stored_at_first), TEST(test_what_was_sent_is_in_force),
      TEST(test_tokens_are_not_part_of_it), TEST(test_records_come_in_any_order_and_again),
      TEST(test_records_without_a_beginning_are_refused), TEST(test_records_beyond_the_counts_are_refused),
      TEST(test_missing_records_are_refused), TEST(test_a_wrong_hash_is_refused_and_the_right_one_told),
      TEST(test_a_hash_of_zero_is_refused), TEST(test_what_the_device_record_may_say),
      TEST(test_what_a_hinge_record_may_say), TEST(test_what_a_latch_record_may_say),
      TEST(test_a_refused_record_is_not_stored), TEST(test_outputs_are_used_once),
      TEST(test_outputs_of_records_that_are_gone_are_free));
