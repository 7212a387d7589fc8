/* Impacts: impulses of the rows that touch where a gap that is closed closes with speed.

   All at once, with friction as a complementarity problem (Glocker and Pfeiffer, Nonlinear Dynamics 7, 1995). By Poisson in two phases: compression, then expansion with so much
   of its impulses. By Newton in one: rates after it are at least so much of those before, with the other sign. Slips that friction brings back (`back`) in the last phase.

   One after the other: each as if it were alone, as long as any closes. Where several close at once and move one another, no law says which comes first.

   Alone, by energy (Stronge, Proc. R. Soc. Lond. A 431, 1990): along the path of its normal impulse P, on which the slip may stop, turn round or bend (Darboux 1880; Keller, J. Appl.
   Mech. 53, 1986), to where the normal force has given back e^2 of the work that it has taken. */

#define BLOWS 1000    /* one after the other, for each gap */
#define PULLS 8       /* sequence of midpoint rules that are extrapolated */
#define SLIP_ENDS 1e-14
static int impact_law(const Decision *D, long i) { return (int)D->kind[i] & 3; }
static int is_alone(const Decision *D, long i) { return D->kind[i] > 0 && ((int)D->kind[i] & ~NO_GAP) >= BY_ENERGY; }
static int is_plain(const Decision *D, long i) { return ((int)D->kind[i] & ~NO_GAP) == BY_POISSON; }
static int is_speed(const Decision *D, long i) { return D->kind[i] >= NO_GAP; } /* that must not be negative, of what has no gap */

static int make_impacts(Integrator *I) {
    struct State *T = I->state;
    T->blow = reserve_doubles(I, 4 * reactions_of(I));
    return I->counted || T->blow != 0;
}

/* Whether a law takes part in an impact of all that touch together, or of one gap `only`. */
static int takes_part(const Decision *D, const long *touching, long only, long k) { return touching[k] && k >= D->valves && (k >= D->gaps || (only < 0 ? !is_alone(D, k) : k == only)); }

/* All that touch at once, or one gap `only`: `rate` becomes that after it, `total` grows. Limits of friction that do not grow with impulses are nothing beside them. */
static int strike_together(Integrator *I, const Decision *D, Room R, long only, double *rate, double *total) {
    struct State *T = I->state;
    long n = D->n;
    double *start = R.before, *first = R.compressed, *met = T->blow + 3 * n;
    Problem p = problem_of(I, D, R, rate);
    p.kinetic = 1;
    int compresses = 0;
    memcpy(met, rate, sizeof(double) * (size_t)n);
    memset(first, 0, sizeof(double) * (size_t)n);
    for (long i = 0; i < D->gaps; i++) compresses |= takes_part(D, R.touching, only, i) && impact_law(D, i) == BY_POISSON;
    for (int phase = !compresses; phase < 2; phase++) {
        for (long k = 0; k < D->gaps + D->frictions; k++) R.law[k] = takes_part(D, R.touching, only, k) ? MAY_HOLD : OFF;
        if (phase) {
            memcpy(start, rate, sizeof(double) * (size_t)n);
            for (long i = 0; i < D->gaps; i++) {
                int newton = takes_part(D, R.touching, only, i) && impact_law(D, i) == BY_NEWTON;
                R.floor[i] = newton ? -first[i] : D->bounce[i] * fmax(first[i], 0);
                if (newton) start[i] += D->bounce[i] * fmin(met[i], 0);
            }
            for (long f = 0; f < D->frictions; f++)
                for (long k = 0; k < rows_of(D, f); k++) start[row_of(D, f) + k] += D->back[f] * met[row_of(D, f) + k];
            p.start = start, p.floor = R.floor;
        }
        if (!complementary(&p, R.place, T->lemke, T->basis)) return 0;
        if (I->directions) change_phase(I, &p, phase, first);
        if (phase == 0) memcpy(first, R.push, sizeof(double) * (size_t)n);
        for (long i = 0; i < n; i++) {
            total[i] += R.push[i];
            for (long j = 0; j < n; j++) rate[i] += D->W[i * n + j] * R.push[j];
        }
    }
    return 1;
}

/* On the path of an impact: slip, rate of the gap, normal impulse, work of it, impulses of friction. */
typedef struct {
    double slip[2], rate, P, work, drag[2];
} Blow;

/* Compliances of a gap and its friction, by which a blow goes on; its limit per normal impulse. */
typedef struct {
    double nn, tn[2], tt[2][2], mu, holds;
    long size;
} Struck;

