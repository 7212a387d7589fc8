/* Programs for modes that last. While a mode lasts its masks are numbers, mostly zero and one: then a program is carried out once with these, and what is only multiplied by zero or
   one, and what nobody needs then, is left out. What is left are the same operations on the same numbers: nothing of a motion but signs of zeros tells whether that is done. */

#define THIN_CALLS 24   /* of a kernel in a mode, before a program is made for it */
#define THIN_LONG 20000 /* calls of a compiled kernel, before its program is asked for */
#define THIN_MODES 64   /* whose programs are kept */
#define THIN_LEAST 64   /* statements of a program that is worth it */
#define THIN_GAIN 0.35  /* of the statements of a compiled kernel: so many, interpreted, are no slower */

enum Masked { OF_RATES, OF_ROWS, OF_PROJECTION, OF_JACOBIAN, MASKED };

struct ThinMode {
    int *program[MASKED];
    long length[MASKED], calls[MASKED], tried[MASKED], known;
    signed char *masks; /* 0, 1, -1, or 2: any number */
};

struct Thin {
    struct ThinMode mode[THIN_MODES], *now;
    long next, length[MASKED], asked[MASKED], calls[MASKED]; /* statements of programs for all modes; whether these have been asked for; calls of kernels */
    Kernel whole[MASKED];
    V *frame[MASKED];
    double *side; /* masks of `now` */
    signed char *key;
};

#define NAME_OF(name, result) OP_##name,
enum { OP_END, OP_LOAD, OP_STORE, OP_NUMBER, OP_SINCOS, OPERATIONS(NAME_OF) OP_SECOND, OP_PLACE };
#undef NAME_OF

/* A value of a program: made by an operation of others; loaded (of[0]: place of the input); one of the frame that stays (OP_PLACE, of[0]); a number. */
typedef struct {
    int code, of[3], place, last; /* where it is put; the last statement that needs it */
    double number;
} Made;

static int operands_of(int code) { return code < OP_NEG || code > OP_MUL_MUL ? 0 : code < OP_ADD ? 1 : code < OP_MUL_ADD ? 2 : 3; }

static int is_number(const Made *m, double number) { return m->code == OP_NUMBER && m->number == number; }

typedef struct {
    Made *made;
    int count;
} Values;

