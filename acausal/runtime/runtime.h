/* What the caller and the runtime share. `acausal/runtime/binding.py` mirrors these structures, in the same order. */
#ifndef ACAUSAL_RUNTIME_H
#define ACAUSAL_RUNTIME_H
#include "lanes.h"
#include <stddef.h>

/* A function of a model, compiled (see acausal/emit/emit.py): run(in, c, out, w), and `prepare` fills c from in, whenever parameters
   change; or a program for interpreter.h, whose frame c then is; or a function that somebody else evaluates, one point at a time. */
typedef void (*KernelFunction)(const V *in, const V *c, V *out, V *w);
typedef struct {
    KernelFunction run, prepare;
    const int *program, *preparation;
    void (*evaluate)(void *function); /* from `arguments` to `results` */
    void *function;
    double *arguments, *results;
    long inputs, outputs, constants, work;
    long twofold; /* whether the program is one for twofold.h */
} Kernel;
INLINE int present(const Kernel *k) { return k->run || k->program || k->evaluate; }

/* A collocation method. Matrices are row-major; A = Re(V diag(eigenvalues) W) with one of each conjugate pair. */
typedef struct {
    long stages, order, kind;
    const double *c, *b, *A, *mu, *to_legendre; /* A[i][j] = mu[i][j] b[j] */
    long eigenvalues;
    const double *eigen_re, *eigen_im, *V_re, *V_im, *W_re, *W_im;
} Method;

/* An input that is a piecewise polynomial of time: piece k from begins[k] on, the first one before that too, with `terms` coefficients,
   highest power first, of the time since then; with a period (0: none), that of `first` to first + period everywhere. */
typedef struct {
    long input, pieces, terms;
    double first, period;
    const double *begins, *coefficients;
} Table;

/* What an input of time alone jumps or bends at: where value + slope t is zero, or, where it counts, whole. */
typedef struct {
    double value, slope;
    long counts;
} Clock;

/* Which entries of df/dx are not zero, by columns: starts (nx + 1), rows; a colour for each column, those of one colour sharing no row; the order of
   elimination, entries that L then has, and squares of their numbers by columns, summed; entries that L or U has at most, whatever the pivots. */
typedef struct {
    const long *start, *row, *colour, *order;
    long colours;
    double fill, work;
    long most;
} Pattern;

enum Kind { GAUSS, RADAU };
enum { EXACT_PROGRAMS = 3, PROGRAMS = 5 }; /* see `lacking` */
enum Newton { NEVER, WHERE_SLOW, ALWAYS };
enum Code {
    REACHED_END,
    PAUSED,          /* the time slice is over: call advance again */
    NEEDS_JACOBIAN,  /* set `jvp`, call advance again */
    EVENT,           /* a guard that ends the run has fired: the last event */
    STEP_UNDERFLOW,
    NON_FINITE,
    NOT_CONVERGED,
    TOO_MANY_STEPS,
    INPUT_FAILED,
    OUT_OF_MEMORY,
    NOT_KEPT,        /* a step that is read is not among those that are kept */
    SLIDES,          /* along a switch, number `worst`: both sides lead back to it */
    OVERLAPS,        /* one-sided row `worst` is violated where the motion begins */
    NO_MODE,         /* no masks fit: row `worst` is where it shows */
    CHATTERS,        /* modes change and change again in one instant: row `worst` */
    NO_DERIVATIVES,  /* law `worst` does what they do not go through: `other`, an `enum Obstacle` */
    SETS_NO_NUMBER,  /* guard `worst` sets target `other` to what is no number */
    SETS_TWICE,      /* it sets what target `other` is in the same instant, to something else */
    SETS_BOUND,      /* it sets target `other`, and constraints do not let it be so */
    TIED,            /* impacts one after the other, and several at once: rows `worst` and `other` */
    GAINS,           /* energy is gained in an impact of row `worst` */
    SETS_APART,      /* row `worst` of locks is held, and does not meet: by `apart` */
    FALLS,           /* the gap of one-sided row `worst` is negative in the middle of the motion, by `apart` */
    BEGINS_NO_NUMBER, /* discrete value `other` begins with what is no number */
    BRANCHES_TOUCH   /* at a singular position of loops, where rates are not known */
};

/* What derivatives do not go through. */
enum Obstacle { WITHOUT_END, OTHER_LAW, BRINGS_BACK, OF_PATCH, JUMPS };

struct Programs;

/* One integration. The caller fills the first part; `begin` makes the rest. Newton WHERE_SLOW: the first method is Gauss's, and others, if any, are
   Radau's by order, for where the motion is stiff; `operations` of the rates at one point tell what is cheaper. */
