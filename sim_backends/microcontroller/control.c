#include "control.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#define CLIENTS 8
#define WORDS 12
#define TABLES 8
#define LINE 20000
#define OTHERS 4 /* server, two of the caller's, standard output */

static struct {
    int fd;
    size_t size;
    char line[LINE];
} clients[CLIENTS];

static const command_t *tables[TABLES];
static int n_tables, server = -1;
static char socket_path[108];

/* -- replies ---------------------------------------------------------------------------------------- */

void reply_add(reply_t *reply, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    va_list again;
    va_copy(again, arguments);
    size_t wanted = (size_t)vsnprintf(NULL, 0, format, arguments);
    if (reply->size + wanted + 1U > reply->room) {
        reply->room = 2U * (reply->size + wanted + 1U);
        reply->text = realloc(reply->text, reply->room);
    }
    reply->size += (size_t)vsnprintf(reply->text + reply->size, wanted + 1U, format, again);
    va_end(again);
    va_end(arguments);
}

void reply_hex(reply_t *reply, const uint8_t *data, size_t size) {
    reply_add(reply, "\"");
    for (size_t i = 0; i < size; i++) {
        reply_add(reply, "%02x", data[i]);
    }
    reply_add(reply, "\"");
}

void reply_fail(reply_t *reply, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(reply->error, sizeof reply->error, format, arguments);
    va_end(arguments);
}

long long number(const char *text, long long least, long long most, reply_t *reply) {
    char *end;
    long long value = strtoll(text, &end, 10);
    if (end == text || *end != 0 || value < least || value > most) {
        reply_fail(reply, "%.40s is no number from %lld to %lld", text, least, most);
        return 0;
    }
    return value;
}

size_t bytes(const char *hex, uint8_t *data, size_t room, reply_t *reply) {
    size_t n = strlen(hex) / 2U;
    for (size_t i = 0; i < n && i < room; i++) {
        char pair[3] = {hex[2U * i], hex[2U * i + 1U], 0};
        char *end;
        data[i] = (uint8_t)strtoul(pair, &end, 16);
        if (*end != 0) {
            reply_fail(reply, "%.10s: no hexadecimal digits", pair);
        }
    }
    if (n > room || strlen(hex) % 2U != 0U) {
        reply_fail(reply, "not an even number of digits, or more than %zu bytes", room);
    }
    return reply->error[0] != 0 ? 0U : n;
}

/* -- commands --------------------------------------------------------------------------------------- */

void control_offer(const command_t *commands) {
    if (n_tables < TABLES) {
        tables[n_tables++] = commands;
    }
}

static const command_t *find(const char *name) {
    for (int i = 0; i < n_tables; i++) {
        for (const command_t *command = tables[i]; command->name != NULL; command++) {
            if (strcmp(command->name, name) == 0) {
                return command;
            }
        }
    }
    return NULL;
}

static void obey(char *line, reply_t *reply) {
    char *word[WORDS], *rest = NULL;
    int n = 0;
    for (char *w = strtok_r(line, " \r\n", &rest); w != NULL && n < WORDS; w = strtok_r(NULL, " \r\n", &rest)) {
        word[n++] = w;
    }
    const command_t *command = n > 0 ? find(word[0]) : NULL;
    if (command == NULL) {
        reply_fail(reply, "there is no command %.40s", n > 0 ? word[0] : "without a name");
    } else if (n - 1 < command->least || n - 1 > command->most) {
        reply_fail(reply, "%s takes %d to %d words", command->name, command->least, command->most);
    } else {
        command->act(word + 1, n - 1, reply);
    }
}

