#include "plan.h"

#include <math.h>

#define EQUALITIES NOSLIP_PLAN_EQUALITIES
#define ROWS NOSLIP_PLAN_ROWS
#define UNKNOWNS NOSLIP_PLAN_UNKNOWNS
#define TURNS NOSLIP_PLAN_TURNS
#define LINEAR NOSLIP_PLAN_LINEAR
#define ROTATIONS NOSLIP_PLAN_ROTATIONS
#define STAGE NOSLIP_PLAN_STAGE
#define WIDTH NOSLIP_PLAN_WIDTH
/* Numbers of a column of the matrix: its diagonal, and what is below. */
#define COLUMN (WIDTH + 1)
/* Columns beyond the last, that the last ones reach. */
#define PADDING (WIDTH + 1)
/* C knows no empty arrays. */
#define SOME(n) ((n) > 0 ? (n) : 1)

typedef double noslip_real;
#define REAL(x) (x)
#define NOT_ZERO(x) ((x) < 0 || (x) > 0)

@GENERATED@

/* Above, a compiler that looks for more takes longer and finds nothing; below, short loops are worth it. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("O3")
#endif

static double larger(double a, double b) { return a > b ? a : b; }
static double smaller(double a, double b) { return a < b ? a : b; }

static double *right_of(const noslip_plan *p) {
    return p->workspace + (p->knots * STAGE + PADDING) * COLUMN;
}

static double *scale_of(const noslip_plan *p) { return right_of(p) + p->knots * STAGE + PADDING; }

/* Of the knot before the one, on. */
static const double *quaternions_at(const noslip_plan *p, int k) {
    return p->quaternions + 4 * ROTATIONS * k;
}

static const double *positions_at(const noslip_plan *p, int k) { return p->positions + LINEAR * k; }

static int is_asked(const noslip_plan *p, int k) {
    int r, any = 0;
    for (r = 0; r < ROWS; ++r) any |= p->active[k * ROWS + r];
    return any;
}

static void clock_at(const noslip_plan *p, int k, double *at) {
    at[0] = p->begin + k * p->time_step;
    at[1] = p->time_step;
    at[2] = p->length;
}

/* A row's residual as a number of order 1. */
static double scaled(const noslip_plan *p, int k, int r, double value) {
    return (value - (p->clearance ? p->clearance[k * ROWS + r] : 0)) * p->row_scale[r];
}

void noslip_plan_values(const noslip_plan *p, double *values) {
    double at[3];
    int k;
    for (k = 0; k < p->knots; ++k) {
        clock_at(p, k, at);
        noslip_values(p->z + k * UNKNOWNS, quaternions_at(p, k), positions_at(p, k), at,
                      values + k * ROWS);
    }
}

/* The largest residual over its tolerance; not finite if one is not. */
static double largest_residual(const noslip_plan *p) {
    double at[3], values[SOME(ROWS)], largest = 0;
    int k, r;
    for (k = 0; k < p->knots; ++k) {
        if (!is_asked(p, k)) continue;
        clock_at(p, k, at);
        noslip_values(p->z + k * UNKNOWNS, quaternions_at(p, k), positions_at(p, k), at, values);
        for (r = 0; r < ROWS; ++r) {
            double missed;
            if (!p->active[k * ROWS + r]) continue;
            missed = scaled(p, k, r, values[r]);
            if (r >= EQUALITIES) missed -= p->slack[k * ROWS + r];
            missed = fabs(missed) / p->tolerance[r];
            if (!(missed <= largest)) largest = missed;
            if (!isfinite(largest)) return largest;
        }
    }
    return largest;
}

void noslip_plan_begin(noslip_plan *p, double barrier) {
    double at[3], values[SOME(ROWS)];
    int k, r, j;
    for (j = 0; j < UNKNOWNS; ++j) {
        p->z[j] = p->z[UNKNOWNS + j];
        p->z[(p->knots + 1) * UNKNOWNS + j] = p->z[p->knots * UNKNOWNS + j];
    }
    p->barrier = 0;
    p->step_size = INFINITY;
    p->iteration = p->stuck = 0;
    for (k = 0; k < p->knots * ROWS; ++k) p->multipliers[k] = 0;
    for (k = 0; k < p->knots && ROWS > EQUALITIES; ++k) {
        clock_at(p, k, at);
        noslip_values(p->z + k * UNKNOWNS, quaternions_at(p, k), positions_at(p, k), at, values);
        for (r = EQUALITIES; r < ROWS; ++r) {
            const int i = k * ROWS + r;
            if (!p->active[i]) continue;
            p->slack[i] = larger(scaled(p, k, r, values[r]), LEAST_SLACK);
            p->multipliers[i] = -barrier / p->slack[i];
            p->barrier = barrier;
        }
    }
}

