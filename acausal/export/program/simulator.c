/* Instances: one motion each, in one block of memory. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "model.h"
#include "methods.h"

#define FINEST 1e-15
#define CLOSED 1e-6 /* gaps that a start may have, in parts of the model's size, or of its velocities */
#define LOOKS 8         /* places of a step at which is looked for singular positions */
#define NEAR 1e-2       /* squares of distances from one: where it is looked for ... */
#define SINGULAR 1e-6   /* ... and what is as good as one */
#define GOLDEN 0.382
#define CUTS 24
#define ALIGNED 64
#define COUNT(array) (long)(sizeof(array) / sizeof *(array))
#define KINDS (SIMULATOR_EVENT + 1)
#define TERMS 3 /* an input, its rate, and the rate of that */

enum Stage { NEW, STARTED, FAILED };
enum Renewal { NOTHING_NEW, NEW_INPUTS, NEW_PARAMETERS, NEW_STATES };

struct simulator_instance {
    Integrator I; /* the motion, as far as steps have been taken; its pointers lead into the same block */
    simulator_options options;
    void *owned;  /* memory of malloc, 0: the caller's */
    size_t size;
    enum Stage stage;
    enum Renewal renewed; /* what was set since the last step: then a new piece of the motion begins */
    double present, end;
    long told;    /* events of the last step that have been told */
    simulator_crossing crossing;
    simulator_transition change; /* of the pieces before the present one */
    simulator_report report; /* the last status; the rest: of the pieces before the present one */
    double *values[KINDS]; /* the present ones of each kind; masks behind inputs */
    double *x, *met, *data; /* where the piece began, then the end of the last step; sizes that states have had; for the assembly */
    double *before;         /* inputs before some were set */
    Table *tables;          /* the model's, then of inputs that have been set and go on with their rates */
    double *course, since;  /* coefficients of these: TERMS of each; when they were set */
    double *looks;          /* states at LOOKS times of a step */
    V *in, *out, *c, *w;    /* of outputs, and of inputs that are formulas */
    const double **arguments;
    double **results, *work;
    long long *integers;
};

static const simulator_options defaults = {SIMULATOR_AUTO, 0, 1e-8, 0.0, 0.0, 0.0, 1000000, 0, 0};

simulator_options simulator_defaults(void) { return defaults; }

const char *simulator_title(void) { return model.title; }

const char *simulator_version(void) { return SIMULATOR_VERSION; }

static long count_of(simulator_kind kind) { return (int)kind < 0 || (int)kind >= KINDS ? 0 : model.quantities[kind].count; }

static int exists(simulator_kind kind, long i) { return i >= 0 && i < count_of(kind); }

long simulator_count(simulator_kind kind) { return count_of(kind); }

const char *simulator_name(simulator_kind kind, long i) { return exists(kind, i) ? model.quantities[kind].names[i] : 0; }

const char *simulator_unit(simulator_kind kind, long i) { return exists(kind, i) ? model.quantities[kind].units[i] : 0; }

double simulator_exported(simulator_kind kind, long i) { return exists(kind, i) ? model.quantities[kind].values[i] : NAN; }

long simulator_index(simulator_kind kind, const char *name) {
    for (long i = 0; name && i < count_of(kind); i++)
        if (strcmp(model.quantities[kind].names[i], name) == 0) return i;
    return -1;
}

/* Methods */

enum { GAUSS_ORDER = 16 };

static long radau_order(double rtol) { return rtol > 1e-6 ? 5 : rtol > 1e-10 ? 9 : 13; }

/* Sets the methods of an instance. Returns 0 when there is none like that. */
static int choose_method(Integrator *I, const simulator_options *options) {
    int radau = options->method == SIMULATOR_RADAU;
    if (!radau && options->method != SIMULATOR_GAUSS && options->method != SIMULATOR_AUTO) return 0;
    long order = options->order ? options->order : radau ? radau_order(I->rtol) : GAUSS_ORDER;
    I->newton = radau ? ALWAYS : WHERE_SLOW;
    I->adapt_order = options->method == SIMULATOR_AUTO || (radau && !options->order && !(options->step > 0));
    if (radau && I->adapt_order) {
        I->method_list = gauss_methods[0] + 1;
        I->methods = COUNT(gauss_methods[0]) - 1;
        return 1;
    }
    I->methods = options->method == SIMULATOR_AUTO ? COUNT(gauss_methods[0]) : 1;
    for (long k = 0; k < (radau ? COUNT(radau_methods) : COUNT(gauss_methods)); k++) {
        I->method_list = radau ? &radau_methods[k] : gauss_methods[k];
        I->fine = radau ? 0 : &gauss_refining[k];
        if (I->method_list->order == order) return 1;
    }
    return 0;
}

/* An integration with nothing in it yet; 0 when there is no such method. */
static int blank(Integrator *I, const simulator_options *options) {
    *I = model.motion;
    I->max_steps = options->max_steps;
    I->step = options->step;
    I->max_step = options->max_step;
    I->rtol = fmax(options->rtol, FINEST);
    I->atol = options->atol;
    I->input = options->input;
    I->user = options->user;
    I->event_room = SIMULATOR_EVENTS_OF_A_STEP;
    if (I->input) I->tables = I->formulas = I->clocks = 0;
    return choose_method(I, options);
}

