/* Switches: comparisons, signs, minima, moduli, steps in the rates. Each is held at one side while a step is taken, so that the rates are
   smooth in the step and beyond its end; its rows are positive as long as the side that is held is the true one. Where a row becomes
   negative the step is taken again so that it ends there, to rounding, and the switch goes over to the other side.

   Next to the end the state is moved along the rates that are known, to just beyond the switch: laws of either side need not be defined on the
   other. Values of rows no larger than what rounding makes of them have no sign. Where a switch goes over and back and over again in one instant,
   ten times as much counts as rounding, and again ten times, so that what only touches it gets away; where that does not help no side lasts,
   and the motion slides along the switch. */

#define OVERS 3       /* times that a switch goes over in one instant; from then on more and more counts as rounding */
#define ENDLESS 9     /* times that tell that it slides */
#define LANDINGS 8    /* tries to end a step where a switch goes over */
#define KEPT 1e-12    /* of their sizes: corrections of states that obey their equations */
#define BACK 1e-3     /* of a step: how far before its end a row's slope is taken from */
#define STAYS_OFF 0.5  /* times as near to the end, or a row comes to no zero there: what decays is cut by the inside of a step and not by its end */
#define NEAR_END 0.75   /* of a step: ends that lie before that are looked for again, since the inside of a shorter step is known better */
#define FAR_END 0.25
#define MOST 30       /* places in a step tried; then it becomes shorter until none is left */
#define FEW_POINTS 8  /* at which all rows are looked at first */
#define CORNER 128.0  /* last coefficients of what has a corner between two points, as large as it is there */
#define AS_MUCH 0.85  /* of the whole: a half varies by no less, so it is nothing but rounding */
#define AS_OFTEN 4    /* times that tell so */
#define DIPS 0.1      /* of a step: where a row dips that has been decided to rise, and does, the inside is not known well enough; a shorter one is made, */
#define SOON_ENOUGH 1e-6 /* of the one that was planned, at least: so soon it has been decided */
#define HOP 1e-5      /* of a step: how far from its end a switch may go over; the state is moved there */

/* A sample of a disturbance, in roundings. */
static double chance_of(long sample) { return (double)(drawn(sample) >> 29) / 2 - 1.75; }

static int make_switches(Integrator *I) {
    struct State *T = I->state;
    long fixed = 1 + I->nx + I->nu;
    if (I->row_count && !arranged(I, &I->rows, &T->rows_in, &T->rows_out, &T->rows_c, fixed)) return 0;
    if (I->row_count && !I->counted) give_inputs(I, T->rows_in);
    if (present(&I->sides) && !arranged(I, &I->sides, &T->sides_in, &T->sides_out, &T->sides_c, fixed - I->held + I->masks)) return 0;
    if (I->directions && I->row_count && !arranged(I, &I->row_change, &T->row_change_in, &T->row_change_out, &T->row_change_c, fixed)) return 0;
    if (I->directions && I->row_count && !I->counted) give_inputs(I, T->row_change_in);
    T->side = reserve_doubles(I, I->held);
    T->given = reserve_doubles(I, I->held);
    T->overs = reserve(I, sizeof(long) * (size_t)(I->held + I->set_count));
    T->step_by_side = reserve_doubles(I, 2 * I->held);
    T->row_values = reserve_doubles(I, POINTS * I->row_count);
    T->row_noise = reserve_doubles(I, I->row_count);
    T->at_few = reserve_doubles(I, FEW_POINTS * I->row_count);
    T->far = reserve(I, (size_t)I->row_count);
    T->one_row = reserve_doubles(I, POINTS * I->row_count);
    T->drift = reserve_doubles(I, (COUNTED + 4) * I->nx);
    T->chance = reserve_doubles(I, COUNTED * (I->nx + 1));
    for (long k = 0; k < COUNTED * (I->nx + 1) && T->chance; k++) T->chance[k] = chance_of(k - 1);
    if (!T->chebyshev) {
        T->chebyshev = reserve_doubles(I, POINTS * POINTS);
        if (T->chebyshev) chebyshev_cosines(T->chebyshev);
    }
    return I->counted || (T->side && T->given && T->overs && T->step_by_side && T->row_values && T->row_noise && T->at_few && T->far && T->one_row && T->drift && T->chance && T->chebyshev);
}

/* Samples of what rounding of rates has made of states since modes have been decided, into T->drift (COUNTED, nx), where valves change their modes: what nothing else moves is no larger than
   that. What decays forgets it. To land a step it is found once. Returns 0 when the input function failed. */
static int find_drift(Integrator *I, double t, const double *x) {
    struct State *T = I->state;
    struct Sparse *S = &T->sparse;
    const Kernel *disturbed = I->valves ? disturbed_kernel(I, 0) : 0;
    long n = I->nx;
    double elapsed = fmax(T->pace, t - fmax(T->changed_at, T->start)), *rounds = T->drift + COUNTED * n, *size = rounds + n, *row = size + n, *kept = row + n;
    if (!disturbed || !(elapsed < INFINITY) || (T->lands && T->drift_known) || !make_forgetting(I)) return 1;
    for (long i = 0; i < n; i++) size[i] = fabs(x[i]);
    if (!rounding_of(I, disturbed, t, x, size, rounds)) return 0;
    for (long i = 0; i < n; i++) {
        rounds[i] = isfinite(rounds[i]) ? elapsed * rounds[i] : 0;
        size[i] = fmax(size[i], rounds[i]) > 0 ? fmax(size[i], rounds[i]) : 1;
    }
    memcpy(kept, T->rate, sizeof(double) * (size_t)n);
    int forgets = is_dear(I) ? 0 : factor_forgetting(I, t, x, elapsed, size, row);
    memcpy(T->rate, kept, sizeof(double) * (size_t)n);
    if (forgets < 0) return 0;
    for (long first = 0; first < COUNTED; first += LANES) {
        V *out = forgets ? S->re + n : S->re;
        memset(S->im, 0, sizeof(V) * (size_t)n);
        for (long i = 0; i < n; i++)
            for (long l = 0; l < LANES; l++) S->re[i][l] = first + l > 0 ? rounds[i] * chance_of((first + l) * (n + 1) + i) : 0;
        if (forgets) solve_sparse(I, &T->forgetting);
        for (long i = 0; i < n; i++)
            for (long l = 0; l < LANES; l++) T->drift[(first + l) * n + i] = isfinite(out[i][l]) ? out[i][l] : 0;
    }
    T->drift_known = T->lands;
    return 1;
}

