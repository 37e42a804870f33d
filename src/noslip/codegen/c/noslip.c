/* What drives a step, and the step itself; the constraints are in noslip_core. */
#include "inside.h"

/* Generated from the declaration of the constraints; see the end of this file. */
static void noslip_core(const noslip_real *state, const noslip_real *step, noslip_real *after,
                        noslip_real *output);
/* The same without constraints. */
static void noslip_free(const noslip_real *state, const noslip_real *step, noslip_real *after,
                        noslip_real *output);
typedef void carrying(const noslip_real *, const noslip_real *, noslip_real *, noslip_real *);

/* Of the core: force, values, multipliers. */
#define NOSLIP_OUTPUTS @OUTPUTS@

/* Where each number stands in what the core takes and returns. */
@OFFSETS@
/* A rate that leaves nothing after any step, 1/s. */
#define AT_ONCE REAL(1e18)
/* Residual that rounding causes, over the largest velocity, or 1. */
#define HELD (sizeof(noslip_real) < sizeof(double) ? REAL(1e-4) : REAL(1e-12))

/* How far a goal has entered at a fraction of the motion: the minimum-jerk blend. */
static noslip_real entered_at(noslip_real fraction) {
    const noslip_real t = smaller(larger(fraction, 0), 1);
    return t * t * t * (10 - t * (15 - 6 * t));
}

/* The sum of psi_i s theta_i over that of psi_i at a fraction of the motion: theta are rows of weights. */
static inline void learned_at(const noslip_primitive *p, noslip_real fraction, const noslip_real *weights,
                              int width, noslip_real *found) {
    const noslip_real phase = is_cyclic(p) ? within_cycle(fraction) : exp(-p->alpha_s * fraction);
    const int middle = nearest_function(p, fraction);
    const noslip_real nearest = exponent_of(p, middle, phase);
    noslip_real sum = 0, psi;
    int i, j, side;
    for (j = 0; j < width; ++j) found[j] = 0;
    for (side = 1; side >= -1; side -= 2) {
        /* Of a cycle half of them on each side, the nearest among those that follow. */
        int most = is_cyclic(p) ? (p->basis_functions + (side > 0)) / 2 : p->basis_functions;
        for (i = side > 0 ? middle : middle - 1; most > 0; i += side, --most) {
            if (is_cyclic(p)) i = (i + p->basis_functions) % p->basis_functions;
            if (i < 0 || i >= p->basis_functions) break;
            if (!((psi = gaussian(p, i, phase, nearest)) > 0)) break;
            sum += psi;
            for (j = 0; j < width; ++j) found[j] += psi * weights[i * width + j];
        }
    }
    for (j = 0; j < width; ++j) found[j] *= (is_cyclic(p) ? 1 : phase) / sum;
}

/* What drives at a fraction of the motion: learned forces over alpha beta; and how a goal draws, ahead
 * by what the attractor lags behind. */
static void drive_at(const noslip_primitive *p, noslip_real fraction, noslip_real *drive) {
    const noslip_real t = smaller(larger(fraction, 0), 1);
    const noslip_real slope = 30 * t * t * (1 - t) * (1 - t), bend = 60 * t * (1 - t) * (1 - 2 * t);
    learned_at(p, fraction, p->weights[0], DRIVE_DRAWN, drive);
    drive[DRIVE_DRAWN] = entered_at(fraction) + slope / p->beta + bend / (p->alpha * p->beta);
}

/* Numbers of a velocity. */
#define VELOCITY (NOSLIP_LINEAR + 3 * NOSLIP_ROTATIONS)

/* What leads each rotation to its goal, alike in all steps: from where the winding ends to the first
 * goal, in the tool's frame; and from there to the goal, a rotation vector in the world's. */
typedef struct goal_lead {
    noslip_real first[4 * SOME_ROTATIONS], moved[3 * SOME_ROTATIONS];
} goal_lead;

