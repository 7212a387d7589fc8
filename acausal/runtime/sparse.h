/* Sparse LU of 1 - z J, the eigenvalues z of a method side by side in lanes: left-looking, columns in an order that keeps fill low, the diagonal as pivot
   unless it is small (Gilbert and Peierls 1988). Pattern and pivots serve again as long as they are good (as in KLU, Davis and Palamadai
   Natarajan 2010). Pivots are chosen by the first eigenvalue. */

#define DIAGONAL 0.1 /* of the largest entry: the diagonal is the pivot; but where loops may be singular: there the largest is */
#define WORN 0.001   /* of the largest entry: a pivot from before is not used again */

/* Room for so many entries more; old arrays stay in the memory of the integration, which doubles at most. A caller's block has it for any pivots. */
static int room_for(Integrator *I, long used, long more, long *room, long **row, V **re, V **im) {
    if (used + more <= *room) return 1;
    if (I->block && used) return 0;
    long new = (used ? 2 : 1) * (used + more);
    long *rows = reserve(I, sizeof(long) * (size_t)new);
    V *a = reserve_lanes(I, new), *b = reserve_lanes(I, new);
    if (I->counted) return 1;
    if (!rows || !a || !b) return 0;
    if (used) {
        memcpy(rows, *row, sizeof(long) * (size_t)used);
        memcpy(a, *re, sizeof(V) * (size_t)used);
        memcpy(b, *im, sizeof(V) * (size_t)used);
    }
    *room = new, *row = rows, *re = a, *im = b;
    return 1;
}

/* The work that all factors share. */
static int make_sparse(Integrator *I) {
    struct Sparse *S = &I->state->sparse;
    long n = I->nx;
    if (S->re) return 1;
    S->re = reserve_lanes(I, 2 * n);
    S->im = reserve_lanes(I, 2 * n);
    S->stack = reserve(I, sizeof(long) * (size_t)(3 * n));
    S->seen = reserve(I, (size_t)n + 1);
    if (I->counted) return 1;
    if (!S->re || !S->im || !S->stack || !S->seen) return 0;
    S->at = S->stack + n;
    S->pattern = S->at + n;
    return 1;
}

static int make_factors(Integrator *I, struct Factors *F) {
    long n = I->nx, room = I->block || I->counted ? I->pattern.most : (long)I->pattern.fill;
    F->L_start = reserve(I, sizeof(long) * (size_t)(4 * n + 2));
    F->D_re = reserve_lanes(I, 2 * n);
    if (!room_for(I, 0, room, &F->L_room, &F->L_row, &F->L_re, &F->L_im) || !room_for(I, 0, room, &F->U_room, &F->U_row, &F->U_re, &F->U_im)) return 0;
    if (I->counted) return 1;
    if (!F->L_start || !F->D_re) return 0;
    F->U_start = F->L_start + n + 1;
    F->pivot_row = F->U_start + n + 1;
    F->pivot_of = F->pivot_row + n;
    F->D_im = F->D_re + n;
    return 1;
}

/* What is much in each row of 1 - z J, each state counted by its `scale`: rows have the units of the states. */
static void measure_sparse_rows(Integrator *I, double re, double im, const double *scale) {
    struct State *T = I->state;
    for (long i = 0; i < I->nx; i++) T->row[i] = scale[i];
    for (long j = 0; j < I->nx; j++)
        for (long a = I->pattern.start[j]; a < I->pattern.start[j + 1]; a++) {
            double here = (fabs(re) + fabs(im)) * fabs(T->J[a]) * scale[j], *most = &T->row[I->pattern.row[a]];
            if (here > *most) *most = here;
        }
}

/* Rows that column `column` of the matrix reaches through the columns of L so far, in an order in which they can be eliminated, into the
   end of `pattern`; where they begin. */
