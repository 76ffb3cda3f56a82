/* Magnets on PA0 to PA7 (D22 to D29), sensors on PC0 to PC7 (D37 down to D30), emergency stop on PD7 (D38). */
#include <avr/io.h>

#include "board.h"
#include "port.h"

void pins_start(void) {
    PORTA = 0;
    DDRA = 0xFFU;
    DDRC = 0;
    PORTC = 0xFFU; /* pull-ups: Hall switches are open collectors */
    DDRD &= (uint8_t)~_BV(7);
    PORTD |= _BV(7); /* pull-up against a normally closed switch to ground: a broken wire reads as pressed */
}

void port_magnet(uint8_t output, bool on) {
    if (output >= ORI_MAGNET_OUTPUTS) {
        return;
    }
    uint8_t bit = (uint8_t)(1U << output);
    PORTA = on ? PORTA | bit : PORTA & (uint8_t)~bit;
}

uint8_t port_sensors(void) {
    return PINC;
}

bool port_estop(void) {
    return PIND & _BV(7);
}
