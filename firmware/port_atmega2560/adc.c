/* Analogue inputs A0 to A15 against AVcc, one after the other: 0.11 ms each, 1.8 ms for all. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "board.h"
#include "port.h"

#define INPUTS 16U
#define PRESCALER_128 (_BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0)) /* 125 kHz: at most 200 for ten bits */

static volatile uint16_t counts[INPUTS];
static volatile uint8_t converting;

static void convert(uint8_t input) {
    converting = input;
    ADMUX = (uint8_t)(_BV(REFS0) | (input & 7U));
    ADCSRB = input & 8U ? _BV(MUX5) : 0U;
    ADCSRA |= _BV(ADSC);
}

ISR(ADC_vect) {
    uint8_t input = converting;
    counts[input] = ADC;
    convert((input + 1U) & (INPUTS - 1U));
}

static uint16_t convert_now(uint8_t input) {
    convert(input);
    loop_until_bit_is_clear(ADCSRA, ADSC);
    return ADC;
}

void adc_start(void) {
    DIDR0 = DIDR2 = 0xFFU; /* no digital input on these pins */
    ADCSRA = _BV(ADEN) | PRESCALER_128;
    (void)convert_now(0); /* the first one after switching on is not to be trusted */
    for (uint8_t input = 0; input < INPUTS; input++) {
        counts[input] = convert_now(input); /* so that the core never sees a count that was not measured */
    }
    ADCSRA = _BV(ADEN) | _BV(ADIE) | _BV(ADIF) | PRESCALER_128;
    convert(0);
}

uint16_t port_adc(uint8_t input) {
    uint16_t count;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        count = counts[input & (INPUTS - 1U)];
    }
    return count;
}