const char *simulator_mistake(const simulator_options *options) {
    Integrator I;
    if (!options) options = &defaults;
    if (lanes() != LANES || model.width != LANES) return "The files were compiled with different flags.";
    if (!(options->rtol > 0 && options->rtol < 1)) return "rtol must lie between 0 and 1.";
    if (!(options->atol >= 0)) return "atol must be positive, or 0 to judge states by their sizes alone.";
    if (!(options->step >= 0)) return "step must be positive, or 0 for steps as the tolerances allow.";
    if (!(options->max_step >= 0) || (options->max_step > 0 && options->step > 0)) return "max_step must be positive, or 0, and goes with steps that adapt.";
    if (options->max_steps < 1) return "max_steps must be positive.";
    return blank(&I, options) ? 0 : "There is no method of that order.";
}

/* Memory */

static char *aligned_to(char *at) { return at + (ALIGNED - (size_t)at % ALIGNED) % ALIGNED; }

static long larger(long a, long b) { return a > b ? a : b; }

/* The place of an array in the block; only counted where there is none. */
static void *take(char *block, size_t *used, size_t bytes) {
    void *at = block ? block + *used : 0;
    *used += (bytes + ALIGNED - 1) / ALIGNED * ALIGNED;
    return at;
}

/* The arrays of an instance, which stands at the beginning of its block. Returns the size of the block; s and block may be 0 to count. */
static size_t arrange(simulator_instance *s, char *block, const Integrator *I) {
    simulator_instance counted;
    size_t used = 0, room = needed(I);
    const PlainFunction *plain[] = {&model.assembly, &model.gaps, &model.holds, &model.clear};
    long arguments = 0, results = 0, integers = 0, work = 0;
    for (long k = 0; k < COUNT(plain); k++) {
        arguments = larger(arguments, plain[k]->arguments);
        results = larger(results, plain[k]->results);
        integers = larger(integers, plain[k]->iw);
        work = larger(work, plain[k]->w);
    }
    long data = count_of(SIMULATOR_CONDITION) + 1 + count_of(SIMULATOR_INPUT) + I->masks + I->np;
    const Kernel *o = &model.outputs, *f = &model.motion.formula;
    if (!s) s = &counted;
    take(block, &used, sizeof *s);
    for (int kind = 0; kind < KINDS; kind++) {
        long count = count_of((simulator_kind)kind) + (kind == SIMULATOR_INPUT ? I->masks : 0);
        s->values[kind] = take(block, &used, sizeof(double) * (size_t)count);
    }
    s->x = take(block, &used, sizeof(double) * (size_t)I->nx);
    s->met = take(block, &used, sizeof(double) * (size_t)I->nx);
    s->before = take(block, &used, sizeof(double) * (size_t)(I->led ? count_of(SIMULATOR_INPUT) : 0));
    s->data = take(block, &used, sizeof(double) * (size_t)data);
    s->tables = take(block, &used, sizeof(Table) * (size_t)(model.motion.tables + count_of(SIMULATOR_INPUT)));
    s->course = take(block, &used, sizeof(double) * (size_t)(TERMS * count_of(SIMULATOR_INPUT)));
    s->looks = take(block, &used, sizeof(double) * (size_t)(model.clear.run ? LOOKS * I->nx : 0));
    s->in = take(block, &used, sizeof(V) * (size_t)larger(o->inputs, f->inputs));
    s->out = take(block, &used, sizeof(V) * (size_t)larger(o->outputs, f->outputs));
    s->c = take(block, &used, sizeof(V) * (size_t)(larger(o->constants, f->constants) + 1));
    s->w = take(block, &used, sizeof(V) * (size_t)(larger(o->work, f->work) + 1));
    s->arguments = take(block, &used, sizeof(double *) * (size_t)arguments);
    s->results = take(block, &used, sizeof(double *) * (size_t)results);
    s->integers = take(block, &used, sizeof(long long) * (size_t)integers);
    s->work = take(block, &used, sizeof(double) * (size_t)work);
    s->I.block = take(block, &used, room);
    s->I.room = room;
    s->I.x = s->x;
    s->I.u = s->values[SIMULATOR_INPUT];
    s->I.before = I->led ? s->before : 0;
    s->I.parameters = s->values[SIMULATOR_PARAMETER];
    for (long k = model.motion.tables; block && k < I->tables; k++) {
        s->tables[k].begins = &s->since;
        s->tables[k].coefficients = s->course + TERMS * (k - model.motion.tables);
    }
    if (block && I->tables > model.motion.tables) s->I.table_list = s->tables;
    return used;
}

/* Inputs that are no functions of time go on from the present time with the rates that were set. */
static void extend_inputs(simulator_instance *s) {
    Integrator *I = &s->I;
    const double *u = s->values[SIMULATOR_INPUT];
    s->since = s->present;
    for (long i = 0; i < count_of(SIMULATOR_INPUT) && !I->input; i++) {
        const long rate = model.rate[i], second = rate < 0 ? -1 : model.rate[rate];
        if (rate < 0 || (u[rate] == 0 && (second < 0 || u[second] == 0))) continue;
        double *c = s->course + TERMS * (I->tables - model.motion.tables);
        c[0] = second < 0 ? 0 : u[second] / 2;
        c[1] = u[rate];
        c[2] = u[i];
        s->tables[I->tables++] = (Table){i, 1, TERMS, 0, 0, &s->since, c};
    }
    if (I->tables == model.motion.tables) return;
    if (model.motion.tables) memcpy(s->tables, model.motion.table_list, sizeof(Table) * (size_t)model.motion.tables);
    I->table_list = s->tables;
}

size_t simulator_size(const simulator_options *options) {
    Integrator I;
    if (!options) options = &defaults;
    if (simulator_mistake(options)) return 0;
    blank(&I, options);
    return arrange(0, 0, &I) + ALIGNED;
}

