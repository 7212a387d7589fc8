/* Modes: which rows of reactions hold. Masks are inputs that are held while a step is taken; its guards are rows of switches.h, so steps end where one of
   them becomes negative. Then all rows are decided together, from what `decision` gives at that place, in this order, row by row:

   gaps (one_sided); rates of gaps, slips (n = one_sided + frictions); accelerations of both without reactions (n); W (n, n): accelerations by
   reactions; J (nx, n): x' by reactions; limits of sticking, without reactions (frictions) and by reactions (frictions, n); those of sliding likewise;
   restitution (one_sided).

   First impacts, where a gap that is closed closes with speed: Poisson's, in two phases (Glocker and Pfeiffer, Nonlinear Dynamics 7, 1995). In both, and then
   for accelerations, reactions and what they hold are complementary: 0 <= reaction, 0 <= rate, one of them zero; friction at most its limit, and against
   the slip. Lemke's method solves that; with units in which the diagonal of W is one. Accelerations are looked at a little later, where
   what is exactly at its threshold has passed it. */

#define TOUCHES 16.0   /* roundings within which gaps are closed and slips are zero */
#define LATER 1e-6     /* of a step: where accelerations are looked at */
#define CHANGES 40     /* of mode in one instant, which tell that no mode lasts */
#define NIL 1e-11      /* of the largest: a reaction or an acceleration that is zero */

static int make_modes(Integrator *I) {
    struct State *T = I->state;
    long n = I->one_sided + I->frictions, most = I->one_sided + 2 * I->frictions, width = 2 * most + 2;
    if (!arranged(I, &I->decision, &T->decision_in, &T->decision_out, &T->decision_c, 1 + I->nx + I->nu)) return 0;
    if (!I->counted) give_inputs(I, T->decision_in);
    T->decided = reserve_doubles(I, I->decision.outputs);
    T->decided_noise = reserve_doubles(I, I->decision.outputs);
    T->lemke = reserve_doubles(I, most * width + width);
    T->impulse = reserve_doubles(I, n);
    T->push = reserve_doubles(I, 6 * n + most);
    T->guess_x = reserve_doubles(I, I->nx + 1);
    T->near_knot = reserve_doubles(I, I->one_sided + n);
    T->basis = reserve(I, sizeof(long) * (size_t)(2 * most + 2));
    T->status = reserve(I, sizeof(long) * (size_t)(4 * n + 1));
    return I->counted || (T->decided && T->decided_noise && T->lemke && T->impulse && T->push && T->guess_x && T->near_knot && T->basis && T->status);
}

/* What is decided by, at one place. */
typedef struct {
    long n, gaps, frictions;
    const double *gap, *rate, *free, *W, *J, *hold, *hold_by, *slide, *slide_by, *bounce;
    const double *gap_noise, *rate_noise;
} Decision;

/* At (t, x) with the masks there are, and what rounding makes of gaps and rates. 0 when the input function failed. */
static int decision_at(Integrator *I, double t, const double *x, Decision *D) {
    struct State *T = I->state;
    V *in = T->decision_in;
    long gaps = I->one_sided, m = I->frictions, n = gaps + m, first = gaps + n;
    for (long o = 0; o < first; o++) T->decided_noise[o] = 0;
    for (long from = 0; from < COUNTED; from += LANES) {
        for (long l = 0; l < LANES; l++)
            for (long i = -1; i < I->nx; i++) {
                double value = i < 0 ? t : x[i], unit = from + l > 0 ? EPS * (i < 0 ? fabs(t) : fmax(T->size[i], fabs(x[i]))) : 0;
                in[1 + i][l] = value + unit * ((double)(drawn((from + l) * (I->nx + 1) + i) >> 29) / 2 - 1.75);
            }
        if (!inputs_at(I, in[0], LANES, in + 1 + I->nx)) return 0;
        run_kernel(&I->decision, in, T->decision_c, T->decision_out, T->work);
        if (from == 0)
            for (long o = 0; o < I->decision.outputs; o++) T->decided[o] = T->decision_out[o][0];
        for (long o = 0; o < first; o++)
            for (long l = 0; l < LANES; l++) {
                double change = fabs(T->decision_out[o][l] - T->decided[o]);
                if (change < INFINITY) T->decided_noise[o] = fmax(T->decided_noise[o], TOUCHES * change);
            }
    }
    const double *at = T->decided;
    *D = (Decision){.n = n, .gaps = gaps, .frictions = m, .gap = at, .gap_noise = T->decided_noise, .rate_noise = T->decided_noise + gaps};
    D->rate = at + gaps;
    D->free = D->rate + n;
    D->W = D->free + n;
    D->J = D->W + n * n;
    D->hold = D->J + I->nx * n;
    D->hold_by = D->hold + m;
    D->slide = D->hold_by + m * n;
    D->slide_by = D->slide + m;
    D->bounce = D->slide_by + m * n;
    return 1;
}