static void cross(const double *a, const double *b, double *product) {
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
}

/* Rate of a rotation vector that an angular velocity leads to, the reference having its own. */
static void turn_rate(const double *turn, const double *asked, const double *own, double *change) {
    const double angle = sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);
    const double half = angle / 2;
    const int small = angle < SMALL_TURN;
    const double sine = small ? 1 - angle * angle / 6 : sin(angle) / angle;
    const double sine_of_half = small ? 1 - angle * angle / 24 : sin(half) / half;
    const double curved = small ? 1.0 / 12 : (1 - half / tan(half)) / (angle * angle);
    double once[3], twice[3], rate[3];
    int i;
    /* R = Exp(turn) R_ref turns with Exp(turn) w_ref + J turn'; J is the left Jacobian. */
    cross(turn, own, once);
    cross(turn, once, twice);
    for (i = 0; i < 3; ++i) {
        rate[i] = asked[i] - own[i] - sine * once[i]
                  - sine_of_half * sine_of_half / 2 * twice[i];
    }
    cross(turn, rate, once);
    cross(turn, once, twice);
    for (i = 0; i < 3; ++i) change[i] = rate[i] - once[i] / 2 + curved * twice[i];
}

/* Change of the correction in the step at an end, that the twist asked for there leads to. */
static void asked_change(const noslip_plan *p, int end, double *change) {
    const double *turns = p->z + (end ? p->knots : 1) * UNKNOWNS;
    const double *asked = p->twists[end], *own = asked + NOSLIP_PLAN_VELOCITY;
    int i;
    for (i = 0; i < 3 * ROTATIONS; i += 3) {
        turn_rate(turns + i, asked + LINEAR + i, own + LINEAR + i, change + i);
    }
    for (i = 3 * ROTATIONS; i < UNKNOWNS; ++i) {
        change[i] = (asked[i - 3 * ROTATIONS] - own[i - 3 * ROTATIONS]) / p->length;
    }
    for (i = 0; i < UNKNOWNS; ++i) change[i] *= p->time_step;
}

/* The cost's part of a knot's columns, and all else zero. */
static void add_cost(const noslip_plan *p, double asked[2][UNKNOWNS], int k, double *columns,
                     double *right) {
    const int last = p->knots - 1;
    const double diagonal = k == 0 || k == last ? 1 : k == 1 || k == last - 1 ? 5 : 6;
    const double beside = k == 0 || k == last - 1 ? -2 : -4;
    int i, j;
    for (i = 0; i < STAGE * COLUMN; ++i) columns[i] = 0;
    for (j = 0; j < UNKNOWNS; ++j) {
        const double *z = p->z + (k + 1) * UNKNOWNS + j;
        const double bending = p->bending[j >= TURNS];
        const double weight = j < TURNS ? p->turn_weights[k] : p->position_weight;
        double before = j < TURNS && k > 0 ? p->turn_slopes[k - 1] : 0;
        double after = j < TURNS && k < last ? p->turn_slopes[k] : 0;
        double changed = z[0] - z[-UNKNOWNS], changes = z[UNKNOWNS] - z[0], gradient = weight * z[0];
        if (p->twists[0]) {
            if (k == 0) after += 2 * bending, changes -= asked[0][j];
            if (k == 1) before += 2 * bending, changed -= asked[0][j];
        }
        if (p->twists[1]) {
            if (k == last) before += 2 * bending, changed -= asked[1][j];
            if (k == last - 1) after += 2 * bending, changes -= asked[1][j];
        }
        columns[j * COLUMN] = weight + bending * diagonal + before + after;
        if (k < last) columns[j * COLUMN + STAGE] = bending * beside - after;
        if (k < last - 1) columns[j * COLUMN + 2 * STAGE] = bending;
        gradient += before * changed - after * changes;
        if (k > 1) gradient += bending * (z[0] - 2 * z[-UNKNOWNS] + z[-2 * UNKNOWNS]);
        if (k > 0 && k < last) gradient -= 2 * bending * (z[UNKNOWNS] - 2 * z[0] + z[-UNKNOWNS]);
        if (k < last - 1) gradient += bending * (z[2 * UNKNOWNS] - 2 * z[UNKNOWNS] + z[0]);
        right[j] = -gradient;
    }
    if (!p->metric) return;
    for (j = 0; j < UNKNOWNS; ++j) {
        const double *z = p->z + (k + 1) * UNKNOWNS;
        const double *form = p->metric + (k * UNKNOWNS + j) * UNKNOWNS;
        right[j] -= p->pull[k * UNKNOWNS + j];
        for (i = 0; i < UNKNOWNS; ++i) right[j] -= form[i] * z[i];
        for (i = j; i < UNKNOWNS; ++i) columns[j * COLUMN + i - j] += form[i];
    }
}

