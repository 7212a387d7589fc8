/* Which of the rows that touch hold on, and which way friction acts: accelerations, looked at a little later, where what is exactly at its threshold has passed it; see modes.h. */

#define SETTLED 6      /* times for each valve that others are asked again */
#define SOONEST 1e-13  /* not so much sooner */
#define FORESEES 0.25 /* part of a rate that it may change by while it is followed */
#define RESOLVED 16.0  /* roundings of a gap: bounces that are not higher are none */
#define BRIEFEST 1024.0 /* roundings of the time: nor are those that do not last longer, and so near to its end slip has a direction that is held */
#define ALIKE 1e-3     /* of the slip: where a patch slides as fast as its edge turns; forces bend there, and a step ends */
#define SUDDEN 0.1      /* of the slips met: what accelerations that jump make of them in a step, at least */
#define SHORTLY 1e-3    /* of a step: where slips are looked at that have begun */
#define OFF_COURSE 1e-3 /* of a slip, across its direction: it does not go that way */
#define BEGUN 1e-11     /* of what slips become until their rates are as fast as what friction holds: with which they begin where their directions are not held */
#define NEARER 1e-2    /* of NEAR_ZERO, for patches: what they act against turns until the end */

/* The rate of a gap that is none: rounding, or that of a bounce so low, or so short, that gaps, or times, do not tell it from rounding, as it falls back with this acceleration. */
static double least_rate(const Integrator *I, const Decision *D, long i, double acceleration) {
    double fall = fmax(0, -acceleration);
    return fmax(D->rate_noise[i], fmax(sqrt(2 * fall * RESOLVED * D->gap_noise[i]), 0.5 * fall * BRIEFEST * EPS * fabs(I->t)));
}

/* Rows that hold, but for valves, into `chosen`; how many. */
static long rows_that_hold(const Decision *D, const long *law, long *chosen) {
    long m = 0;
    for (long i = D->valves; i < D->gaps; i++)
        if (law[i] == HOLDS) chosen[m++] = i;
    for (long f = 0; f < D->frictions; f++)
        for (long k = 0; k < rows_of(D, f) && law[D->gaps + f] == HOLDS; k++) chosen[m++] = row_of(D, f) + k;
    return m;
}

/* Eliminates m of w rows (w, w) into A, in units of their diagonal, until no pivot is left but what vanishes where rows depend on one another. The least of the others; 0: none vanishes. */
static double eliminate_rows(const Decision *D, const long *row, long m, long w, double *A) {
    long n = D->n;
    double least = 1;
    for (long i = 0; i < w; i++)
        for (long j = 0; j < w; j++) A[i * w + j] = D->W[row[i] * n + row[j]] / sqrt(D->W[row[i] * n + row[i]] * D->W[row[j] * n + row[j]]);
    for (long k = 0; k < m; k++) {
        long best = k;
        for (long i = k + 1; i < m; i++)
            if (A[i * w + i] > A[best * w + best]) best = i;
        if (!(A[best * w + best] > DEPENDENT)) return least;
        least = fmin(least, A[best * w + best]);
        for (long j = 0; j < w && best != k; j++) {
            double kept = A[k * w + j];
            A[k * w + j] = A[best * w + j], A[best * w + j] = kept;
        }
        for (long j = 0; j < w && best != k; j++) {
            double kept = A[j * w + k];
            A[j * w + k] = A[j * w + best], A[j * w + best] = kept;
        }
        for (long i = k + 1; i < w; i++)
            for (long j = k + 1; j < w; j++) A[i * w + j] -= A[i * w + k] * A[k * w + j] / A[k * w + k];
    }
    return 0;
}

/* The least pivot of the rows that hold, but for those that vanish; 0: none does. */
static double least_pivot(const Decision *D, const long *law, double *A, long *chosen) {
    long m = rows_that_hold(D, law, chosen);
    return eliminate_rows(D, chosen, m, m, A);
}

/* Whether a row that does not hold moves no way that those leave which do, as a fourth foot beside three: it is no further from zero than these. */
static int kept_by_others(const Decision *D, const long *law, long row, double *A, long *chosen) {
    long m = rows_that_hold(D, law, chosen);
    chosen[m] = row;
    eliminate_rows(D, chosen, m, m + 1, A);
    return A[(m + 1) * (m + 1) - 1] <= DEPENDENT;
}

