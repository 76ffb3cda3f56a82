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
    for (uint8_t fault = 0; fault < ORI_FAULT_ENUM_END; fault++) {
        if (fault == ORI_FAULT_INTERNAL)
            continue;
        CHECK(!fault_trip(fault, 9));
        CHECK_EQUAL(fault_latched(), ORI_FAULT_STALL);
        CHECK_EQUAL(fault_index(), 3);
    }
}

static void test_none_is_no_fault(void)
{
    CHECK(!fault_trip(ORI_FAULT_NONE, 1));
    CHECK_EQUAL(fault_index(), ORI_NOBODY);
}

static void test_any_fault_is_graver_than_the_hosts_wish(void)
{
    for (uint8_t fault = 1; fault < ORI_FAULT_ENUM_END; fault++) {
        fault_forget();
        CHECK(fault_trip(ORI_FAULT_HOST_BRAKE, ORI_NOBODY));
        CHECK_EQUAL(fault_trip(fault, 4), fault != ORI_FAULT_HOST_BRAKE);
        CHECK_EQUAL(fault_latched(), fault);
        CHECK_EQUAL(fault_index(), fault == ORI_FAULT_HOST_BRAKE ? ORI_NOBODY : 4);
        CHECK(!fault_trip(ORI_FAULT_HOST_BRAKE, 5));
        CHECK_EQUAL(fault_latched(), fault);
    }
}

/* What only power ends is not cleared with what came first. */
static void test_a_permanent_fault_is_hidden_by_none(void)
{
    CHECK(fault_trip(ORI_FAULT_UNDERRUN, ORI_NOBODY));
    CHECK(fault_trip(ORI_FAULT_INTERNAL, 7));
    CHECK_EQUAL(fault_latched(), ORI_FAULT_INTERNAL);
    CHECK_EQUAL(fault_index(), 7);
    CHECK(!fault_trip(ORI_FAULT_INTERNAL, 8));
    CHECK(!fault_trip(ORI_FAULT_ESTOP, 8));
    CHECK_EQUAL(fault_index(), 7);
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

SUITE(faults, TEST(test_nothing_is_latched_at_first), TEST(test_the_first_fault_stays), TEST(test_none_is_no_fault),
      TEST(test_any_fault_is_graver_than_the_hosts_wish), TEST(test_a_permanent_fault_is_hidden_by_none), TEST(test_what_is_forgotten_is_gone),
      TEST(test_each_ends_as_it_should), TEST(test_unknown_faults_are_permanent));
