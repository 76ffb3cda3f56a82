#include "machine.h"

#include "events.h"
#include "faults.h"
#include "fixed.h"
#include "hinges.h"
#include "latches.h"
#include "motion_limits.h"
#include "port.h"
#include "queue.h"
#include "supply.h"

#define FULL_RATE UINT32_C(65536)
/* A motion may begin this far from where the outputs are: what rounding on the way to the host and back makes. */
#define SAME_PLACE_URAD 200U

static uint8_t state;
static uint8_t stream;
static bool stream_open; /* knots are taken: from ORI_ENABLE to the next fault */
static uint16_t contiguous;
static uint64_t heard_us;
static config_status_t stored;

/* The profile's own time: it runs with the device's clock, and slower to its end while braking. */
static uint32_t profile_us;
static uint32_t rate;

static void go_to(uint8_t next)
{
    if (next != state)
        events_note(ORI_EVENT_STATE, next, state);
    state = next;
}

static void start_from_store(void)
{
    stored = config_load();
    hinges_init();
    latches_init();
    queue_clear();
    stream_open = false;
    if (stored == CONFIG_GOOD)
        events_note(ORI_EVENT_CONFIG, 0, (int32_t)config_hash());
    if (stored == CONFIG_CORRUPT)
        machine_trip(ORI_FAULT_CONFIG_CORRUPT, ORI_NOBODY);
    go_to(stored == CONFIG_NONE ? ORI_UNCONFIGURED : fault_latched() ? ORI_FAULTED : ORI_IDLE);
}

void machine_init(void)
{
    const port_reset_t cause = port_reset_cause();
    fault_forget();
    state = ORI_UNCONFIGURED;
    contiguous = 0;
    stream = 0;
    heard_us = 0;
    rate = FULL_RATE;
    events_note(ORI_EVENT_BOOT, (uint8_t)cause, 0);
    if (cause == PORT_RESET_WATCHDOG)
        machine_trip(ORI_FAULT_WATCHDOG_RESET, ORI_NOBODY);
    if (cause == PORT_RESET_BROWN_OUT)
        machine_trip(ORI_FAULT_BROWN_OUT, ORI_NOBODY);
    start_from_store();
}

uint8_t machine_state(void)
{
    return state;
}

uint8_t machine_stream(void)
{
    return stream;
}

uint16_t machine_contiguous(void)
{
    return contiguous;
}

uint8_t machine_queued(void)
{
    return queue_size();
}

void machine_heard(uint64_t now_us)
{
    heard_us = now_us;
}

/* Latch a fault. What moves brakes along what is queued; what rests goes on holding. */
void machine_trip(uint8_t fault, uint8_t index)
{
    if (!fault_trip(fault, index))
        return;
    events_note(ORI_EVENT_FAULT, fault, index);
    stream_open = false;
    if (state == ORI_STREAMING)
        go_to(ORI_BRAKING);
    else if (state != ORI_BRAKING)
        go_to(ORI_FAULTED);
}

/* Knots -------------------------------------------------------------------------------------------------------- */

static knot_t knot_of(const mavlink_ori_setpoints_t *setpoints, uint8_t j)
{
    knot_t knot = {.time_us = setpoints->time_us[j]};
    for (uint8_t k = 0; k < ORI_HINGES; k++) {
        knot.position_urad[k] = setpoints->position_urad[j * ORI_HINGES + k];
        knot.velocity_mrad_s[k] = setpoints->velocity_mrad_s[j * ORI_HINGES + k];
    }
    return knot;
}

/* A motion begins at rest, where the outputs are, and not before the outputs that are computed next: that is up to two
 * frames ahead, and what lies nearer would be caught up with in a jump. */
static verdict_t judge_beginning(const knot_t *knot)
{
    const uint32_t now = (uint32_t)port_micros();
    const int32_t ahead = (int32_t)(knot->time_us - now);
    if (ahead < (int32_t)(2 * ORI_FRAME_US) || ahead > (int32_t)(2 * LONGEST_SEGMENT_US))
        return (verdict_t){ORI_FAULT_KNOT_TIME, ORI_NOBODY};
    for (uint8_t k = 0; k < config.device.hinges; k++)
        if ((hinges_on() >> k) & 1U &&
            (knot->velocity_mrad_s[k] != 0 || distance(knot->position_urad[k], hinges_asked()[k]) > SAME_PLACE_URAD))
            return (verdict_t){ORI_FAULT_DISCONTINUITY, k};
    return (verdict_t){ORI_FAULT_NONE, ORI_NOBODY};
}

static verdict_t judge_knot(const knot_t *knot)
{
    const verdict_t alone = limits_of_knot(knot);
    if (alone.fault != ORI_FAULT_NONE)
        return alone;
    return queue_size() == 0 ? judge_beginning(knot) : limits_of_segment(queue_last(), knot);
}