/* Slopes by tau, dP = |slip| dtau, in which the stop is infinitely far and the path smooth. */
static Blow slope_of(const Struck *S, const Blow *b) {
    double s = hypot(b->slip[0], b->slip[1]), u = b->slip[0], v = b->slip[1];
    Blow d = {.P = s, .work = s * b->rate, .drag = {-S->mu * u, -S->mu * v}};
    for (int k = 0; k < 2; k++) d.slip[k] = s * S->tn[k] - S->mu * (S->tt[k][0] * u + S->tt[k][1] * v);
    d.rate = s * S->nn - S->mu * (S->tn[0] * u + S->tn[1] * v);
    return d;
}

/* a + h b, entry by entry. */
static Blow gone(Blow a, double h, Blow b) {
    return (Blow){{a.slip[0] + h * b.slip[0], a.slip[1] + h * b.slip[1]}, a.rate + h * b.rate, a.P + h * b.P, a.work + h * b.work, {a.drag[0] + h * b.drag[0], a.drag[1] + h * b.drag[1]}};
}

/* The blow a stretch of tau later: midpoint rules with 2, 4, 6 ... parts, extrapolated (Gragg). */
static Blow later_blow(const Struck *S, Blow b, double h) {
    Blow row[PULLS];
    for (int k = 0; k < PULLS; k++) {
        int parts = 2 * (k + 1);
        double part = h / parts;
        Blow before = b, now = gone(b, part, slope_of(S, &b));
        for (int j = 1; j < parts; j++) {
            Blow next = gone(before, 2 * part, slope_of(S, &now));
            before = now, now = next;
        }
        row[k] = now;
        for (int j = k - 1; j >= 0; j--) {
            double ratio = (double)(k + 1) / (j + 1), by = 1 / (ratio * ratio - 1);
            row[j] = gone(gone(row[j + 1], by, row[j + 1]), -by, row[j]);
        }
    }
    return row[0];
}

/* What is still to come until the phase is over: the rate of the gap that is left, with its sign, or the work. */
static double ahead_of(const Blow *b, int expands, double work) { return expands ? work - b->work : -b->rate; }

/* Along a straight line: friction `t` per normal impulse. Up to the end of the phase, or of the slip; 1 where the phase is over, -1 where neither ends. */
static int go_straight(const Struck *S, Blow *b, const double *t, int slips, int expands, double work) {
    double a = S->nn + S->tn[0] * t[0] + S->tn[1] * t[1], c[2], end = INFINITY, stop = INFINITY;
    for (int k = 0; k < 2; k++) c[k] = S->tn[k] + S->tt[k][0] * t[0] + S->tt[k][1] * t[1];
    if (slips && b->slip[0] * c[0] + b->slip[1] * c[1] < 0) stop = hypot(b->slip[0], b->slip[1]) / hypot(c[0], c[1]);
    if (!expands) end = a > 0 ? fmax(-b->rate, 0) / a : b->rate < 0 ? INFINITY : 0;
    else {
        double left = fmax(work - b->work, 0), under = b->rate * b->rate + 2 * a * left;
        if (left == 0) end = 0;
        else if (under >= 0 && b->rate + sqrt(under) > 0) end = 2 * left / (b->rate + sqrt(under));
    }
    double P = fmin(end, stop);
    if (!(P < INFINITY)) return -1;
    b->work += P * (b->rate + 0.5 * a * P);
    b->P += P;
    b->rate = end <= stop && !expands ? 0 : b->rate + a * P;
    for (int k = 0; k < 2; k++) {
        b->drag[k] += t[k] * P;
        b->slip[k] = !slips || stop <= end ? 0 : b->slip[k] + c[k] * P;
    }
    return end <= stop;
}

/* The direction in which slip begins where friction does not hold it: that in which it then goes on. */
static void find_ray(const Struck *S, double *e) {
    double last = 0, at = 0, step = 2 * 3.14159265358979323846 / 256, least = -INFINITY, found = 0;
    for (int k = 0; k <= 256; k++) {
        double lo = at, hi = at = k * step, value = 0;
        for (int again = 0; again < 60; again++) {
            double angle = again == 0 || k == 0 ? hi : 0.5 * (lo + hi), x = cos(angle), y = sin(angle);
            double u = S->tn[0] - S->mu * (S->tt[0][0] * x + S->tt[0][1] * y), v = S->tn[1] - S->mu * (S->tt[1][0] * x + S->tt[1][1] * y), across = x * v - y * u;
            if (again == 0) value = across;
            if (k == 0 || (again == 0 && !(across == 0 || (across < 0) != (last < 0)))) break;
            if (again && (across < 0) == (last < 0)) lo = angle;
            else if (again) hi = angle;
            if (again == 59 && x * u + y * v > least) least = x * u + y * v, found = angle;
        }
        last = value;
    }
    e[0] = cos(found), e[1] = sin(found);
}

