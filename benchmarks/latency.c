/* How long each step takes: a line of nanoseconds, sorted quantiles of all steps.
 * Arguments: steps. */
#define _POSIX_C_SOURCE 199309L
#include "cut.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int order(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int main(int count, char **argument) {
    const long steps = count > 1 ? atol(argument[1]) : 1000000;
    double *taken = malloc((size_t)steps * sizeof *taken), clock = 1e9;
    noslip_state s;
    long k;
    for (k = 0; k < 1000; ++k) {
        const double begin = now(), once = now() - begin;
        if (once < clock) clock = once;
    }
    noslip_start(&cut, &s);
    for (k = 0; k < steps; ++k) {
        double begin;
        if (noslip_done(&s)) noslip_start(&cut, &s);
        begin = now();
        noslip_step(&cut, &s, cut.duration / 1000);
        taken[k] = now() - begin - clock;
    }
    qsort(taken, (size_t)steps, sizeof *taken, order);
    printf("%.1f %.1f %.1f\n", taken[steps / 2], taken[steps - 1 - steps / 1000], taken[steps - 1]);
    free(taken);
    return 0;
}
