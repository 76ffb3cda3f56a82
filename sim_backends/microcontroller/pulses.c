#include "pulses.h"

static pulse_t kept[PULSES_KEPT];
static uint64_t count, forgotten;

void pulses_record(uint32_t channel, uint64_t rise, uint64_t width) {
    kept[count % PULSES_KEPT] = (pulse_t){.rise = rise, .width = (uint32_t)width, .channel = channel};
    count++;
}

uint64_t pulses_count(void) {
    return count;
}

uint64_t pulses_first(void) {
    uint64_t overwritten = count > PULSES_KEPT ? count - PULSES_KEPT : 0U;
    return overwritten > forgotten ? overwritten : forgotten;
}

const pulse_t *pulses_at(uint64_t number) {
    return &kept[number % PULSES_KEPT];
}

void pulses_forget(void) {
    forgotten = count;
}
