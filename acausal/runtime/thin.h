/* Programs for modes that last. While a mode lasts its masks are numbers, mostly zero and one: then a program is carried out once with these, and what is only multiplied by zero or
   one, and what nobody needs then, is left out. What is left are the same operations on the same numbers: nothing of a motion but signs of zeros tells whether that is done.
   Programs may be handed on to the next integration with the same parameters, and whoever has them between integrations may compile them. */

#define THIN_CALLS 24   /* of a kernel in a mode, before a program is made for it */
#define THIN_LONG 20000 /* calls of a compiled kernel, before its program is asked for */
#define THIN_MODES 64   /* whose programs are kept */
#define THIN_LEAST 64   /* statements of a program that is worth it */
#define THIN_GAIN 0.35  /* of the statements of a compiled kernel: so many, interpreted, are no slower */
#define THIN_COMPILED 0.8 /* the same, where the program is compiled, too */

enum Masked { OF_RATES, OF_ROWS, OF_PROJECTION, OF_JACOBIAN, MASKED };

struct ThinMode {
    int *program[MASKED];
    KernelFunction run[MASKED]; /* the program compiled, for its frame as work; null as long as it is not */
    long length[MASKED], calls[MASKED], tried[MASKED], known, still; /* still: nothing is corrected */
    double spent[MASKED]; /* statements carried out, as if all were interpreted */
    signed char *masks; /* 0, 1, -1, or 2: any number */
};

/* Handed on whole, with the frames of programs, which are the same where parameters are. */
struct Programs {
    struct ThinMode mode[THIN_MODES];
    V *frame[MASKED];
    void *room[MASKED];                 /* where frames stand */
    long length[MASKED], asked[MASKED]; /* statements of programs for all modes; whether these have been asked for */
    long next, calls;                   /* of kernels */
};

struct Thin {
    struct Programs *of; /* those that `now` is one of */
    struct ThinMode *now;
    double *sides; /* of the masks of `now` */
    signed char *key;
    long written; /* when sides were given that are those of `now`; -1: they are others */
};

#define NAME_OF(name, result) OP_##name,
enum { OP_END, OP_LOAD, OP_STORE, OP_NUMBER, OP_SINCOS, OPERATIONS(NAME_OF) OP_SYSTEM, OP_SECOND, OP_PLACE, OP_ANSWER };
#undef NAME_OF

/* A value of a program: made by an operation of others; loaded (of[0]: place of the input); one of the frame that stays (OP_PLACE, of[0]); a number; a system
   (rows, columns, damped); an answer of one (of[0]) in a place of its own. */
typedef struct {
    int code, of[3], place, last; /* where it is put; the last statement that needs it */
    int home;                     /* place of a system's operand, which nothing else is put to; -1: it has none */
    long operands, first;         /* of a system: where they begin in `listed`; its first place */
    double number;
} Made;

static int operands_of(int code) { return code < OP_NEG || code > OP_MUL_MUL ? 0 : code < OP_ADD ? 1 : code < OP_MUL_ADD ? 2 : 3; }

static int is_number(const Made *m, double number) { return m->code == OP_NUMBER && m->number == number; }

typedef struct {
    Made *made;
    int count, *listed;
    long list, room; /* operands listed; the next place that systems may have */
} Values;

static int make(Values *v, int code, int a, int b, int c) {
    Made *m = &v->made[v->count];
    *m = (Made){.code = code, .of = {a, b, c}, .place = -1, .last = -1, .home = -1};
    return v->count++;
}

static int make_number(Values *v, double number) {
    int k = make(v, OP_NUMBER, 0, 0, 0);
    v->made[k].number = number;
    return k;
}

/* An operation on numbers. */
static double folded(int code, const double *of) {
    V frame[4] = {v_all(0.0), v_all(of[0]), v_all(of[1]), v_all(of[2])};
    const int unit = (int)sizeof(V), program[2 * WIDTH] = {code, 0, unit, 2 * unit, 3 * unit, OP_END, 0, 0, 0, 0};
    interpret(program, 0, frame, 0);
    return frame[0][0];
}