/* A block of `size` bytes with room to align it; 0 when there is none. */
static simulator_instance *block_for(void *memory, size_t bytes, size_t size, void **owned) {
    *owned = memory ? 0 : malloc(size);
    if (memory ? bytes < size : !*owned) return 0;
    return (simulator_instance *)(void *)aligned_to(memory ? memory : *owned);
}

void simulator_reset(simulator_instance *s) {
    for (int kind = 0; kind < KINDS; kind++) {
        const Quantities *q = &model.quantities[kind];
        if (q->count) memcpy(s->values[kind], q->values, sizeof(double) * (size_t)q->count);
    }
    s->stage = NEW;
    s->renewed = NOTHING_NEW;
    s->present = 0;
    s->end = INFINITY;
    s->crossing = (simulator_crossing){-1, 0, NAN};
    s->change = (simulator_transition){0, 0, NAN};
    memset(&s->report, 0, sizeof s->report);
}

simulator_instance *simulator_create(const simulator_options *options, void *memory, size_t bytes) {
    void *owned;
    size_t size = simulator_size(options);
    simulator_instance *s = size ? block_for(memory, bytes, size, &owned) : 0;
    if (!s) return 0;
    memset(s, 0, sizeof *s);
    s->options = options ? *options : defaults;
    s->owned = owned;
    s->size = size;
    blank(&s->I, &s->options);
    arrange(s, (char *)s, &s->I);
    simulator_reset(s);
    return s;
}

int simulator_restore(simulator_instance *s, const simulator_instance *from) {
    void *owned = s->owned;
    const char *block = from->I.block;
    if (s == from) return SIMULATOR_SUCCESS;
    if (s->size != from->size) return SIMULATOR_BAD_ARGUMENT;
    memcpy(s, from, s->size - ALIGNED);
    s->owned = owned;
    arrange(s, (char *)s, &s->I);
    if (s->I.state) moved_integration(&s->I, block);
    return SIMULATOR_SUCCESS;
}

simulator_instance *simulator_copy(const simulator_instance *from, void *memory, size_t bytes) {
    void *owned;
    simulator_instance *s = block_for(memory, bytes, from->size, &owned);
    if (!s) return 0;
    s->owned = owned;
    s->size = from->size;
    simulator_restore(s, from);
    return s;
}

void simulator_free(simulator_instance *s) {
    if (s) free(s->owned);
}

/* What happened */

static const char *in_words(simulator_status status) {
    switch (status) {
    case SIMULATOR_SUCCESS: return "";
    case SIMULATOR_AT_EVENT: return "An event.";
    case SIMULATOR_STOPPED: return "An event ended the motion.";
    case SIMULATOR_STEP_UNDERFLOW: return "The step size fell to rounding: the motion may be singular here.";
    case SIMULATOR_NON_FINITE: return "A rate became infinite or not a number.";
    case SIMULATOR_NOT_CONVERGED: return "The stage equations did not converge; use a smaller step.";
    case SIMULATOR_FAILED_INPUT: return "The inputs could not be computed.";
    case SIMULATOR_OUT_OF_MEMORY: return "Not enough memory.";
    case SIMULATOR_OPEN_START: return "The start does not close the loops, or none can be assembled with these values.";
    case SIMULATOR_SLIDES: return "The motion slides along a switch of the rates: from both sides it is led back there, so that no side lasts.";
    case SIMULATOR_OVERLAPS: return "The gap of a one-sided contact is negative.";
    case SIMULATOR_NO_MODE: return "Nothing obeys the laws of all contacts.";
    case SIMULATOR_CHATTERS: return "A contact changes its mode again and again.";
    case SIMULATOR_CANNOT_SET: return "An event sets what cannot be so.";
    case SIMULATOR_TIED: return "Contacts strike one after the other, several of them in one instant.";
    case SIMULATOR_GAINS: return "An impact gains energy.";
    case SIMULATOR_OTHER_MODEL: return "With these values other equations are needed: export a model that is built with them.";
    default: return "The call makes no sense.";
    }
}

static int said(simulator_instance *s, simulator_status status, const char *message) {
    snprintf(s->report.message, sizeof s->report.message, "%s", message ? message : in_words(status));
    return (int)(s->report.status = status);
}

/* The motion has failed for good. */
static int failed(simulator_instance *s, simulator_status status, const char *message) {
    s->stage = FAILED;
    return said(s, status, message);
}

