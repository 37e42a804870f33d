
/* What Python runs: a plan, and all that it was made of. */

/* Bytes of a primitive and numbers of memory, for a check of the layout. */
void noslip_planned_sizes(int knots, int steps, int functions, int *sizes) {
    sizes[0] = (int)sizeof(noslip_primitive);
    sizes[1] = NOSLIP_REPLAN_MEMORY(knots, steps, functions);
}

/* How far a law's own motion leaves what it was fitted to, over its path or turning at worst. */
static double left_by(noslip_workspace *w, const double *points, int steps) {
    noslip_state *s = &w->state;
    double way = 0, turning = 0, off = 0, off_turn = 0;
    int k, i;
    for (k = 1; k <= steps; ++k) {
        way += apart(points + 7 * k, points + 7 * (k - 1));
        turning += angle_between(points + 7 * (k - 1) + 3, points + 7 * k + 3);
    }
    noslip_start(&w->primitive, s);
    for (i = 0; i < 3; ++i) {
        s->linear_velocity[i] = w->start_velocity[i] / w->duration;
        s->angular_velocity[i] = w->start_velocity[3 + i] / w->duration;
    }
    for (k = 1; k <= steps; ++k) {
        if (noslip_step_once(&w->primitive, s, w->duration / steps, 1)) return INFINITY;
        off = larger(off, apart(s->position, points + 7 * k));
        off_turn = larger(off_turn, angle_between(s->quaternion, points + 7 * k + 3));
    }
    return larger(off / larger(way, BROKEN), off_turn / larger(turning, 2 * PI));
}

/* Plan from a state, or all of a motion (state null), as the numbers that follow in it and in a goal:
 * position, quaternion, twist, time, fraction, previous step, duration, its goal; position, quaternion,
 * duration.  Returns what became of it. */
int noslip_planned(const noslip_primitive *primitive, const double *state, const double *goal,
                   double *memory, double smoother, int knots, int steps, int most,
                   double *reference, double *found,
                   double *values, double *multipliers, double *numbers, int *counts) {
    noslip_workspace w = {0};
    noslip_state s;
    noslip_goal to = {{0}, {0}, 0};
    double *number = numbers;
    int outcome = NOSLIP_REPLAN_GOING_ON, k;
    room at;
    if (state) {
        noslip_start(primitive, &s);
        copy(state, s.position, 3);
        copy(state + 3, s.quaternion, 4);
        copy(state + 7, s.linear_velocity, 3);
        copy(state + 10, s.angular_velocity, 3);
        s.time = state[13];
        s.fraction = state[14];
        s.previous_step = state[15];
        s.duration = state[16];
        copy(state + 17, s.goal_position, 3);
        copy(state + 20, s.goal_quaternion, 4);
    }
    if (goal) {
        copy(goal, to.position, 3);
        copy(goal + 3, to.quaternion, 4);
        to.duration = goal[7];
    }
    w.memory = memory;
    w.knots = knots;
    w.smoother = smoother;
    w.steps = steps;
    w.most_steps = most;
    at = room_of(&w, primitive->basis_functions);
    while (outcome == NOSLIP_REPLAN_GOING_ON && w.phase != CHECK) {
        if (w.phase == CORRECT) {
            noslip_plan_values(&w.plan, values);
            copy(at.multipliers, multipliers, ROWS * knots);
        }
        outcome = unit(primitive, state ? &s : 0, goal ? &to : 0, &w);
        if (w.phase == ATTEMPT && w.attempt == 0) {
            copy(at.positions + 3, reference, 3 * knots);
            copy(at.quaternions + 4, reference + 3 * knots, 4 * knots);
        }
    }
    if (outcome != NOSLIP_REPLAN_GOING_ON) return outcome;
    copy(at.positions + 3, found, 3 * knots);
    copy(at.quaternions + 4, found + 3 * knots, 4 * knots);
    copy(at.scratch, number, 7), number += 7;
    k = w.steps > knots - 1 ? w.steps : knots - 1;
    copy(at.scratch + 7 * k, number, 7), number += 7;
    copy(w.start_velocity, number, 6), number += 6;
    copy(w.first, number, 7), number += 7;
    copy(w.first_twist, number, 6), number += 6;
    copy(w.goal, number, 7), number += 7;
    copy(w.last_twist, number, 6), number += 6;
    *number++ = w.duration;
    *number++ = w.begin;
    *number++ = w.smoothing;
    *number++ = left_by(&w, at.scratch, k);
    copy(at.winding, number, 4 * w.primitive.knots), number += 4 * NOSLIP_WINDING_KNOTS;
    copy(at.weights, number, 6 * primitive->basis_functions);
    counts[0] = w.iterations;
    counts[1] = w.heeded;
    counts[2] = w.backing;
    counts[3] = w.primitive.knots;
    counts[4] = w.primitive.steps;
    return NOSLIP_REPLAN_DONE;
}
