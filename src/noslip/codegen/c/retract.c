/* Motions near a feasible one, many side by side: how far each step of each is from its constraints,
 * and where a correction leads.  Arrays have a row a knot, and motions last.
 *
 * Of a motion to itself there is little to compute; of many, processors do several at once where
 * they can.
 */
#include <math.h>

typedef double noslip_real;
#define REAL(x) (x)
#define NOT_ZERO(x) ((x) < 0 || (x) > 0)

#define LINEAR @LINEAR@
#define ROTATIONS @ROTATIONS@
#define POINT (LINEAR + 4 * ROTATIONS)
#define VELOCITY (LINEAR + 3 * ROTATIONS)
#define ROWS @ROWS@
#define STAGE (VELOCITY + ROWS)
/* Of noslip.quaternions: the sine of half an angle that is it. */
#define SMALL @SMALL@

/* As many numbers as a register of the processor holds that this is compiled for. */
#if defined(__GNUC__) && defined(__AVX512F__)
#define LANES 8
#elif defined(__GNUC__) && defined(__AVX__)
#define LANES 4
#endif
#ifdef LANES
typedef double lanes __attribute__((vector_size(8 * LANES), aligned(8), may_alias));
#endif

#ifdef __GNUC__
#define INLINED static inline __attribute__((always_inline))
#else
#define INLINED static inline
#endif

INLINED void noslip_between(const noslip_real *given, noslip_real *found);

@GENERATED@

/* found[knots][ROWS][motions] of the steps to each knot of points[knots][POINT][motions]; no step
 * leads to the first one. */
void noslip_residuals(const double *times, double time_step, const double *points,
                             double *found, long long knots, long long motions) {
    for (long long k = 0; k < knots; k++) {
        const double *after = points + k * POINT * motions;
        const double *before = k ? after - POINT * motions : after;
        double *rows = found + k * ROWS * motions;
        for (long long s = 0; s < motions; s++) {
            double given[2 + 2 * POINT], out[ROWS];
            given[0] = times[k];
            given[1] = time_step;
            for (int j = 0; j < POINT; j++) {
                given[2 + j] = before[j * motions + s];
                given[2 + POINT + j] = after[j * motions + s];
            }
            noslip_between(given, out);
            for (int j = 0; j < ROWS; j++) rows[j * motions + s] = out[j];
        }
    }
}

/* into[s] -= sum_j row[j] * from[j][s], for `width` j. */
INLINED void subtract(double *into, const double *row, const double *from, int width,
                      long long motions) {
    long long s = 0;
#ifdef LANES
    /* Sums stay in four registers: what takes time is loading. */
    for (; s + 4 * LANES <= motions; s += 4 * LANES) {
        lanes *at = (lanes *)(into + s);
        lanes a = at[0], b = at[1], c = at[2], d = at[3];
        for (int j = 0; j < width; j++) {
            const lanes *x = (const lanes *)(from + j * motions + s);
            a -= row[j] * x[0];
            b -= row[j] * x[1];
            c -= row[j] * x[2];
            d -= row[j] * x[3];
        }
        at[0] = a;
        at[1] = b;
        at[2] = c;
        at[3] = d;
    }
#endif
    for (int j = 0; j < width; j++)
        for (long long m = s; m < motions; m++) into[m] -= row[j] * from[j * motions + m];
}

/* Solve a block-tridiagonal system, factorized as noslip.distribution.blocks.Blocks tells, for
 * right[unknowns][motions], in place.  `scratch` has a block's size times motions numbers. */
void noslip_solve(const double *inverses, const double *lower, const double *upper,
                         double *right, double *scratch, long long blocks, int size, int width,
                         long long motions) {
    for (long long k = 0; k < blocks; k++) {
        double *block = right + k * size * motions;
        if (k)
            for (int i = 0; i < width; i++)
                subtract(block + i * motions, lower + (k * width + i) * width, block - width * motions,
                         width, motions);
        for (long long i = 0; i < size * motions; i++) {
            scratch[i] = -block[i];
            block[i] = 0;
        }
        for (int i = 0; i < size; i++)
            subtract(block + i * motions, inverses + (k * size + i) * size, scratch, size, motions);
    }
    for (long long k = blocks - 1; k-- > 0;)
        for (int i = 0; i < size; i++)
            subtract(right + (k * size + i) * motions, upper + (k * size + i) * width,
                     right + (k + 1) * size * motions, width, motions);
}

/* found[knots][POINT][motions]: points led by steps[knots][STAGE][motions], which have the turns
 * first, then displacements over `length`; turned by 2 atan(|r| / 2). */