/* What the integrator could not do. */
static int gave_up(simulator_instance *s, enum Code code) {
    char message[sizeof s->report.message];
    const Integrator *I = &s->I;
    switch (code) {
    case TOO_MANY_STEPS:
        snprintf(message, sizeof message, "%ld steps were not enough.", s->options.max_steps);
        return failed(s, SIMULATOR_MAX_STEPS, message);
    case INPUT_FAILED: return failed(s, SIMULATOR_FAILED_INPUT, 0);
    case OUT_OF_MEMORY: return failed(s, SIMULATOR_OUT_OF_MEMORY, 0);
    case SLIDES:
        snprintf(message, sizeof message, "The motion slides along a switch of the rates, %.80s: from both sides it is led back there, so that no side lasts.",
                 model.switches[I->worst]);
        return failed(s, SIMULATOR_SLIDES, message);
    case OVERLAPS:
        snprintf(message, sizeof message, "The gap of %.120s is negative at the start, or after a jump of an input.", model.laws[I->worst]);
        return failed(s, SIMULATOR_OVERLAPS, message);
    case FALLS:
        snprintf(message, sizeof message, "The gap of %.120s has become negative, by %.6g, and nothing has struck.", model.laws[I->worst], I->apart);
        return failed(s, SIMULATOR_OVERLAPS, message);
    case NO_MODE:
        snprintf(message, sizeof message, "Whether %.120s and what touches with it hold, slide or open: nothing obeys the laws of all of them.", model.laws[I->worst]);
        return failed(s, SIMULATOR_NO_MODE, message);
    case CHATTERS:
        snprintf(message, sizeof message, "%.120s changes its mode again and again in one instant: no mode lasts.", model.laws[I->worst]);
        return failed(s, SIMULATOR_CHATTERS, message);
    case SETS_NO_NUMBER:
    case SETS_TWICE:
    case SETS_BOUND:
        snprintf(message, sizeof message, "%.120s %s.", model.laws[I->one_sided + I->lines + I->planes + I->patches + I->worst],
                 code == SETS_NO_NUMBER ? "sets something to what is no number" : code == SETS_TWICE ? "and another event set the same to different values" : "sets what constraints do not let be so");
        return failed(s, SIMULATOR_CANNOT_SET, message);
    case SETS_APART:
        snprintf(message, sizeof message, "What is to be held does not meet: by %.6g.", I->apart);
        return failed(s, SIMULATOR_CANNOT_SET, message);
    case BEGINS_NO_NUMBER: return failed(s, SIMULATOR_CANNOT_SET, "What a part remembers begins with what is no number.");
    case BRANCHES_TOUCH: return failed(s, SIMULATOR_STEP_UNDERFLOW, "The motion comes to a singular position of loops where its branches touch.");
    case TIED: return failed(s, SIMULATOR_TIED, 0);
    case GAINS:
        snprintf(message, sizeof message, "An impact of %.120s gains energy.", model.laws[I->worst]);
        return failed(s, SIMULATOR_GAINS, message);
    default: break;
    }
    if (I->worst >= 0 && I->worst < I->nx) s->report.failed_state = model.quantities[SIMULATOR_STATE].names[I->worst];
    return failed(s, code == NON_FINITE ? SIMULATOR_NON_FINITE : code == NOT_CONVERGED ? SIMULATOR_NOT_CONVERGED : SIMULATOR_STEP_UNDERFLOW, 0);
}

const char *simulator_message(const simulator_instance *s) { return s->report.message; }

double simulator_time(const simulator_instance *s) { return s->present; }

simulator_crossing simulator_event(const simulator_instance *s) { return s->crossing; }

simulator_transition simulator_change(const simulator_instance *s) {
    const Integrator *I = &s->I;
    simulator_transition change = s->change;
    if (!I->state || s->stage == NEW) return change;
    Transition last = last_transition(I);
    if (!last.count) return change;
    change.part = last.row < 0 ? 0 : model.laws[last.law];
    change.time = last.time;
    change.count += last.count;
    return change;
}

/* What the present piece of the motion has cost so far, and all before. */
simulator_report simulator_summary(const simulator_instance *s) {
    const Integrator *I = &s->I;
    simulator_report r = s->report;
    r.time = s->present;
    r.reached = s->stage == NEW ? s->present : I->t;
    r.steps += I->steps - (I->state ? last_transition(I).jumps : 0);
    r.rejected += I->rejected;
    r.newton_steps += I->newton_steps;
    r.radau_steps += I->radau_steps;
    r.evaluations += I->evaluations;
    r.factorisations += I->factorisations;
    r.order = I->method_list[I->method].order;
    return r;
}

/* Numbers */

/* Whether an input is a table or formula of time. */
static int is_given(const simulator_instance *s, simulator_kind kind, long i) { return kind == SIMULATOR_INPUT && !s->options.input && model.given[i]; }

static int changeable(const simulator_instance *s, simulator_kind kind) {
    if (kind == SIMULATOR_INPUT) return !s->options.input;
    return kind == SIMULATOR_PARAMETER || kind == SIMULATOR_CONDITION || (kind == SIMULATOR_STATE && s->stage != NEW);
}

static int renewed_by(simulator_instance *s, simulator_kind kind) {
    enum Renewal by = kind == SIMULATOR_STATE ? NEW_STATES : kind == SIMULATOR_PARAMETER ? NEW_PARAMETERS : kind == SIMULATOR_INPUT ? NEW_INPUTS : NOTHING_NEW;
    if (by > s->renewed) s->renewed = by;
    return SIMULATOR_SUCCESS;
}

static int present_inputs(simulator_instance *s);

/* Before anything is set: inputs go on, and states follow them, until then. Whatever is set after it, in whatever order, counts from there. */
static void remember_inputs(simulator_instance *s) {
    if (s->renewed != NOTHING_NEW || !(s->I.led || s->I.tables > model.motion.tables) || !present_inputs(s)) return;
    if (s->I.led) memcpy(s->before, s->values[SIMULATOR_INPUT], sizeof(double) * (size_t)count_of(SIMULATOR_INPUT));
}

int simulator_set(simulator_instance *s, simulator_kind kind, long i, double value) {
    if (!exists(kind, i) || !changeable(s, kind) || is_given(s, kind, i)) return said(s, SIMULATOR_BAD_ARGUMENT, "There is no such number, or it cannot be set.");
    if (kind != SIMULATOR_CONDITION) remember_inputs(s);
    s->values[kind][i] = value;
    return renewed_by(s, kind);
}

int simulator_set_all(simulator_instance *s, simulator_kind kind, const double *values) {
    if (!changeable(s, kind)) return said(s, SIMULATOR_BAD_ARGUMENT, "Numbers of this kind cannot be set.");
    if (kind != SIMULATOR_CONDITION) remember_inputs(s);
    if (count_of(kind)) memcpy(s->values[kind], values, sizeof(double) * (size_t)count_of(kind));
    return renewed_by(s, kind);
}

