/* Forward sensitivities, directions in lanes: the linear stage equations of the variational equation S' = J S + f_p p', solved after
   each step at its stage states with the same iteration, so that they are derivatives of the numerical motion itself, in steps that are short enough for them,
   too: what the motion does not do, a little off it may. Hairer, Norsett, Wanner, Solving ODEs I, section II.6. */

#define UNSTEADY 1e-9 /* what rounding leaves unknown of derivatives of rates next to singular positions, in a step */
#define FALLEN_OFF 1e-3 /* of a change, which no state falls by in one go */
#define NOISY 10.0    /* times rounding of rates, what counts as no change of them */

static long direction_blocks(const Integrator *I) { return (I->directions + LANES - 1) / LANES; }

static int make_sensitivity(Integrator *I) {
    struct State *T = I->state;
    long n = I->nx, B = direction_blocks(I), most = 0, fixed = 1 + n + I->nu;
    for (long k = 0; k < I->methods; k++)
        if (I->method_list[k].stages > most) most = I->method_list[k].stages;
    long inside = I->asked && I->fine && I->fine->stages > most ? I->fine->stages : most; /* see asked.h */
    if (!arranged(I, &I->variation, &T->variation_in, &T->variation_out, &T->variation_c, fixed)) return 0;
    for (long i = 0; i < I->nu - I->held && !I->counted; i++) T->variation_in[1 + n + i] = v_all(I->u[i]);
    if (I->ng && !arranged(I, &I->projected, &T->projected_in, &T->projected_out, &T->projected_c, 1 + n + I->nu - I->held + I->masks)) return 0;
    T->D = reserve_lanes(I, B * n);
    T->D_size = reserve_lanes(I, B * n);
    T->D_noise = reserve_lanes(I, n);
    T->D_rates = reserve_lanes(I, B * most * n);
    T->D_last = reserve_lanes(I, B * most * n);
    T->D_stages = reserve_lanes(I, inside * n);
    T->D_new = reserve_lanes(I, inside * n);
    if (I->counted) return 1;
    if (!T->D || !T->D_size || !T->D_noise || !T->D_rates || !T->D_last || !T->D_stages || !T->D_new) return 0;
    for (long d = 0; d < B * LANES; d++)
        for (long i = 0; i < n; i++) T->D[(d / LANES) * n + i][d % LANES] = I->S[(d < I->directions ? d : 0) * n + i];
    return 1;
}

static double change_of_discrete(const Integrator *I, long direction, long k) { return I->state->discrete_change[(direction < I->directions ? direction : 0) * I->discretes + k]; }

/* Directions of the first so many inputs, up to the masks at least where parts remember something, and of parameters of one block. */
static void set_directions(Integrator *I, V *in, long block, long inputs) {
    for (long l = 0; l < LANES; l++) {
        long d = block * LANES + l < I->directions ? block * LANES + l : 0;
        for (long i = 0; i < inputs; i++) in[i][l] = I->du[d * I->nu + i];
        for (long k = 0; k < I->discretes; k++) in[I->nu - I->held + I->masks - I->discretes + k][l] = change_of_discrete(I, d, k);
        for (long i = 0; i < I->np; i++) in[inputs + i][l] = I->dp[d * I->np + i];
    }
}

/* d f at stage j of the step, for the direction of the states dx (nx). */
static void variation_at(Integrator *I, Stages *S, long j, const V *dx, V *out) {
    struct State *T = I->state;
    V *in = T->variation_in;
    const V *stage = S->in[j / LANES];
    long l = j % LANES, n = I->nx;
    in[0] = v_all(stage[0][l]);
    for (long i = 0; i < n + I->nu; i++) in[1 + i] = v_all(stage[1 + i][l]);
    memcpy(in + 1 + n + I->nu + I->np, dx, sizeof(V) * (size_t)n);
    run_kernel(&I->variation, in, T->variation_c, out, T->work);
}

