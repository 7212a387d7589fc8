/* Impacts without end: those of a ball that comes to rest are infinitely many, in a time that is finite. What all of it converges to, time, positions, velocities, is extrapolated
   from states after impacts, by the epsilon algorithm (Wynn, Mathematical Tables and Other Aids to Computation 10, 1956): from early ones, which are exact. Bounces go on until
   nearly all of the time is over; the rest is bridged. What changes in between, as friction where what bounces turns round, belongs to the sequence if it changes each time. */

#define REMEMBERED 32 /* impacts */
#define SEQUENCE 7     /* of a sequence that is extrapolated, at most */
#define FEWEST 4
#define PERIODS 4     /* impacts of different rows take turns: so many at most */
#define AGREES 1e-9   /* in units of the sizes of states: how well extrapolations must agree */
#define BRIDGED 1e-6  /* of the time since the first impact: what is left when it is bridged */

static int make_zeno(Integrator *I) {
    struct State *T = I->state;
    T->impact_t = reserve_doubles(I, REMEMBERED);
    T->impact_x = reserve_doubles(I, REMEMBERED * I->nx);
    T->impact_row = reserve(I, sizeof(long) * REMEMBERED);
    T->impact_after = reserve(I, sizeof(unsigned long) * REMEMBERED);
    T->rest_x = reserve_doubles(I, I->nx + 1);
    T->rests = reserve(I, sizeof(long) * (size_t)(2 * I->one_sided + frictions_of(I) + 1));
    T->sticks = reserve(I, sizeof(long) * (size_t)(I->lines + I->planes + I->patches + 1));
    T->struck = reserve(I, (size_t)(REMEMBERED * I->one_sided + 1));
    return I->counted || (T->impact_t && T->impact_x && T->impact_row && T->impact_after && T->rest_x && T->rests && T->sticks && T->struck);
}

/* The limit of a sequence of so many values, and by how much the last two guesses differ. */
static double limit_of_sequence(const double *s, int count, double *error) {
    double old[SEQUENCE + 1] = {0}, now[SEQUENCE], next[SEQUENCE], best = s[count - 1];
    memcpy(now, s, sizeof(double) * (size_t)count);
    *error = fabs(s[count - 1] - s[count - 2]);
    if (*error == 0) return best;
    for (int column = 1; column < count; column++) {
        int n = count - column;
        for (int k = 0; k < n; k++) {
            double difference = now[k + 1] - now[k];
            if (difference == 0) return best;
            next[k] = old[k + 1] + 1 / difference;
        }
        memcpy(old, now, sizeof now);
        memcpy(now, next, sizeof now);
        if (column % 2 == 0 && n > 1 && fabs(now[n - 1] - now[n - 2]) < *error) {
            *error = fabs(now[n - 1] - now[n - 2]);
            best = now[n - 1];
        }
    }
    return best;
}

/* A row led to another mode, and nothing struck. */
static void note_between(Integrator *I, long row) {
    struct State *T = I->state;
    if (row < 0 || row >= first_set(I)) T->impacts = 0;
    T->between = 31 * T->between + (unsigned long)(row + 1);
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
    if (!known) T->rest_error = INFINITY, T->first_impact = I->t;
    T->between = 0;
}

/* After an impact of a row: what the impacts converge to, if they do. */
static void foresee_rest(Integrator *I, long row) {
    struct State *T = I->state;
    long n = I->nx, at = T->impacts;
    note_impact(I, row);
    for (long period = 1; period <= PERIODS; period++) {
        long repeated = 0;
        while (repeated + period <= at && repeated < (SEQUENCE - 1) * period && are_alike(T, at - repeated, at - repeated - period)) repeated++;
        int count = (int)(repeated / period) + 1;
        if (count < FEWEST) continue;
        double s[SEQUENCE], error, worst = 0;
        for (int k = 0; k < count; k++) s[k] = T->impact_t[(at - (count - 1 - k) * period) % REMEMBERED] - T->first_impact;
        if (!(s[count - 1] - s[count - 2] < 0.999 * (s[count - 2] - s[count - 3]))) return;
        double rest = limit_of_sequence(s, count, &error), *x = T->later_x;
        if (!(rest > s[count - 1])) return;
        worst = error / rest;
        for (long i = 0; i < n; i++) {
            for (int k = 0; k < count; k++) s[k] = T->impact_x[(at - (count - 1 - k) * period) % REMEMBERED * n + i];
            x[i] = limit_of_sequence(s, count, &error);
            if (T->size[i] > 0) worst = fmax(worst, error / T->size[i]);
        }
        if (!(worst < T->rest_error)) return;
        T->rest_error = worst;
        T->rest_t = T->first_impact + rest;
        memcpy(T->rest_x, x, sizeof(double) * (size_t)n);
        memset(T->rests, 0, sizeof(long) * (size_t)I->one_sided);
        for (long k = 0; k < period; k++) /* all that strike together, whichever is noticed first */
            for (long i = 0; i < I->one_sided; i++) T->rests[i] |= T->struck[(at - k) % REMEMBERED * I->one_sided + i];
        return;
    }
}

/* Whether the rest of the impacts is to be bridged now; `low`: since gaps do not tell the next ones from rounding. */
static int comes_to_rest(const Integrator *I, int low) {
    const struct State *T = I->state;
    double left = T->rest_t - I->t;
    return T->impacts >= FEWEST && T->rest_error < AGREES && left <= (low ? 1e3 : 1) * BRIDGED * (T->rest_t - T->first_impact) && left > 0 && T->rest_t < I->end && T->rest_t < T->knot;
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