/* What an operation gives: one of its operands, a number, or a simpler operation, where that is the same. */
static int simplified(Values *v, int code, int a, int b, int c) {
    const Made *m = v->made;
    int count = operands_of(code), known = 1;
    const int of[3] = {a, b, c};
    double numbers[3] = {0, 0, 0};
    for (int k = 0; k < count; k++) {
        known &= m[of[k]].code == OP_NUMBER;
        numbers[k] = m[of[k]].number;
    }
    if (known && count) return make_number(v, folded(code, numbers));
#define IS(x, number) is_number(&m[x], number)
    if (code == OP_MUL || code >= OP_MUL_ADD) { /* of a product, numbers come first */
        if (!IS(a, 0) && (IS(b, 0) || (!IS(a, 1) && IS(b, 1)))) {
            int other = a;
            a = b, b = other;
        }
        int nil = IS(a, 0), one = IS(a, 1);
        switch (code) {
        case OP_MUL:
            if (nil || one) return nil ? a : b;
            break;
        case OP_MUL_ADD:
            if (nil) return c;
            if (one) return simplified(v, OP_ADD, b, c, 0);
            if (IS(c, 0)) return simplified(v, OP_MUL, a, b, 0);
            break;
        case OP_MUL_SUB:
            if (nil) return simplified(v, OP_NEG, c, 0, 0);
            if (one) return simplified(v, OP_SUB, b, c, 0);
            if (IS(c, 0)) return simplified(v, OP_MUL, a, b, 0);
            break;
        case OP_SUB_MUL:
            if (nil) return c;
            if (one) return simplified(v, OP_SUB, c, b, 0);
            if (IS(c, 0)) return simplified(v, OP_NEG, simplified(v, OP_MUL, a, b, 0), 0, 0);
            break;
        default: /* a b c */
            if (nil || IS(c, 0)) return nil ? a : c;
            if (one) return simplified(v, OP_MUL, b, c, 0);
            if (IS(c, 1)) return simplified(v, OP_MUL, a, b, 0);
        }
    }
    if (code == OP_ADD && (IS(a, 0) || IS(b, 0))) return IS(a, 0) ? b : a;
    if (code == OP_SUB && IS(b, 0)) return a;
    if (code == OP_SUB && IS(a, 0)) return make(v, OP_NEG, b, 0, 0);
    if (code == OP_DIV && (IS(a, 0) || IS(b, 1))) return a;
    if (code == OP_IF_ELSE_ZERO && m[a].code == OP_NUMBER) return IS(a, 0) ? a : b;
    if (code == OP_IF_ELSE_ZERO && IS(b, 0)) return b;
    if (code == OP_AND && (IS(a, 0) || IS(b, 0))) return IS(a, 0) ? a : b;
#undef IS
    return make(v, code, a, b, c);
}

/* The value in a place of the frame. */
static int value_in(Values *v, const V *frame, int *at, long place) {
    if (at[place] < 0) {
        double number = frame[place][0];
        at[place] = number == 0 || number == 1 || number == -1 ? make_number(v, number) : make(v, OP_PLACE, (int)place, 0, 0);
    }
    return at[place];
}

/* What stands where a system is (see systems.h). */
typedef struct {
    long n, m, damped, M, damping, right, answer;
} Layout;
static Layout layout_of(long first, long n, long m, long damped) {
    Layout l = {n, m, damped, first + n, first + n + n * n, 0, 0};
    l.right = l.damping + (damped ? n : 0);
    l.answer = l.right + n * m;
    return l;
}
static long room_of_system(long n, long m, long damped) { return layout_of(0, n, m, damped).answer + n * m + n * n + n * m + (damped ? 2 * n * m : 0) + n; }

