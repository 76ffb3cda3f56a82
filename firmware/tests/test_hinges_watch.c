/* Hinges: who does not follow goes off, and who falls silent is told. */
#include "hinge_bench.h"

/* Farther than 0.1 rad for longer than 100 ms. */
static void test_a_hinge_that_does_not_follow_goes_off(void)
{
    const int32_t position[ORI_HINGES] = {100000, 100000, 100000};
    set_up(3);
    CHECK_EQUAL(enable(0x7, at_zero), ORI_ACCEPTED);
    hinges_output(position);
    rig_place(0, 0.1);
    rig_place(2, 0.1);
    for (unsigned i = 0; i < 50; i++)
        CHECK_EQUAL(sense(), ORI_NOBODY); /* hinge 1 is 0.1 rad away, and no farther */
    rig_place(1, -0.004);
    for (unsigned i = 0; i < 5; i++)
        CHECK_EQUAL(sense(), ORI_NOBODY);
    CHECK_EQUAL(sense(), 1);
    CHECK_EQUAL(hinges_on(), 0x5);
    CHECK_EQUAL(hinges_stalled(), 0x2);
    CHECK_EQUAL(fake.servo[rig_hinge(1).channel], 0);
    CHECK_EQUAL(hinges_asked()[1], 0);
    for (unsigned i = 0; i < 50; i++)
        CHECK_EQUAL(sense(), ORI_NOBODY);
    CHECK_EQUAL(fake.servo[rig_hinge(0).channel], rig_ticks(0, 0.1));
}

static void test_stalling_takes_as_long_as_it_may(void)
{
    static const uint16_t times_ms[] = {0, 19, 20, 100, 1000, 10000};
    for (unsigned i = 0; i < sizeof times_ms / sizeof times_ms[0]; i++) {
        set_up(1);
        config.device.stall_ms = times_ms[i];
        CHECK_EQUAL(enable(1, at_zero), ORI_ACCEPTED);
        rig_place(0, 0.5);
        for (unsigned n = 0; n < times_ms[i] / 20U; n++)
            CHECK_EQUAL(sense(), ORI_NOBODY);
        CHECK_EQUAL(sense(), 0);
    }
}

static void test_a_hinge_that_catches_up_has_its_time_again(void)
{
    set_up(1);
    CHECK_EQUAL(enable(1, at_zero), ORI_ACCEPTED);
    for (unsigned round = 0; round < 3; round++) {
        rig_place(0, 0.5);
        for (unsigned i = 0; i < 5; i++)
            CHECK_EQUAL(sense(), ORI_NOBODY);
        rig_place(0, -0.1);
        CHECK_EQUAL(sense(), ORI_NOBODY);
    }
    /* So has one that was turned off and on, */
    rig_place(0, 0.5);
    for (unsigned i = 0; i < 5; i++)
        CHECK_EQUAL(sense(), ORI_NOBODY);
    hinges_disable(1);
    const int32_t there[ORI_HINGES] = {500000};
    CHECK_EQUAL(enable(1, there), ORI_ACCEPTED);
    rig_place(0, 0);
    for (unsigned i = 0; i < 5; i++)
        CHECK_EQUAL(sense(), ORI_NOBODY);
    /* but not one that was enabled again while it was on. */
    CHECK_EQUAL(enable(1, at_zero), ORI_ACCEPTED);
    CHECK_EQUAL(sense(), 0);
}

static void test_a_stalled_hinge_stays_off_until_it_is_forgiven(void)
{
    int32_t value;
    set_up(1);
    CHECK_EQUAL(enable(1, at_zero), ORI_ACCEPTED);
    rig_place(0, 0.5);
    while (sense() == ORI_NOBODY)
        ;
    CHECK_EQUAL(enable_one(0, 500000, &value), ORI_REFUSED_TRIPPED);
    hinges_forgive();
    CHECK_EQUAL(hinges_stalled(), 0);
    CHECK_EQUAL(enable_one(0, 500000, &value), ORI_ACCEPTED);
}

static void test_who_cannot_tell_does_not_stall(void)
{
    set_up(2);
    config.hinge[1].flags = 0;
    CHECK_EQUAL(enable(3, at_zero), ORI_ACCEPTED);
    count_of(0, 3);
    count_of(1, 900);
    for (unsigned i = 0; i < 50; i++)
        CHECK(hinges_sense().fault != ORI_FAULT_STALL);
    CHECK_EQUAL(hinges_on(), 3);
}

static verdict_t sense_for(unsigned frames)
{
    verdict_t verdict = {ORI_FAULT_NONE, ORI_NOBODY};
    while (frames--)
        verdict = hinges_sense();
    return verdict;
}

