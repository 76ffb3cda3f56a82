/* The fault table: what each reason does, and what ends it. */
#ifndef ORI_FAULTS_H
#define ORI_FAULTS_H

#include "wire.h"

typedef enum {
    CLEARABLE,      /* by ORI_FAULT_CLEAR, once its cause is gone */
    UNTIL_CONFIGURED, /* by a new configuration */
    PERMANENT       /* by cycling power */
} fault_end_t;

fault_end_t fault_end(uint8_t fault);

/* What was found wrong, and with which hinge. */
typedef struct {
    uint8_t fault; /* ORI_FAULT_NONE when all is well */
    uint8_t hinge;
} verdict_t;

/* The latched fault: the first one stays, unless a graver one comes. Every fault is graver than the host's own wish to
 * brake, which would hide what it braked for; and one that only power ends is not to be cleared with another. */
uint8_t fault_latched(void);
uint8_t fault_index(void);

/* Latch a fault unless one as grave is. Returns whether it was latched now. */
bool fault_trip(uint8_t fault, uint8_t index);
void fault_forget(void);

#endif
