/* The log: the last events, until they are sent. */
#ifndef ORI_EVENTS_H
#define ORI_EVENTS_H

#include "wire.h"

#define EVENTS_KEPT 8U

void events_note(uint8_t code, uint8_t index, int32_t value);
/* The oldest event that has not been taken; false when there is none. */
bool events_take(mavlink_ori_event_t *event);

#endif
