/* What the simulated board shares with the process that runs the core on it. */
#ifndef ORI_HOST_BOARD_H
#define ORI_HOST_BOARD_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "port.h"

#define EEPROM_BYTES 4096U

typedef struct {
    /* From the board. */
    uint64_t epoch_us; /* CLOCK_MONOTONIC when the core started; frames count from there */
    port_reset_t cause;
    int uart, eeprom_file; /* descriptors */
    _Atomic uint16_t adc[16];
    _Atomic uint8_t sensors;
    _Atomic bool estop;
    /* From the core. Pulses are double buffered, as in hardware: `next` becomes `now` when a frame begins. */
    _Atomic uint64_t kicked_us, frame;
    _Atomic uint16_t next[ORI_SERVO_OUTPUTS], now[ORI_SERVO_OUTPUTS];
    _Atomic uint8_t magnets;
    port_kept_t kept;
    uint8_t eeprom[EEPROM_BYTES];
} board_t;

extern board_t *board;

uint64_t monotonic_us(void);

/* The core's process; does not return. */
void cpu_run(void);

#endif
