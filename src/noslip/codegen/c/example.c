/* Runs the primitive once and writes it as a table to standard output. */
#include "@NAME@.h"

#include <stdio.h>

#define STEPS @STEPS@
#define CHANNELS @CHANNELS@

static void print(const noslip_state *state) {
#if CHANNELS
    noslip_real channels[CHANNELS] = {0};
#endif
    int i;
    printf("%.17g", (double)state->time);
    for (i = 0; i < NOSLIP_LINEAR; ++i) printf(",%.17g", (double)state->position[i]);
#if NOSLIP_ROTATIONS
    for (i = 0; i < 4 * NOSLIP_ROTATIONS; ++i) printf(",%.17g", (double)state->quaternion[i]);
#endif
#if CHANNELS
    noslip_channels(&@NAME@, state, channels);
    for (i = 0; i < CHANNELS; ++i) printf(",%.17g", (double)channels[i]);
#endif
    printf("\n");
}

int main(void) {
    noslip_state state;
    int k;
    noslip_start(&@NAME@, &state);
    puts("@COLUMNS@");
    print(&state);
    for (k = 0; k < STEPS; ++k) {
        noslip_step(&@NAME@, &state, @NAME@.duration / STEPS);
        print(&state);
    }
    return 0;
}
