/* Steps until the end, a failure, or the end of the time slice. */
int advance(Integrator *I) {
    struct State *T = I->state;
    double deadline = now() + I->slice;
    if (!T->begun) {
        set_scale(I);
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
        if (I->newton == WHERE_SLOW && !T->newton_now && T->hard >= T->asked) {
            T->asked = T->asked < 1000 ? 4 * T->asked : T->asked;
            T->hard = 0;
            return SLOW;
        }
        if (now() > deadline && I->t < I->end) return PAUSED;
    }
    return REACHED_END;
}

/* From the next step on, stages are solved by Newton; `jvp` must be set. */
void use_newton(Integrator *I) {
    I->state->newton_now = 1;
    I->state->jacobian_fresh = 0;
    I->state->hard = 0;
}