/* By how many units in the last place an argument is moved, in one of the samples. */
static double part_of(long argument, long sample) { return (double)((7 * argument + 3 * sample) % 5 - 2); }

/* What rounding makes of the rates of directions dx (nx) in a step h, by its last stage, into `noise`: terms that cancel leave numbers without a digit
   that is right, and an iteration on nothing else never ends. By values of the state, time and parameters that are next to one another: what stands still at
   zero has no others; by directions to either side, whose
   mean has the rates of dx since these are linear in it; and by directions as far apart as such rates move them. */
static void noise_of_variation(Integrator *I, Stages *S, double h, const V *dx, const V *size, V *noise) {
    struct State *T = I->state;
    const V *stage = S->in[(S->s - 1) / LANES];
    long l = (S->s - 1) % LANES, n = I->nx;
    V *in = T->variation_in, *direction = in + 1 + n + I->nu + I->np, *base = T->variation_out, *mean = T->D_stages, *other = T->D_new;
    variation_at(I, S, S->s - 1, dx, base);
    for (long i = 0; i < n; i++) noise[i] = v_all(0.0);
    for (long sample = 1; sample <= 9; sample++) {
        int states = sample <= 3, aside = sample > 3 && sample <= 6;
        for (int side = 1; side >= (aside ? -1 : 1); side -= 2) {
            for (long i = 0; i < n; i++) {
                double part = part_of(i, sample), moved = (double)side * part / 8;
                in[1 + i] = v_all(stage[1 + i][l] * (states ? 1 + part * EPS : 1.0));
                direction[i] = dx[i] + (states ? v_all(0.0) : aside ? v_all(moved) * size[i] : v_all(part * h) * noise[i]);
            }
            in[0] = v_all(stage[0][l] * (states ? 1 + part_of(n, sample) * EPS : 1.0));
            for (long i = 0; i < I->np; i++) in[1 + n + I->nu + i] = v_all(I->parameters[i] * (states ? 1 + part_of(n + 1 + i, sample) * EPS : 1.0));
            run_kernel(&I->variation, in, T->variation_c, other, T->work);
            for (long i = 0; i < n; i++) mean[i] = side > 0 ? other[i] : v_all(0.5) * (mean[i] + other[i]);
        }
        for (long i = 0; i < n; i++) noise[i] = v_larger(noise[i], v_abs(mean[i] - base[i]));
    }
}

/* How far apart two guesses of the rates are, direction by direction, in tolerances of what they move in a step, each state by itself: what others are moved by
   says nothing of it. `least`: changes of rates that are a tolerance whatever these move. */
static void apart_by(const Integrator *I, const V *N, const V *K, const V *size, const V *least, long s, double h, double *apart) {
    double tolerance = I->step > 0 ? 1.0 : I->rtol;
    V sum = v_all(0.0);
    for (long i = 0; i < I->nx; i++) {
        if (I->state->copied[i] && !I->state->newton_now) continue;
        V largest = v_larger(v_larger(size[i], v_all(NOTHING)), least[i] * v_all(h / tolerance));
        for (long j = 0; j < s; j++) largest = v_larger(largest, v_abs(N[j * I->nx + i]) * v_all(h));
        for (long j = 0; j < s; j++) {
            V d = (N[j * I->nx + i] - K[j * I->nx + i]) * v_all(h) / (largest * v_all(tolerance));
            sum = v_fma(d, d, sum);
        }
    }
    for (long l = 0; l < LANES; l++) apart[l] = sqrt(sum[l] / (double)s);
}

/* Whether what Newton's iteration says is so by what its equations are off by, which shrinks as slowly as any part of the error. */
static int has_converged(const Judge *J, double missed, double last) {
    if (missed <= J->tolerance || J->change <= 64 * J->floor) return 1;
    return J->count > 1 && missed < last && J->change * missed <= J->tolerance * (last - missed);
}

