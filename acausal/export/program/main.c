/* Simulates the model from its exported start and prints the states: one line of comma-separated values a time. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "simulator.h"

static int usage(const char *program) {
    fprintf(stderr, "usage: %s end [samples] [rtol] [method]\n"
                    "  end      time to stop at [s]; the start is at 0\n"
                    "  samples  equally spaced times, both ends included: 2 or more (501)\n"
                    "  rtol     relative and absolute error per step (1e-8)\n"
                    "  method   gauss (default) or radau, for stiff models\n", program);
    return 2;
}

/* The number that a text is; NaN when it is none. */
static double number(const char *text) {
    char *rest;
    double value = strtod(text, &rest);
    return rest == text || *rest ? NAN : value;
}

int main(int count, char **words) {
    if (count < 2 || count > 5) return usage(words[0]);
    SimulatorOptions options = simulator_defaults();
    double end = number(words[1]), wanted = count > 2 ? number(words[2]) : 501;
    if (count > 3) options.rtol = number(words[3]);
    if (count > 4 && strcmp(words[4], "radau") == 0) options.method = SIMULATOR_RADAU;
    else if (count > 4 && strcmp(words[4], "gauss") != 0) return usage(words[0]);
    if (!(end >= 0) || !isfinite(end) || !(wanted >= 2 && wanted <= 1e8) || wanted != floor(wanted)) return usage(words[0]);
    if (!(options.rtol > 0 && options.rtol < 1)) return usage(words[0]);

    long n = (long)wanted;
    double *times = malloc(sizeof(double) * (size_t)n), *states = malloc(sizeof(double) * (size_t)(n * model_states));
    if (!times || !states) {
        fprintf(stderr, "%s: not enough memory for %ld samples.\n", model_title, n);
        return 1;
    }
    for (long k = 0; k < n; k++) times[k] = (double)k * (end / (double)(n - 1));
    times[n - 1] = end;
    SimulatorReport report;
    simulate(&options, 0.0, 0, 0, 0, n, times, states, &report);

    printf("t");
    for (long i = 0; i < model_states; i++) printf(",%s", model_state_names[i]);
    printf("\n");
    for (long k = 0; k < report.samples; k++) {
        printf("%.17g", times[k]);
        for (long i = 0; i < model_states; i++) printf(",%.17g", states[k * model_states + i]);
        printf("\n");
    }
    if (report.status != SIMULATOR_SUCCESS) {
        fprintf(stderr, "%s: %s Stopped at t = %g s of %g s after %ld steps.", model_title, report.message, report.time, end, report.steps);
        if (report.failed_state) fprintf(stderr, " The state that failed first: %s.", report.failed_state);
        fprintf(stderr, "\n");
    }
    free(times);
    free(states);
    return report.status == SIMULATOR_SUCCESS ? 0 : 1;
}
