/* Impacts without end: those of a ball that comes to rest are infinitely many, in a time that is finite. Along them all is a smooth function of how hard they are: when they are over is
   extrapolated to none (Neville), from those that are so far apart, and so early, that rounding and what the last terms tell are least. Bounces go on until nearly all of the time is over;
   the rest is bridged. Where reactions act the same way all along, states are then those of what is held from there on; else they are extrapolated, too. What changes in between, as friction
   where what bounces turns round, belongs to the sequence if it changes each time. */

#define REMEMBERED 128 /* impacts */
#define SEQUENCE 10    /* of a sequence that is extrapolated, at most */
#define FEWEST 4
#define PERIODS 4     /* impacts of different rows take turns: so many at most */
#define AGREES 1e-9   /* in units of the sizes of states: how well extrapolations must agree */
#define BRIDGED 1e-6  /* of the time since the first impact: what is left when it is bridged */

static int make_zeno(Integrator *I) {
    struct State *T = I->state;
    T->impact_t = reserve_doubles(I, REMEMBERED);
    T->impact_x = reserve_doubles(I, REMEMBERED * I->nx);
    T->impact_size = reserve_doubles(I, REMEMBERED);
    T->impact_noise = reserve_doubles(I, REMEMBERED);
    T->impact_row = reserve(I, sizeof(long) * REMEMBERED);
    T->impact_after = reserve(I, sizeof(unsigned long) * REMEMBERED);
    T->held = reserve_doubles(I, 6 * I->nx + I->masks + reactions_of(I) + doubles_of_room(I));
    T->held_status = reserve(I, sizeof(long) * (size_t)longs_of_room(I));
    T->rest_x = reserve_doubles(I, I->nx + 1);
    T->rests = reserve(I, sizeof(long) * (size_t)(2 * I->one_sided + frictions_of(I) + 1));
    T->sticks = reserve(I, sizeof(long) * (size_t)(I->lines + I->planes + I->patches + 1));
    T->sticks_now = reserve(I, sizeof(long) * (size_t)(frictions_of(I) + 1));
    T->struck = reserve(I, (size_t)(REMEMBERED * I->one_sided + 1));
    return I->counted || (T->impact_t && T->impact_x && T->impact_size && T->impact_noise && T->impact_row && T->impact_after && T->held && T->held_status && T->rest_x && T->rests && T->sticks && T->sticks_now && T->struck);
}

/* What values tend to as sizes, of which they are smooth functions, go to zero (Neville), and by how much the last two guesses differ; changes the values. */
static double limit_of_sequence(const double *size, double *value, int count, double *error) {
    double best = value[count - 1];
    for (int column = 1; column < count; column++) {
        for (int k = count - 1; k >= column; k--) value[k] += size[k] / (size[k - column] - size[k]) * (value[k] - value[k - 1]);
        *error = fabs(value[count - 1] - best);
        best = value[count - 1];
    }
    return best;
}

/* What is left in that limit of such errors of the values. */
static double noise_of_limit(const double *size, const double *noise, int count) {
    double sum = 0;
    for (int k = 0; k < count; k++) {
        double weight = 1;
        for (int j = 0; j < count; j++) weight *= j == k ? 1 : size[j] / (size[j] - size[k]);
        sum += fabs(weight) * noise[k];
    }
    return sum;
}

/* A row led to another mode, and nothing struck. */
static void note_between(Integrator *I, long row) {
    struct State *T = I->state;
    if (row < 0 || row >= first_set(I)) T->impacts = 0;
    T->between = 31 * T->between + (unsigned long)(row + 1);
}

static void forget_rest(Integrator *I) {
    struct State *T = I->state;
    T->rest_error = T->rest_error_x = T->rest_doubt = T->rest_doubt_x = INFINITY;
}

/* Whether the state, too, that impacts converge to is known, at the instant that they do. */
static int is_state_foreseen(const struct State *T) {
    return T->rest_error_x < AGREES && fabs(T->rest_t_of_x - T->rest_t) <= AGREES * (T->rest_t - T->first_impact);
}