static int make(Values *v, int code, int a, int b, int c) {
    Made *m = &v->made[v->count];
    *m = (Made){code, {a, b, c}, -1, -1, 0};
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

/* The values that a program makes, by masks that are inputs from `first` on, and the results (place, value, ...) into `stores`; how many results. `at`: value in each place of the frame;
   `lasting`: how many places of the frame stay as they are, those of numbers that are written out here too, since programs of other modes read them. */
static long follow_program(const int *program, const V *frame, long first, long masks, const signed char *key, int *at, Values *v, int *stores, int *lasting) {
    const int unit = (int)sizeof(V);
    long results = 0;
    for (const int *s = program; *s != OP_END; s += WIDTH) {
        int code = *s, of[3] = {0, 0, 0}, to = s[1] / unit, count = code == OP_STORE || code == OP_SINCOS ? 1 : operands_of(code);
        for (int k = 0; k < count; k++) {
            int place = s[2 + k] / unit;
            if (at[place] < 0) {
                double number = frame[place][0];
                if (place >= *lasting) *lasting = place + 1;
                at[place] = number == 0 || number == 1 || number == -1 ? make_number(v, number) : make(v, OP_PLACE, place, 0, 0);
            }
            of[k] = at[place];
        }
        if (code == OP_STORE) {
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

/* The last statement that needs each value, by the numbers of values; results are needed by the end. */
static void find_last(Values *v, const int *stores, long results) {
    for (long k = 0; k < results; k++) v->made[stores[2 * k + 1]].last = v->count;
    for (int k = v->count - 1; k >= 0; k--) {
        Made *m = &v->made[k];
        if (m->last < 0) continue;
        int count = m->code == OP_SINCOS || m->code == OP_SECOND ? 1 : operands_of(m->code);
        for (int j = 0; j < count; j++)
            if (v->made[m->of[j]].last < k) v->made[m->of[j]].last = k;
    }
}

/* The statements of what is needed, places from `first` on being free, of which there are `room`; their number, 0 where places do not suffice. */
static long write_program(Values *v, const int *stores, long results, int first, int room, int *free, int *program) {
    const int unit = (int)sizeof(V);
    int left = 0, *s = program;
    for (int k = room; k > first; k--) free[left++] = k - 1;
    for (int k = 0; k < v->count; k++) {
        Made *m = &v->made[k];
        if (m->last < 0 || m->code == OP_SECOND) continue;
        if (m->code == OP_PLACE) {
            m->place = m->of[0] * unit;
            continue;
        }
        int count = m->code == OP_SINCOS ? 1 : operands_of(m->code);
        s[0] = m->code;
        for (int j = 0; j < 3; j++) s[2 + j] = j < count ? v->made[m->of[j]].place : 0;
        for (int j = 0; j < count; j++) { /* whose last need this is */
            Made *old = &v->made[m->of[j]];
            if (old->last == k && old->code != OP_PLACE && old->place >= 0) free[left++] = old->place / unit, old->last = -2;
        }
        if (left < 2) return 0;
        m->place = free[--left] * unit;
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

static long thin_frame(const Kernel *k) { return 2 * k->constants + 64; }

/* The program of a kernel with these masks; null where it cannot be made. */
static int *thinned(const Kernel *k, const V *frame, long first, long masks, const signed char *key, long statements, long *length) {
    long places = thin_frame(k), most = 2 * statements + places;
    Values v = {malloc(sizeof(Made) * (size_t)most), 0};
    int *room = malloc(sizeof(int) * (size_t)(2 * places + 2 * k->outputs + 2)), *program = malloc(sizeof(int) * (size_t)(WIDTH * (2 * statements + places + 1)));
    *length = 0;
    if (v.made && room && program) {
        int *at = room, *free_places = at + places, *stores = free_places + places, lasting = 0;
        for (long j = 0; j < places; j++) at[j] = -1;
        long results = follow_program(k->program, frame, first, masks, key, at, &v, stores, &lasting);
        find_last(&v, stores, results);
        *length = write_program(&v, stores, results, lasting, (int)places, free_places, program);
    }
    free(v.made);
    free(room);
    if (*length) return program;
    free(program);
    return 0;
}

static void forget_programs(Integrator *I) {
    struct Thin *H = I->state ? I->state->thin : 0;
    if (!H) return;
    for (long k = 0; k < THIN_MODES; k++)
        for (int which = 0; which < MASKED; which++) free(H->mode[k].program[which]);
    I->state->thin = 0;
}

/* Only where memory may be allocated. */
static int make_thin(Integrator *I) {
    struct State *T = I->state;
    if (I->block || I->counted) return 1;
    struct Thin *H = reserve(I, sizeof(struct Thin));
    signed char *keys = reserve(I, (size_t)((THIN_MODES + 1) * I->masks));
    if (!H || !keys || !(H->side = reserve_doubles(I, I->masks))) return 0;
    for (long k = 0; k < THIN_MODES; k++) H->mode[k].masks = keys + k * I->masks;
    H->key = keys + THIN_MODES * I->masks;
    T->thin = H;
    return 1;
}

static Kernel *kernel_with_masks(Integrator *I, enum Masked which) {
    Kernel *kernels[MASKED] = {&I->rhs, &I->rows, &I->projection, &I->jvp};
    return kernels[which];
}

/* The program for all modes, with its frame; whether there is one that is worth it. */
static int has_whole(Integrator *I, enum Masked which) {
    struct Thin *H = I->state->thin;
    Kernel *k = kernel_with_masks(I, which), *programs[MASKED] = {&I->rhs_program, &I->rows_program, &I->projection_program, &I->jvp_program};
    if (H->asked[which]) return H->length[which] > 0;
    H->asked[which] = 1;
    if (k->evaluate) return 0;
    if (!k->program && !programs[which]->program && I->lacking) I->lacking(PROGRAMS + (long)which);
    H->whole[which] = k->program ? *k : *programs[which];
    const Kernel *whole = &H->whole[which];
    long inputs = whole->inputs, fixed = which == OF_PROJECTION ? 1 + I->nx + I->masks : 1 + I->nx + I->nu, length = 0;
    if (!whole->program || whole->twofold) return 0;
    while (whole->program[WIDTH * length] != OP_END) length++;
    V *frame = reserve_lanes(I, thin_frame(whole) + inputs + 1), *in = frame + thin_frame(whole);
    if (!frame || length < THIN_LEAST) return 0;
    for (long i = 0; i < I->np; i++) in[fixed + i] = v_all(I->parameters[i]);
    interpret(whole->preparation, in, frame, frame);
    H->frame[which] = frame;
    H->length[which] = length;
    return 1;
}

/* The entry of masks; the oldest one gives way to a new one. */
static void look_up_mode(const Integrator *I, const V *masks) {
    struct Thin *H = I->state->thin;
    for (long k = 0; k < I->masks; k++) {
        double side = H->side[k] = masks[k][0];
        H->key[k] = side == 0 ? 0 : side == 1 ? 1 : side == -1 ? -1 : 2;
    }
    for (long k = 0; k < THIN_MODES; k++)
        if (H->mode[k].known && memcmp(H->mode[k].masks, H->key, (size_t)I->masks) == 0) {
            H->now = &H->mode[k];
            return;
        }
    struct ThinMode *new = H->now = &H->mode[H->next++ % THIN_MODES];
    for (int which = 0; which < MASKED; which++) {
        free(new->program[which]);
        new->program[which] = 0;
        new->length[which] = new->calls[which] = new->tried[which] = 0;
    }
    new->known = 1;
    memcpy(new->masks, H->key, (size_t)I->masks);
}

static int are_those_of_now(const struct Thin *H, const V *masks, long count) {
    for (long k = 0; k < count; k++)
        if (masks[k][0] != H->side[k]) return 0;
    return H->now != 0;
}

/* The program of a kernel for the masks at `in`, the same in all lanes; null: the kernel itself is to be taken. */
static const int *thin_program(Integrator *I, enum Masked which, const V *in) {
    struct Thin *H = I->state->thin;
    long first = 1 + I->nx + (which == OF_PROJECTION ? 0 : I->nu - I->held);
    if (!are_those_of_now(H, in + first, I->masks)) look_up_mode(I, in + first);
    struct ThinMode *now = H->now;
    const Kernel *k = kernel_with_masks(I, which);
    H->calls[which]++;
    if (!now->tried[which] && ++now->calls[which] >= THIN_CALLS && (k->program || H->asked[which] || H->calls[which] > THIN_LONG)) {
        now->tried[which] = 1;
        if (has_whole(I, which)) now->program[which] = thinned(&H->whole[which], H->frame[which], first, I->masks, now->masks, H->length[which], &now->length[which]);
    }
    double part = k->run ? THIN_GAIN : 1;
    return now->program[which] && (double)now->length[which] < part * (double)H->length[which] ? now->program[which] : 0;
}

/* Results at `in` of a kernel that has masks, if there are any. */
static void run_masked(Integrator *I, enum Masked which, const V *in, V *c, V *out) {
    const int *program = I->state->thin ? thin_program(I, which, in) : 0;
    if (program) interpret(program, in, I->state->thin->frame[which], out);
    else run_kernel(kernel_with_masks(I, which), in, c, out, I->state->work);
}
