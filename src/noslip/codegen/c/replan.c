/* What is left of a motion, or all of it, moved to other ends, projected, and a primitive fitted to it:
 * noslip.adapting in Python, in the same order.  The projection is in plan.c. */
#include "replan.h"
#include "inside.h"

#include <math.h>
#include <string.h>

/* The planner's constants hold for double precision. */
typedef char noslip_planning_needs_double[sizeof(noslip_real) == sizeof(double) ? 1 : -1];

#define EQUALITIES NOSLIP_PLAN_EQUALITIES
#define ROWS NOSLIP_PLAN_ROWS
#define UNKNOWNS NOSLIP_PLAN_UNKNOWNS
#define PI 3.14159265358979323846

@GENERATED@

/* Where everything stands in the memory. */
typedef struct room {
    double *positions, *quaternions;              /* [knots + 2], the first knot at 1 */
    double *turn_weights, *turn_slopes, *clearance, *multipliers, *slack, *z, *found;
    double *weights, *winding, *splines;
    unsigned char *fixed, *active;
    double *scratch;
} room;

static room room_of(const noslip_workspace *w, int functions) {
    const int n = w->knots + 2;
    room r;
    double *next = w->memory;
    r.positions = next, next += 3 * n;
    r.quaternions = next, next += 4 * n;
    r.turn_weights = next, next += n;
    r.turn_slopes = next, next += n;
    r.clearance = next, next += ROWS * n;
    r.multipliers = next, next += ROWS * n;
    r.slack = next, next += ROWS * n;
    r.z = next, next += UNKNOWNS * n;
    r.found = next, next += UNKNOWNS * n;
    r.weights = next, next += 6 * functions;
    r.winding = next, next += 4 * NOSLIP_WINDING_KNOTS;
    r.splines = next, next += 12 * NOSLIP_WINDING_KNOTS;
    r.fixed = (unsigned char *)next;
    r.active = r.fixed + UNKNOWNS * w->knots;
    r.scratch = next + (NOSLIP_PLAN_STAGE * w->knots + 7) / 8;
    return r;
}

/* ------------------------------------------------------------------ vectors, rotations */

static void copy(const double *from, double *to, int count) {
    memmove(to, from, (size_t)count * sizeof(double));
}

static void zero(double *numbers, int count) { memset(numbers, 0, (size_t)count * sizeof(double)); }

static void cross(const double *a, const double *b, double *product) {
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
}

/* A vector turned by a quaternion. */
static void turn_by(const double *q, const double *vector, double *turned) {
    double once[3], twice[3];
    int i;
    cross(q + 1, vector, once);
    for (i = 0; i < 3; ++i) once[i] += q[0] * vector[i];
    cross(q + 1, once, twice);
    for (i = 0; i < 3; ++i) turned[i] = vector[i] + 2 * twice[i];
}

static void turn_back(const double *q, const double *vector, double *turned) {
    double back[4];
    conjugate(q, back);
    turn_by(back, vector, turned);
}

/* Rotation vector from one rotation to another, in the frame of the one. */
static void turn_within(const double *from, const double *to, double *vector) {
    double world[3];
    turn_between(from, to, world);
    turn_back(from, world, vector);
}

static double angle_between(const double *one, const double *other) {
    double turn[3];
    turn_between(one, other, turn);
    return norm(turn);
}

/* Each of many quaternions within a quarter sphere of the one before. */
static void without_flips(double *quaternions, int count) {
    int k, i;
    for (k = 1; k < count; ++k) {
        double *q = quaternions + 4 * k;
        double along = 0;
        for (i = 0; i < 4; ++i) along += q[i] * q[i - 4];
        for (i = 0; i < 4 && along < 0; ++i) q[i] = -q[i];
    }
}

/* Of a rotation vector, from the angular velocity of its rotation: the inverse left Jacobian's. */
static void rate_of_turn(const double *turn, const double *rate, double *found) {
    const double angle = norm(turn), half = angle / 2;
    const double curved = angle < SMALL_TURN ? 1.0 / 12 : (1 - half / tan(half)) / (angle * angle);
    double once[3], twice[3];
    int i;
    cross(turn, rate, once);
    cross(turn, once, twice);
    for (i = 0; i < 3; ++i) found[i] = rate[i] - once[i] / 2 + curved * twice[i];
}

static int is_finite(const double *numbers, int count) {
    int i;
    for (i = 0; i < count; ++i) {
        if (!isfinite(numbers[i])) return 0;
    }
    return 1;
}

/* ------------------------------------------------------------------ onto the constraints */

/* Least change, in the metric, with which rows reach values: by a Cholesky factorization with pivots,
 * which passes over rows that depend on others. */
static void least_change(double rows[EQUALITIES + 1][6], const double *reach, int count,
                         const double *inverse_metric, double *change) {
    double gram[EQUALITIES + 1][EQUALITIES + 1], right[EQUALITIES + 1], push[EQUALITIES + 1];
    int order[EQUALITIES + 1], rank = 0, i, j, k;
    double largest = 0;
    for (i = 0; i < count; ++i) {
        order[i] = i;
        push[i] = right[i] = 0;
        for (j = 0; j < count; ++j) {
            gram[i][j] = 0;
            for (k = 0; k < 6; ++k) gram[i][j] += rows[i][k] * inverse_metric[k] * rows[j][k];
        }
        largest = larger(largest, gram[i][i]);
    }
    for (; rank < count; ++rank) {
        int best = rank;
        for (i = rank; i < count; ++i) {
            if (gram[order[i]][order[i]] > gram[order[best]][order[best]]) best = i;
        }
        i = order[rank], order[rank] = order[best], order[best] = i;
        i = order[rank];
        if (!(gram[i][i] > DEPENDENT * largest)) break;
        gram[i][i] = sqrt(gram[i][i]);
        right[rank] = reach[i];
        for (k = 0; k < rank; ++k) right[rank] -= gram[i][order[k]] * right[k];
        right[rank] /= gram[i][i];
        for (j = rank + 1; j < count; ++j) gram[order[j]][i] /= gram[i][i];
        for (j = rank + 1; j < count; ++j) {
            for (k = rank + 1; k < count; ++k) {
                gram[order[j]][order[k]] -= gram[order[j]][i] * gram[order[k]][i];
            }
        }
    }
    for (i = rank - 1; i >= 0; --i) {
        push[order[i]] = right[i];
        for (k = i + 1; k < rank; ++k) push[order[i]] -= gram[order[k]][order[i]] * push[order[k]];
        push[order[i]] /= gram[order[i]][order[i]];
    }
    for (k = 0; k < 6; ++k) {
        change[k] = 0;
        for (i = 0; i < count; ++i) change[k] += inverse_metric[k] * rows[i][k] * push[i];
    }
}

/* Values and rows of the equalities, as conditions on velocities, at an instant. */
static void instant_at(double time, const double *pose, const double *twist, double *residual,
                       double *phi, double rows[EQUALITIES + 1][6]) {
#if NOSLIP_PLAN_EQUALITIES > 0
    double given[14], found[8 * EQUALITIES];
    given[0] = time;
    copy(pose, given + 1, 7);
    copy(twist, given + 8, 6);
    noslip_instant(given, found);
    copy(found, residual, EQUALITIES);
    copy(found + EQUALITIES, phi, EQUALITIES);
    copy(found + 2 * EQUALITIES, rows[0], 6 * EQUALITIES);
#else
    (void)time, (void)pose, (void)twist, (void)residual, (void)phi, (void)rows;
#endif
}

/* The nearest twist, in the rule's metric, that the equalities allow at a pose. */
void noslip_allow(double time, const double *pose, double rate, double *twist) {
    const double most = fmax(fmax(fmax(fabs(twist[0]), fabs(twist[1])), fabs(twist[2])),
                             fmax(fmax(fabs(twist[3]), fabs(twist[4])), fabs(twist[5])));
    double given[6], change[6] = {0}, first = 0;
    int pass, i, k;
    copy(twist, given, 6);
    for (pass = 0; pass < MOST_PASSES && EQUALITIES > 0; ++pass) {
        double residual[EQUALITIES + 1], phi[EQUALITIES + 1], rows[EQUALITIES + 1][6];
        double largest = 0, more[6];
        instant_at(time, pose, twist, residual, phi, rows);
        for (i = 0; i < EQUALITIES; ++i) {
            if (row_levels[i] == POSITION) phi[i] += rate * residual[i];
            largest = larger(largest, fabs(phi[i]));
        }
        if (pass == 0) first = largest;
        if (largest <= 1e-15 * larger(1, most) || !(largest <= LOST * larger(1, first))) break;
        for (i = 0; i < EQUALITIES; ++i) {
            phi[i] = -phi[i];
            for (k = 0; k < 6 && pass < APPROACHING; ++k) phi[i] += rows[i][k] * change[k];
        }
        least_change(rows, phi, EQUALITIES, inverse_metric, more);
        for (k = 0; k < 6; ++k) {
            change[k] = more[k] + (pass < APPROACHING ? 0 : change[k]);
            twist[k] = given[k] + change[k];
        }
    }
}

