/* One run: options checked, method chosen, integrated, read at the times that are wanted. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "model.h"
#include "methods.h"

#define FINEST 1e-15
#define COUNT(array) (long)(sizeof(array) / sizeof *(array))

static const SimulatorOptions defaults = {SIMULATOR_GAUSS, 0, 1e-8, 0.0, 0.0, 1000000, 0};

SimulatorOptions simulator_defaults(void) { return defaults; }

static int finished(SimulatorReport *report, SimulatorStatus status, const char *message) {
    report->status = status;
    snprintf(report->message, sizeof report->message, "%s", message);
    return status;
}

/* What is wrong with a call; 0 when nothing is. */
static const char *mistake(const SimulatorOptions *options, double t0, long n, const double *times, const double *states) {
    if (lanes() != LANES || model.width != LANES) return "model.c, runtime.c and simulator.c were compiled with different flags.";
    if (n < 1 || !times || !states) return "At least one time is needed, and room for its states.";
    if (!isfinite(t0) || !(times[0] >= t0) || !isfinite(times[n - 1])) return "Times must be finite and not before the start.";
    for (long k = 1; k < n; k++)
        if (!(times[k] >= times[k - 1])) return "Times must be in ascending order.";
    if (!(options->rtol > 0 && options->rtol < 1)) return "rtol must lie between 0 and 1.";
    if (!(options->atol >= 0)) return "atol must be positive, or 0 for the same as rtol.";
    if (!(options->step >= 0)) return "step must be positive, or 0 for steps as the tolerances allow.";
    return 0;
}

static const Method *of_order(const Method *methods, long count, long order) {
    for (long k = 0; k < count; k++)
        if (methods[k].order == order) return &methods[k];
    return 0;
}

/* The order at which a tolerance is cheapest: stages that fit into the lanes cost no more than one. */
static long gauss_order(double rtol) {
    if (LANES >= 4) return rtol < (LANES >= 8 ? 2e-4 : 1e-5) ? 16 : 8;
    return rtol >= 1e-4 ? 8 : rtol >= 1e-7 ? 12 : 16;
}

static long radau_order(double rtol) { return rtol > 1e-6 ? 5 : rtol > 1e-10 ? 9 : 13; }

/* Sets the methods of a run. Returns 0 when there is none like that. */
static int choose_method(Integrator *I, const SimulatorOptions *options, double rtol) {
    I->methods = 1;
    if (options->method == SIMULATOR_GAUSS) {
        I->method_list = of_order(gauss_methods, COUNT(gauss_methods), options->order ? options->order : gauss_order(rtol));
        if (!I->method_list) return 0;
        I->fine = gauss_refining + (I->method_list - gauss_methods);
        I->newton = WHERE_SLOW;
        return 1;
    }
    I->newton = ALWAYS;
    if (options->method != SIMULATOR_RADAU) return 0;
    if (options->order || options->step > 0) {
        I->method_list = of_order(radau_methods, COUNT(radau_methods), options->order ? options->order : radau_order(rtol));
        return I->method_list != 0;
    }
    I->method_list = radau_methods;
    I->methods = COUNT(radau_methods);
    I->method = rtol > 1e-4 ? 0 : 1;
    I->adapt_order = 1;
    return 1;
}

static enum Code run(Integrator *I) {
    int code;
    if (!begin(I)) return OUT_OF_MEMORY;
    while ((code = advance(I)) == PAUSED || code == SLOW) /* Newton costs a Jacobian: worth it where steps grow several times */
        if (code == SLOW && I->slowness > 5) use_newton(I);
    return (enum Code)code;
}

/* States at the times that were reached, back on the invariants; how many. */
static enum Code sample(Integrator *I, long n, const double *times, double *states, long *samples) {
    long reached = 0;
    while (reached < n && times[reached] <= I->t) reached++;
    enum Code code = (enum Code)dense(I, reached, times, states);
    if (code != REACHED_END) return code;
    *samples = reached;
    if (!I->ng || !reached) return REACHED_END;
    return (enum Code)project_states(&I->projection, I->nx, I->np, I->parameters, reached, times, states);
}

