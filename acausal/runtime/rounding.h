/* What rounding makes of a function's results. Its program is carried out on pairs of values, the second of which is disturbed: in each operation by a
   random part of 2^-40, many times what rounding does. What both results differ by, made smaller again by as much, is what rounding does to first
   order (Chaitin-Chatelin and Fraysse, Lectures on Finite Precision Computations). Jumps are decided by the first values, so that none is taken for
   rounding. A sample is a lane; all widths take the same ones. */

#define SAMPLES 8
#define ENLARGED 0x1p-40
#define LESS 0x1p-5        /* of it, where a law ends so near that disturbed values leave it, */
#define LEAST_PART 0x1p-50 /* down to little more than what rounding is */

typedef unsigned long long Words __attribute__((vector_size(8 * LANES)));

struct Draw {
    Words words;
    double part; /* of a value, by which it is disturbed at most */
};

/* Lane by lane 1 + a random part. */
INLINE V chance(struct Draw *draw) {
    draw->words = draw->words * 6364136223846793005ULL + 1442695040888963407ULL;
    return v_all(1.0) + v_all(2 * draw->part) * ((V)((draw->words >> 12) | 0x3ff0000000000000ULL) - v_all(1.5));
}
INLINE Pair rounded_pair(V first, V second, struct Draw *draw) { return (Pair){first, second * chance(draw)}; }
INLINE Pair same_pair(V x) { return (Pair){x, x}; }
INLINE Pair pair_add(Pair a, Pair b, struct Draw *draw) { return rounded_pair(a.hi + b.hi, a.lo + b.lo, draw); }
INLINE Pair pair_mul(Pair a, Pair b, struct Draw *draw) { return rounded_pair(a.hi * b.hi, a.lo * b.lo, draw); }

#define EXACTLY(f) (Pair){f(A.hi), f(A.lo)}
#define EXACTLY_TWO(f) (Pair){f(A.hi, B.hi), f(A.lo, B.lo)}
#define ONE(f) rounded_pair(f(A.hi), f(A.lo), draw)
#define TWO(f) rounded_pair(f(A.hi, B.hi), f(A.lo, B.lo), draw)
#define TRUTH(m) same_pair(v_truth(m))

#define DISTURBED(O) \
    O(NEG, EXACTLY(-)) O(SQ, pair_mul(A, A, draw)) O(TWICE, ((Pair){A.hi + A.hi, A.lo + A.lo})) O(INV, ONE(v_all(1.0) /)) O(SQRT, ONE(v_sqrt)) \
    O(FABS, EXACTLY(v_abs)) O(NOT, TRUTH(A.hi == v_all(0.0))) O(SIGN, same_pair(v_copysign(v_sign(A.hi), A.hi))) O(EXP, ONE(v_exp)) O(LOG, ONE(v_log)) \
    O(SIN, ONE(v_sin)) O(COS, ONE(v_cos)) O(TAN, ONE(v_tan)) O(ASIN, ONE(v_asin)) O(ACOS, ONE(v_acos)) O(ATAN, ONE(v_atan)) O(SINH, ONE(v_sinh)) \
    O(COSH, ONE(v_cosh)) O(TANH, ONE(v_tanh)) O(ASINH, ONE(v_asinh)) O(ACOSH, ONE(v_acosh)) O(ATANH, ONE(v_atanh)) O(FLOOR, same_pair(v_floor(A.hi))) \
    O(CEIL, same_pair(v_ceil(A.hi))) O(ERF, ONE(v_erf)) O(ERFINV, ONE(v_erfinv)) O(LOG1P, ONE(v_log1p)) O(EXPM1, ONE(v_expm1)) O(ADD, pair_add(A, B, draw)) \
    O(SUB, rounded_pair(A.hi - B.hi, A.lo - B.lo, draw)) O(MUL, pair_mul(A, B, draw)) O(DIV, rounded_pair(A.hi / B.hi, A.lo / B.lo, draw)) \
    O(LT, TRUTH(A.hi < B.hi)) O(LE, TRUTH(A.hi <= B.hi)) O(EQ, TRUTH(A.hi == B.hi)) O(NE, TRUTH(A.hi != B.hi)) \
    O(AND, TRUTH((A.hi != v_all(0.0)) & (B.hi != v_all(0.0)))) O(OR, TRUTH((A.hi != v_all(0.0)) | (B.hi != v_all(0.0)))) \
    O(IF_ELSE_ZERO, d_select(A.hi != v_all(0.0), B, same_pair(v_all(0.0)))) O(POW, TWO(v_pow)) O(FMIN, EXACTLY_TWO(v_fmin)) O(FMAX, EXACTLY_TWO(v_fmax)) \
    O(FMOD, TWO(v_fmod)) O(REMAINDER, TWO(v_remainder)) O(COPYSIGN, ((Pair){v_copysign(A.hi, B.hi), v_copysign(A.lo, B.hi)})) O(ATAN2, TWO(v_atan2)) \
    O(HYPOT, TWO(v_hypot)) O(MUL_ADD, pair_add(pair_mul(A, B, draw), C, draw)) O(MUL_SUB, pair_add(pair_mul(A, B, draw), d_neg(C), draw)) \
    O(SUB_MUL, pair_add(d_neg(pair_mul(A, B, draw)), C, draw)) O(MUL_MUL, pair_mul(pair_mul(A, B, draw), C, draw)) O(MOVE, A)

