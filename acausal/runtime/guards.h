/* Guards: zeros of functions of the state, located on dense output. A guard is interpolated in Chebyshev points over an interval;
   the sum of the sizes of its coefficients bounds it, and that of its derivative's bounds the slope. An interval is left alone when the
   first excludes a zero, searched by bracketing when the second says that it is monotone, and halved otherwise: crossings that come in
   pairs within a step and zeros that are only touched are found too. Boyd, Solving Transcendental Equations, chapters 2 and 3.

   Values no larger than what rounding makes of them have no sign. A guard has a side once it has had a sign; it crosses when it
   gets the other one, however flat the zero between, and touches when it gets the same one again. Where it has no sign for a whole step,
   it has no side any more; and it gets none as long as it is no more than what the tolerance allows the states to be off by. */

#define PI 3.14159265358979323846
#define POINTS 16
#define AT_START 1e-12 /* of the largest value in the first step: as good as zero there */
#define ROUNDINGS 16.0 /* sizes of rounding below which values have no sign */
#define MET 8.0        /* times as much is it where modes change */
#define LINEAR 1e-4    /* of their sizes: how far states are moved to see what guards make of their errors */
#define UNSURE 10      /* steps' errors from the first step on */
#define SEARCHES 4000  /* intervals looked at for a guard in a step */

typedef struct {
    Integrator *I;
    const double *a, *start, *stop; /* coefficients (nx, width), states at both ends */
    long s, width, guard;
    double t, h, noise;
    int first, searches, memory;
    int rows; /* whether rows of switches are followed, not guards */
    const double *series; /* Chebyshev coefficients of the guard between theta `from` and `to`, which tell it to rounding; null: it is evaluated itself */
    double from, to;
} Path;

static long first_discrete(const Integrator *I) { return I->masks - I->discretes; }
static long first_set(const Integrator *I) { return I->mode_rows - I->set_count; }

/* By what a row is multiplied: rows of what is set by the side that their guards are on. */
static double side_of_row(const Integrator *I, long row) {
    long k = row - first_set(I);
    return k >= 0 && k < I->set_count ? I->state->set_side[k] : 1;
}

static double chebyshev_point(int k) { return 0.5 - 0.5 * cos(PI * k / (POINTS - 1)); }

/* The same by the table of cosines. */
static double point_in(const double *table, int k) { return 0.5 - 0.5 * table[POINTS + k]; }

/* Guards at places theta of a step, each in lanes: rows not yet multiplied by their sides. Null when the input function failed. */
static const V *guards_in_lanes(const Path *p, V theta) {
    Integrator *I = p->I;
    struct State *T = I->state;
    V *in = p->rows ? T->rows_in : T->guard_in, *out = p->rows ? T->rows_out : T->guard_out, *constants = p->rows ? T->rows_c : T->guard_c;
    V P[65], Q[64], y = theta + theta - v_all(1.0);
    in[0] = v_fma(theta, v_all(p->h), v_all(p->t));
    legendre_lanes(y, p->s + 1, P);
    Q[0] = theta;
    for (long q = 1; q < p->s; q++) Q[q] = (P[q + 1] - P[q - 1]) * v_all(1 / (double)(2 * (2 * q + 1)));
    Mask m0 = theta == v_all(0.0), m1 = theta == v_all(1.0);
    for (long i = 0; i < I->nx; i++) {
        V sum = v_all(0.0);
        for (long q = p->s - 1; q >= 0; q--) sum = v_fma(Q[q], v_all(p->a[i * p->width + q]), sum);
        V x = v_fma(v_all(p->h), sum, v_all(p->start[i]));
        in[1 + i] = v_select(m0, v_all(p->start[i]), v_select(m1, v_all(p->stop[i]), x));
    }
    if (!inputs_at(I, in[0], LANES, in + 1 + I->nx)) return 0;
    if (p->rows) run_masked(I, OF_ROWS, in, constants, out);
    else run_kernel(&I->guard, in, constants, out, T->work);
    return out;
}

/* Guard values at theta, POINTS of them; values (POINTS, guards). Returns 0 when the input function failed. */
static int guard_values(const Path *p, const double *theta, int count, double *values) {
    Integrator *I = p->I;
    long n = p->rows ? I->row_count : I->guards;
    for (int k = 0; k < count; k += LANES) {
        V at = v_all(theta[k]);
        for (int l = 0; l < LANES; l++) at[l] = theta[k + l < count ? k + l : count - 1];
        const V *out = guards_in_lanes(p, at);
        if (!out) return 0;
        for (int l = 0; l < LANES && k + l < count; l++)
            for (long g = 0; g < n; g++) values[(k + l) * n + g] = out[g][l];
    }
    for (long k = 0; k < I->set_count && p->rows; k++)
        for (int j = 0; j < count; j++) values[j * n + first_set(I) + k] *= I->state->set_side[k];
    return 1;
}

