/* Through singular positions of loops, where branches of the motion cross; see acausal/integrators/passage.py. */

#define NEARBY 0.1
#define CROSSING 5e-5
#define AHEAD 0.016
#define NODES 8
#define NEAREST 4096 /* times as near as usual at most, what rates are continued from */
#define LOST 1e3 /* times the best one: an error that is nothing but rounding */
#define MUCH 0.01 /* part of the tolerance that two such rates may differ by: errors need not fall by a power of the distance yet */
#define DIGITS_LOST 16 /* times as much as in twofold precision, what rounding makes of rates */
#define CORRECTIONS 4
#define SETTLING 10
#define SEARCH 30
#define CLEARER 4 /* times as clear as a stage and as the next to singular positions, the end of a step by which the stage is settled */
#define BESIDE 0.01 /* clearance that steps end with if they can */
#define AVOIDED 4 /* times that a step is made shorter for this */
#define EXACT 0.05 /* clearance below which rates are found in twofold precision: else what is nothing beside the motion is moved by their rounding,
                      at any tolerance, and leads past the position where that is not stable */
#define SEEN 0.05 /* part of the stages' least clearance that a step's polynomial may come closer */
#define AWAY 0.9 /* clearance of stages, or places between them, beyond which nothing is near */
#define ROUNDS 4
#define SHORTEST 1e-9 /* part of the size of a mechanism that it moves by in a step next to a singular position */
#define STILL 1e-5 /* of that, rounding at most */
#define BRANCHES 0.01 /* part of the distance from a singular position that an error may be: another branch is as close */
#define CREPT 300 /* steps next to a singular position, after which is looked how far they have led */
#define AT_ALL 0.03 /* part of their distance from it that they have led by, if they lead anywhere */
#define LENGTHS 1e-13 /* what rounding of lengths makes of velocities at most, times the square of the distance: 8 roundings of some 50 terms */
#define TOUCHING 0.3 /* distance up to which it tells how branches meet */
#define BENT 0.02 /* part of distances that are the square of a way, which they may differ from this */
#define CLOSER 8 /* times as close, the next distance that rates may be continued from */
#define LONGER_WAY 1.5 /* times the time of a stage from which its rates would be continued, that of another one which is asked, too */
#define ROUNDING 100 /* times as large, what is left of rounding errors across the branch */

/* How motions go that come near one: all past it, some straight through, or all. */
enum Through { PAST, PERHAPS, STRAIGHT };

static const double node_places[NODES] = {-4, -3, -2, -1, 1, 2, 3, 4};
static const double node_weights[NODES] = {-1.0 / 70, 4.0 / 35, -2.0 / 5, 4.0 / 5, 4.0 / 5, -2.0 / 5, 4.0 / 35, -1.0 / 70};

static int make_passage(Integrator *I) {
    struct State *T = I->state;
    long B = NODES / LANES, count = I->rhs.inputs + 1;
    for (long b = 0; b < B; b++) {
        T->nodes[b] = reserve_lanes(I, count);
        T->node_rates[b] = reserve_lanes(I, I->nx + 1);
        T->node_along[b] = reserve_lanes(I, I->nx + 1);
        if (I->counted) continue;
        if (!T->nodes[b] || !T->node_rates[b] || !T->node_along[b]) return 0;
        memcpy(T->nodes[b], T->point_in, sizeof(V) * (size_t)count); /* parameters and inputs */
    }
    T->one_along = reserve_lanes(I, I->nx + 1);
    T->ahead = reserve_lanes(I, count);
    T->across = reserve_doubles(I, I->nx + 1);
    return I->counted || (T->one_along && T->ahead && T->across);
}

/* Clearances of the states in the arguments of a rhs; their products are left in T->clearance_out[1]. */
static V clearances(Integrator *I, const V *in) {
    struct State *T = I->state;
    memcpy(T->clearance_in, in, sizeof(V) * (size_t)(1 + I->nx));
    run_kernel(&I->clearance, T->clearance_in, T->clearance_c, T->clearance_out, T->work);
    return T->clearance_out[0];
}

/* Whether there are exact kernels, or can be; where all motions lead straight through, whether they are needed, too. */
static int has_exact(const Integrator *I) {
    return (I->promised || present(&I->exact_rhs)) && (I->through != STRAIGHT || I->state->twofold);
}