/* What rows are just before inputs jump, at time t: what holds is known to the tolerance only, but how far it jumps to rounding. */
static int look_before_knot(Integrator *I, double t) {
    struct State *T = I->state;
    Decision D;
    if (!decision_at(I, t, I->x, &D)) return 0;
    memcpy(T->near_knot, D.gap, sizeof(double) * (size_t)(D.gaps + D.n));
    T->crossed = 1;
    return 1;
}

/* Whether gap or rate `k` has jumped at the knot that has just been crossed. */
static int has_jumped(Integrator *I, const Decision *D, long k) {
    return I->state->crossed && fabs(D->gap[k] - I->state->near_knot[k]) > 16 * D->gap_noise[k] + NIL * fabs(D->gap[k]);
}

/* A linear complementarity problem w = M z + q, w, z >= 0, one of each pair zero, by Lemke's method with the lexicographic rule. `table` (n, 2 n + 2): columns of w
   (-> 1), z (-M), the covering variable (-1) and q. `basis` (n): number of the variable of each row; z k is n + k. 1 where solved, 0 where there is no
   solution on the way. */
static int lemke(double *table, long *basis, long n) {
    long width = 2 * n + 2, cover = 2 * n, last = 2 * n + 1, row = -1;
    double least = 0;
    for (long i = 0; i < n; i++) {
        basis[i] = i;
        if (table[i * width + last] < least) least = table[i * width + last], row = i;
    }
    if (row < 0) return 1;
    long entering = cover;
    for (long steps = 0; steps < 50 * (n + 1); steps++) {
        double *p = table + row * width, pivot = p[entering];
        for (long j = 0; j < width; j++) p[j] /= pivot;
        for (long i = 0; i < n; i++) {
            double factor = table[i * width + entering];
            if (i == row || factor == 0) continue;
            for (long j = 0; j < width; j++) table[i * width + j] -= factor * p[j];
            table[i * width + entering] = 0;
        }
        long left = basis[row];
        basis[row] = entering;
        if (left == cover) return 1;
        entering = left < n ? left + n : left - n;
        row = -1;
        for (long i = 0; i < n; i++) {
            double a = table[i * width + entering];
            if (!(a > 1e-12)) continue;
            if (row < 0) {
                row = i;
                continue;
            }
            double b = table[row * width + entering];
            double here = table[i * width + last] / a, there = table[row * width + last] / b, tie = 1e-13 * (fabs(here) + fabs(there));
            int less = here < there - tie, more = here > there + tie;
            if (!less && !more && basis[row] == cover) more = 1; /* the covering variable leaves first */
            if (!less && !more && basis[i] == cover) less = 1;
            for (long j = 0; j < n && !less && !more; j++) {
                here = table[i * width + j] / a, there = table[row * width + j] / b;
                less = here < there, more = here > there;
            }
            if (less) row = i;
        }
        if (row < 0) return 0;
    }
    return 0;
}

enum Row { OFF, IN, SLIDING_UP, SLIDING_DOWN, STICKS }; /* of a row in a problem: not at all, may hold; friction with slip of a sign; friction that holds */