static long reach(const Integrator *I, struct Sparse *S, const struct Factors *F, long column) {
    long top = I->nx;
    for (long a = I->pattern.start[column] - 1; a < I->pattern.start[column + 1]; a++) {
        long depth = 0, row = a < I->pattern.start[column] ? column : I->pattern.row[a];
        if (S->seen[row]) continue;
        S->stack[0] = row;
        S->at[0] = -1;
        while (depth >= 0) {
            long here = S->stack[depth], k = F->pivot_of[here], next = -1;
            if (S->at[depth] < 0) {
                S->seen[here] = 1;
                S->at[depth] = k >= 0 ? F->L_start[k] : 0;
            }
            for (; k >= 0 && S->at[depth] < F->L_start[k + 1] && next < 0; S->at[depth]++)
                if (!S->seen[F->L_row[S->at[depth]]]) next = F->L_row[S->at[depth]];
            if (next < 0) {
                S->pattern[--top] = here;
                depth--;
            } else {
                S->stack[++depth] = next;
                S->at[depth] = -1;
            }
        }
    }
    return top;
}

/* Column `column` of 1 - z J, added to the work. */
static void scatter(const Integrator *I, struct Sparse *S, V z_re, V z_im, long column) {
    for (long a = I->pattern.start[column]; a < I->pattern.start[column + 1]; a++) {
        S->re[I->pattern.row[a]] = -z_re * v_all(I->state->J[a]);
        S->im[I->pattern.row[a]] = -z_im * v_all(I->state->J[a]);
    }
    S->re[column] += v_all(1.0);
}

/* The column in the work less entry u times column k of L. */
static void eliminate(struct Sparse *S, const struct Factors *F, long k, V u_re, V u_im) {
    for (long a = F->L_start[k]; a < F->L_start[k + 1]; a++) {
        long i = F->L_row[a];
        S->re[i] = S->re[i] - F->L_re[a] * u_re + F->L_im[a] * u_im;
        S->im[i] = S->im[i] - F->L_re[a] * u_im - F->L_im[a] * u_re;
    }
}

/* Of what stands in row i of the work, against what is much there. */
static double entry_size(const Integrator *I, long i) {
    const struct Sparse *S = &I->state->sparse;
    return (fabs(S->re[i][0]) + fabs(S->im[i][0])) / I->state->row[i];
}

/* 1 / (re + i im) in place; 0 where that does not exist in some lane. */
static int invert(V *re, V *im) {
    V size = *re * *re + *im * *im;
    *re = *re / size;
    *im = -*im / size;
    for (int l = 0; l < LANES; l++)
        if (!(size[l] > 0) || !(size[l] < INFINITY)) return 0;
    return 1;
}

/* Pivot of column k and what L has below it, from the work. */
static int divide(struct Sparse *S, struct Factors *F, long k) {
    V re = S->re[F->pivot_row[k]], im = S->im[F->pivot_row[k]];
    if (!invert(&re, &im)) return 0;
    F->D_re[k] = re;
    F->D_im[k] = im;
    for (long a = F->L_start[k]; a < F->L_start[k + 1]; a++) {
        V x = S->re[F->L_row[a]], y = S->im[F->L_row[a]];
        F->L_re[a] = x * re - y * im;
        F->L_im[a] = x * im + y * re;
    }
    return 1;
}

/* LU with new pivots. 0 when it is singular, or memory is short. */
static int factor_anew(Integrator *I, struct Factors *F, V z_re, V z_im) {
    struct Sparse *S = &I->state->sparse;
    long n = I->nx, L = 0, U = 0;
    F->known = 0;
    for (long i = 0; i < n; i++) F->pivot_of[i] = -1;
    for (long k = 0; k < n; k++) {
        long column = I->pattern.order[k], first = reach(I, S, F, column), best = -1;
        F->L_start[k] = L;
        F->U_start[k] = U;
        long above = 0;
        for (long p = first; p < n; p++) above += F->pivot_of[S->pattern[p]] >= 0;
        if (!room_for(I, L, n - first - above, &F->L_room, &F->L_row, &F->L_re, &F->L_im)) return 0;
        if (!room_for(I, U, above, &F->U_room, &F->U_row, &F->U_re, &F->U_im)) return 0;
        for (long p = first; p < n; p++) {
            S->re[S->pattern[p]] = S->im[S->pattern[p]] = v_all(0.0);
            S->seen[S->pattern[p]] = 0;
        }
        scatter(I, S, z_re, z_im, column);
        double largest = 0;
        for (long p = first; p < n; p++) {
            long i = S->pattern[p], j = F->pivot_of[i];
            if (j >= 0) {
                F->U_row[U] = j;
                F->U_re[U] = S->re[i];
                F->U_im[U++] = S->im[i];
                eliminate(S, F, j, S->re[i], S->im[i]);
            } else if (entry_size(I, i) > largest) {
                largest = entry_size(I, i);
                best = i;
            }
        }
        if (best < 0 || !(largest < INFINITY)) return 0;
        if (F->pivot_of[column] < 0 && entry_size(I, column) >= (present(&I->clearance) ? 1 : DIAGONAL) * largest) best = column;
        for (long p = first; p < n; p++)
            if (F->pivot_of[S->pattern[p]] < 0 && S->pattern[p] != best) F->L_row[L++] = S->pattern[p];
        F->pivot_row[k] = best;
        F->pivot_of[best] = k;
        F->L_start[k + 1] = L;
        F->U_start[k + 1] = U;
        if (!divide(S, F, k)) return 0;
    }
    F->known = 1;
    return 1;
}

