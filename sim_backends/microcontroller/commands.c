#include "commands.h"

#include <stdlib.h>
#include <string.h>

#include "cable.h"
#include "plug.h"
#include "pulses.h"
#include "world.h"

#define TAPPED 65536U

static const emulation_t *emulation;
static uint8_t tapped[TAPPED];
static size_t n_tapped;
static bool tapping;

/* The place of a word among others; the reply fails when it is none of them. */
static int one_of(const char *const *names, const char *word, reply_t *reply) {
    for (int i = 0; names[i] != NULL; i++) {
        if (strcmp(names[i], word) == 0) {
            return i;
        }
    }
    reply_fail(reply, "%.40s is none of %s and others", word, names[0]);
    return 0;
}

/* -- the world -------------------------------------------------------------------------------------- */

static hinge_t *hinge_of(const char *word, reply_t *reply) {
    emulation->catch_up();
    hinge_t *hinge = &world.hinge[number(word, 0, WORLD_HINGES - 1, reply)];
    if (!hinge->present) {
        reply_fail(reply, "there is no hinge %.10s", word);
    }
    return hinge;
}

static latch_t *latch_of(const char *word, reply_t *reply) {
    emulation->catch_up();
    latch_t *latch = &world.latch[number(word, 0, WORLD_LATCHES - 1, reply)];
    if (!latch->present) {
        reply_fail(reply, "there is no latch %.10s", word);
    }
    return latch;
}

static void jam(char **word, int words, reply_t *reply) {
    (void)words;
    hinge_t *hinge = hinge_of(word[0], reply);
    hinge->jammed = number(word[1], 0, 1, reply) != 0;
}

static void push(char **word, int words, reply_t *reply) {
    (void)words;
    (void)hinge_of(word[0], reply);
    double by_rad = 1e-6 * (double)number(word[1], -100000000, 100000000, reply);
    if (reply->error[0] == 0) {
        world_push((int)number(word[0], 0, WORLD_HINGES - 1, reply), by_rad);
    }
}

static void wire(char **word, int words, reply_t *reply) {
    static const char *const names[] = {"good", "open", "short", NULL};
    (void)words;
    hinge_t *hinge = hinge_of(word[0], reply);
    hinge->wire = (wire_t)one_of(names, word[1], reply);
}

static void sensor(char **word, int words, reply_t *reply) {
    static const char *const names[] = {"good", "low", "high", "bounces", NULL};
    (void)words;
    emulation->catch_up();
    world.sensor_fault[number(word[0], 0, WORLD_SENSORS - 1, reply)] = (sensor_fault_t)one_of(names, word[1], reply);
}

static void latch_stuck(char **word, int words, reply_t *reply) {
    (void)words;
    latch_of(word[0], reply)->stuck = number(word[1], 0, 1, reply) != 0;
}

static void supply(char **word, int words, reply_t *reply) {
    (void)words;
    emulation->catch_up();
    world.supply_uv = (double)number(word[0], 0, 100000000, reply);
}

static void thermistor(char **word, int words, reply_t *reply) {
    (void)words;
    world.thermistor_count = (int)number(word[0], 0, 1023, reply);
}

static void adc(char **word, int words, reply_t *reply) {
    (void)words;
    world.adc_forced[number(word[0], 0, WORLD_ADC_INPUTS - 1, reply)] = (int)number(word[1], -1, 1023, reply);
}

static void estop(char **word, int words, reply_t *reply) {
    (void)words;
    world.estop = number(word[0], 0, 1, reply) != 0;
}

static void truth(char **word, int words, reply_t *reply) {
    (void)word, (void)words;
    emulation->catch_up();
    reply_add(reply, "{\"time_us\": %llu, \"shaft_rad\": [", (unsigned long long)emulation->now_us());
    for (int k = 0, n = 0; k < WORLD_HINGES; k++) {
        if (world.hinge[k].present) {
            reply_add(reply, "%s%.9f", n++ > 0 ? ", " : "", world.hinge[k].position_rad);
        }
    }
    reply_add(reply, "], \"latches\": [");
    for (int k = 0, n = 0; k < WORLD_LATCHES; k++) {
        const latch_t *latch = &world.latch[k];
        if (latch->present) {
            reply_add(reply, "%s{\"closed\": %s, \"travel\": %.6f, \"energised_s\": %.3f}", n++ > 0 ? ", " : "",
                      latch->closed ? "true" : "false", latch->travel, latch->energised_s);
        }
    }
    unsigned magnets = 0;
    for (int i = 0; i < WORLD_MAGNETS; i++) {
        magnets |= world.magnet[i] ? 1U << i : 0U;
    }
    reply_add(reply, "], \"magnets\": %u, \"sensors\": %u, \"estop\": %s}", magnets, world_sensors(),
              world.estop ? "true" : "false");
}

