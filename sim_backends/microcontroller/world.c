#include "world.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define LIMP_AFTER_US 60000U   /* without a pulse */
#define LIMP_BELOW_UV 3000000.0 /* of supply */
#define PIN_ENTRY 0.5          /* part of a pin's travel before it meets its hole */
#define PIN_HOME 0.99          /* rounding of pulses taken off */
#define GRIP_RAD 0.005         /* how much a closed latch lets hinges move */
#define STEP_S (1e-6 * WORLD_STEP_US)

world_t world;

void world_clear(void) {
    memset(&world, 0, sizeof world);
    world.plant_fd = -1;
    world.supply_uv = 6e6;
    world.supply_uv_per_count = 1e4;
    world.thermistor_count = 512;
    for (int i = 0; i < WORLD_ADC_INPUTS; i++) {
        world.adc_forced[i] = -1;
    }
    for (int k = 0; k < WORLD_HINGES; k++) {
        world.hinge[k] = (hinge_t){.output = WORLD_NOBODY, .adc = WORLD_NOBODY, .slope_ns = 1.0,
                                   .feedback_slope_nrad = 1.0, .time_constant_s = 0.02, .max_velocity_rad_s = 1.0,
                                   .lower_rad = -1e3, .upper_rad = 1e3};
    }
    for (int k = 0; k < WORLD_LATCHES; k++) {
        world.latch[k].output = world.latch[k].sensor = WORLD_NOBODY;
    }
}

double world_random(uint64_t key) {
    uint64_t z = (world.seed + 1U) * 0x9E3779B97F4A7C15U ^ key * 0xD1342543DE82EF95U;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBU;
    z ^= z >> 31;
    return (double)(z >> 11) * 0x1p-53;
}

/* -- latches ---------------------------------------------------------------------------------------- */

static bool aligned(const latch_t *latch) {
    for (int k = 0; k < WORLD_HINGES; k++) {
        if (latch->secures[k] && fabs(world.hinge[k].crease_rad - latch->closed_rad[k]) > latch->range_rad[k]) {
            return false;
        }
    }
    return true;
}

/* A passive magnet lets itself be pulled apart. */
static bool restrains(const latch_t *latch) {
    switch (latch->kind) {
    case LATCH_LOCK_PIN:
        return latch->stuck ? latch->closed : latch->travel > PIN_ENTRY;
    case LATCH_ELECTROMAGNET:
        return latch->closed;
    default:
        return latch->stuck && latch->closed;
    }
}

static bool limp(int output) {
    if (output < 0 || output >= WORLD_OUTPUTS || !world.pulse[output].ever || world.supply_uv < LIMP_BELOW_UV) {
        return true;
    }
    return world.now_us > world.pulse[output].at_us + LIMP_AFTER_US;
}

static void step_pin(latch_t *latch) {
    if (limp(latch->output)) {
        return;
    }
    double to = (world.pulse[latch->output].width_ns - latch->released_ns) / (latch->engaged_ns - latch->released_ns);
    to = fmin(1.0, fmax(0.0, to));
    double stroke = STEP_S / latch->travel_s;
    double next = to < latch->travel ? fmax(to, latch->travel - stroke) : fmin(to, latch->travel + stroke);
    bool enters = latch->travel <= PIN_ENTRY && next > PIN_ENTRY;
    if (!enters || aligned(latch)) {
        latch->travel = next;
    }
}

static void step_latch(latch_t *latch, bool time_passes) {
    bool energised = latch->kind == LATCH_ELECTROMAGNET && latch->output < WORLD_MAGNETS && world.magnet[latch->output];
    if (time_passes && energised) {
        latch->energised_s += STEP_S;
    }
    if (latch->stuck) {
        return;
    }
    if (latch->kind == LATCH_LOCK_PIN) {
        if (time_passes) {
            step_pin(latch);
        }
        latch->closed = latch->travel >= PIN_HOME;
    } else if (latch->kind == LATCH_ELECTROMAGNET) {
        latch->closed = energised && (latch->closed || aligned(latch));
    } else {
        latch->closed = aligned(latch);
    }
}

