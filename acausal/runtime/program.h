/* Programs of functions, from their values, each made from others once (acausal/emit/statements.py). */
#ifndef ONLY_COMPILED_KERNELS

/* A function as columns. `code`: an operation of one or two values, OP_LOAD of the input at `place`, OP_NUMBER of a `number`, OP_SYSTEM with the number `place`, or OP_ANSWER
   of a system, the one at `place`; operands stand in `of` from `begin` on. `kept`: values that `rare` ones make and that stay.
   `result`: (output, value) each; `system`: rows, columns, whether it is damped, each. `unit`: bytes of a value. */
struct Definition {
    long values, rare_count, often_count, kept_count, results, systems, unit;
    const int *code, *begin, *of, *place, *rare, *often, *kept, *result, *system;
    const double *number;
};

/* An operation: results are made in `to`, operands `of`; `where` of an input, output or answer. */
typedef struct {
    int code, to[2], of[3], where;
} Step;

typedef struct {
    const struct Definition *f;
    int *uses, *inside, *product, *sine, *cosine, *made, *last, *home; /* by values; product: that is made within a sum; home: where it stands for good, or stood last */
    int *first_result, *next_result;                         /* by values, by results */
    int *slot, *slots;                                       /* places where systems have an operand: of value v those from slots[v] to slots[v + 1] */
    int *first_place;                                        /* by systems */
    int *free;
    int *lasting; /* what is kept, and then the numbers that are needed */
    Step *step;
    long steps, end, lasting_count;
    int *row;
} Maker;

static void add_row(Maker *m, int code, int to, int a, int b, int c) {
    const int row[WIDTH] = {code, to, a, b, c};
    memcpy(m->row, row, sizeof row);
    m->row += WIDTH;
}

static void add_step(Maker *m, int code, int to, int second, int a, int b, int c, int where) { m->step[m->steps++] = (Step){code, {to, second}, {a, b, c}, where}; }

static void add_stores(Maker *m, int v) {
    for (int k = m->first_result[v]; k >= 0; k = m->next_result[k]) add_step(m, OP_STORE, -1, -1, v, -1, -1, m->f->result[2 * k]);
}

/* An input is loaded right before it is needed. */
static void bring(Maker *m, int v, int stores) {
    if (m->made[v]) return;
    m->made[v] = 1;
    add_step(m, OP_LOAD, v, -1, -1, -1, -1, m->f->place[v]);
    if (stores) add_stores(m, v);
}

static int is_leaf(int code) { return code == OP_LOAD || code == OP_NUMBER; }

/* Products that nothing needs but one sum, difference or product are made within that. */
static void find_products(Maker *m, const int *order, long count, int stores) {
    const struct Definition *f = m->f;
    for (long v = 0; v < f->values; v++) m->uses[v] = 0, m->inside[v] = 0, m->product[v] = -1, m->sine[v] = m->cosine[v] = -1;
    for (long k = 0; k < count; k++) {
        int v = order[k];
        if (is_leaf(f->code[v])) continue;
        m->inside[v] = 1;
        for (int a = f->begin[v]; a < f->begin[v + 1]; a++) m->uses[f->of[a]]++;
        if (f->code[v] == OP_SIN) m->sine[f->of[f->begin[v]]] = v;
        if (f->code[v] == OP_COS) m->cosine[f->of[f->begin[v]]] = v;
    }
    for (long k = 0; k < m->lasting_count; k++) m->uses[m->lasting[k]] = 0;
    for (long k = 0; k < f->results && stores; k++) m->uses[f->result[2 * k + 1]] = 0;
    for (long k = 0; k < count; k++) {
        int v = order[k], code = f->code[v];
        if (code != OP_ADD && code != OP_MUL && code != OP_SUB) continue;
        for (int side = 0; side < 2; side++) {
            int a = f->of[f->begin[v] + side], of = f->code[a];
            if (!m->inside[a] || m->uses[a] != 1 || (of != OP_MUL && of != OP_SQ) || m->product[a] >= 0) continue;
            m->product[v] = a;
            break;
        }
    }
    for (long k = 0; k < count; k++)
        if (m->product[order[k]] >= 0) m->inside[m->product[order[k]]] = 2;
}