#define DISTURBED_SINCOS(a, sine, cosine) (*(sine) = ONE(v_sin), *(cosine) = ONE(v_cos))
#define INTERPRETER interpret_disturbed
#define VALUE Pair
#define OUTSIDE Pair
#define PARTS 1
#define OF_OUTSIDE(x) (x)
#define TO_OUTSIDE(x) (x)
#define OF_NUMBER same_pair
#define ALONG , struct Draw *draw
#define SINCOS DISTURBED_SINCOS
#define TABLE DISTURBED
#define SYSTEM(at, n, m, damped) ((void)0)
#include "statements.h"
#undef DISTURBED_SINCOS
#undef EXACTLY
#undef EXACTLY_TWO
#undef ONE
#undef TWO
#undef TRUTH

/* Room for slopes of the rates and factors of them. 0 when memory is short. */
static int make_forgetting(Integrator *I) {
    struct State *T = I->state;
    if (T->slopes_of) return 1;
    T->slopes_of = reserve_doubles(I, I->pattern.start[I->nx] + 1);
    return (make_sparse(I) && make_factors(I, &T->forgetting) && T->slopes_of) || I->counted;
}

/* Room for pairs of a program's values. 0 when memory is short. */
static int make_pairs(Integrator *I, const Kernel *k) {
    struct State *T = I->state;
    const long sizes[] = {2 * k->inputs, 2 * k->outputs, k->constants};
    V **const pairs[] = {&T->pair_in, &T->pair_out, &T->pair_frame};
    int all = 1;
    for (int p = 0; p < 3; p++) {
        if (*pairs[p] && sizes[p] <= T->pair_room[p]) continue;
        *pairs[p] = reserve_lanes(I, sizes[p] + 1);
        T->pair_room[p] = sizes[p];
        all = all && *pairs[p];
    }
    if (!T->forgotten) {
        T->forgotten = reserve_doubles(I, 3 * I->nx + 1);
        all = all && T->forgotten && (!I->block || make_forgetting(I));
    }
    return I->counted ? make_forgetting(I) : all;
}

static Kernel *disturbed_one(Integrator *I, int which) { return which == 0 ? &I->disturbed_rhs : which == 1 ? &I->disturbed_guard : &I->disturbed_projection; }

/* The program of the rates (0), guards (1) or projection (2) for which pairs have room; null where there is none. */
static const Kernel *disturbed_kernel(Integrator *I, int which) {
    Kernel *k = disturbed_one(I, which);
    if (!k->program && !(I->lacking && I->lacking(which))) return 0;
    return k->program && make_pairs(I, k) ? k : 0;
}

static int true_sides(Integrator *I, double t, const double *x);

/* Whether rates have no value since switches are held beyond the end of a law; then those of the true sides are taken, as `rates_at` does. */
static int held_too_far(Integrator *I, const Kernel *k, double t, const double *x, Pair *u) {
    long sides = I->held - I->masks;
    if (k != &I->disturbed_rhs || !sides || !true_sides(I, t, x)) return 0;
    for (long j = 0; j < sides; j++) u[I->nu - sides + j] = same_pair(I->state->sides_out[j]);
    return 1;
}

enum Lost { NONE_LOST, DISTURBED_LOST, VALUES_LOST };

