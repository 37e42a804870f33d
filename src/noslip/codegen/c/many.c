#include <math.h>

/* What Python runs: many steps, and many motions, a call. */

/* Sizes, for a check of the layout. */
void noslip_sizes(long long *sizes) {
    sizes[0] = (long long)sizeof(noslip_primitive);
    sizes[1] = (long long)sizeof(noslip_state);
}

/* Steps by a table; a row each of states and outputs. */
void noslip_run(const double *state, const double *table, double *states, double *outputs,
                long long steps) {
    long long k;
    for (k = 0; k < steps; ++k) {
        noslip_core(k ? states + (k - 1) * STATE_SIZE : state, table + k * STEP_SIZE, states + k * STATE_SIZE,
                    outputs + k * NOSLIP_OUTPUTS);
    }
}

static void sample(const noslip_state *s, double *state) {
    int i;
    for (i = 0; i < NOSLIP_LINEAR; ++i) {
        state[STATE_POSITION + i] = s->position[i];
        state[STATE_LINEAR_VELOCITY + i] = s->linear_velocity[i];
    }
#if NOSLIP_ROTATIONS
    for (i = 0; i < 4 * NOSLIP_ROTATIONS; ++i) state[STATE_QUATERNION + i] = s->quaternion[i];
    for (i = 0; i < 3 * NOSLIP_ROTATIONS; ++i) {
        state[STATE_ANGULAR_VELOCITY + i] = s->angular_velocity[i];
    }
#endif
    for (i = 0; i < NOSLIP_EQUALITIES + NOSLIP_LIMITS; ++i) state[STATE_VALUES + i] = s->values[i];
}

/* What drives a motion in so many steps, and its winding: they depend on the phase alone. */
void noslip_drives(const noslip_primitive *primitive, long long steps, double *drives,
                   double *windings) {
    const double h = 1.0 / (double)steps;
    noslip_state s;
    long long k;
    noslip_start(primitive, &s);
    s.duration = 1;
    for (k = 0; k < steps; ++k) {
        stepping_drive(primitive, &s, h, drives + DRIVE_SIZE * k);
        windings_at(primitive, s.fraction, windings + 4 * NOSLIP_ROTATIONS * k);
        s.fraction += h;
        s.previous_step = h;
    }
}

/* One motion for each of several beginnings, from the first sample of each. */
void noslip_rollouts(const noslip_primitive *primitive, const double *drives,
                     const double *windings, const double *beginnings, long long count,
                     long long steps, double *states) {
    long long motion, k;
    int i;
    for (motion = 0; motion < count; ++motion) {
        const double *begin = beginnings + motion * BEGINNING_SIZE;
        const double *first = states + motion * (steps + 1) * STATE_SIZE;
        noslip_state s;
        goal_lead lead;
        noslip_start(primitive, &s);
        for (i = 0; i < NOSLIP_LINEAR; ++i) {
            s.position[i] = first[STATE_POSITION + i];
            s.linear_velocity[i] = first[STATE_LINEAR_VELOCITY + i];
            s.goal_position[i] = begin[BEGINNING_GOAL_POSITION + i];
            s.first_goal_position[i] = begin[BEGINNING_FIRST_GOAL_POSITION + i];
        }
#if NOSLIP_ROTATIONS
        for (i = 0; i < 4 * NOSLIP_ROTATIONS; ++i) {
            s.quaternion[i] = first[STATE_QUATERNION + i];
            s.goal_quaternion[i] = begin[BEGINNING_GOAL_QUATERNION + i];
            s.first_goal_quaternion[i] = begin[BEGINNING_FIRST_GOAL_QUATERNION + i];
        }
        for (i = 0; i < 3 * NOSLIP_ROTATIONS; ++i) {
            s.angular_velocity[i] = first[STATE_ANGULAR_VELOCITY + i];
        }
#endif
        for (i = 0; i < NOSLIP_EQUALITIES + NOSLIP_LIMITS; ++i) {
            s.values[i] = first[STATE_VALUES + i];
        }
        s.duration = begin[BEGINNING_DURATION];
        s.pull_in = begin[BEGINNING_PULL_IN];
        lead_to_goal(primitive, &s, &lead);
        for (k = 1; k <= steps; ++k) {
            const long long at = motion * (steps + 1) + k;
            const double h = s.duration / (double)steps;
            const int lost = advance(primitive, &s, h, drives + DRIVE_SIZE * (k - 1),
                                     windings + 4 * NOSLIP_ROTATIONS * (k - 1), &lead, noslip_core);
            sample(&s, states + at * STATE_SIZE);
            /* The caller looks for it. */
            if (lost) states[at * STATE_SIZE] = NAN;
        }
    }
}
