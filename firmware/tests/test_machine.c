/* The device as a whole: what it does when, driven by frames of a host and frames of time. */
#include <math.h>
#include <string.h>

#include "check.h"
#include "core.h"
#include "events.h"
#include "faults.h"
#include "hinges.h"
#include "latches.h"
#include "machine.h"
#include "queue.h"
#include "rig.h"

#define ALL 0x7U
#define STREAM 5U
#define STEP_US 20000U

/* The motion of most tests: all hinges from 0, 10 rad/s^2 for 100 ms, then 1 rad/s. */
static uint64_t begin_us;
static uint16_t sent;

static double motion(double s)
{
    return s <= 0 ? 0 : s < 0.1 ? 5 * s * s : 0.05 + (s - 0.1);
}

static double speed(double s)
{
    return s <= 0 ? 0 : s < 0.1 ? 10 * s : 1;
}

static void send_knot(uint16_t number)
{
    const double s = number * STEP_US * 1e-6;
    host_knot(STREAM, number, begin_us + (uint64_t)number * STEP_US, (int32_t)lround(motion(s) * 1e6),
              (int16_t)lround(speed(s) * 1e3));
}

static void enable_all(void)
{
    CHECK_EQUAL(host_enable(ALL, NULL, STREAM), ORI_ACCEPTED);
    begin_us = fake.micros + 3 * STEP_US;
    sent = 0;
}

/* Send all knots that begin within 200 ms. */
static void send_ahead(void)
{
    while (begin_us + (uint64_t)sent * STEP_US <= fake.micros + 200000)
        send_knot(sent++);
}

static void stream_for(unsigned frames)
{
    while (frames--) {
        send_ahead();
        frame_passes();
        hinges_follow();
    }
}

/* A device that has been moving at 1 rad/s for a while, with 200 ms queued. */
static void set_moving(void)
{
    rig_start();
    enable_all();
    stream_for(25);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
}

static double output(uint8_t hinge)
{
    return hinges_asked()[hinge] * 1e-6;
}

static void check_rests(void)
{
    int32_t before[ORI_HINGES];
    uint16_t servo[ORI_SERVO_OUTPUTS];
    memcpy(before, hinges_asked(), sizeof before);
    memcpy(servo, fake.servo, sizeof servo);
    for (unsigned i = 0; i < 30; i++) {
        frame_passes();
        hinges_follow();
        CHECK(memcmp(before, hinges_asked(), sizeof before) == 0);
        CHECK(memcmp(servo, fake.servo, sizeof servo) == 0);
    }
}

/* Goes on without the host until at rest: slower from frame to frame, and never back. Returns how many frames moved. */
static unsigned check_brakes(uint8_t hinge)
{
    double step = 1.0 * 0.02 + 3e-6, from = output(hinge);
    unsigned frames = 0;
    while (machine_state() == ORI_BRAKING || machine_state() == ORI_STREAMING) {
        frame_passes();
        hinges_follow();
        const double way = output(hinge) - from;
        CHECK(way >= 0 && way <= step);
        step = way + 3e-6;
        from = output(hinge);
        frames += way > 0;
        CHECK(frames < 100);
    }
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(machine_queued(), 0);
    return frames;
}

static void check_no_knot_is_taken(void)
{
    const uint16_t contiguous = machine_contiguous();
    const uint8_t queued = machine_queued();
    send_knot(contiguous);
    CHECK_EQUAL(machine_contiguous(), contiguous);
    CHECK_EQUAL(machine_queued(), queued);
}

static void check_outputs_are_off(void)
{
    for (unsigned i = 0; i < ORI_SERVO_OUTPUTS; i++)
        CHECK_EQUAL(fake.servo[i], 0);
    for (unsigned i = 0; i < ORI_MAGNET_OUTPUTS; i++)
        CHECK(!fake.magnet[i]);
}

/* Starting ---------------------------------------------------------------------------------------------------- */

static void test_nothing_moves_at_the_start(void)
{
    static const port_reset_t causes[] = {PORT_RESET_POWER, PORT_RESET_EXTERNAL, PORT_RESET_BROWN_OUT, PORT_RESET_WATCHDOG};
    static const uint8_t faults[] = {ORI_FAULT_NONE, ORI_FAULT_NONE, ORI_FAULT_BROWN_OUT, ORI_FAULT_WATCHDOG_RESET};
    for (unsigned i = 0; i < 4; i++) {
        rig_start();
        rig_restart(causes[i]);
        frames_pass(50);
        check_outputs_are_off();
        CHECK_EQUAL(fault_latched(), faults[i]);
        CHECK_EQUAL(machine_state(), faults[i] ? ORI_FAULTED : ORI_IDLE);
        CHECK_EQUAL(machine_contiguous() | machine_stream() | machine_queued(), 0);
    }
}

static void test_a_restart_under_way_leaves_nothing_on(void)
{
    set_moving();
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    rig_restart(PORT_RESET_WATCHDOG);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_WATCHDOG_RESET);
    CHECK_EQUAL(machine_contiguous() | machine_stream() | machine_queued(), 0);
    CHECK_EQUAL(host_state().outputs_on, 0);
    CHECK_EQUAL(host_latches().commanded, 0);
    check_no_knot_is_taken();
    frames_pass(10);
    check_outputs_are_off();
    CHECK_EQUAL(host_enable(ALL, NULL, STREAM), ORI_REFUSED_FAULT);
    CHECK_EQUAL(host_clear(ORI_FAULT_WATCHDOG_RESET), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    check_no_knot_is_taken();
    rig_restart(PORT_RESET_POWER);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
}

