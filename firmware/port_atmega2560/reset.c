/* Why it started, the watchdog, and the paint that shows how deep the stack went. */
#include <avr/io.h>
#include <avr/wdt.h>

#include "board.h"
#include "port.h"

static uint8_t flags __attribute__((section(".noinit"))); /* set before .bss is cleared */
static port_kept_t kept __attribute__((section(".noinit"))); /* never cleared */

/* Fills the RAM above the variables with 0xC5. What is left of it above __heap_start was never used as stack. */
__attribute__((naked, used, section(".init1"))) void paint_stack(void);
void paint_stack(void) {
    __asm__ volatile(
        "ldi r30, lo8(__heap_start)\n"
        "ldi r31, hi8(__heap_start)\n"
        "ldi r24, 0xC5\n"
        "ldi r25, hi8(%0)\n"
        "1: st Z+, r24\n"
        "cpi r30, lo8(%0)\n"
        "cpc r31, r25\n"
        "brlo 1b\n" ::"i"(RAMEND + 1));
}

/* After a watchdog reset the watchdog runs on, with its shortest time: it has to be dealt with at once.
 *
 * A bootloader runs before this. The Mega 2560's clears MCUSR and does not hand it on: with one, every start looks
 * like a power-on, and a watchdog reset is not told from it: what is kept is believed if its checksum is good, which
 * holds as long as the bootloader leaves it alone, and forgotten else. Program the device without a bootloader to have
 * the cause.
 */
__attribute__((naked, used, section(".init3"))) void save_reset_cause(void);
void save_reset_cause(void) {
    flags = MCUSR;
    MCUSR = 0; /* while WDRF is set the watchdog cannot be turned off */
    wdt_disable();
}

void watchdog_start(void) {
    wdt_enable(WDTO_250MS);
}

void port_watchdog_kick(void) {
    wdt_reset();
}

port_reset_t port_reset_cause(void) {
    if (flags & _BV(PORF)) {
        return PORT_RESET_POWER; /* sets BORF as well, as the supply rises */
    }
    if (flags & _BV(WDRF)) {
        return PORT_RESET_WATCHDOG;
    }
    if (flags & _BV(BORF)) {
        return PORT_RESET_BROWN_OUT;
    }
    return flags & _BV(EXTRF) ? PORT_RESET_EXTERNAL : PORT_RESET_POWER;
}

port_kept_t *port_kept(void) {
    return &kept;
}
