#include "events.h"

#include "port.h"

static mavlink_ori_event_t kept[EVENTS_KEPT];
static uint16_t noted;
static uint16_t taken;

void events_note(uint8_t code, uint8_t index, int32_t value)
{
    kept[noted % EVENTS_KEPT] =
        (mavlink_ori_event_t){.time_us = port_micros(), .value = value, .number = noted, .code = code, .index = index};
    noted++;
    if ((uint16_t)(noted - taken) > EVENTS_KEPT)
        taken = (uint16_t)(noted - EVENTS_KEPT);
}

bool events_take(mavlink_ori_event_t *event)
{
    if (taken == noted)
        return false;
    *event = kept[taken % EVENTS_KEPT];
    taken++;
    return true;
}