/* A system of the rows alone that are active with these masks; what is known of others goes to its right side. */
static void make_system(Values *v, const V *frame, int *at, const int *s, int *active) {
    long first = s[1] / (long)sizeof(V), n = s[2], m = s[3], damped = s[4], k = 0;
    Layout l = layout_of(first, n, m, damped);
    for (long i = 0; i < n; i++) {
        int on = value_in(v, frame, at, first + i);
        if (!is_number(&v->made[on], 0)) active[k++] = (int)i;
        else
            for (long c = 0; c < m; c++) at[l.answer + i * m + c] = value_in(v, frame, at, l.right + i * m + c);
    }
    if (!k) return;
    int *list = v->listed + v->list, one = make_number(v, 1), system;
    long q = 0;
    for (long a = 0; a < k; a++) list[q++] = one;
    for (long a = 0; a < k; a++)
        for (long b = 0; b < k; b++) list[q++] = value_in(v, frame, at, l.M + active[a] * n + active[b]);
    for (long a = 0; a < k && damped; a++) list[q++] = value_in(v, frame, at, l.damping + active[a]);
    for (long a = 0; a < k; a++)
        for (long c = 0; c < m; c++) {
            int right = value_in(v, frame, at, l.right + active[a] * m + c);
            for (long j = 0, next = 0; j < n; j++) {
                if (next < k && active[next] == j) {
                    next++;
                    continue;
                }
                int known = at[l.answer + j * m + c];
                if (!is_number(&v->made[known], 0)) right = simplified(v, OP_SUB_MUL, value_in(v, frame, at, l.M + active[a] * n + j), known, right);
            }
            list[q++] = right;
        }
    system = make(v, OP_SYSTEM, (int)k, (int)m, (int)damped);
    v->made[system].operands = v->list;
    v->made[system].first = v->room;
    v->list += q;
    for (long a = 0; a < k; a++)
        for (long c = 0; c < m; c++) {
            int answer = make(v, OP_ANSWER, system, 0, 0);
            v->made[answer].place = (int)((layout_of(v->room, k, m, damped).answer + a * m + c) * (long)sizeof(V));
            at[l.answer + active[a] * m + c] = answer;
        }
    v->room += room_of_system(k, m, damped);
}

/* The values that a program makes, by masks that are inputs from `first` on, and the results (place, value, ...) into `stores`; how many results. `at`: value in each place of the frame. */
static long follow_program(const int *program, const V *frame, long first, long masks, const signed char *key, int *at, int *active, Values *v, int *stores) {
    const int unit = (int)sizeof(V);
    long results = 0;
    for (const int *s = program; *s != OP_END; s += WIDTH) {
        int code = *s, of[3] = {0, 0, 0}, to = s[1] / unit, count = code == OP_STORE || code == OP_SINCOS || code == OP_MOVE ? 1 : operands_of(code);
        for (int k = 0; k < count; k++) of[k] = value_in(v, frame, at, s[2 + k] / unit);
        if (code == OP_MOVE) {
            at[to] = of[0];
        } else if (code == OP_SYSTEM) {
            make_system(v, frame, at, s, active);
        } else if (code == OP_STORE) {
            stores[2 * results] = s[1];
            stores[2 * results++ + 1] = of[0];
        } else if (code == OP_NUMBER) {
            double number;
            memcpy(&number, s + 2, sizeof number);
            at[to] = make_number(v, number);
        } else if (code == OP_LOAD) {
            long mask = s[2] / unit - first;
            int fixed = mask >= 0 && mask < masks && key[mask] != 2;
            at[to] = fixed ? make_number(v, key[mask]) : make(v, OP_LOAD, s[2], 0, 0);
        } else if (code == OP_SINCOS) {
            at[to] = make(v, OP_SINCOS, of[0], 0, 0);
            at[s[3] / unit] = make(v, OP_SECOND, at[to], 0, 0);
        } else {
            at[to] = simplified(v, code, of[0], of[1], of[2]);
        }
    }
    return results;
}