/* From here on, where rounding is in the way of the tolerance; whether that is new. */
static int made_exact(Integrator *I) {
    struct State *T = I->state;
    int before = has_exact(I);
    T->twofold = 1;
    return has_exact(I) && !before;
}

/* The rates (0), or one correction (1), in twofold precision; not finite where the kernel that was promised cannot be had. */
static void run_exact(Integrator *I, int which, const V *in, V *out) {
    struct State *T = I->state;
    const Kernel *k = which ? &I->exact_projection : &I->exact_rhs;
    if (!T->exact_c[which]) {
        if (!present(k) && I->lacking) I->lacking(EXACT_PROGRAMS + which);
        if (!present(k) || !prepared(I, k, which ? T->projection_in : T->point_in, &T->exact_c[which])) {
            for (long i = 0; i < I->nx; i++) out[i] = v_all(NAN);
            return;
        }
    }
    run_kernel(k, in, T->exact_c[which], out, T->work);
}

static int make_exact(Integrator *I) {
    struct State *T = I->state;
    for (int k = 0; k < 2; k++) {
        const Kernel *kernel = k ? &I->exact_projection : &I->exact_rhs;
        if (!present(kernel)) continue;
        if (!prepared(I, kernel, k ? T->projection_in : T->point_in, &T->exact_c[k])) return 0;
    }
    T->farther = reserve_doubles(I, I->nx + 1);
    T->nearer = reserve_doubles(I, I->nx + 1);
    T->exact_out = reserve_lanes(I, I->nx + 1);
    return I->counted || (T->farther && T->nearer && T->exact_out);
}

static int is_near(Integrator *I, const V *in) { return has_exact(I) && clearances(I, in)[0] < EXACT; }

static void look_around(Integrator *I, Stages *S) {
    S->looked++;
    for (long b = 0; b < S->blocks; b++) {
        V clear = clearances(I, S->in[b]);
        memcpy(S->clear + b * LANES, &clear, sizeof clear);
        memcpy(S->clear_of_all + b * LANES, &I->state->clearance_out[1], sizeof clear);
        if (has_exact(I)) S->exact |= i_any(clear < v_all(EXACT));
    }
}

/* One correction of the states in the arguments of a rhs. */
static const V *corrected(Integrator *I, const V *in) {
    struct State *T = I->state;
    memcpy(T->projection_in, in, sizeof(V) * (size_t)(1 + I->nx));
    led_by(I, in[0], LANES, T->projection_in + 1 + I->nx);
    if (has_exact(I)) run_exact(I, 1, T->projection_in, T->projection_out);
    else run_kernel(&I->projection, T->projection_in, T->projection_c, T->projection_out, T->work);
    return T->projection_out;
}

/* What of the rates `K` of velocities at the states in `in` lies along the branch; those of positions are left out. */
static void along_branch(Integrator *I, const V *in, const V *K, V *out) {
    struct State *T = I->state;
    long m = I->positions;
    memcpy(T->projection_in, in, sizeof(V) * (size_t)(1 + m));
    led_by(I, in[0], LANES, T->projection_in + 1 + I->nx);
    memcpy(T->projection_in + 1 + m, K + m, sizeof(V) * (size_t)(I->nx - m));
    run_kernel(&I->projection, T->projection_in, T->projection_c, T->projection_out, T->work);
    for (long i = 0; i < m; i++) out[i] = v_all(0.0);
    memcpy(out + m, T->projection_out + m, sizeof(V) * (size_t)(I->nx - m));
    for (long k = 0; k < I->followers; k++) out[I->follower[k]] = T->projection_in[1 + I->follower[k]]; /* rates of these are no values of theirs */
}

/* The nodes: states of one lane moved by tau times `places`, in positions along their rates K, time too. */
static void set_nodes(Integrator *I, const V *in, const V *K, long lane, double tau, const double *places) {
    struct State *T = I->state;
    for (long k = 0; k < NODES; k++) {
        V *node = T->nodes[k / LANES];
        long l = k % LANES;
        double ahead = tau * places[k];
        node[0][l] = in[0][lane] + ahead;
        for (long i = 0; i < I->nx; i++) node[1 + i][l] = in[1 + i][lane] + (i < I->positions ? ahead * K[i][lane] : 0.0);
        for (long i = 0; i < I->nu; i++) node[1 + I->nx + i][l] = in[1 + I->nx + i][lane];
    }
}

