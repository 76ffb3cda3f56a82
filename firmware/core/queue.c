#include "queue.h"

#include <string.h>

#include "fixed.h"

static knot_t ring[QUEUE_KNOTS];
static uint8_t head;
static uint8_t size;

static uint8_t place(uint8_t index)
{
    const uint8_t at = (uint8_t)(head + index);
    return at < QUEUE_KNOTS ? at : (uint8_t)(at - QUEUE_KNOTS);
}

void queue_clear(void)
{
    size = 0;
}

uint8_t queue_size(void)
{
    return size;
}

bool queue_full(void)
{
    return size == QUEUE_KNOTS;
}

const knot_t *queue_first(void)
{
    return &ring[head];
}

const knot_t *queue_last(void)
{
    return &ring[place((uint8_t)(size - 1))];
}

void queue_push(const knot_t *knot)
{
    ring[place(size)] = *knot;
    size++;
}

void queue_pass(uint32_t time_us)
{
    while (size > 1 && (int32_t)(time_us - ring[place(1)].time_us) >= 0) {
        head = place(1);
        size--;
    }
}

/* The basis functions of a segment at one time; what all hinges share is computed once.
 *
 * With u the part of the segment that has passed: `way` = u^2 (3 - 2 u), in 2^-16, weighs the way from knot to knot;
 * `begin` = u (1 - u)^2 dt and `end` = u^2 (1 - u) dt weigh the velocities: mrad/s times ms is urad, so these are in
 * ms 2^-16; dt is at most 1000 ms and u (1 - u)^2 at most 4/27. */
typedef struct {
    uint16_t way;
    int32_t begin;
    int32_t end;
} basis_t;

/* Two divisions of 32 bits for all hinges. A segment beyond 2^16 us is reckoned in units of 16 us. */
static basis_t basis_at(uint32_t since_us, uint32_t segment_us)
{
    const uint8_t coarse = segment_us > UINT16_MAX ? 4 : 0;
    const uint32_t part = ((since_us >> coarse) << 16) / (segment_us >> coarse);
    const uint16_t u = part > UINT16_MAX ? UINT16_MAX : (uint16_t)part; /* 2^-16; in coarse units the end may be reached */
    const uint16_t v = (uint16_t)(u ? 0U - u : UINT16_MAX);
    const uint16_t uv = (uint16_t)(mul_uu(u, v) >> 16);
    const uint16_t uu = (uint16_t)(mul_uu(u, u) >> 16);
    const int32_t way = scale_u16(INT32_C(3) * 65536 - 2 * (int32_t)u, uu);
    const int32_t segment_ms = (int32_t)((segment_us << 12) / 1000U); /* 2^-12 */
    basis_t basis;
    basis.way = way > UINT16_MAX ? UINT16_MAX : (uint16_t)way;
    basis.begin = scale_u16(segment_ms, (uint16_t)(mul_uu(uv, v) >> 16)) << 4;
    basis.end = scale_u16(segment_ms, (uint16_t)(mul_uu(uv, u) >> 16)) << 4;
    return basis;
}

static int32_t interpolate(const knot_t *a, const knot_t *b, uint8_t hinge, const basis_t *basis)
{
    const int32_t start = a->position_urad[hinge];
    return start + scale_u16(b->position_urad[hinge] - start, basis->way) +
           scale_s16(basis->begin, a->velocity_mrad_s[hinge]) - scale_s16(basis->end, b->velocity_mrad_s[hinge]);
}

void queue_positions(uint32_t time_us, uint8_t hinges, int32_t *position_urad)
{
    const knot_t *a = queue_first();
    uint8_t i = 1;
    while (i < size && (int32_t)(time_us - ring[place(i)].time_us) >= 0)
        a = &ring[place(i++)];
    const bool between = i < size && (int32_t)(time_us - a->time_us) > 0;
    if (!between) {
        memcpy(position_urad, a->position_urad, hinges * sizeof *position_urad);
        return;
    }
    const knot_t *b = &ring[place(i)];
    const basis_t basis = basis_at(time_us - a->time_us, b->time_us - a->time_us);
    for (uint8_t k = 0; k < hinges; k++)
        position_urad[k] = interpolate(a, b, k, &basis);
}

bool knot_moves(const knot_t *knot, uint8_t hinges)
{
    for (uint8_t k = 0; k < hinges; k++)
        if (knot->velocity_mrad_s[k] != 0)
            return true;
    return false;
}