/* Results of a kernel, all of whose arguments are given, into s->out. */
static void run_at(simulator_instance *s, const Kernel *k, const double *const *arguments, const long *counts, int parts) {
    long at = 0;
    for (int part = 0; part < parts; part++)
        for (long i = 0; i < counts[part]; i++) s->in[at++] = v_all(arguments[part][i]);
    k->prepare(s->in, s->c, s->c, s->w);
    k->run(s->in, s->c, s->out, s->w);
}

/* Inputs at the present time. Returns 0 when they could not be computed. */
static int present_inputs(simulator_instance *s) {
    const Integrator *I = &s->I;
    double *u = s->values[SIMULATOR_INPUT], *masks = u + count_of(SIMULATOR_INPUT);
    const double *known = I->masks && s->stage != NEW ? masks_at(I, s->present) : 0;
    for (long k = 0; k < I->masks; k++) masks[k] = known ? known[k] : 0;
    if (I->input) return I->input(I->user, s->present, u);
    const long known_tables = s->stage != NEW && s->renewed == NOTHING_NEW ? I->tables : model.motion.tables; /* what has been set is as it has been set */
    for (long k = 0; k < known_tables; k++) u[I->table_list[k].input] = table_value(&I->table_list[k], s->present);
    if (I->formulas) run_at(s, &I->formula, (const double *const[]){&s->present}, (const long[]){1}, 1);
    for (long k = 0; k < I->formulas; k++) u[I->formula_input[k]] = s->out[k][0];
    return 1;
}

static int find_outputs(simulator_instance *s) {
    const double *const arguments[] = {&s->present, s->values[SIMULATOR_STATE], s->values[SIMULATOR_INPUT], s->values[SIMULATOR_PARAMETER]};
    const long counts[] = {1, s->I.nx, count_of(SIMULATOR_INPUT) + s->I.masks, s->I.np};
    run_at(s, &model.outputs, arguments, counts, 4);
    for (long i = 0; i < model.outputs.outputs; i++) s->values[SIMULATOR_OUTPUT][i] = s->out[i][0];
    return SIMULATOR_SUCCESS;
}

/* What the integrator could not do ended the motion where it stands. */
static int ended(simulator_instance *s, enum Code code) {
    const Integrator *I = &s->I;
    s->present = I->t;
    memcpy(s->values[SIMULATOR_STATE], I->x, sizeof(double) * (size_t)I->nx);
    return gave_up(s, code);
}

/* What holds, sticks or opens where the last step has ended is decided. */
static int settle_here(simulator_instance *s) {
    if (isfinite(s->end)) s->I.end = s->end;
    enum Code code = (enum Code)settle_modes(&s->I);
    return code == REACHED_END ? SIMULATOR_SUCCESS : ended(s, code);
}

static int renew(simulator_instance *s);
static int arrive(simulator_instance *s, double t);

/* Brings the numbers of a kind up to the present time. */
static int find(simulator_instance *s, simulator_kind kind) {
    if (s->I.led && s->stage == STARTED && s->renewed == NEW_INPUTS && (kind == SIMULATOR_STATE || kind == SIMULATOR_OUTPUT)) { /* states follow inputs at once */
        if (renew(s) != SIMULATOR_SUCCESS || arrive(s, s->present) != SIMULATOR_SUCCESS) return (int)s->report.status;
    }
    if (kind != SIMULATOR_INPUT && kind != SIMULATOR_OUTPUT) return SIMULATOR_SUCCESS;
    if (s->stage == NEW && kind == SIMULATOR_OUTPUT) return said(s, SIMULATOR_BAD_ARGUMENT, "Outputs need a start.");
    if (kind == SIMULATOR_OUTPUT && s->stage == STARTED && unsettled(&s->I, -INFINITY) && settle_here(s) != SIMULATOR_SUCCESS) return (int)s->report.status;
    if (s->stage != NEW && !present_inputs(s)) return said(s, SIMULATOR_FAILED_INPUT, 0);
    return kind == SIMULATOR_OUTPUT && count_of(kind) ? find_outputs(s) : SIMULATOR_SUCCESS;
}

double simulator_get(simulator_instance *s, simulator_kind kind, long i) {
    return exists(kind, i) && find(s, kind) == SIMULATOR_SUCCESS ? s->values[kind][i] : NAN;
}

int simulator_get_all(simulator_instance *s, simulator_kind kind, double *values) {
    int status = find(s, kind);
    if (status == SIMULATOR_SUCCESS && count_of(kind)) memcpy(values, s->values[kind], sizeof(double) * (size_t)count_of(kind));
    return status;
}

/* Starts */

static void run_plain(simulator_instance *s, const PlainFunction *f, const double *const *arguments, long n, double *const *results, long m) {
    for (long i = 0; i < n; i++) s->arguments[i] = arguments[i];
    for (long i = 0; i < m; i++) s->results[i] = results[i];
    f->run(s->arguments, s->results, s->integers, s->work, 0);
    memset(s->arguments, 0, sizeof *s->arguments * (size_t)f->arguments);
    memset(s->results, 0, sizeof *s->results * (size_t)f->results);
}

/* Whether the start depends on one of `count` data, the first of which is number `first`, that is not what it was when exported. */
static int differs(long first, long count, const double *values, const double *exported) {
    for (long i = 0; i < count; i++)
        if (model.depends[first + i] && !(values[i] == exported[i])) return 1;
    return 0;
}