/* Into `found` the largest changes of the results, where each value is disturbed by this `part`; what of them has no value: only disturbed ones, or others too. */
static enum Lost disturb(Integrator *I, const Kernel *k, double t, const double *x, const double *size, double part, double *found) {
    struct State *T = I->state;
    Pair *in = (Pair *)(void *)T->pair_in, *out = (Pair *)(void *)T->pair_out;
    enum Lost lost = NONE_LOST;
    for (long i = 0; i < k->outputs; i++) found[i] = 0;
    for (long first = 0; first < SAMPLES; first += LANES) {
        struct Draw draw = {.part = part};
        for (long l = 0; l < LANES; l++) draw.words[l] = (unsigned long long)(first + l + 1) * 0x9e3779b97f4a7c15ULL;
        in[0] = rounded_pair(v_all(t), v_all(t), &draw);
        for (long i = 0; i < I->nx; i++) in[1 + i] = (Pair){v_all(x[i]), v_all(x[i]) + v_all(size[i]) * (chance(&draw) - v_all(1.0))};
        interpret_disturbed(k->preparation, in, T->pair_frame, out, &draw);
        interpret_disturbed(k->program, in, T->pair_frame, out, &draw);
        for (long i = 0; i < k->outputs; i++)
            for (long l = 0; l < LANES; l++) {
                double change = fabs(out[i].lo[l] - out[i].hi[l]);
                if (isnan(out[i].hi[l])) lost = VALUES_LOST;
                else if (isnan(change) && lost == NONE_LOST) lost = DISTURBED_LOST;
                if (!(change <= found[i]) && !isnan(found[i])) found[i] = change;
            }
    }
    for (long i = 0; i < k->outputs; i++) found[i] = isfinite(found[i]) ? found[i] * (EPS / part) : NAN;
    return lost;
}

/* Into `found` what rounding makes of the results of a program (t, x, u, p), x being known to rounding of `size`. 0 when the input function failed. */
static int rounding_of(Integrator *I, const Kernel *k, double t, const double *x, const double *size, double *found) {
    struct State *T = I->state;
    Pair *in = (Pair *)(void *)T->pair_in;
    V *u = T->point_in + 1 + I->nx;
    if (!inputs_at(I, v_all(t), 1, u)) return 0;
    for (long i = 0; i < I->nu; i++) in[1 + I->nx + i] = same_pair(v_all(u[i][0]));
    for (long i = 0; i < I->np; i++) in[1 + I->nx + I->nu + i] = same_pair(v_all(I->parameters[i]));
    double part = ENLARGED;
    enum Lost lost = disturb(I, k, t, x, size, part, found);
    if (lost == VALUES_LOST && held_too_far(I, k, t, x, in + 1 + I->nx)) lost = disturb(I, k, t, x, size, part, found);
    while (lost == DISTURBED_LOST && part > LEAST_PART) lost = disturb(I, k, t, x, size, part *= LESS, found);
    return 1;
}

/* J = df/dx at (t, x), entry by entry of the pattern, by differences of 1e-7 of each state's size: columns that share no row together, LANES of these side
   by side. States without a size are not moved. 0 when the input function failed. */
static int slopes_of_rates(Integrator *I, double t, const double *x, const double *size, double *J) {
    struct State *T = I->state;
    const Pattern *P = &I->pattern;
    long n = I->nx;
    V *in = T->point_in, *out = T->point_out;
    if (!rate_at(I, t, x, T->rate)) return 0;
    int exact = is_near(I, in);
    for (long first = 0; first < P->colours; first += LANES) {
        for (long i = 0; i < n; i++) {
            long lane = P->colour[i] - first;
            in[1 + i] = v_all(x[i]);
            if (lane >= 0 && lane < LANES) in[1 + i][lane] += 1e-7 * size[i];
        }
        rates_at(I, exact, in, out);
        I->evaluations += P->colours - first < LANES ? P->colours - first : LANES;
        for (long j = 0; j < n; j++) {
            long lane = P->colour[j] - first;
            if (lane < 0 || lane >= LANES) continue;
            double step = in[1 + j][lane] - x[j];
            for (long a = P->start[j]; a < P->start[j + 1]; a++) J[a] = step > 0 ? (out[P->row[a]][lane] - T->rate[P->row[a]]) / step : 0;
        }
    }
    return 1;
}

/* Factors of 1 - h J at (t, x), into T->forgetting: what decays within h is forgotten by an implicit step. `size` (n): of states, 1 in the end where they have none; `row` (n): room.
   0 where that is singular, -1 when the input function failed. */