/* Whether a knot was dealt with: taken, or refused for good. One that finds no room waits for its repetition. */
static bool take(const knot_t *knot)
{
    if (queue_full())
        return false;
    const verdict_t verdict = judge_knot(knot);
    if (verdict.fault != ORI_FAULT_NONE) {
        machine_trip(verdict.fault, verdict.hinge);
        return false;
    }
    if (queue_size() == 0) {
        profile_us = (uint32_t)port_micros();
        rate = FULL_RATE;
        go_to(ORI_STREAMING);
    }
    queue_push(knot);
    contiguous++;
    return true;
}

void machine_setpoints(const mavlink_ori_setpoints_t *setpoints)
{
    if (!stream_open || setpoints->stream != stream || setpoints->count < 1 || setpoints->count > 2)
        return;
    for (uint8_t j = 0; j < setpoints->count; j++) {
        const uint16_t number = (uint16_t)(setpoints->first + j);
        if (number != contiguous)
            continue; /* had it, or one before it is missing */
        const knot_t knot = knot_of(setpoints, j);
        if (!take(&knot))
            return;
    }
}

/* Commands ----------------------------------------------------------------------------------------------------- */

uint8_t machine_enable(const mavlink_ori_enable_t *enable, uint8_t *index, int32_t *value)
{
    *value = fault_latched();
    if (fault_latched() != ORI_FAULT_NONE)
        return ORI_REFUSED_FAULT;
    if (state != ORI_IDLE && state != ORI_HOLDING)
        return ORI_REFUSED_STATE;
    if (enable->hinges && supply_is_low()) { /* judged before the sensors, which fail with it */
        *value = supply_mv();
        return ORI_REFUSED_SUPPLY;
    }
    const uint8_t result = hinges_enable(enable->hinges, enable->position_urad, index, value);
    if (result != ORI_ACCEPTED)
        return result;
    queue_clear();
    stream = enable->stream;
    stream_open = true;
    contiguous = 0;
    go_to(hinges_on() ? ORI_HOLDING : ORI_IDLE);
    return ORI_ACCEPTED;
}

uint8_t machine_disable(uint16_t hinges)
{
    if (state == ORI_STREAMING || state == ORI_BRAKING)
        return ORI_REFUSED_STATE;
    hinges_disable(hinges);
    if (state == ORI_HOLDING && !hinges_on())
        go_to(ORI_IDLE);
    return ORI_ACCEPTED;
}

void machine_brake(void)
{
    if (state == ORI_STREAMING)
        machine_trip(ORI_FAULT_HOST_BRAKE, ORI_NOBODY);
}

uint8_t machine_latch(uint8_t index, bool engage, int32_t *value)
{
    if (state == ORI_UNCONFIGURED)
        return ORI_REFUSED_STATE;
    if (engage && latches_drives(index) && supply_is_low()) {
        *value = supply_mv();
        return ORI_REFUSED_SUPPLY;
    }
    const uint8_t result = latches_command(index, engage);
    if (result == ORI_ACCEPTED)
        events_note(ORI_EVENT_LATCH, index, engage);
    return result;
}

/* Whether any hinge or latch is driven: what needs the servos' supply, and is not to be configured anew. */
static bool is_driven(void)
{
    return hinges_on() || latches_driven();
}

static bool cause_persists(uint8_t fault)
{
    return (fault == ORI_FAULT_ESTOP && port_estop()) ||
           (fault == ORI_FAULT_SUPPLY_LOW && supply_is_low() && is_driven()) ||
           (fault == ORI_FAULT_FEEDBACK_LOST && hinges_lost() != ORI_NOBODY);
}

uint8_t machine_clear(uint8_t fault, int32_t *value)
{
    *value = fault_latched();
    if (fault_latched() == ORI_FAULT_NONE)
        return ORI_ACCEPTED;
    if (fault != fault_latched())
        return ORI_REFUSED_FAULT;
    if (state == ORI_BRAKING)
        return ORI_REFUSED_STATE;
    if (fault_end(fault) != CLEARABLE || cause_persists(fault))
        return ORI_REFUSED_CAUSE;
    events_note(ORI_EVENT_CLEARED, fault, fault_index());
    fault_forget();
    hinges_forgive();
    queue_clear();
    if (stored == CONFIG_CORRUPT) /* the one that is forgotten came first and hid it */
        machine_trip(ORI_FAULT_CONFIG_CORRUPT, ORI_NOBODY);
    else
        go_to(stored == CONFIG_NONE ? ORI_UNCONFIGURED : hinges_on() ? ORI_HOLDING : ORI_IDLE);
    return ORI_ACCEPTED;
}

