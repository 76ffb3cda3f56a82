/* port.h on Linux, in a process of its own that the board starts, and kills when it resets. */
#include <errno.h>
#include <poll.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "board.h"
#include "core.h"

#define SEND_BYTES 255U   /* as the microcontroller's ring */
#define LONGEST_REST_US 1000U

static uint8_t received[1024], to_send[SEND_BYTES];
static size_t n_received, next_received, n_to_send;

uint64_t monotonic_us(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000U + (uint64_t)now.tv_nsec / 1000U;
}

uint64_t port_micros(void) {
    return monotonic_us() - board->epoch_us;
}

void port_servo(uint8_t output, uint16_t ticks) {
    if (output < ORI_SERVO_OUTPUTS) {
        board->next[output] = ticks;
    }
}

void port_magnet(uint8_t output, bool on) {
    uint8_t bit = (uint8_t)(1U << output);
    board->magnets = on ? board->magnets | bit : board->magnets & (uint8_t)~bit;
}

uint16_t port_adc(uint8_t input) {
    return board->adc[input & 15U];
}

uint8_t port_sensors(void) {
    return board->sensors;
}

bool port_estop(void) {
    return board->estop;
}

static bool has_received(void) {
    if (next_received == n_received) {
        ssize_t n = read(board->uart, received, sizeof received);
        n_received = n > 0 ? (size_t)n : 0U;
        next_received = 0;
    }
    return next_received < n_received;
}

int16_t port_receive(void) {
    return has_received() ? received[next_received++] : -1;
}

static void flush(void) {
    ssize_t n = n_to_send > 0U ? write(board->uart, to_send, n_to_send) : 0;
    if (n > 0) {
        n_to_send -= (size_t)n;
        memmove(to_send, to_send + n, n_to_send);
    }
}

uint16_t port_send_room(void) {
    flush();
    return (uint16_t)(SEND_BYTES - n_to_send);
}

void port_send(const uint8_t *data, uint16_t size) {
    memcpy(to_send + n_to_send, data, size);
    n_to_send += size;
    flush();
}

void port_eeprom_read(uint16_t address, void *data, uint16_t size) {
    memcpy(data, board->eeprom + address, size);
}

void port_eeprom_write(uint16_t address, const void *data, uint16_t size) {
    port_watchdog_kick();
    memcpy(board->eeprom + address, data, size);
    if (board->eeprom_file >= 0 && pwrite(board->eeprom_file, data, size, address) != size) {
        _exit(1);
    }
}

void port_watchdog_kick(void) {
    board->kicked_us = monotonic_us();
}

port_reset_t port_reset_cause(void) {
    return board->cause;
}

port_kept_t *port_kept(void) {
    return &board->kept;
}

const char *port_name(void) {
    return "host";
}

/* What the timers do by themselves when a frame begins. */
static void begin_frame(uint64_t frame) {
    for (int i = 0; i < (int)ORI_SERVO_OUTPUTS; i++) {
        board->now[i] = board->next[i];
    }
    board->frame = frame;
}

/* Until a byte comes or the next frame begins. */
static void rest(uint64_t next_frame_us) {
    uint64_t now = port_micros();
    uint64_t left = next_frame_us > now ? next_frame_us - now : 0U;
    left = left < LONGEST_REST_US ? left : LONGEST_REST_US;
    struct timespec wait = {.tv_nsec = (long)left * 1000L};
    struct pollfd uart = {.fd = board->uart, .events = (short)(POLLIN | (n_to_send > 0U ? POLLOUT : 0))};
    (void)ppoll(&uart, 1, &wait, NULL);
}

void cpu_run(void) {
    uint64_t frame = 0;
    port_watchdog_kick();
    core_init();
    for (;;) {
        do {
            core_poll();
        } while (has_received() && port_micros() / ORI_FRAME_US == frame);
        uint64_t newest = port_micros() / ORI_FRAME_US;
        if (newest != frame) {
            frame = newest;
            begin_frame(frame);
            core_frame(frame * ORI_FRAME_US);
        }
        rest((frame + 1U) * ORI_FRAME_US);
    }
}
