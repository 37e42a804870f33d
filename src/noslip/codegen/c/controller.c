/* noslip.control in Python, in the same order: the clock, goals, plans, what is measured, the modes. */
#include "controller.h"
#include "inside.h"

#include <math.h>
#include <string.h>

#define N NOSLIP_CONTROLLER_CELLS

@GENERATED@

static const double pi = 3.14159265358979323846;

enum { WAIT, MOVE, LOOK };                                       /* stages of yielding */
enum { NOTHING, LOOK_AHEAD, SEEK, ROLL, READY, FAILED };         /* of a plan's work */

/* Of a plan's work, units besides those of noslip_replan: steps of its own motion in each. */
#define STEPS_A_UNIT 50
/* Units of a plan, about, with which its work is spread over the cycles until it is due. */
#define UNITS 40

/* ------------------------------------------------------------------ vectors */

static void copy(const double *from, double *to, int count) {
    memmove(to, from, (size_t)count * sizeof(double));
}

static void zero(double *numbers, int count) { memset(numbers, 0, (size_t)count * sizeof(double)); }

/* The part of a displacement that a motion can reach. */
static void reach(const double *displacement, double *found) {
    int i;
    double part[3];
    for (i = 0; i < 3; ++i) part[i] = dot(reachable[i], displacement);
    copy(part, found, 3);
}

static void pose_of(const noslip_state *s, double *pose) {
    copy(s->position, pose, 3);
    copy(s->quaternion, pose + 3, 4);
}

static void add_twist(noslip_state *s, double share, const double *twist) {
    int i;
    for (i = 0; i < 3; ++i) {
        s->linear_velocity[i] += share * twist[i];
        s->angular_velocity[i] += share * twist[3 + i];
    }
}

static void forget(noslip_state *s) { s->known_fraction = s->known_step = s->known_lengths[0] = -1; }

/* ------------------------------------------------------------------ the clock: noslip.control.clock */

static double between(const double *table, double fraction) {
    const double place = smaller(larger(fraction, 0), 1) * N;
    const int k = place < N - 1 ? (int)place : N - 1;
    return table[k] + (place - k) * (table[k + 1] - table[k]);
}

static double cap(const noslip_schedule *s, double fraction) { return sqrt(between(s->caps, fraction)); }

static int cell(double fraction) {
    const double place = rint(fraction * N);
    return place < N ? (int)place : N;
}

/* A velocity is that of the step before its sample: what holds at a sample heeds the step after, too. */
static double size(const noslip_schedule *s, int k, int part) {
    return larger(norm(s->velocities[k] + part), norm(s->velocities[k < N ? k + 1 : N] + part));
}

static double change(const noslip_schedule *s, int k, int part) {
    const int at = k < 1 ? 1 : k > N - 1 ? N - 1 : k;
    return apart(s->velocities[at + 1] + part, s->velocities[at] + part) / (s->duration / N);
}

/* What commands may do at most: speeds, then accelerations. */
static void bound(noslip_controller *c, const noslip_schedule *s) {
    double v = 0, w = 0, a = 0, b = 0;
    int k;
    for (k = 0; k <= N; ++k) {
        v = larger(v, size(s, k, 0));
        w = larger(w, size(s, k, 3));
        a = larger(a, change(s, k, 0));
        b = larger(b, change(s, k, 3));
    }
    v = larger(v, s->way[0] / s->duration);
    a = larger(a, 4 * s->way[0] / (s->duration * s->duration));
    w = larger(w, LEAST_TURN / s->duration);
    b = larger(b, LEAST_TURN_CHANGE / (s->duration * s->duration));
    c->bounds[0] = smaller(c->faster, (1 + c->faster) / 2) * (v > 0 ? v : INFINITY);
    c->bounds[1] = c->faster * w;
    c->bounds[2] = HASTE * c->faster * (a > 0 ? a : INFINITY);
    c->bounds[3] = HASTE * c->faster * b;
}

/* Lengths of what is left of a motion. */
static void measure(noslip_schedule *s) {
    int k;
    s->way[N] = 0;
    for (k = N - 1; k >= 0; --k) s->way[k] = s->way[k + 1] + apart(s->positions[k + 1], s->positions[k]);
}

/* The tables of a motion whose samples stand there. */
static void schedule(const noslip_controller *c, noslip_schedule *s, double at_rest) {
    const double step = s->duration / N, *most = c->bounds;
    double still[2];
    int k;
    s->is_free = 1;
    for (k = 0; k <= N; ++k) {
        const double v = size(s, k, 0), w = size(s, k, 3), a = change(s, k, 0), b = change(s, k, 3);
        double allowed = smaller(1, (most[0] / v) * (most[0] / v));
        allowed = smaller(allowed, (most[1] / w) * (most[1] / w));
        allowed = smaller(allowed, most[2] / 2 / a);
        allowed = smaller(allowed, most[3] / 2 / b);
        s->caps[k] = allowed;
        /* Not within less than a few cycles, even at rest. */
        s->ramps[k] = smaller(1 / (4 * c->time_step), (most[2] - allowed * a) / v);
        s->ramps[k] = smaller(s->ramps[k], (most[3] - allowed * b) / w);
    }
    /* From the speed at the end to rest within a cycle, as far as accelerations allow. */
    for (k = 0; k < 2; ++k) {
        const double v = size(s, k * N, 0), w = size(s, k * N, 3);
        still[k] = smaller(most[2] / 2 * c->time_step / v, most[3] / 2 * c->time_step / w);
        still[k] = smaller(still[k], 1);
        if (v <= at_rest * c->mean_speed && w <= at_rest * most[1]) still[k] = 1;
        still[k] *= still[k];
    }
    s->begins_at_speed = still[0] < 1;
    if (!(c->braking > 0)) {
        s->caps[N] = smaller(s->caps[N], still[1]);
        /* The last cycle may be cut short: it slows down and stops, both at once. */
        for (k = N - 1 - (int)smaller(c->time_step / step, N - 1); k <= N && still[1] < 1; ++k) s->ramps[k] /= 2;
    }
    s->left[N] = 0;
    s->is_free = s->caps[N] >= 1;
    for (k = N - 1; k >= 0; --k) {
        s->caps[k] = smaller(s->caps[k], s->caps[k + 1] + 2 * smaller(s->ramps[k], s->ramps[k + 1]) * step);
        if (s->caps[k] < 1) s->is_free = 0;
        s->left[k] = s->left[k + 1]
                     + 2 * step / (larger(sqrt(s->caps[k]), LEAST_SPEED)
                                   + larger(sqrt(s->caps[k + 1]), LEAST_SPEED));
    }
    measure(s);
}

