/* The integrators: one C file, compiled once for a machine, or together with an exported model. */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <time.h>
#include "runtime.h"
#include <string.h>
#include "interpreter.h"
#include "memory.h"
#include "stages.h"
#include "passage.h"
#include "newton.h"
#include "projection.h"
#include "sensitivity.h"
#include "driver.h"
#include "dense.h"
#include "guards.h"
#include "advance.h"

long lanes(void) { return LANES; }
