/* Phase, basis functions, attractor and winding; the constraints are in noslip_core. */
#include "noslip.h"

#include <tgmath.h>

/* Generated from the declaration of the constraints; see the end of this file. */
static void noslip_core(const noslip_real *state, const noslip_real *step, noslip_real *after,
                        noslip_real *output);

#define REAL(x) ((noslip_real)(x))
/* Of the core: force, values, multipliers. */
#define NOSLIP_OUTPUTS @OUTPUTS@

/* Where each number stands in what the core takes and returns. */
@OFFSETS@
/* A rate that leaves nothing after any step, 1/s. */
#define AT_ONCE REAL(1e18)
/* Residual that rounding causes, over the largest velocity, or 1. */
#define HELD (sizeof(noslip_real) < sizeof(double) ? REAL(1e-4) : REAL(1e-12))

/* Exponent below which a Gaussian is lost in the rounding of the sum. */
#define NEGLIGIBLE REAL(-40)

static noslip_real smaller(noslip_real a, noslip_real b) { return a < b ? a : b; }
static noslip_real larger(noslip_real a, noslip_real b) { return a > b ? a : b; }

static noslip_real exponent_of(const noslip_primitive *p, int i, noslip_real phase) {
    const noslip_real apart = (phase - p->centers[i]) / p->widths[i];
    return REAL(-0.5) * apart * apart;
}

/* How far a goal has entered at a fraction of the motion: the minimum-jerk blend. */
static noslip_real entered_at(noslip_real fraction) {
    const noslip_real t = smaller(larger(fraction, 0), 1);
    return t * t * t * (10 - t * (15 - 6 * t));
}

/* What drives at a fraction of the motion: learned forces over alpha beta; and how a goal draws, ahead
 * by what the attractor lags behind. */
static void drive_at(const noslip_primitive *p, noslip_real fraction, noslip_real *drive) {
    const noslip_real t = smaller(larger(fraction, 0), 1);
    const noslip_real slope = 30 * t * t * (1 - t) * (1 - t), bend = 60 * t * (1 - t) * (1 - 2 * t);
    const noslip_real phase = exp(-p->alpha_s * fraction);
    const int count = p->basis_functions;
    noslip_real place = fraction * (noslip_real)(count - 1) + REAL(0.5), nearest, sum = 0;
    int middle, i, j, side;
    for (j = 0; j < 6; ++j) drive[j] = 0;
    /* Centers are evenly spaced in time; from the nearest, or the outermost, both ways until the
     * Gaussians vanish.  Its exponent is taken out, so that no phase leaves all of them at zero. */
    if (!(place > 0)) place = 0;
    middle = (int)smaller(place, (noslip_real)(count - 1));
    nearest = exponent_of(p, middle, phase);
    for (side = 1; side >= -1; side -= 2) {
        for (i = side > 0 ? middle : middle - 1; i >= 0 && i < count; i += side) {
            const noslip_real exponent = exponent_of(p, i, phase) - nearest;
            const noslip_real psi = exponent >= NEGLIGIBLE ? exp(exponent) : 0;
            if (!(psi > 0)) break;
            sum += psi;
            for (j = 0; j < 6; ++j) drive[j] += psi * p->weights[i][j];
        }
    }
    for (j = 0; j < 6; ++j) drive[j] *= phase / sum;
    drive[DRIVE_DRAWN] = entered_at(fraction) + slope / p->beta + bend / (p->alpha * p->beta);
}