/* Where creases are; a plant has told it. */
static void place_creases(void) {
    for (int k = 0; k < WORLD_HINGES && (world.plant_fd < 0 || world.now_us == 0); k++) {
        world.hinge[k].crease_rad = world.hinge[k].position_rad;
    }
}

void world_settle(void) {
    place_creases();
    for (int k = 0; k < WORLD_LATCHES; k++) {
        if (world.latch[k].present) {
            step_latch(&world.latch[k], false);
        }
    }
}

/* -- hinges ----------------------------------------------------------------------------------------- */

/* Where a hinge may be. What is caught off centre may come closer, not leave. */
static double within_bounds(int k, double position_rad) {
    const hinge_t *hinge = &world.hinge[k];
    double lower = hinge->lower_rad, upper = hinge->upper_rad;
    for (int i = 0; i < WORLD_LATCHES; i++) {
        const latch_t *latch = &world.latch[i];
        if (latch->present && latch->secures[k] && restrains(latch)) {
            lower = fmax(lower, fmin(hinge->position_rad, latch->closed_rad[k] - GRIP_RAD));
            upper = fmin(upper, fmax(hinge->position_rad, latch->closed_rad[k] + GRIP_RAD));
        }
    }
    return fmin(upper, fmax(lower, position_rad));
}

static void step_hinge(int k) {
    hinge_t *hinge = &world.hinge[k];
    if (hinge->jammed || limp(hinge->output)) {
        return;
    }
    double target = (world.pulse[hinge->output].width_ns - hinge->zero_ns) / hinge->slope_ns;
    double most = hinge->max_velocity_rad_s * STEP_S;
    double move = (target - hinge->position_rad) * (1.0 - exp(-STEP_S / hinge->time_constant_s));
    hinge->position_rad = within_bounds(k, hinge->position_rad + fmin(most, fmax(-most, move)));
}

/* -- the structure, where it pulls back ------------------------------------------------------------- */

typedef struct {
    double target_rad[WORLD_HINGES], shaft_rad[WORLD_HINGES];
    uint32_t on, jammed, held, spare; /* bits of hinges, of hinges, of latches */
} asked_t;

typedef struct {
    double shaft_rad[WORLD_HINGES], crease_rad[WORLD_HINGES];
} told_t;

static void pass(bool out, void *data, size_t size) {
    for (char *at = data; size > 0;) {
        ssize_t n = out ? write(world.plant_fd, at, size) : read(world.plant_fd, at, size);
        if (n > 0) {
            at += n;
            size -= (size_t)n;
        } else if (n == 0 || errno != EINTR) {
            fprintf(stderr, "the plant has gone\n");
            exit(1);
        }
    }
}

/* WORLD_PLANT_US of servos and structure, by whoever is behind the socket. */
static void step_plant(void) {
    asked_t asked = {0};
    told_t told;
    for (int k = 0; k < WORLD_HINGES; k++) {
        const hinge_t *hinge = &world.hinge[k];
        asked.shaft_rad[k] = asked.target_rad[k] = hinge->position_rad;
        if (hinge->present && !limp(hinge->output)) {
            asked.target_rad[k] = (world.pulse[hinge->output].width_ns - hinge->zero_ns) / hinge->slope_ns;
            asked.on |= 1U << k;
        }
        asked.jammed |= (uint32_t)hinge->jammed << k;
    }
    for (int i = 0; i < WORLD_LATCHES; i++) {
        asked.held |= (uint32_t)(world.latch[i].present && restrains(&world.latch[i])) << i;
    }
    pass(true, &asked, sizeof asked);
    pass(false, &told, sizeof told);
    for (int k = 0; k < WORLD_HINGES; k++) {
        world.hinge[k].position_rad = told.shaft_rad[k];
        world.hinge[k].crease_rad = told.crease_rad[k];
    }
}

