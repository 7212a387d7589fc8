/* What modes are decided by at a place, what of that has jumped there, and transitions; see modes.h. */

#define TOUCHES 16.0   /* roundings within which gaps are closed and slips are zero */
#define LATER 1e-6     /* of a step: where accelerations are looked at */
#define TOO_LATE 1.0   /* not so much later */
#define CHANGES 40     /* of mode in one instant, which tell that no mode lasts */
#define UNSEEN 1e-12   /* of a state: a jump that is none */
#define BRIDGE -2      /* in place of the row that led to a transition: impacts without end are over */
#define NIL 1e-11      /* of the largest: a reaction or a rate that is zero */
#define DEPENDENT 1e-9 /* pivots of rows that depend on one another, in units of their diagonal */
#define DAMPING 1e-6   /* of these, in units of the least of the other pivots, see acausal/reduce/modes.py */
#define NEAR_ZERO 1e-9 /* of the slips met: where their direction is held */
#define ATTRACTS 1e-3   /* of the largest reaction: what cannot be that of a contact that presses */

static long frictions_of(const Integrator *I) { return I->lines + I->planes + I->patches; }
static long reactions_of(const Integrator *I) { return I->one_sided + I->lines + 2 * I->planes + 3 * I->patches; }

/* Where the masks of a friction begin. */
static long mask_of(const Integrator *I, long friction) {
    long n = I->one_sided, patch = friction - I->lines - I->planes;
    return friction < I->lines ? n + 2 * friction : n + 2 * I->lines + 6 * (friction - I->lines) + (patch > 0 ? 2 * patch : 0);
}

/* Where the masks of a magnitude begin: the direction that its force is along, until it is across it. */
static long mask_of_size(const Integrator *I, long m) { return mask_of(I, frictions_of(I)) + 3 * m; }

/* Whether a row of a mode has a corner at zero: that of a slip in a plane, which is its size. */
static int has_corner(const Integrator *I, long row) {
    long f = (row - I->one_sided) / 2;
    return row >= I->one_sided + 2 * I->lines && row < I->one_sided + 2 * frictions_of(I) && !((row - I->one_sided) & 1) && I->state->side[mask_of(I, f) + 1] == 1;
}

/* Number of the law, or behind all laws of what is set, that a row belongs to; 0 for none in particular. */
static long law_of_row(const Integrator *I, long row) {
    long gaps = I->one_sided, set = row - first_set(I);
    if (set >= 0) return gaps + frictions_of(I) + set;
    long law = row < gaps ? row : gaps + (row - gaps) / 2;
    return row < 0 ? 0 : law < gaps + frictions_of(I) ? law : gaps;
}

/* Derivatives end at a law. */
static enum Code not_derived(Integrator *I, long law, enum Obstacle obstacle) {
    I->worst = law, I->other = obstacle;
    return NO_DERIVATIVES;
}

static int make_zeno(Integrator *I);
static int make_saltation(Integrator *I);
static int make_margin(Integrator *I);
static int make_impacts(Integrator *I);
static long carried_of(const Integrator *I);

/* Of a program's statements those up to the last one of its first results, into `begin` if that is not null; how many. */
static long beginning_of(const int *program, long results, int *begin) {
    const int unit = (int)sizeof(V);
    long count = 0;
    for (const int *s = program; *s != OP_END; s += WIDTH)
        if (*s == OP_STORE && s[1] / unit < results) count = (s - program) / WIDTH + 1;
    for (long k = 0; k < WIDTH * count && begin; k++) begin[k] = program[k];
    for (long k = 0; k < WIDTH && begin; k++) begin[WIDTH * count + k] = k ? 0 : OP_END;
    return count;
}

/* Sizes of T->push and T->status, see room_of. */
static long doubles_of_room(const Integrator *I) {
    long n = reactions_of(I), F = frictions_of(I);
    return 6 * n + 3 * F + F + n * n + 6 * n + 3 * F + F;
}

static long longs_of_room(const Integrator *I) { return 5 * (reactions_of(I) + frictions_of(I)) + 1; }

/* Results of the decision's kernel of which it is known what rounding makes of them: gaps and rates, and what valves are without reactions. */
static long counted_of(const Integrator *I) { return I->one_sided + reactions_of(I) + I->valves; }