/* A Chebyshev series of POINTS terms, by Clenshaw's recursion. */
static V series_at(const double *c, V y) {
    V one = v_all(c[POINTS - 1]), other = v_all(0.0), twice = y + y;
    for (int k = POINTS - 2; k > 0; k--) {
        V next = v_fma(twice, one, v_all(c[k]) - other);
        other = one;
        one = next;
    }
    return v_fma(y, one, v_all(c[0]) - other);
}

static V in_series(const Path *p, V theta) { return (theta - v_all(p->from)) * v_all(2 / (p->to - p->from)) - v_all(1.0); }

static double one_value(const Path *p, double theta) {
    if (p->series) return series_at(p->series, in_series(p, v_all(theta)))[0];
    double *values = p->rows ? p->I->state->one_row : p->I->state->guard_values;
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
    for (int k = 0; k < POINTS; k += LANES) {
        V sum = v_all(0.0), cosines;
        for (int j = 0; j <= n; j++) {
            memcpy(&cosines, table + j * POINTS + k, sizeof cosines);
            sum = v_fma(v_all((j == 0 || j == n ? 0.5 : 1.0) * values[j]), cosines, sum);
        }
        memcpy(c + k, &sum, sizeof sum);
    }
    for (int k = 0; k <= n; k++) c[k] *= (k == 0 || k == n ? 1.0 : 2.0) / n * (k & 1 ? -1 : 1);
}

/* By how much a series leaves its mean, at most. */
static double series_varies(const double *c) {
    double rest = 0;
    for (int k = 1; k < POINTS; k++) rest += fabs(c[k]);
    return rest;
}

/* Whether the values keep away from what is no more than noise on the whole interval. */
static int excludes_zero(const double *c, double noise) { return fabs(c[0]) > 1.01 * series_varies(c) + noise; }

/* Whether a series ends in what is only rounding of its values. */
static int is_resolved(const double *c, double noise) {
    double sum = 0;
    for (int k = 0; k < POINTS; k++) sum += fabs(c[k]);
    for (int k = POINTS - 3; k < POINTS; k++)
        if (!(fabs(c[k]) <= noise + 4 * EPS * sum)) return 0;
    return 1;
}

static int is_monotone(const double *c) {
    double d[POINTS + 1] = {0}, rest = 0;
    for (int k = POINTS - 2; k >= 0; k--) d[k] = (k + 2 < POINTS ? d[k + 2] : 0) + 2 * (k + 1) * c[k + 1];
    d[0] /= 2;
    for (int k = 1; k < POINTS; k++) rest += fabs(d[k]);
    return fabs(d[0]) > rest;
}

