/* The stage equations K = f(t + c h, x + h A K) of one collocation step, stages side by side in lanes. */

#define EPS 2.220446049250313e-16

/* Contraction that iterations aim at; fixed-point iteration of positions and velocities in turns squares it. */
#define CAREFUL 0.55 /* of the size at which a Gauss step's error would be one */
#define PLAIN 0.3
#define SQUARED 0.2

#define SHORTER 0.8  /* steps that are to become shorter than that make rounding looked at */

#define HOLDERS 16    /* arguments of kernels that are known to hold what they were given */
#define METHODS 4     /* of one integration, at most */
#define MOST_STAGES 32 /* of one method */
#define BLOCKS (MOST_STAGES / LANES)
#define COUNTED 8      /* lanes that costs are counted in, samples taken and sums ordered for, however many there are: all widths go the same way, to the bit */
#define GROUP (COUNTED / LANES) /* blocks that hold as many */

/* What belongs to one method: its matrices by columns in lanes, its stage values. Blocks of LANES stages; the last one is padded
   with copies of the last stage, which no norm counts. */
typedef struct {
    V *mu, *to_legendre; /* (blocks, blocks * LANES): columns, zero beyond s */
    V *c, *b, *hb, *counted, *odd; /* odd: 2 k + 1 for coefficient k */
    V *in[BLOCKS], *K[BLOCKS], *N[BLOCKS], *L[BLOCKS], *saved[BLOCKS]; /* per block: arguments of rhs, rates, new rates, h b K, rates to go back to */
    V *W_re, *W_im, *V_re, *V_im; /* of Newton's iteration: (eigenvalues in lanes, s), (stages in lanes, eigenvalues) */
    double *a; /* Legendre coefficients of the rates, (nx, blocks * LANES) */
    V *G[BLOCKS], *H[BLOCKS]; /* where `around`: the rates' parts along the branch, now and after the next iteration */
    double *clear, *clear_of_all; /* clearances, and products of them */
    double *tau;     /* how far to either side rates are continued from; 0: not needed */
    const Method *method; /* the last pointer */
    long s, blocks;
    double calm; /* errors beyond make steps shorter */
    double t, h; /* of the step */
    int looked;      /* how many times clearances have been found */
    int exact;       /* whether rates are found in twofold precision */
    int around;      /* whether some stages are around a singular position */
} Stages;

typedef struct {
    double tolerance, floor;
    int limit, count;
    double contraction, change, best, least; /* least: of all changes */
} Judge;

enum Verdict { GO_ON, DONE, HOPELESS };

static Judge new_judge(double tolerance, double floor, int limit) {
    Judge j = {tolerance, floor, limit, 0, 0.0, INFINITY, 1.0, INFINITY};
    return j;
}

/* When an iteration has converged, and when it never will; see acausal/integrators/convergence.py. */
INLINE enum Verdict judge(Judge *j, double change) {
    j->count++;
    double last = j->change;
    j->change = change;
    j->least = fmin(j->least, change);
    if (!(change < INFINITY)) return HOPELESS;
    if (change <= j->floor) return DONE;
    if (j->count == 1) return change <= 1e-3 * j->tolerance ? DONE : GO_ON;
    double ratio = last > 0 ? change / last : 0.0;
    /* it begins at rounding errors where the guess was right */
    if (ratio >= 0.5 && (j->best < 0.3 || j->count > 2) && change <= (j->best < 0.3 ? 1e4 : 64) * j->floor) return DONE;
    if (j->count == 2) {
        j->contraction = ratio;
    } else { /* a single ratio is noisy: the mean of the last two, in logarithms */
        double mean = sqrt(ratio * j->contraction);
        j->contraction = ratio > mean ? ratio : mean;
    }
    if (ratio < j->best) j->best = ratio;
    if (ratio >= 1) return j->count > 3 ? HOPELESS : GO_ON;
    double left = change * ratio / (1 - ratio);
    if (left <= j->tolerance && ratio < 0.9) return DONE;
    double goal = j->tolerance > j->floor ? j->tolerance : j->floor;
    if (j->count >= j->limit) return HOPELESS;
    if (j->count >= 4 && ratio > 0.3 && left * power(j->contraction, j->limit - j->count) > goal) return HOPELESS;
    return GO_ON;
}

/* start + sum over stages k of columns[k] * K[k][i], for the stages of one block */
INLINE V combined(const V *columns, V *const *K, long blocks, long i, V start) {
    V r = start, other = v_all(0.0); /* two sums: half the latency */
#if LANES == 1
    for (long b = 0; b < blocks; b++) *(b & 1 ? &other : &r) = v_fma(K[b][i], columns[b], b & 1 ? other : r);
#else
    for (long b = 0; b < blocks; b++) {
        const double *k = (const double *)&K[b][i];
#pragma GCC unroll 8
        for (int l = 0; l < LANES; l += 2) {
            r = v_fma(v_all(k[l]), columns[b * LANES + l], r);
            other = v_fma(v_all(k[l + 1]), columns[b * LANES + l + 1], other);
        }
    }
#endif
    return r + other;
}

/* The sum of all lanes of blocks, in pairs, and pairs of pairs: the same for all widths. */
INLINE double sum_of_blocks(const V *part, long blocks) {
    double sum = 0;
    for (long first = 0; first < blocks; first += GROUP) {
        double each[GROUP] = {0};
        for (long k = 0; k < GROUP && first + k < blocks; k++) each[k] = v_sum(part[first + k]);
        for (int width = GROUP / 2; width > 0; width /= 2)
            for (int k = 0; k < width; k++) each[k] = each[2 * k] + each[2 * k + 1];
        sum += each[0];
    }
    return sum;
}