static int make_modes(Integrator *I) {
    struct State *T = I->state;
    long n = reactions_of(I), F = frictions_of(I), most = I->one_sided + 2 * F, width = 2 * most + 2;
    T->later_x = reserve_doubles(I, I->nx + 1);
    T->impulse = reserve_doubles(I, n + 1);
    T->heat = reserve_doubles(I, n + 1);
    T->first_rate = reserve_doubles(I, I->nx + 1);
    if (I->directions && !make_saltation(I)) return 0;
    if (!n) return I->counted || (T->later_x && T->first_rate && T->impulse && T->heat);
    if (!arranged(I, &I->decision, &T->decision_in, &T->decision_out, &T->decision_c, 1 + I->nx + I->nu)) return 0;
    if (!I->counted) give_inputs(I, T->decision_in);
    T->decided = reserve_doubles(I, I->decision.outputs);
    T->decided_noise = reserve_doubles(I, I->decision.outputs);
    T->alone = reserve_doubles(I, reactions_of(I));
    T->decided_rounds = reserve_doubles(I, counted_of(I));
    T->decided_from = reserve_lanes(I, GROUP * (1 + I->nx + I->nu));
    if (GROUP > 1 && I->decision.program && !I->decision.twofold) {
        T->decision_begins = reserve(I, sizeof(int) * (size_t)(WIDTH * (beginning_of(I->decision.program, counted_of(I), 0) + 1)));
        if (T->decision_begins) beginning_of(I->decision.program, counted_of(I), T->decision_begins);
    }
    T->lemke = reserve_doubles(I, most * width + width);
    T->push = reserve_doubles(I, doubles_of_room(I));
    T->choice_change = reserve_doubles(I, 2 * n * n + 7 * n);
    T->no_change = reserve_doubles(I, I->decision.outputs);
    T->lifted = reserve_doubles(I, 2 * I->masks + 1);
    T->leaves = reserve(I, sizeof(long) * (size_t)(I->one_sided + 1));
    T->near_knot = reserve_doubles(I, I->one_sided + n + I->nx * n);
    T->gap_terms = reserve_doubles(I, I->one_sided);
    T->at_rest = reserve_doubles(I, I->one_sided);
    T->basis = reserve(I, sizeof(long) * (size_t)(2 * most + 2));
    T->status = reserve(I, sizeof(long) * (size_t)longs_of_room(I));
    if (I->valves) {
        long v = I->valves;
        T->row_unit = reserve_doubles(I, n);
        T->row_terms = reserve_doubles(I, v);
        T->free_noise = reserve_doubles(I, v);
        T->given_push = reserve_doubles(I, n);
        T->given_free = reserve_doubles(I, n);
        T->index_work = reserve_doubles(I, 4 * v * v + 2 * v);
        T->index_rows = reserve(I, sizeof(long) * (size_t)(3 * v));
        T->index_found = reserve(I, sizeof(long) * (size_t)(I->one_sided + F));
        if (!I->counted && !(T->row_unit && T->row_terms && T->free_noise && T->given_push && T->given_free && T->index_work && T->index_rows && T->index_found)) return 0;
    }
    if (!make_zeno(I) || !make_margin(I) || !make_impacts(I) || !make_thin(I)) return 0;
    return I->counted || (T->decided && T->decided_noise && T->alone && T->decided_rounds && T->decided_from && T->lemke && T->impulse && T->heat && T->push && T->choice_change && T->no_change && T->later_x && T->first_rate && T->lifted && T->leaves && T->near_knot && T->gap_terms && T->at_rest && T->basis && T->status);
}

/* Parts of T->push and T->status. */
typedef struct {
    double *push, *rate, *compressed, *floor, *before, *centre, *along, *met, *work, *now, *slow;
    long *touching, *law, *asked, *place, *wanted;
} Room;
static Room room_of(const Integrator *I) {
    struct State *T = I->state;
    long n = reactions_of(I), F = frictions_of(I);
    double *at = T->push;
    long *k = T->status;
    return (Room){at, at + n, at + 2 * n, at + 3 * n, at + 4 * n, at + 5 * n, at + 6 * n, at + 6 * n + 3 * F, at + 6 * n + 4 * F, at + 6 * n + 4 * F + n * n + 6 * n, at + 6 * n + 7 * F + n * n + 6 * n, k, k + n + F, k + 2 * (n + F), k + 3 * (n + F), k + 4 * (n + F)};
}

/* What is to be solved for there, from these rates or accelerations on; without limits that do not grow with reactions, unless it is said that they count. */
static Problem problem_of(const Integrator *I, const Decision *D, Room R, const double *start) {
    return (Problem){.D = D, .start = start, .damping = !I->redundant ? 0 : I->state->parting.hardly ? DEPENDENT : DAMPED, .law = R.law, .asked = R.asked, .along = R.along, .push = R.push, .rate = R.rate, .centre = R.centre, .work = R.work};
}

