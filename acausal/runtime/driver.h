/* The loop over steps. */

/* Of a clock [s]. */
static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static Stages *stages_of(Integrator *I) {
    struct State *T = I->state;
    if (!(T->made >> I->method & 1)) {
        if (!make_stages(I, &T->stages[I->method], &I->method_list[I->method])) return 0;
        T->made |= 1L << I->method;
    }
    return &T->stages[I->method];
}

static int grow(void *array, size_t bytes) {
    void *new = realloc(*(void **)array, bytes);
    if (new) *(void **)array = new;
    return new != 0;
}

/* Room for one step, where a caller's block is all the memory there is. */
static int make_last_step(Integrator *I, long stages) {
    I->times = reserve_doubles(I, 2);
    I->states = reserve_doubles(I, 2 * I->nx);
    I->step_sides = reserve_doubles(I, I->held);
    I->coefficients = reserve_doubles(I, (stages + 1) * I->nx);
    I->stage_count = reserve(I, sizeof(long));
    I->offset = reserve(I, sizeof(long));
    I->kinds = reserve(I, sizeof(long));
    I->event_times = reserve_doubles(I, I->event_room);
    I->event_guards = reserve(I, sizeof(long) * (size_t)I->event_room);
    I->event_directions = reserve(I, sizeof(long) * (size_t)I->event_room);
    I->state->event_capacity = I->event_room;
    return I->times && I->states && I->step_sides && I->coefficients && I->stage_count && I->offset && I->kinds && I->event_times && I->event_guards && I->event_directions;
}

/* Moves what is kept of an end of a step, and of the step after it. */
static void move_row(Integrator *I, long from, long to) {
    size_t n = sizeof(double) * (size_t)I->nx, held = sizeof(double) * (size_t)I->held;
    I->times[to] = I->times[from];
    memmove(I->states + to * I->nx, I->states + from * I->nx, n);
    I->stage_count[to] = I->stage_count[from];
    I->offset[to] = I->offset[from];
    I->kinds[to] = I->kinds[from];
    if (held) memmove(I->step_sides + to * I->held, I->step_sides + from * I->held, held);
}

/* Of `rows` ends of steps, keep both of each step that is read, those of the last step, both sides of jumps, those where modes change, and of the rest one in
   so many, `stride`; how many these are. Several steps from one row to the next have minus their number for their stages. */
static long thin_rows(Integrator *I, long rows) {
    struct State *T = I->state;
    long end = 1, number = 0, last = 0, change = 0;
    while (change < I->transitions && I->transition_steps[change] == 0) change++;
    int before = I->offset[0] >= 0;
    for (long r = 1; r < rows; r++) {
        number += I->stage_count[r - 1] < 0 ? -I->stage_count[r - 1] : 1; /* rows move down, behind what is still looked at */
        int after = r < rows - 1 && I->offset[r] >= 0, changes = change < I->transitions && I->transition_steps[change] == r;
        if (before || after || changes || I->times[r] == I->times[r - 1] || r >= rows - 2 || number % T->stride == 0) {
            if (number > last + 1) {
                I->stage_count[end - 1] = last - number;
                I->offset[end - 1] = -1;
            }
            if (end < r) move_row(I, r, end);
            while (change < I->transitions && I->transition_steps[change] == r) I->transition_steps[change++] = end;
            last = number;
            end++;
        }
        before = after;
    }
    return end;
}

/* Room for one more step. */
static int make_room(Integrator *I) {
    struct State *T = I->state;
    long k = I->steps - I->first, n = I->nx;
    if (I->block) {
        if (I->steps < 2) return 1;
        I->first = I->steps - 1;
        I->times[0] = I->times[1];
        memcpy(I->states, I->states + n, sizeof(double) * (size_t)n);
        T->coefficient_count = 0;
        return 1;
    }
    if (k + 1 < T->capacity) return 1;
    if (T->thinned && sizeof(double) * (size_t)(2 * k * (n + I->held + 4)) > I->budget) {
        for (int again = 0; again < 2; again++) {
            if (again || !T->stride) T->stride = T->stride ? 2 * T->stride : 2;
            long left = thin_rows(I, k);
            I->first += k - left;
            k = left;
            if (2 * k < T->capacity) return 1;
        }
    }
    long c = T->capacity = k < 64 ? 128 : 2 * k;
    return grow(&I->times, sizeof(double) * (size_t)c) && grow(&I->states, sizeof(double) * (size_t)(c * n) + 8) &&
           grow(&I->stage_count, sizeof(long) * (size_t)c) && grow(&I->offset, sizeof(long) * (size_t)c) && grow(&I->kinds, sizeof(long) * (size_t)c) &&
           grow(&I->step_sides, sizeof(double) * (size_t)(c * I->held) + 8);
}

/* Whether something is read of the step between two times; asked for one step after the other. */
static int is_read(Integrator *I, double from, double to) {
    struct State *T = I->state;
    while (T->read_at < I->read_count && I->read[T->read_at] < from) T->read_at++;
    while (T->event_at < I->events && I->event_times[T->event_at] <= from) T->event_at++;
    return (T->read_at < I->read_count && I->read[T->read_at] < to) || (T->event_at < I->events && I->event_times[T->event_at] < to);
}

/* Of the steps so far, `count` of them, keep only those that are read. */
static void thin(Integrator *I, long count) {
    struct State *T = I->state;
    long end = 0;
    for (long k = 0; k < count; k++) {
        long size = (I->stage_count[k] + 1) * I->nx;
        int read = is_read(I, I->times[k], I->times[k + 1]);
        if (read) memmove(I->coefficients + end, I->coefficients + I->offset[k], sizeof(double) * (size_t)size);
        I->offset[k] = read ? end : -1;
        if (read) end += size;
    }
    T->thinned = 1;
    T->coefficient_count = T->coefficient_capacity = end;
    grow(&I->coefficients, sizeof(double) * (size_t)end + 8); /* it becomes smaller */
}

/* Makes room for the next step's coefficients where memory is limited: what is not read goes, the last step too, as soon as another follows. */
static void spare(Integrator *I, long k) {
    struct State *T = I->state;
    if (!I->budget || k < 2) return;
    if (!T->thinned) {
        if (sizeof(double) * (size_t)T->coefficient_count > I->budget) thin(I, k - 1);
    } else if (!is_read(I, I->times[k - 2], I->times[k - 1])) {
        T->coefficient_count = I->offset[k - 2];
        I->offset[k - 2] = -1;
    }
}