/* A state, or at -1 the time, as a sample of what rounding may have made of it. */
static double disturbed_by(const Integrator *I, double t, const double *x, long i, long sample) {
    const struct State *T = I->state;
    double value = i < 0 ? t : x[i], unit = sample > 0 ? EPS * (i < 0 ? fabs(t) : fmax(T->size[i], fabs(x[i]))) : 0;
    return value + unit * T->chance[sample * (I->nx + 1) + i + 1] + (i < 0 ? 0 : T->drift[sample * I->nx + i]);
}

/* Rows at a point, into T->one_row, and what rounding makes of them, into T->row_noise. Returns 0 when the input function failed. */
static int rows_at(Integrator *I, double t, const double *x) {
    struct State *T = I->state;
    V *in = T->rows_in;
    for (long r = 0; r < I->row_count; r++) T->row_noise[r] = 0;
    if (!I->row_count) return 1;
    if (!find_drift(I, t, x)) return 0;
    for (long first = 0; first < COUNTED; first += LANES) {
        for (long l = 0; l < LANES; l++) {
            for (long i = -1; i < I->nx; i++) in[1 + i][l] = disturbed_by(I, t, x, i, first + l);
        }
        if (!inputs_at(I, in[0], LANES, in + 1 + I->nx)) return 0;
        run_masked(I, OF_ROWS, in, T->rows_c, T->rows_out);
        for (long r = 0; r < I->row_count; r++) {
            if (first == 0) T->one_row[r] = T->rows_out[r][0];
            for (long l = 0; l < LANES; l++) {
                double change = fabs(T->rows_out[r][l] - T->one_row[r]);
                if (change < INFINITY) T->row_noise[r] = fmax(T->row_noise[r], ROUNDINGS * change);
            }
        }
    }
    for (long r = 0; r < I->one_sided; r++)
        if (T->side[r] == 0) T->row_noise[r] = fmax(T->row_noise[r], fmax(T->at_rest[r] * fmax(T->pace, t - fmax(T->changed_at, T->start)), 2 * EPS * T->gap_terms[r]));
    for (long r = 0; r < I->valves; r++) T->row_noise[r] = fmax(T->row_noise[r], rounding_of_row(I, r));
    for (long r = 0; r < I->row_count; r++) {
        long overs = T->overs[I->row_switch[r]];
        for (int j = 1; j < POINTS && r >= I->mode_rows && overs > OVERS && T->row_noise[r] == 0; j++) /* what time and states do not show */
            T->row_noise[r] = EPS * fabs(T->row_values[j * I->row_count + r]);
        for (long k = OVERS; k < overs; k++) T->row_noise[r] *= 10;
    }
    for (long k = 0; k < I->set_count; k++) T->one_row[first_set(I) + k] *= T->set_side[k];
    return 1;
}

static void go_to_other_side(Integrator *I, long row) {
    double *side = &I->state->side[I->row_switch[row]];
    *side = I->row_factor[row] * *side + I->row_plus[row];
}

/* The true sides at (t, x), into T->sides_out. Returns 0 when the input function failed. */
static int true_sides(Integrator *I, double t, const double *x) {
    struct State *T = I->state;
    V *in = T->sides_in;
    in[0] = v_all(t);
    for (long i = 0; i < I->nx; i++) in[1 + i] = v_all(x[i]);
    for (long i = 0; i < I->nu - I->held; i++) in[1 + I->nx + i] = v_all(I->u[i]);
    if (!own_inputs_at(I, in[0], 1, in + 1 + I->nx)) return 0;
    for (long k = 0; k < I->masks; k++) in[1 + I->nx + I->nu - I->held + k] = v_all(T->side[k]);
    run_kernel(&I->sides, in, T->sides_c, T->sides_out, T->work);
    return 1;
}

/* Sides that are not true at (t, x) go over; those in doubt stay. `all` true ones at first, where nothing is known of them, or only of inputs
   that jump. Returns 0 when the input function failed. */
static int agree(Integrator *I, double t, const double *x, int all) {
    struct State *T = I->state;
    if (I->held == I->masks) return 1;
    if (all) memset(T->far, 0, (size_t)I->row_count); /* rows that were far from zero may be at it now */
    for (int again = 0; again < 8; again++) {
        if (all && again == 0 && !true_sides(I, t, x)) return 0;
        if (!rows_at(I, t, x)) return 0;
        int wrong = 0;
        for (long r = I->mode_rows; r < I->row_count; r++) {
            int at_it = all && again == 0 && T->one_row[r] == 0 && T->row_noise[r] == 0; /* an input has jumped right there */
            if (!at_it && !(T->one_row[r] < -T->row_noise[r])) continue;
            wrong = 1;
            if (all && again == 0) T->side[I->row_switch[r]] = T->sides_out[I->row_switch[r] - I->masks][0];
            else go_to_other_side(I, r);
        }
        if (!wrong) break;
    }
    return 1;
}

