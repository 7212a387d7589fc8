/* Simplified Newton iteration in the eigenvectors of A: Hairer and Wanner, Solving ODEs II, section IV.8. */

#define MIXED 6      /* pairs of changes and rates, at most, that tell how changes go with these */
#define NO_NEWS 1e-8 /* of the square of a change: so much beside the others says nothing */

/* Costs of Newton's iteration, in operations on lanes. */
static double jacobian_cost(const Integrator *I) {
    return (double)((I->pattern.colours + COUNTED - 1) / COUNTED) * (3 * (double)I->operations + 150 * (double)I->nx);
}
static double factor_cost(const Integrator *I, const Method *m) {
    return ceil((double)m->eigenvalues / COUNTED) * (3.5 * I->pattern.work + 50 * I->pattern.fill);
}
static double solve_cost(const Integrator *I, const Method *m) { return ceil((double)m->eigenvalues / COUNTED) * 10 * I->pattern.fill; }
static double direction_cost(const Integrator *I, const Method *m) {
    double n = (double)I->nx, e = (double)m->eigenvalues;
    return n * (60 + 5 * (e + (double)m->stages)) + solve_cost(I, m);
}

static int make_newton(Integrator *I) {
    struct State *T = I->state;
    if (T->J) return 1;
    long n = I->nx, m = 0;
    for (long k = 0; k < I->methods; k++)
        if (I->method_list[k].eigenvalues > m) m = I->method_list[k].eigenvalues;
    T->J = reserve_doubles(I, I->pattern.start[n] + 1);
    T->row = reserve_doubles(I, n);
    if (!make_sparse(I)) return 0;
    for (long b = 0; b < (m + LANES - 1) / LANES; b++)
        if (!make_factors(I, &T->sparse.blocks[b])) return 0;
    T->jvp_in = reserve_lanes(I, I->jvp.inputs);
    T->jvp_out = reserve_lanes(I, I->jvp.outputs);
    long s = 0;
    for (long k = 0; k < I->methods; k++)
        if (I->method_list[k].stages > s) s = I->method_list[k].stages;
    T->dK = reserve_lanes(I, (s + LANES - 1) / LANES * n);
    T->residual = reserve_lanes(I, (s + LANES - 1) / LANES * n);
    if (slips_turn(I)) {
        T->mixed = reserve_lanes(I, 2 * (MIXED + 1) * ((s + LANES - 1) / LANES * n));
        T->mixed_by = reserve_doubles(I, n);
        if (!I->counted && (!T->mixed || !T->mixed_by)) return 0;
    }
    if (I->counted) return prepared(I, &I->jvp, T->jvp_in, &T->jvp_c);
    if (!T->J || !T->row || !T->jvp_in || !T->jvp_out || !T->dK || !T->residual) return 0;
    for (long i = 0; i < I->np; i++) T->jvp_in[1 + I->nx + I->nu + i] = v_all(I->parameters[i]);
    return prepared(I, &I->jvp, T->jvp_in, &T->jvp_c);
}

/* J = df/dx at (t, x), exact, LANES directions at a time, each the sum of those of columns that share no row. */
static int jacobian(Integrator *I, double t, const double *x) {
    struct State *T = I->state;
    long n = I->nx, fixed = 1 + n + I->nu + I->np;
    V *in = T->jvp_in;
    in[0] = v_all(t);
    for (long i = 0; i < I->nu - I->held; i++) in[1 + n + i] = v_all(I->u[i]);
    if (!inputs_at(I, in[0], 1, in + 1 + n)) return 0;
    for (long i = 0; i < n; i++) in[1 + i] = v_all(x[i]);
    for (long i = fixed; i < I->jvp.inputs; i++) in[i] = v_all(0.0);
    for (long d = 0; d < I->pattern.colours; d += LANES) {
        for (long j = 0; j < n; j++) {
            in[fixed + j] = v_all(0.0);
            if (I->pattern.colour[j] >= d && I->pattern.colour[j] < d + LANES) in[fixed + j][I->pattern.colour[j] - d] = 1.0;
        }
        run_masked(I, OF_JACOBIAN, in, T->jvp_c, T->jvp_out);
        for (long j = 0; j < n; j++) {
            if (I->pattern.colour[j] < d || I->pattern.colour[j] >= d + LANES) continue;
            for (long a = I->pattern.start[j]; a < I->pattern.start[j + 1]; a++) T->J[a] = T->jvp_out[I->pattern.row[a]][I->pattern.colour[j] - d];
        }
    }
    I->work += jacobian_cost(I);
    T->jacobian_fresh = 1;
    T->jacobian_time = t;
    T->factored_h = 0;
    return 1;
}

