/* {title}: motions of a model. They need no library but libm, and a compiler with the vector extensions of GCC and Clang.

   An instance is one motion: its parameters, inputs, start values, and where it stands. Make it, set what is to differ from the exported
   values, start it, and let it go from time to time:

       simulator_instance *s = simulator_create(0, 0, 0);
       if (simulator_start(s, 0.0) == SIMULATOR_SUCCESS && simulator_advance(s, 1.0) == SIMULATOR_SUCCESS)
           printf("%g\n", simulator_get(s, SIMULATOR_STATE, 0));
       else
           puts(simulator_message(s));
       simulator_free(s);

   Memory. An instance is one block, from malloc or from the caller, of fixed size: nothing is allocated while it moves, and copying,
   saving and going back is copying the block. Only the last step is kept.
   Threads. Instances share nothing that changes. One instance belongs to one thread at a time.
   Units. SI; angles in radians. What is written in brackets below is also what `simulator_unit` tells.
   Failures. Functions return a status and never print, exit or raise; `simulator_message` puts the last one into words. An instance that has
   failed stays as it was when it failed, until it is started again or made like another one.
   Names. All begin with simulator_ or SIMULATOR_. Files of two exports with different names go into one program, as objects or as shared
   libraries: nothing else is visible outside. */
#ifndef SIMULATOR_H
#define SIMULATOR_H
#include <stddef.h>

#ifndef SIMULATOR_API
#define SIMULATOR_API __attribute__((visibility("default")))
#endif

/* Of this interface; it grows when programs that use it have to change. */
#define SIMULATOR_INTERFACE 2
/* What wrote these files. */
#define SIMULATOR_VERSION {version}

{indices}
/* What an instance has: numbers of some kind, counted from 0. */
typedef enum {
    SIMULATOR_STATE,     /* positions and velocities at the present time */
    SIMULATOR_INPUT,     /* at the present time; set, where options.input is 0, and it is no table or formula of time: constant from then on, or with the
                            constant rates that are set for it: der(angle), der(der(angle)) of one that prescribes an angle */
    SIMULATOR_PARAMETER, /* set: from then on. The last ones may be constants of integration, which `simulator_start` sets */
    SIMULATOR_CONDITION, /* start values that were named when the model was exported; `simulator_start` meets them */
    SIMULATOR_OUTPUT,    /* expressions that were named when the model was exported, at the present time; cannot be set */
    SIMULATOR_EVENT      /* expressions whose zeros are looked for; have a name only */
} simulator_kind;

typedef enum {
    SIMULATOR_SUCCESS,
    SIMULATOR_AT_EVENT,       /* no failure: the present time is that of an event, see `simulator_event`. Go on as before */
    SIMULATOR_STOPPED,        /* no failure: the same for an event that ends the motion. Start again, or set states or parameters and go on */
    SIMULATOR_STEP_UNDERFLOW, /* the step size became too small */
    SIMULATOR_NON_FINITE,     /* a rate or a start value is infinite or not a number */
    SIMULATOR_NOT_CONVERGED,  /* the implicit equations of a fixed step could not be solved */
    SIMULATOR_MAX_STEPS,      /* options.max_steps were not enough */
    SIMULATOR_FAILED_INPUT,   /* options.input returned 0 */
    SIMULATOR_OUT_OF_MEMORY,  /* malloc failed, or a step had more than SIMULATOR_EVENTS_OF_A_STEP events */
    SIMULATOR_BAD_ARGUMENT,   /* the call makes no sense; nothing was done */
    SIMULATOR_OPEN_START,     /* the states do not close the loops, or there are none that do for these values */
    SIMULATOR_OTHER_MODEL,    /* with these values other equations would be needed, e.g. other constraints are independent, or loops come to a singular position */
    SIMULATOR_SLIDES,         /* the rates switch back and forth without end */
    SIMULATOR_OVERLAPS,       /* the gap of a one-sided contact is negative at the start, where an input jumps, or where it jumps itself */
    SIMULATOR_NO_MODE,        /* whether contacts hold, slide or open: nothing obeys the laws of all of them */
    SIMULATOR_CHATTERS,       /* a contact changes its mode, or an event sets something, again and again in one instant */
    SIMULATOR_CANNOT_SET,     /* an event sets what cannot be so */
    SIMULATOR_TIED,           /* contacts strike one after the other, several in one instant: it is not said which first */
    SIMULATOR_GAINS           /* an impact gains energy */
} simulator_status;

