/* The integrators: one C file, compiled once for a machine, or together with an exported model. */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <time.h>
#include "runtime.h"
#include <string.h>

/* As the C library's, which compilers call and never inline. */
INLINE double larger(double a, double b) { return a >= b || b != b ? a : b; }
INLINE double smaller(double a, double b) { return a <= b || b != b ? a : b; }
#define fmax larger
#define fmin smaller

#include "interpreter.h"
#include "scalar_math.h"
#include "memory.h"
#include "stages.h"
#include "inputs.h"
#include "passage.h"
#include "sparse.h"
#include "rounding.h"
#include "newton.h"
#include "projection.h"
#include "sensitivity.h"
#include "stiffness.h"
#include "dense.h"
#include "asked.h"
#include "driver.h"
#include "guards.h"
#include "switches.h"
#include "patch.h"
#include "complementary.h"
#include "modes.h"
#include "advance.h"
#include "columns.h"
#include "program.h"

long lanes(void) { return LANES; }

#ifndef ONLY_COMPILED_KERNELS
/* Python, which has the structure once more, is to have the same. */
long integrator_size(void) { return (long)sizeof(Integrator); }

/* The most lanes for which this processor has registers, and all that compilers use with them. */
long widest(void) {
#if defined(__x86_64__)
    if (!(__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2"))) return 2;
    if (!(__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq"))) return 4;
    return __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512cd") ? 8 : 4;
#else
    return LANES;
#endif
}
#endif
