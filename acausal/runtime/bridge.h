/* Impacts without end are passed: where all is when they are over, and what they have passed on meanwhile; see modes.h, and zeno.h for their instant. */

#define FORESEEN 1e3   /* roundings of rates, where states are extrapolated */

/* Laws that hang together with gaps that come to rest, by what their reactions move, into `in`. */
static void find_island(const Integrator *I, const Decision *D, const long *touching, long *in) {
    long n = D->n, laws = D->gaps + D->frictions, found = 1;
    for (long k = 0; k < laws; k++) in[k] = k < D->gaps && I->state->rests[k];
    while (found) {
        found = 0;
        for (long a = 0; a < laws; a++)
            for (long b = 0; b < laws && in[a]; b++) {
                if (in[b] || !touching[b] || b < D->valves) continue;
                long i = a < D->gaps ? a : row_of(D, a - D->gaps), j = b < D->gaps ? b : row_of(D, b - D->gaps);
                for (long r = i; r < i + (a < D->gaps ? 1 : rows_of(D, a - D->gaps)); r++)
                    for (long c = j; c < j + (b < D->gaps ? 1 : rows_of(D, b - D->gaps)); c++) in[b] |= fabs(D->W[r * n + c]) > NIL * sqrt(D->W[r * (n + 1)] * D->W[c * (n + 1)]);
                for (long f = 0; f < D->frictions; f++) in[b] |= (a < D->gaps && b == D->gaps + f && D->slide_by[f * n + a] != 0) || (b < D->gaps && a == D->gaps + f && D->slide_by[f * n + b] != 0);
                found |= in[b] != 0;
            }
    }
}

/* Impulses of pushes and friction over a time h in which impacts are bridged, of laws `in` one island, from these rates, and accelerations without reactions, at its beginning: those with which all
   that comes to rest does so, and what slides goes on. To first order in h, as what they do is. */
static void bridge_impulses(Integrator *I, const Decision *D, Room R, const long *in, double h, const double *rate, const double *free) {
    struct State *T = I->state;
    long n = D->n;
    double *start = R.compressed;
    Decision nothing = decision_of(I, T->no_change, 0);
    Problem p = problem_of(I, D, R, start);
    p.kinetic = p.constants = 1;
    memset(T->no_change, 0, sizeof(double) * (size_t)I->decision.outputs);
    for (long i = 0; i < n; i++) R.push[i] = start[i] = R.before[i] = 0;
    for (long i = 0; i < D->gaps; i++) {
        R.law[i] = in[i] && R.touching[i] ? HOLDS : OFF;
        R.push[i] = R.law[i] == HOLDS;
    }
    for (long f = 0; f < D->frictions; f++) {
        long *law = R.law + D->gaps + f;
        *law = !in[D->gaps + f] || !(limit_of(&p, f) > 0) ? OFF : R.touching[D->gaps + f] == 1 ? HOLDS : AGAINST;
        for (long k = 0; k < rows_of(D, f) && *law == AGAINST; k++) T->impulse[row_of(D, f) + k] = -h * D->slide[f] * R.along[3 * f + k];
    }
    for (long i = 0; i < n; i++) {
        start[i] = rate[i] + h * free[i];
        for (long j = D->gaps; j < n; j++) start[i] += D->W[i * n + j] * T->impulse[j];
    }
    change_choice(&p, &nothing, start, 0, T->choice_change, R.before);
    for (long j = 0; j < n; j++) T->impulse[j] = isfinite(R.before[j]) ? T->impulse[j] + R.before[j] : 0;
}

/* Frictions of what comes to rest that have stuck after each of the last impacts stick. */
static void hold_sticking(const Integrator *I, const Decision *D, Room R) {
    struct State *T = I->state;
    for (long f = 0; f < D->frictions; f++)
        for (long i = 0; i < D->gaps; i++)
            if (T->rests[i] && D->slide_by[f * D->n + i] != 0 && T->sticks[f] >= FEWEST) R.touching[D->gaps + f] = 1;
}