/* A matrix (s, s), row-major, as columns in lanes. */
static void columns_of(V *columns, const double *matrix, long s, long blocks) {
    for (long b = 0; b < blocks; b++)
        for (long k = 0; k < s; k++)
            for (long l = 0; l < LANES; l++) {
                long row = b * LANES + l;
                columns[(b * blocks * LANES) + k][l] = matrix[(row < s ? row : s - 1) * s + k];
            }
}

/* Number e of values, or the last one where there are fewer, in lanes from e on. */
static V in_lanes(const double *values, long stride, long e, long count) {
    V v = v_all(0.0);
    for (long l = 0; l < LANES; l++) v[l] = values[(e + l < count ? e + l : count - 1) * stride];
    return v;
}

#define TARGET 0.65 /* of the step size at which a Radau step's error would be one */

/* Error of a step from how fast the sizes of the Legendre coefficients of its rates, times h, decay: geometrically, a_k ~ a_0 r^k; the last one known gives r,
   and quadrature of order p misses a_p. Inside of Radau steps, whose dense output is not refined, a_s is missed: that is to be as small as the tolerance, too; what
   asks for the shorter next step counts. */
static double error_by_decay(const Method *m, const double *sizes, double largest) {
    long s = m->stages;
    double tail = sizes[s - 1], order = (double)m->order;
    if (s > 2) tail = fmax(tail, largest * power(sizes[s - 2] / largest, (double)(s - 1) / (double)(s - 2)));
    double end = largest * power(tail / largest, order / (double)(s - 1));
    if (m->kind == GAUSS) return end;
    double inside = tail * power(tail / largest, 1 / (double)(s - 1)) / (double)(4 * s + 2);
    return fmax(end, power(TARGET, order + 1) * power(inside, (order + 1) / (double)(s + 1)));
}

/* What is known of a guard: its side of zero (0: none), whether and since when it is at zero, whether it has been since the start. */
struct GuardState {
    int side, at_zero, at_start;
    double since;
};

/* Sparse LU (see sparse.h): columns k of L (unit diagonal) and U by start, row (of L: of the matrix, of U: number of its pivot) and value; pivots by
   row and inverse. */
struct Factors {
    long *L_start, *L_row, *U_start, *U_row, *pivot_row, *pivot_of; /* pivot_of: number of the pivot in a row, -1 before it has one */
    V *L_re, *L_im, *U_re, *U_im, *D_re, *D_im;
    long L_room, U_room;
    long known; /* whether pivots are */
};

struct Sparse {
    struct Factors blocks[BLOCKS]; /* LANES eigenvalues each */
    V *re, *im;                    /* work (n): a column, a right-hand side; a solution */
    long *stack, *at, *pattern;
    char *seen;
};

/* What the choice between ways is made by (see stiffness.h), in operations on lanes. */
struct Costs {
    double mark, cost, motion, regret; /* of steps since they are weighed: work before the last one, what they cost, how far they led, what that is too much */
    double sweeps, reach;              /* of fixed-point iteration: cost per time, longest steps */
    double newton_rate, turned_work, turned_t; /* cost per time of Newton's the last time; work and time when it began */
    double looked, fade;               /* work at the last look at the spectrum; decay over the square of the radius [s] */
    double since, wait;                /* work at the last trial, and until the next */
    double paid, size, trial_work, trial_t; /* cost per time and size of steps before a trial; work and time when it began */
    double short_size;                 /* of steps since there is regret */
    long turns, before, radau;         /* changes to and from Newton's iteration; method before a trial, the last one of Radau */
    long hard, behind;                 /* in motions beside singular positions: slow steps, steps by Newton's iteration */
    int decays, trial, passes, undecided; /* whether fast decay is seen; steps left of a trial; whether such a position was near; which method Newton's begins with */
};

/* What is led apart, see apart.h. `inside`: stages of the step of size h that rows are decided by at its start, or null; `hardly`: whether they are led apart so little that damping hides it; `since`: when
   something has changed last; `left_at`: when nothing else has been found to hold; `near_zero`: gaps that open so slowly, until they have left zero, null where no rows depend on one another. */
struct Parting {
    const void *inside;
    double h, since, left_at, *masks;
    char *near_zero;
    int hardly;
};