/* Directions of the forces that limits depend on; what has no force keeps the one it has. */
static void set_directions_of_forces(Integrator *I, const Problem *p) {
    for (long m = 0; m < I->magnitudes; m++) {
        double *e = I->state->side + mask_of_size(I, m), force[3], size = force_at(p, m, force);
        for (long c = 0; c < 3 && size > 0; c++) e[c] = force[c] / size;
        if (e[0] == 0 && e[1] == 0 && e[2] == 0) e[0] = 1;
    }
}

/* How fast slips in planes will be that begin, in a step as it is planned, into R.met: by their accelerations and by how these grow, since what is just at its limit begins
   hardly at all. So large are states then that they move: they are not known better by being small at first. 0 when the input function failed. */
static int foresee_slips(Integrator *I, Decision *D, Room R, double planned, double later) {
    struct State *T = I->state;
    long n = D->n, begun = 0;
    double *first = R.centre;
    for (long f = I->lines; f < D->frictions; f++) begun |= R.law[D->gaps + f] == STARTS;
    if (!begun) return 1;
    memcpy(first, D->free, sizeof(double) * (size_t)n);
    if (!decision_later(I, 2 * later, D)) return 0;
    for (long f = I->lines; f < D->frictions; f++) {
        long i = row_of(D, f);
        double grows[3] = {0};
        for (long k = 0; k < rows_of(D, f); k++) grows[k] = (D->free[i + k] - first[i + k]) / later;
        double jerk = hypot(grows[0], grows[1]), gain = planned * (size_of(D, f, R.rate) + 0.5 * planned * (rows_of(D, f) > 2 ? hypot(jerk, grows[2]) : jerk));
        if (R.law[D->gaps + f] != STARTS || !isfinite(gain)) continue;
        R.met[f] = fmax(R.met[f], gain);
        for (long k = i; k < i + rows_of(D, f); k++)
            for (long x = 0; x < I->nx && D->W[k * n + k] > 0; x++) T->size[x] = fmax(T->size[x], gain * fabs(D->J[x * n + k]) / D->W[k * n + k]);
    }
    for (long x = 0; x < I->nx; x++) T->later_x[x] = I->x[x] + (x < I->positions ? 0 : T->size[x]); /* and so large what these move */
    if (!rate_at(I, I->t, I->x, T->first_rate) || !rate_at(I, I->t, T->later_x, T->rate)) return 0;
    for (long x = 0; x < I->positions; x++) T->size[x] = fmax(T->size[x], planned * fabs(T->rate[x] - T->first_rate[x]));
    return decision_later(I, later, D);
}

/* What rounding makes of a slip. */
static double slip_noise(const Decision *D, long f) {
    double noise = 0;
    for (long k = 0; k < rows_of(D, f); k++) noise += D->rate_noise[row_of(D, f) + k];
    return noise;
}