/* Keep the state, and the coefficients of the step that led to it (none for the start), with the sizes that states have had. */
static int keep(Integrator *I, const Stages *S) {
    struct State *T = I->state;
    if (!make_room(I)) return 0;
    long k = I->steps - I->first, n = I->nx;
    I->times[k] = I->t;
    memcpy(I->states + k * n, I->x, sizeof(double) * (size_t)n);
    if (!S) return 1;
    spare(I, k);
    long s = S->s, width = S->blocks * LANES, at = T->coefficient_count;
    if (!I->block && at + (s + 1) * n > T->coefficient_capacity) {
        T->coefficient_capacity = 2 * (at + (s + 1) * n) + 1024;
        if (!grow(&I->coefficients, sizeof(double) * (size_t)T->coefficient_capacity)) return 0;
    }
    if (s == width) memcpy(I->coefficients + at, S->a, sizeof(double) * (size_t)(n * s));
    for (long i = 0; i < n && s < width; i++) memcpy(I->coefficients + at + i * s, S->a + i * width, sizeof(double) * (size_t)s);
    memcpy(I->coefficients + at + n * s, T->size, sizeof(double) * (size_t)n);
    if (I->held) memcpy(I->step_sides + (k - 1) * I->held, T->side, sizeof(double) * (size_t)I->held);
    I->stage_count[k - 1] = s;
    I->kinds[k - 1] = S->method->kind;
    I->offset[k - 1] = at;
    T->coefficient_count = at + (s + 1) * n;
    return 1;
}

/* The largest sizes of Legendre coefficients `a` of a step of size h in units of the scale, degree by degree. */
static void largest_coefficients(const Integrator *I, const double *a, long width, double h, double *sizes) {
    const struct State *T = I->state;
    for (long first = 0; first < width; first += LANES) {
        V most = v_all(0.0);
        for (long i = 0; i < I->nx; i++) most = v_larger(most, v_abs(*(const V *)(a + i * width + first)) * v_all(h / T->scale[i]));
        memcpy(sizes + first, &most, sizeof most);
    }
}

/* Stage rates by extrapolating the last step's polynomial; the rate at the start for the first step. Extrapolated Legendre
   series diverge where steps are large, so the series ends before its smallest term. */
static int guess(Integrator *I, Stages *S, double h) {
    struct State *T = I->state;
    long s = T->last_s;
    if (T->last_h == 0) {
        if (!rate_at(I, I->t, I->x, T->rate)) return 0;
        for (long b = 0; b < S->blocks; b++)
            for (long i = 0; i < I->nx; i++) S->K[b][i] = v_all(T->rate[i]);
        return 1;
    }
    V columns[64];
    double P[64], largest[64];
    double ratio = h / T->last_h;
    long terms = s, width = (s + LANES - 1) / LANES * LANES;
    if (s > 2) {
        legendre_values(1 + S->method->c[S->s - 1] * ratio, s, P);
        largest_coefficients(I, T->last_a, width, 1, largest);
        terms = 2;
        for (long k = 1; k < s; k++)
            if (largest[k] * P[k] < largest[terms - 1] * P[terms - 1]) terms = k + 1;
    }
    T->terms = terms;
    for (long b = 0; b < S->blocks; b++) {
        V y = v_all(1.0) + v_all(2 * ratio) * S->c[b];
        legendre_lanes(y, terms, columns);
        for (long i = 0; i < I->nx; i++) {
            const double *a = T->last_a + i * width;
            V r = v_all(0.0);
            for (long k = 0; k < terms; k++) r = v_fma(v_all(a[k]), columns[k], r);
            S->K[b][i] = r;
        }
    }
    return 1;
}

/* The change that rounding of the states alone can make, in units of the scale. */
static double rounding_floor(Integrator *I, Stages *S, double h) {
    const struct State *T = I->state;
    V worst = v_all(0.0);
    for (long i = 0; i < I->nx; i++) {
        if (T->scale[i] <= NOTHING) continue;
        for (long b = 0; b < S->blocks; b++)
            worst = v_larger(worst, v_larger(v_abs(S->K[b][i]) * v_all(fabs(h)), v_all(fabs(I->x[i]))) * v_all(1 / T->scale[i]));
    }
    return fmin(2 * EPS * v_largest(worst), 2 * EPS / T->unit);
}

/* Error of a step in units of its scale. Rounding of the rates makes (2 k + 1) times as much of coefficient k at most. */
static double step_error_of(Integrator *I, Stages *S, double h) {
    struct State *T = I->state;
    long s = S->s, n = S->blocks * LANES;
    double sizes[64] = {0}, largest = 0;
    for (long b = 0; b < S->blocks; b++) {
        V most = v_all(0.0);
        for (long i = 0; i < I->nx; i++) {
            V a = v_abs(((const V *)(S->a + i * n))[b]);
            if (T->noisy) a = v_larger(a - v_all(T->noise[i]) * S->odd[b], v_all(0.0));
            most = v_larger(most, a * v_all(h / T->scale[i]));
        }
        memcpy(sizes + b * LANES, &most, sizeof most);
    }
    for (long k = 0; k < s; k++)
        if (!(sizes[k] <= largest)) largest = sizes[k];
    if (largest == 0) return 0;
    if (s == 1) {
        double change = 0;
        if (!rate_at(I, I->t, I->x, T->rate)) return NAN;
        for (long i = 0; i < I->nx; i++) change = fmax(change, fabs(S->K[0][i][0] - T->rate[i]) * (h / T->scale[i]));
        double r = change / largest;
        return largest * (r < 1 ? r * r : 1);
    }
    return error_by_decay(S->method, sizes, largest);
}

/* Whether the rates jump or bend before the first or after the last node, where no stage sees it: the polynomial then misses the rates
   at the ends of the step by more than the neglected terms explain. `strict`: after rejections, when a kink is near. What a jump of the rates moves a state by in a
   step of the size that was planned counts as the state's size: so jumps from rest are found, too. Magnitudes have valleys, often narrow ones of little
   effect: their coefficients decay by themselves, from less than a_0, and what is off at the ends tells how fast. */
static int misses_ends(Integrator *I, Stages *S, double h, int strict) {
    struct State *T = I->state;
    long s = S->s, n = S->blocks * LANES;
    double *off[2] = {T->before, T->most};
    int radau = S->method->kind == RADAU;
    double worst = 0, tail, largest = 0, sizes[64], soonest = h / (T->unit * PART * T->reach);
    if (goes_through(I, S)) {
        T->start_known = 0;
        return 0;
    }
    for (long i = 0; i < I->nx; i++) T->before[i] = I->x[i] + T->increment[i];
    if (!T->start_known && !rate_at(I, I->t, I->x, T->start_rate)) return -1;
    int beside = S->around || T->part > 0;
    if (beside) {
        if (!rate_at(I, I->t, I->x, T->start_rate)) return -1;
        beside_at(I, S->around, h, T->start_rate);
    }
    if (!T->end_known && !rate_at(I, I->t + h, T->before, T->end_rate)) return -1;
    if (beside) beside_at(I, S->around, h, T->end_rate);
    T->start_known = T->end_known = !beside;
    for (long i = 0; i < I->nx; i++) {
        const double *a = S->a + i * n;
        double even = 0, odd = 0;
        if (!isfinite(T->end_rate[i])) return 1;
        for (long k = s - 1; k >= 0; k--) *(k & 1 ? &odd : &even) += a[k];
        double noise = (double)s * T->spread[i];
        double ends[2] = {even - odd - T->start_rate[i], even + odd - T->end_rate[i]};
        for (int e = 0; e < 2; e++) off[e][i] = copysign(heard(ends[e], noise), ends[e]);
    }
    if (radau) forget_fast(I, S->method, off[0]); /* Gauss forgets nothing; the last stage of Radau is the end of the step */
    for (int e = 0; e < (radau ? 1 : 2); e++)
        for (long i = 0; i < I->nx; i++) worst = fmax(worst, fmin(fabs(off[e][i]) * (h / T->scale[i]), soonest));
    if (S->method->c[0] * worst <= 1) return 0;
    largest_coefficients(I, S->a, n, h, sizes);
    for (long k = 0; k < s; k++) largest = fmax(largest, sizes[k]);
    tail = sizes[s - 1];
    double next = tail * power(tail / largest, 1 / (double)(s - 1)); /* the first neglected coefficient */
    if (I->magnitudes > 0 && !radau && worst * power(fmin(worst / tail, 1), (double)(S->method->order - s)) > 1) return 1;
    return (strict && !radau) || worst > (strict ? 2 : 6) * next;
}

