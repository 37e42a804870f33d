/* Steps an exported primitive and its controller with whatever the bytes say: states, measurements,
 * goals, times.  What must never happen aborts: a command that is not finite, a refusal that
 * changes anything; the sanitizers find the rest.  A target of libFuzzer; without it (DRIVEN) a main
 * of its own draws the bytes.  Arguments of that: executions, seed. */
#include "controller.h"
#include "cut.h"

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const uint8_t *bytes;
static size_t left;

static uint8_t byte(void) { return left ? --left, *bytes++ : 0; }

/* Mostly as it was or near it, since nothing goes far that is refused at once. */
static double number(double near) {
    static const double odd[] = {0, -0.0, NAN, INFINITY, -INFINITY, 1, -1, 1e-9, -1e-9, 1e9,
                                 -1e9, 1e30, 1e160, 1e308, -1e308, 5e-324};
    const int kind = byte();
    uint64_t bits = 0;
    double found;
    int i;
    if (kind < 208) return near;
    if (kind < 232) return near + (kind % 2 ? 1e-3 : 1) * (byte() - 128) / 128.0;
    if (kind < 244) return odd[byte() % 16];
    for (i = 0; i < 8; ++i) bits = bits << 8 | byte();
    memcpy(&found, &bits, sizeof found);
    return found;
}

static void numbers(double *values, int count) {
    int i;
    for (i = 0; i < count; ++i) values[i] = number(values[i]);
}

static void must(int holds, const char *what) {
    if (holds) return;
    fprintf(stderr, "exported.c: %s\n", what);
    abort();
}

static void finite(const double *values, int count) {
    int i;
    for (i = 0; i < count; ++i) must(isfinite(values[i]), "a command that is not finite");
}

static void pose_is_finite(const noslip_state *s) {
    finite(s->position, 3);
    finite(s->quaternion, 4);
    finite(s->linear_velocity, 3);
    finite(s->angular_velocity, 3);
}

/* What may be written to between two steps; or anything. */
static void disturb(noslip_state *s) {
    switch (byte() % 8) {
    case 0: numbers(s->position, 3); break;
    case 1: numbers(s->quaternion, 4); break;
    case 2: numbers(s->linear_velocity, 3); break;
    case 3: numbers(s->angular_velocity, 3); break;
    case 4: numbers(s->goal_position, 3); break;
    case 5: numbers(s->goal_quaternion, 4); break;
    case 6: s->duration = number(s->duration); break;
    default: {
        const size_t place = (size_t)(byte() << 8 | byte()) % (sizeof *s / sizeof(double));
        double value;
        memcpy(&value, (char *)s + place * sizeof value, sizeof value);
        value = number(value);
        memcpy((char *)s + place * sizeof value, &value, sizeof value);
    }
    }
}

static void state(void) {
    noslip_state s, before;
    double h;
    noslip_start(&cut, &s);
    while (left) {
        if (byte() % 2) disturb(&s);
        h = number(cut.duration / cut.steps);
        before = s;
        if (noslip_step(&cut, &s, h)) must(!memcmp(&before, &s, sizeof s), "refused, and changed");
        else pose_is_finite(&s);
        noslip_done(&s);
    }
}

static void controller(void) {
    static noslip_controller c, before;
    const double h = cut.duration / cut.steps;
    noslip_state from;
    noslip_controller_init(&c, &cut, h);
    c.follows = byte() % 2;
    c.replans = byte() % 4 > 0;
    c.real_time = byte() % 2;
    c.units = byte() % 4;
    noslip_start(&cut, &from);
    if (byte() % 4 == 0) disturb(&from);
    if (noslip_controller_start(&c, byte() % 2 ? &from : 0)) return;
    while (left) {
        double seen[7], goal[3], turn[4], bias[3], elapsed = number(h);
        const int given = byte();
        memcpy(seen, c.state.position, sizeof goal);
        memcpy(seen + 3, c.state.quaternion, sizeof turn);
        memcpy(goal, c.state.goal_position, sizeof goal);
        memcpy(turn, c.state.goal_quaternion, sizeof turn);
        numbers(seen, 7);
        if (given & 2) numbers(goal, 3);
        if (given & 4) numbers(turn, 4);
        if (given > 250) noslip_controller_pause(&c, number(0));
        if (given < 5) noslip_controller_resume(&c, number(0));
        before = c;
        if (noslip_controller_step(&c, elapsed, given & 1 ? seen : 0, given & 2 ? goal : 0,
                                   given & 4 ? turn : 0)) {
            must(!memcmp(&before, &c, sizeof c), "refused, and changed");
        }
        pose_is_finite(&c.state);
        finite(c.twist, 6);
        finite(&c.speed, 1);
        noslip_controller_done(&c);
        noslip_controller_reason(&c);
        noslip_controller_lag_and_bias(&c, bias);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    bytes = data;
    left = size;
    if (byte() % 2) controller();
    else state();
    return 0;
}

#ifdef DRIVEN
#include "soak.h"

int main(int count, char **argument) {
    const long long executions = count > 1 ? atoll(argument[1]) : 1000;
    const unsigned long long seed = count > 2 ? (unsigned long long)atoll(argument[2]) : 0;
    uint8_t data[1024];
    long long k;
    for (k = 0; k < executions; ++k) {
        size_t i, size = 16;
        /* An execution is its seed's alone. */
        state_of_random = (seed + (unsigned long long)k) * 2 + 1;
        for (i = 0; i < 8; ++i) uniform(0, 1);
        size += (size_t)uniform(0, sizeof data - size);
        for (i = 0; i < size; ++i) data[i] = (uint8_t)uniform(0, 256);
        LLVMFuzzerTestOneInput(data, size);
    }
    printf("{\"executions\": %lld}\n", executions);
    return 0;
}
#endif
