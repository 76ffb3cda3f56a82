/* The fault table: the first one stays, and each ends as it should. */
#include "check.h"
#include "faults.h"

static void test_nothing_is_latched_at_first(void)
{
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_index(), ORI_NOBODY);
}

static void test_the_first_fault_stays(void)
{
    CHECK(fault_trip(ORI_FAULT_STALL, 3));
    for (uint8_t fault = 1; fault < ORI_FAULT_ENUM_END; fault++) {
        CHECK(!fault_trip(fault, 9));
        CHECK_EQUAL(fault_latched(), ORI_FAULT_STALL);
        CHECK_EQUAL(fault_index(), 3);
    }
}

static void test_what_is_forgotten_is_gone(void)
{
    CHECK(fault_trip(ORI_FAULT_UNDERRUN, 1));
    fault_forget();
    CHECK_EQUAL(fault_latched(), ORI_FAULT_NONE);
    CHECK_EQUAL(fault_index(), ORI_NOBODY);
    CHECK(fault_trip(ORI_FAULT_ESTOP, ORI_NOBODY));
    CHECK_EQUAL(fault_latched(), ORI_FAULT_ESTOP);
}

static void test_each_ends_as_it_should(void)
{
    for (uint8_t fault = 0; fault < ORI_FAULT_ENUM_END; fault++) {
        const fault_end_t expected = fault == ORI_FAULT_CONFIG_CORRUPT ? UNTIL_CONFIGURED
                                     : fault == ORI_FAULT_INTERNAL     ? PERMANENT
                                                                       : CLEARABLE;
        CHECK_EQUAL(fault_end(fault), expected);
    }
}

static void test_unknown_faults_are_permanent(void)
{
    CHECK_EQUAL(fault_end(ORI_FAULT_ENUM_END), PERMANENT);
    CHECK_EQUAL(fault_end(255), PERMANENT);
}

SUITE(faults, TEST(test_nothing_is_latched_at_first), TEST(test_the_first_fault_stays), TEST(test_what_is_forgotten_is_gone),
      TEST(test_each_ends_as_it_should), TEST(test_unknown_faults_are_permanent));