/* Complementary reactions of the rows that are IN, by `start` (n): their rates or accelerations without. `constants`: whether limits count that do not grow with
   reactions; `floor` (gaps): least reactions, or null. Reactions into `push` (n); STICKS, or where slip begins, into `row`. `worst`: of a failure. */
static int complementary(Integrator *I, const Decision *D, long *row, const double *start, int constants, const double *floor, double *push, long *worst) {
    struct State *T = I->state;
    long n = D->n, gaps = D->gaps, in = 0, held = 0, *place = T->status + 3 * n;
    double *unit = T->push + 4 * n;
    for (long i = 0; i < n; i++) {
        unit[i] = 1 / sqrt(D->W[i * n + i]);
        place[i] = -1;
        push[i] = floor && i < gaps ? floor[i] : 0;
    }
    for (long i = 0; i < gaps; i++)
        if (row[i] == IN) place[i] = in++;
    for (long i = gaps; i < n; i++)
        if (row[i] == IN) place[i] = in + held++;
    long size = in + 2 * held, width = 2 * size + 2;
    double *table = T->lemke, *line = T->lemke + size * width;
    memset(table, 0, sizeof(double) * (size_t)(size * width));
    /* each reaction by the unknowns: a one-sided one is its own, above its floor; friction p - limit, or against its slip */
    for (long i = 0; i < n; i++) {
        if (place[i] < 0) continue;
        double q = start[i] * unit[i];
        memset(line, 0, sizeof(double) * (size_t)(in + held));
        for (long j = 0; j < n; j++) {
            double w = D->W[i * n + j] * unit[i];
            if (j < gaps) {
                q += w * push[j];
                if (place[j] >= 0) line[place[j]] += w * unit[j];
                continue;
            }
            if (place[j] >= 0) line[place[j]] += w * unit[j];
            double sign = place[j] >= 0 || row[j] == SLIDING_UP ? -1 : row[j] == SLIDING_DOWN ? 1 : 0;
            if (sign == 0) continue;
            long f = j - gaps;
            const double *by = (place[j] >= 0 ? D->hold_by : D->slide_by) + f * n;
            double limit = constants ? (place[j] >= 0 ? D->hold : D->slide)[f] : 0;
            for (long k = 0; k < gaps; k++) {
                limit += by[k] * push[k];
                if (place[k] >= 0) line[place[k]] += w * sign * by[k] * unit[k];
            }
            q += w * sign * limit;
        }
        long r = place[i];
        double *first = table + r * width;
        first[r] = 1;
        for (long k = 0; k < in + held; k++) first[size + k] = -line[k];
        if (i >= gaps) first[size + r + held] = -1;
        first[2 * size] = -1;
        first[2 * size + 1] = q;
        if (i < gaps) continue;
        double *second = table + (r + held) * width;
        const double *by = D->hold_by + (i - gaps) * n;
        double limit = constants ? D->hold[i - gaps] : 0;
        for (long k = 0; k < gaps; k++) {
            limit += by[k] * push[k];
            if (place[k] >= 0) second[size + place[k]] -= 2 * by[k] * unit[k] / unit[i];
        }
        second[r + held] = 1;
        second[size + r] = 1;
        second[2 * size] = -1;
        second[2 * size + 1] = 2 * limit / unit[i];
    }
    if (size && !lemke(table, T->basis, size)) {
        for (long i = 0; i < n; i++)
            if (place[i] >= 0) *worst = i;
        return 0;
    }
    double *z = line;
    memset(z, 0, sizeof(double) * (size_t)(in + held));
    for (long r = 0; r < size; r++)
        if (T->basis[r] >= size && T->basis[r] < size + in + held) z[T->basis[r] - size] = table[r * width + 2 * size + 1];
    for (long i = 0; i < gaps; i++)
        if (place[i] >= 0) push[i] += fmax(z[place[i]], 0) * unit[i];
    for (long i = gaps; i < n; i++) {
        long f = i - gaps;
        int sticking = place[i] >= 0;
        if (!sticking && row[i] != SLIDING_UP && row[i] != SLIDING_DOWN) continue;
        const double *by = (sticking ? D->hold_by : D->slide_by) + f * n;
        double limit = constants ? (sticking ? D->hold : D->slide)[f] : 0;
        for (long k = 0; k < gaps; k++) limit += by[k] * push[k];
        if (!sticking) {
            push[i] = row[i] == SLIDING_UP ? -limit : limit;
            continue;
        }
        double p = z[place[i]] * unit[i];
        push[i] = fmin(fmax(p - limit, -limit), limit);
        int low = 1, high = 1; /* a bound is met where its own variable is not in the basis */
        for (long r = 0; r < size; r++) {
            low &= T->basis[r] != size + place[i];
            high &= T->basis[r] != place[i] + held;
        }
        row[i] = low ? SLIDING_UP : high ? SLIDING_DOWN : STICKS;
        if (!(limit > 0)) row[i] = OFF;
    }
    return 1;
}

