/* Where the library behaves otherwise than the chip, in what this firmware uses:
 *
 * - compare registers take effect at once; in fast PWM the chip's do at BOTTOM;
 * - the converter has eight inputs and converts when the result is read; the chip has sixteen and samples at the start;
 * - a byte takes eleven bits; on the chip ten (8N1); and 64 bytes can wait to be read; on the chip two and a third;
 * - writing EEPROM takes no time; on the chip 3.4 ms, during which EEPE stays set;
 * - external interrupts that nobody uses are polled in every cycle while their pins, servo outputs here, are low.
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_eeprom.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_timer.h>
#include <simavr/avr_uart.h>

#include "avr_board.h"
#include "world.h"

#define IO(address) (avr->io[AVR_DATA_TO_IO(address)])

enum { ADCL = 0x78, ADCH = 0x79, ADCSRB = 0x7B, ADMUX = 0x7C, EECR = 0x3F, EEARL = 0x41, EEARH = 0x42 };
enum { UBRR0L = 0xC4, UDR0 = 0xC6, ADC_VECTOR = 29 };
enum { EEPE = 1, EEMPE = 2 };

/* -- compare registers ------------------------------------------------------------------------------ */

static const struct {
    char name;
    uint8_t overflow_vector;
    uint16_t ocr[3];
} timers[] = {
    {'1', 20, {0x88, 0x8A, 0x8C}},
    {'3', 35, {0x98, 0x9A, 0x9C}},
    {'4', 45, {0xA8, 0xAA, 0xAC}},
    {'5', 50, {0x128, 0x12A, 0x12C}},
};
#define TIMERS (sizeof timers / sizeof timers[0])

static void write_ocr(avr_t *on, avr_io_addr_t address, uint8_t value, void *param) {
    (void)param;
    on->data[address] = value; /* the buffer; the high byte is there already */
}

/* The library calls this before it sets the timer's pins and times its matches for the period that begins. */
static void at_bottom(avr_irq_t *irq, uint32_t value, void *param) {
    avr_timer_t *timer = param;
    (void)irq;
    for (int i = 0; value != 0 && i < AVR_TIMER_COMP_COUNT; i++) {
        uint32_t ocr = avr->data[timer->comp[i].r_ocr] | (uint32_t)avr->data[timer->comp[i].r_ocrh] << 8;
        timer->comp[i].comp_cycles = ocr <= timer->tov_top ? timer->cs_div_value * (ocr + 1U) : 0U;
    }
}

static void start_compare(void) {
    for (size_t t = 0; t < TIMERS; t++) {
        avr_timer_t *timer = ((avr_timer_comp_p)IO(timers[t].ocr[0]).w.param)->timer;
        for (int i = 0; i < AVR_TIMER_COMP_COUNT; i++) {
            IO(timers[t].ocr[i]).w.c = write_ocr;
        }
        avr_irq_t *irq = avr_get_interrupt_irq(avr, timers[t].overflow_vector);
        avr_irq_register_notify(irq + AVR_INT_IRQ_PENDING, at_bottom, timer);
    }
}

/* -- converter -------------------------------------------------------------------------------------- */

static uint16_t sampled;

static void sample(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq, (void)value, (void)param;
    int input = (avr->data[ADMUX] & 7) | (avr->data[ADCSRB] & 8);
    world_step(avr->cycle / CYCLES_PER_US);
    sampled = world_adc(input);
}

static void converted(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq, (void)param;
    if (value != 0) {
        avr->data[ADCL] = (uint8_t)sampled;
        avr->data[ADCH] = (uint8_t)(sampled >> 8);
    }
}

static uint8_t read_result(avr_t *on, avr_io_addr_t address, void *param) {
    (void)param;
    return on->data[address];
}

static void start_converter(void) {
    IO(ADCL).r.c = read_result;
    IO(ADCH).r.c = read_result;
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER), sample, NULL);
    avr_irq_register_notify(avr_get_interrupt_irq(avr, ADC_VECTOR) + AVR_INT_IRQ_PENDING, converted, NULL);
}

/* -- UART ------------------------------------------------------------------------------------------- */

#define QUEUE 65536U

typedef struct {
    uint8_t data[QUEUE];
    size_t in, out;
} queue_t;

static queue_t to_device, from_device;
static avr_uart_t *uart;
static avr_io_write_t library_baud_write;
static uint64_t overruns;

static void write_baud(avr_t *on, avr_io_addr_t address, uint8_t value, void *param) {
    library_baud_write(on, address, value, param);
    uart->cycles_per_byte = uart->cycles_per_byte * 10U / 11U;
}

/* Begins a byte on the wire. Of three that nobody has read the chip still has the third in its shift register. */
static avr_cycle_count_t next_byte(avr_t *on, avr_cycle_count_t when, void *param) {
    (void)on, (void)param;
    if (to_device.in == to_device.out) {
        return 0;
    }
    uint8_t byte = to_device.data[to_device.out++ % QUEUE];
    size_t waiting = (size_t)(uart->input.write - uart->input.read) % 64U;
    if (waiting >= 3U) {
        overruns++;
    } else {
        avr_raise_irq(uart->io.irq + UART_IRQ_INPUT, byte);
    }
    return when + uart->cycles_per_byte;
}

