/* Back onto the invariants after a step: Hairer and Wanner, Solving ODEs II, section VII.2. */

/* Inputs at t and these masks where the kernel of the projection has them. 0 when the input function failed. */
static int give_to_projection(Integrator *I, double t, const double *masks) {
    V *u = I->state->projection_in + 1 + I->nx;
    give_sides(I, masks, I->masks, u + I->nu - I->held);
    return led_by(I, v_all(t), 1, u);
}

#define TORN 1e-6 /* of the largest states so far: corrections that do not shrink below, where inputs lead apart what is to be closed */

/* Corrects x until the corrections, in units of the largest states so far, stop shrinking; ten times at most. Returns whether x was
   changed. */
static int project(Integrator *I, double t, double *x) {
    struct State *T = I->state;
    T->open = 0;
    if (!I->ng || is_crossing(I, t, x) || is_still(I)) return 0;
    int exact = has_exact(I) && !I->masks && clearance_at(I, t, x) < EXACT;
    V *in = T->projection_in, *out = T->projection_out;
    double last = INFINITY;
    int changed = 0;
    if (!give_to_projection(I, t, T->side)) return 0; /* whoever needs rates next finds that, too */
    for (int k = 0; k < 10; k++) {
        in[0] = v_all(t);
        for (long i = 0; i < I->nx; i++) in[1 + i] = v_all(x[i]);
        if (exact) run_exact(I, 1, in, out);
        else run_masked(I, OF_PROJECTION, in, T->projection_c, out);
        double largest = 0;
        for (long i = 0; i < I->nx; i++) {
            double here = fabs(out[i][0] - x[i]), size = fmax(T->size[i], fabs(x[i]));
            if (here > 0 && !(here <= largest * size)) largest = here / size;
        }
        if (!(largest < INFINITY) || largest <= 2 * EPS) {
            T->open = largest < INFINITY ? 0 : INFINITY;
            break;
        }
        /* moving positions may open the velocity rows at first; the second correction closes them */
        T->open = largest;
        if (k > 1 && !(largest < 0.5 * last)) break;
        for (long i = 0; i < I->nx; i++) x[i] = out[i][0];
        changed = 1;
        last = largest;
    }
    return changed;
}

#define PLAINLY 1e3 /* times rounding, a correction that is none of it */

/* Whether what is left to correct of places at time t is more than rounding: something is torn. */
static int is_torn(Integrator *I, double t, const double *x) {
    struct State *T = I->state;
    V *in = T->projection_in, *out = T->projection_out;
    const Kernel *disturbed = T->open > TORN ? disturbed_kernel(I, 2) : 0;
    double *size = T->before, *noise = T->most;
    if (!disturbed) return 0;
    in[0] = v_all(t);
    for (long i = 0; i < I->nx; i++) in[1 + i] = v_all(x[i]), size[i] = fmax(T->size[i], fabs(x[i]));
    run_masked(I, OF_PROJECTION, in, T->projection_c, out);
    Pair *paired = (Pair *)(void *)T->pair_in;
    for (long i = 1 + I->nx; i < disturbed->inputs; i++) paired[i] = same_pair(in[i]);
    disturb(I, disturbed, t, x, size, ENLARGED, noise);
    for (long i = 0; i < I->positions; i++)
        if (!(fabs(out[i][0] - x[i]) <= fmax(TORN * size[i], PLAINLY * noise[i]))) return 1;
    return 0;
}

#define PASSES 3 /* moving positions opens the velocity rows a little; the next correction closes them */

#ifndef ONLY_COMPILED_KERNELS
/* The same for n states (n, nx) at times t with inputs u (n, nu), side by side in lanes, so many corrections; states that come out not finite stay as
   they are. */
int project_states(const Kernel *k, long nx, long nu, long np, const double *p, long n, const double *t, const double *u, double *x) {
    size_t values = (size_t)(k->inputs + k->outputs + k->constants + k->work + 4);
    char *raw = malloc(sizeof(V) * values + 64);
    if (!raw) return OUT_OF_MEMORY;
    V *in = (V *)(raw + (64 - (size_t)raw % 64)), *out = in + k->inputs + 1, *c = out + k->outputs + 1, *w = c + k->constants + 1;
    for (long i = 0; i < np; i++) in[1 + nx + nu + i] = v_all(p[i]);
    prepare_kernel(k, in, c, w);
    for (long first = 0; first < n; first += LANES) {
        for (long l = 0; l < LANES; l++) {
            long at = first + l < n ? first + l : n - 1;
            in[0][l] = t[at];
            for (long i = 0; i < nx; i++) in[1 + i][l] = x[at * nx + i];
            for (long i = 0; i < nu; i++) in[1 + nx + i][l] = u[at * nu + i];
        }
        for (int pass = 0; pass < PASSES; pass++) {
            run_kernel(k, in, c, out, w);
            for (long i = 0; i < nx; i++) in[1 + i] = out[i];
        }
        for (long l = 0; l < LANES && first + l < n; l++) {
            int good = 1;
            for (long i = 0; i < nx; i++) good &= isfinite(out[i][l]);
            for (long i = 0; i < nx && good; i++) x[(first + l) * nx + i] = out[i][l];
        }
    }
    free(raw);
    return REACHED_END;
}
#endif
