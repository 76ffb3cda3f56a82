#include "plug.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <libgen.h>
#include <pty.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <termios.h>
#include <unistd.h>

static int master = -1, slave = -1;
static char device[64], link_path[512];

static void fail(const char *what) {
    fprintf(stderr, "%s: %s\n", what, strerror(errno));
    exit(2);
}

/* Where the link will be, whatever way its folder was named; to be freed. */
static char *whole_name(const char *link) {
    char *copy = strdup(link), *another = strdup(link), *whole = NULL;
    char *folder = realpath(dirname(copy), NULL);
    if (folder == NULL || asprintf(&whole, "%s/%s", folder, basename(another)) < 0) {
        fail(link);
    }
    free(copy);
    free(another);
    free(folder);
    return whole;
}

/* A name that Linux gives to one process alone, until it ends. */
static void claim(const char *link) {
    static int held = -1;
    struct stat found;
    if (held >= 0) {
        return;
    }
    if (lstat(link, &found) == 0 && !S_ISLNK(found.st_mode)) {
        fprintf(stderr, "%s: there is a file of this name; choose another\n", link);
        exit(2);
    }
    char *whole = whole_name(link);
    uint64_t hash = 0xCBF29CE484222325U;
    for (const char *c = whole; *c != 0; c++) {
        hash = (hash ^ (uint8_t)*c) * 0x100000001B3U;
    }
    free(whole);
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path + 1, sizeof address.sun_path - 1U, "ori-microcontroller-%016" PRIx64, hash);
    held = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (held < 0 || bind(held, (struct sockaddr *)&address, sizeof address) != 0) {
        fprintf(stderr, "%s: another microcontroller has it; end that one, or choose another\n", link);
        exit(2);
    }
}

void plug_in(const char *link) {
    if (master >= 0) {
        return;
    }
    claim(link);
    struct termios raw;
    memset(&raw, 0, sizeof raw);
    cfmakeraw(&raw);
    /* The slave is held open: a pty without one reports a hang-up. */
    if (openpty(&master, &slave, device, NULL, NULL) != 0 || tcgetattr(slave, &raw) != 0) {
        fail("openpty");
    }
    cfmakeraw(&raw);
    tcsetattr(slave, TCSANOW, &raw);
    fcntl(master, F_SETFL, O_NONBLOCK);
    fcntl(master, F_SETFD, FD_CLOEXEC);
    char fresh[600];
    snprintf(link_path, sizeof link_path, "%s", link);
    snprintf(fresh, sizeof fresh, "%s.%d", link, (int)getpid());
    unlink(fresh);
    if (symlink(device, fresh) != 0 || rename(fresh, link) != 0) {
        fail(link);
    }
}

void plug_out(void) {
    if (master < 0) {
        return;
    }
    char target[64];
    ssize_t n = readlink(link_path, target, sizeof target - 1U);
    if (n > 0 && (target[n] = 0, strcmp(target, device) == 0)) {
        unlink(link_path);
    }
    close(slave);
    close(master);
    master = slave = -1;
}

int plug_fileno(void) {
    return master;
}

const char *plug_device(void) {
    return device;
}

size_t plug_receive(uint8_t *data, size_t size) {
    ssize_t n = master < 0 ? 0 : read(master, data, size);
    return n > 0 ? (size_t)n : 0U;
}

size_t plug_send(const uint8_t *data, size_t size) {
    size_t sent = 0;
    while (master >= 0 && sent < size) {
        ssize_t n = write(master, data + sent, size - sent);
        if (n <= 0) {
            break;
        }
        sent += (size_t)n;
    }
    return sent;
}