static long operands_in(const Made *m) {
    if (m->code == OP_SYSTEM) return layout_of(0, m->of[0], m->of[1], m->of[2]).answer;
    return m->code == OP_SINCOS || m->code == OP_SECOND || m->code == OP_ANSWER ? 1 : operands_of(m->code);
}
static int operand_in(const Values *v, const Made *m, long j) { return m->code == OP_SYSTEM ? v->listed[m->operands + j] : m->of[j]; }

/* The last statement that needs each value, by the numbers of values; results are needed by the end. */
static void find_last(Values *v, const int *stores, long results) {
    for (long k = 0; k < results; k++) v->made[stores[2 * k + 1]].last = v->count;
    for (int k = v->count - 1; k >= 0; k--) {
        const Made *m = &v->made[k];
        if (m->last < 0) continue;
        long count = operands_in(m);
        for (long j = 0; j < count; j++) {
            Made *of = &v->made[operand_in(v, m, j)];
            if (of->last < k) of->last = k;
        }
    }
}

/* Operands of systems are made where these need them. */
static void find_homes(Values *v) {
    for (int k = 0; k < v->count; k++) {
        const Made *m = &v->made[k];
        if (m->code != OP_SYSTEM || m->last < 0) continue;
        for (long q = 0; q < operands_in(m); q++) {
            Made *of = &v->made[operand_in(v, m, q)];
            int anywhere = of->code != OP_PLACE && of->code != OP_ANSWER && of->code != OP_SINCOS && of->code != OP_SECOND;
            if (anywhere && of->home < 0) of->home = (int)((m->first + q) * (long)sizeof(V));
        }
    }
}

/* The statements of what is needed, places from `first` on being free up to `room`, but for those of systems from `begin` on; their number, 0 where places do not suffice. */
static long write_program(Values *v, const int *stores, long results, int first, int begin, int room, int *free, int *program) {
    const int unit = (int)sizeof(V);
    int left = 0, *s = program;
    for (int k = room; k > first; k--)
        if (k - 1 < begin || k - 1 >= v->room) free[left++] = k - 1;
    for (int k = 0; k < v->count; k++) {
        Made *m = &v->made[k];
        if (m->last < 0 || m->code == OP_SECOND || m->code == OP_ANSWER) continue;
        if (m->code == OP_PLACE) {
            m->place = m->of[0] * unit;
            continue;
        }
        long count = operands_in(m);
        for (long j = 0; j < count && m->code == OP_SYSTEM; j++) {
            const Made *of = &v->made[operand_in(v, m, j)];
            int to = (int)(m->first + j) * unit;
            if (of->place == to) continue;
            s[0] = OP_MOVE, s[1] = to, s[2] = of->place, s[3] = s[4] = 0;
            s += WIDTH;
        }
        s[0] = m->code;
        for (int j = 0; j < 3; j++) s[2 + j] = m->code == OP_SYSTEM ? m->of[j] : j < count ? v->made[m->of[j]].place : 0;
        for (long j = 0; j < count; j++) { /* whose last need this is */
            Made *old = &v->made[operand_in(v, m, j)];
            if (old->last == k && old->code != OP_PLACE && old->code != OP_ANSWER && old->home < 0 && old->place >= 0) free[left++] = old->place / unit, old->last = -2;
        }
        if (left < 2) return 0;
        m->place = m->code == OP_SYSTEM ? (int)m->first * unit : m->home >= 0 ? m->home : free[--left] * unit;
        s[1] = m->place;
        if (m->code == OP_LOAD) s[2] = m->of[0];
        if (m->code == OP_NUMBER) memcpy(s + 2, &m->number, sizeof m->number);
        if (m->code == OP_SINCOS) {
            Made *second = &v->made[k + 1];
            int place = free[--left];
            s[3] = second->place = place * unit;
            if (second->last < 0) free[left++] = place;
            if (m->last <= k + 1) free[left++] = m->place / unit;
        }
        s += WIDTH;
    }
    for (long k = 0; k < results; k++, s += WIDTH) {
        s[0] = OP_STORE;
        s[1] = stores[2 * k];
        s[2] = v->made[stores[2 * k + 1]].place;
        s[3] = s[4] = 0;
    }
    memset(s, 0, sizeof(int) * WIDTH);
    return (s - program) / WIDTH;
}