static void sampled(noslip_schedule *s, int k, const noslip_state *state) {
    copy(state->position, s->positions[k], 3);
    copy(state->linear_velocity, s->velocities[k], 3);
    copy(state->angular_velocity, s->velocities[k] + 3, 3);
}

/* Some of the steps of a plan's own motion; 1 once it is whole, -1 if it is not finite. */
static int roll(noslip_schedule *s, int *rolled, const noslip_primitive *plan, noslip_state *state,
                int steps) {
    const double step = s->duration / N;
    if (*rolled == 0) sampled(s, 0, state);
    for (; *rolled < N && steps > 0; --steps) {
        if (noslip_step(plan, state, step)) return -1;
        sampled(s, ++*rolled, state);
    }
    return *rolled == N;
}

static int whole_motion(noslip_schedule *s, const noslip_primitive *plan, const noslip_state *begun) {
    noslip_state state = *begun;
    int rolled = 0;
    s->duration = begun->duration;
    return roll(s, &rolled, plan, &state, N) == 1;
}

/* ------------------------------------------------------------------ goals: noslip.control.goal_filter */

static void filter_from(noslip_goal_filter *f, const double *goal, double jump, double slow) {
    memset(f, 0, sizeof *f);
    if (goal) copy(goal, f->goal, 3);
    f->jump = jump;
    f->slow = slow;
    f->time = f->since = f->far = -1;
}

/* The noise, from second differences, six times its variance each. */
static void heed_noise(noslip_goal_filter *f, const double *given) {
    double seen = 0, bend;
    int i;
    if (f->recents == 3) {
        copy(f->recent[1], f->recent[0], 6);
        --f->recents;
    }
    copy(given, f->recent[f->recents++], 3);
    if (f->recents < 3) return;
    for (i = 0; i < 3; ++i) {
        bend = f->recent[0][i] - 2 * f->recent[1][i] + f->recent[2][i];
        seen += bend * bend;
    }
    seen /= 18;
    f->samples = f->samples < AVERAGED ? f->samples + 1 : AVERAGED;
    if (f->samples > 8) seen = smaller(seen, 9 * f->noise + 1e-18);
    f->noise += (seen - f->noise) / (f->samples + 1);
}

/* Take a sample at a time; or the last one, held. */
static void take_goal(noslip_goal_filter *f, double time, const double *sample) {
    const double h = f->time >= 0 ? larger(time - f->time, 0) : 0;
    double given[3], off[3], theta, alpha, beta, noise;
    int i;
    if (f->is_told && !memcmp(sample, f->last, sizeof f->last) && f->far < 0 && time - f->time < HELD) return;
    copy(sample, given, 3);
    copy(given, f->last, 3);
    f->is_told = 1;
    for (i = 0; i < 3; ++i) off[i] = given[i] - (f->goal[i] + h * f->rate[i]);
    if (norm(off) > f->jump + 8 * sqrt(f->noise)) {
        if (f->far < 0) f->far = time;
        if (time - f->far >= CONFIRM) {
            copy(given, f->goal, 3);
            zero(f->rate, 3);
            f->recents = 0;
            f->far = -1;
            f->time = f->since = time;
        }
        return;
    }
    f->far = -1;
    if (f->time < 0) f->since = time;
    f->time = time;
    heed_noise(f, given);
    theta = exp(-h / SMOOTH);
    alpha = 1 - theta * theta;
    beta = (1 - theta) * (1 - theta);
    noise = sqrt(f->noise);
    f->deviation = noise * sqrt(alpha);
    for (i = 0; i < 3; ++i) {
        f->goal[i] = f->goal[i] + h * f->rate[i] + alpha * off[i];
        if (h > 0) f->rate[i] += beta / h * off[i];
    }
    if (h > 0) f->rate_deviation = noise * beta / h * sqrt(2 / (alpha * (4 - 2 * alpha - beta)));
}

/* Where it is expected to be; returns the standard deviation of that. */
static double goal_ahead(const noslip_goal_filter *f, double seconds, double *goal) {
    int i;
    copy(f->goal, goal, 3);
    if (norm(f->rate) > f->slow + 4.5 * f->rate_deviation && f->time - f->since > 3 * SMOOTH) {
        for (i = 0; i < 3; ++i) goal[i] += seconds * f->rate[i];
        return f->deviation + seconds * f->rate_deviation;
    }
    return f->deviation;
}

/* ------------------------------------------------------------------ plans beside the loop */

/* Whether a pose is one, and no farther away than any tool can be. */
static int is_pose(const noslip_controller *c, const double *pose) {
    double size = 0;
    int i;
    for (i = 3; i < 7; ++i) size += pose[i] * pose[i];
    return apart(pose, c->state.position) <= NO_TOOL * c->length && size > SMALLEST && size < 1 / SMALLEST;
}

/* Begin to follow a plan: put a state at its start, in a pose near it. */
static void begin_at(const noslip_workspace *w, const noslip_state *there, noslip_state *s) {
    const noslip_primitive *p = &w->primitive;
    double pose[7], twist[6], back[4], turn[4];
    int i;
    noslip_start(p, s);
    for (i = 0; i < 6; ++i) twist[i] = w->start_velocity[i] / p->duration;
    for (i = 0; i < 3; ++i) s->first_goal_position[i] += there->position[i] - p->start_position[i];
    conjugate(p->start_quaternion, back);
    multiply(back, there->quaternion, turn);
    multiply(p->goal_quaternion, turn, s->first_goal_quaternion);
    pose_of(there, pose);
    copy(pose, s->position, 3);
    copy(pose + 3, s->quaternion, 4);
    noslip_allow(s->time, pose, s->pull_in, twist);
    copy(twist, s->linear_velocity, 3);
    copy(twist + 3, s->angular_velocity, 3);
}