/* What `begin` makes: first all pointers, up to `made`. */
struct State {
    V *rhs_c, *jvp_c, *projection_c, *guard_c, *work;
    V *point_in, *point_out; /* rhs at one point */
    V *jvp_in, *jvp_out, *projection_in, *projection_out, *guard_in, *guard_out;
    V *formula_in, *formula_out, *formula_c;
    V *rows_in, *rows_out, *rows_c, *sides_in, *sides_out, *sides_c, *row_change_in, *row_change_out, *row_change_c;
    V *decision_in, *decision_out, *decision_c;
    double *decided, *decided_noise; /* results of the decision's kernel, and what rounding makes of them */
    double *alone;                   /* reactions, as if each were the only one */
    V *decided_from;          /* the arguments that these are of, and others that differ by roundings */
    double *row_unit, *row_terms, *free_noise, *given_push, *given_free, *index_work; /* see index.h */
    long *index_rows, *index_found;
    double *decided_rounds;   /* what that changes of gaps and rates */
    int *decision_begins;     /* the program of gaps and rates alone; null: there is none */
    double *lemke, *impulse, *heat, *push, *later_x, *first_rate; /* work of decisions, see modes.h */
    V *decision_change_in, *decision_change_out, *decision_change_c;
    double *delay, *decided_change, *impulse_change, *choice_change, *no_change, *slopes, *flow, *input_rate, *weight, *unit_of_row, *by_carried, *flow_before; /* of directions at changes of mode, see saltation.h */
    long *weighed, shared, unshared; /* rows whose weights have been looked for together, and how many; counted from one, a row where there are none */
    V *set_in, *set_out, *set_c, *set_change_in, *set_change_out, *set_change_c;
    double *set_side, *set_rows, *set_x, *discrete_change; /* of what is set, see sets.h; changes of discrete values (directions, discretes) */
    double *lock_noise;
    long *set_fired, *set_by;
    double *led_from, *led_to; /* inputs before and after they jump */
    double time_carry;         /* what rounding has left of the time [s] */
    double open;               /* the last correction onto the invariants, where none would end them */
    double *lifted;    /* masks, while gaps are put to zero */
    double *near_knot; /* gaps, rates and effects of rows just before the last knot */
    double *drift, *chance;     /* samples of what rounding of rates has made of states (COUNTED, nx), and room (4 nx) */
    double *at_rest;   /* of speeds that must not be negative: accelerations that are nothing, where nothing drives them; 0 elsewhere */
    double *gap_terms; /* sizes of what gaps are made of, as known last: they are rounded to those, however little states move them */
    double *impact_t, *impact_x, *impact_size, *impact_noise, *rest_x, *held; /* of the last impacts; where they end; see zeno.h */
    char *struck; /* rows in the last impacts */
    double *margin, *blow; /* work, see margin.h and impacts.h */
    unsigned long *impact_after, between;
    long *basis, *status, *impact_row, *rests, *held_status, *sticks, *sticks_now, *leaves, *margin_rows;
    struct Thin *thin; /* programs for modes, null: there are none; see thin.h */
    double *side;                   /* of masks, then of switches */
    double *given;                  /* sides that kernels were given last */
    const V *holder[HOLDERS];       /* where these are: arguments of kernels, which nothing else is written to */
    long holders, written;          /* how many places that is; how often they have changed */
    struct Parting parting;
    int jams;                       /* whether slip is looked at that may have come to where nothing smooth leads further */
    double *step_by_side;           /* sizes of steps at either side when it was left; 0: not known */
    double *row_values, *row_noise, *one_row, *at_few; /* at_few: row by row */
    char *far;                      /* whether a row has been far from zero since its switch went over */
    long *overs;                    /* how often each switch went over since the last step */
    char *copied;
    long *own; /* states that are not copied */
    double *carry, *size, *scale, *factor, *rate, *before, *start_rate, *end_rate, *increment;
    double *limit, *noise;   /* rates beyond which a state is larger than its scale says; what rounding makes of its rates, 0 where that is not looked at */
    double *spread;          /* the same, with what fast decay forgets before a stage is solved */
    double *least;           /* what rounding makes of the rates of states that are nothing else */
    double *known;           /* what rounding makes of these until the motion has changed */
    double *most, *most_left, *change_left, *aside, *apart; /* work: per state */
    V *disturbed, *rates[2]; /* states and rates that rounding is sampled with */
    double *last_a;          /* Legendre coefficients of the last step, as Stages.a */
    double *guard_values, *guard_noise, *chebyshev;
    struct GuardState *guard_states;
    V *variation_in, *variation_out, *variation_c, *projected_in, *projected_out, *projected_c;
    V *D, *D_size, *D_noise, *D_rates, *D_last, *D_stages, *D_new; /* directions: values, sizes, what rounding makes of rates, these, Legendre coefficients, at stages */
    V *D_inside, *D_series, *D_there; /* inside of a step: rates, Legendre coefficients, values; see asked.h */
    double *J;               /* of the rates, by pattern */
    V *dK, *residual;        /* Newton: per block and state */
    V *mixed;                /* where slips turn: see `mix` in newton.h */
    double *mixed_by;
    struct Sparse sparse;
    struct Factors forgetting;
    double *krylov;          /* work of looking for stiffness */
    V *pair_in, *pair_out, *pair_frame; /* pairs of values, of which the second are disturbed */
    double *forgotten, *slopes_of; /* work of looking for rounding: vectors, slopes of the rates */
    double *row;             /* what is much in each row of the matrix that is factorised */
    V *clearance_in, *clearance_out, *clearance_c, *nodes[8], *node_rates[8], *node_along[8], *one_along, *ahead;
    double *across;
    V *exact_c[2], *exact_out;
    double *farther, *nearer; /* rates continued from nodes */
    Stages *fine;            /* of dense output; 0: not made yet */
    long made;               /* methods whose stages are made, as bits */
    Stages stages[METHODS], refining; /* per method; `fine` */
    long work_size, pair_room[3];
    double start, knot;      /* times: of the first step, of the next knot of the inputs */
    int widened;             /* whether the scale counts what the step moves states by */
    double unit, floor;      /* the scale of a state of size one, without atol, and of one of size zero */
    long doubts, patience;   /* CALM times the rejections, less steps without; rejections until every operation's rounding is looked at */
    double reach;            /* size of steps that states are sized by */
    double shortest;         /* step since every operation's rounding was looked at; 0: it was not, or there was none */
    int jumped;              /* whether rates have jumped since */
    double trusted, planned, sooner; /* size of the last step without doubts; of the last one before steps began to be rejected; of the first, as rates say */
    int missed;              /* whether tries of the last step were rejected */
    int just_set;            /* whether something has been set in this instant */
    int noisy, unheard;      /* whether rounding is looked at; for how many steps nothing was forgiven to it */
    double change, grown;    /* the last one of the iteration, and by how much it was larger than the least one */
    double last_h, error_root; /* size of the last step; the root of its error that step sizes go with */
    long last_s, since_switch;
    long terms;
    long events_before, event_capacity;
    int newton_now, begun, start_known, end_known;
    int settling;            /* whether slips have begun whose directions may still be stiff, and Radau is to be had for these */
    double begins_in;        /* how long it takes until slips that have just begun are twice what they are; 0: there are none */
    struct Costs costs;
    double factored_h, jacobian_time; /* of Newton */
    long factored_method;
    int jacobian_fresh;
    long mixes; /* pairs of `mixed` that are filled */
    double part;             /* part of the usual distance that rates were continued from; 0: they were not */
    double speed;            /* the largest velocity that was met, beside what is much for it [1/s] */
    int twofold;             /* whether exact kernels are needed */
    int touching;            /* whether a stage of the last try came to where branches of the motion touch */
    long crept;              /* steps in a row that have ended next to a singular position */
    double crept_from, crept_at; /* when the first of them ended, and how far from there */
    int straight;            /* whether the last step led through a singular position, not past it */
    long capacity, coefficient_capacity, coefficient_count;
    int thinned;             /* whether only steps that are read are kept */
    long stride;             /* of the ends of other steps one in so many is kept; 0: all */
    long transition_room, changes; /* transitions there is room for; changes of mode in this instant */
    Transition last; /* of mode */
    double changed_at, pending_planned, pace, first_impact, rest_t, rest_t_of_x, rest_error, rest_error_x, rest_doubt, rest_doubt_x;
    int is_decided; /* whether `decided_from` is filled */
    int crossed; /* whether a knot has been crossed since modes were decided */
    int delayed; /* whether it is known how much later the present instant is, direction by direction */
    long impacts; /* one after the other, without another change of mode */
    int lands, drift_known; /* whether a step is landed, and `drift` is known for that */
    long pending; /* row of masks at which the last step ended; -1: none */
    long read_at, event_at;  /* the next times that are read, and of events, while steps are looked through */
};