/* The same, beyond what rounding makes of the rates. */
static int hides_kink(Integrator *I, Stages *S, double h, int strict) {
    struct State *T = I->state;
    int carried = T->start_known, found = misses_ends(I, S, h, strict);
    if (found == 1 && carried) { /* corrections after the last step have moved rates that are nothing but rounding */
        T->start_known = 0;
        found = misses_ends(I, S, h, strict);
    }
    if (found != 1) return found;
    int leasts = 0; /* then only here: others are to be as accurate as ever */
    for (long i = 0; i < I->nx; i++) leasts |= T->least[i] > 0;
    if (T->noisy && !leasts) return found;
    double work = I->work;
    sample_noise(I, S, leasts, 1);
    for (long i = 0; i < I->nx; i++) T->scale[i] = fmax(T->scale[i], least_scale(I, i, h));
    found = misses_ends(I, S, h, strict);
    if (found || leasts) {
        forget_noise(I);
        I->work = work; /* methods are chosen by what they take, not by what was looked at */
    }
    return found;
}

static enum Code failed_at(Integrator *I, enum Code code);
static long carried_of(const Integrator *I);

/* Advance with compensated summation, project onto the invariants, keep the polynomial. */
static enum Code accept_step(Integrator *I, Stages *S, double h) {
    struct State *T = I->state;
    long n = I->nx, width = S->blocks * LANES;
    double begin = I->t;
    if (I->directions) advance_directions(I, S, h);
    for (long i = 0; i < n; i++) {
        double increment = T->increment[i] + T->carry[i], x = I->x[i] + increment;
        T->carry[i] = increment - (x - I->x[i]);
        I->x[i] = x;
    }
    double passed = h + T->time_carry, t = I->t + fmax(passed, 0); /* thousands of steps may round alike */
    I->t = fabs(I->end - t) <= 4 * EPS * fabs(I->end) ? I->end : t;
    T->time_carry = passed - (I->t - begin);
    memcpy(T->factor, I->x, sizeof(double) * (size_t)n);
    int projected = project(I, I->t, I->x);
    if (I->led == LED_PLACES && !(I->redundant && T->side[carried_of(I) - 1] != 0) && is_torn(I, I->t, I->x)) { /* of rows that depend on one another, apart.h tells */
        I->t = begin;
        memcpy(I->x, I->states + (I->steps - I->first) * n, sizeof(double) * (size_t)n);
        return failed_at(I, STEP_UNDERFLOW);
    }
    if (projected) {
        memset(T->carry, 0, sizeof(double) * (size_t)n);
        for (long i = 0; i < n; i++) /* the rates at the end of the step are then not those at the start of the next */
            if (fabs(I->x[i] - T->factor[i]) > 0.01 * T->scale[i]) T->start_known = 0;
    }
    if (I->directions && I->ng) project_directions(I);
    for (long i = 0; i < n; i++) take_size(I, i);
    I->steps++;
    if (T->newton_now) I->newton_steps++;
    I->radau_steps += S->method->kind == RADAU;
    I->passages += S->around != 0;
    double *rate = T->start_rate;
    T->start_rate = T->end_rate;
    T->end_rate = rate;
    T->start_known &= S->s > 2;
    if (S->around) legendre_coefficients(I, S, S->K);
    T->last_h = h;
    T->last_s = S->s;
    memcpy(T->last_a, S->a, sizeof(double) * (size_t)(n * width));
    return keep(I, S) ? REACHED_END : OUT_OF_MEMORY;
}

static enum Code touched(Integrator *I) {
    I->worst = -1;
    return BRANCHES_TOUCH;
}

static enum Code failed_at(Integrator *I, enum Code code) {
    struct State *T = I->state;
    I->worst = -1;
    if (!rate_at(I, I->t, I->x, T->rate)) return INPUT_FAILED;
    double largest = -1;
    for (long i = 0; i < I->nx; i++) {
        if (!isfinite(T->rate[i]) || !isfinite(I->x[i])) {
            I->worst = i;
            return code == STEP_UNDERFLOW ? NON_FINITE : code;
        }
        double here = fabs(T->rate[i]) / T->scale[i];
        if (here > 2 * largest) largest = here, I->worst = i; /* the first of about equal ones: rounding names none */
    }
    return code;
}

#define MUCH_SOONER 0.1

/* A first step: a part of the time in which the motion changes much, from the rates at the start and a little later along them.
   Roots of size over change of rate, and rates over their change, are times whatever the unit. A state near zero may pretend to
   change quickly, hence a least step; what is too long is rejected. */
static int first_step(Integrator *I) {
    struct State *T = I->state;
    double span = I->end - I->t, time = INFINITY, soon = 1e-3 * span, order = (double)I->method_list[I->method].order;
    if (!rate_at(I, I->t, I->x, T->rate)) return 0;
    double *later = T->factor;
    for (int k = 0; k < 8; k++, soon = fmax(0.1 * time, 1e-3 * soon)) {
        for (long i = 0; i < I->nx; i++) T->before[i] = I->x[i] + soon * T->rate[i];
        if (!rate_at(I, I->t + soon, T->before, later)) return 0;
        time = INFINITY;
        for (long i = 0; i < I->nx; i++) {
            double bend = fabs(later[i] - T->rate[i]) / soon;
            double here = I->x[i] == 0 ? INFINITY : fmax(sqrt(fabs(I->x[i]) / bend), fabs(T->rate[i]) / bend);
            if (!(here >= time)) time = isfinite(bend) ? here : 0;
        }
        if (time >= 2 * soon) break;
    }
    T->sooner = power(1e-4 * I->rtol, 1 / (order + 1)) * time;
    I->h = fmin(0.01 * span, fmax(1e-6 * span, T->sooner));
    return 1;
}

