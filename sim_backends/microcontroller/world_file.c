/* Reads the description of a world: lines of a name and numbers. */
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "world.h"

#define WORDS 6

typedef struct {
    const char *name;
    size_t at;
    enum { IS_INT, IS_DOUBLE, IS_BOOL } type;
    double unit;
} field_t;

static const field_t world_fields[] = {
    {"supply_uv", offsetof(world_t, supply_uv), IS_DOUBLE, 1.0},
    {"supply_uv_per_count", offsetof(world_t, supply_uv_per_count), IS_DOUBLE, 1.0},
    {"thermistor_count", offsetof(world_t, thermistor_count), IS_INT, 1.0},
    {"estop", offsetof(world_t, estop), IS_BOOL, 1.0},
    {"plant_fd", offsetof(world_t, plant_fd), IS_INT, 1.0},
    {NULL, 0, IS_INT, 0.0},
};

static const field_t hinge_fields[] = {
    {"output", offsetof(hinge_t, output), IS_INT, 1.0},
    {"adc", offsetof(hinge_t, adc), IS_INT, 1.0},
    {"start_rad", offsetof(hinge_t, position_rad), IS_DOUBLE, 1.0},
    {"pulse_zero_ns", offsetof(hinge_t, zero_ns), IS_DOUBLE, 1.0},
    {"pulse_slope_ns", offsetof(hinge_t, slope_ns), IS_DOUBLE, 1.0},
    {"feedback_zero_urad", offsetof(hinge_t, feedback_zero_urad), IS_DOUBLE, 1.0},
    {"feedback_slope_nrad", offsetof(hinge_t, feedback_slope_nrad), IS_DOUBLE, 1.0},
    {"noise_counts", offsetof(hinge_t, noise_counts), IS_DOUBLE, 1.0},
    {"time_constant_s", offsetof(hinge_t, time_constant_s), IS_DOUBLE, 1.0},
    {"max_velocity_rad_s", offsetof(hinge_t, max_velocity_rad_s), IS_DOUBLE, 1.0},
    {"lower_rad", offsetof(hinge_t, lower_rad), IS_DOUBLE, 1.0},
    {"upper_rad", offsetof(hinge_t, upper_rad), IS_DOUBLE, 1.0},
    {NULL, 0, IS_INT, 0.0},
};

static const field_t latch_fields[] = {
    {"kind", offsetof(latch_t, kind), IS_INT, 1.0},
    {"output", offsetof(latch_t, output), IS_INT, 1.0},
    {"sensor", offsetof(latch_t, sensor), IS_INT, 1.0},
    {"sensor_high", offsetof(latch_t, sensor_high), IS_BOOL, 1.0},
    {"engaged_us", offsetof(latch_t, engaged_ns), IS_DOUBLE, 1e3},
    {"released_us", offsetof(latch_t, released_ns), IS_DOUBLE, 1e3},
    {"travel_s", offsetof(latch_t, travel_s), IS_DOUBLE, 1.0},
    {"start_travel", offsetof(latch_t, travel), IS_DOUBLE, 1.0},
    {NULL, 0, IS_INT, 0.0},
};

static bool set(const field_t *fields, void *of, const char *name, const char *text) {
    for (; fields->name != NULL; fields++) {
        if (strcmp(fields->name, name) != 0) {
            continue;
        }
        char *end;
        double value = strtod(text, &end) * fields->unit;
        void *place = (char *)of + fields->at;
        if (fields->type == IS_DOUBLE) {
            *(double *)place = value;
        } else if (fields->type == IS_INT) {
            *(int *)place = (int)value;
        } else {
            *(bool *)place = value != 0.0;
        }
        return *end == 0 && end != text;
    }
    return false;
}

static int index_of(const char *text, int limit) {
    char *end;
    long k = strtol(text, &end, 10);
    return *end == 0 && k >= 0 && k < limit ? (int)k : -1;
}

static bool take_latch(int n, char **word) {
    int k = index_of(word[1], WORLD_LATCHES);
    if (k < 0) {
        return false;
    }
    latch_t *latch = &world.latch[k];
    latch->present = true;
    if (n == 6 && strcmp(word[2], "secures") == 0) {
        int hinge = index_of(word[3], WORLD_HINGES);
        if (hinge < 0) {
            return false;
        }
        latch->secures[hinge] = true;
        latch->closed_rad[hinge] = atof(word[4]);
        latch->range_rad[hinge] = atof(word[5]);
        return true;
    }
    return n == 4 && set(latch_fields, latch, word[2], word[3]);
}

static bool take(int n, char **word) {
    if (n == 2 && strcmp(word[0], "seed") == 0) {
        world.seed = strtoull(word[1], NULL, 10);
        return true;
    }
    if (n == 2) {
        return set(world_fields, &world, word[0], word[1]);
    }
    if (n == 4 && strcmp(word[0], "hinge") == 0) {
        int k = index_of(word[1], WORLD_HINGES);
        if (k < 0) {
            return false;
        }
        world.hinge[k].present = true;
        return set(hinge_fields, &world.hinge[k], word[2], word[3]);
    }
    return n >= 4 && strcmp(word[0], "latch") == 0 && take_latch(n, word);
}

bool world_read(const char *path, char *wrong, int wrong_size) {
    FILE *file = fopen(path, "r");
    if (file == NULL) {
        snprintf(wrong, (size_t)wrong_size, "%s: cannot be opened", path);
        return false;
    }
    char line[256];
    bool good = true;
    for (int number = 1; good && fgets(line, sizeof line, file) != NULL; number++) {
        char *word[WORDS], *rest = NULL;
        int n = 0;
        for (char *w = strtok_r(line, " \n", &rest); w != NULL && n < WORDS; w = strtok_r(NULL, " \n", &rest)) {
            word[n++] = w;
        }
        good = n == 0 || take(n, word);
        if (!good) {
            snprintf(wrong, (size_t)wrong_size, "%s:%d: not understood", path, number);
        }
    }
    fclose(file);
    if (good) {
        world_settle();
    }
    return good;
}