/* What of a kernel depends on parameters only, for the arguments `in`; room for it, and for the kernel's work. 0 when memory is short. */
static int prepared(Integrator *I, const Kernel *k, const V *in, V **c) {
    struct State *T = I->state;
    if (k->work + 1 > T->work_size) {
        T->work = reserve_lanes(I, k->work + 1);
        T->work_size = k->work + 1;
    }
    *c = reserve_lanes(I, k->constants + 1);
    if (I->counted) return 1;
    if (!T->work || !*c) return 0;
    prepare_kernel(k, in, *c, T->work);
    return 1;
}

/* Arrays of a kernel, its parameters (from `fixed` on) and constants set. 0 when memory is short. */
static int arranged(Integrator *I, const Kernel *k, V **in, V **out, V **c, long fixed) {
    *in = reserve_lanes(I, k->inputs + 1);
    *out = reserve_lanes(I, k->outputs + 1);
    if (!I->counted && (!*in || !*out)) return 0;
    for (long i = 0; i < I->np && !I->counted; i++) (*in)[fixed + i] = v_all(I->parameters[i]);
    return prepared(I, k, *in, c);
}

static int make_stages(Integrator *I, Stages *S, const Method *m) {
    long s = m->stages, B = (s + LANES - 1) / LANES, n = B * LANES;
    S->method = m;
    S->s = s;
    S->blocks = B;
    S->calm = power(CAREFUL / SHORTER, (double)(m->order + 1));
    S->mu = reserve_lanes(I, B * n);
    S->to_legendre = reserve_lanes(I, B * n);
    S->c = reserve_lanes(I, B);
    S->b = reserve_lanes(I, B);
    S->hb = reserve_lanes(I, B);
    S->counted = reserve_lanes(I, B);
    S->odd = reserve_lanes(I, B);
    S->tau = (double *)reserve_lanes(I, B);
    S->clear = (double *)reserve_lanes(I, B);
    S->clear_of_all = (double *)reserve_lanes(I, B);
    S->a = (double *)reserve_lanes(I, B * I->nx);
    long count = I->newton == NEVER ? 0 : m->eigenvalues, some = (count + LANES - 1) / LANES * s;
    V **eigen[] = {&S->W_re, &S->W_im, &S->V_re, &S->V_im};
    for (int k = 0; k < 4; k++) *eigen[k] = reserve_lanes(I, k < 2 ? some : B * count);
    int all = S->W_re && S->W_im && S->V_re && S->V_im && S->mu && S->to_legendre && S->c && S->b && S->hb && S->counted && S->odd && S->tau && S->clear && S->clear_of_all && S->a;
    for (long b = 0; b < B; b++) {
        S->in[b] = reserve_lanes(I, I->rhs.inputs);
        S->K[b] = reserve_lanes(I, I->nx);
        S->N[b] = reserve_lanes(I, I->nx);
        S->L[b] = reserve_lanes(I, I->nx);
        S->saved[b] = reserve_lanes(I, I->nx);
        all = all && S->in[b] && S->K[b] && S->N[b] && S->L[b] && S->saved[b];
        if (!present(&I->clearance)) continue;
        S->G[b] = reserve_lanes(I, I->nx + 1);
        S->H[b] = reserve_lanes(I, I->nx + 1);
        all = all && S->G[b] && S->H[b];
    }
    if (I->counted) return 1;
    if (!all) return 0;
    columns_of(S->mu, m->mu, s, B);
    columns_of(S->to_legendre, m->to_legendre, s, B);
    for (long k = 0; k < some; k++) {
        S->W_re[k] = in_lanes(m->W_re + k % s, s, k / s * LANES, count);
        S->W_im[k] = in_lanes(m->W_im + k % s, s, k / s * LANES, count);
    }
    for (long k = 0; k < B * count; k++) {
        S->V_re[k] = in_lanes(m->V_re + k % count, count, k / count * LANES, s);
        S->V_im[k] = in_lanes(m->V_im + k % count, count, k / count * LANES, s);
    }
    for (long b = 0; b < B; b++) {
        for (long l = 0; l < LANES; l++) {
            long j = b * LANES + l;
            S->c[b][l] = m->c[j < s ? j : s - 1];
            S->b[b][l] = m->b[j < s ? j : s - 1];
            S->counted[b][l] = j < s ? 1.0 : 0.0;
            S->odd[b][l] = (double)(2 * j + 1);
        }
        for (long i = 0; i < I->nu - I->held; i++) S->in[b][1 + I->nx + i] = v_all(I->u[i]);
        for (long i = 0; i < I->np; i++) S->in[b][1 + I->nx + I->nu + i] = v_all(I->parameters[i]);
    }
    return 1;
}