/* The largest residual of the rules on poses. */
static double off_surfaces(double time, const double *pose) {
    const double still[6] = {0};
    double residual[EQUALITIES + 1], phi[EQUALITIES + 1], rows[EQUALITIES + 1][6], largest = 0;
    int i;
    if (EQUALITIES == 0) return 0;
    instant_at(time, pose, still, residual, phi, rows);
    for (i = 0; i < EQUALITIES; ++i) {
        if (row_levels[i] == POSITION && !(fabs(residual[i]) <= largest)) largest = fabs(residual[i]);
    }
    return largest;
}

/* The nearest pose that they allow; 0 if there is none near. */
static int onto_surfaces(double time, double *pose) {
    static const double everything[6] = {1, 1, 1, 1, 1, 1};
    const double still[6] = {0};
    double given[7], change[6] = {0}, turn[4], first = 0, largest = 0;
    int pass, i, k, count = 0;
    copy(pose, given, 7);
    for (i = 0; i < EQUALITIES; ++i) count += row_levels[i] == POSITION;
    for (pass = 0; pass < MOST_PASSES && count > 0; ++pass) {
        double residual[EQUALITIES + 1], phi[EQUALITIES + 1], rows[EQUALITIES + 1][6], more[6];
        instant_at(time, pose, still, residual, phi, rows);
        largest = 0;
        for (i = count = 0; i < EQUALITIES; ++i) {
            if (row_levels[i] != POSITION) continue;
            copy(rows[i], rows[count], 6);
            residual[count] = residual[i];
            largest = larger(largest, fabs(residual[i]));
            ++count;
        }
        if (pass == 0) first = largest;
        if (largest <= ON_SURFACE || !(largest <= LOST * larger(1, first))) break;
        for (i = 0; i < count; ++i) {
            residual[i] = -residual[i];
            for (k = 0; k < 6 && pass < APPROACHING; ++k) residual[i] += rows[i][k] * change[k];
        }
        least_change(rows, residual, count, everything, more);
        if (pass < APPROACHING) {
            copy(more, change, 6);
            quaternion_of(change + 3, turn);
            for (i = 0; i < 3; ++i) pose[i] = given[i] + change[i];
            multiply(turn, given + 3, pose + 3);
        } else {
            double before[4];
            copy(pose + 3, before, 4);
            quaternion_of(more + 3, turn);
            for (i = 0; i < 3; ++i) pose[i] += more[i];
            multiply(turn, before, pose + 3);
        }
    }
    return largest <= APART;
}

/* ------------------------------------------------------------------ moved to other ends */

/* Twist with which samples begin or end: a parabola through the nearest steps. */
static void end_twist(const double *positions, const double *quaternions, int count, double step,
                      int end, double *twist) {
    static const double weights[3] = {15.0 / 8, -10.0 / 8, 3.0 / 8};
    int k, i;
    zero(twist, 6);
    for (k = 0; k < 3; ++k) {
        const int at = end ? count - 2 - k : k;
        double turn[3];
        turn_between(quaternions + 4 * at, quaternions + 4 * (at + 1), turn);
        for (i = 0; i < 3; ++i) {
            twist[i] += weights[k] / step * (positions[3 * (at + 1) + i] - positions[3 * at + i]);
            twist[3 + i] += weights[k] / step * turn[i];
        }
    }
}

/* Displace a motion by minimum jerk such that it reaches poses at a few of its samples, the first and
 * the last among them or not, and has twists at its ends where they are given (null: its own). */
static void displace(const room *r, int count, double step, int places, const int *at,
                     double poses[][7], const double *first_twist, const double *last_twist) {
    double *positions = r->positions + 3, *quaternions = r->quaternions + 4;
    const double *asked[2];
    double shifts[5][6], slopes[2][6];
    int knots[5], size = 0, given = 0, i, j, k;
    asked[0] = first_twist;
    asked[1] = last_twist;
    for (j = 0; j < places + 2; ++j) {
        /* The ends are places too, and stay where they are if nothing is said of them. */
        const int place = j == 0 ? 0 : j == places + 1 ? count - 1 : at[j - 1];
        if (size > 0 && place == knots[size - 1] && j == places + 1) continue;
        if (size > 0 && place == knots[size - 1]) --size;
        knots[size] = place;
        zero(shifts[size], 6);
        if (j > 0 && j <= places) {
            const double *pose = poses[given++];
            for (i = 0; i < 3; ++i) shifts[size][i] = pose[i] - positions[3 * place + i];
            turn_within(quaternions + 4 * place, pose + 3, shifts[size] + 3);
        }
        ++size;
    }
    for (j = 0; j < 2; ++j) {
        const int k_end = j ? count - 1 : 0;
        double own[6], more[3], turn[4], after[4], back[3], faster[3];
        const double *shift = shifts[j ? size - 1 : 0];
        end_twist(positions, quaternions, count, step, j, own);
        for (i = 0; i < 3; ++i) {
            slopes[j][i] = asked[j] ? asked[j][i] - own[i] : 0;
            more[i] = asked[j] ? asked[j][3 + i] - own[3 + i] : 0;
            back[i] = -shift[3 + i];
        }
        quaternion_of(shift + 3, turn);
        multiply(quaternions + 4 * k_end, turn, after);
        turn_back(after, more, faster);
        rate_of_turn(back, faster, slopes[j] + 3);
    }
    for (k = j = 0; k < count; ++k) {
        double moved[6], share, blend, turn[4], before[4], rise, way;
        while (j < size - 2 && k >= knots[j + 1]) ++j;
        share = (double)(k - knots[j]) / (double)(knots[j + 1] - knots[j]);
        blend = share * share * share * (10 - 15 * share + 6 * share * share);
        for (i = 0; i < 6; ++i) moved[i] = shifts[j][i] + blend * (shifts[j + 1][i] - shifts[j][i]);
        if (j == 0) {
            rise = share - share * share * share * (6 - share * (8 - 3 * share));
            rise *= (knots[1] - knots[0]) * step;
            for (i = 0; i < 6; ++i) moved[i] += rise * slopes[0][i];
        }
        if (j == size - 2) {
            way = 1 - share;
            rise = way - way * way * way * (6 - way * (8 - 3 * way));
            rise *= -(knots[j + 1] - knots[j]) * step;
            for (i = 0; i < 6; ++i) moved[i] += rise * slopes[1][i];
        }
        for (i = 0; i < 3; ++i) positions[3 * k + i] += moved[i];
        quaternion_of(moved + 3, turn);
        copy(quaternions + 4 * k, before, 4);
        multiply(before, turn, quaternions + 4 * k);
    }
    for (j = 0; j < places; ++j) copy(poses[j], positions + 3 * at[j], 3);
}

/* ------------------------------------------------------------------ first guess of the turns */

#if NOSLIP_HAS_EDGE

/* The first sample farther than a reach along the path, or the last one that there is. */
static int first_beyond(const double *points, const double *path, int count, double reach, int k, int way) {
    const int last = way > 0 ? count - 1 : 0;
    int found = k + way;
    if (k == last) return last;
    while (found != last && fabs(path[found] - path[k]) < (1 - ROUNDED) * reach) found += way;
    while (found != last && apart(points + 3 * found, points + 3 * k) <= reach) found += way;
    return found;
}

/* Direction in the blade's plane of samples that move across it, from those before and after. */
static void fill_open(double *tilt, const unsigned char *is_open, int first, int after) {
    int before = -1, k, j;
    for (k = first; k < after; ++k) {
        if (!is_open[k]) {
            before = k;
            continue;
        }
        for (j = k; j < after && is_open[j]; ++j) {}
        if (before < 0 && j == after) {
            tilt[k] = 0;
        } else if (before < 0) {
            tilt[k] = tilt[j];
        } else if (j == after) {
            tilt[k] = tilt[before];
        } else {
            tilt[k] = tilt[before] + (tilt[j] - tilt[before]) * (k - before) / (j - before);
        }
    }
}

