
/* What Python runs: the command moved from one pose to another, within so many seconds; or the other was
 * measured while the one was commanded, and the number says whether anything may be learned from it. */
void noslip_observe(double *seen, const double *one, const double *other, double number, int has_moved) {
    double given[15], found[SIZE];
    int i;
    for (i = 0; i < 7; ++i) {
        given[i] = one[i];
        given[7 + i] = other[i];
    }
    given[14] = number;
    if (has_moved) {
        noslip_moved(seen, given, found);
    } else {
        noslip_measured(seen, given, found);
    }
    for (i = 0; i < SIZE; ++i) seen[i] = found[i];
}
