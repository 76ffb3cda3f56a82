#include "supply.h"

#include "port.h"

static uint8_t low_frames;

uint16_t supply_mv(void)
{
    const uint32_t mv = (uint32_t)((uint64_t)port_adc(ORI_ADC_SUPPLY) * config.device.supply_uv_per_count / 1000U);
    return mv > UINT16_MAX ? UINT16_MAX : (uint16_t)mv;
}

bool supply_is_low(void)
{
    return supply_mv() < config.device.supply_min_mv;
}

bool supply_step(bool driven)
{
    low_frames = !driven || !supply_is_low() ? 0 : low_frames < SUPPLY_LOW_FRAMES ? (uint8_t)(low_frames + 1) : low_frames;
    return low_frames >= SUPPLY_LOW_FRAMES;
}