/* Parts of the results of the decision's kernel, or of their changes; `noise`: of gaps and rates, or null. */
static Decision decision_of(const Integrator *I, const double *at, const double *noise) {
    long gaps = I->one_sided, m = frictions_of(I), n = reactions_of(I), v = I->valves;
    Decision D = {.n = n, .valves = v, .gaps = gaps, .lines = I->lines, .planes = I->planes, .frictions = m, .magnitudes = I->magnitudes, .gap = at, .gap_noise = noise, .rate_noise = noise ? noise + gaps : 0};
    D.rate = at + gaps;
    D.free = D.rate + n;
    D.W = D.free + n;
    D.J = D.W + n * n;
    D.hold = D.J + I->nx * n;
    D.hold_by = D.hold + m;
    D.slide = D.hold_by + m * n;
    D.slide_by = D.slide + m;
    D.kind = D.slide_by + m * n;
    D.back = D.kind + gaps;
    D.bounce = D.back + m;
    D.force = D.bounce + gaps + 1;
    D.force_by = D.force + 3 * I->magnitudes;
    D.hold_size = D.force_by + 3 * I->magnitudes * n;
    D.slide_size = D.hold_size + m * I->magnitudes;
    D.pressure = D.slide_size + m * I->magnitudes;
    D.values = D.pressure + I->patches;
    D.rates = D.values + v * v;
    if (v) D.own = I->state->row_unit;
    D.terms = D.rates + v * v;
    return D;
}

#include "index.h"

/* The arguments of the decision's kernel at (t, x), and others that differ by roundings, into T->decided_from. -1 when the input function failed; else whether they were there already. */
static int arguments_at(Integrator *I, double t, const double *x) {
    struct State *T = I->state;
    long count = 1 + I->nx + I->nu;
    V *in = T->decision_in;
    int known = T->is_decided;
    T->is_decided = 0;
    if (!find_drift(I, t, x)) return -1;
    for (long from = 0; from < COUNTED; from += LANES) {
        for (long l = 0; l < LANES; l++)
            for (long i = -1; i < I->nx; i++) in[1 + i][l] = disturbed_by(I, t, x, i, from + l);
        if (!inputs_at(I, in[0], LANES, in + 1 + I->nx)) return -1;
        V *kept = T->decided_from + from / LANES * count;
        known = known && memcmp(kept, in, sizeof(V) * (size_t)count) == 0;
        memcpy(kept, in, sizeof(V) * (size_t)count);
    }
    T->is_decided = 1;
    return known;
}

