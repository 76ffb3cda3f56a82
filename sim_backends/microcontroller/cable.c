#include "cable.h"

#include "random.h"

cable_t cables[CABLE_DIRECTIONS];

void cable_seed(uint64_t seed) {
    for (uint64_t i = 0; i < CABLE_DIRECTIONS; i++) {
        cables[i].random = 2U * seed + i;
    }
}

size_t cable_pass(cable_direction_t direction, const uint8_t *from, size_t size, uint8_t *to) {
    cable_t *cable = &cables[direction];
    size_t n = 0;
    for (size_t i = 0; i < size; i++) {
        if (cable->cut) {
            cable->lost++;
            continue;
        }
        if (random_event(&cable->random, cable->noise)) {
            to[n++] = (uint8_t)random_next(&cable->random);
            cable->added++;
        }
        if (random_event(&cable->random, cable->drop)) {
            cable->lost++;
            continue;
        }
        uint8_t byte = from[i];
        if (random_event(&cable->random, cable->flip)) {
            byte ^= (uint8_t)(1U << (random_next(&cable->random) & 7U));
            cable->flipped++;
        }
        to[n++] = byte;
        cable->passed++;
    }
    return n;
}
