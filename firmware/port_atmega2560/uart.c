/* UART 0 (D0, D1, the board's USB), 500 kBd 8N1, with a ring each way. */
#include <avr/interrupt.h>
#include <avr/io.h>

#include "board.h"
#include "port.h"

#define BAUD_DIVISOR 3U /* 16 MHz / 8 / 500 kBd - 1: no error */
#define LISTENING (_BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0))

/* Rings of 256 bytes: their uint8_t ends wrap by themselves. A full one holds 255. */
static volatile uint8_t received[256], to_send[256];
static volatile uint8_t received_in, received_out, send_in, send_out;

ISR(USART0_RX_vect) {
    uint8_t byte = UDR0;
    uint8_t next = (uint8_t)(received_in + 1U);
    if (next != received_out) { /* else the byte is lost; the checksum of its message will tell */
        received[received_in] = byte;
        received_in = next;
    }
}

ISR(USART0_UDRE_vect) {
    uint8_t at = send_out;
    if (at != send_in) {
        UDR0 = to_send[at];
        at++;
        send_out = at;
    }
    if (at == send_in) {
        UCSR0B = LISTENING;
    }
}

void uart_start(void) {
    UCSR0A = _BV(U2X0); /* before the divisor */
    UBRR0 = BAUD_DIVISOR;
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = LISTENING;
}

bool uart_has_received(void) {
    return received_in != received_out;
}

int16_t port_receive(void) {
    uint8_t at = received_out;
    if (at == received_in) {
        return -1;
    }
    uint8_t byte = received[at];
    received_out = (uint8_t)(at + 1U);
    return byte;
}

uint16_t port_send_room(void) {
    return (uint8_t)(send_out - send_in - 1U);
}

void port_send(const uint8_t *data, uint16_t size) {
    uint8_t at = send_in;
    for (uint16_t i = 0; i < size; i++) {
        to_send[at++] = data[i];
    }
    send_in = at;
    UCSR0B = LISTENING | _BV(UDRIE0);
}
