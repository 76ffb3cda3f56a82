/* Drives the fuzz target without libFuzzer: the same seed gives the same run, on every machine.
 *
 * Usage: fuzzer [--seed N] [--bytes N] [--inputs N] [FILE...]
 *   --bytes   raw random bytes on the line, frames passing in between: the device must do nothing
 *   --inputs  random programs for the target
 *   FILE      inputs as libFuzzer leaves them behind
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "core.h"
#include "rig.h"
#include "watch.h"

#define LONGEST_INPUT 8192U

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static uint32_t seed = 1;

static void check_nothing_is_on(void)
{
    for (unsigned i = 0; i < ORI_SERVO_OUTPUTS; i++)
        CHECK_EQUAL(fake.servo[i], 0);
    for (unsigned i = 0; i < ORI_MAGNET_OUTPUTS; i++)
        CHECK(!fake.magnet[i]);
}

/* Some of the bytes look like the beginning of a frame of the host's, or the parser would hardly leave its first state. */
static void fill(uint8_t *bytes, uint32_t count)
{
    static const uint8_t begin[] = {0xfd, 3, 0, 0, 0, 255, 190, 0x55, 0xd3, 0};
    for (uint32_t i = 0; i < count; i++)
        bytes[i] = (uint8_t)random_below(&seed, 256);
    if (count > sizeof begin && random_below(&seed, 4) == 0) {
        const uint32_t at = random_below(&seed, count - (uint32_t)sizeof begin);
        memcpy(bytes + at, begin, sizeof begin);
        bytes[at + 1] = (uint8_t)random_below(&seed, 256);
        bytes[at + 7] = (uint8_t)(0x54 + random_below(&seed, 18));
    }
}

/* No more than a good frame by chance in 2^16: what one in 10^7 bytes might do, a command of the latches, is told apart
 * by the checks of the target; here nothing is to move at all. */
static void fuzz_raw(uint64_t bytes)
{
    uint8_t chunk[230]; /* a frame's time at 115200 baud */
    const step_t frame = {.frame = true};
    rig_start();
    watch_begin();
    for (uint64_t sent = 0; sent < bytes; sent += sizeof chunk) {
        fill(chunk, sizeof chunk);
        fake_type(chunk, sizeof chunk);
        while (fake.to_device_taken < fake.to_device_size)
            core_poll();
        fake.from_device_size = 0;
        frame_passes();
        watch_step(&frame);
        check_nothing_is_on();
    }
}

static void fuzz_inputs(uint64_t count)
{
    static uint8_t input[LONGEST_INPUT];
    for (uint64_t n = 0; n < count; n++) {
        const uint32_t size = 64 + random_below(&seed, LONGEST_INPUT - 63);
        const uint32_t start = seed;
        for (uint32_t i = 0; i < size; i++)
            input[i] = (uint8_t)random_below(&seed, 256);
        if (getenv("FUZZ_TELL"))
            fprintf(stderr, "input %" PRIu64 ": state %" PRIu32 "\n", n, start);
        (void)LLVMFuzzerTestOneInput(input, size);
    }
}

static void run_file(const char *name)
{
    static uint8_t input[65536];
    FILE *file = fopen(name, "rb");
    CHECK(file != NULL);
    const size_t size = fread(input, 1, sizeof input, file);
    fclose(file);
    (void)LLVMFuzzerTestOneInput(input, size);
}

static void tell(void)
{
    static const char *const names[] = {"unconfigured", "idle", "holding", "streaming", "braking", "faulted"};
    printf("%" PRIu64 " steps, %" PRIu64 " knots taken; states", watch_steps, watch_knots);
    for (unsigned i = 0; i < 6; i++)
        printf(" %s %" PRIu64, names[i], watch_states[i]);
    printf("; faults");
    for (unsigned i = 1; i < ORI_FAULT_ENUM_END; i++)
        printf(" %" PRIu64, watch_faults[i]);
    putchar('\n');
}

int main(int count, char **arguments)
{
    uint64_t bytes = 0, inputs = 0;
    for (int i = 1; i < count; i++) {
        const bool has_value = i + 1 < count;
        if (has_value && strcmp(arguments[i], "--seed") == 0)
            seed = (uint32_t)strtoul(arguments[++i], NULL, 10);
        else if (has_value && strcmp(arguments[i], "--bytes") == 0)
            bytes = strtoull(arguments[++i], NULL, 10);
        else if (has_value && strcmp(arguments[i], "--inputs") == 0)
            inputs = strtoull(arguments[++i], NULL, 10);
        else
            run_file(arguments[i]);
    }
    fuzz_raw(bytes);
    fuzz_inputs(inputs);
    tell();
    return 0;
}
