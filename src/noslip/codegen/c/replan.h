/* New goals on the robot: what is left of a motion, or all of it, planned anew under the constraints.
 *
 * A motion is moved to where it must begin and end, projected onto the constraints (plan.h), and a
 * primitive is fitted to what comes of it: as noslip's replan and adapt do in Python, step by step.
 * No heap; double precision.  A plan is made in small units of work, so that a control loop can make
 * one over many of its cycles while it follows the plan before: see example_replan.c.
 * @BOUND@
 * Frames of all functions together take less than 32 kB of stack.
 */
#ifndef NOSLIP_REPLAN_H
#define NOSLIP_REPLAN_H

#include "noslip.h"
#include "plan.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Knots of a winding at most: of a motion that turns far from where it ends. */
#define NOSLIP_WINDING_KNOTS 33

/* Numbers (double) of memory for a plan of so many knots, fitted on so many steps by so many basis
 * functions: with 200 knots, 400 steps and 100 functions of a blade 0.3 MB. */
#define NOSLIP_REPLAN_MEMORY(knots, steps, functions) \
    (NOSLIP_REPLAN_KEPT(knots, functions) \
     + (NOSLIP_PLAN_WORKSPACE(knots) > NOSLIP_FIT_MEMORY(knots, steps, functions) \
            ? NOSLIP_PLAN_WORKSPACE(knots) : NOSLIP_FIT_MEMORY(knots, steps, functions)))
#define NOSLIP_REPLAN_KEPT(knots, functions) \
    (((knots) + 2) * (9 + 2 * NOSLIP_PLAN_UNKNOWNS + 4 * NOSLIP_PLAN_ROWS) \
     + ((knots) * (NOSLIP_PLAN_STAGE) + 7) / 8 + 6 * (functions) + 16 * NOSLIP_WINDING_KNOTS)
#define NOSLIP_FIT_MEMORY(knots, steps, functions) \
    (21 * (knots) + 20 * ((knots) > (steps) ? (knots) : (steps) + 1) \
     + (functions) * ((functions) + 10))

/* Where to go. */
typedef struct noslip_goal {
    double position[3];
    double quaternion[4];
    double duration;        /* s, from where it begins; 0: what it takes */
} noslip_goal;

/* What a plan is made with, and what comes of it.  Set the first fields and zero the rest; the new
 * primitive stands in the memory: while it is followed, the next plan needs another workspace. */
typedef struct noslip_workspace {
    double *memory;         /* [NOSLIP_REPLAN_MEMORY(knots, steps, basis functions)] */
    int knots;              /* of the plan, 20 or more; 201 as in Python */
    int steps;              /* of the fit and of the new primitive's own motion, 200 or more, and 4 or
                             * more a basis function; 400 as in Python */
    int most_steps;         /* 0; or the most that the fit has if the steps given are those of a motion as
                             * long as before, and the new ones are to be as long: then the memory is for
                             * so many */
    int units;              /* of work in a call, each a Newton step or less; 0: all */
    double smoother;        /* times as smooth a turn as usual; 0: as usual */

    noslip_primitive primitive;   /* what came of it; begin with noslip_start */
    double end_error;             /* of its own motion, at the goal: m, rad */
    double end_rotation_error;
    double path_length;           /* m */
    double residual;              /* of the plan, over its tolerance */
    int iterations;               /* Newton steps so far */

    /* Not to be written to. */
    int phase, attempt, done_steps, passed, heeded, turned, exact_start, backing;
    noslip_state state;
    noslip_plan plan;
    double duration, begin, fraction, previous_step, length, smoothing, first_smoothing;
    double start_velocity[6];
    double first[7], goal[7], now[7], first_twist[6], last_twist[6], twists[2][12];
    double steps_around[2][6], step_around, last_steps[3][6], fastest[2], left_fastest[2], way;
    double row_scale[NOSLIP_PLAN_ROWS + 1], tolerance[NOSLIP_PLAN_ROWS + 1];
} noslip_workspace;

/* What becomes of a plan. */
enum {
    NOSLIP_REPLAN_GOING_ON,      /* call again, with the same arguments */
    NOSLIP_REPLAN_DONE,          /* its own motion ends at the goal */
    NOSLIP_REPLAN_MISSES,        /* there is a primitive; by how much it misses stands in end_error */
    NOSLIP_REPLAN_NOT_ALLOWED,   /* a constraint on poses does not allow the goal, or the start */
    NOSLIP_REPLAN_NOT_FOUND,     /* nothing near the motion as it was satisfies the equalities */
    NOSLIP_REPLAN_LIMITS,        /* no way found that keeps a hard limit: another goal; for rates, more time */
    NOSLIP_REPLAN_TURNS,         /* it turns too often for a winding of so many knots */
    NOSLIP_REPLAN_NOT_FINITE,    /* something given is not finite, or something found */
    NOSLIP_REPLAN_WRONG          /* knots, steps or memory are not what they must be */
};

/* Plan what is left of a motion from a state of it, whatever led there.  Without a goal (null): to
 * that of the state.  Not asked again after it is done: zero the phase for another plan. */
int noslip_replan(const noslip_primitive *primitive, const noslip_state *state,
                  const noslip_goal *goal, noslip_workspace *workspace);

/* Plan all of a motion from its start to another goal; it takes as long as before unless the goal says
 * how long.  For limits on speeds and the like the path gives way, not the time. */
int noslip_adapt(const noslip_primitive *primitive, const noslip_goal *goal,
                 noslip_workspace *workspace);

#ifdef __cplusplus
}
#endif

#endif
