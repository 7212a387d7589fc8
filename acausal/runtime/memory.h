/* Memory of one integration: freed all at once. */
#include <stdlib.h>
#include <string.h>

struct Memory {
    struct Memory *next;
    void *block;
};

static size_t rounded(size_t bytes) { return (bytes + 63) / 64 * 64 + 64; }

/* Zeroed, aligned for any V; null when there is none left. */
static void *reserve(Integrator *I, size_t bytes) {
    struct Memory *m = malloc(sizeof *m);
    if (!m) return 0;
    char *raw = malloc(rounded(bytes) + 64);
    if (!raw) {
        free(m);
        return 0;
    }
    m->block = raw;
    m->next = I->memory;
    I->memory = m;
    char *aligned = raw + (64 - (size_t)raw % 64);
    memset(aligned, 0, rounded(bytes));
    return aligned;
}

static double *reserve_doubles(Integrator *I, long n) { return reserve(I, sizeof(double) * (size_t)n); }
static V *reserve_lanes(Integrator *I, long n) { return reserve(I, sizeof(V) * (size_t)n); }

void finish(Integrator *I) {
    while (I->memory) {
        struct Memory *m = I->memory;
        I->memory = m->next;
        free(m->block);
        free(m);
    }
    free(I->times);
    free(I->states);
    free(I->coefficients);
    free(I->stage_count);
    free(I->offset);
    free(I->event_times);
    free(I->event_guards);
    free(I->event_directions);
    I->times = I->states = I->coefficients = 0;
    I->event_times = 0;
    I->stage_count = I->offset = I->event_guards = I->event_directions = 0;
    I->state = 0;
}
