/* One run: options checked, method chosen, integrated, read at the times that are wanted. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "model.h"
#include "methods.h"

#define FINEST 1e-15
#define CLOSED 1e-6 /* gaps that a start may have, in parts of the model's size, or of its velocities */
#define COUNT(array) (long)(sizeof(array) / sizeof *(array))

static const SimulatorOptions defaults = {SIMULATOR_GAUSS, 0, 1e-8, 0.0, 0.0, 1000000, 0, 0};

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
    if (!(options->atol >= 0)) return "atol must be positive, or 0 to judge states by their sizes alone.";
    if (!(options->step >= 0)) return "step must be positive, or 0 for steps as the tolerances allow.";
    return 0;
}

static int called(const PlainFunction *f, const double *const *arguments, double *const *results, long n, long m) {
    const double **arg = malloc(sizeof *arg * (size_t)(f->arguments + 1));
    double **res = malloc(sizeof *res * (size_t)(f->results + 1)), *w = malloc(sizeof *w * (size_t)(f->w + 1));
    long long *iw = malloc(sizeof *iw * (size_t)(f->iw + 1));
    int good = arg && res && w && iw;
    if (good) {
        for (long i = 0; i < n; i++) arg[i] = arguments[i];
        for (long i = 0; i < m; i++) res[i] = results[i];
        f->run(arg, res, iw, w, 0);
    }
    free(arg);
    free(res);
    free(w);
    free(iw);
    return good;
}

/* Whether the start depends on one of `count` data, the first of which is number `first`, that is not what it was when exported. */
static int moved(long first, long count, const double *values, const double *exported) {
    for (long i = 0; i < count; i++)
        if (model.depends[first + i] && !(values[i] == exported[i])) return 1;
    return 0;
}

/* The state at which a run starts, and the constants in p that belong to it. */
static SimulatorStatus assemble(double t0, const double *conditions, const double *u, double *p, double *x) {
    const long c = model.conditions, nu = model.inputs, own = model.parameters - model.constants;
    const double zero = 0;
    memcpy(x, model.start, sizeof(double) * (size_t)model.states);
    if (!moved(0, c, conditions, model.condition_values) && !moved(c, 1, &t0, &zero) && !moved(c + 1, nu, u, model.input_values) &&
        !moved(c + 1 + nu, own, p, model.parameter_values)) {
        memcpy(p + own, model.parameter_values + own, sizeof(double) * (size_t)model.constants);
        return SIMULATOR_SUCCESS;
    }
    double *data = malloc(sizeof(double) * (size_t)(c + 1 + nu + own));
    if (!data) return SIMULATOR_OUT_OF_MEMORY;
    memcpy(data, conditions, sizeof(double) * (size_t)c);
    data[c] = t0;
    memcpy(data + c + 1, u, sizeof(double) * (size_t)nu);
    memcpy(data + c + 1 + nu, p, sizeof(double) * (size_t)own);
    int good = called(&model.assembly, (const double *const[]){data}, (double *const[]){x, p + own}, 1, 2);
    free(data);
    if (!good) return SIMULATOR_OUT_OF_MEMORY;
    for (long i = 0; i < model.states; i++)
        if (!isfinite(x[i])) return SIMULATOR_OPEN_START;
    return SIMULATOR_SUCCESS;
}

static SimulatorStatus decided(double t0, const double *x, const double *u, const double *p) {
    double margin = 0;
    if (!model.holds.run) return SIMULATOR_SUCCESS;
    if (!called(&model.holds, (const double *const[]){&t0, x, u, p}, (double *const[]){&margin}, 4, 1)) return SIMULATOR_OUT_OF_MEMORY;
    return margin >= 0 ? SIMULATOR_SUCCESS : SIMULATOR_OTHER_MODEL;
}

static SimulatorStatus closed(double t0, const double *x, const double *u, const double *p) {
    double gaps[3] = {0, 0, 0};
    if (!model.gaps.run) return SIMULATOR_SUCCESS;
    if (!called(&model.gaps, (const double *const[]){&t0, x, u, p}, (double *const[]){gaps}, 4, 1)) return SIMULATOR_OUT_OF_MEMORY;
    return gaps[0] <= CLOSED && gaps[1] <= CLOSED * gaps[2] ? SIMULATOR_SUCCESS : SIMULATOR_OPEN_START;
}

