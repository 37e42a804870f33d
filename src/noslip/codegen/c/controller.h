/* A primitive in a control loop: its command is its own; measurements steer its clock and its plans.
 *
 * What noslip.Controller is in Python, the planner included, to rounding.  One struct, no heap; double
 * precision.  A cycle:
 *
 *     noslip_controller_step(&c, seconds, measured, goal_position, goal_quaternion);
 *     command(c.state.position, c.state.quaternion, c.twist);
 *
 * Plans are made a few units of work a cycle while the one before is followed (see replan.h for what a
 * unit takes); a cycle that plans nothing takes a step and, if something was measured, the observer's
 * update.
 */
#ifndef NOSLIP_CONTROLLER_H
#define NOSLIP_CONTROLLER_H

#include "noslip.h"
#include "replan.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of the primitive, and of plans at most: knots, and steps of their fits.  Define them alike for all
 * files that include this one, where others are wanted. */
#ifndef NOSLIP_CONTROLLER_FUNCTIONS
#define NOSLIP_CONTROLLER_FUNCTIONS @FUNCTIONS@
#endif
#ifndef NOSLIP_CONTROLLER_KNOTS
#define NOSLIP_CONTROLLER_KNOTS @KNOTS@
#endif
#ifndef NOSLIP_CONTROLLER_STEPS
#define NOSLIP_CONTROLLER_STEPS @STEPS@
#endif
#define NOSLIP_CONTROLLER_CELLS @CELLS@
#define NOSLIP_CONTROLLER_SEEN @SEEN@

typedef enum noslip_mode {
    NOSLIP_MODE_TRACK,           /* follows its plan */
    NOSLIP_MODE_YIELD,           /* a hand holds the tool aside, and is followed */
    NOSLIP_MODE_HOLD,            /* after the end */
    NOSLIP_MODE_FAULT            /* a step failed: the command stands */
} noslip_mode;

/* Why it does not just go on. */
typedef enum noslip_reason {
    NOSLIP_REASON_NONE,
    NOSLIP_REASON_FAULT,         /* what comes of a step is not finite */
    NOSLIP_REASON_BLOCKED,       /* the tool stays off by more than a bias may be */
    NOSLIP_REASON_SILENT,        /* nothing was measured for too long */
    NOSLIP_REASON_HELD,          /* the tool is held aside */
    NOSLIP_REASON_NO_PLAN,       /* it was, and no plan leads on; see the outcome */
    NOSLIP_REASON_PAUSED,
    NOSLIP_REASON_WAITS          /* the tool is off, and waited for */
} noslip_reason;

/* Why there is a new plan. */
typedef enum noslip_cause { NOSLIP_CAUSE_NONE, NOSLIP_CAUSE_PUSH, NOSLIP_CAUSE_GOAL } noslip_cause;

/* Besides those of a plan, outcomes: the goal is so far away that none is sought; every one found bends
 * too sharply for the speed. */
#define NOSLIP_CONTROLLER_TOO_FAR (NOSLIP_REPLAN_WRONG + 1)
#define NOSLIP_CONTROLLER_TOO_SHARP (NOSLIP_REPLAN_WRONG + 2)

/* What a plan allows its clock, at even places of its duration: the largest squared speed of the clock
 * and change of that speed (1/s); what is left, s and m; its own motion. */
typedef struct noslip_schedule {
    double caps[NOSLIP_CONTROLLER_CELLS + 1], ramps[NOSLIP_CONTROLLER_CELLS + 1];
    double left[NOSLIP_CONTROLLER_CELLS + 1], way[NOSLIP_CONTROLLER_CELLS + 1];
    double positions[NOSLIP_CONTROLLER_CELLS + 1][3];
    double velocities[NOSLIP_CONTROLLER_CELLS + 1][6];
    double duration;
    int begins_at_speed, is_free;
} noslip_schedule;

/* Where a goal is, and whither it goes. */
typedef struct noslip_goal_filter {
    double goal[3], rate[3], last[3], recent[3][3];
    double jump, slow, noise, deviation, rate_deviation, time, since, far;
    int samples, recents, is_told;
} noslip_goal_filter;

