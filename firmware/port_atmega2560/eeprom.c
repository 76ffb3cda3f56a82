/* The 4 KiB EEPROM. Writing a byte takes 3.4 ms, during which interrupts go on. */
#include <avr/eeprom.h>

#include "port.h"

void port_eeprom_read(uint16_t address, void *data, uint16_t size) {
    eeprom_read_block(data, (const void *)address, size);
}

void port_eeprom_write(uint16_t address, const void *data, uint16_t size) {
    const uint8_t *bytes = data;
    for (uint16_t i = 0; i < size; i++) {
        port_watchdog_kick();
        eeprom_update_byte((uint8_t *)(address + i), bytes[i]);
    }
    port_watchdog_kick();
}