/* Distance that the state in one lane has tau [s] ahead and back on average; distances grow in proportion to |tau|. */
static double distance_aside(Integrator *I, const V *in, const V *K, long lane, double tau) {
    static const double both[NODES] = {-1, 1, -1, 1, -1, 1, -1, 1};
    struct State *T = I->state;
    set_nodes(I, in, K, lane, tau, both);
    double one = clearances(I, T->nodes[0])[0];
    double other = LANES > 1 ? T->clearance_out[0][1 % LANES] : clearances(I, T->nodes[1 % (NODES / LANES)])[0];
    return 0.5 * (sqrt(fmax(one, 0)) + sqrt(fmax(other, 0)));
}

/* How far to go ahead and back from the state in one lane, in a step of size h, to have clearance; 0 where that leads nowhere. */
static double crossing(Integrator *I, const V *in, const V *K, long lane, double h) {
    double tau = h, distance = INFINITY;
    for (int k = 0; k < SEARCH && distance > 2 * AHEAD; k++) distance = distance_aside(I, in, K, lane, tau *= 0.25);
    for (int k = 0; k < SEARCH && distance < 0.5 * AHEAD; k++) distance = distance_aside(I, in, K, lane, tau *= 4);
    for (int k = 0; k < 2; k++) distance = distance_aside(I, in, K, lane, tau *= AHEAD / distance);
    return distance > 0.5 * AHEAD && distance < 2 * AHEAD ? tau : 0;
}

/* What is left of values at the nodes when a parabola through them is taken away, as part of them. */
static double bends(const double *values) {
    double first = 0, second = 0, third = 0, left = 0, size = 0; /* sums over 1, k^2 and k; of k^2 over the nodes is 60, of k^4 708 */
    for (long k = 0; k < NODES; k++) {
        double at = node_places[k];
        first += values[k], third += values[k] * at, second += values[k] * at * at;
        size = fmax(size, fabs(values[k]));
    }
    double curve = (second - 7.5 * first) / (708 - 7.5 * 60), slope = third / 60, level = first / NODES - 7.5 * curve;
    for (long k = 0; k < NODES; k++) {
        double at = node_places[k];
        left = fmax(left, fabs(values[k] - level - slope * at - curve * at * at));
    }
    return left / size;
}

/* Whether branches of the motion touch near the state in one lane, rather than cross: the distance from them, not its square, grows as the square of
   the way. Forces that hold loops are then known to so few digits, and so far around, that rates cannot be continued from beside. */
static int touches(Integrator *I, const V *in, const V *K, long lane, double h) {
    struct State *T = I->state;
    double tau = h, distance = INFINITY, clear[NODES], aside[NODES], most = 0;
    for (int k = 0; k < SEARCH && distance > 2 * AHEAD; k++) distance = distance_aside(I, in, K, lane, tau *= 0.5);
    for (int k = 0; k < SEARCH && distance < AHEAD; k++) distance = distance_aside(I, in, K, lane, tau *= 2);
    if (!(distance >= AHEAD && distance <= TOUCHING)) return 0;
    set_nodes(I, in, K, lane, 0.25 * tau, node_places);
    for (long b = 0; b < NODES / LANES; b++) {
        V found = clearances(I, T->nodes[b]);
        memcpy(clear + b * LANES, &found, sizeof found);
    }
    for (long k = 0; k < NODES; k++) aside[k] = sqrt(fmax(clear[k], 0)), most = fmax(most, aside[k]);
    return most < 1 && bends(aside) < fmin(BENT, 0.25 * bends(clear));
}

/* The nodes to either side of a state, with closed loops. */
static void close_nodes(Integrator *I, const V *in, const V *K, long lane, double tau) {
    struct State *T = I->state;
    set_nodes(I, in, K, lane, tau, node_places);
    for (long b = 0; b < NODES / LANES; b++)
        for (int k = 0; k < CORRECTIONS; k++) memcpy(T->nodes[b] + 1, corrected(I, T->nodes[b]), sizeof(V) * (size_t)I->nx);
}

/* Row i of values at the nodes, continued to the state between them. */
static double continued(V *const *values, long i) {
    double sum = 0;
    for (long k = 0; k < NODES; k++) sum += node_weights[k] * values[k / LANES][i][k % LANES];
    return sum;
}