/* Minimize sum w |x - value|^2 + smoothing |x''|^2, time normalized. */
static void smooth(double *values, int stride, int width, const double *weights, int count,
                   double smoothing, double *scratch) {
    const double n = count - 1, strength = smoothing * n * n * n * n;
    double *diagonal = scratch, *one = scratch + count, *two = scratch + 2 * count;
    int k, j;
    for (k = 0; k < count; ++k) {
        const int end = k < count - 1 - k ? k : count - 1 - k;
        diagonal[k] = strength * (end == 0 ? 1 : end == 1 ? 5 : 6) + (weights[k] + 1e-9);
        one[k] = k == count - 1 ? 0 : strength * (k == 0 || k == count - 2 ? -2 : -4);
        two[k] = k >= count - 2 ? 0 : strength;
        for (j = 0; j < width; ++j) values[stride * k + j] *= weights[k];
    }
    for (k = 0; k < count; ++k) {
        const double first = one[k] / diagonal[k], second = two[k] / diagonal[k];
        if (k + 1 < count) {
            diagonal[k + 1] -= first * one[k];
            one[k + 1] -= first * two[k];
        }
        if (k + 2 < count) diagonal[k + 2] -= second * two[k];
        for (j = 0; j < width; ++j) {
            if (k + 1 < count) values[stride * (k + 1) + j] -= first * values[stride * k + j];
            if (k + 2 < count) values[stride * (k + 2) + j] -= second * values[stride * k + j];
        }
        one[k] = first;
        two[k] = second;
    }
    for (k = count - 1; k >= 0; --k) {
        for (j = 0; j < width; ++j) {
            double *value = values + stride * k + j;
            *value /= diagonal[k];
            if (k + 1 < count) *value -= one[k] * value[stride];
            if (k + 2 < count) *value -= two[k] * value[2 * stride];
        }
    }
}

#endif

/* Smallest turns that bring each sample's velocity into the blade's plane, its edge leading; in how many
 * stretches it trails. */
static int guess_turns(const room *r, int count, double step, double smoothing) {
    double *z = r->z + UNKNOWNS;
    int backing = 0;
#if NOSLIP_HAS_EDGE
    double *points = r->scratch, *body = points + 3 * count, *path = body + 3 * count;
    double *speed = path + count, *tilt = speed + count, *angle = tilt + count, *weights = angle + count;
    double *spare = weights + count;
    unsigned char *is_open = (unsigned char *)(spare + 3 * count);
    double low[3], high[3], reach = 0, sum = 0, squares = 0, typical, mean = 0, last = 0;
    int first, after, i, k, any = 0;
#else
    int k;
    (void)step, (void)smoothing;
#endif
    for (k = 0; k < count; ++k) zero(z + UNKNOWNS * k, UNKNOWNS);
#if NOSLIP_HAS_EDGE
    for (k = 0; k < count; ++k) {
        double given[8], found[12];
        given[0] = k * step;
        copy(r->positions + 3 * (k + 1), given + 1, 3);
        copy(r->quaternions + 4 * (k + 1), given + 4, 4);
        noslip_edge(given, found);
        copy(found, points + 3 * k, 3);
        path[k] = k ? path[k - 1] + apart(found, points + 3 * (k - 1)) : 0;
        for (i = 0; i < 3; ++i) {
            low[i] = k ? smaller(low[i], found[i]) : found[i];
            high[i] = k ? larger(high[i], found[i]) : found[i];
        }
    }
    for (i = 0; i < 3; ++i) reach = larger(reach, high[i] - low[i]);
    reach *= REACH;
    for (k = 0; k < count; ++k) {
        const int ahead = first_beyond(points, path, count, reach, k, 1);
        const int behind = first_beyond(points, path, count, reach, k, -1);
        double given[8], found[12], velocity[3];
        given[0] = k * step;
        copy(r->positions + 3 * (k + 1), given + 1, 3);
        copy(r->quaternions + 4 * (k + 1), given + 4, 4);
        noslip_edge(given, found);
        for (i = 0; i < 3; ++i) {
            velocity[i] = (points[3 * ahead + i] - points[3 * behind + i]) / ((ahead - behind) * step);
        }
        speed[k] = norm(velocity);
        for (i = 0; i < 3; ++i) given[i] = dot(found + 3 + 3 * i, velocity);
        for (i = 0; i < 3; ++i) body[3 * k + i] = dot(edge_frame + 3 * i, given);
        sum += speed[k];
        squares += speed[k] * speed[k];
    }
    if (!(sum > 0)) return 0;
    typical = squares / sum;
    for (first = 0; first < count; first = after) {
        double facing = 1, forward = 0, all = 0, unwound = 0, before = 0;
        after = first + 1;
        if (!(speed[first] > REST * typical)) continue;
        while (after < count && speed[after] > REST * typical) ++after;
        for (k = first; k < after; ++k) {
            forward += body[3 * k];
            all += speed[k];
        }
        if (forward < -BACKWARDS * all) facing = -1, ++backing;
        for (k = first; k < after; ++k) {
            const double along = facing * body[3 * k];
            const double plunge = facing * body[3 * k + 2];
            const double within = hypot(along, plunge), side = along >= -PLUNGING * within ? 1 : -1;
            tilt[k] = atan2(side * plunge, side * along);
            is_open[k] = within < SIDEWAYS * speed[k];
        }
        fill_open(tilt, is_open, first, after);
        for (k = first; k < after; ++k) {
            const double along = facing * body[3 * k];
            const double plunge = facing * body[3 * k + 2];
            const double forth = cos(tilt[k]) * along + sin(tilt[k]) * plunge;
            const double raw = atan2(facing * body[3 * k + 1], forth);
            if (k > first && fabs(raw - before) > PI) unwound += raw > before ? -2 * PI : 2 * PI;
            before = raw;
            angle[k] = raw + unwound;
        }
        unwound = 2 * PI * rint((last - angle[first]) / (2 * PI));
        for (k = first; k < after; ++k) {
            double axis[3];
            angle[k] += unwound;
            for (i = 0; i < 3; ++i) {
                axis[i] = angle[k] * (cos(tilt[k]) * edge_frame[6 + i] - sin(tilt[k]) * edge_frame[i]);
            }
            turn_by(r->quaternions + 4 * (k + 1), axis, z + UNKNOWNS * k);
            for (i = 0; i < 3; ++i) any |= z[UNKNOWNS * k + i] < 0 || z[UNKNOWNS * k + i] > 0;
        }
        last = angle[after - 1];
    }
    for (k = 0; k < count; ++k) {
        weights[k] = smaller(speed[k], 2 * typical);
        weights[k] *= weights[k];
        mean += weights[k] / count;
    }
    for (k = 0; k < count; ++k) weights[k] = speed[k] > REST * typical ? weights[k] / mean : 0;
    if (any) smooth(z, UNKNOWNS, 3, weights, count, smoothing, spare);
#endif
    return backing;
}

/* ------------------------------------------------------------------ the projection */