void noslip_led(double length, const double *points, const double *steps, double *found,
                       long long knots, long long motions) {
    for (long long k = 0; k < knots; k++) {
        const double *from = points + k * POINT * motions, *by = steps + k * STAGE * motions;
        double *to = found + k * POINT * motions;
        for (int j = 0; j < LINEAR; j++)
            for (long long s = 0; s < motions; s++)
                to[j * motions + s] =
                    from[j * motions + s] + length * by[(3 * ROTATIONS + j) * motions + s];
        for (int r = 0; r < ROTATIONS; r++) {
            const double *q = from + (LINEAR + 4 * r) * motions, *turn = by + 3 * r * motions;
            double *p = to + (LINEAR + 4 * r) * motions;
            for (long long s = 0; s < motions; s++) {
                double a = turn[s] / 2, b = turn[motions + s] / 2, c = turn[2 * motions + s] / 2;
                double w = q[s], x = q[motions + s], y = q[2 * motions + s], z = q[3 * motions + s];
                double shorter = 1 / sqrt(1 + a * a + b * b + c * c);
                p[s] = shorter * (w - a * x - b * y - c * z);
                p[motions + s] = shorter * (x + a * w + b * z - c * y);
                p[2 * motions + s] = shorter * (y + b * w + c * x - a * z);
                p[3 * motions + s] = shorter * (z + c * w + a * y - b * x);
            }
        }
    }
}

/* found[knots][POINT][motions]: points[knots][POINT], the same for all, moved by
 * changes[knots][VELOCITY][motions]; Exp(r) R, as noslip.space.Space.moved. */
void noslip_moved(const double *points, const double *changes, double *found, long long knots,
                  long long motions) {
    for (long long k = 0; k < knots; k++) {
        const double *from = points + k * POINT, *by = changes + k * VELOCITY * motions;
        double *to = found + k * POINT * motions;
        for (int j = 0; j < LINEAR; j++)
            for (long long s = 0; s < motions; s++) to[j * motions + s] = from[j] + by[j * motions + s];
        for (int r = 0; r < ROTATIONS; r++) {
            const double *turn = by + (LINEAR + 3 * r) * motions, *q = from + LINEAR + 4 * r;
            double *p = to + (LINEAR + 4 * r) * motions;
            for (long long s = 0; s < motions; s++) {
                double a = turn[s], b = turn[motions + s], c = turn[2 * motions + s];
                double angle = sqrt(a * a + b * b + c * c), cosine = cos(angle / 2);
                double sine = angle < SMALL ? 0.5 : sin(angle / 2) / angle;
                a *= sine;
                b *= sine;
                c *= sine;
                p[s] = cosine * q[0] - a * q[1] - b * q[2] - c * q[3];
                p[motions + s] = cosine * q[1] + a * q[0] + b * q[3] - c * q[2];
                p[2 * motions + s] = cosine * q[2] + b * q[0] + c * q[1] - a * q[3];
                p[3 * motions + s] = cosine * q[3] + c * q[0] + a * q[2] - b * q[1];
            }
        }
    }
}

/* states[motions][knots][POINT + VELOCITY] of points[knots][POINT][motions]: with the velocities of the
 * steps that lead to them, the first as the second; Log(R' R^T), as noslip.space.Space.difference. */
void noslip_states(double time_step, const double *points, double *states, long long knots,
                   long long motions) {
    for (long long k = 0; k < knots; k++) {
        const double *at = points + k * POINT * motions;
        const double *before = at - POINT * motions;
        for (long long s = 0; s < motions; s++) {
            double *state = states + (s * knots + k) * (POINT + VELOCITY), *rate = state + POINT;
            for (int j = 0; j < POINT; j++) state[j] = at[j * motions + s];
            if (!k) continue;
            for (int j = 0; j < LINEAR; j++) rate[j] = (state[j] - before[j * motions + s]) / time_step;
            for (int r = 0; r < ROTATIONS; r++) {
                const double *q = state + LINEAR + 4 * r, *p = before + (LINEAR + 4 * r) * motions + s;
                double a = p[0], b = -p[motions], c = -p[2 * motions], d = -p[3 * motions];
                double w = q[0] * a - q[1] * b - q[2] * c - q[3] * d;
                double x = (q[0] * b + q[1] * a) + (q[2] * d - q[3] * c);
                double y = (q[0] * c + q[2] * a) + (q[3] * b - q[1] * d);
                double z = (q[0] * d + q[3] * a) + (q[1] * c - q[2] * b);
                double sine = sqrt(x * x + y * y + z * z);
                double scale = sine < SMALL ? 2 : 2 * atan2(sine, fabs(w)) / sine;
                if (w < 0) scale = -scale;
                rate[LINEAR + 3 * r] = scale * x / time_step;
                rate[LINEAR + 3 * r + 1] = scale * y / time_step;
                rate[LINEAR + 3 * r + 2] = scale * z / time_step;
            }
            if (k == 1)
                for (int j = 0; j < VELOCITY; j++) rate[j - POINT - VELOCITY] = rate[j];
        }
    }
}