/* The rates of one lane, continued from the nodes to either side; their part along the branch. */
static void correct_lane(Integrator *I, const V *in, V *K, V *along, long lane, double tau) {
    struct State *T = I->state;
    close_nodes(I, in, K, lane, tau);
    for (long b = 0; b < NODES / LANES; b++) rates_at(I, has_exact(I), T->nodes[b], T->node_rates[b]);
    for (long i = I->positions; i < I->nx; i++) K[i][lane] = continued(T->node_rates, i);
    for (long b = 0; b < NODES / LANES; b++) {
        for (long i = 0; i < I->nx; i++) T->node_rates[b][i] = v_all(K[i][lane]);
        along_branch(I, T->nodes[b], T->node_rates[b], T->node_along[b]);
    }
    for (long i = 0; i < I->nx; i++) along[i][lane] = continued(T->node_along, i);
}

/* Rates of velocities continued from nodes to either side, tau apart; `out` (nx). */
static void continued_rates(Integrator *I, const V *in, const V *K, long lane, double tau, double *out) {
    struct State *T = I->state;
    close_nodes(I, in, K, lane, tau);
    for (long b = 0; b < NODES / LANES; b++) rates_at(I, has_exact(I), T->nodes[b], T->node_rates[b]);
    for (long i = I->positions; i < I->nx; i++) out[i] = continued(T->node_rates, i);
}

/* The part of the distance tau from which rates of a stage are continued on a motion that is known to lead straight through, 0 where they are better
   than these themselves; into `rest` what is left of their error in a time tau, in units of the tolerance. Half as far, a polynomial through them is off
   by a 256th, and rounding by eight times as much: it is gone so much nearer until that is no more than the tolerance. Twice as far from the singular
   position as the state they end: one of those to either side would come to lie in it. */
static double straight_from(Integrator *I, const Stages *S, long j, double tau, double *rest) {
    struct State *T = I->state;
    double unit = fmax(10 * KNOWN, I->step > 0 ? 0 : MUCH * I->rtol) / T->unit, part = 2, best = 0, least = 2 * sqrt(fmax(S->clear[j], 0));
    double *farther = T->farther, *nearer = T->nearer;
    *rest = INFINITY;
    continued_rates(I, S->in[j / LANES], S->N[j / LANES], j % LANES, part * tau, farther);
    while (*rest > 1 && 0.5 * part * AHEAD > least && part > 1.0 / NEAREST) {
        part *= 0.5;
        continued_rates(I, S->in[j / LANES], S->N[j / LANES], j % LANES, part * tau, nearer);
        double sum = 0;
        for (long i = I->positions; i < I->nx; i++) {
            double change = (farther[i] - nearer[i]) / T->scale[i];
            sum += change * change;
        }
        double left = sqrt(sum / (double)(I->nx - I->positions)) * part * tau / unit;
        if (left < *rest) *rest = left, best = part;
        else if (left > LOST * *rest) break;
        double *swapped = farther;
        farther = nearer, nearer = swapped;
    }
    return *rest > 1 && 0.5 * part * AHEAD <= least && has_exact(I) ? 0 : best;
}

/* Whether rates a and b of velocities differ by no more than what rounding of lengths makes of them at a distance that is tau away. */
static int agree_at(const Integrator *I, const double *a, const double *b, double distance, double tau, double speed) {
    double change = 0;
    for (long i = I->positions; i < I->nx; i++) change += (a[i] - b[i]) * I->usual[i] * ((a[i] - b[i]) * I->usual[i]);
    return sqrt(change) * tau < speed * LENGTHS / (distance * distance);
}

/* From how far to either side of a state with exact rates K these are to be continued; 0: not at all. Rounding of lengths disturbs rates by its part
   over the cube of the distance from the singular position, so far ones are better, as long as they differ from nearer ones by no more than this. They
   do beside a motion that does not lead straight through, but past the position. The nearest ones are K itself, twice as far from it as the state: it
   has the last word, since at the vertex of a motion past the position those to either side make up for one another. */
static double continued_from(Integrator *I, const V *in, const V *K, long lane, double tau, double clear) {
    struct State *T = I->state;
    double least = 2 * sqrt(clear), distance = AHEAD, speed = 0, *own = T->across, *farther = T->farther, *nearer = T->nearer;
    if (!I->through || !(tau > 0)) return 0;
    for (long i = I->positions; i < I->nx; i++) {
        double v = in[1 + i][lane] * I->usual[i];
        speed += v * v;
        own[i] = K[i][lane];
    }
    speed = sqrt(speed);
    double here = sqrt(clear) / distance * tau;
    continued_rates(I, in, K, lane, tau, farther);
    while (distance / CLOSER > least) {
        distance /= CLOSER;
        continued_rates(I, in, K, lane, tau / CLOSER, nearer);
        if (agree_at(I, farther, nearer, distance, tau, speed)) break;
        tau /= CLOSER;
        double *swapped = farther;
        farther = nearer, nearer = swapped;
    }
    return agree_at(I, farther, own, sqrt(clear), here, speed) ? tau : 0;
}

