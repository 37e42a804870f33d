/* What the step and the planner share: basis functions, attractor, winding, quaternions. */
#ifndef NOSLIP_INSIDE_H
#define NOSLIP_INSIDE_H

#include "noslip.h"

/* Such code takes it for granted that nothing is NaN, and what must be noticed is not. */
#if defined(__FAST_MATH__) || defined(_M_FP_FAST)
#error "-ffast-math and the like cannot be had: what is not finite would not be noticed"
#endif
#if defined(__FINITE_MATH_ONLY__)
#if __FINITE_MATH_ONLY__
#error "-ffinite-math-only cannot be had: what is not finite would not be noticed"
#endif
#endif

#include <tgmath.h>

#define REAL(x) ((noslip_real)(x))
#define NOT_ZERO(x) ((x) < 0 || (x) > 0)

/* Exponent below which a Gaussian is lost in the rounding of the sum. */
#define NEGLIGIBLE REAL(-40)

static inline noslip_real smaller(noslip_real a, noslip_real b) { return a < b ? a : b; }
static inline noslip_real larger(noslip_real a, noslip_real b) { return a > b ? a : b; }

/* Whether it goes round and round. */
static inline int is_cyclic(const noslip_primitive *p) { return !(p->alpha_s > 0); }

/* A fraction of the motion, within one cycle. */
static inline noslip_real within_cycle(noslip_real fraction) { return fraction - floor(fraction); }

static inline noslip_real exponent_of(const noslip_primitive *p, int i, noslip_real phase) {
    const noslip_real apart = (phase - p->centers[i]) / p->widths[i];
    if (is_cyclic(p)) {
        /* Around the cycle, and without the cancellation of 1 - cos. */
        const noslip_real turn = REAL(6.283185307179586), width = turn * p->widths[i];
        const noslip_real sine = sin(turn / 2 * (phase - p->centers[i]));
        return -2 * sine * sine / (width * width);
    }
    return REAL(-0.5) * apart * apart;
}

/* The function that is nearest in time to a fraction of the motion, or outermost: centers are evenly
 * spaced in time. */
static inline int nearest_function(const noslip_primitive *p, noslip_real fraction) {
    const noslip_real place = fraction * (noslip_real)(p->basis_functions - 1) + REAL(0.5);
    if (is_cyclic(p)) {
        const noslip_real nearest = within_cycle(fraction) * (noslip_real)p->basis_functions + REAL(0.5);
        /* Written so that NaN is the first one. */
        return nearest < (noslip_real)p->basis_functions ? (int)nearest : 0;
    }
    return place > 0 ? (int)smaller(place, (noslip_real)(p->basis_functions - 1)) : 0;
}

/* A Gaussian over that of the nearest one, so that no phase leaves all of them at zero; 0 where it is
 * lost in the rounding of their sum, as are those beyond. */
static inline noslip_real gaussian(const noslip_primitive *p, int i, noslip_real phase,
                                   noslip_real nearest) {
    const noslip_real exponent = exponent_of(p, i, phase) - nearest;
    return exponent >= NEGLIGIBLE ? exp(exponent) : 0;
}