/* Rates of rows by reactions or impulses added. */
static void add_response(const Decision *D, const double *push, double *rate) {
    for (long i = 0; i < D->n; i++)
        for (long j = 0; j < D->n; j++) rate[i] += D->W[i * D->n + j] * push[j];
}

/* Room for one more transition. */
static int note_transition(Integrator *I, long row) {
    struct State *T = I->state;
    long n = I->one_sided + I->frictions, k = I->transitions;
    if (!I->block && k >= T->transition_room) {
        long c = T->transition_room = 2 * k + 16;
        if (!grow(&I->transition_steps, sizeof(long) * (size_t)c) || !grow(&I->transition_rows, sizeof(long) * (size_t)c) ||
            !grow(&I->impulses, sizeof(double) * (size_t)(c * n)) || !grow(&I->transition_masks, sizeof(double) * (size_t)(c * I->masks)))
            return 0;
    }
    I->transitions++;
    if (I->block) return 1;
    I->transition_steps[k] = I->steps - I->first;
    I->transition_rows[k] = row;
    memcpy(I->impulses + k * n, T->impulse, sizeof(double) * (size_t)n);
    memcpy(I->transition_masks + k * I->masks, T->side, sizeof(double) * (size_t)I->masks);
    return 1;
}

/* The state has jumped: a step of no length leads to where it is. */
static int keep_jump(Integrator *I) {
    struct State *T = I->state;
    I->steps++;
    if (!make_room(I)) return 0;
    long k = I->steps - I->first, n = I->nx;
    I->times[k] = I->t;
    memcpy(I->states + k * n, I->x, sizeof(double) * (size_t)n);
    spare(I, k);
    long at = T->coefficient_count;
    if (!I->block && at + 2 * n > T->coefficient_capacity) {
        T->coefficient_capacity = 2 * (at + 2 * n) + 1024;
        if (!grow(&I->coefficients, sizeof(double) * (size_t)T->coefficient_capacity)) return 0;
    }
    memset(I->coefficients + at, 0, sizeof(double) * (size_t)n);
    memcpy(I->coefficients + at + n, T->size, sizeof(double) * (size_t)n);
    memcpy(I->step_sides + (k - 1) * I->held, T->side, sizeof(double) * (size_t)I->held);
    I->stage_count[k - 1] = 1;
    I->kinds[k - 1] = RADAU;
    I->offset[k - 1] = at;
    T->coefficient_count = at + 2 * n;
    return 1;
}

