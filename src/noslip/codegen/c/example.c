/* Runs the primitive once and writes t,x,y,z,qw,qx,qy,qz to standard output. */
#include "@NAME@.h"

#include <stdio.h>

#define STEPS @STEPS@

static void print(const noslip_state *state) {
    int i;
    printf("%.17g", (double)state->time);
    for (i = 0; i < 3; ++i) printf(",%.17g", (double)state->position[i]);
    for (i = 0; i < 4; ++i) printf(",%.17g", (double)state->quaternion[i]);
    printf("\n");
}

int main(void) {
    noslip_state state;
    int k;
    noslip_start(&@NAME@, &state);
    printf("t,x,y,z,qw,qx,qy,qz\n");
    print(&state);
    for (k = 0; k < STEPS; ++k) {
        noslip_step(&@NAME@, &state, @NAME@.duration / STEPS);
        print(&state);
    }
    return 0;
}