/* The state at which a motion starts at the present time, and the constants in p that belong to it. */
static simulator_status assemble(simulator_instance *s) {
    const long c = count_of(SIMULATOR_CONDITION), nu = count_of(SIMULATOR_INPUT), own = s->I.np - model.constants, rest = c + 1 + nu + s->I.masks;
    const double *conditions = s->values[SIMULATOR_CONDITION], *u = s->values[SIMULATOR_INPUT], zero = 0;
    double *p = s->values[SIMULATOR_PARAMETER], *x = s->values[SIMULATOR_STATE], *data = s->data;
    const double *exported = model.quantities[SIMULATOR_PARAMETER].values;
    if (!differs(0, c, conditions, model.quantities[SIMULATOR_CONDITION].values) && !differs(c, 1, &s->present, &zero) &&
        !differs(c + 1, nu, u, model.quantities[SIMULATOR_INPUT].values) && !differs(rest, own, p, exported)) {
        memcpy(x, model.quantities[SIMULATOR_STATE].values, sizeof(double) * (size_t)s->I.nx);
        memcpy(p + own, exported + own, sizeof(double) * (size_t)model.constants);
        return SIMULATOR_SUCCESS;
    }
    memcpy(data, conditions, sizeof(double) * (size_t)c);
    data[c] = s->present;
    memcpy(data + c + 1, u, sizeof(double) * (size_t)(nu + s->I.masks));
    memcpy(data + rest, p, sizeof(double) * (size_t)own);
    run_plain(s, &model.assembly, (const double *const[]){data}, 1, (double *const[]){x, p + own}, 2);
    for (long i = 0; i < s->I.nx; i++)
        if (!isfinite(x[i])) return SIMULATOR_OPEN_START;
    return SIMULATOR_SUCCESS;
}

/* Whether the model is what these values need, and, where it is not known, whether its loops are closed. */
static simulator_status fits(simulator_instance *s, int assembled) {
    const double *const arguments[] = {&s->present, s->values[SIMULATOR_STATE], s->values[SIMULATOR_INPUT], s->values[SIMULATOR_PARAMETER]};
    double gaps[3] = {0, 0, 0}, margin = 0;
    for (long i = 0; i < s->I.nx; i++)
        if (!isfinite(arguments[1][i])) {
            s->report.failed_state = model.quantities[SIMULATOR_STATE].names[i];
            return SIMULATOR_NON_FINITE;
        }
    if (model.gaps.run && !assembled) {
        run_plain(s, &model.gaps, arguments, 4, (double *const[]){gaps}, 1);
        if (!(gaps[0] <= CLOSED && gaps[1] <= CLOSED * gaps[2])) return SIMULATOR_OPEN_START;
    }
    if (model.holds.run) run_plain(s, &model.holds, arguments, 4, (double *const[]){&margin}, 1);
    return margin >= 0 ? SIMULATOR_SUCCESS : SIMULATOR_OTHER_MODEL;
}

/* The state at the present time, back on the invariants, as it is read. */
static int read_present(simulator_instance *s) {
    return state_at(&s->I, s->present, s->values[SIMULATOR_STATE]) == REACHED_END ? SIMULATOR_SUCCESS : failed(s, SIMULATOR_FAILED_INPUT, 0);
}

/* At a time that steps have come to: what happens there has happened. */
static int arrive(simulator_instance *s, double t) {
    s->present = t;
    if (unsettled(&s->I, t) && settle_here(s) != SIMULATOR_SUCCESS) return (int)s->report.status;
    return read_present(s);
}

/* A piece of the motion begins at the present time and states; h: size of its first step, 0: not known; `met`: sizes that states have had. */
static int begin_piece(simulator_instance *s, double h, const double *met) {
    const Integrator old = s->I;
    Integrator *I = &s->I;
    blank(I, &s->options);
    arrange(s, (char *)s, I);
    memcpy(s->x, s->values[SIMULATOR_STATE], sizeof(double) * (size_t)I->nx);
    I->max_steps = s->options.max_steps - s->report.steps;
    I->t = I->end = s->present;
    extend_inputs(s);
    I->h = h;
    I->method = h > 0 ? old.method : I->method;
    if (!begin(I)) return failed(s, SIMULATOR_OUT_OF_MEMORY, 0);
    for (long i = 0; met && i < I->nx; i++) I->size[i] = fmax(I->size[i], met[i]);
    if (met) remember(I, s->values[SIMULATOR_INPUT] + count_of(SIMULATOR_INPUT));
    if (I->newton == WHERE_SLOW && h > 0 && old.newton_steps) use_newton(I);
    s->renewed = NOTHING_NEW;
    s->stage = STARTED;
    return said(s, SIMULATOR_SUCCESS, 0);
}

/* A start is tried at time t, from given states or the conditions. */
static int start_from(simulator_instance *s, double t, const double *states) {
    if (!isfinite(t)) return said(s, SIMULATOR_BAD_ARGUMENT, "The start must be at a finite time.");
    memset(&s->report, 0, sizeof s->report);
    s->crossing = (simulator_crossing){-1, 0, NAN};
    s->change = (simulator_transition){0, 0, NAN};
    s->I.state = 0;
    s->I.steps = s->I.rejected = s->I.newton_steps = s->I.radau_steps = s->I.evaluations = s->I.factorisations = 0;
    s->renewed = NOTHING_NEW;
    s->stage = NEW;
    s->present = t;
    if (!present_inputs(s)) return said(s, SIMULATOR_FAILED_INPUT, 0);
    if (s->I.led) memcpy(s->before, s->values[SIMULATOR_INPUT], sizeof(double) * (size_t)count_of(SIMULATOR_INPUT));
    if (states) memcpy(s->values[SIMULATOR_STATE], states, sizeof(double) * (size_t)s->I.nx);
    simulator_status status = states ? SIMULATOR_SUCCESS : assemble(s);
    if (status == SIMULATOR_SUCCESS) status = fits(s, !states);
    if (status != SIMULATOR_SUCCESS) return said(s, status, status == SIMULATOR_NON_FINITE ? "The start values are not finite." : 0);
    int begun = begin_piece(s, 0, 0);
    return begun == SIMULATOR_SUCCESS ? read_present(s) : begun;
}

