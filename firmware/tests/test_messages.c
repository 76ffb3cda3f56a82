/* The wire: what is believed, what is answered, and what is told without being asked. */
#include <string.h>

#include "check.h"
#include "core.h"
#include "faults.h"
#include "machine.h"
#include "rig.h"
#include "version.h"

static void poll_all(void)
{
    while (fake.to_device_taken < fake.to_device_size)
        core_poll();
    core_poll();
}

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

/* Answers ------------------------------------------------------------------------------------------------------ */

static void test_the_clock_is_told(void)
{
    mavlink_timesync_t ask = {.tc1 = 0, .ts1 = -12345678901234}, told;
    rig_start();
    fake.micros = UINT64_C(5000000123);
    host_says(KIND(TIMESYNC), &ask);
    CHECK(frame_take_kind(KIND(TIMESYNC), &told));
    CHECK_EQUAL(told.tc1, 5000000123000);
    CHECK_EQUAL(told.ts1, ask.ts1);
    ask.tc1 = 1; /* an answer to somebody */
    host_says(KIND(TIMESYNC), &ask);
    CHECK_EQUAL(frame_count(KIND(TIMESYNC)), 0);
}

static void test_a_command_repeated_is_answered_and_not_carried_out(void)
{
    mavlink_ori_latch_command_t command = {.token = 500, .index = 1, .engage = 1};
    rig_start();
    CHECK_EQUAL(host_commands(KIND(ORI_LATCH_COMMAND), &command).result, ORI_ACCEPTED);
    const unsigned calls = fake.servo_calls;
    command.engage = 0;
    const mavlink_ori_ack_t again = host_commands(KIND(ORI_LATCH_COMMAND), &command);
    CHECK_EQUAL(again.token, 500);
    CHECK_EQUAL(again.result, ORI_ACCEPTED);
    CHECK_EQUAL(again.index, 1);
    CHECK_EQUAL(fake.servo_calls, calls);
    command.token = 501;
    CHECK_EQUAL(host_commands(KIND(ORI_LATCH_COMMAND), &command).result, ORI_ACCEPTED);
    CHECK_EQUAL(fake.servo_calls, calls + 1);
    /* A restart forgets it, and token 0 is one like any other. */
    rig_restart(PORT_RESET_POWER);
    command = (mavlink_ori_latch_command_t){.token = 0, .index = 9, .engage = 1};
    CHECK_EQUAL(host_commands(KIND(ORI_LATCH_COMMAND), &command).result, ORI_REFUSED_INDEX);
}

static void test_every_command_repeated_is_not_carried_out(void)
{
    union {
        uint8_t bytes[256];
        uint64_t align;
    } payload = {{0}};
    const kind_t kinds[] = {KIND(ORI_ENABLE),        KIND(ORI_DISABLE),      KIND(ORI_BRAKE),        KIND(ORI_LATCH_COMMAND),
                            KIND(ORI_FAULT_CLEAR),   KIND(ORI_CONFIG_DEVICE), KIND(ORI_CONFIG_HINGE), KIND(ORI_CONFIG_LATCH),
                            KIND(ORI_CONFIG_COMMIT)};
    rig_start();
    mavlink_ori_ack_t first = host_commands(KIND(ORI_BRAKE), payload.bytes); /* token 0 */
    CHECK_EQUAL(first.result, ORI_ACCEPTED);
    CHECK_EQUAL(first.value, ORI_IDLE);
    const uint32_t written = fake.eeprom_written;
    for (unsigned i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        const mavlink_ori_ack_t ack = host_commands(kinds[i], payload.bytes);
        CHECK_EQUAL(ack.result, ORI_ACCEPTED);
        CHECK_EQUAL(ack.token, 0);
    }
    CHECK_EQUAL(fake.eeprom_written, written);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
}

static void test_the_state_is_told(void)
{
    rig_start();
    fake.adc[ORI_ADC_SUPPLY] = 612;
    fake.adc[ORI_ADC_THERMISTOR] = 321;
    rig_place(2, 0.4);
    CHECK_EQUAL(host_enable(0x3, NULL, 17), ORI_ACCEPTED);
    host_knot(17, 0, fake.micros + 60000, 150, 0);
    fake.micros = UINT64_C(7777777777);
    mavlink_ori_state_t state = host_state();
    CHECK_EQUAL(state.time_us, 7777777777);
    CHECK_EQUAL(state.position_urad[2], 400000);
    CHECK_EQUAL(state.contiguous, 1);
    CHECK_EQUAL(state.supply_mv, 6120);
    CHECK_EQUAL(state.temperature_count, 321);
    CHECK_EQUAL(state.outputs_on, 0x3);
    CHECK_EQUAL(state.sensed, 0x7);
    CHECK_EQUAL(state.queued, 1);
    CHECK_EQUAL(state.stream, 17);
    CHECK_EQUAL(state.state, ORI_STREAMING);
    CHECK_EQUAL(state.fault, ORI_FAULT_NONE);
    CHECK_EQUAL(state.fault_index, ORI_NOBODY);
    machine_trip(ORI_FAULT_STALL, 2);
    state = host_state();
    CHECK_EQUAL(state.fault, ORI_FAULT_STALL);
    CHECK_EQUAL(state.fault_index, 2);
    CHECK_EQUAL(state.state, ORI_BRAKING);
}

