/* Does to the port what it is told: a letter and four bytes, answered by the letter and eight bytes. */
#include "core.h"
#include "port.h"

static uint8_t said[5], n_said;
static uint64_t newest_frame;

static uint64_t obey(const uint8_t *word, uint16_t value) {
    uint8_t byte = (uint8_t)value;
    switch (word[0]) {
    case 'P':
        port_servo(word[1], value);
        return 0;
    case 'A':
        return port_adc(word[1]);
    case 'M':
        port_magnet(word[1], value != 0U);
        return 0;
    case 'S':
        return port_sensors() | (port_estop() ? 256U : 0U);
    case 'R':
        return port_reset_cause();
    case 'W':
        port_eeprom_write(value, &word[1], 1);
        return 0;
    case 'G':
        port_eeprom_read(value, &byte, 1);
        return byte;
    case 'T':
        return port_micros();
    case 'F':
        return newest_frame;
    default:
        return 0;
    }
}

void core_init(void) {}

void core_poll(void) {
    port_watchdog_kick();
    int16_t byte;
    while ((byte = port_receive()) >= 0) {
        said[n_said++] = (uint8_t)byte;
        if (n_said == sizeof said) {
            uint64_t result = obey(said, (uint16_t)(said[2] | said[3] << 8));
            uint8_t answer[9] = {said[0]};
            for (uint8_t i = 0; i < 8U; i++) {
                answer[1U + i] = (uint8_t)(result >> (8U * i));
            }
            port_send(answer, sizeof answer);
            n_said = 0;
        }
    }
}

void core_frame(uint64_t frame_start_us) {
    newest_frame = frame_start_us;
}
