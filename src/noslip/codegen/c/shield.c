/* What follows commands under constraints; both are in the graphs below. */
#include "shield.h"

/* Such code takes it for granted that nothing is NaN, and what must be noticed is not. */
#if defined(__FAST_MATH__) || defined(_M_FP_FAST)
#error "-ffast-math and the like cannot be had: what is not finite would not be noticed"
#endif

#include <math.h>

typedef double noslip_real;
#define REAL(x) ((double)(x))
#define NOT_ZERO(x) ((x) < 0 || (x) > 0)

@GENERATED@

static void copied(const double *from, double *to, int count) {
    int i;
    for (i = 0; i < count; ++i) to[i] = from[i];
}

/* Written so that NaN fails; x - x is 0 for what is finite, and NaN for what is not. */
static int all_finite(const double *numbers, int count) {
    double sum = 0;
    int i;
    for (i = 0; i < count; ++i) sum += numbers[i] - numbers[i];
    return sum >= 0;
}

static int is_pose(const double *pose) {
    const double *q = pose + 3;
    const double square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    return all_finite(pose, 7) && square > SMALLEST && square < 1 / SMALLEST;
}

/* Whether what was measured may be the tool that was commanded to a pose. */
static int is_tool(const double *measured, const double *pose) {
    int i;
    for (i = 0; i < 3; ++i) {
        if (!(fabs(measured[i] - pose[i]) <= NO_TOOL)) return 0;
    }
    return is_pose(measured);
}

int noslip_shield_start(noslip_shield *shield, const double *pose) {
    static const double seen[SEEN_SIZE] = {@SEEN@};
    double *all = (double *)shield, unit[7], length;
    int i;
    if (!is_pose(pose)) return 1;
    copied(pose, unit, 7);
    length = sqrt(pose[3] * pose[3] + pose[4] * pose[4] + pose[5] * pose[5] + pose[6] * pose[6]);
    for (i = 3; i < 7; ++i) unit[i] /= length;
    for (i = 0; i < SHIELD_SIZE; ++i) all[i] = 0;
    copied(unit, all + SHIELD_POSITION, 7);
    copied(unit, all + SHIELD_COMMAND, 7);
    copied(unit, all + SHIELD_HEARD, 7);
    copied(unit, all + SHIELD_HAND_POSITION, 7);
    copied(seen, all + SHIELD_SEEN, SEEN_SIZE);
    shield->gap = NOSLIP_SHIELD_PERIOD;
    shield->linear_peak = LINEAR_PEAK;
    shield->angular_peak = ANGULAR_PEAK;
    return 0;
}

/* The observer is told that the tool was commanded from one pose to another within so many seconds; or
 * that the other was measured while the one was commanded, and whether that tells of lag and bias. */
static void observe(double *seen, const double *one, const double *other, double number, int has_moved) {
    double given[15], found[SEEN_SIZE];
    copied(one, given, 7);
    copied(other, given + 7, 7);
    given[14] = number;
    if (has_moved) {
        noslip_moved(seen, given, found);
    } else {
        noslip_measured(seen, given, found);
    }
    copied(found, seen, SEEN_SIZE);
}

int noslip_shield_step(noslip_shield *shield, const double *command, const double *measured) {
    noslip_shield next = *shield;
    const double *before = (const double *)shield, *pose = before + SHIELD_POSITION;
    double given[GIVEN_SIZE], step[STEP_SIZE], output[OUTPUTS] = {0}, *all = (double *)&next;
    int i;
    if (!command) command = before + SHIELD_COMMAND;
    if (!is_pose(command)) return 1;
    if (measured && is_tool(measured, pose)) {
        observe(next.seen, pose, measured, next.seen[SEEN_PACE] >= 1, 0);
    }
    copied(command, given + GIVEN_COMMAND, 7);
    given[GIVEN_TIME] = shield->time;
    given[GIVEN_PACE] = next.seen[SEEN_PACE];
    noslip_follow(pose, before + SHIELD_COMMAND, given, all + SHIELD_COMMAND, step);
    noslip_core(pose, step, all + SHIELD_POSITION, output);
    if (!all_finite(all + SHIELD_POSITION, STATE_VALUES)) return 1;
    if (!all_finite(all + SHIELD_COMMAND, HEARD_SIZE)) return 1;
    for (i = 0; i < 6; ++i) {
        next.acceleration[i] = (all[SHIELD_LINEAR_VELOCITY + i] - before[SHIELD_LINEAR_VELOCITY + i])
                               / NOSLIP_SHIELD_PERIOD;
        next.force[i] = output[OUTPUT_FORCE + i];
    }
    for (i = 0; i < ALL_ROWS; ++i) next.multipliers[i] = output[OUTPUT_MULTIPLIERS + i];
    next.time += NOSLIP_SHIELD_PERIOD;
    if (next.seen[SEEN_PLACE_SAMPLES] > 0) {
        observe(next.seen, pose, all + SHIELD_POSITION, NOSLIP_SHIELD_PERIOD, 1);
    }
    *shield = next;
    return 0;
}

double noslip_shield_distance(const noslip_shield *shield) {
    double square = 0;
    int i;
    for (i = 0; i < 3; ++i) {
        square += (shield->command[i] - shield->position[i]) * (shield->command[i] - shield->position[i]);
    }
    return sqrt(square);
}

double noslip_shield_angle(const noslip_shield *shield) {
    const double *a = shield->command + 3, *b = shield->quaternion;
    const double w = fabs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]);
    const double x = a[1] * b[0] - a[0] * b[1] - a[2] * b[3] + a[3] * b[2];
    const double y = a[2] * b[0] - a[0] * b[2] - a[3] * b[1] + a[1] * b[3];
    const double z = a[3] * b[0] - a[0] * b[3] - a[1] * b[2] + a[2] * b[1];
    return 2 * atan2(sqrt(x * x + y * y + z * z), w);
}
