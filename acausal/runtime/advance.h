static int make_guards(Integrator *I) {
    struct State *T = I->state;
    if (!arranged(I, &I->guard, &T->guard_in, &T->guard_out, &T->guard_c, 1 + I->nx + I->nu)) return 0;
    T->guard_values = reserve_doubles(I, POINTS * I->guards);
    T->chebyshev = reserve_doubles(I, POINTS * POINTS);
    T->guard_noise = reserve_doubles(I, I->guards);
    T->guard_states = reserve(I, sizeof(struct GuardState) * (size_t)I->guards);
    if (I->counted) return 1;
    if (!T->guard_values || !T->guard_noise || !T->guard_states || !T->chebyshev) return 0;
    chebyshev_cosines(T->chebyshev);
    give_inputs(I, T->guard_in);
    return 1;
}

/* Vectors of the states; `most`: stages that a method has. */
static int make_vectors(Integrator *I, long most) {
    struct State *T = I->state;
    long n = I->nx;
    int all = 1;
    double **vectors[] = {&T->carry, &T->size, &T->scale, &T->factor, &T->rate, &T->before, &T->start_rate, &T->end_rate, &T->increment, &T->limit, &T->noise, &T->spread, &T->most, &T->most_left, &T->change_left, &T->aside, &T->apart, &T->least, &T->known};
    for (size_t k = 0; k < sizeof vectors / sizeof *vectors; k++) all = (*vectors[k] = reserve_doubles(I, n + 1)) && all;
    T->copied = reserve(I, (size_t)n + 1);
    T->own = reserve(I, sizeof(long) * (size_t)(n + 1));
    T->disturbed = reserve_lanes(I, I->rhs.inputs + 1);
    for (int k = 0; k < 2; k++) all = (T->rates[k] = reserve_lanes(I, n + 1)) && all;
    T->last_a = (double *)reserve_lanes(I, (most + LANES - 1) / LANES * n);
    if (I->counted) return 1;
    if (!all || !T->copied || !T->own || !T->disturbed || !T->last_a) return 0;
    for (long k = 0; k < I->copies; k++) T->copied[I->copy_to[k]] = 1;
    for (long i = 0, k = 0; i < n; i++)
        if (!T->copied[i]) T->own[k++] = i;
    for (long i = 0; i < n; i++) T->size[i] = fabs(I->x[i]);
    I->size = T->size;
    return 1;
}

/* What is otherwise made when it is needed, where all memory there is is a caller's block. */
static int make_rest(Integrator *I, long most) {
    long method = I->method;
    int made = make_last_step(I, most) || I->counted;
    for (I->method = 0; I->method < I->methods; I->method++) made = made && stages_of(I);
    I->method = method;
    for (int which = 0; which < EXACT_PROGRAMS; which++) made = made && (!disturbed_one(I, which)->program || disturbed_kernel(I, which) || I->counted);
    return made && (I->newton != WHERE_SLOW || make_krylov(I) || I->counted) && (I->newton == NEVER || make_newton(I)) && (!I->fine || fine_stages(I, I->fine));
}

static int make_parts(Integrator *I) {
    struct State *T = I->state;
    long n = I->nx, most = 0;
    for (long k = 0; k < I->methods; k++)
        if (I->method_list[k].stages > most) most = I->method_list[k].stages;
    if (!arranged(I, &I->rhs, &T->point_in, &T->point_out, &T->rhs_c, 1 + n + I->nu)) return 0;
    if (!I->counted) give_inputs(I, T->point_in);
    if (I->ng && !arranged(I, &I->projection, &T->projection_in, &T->projection_out, &T->projection_c, 1 + n + I->nu - I->held + I->masks)) return 0;
    if (I->led) {
        T->led_from = reserve_doubles(I, I->nu);
        T->led_to = reserve_doubles(I, I->nu);
        if (!I->counted && !(T->led_from && T->led_to)) return 0;
    }
    if (present(&I->clearance) && (!arranged(I, &I->clearance, &T->clearance_in, &T->clearance_out, &T->clearance_c, 1 + n) || !make_passage(I) || !make_exact(I))) return 0;
    if (I->formulas && !make_formulas(I)) return 0;
    if (I->guards && !make_guards(I)) return 0;
    if ((I->held || I->row_count) && !make_switches(I)) return 0;
    if (changes_modes(I) && !make_modes(I)) return 0;
    if ((I->discretes || I->set_count) && !make_sets(I)) return 0;
    if (!make_vectors(I, most) || (I->directions && !(make_sensitivity(I) && make_asked(I)))) return 0;
    return !(I->block || I->counted) || make_rest(I, most);
}

