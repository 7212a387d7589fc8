/* Guards: zeros of functions of the state, located on dense output. A guard is interpolated in Chebyshev points over an interval;
   the sum of the sizes of its coefficients bounds it, and that of its derivative's bounds the slope. An interval is left alone when the
   first excludes a zero, searched by bracketing when the second says that it is monotone, and halved otherwise: crossings that come in
   pairs within a step and zeros that are only touched are found too. Boyd, Solving Transcendental Equations, chapters 2 and 3. */

#define PI 3.14159265358979323846
#define POINTS 16
#define TOUCH 1e-13 /* of the largest value in the step: as good as zero */

typedef struct {
    Integrator *I;
    const double *a, *start, *stop; /* coefficients (nx, width), states at both ends */
    long s, width, guard;
    double t, h, largest;
    int first;
} Path;

static double chebyshev_point(int k) { return 0.5 - 0.5 * cos(PI * k / (POINTS - 1)); }

/* Guard values at theta, POINTS of them; values (POINTS, guards). Returns 0 when the input function failed. */
static int guard_values(const Path *p, const double *theta, int count, double *values) {
    Integrator *I = p->I;
    struct State *T = I->state;
    V *in = T->guard_in;
    for (int k = 0; k < count; k += LANES) {
        V at = v_all(theta[k]);
        for (int l = 0; l < LANES; l++) at[l] = theta[k + l < count ? k + l : count - 1];
        in[0] = v_fma(at, v_all(p->h), v_all(p->t));
        V P[65], Q[64], y = at + at - v_all(1.0);
        legendre_lanes(y, p->s + 1, P);
        Q[0] = at;
        for (long q = 1; q < p->s; q++) Q[q] = (P[q + 1] - P[q - 1]) * v_all(1 / (double)(2 * (2 * q + 1)));
        Mask m0 = at == v_all(0.0), m1 = at == v_all(1.0);
        for (long i = 0; i < I->nx; i++) {
            V sum = v_all(0.0);
            for (long q = p->s - 1; q >= 0; q--) sum = v_fma(Q[q], v_all(p->a[i * p->width + q]), sum);
            V x = v_fma(v_all(p->h), sum, v_all(p->start[i]));
            in[1 + i] = v_select(m0, v_all(p->start[i]), v_select(m1, v_all(p->stop[i]), x));
        }
        if (I->input)
            for (int l = 0; l < LANES; l++) {
                if (!I->input(in[0][l], I->u)) return 0;
                for (long i = 0; i < I->nu; i++) in[1 + I->nx + i][l] = I->u[i];
            }
        I->guard.run(in, T->guard_c, T->guard_out, T->work);
        for (int l = 0; l < LANES && k + l < count; l++)
            for (long g = 0; g < I->guards; g++) values[(k + l) * I->guards + g] = T->guard_out[g][l];
    }
    return 1;
}

static double one_value(const Path *p, double theta) {
    double *values = p->I->state->guard_values;
    return guard_values(p, &theta, 1, values) ? values[p->guard] : NAN;
}

/* cos(pi j k / (POINTS - 1)), (POINTS, POINTS). */
static void chebyshev_cosines(double *table) {
    for (int k = 0; k < POINTS; k++)
        for (int j = 0; j < POINTS; j++) table[k * POINTS + j] = cos(PI * j * k / (POINTS - 1));
}

/* Chebyshev coefficients of the interpolant of POINTS values at Lobatto points, by the table of cosines. */
static void chebyshev_coefficients(const double *table, const double *values, double *c) {
    const int n = POINTS - 1;
    for (int k = 0; k <= n; k++) {
        double sum = 0;
        for (int j = 0; j <= n; j++) sum += (j == 0 || j == n ? 0.5 : 1.0) * values[j] * table[k * POINTS + j];
        c[k] = sum * (k == 0 || k == n ? 1.0 : 2.0) / n * (k & 1 ? -1 : 1);
    }
}

/* Whether the values keep away from zero on the whole interval. */
static int excludes_zero(const double *c) {
    double rest = 0;
    for (int k = 1; k < POINTS; k++) rest += fabs(c[k]);
    return fabs(c[0]) > 1.01 * rest + 1e-300;
}

