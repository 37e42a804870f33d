/* Compares what becomes of a stream with what Python made of it; exits with 1 where they differ. */
#include "shield.h"

#include <math.h>
#include <stdio.h>

/* A command comes, and a pose is measured, at each so many periods; that from so many of them ago. */
#define EVERY @EVERY@
#define LATE @LATE@

/* Position (m), quaternion. */
static const double commands[][7] = {
@COMMANDS@
};
static const double expected[][7] = {
@EXPECTED@
};

int main(void) {
    static noslip_shield shield;
    const int count = (int)(sizeof commands / sizeof commands[0]);
    double apart = 0;
    int k, i, j, failed = noslip_shield_start(&shield, commands[0]);
    for (k = 0; k < count; ++k) {
        double sign = 0;
        for (j = 0; j < EVERY; ++j) {
            const double *seen = k < LATE || j ? 0 : expected[k - LATE];
            failed |= noslip_shield_step(&shield, j ? 0 : commands[k], seen);
        }
        for (i = 0; i < 4; ++i) sign += shield.quaternion[i] * expected[k][3 + i];
        sign = sign < 0 ? -1 : 1;
        for (i = 0; i < 3; ++i) apart = fmax(apart, fabs(shield.position[i] - expected[k][i]));
        for (i = 0; i < 4; ++i) {
            apart = fmax(apart, fabs(sign * shield.quaternion[i] - expected[k][3 + i]));
        }
    }
    /* Written so that NaN fails. */
    failed |= !(apart <= @DIFFERENCE@);
    printf("%s: differs by %.3g\n", failed ? "FAILED" : "passed", apart);
    return failed;
}
