/* What the core needs of the hardware. A port implements these and calls core_init, core_poll and core_frame.
 *
 * Nothing here is called from an interrupt, and the core touches no hardware but through these.
 */
#ifndef ORI_PORT_H
#define ORI_PORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define ORI_SERVO_OUTPUTS 12U
#define ORI_MAGNET_OUTPUTS 8U
#define ORI_SENSOR_INPUTS 8U
#define ORI_FRAME_US 20000U
#define ORI_TICK_NS 500U

/* Analogue inputs beyond the hinges' 0 to 11. Counts are 10 bits, of the supply of the converter. */
#define ORI_ADC_SUPPLY 12U
#define ORI_ADC_THERMISTOR 13U

typedef enum { PORT_RESET_POWER = 0, PORT_RESET_EXTERNAL = 1, PORT_RESET_BROWN_OUT = 2, PORT_RESET_WATCHDOG = 3 } port_reset_t;

/* Microseconds since the start, monotonic. */
uint64_t port_micros(void);

/* Pulse of a servo output from the next frame on, in ticks of ORI_TICK_NS; 0 turns the output off. */
void port_servo(uint8_t output, uint16_t ticks);

void port_magnet(uint8_t output, bool on);

/* The newest conversion of an input; inputs are converted in turn, each at least every 5 ms. */
uint16_t port_adc(uint8_t input);

/* Levels of the sensor inputs, bit per input. */
uint8_t port_sensors(void);

/* Whether the emergency stop is pressed or its wire is broken. */
bool port_estop(void);

/* The next received byte, or -1. */
int16_t port_receive(void);

/* Room in the transmit buffer, and bytes into it; port_send is never called with more than there is room for. */
uint16_t port_send_room(void);
void port_send(const uint8_t *data, uint16_t size);

/* EEPROM of at least 4096 bytes. Writing leaves equal bytes alone and kicks the watchdog while it waits. */
void port_eeprom_read(uint16_t address, void *data, uint16_t size);
void port_eeprom_write(uint16_t address, const void *data, uint16_t size);

void port_watchdog_kick(void);
port_reset_t port_reset_cause(void);

/* What outlasts a restart: start-up clears everything else. After power was off anything may be in it; `check` is the
 * core's to tell. */
typedef struct {
    uint32_t heat[ORI_MAGNET_OUTPUTS];
    uint16_t tripped; /* bit per output */
    uint16_t check;
} port_kept_t;

port_kept_t *port_kept(void);

/* Up to 16 characters, ended by 0 when shorter. */
const char *port_name(void);

#endif
