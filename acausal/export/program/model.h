/* What model.c holds beside the names and values of simulator.h: the functions of the model, in lanes. */
#ifndef MODEL_H
#define MODEL_H
#include "runtime.h"

typedef struct {
    Kernel rhs;        /* t, x, u, p -> x' */
    Kernel jvp;        /* t, x, u, p, dx -> df/dx dx */
    Kernel projection; /* t, x, p -> x nearer to the invariants, invariants */
    long width;        /* LANES of model.c */
    long states, inputs, parameters, invariants, copies;
    const long *copy_to, *copy_from; /* x'[copy_to] = x[copy_from] */
    const char *const *state_names;
    const double *start, *input_values, *parameter_values;
} Model;

extern EXPORT const Model model;
#endif