static int is_monotone(const double *c) {
    double d[POINTS + 1] = {0}, rest = 0;
    for (int k = POINTS - 2; k >= 0; k--) d[k] = (k + 2 < POINTS ? d[k + 2] : 0) + 2 * (k + 1) * c[k + 1];
    d[0] /= 2;
    for (int k = 1; k < POINTS; k++) rest += fabs(d[k]);
    return fabs(d[0]) > rest;
}

static int found(Integrator *I, long guard, double time, int direction) {
    int wanted = I->guard_direction[guard];
    if (wanted && direction && direction != wanted) return 1;
    if (I->events >= I->state->event_capacity) {
        long c = I->state->event_capacity = 2 * I->events + 64;
        if (!grow(&I->event_times, sizeof(double) * (size_t)c) || !grow(&I->event_guards, sizeof(long) * (size_t)c) ||
            !grow(&I->event_directions, sizeof(long) * (size_t)c))
            return 0;
    }
    long at = I->events++;
    for (; at > I->state->events_before && I->event_times[at - 1] > time; at--) {
        I->event_times[at] = I->event_times[at - 1];
        I->event_guards[at] = I->event_guards[at - 1];
        I->event_directions[at] = I->event_directions[at - 1];
    }
    I->event_times[at] = time;
    I->event_guards[at] = guard;
    I->event_directions[at] = direction;
    return 1;
}

/* The zero between lo and hi, where the values differ in sign: false position after Illinois, on the guard itself. */
static double zero_between(const Path *p, double lo, double hi, double g_lo, double g_hi) {
    int side = 0;
    for (int k = 0; k < 100 && hi - lo > 2 * EPS * (hi + 1e-3); k++) {
        double middle = k < 40 ? (lo * g_hi - hi * g_lo) / (g_hi - g_lo) : 0.5 * (lo + hi);
        if (!(middle > lo && middle < hi)) middle = 0.5 * (lo + hi);
        double g = one_value(p, middle);
        if (g == 0) return middle;
        if ((g > 0) == (g_hi > 0)) {
            hi = middle, g_hi = g;
            if (side == 1) g_lo /= 2;
            side = 1;
        } else {
            lo = middle, g_lo = g;
            if (side == -1) g_hi /= 2;
            side = -1;
        }
        if (middle == lo && hi - lo <= 2 * EPS) break;
    }
    return fabs(g_lo) < fabs(g_hi) ? lo : hi;
}

/* A motion that starts at zero counts when it leaves zero in the direction asked for. */
static int leaves_zero(const Path *p, const double *values) {
    if (!p->first || fabs(values[0]) > 1e-12 * p->largest) return 1;
    for (int k = 1; k < POINTS; k++) {
        if (fabs(values[k]) <= 1e-12 * p->largest) continue;
        int direction = values[k] > 0 ? 1 : -1;
        return p->I->guard_direction[p->guard] != direction || found(p->I, p->guard, p->t, direction);
    }
    return 1;
}

/* Zeros in (lo, hi]. Returns 0 when memory is short. */
static int zeros_within(const Path *p, double lo, double hi, int depth) {
    Integrator *I = p->I;
    double theta[POINTS], values[POINTS], c[POINTS], *all = I->state->guard_values;
    for (int k = 0; k < POINTS; k++) theta[k] = k == POINTS - 1 ? hi : lo + (hi - lo) * chebyshev_point(k);
    if (!guard_values(p, theta, POINTS, all)) return 0;
    double largest = 0;
    for (int k = 0; k < POINTS; k++) {
        values[k] = all[k * I->guards + p->guard];
        largest = fmax(largest, fabs(values[k]));
    }
    double g_lo = values[0], g_hi = values[POINTS - 1];
    int at_start = p->first && lo == 0 && fabs(g_lo) <= 1e-12 * p->largest;
    chebyshev_coefficients(I->state->chebyshev, values, c);
    if (excludes_zero(c) && !at_start) return 1;
    if (largest <= TOUCH * p->largest || depth > 40) {
        if (at_start) return 1;
        double middle = 0.5 * (lo + hi);
        return found(I, p->guard, p->t + middle * p->h, 0);
    }
    if (is_monotone(c)) {
        int rising = g_hi > g_lo ? 1 : -1;
        if (at_start) return 1; /* `leaves_zero` has seen to it */
        if (g_hi == 0) return found(I, p->guard, p->t + hi * p->h, rising);
        if (g_lo == 0 || (g_lo > 0) == (g_hi > 0)) return 1;
        return found(I, p->guard, p->t + zero_between(p, lo, hi, g_lo, g_hi) * p->h, rising);
    }
    double middle = 0.5 * (lo + hi);
    return zeros_within(p, lo, middle, depth + 1) && zeros_within(p, middle, hi, depth + 1);
}

