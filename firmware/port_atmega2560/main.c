/* The loop: the core as often as there is something to do, and once per frame. */
#include <avr/interrupt.h>
#include <avr/sleep.h>

#include "board.h"
#include "core.h"
#include "port.h"

const char *port_name(void) {
    return "atmega2560";
}

/* Sleeps until the next interrupt. The converter's comes every 0.1 ms: nothing waits longer than that. */
static void rest(uint64_t seen_frame) {
    cli();
    if (!uart_has_received() && clock_frame_start() == seen_frame) {
        sleep_enable();
        sei(); /* the instruction after sei still runs before any interrupt: none is slept through */
        sleep_cpu();
        sleep_disable();
    }
    sei();
}

int main(void) {
    watchdog_start();
    pins_start();
    servos_start();
    adc_start();
    uart_start();
    clock_start();
    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
    core_init();

    uint64_t seen_frame = clock_frame_start();
    for (;;) {
        core_poll();
        uint64_t frame = clock_frame_start();
        if (frame != seen_frame) { /* of several that went by, the newest */
            seen_frame = frame;
            core_frame(frame);
        }
        servos_settle();
        rest(seen_frame);
    }
}