/* A first step that failed, though rates had said that a much shorter one should be made: that one then, once. */
static int begins_sooner(Integrator *I, double h) {
    struct State *T = I->state;
    double sooner = T->sooner;
    if (I->steps > 0 || !(sooner > 0) || sooner > MUCH_SOONER * h) return 0;
    T->sooner = 0;
    I->h = T->planned = T->trusted = sooner;
    I->rejected++;
    return 1;
}

/* Step size for an error of one, by the smaller of the plain and the predictive controller (Gustafsson 1994). */
static double next_size(Integrator *I, double h, double error) {
    struct State *T = I->state;
    if (error == 0) return 4 * h;
    const Method *m = &I->method_list[I->method];
    double root = power(error, 1 / (double)(m->order + 1)), growth = (m->kind == RADAU ? TARGET : CAREFUL) / root;
    if (T->last_h > 0 && I->error > 0) growth = fmin(growth, growth * (h / T->last_h) * (T->error_root / root));
    T->error_root = root;
    return h * fmin(4.0, fmax(0.3, growth));
}

/* The size of a step at which the iteration converges as it is to, after one of size h. */
static double converging(const Integrator *I, double h, double contraction, int failed) {
    if (failed) return 0.7 * h;
    if (contraction == 0) return INFINITY;
    contraction = fmin(contraction, 1); /* it converged: more than that is said by first changes that are rounding */
    return I->copies && !I->state->newton_now ? h * sqrt(SQUARED / contraction) : h * PLAIN / contraction;
}

/* The next step size: as accuracy allows, and such that the iteration converges quickly. */
static void choose_size(Integrator *I, double h, double wanted, double contraction, int failed) {
    struct State *T = I->state;
    I->h = fmin(wanted, converging(I, h, contraction, failed));
    if (T->newton_now && !failed && I->h >= h && I->h < 1.2 * h) I->h = h; /* the factors serve again */
    if (T->newton_now) T->jacobian_fresh = contraction < 0.03;
}

/* Radau: more stages where Newton converges easily, fewer where it does not (Hairer and Wanner 1999). */
static void choose_order(Integrator *I, double contraction, int failed) {
    struct State *T = I->state;
    if (!I->adapt_order || T->since_switch++ < 10) return;
    long new = I->method;
    if (failed || contraction > 0.8) new--;
    else if (contraction < 0.002) new++;
    if (new < 0 || new >= I->methods || new == I->method || I->method_list[new].kind != RADAU) return;
    I->method = new;
    T->since_switch = 0;
    I->error = 0;
}

/* Solves the stage equations of a step of size h; 1 when converged, 0 when not, -1 when the input function failed. */
static int solve_stages(Integrator *I, Stages *S, double h, double tolerance, double *contraction) {
    struct State *T = I->state;
    set_scale(I, h, I->step > 0 ? h : fmax(T->planned, h));
    set_factor(I, h);
    T->end_known = 0;
    if (!stage_times(I, S, I->t, h) || !guess(I, S, h)) return -1;
    forget_surroundings(I, S);
    Judge J = new_judge(tolerance, rounding_floor(I, S, h), T->newton_now ? 15 : 50);
    int done = T->newton_now ? newton(I, S, h, I->x, &J) : fixed_point(I, S, h, I->x, &J);
    *contraction = J.contraction;
    T->change = J.change;
    T->grown = J.change / J.least;
    I->work += step_cost(I);
    T->straight = S->around;
    return done;
}

#define SOON 0.1     /* of a step: a little later */

#define MOSTLY 0.25  /* of a rate that is rounding */
#define ASTRAY 0.01  /* of their sizes: stages that are off by more are no states of the motion, and their rounding explains nothing in the next try */

/* That of a step around a singular position that all motions go straight through: along the branch, and across it beyond what rounding makes. */
static double error_around(Integrator *I, Stages *S, double h) {
    double along = has_exact(I) ? 0 : step_error_of(I, S, h);
    forgive_lengths(I, S);
    along = fmax(along, step_error_of(I, S, h));
    legendre_coefficients(I, S, S->K);
    double whole = step_error_of(I, S, h);
    legendre_coefficients(I, S, S->G);
    return fmax(along, whole);
}

/* The error of a step in units of its scale. Where it asks for shorter steps, what of it is rounding is looked at and forgiven, which no
   step size makes smaller; for as long as there is something to forgive. */
static double step_error(Integrator *I, Stages *S, double h) {
    struct State *T = I->state;
    int noisy = T->noisy;
    T->noisy = 0;
    if (S->around && I->through == STRAIGHT) return error_around(I, S, h);
    double near = beside_branches(I, S), error = fmax(near * step_error_of(I, S, h), missed_as_fast(I, S, h));
    if (!noisy && error <= S->calm) return error;
    sample_noise(I, S, 0, 0);
    for (long i = 0; i < I->nx; i++) T->scale[i] = fmax(T->scale[i], least_scale(I, i, h));
    if (S->around) { /* there only states that are nothing but rounding are forgiven */
        forget_noise(I);
        return near * step_error_of(I, S, h);
    }
    double left = fmax(near * step_error_of(I, S, h), missed_as_fast(I, S, h));
    T->unheard = left < 0.5 * error ? 0 : T->unheard + 1;
    if (!(left * I->rtol <= ASTRAY) || T->unheard > (noisy ? UNHEARD : 0)) forget_noise(I);
    return left;
}

#define ESCAPED 16 /* changes that grow by more are no rounding */

#define NO_MOTION 1e3 /* times what moves a state at the start of a step: so fast it moves in no stage that is near the motion */

/* Whether the rates of some stage are out of all proportion to the motion, of states that move or have moved: scales that grow with them do not show that they diverge. */
static int has_escaped(Integrator *I, const Stages *S, double h) {
    struct State *T = I->state;
    if (!rate_at(I, I->t, I->x, T->increment)) return 1;
    for (long i = 0; i < I->nx; i++) {
        double most = 0, moves = fabs(T->increment[i]) + T->size[i] / fabs(h);
        for (long b = 0; b < S->blocks; b++) most = fmax(most, v_largest(v_abs(S->K[b][i])));
        if (moves > 0 && most > NO_MOTION * moves) return 1;
    }
    return 0;
}

/* What rounding makes of the rates, sampled now, as a change of an iteration at most. */
static double change_by_rounding(Integrator *I, const Stages *S, double h) {
    sample_noise(I, S, 0, 0);
    return 2 * moved_by(I, I->state->noise, h) * sqrt((double)I->nx);
}

/* Whether the last change of an iteration is no more than rounding: how it contracts then says nothing. */
static int ends_in_rounding(Integrator *I, const Stages *S, double h) {
    double noise = change_by_rounding(I, S, h);
    forget_noise(I);
    return I->state->change < noise;
}

/* Whether an iteration that did not converge stopped at what rounding makes of the rates; it may be tried again, this being forgiven. Where it
   diverges, states are so large in the end that rounding would forgive whatever they are. */