/* Whether rates of the last try were continued from afar: what rounding makes of them at the states is large, and explains nothing that moves. */
static int is_continued(const Integrator *I, const Stages *S) {
    int beside = 0;
    for (long j = 0; j < S->s && present(&I->clearance) && !present(&I->exact_rhs); j++) beside |= S->clear[j] < NEARBY;
    return beside;
}

/* Widens the scales of velocities to what lengths that are rounded, or that fit to their rounding only, make of them. */
static void forgive_lengths(Integrator *I, const Stages *S) {
    struct State *T = I->state;
    double least = T->part > 0 ? 0.25 * AHEAD * AHEAD * T->part * T->part : INFINITY, speed = 0;
    for (long j = 0; j < S->s; j++)
        if (!(S->tau[j] > 0)) least = fmin(least, S->clear[j]);
    for (long i = I->positions; i < I->nx; i++) speed = fmax(speed, T->size[i] * I->usual[i]);
    double unknown = (has_exact(I) ? 1 : DIGITS_LOST) * EPS / fmax(least, EPS) * speed;
    for (long i = I->positions; i < I->nx; i++)
        if (I->usual[i] > 0) T->scale[i] = fmax(T->scale[i], unknown / I->usual[i]);
}

/* Whether a step goes through a singular position, where rates at its ends are known less than those between. */
static int goes_through(const Integrator *I, const Stages *S) {
    int next = 0;
    for (long j = 0; j < S->s && S->around && I->through == STRAIGHT; j++) next |= S->clear[j] < CROSSING;
    return next;
}

/* How many times less the error of a step has to be than elsewhere: where another branch comes close that nothing leads to, a part of the distance. */
static double beside_branches(const Integrator *I, const Stages *S) {
    double least = INFINITY;
    if (!S->exact || I->through || I->step > 0) return 1;
    for (long j = 0; j < S->s; j++) least = fmin(least, S->clear[j]);
    return fmax(1, I->rtol / (BRANCHES * sqrt(fmax(least, 0)) + EPS));
}

/* The part of that of a stage, whose rates are exact. */
static double part_from(Integrator *I, const Stages *S, long j) {
    double tau = S->tau[j];
    return tau > 0 ? continued_from(I, S->in[j / LANES], S->N[j / LANES], j % LANES, tau, S->clear[j]) / tau : 0;
}

/* Which stages are next to a singular position, and whether some are around one. */
static void find_zone(Integrator *I, Stages *S, Judge *J) {
    int around = 0, exact = has_exact(I);
    long nearest = 0;
    for (long j = 0; j < S->s; j++) {
        S->tau[j] = S->clear[j] < CROSSING && (!exact || I->through) ? crossing(I, S->in[j / LANES], S->N[j / LANES], j % LANES, S->h) : 0;
        around |= (!exact || I->through == STRAIGHT) && !(S->clear[j] >= NEARBY);
        if (S->clear[j] < S->clear[nearest]) nearest = j;
    }
    I->state->touching = S->clear[nearest] < CROSSING && touches(I, S->in[nearest / LANES], S->N[nearest / LANES], nearest % LANES, S->h);
    if (I->through == STRAIGHT && S->tau[nearest] > 0) {
        double rest, part = straight_from(I, S, nearest, S->tau[nearest], &rest);
        if (rest > 1 && J->count && made_exact(I)) { /* the first guess may be poor */
            look_around(I, S);
            for (long b = 0; b < S->blocks; b++) rates_at(I, S->exact, S->in[b], S->N[b]);
            part = straight_from(I, S, nearest, S->tau[nearest], &rest);
        }
        for (long j = 0; j < S->s; j++) S->tau[j] = 2 * sqrt(S->clear[j]) < AHEAD * part ? S->tau[j] * part : 0;
        I->state->part = part;
    } else if (exact) { /* one decision for all stages: what they differ by is no motion */
        long farthest = nearest; /* where the motion leads along singular positions, it is long until it has left them, and far */
        for (long j = 0; j < S->s; j++)
            if (S->tau[j] > LONGER_WAY * S->tau[farthest]) farthest = j;
        double part = part_from(I, S, nearest);
        if (part > 0 && farthest != nearest) part = fmin(part, part_from(I, S, farthest));
        for (long j = 0; j < S->s; j++) S->tau[j] = 2 * sqrt(S->clear[j]) < AHEAD * part ? S->tau[j] * part : 0;
        I->state->part = part;
        around = part == 1;
    }
    for (long b = 0; b < S->blocks && around; b++) along_branch(I, S->in[b], S->K[b], S->G[b]);
    if (around && !S->around) J->floor *= ROUNDING;
    S->around = around;
}