/* Allocates and prepares; where the caller gave a block, in it, also anew. Returns 0 when memory is short. The caller calls `finish` in
   any case. */
int begin(Integrator *I) {
    I->used = 0;
    I->steps = I->first = I->events = 0;
    if (I->methods > METHODS) return 0;
    struct State *T = I->state = reserve(I, sizeof(struct State));
    if (!T || !make_parts(I)) return 0;
    T->patience = present(&I->clearance) ? DOUBTS : DOUBTS + (I->nx < 32 ? I->nx / 4 : 8); /* looking costs a rate for each state; many more rejections make steps nothing */
    T->newton_now = I->newton == ALWAYS;
    T->pending = -1;
    T->costs.newton_rate = INFINITY;
    if (I->newton == ALWAYS && I->adapt_order) I->method = first_radau(I);
    return 1;
}

/* Bytes of a block in which an integration with kernels, methods, sizes and guards like these can begin. */
size_t needed(const Integrator *I) {
    struct State state = {0};
    Integrator counted = *I;
    counted.counted = 1;
    counted.used = 64; /* to align the block */
    counted.state = &state;
    reserve(&counted, sizeof state);
    make_parts(&counted);
    return counted.used;
}

/* An integration in whose block another one, with all that is in it, has been copied from `block`. */
void moved_integration(Integrator *I, const char *block) {
    const size_t own[][2] = {
        {offsetof(Integrator, state), sizeof I->state},
        {offsetof(Integrator, size), sizeof I->size},
        {offsetof(Integrator, discrete_start), sizeof I->discrete_start},
        {offsetof(Integrator, event_times), offsetof(Integrator, event_directions) + sizeof I->event_directions - offsetof(Integrator, event_times)},
        {offsetof(Integrator, times), offsetof(Integrator, kinds) + sizeof I->kinds - offsetof(Integrator, times)},
    };
    for (size_t k = 0; k < sizeof own / sizeof *own; k++) redirect(I, own[k][0], own[k][0] + own[k][1], block, I->room, I->block);
    struct State *T = I->state;
    redirect(T, 0, offsetof(struct State, made), block, I->room, I->block);
    for (long k = 0; k <= METHODS; k++) {
        Stages *S = k < METHODS ? &T->stages[k] : &T->refining;
        redirect(S, 0, offsetof(Stages, method), block, I->room, I->block);
    }
}

/* What nonlinear equations give by other states, and places that inputs prescribe, where inputs have jumped, from T->led_from. 0 when the input function failed. */
static int jumps_with_inputs(Integrator *I) {
    return !(may_jump(I) || I->led == LED_PLACES) || (jump_along(I, 0, NULL) && (!I->directions || directions_jump(I, 0, NULL)));
}

/* To the far side of the next knot, where the last step is told to have ended: what the rates were before says nothing of what they are now. */
static int cross_knot(Integrator *I) {
    struct State *T = I->state;
    if (changes_modes(I) && I->steps > 0 && !look_before_knot(I, T->knot - aside(I, T->knot))) return 0;
    if (I->led) {
        V *u = T->projection_in + 1 + I->nx;
        if (!led_by(I, v_all(I->t), 1, u)) return 0;
        for (long i = 0; i < I->nu - I->held; i++) T->led_from[i] = u[i][0];
    }
    I->t = fmin(I->end, T->knot + aside(I, T->knot));
    if (I->steps > 0) I->times[I->steps - I->first] = I->t == I->end ? I->t : T->knot;
    T->parting.since = I->t;
    forget_rates(I);
    if (I->held && !agree(I, I->t, I->x, 1)) return 0;
    return jumps_with_inputs(I);
}