/* The sides at the start. */
static int begin_sides(Integrator *I) {
    struct State *T = I->state;
    if (I->held == I->masks) return 1;
    if (!agree(I, I->t, I->x, 1)) return 0;
    for (long k = I->masks; k < I->held; k++) T->side[k] = T->sides_out[k - I->masks][0];
    return agree(I, I->t, I->x, 0);
}

/* The state some time [s] later, or before, by the midpoint rule; h: size of the last step. Returns 0 when the input function failed. */
static int hop(Integrator *I, double time, double h) {
    struct State *T = I->state;
    double *x = T->factor, *rate = T->most;
    if (!rate_at(I, I->t, I->x, rate)) return 0;
    for (long i = 0; i < I->nx; i++) x[i] = I->x[i] + 0.5 * time * rate[i];
    if (!rate_at(I, I->t + 0.5 * time, x, rate)) return 0;
    for (long i = 0; i < I->nx; i++) {
        x[i] = I->x[i] + time * rate[i];
        if (!isfinite(x[i])) return 1;
    }
    memcpy(I->x, x, sizeof(double) * (size_t)I->nx);
    if (I->steps > 0 && fabs(time) > 64 * EPS * h) rescale_step(I, 1 + time / h);
    end_step_at(I, I->t + time);
    return 1;
}

/* To where the row of a switch has become negative by no more than rounding; what closes is at zero, since what is beyond would be energy that is given back. Returns 0
   when the input function failed. */
static int meet_row(Integrator *I, const struct Landing *L) {
    struct State *T = I->state;
    long k = I->steps - I->first;
    double h = k > 0 ? I->times[k] - I->times[k - 1] : L->planned, farthest = L->over ? fmax(HOP, I->rtol) * h : INSTANT * L->planned; /* the step has been corrected since it was solved, by its tolerance */
    for (int again = 0; again < 3 && L->slope < 0 && h > 0; again++) { /* a jump keeps its instant */
        if (!rows_at(I, I->t, I->x)) return 0;
        int closes = L->row < I->one_sided;
        double value = T->one_row[L->row], noise = T->row_noise[L->row], time = -(closes ? value : value + noise) / L->slope;
        if ((closes ? fabs(value) <= noise / ROUNDINGS : value <= 0 && value >= -2 * noise) || !(fabs(time) <= farthest)) break;
        if (!hop(I, time, h)) return 0;
    }
    return 1;
}

/* What was known of the rates says nothing of those after a jump. */
static void forget_rates(Integrator *I) {
    struct State *T = I->state;
    T->last_h = 0;
    T->start_known = 0;
    T->jacobian_fresh = 0;
    T->jumped = 1;
    I->error = 0;
}

/* Derivatives of the motion jump where rates do, as the time at which the switch goes over moves: by (f- - f+) dt. `shift`: a short time [s]. */
static int jump_directions(Integrator *I, long row, double shift, const double *before, const double *after) {
    struct State *T = I->state;
    long n = I->nx, rest = 1 + n + I->nu + I->np;
    V *in = T->row_change_in;
    double value[2], *x = T->factor;
    for (int k = 0; k < 2; k++) {
        double time = k ? shift : -shift;
        for (long i = 0; i < n; i++) x[i] = I->x[i] + time * before[i];
        if (!rows_at(I, I->t + time, x)) return 0;
        value[k] = T->one_row[row];
    }
    double slope = (value[1] - value[0]) / (2 * shift);
    if (!(fabs(slope) > 0)) return 1;
    in[0] = v_all(I->t);
    for (long i = 0; i < n; i++) in[1 + i] = v_all(I->x[i]);
    if (!inputs_at(I, in[0], 1, in + 1 + n)) return 0;
    for (long b = 0; b < direction_blocks(I); b++) {
        V *D = T->D + b * n;
        in[rest] = v_all(0);
        memcpy(in + rest + 1, D, sizeof(V) * (size_t)n);
        set_directions(I, in + rest + 1 + n, b, I->nu);
        run_kernel(&I->row_change, in, T->row_change_c, T->row_change_out, T->work);
        V dt = T->row_change_out[row] / v_all(-slope);
        for (long i = 0; i < n; i++) D[i] = v_fma(v_all(before[i] - after[i]), dt, D[i]);
    }
    return 1;
}

#define FALLEN 1000.0 /* roundings, and a tenth of that many tolerances of its terms, that no gap is below zero by where nothing has gone wrong */

/* How far a gap may be below zero, by its rounding and the size of its terms. */
static double deepest(const Integrator *I, double noise, double size) { return FALLEN * (noise + fmin(0.1 * I->rtol, 1e-5) * size); }

/* The gap of a one-sided row has become negative, and nothing has struck. */
static enum Code falls(Integrator *I, long row, double depth) {
    I->worst = row;
    I->apart = depth;
    return FALLS;
}

static int changes_modes(const Integrator *I);
static int look_before_knot(Integrator *I, double t);
static enum Code look_after_switch(Integrator *I, int before);

/* The switch of a row goes over, and with it those of all others that pass zero in the same instant, as where one condition is written in two ways: what is held at sides that do not fit
   one another is no law. `rates`: those until now. Returns 0 when the input function failed. */
