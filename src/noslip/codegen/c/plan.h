/* A trajectory projection in C99: no heap, nothing but libm; double precision.
 *
 * The nearest trajectory that satisfies constraints, by Newton steps on the optimality conditions,
 * whose matrix is banded; limits by a primal-dual interior point.  Everything stands in arrays of the
 * caller.  SI units, radians, world frame; quaternions are (w, x, y, z).
 */
#ifndef NOSLIP_PLAN_H
#define NOSLIP_PLAN_H

#ifdef __cplusplus
extern "C" {
#endif

/* What moves: coordinates and rotations of a knot, a pose having three and one. */
#define NOSLIP_PLAN_LINEAR @LINEAR@
#define NOSLIP_PLAN_ROTATIONS @ROTATIONS@
#define NOSLIP_PLAN_VELOCITY (NOSLIP_PLAN_LINEAR + 3 * NOSLIP_PLAN_ROTATIONS)
/* Rows of equalities, then of limits; unknowns of a knot: rotation vectors, displacements over length;
 * the first of them cost what turns do. */
#define NOSLIP_PLAN_EQUALITIES @EQUALITIES@
#define NOSLIP_PLAN_LIMITS @LIMITS@
#define NOSLIP_PLAN_ROWS (NOSLIP_PLAN_EQUALITIES + NOSLIP_PLAN_LIMITS)
#define NOSLIP_PLAN_UNKNOWNS @UNKNOWNS@
#define NOSLIP_PLAN_TURNS @TURNS@
#define NOSLIP_PLAN_STAGE (NOSLIP_PLAN_UNKNOWNS + NOSLIP_PLAN_ROWS)
/* Diagonals of the matrix below its main one. */
#define NOSLIP_PLAN_WIDTH (2 * NOSLIP_PLAN_STAGE + @REACH@)

/* Numbers (double) that the workspace has for so many knots. */
#define NOSLIP_PLAN_WORKSPACE(knots) \
    (((knots) * NOSLIP_PLAN_STAGE + NOSLIP_PLAN_WIDTH + 1) * (NOSLIP_PLAN_WIDTH + 3))

/* A projection.  Arrays have a row a knot; those of knots + 2 rows begin with the row before the first
 * knot, and end with the one after the last. */
typedef struct noslip_plan {
    /* The reference. */
    const double *positions;      /* [knots + 2][LINEAR] */
    const double *quaternions;    /* [knots + 2][ROTATIONS][4], each near the next, not near its opposite */
    /* What a turn costs, and what its change costs from each knot to the next. */
    const double *turn_weights;   /* [knots] */
    const double *turn_slopes;    /* [knots - 1] */
    /* What a correction costs besides, as a quadratic form, and its slope where there is none; null:
     * nothing. */
    const double *metric;         /* [knots][UNKNOWNS][UNKNOWNS] */
    const double *pull;           /* [knots][UNKNOWNS] */
    /* Unknowns that stay as they are, and rows that are asked for. */
    const unsigned char *fixed;   /* [knots][UNKNOWNS] */
    const unsigned char *active;  /* [knots][ROWS] */
    /* What limits are kept away from, in their own units; null: nothing. */
    const double *clearance;      /* [knots][ROWS] */
    /* What makes a row's residual a number of order 1, and which of these is as good as none. */
    const double *row_scale;      /* [ROWS] */
    const double *tolerance;      /* [ROWS] */
    /* The correction, the rows' multipliers and the limits' slacks. */
    double *z;                    /* [knots + 2][UNKNOWNS] */
    double *multipliers;          /* [knots][ROWS] */
    double *slack;                /* [knots][ROWS]; null without limits */
    double *workspace;            /* [NOSLIP_PLAN_WORKSPACE(knots)] */
    /* Twists asked for at the start and at the end, then the reference's own there; null: none. */
    const double *twists[2];      /* [2][VELOCITY] */
    double bending[2];            /* what bending the turn costs, and the displacement */
    double time_step, length, begin;      /* s, m, s */
    double position_weight;               /* what the displacement costs */
    double barrier, last_barrier;         /* of the limits: product of multiplier and slack */
    double step_size, residual;           /* of the last step; over the tolerance */
    int knots;
    int careful;                          /* converges from farther, and more slowly */
    int iteration, stuck;                 /* steps so far; short ones in a row */
} noslip_plan;

/* What becomes of it. */
enum {
    NOSLIP_PLAN_GOING_ON,   /* call again: it goes on where it stopped */
    NOSLIP_PLAN_CONVERGED,
    NOSLIP_PLAN_NEARLY,     /* feasible and all but still: it may be used, or gone on with */
    NOSLIP_PLAN_LOST,       /* not finite, or limits let it go no farther */
    NOSLIP_PLAN_UNRELIABLE  /* the matrix needs pivoting; nothing was changed */
};

/* Begin from the correction in z. */
void noslip_plan_begin(noslip_plan *plan, double barrier);

/* Do so many Newton steps or fewer. */
int noslip_plan_iterate(noslip_plan *plan, int steps);

/* Residuals of all rows at all knots, in their own units. */
void noslip_plan_values(const noslip_plan *plan, double *values);

#ifdef __cplusplus
}
#endif

#endif
