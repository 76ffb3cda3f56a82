/* Pulses that the pins give, to the cycle, and levels that they get. */
#include <simavr/avr_ioport.h>
#include <simavr/avr_timer.h>

#include "avr_board.h"
#include "pulses.h"
#include "world.h"

enum { DDRA = 0x21, PINC = 0x26, PIND = 0x29, ESTOP_BIT = 7 };

typedef struct {
    char timer;
    int unit;
    uint16_t control, ocr, port, ddr; /* addresses: TCCRnA, OCRnx, PORTx, DDRx */
    uint8_t com_shift, bit;
} output_t;

static const output_t outputs[WORLD_OUTPUTS] = {
    {'1', 0, 0x80, 0x88, 0x25, 0x24, 6, 5},     {'1', 1, 0x80, 0x8A, 0x25, 0x24, 4, 6},
    {'1', 2, 0x80, 0x8C, 0x25, 0x24, 2, 7},     {'3', 0, 0x90, 0x98, 0x2E, 0x2D, 6, 3},
    {'3', 1, 0x90, 0x9A, 0x2E, 0x2D, 4, 4},     {'3', 2, 0x90, 0x9C, 0x2E, 0x2D, 2, 5},
    {'4', 0, 0xA0, 0xA8, 0x102, 0x101, 6, 3},   {'4', 1, 0xA0, 0xAA, 0x102, 0x101, 4, 4},
    {'4', 2, 0xA0, 0xAC, 0x102, 0x101, 2, 5},   {'5', 0, 0x120, 0x128, 0x10B, 0x10A, 6, 3},
    {'5', 1, 0x120, 0x12A, 0x10B, 0x10A, 4, 4}, {'5', 2, 0x120, 0x12C, 0x10B, 0x10A, 2, 5},
};

static struct {
    avr_timer_t *timer;
    bool latch, level; /* the compare unit's output latch; the pin */
    avr_cycle_count_t rise;
} state[WORLD_OUTPUTS];

static avr_io_write_t library_control_write[4];
static const uint16_t controls[4] = {0x80, 0x90, 0xA0, 0x120};

/* The pin is the latch's while a compare mode is set, else the port's. */
static void settle(int i, avr_cycle_count_t now) {
    const output_t *output = &outputs[i];
    bool connected = (avr->data[output->control] >> output->com_shift & 3U) != 0U;
    bool driven = (avr->data[output->ddr] >> output->bit & 1U) != 0U;
    bool port = (avr->data[output->port] >> output->bit & 1U) != 0U;
    bool level = driven && (connected ? state[i].latch : port);
    if (level && !state[i].level) {
        state[i].rise = now;
    } else if (!level && state[i].level) {
        uint64_t width = now - state[i].rise;
        pulses_record((uint32_t)i, state[i].rise, width);
        world_pulse(i, 1e9 / AVR_HZ * (double)width, now / CYCLES_PER_US);
    }
    state[i].level = level;
}

/* The library tells between two instructions; when it truly was, the timer knows. */
static void compared(avr_irq_t *irq, uint32_t value, void *param) {
    int i = (int)(intptr_t)param;
    avr_timer_t *timer = state[i].timer;
    (void)irq;
    state[i].latch = value != 0;
    settle(i, timer->tov_base + (value != 0 ? 0U : timer->comp[outputs[i].unit].comp_cycles));
}

static void write_control(avr_t *on, avr_io_addr_t address, uint8_t value, void *param) {
    for (int t = 0; t < 4; t++) {
        if (controls[t] == address) {
            library_control_write[t](on, address, value, param);
        }
    }
    for (int i = 0; i < WORLD_OUTPUTS; i++) {
        if (outputs[i].control == address) {
            settle(i, on->cycle);
        }
    }
}

static void write_magnets(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq, (void)param;
    world_step(avr->cycle / CYCLES_PER_US);
    for (int i = 0; i < WORLD_MAGNETS; i++) {
        world_magnet(i, (value & avr->data[DDRA]) >> i & 1U);
    }
}

/* What the program reads. The library shows the port register where a compare unit drives the pin, and remembers
 * levels of inputs from before a reset. */
static const uint16_t read_by_program[] = {PINC, PIND, 0x23, 0x2C, 0x100, 0x109};

static uint8_t read_pins(avr_t *of, avr_io_addr_t address, void *param) {
    (void)param;
    uint8_t ddr = of->data[address + 1U], port = of->data[address + 2U];
    uint8_t levels = port; /* an input that nobody drives shows its pull-up */
    world_step(of->cycle / CYCLES_PER_US);
    if (address == PINC) {
        levels = world_sensors();
    } else if (address == PIND) {
        levels = (uint8_t)((port & 0x7FU) | (world_estop() ? 1U << ESTOP_BIT : 0U));
    }
    levels = (uint8_t)((levels & ~ddr) | (port & ddr));
    for (int i = 0; i < WORLD_OUTPUTS; i++) {
        if (outputs[i].ddr == address + 1U) {
            uint8_t mask = (uint8_t)(1U << outputs[i].bit);
            levels = (uint8_t)(state[i].level ? levels | mask : levels & ~mask);
        }
    }
    return levels;
}

/* Pins that nothing but the port register drives. */
void pins_exchange(void) {
    for (int i = 0; i < WORLD_OUTPUTS; i++) {
        settle(i, avr->cycle);
    }
}

void pins_start(void) {
    for (int t = 0; t < 4; t++) {
        library_control_write[t] = avr->io[AVR_DATA_TO_IO(controls[t])].w.c;
        avr->io[AVR_DATA_TO_IO(controls[t])].w.c = write_control;
    }
    for (size_t i = 0; i < sizeof read_by_program / sizeof read_by_program[0]; i++) {
        avr->io[AVR_DATA_TO_IO(read_by_program[i])].r.c = read_pins;
    }
    for (int i = 0; i < WORLD_OUTPUTS; i++) {
        const output_t *output = &outputs[i];
        state[i].timer = ((avr_timer_comp_p)avr->io[AVR_DATA_TO_IO(output->ocr)].w.param)->timer;
        avr_irq_t *irq = avr_io_getirq(avr, AVR_IOCTL_TIMER_GETIRQ(output->timer), TIMER_IRQ_OUT_COMP + output->unit);
        avr_irq_register_notify(irq, compared, (void *)(intptr_t)i);
    }
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('A'), IOPORT_IRQ_REG_PORT), write_magnets, NULL);
}

/* Every pin is an input again: pulses that ran are cut short, and magnets go off. */
void pins_after_reset(void) {
    for (int i = 0; i < WORLD_OUTPUTS; i++) {
        state[i].latch = false;
        settle(i, avr->cycle);
    }
    for (int i = 0; i < WORLD_MAGNETS; i++) {
        world_magnet(i, false);
    }
}