static int go_over_together(Integrator *I, long row, double shift, const double *rates) {
    struct State *T = I->state;
    double *x = T->factor, *earlier = T->row_values;
    for (long i = 0; i < I->nx; i++) x[i] = I->x[i] - shift * rates[i];
    if (!rows_at(I, I->t - shift, x)) return 0;
    memcpy(earlier, T->one_row, sizeof(double) * (size_t)I->row_count);
    if (!rows_at(I, I->t, I->x)) return 0;
    go_to_other_side(I, row);
    for (long r = I->mode_rows; r < I->row_count; r++) {
        double noise = T->row_noise[r];
        if (I->row_switch[r] != I->row_switch[row] && T->one_row[r] <= noise && earlier[r] > 10 * noise) go_to_other_side(I, r);
    }
    return 1;
}

#define BARELY 8     /* units in the last place of a time: how much later the other side is looked for first */
#define CORRECTED 20000 /* corrections that what nonlinear equations give may need where it jumps */
#define SHORTER_BY 50 /* halvings of one of them */

/* The correction of x at time t, `by` (nx), the largest part of a size in it, and of the invariants that are left there; infinite where there is none. */
static void correction_at(Integrator *I, double t, const double *x, double *by, double *part, double *left) {
    struct State *T = I->state;
    V *in = T->projection_in, *out = T->projection_out;
    in[0] = v_all(t);
    for (long i = 0; i < I->nx; i++) in[1 + i] = v_all(x[i]);
    run_masked(I, OF_PROJECTION, in, T->projection_c, out);
    *part = *left = 0;
    for (long i = 0; i < I->nx; i++) {
        by[i] = out[i][0] - x[i];
        double share = fabs(by[i]) / fmax(fmax(T->size[i], fabs(x[i])), NOTHING);
        *part = by[i] == 0 ? *part : share < INFINITY ? fmax(*part, share) : INFINITY;
    }
    for (long j = 0; j < I->ng; j++) *left = fabs(out[I->nx + j][0]) < INFINITY ? fmax(*left, fabs(out[I->nx + j][0])) : INFINITY;
}

/* Whether states may jump where sides go over or inputs jump. */
static int may_jump(const Integrator *I) { return I->ng && (!present(&I->clearance) || I->followers); }

#define LEAPS 1e-3 /* of a state: rates that move it more in no time are those of what has not jumped yet */

/* How far a state goes so much later. */
static double ahead(const Integrator *I, long i, double later, const double *rates) {
    double step = later * rates[i];
    return fabs(step) <= LEAPS * fmax(I->state->size[i], fabs(I->x[i])) ? step : 0;
}

/* How much later [s], `latest` at most, the kernel of the projection sees on which sides switches are, and the state x there, along `rates`; 0 where these are NULL. Earlier, where
   `latest` is negative. No number where that is not found, infinite when the input function failed. */
static double seen_later(Integrator *I, double latest, const double *rates, double *x) {
    struct State *T = I->state;
    double later = rates ? copysign(BARELY * EPS * fmax(fabs(I->t), fabs(latest)), latest) : 0;
    memcpy(x, I->x, sizeof(double) * (size_t)I->nx);
    for (; rates; later *= 4) {
        int same = 1;
        for (long i = 0; i < I->nx; i++) x[i] = I->x[i] + ahead(I, i, later, rates);
        if (!true_sides(I, I->t + later, x)) return INFINITY;
        for (long k = I->masks; k < I->held; k++) same &= T->sides_out[k - I->masks][0] == T->side[k];
        if (same) break;
        if (fabs(later) > fabs(latest)) return NAN;
    }
    return later;
}

/* Whether states x at time t need no correction. */
static int is_kept(Integrator *I, double t, const double *x) {
    double part, left;
    correction_at(I, t, x, I->state->increment, &part, &left);
    return part <= KEPT;
}

/* Corrections of x at time t, shortened until less is left of the equations, or at least of the correction (Deuflhard, Newton Methods for Nonlinear Problems, 3.3). 1 where they come to
   an end; 2 where x has been there. */
static int corrected_in_parts(Integrator *I, double t, double *x) {
    struct State *T = I->state;
    double *by = T->increment, *trial = T->change_left, *next = T->most_left, part, left;
    correction_at(I, t, x, by, &part, &left);
    if (part <= KEPT) return 2;
    for (int k = 0; k < CORRECTED && part > 2 * EPS; k++) {
        double length = 1, then, there;
        int good = 0;
        if (!(part < INFINITY)) return 0;
        for (int n = 0; n < SHORTER_BY && !good; n++, length *= 0.5) {
            for (long i = 0; i < I->nx; i++) trial[i] = x[i] + length * by[i];
            correction_at(I, t, trial, next, &then, &there);
            good = then < INFINITY && there < INFINITY && (there <= (1 - 0.25 * length) * left || then <= 0.5 * part || then <= 2 * EPS);
        }
        if (!good) break;
        memcpy(x, trial, sizeof(double) * (size_t)I->nx);
        memcpy(by, next, sizeof(double) * (size_t)I->nx);
        part = then, left = there;
    }
    return part <= KEPT;
}

#define LED_IN 10        /* corrections on the way that inputs lead, */
#define LED_CLOSELY 1e-6 /* until the last one is so small beside a state, */
#define LED_SHORTEST 1e-9 /* and the part of it that is too short to go on */

