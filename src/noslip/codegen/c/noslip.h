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

/* What moves: coordinates, and rotations as unit quaternions. */
#define NOSLIP_LINEAR @LINEAR@
#define NOSLIP_ROTATIONS @ROTATIONS@

/* Rows of equalities and of limits; the larger of their sum and 1, for arrays. */
#define NOSLIP_EQUALITIES @EQUALITIES@
#define NOSLIP_LIMITS @LIMITS@
#define NOSLIP_ROWS @ROWS@

/* What keeps the rows of limits apart is smaller than single precision tells. */
typedef char noslip_limits_need_double
    [NOSLIP_LIMITS == 0 || sizeof(noslip_real) >= sizeof(double) ? 1 : -1];

/* Parameters of a primitive.  @WEIGHTS@ */
typedef struct noslip_primitive {
@PRIMITIVE@
} noslip_primitive;

/* Everything that a primitive in motion knows.  May be written to between two steps: the pose and
 * the velocities where they were measured, goal and duration where they change.  After a step from
 * whatever state the tool does not slip; off a surface it is pulled in. */
typedef struct noslip_state {
@STATE@
} noslip_state;

/* Put a state at the start of a primitive. */
void noslip_start(const noslip_primitive *primitive, noslip_state *state);

/* Carry a state over a step of some seconds.  Steps may differ in length; the last one ends where the
 * motion does, and after it the pose is held (see braking).  One longer than a tenth of the duration
 * is made good in steps as long as those of its own motion.  Returns 0; or 1, the state as it was, if the
 * step is not positive, or longer than a hundred durations, or what comes of it is not finite (a
 * measurement is not).
@BOUND@ */
int noslip_step(const noslip_primitive *primitive, noslip_state *state, noslip_real time_step);

/* What goes with the motion and follows its phase, such as a gripper or a wrench, at a state: so many
 * numbers as the primitive has channels; which they are stands beside it.  Returns 0; or 1, the values
 * as they were, if the state's fraction is not finite. */
int noslip_channels(const noslip_primitive *primitive, const noslip_state *state, noslip_real *values);

/* Whether the motion has come to its end. */
int noslip_done(const noslip_state *state);

#ifdef __cplusplus
}
#endif

#endif
