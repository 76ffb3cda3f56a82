#include "queue.h"

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

/* The four basis functions of a segment at one time; what all hinges share is computed once.
 *
 * With u the part of the segment that has passed, in units of 2^-24: `way` = u^2 (3 - 2 u) weighs the way from
 * knot to knot, in 2^-30; `begin` = u (1 - u)^2 dt and `end` = u^2 (1 - u) dt weigh the velocities, in
 * urad s / mrad 2^-16, that is in ms 2^-16: dt is at most 1000 ms and u (1 - u)^2 at most 4/27. */
typedef struct {
    int32_t way;
    int32_t begin;
    int32_t end;
} basis_t;

static basis_t basis_at(uint32_t since_us, uint32_t segment_us)
{
    /* One division for all hinges. since < segment <= 2^20, so the quotient is below 2^24. */
    const uint32_t u = (uint32_t)(((uint64_t)since_us << 24) / segment_us);
    const uint32_t v = (UINT32_C(1) << 24) - u;
    const uint32_t uv = (uint32_t)(((uint64_t)u * v) >> 24);  /* 2^-24 */
    const uint32_t uu = (uint32_t)(((uint64_t)u * u) >> 24);
    const uint32_t segment_ms = (uint32_t)(((uint64_t)segment_us << 16) / 1000U); /* 2^-16 */
    basis_t basis;
    basis.way = (int32_t)(((uint64_t)uu * (3 * (UINT32_C(1) << 24) - 2 * u)) >> 18);
    basis.begin = (int32_t)(((uint64_t)(uint32_t)(((uint64_t)uv * v) >> 24) * segment_ms) >> 24);
    basis.end = (int32_t)(((uint64_t)(uint32_t)(((uint64_t)uv * u) >> 24) * segment_ms) >> 24);
    return basis;
}

static int32_t interpolate(const knot_t *a, const knot_t *b, uint8_t hinge, const basis_t *basis)
{
    const int64_t way = (int64_t)(b->position_urad[hinge] - a->position_urad[hinge]) * basis->way;
    const int64_t bend = (int64_t)a->velocity_mrad_s[hinge] * basis->begin - (int64_t)b->velocity_mrad_s[hinge] * basis->end;
    return a->position_urad[hinge] + (int32_t)((way + bend * (INT32_C(1) << 14) + (INT64_C(1) << 29)) >> 30);
}

void queue_positions(uint32_t time_us, uint8_t hinges, int32_t *position_urad)
{
    const knot_t *a = queue_first();
    uint8_t i = 1;
    while (i < size && (int32_t)(time_us - ring[place(i)].time_us) >= 0)
        a = &ring[place(i++)];
    const bool between = i < size && (int32_t)(time_us - a->time_us) > 0;
    const knot_t *b = &ring[place(between ? i : 0)];
    const basis_t basis = between ? basis_at(time_us - a->time_us, b->time_us - a->time_us) : (basis_t){0, 0, 0};
    for (uint8_t k = 0; k < hinges; k++)
        position_urad[k] = between ? interpolate(a, b, k, &basis) : a->position_urad[k];
}

bool knot_moves(const knot_t *knot, uint8_t hinges)
{
    for (uint8_t k = 0; k < hinges; k++)
        if (knot->velocity_mrad_s[k] != 0)
            return true;
    return false;
}
