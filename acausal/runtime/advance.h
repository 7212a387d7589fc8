/* Allocates and prepares. Returns 0 when memory is short. The caller calls `finish` in any case. */
int begin(Integrator *I) {
    long n = I->nx;
    struct State *T = I->state = reserve(I, sizeof(struct State));
    if (!T) return 0;
    T->stages = reserve(I, sizeof(Stages) * (size_t)I->methods);
    if (!T->stages || !arranged(I, &I->rhs, &T->point_in, &T->point_out, &T->rhs_c, 1 + n + I->nu)) return 0;
    for (long i = 0; i < I->nu; i++) T->point_in[1 + n + i] = v_all(I->u[i]);
    if (I->ng && !arranged(I, &I->projection, &T->projection_in, &T->projection_out, &T->projection_c, 1 + n)) return 0;
    if (present(&I->clearance)) {
        if (!arranged(I, &I->clearance, &T->clearance_in, &T->clearance_out, &T->clearance_c, 1 + n) || !make_passage(I)) return 0;
    }
    if (I->guards) {
        if (!arranged(I, &I->guard, &T->guard_in, &T->guard_out, &T->guard_c, 1 + n + I->nu)) return 0;
        T->guard_values = reserve_doubles(I, POINTS * I->guards);
        T->chebyshev = reserve_doubles(I, POINTS * POINTS);
        T->guard_noise = reserve_doubles(I, I->guards);
        T->guard_states = reserve(I, sizeof(struct GuardState) * (size_t)I->guards);
        if (!T->guard_values || !T->guard_noise || !T->guard_states || !T->chebyshev) return 0;
        chebyshev_cosines(T->chebyshev);
        for (long i = 0; i < I->nu; i++) T->guard_in[1 + n + i] = v_all(I->u[i]);
    }
    double **vectors[] = {&T->carry, &T->size, &T->scale, &T->factor, &T->rate, &T->before, &T->start_rate, &T->end_rate, &T->increment, &T->limit, &T->noise, &T->most, &T->least};
    for (size_t k = 0; k < sizeof vectors / sizeof *vectors; k++)
        if (!(*vectors[k] = reserve_doubles(I, n + 1))) return 0;
    T->copied = reserve(I, (size_t)n + 1);
    if (!T->copied) return 0;
    for (long k = 0; k < I->copies; k++) T->copied[I->copy_to[k]] = 1;
    T->own = reserve(I, sizeof(long) * (size_t)(n + 1));
    if (!T->own) return 0;
    for (long i = 0, k = 0; i < n; i++)
        if (!T->copied[i]) T->own[k++] = i;
    for (long i = 0; i < n; i++) T->size[i] = fabs(I->x[i]);
    I->size = T->size;
    T->patience = DOUBTS;
    T->disturbed = reserve_lanes(I, I->rhs.inputs + 1);
    for (int k = 0; k < 2; k++) T->rates[k] = reserve_lanes(I, n + 1);
    if (!T->disturbed || !T->rates[0] || !T->rates[1]) return 0;
    long most = 0;
    for (long k = 0; k < I->methods; k++)
        if (I->method_list[k].stages > most) most = I->method_list[k].stages;
    T->last_a = reserve_doubles(I, most * n + 1);
    if (!T->last_a) return 0;
    T->newton_now = I->newton == ALWAYS;
    if (I->directions && !make_sensitivity(I)) return 0;
    T->asked = 4;
    return 1;
}

/* To the far side of a break: what the rates were before says nothing of what they are now. */
static void cross_break(Integrator *I) {
    struct State *T = I->state;
    I->t = fmin(I->end, I->breaks[2 * I->next_break++ + 1]);
    if (I->t == I->end) I->times[I->steps] = I->t;
    T->last_h = 0;
    T->start_known = 0;
    T->jacobian_fresh = 0;
    I->error = 0;
}

/* Where the next step must end: before the next break that lies ahead, or at the end. */
static double next_stop(Integrator *I) {
    while (I->next_break < I->break_count && I->breaks[2 * I->next_break] <= I->t) {
        if (I->t < I->breaks[2 * I->next_break + 1]) cross_break(I);
        else I->next_break++;
    }
    return I->next_break < I->break_count ? fmin(I->end, I->breaks[2 * I->next_break]) : I->end;
}

static enum Code run_steps(Integrator *I) {
    struct State *T = I->state;
    double deadline = now() + I->slice;
    if (!T->begun) {
        if (!keep(I, 0)) return OUT_OF_MEMORY;
        if (I->end > I->t && I->nx && I->step == 0 && !first_step(I)) return INPUT_FAILED;
        T->begun = 1;
    }
    while (I->t < I->end && I->nx) {
        if (I->steps >= I->max_steps) return TOO_MANY_STEPS;
        if (T->newton_now && !present(&I->jvp)) return NEEDS_JACOBIAN;
        double end = I->end, stop = next_stop(I);
        if (I->t >= end) break;
        I->end = stop;
        enum Code code = I->step > 0 ? one_fixed(I) : one_adaptive(I);
        I->end = end;
        if (code == REACHED_END && I->guards) code = watch(I);
        if (code == REACHED_END && stop < end && I->t >= stop) cross_break(I);
        if (code != REACHED_END) return code;
        if (I->newton == WHERE_SLOW && I->step == 0 && T->hard >= T->asked) {
            T->asked = T->asked < 1000 ? 2 * T->asked : T->asked;
            T->hard = 0;
            return SLOW;
        }
        if (now() > deadline && I->t < I->end) return PAUSED;
    }
    return REACHED_END;
}

/* Steps until the end, a failure, or the end of the time slice. After the end has been reached it may be set later. */
int advance(Integrator *I) {
    enum Code code = run_steps(I);
    give_directions(I);
    return code;
}

/* A kernel of the same function takes the place of number `which` of the kernels, in their order in Integrator: between steps. */
int exchange(Integrator *I, long which, const Kernel *k) {
    struct State *T = I->state;
    Kernel *kernels[] = {&I->rhs, &I->jvp, &I->projection, &I->guard, &I->variation, &I->projected, &I->clearance};
    const V *in[] = {T->point_in, T->jvp_in, T->projection_in, T->guard_in, T->variation_in, T->projected_in, T->clearance_in};
    V **c[] = {&T->rhs_c, &T->jvp_c, &T->projection_c, &T->guard_c, &T->variation_c, &T->projected_c, &T->clearance_c};
    if (in[which] && !prepared(I, k, in[which], c[which])) return 0;
    *kernels[which] = *k;
    return 1;
}

/* From the next step on, stages are solved by Newton; `jvp` must be set. */
void use_newton(Integrator *I) {
    I->state->newton_now = 1;
    I->state->jacobian_fresh = 0;
    I->state->hard = 0;
    I->state->asked = 4;
}