/* Set up one attempt; with limits, from what was found without them. */
static void set_up(noslip_workspace *w, const room *r, double smoothing, int careful, int limits) {
    const int count = w->knots, last = count - 1;
    const double step = w->duration / last, h = 1.0 / last;
    double *positions = r->positions + 3, *quaternions = r->quaternions + 4, *z = r->z + UNKNOWNS;
    double mean = 0, most = 0, scale, tolerance, wanted[2][3];
    noslip_plan *p = &w->plan;
    int i, k, e;
    w->length = 0;
    for (k = 0; k < last; ++k) {
        r->turn_weights[k + 1] = apart(positions + 3 * k, positions + 3 * (k + 1));
        w->length += r->turn_weights[k + 1];
    }
    if (!(w->length > 0)) w->length = 1;
    r->turn_weights[0] = r->turn_weights[1];
    for (k = 0; k < count; ++k) mean += r->turn_weights[k] / count;
    for (k = 0; k < count; ++k) {
        const double relative = mean > 0 ? r->turn_weights[k] / mean : 1;
        r->turn_weights[k] = h * (relative + REST_WEIGHT);
        if (k > 0) r->turn_slopes[k - 1] = SLOPE / h / (1 + relative / SLOW * (relative / SLOW));
    }
    if (!limits) {
        double farthest = 0;
        /* As it was before an attempt that turned it. */
        for (k = 0; k < count && w->turned; ++k) {
            double turn[4], before[4];
            for (i = 0; i < 3; ++i) wanted[0][i] = -r->found[UNKNOWNS * k + i];
            quaternion_of(wanted[0], turn);
            copy(quaternions + 4 * k, before, 4);
            multiply(turn, before, quaternions + 4 * k);
        }
        w->turned = 0;
        w->backing = guess_turns(r, count, step, smoothing);
        for (k = 0; k < count; ++k) farthest = larger(farthest, norm(z + UNKNOWNS * k));
        /* Beyond, nearest means nearest to the motion as it was turned: Exp is singular at 2 pi. */
        for (k = 0; k < count && farthest > TURNED_REFERENCE; ++k) {
            double turn[4], before[4];
            w->turned = 1;
            copy(z + UNKNOWNS * k, r->found + UNKNOWNS * k, 3);
            quaternion_of(z + UNKNOWNS * k, turn);
            copy(quaternions + 4 * k, before, 4);
            multiply(turn, before, quaternions + 4 * k);
            zero(z + UNKNOWNS * k, 3);
        }
        for (e = 0; e < 2; ++e) {
            const double *own = z + UNKNOWNS * (e ? last : 0);
            turn_between(quaternions + 4 * (e ? last : 0), (e ? w->goal : w->first) + 3, wanted[e]);
            for (i = 0; i < 3; ++i) wanted[e][i] -= own[i];
        }
        for (k = 0; k < count; ++k) {
            const double share = (double)k / last;
            const double blend = share * share * share * (10 - 15 * share + 6 * share * share);
            for (i = 0; i < 3; ++i) {
                z[UNKNOWNS * k + i] += wanted[0][i] + blend * (wanted[1][i] - wanted[0][i]);
            }
        }
    } else {
        copy(r->found, z, UNKNOWNS * count);
    }
    without_flips(quaternions, count);
    for (i = 0; i < 3; ++i) {
        r->positions[i] = 2 * positions[i] - positions[3 + i];
        positions[3 * count + i] = 2 * positions[3 * last + i] - positions[3 * (last - 1) + i];
    }
    {
        double back[4], turn[4], along = 0;
        conjugate(quaternions + 4, back);
        multiply(back, quaternions, turn);
        multiply(quaternions, turn, r->quaternions);
        copy(quaternions + 4 * last, quaternions + 4 * count, 4);
        for (i = 0; i < 4; ++i) along += r->quaternions[i] * quaternions[i];
        for (i = 0; i < 4 && along < 0; ++i) r->quaternions[i] = -r->quaternions[i];
    }
    for (k = 0; k < 3 * count; ++k) most = larger(most, fabs(positions[k]));
    scale = w->length / w->duration;
    tolerance = larger(RESIDUAL_TOLERANCE, 16 * 2.220446049250313e-16 * most / step / scale);
    for (i = 0; i < ROWS; ++i) {
        const int level = row_levels[i];
        w->row_scale[i] = 1 / (level == POSITION ? w->length
                               : level == VELOCITY ? scale : scale / w->duration);
        w->tolerance[i] = i < EQUALITIES ? tolerance : larger(LIMIT_TOLERANCE, tolerance);
    }
    for (k = 0; k < count; ++k) {
        const double away = (k < last - k ? k : last - k) / (APPROACH * count);
        for (i = 0; i < UNKNOWNS; ++i) r->fixed[UNKNOWNS * k + i] = k == 0 || k == last;
        for (i = 0; i < ROWS; ++i) {
            const int heeded = i < EQUALITIES || (limits && row_priorities[i] <= w->heeded);
            r->active[ROWS * k + i]
                = (unsigned char)(heeded && k > 0 && (k < last || row_levels[i] != ACCELERATION));
            r->clearance[ROWS * k + i]
                = row_has_clearance[i] ? CLEARANCE * w->length * smaller(away, 1) : 0;
            r->slack[ROWS * k + i] = 1;
        }
    }
    for (e = 0; e < 2; ++e) {
        copy(e ? w->last_twist : w->first_twist, w->twists[e], 6);
        end_twist(positions, quaternions, count, step, e, w->twists[e] + 6);
        p->twists[e] = w->twists[e];
    }
    p->positions = r->positions;
    p->quaternions = r->quaternions;
    p->turn_weights = r->turn_weights;
    p->turn_slopes = r->turn_slopes;
    p->metric = 0;
    p->fixed = r->fixed;
    p->active = r->active;
    p->clearance = ROWS > EQUALITIES ? r->clearance : 0;
    p->row_scale = w->row_scale;
    p->tolerance = w->tolerance;
    p->z = r->z;
    p->multipliers = r->multipliers;
    p->slack = r->slack;
    p->workspace = r->scratch;
    p->bending[0] = smoothing / (h * h * h);
    p->bending[1] = POSITION_SMOOTHING / (h * h * h);
    p->time_step = step;
    p->length = w->length;
    p->begin = w->begin;
    p->position_weight = POSITION_WEIGHT * h;
    p->last_barrier = LAST_BARRIER / count;
    p->knots = count;
    p->careful = careful;
    w->smoothing = smoothing;
}

/* Whether what was found keeps all limits that are heeded. */
static int keeps_limits(noslip_workspace *w, const room *r) {
    double *values = r->scratch;
    int k, i;
    noslip_plan_values(&w->plan, values);
    for (k = 0; k < w->knots; ++k) {
        for (i = EQUALITIES; i < ROWS; ++i) {
            if (!r->active[ROWS * k + i]) continue;
            if (!(values[ROWS * k + i] * w->row_scale[i] >= -LIMIT_TOLERANCE)) return 0;
        }
    }
    return 1;
}

/* The poses that a correction leads to, in place of the reference. */
static void correct(const noslip_workspace *w, const room *r, const double *z) {
    int k, i;
    for (k = 0; k < w->knots; ++k) {
        double turn[4], before[4], *q = r->quaternions + 4 * (k + 1);
        quaternion_of(z + UNKNOWNS * k, turn);
        copy(q, before, 4);
        multiply(turn, before, q);
        for (i = 0; i < 3; ++i) {
            r->positions[3 * (k + 1) + i] += w->length * z[UNKNOWNS * k + 3 + i];
        }
    }
}

/* ------------------------------------------------------------------ the fit */

/* Cubic splines of seven columns through equally spaced knots, not-a-knot at the ends: their slopes. */
static void spline_slopes(const room *r, int count, double *slopes) {
    /* What elimination leaves of the diagonal tends to a limit at once: it is kept for each knot. */
    double *diagonal = slopes + 7 * count;
    int k, c;
    for (c = 0; c < 7; ++c) {
        const int width = c < 3 ? 3 : 4;
        const double *y = c < 3 ? r->positions + 3 + c : r->quaternions + 4 + c - 3;
        double *s = slopes + c;
#define RISE(k) (y[width * ((k) + 1)] - y[width * (k)])
        s[0] = (5 * RISE(0) + RISE(1)) / 2;
        diagonal[0] = 1;
        for (k = 1; k < count; ++k) {
            const int end = k == count - 1;
            const double above = k == 1 ? 2 : 1, beside = end ? 2 : 1, own = end ? 1 : 4;
            const double right = end ? (5 * RISE(k - 1) + RISE(k - 2)) / 2 : 3 * (RISE(k - 1) + RISE(k));
            diagonal[k] = own - beside / diagonal[k - 1] * above;
            s[7 * k] = right - beside / diagonal[k - 1] * s[7 * (k - 1)];
        }
#undef RISE
        s[7 * (count - 1)] /= diagonal[count - 1];
        for (k = count - 2; k >= 0; --k) {
            s[7 * k] = (s[7 * k] - (k == 0 ? 2 : 1) * s[7 * (k + 1)]) / diagonal[k];
        }
    }
}

/* The motion that was found on the steps of the fit: rows of position and quaternion. */
static void sample(const room *r, int count, int steps, double *points, double *slopes) {
    int k, c, at;
    double size;
    if (steps != count - 1) spline_slopes(r, count, slopes);
    for (k = 0; k <= steps; ++k) {
        double *point = points + 7 * k, place = (double)k * (count - 1) / steps, t;
        at = (int)place;
        if (at > count - 2) at = count - 2;
        t = place - at;
        for (c = 0; c < 7; ++c) {
            const int width = c < 3 ? 3 : 4;
            const double *y = c < 3 ? r->positions + 3 + c : r->quaternions + 4 + c - 3;
            const double before = y[width * at], after = y[width * (at + 1)];
            const double *s = slopes + 7 * at + c;
            if (steps == count - 1) {
                point[c] = k == steps ? after : before;
            } else {
                const double rise = after - before, bend = s[0] - rise, other = s[7] - rise;
                point[c] = before + t * (rise + (1 - t) * (bend * (1 - t) - other * t));
            }
        }
        for (c = 3, size = 0; c < 7; ++c) size += point[c] * point[c];
        for (c = 3, size = sqrt(size); c < 7; ++c) point[c] /= size;
    }
}

typedef double matrix[3][3];

/* Of a rotation vector: what makes of its rate the angular velocity, in the body's frame; or back. */
static void jacobian_of(const double *turn, int back, double found[3][3]) {
    const double angle = norm(turn), square = angle * angle;
    const int small = angle < 1e-4;
    double once, twice;
    int i, j;
    if (back) {
        once = 0.5;
        twice = small ? 1.0 / 12 + square / 720 : (1 - angle / 2 / tan(angle / 2)) / square;
    } else {
        once = small ? -0.5 + square / 24 : -(1 - cos(angle)) / square;
        twice = small ? 1.0 / 6 - square / 120 : (angle - sin(angle)) / (square * angle);
    }
    for (i = 0; i < 3; ++i) {
        for (j = 0; j < 3; ++j) {
            found[i][j] = twice * turn[i] * turn[j] + (i == j ? 1 - twice * square : 0);
        }
    }
    found[0][1] -= once * turn[2], found[1][0] += once * turn[2];
    found[0][2] += once * turn[1], found[2][0] -= once * turn[1];
    found[1][2] -= once * turn[0], found[2][1] += once * turn[0];
}