static void test_without_a_configuration_nothing_goes_on(void)
{
    fake_reset();
    memset(&config, 0, sizeof config);
    core_init();
    frames_pass(5);
    CHECK_EQUAL(machine_state(), ORI_UNCONFIGURED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    CHECK_EQUAL(host_enable(1, NULL, 1), ORI_REFUSED_STATE);
    CHECK_EQUAL(host_latch(0, 1), ORI_REFUSED_STATE);
    CHECK_EQUAL(host_clear(ORI_FAULT_STALL), ORI_ACCEPTED);
    fake.estop = true; /* nothing is watched yet */
    frames_pass(5);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    check_outputs_are_off();
}

static void damage_both_slots(void)
{
    fake.eeprom[40] ^= 1;
    fake.eeprom[1536 + 40] ^= 1;
}

static void configure_again(void)
{
    const mavlink_ori_config_device_t device = rig_device(1, 0);
    mavlink_ori_config_hinge_t hinge = rig_hinge(0);
    uint32_t found = 0;
    int32_t value = 0;
    CHECK_EQUAL(machine_config_begin(&device, &value), ORI_ACCEPTED);
    CHECK_EQUAL(config_add_hinge(&hinge), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_commit(rig_hash(&device, &hinge, NULL), &found), ORI_ACCEPTED);
}

static void test_damaged_configurations_are_a_fault_until_one_is_written(void)
{
    rig_start();
    damage_both_slots();
    rig_restart(PORT_RESET_POWER);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_CONFIG_CORRUPT);
    CHECK_EQUAL(host_clear(ORI_FAULT_CONFIG_CORRUPT), ORI_REFUSED_CAUSE);
    CHECK_EQUAL(host_latch(0, 1), ORI_REFUSED_INDEX);
    CHECK_EQUAL(host_enable(1, NULL, 1), ORI_REFUSED_FAULT);
    frames_pass(3);
    check_outputs_are_off();
    configure_again();
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    CHECK_EQUAL(host_enable(1, NULL, 1), ORI_ACCEPTED);
}

/* The reset's fault hides the damage, and does not take it away with it. */
static void test_damage_behind_another_fault_is_not_forgotten(void)
{
    rig_start();
    damage_both_slots();
    rig_restart(PORT_RESET_WATCHDOG);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_WATCHDOG_RESET);
    CHECK_EQUAL(host_clear(ORI_FAULT_WATCHDOG_RESET), ORI_ACCEPTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_CONFIG_CORRUPT);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(host_clear(ORI_FAULT_CONFIG_CORRUPT), ORI_REFUSED_CAUSE);
    configure_again();
    CHECK_EQUAL(machine_state(), ORI_IDLE);
}

/* Nor does a new configuration end any other fault. */
static void test_a_configuration_ends_no_other_fault(void)
{
    rig_start();
    rig_restart(PORT_RESET_BROWN_OUT);
    configure_again();
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_BROWN_OUT);
    CHECK_EQUAL(host_clear(ORI_FAULT_BROWN_OUT), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
}

static void test_a_reset_without_a_configuration_can_be_cleared(void)
{
    fake_reset();
    memset(&config, 0, sizeof config);
    fake.reset_cause = PORT_RESET_WATCHDOG;
    core_init();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_WATCHDOG_RESET);
    configure_again();
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(host_clear(ORI_FAULT_WATCHDOG_RESET), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
}

static void check_event(uint8_t code, uint8_t index, int32_t value)
{
    mavlink_ori_event_t event;
    CHECK(events_take(&event));
    CHECK_EQUAL(event.code, code);
    CHECK_EQUAL(event.index, index);
    CHECK_EQUAL(event.value, value);
}

/* Whatever the memory was before. */
static void test_the_log_of_a_start(void)
{
    mavlink_ori_event_t event;
    set_moving();
    while (events_take(&event))
        ;
    rig_restart(PORT_RESET_WATCHDOG);
    check_event(ORI_EVENT_BOOT, PORT_RESET_WATCHDOG, 0);
    check_event(ORI_EVENT_FAULT, ORI_FAULT_WATCHDOG_RESET, ORI_NOBODY);
    check_event(ORI_EVENT_STATE, ORI_FAULTED, ORI_UNCONFIGURED);
    check_event(ORI_EVENT_CONFIG, 0, (int32_t)config_hash());
    CHECK(!events_take(&event));
}

/* Enabling and disabling -------------------------------------------------------------------------------------- */

static void test_enabling_holds_where_things_are(void)
{
    const int32_t there[ORI_HINGES] = {100000, -200000, 300000};
    rig_start();
    rig_place(0, 0.1);
    rig_place(1, -0.2);
    rig_place(2, 0.3);
    CHECK_EQUAL(host_enable(ALL, there, 9), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(machine_stream(), 9);
    CHECK_EQUAL(machine_contiguous(), 0);
    CHECK_EQUAL(fake.servo[rig_hinge(1).channel], rig_ticks(1, -0.2));
    check_rests();
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE); /* silence at rest is none */
}

static void test_enabling_elsewhere_is_refused_and_told(void)
{
    mavlink_ori_enable_t enable = {.token = host_token(), .hinges = ALL, .stream = 9};
    rig_start();
    rig_place(1, 0.1);
    const mavlink_ori_ack_t ack = host_commands(KIND(ORI_ENABLE), &enable);
    CHECK_EQUAL(ack.result, ORI_REFUSED_POSITION);
    CHECK_EQUAL(ack.index, 1);
    CHECK_EQUAL(ack.value, 100000);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    CHECK_EQUAL(machine_stream(), 0);
    check_outputs_are_off();
    check_no_knot_is_taken();
}

static void test_enabling_nothing_stays_idle(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0, NULL, 3), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    CHECK_EQUAL(machine_stream(), 3);
    check_outputs_are_off();
}

static void test_more_hinges_go_on_while_others_hold(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0x1, NULL, 1), ORI_ACCEPTED);
    CHECK_EQUAL(host_enable(0x6, NULL, 2), ORI_ACCEPTED);
    CHECK_EQUAL(hinges_on(), 0x7);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(machine_stream(), 2);
}

static void test_enabling_is_refused_under_way(void)
{
    mavlink_ori_enable_t enable = {.token = host_token(), .hinges = ALL, .stream = 9};
    set_moving();
    const mavlink_ori_ack_t ack = host_commands(KIND(ORI_ENABLE), &enable);
    CHECK_EQUAL(ack.result, ORI_REFUSED_STATE);
    CHECK_EQUAL(ack.value, ORI_STREAMING);
    CHECK_EQUAL(machine_stream(), STREAM);
    stream_for(3);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
}

