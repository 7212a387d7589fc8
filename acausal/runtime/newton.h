/* Simplified Newton iteration in the eigenvectors of A: Hairer and Wanner, Solving ODEs II, section IV.8. */

static long padded(long n) { return (n + LANES - 1) / LANES * LANES; }

/* Costs of Newton's iteration, in operations on lanes. */
static double jacobian_cost(const Integrator *I) {
    return (double)((I->pattern.colours + COUNTED - 1) / COUNTED) * (2.5 * (double)I->operations + 4 * (double)I->nx);
}
static double dense_cost(const Integrator *I, double eigenvalues) {
    double n = (double)I->nx;
    return eigenvalues * n * n * (5 + 0.5 * n);
}
static double sparse_cost(const Integrator *I, double eigenvalues) {
    return ceil(eigenvalues / COUNTED) * (10 * I->pattern.work + 40 * I->pattern.fill);
}
static int is_sparse(const Integrator *I) { return 2 * sparse_cost(I, 4) < dense_cost(I, 4); }
static double factor_cost(const Integrator *I, const Method *m) {
    return is_sparse(I) ? sparse_cost(I, (double)m->eigenvalues) : dense_cost(I, (double)m->eigenvalues);
}
static double direction_cost(const Integrator *I, const Method *m) {
    double n = (double)I->nx, e = (double)m->eigenvalues;
    return e * 6 * n * (double)m->stages + (is_sparse(I) ? ceil(e / COUNTED) * 20 * I->pattern.fill : 2 * e * n * n);
}

static int make_newton(Integrator *I) {
    struct State *T = I->state;
    if (T->J) return 1;
    long n = I->nx, m = 0;
    for (long k = 0; k < I->methods; k++)
        if (I->method_list[k].eigenvalues > m) m = I->method_list[k].eigenvalues;
    T->padded = padded(n);
    T->J = reserve_doubles(I, I->pattern.start[n] + 1);
    T->row = reserve_doubles(I, n);
    if (is_sparse(I)) {
        if (!make_sparse(I, (m + LANES - 1) / LANES)) return 0;
    } else {
        T->complex_re = (double *)reserve_lanes(I, m * n * T->padded);
        T->complex_im = (double *)reserve_lanes(I, m * n * T->padded);
        T->pivots = reserve(I, sizeof(long) * (size_t)(m * n));
        if (!I->counted && (!T->complex_re || !T->complex_im || !T->pivots)) return 0;
    }
    T->rhs_re = reserve_doubles(I, T->padded);
    T->rhs_im = reserve_doubles(I, T->padded);
    T->jvp_in = reserve_lanes(I, I->jvp.inputs);
    T->jvp_out = reserve_lanes(I, I->jvp.outputs);
    long s = 0;
    for (long k = 0; k < I->methods; k++)
        if (I->method_list[k].stages > s) s = I->method_list[k].stages;
    T->dK = reserve_doubles(I, s * n);
    T->residual = reserve_doubles(I, s * n);
    if (I->counted) return prepared(I, &I->jvp, T->jvp_in, &T->jvp_c);
    if (!T->J || !T->row || !T->rhs_re || !T->rhs_im || !T->jvp_in || !T->jvp_out || !T->dK || !T->residual) return 0;
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
        run_kernel(&I->jvp, in, T->jvp_c, T->jvp_out, T->work);
        for (long j = 0; j < n; j++) {
            if (I->pattern.colour[j] < d || I->pattern.colour[j] >= d + LANES) continue;
            for (long a = I->pattern.start[j]; a < I->pattern.start[j + 1]; a++) T->J[a] = T->jvp_out[I->pattern.row[a]][I->pattern.colour[j] - d];
        }
    }
    T->spent += jacobian_cost(I);
    T->jacobian_fresh = 1;
    T->jacobian_time = t;
    T->factored_h = 0;
    return 1;
}