static void apply(double m[3][3], const double *vector, double *product) {
    int i;
    for (i = 0; i < 3; ++i) product[i] = dot(m[i], vector);
}

/* What the angular acceleration has of a rotation vector's rate squared. */
static void of_rate_squared(const double *turn, const double *rate, double *found) {
    const double angle = norm(turn), a2 = angle * angle, along = dot(turn, rate);
    const int small = angle < 1e-4;
    const double one = small ? 1.0 / 12 - a2 / 180
                             : (-angle * sin(angle) - 2 * (cos(angle) - 1)) / (a2 * a2);
    const double two = small ? -1.0 / 60 + a2 / 1260
                             : (-2 * angle + 3 * sin(angle) - angle * cos(angle)) / (a2 * a2 * angle);
    const double three = small ? 1.0 / 6 - a2 / 120 : (angle - sin(angle)) / (a2 * angle);
    double c[3], cc[3], dc[3];
    int i;
    cross(turn, rate, c);
    cross(turn, c, cc);
    cross(rate, c, dc);
    for (i = 0; i < 3; ++i) found[i] = along * (one * c[i] + two * cc[i]) + three * dc[i];
}

/* Solve a x = b for several columns, by elimination with pivots; a is lost. */
static void solve3(double a[3][3], double *b, int columns) {
    int i, j, k;
    for (i = 0; i < 3; ++i) {
        int best = i;
        for (j = i + 1; j < 3; ++j) {
            if (fabs(a[j][i]) > fabs(a[best][i])) best = j;
        }
        for (k = 0; k < 3; ++k) {
            const double swapped = a[i][k];
            a[i][k] = a[best][k], a[best][k] = swapped;
        }
        for (k = 0; k < columns; ++k) {
            const double swapped = b[columns * i + k];
            b[columns * i + k] = b[columns * best + k], b[columns * best + k] = swapped;
        }
        for (j = 0; j < 3; ++j) {
            const double factor = a[j][i] / a[i][i];
            if (j == i) continue;
            for (k = i; k < 3; ++k) a[j][k] -= factor * a[i][k];
            for (k = 0; k < columns; ++k) b[columns * j + k] -= factor * b[columns * i + k];
        }
    }
    for (i = 0; i < 3; ++i) {
        for (k = 0; k < columns; ++k) b[columns * i + k] /= a[i][i];
    }
}

/* Rotation vectors in each interval between knots, cubics of the fraction, such that velocity and
 * acceleration go on smoothly (as SciPy's RotationSpline). */
static void wind(const double *quaternions, int knots, double *splines) {
    const int intervals = knots - 1;
    const double step = 1.0 / intervals;
    double turns[NOSLIP_WINDING_KNOTS][3], ends[NOSLIP_WINDING_KNOTS][3];
    double upper[NOSLIP_WINDING_KNOTS][9], right[NOSLIP_WINDING_KNOTS][3], rate[3];
    matrix forth, back;
    int pass, k, i, j;
    for (k = 0; k < intervals; ++k) {
        turn_within(quaternions + 4 * k, quaternions + 4 * (k + 1), turns[k]);
        for (i = 0; i < 3; ++i) ends[k][i] = turns[k][i] / step;
    }
    /* Unknown are the angular velocities at the ends of all intervals but the last. */
    for (pass = 0; pass < MOST_PASSES && intervals > 1; ++pass) {
        double changed = 0, largest = 1;
        for (k = 0; k < intervals - 1; ++k) {
            double nonlinear[3], other[3];
            matrix pivot;
            jacobian_of(turns[k], 1, back);
            apply(back, ends[k], rate);
            of_rate_squared(turns[k], rate, nonlinear);
            for (i = 0; i < 3; ++i) {
                right[k][i] = 6 * (turns[k][i] + turns[k + 1][i]) / (step * step) - nonlinear[i];
                for (j = 0; j < 3; ++j) pivot[i][j] = i == j ? 8 / step : 0;
            }
            jacobian_of(turns[k], 0, forth);
            if (k == 0) {
                for (i = 0; i < 3; ++i) rate[i] = turns[0][i] / step;
                apply(forth, rate, other);
                for (i = 0; i < 3; ++i) right[0][i] -= 2 / step * other[i];
            } else {
                for (i = 0; i < 3; ++i) {
                    right[k][i] -= 2 / step * dot(forth[i], right[k - 1]);
                    for (j = 0; j < 3; ++j) {
                        int l;
                        for (l = 0; l < 3; ++l) {
                            pivot[i][j] -= 2 / step * forth[i][l] * upper[k - 1][3 * l + j];
                        }
                    }
                }
            }
            jacobian_of(turns[k + 1], 1, back);
            if (k == intervals - 2) {
                apply(back, ends[k + 1], other);
                for (i = 0; i < 3; ++i) right[k][i] -= 2 / step * other[i];
                zero(upper[k], 9);
            } else {
                for (i = 0; i < 9; ++i) upper[k][i] = 2 / step * back[i / 3][i % 3];
            }
            {
                matrix same;
                memcpy(same, pivot, sizeof same);
                solve3(same, upper[k], 3);
                solve3(pivot, right[k], 1);
            }
        }
        for (k = intervals - 2; k >= 0; --k) {
            for (i = 0; i < 3; ++i) {
                for (j = 0; j < 3 && k < intervals - 2; ++j) {
                    right[k][i] -= upper[k][3 * i + j] * right[k + 1][j];
                }
                changed = larger(changed, fabs(right[k][i] - ends[k][i]));
                largest = larger(largest, fabs(right[k][i]));
            }
        }
        for (k = 0; k < intervals - 1; ++k) copy(right[k], ends[k], 3);
        if (changed <= 1e-14 * largest) break;
    }
    for (k = 0; k < intervals; ++k) {
        double *spline = splines + 12 * k, end[3];
        jacobian_of(turns[k], 1, back);
        apply(back, ends[k], end);
        for (i = 0; i < 3; ++i) {
            const double begin = k ? ends[k - 1][i] : turns[0][i] / step;
            spline[i] = (-2 * turns[k][i] + step * (begin + end[i])) / (step * step * step);
            spline[3 + i] = (3 * turns[k][i] - step * (2 * begin + end[i])) / (step * step);
            spline[6 + i] = begin;
            spline[9 + i] = 0;
        }
    }
}

/* What leads the rotation to its end: that end, or fewest knots that keep the logarithm from its jump. */
static int wind_around(noslip_workspace *w, const room *r, const double *points, int steps) {
    noslip_primitive *p = &w->primitive;
    double farthest = 0, distance;
    int intervals, k;
    for (k = 0; k <= steps; ++k) {
        farthest = larger(farthest, angle_between(points + 7 * k + 3, points + 7 * steps + 3));
    }
    p->knot_quaternions = (const double(*)[4])r->winding;
    p->knot_splines = (const double(*)[12])r->splines;
    p->knots = 1;
    copy(points + 7 * steps + 3, r->winding, 4);
    zero(r->splines, 12);
    if (farthest <= FARTHEST_FROM_GOAL) return 1;
    for (intervals = 2; intervals < NOSLIP_WINDING_KNOTS; intervals *= 2) {
        for (k = 0; k <= intervals; ++k) {
            copy(points + 7 * (int)rint((double)k * steps / intervals) + 3, r->winding + 4 * k, 4);
        }
        without_flips(r->winding, intervals + 1);
        wind(r->winding, intervals + 1, r->splines);
        p->knots = intervals + 1;
        for (k = 0, distance = 0; k <= steps; ++k) {
            double along[4];
            winding_at(p, 0, (double)k / steps, along);
            distance = larger(distance, angle_between(points + 7 * k + 3, along));
        }
        if (distance <= FARTHEST_FROM_WINDING) return 1;
    }
    return 0;
}

/* What draws a sample to its end by way of the winding, as the step that leaves it feels it. */
static void drawn(const noslip_workspace *w, const double *points, int steps, int k, double *pull) {
    const noslip_primitive *p = &w->primitive;
    const double h = 1.0 / steps;
    double now[4], earlier[4], later[4], before[3] = {0, 0, 0}, after[3], lead[2];
    int i;
    winding_at(p, 0, k * h, now);
    turn_between(points + 7 * k + 3, now, pull + 3);
    for (i = 0; i < 3; ++i) pull[i] = points[7 * steps + i] - points[7 * k + i];
    if (p->knots == 1) return;
    winding_at(p, 0, (k + 1) * h, later);
    turn_between(now, later, after);
    if (k > 0) {
        winding_at(p, 0, (k - 1) * h, earlier);
        turn_between(earlier, now, before);
    }
    led_by(p, k > 0 ? h : 0, h, lead);
    for (i = 0; i < 3; ++i) {
        pull[3 + i] += lead[0] * (after[i] + before[i]) / 2 + lead[1] * (after[i] - before[i]);
    }
}

