#include "faults.h"

static const uint8_t ends[] = {
    [ORI_FAULT_NONE] = CLEARABLE,
    [ORI_FAULT_HOST_SILENT] = CLEARABLE,
    [ORI_FAULT_UNDERRUN] = CLEARABLE,
    [ORI_FAULT_POSITION_LIMIT] = CLEARABLE,
    [ORI_FAULT_VELOCITY_LIMIT] = CLEARABLE,
    [ORI_FAULT_ACCELERATION_LIMIT] = CLEARABLE,
    [ORI_FAULT_DISCONTINUITY] = CLEARABLE,
    [ORI_FAULT_KNOT_TIME] = CLEARABLE,
    [ORI_FAULT_STALL] = CLEARABLE,
    [ORI_FAULT_SUPPLY_LOW] = CLEARABLE,
    [ORI_FAULT_ESTOP] = CLEARABLE,
    [ORI_FAULT_WATCHDOG_RESET] = CLEARABLE,
    [ORI_FAULT_BROWN_OUT] = CLEARABLE,
    [ORI_FAULT_CONFIG_CORRUPT] = UNTIL_CONFIGURED,
    [ORI_FAULT_INTERNAL] = PERMANENT,
    [ORI_FAULT_HOST_BRAKE] = CLEARABLE,
    [ORI_FAULT_FEEDBACK_LOST] = CLEARABLE,
};

static uint8_t latched = ORI_FAULT_NONE;
static uint8_t about = ORI_NOBODY;

fault_end_t fault_end(uint8_t fault)
{
    return fault < sizeof ends ? (fault_end_t)ends[fault] : PERMANENT;
}

uint8_t fault_latched(void)
{
    return latched;
}

uint8_t fault_index(void)
{
    return about;
}

static uint8_t gravity(uint8_t fault)
{
    if (fault == ORI_FAULT_NONE)
        return 0;
    if (fault == ORI_FAULT_HOST_BRAKE)
        return 1;
    return fault_end(fault) == PERMANENT ? 3 : 2;
}

bool fault_trip(uint8_t fault, uint8_t index)
{
    if (gravity(fault) <= gravity(latched))
        return false;
    latched = fault;
    about = index;
    return true;
}

void fault_forget(void)
{
    latched = ORI_FAULT_NONE;
    about = ORI_NOBODY;
}
