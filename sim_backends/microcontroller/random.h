/* A small generator for faults: the same seed, the same faults. */
#ifndef ORI_RANDOM_H
#define ORI_RANDOM_H

#include <stdint.h>

static inline uint64_t random_next(uint64_t *state) {
    uint64_t z = *state += 0x9E3779B97F4A7C15U;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBU;
    return z ^ (z >> 31);
}

/* Whether an event of this probability, in millionths, happens. */
static inline int random_event(uint64_t *state, uint32_t millionths) {
    return millionths != 0U && random_next(state) % 1000000U < millionths;
}

#endif