/* A unit of a plan's work. */
static void work(noslip_controller *c) {
    noslip_workspace *w = &c->workspaces[c->spare];
    noslip_schedule *s = &c->schedules[!c->schedule];
    int k;
    switch (c->work) {
    case LOOK_AHEAD:
        for (k = 0; k < STEPS_A_UNIT && c->ahead_steps > 0; ++k, --c->ahead_steps) {
            if (noslip_step(c->plan, &c->there, c->step_ahead)) {
                c->task_outcome = NOSLIP_REPLAN_NOT_FINITE;
                c->work = FAILED;
                return;
            }
        }
        if (c->ahead_steps > 0) break;
        if (c->resting) {
            zero(c->there.linear_velocity, 3);
            zero(c->there.angular_velocity, 3);
        }
        memset(w, 0, sizeof *w);
        w->memory = c->memory[c->spare];
        w->knots = c->knots;
        w->steps = c->plan->steps;
        w->most_steps = NOSLIP_CONTROLLER_STEPS;
        w->units = 1;
        w->smoother = SMOOTHER;
        c->work = SEEK;
        break;
    case SEEK:
        c->task_outcome = noslip_replan(c->plan, &c->there, &c->to, w);
        if (c->task_outcome == NOSLIP_REPLAN_GOING_ON) break;
        c->work = FAILED;
        if (c->task_outcome > NOSLIP_REPLAN_MISSES) break;
        begin_at(w, &c->there, &c->begun);
        c->rolling = c->begun;
        c->rolled = 0;
        s->duration = c->begun.duration;
        c->work = ROLL;
        break;
    case ROLL:
        k = roll(s, &c->rolled, &w->primitive, &c->rolling, STEPS_A_UNIT);
        if (k < 0) c->task_outcome = NOSLIP_REPLAN_NOT_FINITE;
        if (k < 0) c->work = FAILED;
        if (k <= 0) break;
        schedule(c, s, PLAN_AT_REST);
        c->work = READY;
        break;
    default:
        break;
    }
}

static int is_made(const noslip_controller *c) { return c->work == READY || c->work == FAILED; }

static void drop_task(noslip_controller *c) {
    c->pending = 0;
    c->work = NOTHING;
}

static const noslip_schedule *now(const noslip_controller *c) { return &c->schedules[c->schedule]; }

static void not_found(noslip_controller *c, noslip_cause cause, int outcome) {
    ++c->failures;
    c->cause = cause;
    c->outcome = outcome;
    c->next_plan = c->time + AFTER_FAILURE * pow(2, c->failed_in_row) * c->duration;
    if (c->failed_in_row < 10) ++c->failed_in_row;
}

/* Of a plan to a goal from a place of the one that is followed: at the primitive's own mean speed. */
static double time_for(const noslip_controller *c, const double *aim, double place, double aside) {
    const noslip_schedule *s = now(c);
    const double way = between(s->way, place), left = (1 - place) * c->plan_duration;
    const double off = aside + apart(aim, c->target);
    double detour, needed;
    detour = off > 0 ? DETOUR * off * off / (off + way) : 0;
    needed = larger(left, way / c->bounds[0]) + detour / c->mean_speed;
    needed = larger(larger(needed, LEAST_TIME * c->duration), 20 * c->time_step) * pow(MORE, c->failed_in_row);
    return smaller(needed, left + MOST_TIME * c->duration);
}

/* Where the goal will be; the standard deviations of that (m, rad). */
static void aim_at(const noslip_controller *c, double ahead, double *aim, double *deviations) {
    double turn[3], quaternion[4], beyond[3], part[3];
    int i;
    copy(c->target, aim, 7);
    deviations[0] = deviations[1] = 0;
    if (c->goal.is_told) deviations[0] = goal_ahead(&c->goal, ahead, aim);
    if (c->goal_turn.is_told) {
        deviations[1] = goal_ahead(&c->goal_turn, ahead, turn);
        quaternion_of(turn, quaternion);
        multiply(quaternion, c->goal_quaternion, aim + 3);
    }
    /* What no motion reaches is noise, if it is small. */
    for (i = 0; i < 3; ++i) beyond[i] = aim[i] - c->target[i];
    reach(beyond, part);
    for (i = 0; i < 3; ++i) beyond[i] -= part[i];
    for (i = 0; i < 3 && norm(beyond) <= GOAL_JUMP * c->length; ++i) part[i] = aim[i] - beyond[i];
    if (i == 3) copy(part, aim, 3);
}

/* Begin to plan, from where the command will be, with so much of the clock's speed; or, while it stands,
 * from a pose where the tool is held. */
static void begin_plan(noslip_controller *c, noslip_cause cause, const double *aim, double arrive,
                       const double *held) {
    const double aside = held ? apart(held, c->state.position) : 0;
    const noslip_schedule *s = now(c);
    const double h = c->time_step, speed = c->speed, fraction = c->state.fraction;
    const double step = c->mode == NOSLIP_MODE_TRACK ? speed * h : 0;
    double to[7], deviations[2], ramp, duration, place;
    int steps = step > 0 ? (int)ceil(c->ahead / h - 1e-9) : 0;
    copy(aim, to, 7);
    if (step > 0 && arrive < speed) {
        /* A little farther than it takes to brake. */
        ramp = between(s->ramps, fraction);
        steps += (int)ceil(1.1 * (speed * speed - arrive * arrive) / (2 * ramp) / step);
    }
    place = smaller(fraction + steps * step / c->plan_duration, 1);
    duration = time_for(c, to, place, aside);
    if (cause == NOSLIP_CAUSE_GOAL) {
        /* To where it is when this arrives. */
        const double late = larger(s->left[0] - c->plan_duration, 0);
        aim_at(c, duration + late + c->ahead, to, deviations);
        duration = time_for(c, to, place, aside);
    }
    c->next_plan = c->time + BETWEEN_PLANS * c->duration;
    if (apart(to, c->state.position) > FARTHEST * c->length) {
        not_found(c, cause, NOSLIP_CONTROLLER_TOO_FAR);
        return;
    }
    c->there = c->state;
    if (held) {
        copy(held, c->held, 7);
        copy(held, c->there.position, 3);
        copy(held + 3, c->there.quaternion, 4);
    }
    if (!RUNS_IN_PLAN_TIME) {
        c->there.duration = c->plan_duration;
        add_twist(&c->there, 1 - speed, s->velocities[cell(fraction)]);
    }
    c->pending = 1;
    c->pending_cause = cause;
    c->ahead_steps = steps;
    c->step_ahead = step;
    c->resting = place >= DONE;
    copy(to, c->to.position, 3);
    copy(to + 3, c->to.quaternion, 4);
    c->to.duration = duration;
    c->work = LOOK_AHEAD;
    /* Where it stands there is no place to come to, only a time. */
    c->hand_over = place;
    c->arrive = arrive;
    c->due = steps ? 0 : c->time + c->ahead;
    c->units_now = c->units > 0 ? c->units : (int)ceil(UNITS / larger(1, floor(c->ahead / h)));
}

