/* Where no limit stops what the equalities alone allow, that is the step. */
static void noslip_core(const noslip_real *state, const noslip_real *step, noslip_real *after,
                        noslip_real *output) {
    noslip_real suffices;
    noslip_short(state, step, after, output, &suffices);
    if (!(suffices > 0)) noslip_whole(state, step, after, output);
}