/* The operations in order: inputs right before they are needed, results as they are made. */
static void find_steps(Maker *m, const int *order, long count, int stores) {
    const struct Definition *f = m->f;
    find_products(m, order, count, stores);
    memset(m->made, 0, sizeof(int) * (size_t)f->values);
    m->steps = 0;
    for (long k = 0; k < m->lasting_count; k++) {
        int v = m->lasting[k];
        m->made[v] = 1;
        if (stores) add_stores(m, v);
    }
    for (long k = 0; k < f->results && stores; k++)
        if (f->code[f->result[2 * k + 1]] == OP_LOAD) bring(m, f->result[2 * k + 1], 1);
    for (long k = 0; k < m->lasting_count; k++) m->made[m->lasting[k]] = -1; /* still to be made, here or elsewhere */
    for (long k = 0; k < count; k++) {
        int v = order[k], code = f->code[v], to = v, second = -1, of[3] = {-1, -1, -1};
        if (m->inside[v] != 1 || m->made[v] == 1) continue;
        if (code == OP_ANSWER) {
            m->made[v] = 1;
            add_step(m, code, v, -1, -1, -1, -1, f->place[v]);
            if (stores) add_stores(m, v);
            continue;
        }
        const int *operand = f->of + f->begin[v];
        int operands = f->begin[v + 1] - f->begin[v];
        for (int j = 0; j < operands && j < 3 && code != OP_SYSTEM; j++) of[j] = operand[j];
        if (m->product[v] >= 0) {
            int p = m->product[v], left = operand[0] == p;
            of[2] = operand[left];
            of[0] = f->of[f->begin[p]], of[1] = f->of[f->begin[p + 1] - 1];
            code = code == OP_ADD ? OP_MUL_ADD : code == OP_MUL ? OP_MUL_MUL : left ? OP_MUL_SUB : OP_SUB_MUL;
        } else if ((code == OP_SIN || code == OP_COS) && m->sine[of[0]] >= 0 && m->cosine[of[0]] >= 0) {
            to = m->sine[of[0]], second = m->cosine[of[0]], code = OP_SINCOS;
        }
        for (int j = 0; j < 3; j++)
            if (of[j] >= 0) bring(m, of[j], stores);
        for (int j = 0; j < operands && code == OP_SYSTEM; j++) bring(m, operand[j], stores);
        add_step(m, code, to, second, of[0], of[1], of[2], f->place[v]);
        m->made[to] = 1;
        if (stores && code != OP_SYSTEM) add_stores(m, to);
        if (second < 0) continue;
        m->made[second] = 1;
        if (stores) add_stores(m, second);
    }
}

/* Statements with places; a place is used again once its value is dead, but for those of systems and of what lasts. */
static void write_steps(Maker *m) {
    const struct Definition *f = m->f;
    const int always = (int)m->steps, unit = (int)f->unit;
    long left = 0, size = m->first_place[f->systems];
    for (long v = 0; v < f->values; v++) m->last[v] = m->slots[v + 1] > m->slots[v] ? always : -1, m->home[v] = -1;
    for (int k = 0; k < always; k++) {
        const Step *s = m->step + k;
        const int values[5] = {s->of[0], s->of[1], s->of[2], s->to[0], s->to[1]};
        for (int j = 0; j < 5; j++)
            if (values[j] >= 0 && m->last[values[j]] < always) m->last[values[j]] = k;
    }
    for (int k = 0; k < m->lasting_count; k++) m->last[m->lasting[k]] = always, m->home[m->lasting[k]] = k;
    for (int k = 0; k < always; k++) {
        const Step *s = m->step + k;
        if (s->code == OP_SYSTEM) {
            const int *shape = f->system + 3 * s->where;
            add_row(m, OP_SYSTEM, m->first_place[s->where] * unit, shape[0], shape[1], shape[2]);
            continue;
        }
        if (s->code == OP_ANSWER) {
            int v = s->to[0], number = f->place[f->of[f->begin[v]]];
            const int *shape = f->system + 3 * number;
            int place = (int)layout_of(m->first_place[number], shape[0], shape[1], shape[2]).answer + s->where;
            if (m->home[v] >= 0) add_row(m, OP_MOVE, m->home[v] * unit, place * unit, 0, 0);
            else m->home[v] = place;
            m->last[v] = always;
            for (int j = m->slots[v]; j < m->slots[v + 1]; j++) add_row(m, OP_MOVE, m->slot[j] * unit, place * unit, 0, 0);
            continue;
        }
        int of[3] = {0, 0, 0};
        for (int j = 0; j < 3; j++) {
            int v = s->of[j];
            if (v < 0) continue;
            of[j] = m->home[v] * unit;
            if (m->last[v] != k) continue;
            m->free[left++] = m->home[v];
            m->last[v] = -1; /* once, where a value is both operands */
        }
        for (int j = 0; j < 2; j++) {
            int v = s->to[j];
            if (v < 0 || m->home[v] >= 0) continue;
            m->home[v] = m->slots[v + 1] > m->slots[v] ? m->slot[m->slots[v]] : left ? m->free[--left] : (int)size++;
        }
        int to = s->to[0] < 0 ? 0 : m->home[s->to[0]] * unit;
        if (s->code == OP_LOAD) add_row(m, OP_LOAD, to, s->where * unit, 0, 0);
        else if (s->code == OP_STORE) add_row(m, OP_STORE, s->where * unit, of[0], 0, 0);
        else if (s->code == OP_SINCOS) add_row(m, OP_SINCOS, to, of[0], m->home[s->to[1]] * unit, 0);
        else add_row(m, s->code, to, of[0], of[1], of[2]);
        for (int j = 0; j < 2; j++) {
            int v = s->to[j];
            if (v < 0) continue;
            if (m->last[v] == k) m->free[left++] = m->home[v];
            for (int q = m->slots[v]; q < m->slots[v + 1]; q++)
                if (m->slot[q] != m->home[v]) add_row(m, OP_MOVE, m->slot[q] * unit, m->home[v] * unit, 0, 0);
        }
    }
    if (size > m->end) m->end = size;
}

