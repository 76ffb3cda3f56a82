/* Fixed point on an 8-bit machine: 32 x 32 bits give 64, shifts by whole bytes cost nothing. */
#ifndef ORI_FIXED_H
#define ORI_FIXED_H

#include <stdint.h>

/* a * b / 2^16, rounded to nearest. */
static inline int32_t mul_q16(int32_t a, int32_t b)
{
    return (int32_t)(((int64_t)a * b + 0x8000) >> 16);
}

/* a * b / 2^32, rounded to nearest. */
static inline int32_t mul_q32(int32_t a, int32_t b)
{
    return (int32_t)(((int64_t)a * b + (INT64_C(1) << 31)) >> 32);
}

static inline int64_t abs64(int64_t a)
{
    return a < 0 ? -a : a;
}

static inline uint32_t distance(int32_t a, int32_t b)
{
    return a > b ? (uint32_t)a - (uint32_t)b : (uint32_t)b - (uint32_t)a;
}

#endif
