/* Modes: which rows of reactions hold. Masks are inputs that are held while a step is taken; guards of masks are rows of switches.h, so steps end where one of
   them becomes negative. Then all rows are decided together, from what `decision` gives at that place, in this order, row by row:

   gaps (one_sided); rates of gaps, slips (n); accelerations of both without reactions (n); W (n, n): accelerations by reactions; J (nx, n): x' by
   reactions; limits of sticking, without reactions (frictions) and by reactions (frictions, n); those of sliding likewise; laws of impact (one_sided), see
   impacts.h; restitution of slips (frictions); restitution (one_sided); kinetic energy; where limits depend on
   magnitudes, their forces (3 each) without reactions and by them (3 each, n), and limits of sticking and of sliding by these (frictions, magnitudes).

   First impacts, where a gap that is closed closes with speed.
   Then accelerations, looked at a little later, where what is exactly at its threshold has passed it.

   Slip in a plane has a direction, which is not smooth where it is zero: near zero friction acts against a direction that is held, that of the slip or of its
   beginning. There slip runs through zero like slip along a line; how it turns so near to zero moves nothing. */

#define TOUCHES 16.0   /* roundings within which gaps are closed and slips are zero */
#define REFINED 3      /* times that impulses are solved for, what they leave open last */
#define FORESEEN 1e3   /* roundings of rates, where states are extrapolated */
#define SETTLED 6      /* times that what holds at once is asked again */
#define SOONEST 1e-13  /* not so much sooner */
#define LATER 1e-6     /* of a step: where accelerations are looked at */
#define FORESEES 0.25 /* part of a rate that it may change by while it is followed */
#define TOO_LATE 1.0   /* not so much later */
#define CHANGES 40     /* of mode in one instant, which tell that no mode lasts */
#define UNSEEN 1e-12   /* of a state: a jump that is none */
#define RESOLVED 16.0  /* roundings of a gap: bounces that are not higher are none */
#define BRIEFEST 1024.0 /* roundings of the time: nor are those that do not last longer, and so near to its end slip has a direction that is held */
#define CLOSING 1e-9   /* of the slips: a speed of closing that is as good as none */
#define BRIDGE -2      /* in place of the row that led to a transition: impacts without end are over */
#define NIL 1e-11      /* of the largest: a reaction or a rate that is zero */
#define DEPENDENT 1e-9 /* pivots of rows that depend on one another, in units of their diagonal */
#define DAMPING 1e-6   /* of these, in units of the least of the other pivots, see acausal/reduce/modes.py */
#define NEAR_ZERO 1e-9 /* of the slips met: where their direction is held */
#define ENDED 1e-6     /* of the slips met: what is left of slips that end all at once where no mode lasts */
#define UNSETTLED 20   /* changes of mode in one instant, from which on they do */
#define ATTRACTS 1e-3   /* of the largest reaction: what cannot be that of a contact that presses */
#define ALIKE 1e-3     /* of the slip: where a patch slides as fast as its edge turns; forces bend there, and a step ends */
#define SUDDEN 0.1      /* of the slips met: what accelerations that jump make of them in a step, at least */
#define SHORTLY 1e-3    /* of a step: where slips are looked at that have begun */
#define OFF_COURSE 1e-3 /* of a slip, across its direction: it does not go that way */
#define BEGUN 1e-11     /* of what slips become until their rates are as fast as what friction holds: with which they begin where their directions are not held */
#define HARDLY 1e-4    /* radians by which a direction has turned that is nearly the same */
#define NEARER 1e-2    /* of that, for patches: what they act against turns until the end */

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
    return 6 * n + 3 * F + F + n * n + 5 * n + 3 * F + F;
}

static long longs_of_room(const Integrator *I) { return 5 * (reactions_of(I) + frictions_of(I)) + 1; }

/* Results of the decision's kernel of which it is known what rounding makes of them: gaps and rates, and accelerations where the index changes. */
static long counted_of(const Integrator *I) { return I->one_sided + (I->changes_index ? 2 : 1) * reactions_of(I); }

static int make_modes(Integrator *I) {
    struct State *T = I->state;
    long n = reactions_of(I), F = frictions_of(I), most = I->one_sided + 2 * F, width = 2 * most + 2;
    T->later_x = reserve_doubles(I, I->nx + 1);
    T->impulse = reserve_doubles(I, n + 1);
    T->first_rate = reserve_doubles(I, I->nx + 1);
    if (I->directions && !make_saltation(I)) return 0;
    if (!n) return I->counted || (T->later_x && T->first_rate && T->impulse);
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
    if (I->changes_index) {
        T->row_unit = reserve_doubles(I, n);
        T->row_terms = reserve_doubles(I, n);
        T->free_noise = reserve_doubles(I, n);
        T->index_work = reserve_doubles(I, 4 * n * n + 2 * n);
        T->index_rows = reserve(I, sizeof(long) * (size_t)(3 * n));
        T->index_found = reserve(I, sizeof(long) * (size_t)n);
        if (!I->counted && !(T->row_unit && T->row_terms && T->free_noise && T->index_work && T->index_rows && T->index_found)) return 0;
    }
    if (!make_zeno(I) || !make_margin(I) || !make_impacts(I) || !make_thin(I)) return 0;
    return I->counted || (T->decided && T->decided_noise && T->alone && T->decided_rounds && T->decided_from && T->lemke && T->impulse && T->push && T->choice_change && T->no_change && T->later_x && T->first_rate && T->lifted && T->leaves && T->near_knot && T->gap_terms && T->at_rest && T->basis && T->status);
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
    return (Room){at, at + n, at + 2 * n, at + 3 * n, at + 4 * n, at + 5 * n, at + 6 * n, at + 6 * n + 3 * F, at + 6 * n + 4 * F, at + 6 * n + 4 * F + n * n + 5 * n, at + 6 * n + 7 * F + n * n + 5 * n, k, k + n + F, k + 2 * (n + F), k + 3 * (n + F), k + 4 * (n + F)};
}

/* What is to be solved for there, from these rates or accelerations on; without limits that do not grow with reactions, unless it is said that they count. */
static Problem problem_of(const Integrator *I, const Decision *D, Room R, const double *start) {
    return (Problem){.D = D, .start = start, .damping = I->redundant ? DAMPED : 0, .law = R.law, .asked = R.asked, .along = R.along, .push = R.push, .rate = R.rate, .centre = R.centre, .work = R.work};
}

