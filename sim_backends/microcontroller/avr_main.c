/* An ATmega2560 that runs a program in real time, or step by step, with its UART on a pty and a world at its pins.
 *
 * ori_avr --elf FILE --link PATH --control PATH [--world FILE] [--eeprom FILE] [--seed N] [--lockstep]
 */
#include <getopt.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "avr_board.h"
#include "commands.h"
#include "control.h"
#include "cable.h"
#include "plug.h"
#include "world.h"

#define SLICE_CYCLES (200U * CYCLES_PER_US)
#define GIVE_UP_NS 100000000 /* so late, time is lost rather than made up for */

avr_t *avr;
elf_firmware_t firmware;

static volatile sig_atomic_t ended;
static bool lockstep;
static uint64_t lost_ns;

long symbol_address(const char *name) {
    for (uint32_t i = 0; i < firmware.symbolcount; i++) {
        if (strcmp(firmware.symbol[i]->symbol, name) == 0) {
            return (long)firmware.symbol[i]->addr;
        }
    }
    return -1;
}

/* -- running ---------------------------------------------------------------------------------------- */

static avr_cycle_count_t nothing(avr_t *of, avr_cycle_count_t when, void *param) {
    (void)of, (void)when, (void)param;
    return 0;
}

static void run_slice(avr_cycle_count_t end) {
    if (!power_is_on() || avr->state == cpu_Crashed || avr->state == cpu_Done) {
        avr->cycle = end > avr->cycle ? end : avr->cycle;
        return;
    }
    if (end > avr->cycle) {
        avr_cycle_timer_register(avr, end - avr->cycle, nothing, NULL); /* so that no sleep goes past it */
    }
    while (avr->cycle < end && avr->state != cpu_Crashed && avr->state != cpu_Done) {
        if (measure_wants_every_instruction()) {
            avr->run_cycle_limit = 1;
            measure_instruction();
        } else {
            avr->run_cycle_limit = SLICE_CYCLES;
        }
        avr_run(avr);
    }
}

static void hear_host(void) {
    static uint8_t data[1024], passed[2U * sizeof data];
    size_t n;
    while (uart_room() >= sizeof passed && (n = plug_receive(data, sizeof data)) > 0U) {
        uart_feed(passed, cable_pass(CABLE_TO_DEVICE, data, n, passed));
    }
}

static void tell_host(void) {
    static uint8_t data[1024], passed[2U * sizeof data];
    size_t n;
    while ((n = uart_take(data, sizeof data)) > 0U) {
        size_t size = cable_pass(CABLE_FROM_DEVICE, data, n, passed);
        commands_tap(passed, size);
        (void)plug_send(passed, size);
    }
}

/* Slices end at multiples of their length, whoever asks for how much: the same inputs meet the same cycles. */
static void run_until(avr_cycle_count_t end) {
    while (avr->cycle < end && !ended) {
        avr_cycle_count_t next = (avr->cycle / SLICE_CYCLES + 1U) * SLICE_CYCLES;
        run_slice(next < end ? next : end);
        world_step(avr->cycle / CYCLES_PER_US);
        pins_exchange();
        tell_host();
    }
}

static uint64_t now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000U + (uint64_t)now.tv_nsec;
}

static void run_in_real_time(void) {
    uint64_t start_ns = now_ns();
    while (!ended) {
        hear_host();
        control_serve(-1, -1, 0);
        run_until((avr->cycle / SLICE_CYCLES + 1U) * SLICE_CYCLES);
        uint64_t due_ns = start_ns + avr->cycle * 125U / 2U, late_ns = now_ns();
        if (late_ns > due_ns + GIVE_UP_NS) {
            lost_ns += late_ns - due_ns;
            start_ns += late_ns - due_ns;
            continue;
        }
        struct timespec due = {.tv_sec = (time_t)(due_ns / 1000000000U), .tv_nsec = (long)(due_ns % 1000000000U)};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
    }
}

/* -- commands --------------------------------------------------------------------------------------- */