/* Masks for the laws that have been found for accelerations. */
static void set_masks(Integrator *I, const Decision *D, Room R) {
    struct State *T = I->state;
    double largest = largest_in(D, R.push, D->valves, D->n);
    for (long i = 0; i < D->gaps; i++) {
        int carried = I->redundant && T->side[carried_of(I) + 1 + i] != 0;
        if (R.law[i] == HOLDS && !carried && i >= D->valves && !(R.push[i] * unit_of(own_of(D, i)) > NIL * largest)) R.law[i] = OPENS;
        T->side[i] = R.law[i] == HOLDS;
        double nothing = NIL * largest * unit_of(own_of(D, i));
        T->at_rest[i] = is_speed(D, i) && R.law[i] == OPENS && fabs(R.rate[i]) <= nothing ? nothing : 0;
        if (I->redundant) T->parting.near_zero[i] = i >= D->valves && R.law[i] == OPENS && fabs(R.rate[i]) <= AT_REST * largest * unit_of(own_of(D, i)) && kept_by_others(D, R.law, i, R.work, R.place);
    }
    for (long f = 0; f < D->frictions; f++) {
        long law = R.law[D->gaps + f], i = row_of(D, f);
        double *mask = T->side + mask_of(I, f), *e = R.along + 3 * f;
        mask[0] = law == HOLDS;
        if (f < I->lines) {
            mask[1] = law == AGAINST || law == STARTS ? e[0] : 0;
            continue;
        }
        double slip = size_of(D, f, D->rate), noise = slip_noise(D, f);
        R.met[f] = fmax(R.met[f], slip);
        double stops = size_of(D, f, R.rate) * BRIEFEST * EPS * fabs(I->t), least = fmax((rows_of(D, f) > 2 && law != STARTS ? NEARER : 1) * NEAR_ZERO * R.met[f], fmax(4 * noise, stops));
        int held = law == STARTS || (law == AGAINST && fmin(slip, R.slow[f]) < 1.5 * least); /* from one to twice that, as it came; later it may have passed zero */
        mask[1] = law == AGAINST && !held;
        mask[2] = held;
        mask[3] = least;
        for (long k = 0; k < rows_of(D, f); k++) mask[4 + k] = held ? e[k] : 0;
        if (rows_of(D, f) < 3) continue;
        double faster = hypot(D->rate[i], D->rate[i + 1]) - fabs(D->rate[i + 2]);
        mask[7] = mask[1] == 1 && fabs(faster) > ALIKE * slip ? (faster > 0 ? 1 : -1) : 0;
    }
    if (I->redundant) T->side[carried_of(I) - 1] = DAMPING * least_pivot(D, R.law, R.work, R.place);
}

/* Whether friction has no limit above zero, whatever reactions are: a clutch that is open. */
static int never_holds(const Decision *D, long f) {
    for (long k = 0; k < D->n; k++)
        if (D->hold_by[f * D->n + k] != 0) return 0;
    return D->hold[f] <= 0 && !grows_with_magnitudes(D, f);
}

/* Reactions of rows that depend on one another where the motion depends on how they share what they carry, as of feet that slide: not those that have been found first, but those that rates take in
   the mode, of least norm. Where one of these would pull it opens, though it does not part from what others hold. What has been found stays where that is no answer. */
static void share_as_rates_do(const Integrator *I, const Decision *D, const Problem *p, Room R) {
    long n = D->n, laws = D->gaps + D->frictions, *fixed = R.asked, *found = R.place, *first = I->state->margin_rows, pulls = 0, opened = 0;
    double *kept = R.floor;
    const double *carried = I->state->side + carried_of(I) + 1;
    if (least_pivot(D, R.law, R.work, R.place) == 0) return;
    memcpy(found, R.law, sizeof(long) * (size_t)laws);
    memcpy(first, R.law, sizeof(long) * (size_t)laws);
    memcpy(kept, R.push, sizeof(double) * (size_t)n);
    for (; opened <= D->gaps && pulls >= 0; opened++) {
        for (long k = 0; k < laws; k++) fixed[k] = found[k] == STARTS ? AGAINST : found[k];
        memcpy(R.centre, carried, sizeof(double) * (size_t)n);
        memcpy(R.push, carried, sizeof(double) * (size_t)n);
        int ends = 0;
        double most = 0, least = 0;
        for (long again = 0; again < UNDAMPED && !ends; again++) {
            if (!newton_of_laws(p, fixed)) break;
            double changed = most = 0;
            for (long i = 0; i < n; i++) {
                double unit = unit_of(D->W[i * n + i]);
                changed = fmax(changed, fabs(R.push[i] - R.centre[i]) * unit);
                most = fmax(most, fabs(R.push[i]) * unit);
            }
            memcpy(R.centre, R.push, sizeof(double) * (size_t)n);
            ends = changed <= FITS * most;
        }
        if (!ends) break;
        pulls = -1;
        for (long i = 0; i < D->gaps; i++) {
            double push = R.push[i] * unit_of(D->W[i * n + i]);
            if (found[i] == HOLDS && carried[i] == 0 && push < fmin(least, -NIL * most)) pulls = i, least = push;
        }
        if (pulls < 0) break;
        found[pulls] = OPENS;
    }
    memcpy(R.law, found, sizeof(long) * (size_t)laws);
    find_rates(p);
    if (pulls < 0 && opened > 0 && answers(p)) return;
    memcpy(R.law, first, sizeof(long) * (size_t)laws);
    memcpy(R.push, kept, sizeof(double) * (size_t)n);
    find_rates(p);
}

