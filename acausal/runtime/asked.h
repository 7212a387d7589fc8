/* States and directions at times that are asked for, which ascend. Where steps have some of them inside, directions are refined there on the nodes of dense output, as
   states are (see dense.h), and brought onto the invariants. Where a step cannot tell, since it is implicit or beside a singular position, and where refining is
   dearer than one step more, it ends at the next of these times; so do all steps where modes change. */

#define WORTH_REFINING 2 /* times inside of a step: so many make refining cheaper */

static double at_once(const Integrator *I);

/* The next time that is asked for; infinite where there is none. */
static double next_asked(const Integrator *I) { return I->given < I->asked ? I->asked_t[I->given] : INFINITY; }

/* Room for what is inside of steps. 0 when memory is short. */
static int make_asked(Integrator *I) {
    struct State *T = I->state;
    if (!I->asked || !I->fine) return 1;
    if (!fine_stages(I, I->fine)) return 0;
    long s = I->fine->stages;
    T->D_inside = reserve_lanes(I, s * I->nx);
    T->D_series = reserve_lanes(I, s * I->nx);
    T->D_there = reserve_lanes(I, I->nx);
    return T->D_inside && T->D_series && T->D_there;
}

/* Of one block, directions D (nx) at the time with that number. */
static void give_block(Integrator *I, long number, long block, const V *D) {
    for (long l = 0; l < LANES && block * LANES + l < I->directions; l++) {
        long d = block * LANES + l;
        double *S = I->asked_S + (number * I->directions + d) * I->nx;
        for (long i = 0; i < I->nx; i++) S[i] = D[i][l];
    }
}

static void give_discrete(Integrator *I, long number) {
    if (I->discretes) memcpy(I->asked_discrete + number * I->directions * I->discretes, I->state->discrete_change, sizeof(double) * (size_t)(I->directions * I->discretes));
}

/* What is asked for until a time, as it is where the motion has come to. */
static void give_until(Integrator *I, double time) {
    struct State *T = I->state;
    for (; next_asked(I) <= time; I->given++) {
        memcpy(I->asked_x + I->given * I->nx, I->x, sizeof(double) * (size_t)I->nx);
        for (long b = 0; b < direction_blocks(I); b++) give_block(I, I->given, b, T->D + b * I->nx);
        give_discrete(I, I->given);
    }
}

/* Whether no step tells of what is inside, as far as it is known before it. */
static int ends_at_asked(const Integrator *I) { return I->step > 0 || I->state->newton_now || I->method_list[I->method].kind == RADAU; }

/* Whether one that has been solved does. */
static int tells_inside(const Integrator *I, const Stages *S) { return I->fine && !ends_at_asked(I) && S->s > 2 && !S->around && !S->exact && I->state->part == 0; }

/* Directions of a block at so many times that are asked for, from a step that begins with them and has been refined on F. Returns 0 where they do not converge. */
static int give_inside(Integrator *I, const Stages *S, Stages *F, double h, long block, long count) {
    struct State *T = I->state;
    long n = I->nx, s = S->s;
    V *a = T->D_series, *K = T->D_inside, *D = T->D + block * n;
    double P[65], Q[64];
    coefficients_of_variation(S, n, T->D_rates + block * s * n, a);
    for (long j = 0; j < F->s; j++) {
        legendre_values(F->method->c[j], s, P);
        weigh(P, a, s, n, K + j * n);
    }
    if (!solve_variation(I, F, h, block, K)) return 0;
    coefficients_of_variation(F, n, K, a);
    for (long m = I->given; m < I->given + count; m++) {
        legendre_integrals((I->asked_t[m] - I->t) / h, F->s, P, Q);
        weigh(Q, a, F->s, n, T->D_there);
        for (long i = 0; i < n; i++) T->D_there[i] = v_fma(v_all(h), T->D_there[i], D[i]);
        if (I->ng) project_block(I, I->asked_t[m], I->asked_x + m * n, block, T->D_there);
        give_block(I, m, block, T->D_there);
    }
    return 1;
}

/* Gives what is asked for inside of a step of size h that has been solved and not yet made. 0 where it does not tell, -1 when the input function failed. */
static int tell_inside(Integrator *I, const Stages *S, double h) {
    struct State *T = I->state;
    long count = 0, n = I->nx;
    double end = I->t + h - at_once(I);
    while (I->given + count < I->asked && I->asked_t[I->given + count] < end) count++;
    if (!count) return 1;
    if (count < WORTH_REFINING || !tells_inside(I, S)) return 0;
    Stages *F = T->fine;
    double part = T->part, reach = T->reach;
    Inside step = {I->t, h, I->x, S->a, S->s, S->blocks * LANES, T->size, T->side};
    int refined = refine(I, F, &step), told = refined && !F->around && !F->exact;
    T->part = part;
    set_scale(I, h, reach);
    set_factor(I, h);
    if (!refined) return -1;
    for (long m = I->given; m < I->given + count && told; m++) {
        double *x = I->asked_x + m * n;
        state_within(n, I->x, F->a, F->s, F->blocks * LANES, (I->asked_t[m] - I->t) / h, h, x);
        project(I, I->asked_t[m], x);
        give_discrete(I, m);
    }
    for (long b = 0; b < direction_blocks(I) && told; b++) told = give_inside(I, S, F, h, b, count);
    if (told) I->given += count;
    return told;
}