/* Rates N next to a singular position corrected; H: the part of all of them along the branch. */
static void correct_stages(Integrator *I, Stages *S) {
    for (long b = 0; b < S->blocks; b++) {
        if (S->around) along_branch(I, S->in[b], S->N[b], S->H[b]);
        for (long l = 0; l < LANES; l++)
            if (S->tau[b * LANES + l] > 0) correct_lane(I, S->in[b], S->N[b], S->H[b], l, S->tau[b * LANES + l]);
    }
}

/* A state with closed loops in the arguments `in` of a rhs, in all lanes: x + h sum of row[j] K_j, at a fraction `c` of the step. */
static void close_state(Integrator *I, const Stages *S, V *const *K, double c, const double *x, const double *row, V *in) {
    in[0] = v_all(S->t + S->h * c);
    for (long i = 0; i < I->nx; i++) {
        double sum = 0;
        for (long j = 0; j < S->s; j++) sum += row[j] * K[j / LANES][i][j % LANES];
        in[1 + i] = v_all(x[i] + S->h * sum);
    }
    for (int k = 0; k < 2; k++) memcpy(in + 1, corrected(I, in), sizeof(V) * (size_t)I->nx);
}

/* The part along the branch of the velocities T->across times `factor`, at a state that lies between the nodes, or is at them. */
static double moving(Integrator *I, int between, double factor, long i) {
    struct State *T = I->state;
    if (i == I->positions)
        for (long b = 0; b < (between ? NODES / LANES : 1); b++) {
            for (long k = 0; k < I->nx; k++) T->node_rates[b][k] = v_all(factor * T->across[k]);
            along_branch(I, T->nodes[b], T->node_rates[b], T->node_along[b]);
        }
    return between ? continued(T->node_along, i) : T->node_along[0][i][0];
}

/* Takes what rounding errors have done to the rates of the stage nearest to the position out of them, such that the end of the step moves
   along the branch. The stages in between need not: they are less accurate. */
static void settle(Integrator *I, Stages *S, V *const *K, const double *x) {
    struct State *T = I->state;
    double h = S->h;
    const double *b = S->method->b;
    long s = S->s, n = I->nx, k = 0;
    for (long j = 1; j < s; j++)
        if (S->clear[j] < S->clear[k]) k = j;
    close_state(I, S, K, 1.0, x, b, T->ahead);
    if (!(S->clear[k] < NEARBY) || clearances(I, T->ahead)[0] < CLEARER * fmax(S->clear[k], CROSSING)) return;
    int between = S->tau[k] > 0;
    if (between) close_nodes(I, S->in[k / LANES], K[k / LANES], k % LANES, S->tau[k]);
    else close_state(I, S, K, S->method->c[k], x, S->method->A + k * s, T->nodes[0]);
    double least = INFINITY;
    for (int round = 0; round < SETTLING; round++) {
        for (long i = I->positions; i < n; i++) {
            double sum = 0;
            for (long j = 0; j < s; j++) sum += b[j] * K[j / LANES][i][j % LANES];
            T->ahead[1 + i] = v_all(x[i] + h * sum);
        }
        const V *along = corrected(I, T->ahead);
        double size = 0;
        for (long i = I->positions; i < n; i++) {
            T->across[i] = (T->ahead[1 + i][0] - along[i][0]) / (h * b[k]);
            size = fmax(size, fabs(T->across[i]) / T->scale[i]);
        }
        if (!(size < 0.7 * least)) break;
        least = size;
        V *mine = K[k / LANES];
        for (long i = I->positions; i < n; i++) mine[i][k % LANES] -= T->across[i] - moving(I, between, 1.0, i);
        for (long i = I->positions; i < n; i++) mine[i][k % LANES] -= moving(I, between, 0.0, i);
    }
}