static void test_disabling(void)
{
    rig_start();
    CHECK_EQUAL(host_disable(ALL), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    enable_all();
    CHECK_EQUAL(host_disable(0x2), ORI_ACCEPTED);
    CHECK_EQUAL(hinges_on(), 0x5);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(host_disable(0x5), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    check_outputs_are_off();
}

static void test_what_moves_is_not_disabled(void)
{
    mavlink_ori_disable_t disable = {.token = host_token(), .hinges = ALL};
    set_moving();
    mavlink_ori_ack_t ack = host_commands(KIND(ORI_DISABLE), &disable);
    CHECK_EQUAL(ack.result, ORI_REFUSED_STATE);
    CHECK_EQUAL(ack.value, ORI_STREAMING);
    CHECK_EQUAL(hinges_on(), ALL);
    machine_brake();
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    disable.token = host_token();
    ack = host_commands(KIND(ORI_DISABLE), &disable);
    CHECK_EQUAL(ack.result, ORI_REFUSED_STATE);
    CHECK_EQUAL(ack.value, ORI_BRAKING);
    CHECK_EQUAL(hinges_on(), ALL);
    check_brakes(0);
    CHECK_EQUAL(host_disable(ALL), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    check_outputs_are_off();
}

/* Following --------------------------------------------------------------------------------------------------- */

/* What the device computes is for the frame after the one that runs. */
static void check_follows(unsigned frames)
{
    for (unsigned i = 0; i < frames; i++) {
        stream_for(1);
        const double s = ((double)fake.micros + ORI_FRAME_US - (double)begin_us) * 1e-6;
        for (uint8_t k = 0; k < RIG_HINGES; k++) {
            CHECK_NEAR(output(k), motion(s), 2e-6);
            CHECK_NEAR(fake.servo[rig_hinge(k).channel], rig_ticks(k, motion(s)), 1);
        }
    }
}

static void test_outputs_follow_the_knots(void)
{
    rig_start();
    enable_all();
    check_follows(60);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
}

static void test_time_may_wrap_around(void)
{
    rig_start();
    fake.micros = (UINT64_C(1) << 32) - 500000;
    enable_all();
    check_follows(60);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
}

/* Frames do not fall onto the knots. */
static void test_outputs_follow_between_the_knots(void)
{
    rig_start();
    fake.micros += 7321;
    enable_all();
    begin_us += 3456;
    check_follows(60);
}

static void test_a_motion_that_ends_holds_and_the_next_one_begins(void)
{
    rig_start();
    enable_all();
    for (unsigned round = 0; round < 3; round++) {
        const int32_t from = (int32_t)round * 10000;
        const uint16_t number = (uint16_t)(2 * round);
        const uint64_t at = fake.micros + 60000;
        host_knot(STREAM, number, at, from, 0);
        host_knot(STREAM, (uint16_t)(number + 1), at + 100000, from + 10000, 0);
        CHECK_EQUAL(machine_state(), ORI_STREAMING);
        CHECK_EQUAL(machine_queued(), 2);
        frames_pass(2);
        CHECK_EQUAL(hinges_asked()[0], from);
        frames_pass(4);
        CHECK_EQUAL(machine_state(), ORI_STREAMING);
        CHECK_EQUAL(machine_queued(), 2);
        frames_pass(1);
        CHECK_EQUAL(hinges_asked()[0], from + 10000);
        CHECK_EQUAL(machine_state(), ORI_HOLDING);
        CHECK_EQUAL(machine_queued(), 0);
        CHECK_EQUAL(machine_contiguous(), number + 2);
        frames_pass(10);
    }
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
}

static void test_hinges_that_are_off_stay_off(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0x5, NULL, STREAM), ORI_ACCEPTED);
    begin_us = fake.micros + 3 * STEP_US;
    sent = 0;
    stream_for(40);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
    CHECK_EQUAL(fake.servo[rig_hinge(1).channel], 0);
    CHECK(output(0) > 0.3 && output(2) > 0.3);
}

/* Knots ------------------------------------------------------------------------------------------------------- */

static void test_knots_are_taken_once_and_in_order(void)
{
    rig_start();
    enable_all();
    send_knot(1);
    CHECK_EQUAL(machine_contiguous(), 0); /* the one before is missing */
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    send_knot(0);
    CHECK_EQUAL(machine_contiguous(), 1);
    send_knot(0);
    send_knot(0);
    CHECK_EQUAL(machine_contiguous(), 1);
    CHECK_EQUAL(machine_queued(), 1);
    send_knot(2);
    CHECK_EQUAL(machine_contiguous(), 1);
    send_knot(1);
    send_knot(2);
    CHECK_EQUAL(machine_contiguous(), 3);
    send_knot(1);
    CHECK_EQUAL(machine_contiguous(), 3);
    CHECK_EQUAL(machine_queued(), 3);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
}

static mavlink_ori_setpoints_t two_knots(uint16_t first)
{
    mavlink_ori_setpoints_t setpoints = {.first = first, .count = 2, .stream = STREAM};
    for (unsigned j = 0; j < 2; j++) {
        const double s = (first + j) * STEP_US * 1e-6;
        setpoints.time_us[j] = (uint32_t)(begin_us + (uint64_t)(first + j) * STEP_US);
        for (unsigned k = 0; k < ORI_HINGES; k++) {
            setpoints.position_urad[j * ORI_HINGES + k] = (int32_t)lround(motion(s) * 1e6) + (int32_t)(k * j);
            setpoints.velocity_mrad_s[j * ORI_HINGES + k] = (int16_t)(lround(speed(s) * 1e3) + (long)(k * j));
        }
    }
    return setpoints;
}

static void test_two_knots_come_in_a_message(void)
{
    rig_start();
    enable_all();
    mavlink_ori_setpoints_t setpoints = two_knots(0);
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(machine_contiguous(), 2);
    CHECK_EQUAL(queue_first()->position_urad[2], 0);
    CHECK_EQUAL(queue_last()->position_urad[2], setpoints.position_urad[ORI_HINGES + 2]);
    CHECK_EQUAL(queue_last()->velocity_mrad_s[2], 202);
    CHECK_EQUAL(queue_last()->time_us, setpoints.time_us[1]);
    setpoints = two_knots(1); /* the first of them it had */
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(machine_contiguous(), 3);
    CHECK_EQUAL(machine_queued(), 3);
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(machine_contiguous(), 3);
    setpoints = two_knots(4);
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(machine_contiguous(), 3);
}

static void test_messages_that_make_no_sense_are_ignored(void)
{
    static const uint8_t counts[] = {0, 3, 255};
    rig_start();
    enable_all();
    mavlink_ori_setpoints_t setpoints = two_knots(0);
    for (unsigned i = 0; i < 3; i++) {
        setpoints.count = counts[i];
        host_says(KIND(ORI_SETPOINTS), &setpoints);
        CHECK_EQUAL(machine_contiguous(), 0);
    }
    setpoints = two_knots(0);
    setpoints.stream = STREAM + 1;
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(machine_contiguous(), 0);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
}

static void test_nothing_is_taken_before_a_stream_is_open(void)
{
    rig_start();
    begin_us = fake.micros + 60000;
    host_knot(0, 0, begin_us, 0, 0);
    CHECK_EQUAL(machine_contiguous(), 0);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
}

static void test_a_full_queue_lets_the_host_repeat(void)
{
    rig_start();
    enable_all();
    for (uint16_t i = 0; i < 25; i++)
        send_knot(i);
    CHECK_EQUAL(machine_queued(), QUEUE_KNOTS);
    CHECK_EQUAL(machine_contiguous(), QUEUE_KNOTS);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    for (unsigned i = 0; i < 3; i++)
        frame_passes(); /* the third one's output is at the second knot */
    CHECK_EQUAL(machine_queued(), QUEUE_KNOTS - 1);
    send_knot(QUEUE_KNOTS);
    CHECK_EQUAL(machine_contiguous(), QUEUE_KNOTS + 1);
    CHECK_EQUAL(machine_queued(), QUEUE_KNOTS);
}

static void test_numbers_wrap_around(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0, NULL, STREAM), ORI_ACCEPTED);
    begin_us = fake.micros + 60000;
    mavlink_ori_setpoints_t setpoints = {.count = 1, .stream = STREAM};
    for (uint32_t i = 0; i < 65540; i++) {
        setpoints.first = (uint16_t)i;
        setpoints.time_us[0] = (uint32_t)(begin_us + (uint64_t)i * 1000);
        machine_setpoints(&setpoints); /* so many frames would take their time */
        machine_heard(fake.micros);
        if (machine_queued() > 15) {
            fake.micros = begin_us + (uint64_t)i * 1000 - 30000;
            core_frame(fake.micros);
        }
        CHECK_EQUAL(machine_contiguous(), (uint16_t)(i + 1));
    }
}

