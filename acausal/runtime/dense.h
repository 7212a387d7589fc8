/* Dense output. A Gauss step of s stages is accurate to order 2 s at its end but only s + 1 inside. Fixed-point iteration on more
   nodes, started from the collocation polynomial, brings the inside up to the end's accuracy. */

#define ASIDE 4.0 /* neighbouring numbers to either side of a knot that belong to no step: rounding decides there which side they are on, also where times are shaken by it */

/* So far from a knot steps end before it, and begin after it. */
static double aside(const Integrator *I, double knot) { return ASIDE * EPS * fmax(fabs(knot), fabs(I->state->start)); }

/* The step, of those that are kept, that a time lies in. */
static long step_of(const Integrator *I, double t) {
    long low = I->first, high = I->steps - 1;
    while (low < high) {
        long middle = (low + high + 1) / 2;
        if (I->times[middle - I->first] <= t) low = middle;
        else high = middle - 1;
    }
    return low;
}

/* Whether the last iteration changed the rates by no more than those before it did all together: otherwise it only carried rounding on, and the polynomial was right. */
static int has_settled(const Integrator *I, const Stages *F) {
    double last = 0, before = 0;
    if (F->around) return 1;
    for (long b = 0; b < F->blocks; b++)
        for (long i = 0; i < I->nx; i++) {
            V factor = v_all(I->state->factor[i]);
            last = fmax(last, v_largest(v_abs((F->K[b][i] - F->N[b][i]) * factor)));
            before = fmax(before, v_largest(v_abs((F->N[b][i] - F->saved[b][i]) * factor)));
        }
    return last <= before;
}

/* What is refined: a step of size h from x at t, Legendre coefficients a (nx, width) of its rates, of which s count, sizes that states have had by its end, and sides of switches. */
typedef struct {
    double t, h;
    const double *x, *a;
    long s, width;
    double *size, *side;
} Inside;

#define ASTRAY_AT_END 10 /* errors of a step */

/* Whether refined rates lead to where the step has ended, which they are to make no better: what decays too fast for the iteration, as directions of slips do, may lead it to anything. */
static int ends_there(const Integrator *I, const Stages *F, const Inside *step) {
    double most = 0;
    for (long i = 0; i < I->nx; i++) {
        V parts[BLOCKS];
        for (long b = 0; b < F->blocks; b++) parts[b] = F->b[b] * F->counted[b] * F->K[b][i];
        most = fmax(most, fabs(sum_of_blocks(parts, F->blocks) - step->a[i * step->width]) * I->state->factor[i]);
    }
    return most <= ASTRAY_AT_END;
}

/* Legendre coefficients (nx, blocks * LANES of `fine`) of the refined rates of a step. Returns 0 when the input function failed. */
static int refine(Integrator *I, Stages *F, const Inside *step) {
    struct State *T = I->state;
    double t = step->t, h = step->h, P[64];
    const double *x = step->x, *a = step->a;
    long s = step->s;
    double *held = T->side;
    T->side = step->side;
    int given = stage_times(I, F, t, h);
    T->side = held;
    if (!given) return 0;
    for (long j = 0; j < F->blocks * LANES; j++) {
        legendre_values(F->method->c[j < F->s ? j : F->s - 1], s, P);
        for (long i = 0; i < I->nx; i++) {
            double sum = 0;
            for (long q = s - 1; q >= 0; q--) sum += P[q] * a[i * step->width + q];
            F->K[j / LANES][i][j % LANES] = sum;
        }
    }
    int newton = T->newton_now, noisy = T->noisy, unheard = T->unheard;
    double *met = T->size, work = I->work;
    memcpy(T->aside, T->noise, sizeof(double) * (size_t)I->nx);
    memcpy(T->apart, T->spread, sizeof(double) * (size_t)I->nx);
    T->size = step->size;
    T->newton_now = 0;
    forget_noise(I);
    T->noisy = 0;
    set_scale(I, h, h);
    set_factor(I, h);
    for (long b = 0; b < F->blocks; b++) memcpy(F->saved[b], F->K[b], sizeof(V) * (size_t)I->nx);
    forget_surroundings(I, F);
    Judge J = new_judge(I->step > 0 ? 0.0 : 0.01, 4 * EPS / T->unit, 30);
    int done = fixed_point(I, F, h, x, &J) && ends_there(I, F, step);
    for (int again = 0; again < 2 && !done; again++) {
        for (long b = 0; b < F->blocks; b++) memcpy(F->K[b], F->saved[b], sizeof(V) * (size_t)I->nx);
        if (again) break;
        states_by_rates(I, F, x); /* rounding is that of the motion, not of where the iteration went */
        sample_noise(I, F, 0, 0);
        set_scale(I, h, h);
        set_factor(I, h);
        J = new_judge(J.tolerance, J.floor, J.limit);
        F->looked = 0;
        done = fixed_point(I, F, h, x, &J) && ends_there(I, F, step) && has_settled(I, F);
    }
    T->newton_now = newton;
    T->noisy = noisy;
    T->unheard = unheard;
    T->size = met;
    I->work = work;
    memcpy(T->noise, T->aside, sizeof(double) * (size_t)I->nx);
    memcpy(T->spread, T->apart, sizeof(double) * (size_t)I->nx);
    legendre_coefficients(I, F, F->K);
    return 1;
}

