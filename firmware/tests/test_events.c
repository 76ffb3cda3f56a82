/* The log: eight are kept, the oldest go first, and a gap in their numbers tells that some are lost. */
#include "check.h"
#include "events.h"
#include "fake_port.h"

static void test_events_come_in_order_and_once(void)
{
    mavlink_ori_event_t event;
    fake_reset();
    CHECK(!events_take(&event));
    fake.micros = 5000000000;
    events_note(ORI_EVENT_FAULT, 7, -3);
    fake.micros++;
    events_note(ORI_EVENT_LATCH, 2, 1);
    CHECK(events_take(&event));
    CHECK_EQUAL(event.time_us, 5000000000);
    CHECK_EQUAL(event.number, 0);
    CHECK_EQUAL(event.code, ORI_EVENT_FAULT);
    CHECK_EQUAL(event.index, 7);
    CHECK_EQUAL(event.value, -3);
    CHECK(events_take(&event));
    CHECK_EQUAL(event.number, 1);
    CHECK_EQUAL(event.time_us, 5000000001);
    CHECK(!events_take(&event));
}

static void test_the_last_eight_are_kept(void)
{
    mavlink_ori_event_t event;
    fake_reset();
    for (int i = 0; i < 8; i++)
        events_note(ORI_EVENT_STATE, 0, i);
    for (int i = 0; i < 8; i++)
        CHECK(events_take(&event) && event.value == i);
    for (int i = 0; i < 11; i++)
        events_note(ORI_EVENT_STATE, 0, i);
    for (int i = 3; i < 11; i++) {
        CHECK(events_take(&event));
        CHECK_EQUAL(event.value, i);
        CHECK_EQUAL(event.number, 8 + i);
    }
    CHECK(!events_take(&event));
}

static void test_numbers_wrap_around(void)
{
    mavlink_ori_event_t event;
    fake_reset();
    for (long i = 0; i < 65536 + 5; i++) {
        events_note(ORI_EVENT_STATE, 0, (int32_t)i);
        if (i % 3)
            CHECK(events_take(&event));
    }
    unsigned left = 0;
    while (events_take(&event))
        left++;
    CHECK_EQUAL(left, 7);
    CHECK_EQUAL(event.value, 65540);
    CHECK_EQUAL(event.number, 4);
}

SUITE(events, TEST(test_events_come_in_order_and_once), TEST(test_the_last_eight_are_kept), TEST(test_numbers_wrap_around));