/* Gives one block of eigenvalues the pattern and pivots of the first. 0 when memory is short. */
static int same_pivots(Integrator *I, struct Factors *F, const struct Factors *first) {
    long n = I->nx, L = first->L_start[n], U = first->U_start[n];
    if (!room_for(I, 0, L > F->L_room ? L : 0, &F->L_room, &F->L_row, &F->L_re, &F->L_im)) return 0;
    if (!room_for(I, 0, U > F->U_room ? U : 0, &F->U_room, &F->U_row, &F->U_re, &F->U_im)) return 0;
    memcpy(F->L_start, first->L_start, sizeof(long) * (size_t)(4 * n + 2));
    memcpy(F->L_row, first->L_row, sizeof(long) * (size_t)L);
    memcpy(F->U_row, first->U_row, sizeof(long) * (size_t)U);
    return 1;
}

/* LU with the pivots of before. 0 when they are not good any more, if that is `checked`: pivots are those of the first eigenvalue for all. */
static int factor_again(Integrator *I, struct Factors *F, V z_re, V z_im, int checked) {
    struct Sparse *S = &I->state->sparse;
    for (long k = 0; k < I->nx; k++) {
        double largest = 0;
        for (long a = F->U_start[k]; a < F->U_start[k + 1]; a++) S->re[F->pivot_row[F->U_row[a]]] = S->im[F->pivot_row[F->U_row[a]]] = v_all(0.0);
        for (long a = F->L_start[k]; a < F->L_start[k + 1]; a++) S->re[F->L_row[a]] = S->im[F->L_row[a]] = v_all(0.0);
        S->re[F->pivot_row[k]] = S->im[F->pivot_row[k]] = v_all(0.0);
        scatter(I, S, z_re, z_im, I->pattern.order[k]);
        for (long a = F->U_start[k]; a < F->U_start[k + 1]; a++) {
            long j = F->U_row[a], i = F->pivot_row[j];
            F->U_re[a] = S->re[i];
            F->U_im[a] = S->im[i];
            eliminate(S, F, j, S->re[i], S->im[i]);
        }
        for (long a = F->L_start[k]; a < F->L_start[k + 1] && checked; a++) largest = fmax(largest, entry_size(I, F->L_row[a]));
        if ((checked && !(entry_size(I, F->pivot_row[k]) >= WORN * largest)) || !divide(S, F, k)) return 0;
    }
    return 1;
}

/* The solution for right-hand sides in the first halves of re and im (n), which are lost, into their second halves. */
static void solve_sparse(const Integrator *I, const struct Factors *F) {
    struct Sparse *S = &I->state->sparse;
    long n = I->nx;
    V *x = S->re + n, *y = S->im + n;
    for (long k = 0; k < n; k++) eliminate(S, F, k, S->re[F->pivot_row[k]], S->im[F->pivot_row[k]]);
    for (long k = n - 1; k >= 0; k--) {
        long i = F->pivot_row[k];
        V re = S->re[i] * F->D_re[k] - S->im[i] * F->D_im[k], im = S->re[i] * F->D_im[k] + S->im[i] * F->D_re[k];
        x[I->pattern.order[k]] = re;
        y[I->pattern.order[k]] = im;
        for (long a = F->U_start[k]; a < F->U_start[k + 1]; a++) {
            long j = F->pivot_row[F->U_row[a]];
            S->re[j] = S->re[j] - F->U_re[a] * re + F->U_im[a] * im;
            S->im[j] = S->im[j] - F->U_re[a] * im - F->U_im[a] * re;
        }
    }
}