/* How many places, from the first one on, hold what a program needs and does not make, whatever the masks are; `made`: room for all places. */
static int lasting_places(const int *program, int *made) {
    const int unit = (int)sizeof(V);
    int lasting = 0;
    for (const int *s = program; *s != OP_END; s += WIDTH) {
        int code = *s;
        if (code == OP_SYSTEM) {
            Layout l = layout_of(s[1] / unit, s[2], s[3], s[4]);
            for (long k = s[1] / unit; k < l.answer; k++)
                if (!made[k] && k >= lasting) lasting = (int)k + 1;
            for (long k = 0; k < l.n * l.m; k++) made[l.answer + k] = 1;
            continue;
        }
        int count = code == OP_STORE || code == OP_SINCOS || code == OP_MOVE ? 1 : operands_of(code);
        for (int k = 0; k < count; k++) {
            int place = s[2 + k] / unit;
            if (!made[place] && place >= lasting) lasting = place + 1;
        }
        if (code != OP_STORE) made[s[1] / unit] = 1;
        if (code == OP_SINCOS) made[s[3] / unit] = 1;
    }
    return lasting;
}

static long thin_frame(const Kernel *k) { return 2 * k->constants + 64; }

/* Whether the first so many results are the inputs behind the first one. */
static long are_inputs(const Values *v, const int *stores, long results, long count) {
    const int unit = (int)sizeof(V);
    long same = 0;
    for (long k = 0; k < results; k++) {
        const Made *m = &v->made[stores[2 * k + 1]];
        if (stores[2 * k] < count * unit) same += m->code == OP_LOAD && m->of[0] == stores[2 * k] + unit;
    }
    return same == count;
}

/* The program of a kernel with these masks, null where it cannot be made; `still`: whether it leaves the first so many inputs behind the first as they are. */
static int *thinned(const Kernel *k, const V *frame, long first, long masks, const signed char *key, long statements, long *length, long states, long *still) {
    long places = thin_frame(k), operands = 0, widest = 0, updates = 0;
    for (const int *s = k->program; *s != OP_END; s += WIDTH) {
        if (*s != OP_SYSTEM) continue;
        operands += layout_of(0, s[2], s[3], s[4]).answer;
        updates += 2L * s[2] * (s[2] + 1) * s[3] + 2;
        if (s[2] > widest) widest = s[2];
    }
    long most = 2 * statements + places + updates;
    Values v = {.made = malloc(sizeof(Made) * (size_t)most), .room = k->constants, .listed = malloc(sizeof(int) * (size_t)(operands + 1))};
    int *room = malloc(sizeof(int) * (size_t)(2 * places + 2 * k->outputs + 2 + widest)), *program = malloc(sizeof(int) * (size_t)(WIDTH * (most + operands + 1)));
    *length = 0;
    if (v.made && v.listed && room && program) {
        int *at = room, *free_places = at + places, *stores = free_places + places, *active = stores + 2 * k->outputs + 2;
        memset(at, 0, sizeof(int) * (size_t)places);
        int lasting = lasting_places(k->program, at);
        for (long j = 0; j < places; j++) at[j] = -1;
        long results = follow_program(k->program, frame, first, masks, key, at, active, &v, stores);
        find_last(&v, stores, results);
        find_homes(&v);
        *still = are_inputs(&v, stores, results, states);
        *length = write_program(&v, stores, results, lasting, (int)k->constants, (int)places, free_places, program);
    }
    free(v.made);
    free(v.listed);
    free(room);
    if (*length) return program;
    free(program);
    return 0;
}

