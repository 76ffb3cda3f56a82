/* Time: frames counted by timer 1's overflow, and what timer 1 shows since. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "board.h"
#include "port.h"

static volatile uint64_t frame_start_us;

ISR(TIMER1_OVF_vect) {
    frame_start_us += ORI_FRAME_US;
}

void clock_start(void) {
    TIMSK1 = _BV(TOIE1);
}

uint64_t clock_frame_start(void) {
    uint64_t start;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        start = frame_start_us;
    }
    return start;
}

uint64_t port_micros(void) {
    uint64_t start;
    uint16_t ticks;
    bool overflowed;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        start = frame_start_us;
        ticks = TCNT1;
        overflowed = TIFR1 & _BV(TOV1);
    }
    /* An overflow that has not been counted yet belongs to ticks that are small already. */
    if (overflowed && ticks < TICKS_PER_FRAME / 2U) {
        start += ORI_FRAME_US;
    }
    return start + ticks / 2U;
}
