/* Hinges without a machine around them. Records go straight into what is in force. */
#ifndef ORI_HINGE_BENCH_H
#define ORI_HINGE_BENCH_H

#include <string.h>

#include "check.h"
#include "hinges.h"
#include "rig.h"

static const int32_t at_zero[ORI_HINGES];

static inline void set_up(uint8_t hinges)
{
    fake_reset();
    memset(&config, 0, sizeof config);
    config.device = rig_device(hinges, 0);
    for (uint8_t k = 0; k < hinges; k++) {
        config.hinge[k] = rig_hinge(k);
        rig_place(k, 0);
    }
    hinges_init();
}

static inline uint8_t enable(uint16_t which, const int32_t *position_urad)
{
    uint8_t index = ORI_NOBODY;
    int32_t value = 0;
    return hinges_enable(which, position_urad, &index, &value);
}

static inline uint8_t enable_one(uint8_t hinge, int32_t position_urad, int32_t *value)
{
    int32_t position[ORI_HINGES] = {0};
    uint8_t index = ORI_NOBODY;
    position[hinge] = position_urad;
    const uint8_t result = hinges_enable((uint16_t)(1U << hinge), position, &index, value);
    CHECK_EQUAL(index, hinge);
    return result;
}

/* The hinge that stalled, or has lost its feedback. */
static inline uint8_t sense(void)
{
    return hinges_sense().hinge;
}

static inline void count_of(uint8_t hinge, uint16_t count)
{
    fake.adc[rig_hinge(hinge).adc] = count;
}

#endif
