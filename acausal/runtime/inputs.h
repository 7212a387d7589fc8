/* Inputs as functions of time: numbers, tables, formulas, and what the caller computes. */

/* The piece of a table that t is in; at a knot the one that begins there. */
static long piece_at(const Table *T, double t, long near) {
    const double *begins = T->begins;
    if (begins[near] <= t && (near + 1 == T->pieces || t < begins[near + 1])) return near;
    long low = 0, high = T->pieces - 1;
    while (low < high) {
        long middle = (low + high + 1) / 2;
        if (begins[middle] <= t) low = middle;
        else high = middle - 1;
    }
    return low;
}

/* The time at which a table is read at time t. */
static double within_period(const Table *T, double t) { return T->period > 0 ? t - T->period * floor((t - T->first) / T->period) : t; }

/* Horner's rule in the time since the piece's origin; `near`: the piece of before, then of now. */
static double piece_value(const Table *T, double t, long *near) {
    double at = within_period(T, t);
    *near = piece_at(T, at, *near);
    const double *c = T->coefficients + *near * T->terms;
    double s = at - T->begins[*near], sum = c[0];
    for (long k = 1; k < T->terms; k++) sum = sum * s + c[k];
    return sum;
}

double table_value(const Table *T, double t) {
    long piece = 0;
    return piece_value(T, t, &piece);
}

static V table_at(const Table *T, V t) {
    V value = t;
    long piece = 0;
    for (long l = 0; l < LANES; l++) value[l] = piece_value(T, t[l], &piece);
    return value;
}

/* The first time after t at which another piece of a table begins. */
static double table_knot(const Table *T, double t) {
    double turn = T->period > 0 ? floor((t - T->first) / T->period) : 0;
    long next = T->period > 0 ? 0 : 1, last = piece_at(T, within_period(T, t), 0);
    if (last > next) next = last; /* the time within a period is rounded: the piece before is looked at, too */
    for (;; next++) {
        if (next >= T->pieces) {
            if (!(T->period > 0)) return INFINITY;
            next = 0;
            turn++;
        }
        double knot = T->begins[next] + T->period * turn;
        if (knot > t) return knot;
    }
}

static double clock_knot(const Clock *C, double t) {
    if (!C->counts) return -C->value / C->slope > t ? -C->value / C->slope : INFINITY;
    double step = copysign(1, C->slope), count = floor(C->value + C->slope * t) - step;
    while (!((count - C->value) / C->slope > t)) count += step;
    return (count - C->value) / C->slope;
}

/* The first time after t at which an input jumps or bends. */
static double next_knot(const Integrator *I, double t) {
    double found = INFINITY;
    long low = 0, high = I->knot_count;
    while (low < high) {
        long middle = (low + high) / 2;
        if (I->knots[middle] > t) high = middle;
        else low = middle + 1;
    }
    if (low < I->knot_count) found = I->knots[low];
    for (long k = 0; k < I->tables; k++) found = fmin(found, table_knot(&I->table_list[k], t));
    for (long k = 0; k < I->clocks; k++) found = fmin(found, clock_knot(&I->clock_list[k], t));
    return found;
}

/* Values of the inputs where a kernel has its arguments. */
static void give_inputs(const Integrator *I, V *in) {
    for (long i = 0; i < I->nu - I->held; i++) in[1 + I->nx + i] = v_all(I->u[i]);
}

/* Inputs other than sides at the times t, of whose lanes the first `count` are wanted. Returns 0 when the input function failed. */
static int own_inputs_at(Integrator *I, V t, long count, V *u) {
    struct State *T = I->state;
    if (!I->input && !I->tables && !I->formulas) return 1;
    for (long l = 0; l < LANES && (I->input || l == 0); l++) {
        if (I->input && l < count && !I->input(I->user, t[l], I->u)) return 0;
        for (long i = 0; i < I->nu - I->held; i++) {
            if (I->input) u[i][l] = I->u[i];
            else u[i] = v_all(I->u[i]);
        }
    }
    for (long k = 0; k < I->tables; k++) u[I->table_list[k].input] = table_at(&I->table_list[k], t);
    if (I->formulas) {
        T->formula_in[0] = t;
        run_kernel(&I->formula, T->formula_in, T->formula_c, T->formula_out, T->work);
        for (long k = 0; k < I->formulas; k++) u[I->formula_input[k]] = T->formula_out[k];
    }
    return 1;
}

/* So many sides of switches, unless they are there. */
static void give_sides(Integrator *I, const double *side, long count, V *there) {
    struct State *T = I->state;
    if (!count) return;
    if (memcmp(T->given, side, sizeof(double) * (size_t)count) != 0) {
        memcpy(T->given, side, sizeof(double) * (size_t)count);
        T->holders = 0;
        T->written++;
    }
    if (are_given(T, there)) return;
    for (long k = 0; k < count; k++) there[k] = v_all(side[k]);
    T->holder[T->holders++ % HOLDERS] = there;
}

/* The same for a kernel of invariants, where these depend on them; also those that do not change. */
static int led_by(Integrator *I, V t, long count, V *u) {
    if (!I->led) return 1;
    for (long i = 0; i < I->nu - I->held; i++) u[i] = v_all(I->u[i]);
    return own_inputs_at(I, t, count, u);
}

/* The same with the sides of switches. */
static int inputs_at(Integrator *I, V t, long count, V *u) {
    give_sides(I, I->state->side, I->held, u + I->nu - I->held);
    return own_inputs_at(I, t, count, u);
}

/* Arrays of the kernel of formulas, which takes time only. 0 when memory is short. */
static int make_formulas(Integrator *I) {
    struct State *T = I->state;
    T->formula_in = reserve_lanes(I, I->formula.inputs + 1);
    T->formula_out = reserve_lanes(I, I->formula.outputs + 1);
    return (I->counted || (T->formula_in && T->formula_out)) && prepared(I, &I->formula, T->formula_in, &T->formula_c);
}
