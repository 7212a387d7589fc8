/* Names that other files than their own use. They stay inside the library or program that these files become, and cannot be taken for
   those of others. */
#ifndef NAMES_H
#define NAMES_H
#ifdef __ELF__ /* seen by others, but never taken for theirs: two libraries may have the same names */
#define SIMULATOR_API __attribute__((visibility("protected")))
#endif
#include "simulator.h"

#define ONLY_COMPILED_KERNELS
#define EXPORT __attribute__((visibility("hidden")))
#define begin simulator_hidden_begin
#define needed simulator_hidden_needed
#define moved_integration simulator_hidden_moved
#define advance simulator_hidden_advance
#define use_newton simulator_hidden_use_newton
#define exchange simulator_hidden_exchange
#define finish simulator_hidden_finish
#define forget_programs simulator_hidden_forget_programs
#define lasting_program simulator_hidden_lasting_program
#define take_compiled simulator_hidden_take_compiled
#define dense simulator_hidden_dense
#define state_at simulator_hidden_state_at
#define settle_modes simulator_hidden_settle_modes
#define remember simulator_hidden_remember
#define unsettled simulator_hidden_unsettled
#define masks_at simulator_hidden_masks_at
#define last_transition simulator_hidden_last_transition
#define table_value simulator_hidden_table_value
#define lanes simulator_hidden_lanes
#define model simulator_hidden_model
#endif
