/* Answers: each command is carried out once, and told what became of it. */
#include <string.h>

#include "check.h"
#include "core.h"
#include "faults.h"
#include "machine.h"
#include "rig.h"
#include "version.h"

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

/* Whatever was refused in a state, the state is told. */
static void test_a_refusal_tells_the_state(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0x1, NULL, 3), ORI_ACCEPTED);
    mavlink_ori_config_device_t device = rig_device(1, 0);
    device.token = host_token();
    mavlink_ori_ack_t ack = host_commands(KIND(ORI_CONFIG_DEVICE), &device);
    CHECK_EQUAL(ack.result, ORI_REFUSED_STATE);
    CHECK_EQUAL(ack.value, ORI_HOLDING);
    mavlink_ori_config_hinge_t hinge = rig_hinge(0); /* nothing was begun */
    hinge.token = host_token();
    ack = host_commands(KIND(ORI_CONFIG_HINGE), &hinge);
    CHECK_EQUAL(ack.result, ORI_REFUSED_STATE);
    CHECK_EQUAL(ack.value, ORI_HOLDING);
    const mavlink_ori_config_commit_t commit = {.token = host_token(), .hash = 1};
    ack = host_commands(KIND(ORI_CONFIG_COMMIT), &commit);
    CHECK_EQUAL(ack.result, ORI_REFUSED_STATE);
    CHECK_EQUAL(ack.value, ORI_HOLDING);
    host_knot(3, 0, fake.micros + 60000, 0, 0);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
    const mavlink_ori_disable_t disable = {.token = host_token(), .hinges = 0x1};
    ack = host_commands(KIND(ORI_DISABLE), &disable);
    CHECK_EQUAL(ack.result, ORI_REFUSED_STATE);
    CHECK_EQUAL(ack.value, ORI_STREAMING);
    machine_brake();
    const mavlink_ori_fault_clear_t clear = {.token = host_token(), .fault = ORI_FAULT_HOST_BRAKE};
    ack = host_commands(KIND(ORI_FAULT_CLEAR), &clear);
    CHECK_EQUAL(ack.result, ORI_REFUSED_STATE);
    CHECK_EQUAL(ack.value, ORI_BRAKING);
}

static void test_clearing_tells_what_is_latched(void)
{
    rig_start();
    rig_restart(PORT_RESET_BROWN_OUT);
    mavlink_ori_fault_clear_t clear = {.token = host_token(), .fault = ORI_FAULT_STALL};
    mavlink_ori_ack_t ack = host_commands(KIND(ORI_FAULT_CLEAR), &clear);
    CHECK_EQUAL(ack.result, ORI_REFUSED_FAULT);
    CHECK_EQUAL(ack.value, ORI_FAULT_BROWN_OUT);
    mavlink_ori_enable_t enable = {.token = host_token()};
    ack = host_commands(KIND(ORI_ENABLE), &enable);
    CHECK_EQUAL(ack.result, ORI_REFUSED_FAULT);
    CHECK_EQUAL(ack.value, ORI_FAULT_BROWN_OUT);
    clear = (mavlink_ori_fault_clear_t){.token = host_token(), .fault = ORI_FAULT_BROWN_OUT};
    ack = host_commands(KIND(ORI_FAULT_CLEAR), &clear);
    CHECK_EQUAL(ack.result, ORI_ACCEPTED);
}

SUITE(messages_answers, TEST(test_the_clock_is_told), TEST(test_a_command_repeated_is_answered_and_not_carried_out),
      TEST(test_every_command_repeated_is_not_carried_out), TEST(test_the_state_is_told),
      TEST(test_all_reports_can_be_asked_for_at_once), TEST(test_the_device_says_what_it_is),
      TEST(test_a_configuration_is_written_and_read), TEST(test_a_refusal_tells_the_state),
      TEST(test_clearing_tells_what_is_latched));
