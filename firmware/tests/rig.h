/* A device with a configuration, and a host that talks to it, for tests. */
#ifndef ORI_RIG_H
#define ORI_RIG_H

#include "config.h"
#include "fake_port.h"
#include "frames.h"

#define RIG_HINGES 3U
#define RIG_LATCHES 3U
#define SILENCE_MS 150U
#define BRAKE_MS 60U

/* Records that are as good as any. Hinges: -1 to 1.5 rad, 2 rad/s, 20 rad/s^2, pulses 1.5 ms + 0.6 ms / rad, feedback of
 * 4 mrad per count. Latches: an electromagnet, a lock pin, a passive magnet; sensor inputs as their index. */
mavlink_ori_config_device_t rig_device(uint8_t hinges, uint8_t latches);
mavlink_ori_config_hinge_t rig_hinge(uint8_t index);
mavlink_ori_config_latch_t rig_latch(uint8_t index);

/* Hash of records as the wire defines it. */
uint32_t rig_hash(const mavlink_ori_config_device_t *device, const mavlink_ori_config_hinge_t *hinges,
                  const mavlink_ori_config_latch_t *latches);

/* Store a configuration, by the core's own functions. */
void rig_store(const mavlink_ori_config_device_t *device, const mavlink_ori_config_hinge_t *hinges,
               const mavlink_ori_config_latch_t *latches);

/* A fresh device with the records above stored, started and idle; every hinge measured at 0. */
void rig_start(void);
void rig_restart(port_reset_t cause);

/* Let a hinge be measured there. */
void rig_place(uint8_t hinge, double rad);
/* Pulse that a hinge should get at a position, in ticks. */
uint16_t rig_ticks(uint8_t hinge, double rad);

/* Say something, and let the device take it in. */
void host_says(kind_t kind, const void *payload);
/* Let the device take in all that was said, and once more. */
void poll_all(void);
/* Say a command and return the answer. */
mavlink_ori_ack_t host_commands(kind_t kind, const void *payload);
uint16_t host_token(void);

uint8_t host_enable(uint16_t hinges, const int32_t *position_urad, uint8_t stream);
uint8_t host_disable(uint16_t hinges);
uint8_t host_clear(uint8_t fault);
uint8_t host_latch(uint8_t index, uint8_t engage);
void host_polls(void);
mavlink_ori_state_t host_state(void);
mavlink_ori_latch_state_t host_latches(void);

/* One knot: all hinges at the same place and speed. */
void host_knot(uint8_t stream, uint16_t number, uint64_t time_us, int32_t position_urad, int16_t velocity_mrad_s);

/* Let a frame pass; the frame that began is told to the device. */
void frame_passes(void);
/* Let some pass, the host saying that it lives in each, and hinges following their outputs. */
void frames_pass(unsigned count);
void hinges_follow(void);

#endif