static uint8_t first_knot(int64_t ahead_us, int32_t position_urad, int16_t velocity_mrad_s)
{
    rig_start();
    CHECK_EQUAL(host_enable(0x6, NULL, STREAM), ORI_ACCEPTED);
    mavlink_ori_setpoints_t setpoints = {.count = 1, .stream = STREAM};
    setpoints.time_us[0] = (uint32_t)((int64_t)fake.micros + ahead_us);
    setpoints.position_urad[1] = position_urad;
    setpoints.velocity_mrad_s[1] = velocity_mrad_s;
    setpoints.position_urad[0] = 500000; /* hinge 0 is off: it matters not */
    setpoints.velocity_mrad_s[0] = 5;
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(fault_index(), fault_latched() == ORI_FAULT_DISCONTINUITY ? 1 : ORI_NOBODY);
    CHECK_EQUAL(machine_state(), fault_latched() ? ORI_FAULTED : ORI_STREAMING);
    CHECK_EQUAL(machine_contiguous(), fault_latched() ? 0 : 1);
    return fault_latched();
}

static void test_a_motion_begins_at_rest_where_the_outputs_are(void)
{
    CHECK_EQUAL(first_knot(100000, 0, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(first_knot(100000, 200, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(first_knot(100000, -200, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(first_knot(100000, 201, 0), ORI_FAULT_DISCONTINUITY);
    CHECK_EQUAL(first_knot(100000, -201, 0), ORI_FAULT_DISCONTINUITY);
    CHECK_EQUAL(first_knot(100000, 0, 1), ORI_FAULT_DISCONTINUITY);
    CHECK_EQUAL(first_knot(100000, 0, -1), ORI_FAULT_DISCONTINUITY);
}

/* Outputs are computed up to two frames ahead: what lies nearer would be caught up with in a jump. */
static void test_a_motion_begins_neither_late_nor_far_away(void)
{
    CHECK_EQUAL(first_knot(40000, 0, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(first_knot(39999, 0, 0), ORI_FAULT_KNOT_TIME);
    CHECK_EQUAL(first_knot(0, 0, 0), ORI_FAULT_KNOT_TIME);
    CHECK_EQUAL(first_knot(-1, 0, 0), ORI_FAULT_KNOT_TIME);
    CHECK_EQUAL(first_knot(2000000, 0, 0), ORI_FAULT_NONE);
    CHECK_EQUAL(first_knot(2000001, 0, 0), ORI_FAULT_KNOT_TIME);
    CHECK_EQUAL(first_knot(INT64_C(1) << 31, 0, 0), ORI_FAULT_KNOT_TIME);
}

static void test_knots_beyond_the_limits_are_faults(void)
{
    static const struct {
        int32_t position_urad;
        int16_t velocity_mrad_s;
        uint32_t after_us;
        uint8_t fault;
    } cases[] = {
        {1500001, 0, 20000, ORI_FAULT_POSITION_LIMIT},
        {-1000001, 0, 20000, ORI_FAULT_POSITION_LIMIT},
        {0, 2001, 20000, ORI_FAULT_VELOCITY_LIMIT},
        {100000, 0, 20000, ORI_FAULT_VELOCITY_LIMIT},
        {3000, 0, 20000, ORI_FAULT_ACCELERATION_LIMIT},
        {0, 0, 999, ORI_FAULT_KNOT_TIME},
        {0, 0, 1000001, ORI_FAULT_KNOT_TIME},
    };
    for (unsigned i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        rig_start();
        enable_all();
        send_knot(0);
        host_knot(STREAM, 1, begin_us + cases[i].after_us, cases[i].position_urad, cases[i].velocity_mrad_s);
        CHECK_EQUAL(fault_latched(), cases[i].fault);
        CHECK_EQUAL(fault_index(), cases[i].fault == ORI_FAULT_KNOT_TIME ? ORI_NOBODY : 0);
        CHECK_EQUAL(machine_contiguous(), 1);
        CHECK_EQUAL(machine_state(), ORI_BRAKING);
        check_no_knot_is_taken();
        for (unsigned n = 0; n < 10; n++)
            frame_passes();
        CHECK_EQUAL(machine_state(), ORI_FAULTED);
        CHECK_EQUAL(hinges_asked()[0], 0);
        CHECK_EQUAL(hinges_on(), ALL);
    }
}

/* The first of a stream as well. */
static void test_the_first_knot_is_within_the_limits_too(void)
{
    rig_start();
    enable_all();
    host_knot(STREAM, 0, begin_us, 1500001, 0);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_POSITION_LIMIT);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(machine_queued(), 0);
    check_rests();
}

/* Of two knots in a message the second is not taken when the first is refused. */
static void test_a_refused_knot_ends_its_message(void)
{
    rig_start();
    enable_all();
    mavlink_ori_setpoints_t setpoints = two_knots(0);
    setpoints.position_urad[0] = 300;
    host_says(KIND(ORI_SETPOINTS), &setpoints);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_DISCONTINUITY);
    CHECK_EQUAL(machine_contiguous(), 0);
    CHECK_EQUAL(machine_queued(), 0);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
}

/* Silence and underrun ---------------------------------------------------------------------------------------- */

/* The host falls silent at every phase of a frame; at rest no later than silence_ms and a frame after its last word. */
static void test_silence_brakes_in_time(void)
{
    for (unsigned phase = 0; phase < 20; phase++) {
        set_moving();
        for (unsigned i = 0; i < 8; i++)
            send_knot(sent++); /* enough is queued */
        fake.micros += phase * 1000;
        host_polls();
        const uint64_t last_word = fake.micros;
        fake.micros -= phase * 1000;
        double at = output(1);
        uint64_t rests_from = 0;
        while (machine_state() != ORI_FAULTED) {
            frame_passes();
            hinges_follow();
            if (output(1) != at)
                rests_from = fake.micros + 2 * ORI_FRAME_US; /* this frame's output is reached at the end of the next */
            at = output(1);
            if (fake.micros - last_word < (SILENCE_MS - BRAKE_MS - 20) * 1000 && fake.micros > last_word)
                CHECK_EQUAL(machine_state(), ORI_STREAMING); /* not before it has to */
        }
        CHECK_EQUAL(fault_latched(), ORI_FAULT_HOST_SILENT);
        CHECK_EQUAL(fault_index(), ORI_NOBODY);
        CHECK(rests_from - ORI_FRAME_US <= last_word + (SILENCE_MS + 20) * 1000);
        check_rests();
        CHECK_EQUAL(hinges_on(), ALL);
    }
}

static void test_any_word_of_the_host_ends_its_silence(void)
{
    set_moving();
    for (unsigned i = 0; i < 10; i++)
        send_knot(sent++);
    for (unsigned i = 0; i < 12; i++) {
        if (i % 3 == 2)
            host_polls();
        frame_passes();
        hinges_follow();
    }
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
}

static void test_noise_is_no_word(void)
{
    static const uint8_t noise[] = {0xfd, 3, 0, 0, 1, 255, 190, 0x55, 0xd3, 0, 1, 2, 3, 0, 0, 0xfe, 9, 8};
    set_moving();
    for (unsigned i = 0; i < 10; i++)
        send_knot(sent++);
    for (unsigned i = 0; i < 15; i++) {
        fake_type(noise, sizeof noise);
        core_poll();
        frame_passes();
        hinges_follow();
    }
    CHECK_EQUAL(fault_latched(), ORI_FAULT_HOST_SILENT);
}

static void test_an_underrun_brakes_on_what_is_queued(void)
{
    set_moving();
    const double end = motion((sent - 1) * STEP_US * 1e-6);
    unsigned frames = 0;
    while (machine_state() == ORI_STREAMING) {
        frames_pass(1);
        frames++;
    }
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_UNDERRUN);
    CHECK_EQUAL(fault_index(), ORI_NOBODY);
    CHECK(frames >= 5); /* of ten knots queued, three and a half are needed */
    check_brakes(2);
    CHECK(output(2) < end);
    check_rests();
}

/* What the frame that comes next will find to be left after what has been done so far. */
static int32_t left_us(void)
{
    return (int32_t)(queue_last()->time_us - (uint32_t)(fake.micros + ORI_FRAME_US));
}

/* Stream with the knots shifted, so that at some frame exactly so much is left. */
static uint8_t state_with_left(int32_t us)
{
    rig_start();
    enable_all();
    begin_us += (uint64_t)us % STEP_US;
    for (uint16_t i = 0; i < 19; i++)
        send_knot(i);
    do
        frames_pass(1);
    while (left_us() > us);
    CHECK_EQUAL(left_us(), us);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
    frames_pass(1);
    return machine_state();
}

/* It does not run low before less is left than half of the braking and two frames, to the microsecond. */
static void test_as_much_as_is_needed_is_no_underrun(void)
{
    CHECK_EQUAL(state_with_left(70000), ORI_STREAMING);
    CHECK_EQUAL(state_with_left(69999), ORI_BRAKING);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_UNDERRUN);
}

/* Nor is silence too long before what is left of silence_ms is what braking and its two frames take. */
static void test_silence_is_counted_to_the_microsecond(void)
{
    for (uint64_t early = 0; early < 2; early++) {
        set_moving();
        for (unsigned i = 0; i < 8; i++)
            send_knot(sent++);
        host_polls();
        fake.micros += 50000 - early; /* with the frame's 20 ms these are 150 - 60 - 20 ms */
        frame_passes();
        CHECK_EQUAL(machine_state(), early ? ORI_STREAMING : ORI_BRAKING);
    }
}

/* A first knot that lies ahead is waited for, and one alone ends its motion. */
static void test_a_knot_alone_is_waited_for(void)
{
    rig_start();
    enable_all();
    host_knot(STREAM, 0, fake.micros + 100000, 0, 0);
    for (unsigned i = 0; i < 4; i++) {
        CHECK_EQUAL(machine_state(), ORI_STREAMING);
        CHECK_EQUAL(machine_queued(), 1);
        frames_pass(1); /* the fourth one's output is that of its time */
    }
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
}

static void test_a_queue_that_ends_at_rest_runs_out_without_a_fault(void)
{
    rig_start();
    enable_all();
    host_knot(STREAM, 0, begin_us, 0, 0);
    host_knot(STREAM, 1, begin_us + 50000, 12500, 500);
    host_knot(STREAM, 2, begin_us + 100000, 25000, 0);
    frames_pass(20);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    CHECK_EQUAL(hinges_asked()[1], 25000);
}

/* Braking ------------------------------------------------------------------------------------------------------ */

static void test_the_host_can_brake(void)
{
    const mavlink_ori_brake_t brake = {.token = 4321};
    set_moving();
    CHECK_EQUAL(host_commands(KIND(ORI_BRAKE), &brake).result, ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_HOST_BRAKE);
    CHECK_EQUAL(fault_index(), ORI_NOBODY);
    const double from = output(0);
    CHECK_EQUAL(check_brakes(0), BRAKE_MS / 20);
    CHECK_NEAR(output(0) - from, 1.0 * BRAKE_MS * 1e-3 / 2, 5e-6);
    check_no_knot_is_taken();
    check_rests();
    CHECK_EQUAL(host_clear(ORI_FAULT_HOST_BRAKE), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    machine_brake();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
}

/* Any time of braking uses up its half of the profile, in as many frames as it has; the end is never a jerk. */
static void test_braking_takes_its_time(void)
{
    for (uint16_t brake_ms = 20; brake_ms < 110; brake_ms++) {
        set_moving();
        config.device.brake_ms = brake_ms;
        send_ahead();
        const double from = output(1);
        machine_brake();
        unsigned frames = 0;
        while (machine_state() == ORI_BRAKING) {
            frame_passes();
            hinges_follow();
            frames++;
        }
        CHECK_EQUAL(frames, (brake_ms + 19U) / 20U);
        CHECK_NEAR(output(1) - from, brake_ms * 0.5e-3, 1e-5);
    }
}

static void test_a_motion_that_has_not_begun_does_not_begin(void)
{
    rig_start();
    enable_all();
    for (uint16_t i = 0; i < 10; i++)
        send_knot(i);
    frame_passes();
    machine_brake();
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    for (unsigned i = 0; i < 10; i++)
        frame_passes();
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK(hinges_asked()[0] < 1000); /* 10 ms of 10 rad/s^2 at most */
    check_rests();
}

/* Braking may reach the end of a motion first. */
static void test_braking_ends_where_the_queue_ends(void)
{
    rig_start();
    enable_all();
    host_knot(STREAM, 0, begin_us, 0, 0);
    host_knot(STREAM, 1, begin_us + 50000, 8000, 0);
    while (fake.micros + ORI_FRAME_US + 15000 < begin_us + 50000)
        frames_pass(1);
    machine_brake();
    frames_pass(1);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(hinges_asked()[0], 8000);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_HOST_BRAKE);
}

static void test_a_second_fault_while_braking_changes_nothing(void)
{
    set_moving();
    machine_brake();
    frame_passes();
    fake.estop = true;
    fake.adc[ORI_ADC_SUPPLY] = 0;
    check_brakes(1);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_HOST_BRAKE);
    mavlink_ori_event_t event;
    while (events_take(&event))
        ;
    check_rests();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_HOST_BRAKE);
    CHECK(!events_take(&event)); /* what is found again in every frame is not told again */
    /* The cleared one makes room for what is still wrong. */
    CHECK_EQUAL(host_clear(ORI_FAULT_HOST_BRAKE), ORI_ACCEPTED);
    frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
}

/* A second motion after a fault runs at its full speed. */
static void test_after_braking_a_motion_runs_as_ever(void)
{
    set_moving();
    machine_brake();
    check_brakes(0);
    CHECK_EQUAL(host_clear(ORI_FAULT_HOST_BRAKE), ORI_ACCEPTED);
    check_no_knot_is_taken();
    int32_t there[ORI_HINGES];
    memcpy(there, hinges_asked(), sizeof there);
    hinges_follow();
    CHECK_EQUAL(host_enable(ALL, there, STREAM), ORI_ACCEPTED);
    CHECK_EQUAL(machine_contiguous(), 0);
    const uint64_t at = fake.micros + 60000;
    host_knot(STREAM, 0, at, there[0], 0);
    host_knot(STREAM, 1, at + 200000, there[0] + 20000, 0);
    frames_pass(7);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
    const double u = (double)(fake.micros + ORI_FRAME_US - at) / 200000;
    CHECK_NEAR(hinges_asked()[0] - there[0], 20000 * u * u * (3 - 2 * u), 2);
    frames_pass(10);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(hinges_asked()[0], there[0] + 20000);
}

static void test_the_second_time_braking_is_as_gentle(void)
{
    for (unsigned round = 0; round < 3; round++) {
        if (round == 0)
            set_moving();
        else
            stream_for(12);
        CHECK_EQUAL(machine_state(), ORI_STREAMING);
        machine_brake();
        CHECK_EQUAL(check_brakes(0), BRAKE_MS / 20);
        CHECK_EQUAL(host_clear(ORI_FAULT_HOST_BRAKE), ORI_ACCEPTED);
        CHECK_EQUAL(host_disable(ALL), ORI_ACCEPTED);
        for (uint8_t i = 0; i < RIG_HINGES; i++)
            rig_place(i, 0); /* by hand */
        enable_all();
    }
}

/* Faults ------------------------------------------------------------------------------------------------------- */

static void test_a_stalled_hinge_goes_off_and_the_others_brake(void)
{
    set_moving();
    for (unsigned i = 0; i < 6; i++) { /* 40 ms of them within 0.1 rad */
        send_ahead();
        frame_passes();
        hinges_follow();
        rig_place(1, 0.2);
    }
    while (machine_state() == ORI_STREAMING) {
        send_ahead();
        frame_passes();
        hinges_follow();
        rig_place(1, 0.2);
    }
    CHECK_EQUAL(fault_latched(), ORI_FAULT_STALL);
    CHECK_EQUAL(fault_index(), 1);
    CHECK_EQUAL(hinges_on(), 0x5);
    CHECK_EQUAL(fake.servo[rig_hinge(1).channel], 0);
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    check_brakes(0);
    CHECK_EQUAL(hinges_on(), 0x5);
    CHECK_EQUAL(fake.servo[rig_hinge(1).channel], 0);
    check_rests();
    CHECK_EQUAL(host_state().stalled, 0x2);
    CHECK_EQUAL(host_clear(ORI_FAULT_STALL), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(host_state().stalled, 0);
}

static void test_a_stall_at_rest(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0x1, NULL, STREAM), ORI_ACCEPTED);
    rig_place(0, 0.5);
    for (unsigned i = 0; i < 6; i++) {
        CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
        host_polls();
        frame_passes();
    }
    CHECK_EQUAL(fault_latched(), ORI_FAULT_STALL);
    CHECK_EQUAL(fault_index(), 0);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(hinges_on(), 0);
    CHECK_EQUAL(host_clear(ORI_FAULT_STALL), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE); /* none is on any more */
}

/* A hinge may also stall behind a fault that is latched: it goes off all the same. */
static void test_a_stall_behind_another_fault(void)
{
    rig_start();
    enable_all();
    fake.estop = true;
    frames_pass(1);
    rig_place(2, 0.5);
    for (unsigned i = 0; i < 6; i++)
        frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(hinges_on(), 0x3);
}

static void test_the_emergency_stop(void)
{
    set_moving();
    fake.estop = true;
    frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(fault_index(), ORI_NOBODY);
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    check_no_knot_is_taken();
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_REFUSED_STATE);
    check_brakes(0);
    check_rests();
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_REFUSED_CAUSE);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    fake.estop = false;
    CHECK_EQUAL(host_clear(ORI_FAULT_STALL), ORI_REFUSED_STATE);
    CHECK_EQUAL(host_clear(ORI_FAULT_NONE), ORI_REFUSED_STATE);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(host_enable(ALL, hinges_asked(), STREAM), ORI_REFUSED_FAULT);
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_ACCEPTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_ACCEPTED); /* none is latched */
}