/* In true time: stretch the plan's duration. */
static void stretch(noslip_controller *c) {
    c->state.duration = c->plan_duration * (c->speed > 0 ? 1 / c->speed : STANDING);
}

static void follow(noslip_controller *c, const noslip_primitive *plan, const noslip_state *begun) {
    c->plan = plan;
    c->plan_duration = begun->duration;
    c->state = *begun;
    c->state.braking = c->braking;
    forget(&c->state);
}

/* Take over the plan that was made; whether there is one. */
static int adopt(noslip_controller *c) {
    const noslip_schedule *s = &c->schedules[!c->schedule];
    noslip_state begun;
    double beyond, most;
    int i;
    if (!c->pending) return 0;
    if (c->real_time && !is_made(c)) {
        if (c->speed > 0 && c->mode == NOSLIP_MODE_TRACK) {
            /* The place is passed: the old plan goes on, the new one is made from farther ahead. */
            drop_task(c);
            c->ahead = smaller(2 * c->ahead, 10 * c->plan_within);
            c->next_plan = c->time;
        }
        return 0;
    }
    while (!is_made(c)) work(c);
    c->pending = 0;
    if (c->work == FAILED) {
        c->work = NOTHING;
        not_found(c, c->pending_cause, c->task_outcome);
        return 0;
    }
    c->work = NOTHING;
    most = cap(s, 0);
    if (c->speed > HASTY * most && !c->resting) {
        /* It bends too sharply for this speed: a like one is made from where it is slower. */
        double aim[7];
        if (++c->slowed > MOST_SLOWED) {
            c->slowed = 0;
            not_found(c, c->pending_cause, NOSLIP_CONTROLLER_TOO_SHARP);
            c->next_plan = c->time + BETWEEN_PLANS * c->duration;
            return 0;
        }
        copy(c->to.position, aim, 3);
        copy(c->to.quaternion, aim + 3, 4);
        begin_plan(c, c->pending_cause, aim, 0.9 * most, 0);
        return 0;
    }
    c->slowed = c->failed_in_row = 0;
    ++c->plans;
    c->cause = c->pending_cause;
    c->outcome = c->task_outcome;
    begun = c->begun;
    begun.time = c->state.time;
    copy(c->state.position, begun.position, 3);
    copy(c->state.quaternion, begun.quaternion, 4);
    if (!c->resting) {
        /* Pose and twist are handed over as they are. */
        copy(c->state.linear_velocity, begun.linear_velocity, 3);
        copy(c->state.angular_velocity, begun.angular_velocity, 3);
        begun.previous_step = c->state.previous_step;
    }
    /* As far beyond the place as the old plan has come. */
    beyond = larger(c->state.fraction - c->hand_over, 0) * c->plan_duration;
    follow(c, &c->workspaces[c->spare].primitive, &begun);
    c->spare = !c->spare;
    c->schedule = !c->schedule;
    c->state.fraction = beyond / c->plan_duration;
    for (i = 0; i < 3; ++i) c->target[i] = c->to.position[i];
    for (i = 0; i < 4; ++i) c->target[3 + i] = c->to.quaternion[i];
    if (c->resting) {
        c->speed = 0;
    } else if (!RUNS_IN_PLAN_TIME) {
        stretch(c);
    }
    c->mode = NOSLIP_MODE_TRACK;
    return 1;
}

/* ------------------------------------------------------------------ running the plan */

/* Set the clock's speed; in true time, stretch the plan's duration. */
static void set_speed(noslip_controller *c, double speed) {
    noslip_state *s = &c->state;
    if (!RUNS_IN_PLAN_TIME && (speed < c->speed || speed > c->speed || !(speed > 0))) {
        if (speed > 0) {
            add_twist(s, speed - c->speed, now(c)->velocities[cell(s->fraction)]);
        } else {
            /* What stands moves only as what holds it does. */
            zero(s->linear_velocity, 3);
            zero(s->angular_velocity, 3);
        }
        c->speed = speed;
        stretch(c);
    }
    c->speed = speed;
}

/* Step the plan by so much of its time, or for so many seconds of the true one; 1 if that fails. */
static int steps(noslip_controller *c, double h, double run) {
    const double whole = RUNS_IN_PLAN_TIME ? run : h;
    const int count = (int)larger(1, rint(whole / c->time_step));
    int k;
    for (k = 0; k < count; ++k) {
        if (noslip_step(c->plan, &c->state, whole / count)) return 1;
    }
    return 0;
}

/* Run for some seconds at some speed; on the new plan, where it is handed over.  Returns the seconds left
 * at its end, or less than 0 if a step failed. */
static double run(noslip_controller *c, double h, double speed) {
    double fraction = c->state.fraction, way = speed * h, left, lost = 0;
    set_speed(c, speed);
    /* In whole cycles: the twist of a cycle is then that of one step, which does not slip. */
    if (c->pending && c->time >= c->due - 1e-9 && fraction >= c->hand_over - 1e-9 && adopt(c)) {
        fraction = c->state.fraction;
        way = c->speed * h;
    }
    left = (1 - fraction) * c->plan_duration;
    if (way >= left - 1e-9 * h && RUNS_IN_PLAN_TIME && c->speed > 0) {
        lost = (way - left) / c->speed;
        way = left;
    }
    if (way > LEAST_RUN * c->time_step || !RUNS_IN_PLAN_TIME || (way > 0 && !(way < left) && !(way > left))) {
        if (steps(c, h, way)) return -1;
    }
    if (c->state.fraction >= DONE) c->mode = NOSLIP_MODE_HOLD;
    return larger(lost, 0);
}

