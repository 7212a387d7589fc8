/* The Functional Mock-up Interface 2.0 for co-simulation (fmi-standard.org) around instances of simulator.h.

   Value references count the variables of modelDescription.xml: states, inputs, parameters, conditions, outputs, in this order. Inputs are constant from one
   communication point to the next, or have the constant rates that are inputs, too; steps in between are as long as accuracy allows. Events that stop the motion end it: fmi2DoStep discards the rest of its step.

   What this interface can have and this unit has not (other types, derivatives of inputs, directional derivatives, serialisation) gives fmi2Error, as
   modelDescription.xml says. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "simulator.h"

#if defined(_WIN32)
#define FMI2 __declspec(dllexport)
#else
#define FMI2 __attribute__((visibility("default")))
#endif

#define GUID "{guid}"

/* Types of the interface, by its names. */
typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef char fmi2Char, fmi2Byte;
typedef const fmi2Char *fmi2String;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

enum phase { MADE, INITIALISING, MOVING, ENDED };

/* Of what a unit is beside its motion. */
struct course {
    enum phase phase;
    int begun, stopped; /* whether the motion has been started with the present values; whether an event has ended it */
    double start, stop; /* [s] */
};

/* A motion, somewhere in the memory that is given back. */
typedef struct {
    simulator_instance *motion;
    void *memory;
} Block;

typedef struct {
    Block block;
    simulator_options options;
    struct course course;
    fmi2CallbackFunctions callbacks;
    char name[120];
} Unit;

/* What may be gone back to. */
typedef struct {
    Block block;
    struct course course;
} Kept;

static void *allocate(const fmi2CallbackFunctions *callbacks, size_t bytes) {
    return callbacks->allocateMemory ? callbacks->allocateMemory(1, bytes) : calloc(1, bytes);
}

static void give_back(const fmi2CallbackFunctions *callbacks, void *memory) {
    if (!memory) return;
    if (callbacks->freeMemory) callbacks->freeMemory(memory);
    else free(memory);
}

/* Tells why. Messages are formats, and not every program fills them: so they have nothing to fill. */
static fmi2Status failed(const Unit *u, fmi2Status status, const char *message) {
    char text[800];
    size_t k = 0;
    for (; *message && k < sizeof text - 2; message++) {
        text[k++] = *message;
        if (*message == '%') text[k++] = '%';
    }
    text[k] = 0;
    if (u->callbacks.logger) u->callbacks.logger(u->callbacks.componentEnvironment, u->name, status, "logStatusError", text);
    return status;
}

static fmi2Status missing(fmi2Component c, const char *what) { return failed((const Unit *)c, fmi2Error, what); }

static Block new_block(const fmi2CallbackFunctions *callbacks, const simulator_options *options) {
    size_t bytes = simulator_size(options);
    Block block = {0, bytes ? allocate(callbacks, bytes) : 0};
    if (block.memory) block.motion = simulator_create(options, block.memory, bytes);
    return block;
}

/* A motion with these options in place of the one that there is, with its numbers. */
static fmi2Status remake(Unit *u, const simulator_options *options) {
    Block block = new_block(&u->callbacks, options);
    if (!block.motion) return failed(u, fmi2Error, simulator_mistake(options) ? simulator_mistake(options) : "There is not enough memory.");
    for (simulator_kind kind = SIMULATOR_INPUT; kind <= SIMULATOR_CONDITION; kind++)
        for (long i = 0; i < simulator_count(kind); i++) simulator_set(block.motion, kind, i, simulator_get(u->block.motion, kind, i));
    give_back(&u->callbacks, u->block.memory);
    u->block = block;
    u->options = *options;
    return fmi2OK;
}

/* Of which kind, and which of it, a value reference is; whether there is such. */
static int found(fmi2ValueReference reference, simulator_kind *kind, long *i) {
    *i = (long)reference;
    for (*kind = SIMULATOR_STATE; *kind <= SIMULATOR_OUTPUT; (*kind)++) {
        if (*i < simulator_count(*kind)) return 1;
        *i -= simulator_count(*kind);
    }
    return 0;
}

static fmi2Status begin(Unit *u) {
    if (u->course.begun) return fmi2OK;
    simulator_set_end(u->block.motion, u->course.stop);
    if (simulator_start(u->block.motion, u->course.start) != SIMULATOR_SUCCESS) return failed(u, fmi2Error, simulator_message(u->block.motion));
    u->course.begun = 1;
    return fmi2OK;
}

static struct course fresh(void) {
    struct course course = {MADE, 0, 0, 0.0, INFINITY};
    return course;
}

FMI2 const char *fmi2GetTypesPlatform(void);
FMI2 const char *fmi2GetTypesPlatform(void) { return "default"; }

FMI2 const char *fmi2GetVersion(void);
FMI2 const char *fmi2GetVersion(void) { return "2.0"; }

FMI2 fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]);
FMI2 fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)c, (void)on, (void)n, (void)categories; /* only failures are told, and these always */
    return fmi2OK;
}