static void test_the_emergency_stop_at_rest(void)
{
    rig_start();
    fake.estop = true;
    frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    fake.estop = false;
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
}

static void test_a_sagging_supply(void)
{
    set_moving();
    fake.adc[ORI_ADC_SUPPLY] = 499;
    stream_for(4);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
    fake.adc[ORI_ADC_SUPPLY] = 500;
    stream_for(1);
    fake.adc[ORI_ADC_SUPPLY] = 499;
    stream_for(4);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
    stream_for(1);
    CHECK_EQUAL(machine_state(), ORI_BRAKING);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_SUPPLY_LOW);
    CHECK_EQUAL(fault_index(), ORI_NOBODY);
    check_brakes(0);
    CHECK_EQUAL(host_clear(ORI_FAULT_SUPPLY_LOW), ORI_REFUSED_CAUSE);
    fake.adc[ORI_ADC_SUPPLY] = 600;
    CHECK_EQUAL(host_clear(ORI_FAULT_SUPPLY_LOW), ORI_ACCEPTED);
    frames_pass(5);
    CHECK_EQUAL(machine_state(), ORI_HOLDING);
}

static void test_the_causes_of_other_faults_do_not_matter(void)
{
    rig_start();
    rig_restart(PORT_RESET_WATCHDOG);
    fake.estop = true;
    fake.adc[ORI_ADC_SUPPLY] = 0;
    CHECK_EQUAL(host_clear(ORI_FAULT_WATCHDOG_RESET), ORI_ACCEPTED);
    frame_passes();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    fake.estop = false;
    CHECK_EQUAL(host_clear(ORI_FAULT_ESTOP), ORI_ACCEPTED);
    frames_pass(5);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_SUPPLY_LOW);
}

