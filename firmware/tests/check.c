#include "check.h"

#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <unistd.h>

/* Every test runs in a process of its own: leaving it is leaving the test. */
void check_failed(const char *file, int line, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    fprintf(stderr, "    %s:%d: ", file, line);
    vfprintf(stderr, format, arguments);
    fputc('\n', stderr);
    va_end(arguments);
    fflush(stderr);
    _exit(1);
}

void check_equal(const char *file, int line, const char *text, int64_t found, int64_t expected)
{
    if (found != expected)
        check_failed(file, line, "%s is %" PRId64 ", not %" PRId64, text, found, expected);
}

void check_near(const char *file, int line, const char *text, double found, double expected, double tolerance)
{
    if (!(fabs(found - expected) <= tolerance))
        check_failed(file, line, "%s is %.9g, not within %g of %.9g", text, found, tolerance, expected);
}

/* xorshift32: good enough to vary cases with. */
static uint32_t next(uint32_t *seed)
{
    uint32_t x = *seed ? *seed : 1;
    x ^= x << 13;
    x ^= x >> 17;
    x ^= x << 5;
    return *seed = x;
}

uint32_t random_below(uint32_t *seed, uint32_t bound)
{
    return (uint32_t)(((uint64_t)next(seed) * bound) >> 32);
}

int32_t random_between(uint32_t *seed, int32_t low, int32_t high)
{
    return (int32_t)(low + (int64_t)random_below(seed, (uint32_t)((int64_t)high - low + 1)));
}
