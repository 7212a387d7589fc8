/* Names that other files than their own use. They stay inside the library or program that these files become, and cannot be taken for
   those of others: all begin with `simulator_`, after SIMULATOR_PREFIX where that is set (see simulator.h). */
#ifndef NAMES_H
#define NAMES_H
#include "simulator.h"

#define ONLY_COMPILED_KERNELS
#define EXPORT __attribute__((visibility("hidden")))
#define begin SIMULATOR_NAME(simulator_begin)
#define needed SIMULATOR_NAME(simulator_needed)
#define moved_integration SIMULATOR_NAME(simulator_moved_integration)
#define advance SIMULATOR_NAME(simulator_advance)
#define use_newton SIMULATOR_NAME(simulator_use_newton)
#define exchange SIMULATOR_NAME(simulator_exchange)
#define finish SIMULATOR_NAME(simulator_finish)
#define dense SIMULATOR_NAME(simulator_dense)
#define project_states SIMULATOR_NAME(simulator_project_states)
#define lanes SIMULATOR_NAME(simulator_lanes)
#define model SIMULATOR_NAME(simulator_model)
#endif