/* What cannot be is a fault for good. */
static void test_an_empty_queue_under_way_is_an_internal_fault(void)
{
    rig_start();
    enable_all();
    begin_us += 7000; /* so that no output is at a knot */
    stream_for(25);
    const double at = output(0);
    queue_clear();
    frame_passes();
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK(fault_latched() != ORI_FAULT_NONE);
    CHECK_NEAR(output(0), at, 0);
    rig_start();
    enable_all();
    host_knot(STREAM, 0, begin_us, 0, 0); /* a knot at rest: nothing runs low */
    queue_clear();
    frame_passes();
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_INTERNAL);
    CHECK_EQUAL(fault_index(), ORI_NOBODY);
    CHECK_EQUAL(host_clear(ORI_FAULT_INTERNAL), ORI_REFUSED_CAUSE);
}

/* Latches ------------------------------------------------------------------------------------------------------ */

static void test_faults_and_silence_move_no_latch(void)
{
    set_moving();
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    CHECK_EQUAL(host_latch(1, 1), ORI_ACCEPTED);
    const uint16_t pin = fake.servo[rig_latch(1).output];
    const unsigned calls = fake.magnet_calls;
    CHECK(fake.magnet[1] && pin == 3800);
    while (machine_state() != ORI_FAULTED)
        frame_passes();
    fake.estop = true;
    for (unsigned i = 0; i < 20; i++)
        frame_passes();
    CHECK(fake.magnet[1]);
    CHECK_EQUAL(fake.servo[rig_latch(1).output], pin);
    CHECK_EQUAL(fake.magnet_calls, calls);
    /* Commands are taken all the same. */
    CHECK_EQUAL(host_latch(1, 0), ORI_ACCEPTED);
    CHECK_EQUAL(fake.servo[rig_latch(1).output], 2200);
    CHECK_EQUAL(host_latch(3, 1), ORI_REFUSED_INDEX);
}