/* The stage equations of one block of directions; their rates K (s, n) in, better ones out. Returns whether they converged. */
static int solve_variation(Integrator *I, Stages *S, double h, long block, V *K) {
    struct State *T = I->state;
    long n = I->nx, s = S->s;
    const double *A = S->method->A;
    V *D = T->D + block * n, *size = T->D_size + block * n, *noise = T->D_noise, *X = T->D_stages, *N = T->D_new;
    set_directions(I, T->variation_in + 1 + n + I->nu + I->np + n, block, I->nu);
    for (long i = 0; i < n; i++) size[i] = v_larger(size[i], v_abs(D[i]));
    double tolerance = I->step > 0 ? 0 : 1e-3;
    Judge judgements[LANES];
    double changed[LANES], missed[LANES] = {0}, missed_last[LANES]; /* what the stage equations are off by: Newton's steps alone may be small for a Jacobian that is too large */
    Bits ready = i_all(0); /* directions that have converged, and stay as they are */
    int looked = 0; /* whether noise is that of this step */
    for (long i = 0; i < n; i++) noise[i] = v_all(0.0);
    Judge fresh = new_judge(tolerance, (S->around || S->exact ? UNSTEADY : 4 * EPS) / (I->step > 0 ? 1.0 : I->rtol), T->newton_now ? 15 : 50);
    for (long l = 0; l < LANES; l++) judgements[l] = fresh;
    for (;;) {
        for (long j = 0; j < s; j++)
            for (long i = 0; i < n; i++) {
                if (T->copied[i] && !T->newton_now) continue;
                V x = v_all(0.0);
                for (long k = 0; k < s; k++) x = v_fma(v_all(A[j * s + k]), K[k * n + i], x);
                X[j * n + i] = v_fma(v_all(h), x, D[i]);
            }
        for (long c = 0; c < I->copies && !T->newton_now; c++)
            for (long j = 0; j < s; j++) {
                long to = I->copy_to[c], from = I->copy_from[c];
                V x = v_all(0.0);
                for (long k = 0; k < s; k++) x = v_fma(v_all(A[j * s + k]), X[k * n + from], x);
                X[j * n + to] = v_fma(v_all(h), x, D[to]);
            }
        for (long j = 0; j < s; j++) variation_at(I, S, j, X + j * n, N + j * n);
        memcpy(missed_last, missed, sizeof missed);
        if (T->newton_now) apart_by(I, N, K, size, noise, s, h, missed);
        if (T->newton_now)
            for (long l = 0; l < LANES; l++) {
                if (ready[l]) continue;
                for (long j = 0; j < S->blocks * LANES; j++)
                    for (long i = 0, q = (j < s ? j : s - 1) * n; i < n; i++, q++) T->residual[j / LANES * n + i][j % LANES] = N[q][l] - K[q][l];
                newton_direction(I, S, T->residual, T->dK);
                for (long j = 0; j < s; j++)
                    for (long i = 0, q = j * n; i < n; i++, q++) N[q][l] = K[q][l] + T->dK[j / LANES * n + i][j % LANES];
            }
        apart_by(I, N, K, size, noise, s, h, changed);
        for (long q = 0; q < s * n; q++) K[q] = v_select(ready, K[q], N[q]);
        int going = 0;
        for (long l = 0; l < LANES; l++) {
            if (ready[l]) continue;
            double before = judgements[l].change;
            enum Verdict v = judge(&judgements[l], changed[l]);
            if (v == DONE && changed[l] > 1 && changed[l] < FALLEN_OFF * before) v = GO_ON; /* what is left is of another state than what was */
            if (v == DONE && T->newton_now && !has_converged(&judgements[l], missed[l], missed_last[l])) v = judgements[l].count < judgements[l].limit ? GO_ON : HOPELESS;
            if (v == HOPELESS && looked) return 0;
            if (v == HOPELESS) {
                noise_of_variation(I, S, h, D, size, noise);
                for (long i = 0; i < n; i++) noise[i] *= v_all(NOISY / (64 * fresh.floor));
                looked = going = 1;
                for (long k = 0; k < LANES; k++) judgements[k] = fresh;
                break;
            }
            ready[l] = v == DONE ? -1 : 0;
            going |= v == GO_ON;
        }
        if (!going) return 1;
    }
}