/* What is much in each row of 1 - z J with entries A, each state counted by its scale: rows have the units of the states. */
static void measure_rows(Integrator *I, const double *A_re, const double *A_im) {
    struct State *T = I->state;
    long n = I->nx, w = T->padded;
    for (long i = 0; i < n; i++) {
        double most = 0;
        for (long j = 0; j < n; j++) most = fmax(most, (fabs(A_re[i * w + j]) + fabs(A_im[i * w + j])) * T->scale[j]);
        T->row[i] = most;
    }
}

/* LU of 1 - z J with row exchanges; z = re + i im. Returns 0 when it is singular. */
static int factor_shifted(Integrator *I, double re, double im, double *A_re, double *A_im, long *pivot) {
    struct State *T = I->state;
    long n = I->nx, w = T->padded, W = w / LANES;
    V *R = (V *)A_re, *M = (V *)A_im;
    memset(R, 0, sizeof(V) * (size_t)(n * W));
    memset(M, 0, sizeof(V) * (size_t)(n * W));
    for (long j = 0; j < n; j++)
        for (long a = I->pattern.start[j]; a < I->pattern.start[j + 1]; a++) {
            A_re[I->pattern.row[a] * w + j] = T->J[a] * -re;
            A_im[I->pattern.row[a] * w + j] = T->J[a] * -im;
        }
    for (long i = 0; i < n; i++) A_re[i * w + i] += 1.0;
    measure_rows(I, A_re, A_im);
    for (long k = 0; k < n; k++) {
        long best = k;
        double size = -1;
        for (long i = k; i < n; i++) {
            double here = (fabs(A_re[i * w + k]) + fabs(A_im[i * w + k])) / T->row[i];
            if (here > size) size = here, best = i;
        }
        if (!(size > 0) || !(size < INFINITY)) return 0;
        pivot[k] = best;
        if (best != k) {
            double row = T->row[k];
            T->row[k] = T->row[best], T->row[best] = row;
            for (long j = 0; j < W; j++) {
                V a = R[k * W + j], b = M[k * W + j];
                R[k * W + j] = R[best * W + j], M[k * W + j] = M[best * W + j];
                R[best * W + j] = a, M[best * W + j] = b;
            }
        }
        double pr = A_re[k * w + k], pi = A_im[k * w + k], d = pr * pr + pi * pi;
        for (long i = k + 1; i < n; i++) {
            double ar = A_re[i * w + k], ai = A_im[i * w + k];
            if (ar == 0 && ai == 0) continue;
            double lr = (ar * pr + ai * pi) / d, li = (ai * pr - ar * pi) / d;
            long full = padded(k + 1);
            for (long j = k + 1; j < full && j < n; j++) {
                double r = A_re[k * w + j], m = A_im[k * w + j];
                A_re[i * w + j] = A_re[i * w + j] - lr * r + li * m;
                A_im[i * w + j] = A_im[i * w + j] - lr * m - li * r;
            }
            for (long j = full / LANES; j < W; j++) {
                V r = R[k * W + j], m = M[k * W + j];
                R[i * W + j] = R[i * W + j] - v_all(lr) * r + v_all(li) * m;
                M[i * W + j] = M[i * W + j] - v_all(lr) * m - v_all(li) * r;
            }
            A_re[i * w + k] = lr;
            A_im[i * w + k] = li;
        }
    }
    return 1;
}

static void solve_shifted(Integrator *I, const double *A_re, const double *A_im, const long *pivot, double *b_re, double *b_im) {
    long n = I->nx, w = I->state->padded;
    for (long k = 0; k < n; k++) {
        long p = pivot[k];
        double r = b_re[p], m = b_im[p];
        b_re[p] = b_re[k], b_im[p] = b_im[k];
        b_re[k] = r, b_im[k] = m;
    }
    for (long i = 0; i < n; i++) {
        double r = b_re[i], m = b_im[i];
        for (long j = 0; j < i; j++) {
            r -= A_re[i * w + j] * b_re[j] - A_im[i * w + j] * b_im[j];
            m -= A_re[i * w + j] * b_im[j] + A_im[i * w + j] * b_re[j];
        }
        b_re[i] = r, b_im[i] = m;
    }
    for (long i = n - 1; i >= 0; i--) {
        double r = b_re[i], m = b_im[i];
        for (long j = i + 1; j < n; j++) {
            r -= A_re[i * w + j] * b_re[j] - A_im[i * w + j] * b_im[j];
            m -= A_re[i * w + j] * b_im[j] + A_im[i * w + j] * b_re[j];
        }
        double pr = A_re[i * w + i], pi = A_im[i * w + i], d = pr * pr + pi * pi;
        b_re[i] = (r * pr + m * pi) / d;
        b_im[i] = (m * pr - r * pi) / d;
    }
}

