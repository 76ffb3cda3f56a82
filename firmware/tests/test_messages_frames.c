/* The wire: which frames are believed. */
#include <string.h>

#include "check.h"
#include "core.h"
#include "rig.h"

/* A poll for the state, in a frame that may be spoilt before it is sent. */
static size_t poll_frame(uint8_t *frame, uint16_t token)
{
    const mavlink_ori_poll_t poll = {.token = token, .what = ORI_POLL_STATE};
    return frame_make(frame, KIND(ORI_POLL), &poll);
}

static bool is_answered(const uint8_t *frame, size_t size)
{
    mavlink_ori_state_t state;
    fake.from_device_size = 0;
    fake_type(frame, (uint32_t)size);
    poll_all();
    return frame_take_kind(KIND(ORI_STATE), &state);
}

static void spend(unsigned bytes) /* lets the parser come to the end of what a spoilt frame promised */
{
    static const uint8_t nothing[300];
    fake_type(nothing, bytes);
    poll_all();
}

static void test_a_good_frame_is_answered(void)
{
    uint8_t frame[LONGEST_FRAME];
    rig_start();
    for (uint16_t token = 0; token < 300; token++)
        CHECK(is_answered(frame, poll_frame(frame, token)));
}

static void test_no_spoilt_frame_is_believed(void)
{
    uint8_t frame[LONGEST_FRAME];
    rig_start();
    for (size_t at = 0; at < 15; at++)
        for (unsigned bit = 0; bit < 8; bit++) {
            const size_t size = poll_frame(frame, 0x1234);
            CHECK_EQUAL(size, 15);
            if (at == 4 || at == 3)
                continue; /* covered by the checksum like all others, see below */
            frame[at] ^= (uint8_t)(1U << bit);
            CHECK(!is_answered(frame, size));
            spend(300);
            CHECK(is_answered(frame, poll_frame(frame, 1)));
        }
    for (size_t at = 3; at < 5; at++) {
        const size_t size = poll_frame(frame, 0x1234);
        frame[at] ^= 0x10;
        CHECK(!is_answered(frame, size));
    }
}

static void test_frames_cut_short_are_not_believed(void)
{
    uint8_t frame[LONGEST_FRAME];
    rig_start();
    for (size_t size = 1; size < 15; size++) {
        (void)poll_frame(frame, 0x1234);
        CHECK(!is_answered(frame, size));
        spend(300);
        CHECK(is_answered(frame, poll_frame(frame, 1)));
    }
}

/* What ends too early, or says that it is longer than it is, swallows nothing that comes after a pause. */
static void test_a_pause_ends_what_was_begun(void)
{
    uint8_t frame[LONGEST_FRAME];
    rig_start();
    for (size_t size = 1; size < 15; size++) {
        (void)poll_frame(frame, 0x1234);
        CHECK(!is_answered(frame, size));
        fake.micros += 2501;
        core_poll();
        CHECK(is_answered(frame, poll_frame(frame, 1)));
    }
    const size_t size = poll_frame(frame, 0x1234);
    frame[1] = 250;
    CHECK(!is_answered(frame, size));
    fake.micros += 2501;
    core_poll();
    CHECK(is_answered(frame, poll_frame(frame, 1)));
}

/* A byte now and then is enough, and time in which nobody looked is no pause. */
static void test_slow_bytes_are_one_frame(void)
{
    uint8_t frame[LONGEST_FRAME];
    mavlink_ori_state_t state;
    rig_start();
    fake.micros = (UINT64_C(1) << 32) - 10000; /* times wrap around under way */
    size_t size = poll_frame(frame, 1);
    fake.from_device_size = 0;
    for (size_t at = 0; at < size; at++) {
        fake_type(frame + at, 1);
        poll_all();
        fake.micros += 2500;
        core_poll();
    }
    CHECK(frame_take_kind(KIND(ORI_STATE), &state));
    size = poll_frame(frame, 2);
    CHECK(!is_answered(frame, 7));
    fake.micros += 100000;
    CHECK(is_answered(frame + 7, size - 7));
    static const uint8_t noise[57]; /* with the 7 as many as are taken at a time: that no more came was not seen */
    size = poll_frame(frame, 3);
    fake_type(noise, sizeof noise);
    fake_type(frame, 7);
    core_poll();
    fake.micros += 100000;
    core_poll();
    CHECK(is_answered(frame + 7, size - 7));
}