void world_push(int hinge, double by_rad) {
    world.hinge[hinge].position_rad = within_bounds(hinge, world.hinge[hinge].position_rad + by_rad);
    world_settle();
}

/* -- the microcontroller's side --------------------------------------------------------------------- */

void world_step(uint64_t now_us) {
    while (world.now_us + WORLD_STEP_US <= now_us) {
        world.now_us += WORLD_STEP_US;
        for (int k = 0; k < WORLD_HINGES && world.plant_fd < 0; k++) {
            if (world.hinge[k].present) {
                step_hinge(k);
            }
        }
        if (world.plant_fd >= 0 && world.now_us % WORLD_PLANT_US == 0) {
            step_plant();
        }
        place_creases();
        for (int k = 0; k < WORLD_LATCHES; k++) {
            if (world.latch[k].present) {
                step_latch(&world.latch[k], true);
            }
        }
    }
}

void world_pulse(int output, double width_ns, uint64_t now_us) {
    world_step(now_us);
    world.pulse[output].width_ns = width_ns;
    world.pulse[output].at_us = now_us;
    world.pulse[output].ever = true;
}

void world_magnet(int output, bool on) {
    world.magnet[output] = on;
}

static double feedback(int k, int input) {
    const hinge_t *hinge = &world.hinge[k];
    if (hinge->wire != WIRE_GOOD) {
        return hinge->wire == WIRE_OPEN ? 0.0 : 1023.0;
    }
    double count = (1e6 * hinge->position_rad - hinge->feedback_zero_urad) * 1e3 / hinge->feedback_slope_nrad;
    double sum = 0.0; /* of twelve uniform numbers: nearly normal, standard deviation 1 */
    for (uint64_t i = 0; hinge->noise_counts > 0.0 && i < 12U; i++) {
        sum += world_random((world.now_us / WORLD_STEP_US * WORLD_ADC_INPUTS + (uint64_t)input) * 12U + i) - 0.5;
    }
    return count + hinge->noise_counts * sum;
}

uint16_t world_adc(int input) {
    if (input < 0 || input >= WORLD_ADC_INPUTS) {
        return 0;
    }
    double count = 0.0;
    if (world.adc_forced[input] >= 0) {
        count = world.adc_forced[input];
    } else if (input == 12) {
        count = world.supply_uv / world.supply_uv_per_count;
    } else if (input == 13) {
        count = world.thermistor_count;
    }
    for (int k = 0; k < WORLD_HINGES && world.adc_forced[input] < 0; k++) {
        if (world.hinge[k].present && world.hinge[k].adc == input) {
            count = feedback(k, input);
        }
    }
    return (uint16_t)lround(fmin(1023.0, fmax(0.0, count)));
}

uint8_t world_sensors(void) {
    uint8_t levels = 0xFFU; /* pulled up */
    for (int k = 0; k < WORLD_LATCHES; k++) {
        const latch_t *latch = &world.latch[k];
        if (latch->present && latch->sensor < WORLD_SENSORS && latch->closed != latch->sensor_high) {
            levels &= (uint8_t) ~(1U << latch->sensor);
        }
    }
    for (int i = 0; i < WORLD_SENSORS; i++) {
        uint8_t bit = (uint8_t)(1U << i);
        sensor_fault_t fault = world.sensor_fault[i];
        bool high = world_random(~(world.now_us / WORLD_STEP_US * WORLD_SENSORS + (uint64_t)i)) < 0.5;
        if (fault == SENSOR_LOW || (fault == SENSOR_BOUNCES && !high)) {
            levels &= (uint8_t)~bit;
        } else if (fault == SENSOR_HIGH || fault == SENSOR_BOUNCES) {
            levels |= bit;
        }
    }
    return levels;
}

bool world_estop(void) {
    return world.estop;
}