/* The sum of so many rows of a (count, n), each times its weight, into `out` (n). */
static void weigh(const double *weight, const V *a, long count, long n, V *out) {
    for (long i = 0; i < n; i++) {
        V sum = v_all(0.0);
        for (long k = 0; k < count; k++) sum = v_fma(v_all(weight[k]), a[k * n + i], sum);
        out[i] = sum;
    }
}

/* Rates of all directions over the step whose stages are in S. Returns 0 when some do not converge. */
static int solve_variations(Integrator *I, Stages *S, double h) {
    struct State *T = I->state;
    long n = I->nx, s = S->s;
    double P[64], ratio = T->last_h > 0 ? h / T->last_h : 0;
    for (long b = 0; b < direction_blocks(I); b++) {
        V *K = T->D_rates + b * s * n, *a = T->D_last + b * s * n;
        set_directions(I, T->variation_in + 1 + n + I->nu + I->np + n, b, I->nu);
        for (long j = 0; j < s; j++) {
            if (ratio == 0 || T->last_s != s) {
                variation_at(I, S, j, T->D + b * n, K + j * n);
                continue;
            }
            legendre_values(1 + S->method->c[j] * ratio, s, P);
            weigh(P, a, T->terms < s ? T->terms : s, n, K + j * n);
        }
        if (!solve_variation(I, S, h, b, K)) return 0;
    }
    return 1;
}

/* Legendre coefficients (s, n) of the rates K (s, n) of one block of directions. */
static void coefficients_of_variation(const Stages *S, long n, const V *K, V *a) {
    for (long k = 0; k < S->s; k++) weigh(S->method->to_legendre + k * S->s, K, S->s, n, a + k * n);
}

/* Sizes (n) of one block of directions, what this step moves them by included. */
static void sizes_of_variation(const Integrator *I, const Stages *S, double h, long block, V *size) {
    long n = I->nx;
    const V *K = I->state->D_rates + block * S->s * n;
    for (long i = 0; i < n; i++) {
        size[i] = I->state->D_size[block * n + i];
        for (long j = 0; j < S->s; j++) size[i] = v_larger(size[i], v_abs(K[j * n + i]) * v_all(h));
    }
}

#define AT_LEAST 1e-3 /* of the motion: where a direction moves a state by less than that part of what it moves most, that much is its size */

/* By what part of themselves a direction moves parameters: the largest of all. */
static double part_of_parameters(const Integrator *I, long d) {
    double part = 0;
    for (long i = 0; i < I->np; i++)
        if (I->parameters[i] != 0) part = fmax(part, fabs(I->dp[d * I->np + i] / I->parameters[i]));
    return part;
}

/* The error of a step of one block of directions in tolerances of what they move each state by, largest of all; `noise` (n) of rates is forgiven. */
static double error_of_variation(const Integrator *I, const Stages *S, double h, long block, const V *noise) {
    const struct State *T = I->state;
    long n = I->nx, s = S->s;
    V *a = T->D_new, *size = T->D_stages, moved = v_all(0.0);
    double sizes[64], worst = 0;
    coefficients_of_variation(S, n, T->D_rates + block * s * n, a);
    sizes_of_variation(I, S, h, block, size);
    for (long i = 0; i < n; i++)
        if (T->scale[i] > NOTHING) moved = v_larger(moved, size[i] / v_all(T->scale[i]));
    for (long l = 0; l < LANES && block * LANES + l < I->directions; l++) {
        double largest = 0, rounded = EPS * part_of_parameters(I, block * LANES + l); /* of states: so little is nothing, as of what is held whatever the parameter is */
        memset(sizes, 0, sizeof sizes);
        for (long i = 0; i < n; i++) {
            double scale = fmax(I->rtol * fmax(size[i][l], T->scale[i] > NOTHING ? AT_LEAST * moved[l] * T->scale[i] : 0), rounded * T->size[i]);
            for (long k = 0; k < s && scale > 0; k++)
                sizes[k] = fmax(sizes[k], heard(a[k * n + i][l], (double)(2 * k + 1) * noise[i][l]) * (h / scale));
        }
        for (long k = 0; k < s; k++) largest = fmax(largest, sizes[k]);
        if (largest > 0) worst = fmax(worst, error_by_decay(S->method, sizes, largest));
    }
    return worst;
}