/* Numbers that are operands or results stay as what is kept does. */
static void find_lasting(Maker *m) {
    const struct Definition *f = m->f;
    memset(m->uses, 0, sizeof(int) * (size_t)f->values);
    for (long k = 0; k < f->rare_count + f->often_count; k++) {
        int v = k < f->rare_count ? f->rare[k] : f->often[k - f->rare_count];
        for (int a = f->begin[v]; a < f->begin[v + 1]; a++) m->uses[f->of[a]] = 1;
    }
    for (long k = 0; k < f->results; k++) m->uses[f->result[2 * k + 1]] = 1;
    memcpy(m->lasting, f->kept, sizeof(int) * (size_t)f->kept_count);
    m->lasting_count = f->kept_count;
    for (long v = 0; v < f->values; v++)
        if (m->uses[v] && f->code[v] == OP_NUMBER) m->lasting[m->lasting_count++] = (int)v;
}

/* Places of systems, behind those of what lasts. */
static void place_systems(Maker *m) {
    const struct Definition *f = m->f;
    int *count = m->slots, at = (int)m->lasting_count;
    memset(count, 0, sizeof(int) * (size_t)(f->values + 1));
    for (long v = 0; v < f->values; v++)
        for (int a = f->begin[v]; a < f->begin[v + 1] && f->code[v] == OP_SYSTEM; a++) count[f->of[a] + 1]++;
    for (long v = 0; v < f->values; v++) count[v + 1] += count[v], m->uses[v] = count[v];
    for (long v = 0; v < f->values; v++) {
        if (f->code[v] != OP_SYSTEM) continue;
        const int *shape = f->system + 3 * f->place[v];
        for (int a = f->begin[v]; a < f->begin[v + 1]; a++) m->slot[m->uses[f->of[a]]++] = at + a - f->begin[v];
        m->first_place[f->place[v]] = at;
        at += (int)room_of_system(shape[0], shape[1], shape[2]);
    }
    m->first_place[f->systems] = at;
}

/* The program of a function: `preparation` and `run`, room for 2 values + results + operands of systems + 2 statements each, and their numbers of statements, `length`. What is returned is
   how many places its frame has, or -1 where there is not enough memory. */
long make_program(const struct Definition *f, int *preparation, int *run, long *length) {
    size_t n = (size_t)f->values + 1, operands = (size_t)f->begin[f->values] + 1;
    size_t steps = 2 * n + (size_t)f->results, integers = 13 * n + (size_t)f->results + operands + (size_t)f->systems + 2;
    int *room = malloc(sizeof(int) * integers);
    Maker m = {.f = f, .step = malloc(sizeof(Step) * steps)};
    if (room && m.step) {
        int **parts[] = {&m.uses, &m.inside, &m.product, &m.sine, &m.cosine, &m.made, &m.last, &m.home, &m.first_result, &m.free, &m.lasting, &m.slots};
        int *at = room;
        for (size_t k = 0; k < sizeof parts / sizeof *parts; k++, at += n) *parts[k] = at;
        m.next_result = at, m.slot = at + f->results, m.first_place = m.slot + operands;
        for (size_t v = 0; v < n; v++) m.first_result[v] = -1;
        for (long k = f->results - 1; k >= 0; k--) {
            m.next_result[k] = m.first_result[f->result[2 * k + 1]];
            m.first_result[f->result[2 * k + 1]] = (int)k;
        }
        find_lasting(&m);
        place_systems(&m);
        m.row = preparation;
        for (long k = f->kept_count; k < m.lasting_count; k++) {
            int halves[2];
            memcpy(halves, f->number + m.lasting[k], sizeof halves);
            add_row(&m, OP_NUMBER, (int)(k * f->unit), halves[0], halves[1], 0);
        }
        for (long k = f->kept_count; k < m.lasting_count; k++)
            for (int j = m.slots[m.lasting[k]]; j < m.slots[m.lasting[k] + 1]; j++) add_row(&m, OP_MOVE, m.slot[j] * (int)f->unit, (int)(k * f->unit), 0, 0);
        find_steps(&m, f->rare, f->rare_count, 0);
        write_steps(&m);
        add_row(&m, OP_END, 0, 0, 0, 0);
        length[0] = (m.row - preparation) / WIDTH;
        m.row = run;
        find_steps(&m, f->often, f->often_count, 1);
        write_steps(&m);
        add_row(&m, OP_END, 0, 0, 0, 0);
        length[1] = (m.row - run) / WIDTH;
    }
    long found = room && m.step ? m.end : -1;
    free(room);
    free(m.step);
    return found;
}
#endif