int simulator_start(simulator_instance *s, double t) { return start_from(s, t, 0); }

int simulator_start_at(simulator_instance *s, double t, const double *states) { return start_from(s, t, states); }

int simulator_renew(simulator_instance *s) {
    remember_inputs(s);
    return renewed_by(s, SIMULATOR_INPUT);
}

/* Whether what has been set on the way is a state of the model; if not, the motion ends. */
static int still_fits(simulator_instance *s) {
    simulator_status status = fits(s, 0);
    if (status == SIMULATOR_SUCCESS) return SIMULATOR_SUCCESS;
    return failed(s, status, status == SIMULATOR_NON_FINITE ? "The values that were set are not finite." : 0);
}

/* The same of places, where inputs that prescribe some have jumped. */
static int still_closed(simulator_instance *s) {
    const double *const arguments[] = {&s->present, s->values[SIMULATOR_STATE], s->values[SIMULATOR_INPUT], s->values[SIMULATOR_PARAMETER]};
    double gaps[3] = {0, 0, 0};
    if (model.gaps.run) run_plain(s, &model.gaps, arguments, 4, (double *const[]){gaps}, 1);
    return gaps[0] <= CLOSED ? SIMULATOR_SUCCESS : failed(s, SIMULATOR_OPEN_START, "No position of the mechanism was found at which inputs that prescribe places are what was set.");
}

/* Goes on at the present time with what has been set. */
static int renew(simulator_instance *s) {
    if (!present_inputs(s)) return failed(s, SIMULATOR_FAILED_INPUT, 0);
    const int anew = s->renewed > NEW_INPUTS, follow = s->I.led && (s->renewed != NEW_STATES || s->I.followers); /* states do, before others are looked at */
    if (anew && !follow && still_fits(s) != SIMULATOR_SUCCESS) return (int)s->report.status;
    if (s->renewed == NEW_STATES && follow && still_closed(s) != SIMULATOR_SUCCESS) return (int)s->report.status;
    simulator_report r = simulator_summary(s);
    s->report.steps = r.steps;
    s->report.rejected = r.rejected;
    s->report.newton_steps = r.newton_steps;
    s->report.radau_steps = r.radau_steps;
    s->report.evaluations = r.evaluations;
    s->report.factorisations = r.factorisations;
    s->change = simulator_change(s);
    memcpy(s->met, s->I.size, sizeof(double) * (size_t)s->I.nx);
    const int begun = begin_piece(s, s->I.h, s->met);
    if (begun != SIMULATOR_SUCCESS || !s->I.led) return begun;
    if (arrive(s, s->present) != SIMULATOR_SUCCESS) return (int)s->report.status;
    return anew ? still_fits(s) : still_closed(s);
}

/* The motion */

int simulator_set_end(simulator_instance *s, double end) {
    if (isnan(end) || (s->stage != NEW && end < s->I.t)) return said(s, SIMULATOR_BAD_ARGUMENT, "The end must not lie before steps that were taken.");
    s->end = end;
    return SIMULATOR_SUCCESS;
}

/* Of a state at a time. */
static double clearance_at(simulator_instance *s, double t, const double *x) {
    double clear = 0;
    run_plain(s, &model.clear, (const double *const[]){&t, x, s->values[SIMULATOR_INPUT], s->values[SIMULATOR_PARAMETER]}, 4, (double *const[]){&clear}, 1);
    return clear;
}

/* Whether the last step came by a singular position of loops that have none with the values that were exported: the model knows no way through. The present
   time and state are then those next to it. */
static int comes_by_singular(simulator_instance *s) {
    Integrator *I = &s->I;
    const long last = I->steps - I->first, own = I->np - model.constants;
    if (!model.clear.run || last < 1 || !memcmp(s->values[SIMULATOR_PARAMETER], model.quantities[SIMULATOR_PARAMETER].values, sizeof(double) * (size_t)own)) return 0;
    const double begin = I->times[last - 1], h = I->times[last] - begin;
    double t[LOOKS], least = INFINITY, *x = s->values[SIMULATOR_STATE];
    for (int k = 0; k < LOOKS; k++) t[k] = begin + h * (k + 1) / LOOKS;
    if (!(h > 0) || dense(I, LOOKS, t, s->looks) != REACHED_END) return 0;
    double found = t[0];
    for (int k = 0; k < LOOKS; k++) {
        double clear = clearance_at(s, t[k], s->looks + k * I->nx);
        if (clear < least) least = clear, found = t[k];
    }
    double low = fmax(begin, found - h / LOOKS), high = fmin(begin + h, found + h / LOOKS);
    for (int cut = 0; cut < CUTS && least < NEAR && !(least < SINGULAR); cut++) { /* golden section of the larger part */
        double other = high - found > found - low ? found + GOLDEN * (high - found) : found - GOLDEN * (found - low);
        if (state_at(I, other, x) != REACHED_END) break;
        double clear = clearance_at(s, other, x);
        if (clear < least) {
            if (other > found) low = found;
            else high = found;
            least = clear, found = other;
        } else if (other > found) high = other;
        else low = other;
    }
    if (!(least < SINGULAR)) return 0;
    s->present = found;
    state_at(I, found, x);
    return 1;
}

