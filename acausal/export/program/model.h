/* What model.c holds: the functions of the model, in lanes, and its names and values. */
#ifndef MODEL_H
#define MODEL_H
#include "runtime.h"

/* A function of plain numbers, as CasADi writes them, and the sizes of its work space. */
typedef struct {
    int (*run)(const double **arguments, double **results, long long *iw, double *w, int memory);
    long arguments, results, iw, w;
} PlainFunction;

/* Numbers of one kind: how many, their names, units, and values when the model was exported. */
typedef struct {
    long count;
    const char *const *names, *const *units;
    const double *values;
} Quantities;

typedef struct {
    const char *title;
    Kernel rhs;        /* t, x, u, p -> x' */
    Kernel jvp;        /* t, x, u, p, dx -> df/dx dx */
    Kernel projection; /* t, x, p -> x nearer to the invariants, invariants */
    Kernel clearance;  /* t, x, p -> 0 where branches of the motion cross, about 1 far away */
    Kernel guard;      /* t, x, u, p -> values whose zeros are events */
    Kernel outputs;    /* t, x, u, p -> outputs */
    long width;        /* LANES of model.c */
    Quantities quantities[SIMULATOR_EVENT + 1];
    long invariants, copies, positions, operations;
    Pattern pattern;
    const long *copy_to, *copy_from; /* x'[copy_to] = x[copy_from] */
    const long *guard_direction, *guard_stops;
    long constants;                 /* parameters that follow from the start; they come last */
    PlainFunction assembly;         /* data (conditions, t, u, p without constants) -> x, constants; NaN where there is no such start */
    PlainFunction gaps;             /* t, x, u, p -> gaps of positions, of velocities; size of velocities. run is 0 without constraints */
    PlainFunction holds;            /* t, x, u, p -> not negative where what the model decided holds. run is 0 where nothing can change it */
    const char *depends;            /* on which of the data the start depends */
} Model;

extern EXPORT const Model model;
#endif
