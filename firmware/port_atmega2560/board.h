/* What this port's files share. Pins are those of the Arduino Mega 2560; see each file. */
#ifndef ORI_BOARD_H
#define ORI_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#define TICKS_PER_FRAME 40000U /* of 0.5 us */

void pins_start(void);
void servos_start(void);
void clock_start(void);
void uart_start(void);
void adc_start(void);
void watchdog_start(void);

/* Turns outputs off whose last pulse is over; port_servo(output, 0) may have to leave that for later. */
void servos_settle(void);

/* When the frame that runs began. */
uint64_t clock_frame_start(void);

bool uart_has_received(void);

#endif