static int found(Integrator *I, long guard, double time, int direction) {
    long wanted = I->guard_direction[guard];
    if (wanted && direction && direction != wanted) return 1;
    if (I->events >= I->state->event_capacity) {
        if (I->block) return 0;
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

static void event_at(Path *p, double time, int direction) { p->memory &= found(p->I, p->guard, time, direction); }

/* Whether a guard that starts at zero leaves it in proportion to time: then it is in the middle of a crossing. */
static int leaves_steadily(const Path *p, double theta) {
    double whole = one_value(p, theta), half = one_value(p, 0.5 * theta);
    return fabs(half) > 0.36 * fabs(whole);
}

/* From theta on the guard has this sign; a zero before it counts as in the middle of where there was no sign. */
static void takes_side(Path *p, double theta, int sign) {
    struct GuardState *G = &p->I->state->guard_states[p->guard];
    double now = p->t + theta * p->h;
    if (G->side && (sign != G->side || G->at_zero))
        event_at(p, G->at_zero ? 0.5 * (G->since + now) : now, sign != G->side ? sign : 0);
    else if (!G->side && G->at_start && p->I->guard_direction[p->guard] == sign)
        if (!p->I->guard_stops[p->guard] || !leaves_steadily(p, fmax(2 * theta, chebyshev_point(1)))) event_at(p, p->t, sign);
    G->side = sign;
    G->at_zero = G->at_start = 0;
}

static void comes_to_zero(Path *p, double theta) {
    struct GuardState *G = &p->I->state->guard_states[p->guard];
    if (!G->at_zero) G->since = p->t + theta * p->h;
    G->at_zero = 1;
}

/* The largest value without a sign: larger where there was none, or noise would come and go. */
static double no_sign(const Path *p) { return p->I->state->guard_states[p->guard].at_zero ? 4 * p->noise : p->noise; }

static int sign_of(double value, double none) { return value > none ? 1 : value < -none ? -1 : 0; }

/* Follows the sign of the guard from theta lo to hi. Returns 0 when the input function failed. */
static int follow(Path *p, double lo, double hi, int depth) {
    Integrator *I = p->I;
    double theta[POINTS], values[POINTS], c[POINTS], *all = I->state->guard_values, largest = 0, middle = 0.5 * (lo + hi);
    int known = 0;
    for (int k = 0; k < POINTS; k++) theta[k] = k == POINTS - 1 ? hi : lo + (hi - lo) * point_in(I->state->chebyshev, k);
    if (!guard_values(p, theta, POINTS, all)) return 0;
    for (int k = 0; k < POINTS; k++) {
        values[k] = all[k * I->guards + p->guard];
        known += isfinite(values[k]);
        largest = fmax(largest, fabs(values[k]));
    }
    int deep = depth > 40 || ++p->searches > SEARCHES;
    if (known < POINTS) {
        if (known == 0 || depth > 20 || deep) return 1;
        return follow(p, lo, middle, depth + 1) && follow(p, middle, hi, depth + 1);
    }
    double none = no_sign(p);
    if (largest <= none) {
        comes_to_zero(p, lo);
        return 1;
    }
    chebyshev_coefficients(I->state->chebyshev, values, c);
    double g_lo = values[0], g_hi = values[POINTS - 1];
    if (excludes_zero(c, none)) {
        takes_side(p, lo, g_lo > 0 ? 1 : -1);
        return 1;
    }
    if (!deep && !is_monotone(c)) return follow(p, lo, middle, depth + 1) && follow(p, middle, hi, depth + 1);
    int from = sign_of(g_lo, none), to = sign_of(g_hi, none);
    if (from) takes_side(p, lo, from);
    if (from && to && from != to) {
        takes_side(p, zero_between(p, lo, hi, g_lo, g_hi), to);
    } else if (to) {
        takes_side(p, lo, to);
    } else {
        comes_to_zero(p, from ? (g_hi > 0) == (g_lo > 0) ? hi : zero_between(p, lo, hi, g_lo, g_hi) : lo);
    }
    return 1;
}

/* Coefficients of the last step that is kept for the interval from its start to theta. */
static void rescale_step(Integrator *I, double theta) {
    long k = I->steps - 1 - I->first, s = I->stage_count[k];
    double P[64], K[64], values[64 * 64], *a = I->coefficients + I->offset[k];
    const Method *m = I->method_list;
    if (s == 1) return; /* a constant */
    while (m->stages != s) m++; /* the next step may have another one */
    for (long j = 0; j < s; j++) legendre_values(theta * m->c[j], s, values + j * s);
    for (long i = 0; i < I->nx; i++) {
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
}

/* The last step ends at another time, in the state that I->x now is. */
static void end_step_at(Integrator *I, double t) {
    struct State *T = I->state;
    long k = I->steps - I->first;
    I->t = t;
    project(I, I->t, I->x);
    I->times[k] = I->t;
    memcpy(I->states + k * I->nx, I->x, sizeof(double) * (size_t)I->nx);
    memset(T->carry, 0, sizeof(double) * (size_t)I->nx);
    T->time_carry = 0;
}

/* End the motion within the last step: state, kept step and its coefficients. */
static void cut_step(Integrator *I, const Path *p, double theta) {
    state_within(I->nx, p->start, p->a, p->s, p->width, theta, p->h, I->x);
    rescale_step(I, theta);
    end_step_at(I, p->t + theta * p->h);
    I->state->last_h = 0;
}

/* What rounding of the states, so many times as large, makes of all guards at theta. Returns 0 when the input function failed. */
static int guard_rounding(const Path *p, double theta, double times) {
    Integrator *I = p->I;
    struct State *T = I->state;
    double *x = T->before, *size = T->most;
    const Kernel *disturbed = disturbed_kernel(I, 1);
    if (!disturbed) return 1;
    state_within(I->nx, p->start, p->a, p->s, p->width, theta, p->h, x);
    for (long i = 0; i < I->nx; i++) size[i] = times * (fabs(x[i]) + T->size[i]);
    return rounding_of(I, disturbed, p->t + theta * p->h, x, size, T->guard_noise);
}

/* What errors of the states, as the tolerance allows in each step, make of a guard until theta. Negative when the input function failed. */
static double guard_error(const Path *p, double theta) {
    const Integrator *I = p->I;
    double wanted = I->step > 0 ? 0 : I->rtol / EPS, times = fmin(wanted, LINEAR / ENLARGED);
    if (times <= 1) return 0;
    if (!guard_rounding(p, theta, times)) return -1;
    double found = I->state->guard_noise[p->guard];
    return isfinite(found) ? (UNSURE + (double)I->steps) * wanted / times * found : 0;
}

/* Looks for zeros of one guard in a step whose values at Chebyshev points are known. Returns 0 when the input function failed. */
static int search(Path *p, const double *values) {
    struct State *T = p->I->state;
    struct GuardState *G = &T->guard_states[p->guard];
    double least = INFINITY, largest = 0, where = 0, there = 0;
    for (int j = 0; j < POINTS; j++) {
        if (fabs(values[j]) < least) least = fabs(values[j]), where = chebyshev_point(j);
        if (isfinite(values[j]) && fabs(values[j]) > largest) largest = fabs(values[j]), there = chebyshev_point(j);
    }
    /* what is nothing but rounding where it is largest is so everywhere, also where its terms vanish and rounding with them */
    if (!guard_rounding(p, there, 1)) return 0;
    double most = T->guard_noise[p->guard];
    if (!guard_rounding(p, where, 1)) return 0;
    p->noise = isfinite(T->guard_noise[p->guard]) ? ROUNDINGS * T->guard_noise[p->guard] : 0;
    if (T->pending >= 0 || p->t == T->changed_at) p->noise *= MET; /* what modes change by comes to zero here and is no further beyond */
    if (isfinite(most) && largest <= ROUNDINGS * most) p->noise = fmax(p->noise, ROUNDINGS * most);
    if (!G->side && !G->at_zero && isfinite(largest)) { /* what is conserved only drifts */
        double error = guard_error(p, there);
        if (error < 0) return 0;
        if (largest <= error) p->noise = fmax(p->noise, error);
    }
    if (p->first) p->noise = fmax(p->noise, fabs(values[0]) <= AT_START * largest ? AT_START * largest : 0);
    if (p->first && fabs(values[0]) <= p->noise) G->at_start = 1;
    p->searches = 0;
    if (!follow(p, 0, 1, 0)) return 0;
    if (G->at_zero && G->since <= p->t) G->side = G->at_zero = 0; /* for a whole step: no side any more */
    if (G->at_zero && G->side && p->I->t >= p->I->end) event_at(p, G->since, -G->side);
    return 1;
}

/* Looks for zeros in the last step. REACHED_END: go on; EVENT: a guard that stops the motion has fired. */
static enum Code watch(Integrator *I) {
    struct State *T = I->state;
    long k = I->steps - 1 - I->first, n = I->guards;
    Path p = {I, I->coefficients + I->offset[k], I->states + k * I->nx, I->states + (k + 1) * I->nx,
              I->stage_count[k], I->stage_count[k], 0, I->times[k], I->times[k + 1] - I->times[k], 0, I->times[k] == T->start, 0, 1, 0, 0, 0, 1};
    double theta[POINTS], values[POINTS], c[POINTS];
    T->events_before = I->events;
    for (int j = 0; j < POINTS; j++) theta[j] = point_in(I->state->chebyshev, j);
    theta[POINTS - 1] = 1;
    int refined = 0, seen = 0;
    for (long g = 0; g < n; g++) {
        struct GuardState *G = &T->guard_states[g];
        p.guard = g;
        for (int pass = refined; pass < 2; pass++) {
            if (!seen && !guard_values(&p, theta, POINTS, T->guard_values)) return INPUT_FAILED;
            seen = 1;
            int known = 1;
            for (int j = 0; j < POINTS; j++) {
                values[j] = T->guard_values[j * n + g];
                known &= isfinite(values[j]) != 0;
            }
            chebyshev_coefficients(T->chebyshev, values, c);
            int sign = values[0] > 0 ? 1 : -1;
            if (known && G->side == sign && !G->at_zero && !G->at_start && !p.first && excludes_zero(c, 0)) {
                break;
            }
            if (!refined && I->fine) {
                if (!fine_stages(I, I->fine) || !refine_step(I, T->fine, I->steps - 1)) return INPUT_FAILED;
                p.a = T->fine->a;
                p.s = T->fine->s;
                p.width = T->fine->blocks * LANES;
                refined = 1;
                seen = 0;
                continue;
            }
            if (!search(&p, values)) return INPUT_FAILED;
            seen = 0; /* its room is where values of all were */
            if (!p.memory) return OUT_OF_MEMORY;
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