/* At (t, x) with the masks there are, and what rounding makes of gaps and rates. 0 when the input function failed. */
static int decision_at(Integrator *I, double t, const double *x, Decision *D) {
    struct State *T = I->state;
    V *in = T->decision_in;
    long gaps = I->one_sided, n = reactions_of(I), first = counted_of(I), count = 1 + I->nx + I->nu;
    int known = arguments_at(I, t, x);
    if (known < 0) return 0;
    for (long o = 0; o < first && !known; o++) T->decided_rounds[o] = 0;
    for (long from = 0; from < COUNTED && !known; from += LANES) {
        memcpy(in, T->decided_from + from / LANES * count, sizeof(V) * (size_t)count);
        if (from > 0 && !I->decision.run && T->decision_begins) interpret(T->decision_begins, in, T->decision_c, T->decision_out);
        else run_kernel(&I->decision, in, T->decision_c, T->decision_out, T->work);
        if (from == 0)
            for (long o = 0; o < I->decision.outputs; o++) T->decided[o] = T->decision_out[o][0];
        for (long o = 0; o < first; o++)
            for (long l = 0; l < LANES; l++) {
                double change = fabs(T->decision_out[o][l] - T->decided[o]);
                if (change < INFINITY) T->decided_rounds[o] = fmax(T->decided_rounds[o], TOUCHES * change);
            }
    }
    memcpy(T->decided_noise, T->decided_rounds, sizeof(double) * (size_t)first);
    *D = decision_of(I, T->decided, T->decided_noise);
    if (I->valves) {
        find_units(I, D);
        for (long i = 0; i < I->valves; i++) T->free_noise[i] = fmax(T->decided_rounds[gaps + n + i], TOUCHES * EPS * T->row_terms[i]);
    }
    for (long i = 0; i < gaps; i++) {
        T->gap_terms[i] = fmax(D->terms[i], 0);
        T->decided_noise[i] = fmax(T->decided_noise[i], (T->begun ? 2 : TOUCHES) * EPS * T->gap_terms[i]); /* where things are put is rounded too */
        double all = T->begun || D->terms[i] < 0 ? 0 : I->end - I->t, moves = all * (fabs(D->rate[i]) + all * fabs(D->free[i]));
        if (moves < INFINITY) T->decided_noise[i] = fmax(T->decided_noise[i], TOUCHES * EPS * moves); /* a gap that ends a motion at rest may begin the next one */
    }
    if (I->valves) { /* what they are without reactions is nothing to others */
        memcpy(T->given_free, D->free, sizeof(double) * (size_t)n);
        memset(T->given_free, 0, sizeof(double) * (size_t)I->valves);
        D->free = T->given_free;
    }
    double energy = D->bounce[gaps]; /* no rate is larger than the root of 2 W energy, whatever coordinates it is known by: so large is its rounding */
    for (long i = I->valves; i < n && energy > 0; i++)
        if (D->W[i * n + i] > 0) T->decided_noise[gaps + i] = fmax(T->decided_noise[gaps + i], TOUCHES * EPS * sqrt(2 * D->W[i * n + i] * energy));
    double *push = T->alone; /* what each reaction would be alone */
    for (long j = 0; j < n; j++) push[j] = D->W[j * n + j] > 0 ? fabs(D->free[j]) / D->W[j * n + j] : 0;
    for (long i = I->valves; i < n; i++) { /* what has been held at rest for a step has moved by the rounding of accelerations that cancel */
        double cancel = fabs(D->free[i]);
        for (long j = 0; j < n; j++) cancel += fabs(D->W[i * n + j]) * push[j];
        if (cancel < INFINITY) T->decided_noise[gaps + i] = fmax(T->decided_noise[gaps + i], TOUCHES * EPS * cancel * T->pace);
    }
    return 1;
}

/* What rows are just before inputs or switches jump, at time t: what holds is known to the tolerance only, but how far it jumps to rounding. */
static int look_before_knot(Integrator *I, double t) {
    struct State *T = I->state;
    Decision D;
    if (T->crossed) return 1; /* two in one instant */
    T->crossed = 1;
    if (!reactions_of(I)) return 1;
    if (!decision_at(I, t, I->x, &D)) return 0;
    memcpy(T->near_knot, D.gap, sizeof(double) * (size_t)(D.gaps + D.n));
    memcpy(T->near_knot + D.gaps + D.n, D.J, sizeof(double) * (size_t)(I->nx * D.n));
    return 1;
}

/* Whether gap or rate `k` has jumped at the knot, or by the switch, that has just been crossed; gates, which have no gap, open and shut, and do not jump. */
static int has_jumped(const Integrator *I, const Decision *D, long k) {
    return I->state->crossed && (k >= D->gaps || !(D->terms[k] < 0)) && fabs(D->gap[k] - I->state->near_knot[k]) > 16 * D->gap_noise[k] + NIL * fabs(D->gap[k]);
}

/* Whether what reactions do has jumped there: their directions, which masks know. */
static int has_turned(const Integrator *I, const Decision *D) {
    const double *J = I->state->near_knot + D->gaps + D->n, speed = sqrt(2 * fmax(D->bounce[D->gaps], 0)); /* in their units */
    for (long k = 0; k < I->nx; k++) {
        double most = 0, turned = 0;
        for (long j = k * D->n; j < (k + 1) * D->n; j++) {
            double unit = unit_of(D->W[(j - k * D->n) * (D->n + 1)]);
            most = fmax(most, fabs(J[j]) / unit);
            turned = fmax(turned, fabs(D->J[j] - J[j]) / unit);
        }
        if (turned > sqrt(FITS) * most && turned * speed > NIL * I->state->size[k]) return 1;
    }
    return 0;
}

/* The law that a reaction obeys. */
static long law_of_reaction(const Decision *D, long j) {
    long law = D->gaps;
    if (j < D->gaps) return j;
    while (law + 1 < D->gaps + D->frictions && row_of(D, law + 1 - D->gaps) <= j) law++;
    return law;
}

/* Whether two rows of a friction in a plane have jumped as their axes have, which a comparison chooses, by a turn: what they do is the same in other axes. Not where a direction is held
   in these. */