static int factor_forgetting(Integrator *I, double t, const double *x, double h, double *size, double *row) {
    struct State *T = I->state;
    double *own_J = T->J, *own_row = T->row;
    T->J = T->slopes_of, T->row = row;
    int found = slopes_of_rates(I, t, x, size, T->J) ? 1 : -1;
    for (long i = 0; i < I->nx; i++) size[i] = size[i] > 0 ? size[i] : 1;
    if (found > 0) {
        measure_sparse_rows(I, h, 0, size);
        found = factor_anew(I, &T->forgetting, v_all(h), v_all(0.0));
    }
    T->J = own_J, T->row = own_row;
    return found;
}

/* Adds to `sum` what disturbances `rates` (n), one state's after the other, come to: |(1 - h J)^-1 r| for each. */
static void add_remembered(Integrator *I, const double *rates, double *sum) {
    struct Sparse *S = &I->state->sparse;
    struct Factors *F = &I->state->forgetting;
    long n = I->nx;
    for (long j = 0; j < n;) {
        memset(S->re, 0, sizeof(V) * (size_t)n);
        memset(S->im, 0, sizeof(V) * (size_t)n);
        for (long l = 0; l < LANES && j < n; j++)
            if (rates[j] != 0) S->re[j][l++] = rates[j];
        solve_sparse(I, F);
        for (long i = 0; i < n; i++) {
            V here = v_abs(S->re[n + i]);
            for (long l = 0; l < LANES; l++) sum[i] += here[l];
        }
    }
}

/* The same to first order in h, of random combinations of the disturbances: as much as the largest of them. 0 when the input function failed. */
static int add_carried(Integrator *I, double t, const double *x, double h, const double *rates, const double *size, double *sum) {
    struct State *T = I->state;
    long n = I->nx;
    V *in = T->point_in, *out = T->point_out;
    double part = INFINITY;
    if (!rate_at(I, t, x, T->rate)) return 0;
    int exact = is_near(I, in);
    for (long i = 0; i < n; i++)
        if (rates[i] > 0) part = fmin(part, 1e-7 * size[i] / rates[i]);
    for (long first = 0; first < SAMPLES && part > 0 && part < INFINITY; first += LANES) {
        for (long i = 0; i < n; i++)
            for (long l = 0; l < LANES; l++) in[1 + i][l] = x[i] + (drawn((first + l) * n + i) >> 31 ? part : -part) * rates[i];
        rates_at(I, exact, in, out);
        I->evaluations += LANES;
        for (long i = 0; i < n; i++)
            for (long l = 0; l < LANES; l++) sum[i] = fmax(sum[i], fabs(h * (out[i][l] - T->rate[i]) / part));
    }
    return 1;
}

#define DEAR 1e2 /* evaluations of the rates that factors cost */

/* Whether factors of the slopes of the rates cost more than all else, and steps do without them: fixed-point iteration converges where a disturbance is
   carried on by little more than the first order in h. */
static int is_dear(const Integrator *I) { return !I->state->newton_now && I->pattern.work > DEAR * (double)I->operations; }

/* What rounding seems to add to the rates at (t, x) in an implicit step of size h, per state, each operation counted. A state that is the integral of a
   disturbed one is disturbed with it, and what decays fast forgets: |(1 - h J)^-1| r for disturbances r. 0 when the input function failed. */
static int rounding_of_rates(Integrator *I, const Kernel *k, double t, const double *x, double h, double *rates) {
    struct State *T = I->state;
    long n = I->nx;
    double *size = T->forgotten, *row = size + n, *sum = row + n;
    for (long i = 0; i < n; i++) size[i] = fabs(x[i]);
    if (!rounding_of(I, k, t, x, size, rates)) return 0;
    for (long i = 0; i < n; i++) {
        if (!isfinite(rates[i])) rates[i] = 0;
        size[i] = fmax(size[i], fabs(h) * rates[i]);
        sum[i] = 0;
    }
    if (is_dear(I)) {
        int carried = add_carried(I, t, x, h, rates, size, sum);
        for (long i = 0; i < n && carried; i++) rates[i] = fmax(rates[i], sum[i]);
        return carried;
    }
    if (!make_forgetting(I)) return 1;
    int forgets = factor_forgetting(I, t, x, h, size, row);
    if (forgets < 0) return 0;
    if (forgets) add_remembered(I, rates, sum);
    for (long i = 0; i < n; i++) rates[i] = fmax(rates[i], sum[i]);
    return 1;
}