/* The constraints' part: their slopes, and their curvature if need be.
 *
 * Unknown are the multipliers' changes, not they themselves: these do not vanish, and neither would what
 * rounding makes of them. */
static void add_constraints(const noslip_plan *p, int k, int curved, double *columns, double *right) {
    const double *z = p->z + k * UNKNOWNS, *q = quaternions_at(p, k), *x = positions_at(p, k);
    const unsigned char *active = p->active + k * ROWS;
    const int first = k == 0, last = k == p->knots - 1;
    double at[3], slopes[SOME(ROWS + SLOPES)], weights[SOME(ROWS)], curvature[SOME(CURVATURES)];
    int e, r;
    for (r = 0; r < ROWS; ++r) {
        columns[(UNKNOWNS + r) * COLUMN] = active[r] ? 0 : -1;
        right[UNKNOWNS + r] = 0;
    }
    if (!is_asked(p, k)) return;
    clock_at(p, k, at);
    noslip_slope(z, q, x, at, slopes);
    for (r = 0; r < ROWS; ++r) {
        const double multiplier = p->multipliers[k * ROWS + r];
        weights[r] = multiplier * p->row_scale[r];
        if (!active[r]) continue;
        right[UNKNOWNS + r] = -scaled(p, k, r, slopes[r]);
        if (r >= EQUALITIES) {
            columns[(UNKNOWNS + r) * COLUMN] = p->slack[k * ROWS + r] / multiplier;
            right[UNKNOWNS + r] -= p->barrier / multiplier;
        }
    }
    for (e = 0; e < SLOPES; ++e) {
        const int row = slope_rows[e];
        const double entry = slopes[ROWS + e] * p->row_scale[row];
        if (!active[row]) continue;
        if ((first && slope_knots[e] < 0) || (last && slope_knots[e] > 0)) continue;
        columns[slope_places[e]] += entry;
        right[slope_knots[e] * STAGE + slope_columns[e]] -= entry * p->multipliers[k * ROWS + row];
    }
    if (!curved) return;
    noslip_curvature(z, q, x, at, weights, curvature);
    for (e = 0; e < CURVATURES; ++e) {
        if ((first && curvature_firsts[e] < 0) || (last && curvature_lasts[e] > 0)) continue;
        columns[curvature_places[e]] += curvature[e];
    }
}

/* An unknown stays as it is. */
static void fix(double *band, double *right, int c) {
    double *column = band + c * COLUMN;
    int d;
    for (d = 1; d <= WIDTH; ++d) {
        column[d] = 0;
        if (d <= c) column[d - d * COLUMN] = 0;
    }
    column[0] = 1;
    right[c] = 0;
}

