# The port to the ATmega2560: build/ori_atmega2560.elf and .hex. Included from ../Makefile.
BUILD ?= build
PYTHON ?= $(firstword $(wildcard ../.venv/bin/python) python3)
CORE ?= core
AVR_CC ?= avr-gcc
PORT ?= /dev/ttyACM0

ifndef CODECS
CODECS := $(BUILD)/generated/.made
$(CODECS): ../tools/generate_codecs.py ../ori_deploy/wire/ori_deploy.xml
	$(PYTHON) ../tools/generate_codecs.py c $(BUILD)/generated
	@touch $@
endif

AVR_FLAGS := -mmcu=atmega2560 -DF_CPU=16000000UL -std=c11 -Os -Wall -Wextra -Werror \
	-ffunction-sections -fdata-sections -DMAVLINK_COMM_NUM_BUFFERS=1
AVR_INCLUDES = -iquote $(CORE) -iquote core -iquote port_atmega2560 -isystem $(BUILD)/generated -isystem $(BUILD)/generated/ori_deploy
AVR_OBJECTS = $(patsubst $(CORE)/%.c,$(BUILD)/atmega2560/core/%.o,$(wildcard $(CORE)/*.c)) \
	$(patsubst port_atmega2560/%.c,$(BUILD)/atmega2560/port/%.o,$(wildcard port_atmega2560/*.c))

define AVR_COMPILE
@mkdir -p $(@D)
$(AVR_CC) $(AVR_FLAGS) $(AVR_INCLUDES) -MMD -MP -c $< -o $@
endef

$(BUILD)/atmega2560/core/%.o: $(CORE)/%.c $(CODECS)
	$(AVR_COMPILE)

$(BUILD)/atmega2560/port/%.o: port_atmega2560/%.c
	$(AVR_COMPILE)

$(BUILD)/ori_atmega2560.elf: $(AVR_OBJECTS)
	$(AVR_CC) $(AVR_FLAGS) -Wl,--gc-sections -Wl,-Map=$(@:.elf=.map) $^ -o $@

%.hex: %.elf
	avr-objcopy -O ihex -R .eeprom $< $@

.PHONY: size flash
size: $(BUILD)/ori_atmega2560.elf
	@avr-size -A $< | awk '$$1 == ".text" {t = $$2} $$1 == ".data" {d = $$2} $$1 == ".bss" {b = $$2} \
		$$1 == ".noinit" {n = $$2} END {print "flash " t + d " of 262144 bytes, static RAM " d + b + n " of 8192 bytes"}'

flash: $(BUILD)/ori_atmega2560.hex
	avrdude -c wiring -p m2560 -b 115200 -D -P $(PORT) -U flash:w:$<:i

-include $(AVR_OBJECTS:.o=.d)
