/* Simulates the model from its exported start and prints time, states and outputs: one line of comma-separated values a time. */
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
                    "  method   auto (default), gauss, or radau, for stiff models\n", program);
    return 2;
}

/* The number that a text is; NaN when it is none. */
static double number(const char *text) {
    char *rest;
    double value = strtod(text, &rest);
    return rest == text || *rest ? NAN : value;
}

static void print_names(simulator_kind kind) {
    for (long i = 0; i < simulator_count(kind); i++) printf(",%s", simulator_name(kind, i));
}

static void print_values(simulator_instance *s, simulator_kind kind) {
    for (long i = 0; i < simulator_count(kind); i++) printf(",%.17g", simulator_get(s, kind, i));
}

/* To a time, past events; what ends the motion before is told. */
static int go_to(simulator_instance *s, double t) {
    int status;
    while ((status = simulator_advance(s, t)) == SIMULATOR_AT_EVENT) {
        simulator_crossing event = simulator_event(s);
        fprintf(stderr, "%s at %.17g s\n", simulator_name(SIMULATOR_EVENT, event.event), event.time);
    }
    return status;
}

int main(int count, char **words) {
    if (count < 2 || count > 5) return usage(words[0]);
    simulator_options options = simulator_defaults();
    double end = number(words[1]), wanted = count > 2 ? number(words[2]) : 501;
    if (count > 3) options.rtol = number(words[3]);
    if (count > 4 && strcmp(words[4], "radau") == 0) options.method = SIMULATOR_RADAU;
    else if (count > 4 && strcmp(words[4], "gauss") == 0) options.method = SIMULATOR_GAUSS;
    else if (count > 4 && strcmp(words[4], "auto") != 0) return usage(words[0]);
    if (!(end >= 0) || !isfinite(end) || !(wanted >= 2 && wanted <= 1e8) || wanted != floor(wanted)) return usage(words[0]);
    if (!(options.rtol > 0 && options.rtol < 1)) return usage(words[0]);

    simulator_instance *s = simulator_create(&options, 0, 0);
    if (!s) {
        const char *mistake = simulator_mistake(&options);
        fprintf(stderr, "%s: %s\n", simulator_title(), mistake ? mistake : "Not enough memory.");
        return 1;
    }
    printf("t");
    print_names(SIMULATOR_STATE);
    print_names(SIMULATOR_OUTPUT);
    printf("\n");
    long n = (long)wanted;
    int status = simulator_start(s, 0.0);
    if (status == SIMULATOR_SUCCESS) status = simulator_set_end(s, end);
    for (long k = 0; k < n && status == SIMULATOR_SUCCESS; k++) {
        double t = k == n - 1 ? end : (double)k * (end / (double)(n - 1));
        status = go_to(s, t);
        if (status != SIMULATOR_SUCCESS && status != SIMULATOR_STOPPED) break;
        printf("%.17g", simulator_time(s));
        print_values(s, SIMULATOR_STATE);
        print_values(s, SIMULATOR_OUTPUT);
        printf("\n");
    }
    if (status != SIMULATOR_SUCCESS) {
        simulator_report report = simulator_summary(s);
        fprintf(stderr, "%s: %s Stopped at t = %g s of %g s after %ld steps.", simulator_title(), report.message, report.time, end, report.steps);
        if (status == SIMULATOR_STOPPED) fprintf(stderr, " By: %s.", simulator_name(SIMULATOR_EVENT, simulator_event(s).event));
        if (report.failed_state) fprintf(stderr, " The state that failed first: %s.", report.failed_state);
        fprintf(stderr, "\n");
    }
    simulator_free(s);
    return status == SIMULATOR_SUCCESS || status == SIMULATOR_STOPPED ? 0 : 1;
}
