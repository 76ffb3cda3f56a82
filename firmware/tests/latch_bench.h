/* Latches without a machine around them. Records go straight into what is in force. */
#ifndef ORI_LATCH_BENCH_H
#define ORI_LATCH_BENCH_H

#include <string.h>

#include "check.h"
#include "latches.h"
#include "rig.h"

static inline void set_up(uint8_t latches)
{
    fake_reset();
    memset(&config, 0, sizeof config);
    config.device = rig_device(0, latches);
    for (uint8_t i = 0; i < latches; i++)
        config.latch[i] = rig_latch(i);
    latches_init();
}

static inline mavlink_ori_latch_state_t report(void)
{
    mavlink_ori_latch_state_t state;
    memset(&state, 0xa5, sizeof state);
    latches_report(&state);
    return state;
}

static inline void steps(unsigned count)
{
    while (count--)
        latches_step();
}

#endif