/* The same by the way that inputs lead from what they were: in parts that are doubled after each that is closed, and quartered after others. */
static int led_along(Integrator *I, double t, double *x) {
    struct State *T = I->state;
    V *u = T->projection_in + 1 + I->nx;
    double *by = T->increment, *trial = T->change_left, done = 0, ahead = 0.25, part, left;
    for (long i = 0; i < I->nu - I->held; i++) T->led_to[i] = u[i][0];
    while (done < 1 && ahead > LED_SHORTEST) {
        double there = fmin(1, done + ahead), close = there < 1 ? LED_CLOSELY : KEPT;
        part = INFINITY;
        memcpy(trial, x, sizeof(double) * (size_t)I->nx);
        for (long i = 0; i < I->nu - I->held; i++) u[i] = v_all(T->led_from[i] + there * (T->led_to[i] - T->led_from[i]));
        for (long i = 0; i < I->nu - I->held && there == 1; i++) u[i] = v_all(T->led_to[i]);
        for (int k = 0; k < LED_IN && !(part <= close); k++) {
            correction_at(I, t, trial, by, &part, &left);
            if (!(part < INFINITY)) break;
            for (long i = 0; i < I->nx; i++) trial[i] += by[i];
        }
        if (part <= close) {
            memcpy(x, trial, sizeof(double) * (size_t)I->nx);
            done = there;
            ahead *= 2;
        } else ahead *= 0.25;
    }
    return done == 1;
}

/* Where sides have gone over, or inputs have jumped, what nonlinear equations give by other states jumps with them. `rates`: of the states, on the new side,
   which is seen `latest` later at most, or earlier; NULL where it is seen already. Where that is not found they stay. 0 when the input function failed. */
static int jump_along(Integrator *I, double latest, const double *rates) {
    struct State *T = I->state;
    double *x = T->before, later = seen_later(I, latest, rates, x);
    if (!isfinite(later)) return isnan(later);
    if (!give_to_projection(I, I->t + later, T->side)) return 0;
    int led = rates ? 0 : (int)I->led, found = led != LED_PLACES || is_kept(I, I->t, x) ? corrected_in_parts(I, I->t + later, x) : 0; /* Newton's iteration may find another branch */
    if (!found && led) {
        memcpy(x, I->x, sizeof(double) * (size_t)I->nx);
        found = led_along(I, I->t, x);
    }
    if (found != 1) return 1;
    for (long i = 0; i < I->nx; i++) {
        I->x[i] = rates ? x[i] - ahead(I, i, later, rates) : x[i];
        T->size[i] = fmax(T->size[i], fabs(I->x[i]));
    }
    memset(T->carry, 0, sizeof(double) * (size_t)I->nx);
    memcpy(I->states + (I->steps - I->first) * I->nx, I->x, sizeof(double) * (size_t)I->nx); /* with which the next step begins */
    return 1;
}

/* With it directions jump: those of what is given follow the others. */
static int directions_jump(Integrator *I, double latest, const double *rates) {
    struct State *T = I->state;
    double later = seen_later(I, latest, rates, T->before);
    for (long b = 0; b < direction_blocks(I) && isfinite(later); b++) project_block(I, I->t + later, T->before, b, T->D + b * I->nx);
    return isfinite(later) || isnan(later);
}

/* The switch of a row goes over, here and now. Not REACHED_END where the motion slides along it. */
static enum Code go_over(Integrator *I, const struct Landing *L) {
    struct State *T = I->state;
    long k = I->row_switch[L->row];
    if (L->row >= I->mode_rows && I->t >= I->end) { /* a table may end with the motion: what is true there still is not left */
        if (!true_sides(I, I->t, I->x)) return INPUT_FAILED;
        if (T->sides_out[k - I->masks][0] == T->side[k]) return REACHED_END;
    }
    if (!meet_row(I, L)) return INPUT_FAILED;
    if (L->row < I->mode_rows) { /* decided when events of the step have been looked for */
        T->pending = L->row;
        T->pending_planned = L->planned;
        return REACHED_END;
    }
    double *remembered = &T->step_by_side[2 * k], *before = T->most, *after = T->aside, jump = 0, last = T->last_h;
    if (!rate_at(I, I->t, I->x, before)) return INPUT_FAILED;
    if (may_jump(I)) { /* corrected at the end of the step, where the kernel may have seen the other side */
        if (!jump_along(I, -0.1 * BACK * L->planned, before)) return INPUT_FAILED;
        if (!rate_at(I, I->t, I->x, before)) return INPUT_FAILED;
    }
    T->parting.since = I->t;
    double old = T->side[k], new;
    remembered[old > 0] = L->planned;
    int crossed = T->crossed;
    if (changes_modes(I) && !look_before_knot(I, I->t)) return INPUT_FAILED;
    if (!go_over_together(I, L->row, 0.1 * BACK * L->planned, before)) return INPUT_FAILED;
    if (!agree(I, I->t, I->x, 0)) return INPUT_FAILED; /* conditions of what has jumped */
    new = T->side[k];
    for (long r = 0; r < I->row_count; r++) T->far[r] &= I->row_switch[r] != k;
    if (!rate_at(I, I->t, I->x, after)) return INPUT_FAILED;
    if (may_jump(I)) {
        if (!jump_along(I, 0.1 * BACK * L->planned, after)) return INPUT_FAILED;
        if (!rate_at(I, I->t, I->x, after)) return INPUT_FAILED;
    }
    for (long i = 0; i < I->nx; i++) jump = fmax(jump, fabs(after[i] - before[i]) * L->planned / T->scale[i]);
    T->side[k] = old; /* rows are those that are held until now */
    if (I->directions && !jump_directions(I, L->row, 0.1 * BACK * L->planned, before, after)) return INPUT_FAILED;
    T->side[k] = new;
    if (I->directions && may_jump(I) && !directions_jump(I, 0.1 * BACK * L->planned, after)) return INPUT_FAILED;
    I->h = remembered[new > 0] > 0 ? remembered[new > 0] : L->planned;
    forget_rates(I);
    if (jump <= 1) T->last_h = last; /* they only bend */
    I->switched++;
    if (++T->overs[k] > ENDLESS && jump > 1) {
        I->worst = k - I->masks;
        return SLIDES;
    }
    return changes_modes(I) ? look_after_switch(I, crossed) : REACHED_END;
}