static void lead_to_goal(const noslip_primitive *p, const noslip_state *s, goal_lead *lead) {
#if NOSLIP_ROTATIONS
    int r;
    for (r = 0; r < NOSLIP_ROTATIONS; ++r) {
        const noslip_real *first = s->first_goal_quaternion + 4 * r;
        noslip_real back[4];
        conjugate(p->knot_quaternions[p->knots - 1] + 4 * r, back);
        multiply(back, first, lead->first + 4 * r);
        turn_between(first, s->goal_quaternion + 4 * r, lead->moved + 3 * r);
    }
#else
    (void)p, (void)s, (void)lead;
#endif
}

/* The rotations that play the goal's part in the attractor, and what is added to the turns there: the
 * winding and the learned torque, led to where the goal is by now. */
static void leading(const goal_lead *lead, const noslip_real *windings, noslip_real entered,
                    const noslip_real *drive, noslip_real *quaternions, noslip_real *offsets) {
    int i, r;
    for (r = 0; r < NOSLIP_ROTATIONS; ++r) {
        const noslip_real *moved = lead->moved + 3 * r;
        noslip_real first[4], turn[4], back[4], torque[4] = {0}, turned[4], vector[3];
        noslip_real *quaternion = quaternions + 4 * r;
        int moves = 0;
        multiply(windings + 4 * r, lead->first + 4 * r, first);
        for (i = 0; i < 3; ++i) {
            torque[1 + i] = drive[DRIVE_ANGULAR + 3 * r + i];
            vector[i] = entered * moved[i];
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
            offsets[3 * r + i] = torque[1 + i] + (drive[DRIVE_DRAWN] - entered) * moved[i];
        }
    }
}

/* P and G of the next step, and what a target that moves adds to itself. */
static const noslip_real *factors(const noslip_primitive *p, noslip_state *s, noslip_real h) {
    const noslip_real before = s->previous_step / s->duration;
    noslip_real *found = s->known_factors;
    if (!(s->known_lengths[0] < h) && !(s->known_lengths[0] > h)
        && !(s->known_lengths[1] < before) && !(s->known_lengths[1] > before)) return found;
    s->known_lengths[0] = h;
    s->known_lengths[1] = before;
    carry(p, before, h, found);
    led_by(p, before, h, found + 2);
    return found;
}

/* What a target that stands still for a step leaves out of the windings, added to the force. */
static void stepping_winding(const noslip_primitive *p, noslip_state *s, noslip_real h, int known,
                             noslip_real *force) {
#if NOSLIP_ROTATIONS
    const noslip_real *factor = factors(p, s, h);
    const int starting = !(s->previous_step > 0);
    int j, r;
    if (p->knots == 1) return;
    for (r = 0; r < NOSLIP_ROTATIONS; ++r) {
        noslip_real *winding = s->known_winding + 4 * r, *turn = s->known_turn + 3 * r;
        noslip_real earlier[4], now[4], later[4], before[3] = {0, 0, 0}, after[3];
        if (known) {
            for (j = 0; j < 4; ++j) now[j] = winding[j];
            for (j = 0; j < 3; ++j) before[j] = turn[j];
        } else {
            winding_at(p, r, s->fraction, now);
            if (!starting) {
                winding_at(p, r, s->fraction - h, earlier);
                turn_between(earlier, now, before);
            }
        }
        winding_at(p, r, s->fraction + h, later);
        turn_between(now, later, after);
        for (j = 0; j < 4; ++j) winding[j] = later[j];
        for (j = 0; j < 3; ++j) {
            turn[j] = after[j];
            force[NOSLIP_LINEAR + 3 * r + j]
                += factor[2] * (after[j] + before[j]) / 2 + factor[3] * (after[j] - before[j]);
        }
    }
#else
    (void)p, (void)s, (void)h, (void)known, (void)force;
#endif
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
    for (j = 0; j < DRIVE_DRAWN; ++j) drive[j] *= s->amplitude;
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
    state->amplitude = 1;
    for (i = 0; i < NOSLIP_LINEAR; ++i) {
        state->position[i] = primitive->start_position[i];
        state->linear_velocity[i] = primitive->start_linear_velocity[i];
        state->goal_position[i] = state->first_goal_position[i] = primitive->goal_position[i];
    }
#if NOSLIP_ROTATIONS
    for (i = 0; i < 4 * NOSLIP_ROTATIONS; ++i) {
        state->quaternion[i] = primitive->start_quaternion[i];
        state->goal_quaternion[i] = primitive->goal_quaternion[i];
        state->first_goal_quaternion[i] = primitive->goal_quaternion[i];
        state->known_winding[i] = 0;
    }
    for (i = 0; i < 3 * NOSLIP_ROTATIONS; ++i) {
        state->angular_velocity[i] = primitive->start_angular_velocity[i];
        state->known_turn[i] = 0;
    }
#endif
    for (i = 0; i < VELOCITY; ++i) state->acceleration[i] = state->force[i] = 0;
    state->known_fraction = state->known_step = -1;
    for (i = 0; i < DRIVE_SIZE; ++i) state->known[0][i] = state->known[1][i] = 0;
    for (i = 0; i < 2; ++i) state->known_lengths[i] = -1;
    for (i = 0; i < 4; ++i) state->known_factors[i] = 0;
    for (i = 0; i < NOSLIP_ROWS; ++i) state->values[i] = state->multipliers[i] = 0;
}