static void test_magnets_protect_themselves_during_a_fault(void)
{
    rig_start();
    fake.estop = true;
    frame_passes();
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    for (unsigned i = 0; i < 50; i++)
        frame_passes();
    CHECK(!fake.magnet[1]);
    CHECK_EQUAL(host_latch(0, 1), ORI_REFUSED_TRIPPED);
    CHECK_EQUAL(host_latches().tripped, 0x1);
}

/* Each is told with its own number. */
static void test_magnets_that_trip_are_told_apart(void)
{
    mavlink_ori_event_t event;
    rig_start();
    config.latch[2] = rig_latch(0); /* a second magnet */
    config.latch[2].output = 5;
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    CHECK_EQUAL(host_latch(2, 1), ORI_ACCEPTED);
    while (events_take(&event))
        ;
    for (unsigned i = 0; i < 50; i++)
        frame_passes();
    for (uint8_t i = 0; i < 3; i += 2) {
        CHECK(events_take(&event));
        CHECK_EQUAL(event.code, ORI_EVENT_LATCH_TRIPPED);
        CHECK_EQUAL(event.index, i);
        CHECK_EQUAL(event.value, 0);
    }
    CHECK(!events_take(&event));
}

/* Configurations ------------------------------------------------------------------------------------------------ */

static void test_configuring_needs_everything_off(void)
{
    const mavlink_ori_config_device_t device = rig_device(0, 0);
    const uint32_t hash = rig_hash(&device, NULL, NULL);
    uint32_t found = 0;
    int32_t value = -1;
    rig_start();
    CHECK_EQUAL(host_enable(0x4, NULL, 1), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_begin(&device, &value), ORI_REFUSED_STATE);
    CHECK_EQUAL(value, ORI_HOLDING);
    CHECK_EQUAL(host_disable(0x4), ORI_ACCEPTED);
    CHECK_EQUAL(host_latch(1, 1), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_begin(&device, &value), ORI_REFUSED_STATE);
    CHECK_EQUAL(value, ORI_IDLE);
    CHECK_EQUAL(host_latch(1, 0), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_begin(&device, &value), ORI_ACCEPTED);
    CHECK_EQUAL(host_enable(0x4, NULL, 1), ORI_ACCEPTED); /* the old one is in force until the end */
    CHECK_EQUAL(machine_config_commit(hash, &found), ORI_REFUSED_STATE);
    CHECK_EQUAL(found, ORI_HOLDING);
    CHECK_EQUAL(hinges_on(), 0x4);
    CHECK_EQUAL(host_disable(0x4), ORI_ACCEPTED);
    CHECK_EQUAL(host_latch(0, 1), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_commit(hash, &found), ORI_REFUSED_STATE);
    CHECK(fake.magnet[1]);
    CHECK_EQUAL(host_latch(0, 0), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_commit(hash, &found), ORI_ACCEPTED);
    CHECK_EQUAL(found, hash);
    CHECK_EQUAL(config_hash(), hash);
}

