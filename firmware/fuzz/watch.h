/* What must be true of the device at every step, whatever it is told: watched from outside. */
#ifndef ORI_WATCH_H
#define ORI_WATCH_H

#include <stdbool.h>
#include <stdint.h>

#include "wire.h"

/* What a step has in it that may change something. */
typedef struct {
    bool enable, disable, latch, clear, config; /* a message of this kind was among the bytes */
    bool valid;                                 /* any message that is a word of the host */
    bool frame;                                 /* a frame passed */
    uint8_t cleared;                            /* the fault that a clear named */
} step_t;

/* The device has just started. */
void watch_begin(void);
/* A step is over: check everything. */
void watch_step(const step_t *step);

/* How often each state was seen, for who wants to know what a run has reached. */
extern uint64_t watch_states[6];
extern uint64_t watch_steps, watch_knots, watch_faults[ORI_FAULT_ENUM_END];

#endif