/* Whether a row's values at POINTS places are far from zero, beside what they change by. */
static int is_far_above(const double *v) {
    double least = v[0], most = v[0], finite = 0;
    for (int k = 0; k < POINTS; k++) {
        least = v[k] < least ? v[k] : least, most = v[k] > most ? v[k] : most;
        finite += 0 * v[k];
    }
    return least > 0.5 * (most - least) + finite; /* never, where one of them is no number */
}

#define FAR_CHANGES 5.0 /* where they are all so many times what they change by to either side at a few points, nothing else is looked for */

/* Whether all rows are so far from zero in a step that nothing is looked for; -1 when the input function failed. */
static int are_all_far(Path *p) {
    Integrator *I = p->I;
    struct State *T = I->state;
    double theta[FEW_POINTS], *values = T->at_few;
    for (int j = 0; j < FEW_POINTS; j++) theta[j] = (double)j / (FEW_POINTS - 1);
    for (int k = 0; k < FEW_POINTS; k += LANES) {
        V at;
        memcpy(&at, theta + k, sizeof at);
        const V *out = guards_in_lanes(p, at);
        if (!out) return -1;
        for (long r = 0; r < I->row_count; r++) {
            V value = out[r] * v_all(side_of_row(I, r));
            memcpy(values + r * FEW_POINTS + k, &value, sizeof value);
        }
    }
    Bits near = i_all(0);
    for (long r = 0; r < I->row_count; r++) {
        if (has_corner(I, r)) return 0;
        V middle = v_all(values[r * FEW_POINTS + FEW_POINTS / 2]), value;
        for (int k = 0; k < FEW_POINTS; k += LANES) {
            memcpy(&value, values + r * FEW_POINTS + k, sizeof value);
            near |= ~(Bits)(v_all(FAR_CHANGES) * v_abs(value - middle) < middle); /* nor is what is no number far */
        }
    }
    if (i_any(near)) return 0;
    memset(T->far, 1, (size_t)I->row_count);
    return 1;
}

/* Whether what has these Chebyshev coefficients keeps above what is no more than noise. */
static int stays_above(const double *c, double noise) { return c[0] - 1.01 * series_varies(c) >= -noise; }

/* Whether what is so large at least may have a corner at zero between two points: its last coefficients tell of that by those that would follow. */
static int may_turn(const double *c, double noise, double least) {
    double last = 0;
    for (int k = POINTS - 3; k < POINTS; k++) last = fmax(last, fabs(c[k]) - noise);
    return CORNER * last > fmax(least, 0);
}

/* Where a row becomes negative between lo and hi, 2 where it does not, -1 when the input function failed. `known`: its values, or null. `wider`: by how much it
   varied in the interval that this is a half of; `same`: so many times in a row a half has varied as much as the whole: then it is what rounds terms that neither
   states nor time show, and no half tells more. */
static double first_below(Path *p, double lo, double hi, const double *known, int depth, double wider, int same) {
    struct State *T = p->I->state;
    double theta[POINTS], v[POINTS], c[POINTS], middle = 0.5 * (lo + hi), least = INFINITY;
    int finite = 0, below = -1, corner = has_corner(p->I, p->guard), turns = 0;
    for (int j = 0; j < POINTS; j++) theta[j] = j == POINTS - 1 ? hi : lo + (hi - lo) * point_in(T->chebyshev, j);
    if (p->series) {
        for (int j = 0; j < POINTS; j += LANES) {
            V at;
            memcpy(&at, theta + j, sizeof at);
            at = series_at(p->series, in_series(p, at));
            memcpy(v + j, &at, sizeof at);
        }
    } else {
        if (!known && !guard_values(p, theta, POINTS, T->one_row)) return -1;
        for (int j = 0; j < POINTS; j++) v[j] = (known ? known : T->one_row)[j * p->I->row_count + p->guard];
    }
    for (int j = 0; j < POINTS; j++) {
        finite += isfinite(v[j]) != 0;
        least = fmin(least, v[j]);
        if (below < 0 && v[j] < -p->noise) below = j;
    }
    int deep = depth > 30 || ++p->searches > SEARCHES, here = 0;
    if (finite == 0 || (finite < POINTS && deep)) return below < 0 ? 2 : theta[below];
    if (finite == POINTS) {
        chebyshev_coefficients(T->chebyshev, v, c);
        turns = corner && may_turn(c, p->noise, least);
        if (!turns && stays_above(c, p->noise)) return 2;
        double varies = series_varies(c);
        same = varies > AS_MUCH * wider ? same + 1 : 0;
        wider = varies;
        deep |= same >= AS_OFTEN;
        here = !p->series && is_resolved(c, 0.1 * p->noise);
        if (here) p->series = c, p->from = lo, p->to = hi;
    }
    double found;
    if (finite == POINTS && ((!turns && is_monotone(c)) || deep)) {
        if (below < 0) found = 2;
        else if (below == 0 || v[below - 1] <= 0) found = below == 0 ? lo : theta[below - 1];
        else found = zero_between(p, theta[below - 1], theta[below], v[below - 1], v[below]);
    } else {
        found = first_below(p, lo, middle, 0, depth + 1, wider, same);
        if (found == 2) found = first_below(p, middle, hi, 0, depth + 1, wider, same);
    }
    if (here) p->series = 0;
    return found;
}