static int refresh_jacobian(Integrator *I) {
    return make_newton(I) && (I->state->jacobian_fresh || jacobian(I, I->t, I->x));
}

/* The factors of 1 - h lambda J. 0 when it is singular, or memory is short. */
static int factor_shifted(Integrator *I, const Method *m, double h) {
    measure_sparse_rows(I, h * m->eigen_re[0], h * m->eigen_im[0], I->state->scale);
    struct Factors *first = I->state->sparse.blocks;
    for (long e = 0; e < m->eigenvalues; e += LANES) {
        struct Factors *F = &first[e / LANES];
        V re = in_lanes(m->eigen_re, 1, e, m->eigenvalues) * v_all(h), im = in_lanes(m->eigen_im, 1, e, m->eigenvalues) * v_all(h);
        if (e > 0) {
            if (!same_pivots(I, F, first) || !factor_again(I, F, re, im, 0)) return 0;
        } else if (!(F->known && !present(&I->clearance) && factor_again(I, F, re, im, 1)) && !factor_anew(I, F, re, im)) { /* nearly singular loops want the best pivots */
            return 0;
        }
    }
    return 1;
}

/* Factors 1 - h lambda J for the eigenvalues of the method's A. */
static int factorise(Integrator *I, const Method *m, double h) {
    struct State *T = I->state;
    if (T->factored_h == h && T->factored_method == I->method) return 1;
    T->factored_h = 0;
    if (!factor_shifted(I, m, h)) return 0;
    T->factored_h = h;
    T->factored_method = I->method;
    I->factorisations++;
    I->work += factor_cost(I, m);
    return 1;
}

/* dK = (1 - h A x J)^-1 R for residuals R of the stage equations, both (blocks, nx) with stages in lanes. */
static void newton_direction(Integrator *I, const Stages *of, const V *R, V *dK) {
    struct Sparse *S = &I->state->sparse;
    long n = I->nx, s = of->s, count = of->method->eigenvalues, blocks = of->blocks;
    memset(dK, 0, sizeof(V) * (size_t)(blocks * n));
    I->work += direction_cost(I, of->method);
    for (long e = 0; e < count; e += LANES) {
        const V *re = of->W_re + e / LANES * s, *im = of->W_im + e / LANES * s;
        for (long i = 0; i < n; i++) {
            V x = v_all(0.0), y = v_all(0.0);
            for (long j = 0; j < s; j++) {
                V r = v_all(R[j / LANES * n + i][j % LANES]);
                x += re[j] * r;
                y += im[j] * r;
            }
            S->re[i] = x;
            S->im[i] = y;
        }
        solve_sparse(I, &S->blocks[e / LANES]);
        long here = count - e < LANES ? count - e : LANES;
        for (long b = 0; b < blocks; b++) {
            re = of->V_re + b * count + e, im = of->V_im + b * count + e;
            for (long i = 0; i < n; i++)
                for (long l = 0; l < here; l++) dK[b * n + i] += re[l] * v_all(S->re[n + i][l]) - im[l] * v_all(S->im[n + i][l]);
        }
    }
}

/* Changes dK (blocks, nx) of rates in units of the scale, what rounding makes of them forgiven: squared, summed over states and stages. */
static double sum_of_changes(const Integrator *I, const Stages *S, const V *dK) {
    const struct State *T = I->state;
    V parts[BLOCKS];
    for (long b = 0; b < S->blocks; b++) {
        V part = v_all(0.0);
        for (long i = 0; i < I->nx; i++) {
            V d = scaled_change(T, i, dK[b * I->nx + i]);
            part = v_fma(d, d, part);
        }
        parts[b] = part * S->counted[b];
    }
    return sum_of_blocks(parts, S->blocks);
}

/* The product of two changes of rates (blocks, nx), in units of T->mixed_by. */
static double product_of(const Integrator *I, const Stages *S, const V *a, const V *b) {
    const double *by = I->state->mixed_by;
    V parts[BLOCKS];
    for (long k = 0; k < S->blocks; k++) {
        V part = v_all(0.0);
        for (long i = 0; i < I->nx; i++) part = v_fma(a[k * I->nx + i] * v_all(by[i]), b[k * I->nx + i] * v_all(by[i]), part);
        parts[k] = part * S->counted[k];
    }
    return sum_of_blocks(parts, S->blocks);
}

/* Anderson's mixing (1965): of all rates that the last ones, and the changes dK that Newton's iteration made of them, lead to, those are gone on from of which least is left, as far as changes have gone
   with rates until now. Slips that begin or end stiffen their directions, or slacken them, many times in a step: then one Jacobian leaves much of a change, but few directions of it. */