static void answer(int fd, char *line) {
    reply_t reply = {0};
    reply_add(&reply, "{\"ok\": ");
    size_t before = reply.size;
    obey(line, &reply);
    if (reply.error[0] != 0) {
        reply.size = 0;
        reply_add(&reply, "{\"error\": \"");
        for (const char *c = reply.error; *c != 0; c++) {
            reply_add(&reply, "%c", *c == '"' || *c == '\\' || !isprint((unsigned char)*c) ? '?' : *c);
        }
        reply_add(&reply, "\"}\n");
    } else {
        reply_add(&reply, "%s}\n", reply.size == before ? "null" : "");
    }
    for (size_t sent = 0; sent < reply.size;) {
        ssize_t n = send(fd, reply.text + sent, reply.size - sent, MSG_NOSIGNAL);
        if (n <= 0) {
            break;
        }
        sent += (size_t)n;
    }
    free(reply.text);
}

/* -- the socket ------------------------------------------------------------------------------------- */

void control_open(const char *path) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    for (int i = 0; i < CLIENTS; i++) {
        clients[i].fd = -1;
    }
    if (strlen(path) >= sizeof address.sun_path) {
        fprintf(stderr, "%s: too long for a socket's name\n", path);
        exit(2);
    }
    snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    snprintf(socket_path, sizeof socket_path, "%s", path);
    unlink(path);
    server = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (server < 0 || bind(server, (struct sockaddr *)&address, sizeof address) != 0 || listen(server, CLIENTS) != 0) {
        fprintf(stderr, "%s: %s\n", path, strerror(errno));
        exit(2);
    }
}

static void accept_client(void) {
    int fd = accept4(server, NULL, NULL, SOCK_CLOEXEC);
    for (int i = 0; fd >= 0 && i < CLIENTS; i++) {
        if (clients[i].fd < 0) {
            struct timeval patience = {.tv_sec = 1};
            setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
            clients[i].fd = fd;
            clients[i].size = 0;
            return;
        }
    }
    if (fd >= 0) {
        close(fd);
    }
}

static void hear(int i) {
    size_t size = clients[i].size;
    ssize_t n = recv(clients[i].fd, clients[i].line + size, LINE - 1U - size, MSG_DONTWAIT);
    if (n < 0 && errno == EAGAIN) {
        return;
    }
    if (n <= 0) { /* gone, or talks without end */
        close(clients[i].fd);
        clients[i].fd = -1;
        return;
    }
    clients[i].size = size += (size_t)n;
    char *end;
    while ((end = memchr(clients[i].line, '\n', clients[i].size)) != NULL) {
        *end = 0;
        answer(clients[i].fd, clients[i].line);
        size_t used = (size_t)(end + 1 - clients[i].line);
        clients[i].size -= used;
        memmove(clients[i].line, end + 1, clients[i].size);
    }
}

void control_serve(int other, int another, int timeout_us) {
    struct pollfd fds[CLIENTS + OTHERS];
    fds[0] = (struct pollfd){.fd = server, .events = POLLIN};
    fds[1] = (struct pollfd){.fd = other, .events = POLLIN};
    fds[2] = (struct pollfd){.fd = another, .events = POLLIN};
    fds[3] = (struct pollfd){.fd = STDOUT_FILENO}; /* an error: whoever started this is gone */
    for (int i = 0; i < CLIENTS; i++) {
        fds[OTHERS + i] = (struct pollfd){.fd = clients[i].fd, .events = POLLIN};
    }
    struct timespec wait = {.tv_sec = timeout_us / 1000000, .tv_nsec = timeout_us % 1000000 * 1000L};
    if (ppoll(fds, CLIENTS + OTHERS, timeout_us < 0 ? NULL : &wait, NULL) <= 0) {
        return;
    }
    if ((fds[3].revents & POLLERR) != 0) {
        raise(SIGTERM);
    }
    if (fds[0].revents != 0) {
        accept_client();
    }
    for (int i = 0; i < CLIENTS; i++) {
        if (fds[OTHERS + i].fd >= 0 && fds[OTHERS + i].revents != 0) {
            hear(i);
        }
    }
}

void control_close(void) {
    if (server >= 0) {
        unlink(socket_path);
        close(server);
        server = -1;
    }
}