long lasting_program(const struct Programs *P, long from, double spent, struct Lasting *found) {
    for (long k = from; k < THIN_MODES * MASKED; k++) {
        const struct ThinMode *mode = &P->mode[k / MASKED];
        long which = k % MASKED;
        if (!mode->program[which] || mode->run[which] || mode->spent[which] < spent) continue;
        *found = (struct Lasting){mode->program[which], mode->length[which], mode->spent[which]};
        return k;
    }
    return -1;
}

void take_compiled(struct Programs *P, long at, KernelFunction run) { P->mode[at / MASKED].run[at % MASKED] = run; }

void forget_programs(struct Programs *P) {
    if (!P) return;
    for (int which = 0; which < MASKED; which++) {
        for (long k = 0; k < THIN_MODES; k++) free(P->mode[k].program[which]);
        free(P->room[which]);
    }
    free(P);
}

/* Only where memory may be allocated. */
static int make_thin(Integrator *I) {
    struct State *T = I->state;
    if (I->block || I->counted) return 1;
    struct Thin *H = reserve(I, sizeof(struct Thin));
    if (!H || !(H->key = reserve(I, (size_t)I->masks + 1)) || !(H->sides = reserve_doubles(I, I->masks))) return 0;
    T->thin = H;
    return 1;
}

static Kernel *kernel_with_masks(Integrator *I, enum Masked which) {
    Kernel *kernels[MASKED] = {&I->rhs, &I->rows, &I->projection, &I->jvp};
    return kernels[which];
}

/* The kernel for all modes as a program; null where there is none. */
static const Kernel *whole_program(Integrator *I, enum Masked which) {
    const Kernel *k = kernel_with_masks(I, which), *programs[MASKED] = {&I->rhs_program, &I->rows_program, &I->projection_program, &I->jvp_program}, *whole = programs[which];
    if (k->evaluate) return 0;
    if (k->program) whole = k;
    else if (!whole->program && I->lacking) I->lacking(PROGRAMS + (long)which);
    return whole->program && !whole->twofold ? whole : 0;
}

/* The frame of a program for all modes; whether there is one that is worth it. */
static int has_frame(Integrator *I, enum Masked which) {
    struct Programs *P = I->programs;
    if (P->asked[which]) return P->length[which] > 0;
    P->asked[which] = 1;
    const Kernel *whole = whole_program(I, which);
    long length = 0, fixed = 1 + I->nx + I->nu - (which == OF_PROJECTION ? I->held - I->masks : 0);
    if (!whole) return 0;
    while (whole->program[WIDTH * length] != OP_END) length++;
    if (length < THIN_LEAST || !(P->room[which] = malloc(sizeof(V) * (size_t)(thin_frame(whole) + whole->inputs + 1) + 64))) return 0;
    V *frame = (V *)(void *)aligned(P->room[which]), *in = frame + thin_frame(whole);
    memset(frame, 0, sizeof(V) * (size_t)(thin_frame(whole) + whole->inputs + 1));
    for (long i = 0; i < I->np; i++) in[fixed + i] = v_all(I->parameters[i]);
    interpret(whole->preparation, in, frame, frame);
    P->frame[which] = frame;
    P->length[which] = length;
    return 1;
}

/* The programs that the caller has given, or new ones; null when memory is short. */
static struct Programs *programs_of(Integrator *I) {
    struct Thin *H = I->state->thin;
    if (!I->programs) {
        struct Programs *P = I->programs = calloc(1, sizeof(struct Programs) + (size_t)(THIN_MODES * I->masks));
        for (long k = 0; P && k < THIN_MODES; k++) P->mode[k].masks = (signed char *)(P + 1) + k * I->masks;
    }
    if (H->of != I->programs) H->now = 0;
    return H->of = I->programs;
}