/* Activations psi_i s / sum psi of the basis functions at a fraction of the motion. */
typedef struct activated {
    double *of;
    int first, last;
} activated;

static void activate(const noslip_primitive *p, double fraction, activated *a) {
    const double phase = exp(-p->alpha_s * fraction);
    const int middle = nearest_function(p, fraction);
    const double nearest = exponent_of(p, middle, phase);
    double sum = a->of[middle] = 1;
    int i;
    for (i = middle; i > 0 && (a->of[i - 1] = gaussian(p, i - 1, phase, nearest)) > 0; --i) sum += a->of[i - 1];
    for (a->first = i, i = middle + 1; i < p->basis_functions; sum += a->of[i++]) {
        if (!((a->of[i] = gaussian(p, i, phase, nearest)) > 0)) break;
    }
    a->last = i - 1;
    for (i = a->first; i <= a->last; ++i) a->of[i] *= phase / sum;
}

static double activation(const activated *a, int i) {
    return i >= a->first && i <= a->last ? a->of[i] : 0;
}

/* Normal equations of the ridge regression; moment in the place of the weights. */
static void weigh(const noslip_workspace *w, const room *r, const double *points, int steps,
                  double *normal, double *rows) {
    const noslip_primitive *p = &w->primitive;
    const int functions = p->basis_functions;
    const double h = 1.0 / steps, stiffness = p->alpha * p->beta;
    double lead[2], carried[2], trace = 0, *sum = rows + 3 * functions;
    activated around[3];
    int k, i, j, c;
    led_by(p, h, h, lead);
    carry(p, h, h, carried);
    zero(normal, functions * functions);
    zero(r->weights, 6 * functions);
    for (i = 0; i < 3; ++i) {
        around[i].of = rows + functions * i;
        activate(p, i * h, &around[i]);
    }
    for (k = 1; k < steps; ++k) {
        activated next = around[0];
        double force[6], pull[6], turns[2][3];
        const double *point = points + 7 * k;
        int first = functions, last = 0;
        drawn(w, points, steps, k, pull);
        turn_between(point - 4, point + 3, turns[0]);
        turn_between(point + 3, point + 10, turns[1]);
        for (c = 0; c < 6; ++c) {
            const double before = c < 3 ? point[c] - point[c - 7] : turns[0][c - 3];
            const double after = c < 3 ? point[c + 7] - point[c] : turns[1][c - 3];
            force[c] = stiffness * ((after - carried[0] * before) / h / carried[1] - pull[c]);
        }
        for (i = 0; i < 3; ++i) {
            if (around[i].first < first) first = around[i].first;
            if (around[i].last > last) last = around[i].last;
        }
        for (i = first; i <= last; ++i) {
            const double before = activation(&around[0], i), now = activation(&around[1], i);
            const double after = activation(&around[2], i);
            sum[i] = now + lead[0] * (after - before) / 2 + lead[1] * (after - 2 * now + before);
        }
        for (i = first; i <= last; ++i) {
            for (j = first; j <= i; ++j) normal[functions * i + j] += sum[i] * sum[j];
            for (c = 0; c < 6; ++c) r->weights[6 * i + c] += sum[i] * force[c];
        }
        around[0] = around[1];
        around[1] = around[2];
        around[2] = next;
        if (k + 1 < steps) activate(p, (k + 2) * h, &around[2]);
    }
    for (i = 0; i < functions; ++i) trace += normal[functions * i + i];
    for (i = 0; i < functions; ++i) normal[functions * i + i] += RIDGE * trace / functions;
}

/* Solve them by a Cholesky factorization, between the first and the last entry of each row. */
static void solve_normal(double *normal, int functions, double *weights, double *starts) {
    int i, j, k, c;
    for (i = 0; i < functions; ++i) {
        double *row = normal + functions * i;
        int start = 0;
        while (start < i && !(row[start] > 0) && !(row[start] < 0)) ++start;
        starts[i] = start;
        for (j = start; j <= i; ++j) {
            const double *other = normal + functions * j;
            const int from = (int)larger(start, starts[j]);
            for (k = from; k < j; ++k) row[j] -= row[k] * other[k];
            row[j] = j < i ? row[j] / other[j] : sqrt(row[j]);
        }
        for (c = 0; c < 6; ++c) {
            for (k = start; k < i; ++k) weights[6 * i + c] -= row[k] * weights[6 * k + c];
            weights[6 * i + c] /= row[i];
        }
    }
    for (i = functions - 1; i >= 0; --i) {
        const double *row = normal + functions * i;
        for (c = 0; c < 6; ++c) {
            weights[6 * i + c] /= row[i];
            for (k = (int)starts[i]; k < i; ++k) weights[6 * k + c] -= row[k] * weights[6 * i + c];
        }
    }
}

/* The primitive of what was found: how it begins, and where. */
static int finish(noslip_workspace *w, const room *r, const double *points, int steps, double *rows) {
    noslip_primitive *p = &w->primitive;
    const int functions = p->basis_functions;
    const double h = 1.0 / steps, stiffness = p->alpha * p->beta;
    double lead[2], carried[2], pull[6], turn[3], twist[6];
    activated now, after;
    int i, c;
    now.of = rows;
    after.of = rows + functions;
    activate(p, 0, &now);
    activate(p, h, &after);
    led_by(p, 0, h, lead);
    carry(p, 0, h, carried);
    drawn(w, points, steps, 0, pull);
    for (c = 0; c < 6; ++c) {
        for (i = 0; i < functions; ++i) {
            const double here = activation(&now, i), change = activation(&after, i) - here;
            pull[c] += (here + lead[0] * change) * r->weights[6 * i + c] / stiffness;
        }
    }
    turn_between(points + 3, points + 10, turn);
    for (c = 0; c < 6; ++c) {
        const double first = (c < 3 ? points[7 + c] - points[c] : turn[c - 3]) / h;
        twist[c] = (first - carried[1] * pull[c]) / carried[0] / w->duration;
        if (w->exact_start) twist[c] = w->first_twist[c];
        w->start_velocity[c] = twist[c] * w->duration;
    }
    for (i = 0; i < 6 * functions; ++i) r->weights[i] /= stiffness;
    p->weights = (const double(*)[6])r->weights;
    p->duration = w->duration;
    p->begin = w->begin;
    p->channel_begin += (1 - p->channel_begin) * w->fraction;
    noslip_allow(p->begin, points, p->residual_rate / p->duration, twist);
    copy(points, p->start_position, 3);
    copy(points + 3, p->start_quaternion, 4);
    copy(twist, p->start_linear_velocity, 3);
    copy(twist + 3, p->start_angular_velocity, 3);
    copy(points + 7 * steps, p->goal_position, 3);
    copy(points + 7 * steps + 3, p->goal_quaternion, 4);
    return is_finite(r->weights, 6 * functions) && is_finite(twist, 6);
}

/* ------------------------------------------------------------------ one after another */

enum { BEGIN, ROLL, MOVE, ATTEMPT, ITERATE, LIMIT, ITERATE_LIMITS, CORRECT, SAMPLE, WEIGH, SOLVE, CHECK };

static int is_over(const noslip_workspace *w) {
    return w->passed > 0 && w->passed >= w->knots - 1 - FEWEST_LEFT;
}

/* Whether the motion is rolled out in two sections, up to now and from now on. */
static int has_past(const noslip_workspace *w) { return w->passed > 0 && !is_over(w); }

/* Put a state at the start of a motion over another duration. */
void noslip_start_within(const noslip_primitive *p, double duration, noslip_state *s) {
    double pose[7], twist[6];
    int i;
    noslip_start(p, s);
    s->duration = duration;
    s->pull_in = p->residual_rate / duration;
    copy(s->position, pose, 3);
    copy(s->quaternion, pose + 3, 4);
    for (i = 0; i < 3; ++i) {
        twist[i] = s->linear_velocity[i] * p->duration / duration;
        twist[3 + i] = s->angular_velocity[i] * p->duration / duration;
    }
    /* Not all rules allow a twist that is as much slower. */
    noslip_allow(s->time, pose, s->pull_in, twist);
    copy(twist, s->linear_velocity, 3);
    copy(twist + 3, s->angular_velocity, 3);
}

