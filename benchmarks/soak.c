/* Steps random primitives from random states to random goals, pushes them about, and looks at what
 * must never happen.  Arguments: steps, seed, how far to push (0: not at all). */
#include "primitives.h"
#include "soak.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void turn(double *quaternion, double angle) {
    double size = 0;
    int i;
    for (i = 0; i < 4; ++i) quaternion[i] += uniform(-angle, angle) / 2;
    for (i = 0; i < 4; ++i) size += quaternion[i] * quaternion[i];
    for (i = 0; i < 4; ++i) quaternion[i] /= sqrt(size);
}

/* How fast the tool went sideways in a step, from its poses alone: along the y axis that it had midway.
 * What rounding of the positions may feign, in a short step above all, is left out. */
static double sideways(const noslip_state *before, const noslip_state *after) {
    const double *a = before->quaternion, *b = after->quaternion, *p = before->position, *q = after->position;
    double same = 0, rounding = 0, w, x, y, z, moved;
    int i;
    for (i = 0; i < 4; ++i) same += a[i] * b[i];
    same = same < 0 ? -1 : 1;
    w = b[0] + same * a[0], x = b[1] + same * a[1], y = b[2] + same * a[2], z = b[3] + same * a[3];
    moved = 2 * (x * y - w * z) * (q[0] - p[0]) + (w * w - x * x + y * y - z * z) * (q[1] - p[1])
            + 2 * (y * z + w * x) * (q[2] - p[2]);
    for (i = 0; i < 3; ++i) rounding += DBL_EPSILON * fmax(fabs(p[i]), fabs(q[i]));
    return fmax(0, fabs(moved / (w * w + x * x + y * y + z * z)) - rounding) / after->previous_step;
}

int main(int count, char **argument) {
    const long long steps = count > 1 ? atoll(argument[1]) : 1000000;
    const double push = count > 3 ? atof(argument[3]) : 1.0;
    const noslip_primitive *p = primitives[0];
    double residual = 0, slip = 0, violation = 0, off = 0, scale = 1, top = 0, largest = 0, aside = 0;
    long long k, motions = 0, pushes = 0, goals = 0, late = 0, lost = 0;
    noslip_state s, before;
    int i;
    state_of_random = count > 2 ? (unsigned long long)atoll(argument[2]) * 2 + 1 : 1;
    noslip_start(p, &s);
    for (k = 0; k < steps; ++k) {
        double norm = 0, sum = 0, speed = 0;
        if (noslip_done(&s) || k == 0) {
            if (top > 0) residual = fmax(residual, largest / top), slip = fmax(slip, aside / top);
            top = largest = aside = 0;
            p = primitives[(int)uniform(0, PRIMITIVES)];
            noslip_start(p, &s);
            scale = 0;
            for (i = 0; i < 3; ++i) scale += pow(p->goal_position[i] - p->start_position[i], 2);
            scale = push * (sqrt(scale) + 0.01);
            for (i = 0; i < 3; ++i) s.goal_position[i] += uniform(-scale, scale);
            if (push > 0) turn(s.goal_quaternion, 0.5);
            s.duration *= uniform(0.3, 3.0);
            ++motions;
        }
        /* A start off the constraints would be pulled in. */
        if (push > 0 && s.previous_step > 0 && uniform(0, 1) < 1e-3) {
            for (i = 0; i < 3; ++i) {
                s.position[i] += uniform(-0.1, 0.1) * scale;
                s.linear_velocity[i] += uniform(-1, 1) * scale / s.duration;
                s.angular_velocity[i] += uniform(-1, 1) / s.duration;
            }
            turn(s.quaternion, 0.2);
            ++pushes;
        }
        if (push > 0 && uniform(0, 1) < 1e-3) {
            for (i = 0; i < 3; ++i) s.goal_position[i] += uniform(-0.1, 0.1) * scale;
            ++goals;
        }
        if (uniform(0, 1) < 1e-4) {
            /* What cannot be is refused, and leaves everything as it was. */
            noslip_state hostile = s, kept;
            hostile.linear_velocity[1] = 1e308;
            hostile.angular_velocity[(int)uniform(0, 3)] = 1e200;
            kept = hostile;
            if (!noslip_step(p, &hostile, 1e-3 * s.duration) || memcmp(&hostile, &kept, sizeof kept)) ++lost;
            if (!noslip_step(p, &hostile, NAN) || !noslip_step(p, &hostile, 200 * s.duration)) ++lost;
        }
        if (uniform(0, 1) < 1e-4) {
            noslip_step(p, &s, uniform(0.02, 2.0) * s.duration);
            ++late;
        }
        before = s;
        noslip_step(p, &s, uniform(0.2e-3, 2e-3) * s.duration);
        aside = fmax(aside, sideways(&before, &s));
        for (i = 0; i < 3; ++i) speed += s.linear_velocity[i] * s.linear_velocity[i];
        top = fmax(top, sqrt(speed));
        for (i = 0; i < 4; ++i) norm += s.quaternion[i] * s.quaternion[i];
        for (i = 0; i < 3; ++i) sum += s.position[i] + s.linear_velocity[i] + s.angular_velocity[i];
        if (!(fabs(sum) < HUGE_VAL) || !(norm > 0)) ++lost;
        off = fmax(off, fabs(sqrt(norm) - 1));
        for (i = 0; i < NOSLIP_EQUALITIES; ++i) largest = fmax(largest, fabs(s.values[i]));
        for (; i < NOSLIP_EQUALITIES + NOSLIP_LIMITS; ++i) violation = fmax(violation, -s.values[i]);
    }
    printf("{\"steps\": %lld, \"motions\": %lld, \"pushes\": %lld, \"goals\": %lld, \"late\": %lld, ", steps, motions,
           pushes, goals, late);
    printf("\"not finite\": %lld, \"residual\": %.3g, \"sideways\": %.3g, ", lost, residual, slip);
    printf("\"violation\": %.3g, \"off SO(3)\": %.3g}\n", violation, off);
    return lost > 0 || !(residual <= 1e-10) || !(slip <= 1e-10) || !(off <= 1e-12);
}
