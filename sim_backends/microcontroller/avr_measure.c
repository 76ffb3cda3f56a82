/* Cycles that functions take, latencies of interrupts, depth of the stack. */
#include <stdlib.h>
#include <string.h>

#include "avr_board.h"
#include "control.h"

#define FUNCTIONS 8
#define VECTORS 64
#define PAINT 0xC5U

typedef struct {
    uint64_t count, least, most, sum;
} tally_t;

static struct {
    char name[64];
    avr_flashaddr_t address;
    bool inside;
    uint16_t stack;
    avr_cycle_count_t entered, interrupted;
    tally_t all, own; /* own: without interrupts that came between */
} functions[FUNCTIONS];

static int n_functions;

static struct {
    bool pending;
    avr_cycle_count_t since;
    tally_t waited;
} vectors[VECTORS];

static avr_cycle_count_t in_interrupts, interrupt_began;

static void tally(tally_t *of, uint64_t cycles) {
    of->least = of->count == 0 || cycles < of->least ? cycles : of->least;
    of->most = cycles > of->most ? cycles : of->most;
    of->sum += cycles;
    of->count++;
}

static void reply_tally(reply_t *reply, const char *name, const tally_t *of) {
    reply_add(reply, "\"%s\": {\"count\": %llu, \"least\": %llu, \"most\": %llu, \"mean\": %.1f}", name,
              (unsigned long long)of->count, (unsigned long long)of->least, (unsigned long long)of->most,
              of->count == 0 ? 0.0 : (double)of->sum / (double)of->count);
}

/* -- functions -------------------------------------------------------------------------------------- */

static uint16_t stack_pointer(void) {
    return (uint16_t)(avr->data[R_SPL] | avr->data[R_SPH] << 8);
}

bool measure_wants_every_instruction(void) {
    return n_functions > 0;
}

/* Before every instruction: a function is entered at its address, and left once its return address is gone. */
void measure_instruction(void) {
    uint16_t stack = stack_pointer();
    for (int i = 0; i < n_functions; i++) {
        if (functions[i].inside && stack > functions[i].stack) {
            functions[i].inside = false;
            uint64_t cycles = avr->cycle - functions[i].entered;
            tally(&functions[i].all, cycles);
            tally(&functions[i].own, cycles - (in_interrupts - functions[i].interrupted));
        }
        if (!functions[i].inside && avr->pc == functions[i].address) {
            functions[i].inside = true;
            functions[i].stack = stack;
            functions[i].entered = avr->cycle;
            functions[i].interrupted = in_interrupts;
        }
    }
}

static void measure(char **word, int words, reply_t *reply) {
    n_functions = 0;
    for (int i = 0; i < words; i++) {
        long address = symbol_address(word[i]);
        if (address < 0 || address > (long)avr->flashend || n_functions == FUNCTIONS) {
            reply_fail(reply, "there is no function %.60s", word[i]);
            return;
        }
        memset(&functions[n_functions], 0, sizeof functions[0]);
        strncpy(functions[n_functions].name, word[i], sizeof functions[0].name - 1U);
        functions[n_functions++].address = (avr_flashaddr_t)address;
    }
}

static void measured(char **word, int words, reply_t *reply) {
    (void)word, (void)words;
    reply_add(reply, "{");
    for (int i = 0; i < n_functions; i++) {
        reply_add(reply, "%s\"%s\": {", i > 0 ? ", " : "", functions[i].name);
        reply_tally(reply, "all", &functions[i].all);
        reply_add(reply, ", ");
        reply_tally(reply, "own", &functions[i].own);
        reply_add(reply, "}");
    }
    reply_add(reply, "}");
}

/* -- interrupts ------------------------------------------------------------------------------------- */

static void pending(avr_irq_t *irq, uint32_t value, void *param) {
    avr_int_vector_t *vector = param;
    (void)irq;
    vectors[vector->vector].pending = value != 0 && avr_regbit_get(avr, vector->enable) != 0;
    vectors[vector->vector].since = avr->cycle;
}

static void running(avr_irq_t *irq, uint32_t value, void *param) {
    avr_int_vector_t *vector = param;
    (void)irq;
    if (value == 0) {
        in_interrupts += avr->cycle - interrupt_began;
        return;
    }
    interrupt_began = avr->cycle;
    if (vectors[vector->vector].pending) {
        vectors[vector->vector].pending = false;
        tally(&vectors[vector->vector].waited, avr->cycle - vectors[vector->vector].since);
    }
}

static void latency(char **word, int words, reply_t *reply) {
    (void)word, (void)words;
    reply_add(reply, "{");
    for (int i = 0, n = 0; i < VECTORS; i++) {
        if (vectors[i].waited.count > 0) {
            char name[8] = {(char)('0' + i / 10), (char)('0' + i % 10), 0};
            reply_add(reply, "%s", n++ > 0 ? ", " : "");
            reply_tally(reply, i < 10 ? name + 1 : name, &vectors[i].waited);
        }
    }
    reply_add(reply, "}");
}

static void forget(char **word, int words, reply_t *reply) {
    (void)word, (void)words, (void)reply;
    memset(vectors, 0, sizeof vectors);
}

/* -- stack ------------------------------------------------------------------------------------------ */

static void stack(char **word, int words, reply_t *reply) {
    (void)word, (void)words;
    long end = symbol_address("__heap_start");
    if (end < 0) {
        reply_fail(reply, "the program does not say where its variables end");
        return;
    }
    uint32_t first = (uint32_t)end & 0xFFFFU, at = first;
    while (at <= avr->ramend && avr->data[at] == PAINT) {
        at++;
    }
    reply_add(reply, "{\"used\": %u, \"free\": %u, \"now\": %u}", avr->ramend + 1U - at, at - first,
              (unsigned)(avr->ramend - stack_pointer()));
}

static const command_t commands[] = {
    {"measure", 0, FUNCTIONS, measure}, {"measured", 0, 0, measured}, {"latency", 0, 0, latency},
    {"forget_latency", 0, 0, forget},   {"stack", 0, 0, stack},       {NULL, 0, 0, NULL},
};

void measure_after_reset(void) {
    for (int i = 0; i < n_functions; i++) {
        functions[i].inside = false;
    }
}

void measure_start(void) {
    for (int i = 0; i < avr->interrupts.vector_count; i++) {
        avr_int_vector_t *vector = avr->interrupts.vector[i];
        avr_irq_register_notify(vector->irq + AVR_INT_IRQ_PENDING, pending, vector);
        avr_irq_register_notify(vector->irq + AVR_INT_IRQ_RUNNING, running, vector);
    }
    control_offer(commands);
}