static double track(noslip_controller *c, double h, int halt) {
    const noslip_schedule *s = now(c);
    const double fraction = c->state.fraction, pace = c->seen[SEEN_PACE];
    double speed = c->speed, ramp, wanted;
    const int slows = halt || c->silent || c->pending || c->wanted_speed < 1;
    if (speed >= 1 && pace >= 1 && s->is_free && !slows) return run(c, h, 1);
    ramp = between(s->ramps, fraction);
    /* Where this cycle ends, braking was foreseen; the least keeps it from stopping short. */
    wanted = smaller(cap(s, fraction), cap(s, fraction + speed * h / c->plan_duration));
    wanted = larger(wanted, smaller(ramp * h, 1));
    if (c->pending && c->arrive < 1) {
        /* Slow enough for the new plan where it is handed over. */
        const double way = larger(c->hand_over - fraction, 0) * c->plan_duration;
        wanted = smaller(wanted, sqrt(c->arrive * c->arrive + 2 * ramp * way));
    }
    if (halt || c->silent || (c->pending && c->due > 0)) {
        /* A plan that begins where it stands finds it there. */
        wanted = 0;
    } else if (c->seen[SEEN_PLACE_SAMPLES] > 0) {
        wanted = smaller(wanted, pace);
    }
    if (c->wanted_speed < wanted) {
        wanted = c->wanted_speed;
        ramp = c->ramp > 0 ? c->ramp : ramp;
    } else if (c->ramp > 0) {
        ramp = c->ramp;
        if (speed >= c->wanted_speed) c->ramp = 0;
    }
    if (wanted < speed || wanted > speed) {
        speed += larger(smaller(wanted - speed, ramp * h), -ramp * h);
    }
    return run(c, h, speed);
}

/* Hold the pose after the end; come to rest, move along with what moves. */
static int hold(noslip_controller *c, double h) {
    if (c->pending && c->time >= c->due - 1e-9 && adopt(c)) return 0;
    if (RUNS_IN_PLAN_TIME) return noslip_step(c->plan, &c->state, larger(c->speed, LEAST_RUN) * h);
    c->state.duration = c->plan_duration;
    return noslip_step(c->plan, &c->state, h);
}

/* ------------------------------------------------------------------ what is measured */

static const int places[2] = {SEEN_PLACE_LAG, SEEN_TURN_LAG};
/* Of a channel: where a part of it stands. */
#define PART(channel, name) (places[channel] + SEEN_PLACE_##name - SEEN_PLACE_LAG)

static void observe_from(noslip_controller *c) {
    static const int diagonal[4] = {0, 4, 7, 9};
    const int known = c->lag >= 0;
    const double std = known ? KNOWN_LAG_STD : LAG_STD;
    const double tolerances[2] = {c->tolerance * c->length, c->angle_tolerance};
    const double biases[2] = {c->bias * c->length / 3, ANGLE_BIAS / 3};
    double *seen = c->seen;
    int k, i;
    zero(seen, SEEN_SIZE);
    for (k = 0; k < 2; ++k) {
        const double tolerance = tolerances[k], bias = biases[k];
        const int drift = k ? SEEN_TURN_LAG_DRIFT : SEEN_PLACE_LAG_DRIFT;
        seen[PART(k, LAG)] = known ? c->lag : 0;
        for (i = 0; i < 4; ++i) seen[PART(k, COVARIANCE) + diagonal[i]] = i ? bias * bias : std * std;
        /* At first it is taken for noise of a fifth of what is tolerated. */
        seen[PART(k, VARIANCE)] = seen[PART(k, NOISE)] = (tolerance / 5) * (tolerance / 5);
        seen[PART(k, BAND)] = tolerance;
        /* Within a second both drift by a small part of what they may be. */
        seen[drift] = (0.15 * std) * (0.15 * std);
        seen[drift + SEEN_PLACE_BIAS_DRIFT - SEEN_PLACE_LAG_DRIFT] = (0.1 * bias) * (0.1 * bias);
        seen[drift + SEEN_PLACE_LONGEST_LAG - SEEN_PLACE_LAG_DRIFT] = known ? c->lag + 4 * KNOWN_LAG_STD : LONGEST_LAG;
        seen[drift + SEEN_PLACE_FLOOR - SEEN_PLACE_LAG_DRIFT] = tolerance / 3;
        seen[drift + SEEN_PLACE_TOLERANCE - SEEN_PLACE_LAG_DRIFT] = tolerance;
    }
    seen[SEEN_GAP] = c->time_step;
    seen[SEEN_PACE] = 1;
}

/* The command moved from a pose to another within some seconds. */
static void observe_move(noslip_controller *c, const double *before, double passed) {
    double given[15], found[SEEN_SIZE];
    copy(before, given, 7);
    pose_of(&c->state, given + 7);
    given[14] = passed;
    noslip_moved(c->seen, given, found);
    copy(found, c->seen, SEEN_SIZE);
}

static void observe_pose(noslip_controller *c, const double *measured, int learns) {
    double given[15], found[SEEN_SIZE];
    pose_of(&c->state, given);
    copy(measured, given + 7, 7);
    given[14] = learns;
    noslip_measured(c->seen, given, found);
    copy(found, c->seen, SEEN_SIZE);
}

/* The command was moved to where the tool is, which thus is no longer off by so much. */
static void shifted(noslip_controller *c, const double *place, const double *turn) {
    int k, i;
    for (k = 0; k < 2; ++k) {
        for (i = 0; i < 3; ++i) {
            const double by = k ? turn[i] : place[i];
            c->seen[PART(k, LEFT) + i] -= by;
            c->seen[PART(k, BEHIND) + i] += by;
        }
    }
}

/* Take what is left for a bias. */
static void accept_bias(noslip_controller *c) {
    int k, i;
    for (k = 0; k < 2; ++k) {
        for (i = 0; i < 3; ++i) {
            c->seen[PART(k, BIAS) + i] += c->seen[PART(k, LEFT) + i];
            c->seen[PART(k, LEFT) + i] = 0;
        }
        c->seen[PART(k, FAR)] = 0;
    }
    c->seen[SEEN_PACE] = 1;
}

