/* Kernels without a compiler: a program of a model's statements, carried out on lanes one after the other with the operations that
   generated C has, so that both give the same bits. See acausal/emit/program.py, which numbers the operations in the order of OPERATIONS.
   The loop over statements stands in statements.h, once for all kinds of values.

   All values of a program stand in one frame: what depends on parameters only, numbers, then values that come and go. The frame is the
   array `c` of the kernel; a statement is five integers, its operation and places in bytes. */
#include "systems.h"
#include "vector_math.h"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpedantic" /* labels as values */

enum { WIDTH = 5 };

/* name, result; A, B, C are operands */
#define OPERATIONS(O) \
    O(NEG, -A) O(SQ, A * A) O(TWICE, A + A) O(INV, v_all(1.0) / A) O(SQRT, v_sqrt(A)) O(FABS, v_abs(A)) \
    O(NOT, v_truth(A == v_all(0.0))) O(SIGN, v_copysign(v_sign(A), A)) O(EXP, v_exp(A)) O(LOG, v_log(A)) O(SIN, v_sin(A)) \
    O(COS, v_cos(A)) O(TAN, v_tan(A)) O(ASIN, v_asin(A)) O(ACOS, v_acos(A)) O(ATAN, v_atan(A)) O(SINH, v_sinh(A)) O(COSH, v_cosh(A)) \
    O(TANH, v_tanh(A)) O(ASINH, v_asinh(A)) O(ACOSH, v_acosh(A)) O(ATANH, v_atanh(A)) O(FLOOR, v_floor(A)) O(CEIL, v_ceil(A)) \
    O(ERF, v_erf(A)) O(ERFINV, v_erfinv(A)) O(LOG1P, v_log1p(A)) O(EXPM1, v_expm1(A)) \
    O(ADD, A + B) O(SUB, A - B) O(MUL, A * B) O(DIV, A / B) O(LT, v_truth(A < B)) O(LE, v_truth(A <= B)) O(EQ, v_truth(A == B)) \
    O(NE, v_truth(A != B)) O(AND, v_truth((A != v_all(0.0)) & (B != v_all(0.0)))) O(OR, v_truth((A != v_all(0.0)) | (B != v_all(0.0)))) \
    O(IF_ELSE_ZERO, v_select(A != v_all(0.0), B, v_all(0.0))) O(POW, v_pow(A, B)) O(FMIN, v_fmin(A, B)) O(FMAX, v_fmax(A, B)) \
    O(FMOD, v_fmod(A, B)) O(REMAINDER, v_remainder(A, B)) O(COPYSIGN, v_copysign(A, B)) O(ATAN2, v_atan2(A, B)) O(HYPOT, v_hypot(A, B)) \
    O(MUL_ADD, A * B + C) O(MUL_SUB, A * B - C) O(SUB_MUL, C - A * B) O(MUL_MUL, A * B * C) O(MOVE, A)

#define INTERPRETER interpret
#define VALUE V
#define OUTSIDE V
#define PARTS 1
#define OF_OUTSIDE(x) (x)
#define TO_OUTSIDE(x) (x)
#define OF_NUMBER(x) (x)
#define ALONG
#define SINCOS v_sincos
#define TABLE OPERATIONS
#define SYSTEM(at, n, m, damped) solve_system(at, n, m, damped)
#include "statements.h"

#include "twofold.h"

#ifndef ONLY_COMPILED_KERNELS
/* Results of a function of one point, lane by lane; lanes that repeat the one before are not evaluated again. */
static void evaluate_lanes(const Kernel *k, const V *in, V *out) {
    for (long l = 0; l < LANES; l++) {
        int repeated = l > 0;
        for (long i = 0; i < k->inputs; i++) {
            repeated &= l > 0 && in[i][l] == in[i][l - 1];
            k->arguments[i] = in[i][l];
        }
        if (!repeated) k->evaluate(k->function);
        for (long i = 0; i < k->outputs; i++) out[i][l] = k->results[i];
    }
}
#endif

/* A kernel's results at `in`. */
static void run_kernel(const Kernel *k, const V *in, V *c, V *out, V *w) {
    if (k->run) k->run(in, c, out, w);
    else if (k->program) (k->twofold ? interpret_twofold : interpret)(k->program, in, c, out);
#ifndef ONLY_COMPILED_KERNELS
    else evaluate_lanes(k, in, out);
#endif
}

/* What of a kernel depends on parameters only. */
static void prepare_kernel(const Kernel *k, const V *in, V *c, V *w) {
    if (k->prepare) k->prepare(in, c, c, w);
    else if (k->program) (k->twofold ? interpret_twofold : interpret)(k->preparation, in, c, c);
}
