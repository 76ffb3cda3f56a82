/* Commands that every emulation knows: about the world, the cable and the record of pulses. */
#ifndef ORI_COMMANDS_H
#define ORI_COMMANDS_H

#include "control.h"

/* The emulation's side of them. */
typedef struct {
    const char *link;               /* name of the port */
    uint64_t pulse_hz;              /* units of recorded pulses */
    void (*catch_up)(void);         /* bring the world to now */
    uint64_t (*now_us)(void);
    void (*feed)(const uint8_t *data, size_t size); /* bytes as if the host had sent them */
} emulation_t;

void commands_offer(const emulation_t *emulation);

/* Bytes that the device has sent, for those who tap the line. */
void commands_tap(const uint8_t *data, size_t size);

#endif
