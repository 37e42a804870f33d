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

/* What is inlined takes the widest registers of the machine that it runs on. */
#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__)
#define WIDEST __attribute__((target_clones("arch=haswell", "default")))
#else
#define WIDEST
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
WIDEST void noslip_residuals(const double *times, double time_step, const double *points,
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

/* into[s] -= sum_j row[j] * from[j][s], for `width` j: four at a time, as loads are what it takes. */
INLINED void subtract(double *restrict into, const double *row, const double *restrict from, int width,
                      long long motions) {
    int j = 0;
    for (; j + 4 <= width; j += 4) {
        const double *restrict at = from + j * motions;
        double a = row[j], b = row[j + 1], c = row[j + 2], d = row[j + 3];
        for (long long s = 0; s < motions; s++)
            into[s] -= a * at[s] + b * at[motions + s] + c * at[2 * motions + s] + d * at[3 * motions + s];
    }
    for (; j < width; j++)
        for (long long s = 0; s < motions; s++) into[s] -= row[j] * from[j * motions + s];
}

/* Solve a block-tridiagonal system, factorized as noslip.distribution.blocks.Blocks tells, for
 * right[unknowns][motions], in place.  `scratch` has a block's size times motions numbers. */
WIDEST void noslip_solve(const double *inverses, const double *lower, const double *upper,
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
WIDEST void noslip_led(double length, const double *points, const double *steps, double *found,
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
