/* What is told without being asked, and what waits for room. */
#include <string.h>

#include "check.h"
#include "core.h"
#include "machine.h"
#include "rig.h"

static void test_the_heart_beats_every_second(void)
{
    unsigned beats = 0;
    mavlink_heartbeat_t beat;
    rig_start();
    core_poll();
    while (frame_take_kind(KIND(HEARTBEAT), &beat))
        ;
    for (unsigned i = 1; i <= 500; i++) {
        frame_passes();
        core_poll();
        while (frame_take_kind(KIND(HEARTBEAT), &beat)) {
            beats++;
            CHECK_EQUAL(i % 50, 0);
            CHECK_EQUAL(beat.custom_mode, ORI_IDLE);
            CHECK_EQUAL(beat.system_status, MAV_STATE_STANDBY);
        }
    }
    CHECK_EQUAL(beats, 10);
    CHECK_EQUAL(host_enable(1, NULL, 1), ORI_ACCEPTED);
    frames_pass(51);
    bool active = false;
    while (frame_take_kind(KIND(HEARTBEAT), &beat))
        active = active || beat.system_status == MAV_STATE_ACTIVE;
    CHECK(active);
    fake.estop = true;
    frames_pass(51);
    bool critical = false;
    while (frame_take_kind(KIND(HEARTBEAT), &beat))
        critical = critical || beat.system_status == MAV_STATE_CRITICAL;
    CHECK(critical);
}

static void test_events_are_told(void)
{
    mavlink_ori_event_t event;
    rig_start();
    core_poll();
    frames_pass(20);
    fake.from_device_size = 0;
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    core_poll();
    bool told = false;
    for (unsigned i = 0; i < 60; i++) {
        frame_passes();
        core_poll();
        core_poll();
        while (frame_take_kind(KIND(ORI_EVENT), &event))
            told = told || (event.code == ORI_EVENT_LATCH_TRIPPED && event.index == 0);
    }
    CHECK(told);
    fake.estop = true;
    frame_passes();
    core_poll();
    CHECK(frame_take_kind(KIND(ORI_EVENT), &event));
    CHECK_EQUAL(event.code, ORI_EVENT_FAULT);
    CHECK_EQUAL(event.index, ORI_FAULT_ESTOP);
    CHECK_EQUAL(event.value, ORI_NOBODY);
    mavlink_statustext_t text;
    CHECK(frame_take_kind(KIND(STATUSTEXT), &text));
    CHECK_EQUAL(text.severity, MAV_SEVERITY_CRITICAL);
    CHECK(strcmp(text.text, "ori fault 10") == 0);
    core_poll();
    CHECK(frame_take_kind(KIND(ORI_EVENT), &event));
    CHECK_EQUAL(event.code, ORI_EVENT_STATE);
    CHECK_EQUAL(event.index, ORI_FAULTED);
    CHECK_EQUAL(event.value, ORI_IDLE);
    fake.estop = false;
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_ACCEPTED);
    core_poll();
    CHECK(frame_take_kind(KIND(ORI_EVENT), &event));
    CHECK_EQUAL(event.code, ORI_EVENT_CLEARED);
    CHECK_EQUAL(event.index, ORI_FAULT_ESTOP);
}

/* The second of eight that trip is told by its own number; what a start and a command leave in the log as well. */
static void test_the_log_of_a_start_and_of_latches(void)
{
    mavlink_ori_event_t event;
    rig_start();
    rig_restart(PORT_RESET_EXTERNAL);
    unsigned boots = 0, configs = 0;
    for (unsigned i = 0; i < 12; i++) {
        core_poll();
        while (frame_take_kind(KIND(ORI_EVENT), &event)) {
            boots += event.code == ORI_EVENT_BOOT && event.index == PORT_RESET_EXTERNAL;
            configs += event.code == ORI_EVENT_CONFIG && (uint32_t)event.value == config_hash();
        }
    }
    CHECK_EQUAL(boots, 1);
    CHECK(configs >= 1);
    const mavlink_ori_latch_command_t command = {.token = host_token(), .index = 1, .engage = 1};
    host_says(KIND(ORI_LATCH_COMMAND), &command);
    core_poll();
    bool told = false;
    while (frame_take_kind(KIND(ORI_EVENT), &event))
        told = told || (event.code == ORI_EVENT_LATCH && event.index == 1 && event.value == 1);
    CHECK(told);
    const mavlink_ori_latch_command_t refused = {.token = host_token(), .index = 7, .engage = 1};
    host_says(KIND(ORI_LATCH_COMMAND), &refused);
    core_poll();
    while (frame_take_kind(KIND(ORI_EVENT), &event))
        CHECK(event.code != ORI_EVENT_LATCH);
}