#define LED_PLACES 2
typedef struct Integrator {
    long nx, nu, np, ng, led, methods, method, newton, adapt_order, max_steps, copies, guards, positions, operations;
    /* led: whether inputs other than masks stand in the invariants; LED_PLACES: in those of positions, too */
    long through; /* whether motions lead straight through singular positions, where exact kernels are given: see Through */
    Kernel rhs;         /* t, x, u, p -> x' */
    Kernel jvp;         /* t, x, u, p, dx, dp -> dx' */
    Kernel projection;  /* t, x, u without sides, p -> x nearer to the invariants, invariants (ng) at the given x */
    Kernel guard;       /* t, x, u, p -> values whose zeros are wanted */
    Kernel variation;   /* t, x, u, p, dx, du, dp -> dx' */
    Kernel projected;   /* t, x, u without sides, p, dx, du, dp -> dx after projection */
    Kernel clearance;   /* t, x, p -> 0 where branches of the motion cross, about 1 far away; none where they never do */
    Kernel formula;     /* t -> inputs that are formulas */
    Kernel rows;        /* t, x, u, p -> values that are positive as long as switches are at their true sides */
    Kernel sides;       /* t, x, u without sides, p -> the true sides */
    Kernel row_change;  /* t, x, u, p, dt, dx, du, dp -> changes of the rows */
    Kernel decision;    /* t, x, u, p -> what masks are decided by, see modes.h */
    Kernel decision_change; /* t, x, u, p, dt, dx, du, dp -> changes of that */
    Kernel set;         /* t, x, u, p -> discrete values at the start, then new values of all targets that are set, see sets.h */
    Kernel set_change;  /* t, x, u, p, dt, dx, du, dp -> changes of that */
    Kernel exact_rhs, exact_projection; /* the same as programs for twofold.h, for states near such positions; none where that is not needed */
    Kernel disturbed_rhs, disturbed_guard, disturbed_projection; /* the same as programs for rounding.h */
    Kernel rhs_program, rows_program, projection_program, jvp_program; /* the same as programs, for thin.h, where the kernels are compiled */
    /* Makes one of these where it is none: disturbed rates (0), guards (1), projection (2); exact rates and projection from EXACT_PROGRAMS on, programs from PROGRAMS on. Null: it stays unknown what rounding does */
    int (*lacking)(long which);
    /* The last `held` of the nu inputs are sides of switches, kept by the runtime; row r is one of switch row_switch[r], which goes over to
       row_factor[r] times its side + row_plus[r] */
    long held, row_count;
    const long *row_switch;
    const double *row_factor, *row_plus;
    /* The first `masks` of these say which rows of reactions hold: one for each of `one_sided` laws, two for each friction along a line, six for each in a
       plane, three for each of the magnitudes that their limits depend on, and the damping of rows that depend on one another, if any do; then `discretes`, which are set. The first `mode_rows` rows are theirs, and the last
       `set_count` of these those of guards at which something is set: guard k, where it passes zero in set_direction[k] (0 both, 1 rising, -1 falling), the targets
       from set_first[k] to set_first[k + 1]: states, or nx + discrete values */
    long masks, mode_rows, one_sided, lines, planes, patches, magnitudes, redundant, valves, discretes, set_count;
    const long *set_direction, *set_first, *set_target;
    long followers;            /* states that nonlinear equations give by the others: */
    const long *follower;
    const double *discrete_start; /* discrete values at the start; null, or no number: as the kernel says */
    const double *usual; /* 1 / how much a position or velocity of loops is, beside others; 0 for other states; without exact kernels below 0 where loops do not hold it for good */
    const Method *method_list;
    const double *parameters;
    int (*input)(void *user, double t, double *u); /* null: `u` does not change, but for what is in tables and formulas */
    long tables, formulas;
    const Table *table_list;
    const long *formula_input;
    double *u;
    const double *before; /* inputs that the state at the start follows, where others are given from there on; or null */
    const long *copy_to, *copy_from; /* x'[copy_to] = x[copy_from] */
    double *x;                       /* start and current state */
    double t, end, rtol, atol, step; /* atol 0: states are judged by their sizes alone; step 0: adaptive */
    double max_step;                 /* 0: none */
    double slice;                    /* seconds until PAUSED; 0: after each step */
    /* Where inputs jump or bend, beside the knots of tables: clocks, and times that ascend */
    long clocks, knot_count;
    const Clock *clock_list;
    const double *knots;
    Pattern pattern;
    /* results */
    long steps, rejected, evaluations, iterations, factorisations, newton_steps, radau_steps, worst, passages, switched; /* passages: steps around singular positions; switched: times that switches went over */
    double *size; /* largest magnitude met so far, per state */
    double h, error, contraction; /* of the last step */
    double work;                  /* operations on lanes so far, counted as the choice between methods counts them */
    const long *guard_direction, *guard_stops; /* per guard: which crossings count (0 both, 1 rising, -1 falling); whether it ends the run */
    const Method *fine;                        /* whose nodes refine Gauss steps; null: as they are */
    long events;                               /* found so far, in order of time */
    double *event_times;
    long *event_guards, *event_directions;
    struct Memory *memory;
    struct State *state;
    /* steps kept, without `first` of them: times (steps + 1), states (steps + 1, nx); stages of each step, minus how many they are where several are
       one, and place of its coefficients (nx, stages), with what sizes states had had by then (nx) behind them; place -1: not kept */
    double *times, *states, *coefficients, *step_sides; /* step_sides (steps, held): of switches */
    long *stage_count, *offset, *kinds;
    /* forward sensitivities: S (directions, nx) at the start, then now; inputs du (directions, nu) and dp (directions, np) */
    long directions;
    double *S;
    const double *du, *dp;
    double *discrete_S; /* of discrete values (directions, discretes), as S is; or null */
    /* `asked` times, which ascend: states (asked, nx), S (asked, directions, nx) and discrete_S there (asked, directions, discretes), of the first so many that have been `given` */
    long asked, given;
    const double *asked_t;
    double *asked_x, *asked_S, *asked_discrete;
    void *user; /* of `input` */
    /* Coefficients beyond `budget` bytes are kept of steps only in which there is an event, or one of the times `read`, which ascend; ends of
       steps beyond so many bytes of these steps, and some between them. 0: all */
    size_t budget;
    const double *read;
    long read_count;
    /* Memory of the caller, `room` bytes (see `needed`): then no other is taken, and the last step only is kept, with its events. Null: allocated. */
    char *block;
    size_t room, used;
    long counted, first, event_room; /* whether bytes are only counted; number of steps that are not kept; events of one step at most */
    long promised;                   /* whether exact kernels are to be had where they are needed */
    /* Changes of mode so far: after how many of the steps that are kept each, the row of masks that led to it (-1: the start, or a jump of inputs), impulses of all
       reactions, which are in steps of no length, and what is lost by those of impacts without end beside what all of them do on the way (2 reactions) */
    long transitions, *transition_steps, *transition_rows;
    double *impulses, *transition_masks; /* masks from then on */
    /* Where derivatives are those to one side: 1 + the first law whose guard only touched zero, 1 + the first gap that closed together with others, each for itself; 0: none */
    long grazed, coincides;
    long other; /* target of what could not be set */
    double apart; /* gap of what should have met */
    struct Programs *programs; /* of modes, see thin.h: those of an earlier integration with the same functions and parameters, or null; to be kept by the caller after `finish`, or forgotten */
} Integrator;