/* Whether two impacts are of the same row, after the same changes of mode. */
static int are_alike(const struct State *T, long a, long b) {
    return T->impact_row[a % REMEMBERED] == T->impact_row[b % REMEMBERED] && T->impact_after[a % REMEMBERED] == T->impact_after[b % REMEMBERED];
}

/* Remembers an impact of a row. Impacts begin anew where modes have changed before it as they have not before any of the last ones. */
static void note_impact(Integrator *I, long row) {
    struct State *T = I->state;
    long at = T->impacts++, known = 0;
    T->impact_t[at % REMEMBERED] = I->t;
    T->impact_row[at % REMEMBERED] = row;
    T->impact_after[at % REMEMBERED] = T->between;
    memcpy(T->impact_x + at % REMEMBERED * I->nx, I->x, sizeof(double) * (size_t)I->nx);
    for (long period = 1; period <= PERIODS && period <= at; period++) known |= T->impact_after[(at - period) % REMEMBERED] == T->between;
    if (!known) forget_rest(I), T->first_impact = I->t;
    T->between = 0;
}

/* What so many impacts so far apart, up to one of them, converge to, in a state, or in time since the first one (-1), and by how much the last two guesses differ. */
static double limit_up_to(const Integrator *I, long at, long apart, int count, long state, double *error) {
    const struct State *T = I->state;
    double value[SEQUENCE] = {0}, size[SEQUENCE] = {0};
    for (int k = 0; k < count; k++) {
        long impact = (at - (count - 1 - k) * apart) % REMEMBERED;
        value[k] = state < 0 ? T->impact_t[impact] - T->first_impact : T->impact_x[impact * I->nx + state];
        size[k] = T->impact_size[impact];
    }
    return limit_of_sequence(size, value, count, error);
}

/* The same, up to the last one. Guesses may agree by chance: not also with the one that was made one period earlier, whose errors have shrunk since then. */
static double last_limit(const Integrator *I, long at, long period, long apart, int count, long state, double *error) {
    const struct State *T = I->state;
    double nothing, before = limit_up_to(I, at - period, apart, count, state, &nothing), found = limit_up_to(I, at, apart, count, state, error);
    double shrinks = power(T->impact_size[at % REMEMBERED] / T->impact_size[(at - period) % REMEMBERED], count);
    *error = fmax(*error, fabs(found - before) / (1 - shrinks));
    return found;
}

/* Whether an impact is of rows that are known to come to rest. */
static int is_of_rest(const Integrator *I, long at) {
    const struct State *T = I->state;
    for (long i = 0; i < I->one_sided; i++)
        if (T->rests[i] && T->struck[at % REMEMBERED * I->one_sided + i]) return 1;
    return 0;
}

/* What so many impacts so far apart, up to the last one, converge to, if to something better than what is known, in time or state. What is wrong of an instant is so of
   all that follow: it shrinks as they do. */