/* End the motion within the last step: state, kept step and its coefficients. */
static void cut_step(Integrator *I, const Path *p, double theta) {
    struct State *T = I->state;
    long k = I->steps - 1, nx = I->nx, s = I->stage_count[k];
    double P[64], K[64], values[64 * 64], *a = I->coefficients + I->offset[k];
    const Method *m = &I->method_list[I->method];
    state_within(nx, p->start, p->a, p->s, p->width, theta, p->h, I->x);
    for (long j = 0; j < s; j++) legendre_values(theta * m->c[j], s, values + j * s);
    for (long i = 0; i < nx; i++) {
        for (long j = 0; j < s; j++) {
            K[j] = 0;
            for (long q = 0; q < s; q++) K[j] += values[j * s + q] * a[i * s + q];
        }
        for (long q = 0; q < s; q++) {
            P[q] = 0;
            for (long j = 0; j < s; j++) P[q] += m->to_legendre[q * s + j] * K[j];
        }
        memcpy(a + i * s, P, sizeof(double) * (size_t)s);
    }
    I->t = p->t + theta * p->h;
    project(I, I->t, I->x);
    I->times[k + 1] = I->t;
    memcpy(I->states + (k + 1) * nx, I->x, sizeof(double) * (size_t)nx);
    memset(T->carry, 0, sizeof(double) * (size_t)nx);
    T->last_h = 0;
}

/* Looks for zeros in the last step. REACHED_END: go on; EVENT: a guard that stops the motion has fired. */
static enum Code watch(Integrator *I) {
    struct State *T = I->state;
    long k = I->steps - 1, n = I->guards;
    Path p = {I, I->coefficients + I->offset[k], I->states + k * I->nx, I->states + (k + 1) * I->nx,
              I->stage_count[k], I->stage_count[k], 0, I->times[k], I->times[k + 1] - I->times[k], 0, k == 0};
    double theta[POINTS], values[POINTS], c[POINTS];
    T->events_before = I->events;
    for (int j = 0; j < POINTS; j++) theta[j] = chebyshev_point(j);
    theta[POINTS - 1] = 1;
    int refined = 0;
    for (long g = 0; g < n; g++) {
        p.guard = g;
        for (int pass = refined; pass < 2; pass++) {
            if (!guard_values(&p, theta, POINTS, T->guard_values)) return INPUT_FAILED;
            p.largest = 0;
            for (int j = 0; j < POINTS; j++) {
                values[j] = T->guard_values[j * n + g];
                if (!isfinite(values[j])) return REACHED_END;
                p.largest = fmax(p.largest, fabs(values[j]));
            }
            chebyshev_coefficients(T->chebyshev, values, c);
            if (excludes_zero(c) && !(p.first && fabs(values[0]) <= 1e-12 * p.largest)) break;
            if (!refined && I->fine) {
                if (!fine_stages(I, I->fine) || !refine_step(I, T->fine, k)) return INPUT_FAILED;
                p.a = T->fine->a;
                p.s = T->fine->s;
                p.width = T->fine->blocks * LANES;
                refined = 1;
                continue;
            }
            if (p.largest > 0 && !(leaves_zero(&p, values) && zeros_within(&p, 0, 1, 0))) return OUT_OF_MEMORY;
            break;
        }
    }
    for (long e = T->events_before; e < I->events; e++) {
        if (!I->guard_stops[I->event_guards[e]]) continue;
        I->events = e + 1;
        double at = (I->event_times[e] - p.t) / p.h;
        if (at <= 0) {
            I->steps--;
            I->t = p.t;
            memcpy(I->x, p.start, sizeof(double) * (size_t)I->nx);
        } else if (at < 1) {
            cut_step(I, &p, at);
        }
        return EVENT;
    }
    return REACHED_END;
}
