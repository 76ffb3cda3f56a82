#include "motion.h"

#include <math.h>
#include <string.h>

#include "check.h"
#include "hinges.h"
#include "machine.h"

uint64_t begin_us;
uint16_t sent;

double motion(double s)
{
    return s <= 0 ? 0 : s < 0.1 ? 5 * s * s : 0.05 + (s - 0.1);
}

double speed(double s)
{
    return s <= 0 ? 0 : s < 0.1 ? 10 * s : 1;
}

void send_knot(uint16_t number)
{
    const double s = number * STEP_US * 1e-6;
    host_knot(STREAM, number, begin_us + (uint64_t)number * STEP_US, (int32_t)lround(motion(s) * 1e6),
              (int16_t)lround(speed(s) * 1e3));
}

void enable_all(void)
{
    CHECK_EQUAL(host_enable(ALL, NULL, STREAM), ORI_ACCEPTED);
    begin_us = fake.micros + 3 * STEP_US;
    sent = 0;
}

void send_ahead(void)
{
    while (begin_us + (uint64_t)sent * STEP_US <= fake.micros + 200000)
        send_knot(sent++);
}

void stream_for(unsigned frames)
{
    while (frames--) {
        send_ahead();
        frame_passes();
        hinges_follow();
    }
}

void set_moving(void)
{
    rig_start();
    enable_all();
    stream_for(25);
    CHECK_EQUAL(machine_state(), ORI_STREAMING);
}

double output(uint8_t hinge)
{
    return hinges_asked()[hinge] * 1e-6;
}

void check_rests(void)
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

unsigned check_brakes(uint8_t hinge)
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

void check_no_knot_is_taken(void)
{
    const uint16_t contiguous = machine_contiguous();
    const uint8_t queued = machine_queued();
    send_knot(contiguous);
    CHECK_EQUAL(machine_contiguous(), contiguous);
    CHECK_EQUAL(machine_queued(), queued);
}

void check_outputs_are_off(void)
{
    for (unsigned i = 0; i < ORI_SERVO_OUTPUTS; i++)
        CHECK_EQUAL(fake.servo[i], 0);
    for (unsigned i = 0; i < ORI_MAGNET_OUTPUTS; i++)
        CHECK(!fake.magnet[i]);
}

void configure_again(void)
{
    const mavlink_ori_config_device_t device = rig_device(1, 0);
    mavlink_ori_config_hinge_t hinge = rig_hinge(0);
    uint8_t index = ORI_NOBODY;
    int32_t value = 0;
    CHECK_EQUAL(machine_config_begin(&device, &index, &value), ORI_ACCEPTED);
    CHECK_EQUAL(config_add_hinge(&hinge), ORI_ACCEPTED);
    CHECK_EQUAL(machine_config_commit(rig_hash(&device, &hinge, NULL), &index, &value), ORI_ACCEPTED);
}
