/* Fixed point on an 8-bit machine: 32 x 32 bits give 64, shifts by whole bytes cost nothing. */
#ifndef ORI_FIXED_H
#define ORI_FIXED_H

#include <stdint.h>

/* Products of 16 bits, each a few instructions on an 8-bit machine. They are functions of a file of their own: a
 * compiler that sees a factor used twice extends it to 32 bits first, and makes the product three times as long. */
uint32_t mul_uu(uint16_t a, uint16_t b);
int32_t mul_su(int16_t a, uint16_t b);
int32_t mul_ss(int16_t a, int16_t b);

static inline int16_t upper(int32_t a)
{
    return (int16_t)(a >> 16);
}

/* a * b / 2^16, rounded down. */
static inline int32_t scale_u16(int32_t a, uint16_t b)
{
    return mul_su(upper(a), b) + (int32_t)(mul_uu((uint16_t)a, b) >> 16);
}

/* The same with a sign. */
static inline int32_t scale_s16(int32_t a, int16_t b)
{
    return mul_ss(upper(a), b) + (mul_su(b, (uint16_t)a) >> 16);
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