/* Impulses of an impact, into T->impulse: compression and expansion. Rows: IN, or OFF. */
static int impact(Integrator *I, const Decision *D, const long *touching, long *worst) {
    struct State *T = I->state;
    long n = D->n, gaps = D->gaps, *row = T->status + n;
    double *compressed = T->push, *floor = T->push + n, *push = T->push + 2 * n;
    for (int phase = 0; phase < 2; phase++) {
        for (long i = 0; i < n; i++) {
            row[i] = touching[i] ? IN : OFF;
            if (i < gaps) continue;
            double grows = 0;
            for (long k = 0; k < gaps; k++) grows += fabs(D->hold_by[(i - gaps) * n + k]);
            if (grows == 0) row[i] = OFF; /* what does not grow with impulses is nothing beside them */
        }
        double *rate = T->push + 3 * n;
        memcpy(rate, D->rate, sizeof(double) * (size_t)n);
        if (phase) add_response(D, compressed, rate);
        for (long i = 0; i < gaps && phase; i++) floor[i] = D->bounce[i] * fmax(compressed[i], 0);
        if (!complementary(I, D, row, rate, 0, phase ? floor : 0, push, worst)) return 0;
        if (phase == 0) memcpy(compressed, push, sizeof(double) * (size_t)n);
    }
    for (long i = 0; i < n; i++) T->impulse[i] = compressed[i] + push[i];
    return 1;
}

/* Masks for the rows of a problem of accelerations that has been solved. */
static void set_masks(Integrator *I, const Decision *D, const long *row, const double *push) {
    struct State *T = I->state;
    double largest = 0;
    for (long i = 0; i < D->n; i++) {
        double w = sqrt(D->W[i * D->n + i]);
        largest = fmax(largest, fmax(fabs(push[i]) * w, fabs(D->free[i]) / w));
    }
    for (long i = 0; i < D->gaps; i++) T->side[i] = row[i] != OFF && push[i] * sqrt(D->W[i * D->n + i]) > NIL * largest;
    for (long i = D->gaps; i < D->n; i++) {
        double *mask = T->side + D->gaps + 2 * (i - D->gaps);
        mask[0] = row[i] == STICKS;
        mask[1] = row[i] == SLIDING_UP ? 1 : row[i] == SLIDING_DOWN ? -1 : 0;
    }
}

/* Whether friction has no limit above zero, whatever other reactions are: a clutch that is open. */
static int never_holds(const Decision *D, long row) {
    long f = row - D->gaps;
    for (long k = 0; k < D->n; k++)
        if (D->hold_by[f * D->n + k] != 0) return 0;
    return D->hold[f] <= 0;
}

/* Accelerations decide which of the rows that touch hold on, and which way friction acts. */
static enum Code decide_accelerations(Integrator *I, const long *touching, double planned) {
    struct State *T = I->state;
    Decision D;
    double *x = T->guess_x, *push = T->push + 2 * (I->one_sided + I->frictions), later = LATER * planned;
    long *row = T->status + I->one_sided + I->frictions, worst = 0;
    if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
    long n = D.n;
    for (long i = 0; i < n; i++) {
        row[i] = touching[i] ? IN : OFF;
        if (i < D.gaps && D.rate[i] > D.rate_noise[i]) row[i] = OFF;
        if (i >= D.gaps && touching[i] != 1) row[i] = touching[i] == 2 ? SLIDING_UP : SLIDING_DOWN;
    }
    if (!rate_at(I, I->t, I->x, T->rate)) return INPUT_FAILED;
    for (long i = 0; i < I->nx; i++) x[i] = I->x[i] + 0.5 * later * T->rate[i];
    if (!rate_at(I, I->t + 0.5 * later, x, T->rate)) return INPUT_FAILED; /* what is at its threshold by its rate too passes it by the next */
    for (long i = 0; i < I->nx; i++) x[i] = I->x[i] + later * T->rate[i];
    int moved = 1;
    for (long i = 0; i < I->nx; i++) moved &= isfinite(x[i]) != 0;
    if (!decision_at(I, I->t + (moved ? later : 0), moved ? x : I->x, &D)) return INPUT_FAILED;
    for (long i = D.gaps; i < n; i++)
        if (never_holds(&D, i)) row[i] = OFF;
    for (long again = 0; again <= 2 * D.frictions; again++) {
        long *trial = T->status + 2 * n;
        memcpy(trial, row, sizeof(long) * (size_t)n);
        if (!complementary(I, &D, trial, D.free, 1, 0, push, &worst)) {
            I->worst = worst;
            return NO_MODE;
        }
        int begun = 0;
        for (long i = D.gaps; i < n; i++)
            if (row[i] == IN && (trial[i] == SLIDING_UP || trial[i] == SLIDING_DOWN)) row[i] = trial[i], begun = 1;
        if (begun && again < 2 * D.frictions) continue; /* what slips has another limit */
        memcpy(row, trial, sizeof(long) * (size_t)n);
        break;
    }
    set_masks(I, &D, row, push);
    return REACHED_END;
}

