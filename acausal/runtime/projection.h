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

/* The same for n states (n, nx) at times t, side by side in lanes, three corrections; states that come out not finite stay as they are. */
int project_states(const Kernel *k, long nx, long np, const double *p, long n, const double *t, double *x) {
    size_t values = (size_t)(k->inputs + k->outputs + k->constants + k->work + 4);
    char *raw = malloc(sizeof(V) * values + 64);
    if (!raw) return OUT_OF_MEMORY;
    V *in = (V *)(raw + (64 - (size_t)raw % 64)), *out = in + k->inputs + 1, *c = out + k->outputs + 1, *w = c + k->constants + 1;
    for (long i = 0; i < np; i++) in[1 + nx + i] = v_all(p[i]);
    k->prepare(in, c, c, w);
    for (long m = 0; m < n; m += LANES) {
        for (long l = 0; l < LANES; l++) {
            long at = m + l < n ? m + l : n - 1;
            in[0][l] = t[at];
            for (long i = 0; i < nx; i++) in[1 + i][l] = x[at * nx + i];
        }
        for (int pass = 0; pass < 3; pass++) { /* moving q opens the velocity rows a little; the next pass closes them */
            k->run(in, c, out, w);
            for (long i = 0; i < nx; i++) in[1 + i] = out[i];
        }
        for (long l = 0; l < LANES && m + l < n; l++) {
            int good = 1;
            for (long i = 0; i < nx; i++) good &= isfinite(out[i][l]);
            for (long i = 0; i < nx && good; i++) x[(m + l) * nx + i] = out[i][l];
        }
    }
    free(raw);
    return REACHED_END;
}