static int stalls_on_rounding(Integrator *I, Stages *S, double h) {
    struct State *T = I->state;
    if (S->around || T->noisy || !(T->change < INFINITY) || T->grown > ESCAPED || has_escaped(I, S, h)) return 0;
    double noise = change_by_rounding(I, S, h);
    if (noise > LEFT && T->change < noise) return 1;
    forget_noise(I);
    return 0;
}

/* How long it takes until something other than rounding has changed (rates, and what rounding makes of these); the whole time, where nothing does. A slip that begins is soon
   many times what it is: rounding of its direction now says nothing of what it will be. */
static double pace_of(const Integrator *I, const double *rate, const double *noise) {
    double pace = INFINITY;
    for (long i = 0; i < I->nx; i++)
        if (FEW * noise[i] < SMALL * fabs(rate[i]) && I->state->size[i] > 0) pace = fmin(pace, (slips_turn(I) && i >= I->positions ? fabs(I->x[i]) : I->state->size[i]) / fabs(rate[i]));
    return pace < INFINITY ? pace : I->end - I->state->start;
}

/* What such states make of others until the motion has changed, these are worth no more than, too, if it is much of them: an attitude of a spin that is rounding. */
static int spread_rounding(Integrator *I, double reach) {
    struct State *T = I->state;
    double *rate = T->factor, *moved = T->increment;
    int some = 0;
    for (long i = 0; i < I->nx; i++) {
        T->before[i] = I->x[i] + (drawn(i) & 1 ? T->known[i] : -T->known[i]);
        some |= T->known[i] > 0;
    }
    if (!some) return 1;
    if (!rate_at(I, I->t, I->x, rate) || !rate_at(I, I->t, T->before, moved)) return 0;
    double until = fmin(SOON * pace_of(I, rate, T->most), reach), *size = T->forgotten;
    struct Sparse *S = &T->sparse;
    for (long i = 0; i < I->nx; i++) {
        moved[i] -= rate[i];
        size[i] = fmax(fabs(I->x[i]), T->known[i]);
    }
    int forgets = is_dear(I) || !make_forgetting(I) ? 0 : factor_forgetting(I, I->t, I->x, until, size, size + I->nx);
    if (forgets < 0) return 0;
    for (long i = 0; i < I->nx && forgets; i++) S->re[i] = v_all(moved[i]), S->im[i] = v_all(0.0);
    if (forgets) solve_sparse(I, &T->forgetting);
    for (long i = 0; i < I->nx; i++) {
        double change = until * fabs(forgets ? S->re[I->nx + i][0] : moved[i]);
        if (T->size[i] > 0 && change > SMALL * T->size[i] && change > T->known[i] && isfinite(change)) T->known[i] = change;
    }
    return 1;
}

static int rows_at(Integrator *I, double t, const double *x);
static double rounding_of_row(const Integrator *I, long i);
static int has_corner(const Integrator *I, long row);

#define UNTIL 1e-3    /* of a step: what a row does then says when it comes to zero; and of that, where it does not fall */
#define CLEARLY 16    /* roundings of a row, which a fall is that says so */
#define NEARINGS 3    /* times that it is looked for */
#define ENDINGS 3     /* tries to end a step there */
#define SHORT_OF 0.05 /* of the way, each of these but the first ends that much before */

/* How long it takes until the first row comes to zero as it does now, seen from a step of size h, and which one, into `row`; infinite, where none falls: beyond it
   rates are those of nothing that will be, steps into it do not converge, and rounding there is that of anything. Negative when the input function failed. */
static double until_a_switch(Integrator *I, double h, long *row) {
    struct State *T = I->state;
    double *rate = T->most, *value = T->row_values, soonest = INFINITY;
    if (!I->row_count || I->directions) return INFINITY;
    if (!rate_at(I, I->t, I->x, rate) || !rows_at(I, I->t, I->x)) return -1;
    for (long r = 0; r < I->row_count; r++) value[r] = T->changed_at == I->t && T->one_row[r] <= T->row_noise[r] ? 0 : T->one_row[r]; /* what has just been let go is not to be met */
    for (int tries = 0; tries < NEARINGS; tries++) { /* as seen from where it is to come to zero: beyond that it does something else */
        double found = INFINITY;
        long falls_first = -1;
        for (long i = 0; i < I->nx; i++) T->before[i] = I->x[i] + UNTIL * h * rate[i];
        if (!rows_at(I, I->t + UNTIL * h, T->before)) return -1;
        for (long r = 0; r < I->row_count; r++) {
            double fall = value[r] - T->one_row[r], lasts = value[r] / fall * UNTIL * h;
            if (value[r] > 0 && fall > CLEARLY * T->row_noise[r] && lasts < found) found = lasts, falls_first = r;
        }
        if (found < INFINITY) soonest = found, *row = falls_first; /* what is nearer says more */
        h = found < h ? found : UNTIL * h;
    }
    return soonest;
}

#define SLACKENS 16 /* times the slip: by more than that one Jacobian tells nothing of its direction, not even how badly */

/* How many times too long a step of size h is for slips that begin, by what they are at its end. Negative when the input function failed. */
static double outgrown(Integrator *I, double h) {
    struct State *T = I->state;
    double *value = T->row_values, most = 1;
    if (!rows_at(I, I->t, I->x)) return -1;
    memcpy(value, T->one_row, sizeof(double) * (size_t)I->row_count);
    for (long i = 0; i < I->nx; i++) T->before[i] = I->x[i] + T->increment[i];
    if (!rows_at(I, I->t + h, T->before)) return -1;
    for (long r = 0; r < I->row_count; r++)
        if (has_corner(I, r) && value[r] > 0) most = fmax(most, T->one_row[r] / value[r]);
    return (sqrt(most) - 1) / (sqrt(SLACKENS) - 1);
}

#define SHORTENINGS 60
#define ELSEWHERE 10 /* times their sizes */

/* The states a little later, T->before, at the rates T->increment. Of a first step nobody knows how long it may be: then only so much later as the rates of now,
   T->factor, do not lead far away from where they would be then. Where they are no states of the motion any more rounding is that of anything. `found` (nx): what
   rounding makes of rates, of which only clear ones are asked. */
static int goes_ahead(Integrator *I, double *ahead, const double *found) {
    struct State *T = I->state;
    for (int tries = 0;; tries++, *ahead *= 0.25) {
        int same = 1;
        for (long i = 0; i < I->nx; i++) T->before[i] = I->x[i] + *ahead * T->increment[i];
        if (I->steps > 0 || tries == SHORTENINGS) return 1;
        if (!rate_at(I, I->t + *ahead, T->before, T->rate)) return 0;
        for (long i = 0; i < I->nx; i++)
            if (T->size[i] > 0 && FEW * found[i] < SMALL * fabs(T->factor[i]) && *ahead * fabs(T->rate[i] - T->factor[i]) > ELSEWHERE * T->size[i]) same = 0;
        if (same) return 1;
    }
}

#define NEIGHBOURS 16 /* how far it is followed what states that are nothing but rounding make of others */

