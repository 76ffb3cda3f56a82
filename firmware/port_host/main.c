/* A board on Linux: pty, world, timers, watchdog; and the core in a process of its own, so that it can hang and reset.
 *
 * ori_host --link PATH --control PATH [--world FILE] [--eeprom FILE] [--seed N]
 */
#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "board.h"
#include "commands.h"
#include "control.h"
#include "cable.h"
#include "plug.h"
#include "pulses.h"
#include "world.h"

#define WATCHDOG_US 250000U
#define TICK_US 1000
#define PULSE_HZ 1000000000U

board_t *board;

static volatile sig_atomic_t ended;
static pid_t cpu = -1;
static int uart = -1;
static uint64_t start_us, frames_shown, resets;

static uint64_t now_us(void) {
    return monotonic_us() - start_us;
}

static void catch_up(void) {
    world_step(now_us());
}

/* -- power and resets ------------------------------------------------------------------------------- */

static void stop_cpu(void) {
    if (cpu > 0) {
        kill(cpu, SIGKILL);
        waitpid(cpu, NULL, 0);
        close(uart);
    }
    cpu = -1;
    uart = -1;
    for (int i = 0; i < (int)ORI_SERVO_OUTPUTS; i++) {
        board->next[i] = board->now[i] = 0;
    }
    board->magnets = 0;
}

static void show_levels(void) {
    for (int i = 0; i < WORLD_ADC_INPUTS; i++) {
        board->adc[i] = world_adc(i);
    }
    board->sensors = world_sensors();
    board->estop = world_estop();
    for (int i = 0; i < WORLD_MAGNETS; i++) {
        world_magnet(i, board->magnets >> i & 1U);
    }
}

/* With nothing of the board's but the shared memory, the UART and the EEPROM: a pty held open is not hung up. */
static void become_cpu(pid_t parent) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    signal(SIGINT, SIG_IGN); /* the board ends it */
    for (int fd = STDERR_FILENO + 1; fd < 256; fd++) {
        if (fd != board->uart && fd != board->eeprom_file) {
            close(fd);
        }
    }
    if (getppid() == parent) {
        cpu_run();
    }
    _exit(0);
}

static void start_cpu(port_reset_t cause) {
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends) != 0) {
        perror("socketpair");
        exit(2);
    }
    catch_up();
    show_levels();
    uart = ends[0];
    board->uart = ends[1];
    board->cause = cause;
    board->epoch_us = board->kicked_us = monotonic_us();
    board->frame = frames_shown = 0;
    pid_t parent = getpid();
    cpu = fork();
    if (cpu == 0) {
        become_cpu(parent);
    }
    close(ends[1]);
}

static void restart(port_reset_t cause) {
    stop_cpu();
    resets++;
    start_cpu(cause);
}

static void watch(void) {
    if (cpu > 0 && (waitpid(cpu, NULL, WNOHANG) == cpu || monotonic_us() > board->kicked_us + WATCHDOG_US)) {
        restart(PORT_RESET_WATCHDOG);
    }
}

/* -- every tick ------------------------------------------------------------------------------------- */

/* Pulses of frames that have begun. The timers go on when the core does not. */
static void show_pulses(void) {
    uint64_t since_us = board->epoch_us - start_us;
    while (cpu > 0 && now_us() >= since_us + (frames_shown + 1U) * ORI_FRAME_US) {
        frames_shown++;
        uint64_t rise_us = since_us + frames_shown * ORI_FRAME_US;
        bool taken = board->frame >= frames_shown;
        for (int i = 0; i < (int)ORI_SERVO_OUTPUTS; i++) {
            uint32_t ticks = taken ? board->now[i] : board->next[i];
            if (ticks > 0U) {
                pulses_record((uint32_t)i, rise_us * 1000U, ticks * ORI_TICK_NS);
                world_pulse(i, ticks * (double)ORI_TICK_NS, rise_us);
            }
        }
    }
}

static void feed(const uint8_t *data, size_t size) {
    if (uart >= 0 && size > 0U) {
        (void)!send(uart, data, size, MSG_NOSIGNAL);
    }
}

static void carry_bytes(void) {
    static uint8_t data[1024], passed[2U * sizeof data];
    size_t n;
    while ((n = plug_receive(data, sizeof data)) > 0U) {
        feed(passed, cable_pass(CABLE_TO_DEVICE, data, n, passed));
    }
    ssize_t m;
    while (uart >= 0 && (m = read(uart, data, sizeof data)) > 0) {
        size_t size = cable_pass(CABLE_FROM_DEVICE, data, (size_t)m, passed);
        commands_tap(passed, size);
        (void)plug_send(passed, size);
    }
}

static void serve(void) {
    uint64_t next_us = 0;
    while (!ended) {
        control_serve(plug_fileno(), uart, TICK_US);
        carry_bytes();
        if (now_us() >= next_us) {
            next_us = now_us() + TICK_US;
            show_pulses();
            catch_up();
            show_levels();
            watch();
        }
    }
}

/* -- commands --------------------------------------------------------------------------------------- */