/* Length of the sum of what is left and of another part of a channel. */
static double with_left(const noslip_controller *c, int channel, int part) {
    double sum[3];
    int i;
    for (i = 0; i < 3; ++i) sum[i] = c->seen[part + i] + c->seen[PART(channel, LEFT) + i];
    return norm(sum);
}

static int is_small_bias(const noslip_controller *c) {
    return with_left(c, 0, SEEN_PLACE_BIAS) <= c->bias * c->length;
}

/* Of an offset that has stayed: a bias, or it blocks. */
static void settle(noslip_controller *c) {
    c->blocked = !(is_small_bias(c) && with_left(c, 1, SEEN_TURN_BIAS) <= ANGLE_BIAS);
    if (!c->blocked) accept_bias(c);
}

/* Take an offset that stays for a bias, if it is small enough; else it blocks. */
static void accept_or_block(noslip_controller *c) {
    const double *left = c->seen + SEEN_PLACE_LEFT;
    if (c->seen[SEEN_PACE] >= 1) {
        c->rest = -1;
        c->blocked = 0;
        return;
    }
    if (c->rest < 0 || apart(left, c->rest_at) > 0.5 * c->seen[SEEN_PLACE_BAND]) {
        c->rest = c->time;
        copy(left, c->rest_at, 3);
    }
    if (c->time - c->rest > ACCEPT) {
        settle(c);
        c->rest = -1;
    }
}

static void take_measured(noslip_controller *c, const double *measured) {
    const double *seen = c->seen, *left = seen + SEEN_PLACE_LEFT;
    double v[3], sideways[3], size;
    int i;
    observe_pose(c, measured, c->mode != NOSLIP_MODE_YIELD && seen[SEEN_PACE] >= 1);
    if (c->mode == NOSLIP_MODE_YIELD) return;
    accept_or_block(c);
    if (!(c->follows && c->replans && c->mode == NOSLIP_MODE_TRACK)) return;
    /* Sideways: what no lag and no stall explains. */
    if (seen[SEEN_PLACE_FAR] > 1.5 * seen[SEEN_PLACE_BAND]) {
        size = norm(c->state.linear_velocity) + 1e-12;
        for (i = 0; i < 3; ++i) v[i] = c->state.linear_velocity[i] / size;
        for (i = 0; i < 3; ++i) sideways[i] = left[i] - dot(left, v) * v[i];
        if (norm(sideways) > 1.5 * seen[SEEN_PLACE_BAND]) {
            if (c->aside < 0) c->aside = c->time;
            if (c->time - c->aside >= PERSIST) {
                c->mode = NOSLIP_MODE_YIELD;
                c->stage = WAIT;
                c->rest = c->aside = -1;
                drop_task(c);
            }
            return;
        }
    }
    c->aside = -1;
}

/* Whether the plan from where the tool is held is there, and takes not too long. */
static int leads_on(noslip_controller *c) {
    double left;
    if (c->real_time && !is_made(c)) return 0;
    while (!is_made(c)) work(c);
    if (c->work == FAILED) {
        drop_task(c);
        not_found(c, NOSLIP_CAUSE_PUSH, c->task_outcome);
        return 0;
    }
    left = between(now(c)->left, c->state.fraction) + DEAREST * c->duration;
    return c->time - c->rest > ACCEPT || c->schedules[!c->schedule].left[0] <= left;
}

/* Wait until the tool is back, or rests where a plan leads on from. */
static void wait_for(noslip_controller *c, double calm) {
    const double *seen = c->seen, *left = seen + SEEN_PLACE_LEFT;
    double tool[3], held[7], turn[4], rests;
    int i;
    if (seen[SEEN_PACE] >= 1) {
        /* It came back by itself. */
        c->mode = NOSLIP_MODE_TRACK;
        c->blocked = 0;
        drop_task(c);
        return;
    }
    for (i = 0; i < 3; ++i) {
        tool[i] = c->state.position[i] + seen[SEEN_PLACE_BEHIND + i] + seen[SEEN_PLACE_BIAS + i] + left[i];
    }
    rests = 0.5 * c->tolerance * c->length + 4.5 * sqrt(seen[SEEN_PLACE_VARIANCE]);
    if (c->rest < 0 || apart(tool, c->rest_at) > rests) {
        c->rest = c->time;
        copy(tool, c->rest_at, 3);
        drop_task(c);
    }
    if (c->time - c->rest < calm || c->speed > 0) return;
    if (c->pending) {
        if (c->time >= c->due - 1e-9 && leads_on(c)) {
            c->stage = MOVE;
            c->blocked = 0;
        }
    } else if (c->time >= c->next_plan) {
        pose_of(&c->state, held);
        if (seen[SEEN_TURN_FAR] > seen[SEEN_TURN_BAND]) {
            quaternion_of(seen + SEEN_TURN_LEFT, turn);
            multiply(turn, c->state.quaternion, held + 3);
        }
        reach(left, held);
        for (i = 0; i < 3; ++i) held[i] += c->state.position[i];
        begin_plan(c, NOSLIP_CAUSE_PUSH, c->target, 1, held);
    } else if (c->time - c->rest > ACCEPT) {
        settle(c);
    }
}

/* Move the command to where its plan begins: to a place that is fixed, so that nothing can run away. */
static void go_there(noslip_controller *c, double h) {
    const double near[2] = {0.1 * c->tolerance * c->length, 0.1 * c->angle_tolerance};
    double steps[2][3], sizes[2], turn[4], before[4], part;
    int k, i, arrives;
    for (i = 0; i < 3; ++i) steps[0][i] = c->held[i] - c->state.position[i];
    turn_between(c->state.quaternion, c->held + 3, steps[1]);
    for (k = 0; k < 2; ++k) sizes[k] = norm(steps[k]);
    /* The last of it whole: the plan starts just there. */
    arrives = sizes[0] < near[0] && sizes[1] < near[1];
    part = arrives ? 1 : -expm1(-h / FOLLOW);
    for (k = 0; k < 2; ++k) {
        const double allowed = FOLLOW_HASTE * c->bounds[k] * h;
        double share = part;
        if (share * sizes[k] > allowed) {
            share = allowed / sizes[k];
            arrives = 0;
        }
        for (i = 0; i < 3; ++i) steps[k][i] *= share;
    }
    if (arrives) {
        c->stage = LOOK;
        c->since = c->time;
        c->rest = -1;
    }
    for (i = 0; i < 3; ++i) c->state.position[i] += steps[0][i];
    quaternion_of(steps[1], turn);
    copy(c->state.quaternion, before, 4);
    multiply(turn, before, c->state.quaternion);
    shifted(c, steps[0], steps[1]);
}