/* Where steps are rejected again and again, states may be nothing but rounding, which disturbing them does not show: at rest in zero,
   or in an equilibrium. 1 where that explains it, -1 when the input function failed. */
static int rests_on_rounding(Integrator *I, const Kernel *disturbed, double h, double reach, int beside) {
    struct State *T = I->state;
    double *found = T->most, *rate = T->factor, *there = T->apart;
    int explains = 0, more = 1;
    memcpy(T->before, I->x, sizeof(double) * (size_t)I->nx);
    double ahead = SOON * h;
    for (int later = 0; later < 2 || (more && later < NEIGHBOURS); later++) { /* a little later states are looked at that are zero at first */
        double t = I->t + (later ? ahead : 0);
        more = 0;
        if (!rate_at(I, t, T->before, rate) || !rounding_of_rates(I, disturbed, t, T->before, h, found)) return -1;
        if (later && !rate_at(I, t, there, T->rate)) return -1;
        double until = later ? 0 : fmin(SOON * pace_of(I, rate, found), reach);
        for (long i = 0; i < I->nx; i++) {
            /* what is a product of others is known as badly as these are */
            double noise = FEW * found[i] + (later && T->size[i] == 0 ? fabs(rate[i] - T->rate[i]) : 0);
            /* what nothing but rounding moves is worth no more than what that makes of it until the motion is another: short steps do not show that */
            if (!beside && noise > MOSTLY * fabs(rate[i]) && until * noise > fmax(fmax(T->unit, SMALL) * T->size[i], 2 * T->known[i]) && isfinite(noise) && T->size[i] > 0) {
                T->known[i] = until * noise;
                explains = 1;
            }
            int is_noise = T->size[i] > 0 ? h * noise > fmax(T->unit, SMALL) * T->size[i] : later && noise > SMALL * fabs(rate[i]);
            if (noise > T->least[i] && is_noise && isfinite(noise) && !(beside && T->size[i] > 0)) {
                T->least[i] = 2 * noise;
                explains = more = 1;
            }
            T->increment[i] = rate[i] + (isfinite(noise) ? drawn(i) & 1 ? noise : -noise : 0);
        }
        if (!later && !goes_ahead(I, &ahead, found)) return -1;
        for (long i = 0; i < I->nx; i++) {
            if (later) T->before[i] = there[i] + (drawn(i) & 1 ? ahead : -ahead) * T->least[i];
            else there[i] = I->x[i] + ahead * rate[i];
        }
    }
    if (!beside && !spread_rounding(I, reach)) return -1;
    T->doubts = 0;
    if (explains && !I->row_count) T->shortest = INFINITY; /* near the end of a mode a long step is to reach beyond it */
    T->patience = explains ? DOUBTS : T->patience < 1000 ? 2 * T->patience : T->patience;
    if (explains) forget_noise(I);
    return explains;
}

#define AGAIN 4 /* times a step that rounding explains, the next try */
#define LONGER 2 /* times the shortest step since rounding was looked at: what it was beside a singular position is not what it is now */

/* Rounding of rates, looked at again for steps of size h: what has become less is allowed less; a state that is nothing but rounding stays so.
   0 when the input function failed. */
static int listen(Integrator *I, double h) {
    struct State *T = I->state;
    const Kernel *disturbed = disturbed_kernel(I, 0);
    double *found = T->most;
    int left = 0;
    if (!disturbed) return 1;
    if (!rounding_of_rates(I, disturbed, I->t, I->x, h, found)) return 0;
    for (long i = 0; i < I->nx; i++) {
        if (T->size[i] > 0 && isfinite(found[i])) T->least[i] = fmin(T->least[i], 2 * FEW * found[i]);
        left |= T->least[i] > 0;
    }
    T->shortest = left ? h : 0;
    forget_noise(I);
    return 1;
}

/* The same after a step of size h, where steps become longer. */
static int listen_again(Integrator *I, double h) {
    struct State *T = I->state;
    if (T->shortest > 0 && h > LONGER * T->shortest) return listen(I, h);
    T->shortest = fmin(T->shortest, h);
    return 1;
}

/* The same where rates have jumped: rounding of a contact says nothing of the flight that follows. */
static int listen_after_jump(Integrator *I) {
    struct State *T = I->state;
    double shortest = T->shortest, most = 0;
    T->jumped = 0;
    for (long i = 0; i < I->nx; i++) most = fmax(most, T->least[i]);
    if (!(most > 0)) return 1;
    int known = listen(I, I->h);
    T->shortest = shortest;
    return known;
}

/* States at zero that are reached only through others at zero move as a high power of the step, of which no step size resolves a part. What
   the errors that others may have move such a state by in a step of size h is allowed to it, too, from neighbour to neighbour: less where it is held
   back by what depends on itself (`own`, with states that are reached at the same time moved either way), as implicit steps see it. Otherwise what
   is stiff were allowed more and more from neighbour to neighbour. 1 where there is such a state, -1 when the input function failed. */
static int follows_others(Integrator *I, double h) {
    struct State *T = I->state;
    double *allowed = T->most, *rate = T->factor, *moved = T->increment, *again = T->rate; /* allowed: minus what a state is moved by that is reached now */
    int explains = 0, reached = 1;
    if (!rate_at(I, I->t, I->x, rate)) return -1;
    for (long i = 0; i < I->nx; i++) allowed[i] = T->unit * T->size[i];
    for (long sweep = 0; reached && sweep < I->nx; sweep++) {
        reached = 0;
        for (long i = 0; i < I->nx; i++) T->before[i] = I->x[i] + allowed[i];
        if (!rate_at(I, I->t, T->before, moved)) return -1;
        for (long i = 0; i < I->nx; i++) {
            double change = fabs(h * (moved[i] - rate[i]));
            if (allowed[i] == 0 && change > 0 && change < INFINITY) allowed[i] = -change, reached = 1;
            T->before[i] = I->x[i] + (allowed[i] < 0 && drawn(i) & 1 ? -allowed[i] : allowed[i]);
        }
        if (!reached) break;
        if (!rate_at(I, I->t, T->before, again)) return -1;
        for (long i = 0; i < I->nx; i++) {
            if (!(allowed[i] < 0)) continue;
            double own = 0.5 * fabs(h * (again[i] - moved[i]) / allowed[i]);
            allowed[i] = -allowed[i] / (PART + (own < INFINITY ? own : 0));
        }
    }
    for (long i = 0; i < I->nx; i++) {
        double least = LEFT * allowed[i] / fabs(h);
        if (T->size[i] == 0 && least > T->least[i]) T->least[i] = least, explains = 1;
    }
    if (explains) {
        T->doubts = 0;
        T->patience = DOUBTS;
        forget_noise(I);
    }
    return explains;
}

#define STRAINED 0.25 /* of the step that accuracy allows */
#define SHRUNK 0.5    /* of a step that is accurate, the next one */
#define SUSPECT 3     /* rejections that a step counts as, where rounding is known to disturb it */
#define INSTANT 1e-9 /* of a step: no time passes */
#define LANDED 2000 /* tries of one step to end at a switch */

