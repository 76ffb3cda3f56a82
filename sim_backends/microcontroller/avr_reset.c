/* Power, resets and hangs, and the flags in MCUSR that tell of them. */
#include <string.h>

#include <simavr/avr_eeprom.h>

#include "avr_board.h"
#include "control.h"
#include "random.h"

enum { MCUSR = 0x54, PORF = 0, EXTRF = 1, BORF = 2 };

static bool on = true;
static uint64_t resets, booted, random_state = 1;
static void (*library_reset)(avr_t *);

bool power_is_on(void) {
    return on;
}

/* Part of every reset, the watchdog's too: the library has just taken all its timers away. */
static void after_reset(avr_t *of) {
    if (library_reset != NULL) {
        library_reset(of);
    }
    resets += on; /* to be switched off is none */
    booted = of->cycle;
    pins_after_reset();
    silicon_after_reset();
    measure_after_reset();
}

static void reset_with(uint8_t flags) {
    avr_reset(avr);
    avr->data[MCUSR] = flags;
}

static void reset(char **word, int words, reply_t *reply) {
    (void)words;
    if (strcmp(word[0], "external") == 0) {
        reset_with(1U << EXTRF);
    } else if (strcmp(word[0], "brown_out") == 0) {
        reset_with(1U << BORF);
    } else {
        reply_fail(reply, "%.40s is neither external nor brown_out; for the watchdog's, hang", word[0]);
    }
}

/* Off: pins are dead, RAM is lost; EEPROM stays. On: RAM is anything, and the rising supply sets BORF as well. */
static void power(char **word, int words, reply_t *reply) {
    (void)words;
    bool wanted = number(word[0], 0, 1, reply) != 0;
    if (reply->error[0] != 0 || wanted == on) {
        return;
    }
    on = wanted;
    for (uint32_t i = avr->ioend + 1U; i <= avr->ramend; i++) {
        avr->data[i] = (uint8_t)random_next(&random_state);
    }
    reset_with(1U << PORF | 1U << BORF);
}

/* Into the loop that follows a program's end. With interrupts off nothing happens any more but in hardware:
 * pulses go on, and the watchdog counts. With "irq" only the main program hangs. */
static void hang(char **word, int words, reply_t *reply) {
    long end = symbol_address("_exit");
    if (end < 0 || (words == 1 && strcmp(word[0], "irq") != 0)) {
        reply_fail(reply, "the program has no end to go to, or that is no kind of hang");
        return;
    }
    avr->pc = (avr_flashaddr_t)end + (words == 1 ? 2U : 0U); /* cli; rjmp .-2 */
    avr->state = cpu_Running;
}

static void status(char **word, int words, reply_t *reply) {
    (void)word, (void)words;
    reply_add(reply, "{\"cycle\": %llu, \"booted\": %llu, \"resets\": %llu, \"power\": %s, \"crashed\": %s, \"overruns\": %llu}",
              (unsigned long long)avr->cycle, (unsigned long long)booted, (unsigned long long)resets, on ? "true" : "false",
              avr->state == cpu_Crashed || avr->state == cpu_Done ? "true" : "false",
              (unsigned long long)uart_overruns());
}

static void eeprom(char **word, int words, reply_t *reply) {
    (void)words;
    avr_eeprom_desc_t place = {.ee = NULL, .offset = (uint16_t)number(word[0], 0, 4095, reply)};
    place.size = (uint32_t)number(word[1], 1, 4096 - place.offset, reply);
    if (reply->error[0] == 0 && avr_ioctl(avr, AVR_IOCTL_EEPROM_GET, &place) >= -1) {
        reply_hex(reply, place.ee, place.size);
    }
}

static void put_eeprom(char **word, int words, reply_t *reply) {
    (void)words;
    static uint8_t data[4096];
    uint16_t at = (uint16_t)number(word[0], 0, 4095, reply);
    size_t n = bytes(word[1], data, 4096U - at, reply);
    if (n > 0U) {
        eeprom_put(at, data, n);
    }
}

static const command_t commands[] = {
    {"reset", 1, 1, reset},   {"power", 1, 1, power},   {"hang", 0, 1, hang},
    {"status", 0, 0, status}, {"eeprom", 2, 2, eeprom}, {"put_eeprom", 2, 2, put_eeprom},
    {NULL, 0, 0, NULL},
};

void reset_start(void) {
    library_reset = avr->reset;
    avr->reset = after_reset;
    control_offer(commands);
}