static void mix(Integrator *I, const Stages *S, int count) {
    struct State *T = I->state;
    long n = I->nx, size = S->blocks * n;
    V *last = T->mixed, *pairs = last + 2 * size, *dK = T->dK; /* a change, and the rates that it is of; differences of such, whose changes are orthonormal */
    if (count == 0) {
        T->mixes = 0;
        memcpy(T->mixed_by, T->factor, sizeof(double) * (size_t)n);
    } else if (T->mixes < MIXED) {
        V *mine = pairs + 2 * T->mixes * size;
        for (long k = 0; k < size; k++) {
            mine[k] = dK[k] - last[k];
            mine[size + k] = S->K[k / n][k % n] - last[size + k];
        }
        double all = product_of(I, S, mine, mine);
        for (long j = 0; j < 2 * T->mixes; j++) { /* twice is enough */
            const V *other = pairs + 2 * (j % T->mixes) * size;
            double part = product_of(I, S, mine, other);
            for (long k = 0; k < 2 * size; k++) mine[k] -= v_all(part) * other[k];
        }
        double left = product_of(I, S, mine, mine);
        if (left > NO_NEWS * all && left < INFINITY) {
            for (long k = 0; k < 2 * size; k++) mine[k] *= v_all(1 / sqrt(left));
            T->mixes++;
        }
    }
    memcpy(last, dK, sizeof(V) * (size_t)size);
    for (long k = 0; k < size; k++) last[size + k] = S->K[k / n][k % n];
    for (long j = 0; j < T->mixes; j++) {
        const V *other = pairs + 2 * j * size;
        double part = product_of(I, S, dK, other);
        for (long k = 0; k < size; k++) dK[k] -= v_all(part) * (other[k] + other[size + k]);
    }
}

static int newton(Integrator *I, Stages *S, double h, const double *x, Judge *J) {
    struct State *T = I->state;
    const Method *m = S->method;
    long n = I->nx;
    if (!factorise(I, m, h)) return 0;
    for (;;) {
        scale_rates(I, S);
        for (long b = 0; b < S->blocks; b++)
            for (long i = 0; i < n; i++) S->in[b][1 + i] = combined(S->mu + b * S->blocks * LANES, S->L, S->blocks, i, v_all(x[i]));
        stage_rates(I, S);
        if (present(&I->clearance) && J->count < 2) find_zone(I, S, J);
        if (present(&I->clearance)) correct_stages(I, S);
        if (S->around) settle(I, S, S->N, x);
        for (long b = 0; b < S->blocks; b++)
            for (long i = 0; i < n; i++) T->residual[b * n + i] = S->N[b][i] - S->K[b][i];
        newton_direction(I, S, T->residual, T->dK);
        if (slips_turn(I)) {
            widen(I, S, S->K, h);
            mix(I, S, J->count);
        }
        for (long b = 0; b < S->blocks; b++)
            for (long i = 0; i < n; i++) S->K[b][i] += T->dK[b * n + i];
        widen(I, S, S->K, h);
        double sum = S->around ? change_along(I, S, T->dK, T->factor) : sum_of_changes(I, S, T->dK);
        enum Verdict v = judge(J, sqrt(sum / (double)S->s));
        if (v != GO_ON) return v == DONE;
    }
}

/* What is left of a change of rates in a step of size h where fast decay forgets it, in place: (1 - h gamma J)^-1, by the factors of the most real
   eigenvalue gamma. */
static void forget_fast(Integrator *I, const Method *m, double *rates) {
    struct State *T = I->state;
    struct Sparse *S = &T->sparse;
    long n = I->nx, e = 0;
    for (long k = 1; k < m->eigenvalues; k++)
        if (fabs(m->eigen_im[k]) < fabs(m->eigen_im[e])) e = k;
    for (long i = 0; i < n; i++) {
        S->re[i] = v_all(rates[i]);
        S->im[i] = v_all(0.0);
    }
    solve_sparse(I, &S->blocks[e / LANES]);
    for (long i = 0; i < n; i++) rates[i] = S->re[n + i][e % LANES];
}

/* The weight of (1 - h lambda_e J)^-1 in (h J)^s / Q(h J), Q(z) the product of 1 - lambda z over all eigenvalues of A, into re and im, doubled where the other
   one of a pair has its conjugate: partial fractions. */