static int inputs_at(Integrator *I, V t, long count, V *u);

#include "thin.h"

/* Times and inputs of the stages. Returns 0 when the input function failed. */
static int stage_times(Integrator *I, Stages *S, double t, double h) {
    S->t = t;
    S->h = h;
    for (long b = 0; b < S->blocks; b++) {
        S->in[b][0] = v_fma(v_all(h), S->c[b], v_all(t));
        if (!inputs_at(I, S->in[b][0], S->s - b * LANES, S->in[b] + 1 + I->nx)) return 0;
    }
    for (long b = 0; b < S->blocks; b++) S->hb[b] = S->b[b] * v_all(h);
    return 1;
}

/* Before an iteration: nothing is known of singular positions near its stages. */
static void forget_surroundings(Integrator *I, Stages *S) {
    S->around = S->exact = S->looked = 0;
    I->state->part = 0;
}

static void look_around(Integrator *I, Stages *S);
static void run_exact(Integrator *I, int which, const V *in, V *out);
static int is_near(Integrator *I, const V *in);

/* Rates at the points in lanes. Where switches are held beyond the end of a law, as sqrt(x) held at x > 0 is, values are missing: there the
   true sides are taken. */
static void rates_at(Integrator *I, int exact, V *in, V *out) {
    struct State *T = I->state;
    if (exact) {
        run_exact(I, 0, in, out);
        return;
    }
    run_masked(I, OF_RATES, in, T->rhs_c, out);
    long sides = I->held - I->masks;
    if (!sides) return;
    V lost = v_all(0.0), *side = in + 1 + I->nx + I->nu - sides;
    for (long i = 0; i < I->nx; i++) lost += out[i] - out[i];
    if (!i_any(lost != v_all(0.0))) return;
    memcpy(T->sides_in, in, sizeof(V) * (size_t)(1 + I->nx + I->nu - sides));
    run_kernel(&I->sides, T->sides_in, T->sides_c, T->sides_out, T->work);
    for (long k = 0; k < sides; k++) side[k] = v_select(lost != v_all(0.0), T->sides_out[k], side[k]);
    run_kernel(&I->rhs, in, T->rhs_c, out, T->work);
    for (long k = 0; k < sides; k++) side[k] = v_all(T->side[I->masks + k]);
}

/* Costs, in operations on lanes: fitted to times of 350 runs of 30 scenes, which they meet to 15 % (geometric mean) where vectors have eight lanes.
   Of the rates at all stages and what goes with them; and of a try of a step besides. */
static double sweep_cost(const Integrator *I, const Stages *S) {
    return (double)((S->s + COUNTED - 1) / COUNTED) * ((double)I->operations + 8 * (double)S->s * (double)I->nx);
}
static double step_cost(const Integrator *I) { return 3.5e3 + 275 * (double)I->nx; }

/* All rates from the states in `in`, into N. */
static void stage_rates(Integrator *I, Stages *S) {
    if (present(&I->clearance) && S->looked < 2) look_around(I, S); /* the first guess may be poor */
    for (long b = 0; b < S->blocks; b++) rates_at(I, S->exact, S->in[b], S->N[b]);
    I->evaluations += S->s;
    I->iterations++;
    I->work += sweep_cost(I, S);
}

/* L = h b K: stages are x + mu L, and the step is x + sum of L. With mu_ij + mu_ji = 1 exactly, Gauss stays symplectic in spite of
   rounded coefficients (Antonana, Makazaga, Murua 2017). */
static void scale_rates(Integrator *I, Stages *S) {
    for (long b = 0; b < S->blocks; b++)
        for (long i = 0; i < I->nx; i++) S->L[b][i] = S->hb[b] * S->K[b][i];
}

/* f(t, x) into `out`. Returns 0 when the input function failed. */
static int rate_at(Integrator *I, double t, const double *x, double *out) {
    struct State *T = I->state;
    V *in = T->point_in;
    in[0] = v_all(t);
    if (!inputs_at(I, in[0], 1, in + 1 + I->nx)) return 0;
    for (long i = 0; i < I->nx; i++) in[1 + i] = v_all(x[i]);
    rates_at(I, is_near(I, in), in, T->point_out);
    for (long i = 0; i < I->nx; i++) out[i] = T->point_out[i][0];
    I->evaluations++;
    I->work += (double)I->operations;
    return 1;
}