/* Where the next step must end: before the next knot that lies ahead, or at the end. */
static int next_stop(Integrator *I, double *stop) {
    struct State *T = I->state;
    *stop = I->end;
    while (T->knot < INFINITY && T->knot - aside(I, T->knot) <= I->t && I->t < I->end) {
        if (I->t < T->knot + aside(I, T->knot)) {
            if (!cross_knot(I)) return 0;
            if (I->t >= I->end) return 1;
        }
        T->knot = next_knot(I, T->knot + 2 * aside(I, T->knot));
    }
    if (T->knot < INFINITY) *stop = fmin(I->end, T->knot - aside(I, T->knot));
    return 1;
}

/* So little time before a stop that no step is possible is passed over: where modes change just before it. Returns whether there was no more. */
static int arrives(Integrator *I, double stop) {
    double little = 16 * EPS * fmax(fabs(I->t), fabs(stop) * 1e-3), t = I->t;
    if (!changes_modes(I) || I->steps == 0 || !(stop - t <= little)) return 0;
    I->t = stop;
    for (long k = I->steps - I->first; k > 0 && I->times[k] == t; k--) I->times[k] = stop;
    return 1;
}

static enum Code begin_motion(Integrator *I) {
    struct State *T = I->state;
    T->start = T->parting.since = I->t;
    T->knot = next_knot(I, I->t - aside(I, I->t));
    if (!keep(I, 0)) return OUT_OF_MEMORY;
    enum Code code = I->discretes ? begin_discretes(I) : REACHED_END;
    if (code != REACHED_END) return code;
    if (I->held && !begin_sides(I)) return INPUT_FAILED;
    if (changes_modes(I)) code = begin_modes(I);
    if (I->led) memcpy(T->led_from, I->before ? I->before : I->u, sizeof(double) * (size_t)(I->nu - I->held));
    if (code == REACHED_END && I->led && !jumps_with_inputs(I)) return INPUT_FAILED; /* of a motion that goes on with others */
    T->begun = code == REACHED_END;
    return code;
}

/* Modes where the last step has ended. */
static enum Code decide_here(Integrator *I) {
    struct State *T = I->state;
    if (T->crossed) T->pending = -1;
    if (T->crossed) return decide_modes(I, -1, I->h);
    return changes_modes(I) && T->pending >= 0 ? decide_modes(I, T->pending, T->pending_planned) : REACHED_END;
}

/* Where only the last step is kept, what happens at its end is decided when it has been read: by `settle_modes`, or with the next step. */
int settle_modes(Integrator *I) { return (int)(I->state->begun ? decide_here(I) : begin_motion(I)); }

/* Whether modes are still to be decided before the motion is read at time t, or what follows inputs is to jump with them. */
int unsettled(const Integrator *I, double t) {
    const struct State *T = I->state;
    if (!changes_modes(I) || !T->begun) return changes_modes(I) || (I->led && !T->begun);
    return (T->crossed || T->pending >= 0) && t >= I->times[I->steps - I->first];
}

/* A motion that is about to begin, as another one goes on: with the discrete values among these masks. */
void remember(Integrator *I, const double *masks) {
    if (!I->discretes) return;
    double *value = I->state->side + first_discrete(I);
    memcpy(value, masks + first_discrete(I), sizeof(double) * (size_t)I->discretes);
    I->discrete_start = value;
}

Transition last_transition(const Integrator *I) { return I->state->last; }

/* One step, until I->end at most. */
static enum Code go_a_step(Integrator *I) {
    double end = I->end;
    if (ends_at_asked(I)) I->end = fmin(end, next_asked(I));
    enum Code code = I->step > 0 ? one_fixed(I) : one_adaptive(I);
    I->end = end;
    return code;
}

