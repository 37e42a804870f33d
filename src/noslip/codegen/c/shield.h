/* A stream of commands in, one that keeps constraints out, in C99: no heap, nothing but libm.
 *
 * SI units, radians, world frame; a pose is x, y, z, qw, qx, qy, qz.
 */
#ifndef NOSLIP_SHIELD_H
#define NOSLIP_SHIELD_H

#ifdef __cplusplus
extern "C" {
#endif

/* Rows of equalities and of limits; the larger of their sum and 1, for arrays. */
#define NOSLIP_SHIELD_EQUALITIES @EQUALITIES@
#define NOSLIP_SHIELD_LIMITS @LIMITS@
#define NOSLIP_SHIELD_ROWS @ROWS@
/* Between two calls of noslip_shield_step, s. */
#define NOSLIP_SHIELD_PERIOD @PERIOD@

/* Everything that a shield knows.  To be commanded: position, quaternion and the velocities. */
typedef struct noslip_shield {
@FIELDS@
} noslip_shield;

/* Begin at rest in a pose.  Returns 0; or 1, the state as it was, if that is none. */
int noslip_shield_start(noslip_shield *shield, const double *pose);

/* Go on by a period.  command: a pose, or null if none came: the last one stands.  measured: where the
 * tool was seen to be, or null; what is not finite is a sample that was lost.  Returns 0; or 1, the
 * state as it was, if the command is not finite, or what comes of it.
@BOUND@ */
int noslip_shield_step(noslip_shield *shield, const double *command, const double *measured);

/* How far the last command is away from the tool as it is commanded: m, rad. */
double noslip_shield_distance(const noslip_shield *shield);
double noslip_shield_angle(const noslip_shield *shield);

#ifdef __cplusplus
}
#endif

#endif
