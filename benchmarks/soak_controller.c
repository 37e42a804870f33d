/* Runs exported controllers on robots that err in every way, and looks at what must never happen.
 * Arguments: cycles, seed. */
#include "controller.h"
#include "primitives.h"
#include "soak.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int happens(double once_in) { return uniform(0, once_in) < 1; }

static double apart(const double *a, const double *b) {
    return sqrt(pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2));
}

/* An arc's cosine would lose half of the digits of a small angle. */
static double turned(const double *a, const double *b) {
    double along = 0, chord = 0;
    int i;
    for (i = 0; i < 4; ++i) along += a[i] * b[i];
    for (i = 0; i < 4; ++i) chord += pow(b[i] - (along < 0 ? -a[i] : a[i]), 2);
    return 4 * asin(fmin(sqrt(chord) / 2, 1));
}

int main(int count, char **argument) {
    static const double odd[] = {0, -0.0, NAN, INFINITY, 1e30, 1e160, 1e308, -1e308, 5e-324};
    static noslip_controller c;
    const long long cycles = count > 1 ? atoll(argument[1]) : 100000;
    long long k, motions = 0, faults = 0, lost = 0, plans = 0, late = 0;
    double fastest = 0, quickest = 0, off = 0, aside[3] = {0}, goal[3] = {0}, lag[7], before[7], h = 0;
    int i, since = 0, aims = 0, hand = 0;
    state_of_random = count > 2 ? (unsigned long long)atoll(argument[2]) * 2 + 1 : 1;
    for (k = 0; k < cycles; ++k) {
        double elapsed, seen[7], norm = 0, made_good;
        if (k == 0 || since > 4000 || c.mode == NOSLIP_MODE_FAULT || (noslip_controller_done(&c) && happens(50))) {
            plans += c.plans;
            h = pow(10, uniform(-3, -2));
            noslip_controller_init(&c, primitives[(int)uniform(0, PRIMITIVES)], h);
            c.follows = happens(2);
            c.real_time = happens(2);
            c.units = (int)uniform(0, 4);
            if (noslip_controller_start(&c, 0)) return 2;
            memcpy(lag, c.state.position, 3 * sizeof(double));
            memcpy(lag + 3, c.state.quaternion, 4 * sizeof(double));
            since = aims = hand = 0;
            ++motions;
        }
        ++since;
        elapsed = h * uniform(0.5, 1.5);
        if (happens(200)) elapsed = pow(10, uniform(-6, 3)), ++late;
        if (happens(500)) {
            aims = 1;
            for (i = 0; i < 3; ++i) goal[i] = c.state.goal_position[i] + uniform(-0.2, 0.2) * c.length;
        }
        if (happens(700)) {
            hand = (int)uniform(10, 300);
            for (i = 0; i < 3; ++i) aside[i] = uniform(-0.1, 0.1) * c.length;
        }
        for (i = 0; i < 7; ++i) {
            lag[i] += 0.1 * ((i < 3 ? c.state.position[i] : c.state.quaternion[i - 3]) - lag[i]);
            seen[i] = lag[i] + (i < 3 ? (hand > 0 ? aside[i] : 0) + 1e-3 * c.length * uniform(-1, 1) : 0);
        }
        if (hand > 0) --hand;
        if (happens(100)) seen[(int)uniform(0, 7)] = odd[(int)uniform(0, 9)];
        memcpy(before, c.state.position, 3 * sizeof(double));
        memcpy(before + 3, c.state.quaternion, 4 * sizeof(double));
        if (happens(300)) {
            double away[3] = {0};
            away[(int)uniform(0, 3)] = odd[(int)uniform(2, 8)];
            if (!noslip_controller_step(&c, elapsed, 0, away, 0) && fabs(away[0] + away[1] + away[2]) > 1e30) ++lost;
            continue;
        }
        noslip_controller_step(&c, elapsed, happens(2) ? seen : 0, aims ? goal : 0, 0);
        if (c.mode == NOSLIP_MODE_FAULT) ++faults;
        made_good = fmin(elapsed, fmax(0.015, 2 * h)) * (c.mode == NOSLIP_MODE_YIELD ? 2 : 1);
        fastest = fmax(fastest, apart(before, c.state.position) / (c.bounds[0] * made_good));
        quickest = fmax(quickest, turned(before + 3, c.state.quaternion) / (c.bounds[1] * made_good + 1e-15));
        for (i = 0; i < 4; ++i) norm += c.state.quaternion[i] * c.state.quaternion[i];
        off = fmax(off, fabs(sqrt(norm) - 1));
        for (i = 0; i < 6; ++i) norm += c.twist[i];
        if (!(fabs(norm) < HUGE_VAL) || !(off < 1)) ++lost;
    }
    printf("{\"cycles\": %lld, \"motions\": %lld, \"late\": %lld, \"plans\": %lld, ", cycles, motions, late, plans);
    printf("\"faults\": %lld, \"not finite\": %lld, \"speed over its bound\": %.6f, ", faults, lost, fastest);
    printf("\"turning over its bound\": %.6f, \"off SO(3)\": %.3g}\n", quickest, off);
    /* A plan that is handed over at speed may ask for 5 % more (HASTY), for a few cycles. */
    return faults > 0 || lost > 0 || !(fastest <= 1.05) || !(quickest <= 1.05) || !(off <= 1e-9);
}
