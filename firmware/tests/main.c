/* Runs the tests, each in a process of its own, so that none sees what another left behind.
 *
 * Usage: unit [--first] [SUBJECT...]   with --first the first failure ends the run; subjects named come first.
 * A subject stands for its parts as well: machine for machine_start and the like.
 */
#define _POSIX_C_SOURCE 200809L
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "check.h"

#define LONGEST_TEST_S 60U
#define LONGEST_TEST_OF_MUTANTS_S 2U

extern const suite_t suite_queue, suite_motion_limits, suite_hinges_drive, suite_hinges_watch,
    suite_latches_drive, suite_latches_heat, suite_faults, suite_config_records, suite_config_slots,
    suite_machine_start, suite_machine_commands, suite_machine_stream, suite_machine_silence,
    suite_machine_braking, suite_machine_faults, suite_machine_config, suite_supply, suite_events,
    suite_messages_frames, suite_messages_answers, suite_messages_unasked;

static const suite_t *const suites[] = {
    &suite_queue, &suite_motion_limits, &suite_hinges_drive, &suite_hinges_watch,
    &suite_latches_drive, &suite_latches_heat, &suite_faults, &suite_config_records, &suite_config_slots,
    &suite_machine_start, &suite_machine_commands, &suite_machine_stream,
    &suite_machine_silence, &suite_machine_braking, &suite_machine_faults, &suite_machine_config, &suite_supply,
    &suite_events, &suite_messages_frames, &suite_messages_answers, &suite_messages_unasked,
};
#define SUITES (sizeof suites / sizeof suites[0])

static bool only_first;
static unsigned run, failed;

static void run_test(const suite_t *suite, const test_t *test)
{
    int status = 0;
    fflush(stdout);
    const pid_t child = fork();
    if (child == 0) {
        alarm(only_first ? LONGEST_TEST_OF_MUTANTS_S : LONGEST_TEST_S);
        test->run();
        _exit(0);
    }
    waitpid(child, &status, 0);
    run++;
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0)
        return;
    failed++;
    printf("FAILED %s: %s", suite->name, test->name);
    if (WIFSIGNALED(status))
        printf(" (%s)", strsignal(WTERMSIG(status)));
    putchar('\n');
}

static void run_suite(const suite_t *suite)
{
    for (unsigned i = 0; i < suite->count && !(only_first && failed); i++)
        run_test(suite, &suite->tests[i]);
}

static bool is_named(const suite_t *suite, int count, char **names)
{
    for (int i = 0; i < count; i++) {
        const size_t size = strlen(names[i]);
        if (strncmp(names[i], suite->name, size) == 0 && (suite->name[size] == '\0' || suite->name[size] == '_'))
            return true;
    }
    return false;
}

int main(int count, char **arguments)
{
    only_first = count > 1 && strcmp(arguments[1], "--first") == 0;
    const int skipped = only_first ? 2 : 1;
    char **names = arguments + skipped;
    count -= skipped;
    for (unsigned i = 0; i < SUITES; i++)
        if (is_named(suites[i], count, names))
            run_suite(suites[i]);
    for (unsigned i = 0; i < SUITES && (count == 0 || only_first); i++)
        if (!is_named(suites[i], count, names))
            run_suite(suites[i]);
    printf("%u tests, %u failed\n", run, failed);
    return failed || !run;
}