static void run(char **word, int words, reply_t *reply) {
    (void)words;
    uint64_t cycles = (uint64_t)number(word[0], 0, 1000000000000, reply);
    if (!lockstep) {
        reply_fail(reply, "it runs by itself; start it with --lockstep to let it run so far");
        return;
    }
    hear_host();
    run_until(avr->cycle + cycles);
    reply_add(reply, "%llu", (unsigned long long)avr->cycle);
}

static void pace(char **word, int words, reply_t *reply) {
    (void)word, (void)words;
    reply_add(reply, "{\"lost_s\": %.6f}", 1e-9 * (double)lost_ns);
}

static const command_t commands[] = {{"run", 1, 1, run}, {"pace", 0, 0, pace}, {NULL, 0, 0, NULL}};

static void catch_up(void) {
    world_step(avr->cycle / CYCLES_PER_US);
}

static uint64_t now_us(void) {
    return avr->cycle / CYCLES_PER_US;
}

/* -- start and end ---------------------------------------------------------------------------------- */

static void end(int number_of_signal) {
    (void)number_of_signal;
    ended = 1;
}

static void rest(avr_t *of, avr_cycle_count_t cycles) {
    (void)of, (void)cycles; /* run_in_real_time keeps the time */
}

static void log_errors(avr_t *of, const int level, const char *format, va_list arguments) {
    (void)of;
    if (level <= LOG_ERROR) {
        vfprintf(stderr, format, arguments);
    }
}

static void start_avr(const char *elf, const char *eeprom) {
    avr_global_logger_set(log_errors);
    avr = avr_make_mcu_by_name("atmega2560");
    if (avr == NULL || elf_read_firmware(elf, &firmware) != 0) {
        fprintf(stderr, "%s: no program, or the simulator knows no atmega2560\n", elf);
        exit(2);
    }
    avr_init(avr);
    firmware.frequency = AVR_HZ;
    avr_load_firmware(avr, &firmware);
    avr->frequency = AVR_HZ;
    avr->sleep = rest;
    measure_start();
    silicon_start(eeprom);
    pins_start();
    reset_start();
}

int main(int argc, char **argv) {
    static const struct option options[] = {
        {"elf", 1, NULL, 'f'},    {"link", 1, NULL, 'l'}, {"control", 1, NULL, 'c'},  {"world", 1, NULL, 'w'},
        {"eeprom", 1, NULL, 'e'}, {"seed", 1, NULL, 's'}, {"lockstep", 0, NULL, 'k'}, {NULL, 0, NULL, 0},
    };
    const char *value[128] = {NULL};
    for (int c; (c = getopt_long(argc, argv, "", options, NULL)) != -1;) {
        if (c == '?') {
            return 2;
        }
        value[c] = optarg != NULL ? optarg : "";
    }
    if (value['f'] == NULL || value['l'] == NULL || value['c'] == NULL) {
        fprintf(stderr, "--elf, --link and --control are needed\n");
        return 2;
    }
    lockstep = value['k'] != NULL;
    world_clear();
    char wrong[300];
    if (value['w'] != NULL && !world_read(value['w'], wrong, sizeof wrong)) {
        fprintf(stderr, "%s\n", wrong);
        return 2;
    }
    cable_seed(value['s'] != NULL ? strtoull(value['s'], NULL, 10) : 0U);
    static emulation_t emulation = {.pulse_hz = AVR_HZ, .catch_up = catch_up, .now_us = now_us, .feed = uart_feed};
    emulation.link = value['l'];
    control_offer(commands);
    commands_offer(&emulation);
    start_avr(value['f'], value['e']);
    control_open(value['c']);
    plug_in(value['l']);
    struct sigaction action = {.sa_handler = end};
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    printf("atmega2560 on %s -> %s; control %s\n", value['l'], plug_device(), value['c']);
    fflush(stdout);
    while (lockstep && !ended) {
        control_serve(-1, -1, -1);
    }
    if (!lockstep) {
        run_in_real_time();
    }
    plug_out();
    control_close();
    return 0;
}
