# The port to Linux, with a simulated board around it: build/ori_host. Included from ../Makefile.
BUILD ?= build
PYTHON ?= $(firstword $(wildcard ../.venv/bin/python) python3)
CORE ?= core
HOST_CC ?= gcc
BOARD := ../sim_backends/microcontroller

ifndef CODECS
CODECS := $(BUILD)/generated/.made
$(CODECS): ../tools/generate_codecs.py ../ori_deploy/wire/ori_deploy.xml
	$(PYTHON) ../tools/generate_codecs.py c $(BUILD)/generated
	@touch $@
endif

HOST_FLAGS := -std=c11 -D_GNU_SOURCE -O2 -g -Wall -Wextra -Werror -ffp-contract=off -DMAVLINK_COMM_NUM_BUFFERS=1
HOST_INCLUDES = -iquote $(CORE) -iquote core -iquote port_host -iquote $(BOARD) \
	-isystem $(BUILD)/generated -isystem $(BUILD)/generated/ori_deploy
HOST_BOARD := cable commands control plug pulses world world_file
HOST_OBJECTS = $(patsubst $(CORE)/%.c,$(BUILD)/host/core/%.o,$(wildcard $(CORE)/*.c)) \
	$(patsubst port_host/%.c,$(BUILD)/host/port/%.o,$(wildcard port_host/*.c)) $(HOST_BOARD:%=$(BUILD)/host/board/%.o)

define HOST_COMPILE
@mkdir -p $(@D)
$(HOST_CC) $(HOST_FLAGS) $(HOST_INCLUDES) -MMD -MP -c $< -o $@
endef

$(BUILD)/host/core/%.o: $(CORE)/%.c $(CODECS)
	$(HOST_COMPILE)

$(BUILD)/host/port/%.o: port_host/%.c
	$(HOST_COMPILE)

$(BUILD)/host/board/%.o: $(BOARD)/%.c
	$(HOST_COMPILE)

$(BUILD)/ori_host: $(HOST_OBJECTS)
	$(HOST_CC) $(HOST_FLAGS) $^ -lutil -lm -o $@

-include $(HOST_OBJECTS:.o=.d)