/* The entry of masks; the oldest one gives way to a new one. */
static void look_up_mode(const Integrator *I, const V *masks) {
    struct Thin *H = I->state->thin;
    for (long k = 0; k < I->masks; k++) {
        double side = masks[k][0];
        H->sides[k] = side;
        H->key[k] = side == 0 ? 0 : side == 1 ? 1 : side == -1 ? -1 : 2;
    }
    struct Programs *P = I->programs;
    for (long k = 0; k < THIN_MODES; k++)
        if (P->mode[k].known && memcmp(P->mode[k].masks, H->key, (size_t)I->masks) == 0) {
            H->now = &P->mode[k];
            return;
        }
    struct ThinMode *new = H->now = &P->mode[P->next++ % THIN_MODES];
    for (int which = 0; which < MASKED; which++) {
        free(new->program[which]);
        new->program[which] = 0;
        new->run[which] = 0;
        new->spent[which] = 0;
        new->length[which] = new->calls[which] = new->tried[which] = 0;
    }
    new->known = 1;
    new->still = 0;
    memcpy(new->masks, H->key, (size_t)I->masks);
}

/* Whether these sides are those that were given last. */
static int are_given(const struct State *T, const V *there) {
    for (long k = 0; k < T->holders && k < HOLDERS; k++)
        if (T->holder[k] == there) return 1;
    return 0;
}

/* Looks at the masks of `in`, unless nothing can have changed since: asked before each kernel. */
static void follow_masks(Integrator *I, const V *in, long first) {
    struct Thin *H = I->state->thin;
    int given = are_given(I->state, in + first);
    if (H->now && given && H->written == I->state->written) return;
    int other = !H->now;
    for (long k = 0; k < I->masks; k++) other |= in[first + k][0] != H->sides[k];
    if (other) look_up_mode(I, in + first);
    H->written = given ? I->state->written : -1;
}

/* The mode of the masks at `in`, the same in all lanes, if its program is to be carried out; null: the kernel itself is to be taken. */
static struct ThinMode *thin_mode(Integrator *I, enum Masked which, const V *in) {
    struct Thin *H = I->state->thin;
    long first = 1 + I->nx + I->nu - I->held;
    struct Programs *P = programs_of(I);
    if (!P) return 0;
    follow_masks(I, in, first);
    struct ThinMode *now = H->now;
    const Kernel *k = kernel_with_masks(I, which);
    P->calls++;
    if (!now->tried[which] && ++now->calls[which] >= THIN_CALLS && (k->program || P->asked[which] || P->calls > THIN_LONG)) {
        now->tried[which] = 1;
        long still = 0;
        const Kernel *whole = has_frame(I, which) ? whole_program(I, which) : 0;
        if (whole) now->program[which] = thinned(whole, P->frame[which], first, I->masks, now->masks, P->length[which], &now->length[which], I->nx, &still);
        if (which == OF_PROJECTION) now->still = still;
    }
    if (!now->program[which]) return 0;
    double length = (double)now->length[which], whole = (double)P->length[which];
    if (now->run[which]) return now;
    if (length >= (k->run ? THIN_COMPILED : 1) * whole) return 0;
    int interpreted = length < (k->run ? THIN_GAIN : 1) * whole;
    now->spent[which] += interpreted ? length : THIN_GAIN * whole;
    return interpreted ? now : 0;
}

/* Whether nothing is corrected in this mode. */
static int is_still(const Integrator *I) {
    const struct Thin *H = I->state->thin;
    return H && H->now && H->of == I->programs && H->now->still && memcmp(H->sides, I->state->side, sizeof(double) * (size_t)I->masks) == 0;
}

/* Results at `in` of a kernel that has masks, if there are any. */
static void run_masked(Integrator *I, enum Masked which, const V *in, V *c, V *out) {
    struct Thin *H = I->state->thin;
    const struct ThinMode *mode = H ? thin_mode(I, which, in) : 0;
    if (mode && mode->run[which]) mode->run[which](in, H->of->frame[which], out, H->of->frame[which]);
    else if (mode) interpret(mode->program[which], in, H->of->frame[which], out);
    else run_kernel(kernel_with_masks(I, which), in, c, out, I->state->work);
}
