/* Simplified Newton iteration in the eigenvectors of A: Hairer and Wanner, Solving ODEs II, section IV.8. */

/* Costs of Newton's iteration, in operations on lanes. */
static double jacobian_cost(const Integrator *I) {
    return (double)((I->pattern.colours + COUNTED - 1) / COUNTED) * (3 * (double)I->operations + 150 * (double)I->nx);
}
static double factor_cost(const Integrator *I, const Method *m) {
    return ceil((double)m->eigenvalues / COUNTED) * (3.5 * I->pattern.work + 50 * I->pattern.fill);
}
static double direction_cost(const Integrator *I, const Method *m) {
    double n = (double)I->nx, e = (double)m->eigenvalues;
    return n * (60 + 5 * (e + (double)m->stages)) + ceil(e / COUNTED) * 10 * I->pattern.fill;
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

/* Number e of values, or the last one where there are fewer, in lanes from e on. */
static V in_lanes(const double *values, long stride, long e, long count) {
    V v = v_all(0.0);
    for (long l = 0; l < LANES; l++) v[l] = values[(e + l < count ? e + l : count - 1) * stride];
    return v;
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
static void newton_direction(Integrator *I, const Method *m, const V *R, V *dK) {
    struct Sparse *S = &I->state->sparse;
    long n = I->nx, s = m->stages, count = m->eigenvalues, blocks = (s + LANES - 1) / LANES;
    memset(dK, 0, sizeof(V) * (size_t)(blocks * n));
    I->work += direction_cost(I, m);
    for (long e = 0; e < count; e += LANES) {
        V re[MOST_STAGES], im[MOST_STAGES];
        for (long j = 0; j < s; j++) {
            re[j] = in_lanes(m->W_re + j, s, e, count);
            im[j] = in_lanes(m->W_im + j, s, e, count);
        }
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
            for (long l = 0; l < here; l++) {
                re[l] = in_lanes(m->V_re + e + l, count, b * LANES, s);
                im[l] = in_lanes(m->V_im + e + l, count, b * LANES, s);
            }
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
            V d = dK[b * I->nx + i];
            if (T->noisy) d = v_larger(v_abs(d) - v_all(0.25 * T->noise[i]), v_all(0.0));
            d = d * v_all(T->factor[i]);
            part = v_fma(d, d, part);
        }
        parts[b] = part * S->counted[b];
    }
    return sum_of_blocks(parts, S->blocks);
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
        newton_direction(I, m, T->residual, T->dK);
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
