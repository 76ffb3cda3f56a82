/* What the files of the ATmega2560's emulation share. */
#ifndef ORI_AVR_BOARD_H
#define ORI_AVR_BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

#define AVR_HZ 16000000U
#define CYCLES_PER_US 16U

extern avr_t *avr;
extern elf_firmware_t firmware;

/* Address of a symbol, or -1. */
long symbol_address(const char *name);

/* avr_silicon.c: where the library behaves otherwise than the chip. */
void silicon_start(const char *eeprom_path);
void silicon_after_reset(void);
void uart_feed(const uint8_t *data, size_t size);
size_t uart_room(void);
size_t uart_take(uint8_t *data, size_t size);
uint64_t uart_overruns(void);
void eeprom_put(uint16_t address, uint8_t *data, size_t size);

/* avr_pins.c: pulses out, levels in. */
void pins_start(void);
void pins_exchange(void);
void pins_after_reset(void);

/* avr_measure.c: cycles, latencies, stack. */
void measure_start(void);
bool measure_wants_every_instruction(void);
void measure_instruction(void);
void measure_after_reset(void);

/* avr_reset.c: power, resets, hangs. */
void reset_start(void);
bool power_is_on(void);


#endif