#define NOTHING 1e-290     /* the scale of what is exactly zero */
#define KNOWN 2e-13        /* of what is much for it: what rounding leaves unknown of a state, as far as the iteration may leave */
#define PART 0.125         /* of what a step moves a state: counts as its size, as long as it has met nothing larger */
#define LEFT 1e-3          /* what the iteration may leave of the error of a step */
#define FEW 4.0            /* times the mean of a few samples: what rounding makes of rates at most */
#define DOUBTS 8           /* rejections that make every operation's rounding looked at */
#define CALM 4             /* steps without any that make up for one */
#define SMALL 1e-4         /* part of a state that rounding disturbs in a step: then it is nothing but rounding */
#define UNHEARD 8          /* steps in which nothing was forgiven to rounding: then it is not looked at any more */

/* What is left of a value beside noise; not a number where it is none. */
static double heard(double value, double noise) {
    double left = fabs(value) - noise;
    return left <= 0 ? 0 : left;
}

/* The least scale of state i in a step of size h: where it is nothing but rounding, so much that rounding is no more than what the iteration
   may leave; less, the more there is beside rounding. */
static double least_scale(const Integrator *I, long i, double h) {
    double noise = fabs(h) * I->state->noise[i] / LEFT, size = I->state->size[i];
    return noise > size ? noise : noise > 0 ? noise * (noise / size) : 0;
}

/* The least scale of state i where motions pass singular positions, or where loops hold it for good: what it is beside others is known to so many digits only. */
static double known_to(const Integrator *I, long i) {
    double whole = i < I->positions ? 1.0 : I->state->speed;
    return I->usual && I->usual[i] > 0 ? KNOWN * whole / I->usual[i] : 0;
}

#define UNEXPLAINED 10 /* times what rounding makes of a state */

/* State i has come to where it is now: the largest that it has been. Where it went on by more than rounding explains it is not rounding any more. */
static void take_size(Integrator *I, long i) {
    struct State *T = I->state;
    double size = fabs(I->x[i]);
    if (size <= T->size[i]) return;
    if (size > T->size[i] + UNEXPLAINED * T->known[i]) T->known[i] = 0;
    T->size[i] = size;
}

/* The scale of state i in a step of size h: atol + rtol times a magnitude. */
static void set_scale_of(Integrator *I, long i, double h, double size) {
    struct State *T = I->state;
    double least = fmax(fmax(least_scale(I, i, h), T->known[i]), known_to(I, i));
    T->scale[i] = fmax(T->floor + T->unit * size, fmax(least, NOTHING));
}

/* A gap that closed at once, whose rate is held since: such a position is far less than its velocity, as large as that was, moves in a step of size h, and is known no better
   than what that may be off by moves it. */
static void scale_integrals(const Integrator *I, double h) {
    const struct State *T = I->state;
    for (long c = 0; c < I->copies && I->mode_rows; c++) {
        long from = I->copy_from[c], to = I->copy_to[c];
        if (T->size[to] < SMALL * PART * fabs(h) * T->size[from]) T->scale[to] = fmax(T->scale[to], PART * fabs(h) * T->scale[from]);
    }
}

/* For steps of size h, where without rejections steps of size `reach` would be. */
static void set_scale(Integrator *I, double h, double reach) {
    struct State *T = I->state;
    T->unit = I->step > 0 ? 1.0 : I->rtol;
    T->floor = T->unit / I->rtol * I->atol;
    T->speed = 0;
    double per_time = 1 / (PART * reach);
    for (long i = I->positions; I->usual && i < I->nx; i++) T->speed = fmax(T->speed, T->size[i] * fabs(I->usual[i]));
    for (long i = 0; i < I->nx; i++) {
        set_scale_of(I, i, h, T->size[i]);
        T->limit[i] = T->size[i] * per_time;
    }
    scale_integrals(I, h);
    T->widened = 0;
    T->reach = reach;
}

static void along_branch(Integrator *I, const V *in, const V *K, V *out);
static void forget_fast(Integrator *I, const Method *m, double *rates);

/* A random number, the same for the same n (the mixing of Wellons' hash prospector). */
static unsigned drawn(long n) {
    unsigned x = (unsigned)n;
    x = (x ^ (x >> 16)) * 0x7feb352dU;
    x = (x ^ (x >> 15)) * 0x846ca68bU;
    return x ^ (x >> 16);
}

/* What rounding makes of the rates: how much they change when the states of stages, and `times`, change by a unit or two of their last place; and how much of that fast decay leaves
   in the rates of stages that are solved for. The largest change is left out: there the rates may jump. `leasts`: with what rounding moves states by that are nothing else. */