/* Where a step is to end so that a switch goes over there; see switches.h. */
struct Landing {
    long row, tries, total; /* of the switch, -1: none is known; tries to meet it, places tried */
    int over, coarse, others_coarse, dips; /* whether it goes over at the end of the step; whether it, and others, were looked for only as well as the inside of a step was known; whether it does so
        where the step begins, and has come back at its end */
    double planned, slope, off; /* size of the step without it; slope of the row [1/s]; the part of the step that the last try was off by */
};
static double landing(Integrator *I, const Stages *S, double h, struct Landing *L);
static enum Code go_over(Integrator *I, const struct Landing *L);
static enum Code decide_here(Integrator *I);
static int jams(Integrator *I, double planned);
static int changes_modes(const Integrator *I);
static enum Code part_rows(Integrator *I, const Stages *S, double h, double *part);

/* After a step, at the end of which a switch may go over. */
static enum Code finish_step(Integrator *I, const struct Landing *L) {
    struct State *T = I->state;
    if (I->held && !(T->last_h < INSTANT * L->planned)) memset(T->overs, 0, sizeof(long) * (size_t)I->held);
    if (L->row < 0 || !L->over) return REACHED_END;
    return go_over(I, L);
}

/* The step begins where a switch goes over. */
static enum Code switch_now(Integrator *I, struct Landing *L) {
    enum Code code = go_over(I, L);
    double t = I->t;
    L->row = -1;
    if (code == REACHED_END) code = decide_here(I);
    return code == REACHED_END && I->block && I->t > t ? PAUSED : code; /* what has been bridged is read before the next step */
}

/* Which part of a step of size h is to be made, so that it ends at a switch: 1 all of it, 0 none, since the step begins there, and has gone over. */
static enum Code land(Integrator *I, Stages *S, double h, struct Landing *L, double *part) {
    I->state->lands = 1;
    *part = landing(I, S, h, L);
    I->state->lands = 0;
    if (*part < 0) return *part == -2 ? FALLS : INPUT_FAILED;
    if (*part == 1 && changes_modes(I)) {
        enum Code code = part_rows(I, S, h, part);
        if (*part != 1) L->row = -1;
        return code;
    }
    return *part > 0 ? REACHED_END : switch_now(I, L);
}

/* The next try, after a step of size h of that error. */
static void shorten(Integrator *I, const Stages *S, double h, double error) {
    double growth = error < INFINITY ? 0.65 * power(error, -1 / (double)(S->method->order + 1)) : 0.1;
    I->h = h * fmin(0.9, fmax(0.15, growth));
    I->rejected++;
    I->state->jacobian_fresh = I->state->jacobian_time == I->t;
}

/* Whether a step that passes a singular position closely is to be tried again but a little shorter: none of its stages may be as near then. */
static int takes_other_stages(Integrator *I, const Stages *S, double h, int *avoided, int *refused) {
    if (!S->exact || *avoided >= AVOIDED) return 0;
    I->h = 0.95 * h;
    I->rejected++;
    ++*avoided, --*refused;
    return 1;
}

