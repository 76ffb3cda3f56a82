/* The supply: volts per count, and how long it may be low. */
#include <string.h>

#include "check.h"
#include "fake_port.h"
#include "supply.h"

static void set_up(uint32_t uv_per_count, uint16_t min_mv)
{
    fake_reset();
    memset(&config, 0, sizeof config);
    config.device.supply_uv_per_count = uv_per_count;
    config.device.supply_min_mv = min_mv;
}

static void reads(uint16_t count)
{
    fake.adc[ORI_ADC_SUPPLY] = count;
}

static void test_counts_are_millivolts(void)
{
    set_up(14663, 0);
    reads(0);
    CHECK_EQUAL(supply_mv(), 0);
    reads(512);
    CHECK_EQUAL(supply_mv(), 7507); /* 512 * 14.663 = 7507.456 */
    reads(1023);
    CHECK_EQUAL(supply_mv(), 15000);
}

static void test_the_most_is_no_more_than_fits(void)
{
    set_up(64063, 0);
    reads(1023);
    CHECK_EQUAL(supply_mv(), 65535); /* 65536.4 */
    set_up(64062, 0);
    reads(1023);
    CHECK_EQUAL(supply_mv(), 65535); /* 65535.4 */
    set_up(64061, 0);
    reads(1023);
    CHECK_EQUAL(supply_mv(), 65534);
    set_up(UINT32_MAX, 0);
    reads(1023);
    CHECK_EQUAL(supply_mv(), 65535);
}

static void test_the_limit_itself_is_enough(void)
{
    set_up(10000, 5000);
    reads(500);
    CHECK(!supply_is_low());
    reads(499);
    CHECK(supply_is_low());
}

static void test_nothing_is_low_when_none_is_watched(void)
{
    set_up(10000, 0);
    reads(0);
    for (unsigned i = 0; i < 20; i++)
        CHECK(!supply_step(true));
}

static void test_low_for_five_frames_is_low(void)
{
    set_up(10000, 5000);
    reads(400);
    for (unsigned i = 1; i < 5; i++)
        CHECK(!supply_step(true));
    for (unsigned i = 0; i < 600; i++) /* and for ever */
        CHECK(supply_step(true));
}

static void test_a_good_frame_begins_anew(void)
{
    set_up(10000, 5000);
    for (unsigned round = 0; round < 3; round++) {
        reads(400);
        for (unsigned i = 0; i < 4; i++)
            CHECK(!supply_step(true));
        reads(600);
        CHECK(!supply_step(true));
    }
    reads(400);
    for (unsigned i = 0; i < 5; i++)
        CHECK_EQUAL(supply_step(true), i == 4);
    reads(600);
    CHECK(!supply_step(true));
}

static void test_it_counts_while_something_is_driven(void)
{
    set_up(10000, 5000);
    reads(400);
    for (unsigned i = 0; i < 50; i++)
        CHECK(!supply_step(false));
    for (unsigned i = 0; i < 5; i++)
        CHECK_EQUAL(supply_step(true), i == 4);
    CHECK(!supply_step(false));
    CHECK(!supply_step(true));
}

SUITE(supply, TEST(test_counts_are_millivolts), TEST(test_the_most_is_no_more_than_fits), TEST(test_the_limit_itself_is_enough),
      TEST(test_nothing_is_low_when_none_is_watched), TEST(test_low_for_five_frames_is_low), TEST(test_a_good_frame_begins_anew),
      TEST(test_it_counts_while_something_is_driven));