static void test_all_reports_can_be_asked_for_at_once(void)
{
    const mavlink_ori_poll_t poll = {.token = 99, .what = ORI_POLL_STATE | ORI_POLL_LATCHES | ORI_POLL_INFO};
    received_t received;
    unsigned seen = 0;
    rig_start();
    poll_all();
    fake.from_device_size = 0;
    host_says(KIND(ORI_POLL), &poll);
    while (frame_take(&received)) {
        if (received.id == MAVLINK_MSG_ID_ORI_STATE)
            seen |= 1;
        if (received.id == MAVLINK_MSG_ID_ORI_LATCH_STATE)
            seen |= 2;
        if (received.id == MAVLINK_MSG_ID_ORI_INFO)
            seen |= 4;
    }
    CHECK_EQUAL(seen, 7);
}

static void test_the_device_says_what_it_is(void)
{
    const mavlink_ori_poll_t poll = {.token = 41, .what = ORI_POLL_INFO};
    mavlink_ori_info_t info;
    rig_start();
    rig_restart(PORT_RESET_EXTERNAL);
    host_says(KIND(ORI_POLL), &poll);
    CHECK(frame_take_kind(KIND(ORI_INFO), &info));
    CHECK_EQUAL(info.token, 41);
    CHECK_EQUAL(info.boot, 2);
    CHECK_EQUAL(info.firmware, ORI_FIRMWARE_VERSION);
    CHECK_EQUAL(info.config_hash, config_hash());
    CHECK_EQUAL(info.reset_cause, PORT_RESET_EXTERNAL);
    CHECK_EQUAL(info.hinges, RIG_HINGES);
    CHECK_EQUAL(info.latches, RIG_LATCHES);
    CHECK_EQUAL(info.time_us, fake.micros);
    CHECK(memcmp(info.port, "fake\0\0\0\0\0\0\0\0\0\0\0", 16) == 0);
    fake_reset();
    core_init();
    host_says(KIND(ORI_POLL), &poll);
    CHECK(frame_take_kind(KIND(ORI_INFO), &info));
    CHECK_EQUAL(info.config_hash | info.hinges | info.latches, 0);
}