static int conclude(SimulatorReport *report, const Integrator *I, enum Code code) {
    char message[160];
    switch (code) {
    case REACHED_END: return finished(report, SIMULATOR_SUCCESS, "");
    case TOO_MANY_STEPS:
        snprintf(message, sizeof message, "%ld steps were not enough.", I->max_steps);
        return finished(report, SIMULATOR_MAX_STEPS, message);
    case INPUT_FAILED: return finished(report, SIMULATOR_INPUT_FAILED, "The inputs could not be computed.");
    case OUT_OF_MEMORY: return finished(report, SIMULATOR_OUT_OF_MEMORY, "Not enough memory.");
    default: break;
    }
    if (I->worst >= 0 && I->worst < I->nx) report->failed_state = model.state_names[I->worst];
    if (code == NON_FINITE) return finished(report, SIMULATOR_NON_FINITE, "A rate became infinite or not a number.");
    if (code == NOT_CONVERGED)
        return finished(report, SIMULATOR_NOT_CONVERGED, "The stage equations did not converge; use a smaller step.");
    return finished(report, SIMULATOR_STEP_UNDERFLOW, "The step size fell to rounding: the motion may be singular here.");
}

int simulate(const SimulatorOptions *options, double t0, const double *x0, const double *u, const double *p, long n,
             const double *times, double *states, SimulatorReport *report) {
    SimulatorReport unread;
    if (!options) options = &defaults;
    if (!report) report = &unread;
    memset(report, 0, sizeof *report);
    report->time = t0;
    const char *wrong = mistake(options, t0, n, times, states);
    if (wrong) return finished(report, SIMULATOR_BAD_ARGUMENT, wrong);

    Integrator I = {.nx = model.states, .nu = model.inputs, .np = model.parameters, .ng = model.invariants,
                    .rhs = model.rhs, .jvp = model.jvp, .projection = model.projection,
                    .copies = model.copies, .copy_to = model.copy_to, .copy_from = model.copy_from, .slice = INFINITY,
                    .t = t0, .end = times[n - 1], .step = options->step, .max_steps = options->max_steps};
    I.rtol = fmax(options->rtol, FINEST);
    I.atol = fmax(options->atol > 0 ? options->atol : options->rtol, options->rtol < FINEST ? FINEST : 0.0);
    I.input = options->input;
    I.parameters = p ? p : model.parameter_values;
    if (!choose_method(&I, options, I.rtol)) return finished(report, SIMULATOR_BAD_ARGUMENT, "There is no method of that order.");

    double *own = malloc(sizeof(double) * (size_t)(model.states + model.inputs + 1));
    if (!own) return finished(report, SIMULATOR_OUT_OF_MEMORY, "Not enough memory.");
    I.x = own;
    I.u = own + model.states;
    memcpy(I.x, x0 ? x0 : model.start, sizeof(double) * (size_t)model.states);
    memcpy(I.u, u ? u : model.input_values, sizeof(double) * (size_t)model.inputs);
    for (long i = 0; i < model.states; i++)
        if (!isfinite(I.x[i])) {
            report->failed_state = model.state_names[i];
            free(own);
            return finished(report, SIMULATOR_NON_FINITE, "The start values are not finite.");
        }

    enum Code code = run(&I);
    report->time = I.t;
    report->steps = I.steps;
    report->rejected = I.rejected;
    report->newton_steps = I.newton_steps;
    report->evaluations = I.evaluations;
    report->factorisations = I.factorisations;
    report->order = I.method_list[I.method].order;
    enum Code read = code == OUT_OF_MEMORY ? code : sample(&I, n, times, states, &report->samples);
    conclude(report, &I, code == REACHED_END ? read : code);
    finish(&I);
    free(own);
    return report->status;
}
