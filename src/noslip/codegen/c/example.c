/* Runs the primitive once and writes @COLUMNS@ to standard output. */
#include "@NAME@.h"

#include <stdio.h>

#define STEPS @STEPS@

static void print(const noslip_state *state) {
    int i;
    printf("%.17g", (double)state->time);
    for (i = 0; i < NOSLIP_LINEAR; ++i) printf(",%.17g", (double)state->position[i]);
#if NOSLIP_ROTATIONS
    for (i = 0; i < 4 * NOSLIP_ROTATIONS; ++i) printf(",%.17g", (double)state->quaternion[i]);
#endif
    printf("\n");
}

int main(void) {
    noslip_state state;
    int k;
    noslip_start(&@NAME@, &state);
    printf("@COLUMNS@\n");
    print(&state);
    for (k = 0; k < STEPS; ++k) {
        noslip_step(&@NAME@, &state, @NAME@.duration / STEPS);
        print(&state);
    }
    return 0;
}