/* What each unknown and row is measured by, 1 over its size; the rows' regularization is relative. */
static void regularize(const noslip_plan *p, double *band, double *scale) {
    double most[SOME(ROWS)] = {0};
    int k, r, j, e;
    for (k = 0; k < p->knots; ++k) {
        double *sizes = scale + k * STAGE, *columns = band + k * STAGE * COLUMN;
        for (j = 0; j < UNKNOWNS; ++j) sizes[j] = 1 / fabs(columns[j * COLUMN]);
        for (r = 0; r < ROWS; ++r) sizes[UNKNOWNS + r] = 0;
    }
    for (k = 0; k < p->knots; ++k) {
        double *sizes = scale + k * STAGE, *columns = band + k * STAGE * COLUMN;
        for (e = 0; e < SLOPES; ++e) {
            const int other = k + slope_knots[e];
            double *size = sizes + UNKNOWNS + slope_rows[e], entry;
            if (other < 0 || other >= p->knots) continue;
            entry = columns[slope_places[e]];
            *size = larger(*size, entry * entry * sizes[slope_knots[e] * STAGE + slope_columns[e]]);
        }
        for (r = 0; r < ROWS; ++r) {
            if (p->active[k * ROWS + r]) most[r] = larger(most[r], sizes[UNKNOWNS + r]);
        }
    }
    for (k = 0; k < p->knots; ++k) {
        for (r = 0; r < ROWS; ++r) {
            const int i = k * STAGE + UNKNOWNS + r;
            double size = larger(larger(scale[i], fabs(band[i * COLUMN])), VANISHING * most[r]);
            if (!(size > 0)) size = 1;
            scale[i] = 1 / size;
            if (p->active[k * ROWS + r]) band[i * COLUMN] -= DUAL_REGULARIZATION * size;
        }
    }
}

/* Entries below a pivot over it; what becomes of the right side, and how much the entries grow at most.
 * Leaves 1 / pivot in its place. */
static void eliminate(double *column, double *right, const double *scale, double *factors,
                      double *growth) {
    const double inverse = 1 / column[0], pivot_right = right[0];
    int i;
    for (i = 1; i <= WIDTH; ++i) {
        factors[i] = column[i] * inverse;
        growth[i] = larger(growth[i], fabs(factors[i] * column[i]) * scale[i]);
        right[i] -= factors[i] * pivot_right;
    }
    column[0] = inverse;
}

/* Factorize the matrix as L D L^T and solve; how much an entry grew on the way, at most.
 * Two columns at a time: what they take from a third one is written once. */
static double solve_band(double *band, double *right, const double *scale, int size) {
    double growth[WIDTH + 1] = {0}, one[WIDTH + 4] = {0}, two[WIDTH + 4] = {0};
    double from_one[WIDTH + 2] = {0}, from_two[WIDTH + 2] = {0};
    int c, i, d;
    for (c = 0; c < size; c += 2) {
        double *column = band + c * COLUMN, *next = column + COLUMN;
        eliminate(column, right + c, scale + c, from_one, growth);
        for (i = 0; i < COLUMN; ++i) one[i] = column[i];
        for (d = 0; d < WIDTH; ++d) next[d] -= from_one[1] * one[1 + d];
        eliminate(next, right + c + 1, scale + c + 1, from_two + 1, growth);
        for (i = 0; i < COLUMN; ++i) two[1 + i] = next[i];
        for (i = 2; i <= WIDTH + 1; ++i) {
            const double f = from_one[i], g = from_two[i];
            double *below = column + i * COLUMN;
            for (d = 0; d <= WIDTH + 1 - i; d += 2) {
                below[d] -= f * one[i + d] + g * two[i + d];
                below[d + 1] -= f * one[i + d + 1] + g * two[i + d + 1];
            }
        }
    }
    for (i = size; i < size + PADDING; ++i) right[i] = 0;
    for (c = size - 1; c >= 0; --c) {
        const double *column = band + c * COLUMN, *rest = right + c;
        double even = 0, odd = right[c];
        for (i = WIDTH; i > 1; i -= 2) {
            even += column[i] * rest[i];
            odd -= column[i - 1] * rest[i - 1];
        }
        if (i == 1) odd -= column[1] * rest[1];
        right[c] = (odd - even) * column[0];
    }
    for (i = 2; i <= WIDTH; ++i) growth[1] = larger(growth[1], growth[i]);
    return growth[1];
}

