/* The pty that a host opens in place of the board's USB, and the link by which it finds it. */
#ifndef ORI_PLUG_H
#define ORI_PLUG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Opens a pty and lets the link point at it; on trouble says so and ends the process. */
void plug_in(const char *link);

/* Closes it: whoever has it open is hung up on. The link goes, too. */
void plug_out(void);

/* To wait on; -1 while unplugged. */
int plug_fileno(void);

const char *plug_device(void);

/* Bytes from the host; 0 when there are none. */
size_t plug_receive(uint8_t *data, size_t size);

/* Bytes to the host. What it does not take is lost, as on a real line; returns what it took. */
size_t plug_send(const uint8_t *data, size_t size);

#endif