/* Parts of the results of the decision's kernel, or of their changes; `noise`: of gaps and rates, or null. */
static Decision decision_of(const Integrator *I, const double *at, const double *noise) {
    long gaps = I->one_sided, m = frictions_of(I), n = reactions_of(I);
    Decision D = {.n = n, .gaps = gaps, .lines = I->lines, .planes = I->planes, .frictions = m, .magnitudes = I->magnitudes, .gap = at, .gap_noise = noise, .rate_noise = noise ? noise + gaps : 0};
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
    D.rates = D.values + n * n;
    if (I->changes_index) D.own = I->state->row_unit;
    D.terms = D.values + (I->changes_index ? 2 * n * n : 0);
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
    if (I->changes_index) {
        find_units(I, D);
        for (long i = 0; i < n; i++) T->free_noise[i] = fmax(T->decided_rounds[gaps + n + i], TOUCHES * EPS * T->row_terms[i]);
    }
    for (long i = 0; i < gaps; i++) {
        T->gap_terms[i] = fmax(D->terms[i], 0);
        T->decided_noise[i] = fmax(T->decided_noise[i], (T->begun ? 2 : TOUCHES) * EPS * T->gap_terms[i]); /* where things are put is rounded too */
    }
    double energy = D->bounce[gaps]; /* no rate is larger than the root of 2 W energy, whatever coordinates it is known by: so large is its rounding */
    for (long i = 0; i < n && energy > 0; i++)
        if (D->W[i * n + i] > 0) T->decided_noise[gaps + i] = fmax(T->decided_noise[gaps + i], TOUCHES * EPS * sqrt(2 * D->W[i * n + i] * energy));
    double *push = T->alone; /* what each reaction would be alone */
    for (long j = 0; j < n; j++) push[j] = D->W[j * n + j] > 0 ? fabs(D->free[j]) / D->W[j * n + j] : 0;
    for (long i = 0; i < n; i++) { /* what has been held at rest for a step has moved by the rounding of accelerations that cancel */
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

/* Room for one more transition. */
static int note_transition(Integrator *I, long row) {
    struct State *T = I->state;
    long n = reactions_of(I), k = I->transitions;
    if (!I->block && k >= T->transition_room) {
        long c = T->transition_room = 2 * k + 16;
        if (!grow(&I->transition_steps, sizeof(long) * (size_t)c) || !grow(&I->transition_rows, sizeof(long) * (size_t)c) ||
            !grow(&I->impulses, sizeof(double) * (size_t)(c * n + 1)) || !grow(&I->transition_masks, sizeof(double) * (size_t)(c * I->masks + 1)))
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
    memcpy(I->impulses + k * n, T->impulse, sizeof(double) * (size_t)n);
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

#include "zeno.h"
#include "saltation.h"
#include "impacts.h"
#include "margin.h"

/* The rate of a gap that is none: rounding, or that of a bounce so low, or so short, that gaps, or times, do not tell it from rounding, as it falls back with this acceleration. */
static double least_rate(const Integrator *I, const Decision *D, long i, double acceleration) {
    double fall = fmax(0, -acceleration);
    return fmax(D->rate_noise[i], fmax(sqrt(2 * fall * RESOLVED * D->gap_noise[i]), 0.5 * fall * BRIEFEST * EPS * fabs(I->t)));
}

/* The least pivot of the rows that hold, in units of their diagonal, but for those that vanish where rows depend on one another; 0: none does. */
static double least_pivot(const Decision *D, const long *law, double *A, long *chosen) {
    long n = D->n, m = 0;
    double least = 1;
    for (long i = 0; i < D->gaps; i++)
        if (law[i] == HOLDS) chosen[m++] = i;
    for (long f = 0; f < D->frictions; f++)
        for (long k = 0; k < rows_of(D, f) && law[D->gaps + f] == HOLDS; k++) chosen[m++] = row_of(D, f) + k;
    for (long i = 0; i < m; i++)
        for (long j = 0; j < m; j++) {
            long a = chosen[i], b = chosen[j];
            A[i * m + j] = D->W[a * n + b] / sqrt(D->W[a * n + a] * D->W[b * n + b]);
        }
    for (long k = 0; k < m; k++) {
        long best = k;
        for (long i = k + 1; i < m; i++)
            if (A[i * m + i] > A[best * m + best]) best = i;
        if (!(A[best * m + best] > DEPENDENT)) return least;
        least = fmin(least, A[best * m + best]);
        for (long j = 0; j < m && best != k; j++) {
            double kept = A[k * m + j];
            A[k * m + j] = A[best * m + j], A[best * m + j] = kept;
        }
        for (long j = 0; j < m && best != k; j++) {
            double kept = A[j * m + k];
            A[j * m + k] = A[j * m + best], A[j * m + best] = kept;
        }
        for (long i = k + 1; i < m; i++)
            for (long j = k + 1; j < m; j++) A[i * m + j] -= A[i * m + k] * A[k * m + j] / A[k * m + k];
    }
    return 0;
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
        double grows[3];
        for (long k = 0; k < rows_of(D, f); k++) grows[k] = (D->free[i + k] - first[i + k]) / later;
        double jerk = hypot(grows[0], grows[1]), gain = planned * (size_of(D, f, R.rate) + 0.5 * planned * (rows_of(D, f) > 2 ? hypot(jerk, grows[2]) : jerk));
        if (R.law[D->gaps + f] != STARTS || !isfinite(gain)) continue;
        R.met[f] = fmax(R.met[f], gain);
        for (long k = i; k < i + rows_of(D, f); k++)
            for (long x = 0; x < I->nx && D->W[k * n + k] > 0; x++) T->size[x] = fmax(T->size[x], gain * fabs(D->J[x * n + k]) / D->W[k * n + k]);
    }
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
    double largest = largest_in(D, R.push);
    for (long i = 0; i < D->gaps; i++) {
        int carried = I->redundant && T->side[carried_of(I) + 1 + i] != 0;
        double least = D->kind[i] == NO_IMPACT && !I->redundant ? 0 : NIL * largest; /* valves that leak have units too far apart */
        if (R.law[i] == HOLDS && !carried && !I->changes_index && !(R.push[i] * unit_of(own_of(D, i)) > least)) R.law[i] = OPENS;
        T->side[i] = R.law[i] == HOLDS;
        double nothing = NIL * largest * unit_of(own_of(D, i));
        T->at_rest[i] = is_speed(D, i) && R.law[i] == OPENS && fabs(R.rate[i]) <= nothing ? nothing : 0;
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

/* Directions of what slips, as it does at this place: where it has hardly turned since then, since what is at its threshold may be passed by that alone. */
static void turn_slips(const Decision *D, Room R) {
    for (long f = D->lines; f < D->frictions; f++) {
        double *e = R.along + 3 * f, now[3], turned = 0;
        if (R.law[D->gaps + f] != AGAINST || !(size_of(D, f, D->rate) > 0)) continue;
        against(D, f, D->rate + row_of(D, f), now);
        for (long k = 0; k < rows_of(D, f); k++) turned = hypot(turned, now[k] - e[k]);
        if (turned < HARDLY) memcpy(e, now, sizeof(double) * (size_t)rows_of(D, f));
    }
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

/* Accelerations, looked at so much later [s], decide which of the rows that touch hold on, and which way friction acts; `roughly`: they hardly tell which way. */
static enum Code decide_when(Integrator *I, Room R, double planned, double later, int *roughly) {
    struct State *T = I->state;
    Decision D;
    long laws = I->one_sided + frictions_of(I), *asked = R.wanted, *found = T->index_found;
    for (long k = carried_of(I); I->redundant && k < first_discrete(I); k++) T->side[k] = 0;
    if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
    for (long i = 0; i < D.gaps; i++) R.law[i] = R.touching[i] && (R.touching[i] == 2 || D.rate[i] <= least_rate(I, &D, i, D.free[i])) ? MAY_HOLD : OFF;
    for (long f = 0; f < D.frictions; f++) R.law[D.gaps + f] = R.touching[D.gaps + f] == 1 ? MAY_HOLD : AGAINST;
    int given = 0;
    if (I->changes_index) given = hold_shut(I, &D, R.law);
    if (given < 0) return INPUT_FAILED;
    memcpy(asked, R.law, sizeof(long) * (size_t)laws);
    for (long f = 0; f < D.frictions; f++) R.slow[f] = size_of(&D, f, D.rate);
    if (!decision_later(I, later, &D)) return INPUT_FAILED;
    memcpy(R.now, R.along, sizeof(double) * (size_t)(3 * D.frictions));
    turn_slips(&D, R);
    for (long f = 0; f < D.frictions; f++)
        if (never_holds(&D, f)) asked[D.gaps + f] = OFF;
    Problem p = problem_of(I, &D, R, D.free);
    p.constants = 1;
    for (long again = 0; again <= D.frictions; again++) {
        *roughly = 0;
        memcpy(R.law, asked, sizeof(long) * (size_t)laws);
        int solved = given ? 0 : complementary(&p, R.place, T->lemke, T->basis), held = 0;
        if (I->changes_index) {
            for (long i = 0; i < D.gaps && !solved; i++) R.law[i] = asked[i] != MAY_HOLD ? asked[i] : T->side[i] == 1 ? HOLDS : OPENS;
            memcpy(found, R.law, sizeof(long) * (size_t)laws);
            if (settle_rows(I, &D, asked, R.law, R.push, R.rate)) solved = 1;
            else if (solved) memcpy(R.law, found, sizeof(long) * (size_t)laws);
        }
        if (I->redundant) {
            held = hold_more(I, &D, asked, R.law, R.along, solved ? R.rate : 0, R.push, later);
            if (held < 0 || !decision_later(I, later, &D)) return INPUT_FAILED; /* it has looked elsewhere */
            for (long k = 0; k < laws && held && !solved; k++) held = asked[k] == OFF || R.law[k] == HOLDS;
        }
        if (!solved && !held) {
            I->worst = 0;
            for (long k = 0; k < laws; k++)
                if (asked[k] != OFF) I->worst = k;
            return NO_MODE;
        }
        int begun = 0;
        for (long k = D.gaps; k < laws; k++) {
            if (R.law[k] != STARTS) continue;
            begun |= asked[k] == MAY_HOLD;
            asked[k] = MAY_SLIDE;
            *roughly |= solved == ROUGHLY;
        }
        if (!begun) break; /* what slips has another limit */
    }
    if (!I->changes_index) find_rates(&p);
    if (I->redundant) share_as_rates_do(I, &D, &p, R);
    for (long f = 0; f < D.frictions; f++) /* not where nothing presses */
        if (R.law[D.gaps + f] == AGAINST && !(limit_of(&p, f) > 0)) R.law[D.gaps + f] = OFF;
    for (long f = 0; f < D.frictions; f++)
        if (asked[D.gaps + f] == AGAINST) memcpy(R.along + 3 * f, R.now + 3 * f, sizeof(double) * 3);
    if (!foresee_slips(I, &D, R, planned, later)) return INPUT_FAILED;
    set_masks(I, &D, R);
    if (I->changes_index && !combine_others(I, &D, R.push, R.rate)) {
        I->worst = 0;
        return NO_MODE;
    }
    set_directions_of_forces(I, &p);
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

/* Whether rows of the mode that has been set are no more than a little on the wrong side where it begins: else something else has changed by when it was looked at. -1 when the input
   function failed. */
static int is_true_now(Integrator *I, Room R) {
    struct State *T = I->state;
    Decision D;
    if (!decision_at(I, I->t, I->x, &D) || !rows_at(I, I->t, I->x)) return -1;
    double most = largest_in(&D, R.push);
    for (long i = 0; i < D.gaps; i++) {
        double unit = unit_of(own_of(&D, i)), size = T->side[i] == 1 ? T->one_row[i] * unit : T->one_row[i] / unit;
        if (size < -ATTRACTS * most && T->one_row[i] < -T->row_noise[i]) return 0;
    }
    return 1;
}

/* The same, not later than it takes to tell; nor so late that something else has changed, if it can be told. */
static enum Code decide_in_time(Integrator *I, Room R, double planned) {
    struct State *T = I->state;
    double *before = T->lifted + I->masks, first = LATER; /* what begins with no rate is told from rounding later, where it has not lasted */
    enum Code code = REACHED_END;
    int roughly = 1;
    memcpy(before, T->side, sizeof(double) * (size_t)I->masks);
    if (I->changes_index) {
        double most = foreseen(I, 0.01 * TOO_LATE * planned);
        if (!(most > 0)) return INPUT_FAILED;
        planned = fmax(fmin(planned, most / LATER), SPENT * EPS / LATER * fabs(I->t)); /* what changes with time does not sooner */
    }
    for (long k = 0; k < T->changes && I->changes_index && first < 0.01; k++) first *= 10;
    for (double later = first; roughly && later < TOO_LATE; later *= 100) code = decide_when(I, R, planned, later * planned, &roughly);
    for (double later = 0.01 * first; I->changes_index && later > SOONEST && later * planned > SPENT * EPS * fabs(I->t); later *= 0.01) {
        int holds = code == REACHED_END ? is_true_now(I, R) : 0;
        if (holds < 0) return INPUT_FAILED;
        if (holds) break;
        memcpy(T->side, before, sizeof(double) * (size_t)I->masks);
        code = decide_when(I, R, planned, later * planned, &roughly);
    }
    return code;
}

/* The same. Of rows that depend on one another, what holds at once changes how fast states move, and by that whether the others can: until it is the same as before. */
static enum Code decide_accelerations(Integrator *I, Room R, double planned) {
    struct State *T = I->state;
    Decision D;
    enum Code code = decide_in_time(I, R, planned);
    long changed = -1;
    if (code != REACHED_END || !I->redundant) return code;
    if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
    for (long again = 0, n = 0; again < SETTLED; again++, n = 0, changed = -1) {
        for (long i = 0; i < D.gaps; i++) n += D.kind[i] == NO_IMPACT;
        if (n == 0) return code;
        memcpy(T->lifted, T->side, sizeof(double) * (size_t)I->masks);
        code = decide_in_time(I, R, planned);
        for (long i = 0; i < D.gaps; i++)
            if (D.kind[i] == NO_IMPACT && T->side[i] != T->lifted[i]) changed = i;
        if (code != REACHED_END || changed < 0) return code;
    }
    I->worst = changed;
    return CHATTERS;
}

/* Rows that touch and leave so slowly that gaps do not tell it are held where they are. What happens instead, a bounce, loses the time until it is over, and the
   friction of all that pushes meanwhile; both are first order in its speed, and so is what is done here: the impulse that ends the bounce, turned round, with its friction. */
static void end_low_bounces(Integrator *I, const Decision *D, Room R) {
    struct State *T = I->state;
    long n = D->n;
    double *left = T->blow, *more = T->blow + n;
    Decision nothing = decision_of(I, T->no_change, 0);
    Problem p = problem_of(I, D, R, D->rate);
    p.kinetic = 1;
    memset(T->no_change, 0, sizeof(double) * (size_t)I->decision.outputs);
    for (int slides = 1; slides >= 0; slides--) { /* where friction that slides leaves no answer, without it */
        double open = 0, most = 0;
        for (long i = 0; i < n; i++) R.push[i] = i < D->gaps && R.touching[i];
        for (long i = 0; i < D->gaps; i++) R.law[i] = R.touching[i] ? HOLDS : OFF;
        for (long f = 0; f < D->frictions; f++) R.law[D->gaps + f] = !(limit_of(&p, f) > 0) ? OFF : R.touching[D->gaps + f] == 1 ? HOLDS : slides ? AGAINST : OFF;
        for (int again = 0; again < REFINED; again++) { /* of redundant rows damping leaves something open */
            for (long i = 0; i < n; i++) {
                left[i] = D->rate[i];
                for (long j = 0; j < n && again; j++) left[i] += D->W[i * n + j] * R.before[j];
            }
            change_choice(&p, &nothing, left, 0, T->choice_change, again ? more : R.before);
            for (long i = 0; i < n && again; i++) R.before[i] += more[i];
        }
        for (long i = 0; i < D->gaps; i++) {
            double rate = D->rate[i], unit = unit_of(own_of(D, i));
            for (long j = 0; j < n; j++) rate += D->W[i * n + j] * R.before[j];
            if (!R.touching[i]) continue;
            most = fmax(most, fabs(D->rate[i]) / unit);
            open = isfinite(rate) ? fmax(open, fabs(rate) / unit) : INFINITY;
        }
        if (open <= sqrt(FITS) * most) break;
        if (!slides) return; /* what holds is projected */
    }
    if (I->directions) {
        memcpy(R.push, R.before, sizeof(double) * (size_t)n);
        memset(T->impulse_change, 0, sizeof(double) * (size_t)(2 * n * direction_blocks(I) * LANES));
        change_phase(I, &p, 0, 0);
        strike_directions(I, D, R.before);
    }
    for (long j = 0; j < n; j++) T->impulse[j] += R.before[j];
    for (long i = 0; i < I->nx; i++)
        for (long j = 0; j < n; j++) I->x[i] += D->J[i * n + j] * R.before[j];
}

/* What touches, and which way it slips: of one-sided laws 0 or 1, 2 where they have come to rest; of frictions 1 where the slip is zero, 2 else, with its direction. */
static void look_at_slips(Integrator *I, const Decision *D, Room R, long row, const double *before) {
    struct State *T = I->state;
    for (long f = 0; f < D->frictions; f++) {
        long i = row_of(D, f), size = rows_of(D, f), first = I->one_sided + 2 * f;
        double *mask = T->side + mask_of(I, f), *e = R.along + 3 * f, slip = size_of(D, f, D->rate), nil = 0, was = 0;
        for (long k = 0; k < size; k++) nil += D->rate_noise[i + k], was += before ? fabs(before[i + k]) : 0;
        nil = fmax(nil, NIL * was);
        int held = size > 1 && mask[2] == 1, stops = row == first && mask[0] == 0 && (size == 1 ? mask[1] != 0 : held), stuck = !before && mask[0] == 1;
        for (long k = 0; k < size; k++) stuck &= !has_jumped(I, D, D->gaps + i + k);
        int passed = !before && size == 1 && mask[1] * D->rate[i] < 0 && !has_jumped(I, D, D->gaps + i); /* in the same instant as the row's */
        int zero = stuck || stops || passed || slip <= nil;
        R.touching[D->gaps + f] = zero ? 1 : 2;
        if (size == 1 || zero) e[0] = D->rate[i] > 0 ? 1 : -1, e[1] = e[2] = 0;
        else if (held && !before && slip < 2 * mask[3] && row != first + 1) memcpy(e, mask + 4, sizeof(double) * (size_t)size);
        else against(D, f, D->rate + i, e);
    }
}

/* How a one-sided row is pushed open by its own reaction, less than none where friction that slips turns it round (Painleve); with all others that hold, in its units. */
static double yield_of(const Decision *D, Room R, long gap) {
    long n = D->n, m = 0, *row = R.place;
    double *A = R.work;
    for (long i = 0; i < D->gaps; i++)
        if (i != gap && R.law[i] == HOLDS) row[m++] = i;
    for (long f = 0; f < D->frictions; f++)
        for (long k = 0; k < rows_of(D, f) && R.law[D->gaps + f] == HOLDS; k++) row[m++] = row_of(D, f) + k;
    row[m++] = gap;
    for (long a = 0; a < m; a++)
        for (long b = 0; b < m; b++) {
            double sum = D->W[row[a] * n + row[b]];
            for (long f = 0; f < D->frictions && row[b] < D->gaps; f++)
                for (long k = 0; k < rows_of(D, f) && R.touching[D->gaps + f] == 2; k++)
                    sum -= D->slide_by[f * n + row[b]] * R.along[3 * f + k] * D->W[row[a] * n + row_of(D, f) + k];
            A[a * m + b] = sum / (unit_of(D->W[row[a] * n + row[a]]) * unit_of(D->W[row[b] * n + row[b]]));
        }
    for (long k = 0; k < m - 1; k++)
        for (long a = k + 1; a < m; a++) {
            double factor = A[a * m + k] / A[k * m + k];
            for (long b = k + 1; b < m; b++) A[a * m + b] -= factor * A[k * m + b];
        }
    return A[m * m - 1];
}

/* Whether a row holds as soon as the clock tells another time; -1 when the input function failed. */
static int holds_soon(Integrator *I, long row) {
    struct State *T = I->state;
    double h = 2 * SPENT * EPS * fabs(I->t);
    if (!rate_at(I, I->t, I->x, T->rate)) return -1;
    for (long i = 0; i < I->nx; i++) T->later_x[i] = I->x[i] + h * T->rate[i];
    if (!rows_at(I, I->t + h, T->later_x)) return -1;
    int holds = T->one_row[row] >= -T->row_noise[row];
    return rows_at(I, I->t, I->x) ? holds : -1;
}

/* Whether friction that slips has one answer in the mode that has been set; else `worst` is the law. REACHED_END, NO_MODE or INPUT_FAILED. */
static enum Code has_one_answer(Integrator *I, const Decision *D, Room R) {
    for (long f = 0; f < D->frictions; f++)
        for (long i = 0; i < D->gaps && R.touching[D->gaps + f] == 2; i++) {
            double by = D->slide_by[f * D->n + i], alone = D->W[i * D->n + i];
            for (long k = 0; k < rows_of(D, f); k++) alone -= by * R.along[3 * f + k] * D->W[i * D->n + row_of(D, f) + k];
            if (by == 0 || alone > 0 || !R.touching[i] || I->redundant || yield_of(D, R, i) > 0) continue;
            I->worst = D->gaps + f;
            return NO_MODE;
        }
    int holds = 0;
    for (long i = 0; i < D->gaps; i++) holds |= I->state->side[i] == 1;
    if (!I->magnitudes && !holds) return REACHED_END;
    if (!rows_at(I, I->t, I->x)) return INPUT_FAILED;
    double most = largest_in(D, R.push);
    for (long i = 0; i < D->gaps; i++) { /* in this mode the equations may say something else: then it is none */
        double unit = unit_of(own_of(D, i));
        if (I->state->side[i] != 1 || !(I->state->one_row[i] * unit < -ATTRACTS * most) || I->state->one_row[i] >= -I->state->row_noise[i]) continue;
        int soon = D->kind[i] == NO_IMPACT ? holds_soon(I, i) : 0;
        if (soon < 0) return INPUT_FAILED;
        if (soon) continue;
        I->worst = i;
        return NO_MODE;
    }
    for (long m = 0; m < I->magnitudes; m++) {
        if (I->state->one_row[first_set(I) - 2 * (I->magnitudes - m) + 1] > 0) continue;
        I->worst = D->gaps;
        while (I->worst < D->gaps + D->frictions - 1 && D->slide_size[(I->worst - D->gaps) * D->magnitudes + m] == 0) I->worst++;
        return NO_MODE;
    }
    return REACHED_END;
}

/* Where friction that slips leaves no acceleration that is possible, what jams is stopped by an impact, plastic, though nothing closes with speed (Genot and Brogliato,
   European Journal of Mechanics A 18, 1999): that of a speed of closing that goes to zero, whose impulses do not. Whether there is one. */
static int strike_without_closing(Integrator *I, Room R) {
    struct State *T = I->state;
    Decision D;
    long n = reactions_of(I), laws = I->one_sided + frictions_of(I);
    double *start = R.compressed, fast = 0, most = 0;
    if (!frictions_of(I) || !decision_at(I, I->t, I->x, &D)) return 0;
    Problem p = problem_of(I, &D, R, start);
    p.kinetic = 1;
    for (long i = 0; i < D.gaps; i++) R.law[i] = R.touching[i] ? MAY_HOLD : OFF;
    for (long f = 0; f < D.frictions; f++) {
        long *law = R.law + D.gaps + f;
        *law = OFF;
        for (long i = 0; i < D.gaps; i++)
            if (R.touching[i] && D.slide_by[f * n + i] != 0) *law = MAY_HOLD;
        for (long k = row_of(&D, f); k < row_of(&D, f) + rows_of(&D, f) && *law == MAY_HOLD; k++) fast = fmax(fast, fabs(D.rate[k]) / unit_of(own_of(&D, k)));
    }
    memcpy(start, D.rate, sizeof(double) * (size_t)n);
    for (long i = 0; i < n; i++) /* what closes a little later, if nothing acts */
        if (R.law[i < D.gaps ? i : 0] != OFF || i >= D.gaps) most = fmax(most, fabs(D.free[i]) / unit_of(own_of(&D, i)));
    for (long i = 0; i < n && most > 0; i++) start[i] = (i < D.gaps ? 0 : D.rate[i]) + CLOSING * fast / most * D.free[i];
    most = 0;
    if (!complementary(&p, R.place, T->lemke, T->basis)) return 0;
    memcpy(start, D.rate, sizeof(double) * (size_t)n);
    memcpy(R.asked, R.law, sizeof(long) * (size_t)laws);
    memcpy(R.centre, R.push, sizeof(double) * (size_t)n);
    if (!newton_of_laws(&p, R.asked)) return 0;
    find_rates(&p);
    for (long i = 0; i < n; i++) most = fmax(most, fabs(R.push[i]) * unit_of(own_of(&D, i)));
    if (!answers(&p) || !(most > NIL * fast)) return 0;
    for (long j = 0; j < n; j++) T->impulse[j] += R.push[j];
    for (long i = 0; i < I->nx; i++)
        for (long j = 0; j < n; j++) I->x[i] += D.J[i * n + j] * R.push[j];
    memcpy(R.before, D.rate, sizeof(double) * (size_t)n);
    for (long k = 0; k < first_discrete(I); k++) T->side[k] = 0;
    if (!decision_at(I, I->t, I->x, &D)) return 0;
    look_at_slips(I, &D, R, -1, R.before);
    return 1;
}

/* Slips that are nothing beside how fast all is, and that leave no acceleration that is possible: they are zero. Whether there are such. */
static int end_least_slips(const Integrator *I, const Decision *D, Room R) {
    long n = D->n, found = 0;
    double fast = sqrt(2 * fmax(D->bounce[D->gaps], 0));
    for (long f = 0; f < D->frictions; f++) {
        long i = row_of(D, f);
        if (R.touching[D->gaps + f] != 2 || !(size_of(D, f, D->rate) <= NEAR_ZERO * fast * unit_of(own_of(D, i)))) continue;
        R.touching[D->gaps + f] = 1;
        for (long k = 0; k < I->one_sided; k++) found |= R.touching[k] && D->slide_by[f * n + k] != 0;
    }
    return found != 0;
}

/* Slips in planes that are all but over end at once: beside them directions turn faster than others can follow, as those of feet that hold what slides on them. */
static void end_small_slips(const Decision *D, Room R) {
    for (long f = D->lines; f < D->frictions; f++)
        if (R.touching[D->gaps + f] == 2 && size_of(D, f, D->rate) <= ENDED * R.met[f]) R.touching[D->gaps + f] = 1;
}

/* Slips that have been put to zero by what holds now, as that of the third foot of what stands still on two, are over, too. Whether there are such; -1 when the input function failed. */
static int end_with_others(Integrator *I, Room R) {
    Decision D;
    long F = I->lines + I->planes, slides = 0, ended = 0;
    for (long f = 0; f < F; f++) slides |= R.touching[I->one_sided + f] == 2 && R.law[I->one_sided + f] == AGAINST;
    if (!slides || I->directions) return 0;
    if (!decision_at(I, I->t, I->x, &D)) return -1;
    for (long f = 0; f < F; f++) {
        if (R.touching[D.gaps + f] != 2 || R.law[D.gaps + f] != AGAINST || size_of(&D, f, D.rate) > slip_noise(&D, f)) continue;
        R.touching[D.gaps + f] = ended = 1;
    }
    return ended != 0;
}

/* Whether no other gap closes while impacts are bridged; -1 when the input function failed. */
static int meets_nothing_else(Integrator *I, Room R) {
    struct State *T = I->state;
    Decision D;
    if (!decision_at(I, T->rest_t, T->rest_x, &D)) return -1;
    for (long i = 0; i < D.gaps; i++)
        if (!R.touching[i] && !T->rests[i] && D.gap[i] < -D.gap_noise[i]) return 0;
    return 1;
}

/* Of the gaps that leave, those that fall back before that is seen, by the accelerations that have been decided: they touch. Whether there are any; `rate`: of gaps. */
static int fall_back(const Integrator *I, const Decision *D, Room R, const double *rate, long *leaves) {
    int low = 0;
    for (long i = 0; i < D->gaps; i++) {
        if (!leaves[i] || rate[i] > least_rate(I, D, i, R.rate[i])) continue;
        leaves[i] = 0;
        R.touching[i] = low = 1;
    }
    return low;
}

/* Frictions whose slip was zero after each of so many impacts of theirs. */
static void note_sticking(Integrator *I, const Decision *D, Room R) {
    struct State *T = I->state;
    const char *struck = T->struck + T->impacts % REMEMBERED * D->gaps;
    for (long f = 0; f < D->frictions; f++)
        for (long i = 0; i < D->gaps; i++) {
            if (!struck[i] || D->slide_by[f * D->n + i] == 0) continue;
            T->sticks[f] = R.touching[D->gaps + f] == 1 ? T->sticks[f] + 1 : 0;
        }
}

/* How hard the impact is that has been decided, as a root of an energy, and how well its instant is known, by rounding of gaps. */
static void note_strength(Integrator *I, const Decision *D, Room R) {
    struct State *T = I->state;
    long at = T->impacts % REMEMBERED;
    double *size = T->impact_size + at, *noise = T->impact_noise + at;
    *size = *noise = 0;
    for (long i = 0; i < D->gaps; i++) {
        if (!T->struck[at * D->gaps + i]) continue;
        *size += fabs(T->impulse[i]) * unit_of(own_of(D, i));
        *noise = fmax(*noise, D->gap_noise[i] / (TOUCHES * fabs(R.before[i])));
    }
}

/* Gaps that are below zero by more than rounding, at a tolerance that allows for it, are put to zero where they strike or leave, as what holds is: positions are moved, speeds
   stay. 1 where there are such gaps, -1 when the input function failed. */
static int lift(Integrator *I, Decision *D, Room R) {
    struct State *T = I->state;
    long n = D->n, deep = 0;
    double *sides = T->lifted, *before = T->later_x;
    memcpy(sides, T->side, sizeof(double) * (size_t)I->masks);
    memcpy(before, I->x, sizeof(double) * (size_t)I->nx);
    memset(T->side, 0, sizeof(double) * (size_t)first_discrete(I));
    for (long i = 0; i < D->gaps; i++) {
        T->side[i] = R.touching[i] && D->gap[i] < -D->gap_noise[i];
        deep |= T->side[i] == 1;
    }
    if (deep) project(I, I->t, I->x);
    memcpy(T->side, sides, sizeof(double) * (size_t)I->masks);
    if (!deep) return 0;
    for (long i = 0; i < I->nx; i++)
        for (long j = 0; j < n; j++)
            if (D->J[i * n + j] != 0) I->x[i] = before[i];
    return decision_at(I, I->t, I->x, D) ? 1 : -1;
}

/* Laws that hang together with gaps that come to rest, by what their reactions move, into `in`. */
static void find_island(const Integrator *I, const Decision *D, const long *touching, long *in) {
    long n = D->n, laws = D->gaps + D->frictions, found = 1;
    for (long k = 0; k < laws; k++) in[k] = k < D->gaps && I->state->rests[k];
    while (found) {
        found = 0;
        for (long a = 0; a < laws; a++)
            for (long b = 0; b < laws && in[a]; b++) {
                if (in[b] || !touching[b]) continue;
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
    bridge_impulses(I, D, R, in, h, first, free);
    T->impacts = 0;
    return decide_accelerations(I, R, planned);
}

/* Slips in planes that begin together, without a jump of their accelerations: which ways they go is told by all of them at once, as those of feet by the point that a body turns about. What acts
   against directions that are held would not keep them there. So they begin with speeds, nothing beside those met, at which directions need not be held. Whether there are such; -1 when the input
   function failed. */
static int start_together(Integrator *I, Room R, double planned) {
    struct State *T = I->state;
    Decision D, nothing = decision_of(I, T->no_change, 0);
    long n = reactions_of(I), astray = 0, *law = R.asked;
    double *missing = R.centre, *change = T->blow, time = 0, fast = 0, most = 0;
    if (!I->redundant) return 0;
    if (!decision_at(I, I->t, I->x, &D)) return -1;
    memcpy(law, R.law, sizeof(long) * (size_t)(D.gaps + D.frictions));
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
    for (long i = 0; i < n; i++) missing[i] = R.push[i] = 0;
    for (long f = D.lines; f < D.lines + D.planes; f++) {
        double *mask = T->side + mask_of(I, f);
        if (law[D.gaps + f] != STARTS) continue;
        law[D.gaps + f] = HOLDS;
        for (long k = row_of(&D, f); k < row_of(&D, f) + 2; k++) missing[k] = -time * R.rate[k];
        mask[1] = 1, mask[2] = mask[4] = mask[5] = 0;
    }
    Problem p = problem_of(I, &D, R, missing);
    p.law = law;
    p.kinetic = 1;
    p.damping = DEPENDENT;
    memset(T->no_change, 0, sizeof(double) * (size_t)I->decision.outputs);
    change_choice(&p, &nothing, missing, 0, T->choice_change, change);
    for (long i = 0; i < I->nx; i++)
        for (long j = 0; j < n; j++) I->x[i] += D.J[i * n + j] * change[j];
    return 1;
}

/* What touches after an impact with no speed but rounding of all that has struck stays beside one another: that speed, and the gap, are put to zero, since they would part it in flight,
   so that it strikes in pieces later. So are others to what restitution makes of them, where rounding is all that is missing. 0 when the input function failed. */
static int stay_beside(Integrator *I, Decision *D, Room R) {
    struct State *T = I->state;
    long n = D->n, found = 0;
    double *missing = R.compressed, *end = T->blow;
    Decision nothing = decision_of(I, T->no_change, 0);
    memset(T->no_change, 0, sizeof(double) * (size_t)I->decision.outputs);
    for (long k = 0; k < D->gaps + D->frictions; k++) R.law[k] = OFF;
    for (long i = 0; i < n; i++) R.push[i] = R.floor[i] = 0;
    for (long i = 0; i < D->gaps; i++) {
        double struck = 0;
        for (long j = 0; j < n; j++) struck += fabs(D->W[i * n + j] * T->impulse[j]);
        double noise = fmax(D->rate_noise[i], TOUCHES * EPS * struck), back = fabs(R.before[i]) <= noise ? 0 : -D->bounce[i] * R.before[i];
        if (!R.touching[i] || D->terms[i] < 0 || is_speed(D, i) || !(fabs(D->rate[i] - back) <= noise)) continue;
        R.law[i] = HOLDS;
        R.push[i] = 1, R.floor[i] = back;
        found |= back == 0 && fabs(D->rate[i]) > D->rate_noise[i] / ROUNDINGS; /* a rounding of its own parts it by no more than gaps are rounded */
    }
    if (!found) return 1;
    for (int again = 0; again < 2; again++) { /* the first ones are rounded as large as they are */
        Problem p = problem_of(I, D, R, missing);
        p.kinetic = 1;
        p.damping = I->redundant ? DEPENDENT : 0;
        for (long i = 0; i < n; i++) missing[i] = D->rate[i] - R.floor[i];
        change_choice(&p, &nothing, missing, 0, T->choice_change, end);
        for (long i = 0; i < I->nx; i++) {
            double moved = 0;
            for (long j = 0; j < n; j++) moved += D->J[i * n + j] * end[j];
            if (isfinite(moved)) I->x[i] += moved;
        }
        if (!decision_at(I, I->t, I->x, D)) return 0;
    }
    for (long i = 0; i < D->gaps; i++) {
        T->side[i] = R.law[i] == HOLDS && R.floor[i] == 0;
        R.law[i] = T->side[i] == 1 ? HOLDS : OFF;
    }
    if (I->redundant) T->side[carried_of(I) - 1] = DAMPING * least_pivot(D, R.law, R.work, R.place);
    project(I, I->t, I->x);
    memset(T->side, 0, sizeof(double) * (size_t)first_discrete(I));
    return decision_at(I, I->t, I->x, D);
}

/* All rows are decided at (t, x): impacts, then modes. `row`: the guard of masks that has become negative, -1: none in particular. */
static enum Code decide_reactions(Integrator *I, long row, double planned) {
    struct State *T = I->state;
    Decision D;
    Room R = room_of(I);
    long gaps = I->one_sided, n = reactions_of(I), *leaves = T->leaves;
    int impacts = 0;
    if (I->changes_index && T->begun) project(I, I->t, I->x); /* what has been held at zero through states is where it may change */
    if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
    for (long i = 0; i < gaps; i++) {
        R.touching[i] = D.gap[i] <= D.gap_noise[i] || (T->side[i] == 1 && !has_jumped(I, &D, i)) || i == row;
        if ((!T->begun || has_jumped(I, &D, i)) && D.gap[i] < -fmax(D.gap_noise[i], T->begun && !T->just_set ? 0 : I->rtol * fabs(D.terms[i]))) {
            I->worst = i;
            return OVERLAPS;
        }
        double known = D.gap_noise[i] + (T->side[i] == 1 ? D.rate_noise[i] * T->pace : 0); /* what is held moves by the rounding of all that holds it */
        if (!T->just_set && D.gap[i] < -deepest(I, known, fmax(D.gap_noise[i] / (TOUCHES * EPS), T->gap_terms[i]))) return falls(I, i, -D.gap[i]); /* what has been set moves gaps by the rounding of others */
        int strikes = R.touching[i] && D.rate[i] < -(i == row ? 4 : 1) * D.rate_noise[i];
        T->struck[T->impacts % REMEMBERED * gaps + i] = strikes != 0;
        impacts |= strikes; /* what begins to hold where its speed vanishes strikes nothing */
    }
    int lifted = T->begun && !T->just_set && !I->directions ? lift(I, &D, R) : 0;
    if (lifted < 0) return INPUT_FAILED;
    if (I->directions) {
        if (!meet_directions(I, row, planned)) return INPUT_FAILED;
        if (row < 0) note_closed(I, &D, R.touching);
    }
    look_at_slips(I, &D, R, row, 0);
    if (T->changes > UNSETTLED && !I->directions) end_small_slips(&D, R);
    memset(T->impulse, 0, sizeof(double) * (size_t)n);
    if (impacts) {
        I->worst = row >= 0 && row < gaps ? row : 0;
        enum Code struck = impact(I, &D, R);
        if (struck != REACHED_END) return struck;
        for (long i = 0; i < I->nx; i++)
            for (long j = 0; j < n; j++) I->x[i] += D.J[i * n + j] * T->impulse[j];
        if (I->directions) strike_directions(I, &D, T->impulse);
        memcpy(R.before, D.rate, sizeof(double) * (size_t)n);
        for (long k = 0; k < first_discrete(I); k++) T->side[k] = 0;
        if (!decision_at(I, I->t, I->x, &D) || !stay_beside(I, &D, R)) return INPUT_FAILED;
        look_at_slips(I, &D, R, -1, R.before);
        note_strength(I, &D, R);
    } else {
        note_between(I, row);
    }
    double *rate = R.compressed;
    memcpy(rate, D.rate, sizeof(double) * (size_t)n);
    for (long i = 0; i < gaps; i++) { /* open, if it bounces */
        leaves[i] = R.touching[i] && rate[i] > (impacts ? fmax(D.rate_noise[i], NIL * fabs(R.before[i])) : least_rate(I, &D, i, D.free[i]));
        if (leaves[i]) R.touching[i] = 0;
    }
    enum Code code = decide_accelerations(I, R, planned);
    int low = code == REACHED_END && fall_back(I, &D, R, rate, leaves), over = 0;
    if (impacts) {
        note_sticking(I, &D, R);
        foresee_rest(I, row < gaps ? row : -1);
        over = comes_to_rest(I, low);
        if (over) over = go_on_held(I, R, planned);
        if (over == HELD && I->directions && (low || act_alike(I, &D))) { /* derivatives are those of what is held from here on */
            for (long i = 0; i < gaps; i++)
                if (T->rests[i]) R.touching[i] = 1, leaves[i] = 0;
            over = 0;
            low = 1;
        }
        if (over > 0) over = meets_nothing_else(I, R);
        if (over < 0) return INPUT_FAILED;
    }
    lifted |= low;
    if (over || low) {
        memcpy(T->lifted, T->side, sizeof(double) * (size_t)I->masks);
        memset(T->side, 0, sizeof(double) * (size_t)first_discrete(I));
        if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
    }
    if (over) {
        code = bridge(I, &D, R, row, planned, T->lifted, rate);
        row = BRIDGE;
        impacts = 0;
    }
    while (!over && low) { /* what does not leave keeps others */
        if (I->directions && !meet_directions(I, -1, planned)) return INPUT_FAILED;
        end_low_bounces(I, &D, R);
        if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
        look_at_slips(I, &D, R, -1, rate);
        memcpy(rate, D.rate, sizeof(double) * (size_t)n);
        code = decide_accelerations(I, R, planned);
        low = code == REACHED_END && fall_back(I, &D, R, rate, leaves);
        if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
    }
    if (code == NO_MODE && !I->directions) {
        if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
        if (end_least_slips(I, &D, R)) code = decide_accelerations(I, R, planned);
    }
    if (code == NO_MODE && !I->directions && strike_without_closing(I, R)) {
        impacts = 1;
        code = decide_accelerations(I, R, planned);
    }
    if (code == REACHED_END) code = has_one_answer(I, &D, R);
    if (code != REACHED_END) return code;
    int begins = start_together(I, R, planned);
    if (begins < 0) return INPUT_FAILED;
    lifted |= begins;
    for (int more = 1; more;) {
        memcpy(T->later_x, I->x, sizeof(double) * (size_t)I->nx);
        project(I, I->t, I->x);
        for (long i = 0; i < I->nx; i++) {
            take_size(I, i);
            lifted |= fabs(I->x[i] - T->later_x[i]) > UNSEEN * T->size[i];
        }
        more = end_with_others(I, R);
        if (more < 0) return INPUT_FAILED;
        code = more ? decide_accelerations(I, R, planned) : code;
        if (code != REACHED_END) return code;
    }
    memset(T->carry, 0, sizeof(double) * (size_t)I->nx);
    if (!note_transition(I, row)) return OUT_OF_MEMORY;
    if (row == BRIDGE) end_bridge(I);
    else if ((impacts || lifted) && !keep_straight(I, 0)) return OUT_OF_MEMORY;
    return REACHED_END;
}

#include "sets.h"

/* A part of the time in which states change by their sizes [s], where it is not known how long the motion is. */
static double part_of_motion(Integrator *I) {
    struct State *T = I->state;
    double time = INFINITY;
    if (!rate_at(I, I->t, I->x, T->rate)) return 0;
    for (long i = 0; i < I->nx; i++)
        if (T->size[i] > 0 && isfinite(T->rate[i])) time = fmin(time, T->size[i] / fabs(T->rate[i]));
    return time < INFINITY ? 1e-3 * time : 1e-3;
}

static enum Code begin_modes(Integrator *I) {
    double planned = I->step > 0 ? I->step : I->end > I->t ? 1e-3 * (I->end - I->t) : part_of_motion(I), h = I->h;
    enum Code code = decide_modes(I, -1, planned);
    I->h = h;
    I->state->changed_at = -INFINITY;
    return code;
}
