/* What model.c holds beside the names and values of simulator.h: the functions of the model, in lanes. */
#ifndef MODEL_H
#define MODEL_H
#include "runtime.h"
#include "simulator.h"

extern const Kernel model_rhs_kernel;        /* t, x, u, p -> x' */
extern const Kernel model_jvp_kernel;        /* t, x, u, p, dx -> df/dx dx */
extern const Kernel model_projection_kernel; /* t, x, p -> x nearer to the invariants, invariants */
extern const long model_lanes, model_invariants;
extern const long model_copies, model_copy_to[], model_copy_from[]; /* x'[copy_to] = x[copy_from] */
#endif
