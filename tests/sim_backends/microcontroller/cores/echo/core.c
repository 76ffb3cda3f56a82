/* Sends back what it receives. */
#include "core.h"
#include "port.h"

void core_init(void) {}

void core_poll(void) {
    port_watchdog_kick();
    int16_t byte;
    while (port_send_room() > 0U && (byte = port_receive()) >= 0) {
        uint8_t same = (uint8_t)byte;
        port_send(&same, 1);
    }
}

void core_frame(uint64_t frame_start_us) {
    (void)frame_start_us;
}