static void multiply(const noslip_real *a, const noslip_real *b, noslip_real *product) {
    product[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    product[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    product[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    product[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

static void conjugate(const noslip_real *q, noslip_real *back) {
    int i;
    back[0] = q[0];
    for (i = 1; i < 4; ++i) back[i] = -q[i];
}

/* Quaternion of a rotation vector. */
static void quaternion_of(const noslip_real *vector, noslip_real *quaternion) {
    const noslip_real size
        = sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
    const noslip_real scale = size > REAL(1e-6) ? sin(size / 2) / size : REAL(0.5) - size * size / 48;
    int i;
    quaternion[0] = cos(size / 2);
    for (i = 0; i < 3; ++i) quaternion[1 + i] = scale * vector[i];
}

/* The winding's rotation at a fraction of the motion. */
static void winding_at(const noslip_primitive *p, noslip_real fraction, noslip_real *rotation) {
    noslip_real turn[4], vector[3], within;
    const noslip_real *spline;
    int interval, i;
    if (p->knots == 1) {
        for (i = 0; i < 4; ++i) rotation[i] = p->knot_quaternions[0][i];
        return;
    }
    if (!(fraction > 0)) fraction = 0;
    fraction = smaller(fraction, 1);
    interval = (int)(fraction * (noslip_real)(p->knots - 1));
    if (interval > p->knots - 2) interval = p->knots - 2;
    within = fraction - (noslip_real)interval / (noslip_real)(p->knots - 1);
    spline = p->knot_splines[interval];
    for (i = 0; i < 3; ++i) {
        vector[i] = ((spline[i] * within + spline[3 + i]) * within + spline[6 + i]) * within
                    + spline[9 + i];
    }
    quaternion_of(vector, turn);
    multiply(p->knot_quaternions[interval], turn, rotation);
}

/* Rotation vector that leads from one rotation to another, world frame. */
static void turn_between(const noslip_real *from, const noslip_real *to, noslip_real *vector) {
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

/* What leads the rotation to its goal, alike in all steps: from where the winding ends to the first
 * goal, in the tool's frame; and from there to the goal, a rotation vector in the world's. */
typedef struct goal_lead {
    noslip_real first[4], moved[3];
} goal_lead;

static void lead_to_goal(const noslip_primitive *p, const noslip_state *s, goal_lead *lead) {
    noslip_real back[4];
    conjugate(p->knot_quaternions[p->knots - 1], back);
    multiply(back, s->first_goal_quaternion, lead->first);
    turn_between(s->first_goal_quaternion, s->goal_quaternion, lead->moved);
}

/* The rotation that plays the goal's part in the attractor, and what is added to the turn there: the
 * winding and the learned torque, led to where the goal is by now. */
static void leading(const goal_lead *lead, const noslip_real *winding, noslip_real entered,
                    const noslip_real *drive, noslip_real *quaternion, noslip_real *offset) {
    noslip_real first[4], turn[4], back[4], torque[4] = {0}, turned[4], vector[3];
    int i, moves = 0;
    multiply(winding, lead->first, first);
    for (i = 0; i < 3; ++i) {
        torque[1 + i] = drive[DRIVE_ANGULAR + i];
        vector[i] = entered * lead->moved[i];
        moves |= vector[i] < 0 || vector[i] > 0;
    }
    if (moves) {
        quaternion_of(vector, turn);
        conjugate(turn, back);
        multiply(turn, torque, turned);
        multiply(turned, back, torque);
        multiply(turn, first, quaternion);
    } else {
        for (i = 0; i < 4; ++i) quaternion[i] = first[i];
    }
    for (i = 0; i < 3; ++i) {
        offset[i] = torque[1 + i] + (drive[DRIVE_DRAWN] - entered) * lead->moved[i];
    }
}

/* Of shorter steps, fractions of the duration, what a moving target adds would be rounding. */
#define LEAST_STEP (sizeof(noslip_real) < sizeof(double) ? REAL(1e-3) : REAL(1e-5))

/* (exp(r t) - 1) / t, which is r for no time at all. */
static noslip_real rate(noslip_real r, noslip_real t) { return t > 0 ? expm1(r * t) / t : r; }

static noslip_real sinc(noslip_real x) { return x > 0 ? sin(x) / x : 1; }

/* (1 - cos(w t)) / t. */
static noslip_real risen(noslip_real w, noslip_real t) { return w * sin(w * t / 2) * sinc(w * t / 2); }

/* P and G of a step h after another one, fractions of the duration. */
static void carry(const noslip_primitive *p, noslip_real before, noslip_real h, noslip_real *found) {
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

/* The same of the next step, and what a target that moves adds to itself, by its change and by its
 * bend. */
static const noslip_real *factors(const noslip_primitive *p, noslip_state *s, noslip_real h) {
    noslip_real before = s->previous_step / s->duration, wide[2], slope, bend;
    noslip_real *found = s->known_factors;
    if (!(s->known_lengths[0] < h) && !(s->known_lengths[0] > h)
        && !(s->known_lengths[1] < before) && !(s->known_lengths[1] > before)) return found;
    s->known_lengths[0] = h;
    s->known_lengths[1] = before;
    carry(p, before, h, found);
    wide[0] = found[0];
    wide[1] = found[1];
    if (h < LEAST_STEP) {
        before *= LEAST_STEP / h;
        h = LEAST_STEP;
        carry(p, before, h, wide);
    }
    slope = (1 - wide[0]) / wide[1] - 1 / p->beta;
    bend = (h + wide[0] * before) / wide[1] / 2 - slope / p->beta - 1 / (p->alpha * p->beta);
    found[2] = slope / h;
    found[3] = before > 0 ? bend / (h * h) : slope / h / 2;
    return found;
}

/* What a target that stands still for a step leaves out of the winding, added to the force. */
static void stepping_winding(const noslip_primitive *p, noslip_state *s, noslip_real h, int known,
                             noslip_real *force) {
    const noslip_real *factor = factors(p, s, h);
    const int starting = !(s->previous_step > 0);
    noslip_real earlier[4], now[4], later[4], before[3] = {0, 0, 0}, after[3];
    int j;
    if (p->knots == 1) return;
    if (known) {
        for (j = 0; j < 4; ++j) now[j] = s->known_winding[j];
        for (j = 0; j < 3; ++j) before[j] = s->known_turn[j];
    } else {
        winding_at(p, s->fraction, now);
        if (!starting) {
            winding_at(p, s->fraction - h, earlier);
            turn_between(earlier, now, before);
        }
    }
    winding_at(p, s->fraction + h, later);
    turn_between(now, later, after);
    for (j = 0; j < 4; ++j) s->known_winding[j] = later[j];
    for (j = 0; j < 3; ++j) {
        s->known_turn[j] = after[j];
        force[3 + j] += factor[2] * (after[j] + before[j]) / 2 + factor[3] * (after[j] - before[j]);
    }
}

/* The same as a step from there wants it: what a constant target leaves out is added. */
static void stepping_drive(const noslip_primitive *p, noslip_state *s, noslip_real h,
                           noslip_real *drive) {
    const int starting = !(s->previous_step > 0);
    const int known = !starting && !(s->known_fraction < s->fraction)
                      && !(s->known_fraction > s->fraction) && !(s->known_step < h)
                      && !(s->known_step > h);
    const noslip_real *factor = factors(p, s, h);
    noslip_real before[DRIVE_SIZE] = {0}, now[DRIVE_SIZE], after[DRIVE_SIZE];
    int j;
    if (known) {
        for (j = 0; j < DRIVE_SIZE; ++j) {
            before[j] = s->known[0][j];
            now[j] = s->known[1][j];
        }
    } else {
        if (!starting) drive_at(p, s->fraction - h, before);
        drive_at(p, s->fraction, now);
    }
    drive_at(p, s->fraction + h, after);
    s->known_fraction = s->fraction + h;
    s->known_step = h;
    for (j = 0; j < DRIVE_SIZE; ++j) {
        s->known[0][j] = now[j];
        s->known[1][j] = after[j];
    }
    for (j = 0; j < DRIVE_SIZE; ++j) {
        drive[j] = now[j] + factor[2] * (after[j] - before[j]) / 2
                   + factor[3] * (after[j] - 2 * now[j] + before[j]);
    }
    stepping_winding(p, s, h, known, drive);
}

void noslip_start(const noslip_primitive *primitive, noslip_state *state) {
    int i;
    state->time = primitive->begin;
    state->fraction = 0;
    state->previous_step = 0;
    state->duration = primitive->duration;
    state->pull_in = primitive->residual_rate / primitive->duration;
    state->braking = 0;
    for (i = 0; i < 3; ++i) {
        state->position[i] = primitive->start_position[i];
        state->linear_velocity[i] = primitive->start_linear_velocity[i];
        state->angular_velocity[i] = primitive->start_angular_velocity[i];
        state->goal_position[i] = state->first_goal_position[i] = primitive->goal_position[i];
        state->steering[i] = 0;
    }
    for (i = 0; i < 4; ++i) {
        state->quaternion[i] = primitive->start_quaternion[i];
        state->goal_quaternion[i] = primitive->goal_quaternion[i];
        state->first_goal_quaternion[i] = primitive->goal_quaternion[i];
    }
    for (i = 0; i < 6; ++i) state->acceleration[i] = state->force[i] = 0;
    state->known_fraction = state->known_step = -1;
    for (i = 0; i < DRIVE_SIZE; ++i) state->known[0][i] = state->known[1][i] = 0;
    for (i = 0; i < 4; ++i) state->known_winding[i] = 0;
    for (i = 0; i < 3; ++i) state->known_turn[i] = 0;
    for (i = 0; i < 2; ++i) state->known_lengths[i] = -1;
    for (i = 0; i < 4; ++i) state->known_factors[i] = 0;
    for (i = 0; i < NOSLIP_ROWS; ++i) state->values[i] = state->multipliers[i] = 0;
}

int noslip_done(const noslip_state *state) { return state->fraction >= 1 - REAL(1e-9); }

/* After the end: evenly to rest.  The share of the speed that a step leaves, and the fraction then. */
static noslip_real slowed(const noslip_state *s, noslip_real time_step, noslip_real *fraction) {
    noslip_real speed, slower;
    if (!(s->braking > 0)) return 0;
    speed = sqrt(larger(0, 1 - 2 * (larger(1, s->fraction) - 1) * s->duration / s->braking));
    slower = larger(0, speed - time_step / s->braking);
    *fraction = 1 + (1 - slower * slower) * s->braking / (2 * s->duration);
    return speed > 0 ? slower / speed : 0;
}

/* A step that is driven and led so; 1 and the state as it was if what comes of it is not finite. */
static int advance(const noslip_primitive *p, noslip_state *state, noslip_real time_step,
                   const noslip_real *drive, const noslip_real *winding, const goal_lead *lead) {
    const noslip_real tau = state->duration, h = time_step / tau;
    const noslip_real kick = (state->previous_step + time_step) / 2;
    const noslip_real *factor = factors(p, state, h);
    noslip_real now[STATE_SIZE], step[STEP_SIZE], after[STATE_SIZE], output[NOSLIP_OUTPUTS];
    noslip_real decay = factor[0], gain = factor[1] / tau;
    noslip_real fraction = state->fraction + h;
    noslip_real sum = 0, fast = 1, slip_rate = state->previous_step > 0 ? AT_ONCE : state->pull_in;
    int i;

    /* What violates a constraint from the start is pulled in; what was pushed off it, or measured to
     * be, goes on without slip at once. */
    for (i = 0; i < 3; ++i) {
        fast = larger(fast, fabs(state->linear_velocity[i]));
        fast = larger(fast, fabs(state->angular_velocity[i]));
    }
    for (i = 0; i < NOSLIP_EQUALITIES; ++i) {
        if (!(fabs(state->values[i]) <= HELD * fast)) slip_rate = state->pull_in;
    }
    if (noslip_done(state)) {
        /* Drawn nowhere any more. */
        fraction = state->fraction;
        decay = slowed(state, time_step, &fraction);
        gain = 0;
        slip_rate = AT_ONCE;
    }
    leading(lead, winding, entered_at(state->fraction), drive, step + STEP_ROTATION_GOAL,
            step + STEP_ROTATION_OFFSET);
    for (i = 0; i < 3; ++i) {
        now[STATE_POSITION + i] = state->position[i];
        now[STATE_LINEAR_VELOCITY + i] = state->linear_velocity[i];
        now[STATE_ANGULAR_VELOCITY + i] = state->angular_velocity[i];
        const noslip_real moved = state->goal_position[i] - state->first_goal_position[i];
        step[STEP_POSITION_TARGET + i]
            = state->goal_position[i] + moved * (drive[DRIVE_DRAWN] - 1) + drive[i];
        step[STEP_ROTATION_OFFSET + i] += state->steering[i];
    }
    for (i = 0; i < 4; ++i) now[STATE_QUATERNION + i] = state->quaternion[i];
    for (i = 0; i < NOSLIP_EQUALITIES + NOSLIP_LIMITS; ++i) now[STATE_VALUES + i] = state->values[i];
    step[STEP_TIME_STEP] = time_step;
    step[STEP_KICK] = kick;
    step[STEP_PREVIOUS_STEP] = state->previous_step;
    step[STEP_TIME] = state->time + time_step;
    step[STEP_RESIDUAL_RATE] = state->pull_in;
    step[STEP_SLIP_RATE] = slip_rate;
    step[STEP_BARRIER_RATE] = p->barrier_rate / tau;
    step[STEP_DECAY] = decay;
    step[STEP_GAIN] = gain;

    noslip_core(now, step, after, output);

    for (i = 0; i < STATE_VALUES; ++i) sum += after[i] - after[i];
    if (!(sum >= 0)) return 1;
    for (i = 0; i < 3; ++i) {
        state->position[i] = after[STATE_POSITION + i];
        state->linear_velocity[i] = after[STATE_LINEAR_VELOCITY + i];
        state->angular_velocity[i] = after[STATE_ANGULAR_VELOCITY + i];
    }
    for (i = 0; i < 4; ++i) state->quaternion[i] = after[STATE_QUATERNION + i];
    for (i = 0; i < 6; ++i) {
        state->acceleration[i] = (after[STATE_LINEAR_VELOCITY + i] - now[STATE_LINEAR_VELOCITY + i]) / kick;
        state->force[i] = output[OUTPUT_FORCE + i];
    }
    for (i = 0; i < NOSLIP_EQUALITIES + NOSLIP_LIMITS; ++i) {
        state->values[i] = after[STATE_VALUES + i];
        state->multipliers[i] = output[OUTPUT_MULTIPLIERS + i];
    }
    state->time += time_step;
    state->fraction = fraction;
    state->previous_step = time_step;
    return 0;
}

int noslip_step(const noslip_primitive *primitive, noslip_state *state, noslip_real time_step) {
    noslip_real h = time_step / state->duration, drive[DRIVE_SIZE] = {0}, winding[4];
    goal_lead lead;
    /* Written so that NaN fails; x - x is 0 for what is finite, and NaN for what is not. */
    if (!(time_step > 0) || !(h > 0) || !(h - h >= 0)) return 1;
    if (!noslip_done(state)) {
        /* The last step ends where the motion does; a whole one would go beyond. */
        if (h > 1 - state->fraction) {
            h = 1 - state->fraction;
            time_step = h * state->duration;
        }
        stepping_drive(primitive, state, h, drive);
    }
    winding_at(primitive, state->fraction, winding);
    lead_to_goal(primitive, state, &lead);
    return advance(primitive, state, time_step, drive, winding, &lead);
}