/* The same of step k: the same whenever it is asked for, and the steps that come after it do not see it. */
static int refine_step(Integrator *I, Stages *F, long k) {
    k -= I->first;
    long s = I->stage_count[k];
    double *a = I->coefficients + I->offset[k];
    Inside step = {I->times[k], I->times[k + 1] - I->times[k], I->states + k * I->nx, a, s, s, a + s * I->nx, I->held ? I->step_sides + k * I->held : I->state->side};
    return refine(I, F, &step);
}

static int fine_stages(Integrator *I, const Method *fine) {
    struct State *T = I->state;
    if (T->fine) return 1;
    if (!make_stages(I, &T->refining, fine)) return 0;
    T->fine = &T->refining;
    return 1;
}

/* x (nx) on a step of size h from `start`, with Legendre coefficients a (nx, width) of the rates, of which s count. */
static void state_within(long nx, const double *start, const double *a, long s, long width, double theta, double h, double *x) {
    double P[65], Q[64];
    legendre_integrals(theta, s, P, Q);
    for (long i = 0; i < nx; i++) {
        double sum = 0;
        for (long q = s - 1; q >= 0; q--) sum += Q[q] * a[i * width + q];
        x[i] = start[i] + h * sum;
    }
}

/* The same at `count` places, at most LANES, side by side: x (count, nx). */
static void states_within(long nx, const double *start, const double *a, long s, long width, const double *theta, long count, double h, double *x) {
    double P[65], Q[64];
    V integrals[64];
    for (long l = 0; l < LANES; l++) {
        legendre_integrals(theta[l < count ? l : count - 1], s, P, Q);
        for (long q = 0; q < s; q++) integrals[q][l] = Q[q];
    }
    for (long i = 0; i < nx; i++) {
        V sum = v_all(0.0);
        for (long q = s - 1; q >= 0; q--) sum += integrals[q] * v_all(a[i * width + q]);
        sum = v_all(start[i]) + v_all(h) * sum;
        for (long l = 0; l < count; l++) x[l * nx + i] = sum[l];
    }
}

/* States (n, nx) at times in ascending order. NOT_KEPT where a step that they lie in is not kept. */
int dense(Integrator *I, long n, const double *t, double *x) {
    struct State *T = I->state;
    const Method *fine = I->fine;
    long nx = I->nx, refined = -1;
    if (fine && !fine_stages(I, fine)) return OUT_OF_MEMORY;
    for (long m = 0, count; m < n; m += count) {
        count = 1;
        if (I->steps == I->first) {
            memcpy(x + m * nx, I->states, sizeof(double) * (size_t)nx);
            continue;
        }
        long k = step_of(I, t[m]), row = k - I->first, s = I->stage_count[row], width = s;
        const double *start = I->states + row * nx;
        double begin = I->times[row], end = I->times[row + 1], h = end - begin, theta[LANES] = {(t[m] - begin) / h};
        int after = t[m] >= end;
        if (after || t[m] - begin <= 2 * aside(I, begin)) { /* beside a knot that the motion has come to */
            memcpy(x + m * nx, start + (after ? nx : 0), sizeof(double) * (size_t)nx);
            continue;
        }
        if (I->offset[row] < 0) return NOT_KEPT;
        const double *a = I->coefficients + I->offset[row];
        if (fine && I->kinds[row] == GAUSS) {
            if (refined != k && !refine_step(I, T->fine, k)) return INPUT_FAILED;
            refined = k;
            a = T->fine->a;
            s = T->fine->s;
            width = T->fine->blocks * LANES;
        }
        for (; count < LANES && m + count < n && t[m + count] < end; count++) {
            theta[count] = (t[m + count] - begin) / h;
            if (theta[count] == 1) break;
        }
        states_within(nx, start, a, s, width, theta, count, h, x + m * nx);
    }
    return REACHED_END;
}