static void weight_of(const Method *m, long e, double *re, double *im) {
    double power[2] = {1, 0}, product[2] = {1, 0}, size = m->eigen_re[e] * m->eigen_re[e] + m->eigen_im[e] * m->eigen_im[e];
    double inverse[2] = {m->eigen_re[e] / size, -m->eigen_im[e] / size};
    for (long k = 0; k < m->stages; k++) {
        double a = power[0] * inverse[0] - power[1] * inverse[1];
        power[1] = power[0] * inverse[1] + power[1] * inverse[0];
        power[0] = a;
    }
    for (long f = 0; f < m->eigenvalues; f++)
        for (int sign = 1; sign >= -1; sign -= 2) {
            double x = m->eigen_re[f], y = sign * m->eigen_im[f];
            if ((sign < 0 && y == 0) || (f == e && sign > 0)) continue;
            double a = 1 - (x * inverse[0] - y * inverse[1]), b = -(x * inverse[1] + y * inverse[0]), c = product[0] * a - product[1] * b;
            product[1] = product[0] * b + product[1] * a;
            product[0] = c;
        }
    double all = (product[0] * product[0] + product[1] * product[1]) / (m->eigen_im[e] == 0 ? 1 : 2);
    *re = (power[0] * product[0] + power[1] * product[1]) / all;
    *im = (power[1] * product[0] - power[0] * product[1]) / all;
}

/* left (n) times (h J)^s / Q(h J), into `kept` (n), by the factors of Newton's iteration: where motions are slow, that leaves as little as the order does; of fast ones, all. */
static void keep_fast(Integrator *I, const Method *m, const double *left, double *kept) {
    struct Sparse *S = &I->state->sparse;
    long n = I->nx;
    double all = 1; /* the limit far away */
    for (long e = 0; e < m->eigenvalues; e++)
        all /= m->eigen_im[e] == 0 ? -m->eigen_re[e] : m->eigen_re[e] * m->eigen_re[e] + m->eigen_im[e] * m->eigen_im[e];
    for (long i = 0; i < n; i++) kept[i] = all * left[i];
    for (long e = 0; e < m->eigenvalues; e += LANES) {
        for (long i = 0; i < n; i++) {
            S->re[i] = v_all(left[i]);
            S->im[i] = v_all(0.0);
        }
        solve_sparse(I, &S->blocks[e / LANES]);
        long here = m->eigenvalues - e < LANES ? m->eigenvalues - e : LANES;
        for (long l = 0; l < here; l++) {
            double re, im;
            weight_of(m, e + l, &re, &im);
            for (long i = 0; i < n; i++) kept[i] = kept[i] + re * S->re[n + i][l] - im * S->im[n + i][l];
        }
    }
    I->work += solve_cost(I, m);
}

#define AS_LONG 0.03 /* units of the scale that a step may miss so that the next one is as long: they add up where something oscillates */
#define TOO_LONG 3   /* times as much is too much */

/* What a step of Gauss misses in motions that are too fast for it, as an error that its order would explain. That is twice its stages because what is left of the
   rates, a multiple of the Legendre polynomial P_s, is integrated with what the rest of the step makes of it, which lower polynomials tell. Not so for a fast oscillation,
   of which a small part in a slow motion does not show in its coefficients. What is left is known at the end of the step, and the integral of exp(J (h - t)) P_s(t) over it
   is s! / (2 s + 1)! (h J)^s / Q(h J) where J is small, Q the denominator of the Pade approximant. Where it is large that has to be forgotten once: then it is at most seven times
   too small for eigenvalues that oscillate or decay and 3 to 12 stages, hence twice as much (tests/test_integrators.py). 0 where factors are those of another step. */
static double missed_as_fast(Integrator *I, const Stages *S, double h) {
    struct State *T = I->state;
    double *left = T->most, *kept = T->before;
    long n = I->nx, s = S->s, width = S->blocks * LANES;
    if (s < 3 || !T->newton_now || S->method->kind != GAUSS || S->around || T->factored_h != h || T->factored_method != I->method) return 0;
    for (long i = 0; i < n; i++) T->before[i] = I->x[i] + T->increment[i];
    if (!T->end_known && !rate_at(I, I->t + h, T->before, T->end_rate)) return 0; /* told when ends are looked at */
    T->end_known = 1;
    double factor = 2;
    for (long k = s + 1; k <= 2 * s + 1; k++) factor /= (double)k;
    for (long i = 0; i < n; i++) {
        double end = -T->end_rate[i];
        for (long k = s - 1; k >= 0; k--) end += S->a[i * width + k];
        left[i] = factor * copysign(heard(end, (double)s * T->spread[i]), end);
    }
    keep_fast(I, S->method, left, kept);
    if (!(moved_by(I, kept, h) > 0.1 * AS_LONG)) return 0;
    forget_fast(I, S->method, kept);
    double times = moved_by(I, kept, h) / AS_LONG, error = power(CAREFUL * power(times, 1 / (double)(s + 1)), (double)(S->method->order + 1));
    return times < 0.1 ? 0 : times > TOO_LONG ? fmax(error, 1 + EPS) : error;
}
