/* What model.c holds beside the names and values of simulator.h: the functions of the model, in lanes. */
#ifndef MODEL_H
#define MODEL_H
#include "runtime.h"

/* A function of plain numbers, as CasADi writes them, and the sizes of its work space. */
typedef struct {
    int (*run)(const double **arguments, double **results, long long *iw, double *w, int memory);
    long arguments, results, iw, w;
} PlainFunction;

typedef struct {
    Kernel rhs;        /* t, x, u, p -> x' */
    Kernel jvp;        /* t, x, u, p, dx -> df/dx dx */
    Kernel projection; /* t, x, p -> x nearer to the invariants, invariants */
    Kernel clearance;  /* t, x, p -> 0 where branches of the motion cross, about 1 far away */
    long width;        /* LANES of model.c */
    long states, inputs, parameters, invariants, copies, positions;
    const long *copy_to, *copy_from; /* x'[copy_to] = x[copy_from] */
    const char *const *state_names;
    const double *start, *input_values, *parameter_values;
    long conditions, constants;     /* constants: parameters that follow from the start; they come last */
    const double *condition_values;
    PlainFunction assembly;         /* data (conditions, t, u, p without constants) -> x, constants; NaN where there is no such start */
    PlainFunction gaps;             /* t, x, u, p -> gaps of positions, of velocities; size of velocities. run is 0 without constraints */
    PlainFunction holds;            /* t, x, u, p -> not negative where what the model decided holds. run is 0 where nothing can change it */
    const char *depends;            /* on which of the data the start depends */
} Model;

extern EXPORT const Model model;
#endif