/* The part of a change dK (blocks, nx) of the rates along the branch: squares of its entries times `factor`, summed. */
static double change_along(Integrator *I, Stages *S, const V *dK, const double *factor) {
    double sum = 0;
    for (long b = 0; b < S->blocks; b++) {
        V *G = S->G[b];
        S->G[b] = S->H[b];
        S->H[b] = G;
        along_branch(I, S->in[b], dK + b * I->nx, G);
        for (long l = 0; l < LANES && b * LANES + l < S->s; l++)
            for (long i = 0; i < I->nx; i++) sum += G[i][l] * factor[i] * (G[i][l] * factor[i]);
    }
    return sum;
}

/* Of a state that `rate_at` has just been asked for: the rates as stages next to a singular position have them, around one their part along the
   branch, into `rate`. */
static void beside_at(Integrator *I, int around, double h, double *rate) {
    struct State *T = I->state;
    V *in = T->point_in, *K = T->point_out;
    double clear = clearances(I, in)[0], tau = clear < CROSSING ? crossing(I, in, K, 0, h) : 0;
    if (has_exact(I) || I->through == STRAIGHT) tau = 2 * sqrt(clear) < AHEAD * T->part ? tau * T->part : 0;
    if (around) along_branch(I, in, K, T->one_along);
    if (tau > 0) correct_lane(I, in, K, T->one_along, 0, tau);
    for (long i = 0; i < I->nx; i++) rate[i] = (around ? T->one_along : K)[i][0];
}

static double clearance_at(Integrator *I, double t, const double *x) {
    struct State *T = I->state;
    T->nodes[0][0] = v_all(t);
    for (long i = 0; i < I->nx; i++) T->nodes[0][1 + i] = v_all(x[i]);
    return clearances(I, T->nodes[0])[0];
}

/* Whether a state is next to a singular position, where closing loops only adds rounding errors. */
static int is_crossing(Integrator *I, double t, const double *x) {
    if (!present(&I->clearance) || (has_exact(I) && !I->state->straight)) return 0;
    double part = I->through == STRAIGHT && I->state->part > 0 ? I->state->part : 1;
    return clearance_at(I, t, x) < CROSSING * part * part;
}

/* Whether a step leads from elsewhere to beside a singular position, where its end is known to eps / x^2 only, or closely past two of them:
   `settle` finds what rounding has done at one. */
static int is_awkward(Integrator *I, const Stages *S, double h) {
    struct State *T = I->state;
    if (!S->around && !(S->exact && I->directions)) return 0; /* derivatives are not found in twofold precision */
    int passes = 0, beside = 0;
    for (long j = 0; j < S->s; j++) {
        passes += S->clear[j] < BESIDE && !beside;
        beside = S->clear[j] < (beside ? NEARBY : BESIDE);
    }
    if (passes > 1) return 1;
    for (long i = 0; i < I->nx; i++) T->across[i] = I->x[i] + T->increment[i];
    return clearance_at(I, I->t + h, T->across) < BESIDE && !(clearance_at(I, I->t, I->x) < BESIDE);
}

/* States of a step at LANES fractions of it, clearances into `clear`, products of them into `all`; the arguments of a rhs stay in T->ahead. */
static void clearances_within(Integrator *I, const Stages *S, const double *fractions, double *clear, double *all) {
    struct State *T = I->state;
    double P[65], Q[64];
    for (long l = 0; l < LANES; l++) {
        legendre_integrals(fractions[l], S->s, P, Q);
        T->ahead[0][l] = S->t + S->h * fractions[l];
        for (long i = 0; i < I->nx; i++) {
            double sum = 0;
            for (long k = 0; k < S->s; k++) sum += S->a[i * S->blocks * LANES + k] * Q[k];
            T->ahead[1 + i][l] = I->x[i] + S->h * sum;
        }
        for (long i = 0; i < I->nu; i++) T->ahead[1 + I->nx + i][l] = S->in[0][1 + I->nx + i][0];
    }
    V found = clearances(I, T->ahead);
    memcpy(clear, &found, sizeof found);
    memcpy(all, &T->clearance_out[1], sizeof found);
}

/* Whether the polynomial of a step comes much closer to a singular position, between these fractions of it, than the stage there, with a product of
   clearances `least`, and does not lead straight through. */
