/* Half of the motion; then the goal moves, and while the plan before is followed a new one is made, a unit
 * of work a cycle, from where the tool will be when it is done.  Writes t,x,y,z,qw,qx,qy,qz. */
#include "@NAME@.h"
#include "replan.h"

#include <stdio.h>

#define STEPS @STEPS@
#define KNOTS 101
#define FIT_STEPS @FIT_STEPS@
/* Cycles ahead: as many units as a plan takes, about, and some more. */
#define AHEAD (@STEPS@ / 5)

static double memory[NOSLIP_REPLAN_MEMORY(KNOTS, FIT_STEPS, @FUNCTIONS@)];

static void print(const noslip_state *state) {
    int i;
    printf("%.17g", state->time);
    for (i = 0; i < 3; ++i) printf(",%.17g", state->position[i]);
    for (i = 0; i < 4; ++i) printf(",%.17g", state->quaternion[i]);
    printf("\n");
}

int main(void) {
    static noslip_workspace workspace;
    const noslip_primitive *followed = &@NAME@;
    const double cycle = @NAME@.duration / STEPS, aside[3] = @ASIDE@;
    noslip_state state, ahead;
    noslip_goal goal = {{0}, {0}, 0};
    int k, i, outcome = NOSLIP_REPLAN_GOING_ON;
    workspace.memory = memory;
    workspace.knots = KNOTS;
    workspace.steps = FIT_STEPS;
    workspace.units = 1;
    for (i = 0; i < 3; ++i) goal.position[i] = followed->goal_position[i] + aside[i];
    for (i = 0; i < 4; ++i) goal.quaternion[i] = followed->goal_quaternion[i];
    noslip_start(followed, &state);
    printf("t,x,y,z,qw,qx,qy,qz\n");
    print(&state);
    for (k = 0; !noslip_done(&state); ++k) {
        if (k == STEPS / 2) {
            ahead = state;
            for (i = 0; i < AHEAD; ++i) noslip_step(followed, &ahead, cycle);
        }
        if (k >= STEPS / 2 && outcome == NOSLIP_REPLAN_GOING_ON) {
            outcome = noslip_replan(followed, &ahead, &goal, &workspace);
        }
        if (k == STEPS / 2 + AHEAD && outcome == NOSLIP_REPLAN_DONE) {
            followed = &workspace.primitive;
            noslip_start(followed, &state);
        }
        noslip_step(followed, &state, cycle);
        print(&state);
    }
    fprintf(stderr, "plan: outcome %d after %d Newton steps; it ends %.3g m and %.3g rad from its goal\n",
            outcome, workspace.iterations, workspace.end_error, workspace.end_rotation_error);
    return outcome != NOSLIP_REPLAN_DONE;
}