static int begin(noslip_workspace *w, const noslip_primitive *p, const noslip_state *s,
                 const noslip_goal *goal) {
    int i;
    w->fraction = 0;
    w->duration = p->duration;
    w->begin = p->begin;
    w->previous_step = 0;
    copy(p->start_position, w->first, 3);
    copy(p->start_quaternion, w->first + 3, 4);
    copy(p->goal_position, w->goal, 3);
    copy(p->goal_quaternion, w->goal + 3, 4);
    if (s) {
        const double given[6] = {s->duration, s->fraction, s->time, s->previous_step, 0, 0};
        if (!is_finite(s->position, 3) || !is_finite(s->quaternion, 4) || !is_finite(given, 6)
            || !is_finite(s->linear_velocity, 3) || !is_finite(s->angular_velocity, 3)
            || !is_finite(s->goal_position, 3) || !is_finite(s->goal_quaternion, 4)
            || !(s->duration > 0)) return NOSLIP_REPLAN_NOT_FINITE;
        w->fraction = smaller(larger(s->fraction, 0), 1);
        w->duration = s->duration;
        w->begin = s->time;
        w->previous_step = s->previous_step;
        copy(s->position, w->first, 3);
        copy(s->quaternion, w->first + 3, 4);
        copy(s->linear_velocity, w->first_twist, 3);
        copy(s->angular_velocity, w->first_twist + 3, 3);
        copy(s->goal_position, w->goal, 3);
        copy(s->goal_quaternion, w->goal + 3, 4);
    } else if (goal && goal->duration > 0) {
        w->duration = goal->duration;
    }
    noslip_start_within(p, w->duration, &w->state);
    if (goal) {
        double size = 0;
        if (!is_finite(goal->position, 3) || !is_finite(goal->quaternion, 4)) return NOSLIP_REPLAN_NOT_FINITE;
        if (!isfinite(goal->duration) || goal->duration < 0) return NOSLIP_REPLAN_NOT_FINITE;
        copy(goal->position, w->goal, 3);
        for (i = 0; i < 4; ++i) size += goal->quaternion[i] * goal->quaternion[i];
        for (i = 0; i < 4; ++i) w->goal[3 + i] = goal->quaternion[i] / sqrt(size);
        if (!(size > 0)) return NOSLIP_REPLAN_NOT_FINITE;
    }
    w->passed = (int)rint(w->fraction * (w->knots - 1));
    w->done_steps = w->iterations = w->turned = 0;
    w->way = w->path_length = w->left_fastest[0] = w->left_fastest[1] = 0;
    w->fastest[0] = w->fastest[1] = w->step_around = 0;
    w->primitive = *p;
    return NOSLIP_REPLAN_GOING_ON;
}

/* Some steps of the motion as it was; 1 once it is at its end. */
static int roll(noslip_workspace *w, const room *r, const noslip_primitive *p, int free) {
    const int past = has_past(w), left = w->knots - 1, total = left + (past ? w->passed : 0);
    const int middle = w->passed < 1 ? 1 : w->passed > total - 1 ? total - 1 : w->passed;
    noslip_state *s = &w->state;
    double before[3];
    int k, i;
    for (k = 0; k <= left; ++k) {
        const int at = w->done_steps, to = at - (past ? w->passed : 0);
        const double speeds[2] = {norm(s->linear_velocity), norm(s->angular_velocity)};
        double step = w->state.duration / left;
        if (past) step *= at < w->passed ? w->fraction * left / w->passed : 1 - w->fraction;
        if (at > 0) {
            for (i = 0; i < 2; ++i) {
                w->fastest[i] = larger(w->fastest[i], speeds[i]);
                if (at > w->passed) w->left_fastest[i] = larger(w->left_fastest[i], speeds[i]);
            }
            if (at == middle || at == middle + 1) {
                copy(s->linear_velocity, w->steps_around[at - middle], 3);
                copy(s->angular_velocity, w->steps_around[at - middle] + 3, 3);
                w->step_around += s->previous_step;
            }
            copy(w->last_steps[1], w->last_steps[2], 6);
            copy(w->last_steps[0], w->last_steps[1], 6);
            copy(s->linear_velocity, w->last_steps[0], 3);
            copy(s->angular_velocity, w->last_steps[0] + 3, 3);
        }
        if (at == w->passed) {
            copy(s->position, w->now, 3);
            copy(s->quaternion, w->now + 3, 4);
        }
        if (to >= 0 && to <= left) {
            copy(s->position, r->positions + 3 * (to + 1), 3);
            copy(s->quaternion, r->quaternions + 4 * (to + 1), 4);
        }
        if (at == total) return 1;
        copy(s->position, before, 3);
        if (noslip_step_once(p, s, step, free)) return -1;
        w->path_length += apart(s->position, before);
        if (at >= w->passed) w->way += apart(s->position, before);
        ++w->done_steps;
    }
    return 0;
}

/* Seconds for what is left of a motion, and for a displacement besides. */
static double time_needed(const noslip_workspace *w) {
    const noslip_state *end = &w->state;
    const double displaced = apart(w->first, w->now) + apart(w->goal, end->position);
    const double speed = w->path_length / end->duration;
    const double detour = displaced > 0 ? DETOUR * displaced * displaced / (displaced + w->way) : 0;
    const double longer = speed > 0 ? detour / speed / end->duration : 0;
    const double turn = angle_between(w->now + 3, w->first + 3) / PI;
    const double step = w->previous_step > 0 ? w->previous_step : end->duration / w->steps;
    const double needed = larger(larger(1 - w->fraction + longer, turn), LEAST_TIME) * end->duration;
    return larger(needed, FEWEST_SAMPLES * step);
}

static int holds_velocities(void) {
    int i, any = 0;
    for (i = 0; i < EQUALITIES; ++i) any |= row_levels[i] == VELOCITY;
    return any;
}

/* The twist that a motion has at an end, turned with the tool where rules tie velocities to it, and what
 * rules do not allow of it taken away; what rests but for rounding is at rest. */
static void keep_twist(const double *own, const double *fastest, const double *from, double time,
                       const double *pose, double *twist) {
    double back[4], turn[4], kept[6];
    int i;
    copy(own, kept, 6);
    for (i = 0; i < 2; ++i) {
        if (!(norm(kept + 3 * i) > AT_REST * fastest[i])) zero(kept + 3 * i, 3);
    }
    if (holds_velocities()) {
        conjugate(from, back);
        multiply(pose + 3, back, turn);
        turn_by(turn, kept, twist);
        turn_by(turn, kept + 3, twist + 3);
    } else {
        copy(kept, twist, 6);
    }
    noslip_allow(time, pose, 0, twist);
}

/* Move what is left of the motion, or all of it, to where it must begin and end. */
static int move(noslip_workspace *w, const room *r, const noslip_goal *goal, int adapting) {
    const int last = w->knots - 1, over = !adapting && is_over(w);
    const int is_given = goal && goal->duration > 0;
    double own[6], end[7], poses[3][7], step, traveled = 0, displaced, slower;
    int at[3], i, k, places = 2;
    const double *fastest = w->fastest;
    copy(w->state.position, end, 3);
    copy(w->state.quaternion, end + 3, 4);
    slower = (1 - w->fraction) * w->state.duration;
    if (!adapting) w->duration = is_given ? goal->duration : time_needed(w);
    for (k = 0; k <= last && over; ++k) {
        copy(end, r->positions + 3 * (k + 1), 3);
        copy(end + 3, r->quaternions + 4 * (k + 1), 4);
    }
    for (i = 0; i < 6; ++i) {
        own[i] = (15 * w->last_steps[0][i] - 10 * w->last_steps[1][i] + 3 * w->last_steps[2][i]) / 8;
        if (over) own[i] = 0;
        if (!adapting && is_given) own[i] *= slower / w->duration;
    }
    if (!adapting && is_given) {
        w->left_fastest[0] *= slower / w->duration;
        w->left_fastest[1] *= slower / w->duration;
        fastest = w->left_fastest;
    }
    step = w->duration / last;
    if (!goal && !onto_surfaces(w->begin + w->duration, w->goal)) return NOSLIP_REPLAN_NOT_ALLOWED;
    if (!(off_surfaces(w->begin + w->duration, w->goal) <= OFF)) return NOSLIP_REPLAN_NOT_ALLOWED;
    keep_twist(own, fastest, end + 3, w->begin + w->duration, w->goal, w->last_twist);
    if (!onto_surfaces(w->begin, w->first)) return NOSLIP_REPLAN_NOT_ALLOWED;
    if (adapting) {
        end_twist(r->positions + 3, r->quaternions + 4, w->knots, step, 0, own);
        keep_twist(own, w->fastest, r->quaternions + 4, w->begin, w->first, w->first_twist);
        for (i = 0, w->exact_start = 1; i < 6; ++i) {
            if (w->first_twist[i] < 0 || w->first_twist[i] > 0) w->exact_start = 0;
        }
    } else {
        /* Both velocities of the motion as it was change but little within half a step. */
        const double share = w->previous_step / w->step_around;
        for (i = 0; i < 6; ++i) {
            w->first_twist[i] += share * (w->steps_around[1][i] - w->steps_around[0][i]);
        }
        noslip_allow(w->begin, w->first, 0, w->first_twist);
        w->exact_start = 0;
        at[0] = last;
        copy(w->goal, poses[0], 7);
        displace(r, w->knots, step, 1, at, poses, 0, w->last_twist);
    }
    at[0] = 0;
    copy(w->first, poses[0], 7);
    if (!adapting) {
        /* Back onto the path, not just to its end, if the way there is long enough. */
        int along = 0;
        displaced = apart(w->first, r->positions + 3);
        while (along < last) {
            traveled += apart(r->positions + 3 * (along + 2), r->positions + 3 * (along + 1));
            if (traveled >= DETOUR * displaced) break;
            ++along;
        }
        k = (int)rint(SETTLED * w->knots);
        if (along + 1 > k) k = along + 1;
        if (k < last) {
            at[1] = k;
            copy(r->positions + 3 * (k + 1), poses[1], 3);
            copy(r->quaternions + 4 * (k + 1), poses[1] + 3, 4);
            places = 3;
        }
    }
    at[places - 1] = last;
    copy(w->goal, poses[places - 1], 7);
    displace(r, w->knots, step, places, at, poses, w->first_twist, w->last_twist);
    return NOSLIP_REPLAN_GOING_ON;
}