/* Wait until the tool rests; plan from there; move the command there, once; look; go on. */
static int yield_to(noslip_controller *c, double h) {
    const double calm = larger(CALM, CALM_GAPS * c->seen[SEEN_GAP]);
    if (c->speed > 0) {
        if (track(c, h, 1) < 0) return 1;
        if (c->mode == NOSLIP_MODE_HOLD) return 0;
    }
    if (c->stage == WAIT) {
        wait_for(c, calm);
    } else if (c->stage == MOVE && c->pending) {
        go_there(c, h);
    } else if (c->time - c->since >= larger(calm, 3 * c->seen[SEEN_PLACE_LAG])) {
        if (c->seen[SEEN_PACE] < 1) {
            if (!is_small_bias(c)) {
                accept_or_block(c);
                return 0;
            }
            /* It went along: a bias. */
            accept_bias(c);
        }
        adopt(c);
    }
    return 0;
}

/* ------------------------------------------------------------------ goals */

static void take_aim(noslip_controller *c, const double *position, const double *quaternion) {
    double turn[3], last[3], angle, size = 0, unit[4];
    int i;
    if (position) take_goal(&c->goal, c->time, position);
    if (quaternion) {
        for (i = 0; i < 4; ++i) size += quaternion[i] * quaternion[i];
        for (i = 0; i < 4; ++i) unit[i] = quaternion[i] / sqrt(size);
        turn_between(c->goal_quaternion, unit, turn);
        copy(c->goal_turn.is_told ? c->goal_turn.last : turn, last, 3);
        angle = norm(turn);
        if (angle > 0 && dot(last, turn) < 0 && apart(turn, last) > pi) {
            /* The same rotation, the other way round. */
            for (i = 0; i < 3; ++i) turn[i] *= 1 - 2 * pi / angle;
        }
        take_goal(&c->goal_turn, c->time, turn);
    }
}

/* Plan for the goal, if it has moved out of the funnel. */
static void look_at_goal(noslip_controller *c) {
    const double fraction = c->state.fraction;
    const int tracks = c->mode == NOSLIP_MODE_TRACK;
    double left, aim[7], deviations[2], turn[3], funnel;
    int jumped, wide, near;
    /* What was told holds until it is told otherwise. */
    if (c->goal.is_told) take_goal(&c->goal, c->time, c->goal.last);
    if (c->goal_turn.is_told) take_goal(&c->goal_turn, c->time, c->goal_turn.last);
    if (c->pending || c->mode == NOSLIP_MODE_YIELD || c->time < c->next_plan) return;
    left = tracks ? between(now(c)->left, fraction) : 0;
    aim_at(c, left, aim, deviations);
    if (c->goal.far >= 0 || c->goal_turn.far >= 0) return;
    jumped = larger(c->goal.since, c->goal_turn.since) >= c->time - PATIENCE;
    wide = tracks && left >= LATE * c->duration ? 1 : (int)LATE_WIDER;
    funnel = jumped ? FUNNEL : DRIFT_FUNNEL;
    funnel *= tracks ? between(now(c)->way, fraction) : 0;
    turn_between(c->target + 3, aim + 3, turn);
    near = apart(aim, c->target) <= larger(wide * GOAL_TOLERANCE * c->length, funnel) + 4 * deviations[0];
    if (near && norm(turn) <= wide * GOAL_ANGLE_TOLERANCE + 4 * deviations[1]) {
        c->goal_since = -1;
        return;
    }
    if (c->goal_since < 0) c->goal_since = c->time;
    if (jumped || c->time - c->goal_since >= PATIENCE) {
        c->goal_since = -1;
        begin_plan(c, NOSLIP_CAUSE_GOAL, aim, 1, 0);
    }
}

/* ------------------------------------------------------------------ the face */

void noslip_controller_init(noslip_controller *c, const noslip_primitive *primitive, double time_step) {
    memset(c, 0, sizeof *c);
    c->primitive = primitive;
    c->time_step = time_step;
    c->replans = 1;
    c->lag = -1;
    c->tolerance = TOLERANCE;
    c->angle_tolerance = ANGLE_TOLERANCE;
    c->bias = BIAS;
    c->faster = FASTER;
    c->plan_within = PLAN_WITHIN;
    c->knots = NOSLIP_CONTROLLER_KNOTS;
}

int noslip_controller_start(noslip_controller *c, const noslip_state *from) {
    const noslip_primitive *p = c->primitive;
    noslip_schedule *s = c->schedules;
    noslip_state first;
    double slow;
    int i;
    if (!(c->time_step > 0) || !isfinite(c->time_step) || p->basis_functions > NOSLIP_CONTROLLER_FUNCTIONS
        || c->knots > NOSLIP_CONTROLLER_KNOTS || !(c->tolerance > 0) || !(c->angle_tolerance > 0)
        || !(c->bias >= 0) || !(c->faster > 0) || !(c->plan_within >= 0) || !(c->braking >= 0)) return 1;
    noslip_start(p, &first);
    if (!whole_motion(s, p, &first)) return 1;
    measure(s);
    c->length = s->way[0] > 0 ? s->way[0] : 1;
    c->duration = p->duration;
    c->mean_speed = c->length / c->duration;
    bound(c, s);
    c->mode = NOSLIP_MODE_TRACK;
    c->blocked = c->plans = c->failures = c->failed_in_row = c->silent = c->slowed = 0;
    c->cause = NOSLIP_CAUSE_NONE;
    c->outcome = NOSLIP_REPLAN_DONE;
    c->time = c->next_plan = c->next_look = c->ramp = c->hand_over = c->due = c->since = 0;
    c->wanted_speed = c->arrive = 1;
    c->goal_since = c->aside = c->rest = -1;
    c->ahead = c->plan_within;
    c->stage = WAIT;
    zero(c->rest_at, 3);
    c->schedule = c->spare = 0;
    drop_task(c);
    observe_from(c);
    if (from) {
        noslip_start_within(p, from->duration, &first);
        copy(from->goal_position, first.goal_position, 3);
        copy(from->goal_quaternion, first.goal_quaternion, 4);
        copy(from->first_goal_position, first.first_goal_position, 3);
        copy(from->first_goal_quaternion, first.first_goal_quaternion, 4);
        if (!whole_motion(s, p, from->previous_step > 0 ? &first : from)) return 1;
    }
    schedule(c, s, AT_REST);
    follow(c, p, from ? from : &first);
    copy(c->state.goal_position, c->target, 3);
    copy(c->state.goal_quaternion, c->target + 3, 4);
    copy(c->state.goal_quaternion, c->goal_quaternion, 4);
    slow = GOAL_SLOW / c->duration;
    filter_from(&c->goal, c->state.goal_position, GOAL_JUMP * c->length, slow * c->length);
    filter_from(&c->goal_turn, 0, GOAL_ANGLE_JUMP, slow);
    c->speed = (s->begins_at_speed || c->state.previous_step > 0) && isfinite(c->faster) ? 0 : 1;
    for (i = 0; i < 3; ++i) {
        c->twist[i] = c->speed * c->state.linear_velocity[i];
        c->twist[3 + i] = c->speed * c->state.angular_velocity[i];
    }
    return 0;
}