#define SIMULATOR_EVENTS_OF_A_STEP 256

typedef enum {
    SIMULATOR_GAUSS, /* Gauss-Legendre collocation: for everything that is not stiff */
    SIMULATOR_RADAU, /* Radau IIA collocation: for stiff models */
    SIMULATOR_AUTO   /* Gauss, and Radau for as long as a motion is stiff */
} simulator_method;

/* How an instance integrates: it keeps this as long as it lives. */
typedef struct {
    simulator_method method;
    long order;     /* gauss, auto: even, 2 to 16; radau: odd, 1 to 13; 0: 16, radau by the tolerance */
    double rtol;    /* relative error per step, 0 < rtol < 1; no less than 1e-15 is used */
    double atol;    /* absolute error per step, in SI units; 0: none, states are judged by their sizes */
    double step;    /* size of fixed steps [s]; 0: as the tolerances allow */
    double max_step; /* steps are no longer than that [s]; 0: as the tolerances allow */
    long max_steps; /* of one motion; it fails when these are not enough */
    /* Fills the inputs u at time t, also at times ahead of the present one; returns 0 to give up. 0: inputs are constant between calls of
       `simulator_set`, or tables and formulas of time, where they were exported as that. Where inputs jump, end steps: advance to that time, then call
       `simulator_renew`; knots of tables and jumps of formulas end steps by themselves. */
    int (*input)(void *user, double t, double *u);
    void *user; /* handed to `input` */
} simulator_options;

typedef struct {
    long event;    /* number among those of kind SIMULATOR_EVENT */
    int direction; /* 1 rising, -1 falling, 0 touching */
    double time;   /* [s] */
} simulator_crossing;

/* When contacts, stops and frictions began or ceased to hold: how often that was decided since the start, which counts, too; the part at which it was the last time, 0:
   the start, or a jump of inputs; and when. */
typedef struct {
    long count;
    const char *part;
    double time; /* [s]; NaN where there is nothing to decide */
} simulator_transition;

/* What a motion has cost since it was started. */
typedef struct {
    simulator_status status;
    char message[240];        /* in words; "" after success */
    double time;              /* present [s] */
    double reached;           /* end of the last step [s]; may be later */
    const char *failed_state; /* name of the state that failed first; 0: none, or not known */
    long steps, rejected;     /* steps taken, and tried in vain */
    long newton_steps;        /* of these, solved by Newton's iteration */
    long radau_steps;         /* of these, by Radau's method */
    long evaluations;         /* of the rates at one point */
    long factorisations;      /* of the equations of Newton's iteration */
    long order;               /* of the last step */
    long samples;             /* `simulator_simulate`: rows of states that are filled */
} simulator_report;

typedef struct simulator_instance simulator_instance;