/* The motion in the mode that has been set until a time, from x on, into `end`; by as many steps of Kutta's method as it takes to know it to rounding. 1 if it is, -1 when the input
   function failed. */
static int go_on(Integrator *I, const double *x, double until, double *end) {
    struct State *T = I->state;
    long n = I->nx;
    double *k = T->later_x, *sum = end + n, *at = sum + n, *last = at + n;
    for (int steps = 1; steps <= 64; steps *= 2) {
        double h = (until - I->t) / steps, left = 0;
        memcpy(last, end, sizeof(double) * (size_t)n);
        memcpy(end, x, sizeof(double) * (size_t)n);
        for (int step = 0; step < steps; step++) {
            static const double part[] = {0, 0.5, 0.5, 1}, weight[] = {1. / 6, 1. / 3, 1. / 3, 1. / 6};
            for (long i = 0; i < n; i++) k[i] = sum[i] = 0;
            for (int stage = 0; stage < 4; stage++) {
                for (long i = 0; i < n; i++) at[i] = end[i] + part[stage] * h * k[i];
                if (!rate_at(I, I->t + (step + part[stage]) * h, at, k)) return -1;
                for (long i = 0; i < n; i++) sum[i] += weight[stage] * h * k[i];
            }
            for (long i = 0; i < n; i++) end[i] += sum[i];
        }
        for (long i = 0; i < n; i++) left = fmax(left, T->size[i] > 0 ? fabs(end[i] - last[i]) / T->size[i] : 0);
        if (steps > 1 && left <= 8 * EPS) return 1;
    }
    return 0;
}

/* Whether reactions act the same way in all of the impacts that come to rest: no friction turns in between, or depends on them. */
static int act_alike(const Integrator *I, const Decision *D) {
    const struct State *T = I->state;
    int alike = 1;
    for (long k = 0; k < FEWEST && alike; k++) alike = T->impact_after[(T->impacts - 1 - k) % REMEMBERED] == 0;
    for (long f = 0; f < D->frictions; f++)
        for (long i = 0; i < D->gaps && alike; i++) alike = !(T->rests[i] && D->slide_by[f * D->n + i] != 0);
    return alike;
}

enum { CONVERGES = 1, HELD };

/* Where all is when impacts are over, if from the one that has been decided what comes to rest is held: what reactions that act the same way all along pass on until then is the same
   to second order in that time. Into T->rest_x, wherever they do, or where impacts converge to the same: HELD. Else CONVERGES, if it is known at all, 0 if not; -1 when the input
   function failed. */
static int go_on_held(Integrator *I, Room R, double planned) {
    struct State *T = I->state;
    Decision D;
    long n = I->nx, directions = I->directions;
    double *end = T->held, *x = end + 4 * n, *size = x + n, *side = size + n, *impulse = side + I->masks, *room = impulse + reactions_of(I);
    I->directions = 0;
    memcpy(x, I->x, sizeof(double) * (size_t)n);
    memcpy(size, T->size, sizeof(double) * (size_t)n);
    memcpy(side, T->side, sizeof(double) * (size_t)I->masks);
    memcpy(impulse, T->impulse, sizeof(double) * (size_t)reactions_of(I));
    memcpy(room, T->push, sizeof(double) * (size_t)doubles_of_room(I));
    memcpy(T->held_status, T->status, sizeof(long) * (size_t)longs_of_room(I));
    memset(T->side, 0, sizeof(double) * (size_t)first_discrete(I));
    int known = decision_at(I, I->t, I->x, &D) ? 1 : -1;
    if (known > 0) {
        for (long i = 0; i < D.gaps; i++) R.touching[i] = T->rests[i] ? 2 : R.touching[i];
        memcpy(R.compressed, D.rate, sizeof(double) * (size_t)D.n);
        hold_sticking(I, &D, R);
        end_low_bounces(I, &D, R);
        known = decision_at(I, I->t, I->x, &D) ? 1 : -1;
    }
    if (known > 0) {
        look_at_slips(I, &D, R, -1, R.compressed);
        hold_sticking(I, &D, R);
        enum Code code = decide_accelerations(I, R, planned);
        known = code == INPUT_FAILED ? -1 : code == REACHED_END;
    }
    if (known > 0) {
        project(I, I->t, I->x);
        known = go_on(I, I->x, T->rest_t, end);
    }
    int alike = known > 0, always = alike && act_alike(I, &D);
    for (long i = 0; i < n && alike; i++) alike = isfinite(end[i]) && (always || (is_state_foreseen(T) && !(fabs(end[i] - T->rest_x[i]) > AGREES * size[i])));
    if (alike) memcpy(T->rest_x, end, sizeof(double) * (size_t)n);
    I->directions = directions;
    memcpy(I->x, x, sizeof(double) * (size_t)n);
    memcpy(T->size, size, sizeof(double) * (size_t)n);
    memcpy(T->side, side, sizeof(double) * (size_t)I->masks);
    memcpy(T->impulse, impulse, sizeof(double) * (size_t)reactions_of(I));
    memcpy(T->push, room, sizeof(double) * (size_t)doubles_of_room(I));
    memcpy(T->status, T->held_status, sizeof(long) * (size_t)longs_of_room(I));
    return known < 0 ? -1 : alike ? HELD : is_state_foreseen(T) ? CONVERGES : 0;
}

