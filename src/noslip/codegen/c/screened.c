/* Where no limit stops what the equalities alone allow, that is the step. */
static void noslip_core(const noslip_real *state, const noslip_real *step, noslip_real *after,
                        noslip_real *output) {
    const noslip_real *arg[@ARGUMENTS@] = {state, step};
    noslip_real *res[@RESULTS@] = {after, output}, w[@WORK@], suffices;
    res[2] = &suffices;
    noslip_short(arg, res, w);
    if (!(suffices > 0)) noslip_whole(arg, res, w);
}