static void test_others_are_not_believed(void)
{
    uint8_t frame[LONGEST_FRAME];
    const mavlink_ori_poll_t poll = {.token = 77, .what = ORI_POLL_STATE};
    rig_start();
    CHECK(!is_answered(frame, frame_make_as(frame, KIND(ORI_POLL), &poll, 3, 1, 1)));
    CHECK(!is_answered(frame, frame_make_as(frame, KIND(ORI_POLL), &poll, 3, 255, 1)));
    CHECK(!is_answered(frame, frame_make_as(frame, KIND(ORI_POLL), &poll, 3, 1, 190)));
    CHECK(is_answered(frame, frame_make_as(frame, KIND(ORI_POLL), &poll, 3, 255, 190)));
}

static void test_signed_frames_are_not_believed(void)
{
    uint8_t frame[LONGEST_FRAME + 13];
    const kind_t kind = KIND(ORI_POLL);
    rig_start();
    const size_t size = poll_frame(frame, 77);
    frame[2] = 1;
    const uint16_t crc = x25(x25(0xffff, frame + 1, size - 3), &kind.extra, 1);
    frame[size - 2] = (uint8_t)crc;
    frame[size - 1] = (uint8_t)(crc >> 8);
    memset(frame + size, 0, 13);
    CHECK(!is_answered(frame, size + 13));
    CHECK(is_answered(frame, poll_frame(frame, 1)));
}

static void test_frames_of_the_first_mavlink_are_not_believed(void)
{
    uint8_t frame[] = {0xfe, 9, 0, 255, 190, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    const uint8_t extra = 50; /* a heartbeat */
    rig_start();
    const uint16_t crc = x25(x25(0xffff, frame + 1, 14), &extra, 1);
    frame[15] = (uint8_t)crc;
    frame[16] = (uint8_t)(crc >> 8);
    CHECK(!is_answered(frame, sizeof frame));
    CHECK(is_answered(frame, poll_frame(frame, 1)));
}

static void test_what_only_a_device_says_is_no_word_of_the_host(void)
{
    mavlink_ori_state_t state = {.token = 3};
    uint8_t frame[LONGEST_FRAME];
    rig_start();
    CHECK(!is_answered(frame, frame_make(frame, KIND(ORI_STATE), &state)));
    CHECK(is_answered(frame, poll_frame(frame, 1)));
}

static void test_frames_may_come_in_pieces_and_in_crowds(void)
{
    uint8_t frames[20 * LONGEST_FRAME];
    size_t size = 0;
    rig_start();
    for (uint16_t i = 0; i < 20; i++)
        size += poll_frame(frames + size, i);
    fake.from_device_size = 0;
    for (size_t at = 0; at < size; at++) {
        fake_type(frames + at, 1);
        core_poll();
    }
    CHECK_EQUAL(frame_count(KIND(ORI_STATE)), 20);
    fake_type(frames, (uint32_t)size);
    poll_all();
    CHECK_EQUAL(frame_count(KIND(ORI_STATE)), 20);
}

static void test_a_flood_does_not_keep_the_frame_waiting(void)
{
    static const uint8_t flood[4096];
    rig_start();
    fake_type(flood, sizeof flood);
    core_poll();
    CHECK(fake.to_device_taken <= 64);
}

SUITE(messages_frames, TEST(test_a_good_frame_is_answered), TEST(test_no_spoilt_frame_is_believed),
      TEST(test_frames_cut_short_are_not_believed),
      TEST(test_a_pause_ends_what_was_begun), TEST(test_slow_bytes_are_one_frame), TEST(test_others_are_not_believed),
      TEST(test_signed_frames_are_not_believed), TEST(test_frames_of_the_first_mavlink_are_not_believed),
      TEST(test_what_only_a_device_says_is_no_word_of_the_host), TEST(test_frames_may_come_in_pieces_and_in_crowds),
      TEST(test_a_flood_does_not_keep_the_frame_waiting));