/* Number e of values, or the last one where there are fewer, in lanes from e on. */
static V in_lanes(const double *values, long stride, long e, long count) {
    V v = v_all(0.0);
    for (long l = 0; l < LANES; l++) v[l] = values[(e + l < count ? e + l : count - 1) * stride];
    return v;
}

static int factor_sparse(Integrator *I, const Method *m, double h) {
    measure_sparse_rows(I, h * m->eigen_re[0], h * m->eigen_im[0]);
    struct Factors *first = I->state->sparse.blocks;
    for (long e = 0; e < m->eigenvalues; e += LANES) {
        struct Factors *F = &first[e / LANES];
        V re = in_lanes(m->eigen_re, 1, e, m->eigenvalues) * v_all(h), im = in_lanes(m->eigen_im, 1, e, m->eigenvalues) * v_all(h);
        if (e > 0) {
            if (!same_pivots(I, F, first) || !factor_again(I, F, re, im, 0)) return 0;
        } else if (!(F->known && factor_again(I, F, re, im, 1)) && !factor_anew(I, F, re, im)) {
            return 0;
        }
    }
    return 1;
}

static int factor_dense(Integrator *I, const Method *m, double h) {
    struct State *T = I->state;
    long block = I->nx * T->padded;
    for (long e = 0; e < m->eigenvalues; e++)
        if (!factor_shifted(I, h * m->eigen_re[e], h * m->eigen_im[e], T->complex_re + e * block, T->complex_im + e * block, T->pivots + e * I->nx)) return 0;
    return 1;
}

/* Factors 1 - h lambda J for the eigenvalues of the method's A. */
static int factorise(Integrator *I, const Method *m, double h) {
    struct State *T = I->state;
    if (T->factored_h == h && T->factored_method == I->method) return 1;
    T->factored_h = 0;
    if (!(T->sparse_now ? factor_sparse(I, m, h) : factor_dense(I, m, h))) return 0;
    T->factored_h = h;
    T->factored_method = I->method;
    I->factorisations++;
    T->spent += factor_cost(I, m);
    return 1;
}

static void sparse_direction(Integrator *I, const Method *m, const double *R, double *dK) {
    struct Sparse *S = &I->state->sparse;
    long n = I->nx, s = m->stages, count = m->eigenvalues;
    for (long e = 0; e < count; e += LANES) {
        memset(S->re, 0, sizeof(V) * (size_t)n);
        memset(S->im, 0, sizeof(V) * (size_t)n);
        for (long j = 0; j < s; j++) {
            V re = in_lanes(m->W_re + j, s, e, count), im = in_lanes(m->W_im + j, s, e, count);
            for (long i = 0; i < n; i++) {
                S->re[i] += re * v_all(R[j * n + i]);
                S->im[i] += im * v_all(R[j * n + i]);
            }
        }
        solve_sparse(I, &S->blocks[e / LANES]);
        for (long j = 0; j < s; j++)
            for (long l = 0; l < LANES && e + l < count; l++) {
                double re = m->V_re[j * count + e + l], im = m->V_im[j * count + e + l];
                for (long i = 0; i < n; i++) dK[j * n + i] += re * S->re[n + i][l] - im * S->im[n + i][l];
            }
    }
}