/* Which valves hold, by what is so much later [s], into their masks, with what others hold, T->given_push; `again`: those that do keep doing so unless that is wrong. Whether that has changed; -1 when
   the input function failed, -2 where no mode is possible. */
static int decide_valves(Integrator *I, Room R, double later, int again, Decision *D) {
    struct State *T = I->state;
    long v = I->valves, *law = R.law, *asked = R.wanted, *found = T->index_found;
    int changed = 0;
    if (!valves_later(I, 0, D)) return -1;
    for (long k = 0; k < D->n + D->frictions; k++) law[k] = k < v && R.touching[k] ? MAY_HOLD : OFF;
    int given = hold_shut(I, D, law);
    if (given < 0) return -1;
    memcpy(asked, law, sizeof(long) * (size_t)v);
    if (!valves_later(I, later, D)) return -1;
    Problem p = problem_of(I, D, R, D->free);
    int solved = given || again ? 0 : choose_valves(&p, R.place, T->lemke, T->basis);
    for (long i = 0; i < v; i++) {
        if (!solved) law[i] = asked[i] != MAY_HOLD ? asked[i] : T->side[i] == 1 ? HOLDS : OPENS;
        found[i] = law[i];
    }
    if (settle_rows(I, D, asked, law, R.push, R.rate)) solved = 1;
    else if (solved) memcpy(law, found, sizeof(long) * (size_t)v);
    I->worst = 0;
    for (long i = 0; i < v && !solved; i++)
        if (asked[i] != OFF) I->worst = i;
    if (!solved) return -2;
    for (long i = 0; i < v; i++) {
        changed |= T->side[i] != (law[i] == HOLDS);
        T->side[i] = law[i] == HOLDS;
        found[i] = law[i];
        T->given_push[i] = R.push[i];
    }
    I->worst = 0;
    return combine_others(I, D, R.push, R.rate) ? changed : -2;
}

/* Accelerations, looked at so much later [s], decide which of the rows that touch hold on, and which way friction acts, but for valves; `roughly`: they hardly tell which way. */
static enum Code decide_others(Integrator *I, Room R, double later, int *roughly, Decision *D, Problem *p) {
    struct State *T = I->state;
    long laws = I->one_sided + frictions_of(I), *asked = R.wanted;
    for (long k = carried_of(I); I->redundant && k < first_discrete(I); k++) T->side[k] = 0;
    if (!decision_at(I, I->t, I->x, D)) return INPUT_FAILED;
    for (long i = 0; i < D->gaps; i++) R.law[i] = i >= I->valves && R.touching[i] && (R.touching[i] == 2 || D->rate[i] <= least_rate(I, D, i, D->free[i])) ? MAY_HOLD : OFF;
    for (long f = 0; f < D->frictions; f++) R.law[D->gaps + f] = R.touching[D->gaps + f] == 1 ? MAY_HOLD : R.touching[D->gaps + f] == 3 ? MAY_SLIDE : AGAINST;
    memcpy(asked, R.law, sizeof(long) * (size_t)laws);
    for (long f = 0; f < D->frictions; f++) R.slow[f] = size_of(D, f, D->rate);
    if (!decision_later(I, later, D)) return INPUT_FAILED;
    memcpy(R.now, R.along, sizeof(double) * (size_t)(3 * D->frictions));
    turn_slips(D, R);
    for (long f = 0; f < D->frictions; f++)
        if (never_holds(D, f)) asked[D->gaps + f] = OFF;
    *p = problem_of(I, D, R, D->free);
    p->constants = 1;
    for (long again = 0; again <= D->frictions; again++) {
        *roughly = 0;
        memcpy(R.law, asked, sizeof(long) * (size_t)laws);
        int solved = complementary(p, R.place, T->lemke, T->basis), held = 0;
        if (I->redundant) {
            held = hold_more(I, D, asked, R.law, R.along, solved ? R.rate : 0, R.push, later);
            if (held < 0 || !decision_later(I, later, D)) return INPUT_FAILED; /* it has looked elsewhere */
            turn_slips(D, R);
            for (long k = 0; k < laws && held && !solved; k++) held = asked[k] == OFF || R.law[k] == HOLDS;
        }
        if (!solved && !held) {
            I->worst = 0;
            for (long k = 0; k < laws; k++)
                if (asked[k] != OFF) I->worst = k;
            return NO_MODE;
        }
        int begun = 0;
        for (long k = D->gaps; k < laws; k++) {
            if (R.law[k] != STARTS) continue;
            begun |= asked[k] == MAY_HOLD;
            asked[k] = MAY_SLIDE;
            *roughly |= solved == ROUGHLY;
        }
        if (!begun) break; /* what slips has another limit */
    }
    find_rates(p);
    if (I->redundant) share_as_rates_do(I, D, p, R);
    for (long f = 0; f < D->frictions; f++) /* not where nothing presses */
        if (R.law[D->gaps + f] == AGAINST && !(limit_of(p, f) > 0)) R.law[D->gaps + f] = OFF;
    for (long f = 0; f < D->frictions; f++)
        if (asked[D->gaps + f] == AGAINST) memcpy(R.along + 3 * f, R.now + 3 * f, sizeof(double) * 3);
    return REACHED_END;
}

