/* The servos' supply. While something is driven, low for several frames in a row is a fault; a dip of one is not. While
 * nothing is, it may be off; then nothing goes on. */
#ifndef ORI_SUPPLY_H
#define ORI_SUPPLY_H

#include "config.h"

#define SUPPLY_LOW_FRAMES 5U

uint16_t supply_mv(void);
bool supply_is_low(void);

/* Once a frame: whether it has been low for long enough, and something driven all the while. */
bool supply_step(bool driven);

#endif
