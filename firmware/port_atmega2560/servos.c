/* Twelve servo pulses, made by the compare units of timers 1, 3, 4 and 5, exact to the clock.
 *
 * output  0     1     2     3     4     5     6     7     8     9     10    11
 * unit    1A    1B    1C    3A    3B    3C    4A    4B    4C    5A    5B    5C
 * port    PB5   PB6   PB7   PE3   PE4   PE5   PH3   PH4   PH5   PL3   PL4   PL5
 * pin     D11   D12   D13   D5    D2    D3    D6    D7    D8    D46   D45   D44
 *
 * Fast PWM with the top in ICR: a pin goes high at BOTTOM and low after the tick in which the counter equals OCR, so a
 * pulse has OCR + 1 ticks. OCR is double buffered: what is written takes effect at the next BOTTOM.
 *
 * On and off: with COM = 0 a unit leaves its output latch alone and the pin shows PORT, low. The latch is low after
 * reset, and COM changes only while it is low, after the pulse of a frame and clear of the next BOTTOM. So it is low
 * whenever a unit is connected, and the first pulse is a whole one, in the next frame; and none is cut short.
 */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "board.h"
#include "port.h"

#define PRESCALER_8 _BV(CS11)

/* No servo takes a pulse of 10 ms, and every pulse is over long before the frame is. */
#define LONGEST_TICKS 20000U

/* So close to the end of a frame, COM is left alone. */
#define GUARD_TICKS 40U

typedef struct {
    volatile uint16_t *compare;
    volatile uint16_t *counter;
    volatile uint8_t *control; /* TCCRnA */
    volatile uint8_t *pin;
    uint8_t connect; /* COMnx1: clear on match, set at BOTTOM */
    uint8_t mask;
} unit_t;

static const unit_t units[ORI_SERVO_OUTPUTS] = {
    {&OCR1A, &TCNT1, &TCCR1A, &PINB, _BV(COM1A1), _BV(5)}, {&OCR1B, &TCNT1, &TCCR1A, &PINB, _BV(COM1B1), _BV(6)},
    {&OCR1C, &TCNT1, &TCCR1A, &PINB, _BV(COM1C1), _BV(7)}, {&OCR3A, &TCNT3, &TCCR3A, &PINE, _BV(COM3A1), _BV(3)},
    {&OCR3B, &TCNT3, &TCCR3A, &PINE, _BV(COM3B1), _BV(4)}, {&OCR3C, &TCNT3, &TCCR3A, &PINE, _BV(COM3C1), _BV(5)},
    {&OCR4A, &TCNT4, &TCCR4A, &PINH, _BV(COM4A1), _BV(3)}, {&OCR4B, &TCNT4, &TCCR4A, &PINH, _BV(COM4B1), _BV(4)},
    {&OCR4C, &TCNT4, &TCCR4A, &PINH, _BV(COM4C1), _BV(5)}, {&OCR5A, &TCNT5, &TCCR5A, &PINL, _BV(COM5A1), _BV(3)},
    {&OCR5B, &TCNT5, &TCCR5A, &PINL, _BV(COM5B1), _BV(4)}, {&OCR5C, &TCNT5, &TCCR5A, &PINL, _BV(COM5C1), _BV(5)},
};

static uint16_t going_off; /* bit per output that is to be turned off as soon as its pulse is over */

static void start_timers(void) {
    GTCCR = _BV(TSM) | _BV(PSRSYNC); /* holds the prescaler that the four share */
    ICR1 = ICR3 = ICR4 = ICR5 = TICKS_PER_FRAME - 1U;
    TCCR1A = TCCR3A = TCCR4A = TCCR5A = _BV(WGM11);
    const uint8_t run = _BV(WGM13) | _BV(WGM12) | PRESCALER_8;
    TCCR1B = run;
    TCCR3B = run;
    TCCR4B = run;
    TCCR5B = run;
    TCNT1 = TCNT3 = TCNT4 = TCNT5 = 0U;
    GTCCR = 0; /* all four count from here, in phase */
}

void servos_start(void) {
    PORTB &= (uint8_t)~(_BV(5) | _BV(6) | _BV(7));
    PORTE &= (uint8_t)~(_BV(3) | _BV(4) | _BV(5));
    PORTH &= (uint8_t)~(_BV(3) | _BV(4) | _BV(5));
    PORTL &= (uint8_t)~(_BV(3) | _BV(4) | _BV(5));
    DDRB |= _BV(5) | _BV(6) | _BV(7);
    DDRE |= _BV(3) | _BV(4) | _BV(5);
    DDRH |= _BV(3) | _BV(4) | _BV(5);
    DDRL |= _BV(3) | _BV(4) | _BV(5);
    start_timers();
}

/* Disconnects a unit if its pulse of this frame is over. */
static bool turn_off(const unit_t *unit) {
    bool done = false;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (*unit->counter < TICKS_PER_FRAME - GUARD_TICKS && !(*unit->pin & unit->mask)) {
            *unit->control &= (uint8_t)~unit->connect;
            done = true;
        }
    }
    return done;
}

void servos_settle(void) {
    for (uint8_t output = 0; going_off && output < ORI_SERVO_OUTPUTS; output++) {
        uint16_t bit = (uint16_t)(1U << output);
        if ((going_off & bit) && turn_off(&units[output])) {
            going_off &= (uint16_t)~bit;
        }
    }
}

void port_servo(uint8_t output, uint16_t ticks) {
    if (output >= ORI_SERVO_OUTPUTS) {
        return;
    }
    const unit_t *unit = &units[output];
    if (ticks == 0U) {
        if (*unit->control & unit->connect) {
            going_off |= (uint16_t)(1U << output);
            servos_settle();
        }
        return;
    }
    if (going_off) { /* shifting by a number takes its time */
        going_off &= (uint16_t) ~(1U << output);
    }
    /* Both halves before the next BOTTOM or both after it: no interrupt uses these timers' shared high byte. */
    *unit->compare = (ticks < LONGEST_TICKS ? ticks : LONGEST_TICKS) - 1U;
    *unit->control |= unit->connect; /* after OCR: a connected unit always has its pulse */
}