/* To the end of a phase; 0 where it has none. */
static int finish_phase(const Struck *S, Blow *b, int expands, double work, double first) {
    double rate = S->mu * (fabs(S->tt[0][0]) + fabs(S->tt[1][1])) + hypot(S->tn[0], S->tn[1]), h = 0.25 / rate;
    for (int pieces = 0; pieces < 1000; pieces++) {
        double slip = hypot(b->slip[0], b->slip[1]), none[2] = {0, 0}, t[2] = {0, 0};
        if (S->size == 0) return go_straight(S, b, none, 0, expands, work) > 0;
        if (slip <= SLIP_ENDS * first) { /* sticks, or begins to slip along a ray */
            double det = S->size > 1 ? S->tt[0][0] * S->tt[1][1] - S->tt[0][1] * S->tt[1][0] : S->tt[0][0];
            t[0] = -(S->size > 1 ? S->tt[1][1] * S->tn[0] - S->tt[0][1] * S->tn[1] : S->tn[0]) / det;
            t[1] = S->size > 1 ? -(S->tt[0][0] * S->tn[1] - S->tt[1][0] * S->tn[0]) / det : 0;
            b->slip[0] = b->slip[1] = 0;
            if (hypot(t[0], t[1]) <= S->holds) return go_straight(S, b, t, 0, expands, work) > 0;
            double e[2] = {S->tn[0] < 0 ? -1 : 1, 0};
            if (S->size > 1) find_ray(S, e);
            t[0] = -S->mu * e[0], t[1] = -S->mu * e[1];
            return go_straight(S, b, t, 1, expands, work) > 0;
        }
        if (S->size == 1 || S->mu == 0) {
            t[0] = -S->mu * b->slip[0] / slip, t[1] = -S->mu * b->slip[1] / slip;
            int over = go_straight(S, b, t, S->mu > 0, expands, work);
            if (over) return over > 0;
            continue;
        }
        Blow next = later_blow(S, *b, h);
        double left = ahead_of(b, expands, work), after = ahead_of(&next, expands, work);
        if (after > 0) {
            *b = next;
            continue;
        }
        double lo = 0, hi = h, at = h * left / (left - after); /* regula falsi, halved where it stands */
        for (int again = 0; again < 60 && hi - lo > EPS * h; again++) {
            next = later_blow(S, *b, at);
            double value = ahead_of(&next, expands, work);
            if (value > 0) lo = at, left = value, after *= 0.5;
            else hi = at, after = value, left *= again ? 0.5 : 1;
            at = value == 0 ? at : hi - (hi - lo) * after / (after - left);
            if (value == 0) break;
        }
        *b = later_blow(S, *b, at);
        return 1;
    }
    return 0;
}

/* A gap alone, by energy, with its friction f, -1: none. */
static int strike_alone(const Decision *D, long i, long f, double *rate, double *total) {
    long n = D->n, first = f < 0 ? 0 : row_of(D, f);
    Struck S = {.nn = D->W[i * n + i], .size = f < 0 ? 0 : rows_of(D, f)};
    Blow b = {.rate = rate[i]};
    for (long k = 0; k < S.size; k++) {
        b.slip[k] = rate[first + k];
        S.tn[k] = D->W[(first + k) * n + i];
        for (long c = 0; c < S.size; c++) S.tt[k][c] = D->W[(first + k) * n + first + c];
    }
    if (f >= 0) S.mu = D->slide_by[f * n + i], S.holds = D->hold_by[f * n + i];
    double fast = fmax(hypot(b.slip[0], b.slip[1]), fabs(b.rate) * sqrt((S.tt[0][0] + S.tt[1][1]) / S.nn));
    if (!finish_phase(&S, &b, 0, 0, fast) || !finish_phase(&S, &b, 1, (1 - D->bounce[i] * D->bounce[i]) * b.work, fast)) return 0;
    total[i] += b.P;
    for (long k = 0; k < S.size; k++) total[first + k] += b.drag[k];
    for (long r = 0; r < n; r++) {
        rate[r] += D->W[r * n + i] * b.P;
        for (long k = 0; k < S.size; k++) rate[r] += D->W[r * n + first + k] * b.drag[k];
    }
    return 1;
}

/* The friction whose limit grows with the push of a gap, -1 where there is none. */
static long friction_of(const Decision *D, const long *touching, long i) {
    for (long f = 0; f < D->frictions; f++)
        if (touching[D->gaps + f] && D->slide_by[f * D->n + i] != 0) return f;
    return -1;
}