FMI2 fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                                   fmi2Boolean logs);
FMI2 fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                                   fmi2Boolean logs) {
    (void)resources, (void)visible, (void)logs;
    if (!callbacks) return 0;
    Unit *u = (Unit *)allocate(callbacks, sizeof *u);
    if (!u) return 0;
    u->callbacks = *callbacks;
    snprintf(u->name, sizeof u->name, "%s", name ? name : "");
    u->options = simulator_defaults();
    u->course = fresh();
    const char *wrong = type != fmi2CoSimulation ? "This unit is for co-simulation only." : !guid || strcmp(guid, GUID) ? "modelDescription.xml is that of another unit." : 0;
    if (!wrong) u->block = new_block(callbacks, &u->options);
    if (u->block.motion) return u;
    failed(u, fmi2Error, wrong ? wrong : "There is not enough memory.");
    give_back(callbacks, u);
    return 0;
}

FMI2 void fmi2FreeInstance(fmi2Component c);
FMI2 void fmi2FreeInstance(fmi2Component c) {
    Unit *u = (Unit *)c;
    if (!u) return;
    fmi2CallbackFunctions callbacks = u->callbacks;
    give_back(&callbacks, u->block.memory);
    give_back(&callbacks, u);
}

FMI2 fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start, fmi2Boolean has_stop, fmi2Real stop);
FMI2 fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start, fmi2Boolean has_stop, fmi2Real stop) {
    Unit *u = (Unit *)c;
    simulator_options options = u->options;
    if (u->course.phase != MADE) return failed(u, fmi2Error, "The experiment is set up before it is initialised.");
    if (has_stop && !(stop > start)) return failed(u, fmi2Error, "The experiment ends before it starts.");
    options.rtol = has_tolerance ? tolerance : simulator_defaults().rtol;
    u->course.start = start;
    u->course.stop = has_stop ? stop : INFINITY;
    return options.rtol == u->options.rtol ? fmi2OK : remake(u, &options);
}

FMI2 fmi2Status fmi2EnterInitializationMode(fmi2Component c);
FMI2 fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    Unit *u = (Unit *)c;
    if (u->course.phase != MADE) return failed(u, fmi2Error, "This unit has been initialised before; reset it.");
    u->course.phase = INITIALISING;
    return fmi2OK;
}

FMI2 fmi2Status fmi2ExitInitializationMode(fmi2Component c);
FMI2 fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Unit *u = (Unit *)c;
    if (u->course.phase != INITIALISING) return failed(u, fmi2Error, "This unit is not being initialised.");
    fmi2Status status = begin(u);
    if (status == fmi2OK) u->course.phase = MOVING;
    return status;
}

FMI2 fmi2Status fmi2Terminate(fmi2Component c);
FMI2 fmi2Status fmi2Terminate(fmi2Component c) {
    ((Unit *)c)->course.phase = ENDED;
    return fmi2OK;
}

FMI2 fmi2Status fmi2Reset(fmi2Component c);
FMI2 fmi2Status fmi2Reset(fmi2Component c) {
    Unit *u = (Unit *)c;
    simulator_reset(u->block.motion);
    u->course = fresh();
    return fmi2OK;
}

FMI2 fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]);
FMI2 fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    Unit *u = (Unit *)c;
    for (size_t k = 0; k < n; k++) {
        simulator_kind kind;
        long i;
        if (!found(vr[k], &kind, &i)) return failed(u, fmi2Error, "There is no variable with this value reference.");
        if (u->course.phase == INITIALISING && begin(u) != fmi2OK) return fmi2Error;
        value[k] = simulator_get(u->block.motion, kind, i);
    }
    return fmi2OK;
}

FMI2 fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]);
FMI2 fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    Unit *u = (Unit *)c;
    int begins = u->course.phase == MADE || u->course.phase == INITIALISING;
    for (size_t k = 0; k < n; k++) {
        simulator_kind kind;
        long i;
        if (!found(vr[k], &kind, &i)) return failed(u, fmi2Error, "There is no variable with this value reference.");
        if (value[k] == simulator_get(u->block.motion, kind, i)) continue; /* no new piece of the motion */
        int is_given = kind == SIMULATOR_INPUT || kind == SIMULATOR_PARAMETER || (kind == SIMULATOR_CONDITION && begins);
        if (!is_given || !isfinite(value[k]) || simulator_set(u->block.motion, kind, i, value[k]) != SIMULATOR_SUCCESS) {
            char message[400];
            snprintf(message, sizeof message, "%.200s cannot be set to %g%s.", simulator_name(kind, i), value[k], is_given ? "" : " now");
            return failed(u, fmi2Error, message);
        }
        if (begins) u->course.begun = 0;
    }
    return fmi2OK;
}