/* Of changes of mode: how many, when the last one was, of which row of masks (-1: the start, or a jump of inputs); steps of no length so far. */
typedef struct {
    long count, row, law, jumps; /* law: number of the law that the row belongs to, or behind all of them of what is set */
    double time;
} Transition;

EXPORT int begin(Integrator *I);
EXPORT size_t needed(const Integrator *I);
EXPORT void moved_integration(Integrator *I, const char *block);
EXPORT int advance(Integrator *I);
EXPORT void use_newton(Integrator *I);
EXPORT int exchange(Integrator *I, long which, const Kernel *k);
EXPORT void finish(Integrator *I);
EXPORT void forget_programs(struct Programs *P);
/* The first program from number `from` on that is not compiled, and of which at least so many statements have been carried out: its number, or -1. It is taken
   compiled from now on, with the same statements: `run(in, c, out, w)`, of which w is its frame. Only while no integration has the programs. */
struct Lasting {
    const int *program;
    long length; /* statements before the last one, which is zero */
    double spent;
};
EXPORT long lasting_program(const struct Programs *P, long from, double spent, struct Lasting *found);
EXPORT void take_compiled(struct Programs *P, long at, KernelFunction run);
EXPORT int dense(Integrator *I, long n, const double *t, double *x);
EXPORT int state_at(Integrator *I, double t, double *x);
EXPORT int settle_modes(Integrator *I);
EXPORT int unsettled(const Integrator *I, double t);
EXPORT const double *masks_at(const Integrator *I, double t);
EXPORT void remember(Integrator *I, const double *masks);
EXPORT Transition last_transition(const Integrator *I);
EXPORT double table_value(const Table *T, double t);
EXPORT long lanes(void);
#ifndef ONLY_COMPILED_KERNELS
EXPORT int columns(const Kernel *k, long nx, long nu, long np, const double *p, long n, const double *t, const double *x, const double *u, double *y);
struct Definition; /* see program.h */
EXPORT long make_program(const struct Definition *f, int *preparation, int *run, long *length);
EXPORT int project_states(const Kernel *projection, long nx, long nu, long np, const double *p, long n, const double *t, const double *u, double *x);
EXPORT long widest(void);
EXPORT long integrator_size(void);
#endif
#endif