static void reset(char **word, int words, reply_t *reply) {
    (void)words;
    if (cpu <= 0) {
        reply_fail(reply, "the power is off");
    } else if (strcmp(word[0], "external") == 0) {
        restart(PORT_RESET_EXTERNAL);
    } else if (strcmp(word[0], "brown_out") == 0) {
        restart(PORT_RESET_BROWN_OUT);
    } else {
        reply_fail(reply, "%.40s is neither external nor brown_out; for the watchdog's, hang", word[0]);
    }
}

static void power(char **word, int words, reply_t *reply) {
    (void)words;
    bool on = number(word[0], 0, 1, reply) != 0;
    if (reply->error[0] == 0 && on != (cpu > 0)) {
        stop_cpu();
        if (on) {
            memset(&board->kept, 0, sizeof board->kept);
            resets++;
            start_cpu(PORT_RESET_POWER);
        }
    }
}

static void hang(char **word, int words, reply_t *reply) {
    (void)word, (void)words;
    if (cpu <= 0 || kill(cpu, SIGSTOP) != 0) {
        reply_fail(reply, "there is nothing to hang");
    }
}

static void status(char **word, int words, reply_t *reply) {
    (void)word, (void)words;
    reply_add(reply,
              "{\"cycle\": %llu, \"booted\": %llu, \"resets\": %llu, \"power\": %s, \"crashed\": false, \"overruns\": 0}",
              (unsigned long long)now_us() * 16U, (unsigned long long)(board->epoch_us - start_us) * 16U,
              (unsigned long long)resets, cpu > 0 ? "true" : "false");
}

static void eeprom(char **word, int words, reply_t *reply) {
    (void)words;
    long long at = number(word[0], 0, EEPROM_BYTES - 1, reply);
    long long size = number(word[1], 1, (long long)EEPROM_BYTES - at, reply);
    if (reply->error[0] == 0) {
        reply_hex(reply, board->eeprom + at, (size_t)size);
    }
}

static void put_eeprom(char **word, int words, reply_t *reply) {
    (void)words;
    long long at = number(word[0], 0, EEPROM_BYTES - 1, reply);
    size_t n = bytes(word[1], board->eeprom + at, EEPROM_BYTES - (size_t)at, reply);
    if (board->eeprom_file >= 0 && pwrite(board->eeprom_file, board->eeprom + at, n, at) < 0) {
        reply_fail(reply, "the EEPROM's file cannot be written");
    }
}

static const command_t commands[] = {
    {"reset", 1, 1, reset},   {"power", 1, 1, power},   {"hang", 0, 1, hang},
    {"status", 0, 0, status}, {"eeprom", 2, 2, eeprom}, {"put_eeprom", 2, 2, put_eeprom},
    {NULL, 0, 0, NULL},
};

/* -- start and end ---------------------------------------------------------------------------------- */

static void end(int number_of_signal) {
    (void)number_of_signal;
    ended = 1;
}

static void start_board(const char *eeprom_path) {
    board = mmap(NULL, sizeof *board, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (board == MAP_FAILED) {
        perror("mmap");
        exit(2);
    }
    memset(board->eeprom, 0xFF, EEPROM_BYTES);
    board->eeprom_file = -1;
    if (eeprom_path == NULL) {
        return;
    }
    board->eeprom_file = open(eeprom_path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (board->eeprom_file < 0 || pread(board->eeprom_file, board->eeprom, EEPROM_BYTES, 0) < 0 ||
        pwrite(board->eeprom_file, board->eeprom, EEPROM_BYTES, 0) != EEPROM_BYTES) {
        perror(eeprom_path);
        exit(2);
    }
}

int main(int argc, char **argv) {
    static const struct option options[] = {
        {"link", 1, NULL, 'l'},   {"control", 1, NULL, 'c'}, {"world", 1, NULL, 'w'},
        {"eeprom", 1, NULL, 'e'}, {"seed", 1, NULL, 's'},    {NULL, 0, NULL, 0},
    };
    const char *value[128] = {NULL};
    for (int c; (c = getopt_long(argc, argv, "", options, NULL)) != -1;) {
        if (c == '?') {
            return 2;
        }
        value[c] = optarg;
    }
    if (value['l'] == NULL || value['c'] == NULL) {
        fprintf(stderr, "--link and --control are needed\n");
        return 2;
    }
    world_clear();
    char wrong[300];
    if (value['w'] != NULL && !world_read(value['w'], wrong, sizeof wrong)) {
        fprintf(stderr, "%s\n", wrong);
        return 2;
    }
    cable_seed(value['s'] != NULL ? strtoull(value['s'], NULL, 10) : 0U);
    static emulation_t emulation = {.pulse_hz = PULSE_HZ, .catch_up = catch_up, .now_us = now_us, .feed = feed};
    emulation.link = value['l'];
    control_offer(commands);
    commands_offer(&emulation);
    start_board(value['e']);
    control_open(value['c']);
    plug_in(value['l']);
    struct sigaction action = {.sa_handler = end};
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    start_us = monotonic_us();
    start_cpu(PORT_RESET_POWER);
    printf("host on %s -> %s; control %s\n", value['l'], plug_device(), value['c']);
    fflush(stdout);
    serve();
    stop_cpu();
    plug_out();
    control_close();
    return 0;
}
