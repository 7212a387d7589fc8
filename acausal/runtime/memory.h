/* Memory of one integration. Arrays are taken one after the other, and given back all together: from one block, where the caller gave one,
   and otherwise from blocks that are allocated as they are needed. Structures that hold pointers begin with them, so that a block can be
   copied and used elsewhere. */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

struct Memory {
    struct Memory *next;
    void *block;
};

static size_t rounded(size_t bytes) { return (bytes + 63) / 64 * 64 + 64; }

static char *aligned(char *at) { return at + (64 - (size_t)at % 64) % 64; }

/* Zeroed, aligned for any V; null when there is none left. What is only `counted` is not to be written. */
static void *reserve(Integrator *I, size_t bytes) {
    size_t whole = rounded(bytes);
    I->used += whole;
    if (I->counted) return 0;
    if (I->block) return I->used + 64 <= I->room ? memset(aligned(I->block) + I->used - whole, 0, whole) : 0;
    struct Memory *m = malloc(sizeof *m);
    if (!m) return 0;
    char *raw = malloc(whole + 64);
    if (!raw) {
        free(m);
        return 0;
    }
    m->block = raw;
    m->next = I->memory;
    I->memory = m;
    return memset(aligned(raw), 0, whole);
}

static double *reserve_doubles(Integrator *I, long n) { return reserve(I, sizeof(double) * (size_t)n); }
static V *reserve_lanes(Integrator *I, long n) { return reserve(I, sizeof(V) * (size_t)n); }

/* Pointers between two places in a structure that lead into a block of `size` bytes, made to lead to the same places of its copy. */
static void redirect(void *structure, size_t first, size_t end, const char *block, size_t size, char *copy) {
    for (char *at = (char *)structure + first; at < (char *)structure + end; at += sizeof(char *)) {
        char *p;
        memcpy(&p, at, sizeof p);
        if (p < block || p >= block + size) continue;
        p = copy + (p - block);
        memcpy(at, &p, sizeof p);
    }
}

/* All of it but programs that may be handed on. */
void finish(Integrator *I) {
    while (I->memory) {
        struct Memory *m = I->memory;
        I->memory = m->next;
        free(m->block);
        free(m);
    }
    if (!I->block) {
        void *kept[] = {I->times, I->states, I->coefficients, I->step_sides, I->stage_count, I->offset, I->kinds, I->event_times, I->event_guards, I->event_directions, I->transition_steps, I->transition_rows, I->impulses, I->transition_masks};
        for (size_t k = 0; k < sizeof kept / sizeof *kept; k++) free(kept[k]);
    }
    I->times = I->states = I->coefficients = I->step_sides = I->event_times = I->impulses = I->transition_masks = 0;
    I->stage_count = I->offset = I->kinds = I->event_guards = I->event_directions = I->transition_steps = I->transition_rows = 0;
    I->state = 0;
}