static void sent(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq, (void)param;
    if (from_device.in - from_device.out < QUEUE) {
        from_device.data[from_device.in++ % QUEUE] = (uint8_t)value;
    }
}

size_t uart_room(void) {
    return QUEUE - (to_device.in - to_device.out);
}

void uart_feed(const uint8_t *data, size_t size) {
    for (size_t i = 0; i < size && uart_room() > 0U; i++) {
        to_device.data[to_device.in++ % QUEUE] = data[i];
    }
    if (to_device.in != to_device.out && avr_cycle_timer_status(avr, next_byte, NULL) == 0) {
        avr_cycle_timer_register(avr, 1, next_byte, NULL);
    }
}

size_t uart_take(uint8_t *data, size_t size) {
    size_t n = 0;
    while (n < size && from_device.out != from_device.in) {
        data[n++] = from_device.data[from_device.out++ % QUEUE];
    }
    return n;
}

uint64_t uart_overruns(void) {
    return overruns;
}

static void start_uart(void) {
    uint32_t flags = 0; /* it prints nothing, and takes no pauses of its own */
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    uart = IO(UDR0).w.param;
    library_baud_write = IO(UBRR0L).w.c;
    IO(UBRR0L).w.c = write_baud;
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), sent, NULL);
}

/* -- EEPROM ----------------------------------------------------------------------------------------- */

#define EEPROM_WRITE_US 3400U

static avr_io_write_t library_eeprom_write;
static int eeprom_file = -1;
static bool eeprom_busy;

static void keep(const uint8_t *data, size_t size, uint16_t address) {
    if (eeprom_file >= 0 && pwrite(eeprom_file, data, size, address) != (ssize_t)size) {
        fprintf(stderr, "the EEPROM's file cannot be written\n");
    }
}

static avr_cycle_count_t eeprom_done(avr_t *on, avr_cycle_count_t when, void *param) {
    (void)when, (void)param;
    eeprom_busy = false;
    on->data[EECR] &= (uint8_t) ~(1U << EEPE);
    return 0;
}

static void write_eeprom(avr_t *on, avr_io_addr_t address, uint8_t value, void *param) {
    bool begins = !eeprom_busy && (on->data[EECR] & 1U << EEMPE) && (value & 1U << EEPE);
    library_eeprom_write(on, address, eeprom_busy ? value & (uint8_t) ~(1U << EEPE) : value, param);
    if (begins) {
        uint16_t at = (uint16_t)((on->data[EEARL] | on->data[EEARH] << 8) & 0xFFF);
        avr_eeprom_desc_t place = {.ee = NULL, .offset = at, .size = 1};
        avr_ioctl(on, AVR_IOCTL_EEPROM_GET, &place);
        keep(place.ee, 1, at);
        eeprom_busy = true;
        avr_cycle_timer_register_usec(on, EEPROM_WRITE_US, eeprom_done, NULL);
    }
    if (eeprom_busy) {
        on->data[EECR] |= 1U << EEPE;
    }
}

void eeprom_put(uint16_t address, uint8_t *data, size_t size) {
    avr_eeprom_desc_t place = {.ee = data, .offset = address, .size = (uint32_t)size};
    avr_ioctl(avr, AVR_IOCTL_EEPROM_SET, &place);
    keep(data, size, address);
}

static void start_eeprom(const char *path) {
    static uint8_t content[4096];
    library_eeprom_write = IO(EECR).w.c;
    IO(EECR).w.c = write_eeprom;
    if (path == NULL) {
        return;
    }
    eeprom_file = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    memset(content, 0xFF, sizeof content);
    if (eeprom_file < 0 || pread(eeprom_file, content, sizeof content, 0) < 0 ||
        pwrite(eeprom_file, content, sizeof content, 0) != sizeof content) {
        perror(path);
        exit(2);
    }
    avr_eeprom_desc_t all = {.ee = content, .offset = 0, .size = sizeof content};
    avr_ioctl(avr, AVR_IOCTL_EEPROM_SET, &all);
}

/* --------------------------------------------------------------------------------------------------- */

static avr_cycle_count_t spare_polling(avr_t *of, avr_cycle_count_t when, void *param) {
    (void)when, (void)param;
    for (uint8_t i = 0; i < EXTINT_COUNT; i++) {
        if (avr_extint_is_strict_lvl_trig(of, i) > 0) {
            avr_extint_set_strict_lvl_trig(of, i, 0);
        }
    }
    return 0;
}

void silicon_start(const char *eeprom_path) {
    spare_polling(avr, 0, NULL);
    start_compare();
    start_converter();
    start_uart();
    start_eeprom(eeprom_path);
}

/* A reset takes the library's timers away, these among them. What was on the wire goes on. */
void silicon_after_reset(void) {
    eeprom_busy = false;
    avr_cycle_timer_register(avr, 1, spare_polling, NULL); /* the library's own part of the reset is still to come */
    uart_feed(NULL, 0);
}