/* All rows are decided at (t, x): impacts, then modes. `row`: the guard of masks that has become negative, -1: none in particular. */
static enum Code decide_modes(Integrator *I, long row, double planned) {
    struct State *T = I->state;
    Decision D;
    long gaps = I->one_sided, n = gaps + I->frictions, *touching = T->status, worst = 0;
    int impacts = 0;
    T->changes = fabs(I->t - T->changed_at) <= INSTANT * planned ? T->changes + 1 : 0;
    T->changed_at = I->t;
    if (T->changes > CHANGES) {
        I->worst = row < gaps ? row : gaps + (row - gaps) / 2;
        return CHATTERS;
    }
    if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
    for (long i = 0; i < gaps; i++) {
        touching[i] = D.gap[i] <= D.gap_noise[i] || T->side[i] == 1 || i == row;
        if ((!T->begun || has_jumped(I, &D, i)) && D.gap[i] < -D.gap_noise[i]) {
            I->worst = i;
            return OVERLAPS;
        }
        impacts |= touching[i] && D.rate[i] < -(i == row ? 4 : 1) * D.rate_noise[i]; /* what begins to hold where its speed vanishes strikes nothing */
    }
    for (long i = gaps; i < n; i++) {
        long first = gaps + 2 * (i - gaps);
        int stuck = T->side[first] == 1 && !has_jumped(I, &D, gaps + i), stops = row == first && T->side[first] == 0;
        touching[i] = stuck || stops || fabs(D.rate[i]) <= D.rate_noise[i] ? 1 : D.rate[i] > 0 ? 2 : 3;
    }
    T->crossed = 0;
    memset(T->impulse, 0, sizeof(double) * (size_t)n);
    if (impacts) {
        if (!impact(I, &D, touching, &worst)) {
            I->worst = worst;
            return NO_MODE;
        }
        for (long i = 0; i < I->nx; i++)
            for (long j = 0; j < n; j++) I->x[i] += D.J[i * n + j] * T->impulse[j];
        double *before = T->push;
        memcpy(before, D.rate, sizeof(double) * (size_t)n);
        if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
        for (long i = gaps; i < n; i++) /* slip that the impact has stopped, or turned */
            touching[i] = fabs(D.rate[i]) <= fmax(D.rate_noise[i], NIL * fabs(before[i])) ? 1 : D.rate[i] > 0 ? 2 : 3;
        for (long i = 0; i < gaps; i++) /* closed, if nothing bounces */
            if (touching[i] && D.rate[i] > fmax(D.rate_noise[i], NIL * fabs(before[i]))) touching[i] = 0;
    }
    for (long k = 0; k < I->masks && impacts; k++) T->side[k] = 0;
    enum Code code = decide_accelerations(I, touching, planned);
    if (code != REACHED_END) return code;
    project(I, I->t, I->x);
    for (long i = 0; i < I->nx; i++)
        if (fabs(I->x[i]) > T->size[i]) T->size[i] = fabs(I->x[i]);
    memset(T->carry, 0, sizeof(double) * (size_t)I->nx);
    if (!note_transition(I, row)) return OUT_OF_MEMORY;
    if (impacts && !keep_jump(I)) return OUT_OF_MEMORY;
    for (long r = 0; r < I->row_count; r++) T->far[r] = 0;
    forget_rates(I);
    I->h = planned;
    T->pending = -1;
    return REACHED_END;
}

static enum Code begin_modes(Integrator *I) {
    double planned = I->step > 0 ? I->step : 1e-3 * (I->end - I->t);
    double h = I->h;
    enum Code code = decide_modes(I, -1, planned);
    I->h = h;
    I->state->changed_at = -INFINITY;
    return code;
}
