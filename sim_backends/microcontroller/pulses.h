/* A record of servo pulses, for whoever asks. Times in units of the emulation's own clock, so that they are exact. */
#ifndef ORI_PULSES_H
#define ORI_PULSES_H

#include <stdint.h>

#define PULSES_KEPT 65536U

typedef struct {
    uint64_t rise;
    uint32_t width;
    uint32_t channel;
} pulse_t;

/* Whole pulses since the last `pulses_forget`; the oldest go first when there are more than PULSES_KEPT. */
void pulses_record(uint32_t channel, uint64_t rise, uint64_t width);
uint64_t pulses_count(void);
uint64_t pulses_first(void); /* number of the oldest that is kept */
const pulse_t *pulses_at(uint64_t number);
void pulses_forget(void);

#endif
