/* Back onto the invariants after a step: Hairer and Wanner, Solving ODEs II, section VII.2. */

static double largest_gap(Integrator *I, const V *out) {
    double gap = 0;
    for (long i = 0; i < I->ng; i++) {
        double here = fabs(out[I->nx + i][0]);
        if (!(here <= gap)) gap = here;
    }
    return gap;
}

/* Corrects x until the invariants stop shrinking, ten times at most. Returns whether x was changed. */
static int project(Integrator *I, double t, double *x) {
    if (!I->ng) return 0;
    struct State *T = I->state;
    V *in = T->projection_in, *out = T->projection_out;
    in[0] = v_all(t);
    double gap = 0;
    int changed = 0;
    for (int k = 0; k <= 10; k++) {
        for (long i = 0; i < I->nx; i++) in[1 + i] = v_all(changed ? T->before[i] : x[i]);
        I->projection.run(in, T->projection_c, out, T->work);
        double here = largest_gap(I, out);
        /* moving positions may open the velocity rows at first; the second correction closes them */
        if (k && (!(here < INFINITY) || (k > 2 && !(here < gap)))) break;
        if (k)
            for (long i = 0; i < I->nx; i++) x[i] = T->before[i];
        gap = here;
        if (gap <= 2 * EPS) break;
        changed = 1;
        for (long i = 0; i < I->nx; i++) T->before[i] = out[i][0];
    }
    return changed;
}
