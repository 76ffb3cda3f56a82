#include "fixed.h"

uint32_t mul_uu(uint16_t a, uint16_t b)
{
    return (uint32_t)a * b;
}

int32_t mul_su(int16_t a, uint16_t b)
{
    return (int32_t)a * (int32_t)(uint32_t)b;
}

int32_t mul_ss(int16_t a, int16_t b)
{
    return (int32_t)a * b;
}