static int has_other_axes(const Integrator *I, const Decision *D, long f) {
    const struct State *T = I->state;
    long i = row_of(D, f), n = D->n;
    const double *was = T->near_knot + D->gaps + i, *is = D->rate + i, *J = T->near_knot + D->gaps + n, *mask = T->side + mask_of(I, f);
    if (rows_of(D, f) != 2 || mask[2] == 1) return 0;
    double square = was[0] * was[0] + was[1] * was[1], c = (was[0] * is[0] + was[1] * is[1]) / square, s = (was[1] * is[0] - was[0] * is[1]) / square;
    if (!(fabs(c * c + s * s - 1) <= FITS)) return 0;
    for (long k = 0; k < I->nx; k++) {
        const double *a = J + k * n + i, *b = D->J + k * n + i;
        double most = fmax(fabs(a[0]), fabs(a[1]));
        if (!(fmax(fabs(b[0] - c * a[0] - s * a[1]), fabs(b[1] - c * a[1] + s * a[0])) <= sqrt(FITS) * most)) return 0;
    }
    return 1;
}

/* A switch has gone over: modes are decided anew where a gap, a rate or a direction has jumped by that; `before`: whether there was something to decide anyway. REACHED_END,
   or why not: derivatives do not go through it. */
static enum Code look_after_switch(Integrator *I, int before) {
    struct State *T = I->state;
    Decision D = {.gaps = 0};
    long k = 0;
    if (reactions_of(I) && !decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
    for (; k < D.gaps + D.n; k++) {
        long law = k < D.gaps ? k : law_of_reaction(&D, k - D.gaps);
        if (has_jumped(I, &D, k) && !(I->directions && law >= D.gaps && has_other_axes(I, &D, law - D.gaps))) break;
    }
    if (k == D.gaps + D.n) T->crossed = before || (D.n > 0 && !I->directions && has_turned(I, &D));
    else if (I->directions) {
        return not_derived(I, k < D.gaps ? k : law_of_reaction(&D, k - D.gaps), JUMPS);
    }
    return REACHED_END;
}

/* Whether the same laws hold as by these masks. */
static int same_laws(const Integrator *I, const double *masks) {
    const double *side = I->state->side;
    int same = 1;
    for (long i = 0; i < I->one_sided; i++) same &= side[i] == masks[i];
    for (long f = 0; f < frictions_of(I); f++) same &= (side[mask_of(I, f)] == 1) == (masks[mask_of(I, f)] == 1);
    return same;
}

/* Room for one more transition. */
static int note_transition(Integrator *I, long row) {
    struct State *T = I->state;
    long n = reactions_of(I), k = I->transitions;
    if (!I->block && k >= T->transition_room) {
        long c = T->transition_room = 2 * k + 16;
        if (!grow(&I->transition_steps, sizeof(long) * (size_t)c) || !grow(&I->transition_rows, sizeof(long) * (size_t)c) ||
            !grow(&I->impulses, sizeof(double) * (size_t)(2 * c * n + 1)) || !grow(&I->transition_masks, sizeof(double) * (size_t)(c * I->masks + 1)))
            return 0;
    }
    I->transitions++;
    int follows = row == BRIDGE || (row < 0 && T->last.count > 0 && T->last.time == I->t);
    T->last.count++;
    T->last.time = I->t;
    if (!follows) T->last.row = row, T->last.law = law_of_row(I, row);
    if (I->block) return 1;
    I->transition_steps[k] = I->steps - I->first;
    I->transition_rows[k] = row;
    memcpy(I->impulses + 2 * k * n, T->impulse, sizeof(double) * (size_t)n);
    memcpy(I->impulses + (2 * k + 1) * n, T->heat, sizeof(double) * (size_t)n);
    memset(T->heat, 0, sizeof(double) * (size_t)n);
    memcpy(I->transition_masks + k * I->masks, T->side, sizeof(double) * (size_t)I->masks);
    return 1;
}

/* A step along a straight line, with these rates, to where the state is now; null: one of no length, since it has jumped. */
static int keep_straight(Integrator *I, const double *rates) {
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
    for (long i = 0; i < n; i++) I->coefficients[at + i] = rates ? rates[i] : 0;
    memcpy(I->coefficients + at + n, T->size, sizeof(double) * (size_t)n);
    memcpy(I->step_sides + (k - 1) * I->held, T->side, sizeof(double) * (size_t)I->held);
    I->stage_count[k - 1] = 1;
    I->kinds[k - 1] = RADAU;
    I->offset[k - 1] = at;
    T->coefficient_count = at + 2 * n;
    T->last.jumps += !rates;
    return 1;
}