/* From the impact that has been decided, of this row, to where all that follow it are over; `rate`: after it. What has nothing to do with them keeps its `sides`. */
static enum Code bridge(Integrator *I, Decision *D, Room R, long row, double planned, const double *sides, const double *rate) {
    struct State *T = I->state;
    long n = D->n, *in = T->rests + D->gaps;
    double *free = T->blow, *first = T->blow + n, h = T->rest_t - I->t;
    if (I->directions) return not_derived(I, row >= 0 && row < D->gaps ? row : 0, WITHOUT_END);
    memcpy(free, D->free, sizeof(double) * (size_t)n);
    memcpy(first, rate, sizeof(double) * (size_t)n);
    find_island(I, D, R.touching, in);
    memcpy(T->side, sides, sizeof(double) * (size_t)I->masks);
    for (long i = 0; i < D->gaps; i++)
        if (in[i]) T->side[i] = 0;
    for (long f = 0; f < D->frictions; f++)
        if (in[D->gaps + f]) memset(T->side + mask_of(I, f), 0, sizeof(double) * (size_t)(mask_of(I, f + 1) - mask_of(I, f)));
    if (!note_transition(I, row) || !keep_straight(I, 0) || !bridge_impacts(I)) return OUT_OF_MEMORY;
    memset(T->side, 0, sizeof(double) * (size_t)first_discrete(I));
    memset(T->impulse, 0, sizeof(double) * (size_t)n);
    for (long i = 0; i < D->gaps; i++) R.touching[i] = T->rests[i] ? 2 : R.touching[i];
    if (!decision_at(I, I->t, I->x, D)) return INPUT_FAILED;
    look_at_slips(I, D, R, -1, 0);
    hold_sticking(I, D, R);
    for (long f = 0; f < D->frictions; f++) { /* so do those at last that have come to rest, whatever is left of their slips */
        int rests = 0;
        for (long i = 0; i < D->gaps; i++) rests |= T->rests[i] && D->slide_by[f * D->n + i] != 0;
        int holds = sides[mask_of(I, f)] == 1 && size_of(D, f, D->rate) <= FORESEEN * slip_noise(D, f); /* what stuck through all of them */
        if (holds) R.touching[D->gaps + f] = 1;
        if (rests) T->sticks[f] = 0;
    }
    bridge_impulses(I, D, R, in, 0, first, free);
    for (long i = D->valves; i < D->gaps; i++) T->heat[i] = -0.5 * T->impulse[i] * first[i]; /* of all that speeds are worth, to second order: it may be much where little time is left */
    memset(T->impulse, 0, sizeof(double) * (size_t)n);
    bridge_impulses(I, D, R, in, h, first, free);
    T->impacts = 0;
    return decide_accelerations(I, R, planned);
}