/* One step of the integrator towards a time. */
static int take_step(simulator_instance *s, double towards) {
    Integrator *I = &s->I;
    I->end = isfinite(s->end) ? s->end : towards;
    I->events = s->told = 0;
    enum Code code = (enum Code)advance(I);
    if (code != PAUSED && code != REACHED_END && code != EVENT) return ended(s, code);
    if (I->nx && comes_by_singular(s))
        return failed(s, SIMULATOR_OTHER_MODEL, "Loops come to a singular position, of which they have none with the values that were exported: export a model that is built with these.");
    return SIMULATOR_SUCCESS;
}

/* To the next event that has not been told, if it comes by time t. */
static int next_event(simulator_instance *s, double t) {
    const Integrator *I = &s->I;
    if (s->told >= I->events || I->event_times[s->told] > t) return SIMULATOR_SUCCESS;
    long guard = I->event_guards[s->told];
    s->crossing = (simulator_crossing){guard, (int)I->event_directions[s->told], I->event_times[s->told]};
    s->told++;
    s->present = fmin(s->crossing.time, I->t);
    int stops = model.motion.guard_stops[guard] != 0, status = stops ? read_present(s) : arrive(s, s->present);
    return status != SIMULATOR_SUCCESS ? status : said(s, stops ? SIMULATOR_STOPPED : SIMULATOR_AT_EVENT, 0);
}

/* What keeps an instance from moving to time t; SIMULATOR_SUCCESS when it may go on. */
static int may_move(simulator_instance *s, double t) {
    if (s->stage == NEW) return said(s, SIMULATOR_BAD_ARGUMENT, "There is no motion yet: start it.");
    if (s->stage == FAILED) return (int)s->report.status;
    if (!(t >= s->present) || !(t < INFINITY)) return said(s, SIMULATOR_BAD_ARGUMENT, "Times must be finite and not before the present one.");
    if (t > s->end) return said(s, SIMULATOR_BAD_ARGUMENT, "The time lies beyond the end of the motion.");
    if (s->renewed != NOTHING_NEW) return renew(s);
    if (s->report.status == SIMULATOR_STOPPED) return SIMULATOR_STOPPED;
    return said(s, SIMULATOR_SUCCESS, 0);
}

int simulator_advance(simulator_instance *s, double t) {
    int status = may_move(s, t);
    while (status == SIMULATOR_SUCCESS) {
        status = next_event(s, t);
        if (status != SIMULATOR_SUCCESS) break;
        if (t <= s->I.t) return arrive(s, t);
        status = take_step(s, t);
    }
    return status;
}

int simulator_step(simulator_instance *s, double t) {
    int status = may_move(s, t), taken = 0;
    while (status == SIMULATOR_SUCCESS) {
        status = next_event(s, t);
        if (status != SIMULATOR_SUCCESS) break;
        if (taken || t <= s->I.t || s->present < s->I.t) return arrive(s, fmin(t, s->I.t));
        status = take_step(s, t);
        taken = 1;
    }
    return status;
}

/* Whole motions */

static int refused(simulator_report *report, simulator_status status, const char *message) {
    report->status = status;
    snprintf(report->message, sizeof report->message, "%s", message);
    return (int)status;
}

static int read_times(simulator_instance *s, long n, const double *times, double *states, long *samples) {
    int status = simulator_set_end(s, times[n - 1]);
    for (long k = 0; k < n && status == SIMULATOR_SUCCESS; k++) {
        do status = simulator_advance(s, times[k]);
        while (status == SIMULATOR_AT_EVENT);
        if (status != SIMULATOR_SUCCESS) break;
        simulator_get_all(s, SIMULATOR_STATE, states + k * s->I.nx);
        *samples = k + 1;
    }
    return status;
}

/* What is wrong with times; 0 when nothing is. */
static const char *wrong_times(double t0, long n, const double *times, const double *states) {
    if (n < 1 || !times || !states) return "At least one time is needed, and room for its states.";
    if (!isfinite(t0) || !(times[0] >= t0) || !isfinite(times[n - 1])) return "Times must be finite and not before the start.";
    for (long k = 1; k < n; k++)
        if (!(times[k] >= times[k - 1])) return "Times must be in ascending order.";
    return 0;
}

int simulator_simulate(const simulator_options *options, double t0, const double *x0, const double *u, const double *p, long n,
                       const double *times, double *states, simulator_report *report) {
    simulator_report unread;
    if (!report) report = &unread;
    memset(report, 0, sizeof *report);
    report->time = report->reached = t0;
    const char *wrong = simulator_mistake(options);
    if (!wrong) wrong = wrong_times(t0, n, times, states);
    if (wrong) return refused(report, SIMULATOR_BAD_ARGUMENT, wrong);
    simulator_instance *s = simulator_create(options, 0, 0);
    if (!s) return refused(report, SIMULATOR_OUT_OF_MEMORY, in_words(SIMULATOR_OUT_OF_MEMORY));
    if (u) simulator_set_all(s, SIMULATOR_INPUT, u);
    if (p) simulator_set_all(s, SIMULATOR_PARAMETER, p);
    int status = x0 ? simulator_start_at(s, t0, x0) : simulator_start(s, t0);
    long samples = 0;
    if (status == SIMULATOR_SUCCESS) status = read_times(s, n, times, states, &samples);
    *report = simulator_summary(s);
    report->samples = samples;
    simulator_free(s);
    return status;
}