int noslip_channels(const noslip_primitive *primitive, const noslip_state *state, noslip_real *values) {
    noslip_primitive own = *primitive;
    noslip_real fraction = state->fraction;
    int i;
    /* Written so that NaN fails. */
    if (!(fraction - fraction >= 0)) return 1;
    if (!own.channels) return 0;
    if (!is_cyclic(primitive)) {
        fraction = own.channel_begin + (1 - own.channel_begin) * smaller(larger(fraction, 0), 1);
    }
    own.basis_functions = own.channel_functions;
    own.centers = own.channel_centers;
    own.widths = own.channel_widths;
    learned_at(&own, fraction, own.channel_weights, own.channels, values);
    for (i = 0; i < own.channels; ++i) {
        values[i] += own.channel_trend[i] + fraction * own.channel_trend[own.channels + i];
        values[i] = smaller(larger(values[i], own.channel_least[i]), own.channel_most[i]);
    }
    return 0;
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

/* Fraction of a cycle, from 0 again after each; what rounding leaves before or beyond 1 is 0. */
static noslip_real next_in_cycle(noslip_real fraction) {
    const noslip_real whole = floor(fraction + REAL(1e-9));
    if (!(whole > 0)) return fraction;
    return fraction - whole > REAL(1e-9) ? fraction - whole : 0;
}

/* A step that is driven and led so; 1 and the state as it was if what comes of it is not finite. */
static int advance(const noslip_primitive *p, noslip_state *state, noslip_real time_step,
                   const noslip_real *drive, const noslip_real *windings, const goal_lead *lead,
                   carrying *carried) {
    const noslip_real tau = state->duration, h = time_step / tau;
    const noslip_real kick = (state->previous_step + time_step) / 2;
    const noslip_real *factor = factors(p, state, h);
    noslip_real now[STATE_SIZE], step[STEP_SIZE], after[STATE_SIZE], output[NOSLIP_OUTPUTS];
    noslip_real decay = factor[0], gain = factor[1] / tau;
    noslip_real fraction = is_cyclic(p) ? next_in_cycle(state->fraction + h) : state->fraction + h;
    noslip_real sum = 0, fast = 1, slip_rate = state->previous_step > 0 ? AT_ONCE : state->pull_in;
    int i;

    /* What violates a constraint from the start is pulled in; what was pushed off it, or measured to
     * be, goes on without slip at once. */
    for (i = 0; i < NOSLIP_LINEAR; ++i) fast = larger(fast, fabs(state->linear_velocity[i]));
#if NOSLIP_ROTATIONS
    for (i = 0; i < 3 * NOSLIP_ROTATIONS; ++i) fast = larger(fast, fabs(state->angular_velocity[i]));
#endif
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
    leading(lead, windings, entered_at(state->fraction), drive, step + STEP_ROTATION_GOAL,
            step + STEP_ROTATION_OFFSET);
    for (i = 0; i < NOSLIP_LINEAR; ++i) {
        now[STATE_POSITION + i] = state->position[i];
        now[STATE_LINEAR_VELOCITY + i] = state->linear_velocity[i];
        const noslip_real moved = state->goal_position[i] - state->first_goal_position[i];
        step[STEP_POSITION_TARGET + i]
            = state->goal_position[i] + moved * (drive[DRIVE_DRAWN] - 1) + drive[i];
    }
#if NOSLIP_ROTATIONS
    for (i = 0; i < 3 * NOSLIP_ROTATIONS; ++i) {
        now[STATE_ANGULAR_VELOCITY + i] = state->angular_velocity[i];
    }
    for (i = 0; i < 4 * NOSLIP_ROTATIONS; ++i) now[STATE_QUATERNION + i] = state->quaternion[i];
#endif
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

    for (i = 0; i < NOSLIP_OUTPUTS; ++i) output[i] = 0;
    for (i = STATE_VALUES; i < STATE_SIZE; ++i) after[i] = 0;
    carried(now, step, after, output);

    for (i = 0; i < STATE_VALUES; ++i) sum += after[i] - after[i];
    if (!(sum >= 0)) return 1;
    for (i = 0; i < NOSLIP_LINEAR; ++i) {
        state->position[i] = after[STATE_POSITION + i];
        state->linear_velocity[i] = after[STATE_LINEAR_VELOCITY + i];
    }
#if NOSLIP_ROTATIONS
    for (i = 0; i < 4 * NOSLIP_ROTATIONS; ++i) state->quaternion[i] = after[STATE_QUATERNION + i];
    for (i = 0; i < 3 * NOSLIP_ROTATIONS; ++i) {
        state->angular_velocity[i] = after[STATE_ANGULAR_VELOCITY + i];
    }
#endif
    for (i = 0; i < VELOCITY; ++i) {
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

static int step_by(const noslip_primitive *primitive, noslip_state *state, noslip_real time_step,
                   carrying *carried) {
    noslip_real h = time_step / state->duration, drive[DRIVE_SIZE] = {0}, windings[4 * SOME_ROTATIONS];
    goal_lead lead;
    /* Written so that NaN fails; x - x is 0 for what is finite, and NaN for what is not. */
    if (!(time_step > 0) || !(h > 0) || !(h - h >= 0)) return 1;
    if (!noslip_done(state)) {
        /* The last step ends where the motion does; a whole one would go beyond. */
        if (!is_cyclic(primitive) && h > 1 - state->fraction) {
            h = 1 - state->fraction;
            time_step = h * state->duration;
        }
        stepping_drive(primitive, state, h, drive);
    }
    windings_at(primitive, state->fraction, windings);
    lead_to_goal(primitive, state, &lead);
    return advance(primitive, state, time_step, drive, windings, &lead, carried);
}

int noslip_step_once(const noslip_primitive *primitive, noslip_state *state, noslip_real time_step,
                     int freely) {
    return step_by(primitive, state, time_step, freely ? noslip_free : noslip_core);
}

int noslip_step(const noslip_primitive *primitive, noslip_state *state, noslip_real time_step) {
    const noslip_state kept = *state;
    const noslip_real share = time_step / state->duration;
    int count = 1, k;
    /* Written so that NaN fails. */
    if (!(share <= LATEST)) return 1;
    if (share > LONGEST_STEP) {
        /* A late cycle is made good in steps as long as those of its own motion. */
        noslip_real left = share;
        if (!is_cyclic(primitive) && !noslip_done(state)) left = smaller(share, 1 - state->fraction);
        if (!(left <= share)) return 1;
        count = (int)ceil(left * (noslip_real)primitive->steps);
        time_step = left * state->duration / (noslip_real)count;
    }
    for (k = 0; k < count; ++k) {
        if (step_by(primitive, state, time_step, noslip_core)) {
            *state = kept;
            return 1;
        }
    }
    return 0;
}