static void test_a_refused_configuration_changes_nothing(void)
{
    const mavlink_ori_config_device_t device = rig_device(0, 0);
    uint32_t found = 0;
    int32_t value = 0;
    rig_start();
    const uint32_t old = config_hash();
    fake.estop = true;
    frame_passes();
    fake.estop = false;
    CHECK_EQUAL(machine_config_begin(&device, &value), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_commit(12345, &found), ORI_REFUSED_HASH);
    CHECK_EQUAL(found, rig_hash(&device, NULL, NULL));
    CHECK_EQUAL(config_hash(), old);
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
    CHECK_EQUAL(machine_state(), ORI_FAULTED);
}

static void test_a_new_configuration_begins_afresh(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0, NULL, STREAM), ORI_ACCEPTED);
    begin_us = fake.micros + 100000;
    host_knot(STREAM, 0, begin_us, 0, 0);
    CHECK_EQUAL(machine_queued(), 1);
    configure_again();
    CHECK_EQUAL(machine_queued(), 0);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
    host_knot(STREAM, 1, begin_us + 20000, 0, 0); /* the stream is closed */
    CHECK_EQUAL(machine_queued(), 0);
    check_outputs_are_off();
}

static void test_clearing_without_hinges_on_is_idle(void)
{
    rig_start();
    CHECK_EQUAL(host_enable(0, NULL, STREAM), ORI_ACCEPTED);
    host_knot(STREAM, 0, fake.micros + 500000, 0, 0);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
    machine_brake();
    for (unsigned i = 0; i < 10; i++)
        frame_passes();
    CHECK_EQUAL(host_clear(ORI_FAULT_HOST_BRAKE), ORI_ACCEPTED);
    CHECK_EQUAL(machine_state(), ORI_IDLE);
}

SUITE(machine, TEST(test_nothing_moves_at_the_start), TEST(test_a_restart_under_way_leaves_nothing_on),
      TEST(test_without_a_configuration_nothing_goes_on), TEST(test_damaged_configurations_are_a_fault_until_one_is_written),
      TEST(test_damage_behind_another_fault_is_not_forgotten), TEST(test_a_configuration_ends_no_other_fault),
      TEST(test_a_reset_without_a_configuration_can_be_cleared), TEST(test_enabling_holds_where_things_are),
      TEST(test_enabling_elsewhere_is_refused_and_told), TEST(test_enabling_nothing_stays_idle),
      TEST(test_more_hinges_go_on_while_others_hold), TEST(test_enabling_is_refused_under_way), TEST(test_disabling),
      TEST(test_what_moves_is_not_disabled), TEST(test_outputs_follow_the_knots), TEST(test_time_may_wrap_around),
      TEST(test_outputs_follow_between_the_knots), TEST(test_a_motion_that_ends_holds_and_the_next_one_begins),
      TEST(test_hinges_that_are_off_stay_off), TEST(test_knots_are_taken_once_and_in_order),
      TEST(test_two_knots_come_in_a_message), TEST(test_messages_that_make_no_sense_are_ignored),
      TEST(test_nothing_is_taken_before_a_stream_is_open), TEST(test_a_full_queue_lets_the_host_repeat),
      TEST(test_numbers_wrap_around), TEST(test_a_motion_begins_at_rest_where_the_outputs_are),
      TEST(test_a_motion_begins_neither_late_nor_far_away), TEST(test_knots_beyond_the_limits_are_faults),
      TEST(test_the_first_knot_is_within_the_limits_too), TEST(test_a_refused_knot_ends_its_message),
      TEST(test_silence_brakes_in_time), TEST(test_any_word_of_the_host_ends_its_silence), TEST(test_noise_is_no_word),
      TEST(test_an_underrun_brakes_on_what_is_queued), TEST(test_as_much_as_is_needed_is_no_underrun),
      TEST(test_silence_is_counted_to_the_microsecond), TEST(test_a_knot_alone_is_waited_for),
      TEST(test_a_queue_that_ends_at_rest_runs_out_without_a_fault), TEST(test_the_host_can_brake),
      TEST(test_braking_takes_its_time), TEST(test_a_motion_that_has_not_begun_does_not_begin),
      TEST(test_braking_ends_where_the_queue_ends), TEST(test_a_second_fault_while_braking_changes_nothing),
      TEST(test_after_braking_a_motion_runs_as_ever),
      TEST(test_the_second_time_braking_is_as_gentle), TEST(test_a_stalled_hinge_goes_off_and_the_others_brake),
      TEST(test_a_stall_at_rest), TEST(test_a_stall_behind_another_fault), TEST(test_the_emergency_stop),
      TEST(test_the_emergency_stop_at_rest), TEST(test_a_sagging_supply), TEST(test_the_causes_of_other_faults_do_not_matter),
      TEST(test_an_empty_queue_under_way_is_an_internal_fault), TEST(test_faults_and_silence_move_no_latch),
      TEST(test_magnets_protect_themselves_during_a_fault),
      TEST(test_magnets_that_trip_are_told_apart), TEST(test_the_log_of_a_start), TEST(test_configuring_needs_everything_off),
      TEST(test_a_refused_configuration_changes_nothing), TEST(test_a_new_configuration_begins_afresh),
      TEST(test_clearing_without_hinges_on_is_idle));