/* The configuration over the wire, record by record, and read back. */
static void test_a_configuration_is_written_and_read(void)
{
    mavlink_ori_config_device_t device = rig_device(2, 2), device_back;
    mavlink_ori_config_hinge_t hinges[2] = {rig_hinge(0), rig_hinge(1)}, hinge_back;
    mavlink_ori_config_latch_t latches[2] = {rig_latch(0), rig_latch(1)}, latch_back;
    fake_reset();
    fake.adc[ORI_ADC_SUPPLY] = 600;
    core_init();
    device.token = host_token();
    CHECK_EQUAL(host_commands(KIND(ORI_CONFIG_DEVICE), &device).result, ORI_ACCEPTED);
    for (unsigned i = 0; i < 2; i++) {
        hinges[i].token = host_token();
        latches[i].token = host_token();
        const mavlink_ori_ack_t ack = host_commands(KIND(ORI_CONFIG_HINGE), &hinges[i]);
        CHECK_EQUAL(ack.result, ORI_ACCEPTED);
        CHECK_EQUAL(ack.index, i);
        CHECK_EQUAL(host_commands(KIND(ORI_CONFIG_LATCH), &latches[i]).result, ORI_ACCEPTED);
    }
    mavlink_ori_config_commit_t commit = {.token = host_token(), .hash = 1};
    mavlink_ori_ack_t ack = host_commands(KIND(ORI_CONFIG_COMMIT), &commit);
    CHECK_EQUAL(ack.result, ORI_REFUSED_HASH);
    CHECK_EQUAL((uint32_t)ack.value, rig_hash(&device, hinges, latches));
    mavlink_ori_config_read_t read = {.token = host_token(), .record = ORI_RECORD_DEVICE};
    CHECK_EQUAL(host_commands(KIND(ORI_CONFIG_READ), &read).result, ORI_REFUSED_STATE);
    commit = (mavlink_ori_config_commit_t){.token = host_token(), .hash = rig_hash(&device, hinges, latches)};
    CHECK_EQUAL(host_commands(KIND(ORI_CONFIG_COMMIT), &commit).result, ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    read.token = device.token = 1001;
    host_says(KIND(ORI_CONFIG_READ), &read);
    CHECK(frame_take_kind(KIND(ORI_CONFIG_DEVICE), &device_back));
    CHECK(memcmp(&device, &device_back, MAVLINK_MSG_ID_ORI_CONFIG_DEVICE_LEN) == 0);
    for (uint8_t i = 0; i < 2; i++) {
        read = (mavlink_ori_config_read_t){.token = 2000, .record = ORI_RECORD_HINGE, .index = i};
        hinges[i].token = latches[i].token = 2000;
        host_says(KIND(ORI_CONFIG_READ), &read);
        CHECK(frame_take_kind(KIND(ORI_CONFIG_HINGE), &hinge_back));
        CHECK(memcmp(&hinges[i], &hinge_back, MAVLINK_MSG_ID_ORI_CONFIG_HINGE_LEN) == 0);
        read.record = ORI_RECORD_LATCH;
        host_says(KIND(ORI_CONFIG_READ), &read);
        CHECK(frame_take_kind(KIND(ORI_CONFIG_LATCH), &latch_back));
        CHECK(memcmp(&latches[i], &latch_back, MAVLINK_MSG_ID_ORI_CONFIG_LATCH_LEN) == 0);
    }
    read.token = 2001;
    read.index = 2;
    CHECK_EQUAL(host_commands(KIND(ORI_CONFIG_READ), &read).result, ORI_REFUSED_INDEX);
    read.token = 2002;
    read.record = ORI_RECORD_HINGE;
    CHECK_EQUAL(host_commands(KIND(ORI_CONFIG_READ), &read).result, ORI_REFUSED_INDEX);
    read.token = 2003;
    read.record = 3;
    CHECK_EQUAL(host_commands(KIND(ORI_CONFIG_READ), &read).result, ORI_REFUSED_INDEX);
}

static void test_clearing_tells_what_is_latched(void)
{
    rig_start();
    rig_restart(PORT_RESET_BROWN_OUT);
    mavlink_ori_fault_clear_t clear = {.token = host_token(), .fault = ORI_FAULT_STALL};
    mavlink_ori_ack_t ack = host_commands(KIND(ORI_FAULT_CLEAR), &clear);
    CHECK_EQUAL(ack.result, ORI_REFUSED_STATE);
    CHECK_EQUAL(ack.value, ORI_FAULT_BROWN_OUT);
    mavlink_ori_enable_t enable = {.token = host_token()};
    ack = host_commands(KIND(ORI_ENABLE), &enable);
    CHECK_EQUAL(ack.result, ORI_REFUSED_FAULT);
    CHECK_EQUAL(ack.value, ORI_FAULT_BROWN_OUT);
    clear = (mavlink_ori_fault_clear_t){.token = host_token(), .fault = ORI_FAULT_BROWN_OUT};
    ack = host_commands(KIND(ORI_FAULT_CLEAR), &clear);
    CHECK_EQUAL(ack.result, ORI_ACCEPTED);
}

/* Unasked ------------------------------------------------------------------------------------------------------ */

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

SUITE(messages, TEST(test_a_good_frame_is_answered), TEST(test_no_spoilt_frame_is_believed),
      TEST(test_frames_cut_short_are_not_believed), TEST(test_others_are_not_believed), TEST(test_signed_frames_are_not_believed),
      TEST(test_frames_of_the_first_mavlink_are_not_believed), TEST(test_what_only_a_device_says_is_no_word_of_the_host),
      TEST(test_frames_may_come_in_pieces_and_in_crowds), TEST(test_a_flood_does_not_keep_the_frame_waiting),
      TEST(test_the_clock_is_told), TEST(test_a_command_repeated_is_answered_and_not_carried_out),
      TEST(test_every_command_repeated_is_not_carried_out), TEST(test_the_state_is_told),
      TEST(test_all_reports_can_be_asked_for_at_once), TEST(test_the_device_says_what_it_is),
      TEST(test_a_configuration_is_written_and_read), TEST(test_clearing_tells_what_is_latched),
      TEST(test_the_heart_beats_every_second), TEST(test_events_are_told), TEST(test_the_log_of_a_start_and_of_latches),
      TEST(test_what_finds_no_room_waits), TEST(test_an_answer_without_room_is_given_again),
      TEST(test_the_watchdog_is_kicked_in_every_frame_and_only_there));