/* All rows are decided by what is so much later [s]: valves first, then others with what these do, until valves stay as they are with what others do. */
static enum Code decide_when(Integrator *I, Room R, double planned, double later, int *roughly) {
    struct State *T = I->state;
    Decision D;
    Problem p;
    long n = reactions_of(I), v = I->valves, laws = I->one_sided + frictions_of(I);
    *roughly = 0;
    if (v) memset(T->given_push, 0, sizeof(double) * (size_t)n);
    for (long turns = 0, linked = v; n > v || turns == 0; turns++) {
        int changed = !v ? 1 : turns && !linked ? 0 : decide_valves(I, R, later, turns > 0, &D);
        if (changed == -1) return INPUT_FAILED;
        if (changed < 0 || turns > SETTLED * (v + 1)) return NO_MODE;
        if (turns && !changed) break;
        if (n == v) break;
        linked = 0;
        for (long i = 0; i < v; i++)
            for (long j = v; j < n; j++) linked |= D.W[i * n + j] != 0;
        enum Code code = decide_others(I, R, later, roughly, &D, &p);
        if (code != REACHED_END) return code;
        if (!v) break;
        memcpy(T->given_push + v, R.push + v, sizeof(double) * (size_t)(n - v));
        memcpy(T->index_found + v, R.law + v, sizeof(long) * (size_t)(laws - v));
    }
    if (v && n > v) {
        memcpy(R.law, T->index_found, sizeof(long) * (size_t)laws);
        memcpy(R.push, T->given_push, sizeof(double) * (size_t)n);
        if (!decision_later(I, later, &D)) return INPUT_FAILED;
        p = problem_of(I, &D, R, D.free);
        p.constants = 1;
        find_rates(&p);
    }
    if (!foresee_slips(I, &D, R, planned, later)) return INPUT_FAILED;
    set_masks(I, &D, R);
    if (n > v) set_directions_of_forces(I, &p);
    return REACHED_END;
}

/* How much later states are still what their rates here make of them, `most` at most: a leak lets go in no time what has been held. 0 when the input function failed. */
static double foreseen(Integrator *I, double most) {
    struct State *T = I->state;
    double h = most, least = SPENT * EPS * fabs(I->t), *first = T->first_rate, *x = T->later_x;
    for (int again = 0; again < 8 && h > least; again++) {
        double speed = 0, change = 0;
        if (!rate_at(I, I->t + h, I->x, T->rate)) return 0;
        memcpy(first, T->rate, sizeof(double) * (size_t)I->nx);
        for (long i = 0; i < I->nx; i++) x[i] = I->x[i] + h * first[i];
        if (!rate_at(I, I->t + h, x, T->rate)) return 0;
        for (long i = 0; i < I->nx; i++) {
            double size = fmax(T->size[i], h * fabs(first[i]));
            if (!(size > 0)) continue;
            speed += first[i] / size * (first[i] / size);
            change += (T->rate[i] - first[i]) / size * ((T->rate[i] - first[i]) / size);
        }
        if (change <= speed * (FORESEES * FORESEES)) return h;
        h *= isfinite(change) ? fmax(0.5 * FORESEES * sqrt(speed / change), 1e-6) : 1e-6;
    }
    return fmax(h, least);
}