#define MAY_BE_NOISE 1e-6 /* of a tolerance: an error for which steps of the motion alone would not become shorter, and that may be rounding */

/* The error of a step of all directions, and of the motion; beside singular positions, where their rates lose digits, and with few stages the motion alone is asked. What is
   forgiven to rounding counts where steps are refused, and where they become shorter and shorter: rounding does not. */
static double error_of_variations(Integrator *I, Stages *S, double h, double motion) {
    struct State *T = I->state;
    long n = I->nx;
    double worst = motion;
    if (!I->directions || S->s < 3 || S->around || S->exact) return motion;
    for (long b = 0; b < direction_blocks(I); b++) {
        V *noise = T->D_noise;
        for (long i = 0; i < n; i++) noise[i] = v_all(0.0);
        double error = error_of_variation(I, S, h, b, noise);
        if (!(error <= 1) || (h < T->last_h && error > fmax(motion, MAY_BE_NOISE))) {
            set_directions(I, T->variation_in + 1 + n + I->nu + I->np + n, b, I->nu);
            noise_of_variation(I, S, h, T->D + b * n, T->D_size + b * n, noise);
            for (long i = 0; i < n; i++) noise[i] *= v_all(FEW);
            error = error_of_variation(I, S, h, b, noise);
        }
        worst = fmax(worst, error);
    }
    return worst;
}

/* Advance all directions with the rates that have been found. */
static void advance_directions(Integrator *I, Stages *S, double h) {
    struct State *T = I->state;
    long n = I->nx, s = S->s;
    for (long b = 0; b < direction_blocks(I); b++) {
        V *a = T->D_last + b * s * n, *D = T->D + b * n;
        coefficients_of_variation(S, n, T->D_rates + b * s * n, a);
        sizes_of_variation(I, S, h, b, T->D_size + b * n);
        for (long i = 0; i < n; i++) D[i] = v_fma(v_all(h), a[i], D[i]);
    }
}

/* Back to directions along the invariants, those D (n) of one block, at the state x at t that has been projected. */
static void project_block(Integrator *I, double t, const double *x, long block, V *D) {
    struct State *T = I->state;
    long n = I->nx, own = I->nu - I->held, nu = own + I->masks;
    V *in = T->projected_in, *change = in + 1 + n + nu + I->np;
    in[0] = v_all(t);
    for (long i = 0; i < n; i++) in[1 + i] = v_all(x[i]);
    for (long k = 0; k < I->masks; k++) in[1 + n + own + k] = v_all(T->side[k]);
    led_by(I, in[0], 1, in + 1 + n);
    memcpy(change, D, sizeof(V) * (size_t)n);
    set_directions(I, change + n, block, I->led || I->discretes ? nu : 0);
    run_kernel(&I->projected, in, T->projected_c, T->projected_out, T->work);
    memcpy(D, T->projected_out, sizeof(V) * (size_t)n);
}

/* The same of all directions, where the motion is now. */
static void project_directions(Integrator *I) {
    for (long b = 0; b < direction_blocks(I); b++) project_block(I, I->t, I->x, b, I->state->D + b * I->nx);
}

/* The sensitivities so far, into S. */
static void give_directions(Integrator *I) {
    for (long d = 0; d < I->directions; d++)
        for (long i = 0; i < I->nx; i++) I->S[d * I->nx + i] = I->state->D[(d / LANES) * I->nx + i][d % LANES];
    for (long k = 0; k < I->directions * I->discretes && I->discrete_S; k++) I->discrete_S[k] = I->state->discrete_change[k];
}
