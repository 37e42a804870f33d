/* Compares a motion with the one that Python made; exits with 1 where they differ. */
#include "@NAME@.h"

#include <stdio.h>
#include <tgmath.h>

#define STEPS @STEPS@
#define EVERY @EVERY@

/* Coordinates, then quaternions. */
static const double expected[][NOSLIP_LINEAR + 4 * NOSLIP_ROTATIONS] = {
@EXPECTED@
};

#define CHANNELS @CHANNELS@
#if CHANNELS
/* And what goes with it; how large each becomes, or 1. */
static const double expected_channels[][CHANNELS] = {
@EXPECTED_CHANNELS@
};
static const double sizes[CHANNELS] = {@CHANNEL_SIZES@};
#endif

/* Largest residual that rounding causes, and difference from double precision. */
#define SINGLE (sizeof(noslip_real) < sizeof(double))
#define DIFFERENCE (SINGLE ? @SINGLE_DIFFERENCE@ : @DIFFERENCE@)
#define RESIDUAL (SINGLE ? @SINGLE_RESIDUAL@ : 1e-10)

int main(void) {
    noslip_state state;
    double apart = 0, residual = 0;
    int k, i, failed;
#if NOSLIP_ROTATIONS
    int r;
#endif
#if CHANNELS
    noslip_real channels[CHANNELS] = {0};
#endif
    noslip_start(&@NAME@, &state);
    for (k = 1; k <= STEPS; ++k) {
        noslip_step(&@NAME@, &state, @NAME@.duration / STEPS);
        for (i = 0; i < NOSLIP_EQUALITIES; ++i) {
            residual = fmax(residual, fabs((double)state.values[i]));
        }
        if (k % EVERY == 0) {
            const double *wanted = expected[k / EVERY - 1];
            for (i = 0; i < NOSLIP_LINEAR; ++i) {
                apart = fmax(apart, fabs((double)state.position[i] - wanted[i]));
            }
#if NOSLIP_ROTATIONS
            for (r = 0; r < NOSLIP_ROTATIONS; ++r) {
                const noslip_real *turned = state.quaternion + 4 * r;
                const double *turn = wanted + NOSLIP_LINEAR + 4 * r;
                double sign = 0;
                for (i = 0; i < 4; ++i) sign += (double)turned[i] * turn[i];
                sign = sign < 0 ? -1 : 1;
                for (i = 0; i < 4; ++i) {
                    apart = fmax(apart, fabs(sign * (double)turned[i] - turn[i]));
                }
            }
#endif
#if CHANNELS
            if (noslip_channels(&@NAME@, &state, channels)) apart = HUGE_VAL;
            for (i = 0; i < CHANNELS; ++i) {
                const double away = fabs((double)channels[i] - expected_channels[k / EVERY - 1][i]);
                apart = fmax(apart, away / sizes[i]);
            }
#endif
        }
    }
    /* Written so that NaN fails. */
    failed = !(apart <= DIFFERENCE) || !(residual <= RESIDUAL);
    printf("%s: differs by %.3g, residual %.3g\n", failed ? "FAILED" : "passed", apart, residual);
    return failed;
}
