/* What a bad cable does to bytes, in each direction: loses them, flips bits, puts noise between them, is cut. */
#ifndef ORI_CABLE_H
#define ORI_CABLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef enum { CABLE_TO_DEVICE, CABLE_FROM_DEVICE, CABLE_DIRECTIONS } cable_direction_t;

typedef struct {
    uint32_t drop, flip, noise; /* probabilities per byte, in millionths */
    bool cut;
    uint64_t random, passed, lost, flipped, added;
} cable_t;

extern cable_t cables[CABLE_DIRECTIONS];

void cable_seed(uint64_t seed);

/* Passes bytes on; `to` has room for twice as many. */
size_t cable_pass(cable_direction_t direction, const uint8_t *from, size_t size, uint8_t *to);

#endif