/* A cycle of h seconds, of which so many are made good; 1 if a step failed. */
static int cycle(noslip_controller *c, double h, double passed, const double *measured) {
    noslip_state *s = &c->state;
    const double *seen = c->seen, before = s->time;
    double pose[7], lost = 0;
    int observes;
    if (measured) take_measured(c, measured);
    if (c->time >= c->next_look && (c->goal.is_told || c->goal_turn.is_told)) {
        c->next_look = c->time + LOOK_EVERY;
        look_at_goal(c);
    }
    observes = seen[SEEN_PLACE_SAMPLES] > 0;
    if (observes) {
        const double silent = larger(SILENT, SILENT_GAPS * seen[SEEN_GAP]);
        pose_of(s, pose);
        c->silent = seen[SEEN_PLACE_SAMPLES] > 3 && seen[SEEN_AGE] > silent;
    }
    if (c->mode == NOSLIP_MODE_TRACK) {
        lost = track(c, passed, 0);
        if (lost < 0) return 1;
    } else if (c->mode == NOSLIP_MODE_YIELD) {
        if (yield_to(c, passed)) return 1;
    } else if (hold(c, passed)) {
        return 1;
    }
    /* Rules that know the time know the true one, however much of a late cycle is made good. */
    s->time = RUNS_IN_PLAN_TIME ? before + h - lost : s->time + (h - passed);
    /* Of a late cycle the robot made what it makes of any. */
    if (observes) observe_move(c, pose, passed < h ? c->time_step : h);
    return 0;
}

int noslip_controller_step(noslip_controller *c, double elapsed, const double *measured,
                           const double *goal_position, const double *goal_quaternion) {
    const double *place = goal_position ? goal_position : c->state.position;
    const double *turn = goal_quaternion ? goal_quaternion : c->state.quaternion;
    double asked[7];
    double share;
    int i;
    copy(place, asked, 3);
    copy(turn, asked + 3, 4);
    if (!(elapsed > 0) || !isfinite(elapsed) || !is_pose(c, asked)) return 1;
    if (measured && !is_pose(c, measured)) measured = 0;
    if (c->replans) take_aim(c, goal_position, goal_quaternion);
    c->time += elapsed;
    if (c->mode == NOSLIP_MODE_FAULT) return 0;
    if (elapsed > larger(HALTED, 2 * c->time_step)) set_speed(c, 0);
    if (cycle(c, elapsed, smaller(elapsed, larger(MADE_GOOD, 2 * c->time_step)), measured)) {
        c->mode = NOSLIP_MODE_FAULT;
        c->speed = 0;
    }
    for (i = 0; i < c->units_now && c->pending && !is_made(c); ++i) work(c);
    share = RUNS_IN_PLAN_TIME ? c->speed : 1;
    if (c->mode == NOSLIP_MODE_FAULT) {
        /* The command stands, whatever the velocities were. */
        zero(c->twist, 6);
        return 0;
    }
    for (i = 0; i < 3; ++i) {
        c->twist[i] = share * c->state.linear_velocity[i];
        c->twist[3 + i] = share * c->state.angular_velocity[i];
    }
    return 0;
}

static void head_for(noslip_controller *c, double speed, double within) {
    c->wanted_speed = speed;
    c->ramp = within < 0 ? 0 : within > 0 ? 1 / within : INFINITY;
}

void noslip_controller_pause(noslip_controller *c, double within) { head_for(c, 0, within); }

void noslip_controller_resume(noslip_controller *c, double within) { head_for(c, 1, within); }

int noslip_controller_done(const noslip_controller *c) {
    if (c->mode != NOSLIP_MODE_HOLD || c->pending) return 0;
    if (!(c->seen[SEEN_PLACE_SAMPLES] > 0)) return 1;
    return with_left(c, 0, SEEN_PLACE_BEHIND) <= c->seen[SEEN_PLACE_BAND] && c->seen[SEEN_PACE] >= 1;
}

noslip_reason noslip_controller_reason(const noslip_controller *c) {
    if (c->mode == NOSLIP_MODE_FAULT) return NOSLIP_REASON_FAULT;
    if (c->blocked) return NOSLIP_REASON_BLOCKED;
    if (c->silent) return NOSLIP_REASON_SILENT;
    if (c->mode == NOSLIP_MODE_YIELD) {
        return c->failed_in_row > 0 ? NOSLIP_REASON_NO_PLAN : NOSLIP_REASON_HELD;
    }
    if (!(c->wanted_speed > 0)) return NOSLIP_REASON_PAUSED;
    return c->seen[SEEN_PACE] < 1 ? NOSLIP_REASON_WAITS : NOSLIP_REASON_NONE;
}

double noslip_controller_lag_and_bias(const noslip_controller *c, double bias[3]) {
    copy(c->seen + SEEN_PLACE_BIAS, bias, 3);
    return c->seen[SEEN_PLACE_LAG];
}