static void dense_direction(Integrator *I, const Method *m, const double *R, double *dK) {
    struct State *T = I->state;
    long n = I->nx, s = m->stages, block = n * T->padded;
    for (long e = 0; e < m->eigenvalues; e++) {
        double *re = T->rhs_re, *im = T->rhs_im;
        for (long i = 0; i < n; i++) {
            re[i] = im[i] = 0;
            for (long j = 0; j < s; j++) {
                re[i] += m->W_re[e * s + j] * R[j * n + i];
                im[i] += m->W_im[e * s + j] * R[j * n + i];
            }
        }
        solve_shifted(I, T->complex_re + e * block, T->complex_im + e * block, T->pivots + e * n, re, im);
        for (long j = 0; j < s; j++) {
            double vr = m->V_re[j * m->eigenvalues + e], vi = m->V_im[j * m->eigenvalues + e];
            for (long i = 0; i < n; i++) dK[j * n + i] += vr * re[i] - vi * im[i];
        }
    }
}

/* dK (stages, nx) = (1 - h A x J)^-1 R for residuals R of the stage equations, given by stage and state. */
static void newton_direction(Integrator *I, const Method *m, const double *R, double *dK) {
    memset(dK, 0, sizeof(double) * (size_t)(m->stages * I->nx));
    I->state->spent += direction_cost(I, m);
    if (I->state->sparse_now) sparse_direction(I, m, R, dK);
    else dense_direction(I, m, R, dK);
}

static int newton(Integrator *I, Stages *S, double h, const double *x, Judge *J) {
    struct State *T = I->state;
    const Method *m = S->method;
    long n = I->nx, s = S->s;
    double *residual = T->residual;
    if (!factorise(I, m, h)) return 0;
    for (;;) {
        scale_rates(I, S);
        for (long b = 0; b < S->blocks; b++)
            for (long i = 0; i < n; i++) S->in[b][1 + i] = combined(S->mu + b * S->blocks * LANES, S->L, S->blocks, i, v_all(x[i]));
        stage_rates(I, S);
        if (present(&I->clearance) && J->count < 2) find_zone(I, S, J);
        if (present(&I->clearance)) correct_stages(I, S);
        if (S->around) settle(I, S, S->N, x);
        for (long j = 0; j < s; j++)
            for (long i = 0; i < n; i++) residual[j * n + i] = S->N[j / LANES][i][j % LANES] - S->K[j / LANES][i][j % LANES];
        newton_direction(I, m, residual, T->dK);
        double sum = 0;
        const double *factor = T->factor;
        for (long j = 0; j < S->blocks * LANES; j++) {
            const double *d = T->dK + (j < s ? j : s - 1) * n;
            for (long i = 0; i < n; i++) S->K[j / LANES][i][j % LANES] += d[i];
        }
        widen(I, S, S->K, h);
        for (long j = 0; j < s; j++)
            for (long i = 0; i < n; i++) {
                double change = heard(T->dK[j * n + i], 0.25 * T->noise[i]) * factor[i];
                sum += change * change;
            }
        if (S->around) sum = change_along(I, S, T->dK, factor);
        enum Verdict v = judge(J, sqrt(sum / (double)s));
        if (v != GO_ON) return v == DONE;
    }
}

/* What is left of a change of rates in a step of size h where fast decay forgets it, in place: (1 - h gamma J)^-1, by the factors of the most real
   eigenvalue gamma. */
static void forget_fast(Integrator *I, const Method *m, double *rates) {
    struct State *T = I->state;
    long n = I->nx, block = n * T->padded, e = 0;
    for (long k = 1; k < m->eigenvalues; k++)
        if (fabs(m->eigen_im[k]) < fabs(m->eigen_im[e])) e = k;
    if (T->sparse_now) {
        struct Sparse *S = &T->sparse;
        for (long i = 0; i < n; i++) {
            S->re[i] = v_all(rates[i]);
            S->im[i] = v_all(0.0);
        }
        solve_sparse(I, &S->blocks[e / LANES]);
        for (long i = 0; i < n; i++) rates[i] = S->re[n + i][e % LANES];
        return;
    }
    memset(T->rhs_im, 0, sizeof(double) * (size_t)n);
    solve_shifted(I, T->complex_re + e * block, T->complex_im + e * block, T->pivots + e * n, rates, T->rhs_im);
}
