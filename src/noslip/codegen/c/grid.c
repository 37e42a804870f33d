/* Of a grid's spline about a place: the place, value, slopes and curvatures. */
extern const float noslip_@NAME@[];

static void noslip_look_up_@NAME@(const noslip_real *at, noslip_real *found) {
    noslip_real numbers[@NEAR@], values[@NEAR@], u[@AXES@];
    int i;
    noslip_places_in_@NAME@(at, numbers, u);
    for (i = 0; i < @NEAR@; ++i) values[i] = noslip_@NAME@[(int)numbers[i]];
    noslip_spline_@AXES@(values, u, found + @AXES@);
    for (i = 0; i < @AXES@; ++i) found[i] = at[i];
}