/* With another configuration the heat of an electromagnet would be another's, or nobody's. */
static uint8_t judge_configuring(uint8_t *index, int32_t *value)
{
    if (is_driven())
        return ORI_REFUSED_STATE;
    *value = latches_hot_ms(index);
    return *value > 0 ? ORI_REFUSED_HOT : ORI_ACCEPTED;
}

uint8_t machine_config_begin(const mavlink_ori_config_device_t *device, uint8_t *index, int32_t *value)
{
    const uint8_t result = judge_configuring(index, value);
    return result == ORI_ACCEPTED ? config_begin(device) : result;
}

uint8_t machine_config_commit(uint32_t hash, uint8_t *index, int32_t *value)
{
    uint32_t found = 0;
    uint8_t result = judge_configuring(index, value);
    if (result != ORI_ACCEPTED)
        return result;
    result = config_commit(hash, &found);
    *value = (int32_t)found;
    if (result == ORI_ACCEPTED) {
        if (fault_latched() == ORI_FAULT_CONFIG_CORRUPT)
            fault_forget();
        start_from_store();
    }
    return result;
}

/* Frames ------------------------------------------------------------------------------------------------------- */

static uint32_t brake_us(void)
{
    return (uint32_t)config.device.brake_ms * 1000U;
}

/* Braking takes two frames to be seen and to take effect, and then brake_ms. */
static bool host_is_silent(uint64_t now_us)
{
    const uint64_t allowed = (uint64_t)config.device.silence_ms * 1000U - brake_us() - ORI_FRAME_US;
    return now_us - heard_us >= allowed;
}

/* Braking uses up half of brake_ms of the profile, and it has to begin before less is left. */
static bool queue_runs_low(void)
{
    const int32_t left = (int32_t)(queue_last()->time_us - profile_us);
    return left < (int32_t)(brake_us() / 2 + 2 * ORI_FRAME_US) && knot_moves(queue_last(), config.device.hinges);
}

/* Bring the profile's time to the next frame; its rate falls while braking. */
static void advance(uint32_t next_frame_us)
{
    if (state == ORI_STREAMING) {
        profile_us = next_frame_us;
        return;
    }
    /* A little more than its share, so that no crumb is left for one more frame. */
    const uint32_t fall = FULL_RATE * (ORI_FRAME_US / 1000U) / config.device.brake_ms + 1U;
    const uint32_t slower = rate > fall ? rate - fall : 0;
    /* While it still falls the mean of both rates counts; the last step may be shorter than a frame. */
    const uint32_t part = rate > fall ? ORI_FRAME_US : (uint32_t)((uint64_t)ORI_FRAME_US * rate / fall);
    profile_us += (uint32_t)(((uint64_t)(rate + slower) * part) >> 17);
    rate = slower;
}

static void come_to_rest(void)
{
    queue_clear();
    go_to(fault_latched() ? ORI_FAULTED : ORI_HOLDING);
}

static void follow_queue(uint32_t next_frame_us)
{
    int32_t position_urad[ORI_HINGES];
    advance(next_frame_us);
    queue_positions(profile_us, config.device.hinges, position_urad);
    hinges_output(position_urad);
    queue_pass(profile_us);
    const bool ended = queue_size() == 1 && (int32_t)(profile_us - queue_first()->time_us) >= 0;
    if (ended || (state == ORI_BRAKING && rate == 0))
        come_to_rest();
}

static void watch(uint64_t now_us)
{
    const verdict_t lame = hinges_sense();
    if (port_estop())
        machine_trip(ORI_FAULT_ESTOP, ORI_NOBODY);
    if (lame.fault != ORI_FAULT_NONE)
        machine_trip(lame.fault, lame.hinge);
    if (supply_step(is_driven()))
        machine_trip(ORI_FAULT_SUPPLY_LOW, ORI_NOBODY);
    if (state == ORI_STREAMING && host_is_silent(now_us))
        machine_trip(ORI_FAULT_HOST_SILENT, ORI_NOBODY);
    if (state == ORI_STREAMING && queue_runs_low())
        machine_trip(ORI_FAULT_UNDERRUN, ORI_NOBODY);
}

void machine_frame(uint64_t now_us, uint64_t next_frame_us)
{
    if (state == ORI_UNCONFIGURED)
        return;
    if ((state == ORI_STREAMING || state == ORI_BRAKING) && queue_size() == 0) { /* cannot be, and must not be read */
        machine_trip(ORI_FAULT_INTERNAL, ORI_NOBODY);
        go_to(ORI_FAULTED);
        return;
    }
    watch(now_us);
    if (state == ORI_STREAMING || state == ORI_BRAKING)
        follow_queue((uint32_t)next_frame_us);
    uint8_t tripped = latches_step();
    for (uint8_t i = 0; tripped; i++, tripped >>= 1)
        if (tripped & 1U)
            events_note(ORI_EVENT_LATCH_TRIPPED, i, 0);
}
