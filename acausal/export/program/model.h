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
    Integrator motion;              /* what all motions of the model have in common */
    Kernel outputs;                 /* t, x, u, p -> outputs */
    long width;                     /* LANES of model.c */
    Quantities quantities[SIMULATOR_EVENT + 1];
    const char *given;              /* which inputs are tables or formulas */
    const long *rate;               /* of each input: the one that is its rate; -1 where there is none, or it is given */
    const char *const *switches;    /* what switches, in words */
    const char *const *laws;        /* parts that open, stick or slide: one-sided laws, then friction */
    long constants;                 /* parameters that follow from the start; they come last */
    PlainFunction assembly;         /* data (conditions, t, u, p without constants) -> x, constants; NaN where there is no such start */
    PlainFunction gaps;             /* t, x, u (masks among them), p -> gaps of positions, of velocities; size of velocities. run is 0 without constraints */
    PlainFunction holds;            /* t, x, u, p -> not negative where what the model decided holds. run is 0 where nothing can change it */
    PlainFunction clear;            /* t, x, u, p -> how far loops are from singular positions, of which they have none with the values that were exported. run is 0
                                       where no parameter can bring them to any */
    const char *depends;            /* on which of the data the start depends */
} Model;

extern EXPORT const Model model;
#endif