/* Whether an impact of one gap moves another gap that closes, or its friction. */
static int moves_other(const Decision *D, const long *touching, long i, long j) {
    long n = D->n, f[2] = {friction_of(D, touching, i), friction_of(D, touching, j)}, rows[2][4], count[2];
    const long gap[2] = {i, j};
    for (int side = 0; side < 2; side++) {
        rows[side][0] = gap[side];
        count[side] = 1;
        for (long k = 0; f[side] >= 0 && k < rows_of(D, f[side]); k++) rows[side][count[side]++] = row_of(D, f[side]) + k;
    }
    for (long a = 0; a < count[0]; a++)
        for (long b = 0; b < count[1]; b++) {
            long r = rows[0][a], c = rows[1][b];
            if (fabs(D->W[r * n + c]) > NIL * sqrt(D->W[r * n + r] * D->W[c * n + c])) return 1;
        }
    return 0;
}

/* Impulses of an impact, into T->impulse, of the laws that touch. */
static enum Code impact(Integrator *I, const Decision *D, Room R) {
    struct State *T = I->state;
    long n = D->n, *shut = R.wanted;
    double *rate = T->blow, *met = T->blow + n, *total = T->blow + 2 * n, taken = 0, gained = 0, fastest = 0;
    int plain = 1;
    memset(total, 0, sizeof(double) * (size_t)n);
    memcpy(rate, D->rate, sizeof(double) * (size_t)n);
    memcpy(met, D->rate, sizeof(double) * (size_t)n);
    for (long i = 0; i < D->gaps; i++) {
        plain &= !R.touching[i] || is_plain(D, i);
        if (R.touching[i] && met[i] < 0) fastest = fmax(fastest, -met[i] / unit_of(D->W[i * n + i]));
    }
    for (long f = 0; f < D->frictions; f++) plain &= !R.touching[D->gaps + f] || D->back[f] == 0;
    for (long law = 0; law < D->gaps + D->frictions && I->directions; law++) {
        if (law >= D->gaps && rows_of(D, law - D->gaps) > 2) return not_derived(I, law, OF_PATCH);
        if (!R.touching[law]) continue;
        if (law < D->gaps && !is_plain(D, law)) return not_derived(I, law, OTHER_LAW);
        if (law >= D->gaps && D->back[law - D->gaps] != 0) return not_derived(I, law, BRINGS_BACK);
    }
    for (long blows = 0; blows < (plain ? 1 : BLOWS * D->gaps); blows++) {
        long closes = plain, together = plain; /* where all strike together, what touches is asked only once */
        for (long i = 0; i < D->gaps; i++) {
            double least = fmax(D->rate_noise[i], NIL * fabs(met[i])), moved = 0;
            for (long j = 0; j < n; j++) moved += fabs(D->W[i * n + j] * total[j]);
            least = fmax(least, NIL * moved);
            shut[i] = R.touching[i] && rate[i] < -least;
            for (long j = 0; j < D->gaps && shut[i]; j++) {
                if (!R.touching[j] || !(met[j] < 0) || D->W[i * n + j] == 0) continue;
                least = fmax(least, NIL * unit_of(D->W[i * n + i]) / unit_of(D->W[j * n + j]) * -met[j]);
                shut[i] = rate[i] < -least;
            }
            for (long j = 0; j < i && shut[i]; j++) {
                if (!shut[j] || (!is_alone(D, i) && !is_alone(D, j)) || !moves_other(D, R.touching, i, j)) continue;
                double one = -rate[i] / unit_of(D->W[i * n + i]), other = -rate[j] / unit_of(D->W[j * n + j]);
                int least_of_all = rate[i] >= -MET * D->rate_noise[i] && rate[j] >= -MET * D->rate_noise[j];
                if (least_of_all || fmax(one, other) <= FITS * fastest) { /* what is left of blows without end: the faster one first */
                    shut[one > other ? j : i] = 0;
                    continue;
                }
                I->worst = j, I->other = i;
                return TIED;
            }
            closes |= shut[i];
            together |= shut[i] && !is_alone(D, i);
        }
        if (!closes) break;
        for (long i = 0; i < D->gaps; i++) { /* those of one round do not move one another */
            if (!shut[i] || !is_alone(D, i)) continue;
            int by_energy = impact_law(D, i) == BY_ENERGY;
            if (!(by_energy ? strike_alone(D, i, friction_of(D, R.touching, i), rate, total) : strike_together(I, D, R, i, rate, total))) return NO_MODE;
        }
        if (together && !strike_together(I, D, R, -1, rate, total)) return NO_MODE;
    }
    memcpy(T->impulse, total, sizeof(double) * (size_t)n);
    for (long i = 0; i < n; i++) {
        taken += fabs(total[i]) * (fabs(met[i]) + fabs(rate[i])) / 2;
        gained += total[i] * (met[i] + rate[i]) / 2;
    }
    return plain || gained <= FITS * taken ? REACHED_END : GAINS;
}