/* Where a row with these values, negative at the end, becomes so after it has been largest: how it has left zero is known less well than that. 2 where it has not left it. */
static double first_below_again(Path *p, const double *theta, const double *v, double noise) {
    int most = 0;
    for (int j = 1; j < POINTS; j++)
        if (v[j] > v[most]) most = j;
    p->noise = noise;
    if (!(v[most] > p->noise)) return 2;
    p->searches = 0;
    return first_below(p, theta[most], 1, 0, 0, INFINITY, 0);
}

/* So soon is now [s]. */
static double at_once(const Integrator *I) { return 16 * EPS * fmax(fabs(I->t), fabs(I->end) * 1e-3); }

/* Where a row that is zero but for rounding, and has been decided to stay as it is, is clearly below zero: until then it says nothing. */
static double clearly_below(const Path *p, const double *theta, const double *v, double noise) {
    double lo = 0, hi = 1, level = fmin(v[0], 0) - noise;
    for (int j = POINTS - 1; j > 0; j--)
        if (v[j] < level) hi = theta[j];
    while (hi - lo > 0.1 * hi && hi > EPS) {
        double middle = 0.5 * (lo + hi);
        *(one_value(p, middle) < level ? &hi : &lo) = middle;
    }
    return hi;
}

static int find_set_slopes(Integrator *I, double *slope);

/* How far from zero the tolerance leaves a guard of something that sets. */
static double at_rest(const Integrator *I, long row) { return I->state->row_noise[row] * fmax(MET, ROUNDINGS * I->rtol / EPS); }

#define MOVED 1e3 /* roundings that states are moved by where it is asked what depends on them */

/* The same of its states x at t alone, where rounding has been looked at: time is known to rounding, whatever the tolerance is. Negative when the input function failed. */
static double known_by_states(Integrator *I, long row, double t, const double *x) {
    struct State *T = I->state;
    V *in = T->rows_in;
    double most = 0, here = 0;
    in[0] = v_all(t);
    for (long first = 0; first < COUNTED; first += LANES) {
        for (long l = 0; l < LANES; l++)
            for (long i = 0; i < I->nx; i++) {
                double unit = first + l > 0 ? MOVED * EPS * fmax(T->size[i], fabs(x[i])) : 0;
                in[1 + i][l] = x[i] + unit * ((double)(drawn((first + l) * (I->nx + 1) + i) >> 29) / 2 - 1.75);
            }
        if (!inputs_at(I, in[0], LANES, in + 1 + I->nx)) return -1;
        run_masked(I, OF_ROWS, in, T->rows_c, T->rows_out);
        if (first == 0) here = T->rows_out[row][0];
        for (long l = 0; l < LANES; l++) most = fmax(most, fabs(T->rows_out[row][l] - here));
    }
    return most * ROUNDINGS * ROUNDINGS * I->rtol / (MOVED * EPS);
}

/* Whether such a guard rests at zero: it is as near as the tolerance tells, and so it is at the end, or `ahead` of here, if it goes on as it does here. -1: the input function failed. */
static int rests_at_zero(Integrator *I, long row, double value, double t, const double *x, double ahead) {
    double *slope = I->state->set_rows + 2 * I->set_count, known = at_rest(I, row), rounded = MET * I->state->row_noise[row];
    if (!(fabs(value) <= known)) return 0;
    if (!find_set_slopes(I, slope)) return -1;
    double most = fmax(fabs(value), fabs(slope[row - first_set(I)] * fmax(I->end - I->t, ahead)));
    if (!(most <= known)) return 0;
    double by_states = most <= rounded ? known : known_by_states(I, row, t, x);
    return by_states < 0 ? -1 : most <= by_states || by_states >= 0.5 * known; /* what else but time it depends on is as rounded as rounding tells */
}

/* The first row that becomes negative in a step, into L, and where; 2 where none does, -1 when the input function failed, -2 where an
   open gap is below zero at the end and nothing has been found on the way. */