static enum Code one_adaptive(Integrator *I) {
    struct State *T = I->state;
    int ends = 0, failed = 0, misses = 0, tries = 0, avoided = 0, asked = 0, landings = 0, refused = -1;
    long doubts = T->doubts;
    T->drift_known = 0;
    struct Landing L = {.row = -1};
    if (I->max_step > 0) I->h = fmin(I->h, I->max_step);
    double first = fmin(I->h, I->end - I->t);
    if (!T->missed || first > T->planned) T->planned = first; /* near a jump steps stay small: states are sized by those before */
    if (T->doubts == 0) T->trusted = I->h;
    if (T->settling && I->method == 0) turn_to_newton(I, some_radau(I), I->h);
    for (;;) {
        if (T->newton_now && !present(&I->jvp)) return NEEDS_JACOBIAN;
        if (T->jumped && !listen_after_jump(I)) return INPUT_FAILED;
        if (T->costs.undecided && !choose_newton(I, I->h)) return INPUT_FAILED;
        Stages *S = stages_of(I);
        if (!S) return OUT_OF_MEMORY;
        double spent = I->work;
        if (++refused) T->doubts += CALM;
        if (T->doubts >= CALM * T->patience) {
            const Kernel *disturbed = disturbed_kernel(I, 0);
            first = fmin(fmax(T->trusted, I->h), I->end - I->t);
            double reach = until_a_switch(I, first, &(long){-1});
            int follows = reach < 0 ? -1 : follows_others(I, fmin(first, reach));
            int rests = disturbed && follows >= 0 ? rests_on_rounding(I, disturbed, fmin(first, reach), reach, is_continued(I, S)) : 0;
            if (follows < 0 || rests < 0) return INPUT_FAILED;
            if (follows || rests) I->h = rests && !follows && !I->row_count ? fmin(first, AGAIN * I->h) : first;
            ends = 0;
        }
        double planned = I->h, h = fmin(I->h, I->end - I->t), contraction;
        if (I->max_step > 0) h = fmin(h, I->max_step);
        if (L.row < 0 && I->end - I->t - h < (I->max_step > 0 ? 1e-9 : 1e-3) * h) h = I->end - I->t;
        if (h <= 16 * EPS * fmax(fabs(I->t), fabs(I->end) * 1e-12) || (refused > 0 && is_lost(I, S, h))) {
            return jams(I, first) ? one_adaptive(I) : failed_at(I, STEP_UNDERFLOW); /* steps that led here say nothing of the next */
        }
        int old = T->newton_now && T->jacobian_fresh && T->jacobian_time != I->t;
        if (T->newton_now && !refresh_jacobian(I)) return INPUT_FAILED;
        int solved = solve_stages(I, S, h, LEFT, &contraction);
        if (solved < 0) return INPUT_FAILED;
        if (T->touching) return touched(I);
        if (!solved) {
            T->jacobian_fresh = T->jacobian_time == I->t;
            L.row = -1;
            if (old) continue; /* again with a new Jacobian */
            if (begins_sooner(I, h)) continue;
            if (!T->newton_now && leave_fixed_point(I, S, 0, 0, T->planned, I->work - spent)) {
                if (I->steps == 0 && !first_step(I)) return INPUT_FAILED;
                return present(&I->jvp) ? one_adaptive(I) : NEEDS_JACOBIAN; /* the step begins anew, whoever had the kernel */
            }
            double until = ends++ < ENDINGS ? until_a_switch(I, h, &L.row) : h;
            if (until < 0) return INPUT_FAILED;
            if (L.row >= 0 && until <= at_once(I) && T->changed_at != I->t) {
                L.planned = fmax(I->h, h);
                enum Code code = switch_now(I, &L);
                if (code != REACHED_END) return code;
                refused = -1;
                continue;
            }
            L.row = -1;
            if (until < h) {
                I->h = (1 - SHORT_OF * (ends - 1)) * until;
                T->planned = fmin(T->planned, I->h);
                T->doubts = doubts;
                forget_noise(I);
                I->rejected++;
                refused = -1;
                continue;
            }
            if (!asked++ && stalls_on_rounding(I, S, h)) continue;
            /* where it converged well until now, something local is in the way: other nodes may miss it */
            I->h = (I->contraction < 0.1 && tries++ < 4 ? 0.85 : 0.4) * h;
            T->planned = fmin(T->planned, I->h);
            I->rejected++;
            failed = 1;
            choose_order(I, 1, 1);
            continue;
        }
        legendre_coefficients(I, S, S->around ? S->G : S->K);
        step_increments(I, S);
        double times = T->settling ? outgrown(I, h) : 0;
        if (times < 0) return INPUT_FAILED;
        if (times > 1) {
            L.row = -1;
            I->h = h / times;
            I->rejected++;
            continue;
        }
        double error = step_error(I, S, h);
        if (!(error <= 1)) {
            L.row = -1;
            if (begins_sooner(I, h)) continue;
            if (S->around && takes_other_stages(I, S, h, &avoided, &refused)) continue;
            shorten(I, S, h, error);
            if (++misses > 1 && S->around && I->through == STRAIGHT) made_exact(I);
            continue;
        }
        if (leaves_branch(I, S)) {
            I->h = 0.4 * h;
            I->rejected++;
            continue;
        }
        if (avoided < AVOIDED && is_awkward(I, S, h)) {
            I->h = 0.8 * h;
            I->rejected++;
            avoided++;
            refused--;
            continue;
        }
        int kink = S->s > 2 ? hides_kink(I, S, h, misses > 0) : 0;
        if (kink < 0) return INPUT_FAILED;
        if (kink) {
            if (takes_other_stages(I, S, h, &avoided, &refused)) continue;
            if (T->noisy) T->doubts += CALM * SUSPECT; /* nor is what is no kink */
            I->h = 0.3 * h;
            I->rejected++;
            misses++;
            continue;
        }
        if (I->row_count) {
            double part;
            enum Code code = land(I, S, h, &L, &part);
            if (code != REACHED_END) return code;
            if (part != 0 && part != 1) {
                I->h = part * h;
                if (L.row >= 0) T->planned = fmin(T->planned, I->h);
            }
            if (part != 1) {
                if (++landings > LANDED) return CHATTERS; /* a row that is zero all along */
                refused--;
                continue;
            }
        }
        if (I->directions && !solve_variations(I, S, h)) {
            T->jacobian_fresh = T->jacobian_time == I->t;
            if (old) {
                I->h = h;
                continue;
            }
            if (takes_other_stages(I, S, h, &avoided, &refused)) continue;
            I->h = 0.5 * h;
            I->rejected++;
            failed = 1;
            continue;
        }
        error = error_of_variations(I, S, h, error);
        if (!(error <= 1)) {
            shorten(I, S, h, error);
            continue;
        }
        if (I->directions && I->asked) {
            int told = tell_inside(I, S, h);
            if (told < 0) return INPUT_FAILED;
            if (!told) {
                I->end = next_asked(I);
                I->h = planned;
                L.row = -1;
                refused--;
                continue;
            }
        }
        if (S->around) I->error = 0; /* rounding makes errors jump there: how they grow from step to step says nothing */
        double wanted = next_size(I, h, error);
        if (T->newton_now && slips_turn(I) && !T->noisy && !failed && converging(I, h, contraction, 0) < STRAINED * wanted && ends_in_rounding(I, S, h)) contraction = 0;
        I->error = error;
        I->contraction = contraction;
        T->missed = misses > 0;
        if (T->noisy && !failed && converging(I, h, contraction, 0) < STRAINED * wanted) T->doubts += CALM * SUSPECT; /* what does not contract may be rounding */
        enum Code accepted = accept_step(I, S, h);
        if (accepted != REACHED_END) return accepted;
        if (creeps(I, S)) return touched(I);
        if (!listen_again(I, h)) return INPUT_FAILED;
        choose_size(I, h, wanted, contraction, failed);
        if (S->method->kind == RADAU) choose_order(I, contraction, failed);
        if (T->settling) let_settle(I, h);
        else if (is_steep(I, S, failed || wanted > 2 * I->h)) begin_weighing(I);
        else if (!T->newton_now) leave_fixed_point(I, S, h, converging(I, h, contraction, failed), wanted, I->work - spent);
        else if (!review_newton(I, S, h)) return INPUT_FAILED;
        if (!failed && h < planned) I->h = fmax(I->h, planned); /* it was cut by the end only */
        if (T->noisy || wanted < SHRUNK * h) T->doubts += CALM / 2; /* rounding that is heard of for long, or makes errors now and then and steps too short to grow, may be all that there is */
        else if (!refused && T->doubts > 0) T->doubts--;
        return finish_step(I, &L);
    }
}

static enum Code one_fixed(Integrator *I) {
    struct State *T = I->state;
    Stages *S = stages_of(I);
    if (!S) return OUT_OF_MEMORY;
    double h = fmin(I->step, I->end - I->t), contraction;
    if (I->end - I->t - h < 1e-9 * h) h = I->end - I->t;
    struct Landing L = {.row = -1};
again:;
    int solved = 0;
    if (T->newton_now) {
        T->jacobian_fresh = 0;
        if (!refresh_jacobian(I)) return INPUT_FAILED;
        solved = solve_stages(I, S, h, 0.0, &contraction);
    }
    if (!solved) {
        int before = T->newton_now;
        T->newton_now = 0;
        solved = solve_stages(I, S, h, 0.0, &contraction);
        T->newton_now = before;
    }
    if (!solved && I->newton == WHERE_SLOW && !T->newton_now) {
        if (!present(&I->jvp)) return NEEDS_JACOBIAN;
        T->newton_now = 1;
        T->jacobian_fresh = 0;
        if (!refresh_jacobian(I)) return INPUT_FAILED;
        solved = solve_stages(I, S, h, 0.0, &contraction);
        if (solved > 0) I->newton_steps++;
        T->newton_now = 0;
    }
    if (solved < 0) return INPUT_FAILED;
    if (I->state->touching) return touched(I);
    if (!solved) {
        enum Code code = failed_at(I, STEP_UNDERFLOW);
        return code == STEP_UNDERFLOW ? NOT_CONVERGED : code;
    }
    legendre_coefficients(I, S, S->K);
    step_increments(I, S);
    if (leaves_branch(I, S)) return NOT_CONVERGED;
    if (I->row_count) {
        double part;
        enum Code code = land(I, S, h, &L, &part);
        if (code != REACHED_END) return code;
        if (part != 0) h *= part;
        if (part != 1) goto again;
    }
    if (I->directions && !solve_variations(I, S, h)) return NOT_CONVERGED;
    enum Code accepted = accept_step(I, S, h);
    return accepted == REACHED_END ? finish_step(I, &L) : accepted;
}