static void sample_noise(Integrator *I, const Stages *S, int leasts, int times) {
    struct State *T = I->state;
    long samples = (S->s + COUNTED - 1) / COUNTED * COUNTED; /* the last stage again, where there are fewer */
    int forgets = T->newton_now && T->factored_h == S->h && T->factored_method == I->method;
    double *found[2] = {T->spread, T->noise}, *most[2] = {T->most, T->most_left}, *change = T->change_left;
    for (int k = 0; k < 2; k++)
        for (long i = 0; i < I->nx; i++) found[k][i] = most[k][i] = 0;
    for (long first = 0; first < samples; first += LANES) {
        for (int k = 0; k < 2; k++) {
            V *in = T->disturbed;
            for (long l = 0; l < LANES; l++) {
                long j = first + l < S->s ? first + l : S->s - 1;
                for (long i = 0; i < I->rhs.inputs; i++) in[i][l] = S->in[j / LANES][i][j % LANES];
                if (times) in[0][l] *= 1 + EPS * ((double)(drawn(-1 - 2 * (first + l) - k) >> 30) - 1.5); /* two units of the last place */
                for (long i = 0; i < I->nx; i++) {
                    double part = (double)(drawn((2 * (first + l) + k) * I->nx + i) >> 30) - 1.5;
                    in[1 + i][l] = in[1 + i][l] * (1 + EPS * part) + (leasts ? part * T->least[i] * S->h : 0);
                }
            }
            rates_at(I, S->exact, in, T->rates[k]);
            if (S->around) along_branch(I, in, T->rates[k], T->rates[k]);
        }
        for (long l = 0; l < LANES; l++) {
            if (S->around && S->tau[first + l < S->s ? first + l : S->s - 1] > 0) continue;
            int known = 1;
            for (long i = 0; i < I->nx; i++) known &= isfinite(change[i] = T->rates[0][i][l] - T->rates[1][i][l]) != 0;
            for (int k = 0; k < 2; k++) {
                if (k == 1 && forgets && known) forget_fast(I, S->method, change);
                for (long i = 0; i < I->nx; i++) {
                    if (!(fabs(change[i]) < INFINITY)) continue;
                    found[k][i] += fabs(change[i]);
                    most[k][i] = fmax(most[k][i], fabs(change[i]));
                }
            }
        }
    }
    for (int k = 0; k < 2; k++) {
        double *noise = found[k];
        for (long i = 0; i < I->nx; i++) noise[i] = FEW * (noise[i] - most[k][i]) / (double)(samples - 1);
        for (long c = 0; c < I->copies; c++) /* what is the integral of a disturbed state is disturbed with it */
            noise[I->copy_to[c]] = fmax(noise[I->copy_to[c]], S->h * noise[I->copy_from[c]]);
        for (long i = 0; i < I->nx; i++) noise[i] = fmax(noise[i], T->least[i]);
    }
    T->noisy = 1;
    I->work += 2 * (double)((S->s + COUNTED - 1) / COUNTED) * ((double)I->operations + 150 * (double)I->nx);
}

/* What rates (nx) move a state by in a step of size h at most, in units of the scale. */
static double moved_by(const Integrator *I, const double *rates, double h) {
    double most = 0;
    for (long i = 0; i < I->nx; i++) most = fmax(most, fabs(h) * fabs(rates[i]) / I->state->scale[i]);
    return most;
}

/* Directions of slip turn and decay fast for the instants in which it is slow, which is no stiffness. */
static int slips_turn(const Integrator *I) { return I->planes + I->patches > 0; }

static void forget_noise(Integrator *I) {
    struct State *T = I->state;
    T->noisy = T->unheard = 0;
    for (long i = 0; i < I->nx; i++) {
        T->noise[i] = T->spread[i] = T->least[i];
        T->noisy |= T->least[i] > 0;
    }
}

/* In fixed-point iteration, positions that are integrals of velocities count through these. */
static void count_copies_through(Integrator *I, double h) {
    double *factor = I->state->factor;
    for (long k = 0; k < I->copies; k++) {
        double other = h * factor[I->copy_to[k]], *mine = &factor[I->copy_from[k]];
        if (other > *mine) *mine = other;
    }
    for (long k = 0; k < I->copies; k++) factor[I->copy_to[k]] = 0;
}

/* Sizes of changes of rates in units of the scale. */
static void set_factor(Integrator *I, double h) {
    struct State *T = I->state;
    for (long i = 0; i < I->nx; i++) T->factor[i] = T->scale[i] > NOTHING ? h / T->scale[i] : 0;
    if (!T->newton_now) count_copies_through(I, h);
}

/* States that start at zero, or are moved as never before: what the step moves them by, at rates K, is their size. */
static void widen(Integrator *I, Stages *S, V **K, double h) {
    struct State *T = I->state;
    Bits beyond = i_all(0);
    for (long b = 0; b < S->blocks; b++)
        for (long i = 0; i < I->nx; i++) beyond |= v_abs(K[b][i]) > v_all(T->limit[i]);
    if (!i_any(beyond) && !T->widened) return;
    for (long i = 0; i < I->nx; i++) {
        double most = 0;
        for (long b = 0; b < S->blocks; b++) most = fmax(most, v_largest(v_abs(K[b][i])));
        set_scale_of(I, i, h, fmax(T->size[i], PART * T->reach * most));
    }
    scale_integrals(I, h);
    set_factor(I, h);
    T->widened = 1;
}

/* A change of the rates of state i in units of the scale, beyond what rounding makes of it. */
INLINE V scaled_change(const struct State *T, long i, V change) {
    if (T->noisy) change = v_larger(v_abs(change) - v_all(0.25 * T->noise[i]), v_all(0.0));
    return change * v_all(T->factor[i]);
}

/* (N - K) factor, squared, summed over states and stages, divided by stages, rooted; then K = N. Around a singular position the same of
   (H - G), and `whole` of (N - K). */
