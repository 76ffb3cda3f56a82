/* A host that falls silent, and queues that run low. */
#include "check.h"
#include "core.h"
#include "faults.h"
#include "hinges.h"
#include "machine.h"
#include "motion.h"
#include "queue.h"

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

SUITE(machine_silence, TEST(test_silence_brakes_in_time), TEST(test_any_word_of_the_host_ends_its_silence),
      TEST(test_noise_is_no_word), TEST(test_an_underrun_brakes_on_what_is_queued),
      TEST(test_as_much_as_is_needed_is_no_underrun), TEST(test_silence_is_counted_to_the_microsecond),
      TEST(test_a_knot_alone_is_waited_for), TEST(test_a_queue_that_ends_at_rest_runs_out_without_a_fault));
