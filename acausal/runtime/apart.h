/* What holds, and is led apart by time: rows that depend on one another hold together only as long as what moves them agrees, as a floor and a rope that is drawn up do until it is. Their reactions share
   what cannot be, and none of them tells. So before a step is taken their accelerations at its end are looked at: where no reactions hold all of them, what holds is decided
   anew where that begins, by what is inside of the step, since what is smooth begins with no acceleration at all. */

#define LED_APART 16.0 /* roundings of rates that a step leads rows apart by, at least */
#define AT_ITS_START 1e-2 /* of a step: what is seen by then has begun with it, where something else has changed there */
#define SOUGHT 60      /* halvings of a step */

/* Laws of the mode that is, and directions of what slides. */
static void laws_now(const Integrator *I, const Decision *D, long *law, double *along) {
    const struct State *T = I->state;
    for (long i = 0; i < D->gaps; i++) law[i] = T->side[i] == 1 && i >= D->valves ? HOLDS : OFF;
    for (long f = 0; f < D->frictions; f++) {
        const double *mask = T->side + mask_of(I, f);
        double *e = along + 3 * f;
        long size = rows_of(D, f);
        int held = size > 1 && mask[2] == 1;
        law[D->gaps + f] = mask[0] == 1 ? HOLDS : mask[1] != 0 || held ? AGAINST : OFF;
        e[0] = e[1] = e[2] = 0;
        if (size == 1) e[0] = mask[1];
        else if (held) memcpy(e, mask + 4, sizeof(double) * (size_t)size);
        else if (size_of(D, f, D->rate) > 0) against(D, f, D->rate + row_of(D, f), e);
    }
}

/* Whether no reactions hold all that holds so much later in a step of size h; -1 when the input function failed. */
static int is_led_apart(Integrator *I, double later, double h) {
    struct State *T = I->state;
    Decision D;
    Room R = room_of(I);
    Held S = held_of(I);
    long laws = I->one_sided + frictions_of(I), *seen = T->margin_rows + 3 * reactions_of(I) + frictions_of(I);
    if (!decision_later(I, later, &D)) return -1;
    laws_now(I, &D, R.law, R.along);
    memset(S.e, 0, sizeof(double) * (size_t)(3 * D.magnitudes));
    memset(seen, 0, sizeof(long) * (size_t)laws);
    for (long k = 0; k < laws; k++) {
        if (R.law[k] != HOLDS || seen[k]) continue;
        gather(&D, R.law, k, &S, seen);
        pose_held(&D, R.law, R.along, &S);
        if (solve_held(&S)) continue;
        double left = 0, noise = 0;
        for (long a = 0; a < S.rows; a++) {
            if (a >= S.rows - S.free) left = fmax(left, fabs(S.b[a]));
            noise = fmax(noise, D.rate_noise[S.row[a]] / unit_of(D.W[S.row[a] * (D.n + 1)]));
        }
        if (left * h > LED_APART * noise) return 1;
    }
    return 0;
}

/* The part of a step after which it is, and before which it is not. Negative when the input function failed. */
static double led_from(Integrator *I, double h) {
    double lo = 0, hi = 1;
    for (int k = 0; k < SOUGHT && hi - lo > EPS; k++) {
        double middle = 0.5 * (lo + hi);
        int apart = is_led_apart(I, middle * h, h);
        if (apart < 0) return -1;
        *(apart ? &hi : &lo) = middle;
    }
    return lo;
}

/* Of a step that has been solved, and is to be taken: how much of it is, before something in it is led apart; 0 where that begins with it, and has been decided. 1: nothing is. */
static enum Code part_rows(Integrator *I, const Stages *S, double h, double *part) {
    struct State *T = I->state;
    enum Code code = REACHED_END;
    *part = 1;
    if (!I->redundant || T->side[carried_of(I) - 1] == 0 || T->parting.left_at == I->t) return code;
    T->parting.inside = S;
    T->parting.h = h;
    int apart = is_led_apart(I, h, h);
    if (apart > 0) *part = led_from(I, h);
    if (apart < 0 || *part < 0) code = INPUT_FAILED;
    else if (apart && (*part * h <= at_once(I) || (fabs(I->t - T->parting.since) <= at_once(I) && *part <= AT_ITS_START))) {
        double *masks = T->parting.masks;
        *part = 0;
        memcpy(masks, T->side, sizeof(double) * (size_t)I->masks);
        code = decide_modes(I, -1, h);
        for (long i = 0; i < I->one_sided && code == REACHED_END; i++)
            if (masks[i] == 1 && T->side[i] == 0) T->parting.near_zero[i] = 1;
        if (code == REACHED_END && same_laws(I, masks)) T->parting.left_at = I->t; /* nothing else is known to hold */
    } else if (apart) T->parting.since = I->t + *part * h;
    T->parting.inside = 0;
    return code;
}
