/* The control socket: lines of words in, lines of JSON out, {"ok": ...} or {"error": "..."}. */
#ifndef ORI_CONTROL_H
#define ORI_CONTROL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    char *text;
    size_t size, room;
    char error[256];
} reply_t;

typedef struct {
    const char *name;
    int least, most; /* words after the name */
    void (*act)(char **word, int words, reply_t *reply);
} command_t;

void reply_add(reply_t *reply, const char *format, ...) __attribute__((format(printf, 2, 3)));
void reply_hex(reply_t *reply, const uint8_t *data, size_t size);
void reply_fail(reply_t *reply, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Numbers of a command; without one, or outside the limits, the reply fails and 0 is given. */
long long number(const char *text, long long least, long long most, reply_t *reply);
size_t bytes(const char *hex, uint8_t *data, size_t room, reply_t *reply);

/* Adds commands, up to one without a name; then opens the socket. On trouble says so and ends the process. */
void control_offer(const command_t *commands);
void control_open(const char *path);

/* Waits at most so long (-1: for ever) for a command, or for bytes on one of two other descriptors (-1: none), and obeys
 * what has come. */
void control_serve(int other, int another, int timeout_us);

void control_close(void);

#endif
