/* Allocates and prepares. Returns 0 when memory is short. The caller calls `finish` in any case. */
int begin(Integrator *I) {
    long n = I->nx;
    struct State *T = I->state = reserve(I, sizeof(struct State));
    if (!T) return 0;
    T->stages = reserve(I, sizeof(Stages) * (size_t)I->methods);
    double *w = arranged(I, &I->rhs, &T->point_in, &T->point_out, &T->rhs_c, 1 + n + I->nu);
    if (!T->stages || !w) return 0;
    for (long i = 0; i < I->nu; i++) T->point_in[1 + n + i] = v_all(I->u[i]);
    T->work = (V *)w;
    long longest = I->rhs.work;
    if (I->ng) {
        w = arranged(I, &I->projection, &T->projection_in, &T->projection_out, &T->projection_c, 1 + n);
        if (!w) return 0;
        if (I->projection.work > longest) T->work = (V *)w, longest = I->projection.work;
    }
    if (I->clearance.run) {
        w = arranged(I, &I->clearance, &T->clearance_in, &T->clearance_out, &T->clearance_c, 1 + n);
        if (!w || !make_passage(I)) return 0;
        if (I->clearance.work > longest) T->work = (V *)w, longest = I->clearance.work;
    }
    if (I->guards) {
        w = arranged(I, &I->guard, &T->guard_in, &T->guard_out, &T->guard_c, 1 + n + I->nu);
        T->guard_values = reserve_doubles(I, POINTS * I->guards);
        T->chebyshev = reserve_doubles(I, POINTS * POINTS);
        T->guard_noise = reserve_doubles(I, I->guards);
        T->guard_states = reserve(I, sizeof(struct GuardState) * (size_t)I->guards);
        if (!w || !T->guard_values || !T->guard_noise || !T->guard_states || !T->chebyshev) return 0;
        chebyshev_cosines(T->chebyshev);
        for (long i = 0; i < I->nu; i++) T->guard_in[1 + n + i] = v_all(I->u[i]);
        if (I->guard.work > longest) T->work = (V *)w;
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
        if (T->newton_now && !I->jvp.run) return NEEDS_JACOBIAN;
        enum Code code = I->step > 0 ? one_fixed(I) : one_adaptive(I);
        if (code == REACHED_END && I->guards) code = watch(I);
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

/* From the next step on, stages are solved by Newton; `jvp` must be set. */
void use_newton(Integrator *I) {
    I->state->newton_now = 1;
    I->state->jacobian_fresh = 0;
    I->state->hard = 0;
    I->state->asked = 4;
}