/* The port checks that nothing is sent that there is no room for; here, that all of it comes later. */
static void test_what_finds_no_room_waits(void)
{
    const mavlink_ori_poll_t poll = {.token = 3, .what = ORI_POLL_STATE | ORI_POLL_LATCHES | ORI_POLL_INFO};
    received_t received;
    rig_start();
    machine_trip(ORI_FAULT_ESTOP, ORI_NOBODY);
    for (uint16_t room = 0; room < 400; room += 7) {
        fake.send_room = room;
        host_says(KIND(ORI_POLL), &poll);
        core_poll();
    }
    unsigned states = 0, latches = 0, infos = 0;
    fake.from_device_size = 0;
    fake.send_room = UINT16_MAX;
    host_says(KIND(ORI_POLL), &poll);
    while (frame_take(&received)) {
        states += received.id == MAVLINK_MSG_ID_ORI_STATE;
        latches += received.id == MAVLINK_MSG_ID_ORI_LATCH_STATE;
        infos += received.id == MAVLINK_MSG_ID_ORI_INFO;
    }
    CHECK_EQUAL(states, 1);
    CHECK_EQUAL(latches, 1);
    CHECK_EQUAL(infos, 1);
    fake.send_room = 0;
    const mavlink_ori_config_read_t read = {.token = 5, .record = ORI_RECORD_DEVICE};
    const mavlink_timesync_t ask = {.ts1 = 5};
    host_says(KIND(ORI_CONFIG_READ), &read);
    host_says(KIND(TIMESYNC), &ask);
    host_says(KIND(ORI_POLL), &poll);
    fake.send_room = UINT16_MAX;
    core_poll();
    CHECK_EQUAL(frame_count(KIND(ORI_STATE)), 1);
}

/* Without room for an answer the command is carried out, and answered when it is repeated. */
static void test_an_answer_without_room_is_given_again(void)
{
    const mavlink_ori_latch_command_t command = {.token = 700, .index = 0, .engage = 1};
    rig_start();
    fake.send_room = 0;
    host_says(KIND(ORI_LATCH_COMMAND), &command);
    CHECK(fake.magnet[1]);
    fake.send_room = UINT16_MAX;
    const unsigned calls = fake.magnet_calls;
    CHECK_EQUAL(host_commands(KIND(ORI_LATCH_COMMAND), &command).result, ORI_ACCEPTED);
    CHECK_EQUAL(fake.magnet_calls, calls);
}

static void test_the_watchdog_is_kicked_in_every_frame_and_only_there(void)
{
    rig_start();
    const unsigned kicks = fake.kicks;
    for (unsigned i = 0; i < 10; i++)
        core_poll();
    CHECK_EQUAL(fake.kicks, kicks);
    for (unsigned i = 0; i < 10; i++)
        frame_passes();
    CHECK_EQUAL(fake.kicks, kicks + 10);
}

SUITE(messages_unasked, TEST(test_the_heart_beats_every_second), TEST(test_events_are_told),
      TEST(test_the_log_of_a_start_and_of_latches), TEST(test_what_finds_no_room_waits),
      TEST(test_an_answer_without_room_is_given_again),
      TEST(test_the_watchdog_is_kicked_in_every_frame_and_only_there));