/* The next priority of limits to be left out; less than 0 if all that are left are hard. */
static int less_important(int than) {
    int i, least = -1;
    for (i = EQUALITIES; i < ROWS; ++i) {
        if (row_priorities[i] < than && row_priorities[i] > least) least = row_priorities[i];
    }
    return least;
}

/* Its own motion, some steps of it: where it ends. */
static int check(noslip_workspace *w) {
    const noslip_primitive *p = &w->primitive;
    noslip_state *s = &w->state;
    double before[3], turns;
    int k;
    for (k = 0; k < w->knots && w->done_steps < w->steps; ++k, ++w->done_steps) {
        copy(s->position, before, 3);
        if (noslip_step(p, s, p->duration / w->steps)) return NOSLIP_REPLAN_NOT_FINITE;
        w->path_length += apart(s->position, before);
        w->way += norm(s->angular_velocity) * s->previous_step;
    }
    if (w->done_steps < w->steps) return NOSLIP_REPLAN_GOING_ON;
    w->end_error = apart(s->position, w->goal);
    w->end_rotation_error = angle_between(s->quaternion, w->goal + 3);
    turns = larger(1, w->way / (2 * PI));
    if (!(w->end_error <= MISSED * w->path_length + BROKEN)
        || !(w->end_rotation_error <= MISSED_TURN * turns)) return NOSLIP_REPLAN_MISSES;
    return NOSLIP_REPLAN_DONE;
}

/* As many steps as before in the same time, where the workspace does not say how many. */
static void set_steps(noslip_workspace *w, int functions, double before) {
    const int fewest = STEPS_PER_FUNCTION * functions;
    w->primitive.steps = w->steps;
    if (w->most_steps <= 0) return;
    w->primitive.steps = (int)rint(w->steps * w->duration / before);
    if (w->primitive.steps < FEWEST_STEPS) w->primitive.steps = FEWEST_STEPS;
    if (w->primitive.steps < fewest) w->primitive.steps = fewest;
    w->steps = w->primitive.steps < w->most_steps ? w->primitive.steps : w->most_steps;
}

/* A unit of work. */
static int unit(const noslip_primitive *p, const noslip_state *s, const noslip_goal *goal,
                noslip_workspace *w) {
    const room r = room_of(w, p->basis_functions);
    const int functions = p->basis_functions, steps = w->steps > w->knots - 1 ? w->steps : w->knots - 1;
    double *points = r.scratch, *normal = points + 7 * (steps + 1), *rows = normal + functions * functions;
    int outcome = NOSLIP_REPLAN_GOING_ON, last;
    switch (w->phase) {
    case BEGIN:
        outcome = begin(w, p, s, goal);
        w->phase = ROLL;
        break;
    case ROLL:
        last = roll(w, &r, p, !s);
        if (last < 0) outcome = NOSLIP_REPLAN_NOT_FINITE;
        if (last > 0) w->phase = MOVE;
        break;
    case MOVE:
        outcome = move(w, &r, goal, !s);
        without_flips(r.quaternions + 4, w->knots);
        if (!is_finite(r.positions + 3, 3 * w->knots)) outcome = NOSLIP_REPLAN_NOT_FINITE;
        set_steps(w, functions, s ? s->duration : w->duration);
        w->attempt = 0;
        w->phase = ATTEMPT;
        break;
    case ATTEMPT:
        set_up(w, &r,
               ROTATION_SMOOTHING * (w->smoother > 0 ? w->smoother : 1) * attempts[w->attempt].factor,
               attempts[w->attempt].careful, 0);
        noslip_plan_begin(&w->plan, 0);
        w->phase = ITERATE;
        break;
    case ITERATE:
    case ITERATE_LIMITS: {
        const int limits = w->phase == ITERATE_LIMITS;
        const int most = MOST_ITERATIONS * (limits ? LIMIT_PATIENCE : attempts[w->attempt].patience);
        const int found = noslip_plan_iterate(&w->plan, w->plan.iteration < most);
        w->residual = w->plan.residual;
        ++w->iterations;
        if (found == NOSLIP_PLAN_CONVERGED || (found == NOSLIP_PLAN_NEARLY && w->plan.iteration >= most)) {
            if (!limits) copy(r.z + UNKNOWNS, r.found, UNKNOWNS * w->knots);
            w->phase = limits ? CORRECT : LIMIT;
            w->attempt = 0;
            w->heeded = less_important(MOST_PRIORITY);
        } else if (found == NOSLIP_PLAN_LOST || found == NOSLIP_PLAN_UNRELIABLE
                   || w->plan.iteration >= most) {
            ++w->attempt;
            w->phase = limits ? LIMIT : ATTEMPT;
            if (!limits && w->attempt == ATTEMPTS) outcome = NOSLIP_REPLAN_NOT_FOUND;
            if (limits && w->attempt == LIMIT_ATTEMPTS) {
                w->attempt = 0;
                w->heeded = w->heeded > 0 ? less_important(w->heeded) : -2;
            }
        }
        break;
    }
    case LIMIT:
        /* Soft limits are left out, the least important first; a hard one is not. */
        if (w->heeded == -2) outcome = NOSLIP_REPLAN_LIMITS;
        w->phase = CORRECT;
        if (w->heeded < 0) {
            copy(r.found, r.z + UNKNOWNS, UNKNOWNS * w->knots);
            break;
        }
        if (w->attempt == 0) w->first_smoothing = w->smoothing;
        set_up(w, &r, w->first_smoothing * limit_attempts[w->attempt].factor,
               limit_attempts[w->attempt].careful, 1);
        if (keeps_limits(w, &r)) break;
        noslip_plan_begin(&w->plan, limit_attempts[w->attempt].barrier / w->knots);
        w->phase = ITERATE_LIMITS;
        break;
    case CORRECT:
        correct(w, &r, r.z + UNKNOWNS);
        without_flips(r.quaternions + 4, w->knots);
        w->phase = SAMPLE;
        break;
    case SAMPLE:
        sample(&r, w->knots, steps, points, normal);
        if (!wind_around(w, &r, points, steps)) outcome = NOSLIP_REPLAN_TURNS;
        w->phase = WEIGH;
        break;
    case WEIGH:
        weigh(w, &r, points, steps, normal, rows);
        w->phase = SOLVE;
        break;
    case SOLVE:
        solve_normal(normal, functions, r.weights, rows);
        if (!finish(w, &r, points, steps, rows)) outcome = NOSLIP_REPLAN_NOT_FINITE;
        noslip_start(&w->primitive, &w->state);
        w->done_steps = 0;
        w->path_length = w->way = 0;
        w->phase = CHECK;
        break;
    default:
        outcome = check(w);
    }
    return outcome;
}

static int plan_anew(const noslip_primitive *p, const noslip_state *s, const noslip_goal *goal,
                     noslip_workspace *w) {
    int outcome = NOSLIP_REPLAN_GOING_ON, k;
    if (w->knots < FEWEST_SAMPLES || w->steps < FEWEST_STEPS || !w->memory) return NOSLIP_REPLAN_WRONG;
    if (w->steps < STEPS_PER_FUNCTION * p->basis_functions) return NOSLIP_REPLAN_WRONG;
    for (k = 0; (k < w->units || w->units <= 0) && outcome == NOSLIP_REPLAN_GOING_ON; ++k) {
        outcome = unit(p, s, goal, w);
    }
    return outcome;
}

int noslip_replan(const noslip_primitive *primitive, const noslip_state *state,
                  const noslip_goal *goal, noslip_workspace *workspace) {
    return plan_anew(primitive, state, goal, workspace);
}

int noslip_adapt(const noslip_primitive *primitive, const noslip_goal *goal,
                 noslip_workspace *workspace) {
    return plan_anew(primitive, 0, goal, workspace);
}