/* Masks at a time that the last step reaches to: those it was made with, and at its end those that have been decided there. */
const double *masks_at(const Integrator *I, double t) {
    long last = I->steps - I->first;
    return last > 0 && t < I->times[last] ? I->step_sides + (last - 1) * I->held : I->state->side;
}

#define BETWEEN 3 /* distances of nodes from a singular position, that a motion is read between */
#define THROWN 8 /* times as far as what lies between these, that closing loops throws a state which is taken from there */

/* The square of how far the velocities of one state are from those of another, by how much those of loops are beside others. */
static double velocities_apart(const Integrator *I, const double *x, const double *y) {
    double sum = 0;
    for (long i = I->positions; i < I->nx; i++) sum += (y[i] - x[i]) * I->usual[i] * ((y[i] - x[i]) * I->usual[i]);
    return sum;
}

/* Takes into `closed`, where x is next to a singular position and loops are closed there, what lies between nodes to either side, nearer ones where the motion
   bends, if that is much nearer to x: a motion that passes by turns aside between these, one that leads through is thrown off by closing loops where it is. As
   Passage.nearest of acausal/integrators/passage.py. */
static void read_between(Integrator *I, double t, const double *x, double *closed) {
    struct State *T = I->state;
    double *found = T->increment, work = I->work, part = 1, clear = INFINITY;
    if (present(&I->clearance) && I->usual && !(has_exact(I) && I->through == PAST)) clear = clearance_at(I, t, x);
    if (!(clear < CROSSING)) return;
    if (!T->begun || I->steps == I->first) { /* as it has been assembled */
        memcpy(closed, x, sizeof(double) * (size_t)I->nx);
        return;
    }
    long row = step_of(I, t) - I->first, evaluations = I->evaluations;
    int known = rate_at(I, t, x, T->rate);
    I->evaluations = evaluations, I->work = work; /* steps to come are chosen by these */
    double tau = known ? crossing(I, T->point_in, T->point_out, 0, I->times[row + 1] - I->times[row]) : 0, least = 2 * sqrt(fmax(clear, 0)) / AHEAD;
    double off = velocities_apart(I, x, closed) / (THROWN * THROWN);
    for (int k = 0; k < BETWEEN && tau > 0; k++, part /= CLOSER) {
        close_nodes(I, T->point_in, T->point_out, 0, tau * fmax(part, least)); /* one of them would come to lie in the position itself */
        for (long i = 0; i < I->nx; i++) found[i] = continued(T->nodes, 1 + i);
        double moved = velocities_apart(I, x, found);
        if (moved < off) memcpy(closed, found, sizeof(double) * (size_t)I->nx), off = moved;
    }
}

/* The state (nx) at a time that the steps which are kept reach to, back on the invariants. Steps to come do not see it. */
int state_at(Integrator *I, double t, double *x) {
    struct State *T = I->state;
    V *in = T->projection_in, *out = T->projection_out;
    int good = 1, exact = 0;
    if (!T->begun) memcpy(x, I->x, sizeof(double) * (size_t)I->nx);
    else if (dense(I, 1, &t, x) != REACHED_END) return INPUT_FAILED;
    if (!I->ng) return REACHED_END;
    exact = has_exact(I) && !I->masks && I->through != STRAIGHT && !(present(&I->clearance) && clearance_at(I, t, x) > EXACT);
    in[0] = v_all(t);
    for (long i = 0; i < I->nx; i++) in[1 + i] = v_all(x[i]);
    if (!give_to_projection(I, t, I->masks ? masks_at(I, t) : 0)) return INPUT_FAILED;
    for (int pass = 0; pass < PASSES; pass++) {
        if (exact) run_exact(I, 1, in, out);
        else run_kernel(&I->projection, in, T->projection_c, out, T->work);
        memcpy(in + 1, out, sizeof(V) * (size_t)I->nx);
    }
    for (long i = 0; i < I->nx; i++) good &= isfinite(out[i][0]) != 0;
    double *closed = T->before;
    for (long i = 0; i < I->nx; i++) closed[i] = good ? out[i][0] : x[i];
    read_between(I, t, x, closed);
    memcpy(x, closed, sizeof(double) * (size_t)I->nx);
    return REACHED_END;
}
