#include "fake_port.h"

#include <string.h>

#include "check.h"

fake_t fake;

void fake_reset(void)
{
    memset(&fake, 0, sizeof fake);
    memset(fake.eeprom, 0xff, sizeof fake.eeprom);
    fake.eeprom_left = UINT32_MAX;
    fake.send_room = UINT16_MAX;
    fake.micros = 1000000;
}

void fake_type(const void *bytes, uint32_t size)
{
    if (fake.to_device_taken == fake.to_device_size)
        fake.to_device_taken = fake.to_device_size = 0;
    CHECK(fake.to_device_size + size <= FAKE_BUFFER);
    memcpy(fake.to_device + fake.to_device_size, bytes, size);
    fake.to_device_size += size;
}

uint64_t port_micros(void)
{
    return fake.micros;
}

void port_servo(uint8_t output, uint16_t ticks)
{
    CHECK(output < ORI_SERVO_OUTPUTS);
    fake.servo[output] = ticks;
    fake.servo_calls++;
}

void port_magnet(uint8_t output, bool on)
{
    CHECK(output < ORI_MAGNET_OUTPUTS);
    fake.magnet[output] = on;
    fake.magnet_calls++;
}

uint16_t port_adc(uint8_t input)
{
    CHECK(input < sizeof fake.adc / sizeof fake.adc[0]);
    return fake.adc[input];
}

uint8_t port_sensors(void)
{
    return fake.sensors;
}

bool port_estop(void)
{
    return fake.estop;
}

int16_t port_receive(void)
{
    return fake.to_device_taken < fake.to_device_size ? fake.to_device[fake.to_device_taken++] : -1;
}

uint16_t port_send_room(void)
{
    return fake.send_room;
}

void port_send(const uint8_t *data, uint16_t size)
{
    CHECK(size <= fake.send_room);
    if (fake.send_room != UINT16_MAX)
        fake.send_room = (uint16_t)(fake.send_room - size);
    if (fake.from_device_size + size > FAKE_BUFFER)
        fake.from_device_size = 0; /* nobody reads */
    memcpy(fake.from_device + fake.from_device_size, data, size);
    fake.from_device_size += size;
}

void port_eeprom_read(uint16_t address, void *data, uint16_t size)
{
    CHECK((uint32_t)address + size <= FAKE_EEPROM);
    memcpy(data, fake.eeprom + address, size);
}

void port_eeprom_write(uint16_t address, const void *data, uint16_t size)
{
    CHECK((uint32_t)address + size <= FAKE_EEPROM);
    for (uint16_t i = 0; i < size; i++) {
        const uint16_t at = (uint16_t)(address + i);
        if (fake.eeprom_left == 0)
            return;
        fake.eeprom_left -= fake.eeprom_left != UINT32_MAX;
        fake.eeprom_written++;
        if (at < fake.worn_from || at >= fake.worn_to)
            fake.eeprom[at] = ((const uint8_t *)data)[i];
    }
}

void port_watchdog_kick(void)
{
    fake.kicks++;
}

port_reset_t port_reset_cause(void)
{
    return fake.reset_cause;
}

port_kept_t *port_kept(void)
{
    return &fake.kept;
}

const char *port_name(void)
{
    return "fake";
}
