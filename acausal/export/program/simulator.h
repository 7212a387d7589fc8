/* Simulates the model that this folder holds. Plain C: no library but libm. See README.txt.

       double times[3] = {0.0, 0.5, 1.0}, *states = malloc(3 * model_states * sizeof(double));
       SimulatorReport report;
       if (simulate(0, 0.0, 0, 0, 0, 3, times, states, &report)) puts(report.message);

   Calls do not share anything: they may run side by side in threads.

   Two models in one program: compile the files of each folder with a prefix of its own, e.g. -DSIMULATOR_PREFIX=arm_, and define that before
   its simulator.h is included; the functions and variables below are then `arm_simulate` and so on. */
#ifndef SIMULATOR_H
#define SIMULATOR_H

#ifdef SIMULATOR_PREFIX
#define SIMULATOR_PASTE(prefix, name) prefix##name
#define SIMULATOR_JOIN(prefix, name) SIMULATOR_PASTE(prefix, name)
#define SIMULATOR_NAME(name) SIMULATOR_JOIN(SIMULATOR_PREFIX, name)
#define model_title SIMULATOR_NAME(model_title)
#define model_states SIMULATOR_NAME(model_states)
#define model_inputs SIMULATOR_NAME(model_inputs)
#define model_parameters SIMULATOR_NAME(model_parameters)
#define model_state_names SIMULATOR_NAME(model_state_names)
#define model_input_names SIMULATOR_NAME(model_input_names)
#define model_parameter_names SIMULATOR_NAME(model_parameter_names)
#define model_start SIMULATOR_NAME(model_start)
#define model_conditions SIMULATOR_NAME(model_conditions)
#define model_condition_names SIMULATOR_NAME(model_condition_names)
#define model_condition_values SIMULATOR_NAME(model_condition_values)
#define model_input_values SIMULATOR_NAME(model_input_values)
#define model_parameter_values SIMULATOR_NAME(model_parameter_values)
#define simulator_defaults SIMULATOR_NAME(simulator_defaults)
#define simulator_start SIMULATOR_NAME(simulator_start)
#define simulate SIMULATOR_NAME(simulate)
#else
#define SIMULATOR_NAME(name) name
#endif

typedef enum {
    SIMULATOR_GAUSS, /* Gauss-Legendre collocation: for everything that is not stiff */
    SIMULATOR_RADAU  /* Radau IIA collocation: for stiff models */
} SimulatorMethod;

typedef struct {
    SimulatorMethod method;
    long order;     /* gauss 8, 12, 16; radau 5, 9, 13; 0: by the tolerance */
    double rtol;    /* relative error per step, 0 < rtol < 1; no less than 1e-15 is used */
    double atol;    /* absolute error per step, in SI units; 0: none, states are judged by their sizes */
    double step;    /* size of fixed steps [s]; 0: as the tolerances allow */
    long max_steps; /* the run fails when these are not enough */
    /* Fills the inputs u at time t, also times ahead of the motion; returns 0 to give up. 0: inputs stay what `simulate` got. */
    int (*input)(void *user, double t, double *u);
    void *user; /* handed to `input` */
} SimulatorOptions;

typedef enum {
    SIMULATOR_SUCCESS,
    SIMULATOR_STEP_UNDERFLOW, /* the step size became too small */
    SIMULATOR_NON_FINITE,     /* a rate or a start value is infinite or not a number */
    SIMULATOR_NOT_CONVERGED,  /* the implicit equations of a fixed step could not be solved */
    SIMULATOR_MAX_STEPS,
    SIMULATOR_INPUT_FAILED,   /* options->input returned 0 */
    SIMULATOR_OUT_OF_MEMORY,
    SIMULATOR_BAD_ARGUMENT,   /* nothing was done */
    SIMULATOR_OPEN_START,     /* the start does not close the loops, or there is none for these values */
    SIMULATOR_OTHER_MODEL     /* with these values other equations would be needed, e.g. other constraints are independent */
} SimulatorStatus;

typedef struct {
    SimulatorStatus status;
    char message[160];          /* what happened, in words; empty after success */
    double time;                /* reached [s] */
    long samples;               /* rows of `states` that are filled */
    const char *failed_state;   /* name of the state that failed first; 0: none, or not known */
    long steps, rejected;       /* steps taken, and tried in vain */
    long newton_steps;          /* of these, solved by Newton's iteration */
    long evaluations;           /* of the rates at one point */
    long factorisations;        /* of the equations of Newton's iteration */
    long order;                 /* of the last step */
} SimulatorReport;
#endif

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

/* The model: how many numbers of each kind, their names (0 behind the last), and their values when it was exported. Conditions are the start
   values from which the start state follows. */
extern const char model_title[];
extern const long model_states, model_inputs, model_parameters, model_conditions;
extern const char *const model_state_names[], *const model_input_names[], *const model_parameter_names[], *const model_condition_names[];
extern const double model_start[], model_input_values[], model_parameter_values[], model_condition_values[];

/* gauss, order by the tolerance, rtol = 1e-8, no fixed step, at most a million steps, constant inputs. */
SimulatorOptions simulator_defaults(void);

/* The start state x (model_states numbers) at time t0 [s] that meets the conditions (0: the exported values) with inputs u and parameters p
   (0: the exported values), on the branch of the exported start; constants of integration in p, if there are any, are set. Returns
   SIMULATOR_SUCCESS, SIMULATOR_OPEN_START where it cannot be assembled, SIMULATOR_OTHER_MODEL where what was exported does not hold, or
   SIMULATOR_OUT_OF_MEMORY. */
int simulator_start(double t0, const double *conditions, const double *u, double *p, double *x);

/* The motion from time t0 [s] on, at n times in ascending order, not before t0; the last one is the end of the run.

   x0: start state (model_states numbers), which has to close the loops of the model; 0: what `simulator_start` finds. u: inputs;
   p: parameters; each may be 0: the exported values. options: 0 for simulator_defaults(). states: n rows of model_states numbers; rows
   after the time that was reached are not written. report: may be 0. Returns the status, 0 for success. All steps stay in memory until
   the run has ended. */
int simulate(const SimulatorOptions *options, double t0, const double *x0, const double *u, const double *p, long n,
             const double *times, double *states, SimulatorReport *report);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