#ifdef __cplusplus
extern "C" {
#endif

/* The model: its title; how many there are of a kind; name, unit ("" where it is not known, "1" for plain numbers) and exported value of
   each, 0 or NaN where there is none; the number that belongs to a name, -1 if none does. */
SIMULATOR_API const char *simulator_title(void);
SIMULATOR_API const char *simulator_version(void);
SIMULATOR_API long simulator_count(simulator_kind kind);
SIMULATOR_API const char *simulator_name(simulator_kind kind, long i);
SIMULATOR_API const char *simulator_unit(simulator_kind kind, long i);
SIMULATOR_API double simulator_exported(simulator_kind kind, long i);
SIMULATOR_API long simulator_index(simulator_kind kind, const char *name);

/* auto, rtol = 1e-8, no fixed step, at most a million steps, inputs as they were exported. */
SIMULATOR_API simulator_options simulator_defaults(void);

/* What is wrong with options, in words; 0 when nothing is. options: 0 for simulator_defaults(), here and below. */
SIMULATOR_API const char *simulator_mistake(const simulator_options *options);

/* Bytes of an instance; 0 when the options make no sense. */
SIMULATOR_API size_t simulator_size(const simulator_options *options);

/* A new instance with the exported values, not started: in `memory` of `bytes` bytes, at any address, which must stay as long as the instance
   is used; or, when `memory` is 0, in memory of malloc. Returns 0 when the options make no sense or memory is short. */
SIMULATOR_API simulator_instance *simulator_create(const simulator_options *options, void *memory, size_t bytes);

/* The same motion once more, from where it stands. `memory` as above. */
SIMULATOR_API simulator_instance *simulator_copy(const simulator_instance *from, void *memory, size_t bytes);

/* Makes an instance what another one is that was created with the same options: to go back to what was copied. SIMULATOR_BAD_ARGUMENT
   where sizes differ. */
SIMULATOR_API int simulator_restore(simulator_instance *s, const simulator_instance *from);

/* Back to the exported values, not started. */
SIMULATOR_API void simulator_reset(simulator_instance *s);

/* Gives memory of malloc back; other memory is the caller's. 0 is allowed. */
SIMULATOR_API void simulator_free(simulator_instance *s);

/* Sets number i, e.g. simulator_set(s, SIMULATOR_PARAMETER, simulator_index(SIMULATOR_PARAMETER, "mass"), 2.0), or all of a kind, in order.
   Before the start: what it starts with. Later: a new piece of the motion begins at the present time with the next call that moves it,
   which checks that loops are closed with the new values. What inputs prescribe goes along at once: places are led to where they are set, loops closed on the way
   (SIMULATOR_OPEN_START where they cannot be), speeds jump as by a blow; who sets states has to set those that inputs prescribe, too. SIMULATOR_BAD_ARGUMENT where there is no such number, or it is an input that is a table or a
   formula of time, which stays that when all are set. */
SIMULATOR_API int simulator_set(simulator_instance *s, simulator_kind kind, long i, double value);
SIMULATOR_API int simulator_set_all(simulator_instance *s, simulator_kind kind, const double *values);

/* A number; NaN where there is none. All of a kind, in order. */
SIMULATOR_API double simulator_get(simulator_instance *s, simulator_kind kind, long i);
SIMULATOR_API int simulator_get_all(simulator_instance *s, simulator_kind kind, double *values);

/* A consistent start at time t [s], in positions and velocities: one that meets the conditions with the parameters and inputs, on the
   branch of the exported start. SIMULATOR_OPEN_START where there is none, SIMULATOR_OTHER_MODEL where what was exported does not hold. */
SIMULATOR_API int simulator_start(simulator_instance *s, double t);

/* A start from all states, which have to close the loops to a millionth: SIMULATOR_OPEN_START otherwise. */
SIMULATOR_API int simulator_start_at(simulator_instance *s, double t, const double *states);

/* The end of the motion [s], no step goes beyond it: steps are as long as accuracy allows, and times on the way are read between their
   ends. Without one (INFINITY) each `simulator_advance` ends a step at its time. Set it before the start or later, and before outputs that depend on
   contacts are read for the first time. */
SIMULATOR_API int simulator_set_end(simulator_instance *s, double end);

/* Moves to time t [s], not before the present one. SIMULATOR_AT_EVENT, SIMULATOR_STOPPED: events come first; call again to go on. */
SIMULATOR_API int simulator_advance(simulator_instance *s, double t);

/* Moves to the end of the next step, not beyond time t [s] and the end of the motion. Events as above. */
SIMULATOR_API int simulator_step(simulator_instance *s, double t);

/* Begins a new piece of the motion at the present time: where `input` jumps. */
SIMULATOR_API int simulator_renew(simulator_instance *s);

/* The present time [s]. The last event that the motion came to; number -1 before the first. */
SIMULATOR_API double simulator_time(const simulator_instance *s);
SIMULATOR_API simulator_crossing simulator_event(const simulator_instance *s);

/* The last change of mode that steps have come to. At its time states and outputs are those after it, unless it is found
   only as the next step begins. */
SIMULATOR_API simulator_transition simulator_change(const simulator_instance *s);

/* The last status in words, "" after success; and what the motion has cost. */
SIMULATOR_API const char *simulator_message(const simulator_instance *s);
SIMULATOR_API simulator_report simulator_summary(const simulator_instance *s);

/* A whole motion from time t0 [s] on, read at n times in ascending order, the last of which is its end. x0: all states, see
   `simulator_start_at`, or 0: see `simulator_start`. u: inputs; p: parameters; each may be 0: the exported values. states: n rows of all
   states; those of times that were not reached are not written. report: may be 0. Events that do not end the motion are passed. Returns the
   status. The numbers are those of an instance that is advanced from time to time, and those of the package itself. */
SIMULATOR_API int simulator_simulate(const simulator_options *options, double t0, const double *x0, const double *u, const double *p, long n,
                                     const double *times, double *states, simulator_report *report);

#ifdef __cplusplus
}
#endif
#endif
