/* Who pushes: exchanges, until nobody is left to be driven. */
static void noslip_push_@KIND@_@MOST@(const noslip_real **arg, noslip_real **res, noslip_real *w) {
    noslip_real states[2][@STATE@], *state = states[0], *next = states[1], *spare, wanted;
    const noslip_real *given[@ARGUMENTS@];
    noslip_real *found[@RESULTS@];
    int i, exchange;
    for (i = 0; i < 7; ++i) given[i] = arg[i];
    found[0] = state;
    found[1] = &wanted;
    noslip_begin_@KIND@(given, found, w);
    for (exchange = 0; exchange < @MOST@ && wanted > 0; ++exchange) {
        given[5] = state;
        found[0] = next;
        noslip_exchange_@KIND@(given, found, w);
        spare = state;
        state = next;
        next = spare;
    }
    given[2] = arg[4];
    given[3] = state;
    for (i = 0; i < 3; ++i) found[i] = res[i];
    noslip_finish(given, found, w);
}