FMI2 fmi2Status fmi2DoStep(fmi2Component c, fmi2Real from, fmi2Real step, fmi2Boolean never_back);
FMI2 fmi2Status fmi2DoStep(fmi2Component c, fmi2Real from, fmi2Real step, fmi2Boolean never_back) {
    Unit *u = (Unit *)c;
    (void)never_back;
    if (u->course.phase != MOVING) return failed(u, fmi2Error, "A unit moves between its initialisation and its end.");
    if (u->course.stopped) return fmi2Discard;
    double to = from + step;
    int status;
    if (!(step >= 0)) return failed(u, fmi2Error, "A step cannot go back.");
    if (to > u->course.stop) { /* as much further as rounding says, or as whoever asks for it */
        u->course.stop = to;
        simulator_set_end(u->block.motion, to);
    }
    do status = simulator_advance(u->block.motion, to);
    while (status == SIMULATOR_AT_EVENT);
    if (status == SIMULATOR_SUCCESS) return fmi2OK;
    u->course.stopped = status == SIMULATOR_STOPPED;
    return u->course.stopped ? fmi2Discard : failed(u, fmi2Error, simulator_message(u->block.motion));
}

FMI2 fmi2Status fmi2CancelStep(fmi2Component c);
FMI2 fmi2Status fmi2CancelStep(fmi2Component c) { return missing(c, "Steps are over when fmi2DoStep returns."); }

FMI2 fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value);
FMI2 fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    if (kind != fmi2DoStepStatus) return fmi2Discard;
    *value = ((const Unit *)c)->course.stopped ? fmi2Discard : fmi2OK;
    return fmi2OK;
}

FMI2 fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value);
FMI2 fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = simulator_time(((const Unit *)c)->block.motion);
    return fmi2OK;
}

FMI2 fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value);
FMI2 fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

FMI2 fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value);
FMI2 fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = ((const Unit *)c)->course.stopped;
    return fmi2OK;
}

FMI2 fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value);
FMI2 fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

FMI2 fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state);
FMI2 fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    Unit *u = (Unit *)c;
    if (!state || !*state) return fmi2OK;
    give_back(&u->callbacks, ((Kept *)*state)->block.memory);
    give_back(&u->callbacks, *state);
    *state = 0;
    return fmi2OK;
}

FMI2 fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state);
FMI2 fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    Unit *u = (Unit *)c;
    Kept *kept = (Kept *)*state;
    if (!kept) {
        kept = (Kept *)allocate(&u->callbacks, sizeof *kept);
        if (kept) kept->block = new_block(&u->callbacks, &u->options);
        if (kept && !kept->block.motion) {
            give_back(&u->callbacks, kept);
            kept = 0;
        }
        if (!kept) return failed(u, fmi2Error, "There is not enough memory.");
        *state = kept;
    }
    kept->course = u->course;
    return simulator_restore(kept->block.motion, u->block.motion) == SIMULATOR_SUCCESS ? fmi2OK : failed(u, fmi2Error, "This state is that of a unit with another tolerance.");
}

FMI2 fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state);
FMI2 fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    Unit *u = (Unit *)c;
    const Kept *kept = (const Kept *)state;
    if (!kept || simulator_restore(u->block.motion, kept->block.motion) != SIMULATOR_SUCCESS) return failed(u, fmi2Error, "This state is that of a unit with another tolerance.");
    u->course = kept->course;
    return fmi2OK;
}

#define NO_OTHER_TYPES "All variables are real numbers."
#define OTHER_TYPE(Type) \
    FMI2 fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Type value[]); \
    FMI2 fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Type value[]) { \
        (void)vr, (void)value; \
        return n ? missing(c, NO_OTHER_TYPES) : fmi2OK; \
    } \
    FMI2 fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Type value[]); \
    FMI2 fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Type value[]) { \
        (void)vr, (void)value; \
        return n ? missing(c, NO_OTHER_TYPES) : fmi2OK; \
    }
OTHER_TYPE(Integer)
OTHER_TYPE(Boolean)
OTHER_TYPE(String)

#define NOT_SERIALISED "States of this unit belong to the process."
FMI2 fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size);
FMI2 fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)state, (void)size;
    return missing(c, NOT_SERIALISED);
}

FMI2 fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size);
FMI2 fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    (void)state, (void)bytes, (void)size;
    return missing(c, NOT_SERIALISED);
}

FMI2 fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state);
FMI2 fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    (void)state, (void)bytes, (void)size;
    return missing(c, NOT_SERIALISED);
}

FMI2 fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference of[], size_t m, const fmi2ValueReference by[], size_t n, const fmi2Real seed[],
                                             fmi2Real sensitivity[]);
FMI2 fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference of[], size_t m, const fmi2ValueReference by[], size_t n, const fmi2Real seed[],
                                             fmi2Real sensitivity[]) {
    (void)of, (void)m, (void)by, (void)n, (void)seed, (void)sensitivity;
    return missing(c, "This unit has no directional derivatives.");
}

FMI2 fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], const fmi2Real value[]);
FMI2 fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    return n ? missing(c, "Inputs are constant in steps.") : fmi2OK;
}

FMI2 fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], fmi2Real value[]);
FMI2 fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    return n ? missing(c, "This unit has no derivatives of outputs.") : fmi2OK;
}