int simulator_start(double t0, const double *conditions, const double *u, double *p, double *x) {
    double *own = malloc(sizeof(double) * (size_t)(model.parameters + 1));
    if (!own) return SIMULATOR_OUT_OF_MEMORY;
    memcpy(own, p ? p : model.parameter_values, sizeof(double) * (size_t)model.parameters);
    const double *given = u ? u : model.input_values;
    SimulatorStatus status = assemble(t0, conditions ? conditions : model.condition_values, given, own, x);
    if (status == SIMULATOR_SUCCESS) status = decided(t0, x, given, own);
    if (p) memcpy(p, own, sizeof(double) * (size_t)model.parameters);
    free(own);
    return (int)status;
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
    int code, newton = 0;
    if (!begin(I)) return OUT_OF_MEMORY;
    while ((code = advance(I)) == PAUSED || code == SLOW) /* Newton costs a Jacobian: worth it where steps grow several times */
        if (code == SLOW && I->slowness > 5 && !newton) {
            newton = 1;
            use_newton(I);
        }
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

static const char *without_start(SimulatorStatus status) {
    switch (status) {
    case SIMULATOR_OPEN_START: return "The start does not close the loops, or none can be assembled with these values.";
    case SIMULATOR_OTHER_MODEL: return "With these values other equations are needed: export a model that is built with them.";
    case SIMULATOR_NON_FINITE: return "The start values are not finite.";
    case SIMULATOR_INPUT_FAILED: return "The inputs could not be computed.";
    default: return "Not enough memory.";
    }
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

    Integrator I = {.nx = model.states, .nu = model.inputs, .np = model.parameters, .ng = model.invariants, .positions = model.positions,
                    .rhs = model.rhs, .jvp = model.jvp, .projection = model.projection, .clearance = model.clearance,
                    .copies = model.copies, .copy_to = model.copy_to, .copy_from = model.copy_from, .slice = INFINITY,
                    .t = t0, .end = times[n - 1], .step = options->step, .max_steps = options->max_steps};
    I.rtol = fmax(options->rtol, FINEST);
    I.atol = options->atol;
    I.input = options->input;
    I.user = options->user;
    if (!choose_method(&I, options, I.rtol)) return finished(report, SIMULATOR_BAD_ARGUMENT, "There is no method of that order.");

    double *own = malloc(sizeof(double) * (size_t)(model.states + model.inputs + model.parameters + 1));
    if (!own) return finished(report, SIMULATOR_OUT_OF_MEMORY, "Not enough memory.");
    double *parameters = own + model.states + model.inputs;
    I.x = own;
    I.u = own + model.states;
    I.parameters = parameters;
    memcpy(I.u, u ? u : model.input_values, sizeof(double) * (size_t)model.inputs);
    memcpy(parameters, p ? p : model.parameter_values, sizeof(double) * (size_t)model.parameters);
    if (x0) memcpy(I.x, x0, sizeof(double) * (size_t)model.states);
    int given = !I.input || I.input(I.user, t0, I.u);
    SimulatorStatus begun = !given ? SIMULATOR_INPUT_FAILED
                            : x0   ? SIMULATOR_SUCCESS
                                   : assemble(t0, model.condition_values, I.u, parameters, I.x);
    for (long i = 0; i < model.states && begun == SIMULATOR_SUCCESS; i++)
        if (!isfinite(I.x[i])) {
            report->failed_state = model.state_names[i];
            begun = SIMULATOR_NON_FINITE;
        }
    if (x0 && begun == SIMULATOR_SUCCESS) begun = closed(t0, I.x, I.u, parameters);
    if (begun == SIMULATOR_SUCCESS) begun = decided(t0, I.x, I.u, parameters);
    if (begun != SIMULATOR_SUCCESS) {
        free(own);
        return finished(report, begun, without_start(begun));
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