/* Whether valves of the mode that has been set are no more than a little on the wrong side where it begins: else something else has changed by when it was looked at. -1 when the input
   function failed. */
static int is_true_now(Integrator *I, Room R) {
    struct State *T = I->state;
    Decision D;
    if (!valves_later(I, 0, &D) || !rows_at(I, I->t, I->x)) return -1;
    double most = largest_in(&D, R.push, 0, D.valves);
    for (long i = 0; i < D.valves; i++) {
        double unit = unit_of(own_of(&D, i)), size = T->side[i] == 1 ? T->one_row[i] * unit : T->one_row[i] / unit;
        if (size < -ATTRACTS * most && T->one_row[i] < -T->row_noise[i]) return 0;
    }
    return 1;
}

/* The same, not later than it takes to tell; nor so late that something else has changed, if it can be told. */
static enum Code decide_accelerations(Integrator *I, Room R, double planned) {
    struct State *T = I->state;
    double *before = T->lifted + I->masks, first = LATER; /* what begins with no rate is told from rounding later, where it has not lasted */
    enum Code code = REACHED_END;
    int roughly = 1;
    memcpy(before, T->side, sizeof(double) * (size_t)I->masks);
    if (I->valves) {
        double most = foreseen(I, 0.01 * TOO_LATE * planned);
        if (!(most > 0)) return INPUT_FAILED;
        planned = fmax(fmin(planned, most / LATER), SPENT * EPS / LATER * fabs(I->t)); /* what changes with time does not sooner */
    }
    for (long k = 0; k < T->changes && I->valves && first < 0.01; k++) first *= 10;
    for (double later = first; roughly && later < TOO_LATE; later *= 100) code = decide_when(I, R, planned, later * planned, &roughly);
    for (T->parting.hardly = 0; T->parting.inside && code == REACHED_END && T->parting.hardly < 2 && same_laws(I, before); T->parting.hardly++) /* that is known to be wrong somewhere in the step */
        for (double later = first; code == REACHED_END && later < 10 * TOO_LATE && same_laws(I, before); later *= 100) {
            memcpy(T->side, before, sizeof(double) * (size_t)I->masks);
            code = decide_when(I, R, planned, fmin(later, 1) * planned, &roughly);
        }
    T->parting.hardly = 0;
    for (double later = 0.01 * first; I->valves && later > SOONEST && later * planned > SPENT * EPS * fabs(I->t); later *= 0.01) {
        int holds = code == REACHED_END ? is_true_now(I, R) : 0;
        if (holds < 0) return INPUT_FAILED;
        if (holds) break;
        memcpy(T->side, before, sizeof(double) * (size_t)I->masks);
        code = decide_when(I, R, planned, later * planned, &roughly);
    }
    return code;
}

/* What is missing (n) of the rates of what holds is brought about by impulses of that alone. */
static void give_speeds(Integrator *I, const Decision *D, Room R, long *law, const double *missing) {
    struct State *T = I->state;
    Decision nothing = decision_of(I, T->no_change, 0);
    double *change = T->blow;
    Problem p = problem_of(I, D, R, missing);
    p.law = law;
    p.kinetic = 1;
    p.damping = DEPENDENT;
    memset(T->no_change, 0, sizeof(double) * (size_t)I->decision.outputs);
    memset(R.push, 0, sizeof(double) * (size_t)D->n);
    change_choice(&p, &nothing, missing, 0, T->choice_change, change);
    for (long i = 0; i < I->nx; i++)
        for (long j = 0; j < D->n; j++) I->x[i] += D->J[i * D->n + j] * change[j];
}

/* Slips in planes that begin together, without a jump of their accelerations: which ways they go is told by all of them at once, as those of feet by the point that a body turns about. What acts
   against directions that are held would not keep them there. So they begin with speeds, nothing beside those met, at which directions need not be held. Whether there are such; -1 when the input
   function failed. */