static int skips(Integrator *I, const Stages *S, double from, double to, double least) {
    struct State *T = I->state;
    double fractions[COUNTED], clear[COUNTED], all[COUNTED], closest = least, seen = 0;
    int through = 0;
    for (int round = 0; round < ROUNDS; round++) {
        double step = (to - from) / (COUNTED + 1), best = INFINITY, at = from;
        for (long k = 0; k < COUNTED; k++) fractions[k] = from + step * (double)(k + 1);
        for (long k = 0; k < COUNTED; k += LANES) clearances_within(I, S, fractions + k, clear + k, all + k);
        for (long k = 0; k < COUNTED; k++)
            if (all[k] < best) best = all[k], at = fractions[k];
        closest = fmin(closest, best);
        if (closest > AWAY) return 0;
        for (long k = 0; k < COUNTED; k++)
            if (clear[k] < CROSSING && clear[k] > seen && closest < SEEN * least) {
                long first = k / LANES * LANES;
                V *K = T->exact_out;
                if (GROUP > 1) clearances_within(I, S, fractions + first, clear + first, all + first);
                rates_at(I, 1, T->ahead, K);
                double tau = crossing(I, T->ahead, K, k - first, S->h);
                through = tau > 0 && continued_from(I, T->ahead, K, k - first, tau, clear[k]) == tau;
                seen = clear[k];
            }
        from = at - step;
        to = at + step;
    }
    return closest < SEEN * least && !through;
}

/* Whether tries of steps have become so short, beside what the velocities are or become, that no distance from a singular position explains it which
   the states' digits tell from none. What stands still but for rounding comes near to none. */
static int is_lost(Integrator *I, const Stages *S, double h) {
    double *rate = I->state->rate, speed = 0;
    if (!S->exact || I->through != PERHAPS || !rate_at(I, I->t, I->x, rate)) return 0;
    for (long i = I->positions; i < I->nx; i++) {
        double most = fmax(fabs(I->x[i]), fabs(h * rate[i])) * I->usual[i];
        speed += most * most;
    }
    double moved = h * sqrt(speed);
    return moved < SHORTEST && moved > STILL * SHORTEST;
}

/* Whether so many steps in a row have ended next to a singular position, have led neither there nor away, and are so short that as many as are left
   would not lead to the end. What vibrates or rests there takes steps as long as elsewhere. */
static int creeps(Integrator *I, const Stages *S) {
    struct State *T = I->state;
    double least = INFINITY;
    for (long j = 0; j < S->s && present(&I->clearance); j++) least = fmin(least, S->clear[j]);
    if (!(least < CROSSING)) T->crept = 0;
    else if (T->crept++ == 0) T->crept_from = I->t, T->crept_at = sqrt(fmax(least, 0));
    if (T->crept <= CREPT) return 0;
    double distance = sqrt(fmax(least, 0)), pace = (I->t - T->crept_from) / CREPT;
    T->crept = 0;
    return fabs(distance - T->crept_at) <= AT_ALL * fmax(distance, T->crept_at) && I->t + pace * (double)(I->max_steps - I->steps) < I->end;
}

/* Whether the polynomial of a step comes much closer to a singular position than the stages around do; not beside stage `straight`. */
static int leaps(Integrator *I, const Stages *S, long straight) {
    for (long j = 0; j < S->s; j++) {
        int first = j == 0, last = j == S->s - 1;
        if (j == straight || (!first && S->clear_of_all[j - 1] < S->clear_of_all[j]) || (!last && S->clear_of_all[j + 1] <= S->clear_of_all[j])) continue;
        if (skips(I, S, first ? 0 : S->method->c[j - 1], last ? 1 : S->method->c[j + 1], S->clear_of_all[j])) return 1;
    }
    return 0;
}

/* Whether a step goes from one branch to another that comes close to it, between two stages that see nothing of this. */
static int leaves_branch(Integrator *I, Stages *S) {
    if (!has_exact(I) || I->through == STRAIGHT) return 0;
    if (!S->around) return leaps(I, S, -1);
    long straight = 0; /* it may leave its branch elsewhere */
    for (long j = 1; j < S->s; j++)
        if (S->clear[j] < S->clear[straight]) straight = j;
    legendre_coefficients(I, S, S->K);
    int found = leaps(I, S, straight);
    legendre_coefficients(I, S, S->G);
    return found;
}