static void test_feedback_is_lost_after_some_frames(void)
{
    static const uint16_t counts[] = {0, 19, 1001, 1023};
    for (unsigned i = 0; i < 4; i++) {
        set_up(3);
        CHECK_EQUAL(enable(7, at_zero), ORI_ACCEPTED);
        count_of(1, counts[i]);
        CHECK_EQUAL(sense_for(5).fault, ORI_FAULT_NONE);
        CHECK_EQUAL(hinges_lost(), ORI_NOBODY);
        for (unsigned n = 0; n < 300; n++) { /* and for ever */
            const verdict_t verdict = hinges_sense();
            CHECK_EQUAL(verdict.fault, ORI_FAULT_FEEDBACK_LOST);
            CHECK_EQUAL(verdict.hinge, 1);
            CHECK_EQUAL(hinges_lost(), 1);
        }
        CHECK_EQUAL(hinges_on(), 7); /* it goes on holding */
        rig_place(1, 0);
        CHECK_EQUAL(sense_for(1).fault, ORI_FAULT_NONE);
        CHECK_EQUAL(hinges_lost(), ORI_NOBODY);
    }
}

static void test_a_noisy_reading_loses_no_feedback(void)
{
    set_up(1);
    CHECK_EQUAL(enable(1, at_zero), ORI_ACCEPTED);
    for (unsigned i = 0; i < 20; i++) {
        count_of(0, i % 2 ? 0 : 1023);
        CHECK_EQUAL(sense_for(5).fault, ORI_FAULT_NONE);
        rig_place(0, 0);
        CHECK_EQUAL(sense_for(1).fault, ORI_FAULT_NONE);
    }
}

/* One without feedback has none to lose, nor has one that is off; and one that goes on again begins anew. */
static void test_feedback_counts_while_a_hinge_is_on(void)
{
    set_up(2);
    config.hinge[1].flags = 0;
    count_of(0, 0);
    count_of(1, 0);
    CHECK_EQUAL(enable(2, at_zero), ORI_ACCEPTED);
    CHECK_EQUAL(sense_for(50).fault, ORI_FAULT_NONE);
    rig_place(0, 0);
    CHECK_EQUAL(enable(1, at_zero), ORI_ACCEPTED);
    count_of(0, 0);
    CHECK_EQUAL(sense_for(6).fault, ORI_FAULT_FEEDBACK_LOST);
    hinges_disable(1);
    CHECK_EQUAL(hinges_lost(), ORI_NOBODY);
    rig_place(0, 0);
    CHECK_EQUAL(enable(1, at_zero), ORI_ACCEPTED);
    count_of(0, 0);
    CHECK_EQUAL(sense_for(5).fault, ORI_FAULT_NONE);
    hinges_disable(1);
    rig_place(0, 0);
    CHECK_EQUAL(enable(1, at_zero), ORI_ACCEPTED);
    count_of(0, 0);
    CHECK_EQUAL(sense_for(5).fault, ORI_FAULT_NONE);
    CHECK_EQUAL(sense_for(1).fault, ORI_FAULT_FEEDBACK_LOST);
}

/* A hinge that went off is told first. */
static void test_a_stall_is_told_before_lost_feedback(void)
{
    set_up(2);
    CHECK_EQUAL(enable(3, at_zero), ORI_ACCEPTED);
    rig_place(0, 0.5);
    count_of(1, 0);
    CHECK_EQUAL(sense_for(5).fault, ORI_FAULT_NONE);
    verdict_t verdict = hinges_sense();
    CHECK_EQUAL(verdict.fault, ORI_FAULT_STALL);
    CHECK_EQUAL(verdict.hinge, 0);
    verdict = hinges_sense();
    CHECK_EQUAL(verdict.fault, ORI_FAULT_FEEDBACK_LOST);
    CHECK_EQUAL(verdict.hinge, 1);
}

static void test_who_is_off_does_not_stall(void)
{
    set_up(3);
    CHECK_EQUAL(enable(0x5, at_zero), ORI_ACCEPTED);
    rig_place(1, 0.5); /* moved by hand */
    for (unsigned i = 0; i < 50; i++)
        CHECK_EQUAL(sense(), ORI_NOBODY);
    CHECK_EQUAL(hinges_stalled(), 0);
}

static void test_several_stall_at_once(void)
{
    set_up(3);
    CHECK_EQUAL(enable(7, at_zero), ORI_ACCEPTED);
    rig_place(0, 0.5);
    rig_place(1, 0.5);
    uint8_t lame = ORI_NOBODY;
    for (unsigned i = 0; i < 6; i++)
        lame = sense();
    CHECK(lame == 0 || lame == 1);
    CHECK_EQUAL(hinges_on(), 4);
    CHECK_EQUAL(hinges_stalled(), 3);
}

SUITE(hinges_watch, TEST(test_a_hinge_that_does_not_follow_goes_off), TEST(test_stalling_takes_as_long_as_it_may),
      TEST(test_a_hinge_that_catches_up_has_its_time_again), TEST(test_a_stalled_hinge_stays_off_until_it_is_forgiven),
      TEST(test_who_cannot_tell_does_not_stall), TEST(test_feedback_is_lost_after_some_frames),
      TEST(test_a_noisy_reading_loses_no_feedback), TEST(test_feedback_counts_while_a_hinge_is_on),
      TEST(test_a_stall_is_told_before_lost_feedback), TEST(test_who_is_off_does_not_stall),
      TEST(test_several_stall_at_once));