/* Set up the optimality conditions and solve them. */
static int newton_step(noslip_plan *p) {
    const int size = p->knots * STAGE;
    const int curved = p->careful ? p->step_size < NEAR : p->iteration >= GAUSS_NEWTON_STEPS;
    double *band = p->workspace, *right = right_of(p), *scale = scale_of(p), asked[2][UNKNOWNS];
    int k, j, i;
    for (i = 0; i < 2; ++i) {
        if (p->twists[i]) asked_change(p, i, asked[i]);
    }
    for (i = size * COLUMN; i < (size + PADDING) * COLUMN; ++i) band[i] = 0;
    for (i = size; i < size + PADDING; ++i) right[i] = scale[i] = 0;
    band[size * COLUMN] = 1;
    for (k = 0; k < p->knots; ++k) {
        add_cost(p, asked, k, band + k * STAGE * COLUMN, right + k * STAGE);
    }
    for (k = 0; k < p->knots; ++k) {
        add_constraints(p, k, curved, band + k * STAGE * COLUMN, right + k * STAGE);
    }
    for (k = 0; k < p->knots; ++k) {
        for (j = 0; j < UNKNOWNS; ++j) {
            if (p->fixed[k * UNKNOWNS + j]) fix(band, right, k * STAGE + j);
        }
    }
    regularize(p, band, scale);
    if (!(solve_band(band, right, scale, size) <= MOST_GROWTH)) return 0;
    for (i = 0; i < size; ++i) {
        if (!isfinite(right[i])) return 0;
    }
    return 1;
}

/* Fraction of a step that leaves a positive value positive. */
static double room(double value, double step) {
    return step < 0 ? smaller(1, -TO_THE_BOUNDARY * value / step) : 1;
}

/* What a limit's slack grows by in a whole step, its push by so much more. */
static double widened(const noslip_plan *p, int i, double more) {
    const double push = -p->multipliers[i], slack = p->slack[i];
    return (p->barrier - push * slack - slack * more) / push;
}

/* Go along a step, as far as it may be trusted and as limits let it. */
static void go(noslip_plan *p) {
    const double *right = right_of(p);
    double fraction, more, products = 0;
    int k, j, r, heeded = 0;
    p->step_size = 0;
    for (k = 0; k < p->knots; ++k) {
        for (j = 0; j < UNKNOWNS; ++j) p->step_size = larger(p->step_size, fabs(right[k * STAGE + j]));
    }
    fraction = smaller(1, LARGEST_TURN / larger(p->step_size, 1e-300));
    for (k = 0; k < p->knots; ++k) {
        for (r = EQUALITIES; r < ROWS; ++r) {
            const int i = k * ROWS + r;
            if (!p->active[i]) continue;
            more = -right[k * STAGE + UNKNOWNS + r];
            fraction = smaller(fraction, room(p->slack[i], widened(p, i, more)));
            fraction = smaller(fraction, room(-p->multipliers[i], more));
        }
    }
    for (k = 0; k < p->knots; ++k) {
        for (j = 0; j < UNKNOWNS; ++j) {
            p->z[(k + 1) * UNKNOWNS + j] += fraction * right[k * STAGE + j];
        }
        for (r = 0; r < ROWS; ++r) {
            const int i = k * ROWS + r;
            more = -right[k * STAGE + UNKNOWNS + r];
            if (r >= EQUALITIES && p->active[i]) {
                p->slack[i] += fraction * widened(p, i, more);
                products += p->slack[i] * (fraction * more - p->multipliers[i]);
                ++heeded;
            }
            p->multipliers[i] -= fraction * more;
        }
    }
    for (j = 0; j < UNKNOWNS; ++j) {
        p->z[j] = p->z[UNKNOWNS + j];
        p->z[(p->knots + 1) * UNKNOWNS + j] = p->z[p->knots * UNKNOWNS + j];
    }
    if (heeded) {
        const double fall = fraction > LONG_STEP ? BARRIER_FALL : SHORT_STEP_FALL;
        p->barrier = smaller(p->barrier, larger(fall * products / heeded, p->last_barrier));
        p->stuck = fraction < STUCK ? p->stuck + 1 : 0;
    }
    ++p->iteration;
}

int noslip_plan_iterate(noslip_plan *p, int steps) {
    for (;; --steps) {
        const int last = p->barrier <= p->last_barrier;
        if (p->stuck > MOST_STUCK) return NOSLIP_PLAN_LOST;
        p->residual = INFINITY;
        if (p->step_size <= STILL) {
            p->residual = largest_residual(p);
            if (!isfinite(p->residual)) return NOSLIP_PLAN_LOST;
            if (p->residual <= 1 && p->step_size <= STEP_TOLERANCE && last) {
                return NOSLIP_PLAN_CONVERGED;
            }
        }
        if (steps <= 0) {
            return p->residual <= NEARLY && last ? NOSLIP_PLAN_NEARLY : NOSLIP_PLAN_GOING_ON;
        }
        if (!newton_step(p)) return NOSLIP_PLAN_UNRELIABLE;
        go(p);
    }
}