static double first_switch(Path *p, struct Landing *L) {
    Integrator *I = p->I;
    struct State *T = I->state;
    double theta[POINTS], v[POINTS], first = 2;
    int noise_known = 0, coarse = 0;
    long fallen = -1;
    int far = are_all_far(p);
    if (far) return far < 0 ? -1 : 2;
    for (int j = 0; j < POINTS; j++) theta[j] = j == POINTS - 1 ? 1 : point_in(T->chebyshev, j);
    if (!guard_values(p, theta, POINTS, T->row_values)) return -1;
    for (long r = 0; r < I->row_count; r++) {
        for (int j = 0; j < POINTS; j++) v[j] = T->row_values[j * I->row_count + r];
        if (!has_corner(I, r) && is_far_above(v)) {
            T->far[r] = 1;
            continue;
        }
        if (!noise_known && !rows_at(I, p->t + p->h, p->stop)) return -1;
        noise_known = 1;
        double most = fabs(v[0]);
        for (int j = 1; j < POINTS; j++) most = fmax(most, fabs(v[j]));
        if (r < I->one_sided && T->side[r] == 0 && v[POINTS - 1] < -deepest(I, T->row_noise[r] + fmax(-v[0], 0), most)) fallen = r;
        if (T->overs[I->row_switch[r]] > ENDLESS) continue;
        p->guard = r;
        p->noise = T->row_noise[r];
        if (r >= first_set(I) && r < I->mode_rows) { /* what is at zero has passed where it is seen to get away */
            if (fabs(v[0]) <= MET * p->noise) p->noise *= MET;
            int rests = rests_at_zero(I, r, v[0], p->t + p->h, p->stop, p->h);
            if (rests < 0) return -1;
            if (rests) p->noise = fmax(p->noise, fabs(v[0]) + at_rest(I, r));
            if (rests && fabs(v[POINTS - 1]) <= p->noise) continue; /* the inside of a step is known less well than its ends */
        }
        double known = p->noise; /* of the ends; and of the inside: */
        int decided = r < I->mode_rows && p->t == T->changed_at; /* that it holds: then it leaves zero, within what the inside of a step is known to */
        int slowly = r < I->one_sided && T->parting.near_zero && T->parting.near_zero[r]; /* it opens: until it has */
        if (slowly) decided = T->parting.near_zero[r] = !(v[0] > MET * known);
        if (decided) p->noise = fmax(p->noise, r < first_set(I) ? known - v[0] : -1.01 * v[0]);
        for (int j = 0; decided && (r < first_set(I) ? v[0] : fabs(v[0])) <= T->row_noise[r] && j < POINTS; j++) p->noise = fmax(p->noise, 10 * I->rtol * fabs(v[j]));
        if (slowly && decided) p->noise = fmax(p->noise, at_rest(I, r));
        int is_coarse = r < first_set(I) && p->noise > known;
        coarse += is_coarse;
        p->searches = 0;
        double here = first_below(p, 0, 1, T->row_values, 0, INFINITY, 0);
        if (here < 0) return -1;
        if (here >= 0 && is_coarse && (here <= 1 || v[POINTS - 1] < -known)) { /* what has left zero comes back to it, not to as far below it as it began */
            double again = first_below_again(p, theta, v, known);
            here = again < here ? again : here;
        }
        if (here < 0) return -1;
        if (v[0] > 100 * p->noise) T->far[r] = 1;
        if (here == 2 && fabs(v[POINTS - 1]) <= p->noise && T->far[r]) here = 1; /* the step ends there */
        if (here > 1 || here >= first) continue;
        if (!decided && v[0] <= p->noise && here > 0 && one_value(p, 0.5 * here) <= 2 * p->noise) here = 0;
        if (here * p->h <= at_once(I) && T->changes > 0 && r < I->one_sided && decided) {
            if (!rows_at(I, p->t, p->start)) return -1;
            double begun = fmax(known, T->row_noise[r]);
            if (fabs(v[0]) <= begun) here = clearly_below(p, theta, v, begun);
            noise_known = 0;
        }
        first = here;
        L->row = r;
        L->coarse = is_coarse;
        L->dips = decided && r < first_set(I) && here * p->h <= at_once(I) && v[POINTS - 1] > known;
    }
    L->others_coarse = coarse > L->coarse;
    if (first == 2 && fallen >= 0) {
        falls(I, fallen, -T->row_values[(POINTS - 1) * I->row_count + fallen]);
        return -2;
    }
    return first;
}

static double next_landing(Path *p, struct Landing *L) {
    Integrator *I = p->I;
    struct State *T = I->state;
    double end = p->t + p->h, edge = 2 * EPS * fabs(end);
    p->guard = L->row;
    if (!rows_at(I, end, p->stop)) return -1;
    double noise = T->row_noise[L->row], value = T->one_row[L->row], slope = (value - one_value(p, 1 - BACK)) / BACK;
    double theta = 1 - value / slope;
    L->slope = slope / p->h;
    if (fabs(value) <= noise || fabs(theta - 1) * p->h <= edge || (!I->directions && slope < 0 && fabs(theta - 1) <= HOP)) return 1;
    if (L->coarse) return 2;
    int sets = L->row >= first_set(I) && L->row < I->mode_rows; /* that is at rest where rounding is all that is left of it, and not a place to look at again */
    int decays = value > 0 && L->tries > 0 && theta - 1 > STAYS_OFF * fabs(L->off);
    L->off = theta - 1;
    if (slope < 0 && theta > (sets ? FAR_END : NEAR_END) && theta < 1.5 && !decays && ++L->tries <= LANDINGS) return theta;
    return value < 0 && L->tries > LANDINGS ? 1 : 2;
}

/* Of a step that has been solved: 1, it may be taken; 0, a switch goes over before it; otherwise the part of it to try instead, so that it
   ends where a switch goes over. -1: the input function failed. */
static double landing(Integrator *I, const Stages *S, double h, struct Landing *L) {
    struct State *T = I->state;
    for (long i = 0; i < I->nx; i++) T->aside[i] = I->x[i] + T->increment[i];
    Path p = {I, S->a, I->x, T->aside, S->s, S->blocks * LANES, 0, I->t, h, 0, 0, 0, 1, 1, 0, 0, 1};
    double to = 2;
    L->over = 0;
    if (L->row >= 0) to = next_landing(&p, L);
    if (to == 2 || (to == 1 && L->others_coarse)) { /* in a step that is much shorter, another one may be seen before */
        long reached = to == 1 ? L->row : -1;
        struct Landing other = *L;
        other.row = -1;
        other.tries = other.coarse = 0;
        to = first_switch(&p, &other);
        if (reached >= 0 && (to == 2 || other.row == reached)) {
            L->over = 1;
            return 1;
        }
        *L = other;
        if (to == 2) return 1;
        L->planned = fmax(I->h, h);
        if (to < 0) return to;
        p.guard = L->row;
        L->slope = (one_value(&p, to + BACK) - one_value(&p, to)) / (BACK * h);
        if (L->dips && h > SOON_ENOUGH * T->pace) {
            L->row = -1;
            return DIPS;
        }
        if (++L->total > MOST) return 0.5 * to;
        int at_begin = L->row >= 0 && L->row < I->valves && to <= INSTANT && L->slope < 0 && I->steps > 0 && T->changed_at != I->t && !I->directions; /* a valve: a step that ends there would know nothing but rounding */
        if (to * h <= at_once(I) || at_begin) to = 0;
    }
    L->over = to == 1;
    return to;
}
