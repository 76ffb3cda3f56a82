/* A port without hardware: tests set its inputs and read its outputs. */
#ifndef ORI_FAKE_PORT_H
#define ORI_FAKE_PORT_H

#include "port.h"

#define FAKE_EEPROM 4096U
#define FAKE_BUFFER 65536U

typedef struct {
    uint64_t micros;
    uint16_t servo[ORI_SERVO_OUTPUTS];
    bool magnet[ORI_MAGNET_OUTPUTS];
    uint16_t adc[14];
    uint8_t sensors;
    bool estop;
    port_reset_t reset_cause;
    uint8_t eeprom[FAKE_EEPROM];
    /* Bytes that are still written before the power is cut; what comes later is lost. */
    uint32_t eeprom_left;
    uint32_t eeprom_written;
    /* Cells from here to there keep what they have, as if worn out. */
    uint16_t worn_from, worn_to;
    port_kept_t kept;
    uint16_t send_room;
    unsigned kicks;
    unsigned servo_calls;
    unsigned magnet_calls;
    /* What the host sends, and what it gets. */
    uint8_t to_device[FAKE_BUFFER];
    uint32_t to_device_size, to_device_taken;
    uint8_t from_device[FAKE_BUFFER];
    uint32_t from_device_size;
} fake_t;

extern fake_t fake;

/* Everything off, EEPROM erased, supply and wires good. */
void fake_reset(void);
void fake_type(const void *bytes, uint32_t size);

#endif