typedef struct noslip_controller {
    /* Settings: noslip_controller_init sets the usual ones; others before noslip_controller_start. */
    const noslip_primitive *primitive;
    double time_step;            /* of the loop, s */
    int follows;                 /* the robot is compliant, and a hand that holds its tool is followed */
    int replans;                 /* whether new plans are made */
    int real_time;               /* a plan that comes too late is made anew from farther ahead; else
                                  * the cycle in which it is due does what is left of it */
    int units;                   /* of a plan's work in a cycle; 0: so many that it comes in time */
    double lag;                  /* of the robot, s; less than 0: it is estimated, up to 0.2 s */
    double tolerance;            /* between command and tool, over the path's length */
    double angle_tolerance;      /* rad */
    double bias;                 /* what may stand between them for ever, over the path's length */
    double faster;               /* times the peaks of its own motion; INFINITY: as fast as it is */
    double plan_within;          /* s */
    double braking;              /* s, after an end at speed */
    int knots;                   /* of plans, NOSLIP_CONTROLLER_KNOTS at most */

    /* What it tells. */
    noslip_state state;          /* the command's pose; its velocities are the plan's */
    double twist[6];             /* commanded, m/s and rad/s: speed times the plan's */
    double speed;                /* of the clock, 0 to 1 */
    noslip_mode mode;
    int blocked;
    int plans, failures;         /* made so far, and not found */
    noslip_cause cause;          /* of the last one */
    int outcome;                 /* of the last one, as noslip_replan returns it */

    /* Not to be written to. */
    const noslip_primitive *plan;
    int schedule, spare, silent, stage, slowed, failed_in_row, pending, work;
    noslip_cause pending_cause;
    int ahead_steps, rolled, resting, task_outcome, units_now;
    double duration, plan_duration, length, mean_speed, time, next_plan, next_look, wanted_speed, ramp;
    double goal_since, hand_over, due, ahead, arrive, aside, rest, rest_at[3], since;
    double bounds[4], target[7], goal_quaternion[4], step_ahead;
    double seen[NOSLIP_CONTROLLER_SEEN];
    noslip_goal_filter goal, goal_turn;
    noslip_goal to;
    noslip_state there, begun, rolling;
    double held[7];
    noslip_schedule schedules[2];
    noslip_workspace workspaces[2];
    double memory[2][NOSLIP_REPLAN_MEMORY(NOSLIP_CONTROLLER_KNOTS, NOSLIP_CONTROLLER_STEPS,
                                          NOSLIP_CONTROLLER_FUNCTIONS)];
} noslip_controller;

/* Set everything to what is usual. */
void noslip_controller_init(noslip_controller *controller, const noslip_primitive *primitive,
                            double time_step);

/* Begin, from a state of the primitive or (null) from its start; takes two of its motions.  Returns 0; or
 * 1 if a setting is not what it must be, or the motion is not finite. */
int noslip_controller_start(noslip_controller *controller, const noslip_state *from);

/* A cycle.  Returns 0; or 1, everything as it was, if the seconds are not positive or the goal is not
 * finite, or a million path lengths away.  Whatever else goes wrong does not end the loop: see mode and noslip_controller_reason.
 *
 * elapsed: since the last one, s.  measured: the pose that was measured since (position, quaternion), or
 * null; what is not finite, or as far away, is a sample that was lost.  goal_position, goal_quaternion: as seen now, or
 * null. */
int noslip_controller_step(noslip_controller *controller, double elapsed, const double *measured,
                           const double *goal_position, const double *goal_quaternion);

/* Come to a halt on the path, and go on, within some seconds; less than 0: as fast as accelerations are
 * bounded. */
void noslip_controller_pause(noslip_controller *controller, double within);
void noslip_controller_resume(noslip_controller *controller, double within);

/* Whether the command has come to its end, and the tool, where it is measured, too. */
int noslip_controller_done(const noslip_controller *controller);

noslip_reason noslip_controller_reason(const noslip_controller *controller);

/* What the robot makes of a command: returns its lag (s); where it stands besides (m). */
double noslip_controller_lag_and_bias(const noslip_controller *controller, double bias[3]);

#ifdef __cplusplus
}
#endif

#endif