static int start_together(Integrator *I, Room R, double planned) {
    struct State *T = I->state;
    Decision D;
    long n = reactions_of(I), astray = 0, *law = R.asked;
    double *missing = R.centre, time = 0, fast = 0, most = 0;
    for (long f = I->lines; f < I->lines + I->planes; f++) astray |= R.law[I->one_sided + f] == STARTS;
    if (!I->redundant || !astray) return 0;
    astray = 0;
    if (!decision_at(I, I->t, I->x, &D)) return -1;
    memcpy(law, R.law, sizeof(long) * (size_t)(D.gaps + D.frictions));
    for (long i = 0; i < D.valves; i++) law[i] = OFF;
    for (long f = 0; f < D.frictions; f++) {
        double speed = size_of(&D, f, R.rate), held = size_of(&D, f, R.push) * D.W[row_of(&D, f) * (n + 1)];
        long *own = law + D.gaps + f;
        if (f < D.lines ? *own == STARTS : *own == AGAINST) *own = OFF;
        if (*own != STARTS) continue;
        if (f >= D.lines + D.planes || !(speed > 0) || speed * planned > SUDDEN * R.met[f]) return 0;
        time = fmax(time, 2 * T->side[mask_of(I, f) + 3] / speed);
        fast = fmax(fast, speed);
        most = fmax(most, held * held * planned * planned / R.met[f]);
    }
    if (!decision_later(I, SHORTLY * planned, &D)) return -1;
    for (long f = D.lines; f < D.lines + D.planes; f++) {
        const double *slip = D.rate + row_of(&D, f), *e = R.along + 3 * f;
        astray |= law[D.gaps + f] == STARTS && fabs(slip[0] * e[1] - slip[1] * e[0]) > OFF_COURSE * hypot(slip[0], slip[1]);
    }
    if (!astray) return 0;
    time = fmax(time, BEGUN * most / fast);
    if (!decision_at(I, I->t, I->x, &D)) return -1;
    for (long i = 0; i < n; i++) missing[i] = 0;
    for (long f = D.lines; f < D.lines + D.planes; f++) {
        double *mask = T->side + mask_of(I, f);
        if (law[D.gaps + f] != STARTS) continue;
        law[D.gaps + f] = HOLDS;
        for (long k = row_of(&D, f); k < row_of(&D, f) + 2; k++) missing[k] = -time * R.rate[k];
        mask[1] = 1, mask[2] = mask[4] = mask[5] = 0;
    }
    give_speeds(I, &D, R, law, missing);
    T->begins_in = time;
    return 1;
}

/* Slips in planes that have begun, against directions that were held, are let go (3 in R.touching) in the directions in which they would begin here, which forces tell better than accelerations that
   are still small: what is off these was made of how the others were held, and is forgotten at once. Whether there were such; -1 when the input function failed. */
static int let_go(Integrator *I, Room R) {
    struct State *T = I->state;
    Decision D;
    long n = reactions_of(I), freed = 0, *law = R.asked;
    double *missing = R.centre;
    for (long f = I->lines; f < I->lines + I->planes; f++) freed |= R.touching[I->one_sided + f] == 3;
    if (!freed) return 0;
    if (!decision_at(I, I->t, I->x, &D)) return -1;
    for (long k = 0; k < D.gaps + D.frictions; k++) law[k] = k >= D.valves && R.law[k] == HOLDS ? HOLDS : OFF;
    for (long i = 0; i < n; i++) missing[i] = 0;
    for (long f = D.lines; f < D.lines + D.planes; f++) {
        long i = row_of(&D, f);
        double *mask = T->side + mask_of(I, f), part = 0;
        if (R.touching[D.gaps + f] != 3) continue;
        for (long k = i; k < i + 2; k++) part += D.rate[k] * R.push[k];
        part /= R.push[i] * R.push[i] + R.push[i + 1] * R.push[i + 1];
        for (long k = i; k < i + 2; k++) missing[k] = D.rate[k] - part * R.push[k];
        law[D.gaps + f] = HOLDS;
        R.law[D.gaps + f] = AGAINST;
        R.touching[D.gaps + f] = 2;
        mask[1] = 1, mask[2] = mask[4] = mask[5] = 0;
        double speed = fabs(part) * hypot(R.push[i], R.push[i + 1]), doubles = speed / size_of(&D, f, R.rate);
        mask[3] = fmin(mask[3], 0.5 * speed); /* it is not held again at once */
        if (!(doubles > I->state->begins_in && I->state->begins_in > 0)) I->state->begins_in = doubles;
    }
    give_speeds(I, &D, R, law, missing);
    return 1;
}