/* -- the cable -------------------------------------------------------------------------------------- */

static const char *const directions[] = {"to_device", "from_device", NULL};

static void spoil(char **word, int words, reply_t *reply) {
    static const char *const kinds[] = {"drop", "flip", "noise", "cut", NULL};
    (void)words;
    int kind = one_of(kinds, word[1], reply);
    cable_t *cable = &cables[one_of(directions, word[0], reply)];
    uint32_t value = (uint32_t)number(word[2], 0, 1000000, reply);
    if (reply->error[0] != 0) {
        return;
    }
    if (kind == 3) {
        cable->cut = value != 0;
    } else {
        *(kind == 0 ? &cable->drop : kind == 1 ? &cable->flip : &cable->noise) = value;
    }
}

static void seed(char **word, int words, reply_t *reply) {
    (void)words;
    cable_seed((uint64_t)number(word[0], 0, INT64_MAX, reply));
}

static void account(char **word, int words, reply_t *reply) {
    (void)word, (void)words;
    reply_add(reply, "{");
    for (int i = 0; i < CABLE_DIRECTIONS; i++) {
        const cable_t *cable = &cables[i];
        reply_add(reply, "%s\"%s\": {\"passed\": %llu, \"lost\": %llu, \"flipped\": %llu, \"added\": %llu}",
                  i > 0 ? ", " : "", directions[i], (unsigned long long)cable->passed, (unsigned long long)cable->lost,
                  (unsigned long long)cable->flipped, (unsigned long long)cable->added);
    }
    reply_add(reply, "}");
}

static void unplug(char **word, int words, reply_t *reply) {
    (void)word, (void)words, (void)reply;
    plug_out();
}

static void replug(char **word, int words, reply_t *reply) {
    (void)word, (void)words, (void)reply;
    plug_in(emulation->link);
}

static void feed(char **word, int words, reply_t *reply) {
    (void)words;
    static uint8_t data[8192];
    static uint8_t passed[2U * sizeof data];
    size_t n = bytes(word[0], data, sizeof data, reply);
    emulation->feed(passed, cable_pass(CABLE_TO_DEVICE, data, n, passed));
}

static void tap(char **word, int words, reply_t *reply) {
    (void)words;
    tapping = number(word[0], 0, 1, reply) != 0;
    n_tapped = 0;
}

static void take_tapped(char **word, int words, reply_t *reply) {
    (void)word, (void)words;
    reply_hex(reply, tapped, n_tapped);
    n_tapped = 0;
}

void commands_tap(const uint8_t *data, size_t size) {
    for (size_t i = 0; tapping && i < size && n_tapped < TAPPED; i++) {
        tapped[n_tapped++] = data[i];
    }
}

/* -- the record ------------------------------------------------------------------------------------- */

static void pulses(char **word, int words, reply_t *reply) {
    (void)word, (void)words;
    reply_add(reply, "{\"hz\": %llu, \"pulses\": [", (unsigned long long)emulation->pulse_hz);
    for (uint64_t i = pulses_first(); i < pulses_count(); i++) {
        const pulse_t *pulse = pulses_at(i);
        reply_add(reply, "%s[%u, %llu, %u]", i > pulses_first() ? ", " : "", pulse->channel,
                  (unsigned long long)pulse->rise, pulse->width);
    }
    reply_add(reply, "]}");
}

static void forget_pulses(char **word, int words, reply_t *reply) {
    (void)word, (void)words, (void)reply;
    pulses_forget();
}

static const command_t commands[] = {
    {"truth", 0, 0, truth},
    {"jam", 2, 2, jam},
    {"push", 2, 2, push},
    {"wire", 2, 2, wire},
    {"sensor", 2, 2, sensor},
    {"latch_stuck", 2, 2, latch_stuck},
    {"supply", 1, 1, supply},
    {"thermistor", 1, 1, thermistor},
    {"adc", 2, 2, adc},
    {"estop", 1, 1, estop},
    {"spoil", 3, 3, spoil},
    {"seed", 1, 1, seed},
    {"account", 0, 0, account},
    {"unplug", 0, 0, unplug},
    {"replug", 0, 0, replug},
    {"feed", 1, 1, feed},
    {"tap", 1, 1, tap},
    {"tapped", 0, 0, take_tapped},
    {"pulses", 0, 0, pulses},
    {"forget_pulses", 0, 0, forget_pulses},
    {NULL, 0, 0, NULL},
};

void commands_offer(const emulation_t *of) {
    emulation = of;
    control_offer(commands);
}