static enum Code run_steps(Integrator *I) {
    struct State *T = I->state;
    double deadline = I->slice > 0 ? now() + I->slice : 0, t = I->t;
    if (I->block || !T->begun) {
        enum Code code = (enum Code)settle_modes(I);
        if (code != REACHED_END) return code;
        if (I->block && I->t > t) return PAUSED; /* what has been bridged is read before the next step */
    }
    if (!I->nx && !I->set_count && !I->guards) return REACHED_END; /* nothing moves, and nothing is looked for */
    if (I->t < I->end && I->step == 0 && I->h == 0 && !first_step(I)) return INPUT_FAILED;
    while (I->t < I->end) {
        if (I->steps >= I->max_steps) return TOO_MANY_STEPS;
        if (T->newton_now && !present(&I->jvp)) return NEEDS_JACOBIAN;
        double end = I->end, stop;
        if (!next_stop(I, &stop)) return INPUT_FAILED;
        if (I->t >= end) break;
        if (T->crossed) { /* where modes changed at a knot */
            enum Code code = decide_modes(I, -1, I->h);
            if (code != REACHED_END) return code;
        }
        I->end = stop;
        int there = arrives(I, stop);
        enum Code code = there ? REACHED_END : go_a_step(I);
        I->end = end;
        if (code == REACHED_END && I->guards && !there) code = watch(I);
        if (code == REACHED_END && stop < end && I->t >= stop) {
            if (!cross_knot(I)) return INPUT_FAILED;
        }
        if (code == REACHED_END && !I->block) code = decide_here(I);
        if (code != REACHED_END) return code;
        give_until(I, I->t + at_once(I));
        if ((I->slice == 0 || now() > deadline) && I->t < I->end) return PAUSED;
    }
    return REACHED_END;
}

/* Steps until the end, a failure, or the end of the time slice. After the end has been reached it may be set later. */
int advance(Integrator *I) {
    enum Code code;
    double end = I->end;
    do {
        if (changes_modes(I)) I->end = fmin(end, next_asked(I));
        code = run_steps(I);
        if (code == REACHED_END) give_until(I, I->end);
    } while (code == REACHED_END && I->end < end);
    I->end = end;
    give_directions(I);
    return (int)code;
}

/* A kernel of the same function takes the place of number `which` of the kernels, in their order in Integrator: between steps. */
int exchange(Integrator *I, long which, const Kernel *k) {
    struct State *T = I->state;
    Kernel *kernels[] = {&I->rhs, &I->jvp, &I->projection, &I->guard, &I->variation, &I->projected, &I->clearance, &I->formula, &I->rows, &I->sides, &I->row_change, &I->decision, &I->decision_change, &I->set, &I->set_change};
    const V *in[] = {T->point_in, T->jvp_in, T->projection_in, T->guard_in, T->variation_in, T->projected_in, T->clearance_in, T->formula_in, T->rows_in, T->sides_in, T->row_change_in, T->decision_in, T->decision_change_in, T->set_in, T->set_change_in};
    V **c[] = {&T->rhs_c, &T->jvp_c, &T->projection_c, &T->guard_c, &T->variation_c, &T->projected_c, &T->clearance_c, &T->formula_c, &T->rows_c, &T->sides_c, &T->row_change_c, &T->decision_c, &T->decision_change_c, &T->set_c, &T->set_change_c};
    if (in[which] && !prepared(I, k, in[which], c[which])) return 0;
    *kernels[which] = *k;
    return 1;
}

/* A run that goes on from another one's end solves its stages by Newton's iteration as that one did; `jvp` must be set. */
void use_newton(Integrator *I) {
    I->state->newton_now = 1;
    I->state->jacobian_fresh = 0;
    I->state->costs.sweeps = INFINITY;
    I->state->costs.turned_t = I->t;
    begin_weighing(I);
}
