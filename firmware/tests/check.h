/* Checks that say what was expected, and tests with names. A check that fails ends its test. */
#ifndef ORI_CHECK_H
#define ORI_CHECK_H

#include <stdint.h>

typedef struct {
    const char *name;
    void (*run)(void);
} test_t;

typedef struct {
    const char *name;
    const test_t *tests;
    unsigned count;
} suite_t;

#define TEST(function) {#function, function}
#define SUITE(subject, ...) \
    static const test_t subject##_tests[] = {__VA_ARGS__}; \
    const suite_t suite_##subject = {#subject, subject##_tests, sizeof subject##_tests / sizeof subject##_tests[0]}

_Noreturn void check_failed(const char *file, int line, const char *format, ...);
void check_equal(const char *file, int line, const char *text, int64_t found, int64_t expected);
void check_near(const char *file, int line, const char *text, double found, double expected, double tolerance);

#define CHECK(condition) ((condition) ? (void)0 : check_failed(__FILE__, __LINE__, "%s", #condition))
#define CHECK_EQUAL(found, expected) check_equal(__FILE__, __LINE__, #found, (int64_t)(found), (int64_t)(expected))
#define CHECK_NEAR(found, expected, tolerance) \
    check_near(__FILE__, __LINE__, #found, (double)(found), (double)(expected), (double)(tolerance))

/* A seeded generator, the same on every machine. */
uint32_t random_below(uint32_t *seed, uint32_t bound);
int32_t random_between(uint32_t *seed, int32_t low, int32_t high);

#endif