static inline void multiply(const noslip_real *a, const noslip_real *b, noslip_real *product) {
    product[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    product[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    product[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    product[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

static inline void conjugate(const noslip_real *q, noslip_real *back) {
    int i;
    back[0] = q[0];
    for (i = 1; i < 4; ++i) back[i] = -q[i];
}

/* Quaternion of a rotation vector. */
static inline void quaternion_of(const noslip_real *vector, noslip_real *quaternion) {
    const noslip_real size
        = sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
    const noslip_real scale = size > REAL(1e-6) ? sin(size / 2) / size : REAL(0.5) - size * size / 48;
    int i;
    quaternion[0] = cos(size / 2);
    for (i = 0; i < 3; ++i) quaternion[1 + i] = scale * vector[i];
}

/* C knows no empty arrays. */
#define SOME_ROTATIONS (NOSLIP_ROTATIONS > 0 ? NOSLIP_ROTATIONS : 1)

#if NOSLIP_ROTATIONS
/* The winding of a rotation at a fraction of the motion. */
static inline void winding_at(const noslip_primitive *p, int r, noslip_real fraction,
                              noslip_real *rotation) {
    noslip_real turn[4], vector[3], within;
    const noslip_real *spline;
    int interval, i;
    if (p->knots == 1) {
        for (i = 0; i < 4; ++i) rotation[i] = p->knot_quaternions[0][4 * r + i];
        return;
    }
    if (is_cyclic(p)) fraction = within_cycle(fraction);
    if (!(fraction > 0)) fraction = 0;
    fraction = smaller(fraction, 1);
    interval = (int)(fraction * (noslip_real)(p->knots - 1));
    if (interval > p->knots - 2) interval = p->knots - 2;
    within = fraction - (noslip_real)interval / (noslip_real)(p->knots - 1);
    spline = p->knot_splines[interval] + 12 * r;
    for (i = 0; i < 3; ++i) {
        vector[i] = ((spline[i] * within + spline[3 + i]) * within + spline[6 + i]) * within
                    + spline[9 + i];
    }
    quaternion_of(vector, turn);
    multiply(p->knot_quaternions[interval] + 4 * r, turn, rotation);
}
#endif

/* Of all rotations. */
static inline void windings_at(const noslip_primitive *p, noslip_real fraction, noslip_real *rotations) {
#if NOSLIP_ROTATIONS
    int r;
    for (r = 0; r < NOSLIP_ROTATIONS; ++r) winding_at(p, r, fraction, rotations + 4 * r);
#else
    (void)p, (void)fraction, (void)rotations;
#endif
}

/* Rotation vector that leads from one rotation to another, world frame. */
static inline void turn_between(const noslip_real *from, const noslip_real *to, noslip_real *vector) {
    noslip_real back[4], turn[4], size, scale;
    int i;
    conjugate(from, back);
    multiply(to, back, turn);
    if (turn[0] < 0) {
        for (i = 0; i < 4; ++i) turn[i] = -turn[i];
    }
    size = sqrt(turn[1] * turn[1] + turn[2] * turn[2] + turn[3] * turn[3]);
    scale = size > REAL(1e-6) ? 2 * atan2(size, turn[0]) / size : 2 / turn[0];
    for (i = 0; i < 3; ++i) vector[i] = scale * turn[1 + i];
}

/* Of shorter steps, fractions of the duration, what a moving target adds would be rounding. */
#define LEAST_STEP (sizeof(noslip_real) < sizeof(double) ? REAL(1e-3) : REAL(1e-5))

/* (exp(r t) - 1) / t, which is r for no time at all. */
static inline noslip_real rate(noslip_real r, noslip_real t) { return t > 0 ? expm1(r * t) / t : r; }

static inline noslip_real sinc(noslip_real x) { return x > 0 ? sin(x) / x : 1; }

/* (1 - cos(w t)) / t. */
static inline noslip_real risen(noslip_real w, noslip_real t) { return w * sin(w * t / 2) * sinc(w * t / 2); }

/* P and G of a step h after another one, fractions of the duration. */
static inline void carry(const noslip_primitive *p, noslip_real before, noslip_real h, noslip_real *found) {
    const noslip_real c = p->alpha / 2, inside = c * c - p->alpha * p->beta;
    const noslip_real root = sqrt(fabs(inside));
    noslip_real share = 1;
    if (inside >= 0) {
        const noslip_real lead = rate(-c - root, before);
        if (root > 0) share = rate(-2 * root, h) / rate(-2 * root, before);
        found[0] = share * exp((root - c) * h - (root + c) * before);
        found[1] = lead * (expm1((root - c) * h) * share + (share - 1));
        found[1] += lead - rate(-c - root, h);
    } else {
        share = sinc(root * h) / sinc(root * before);
        found[0] = share * exp(-c * (h + before));
        found[1] = exp(-c * h) * (share * (rate(-c, before) + risen(root, before)) + risen(root, h));
        found[1] -= rate(-c, h);
    }
}

/* What a target that moves adds to itself in a step h, by its change and by its bend. */
static inline void led_by(const noslip_primitive *p, noslip_real before, noslip_real h, noslip_real *found) {
    noslip_real carried[2], slope, bend;
    if (h < LEAST_STEP) {
        before *= LEAST_STEP / h;
        h = LEAST_STEP;
    }
    carry(p, before, h, carried);
    slope = (1 - carried[0]) / carried[1] - 1 / p->beta;
    bend = (h + carried[0] * before) / carried[1] / 2 - slope / p->beta - 1 / (p->alpha * p->beta);
    found[0] = slope / h;
    found[1] = before > 0 ? bend / (h * h) : slope / h / 2;
}

static inline double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline double norm(const double *a) { return sqrt(dot(a, a)); }

static inline double apart(const double *a, const double *b) {
    const double between[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return norm(between);
}

/* One step, however long; freely, without the constraints.  What it keeps for the next one may change
 * even if it fails. */
int noslip_step_once(const noslip_primitive *primitive, noslip_state *state, noslip_real time_step,
                     int freely);

/* In replan.c.  The nearest twist, in the rule's metric, that the equalities allow at a pose. */
void noslip_allow(double time, const double *pose, double rate, double *twist);

/* Put a state at the start of a motion over another duration. */
void noslip_start_within(const noslip_primitive *primitive, double duration, noslip_state *state);

#endif