static double replace_rates(Integrator *I, Stages *S, double h, double *whole) {
    const double *factor = I->state->factor;
    V parts[BLOCKS], along[BLOCKS];
    widen(I, S, S->N, h);
    for (long b = 0; b < S->blocks; b++) {
        V part = v_all(0.0), *K = S->K[b], *N = S->N[b];
        for (long i = 0; i < I->nx; i++) {
            V d = scaled_change(I->state, i, N[i] - K[i]);
            part = v_fma(d, d, part);
        }
        S->K[b] = N;
        S->N[b] = K;
        if (S->around) {
            V *G = S->G[b], *H = S->H[b];
            along[b] = part * S->counted[b];
            part = v_all(0.0);
            for (long i = 0; i < I->nx; i++) {
                V d = (H[i] - G[i]) * v_all(factor[i]);
                part = v_fma(d, d, part);
            }
            S->G[b] = H;
            S->H[b] = G;
        }
        parts[b] = part * S->counted[b];
    }
    *whole = S->around ? sum_of_blocks(along, S->blocks) : 0;
    return sqrt(sum_of_blocks(parts, S->blocks) / (double)S->s);
}

/* in[1 + i] = x[i] + mu L[i] for the states of a list. */
INLINE void combine_states(Stages *S, const long *list, long count, const double *x) {
    long B = S->blocks;
    if (B > 1) {
        for (long b = 0; b < B; b++)
            for (long k = 0; k < count; k++) S->in[b][1 + list[k]] = combined(S->mu + b * B * LANES, S->L, B, list[k], v_all(x[list[k]]));
        return;
    }
    V m[LANES], *in = S->in[0] + 1; /* one block: the matrix stays in registers */
    V *const L = S->L[0];
    for (int l = 0; l < LANES; l++) m[l] = S->mu[l];
    for (long k = 0; k < count; k++) {
        long i = list[k];
        in[i] = combined(m, &L, 1, i, v_all(x[i]));
    }
}

/* Rates of positions are velocities at the stages: the newest ones, not those that the last rates were found with. */
static void renew_copies(Integrator *I, Stages *S, const double *x) {
    if (!I->copies) return;
    scale_rates(I, S);
    for (long b = 0; b < S->blocks; b++)
        for (long k = 0; k < I->copies; k++) {
            long from = I->copy_from[k];
            S->K[b][I->copy_to[k]] = combined(S->mu + b * S->blocks * LANES, S->L, S->blocks, from, v_all(x[from]));
        }
}

static void find_zone(Integrator *I, Stages *S, Judge *J);
static void correct_stages(Integrator *I, Stages *S);
static void settle(Integrator *I, Stages *S, V *const *K, const double *x);

/* States of the stages of a step from x, by their rates; positions that are integrals of velocities by these. */
static void states_by_rates(Integrator *I, Stages *S, const double *x) {
    scale_rates(I, S);
    combine_states(S, I->state->own, I->nx - I->copies, x);
    for (long b = 0; b < S->blocks; b++)
        for (long k = 0; k < I->copies; k++) S->L[b][I->copy_to[k]] = S->hb[b] * S->in[b][1 + I->copy_from[k]];
    combine_states(S, I->copy_to, I->copies, x);
}

/* Fixed-point iteration. Positions whose rates are states use the newest velocities, which squares the contraction. */
static int fixed_point(Integrator *I, Stages *S, double h, const double *x, Judge *J) {
    double whole = 0, before = INFINITY;
    for (;;) {
        states_by_rates(I, S, x);
        stage_rates(I, S);
        if (present(&I->clearance) && J->count < 2) find_zone(I, S, J);
        if (present(&I->clearance)) correct_stages(I, S);
        if (S->around) settle(I, S, S->N, x);
        enum Verdict v = judge(J, replace_rates(I, S, h, &whole));
        int still = v == DONE && whole < 0.25 * before; /* across the branch it converges still, and not yet to rounding errors */
        before = S->around ? whole : 0;
        if (still) continue;
        if (v == DONE) renew_copies(I, S, x);
        if (v != GO_ON) return v == DONE;
    }
}

/* The step from the rates that were found, into the vector of increments. */
static void step_increments(Integrator *I, Stages *S) {
    scale_rates(I, S);
    for (long i = 0; i < I->nx; i++) {
        double sum = 0;
        for (long j = S->s - 1; j >= 0; j--) sum += S->L[j / LANES][i][j % LANES];
        I->state->increment[i] = sum;
    }
}

/* Legendre coefficients a = L K of rates. */
static void legendre_coefficients(Integrator *I, Stages *S, V *const *K) {
    long n = S->blocks * LANES;
    for (long i = 0; i < I->nx; i++)
        for (long b = 0; b < S->blocks; b++) {
            V v = combined(S->to_legendre + b * n, K, S->blocks, i, v_all(0.0));
            memcpy(S->a + i * n + b * LANES, &v, sizeof v);
        }
}

/* Legendre polynomials of [0, 1] at theta, degrees 0 .. count - 1. */
static void legendre_values(double theta, long count, double *P) {
    double y = 2 * theta - 1;
    P[0] = 1;
    if (count > 1) P[1] = y;
    for (long k = 1; k + 1 < count; k++) P[k + 1] = ((double)(2 * k + 1) * y * P[k] - (double)k * P[k - 1]) * (1 / (double)(k + 1));
}

/* The same in lanes, at y = 2 theta - 1; at least two. */
static void legendre_lanes(V y, long count, V *P) {
    P[0] = v_all(1.0);
    P[1] = y;
    for (long k = 1; k + 1 < count; k++)
        P[k + 1] = (v_all((double)(2 * k + 1)) * y * P[k] - v_all((double)k) * P[k - 1]) * v_all(1 / (double)(k + 1));
}

/* Their integrals from 0 to theta; P has room for count + 1. */
static void legendre_integrals(double theta, long count, double *P, double *Q) {
    legendre_values(theta, count + 1, P);
    Q[0] = theta;
    for (long k = 1; k < count; k++) Q[k] = (P[k + 1] - P[k - 1]) / (double)(2 * (2 * k + 1));
}