static void foresee_by(Integrator *I, long at, long period, long apart, int count) {
    struct State *T = I->state;
    long n = I->nx;
    double size[SEQUENCE] = {0}, noise[SEQUENCE] = {0}, error, *x = T->later_x, shrinks = T->impact_size[at % REMEMBERED] / T->impact_size[(at - period) % REMEMBERED];
    for (int k = 0; k < count; k++) {
        long impact = (at - (count - 1 - k) * apart) % REMEMBERED, before = (at - period - (count - 1 - k) * apart) % REMEMBERED;
        size[k] = T->impact_size[impact];
        noise[k] = EPS * fabs(T->impact_t[impact]) + T->impact_noise[impact] / (1 - shrinks);
        if (!(size[k] < 0.999 * T->impact_size[before]) || (k && !(size[k] < 0.999 * size[k - 1]))) return;
    }
    double now = T->impact_t[at % REMEMBERED] - T->first_impact, rest = last_limit(I, at, period, apart, count, -1, &error), doubt = noise_of_limit(size, noise, count) / rest;
    if (!(rest > now)) return;
    if (T->rest_t <= I->t) forget_rest(I); /* of others that are over */
    double missed = error / rest, worst = missed;
    if (!is_of_rest(I, at) && T->rest_doubt < INFINITY) { /* of several, each with an end of its own, the one that is over first */
        int known = T->rest_error < AGREES, found = missed < AGREES;
        if (known ? !found || T->first_impact + rest >= T->rest_t : !found && missed + doubt >= T->rest_doubt) return;
        forget_rest(I);
    }
    for (long i = 0; i < n && worst + doubt < T->rest_doubt_x; i++) {
        double left;
        x[i] = last_limit(I, at, period, apart, count, i, &left);
        if (T->size[i] > 0) worst = fmax(worst, left / T->size[i]);
    }
    int sooner = missed + doubt < T->rest_doubt, better = worst + doubt < T->rest_doubt_x;
    if (sooner) T->rest_t = T->first_impact + rest, T->rest_error = missed, T->rest_doubt = missed + doubt;
    if (better) {
        memcpy(T->rest_x, x, sizeof(double) * (size_t)n);
        T->rest_t_of_x = T->first_impact + rest;
        T->rest_error_x = worst;
        T->rest_doubt_x = worst + doubt;
    }
    if (!sooner && !better) return;
    memset(T->rests, 0, sizeof(long) * (size_t)I->one_sided);
    for (long k = 0; k < period; k++) { /* all that strike together, whichever is noticed first, or in turns, if their impacts are over at the same time */
        if (k && !(fabs(limit_up_to(I, at - k, apart, count, -1, &error) - rest) <= 10 * AGREES * rest)) continue;
        for (long i = 0; i < I->one_sided; i++) T->rests[i] |= T->struck[(at - k) % REMEMBERED * I->one_sided + i];
    }
}

/* After an impact of a row: what the impacts converge to, if they do. */
static void foresee_rest(Integrator *I, long row) {
    struct State *T = I->state;
    long at = T->impacts;
    note_impact(I, row);
    for (long period = 1; period <= PERIODS; period++) {
        long repeated = 0;
        while (repeated + period <= at && repeated + period < REMEMBERED && are_alike(T, at - repeated, at - repeated - period)) repeated++;
        long known = repeated - period; /* with one period before */
        if (known / period + 1 < FEWEST) continue;
        for (long apart = period; known / apart + 1 >= FEWEST; apart *= 2)
            for (int count = FEWEST; count <= SEQUENCE && count <= known / apart + 1; count++) foresee_by(I, at, period, apart, count);
        return;
    }
}

/* Whether the rest of the impacts is to be bridged now; `low`: since gaps do not tell the next ones from rounding. */
static int comes_to_rest(const Integrator *I, int low) {
    const struct State *T = I->state;
    double left = T->rest_t - I->t;
    return T->impacts >= FEWEST && T->rest_error < AGREES && (low || is_state_foreseen(T)) && left <= (low ? 1e3 : 1) * BRIDGED * (T->rest_t - T->first_impact) && left > 0 && T->rest_t < I->end && T->rest_t < T->knot;
}

/* To where they are over, in one step. */
static int bridge_impacts(Integrator *I) {
    struct State *T = I->state;
    double h = T->rest_t - I->t;
    for (long i = 0; i < I->nx; i++) T->later_x[i] = h > 0 ? (T->rest_x[i] - I->x[i]) / h : 0;
    memcpy(I->x, T->rest_x, sizeof(double) * (size_t)I->nx);
    I->t = T->rest_t;
    return keep_straight(I, T->later_x);
}

/* It leads to the state that there is now, which has been put where everything that holds is closed. */
static void end_bridge(Integrator *I) {
    long k = I->steps - I->first, n = I->nx;
    double h = I->times[k] - I->times[k - 1], *rates = I->coefficients + I->offset[k - 1];
    for (long i = 0; i < n; i++) rates[i] = (I->x[i] - I->states[(k - 1) * n + i]) / h;
    memcpy(I->states + k * n, I->x, sizeof(double) * (size_t)n);
}
