/* One step of a movement primitive under constraints, in C99: no heap, nothing but libm.
 *
 * A primitive's parameters are data (noslip_primitive); the code depends on the constraints alone.
 * SI units, radians, world frame; quaternions are (w, x, y, z).
 */
#ifndef NOSLIP_H
#define NOSLIP_H

#ifdef __cplusplus
extern "C" {
#endif

/* double, unless compiled with -DNOSLIP_REAL=float. */
#ifndef NOSLIP_REAL
#define NOSLIP_REAL double
#endif
typedef NOSLIP_REAL noslip_real;

/* Rows of equalities and of limits; the larger of their sum and 1, for arrays. */
#define NOSLIP_EQUALITIES @EQUALITIES@
#define NOSLIP_LIMITS @LIMITS@
#define NOSLIP_ROWS @ROWS@

/* What keeps the rows of limits apart is smaller than single precision tells. */
typedef char noslip_limits_need_double
    [NOSLIP_LIMITS == 0 || sizeof(noslip_real) >= sizeof(double) ? 1 : -1];

/* Parameters of a primitive.  Rows of weights: x, y, z (m), then the rotation vector (rad). */
typedef struct noslip_primitive {
    int basis_functions;
    const noslip_real *centers;        /* in phase */
    const noslip_real *widths;         /* standard deviations, in phase */
    const noslip_real (*weights)[6];   /* over alpha beta: what they add to the goals */
    noslip_real alpha;
    noslip_real beta;
    noslip_real alpha_s;
    int knots;                                /* of the winding; 1: the goal is fixed */
    const noslip_real (*knot_quaternions)[4];
    const noslip_real (*knot_splines)[12];    /* of each interval: rotation vector, cubic first */
    noslip_real duration;          /* s */
    noslip_real residual_rate;     /* per duration */
    noslip_real barrier_rate;      /* per duration */
    noslip_real begin;             /* time at the start, s */
    noslip_real start_position[3];
    noslip_real start_quaternion[4];
    noslip_real start_linear_velocity[3];
    noslip_real start_angular_velocity[3];
    noslip_real goal_position[3];
    noslip_real goal_quaternion[4];
} noslip_primitive;

/* Everything that a primitive in motion knows.  May be written to between two steps: the pose and
 * the velocities where they were measured, goal and duration where they change.  After a step from
 * whatever state the tool does not slip; off a surface it is pulled in. */
typedef struct noslip_state {
    noslip_real time;              /* s */
    noslip_real fraction;          /* of the motion: 0 at the start, 1 at the end */
    noslip_real position[3];
    noslip_real quaternion[4];
    noslip_real linear_velocity[3];
    noslip_real angular_velocity[3];
    noslip_real previous_step;     /* s; 0 at the start */
    noslip_real duration;          /* s */
    noslip_real pull_in;           /* 1/s */
    noslip_real goal_position[3];
    noslip_real goal_quaternion[4];
    noslip_real steering[3];       /* turn of the orientation's target, rad */
    /* Of the last step. */
    noslip_real acceleration[6];   /* m/s^2 and rad/s^2 */
    noslip_real force[6];          /* the constraints' part of it */
    noslip_real values[NOSLIP_ROWS];       /* residuals, then margins */
    noslip_real multipliers[NOSLIP_ROWS];
    /* Forces that the next step of the same length needs again; not to be written to. */
    noslip_real known_fraction;
    noslip_real known_step;
    noslip_real known[2][6];
} noslip_state;

/* Put a state at the start of a primitive. */
void noslip_start(const noslip_primitive *primitive, noslip_state *state);

/* Carry a state over a step of some seconds.  Steps may differ in length.  Returns 0; or 1, the state
 * as it was, if the step is not positive or what comes of it is not finite (a measurement is not).
@BOUND@ */
int noslip_step(const noslip_primitive *primitive, noslip_state *state, noslip_real time_step);

/* Whether the motion has come to its end. */
int noslip_done(const noslip_state *state);

#ifdef __cplusplus
}
#endif

#endif
