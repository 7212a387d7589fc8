/* Valves whose currents follow at once in some modes, and through states in others (see acausal/reduce/changing_index.py).

   Of what holds, y = h + M r, rows that depend on one another say nothing of reactions, but something of states; then their rates y' = d + K r say it, as far as these rows do,
   N y' = 0 with N M = 0. Both together are P y + Q y' = 0, with P and Q so that what stands before r is the unit matrix. P and Q are found where a mode begins, by elimination with
   complete pivoting, in units in which what a row does and what its reaction does are of one size.

   What is decided is looked at a little later, after an implicit step of Euler's. */

#define CANCELS 1e-12 /* of its terms, what is zero */

/* Where the masks begin: how much later, P, Q by rows. */
static long index_of(const Integrator *I) { return mask_of_size(I, I->magnitudes); }

/* What each row's own reaction does to it, or of valves something of that unit where it does nothing, into T->row_unit (n). What it does at once counts, then what it does with others that
   are known, then what it does later. */
static void find_units(Integrator *I, const Decision *D) {
    double *own = I->state->row_unit;
    const double *W = D->W;
    long n = D->n, v = I->valves;
    for (long i = v; i < n; i++) own[i] = W[i * n + i];
    for (long i = 0; i < v; i++) I->state->row_terms[i] = -D->terms[i];
    if (!(I->state->side[index_of(I)] > 0) && own[0] > 0) return;
    for (long i = 0; i < v; i++) own[i] = fmax(D->values[i * v + i], 0);
    for (long again = 0; again <= 2 * v; again++) {
        int found = 0;
        for (long i = 0; i < v; i++) {
            double most = 0;
            for (long j = 0; j < v && !(own[i] > 0); j++)
                if (own[j] > 0) most = fmax(most, fabs(W[i * n + j] * W[j * n + i]) / own[j]);
            if (most > 0) own[i] = fmax(most, W[i * n + i]), found = 1;
        }
        for (long i = 0; i < v && !found; i++)
            if (!(own[i] > 0) && W[i * n + i] > 0) own[i] = W[i * n + i], found = 1;
    }
    for (long i = 0; i < v; i++)
        if (!(own[i] > 0)) own[i] = 1;
}

/* What is left of a - b; exactly nothing, where that is rounding. */
static double left_of(double a, double b) {
    double left = a - b;
    return fabs(left) <= CANCELS * (fabs(a) + fabs(b)) ? 0 : left;
}

/* Eliminates A (k, k) with complete pivoting, and does the same with the rows of C (k, k); `column` (k): which one comes where. The rank. */
static long eliminate_whole(double *A, double *C, long *column, long k) {
    for (long b = 0; b < k; b++) column[b] = b;
    for (long s = 0; s < k; s++) {
        long row = s, at = s;
        for (long a = s; a < k; a++)
            for (long b = s; b < k; b++)
                if (fabs(A[a * k + b]) > 1.5 * fabs(A[row * k + at])) row = a, at = b; /* of what is alike the first */
        if (A[row * k + at] == 0) return s;
        for (long b = 0; b < k && row != s; b++) {
            double one = A[s * k + b], other = C[s * k + b];
            A[s * k + b] = A[row * k + b], A[row * k + b] = one;
            C[s * k + b] = C[row * k + b], C[row * k + b] = other;
        }
        for (long a = 0; a < k && at != s; a++) {
            double one = A[a * k + s];
            A[a * k + s] = A[a * k + at], A[a * k + at] = one;
        }
        long moved = column[s];
        column[s] = column[at], column[at] = moved;
        for (long a = s + 1; a < k; a++) {
            double factor = A[a * k + s] / A[s * k + s];
            if (factor == 0) continue;
            A[a * k + s] = 0;
            for (long b = s + 1; b < k; b++) A[a * k + b] = left_of(A[a * k + b], factor * A[s * k + b]);
            for (long b = 0; b < k; b++) C[a * k + b] = left_of(C[a * k + b], factor * C[s * k + b]);
        }
    }
    return k;
}

/* The inverse of G (k, k), which is used up, into B (k, k); x (k): room. 0 where there is none. */
static int invert_whole(double *G, double *B, double *x, long *column, long k) {
    memset(B, 0, sizeof(double) * (size_t)(k * k));
    for (long a = 0; a < k; a++) B[a * k + a] = 1;
    if (eliminate_whole(G, B, column, k) < k) return 0;
    for (long c = 0; c < k; c++) {
        for (long a = k - 1; a >= 0; a--) {
            double sum = B[a * k + c];
            for (long b = a + 1; b < k; b++) sum -= G[a * k + b] * x[column[b]];
            x[column[a]] = sum / G[a * k + a];
        }
        for (long a = 0; a < k; a++) B[a * k + c] = x[a];
    }
    return 1;
}

/* P and Q of the rows that hold in the mode that has been set, into the masks. 0 where rows say nothing of reactions, nor do their rates. */
static int combine_rows(Integrator *I, const Decision *D) {
    struct State *T = I->state;
    long n = I->valves, k = 0, *row = T->index_rows, *column = row + n;
    double *P = T->side + index_of(I) + 1, *Q = P + n * n, *A = T->index_work, *C = A + n * n, *G = C + n * n, *B = G + n * n, *x = B + n * n;
    memset(P, 0, sizeof(double) * (size_t)(2 * n * n));
    for (long i = 0; i < n; i++)
        if (T->side[i] == 1) row[k++] = i;
    for (long a = 0; a < k; a++)
        for (long b = 0; b < k; b++) {
            A[a * k + b] = D->values[row[a] * n + row[b]] / sqrt(T->row_unit[row[a]] * T->row_unit[row[b]]);
            C[a * k + b] = a == b;
        }
    long rank = eliminate_whole(A, C, column, k);
    for (long a = 0; a < k; a++) {
        double most = 0;
        for (long b = 0; b < k; b++) {
            double sum = 0;
            for (long c = 0; c < k; c++) {
                const double *of = a < rank ? D->values : D->rates;
                sum += C[a * k + c] * of[row[c] * n + row[b]] / sqrt(T->row_unit[row[c]] * T->row_unit[row[b]]);
            }
            G[a * k + b] = sum;
            most = fmax(most, fabs(sum));
        }
        if (!(most > 0)) return 0;
        for (long b = 0; b < k; b++) G[a * k + b] /= most, C[a * k + b] /= most;
    }
    if (!invert_whole(G, B, x, column, k)) return 0;
    for (long a = 0; a < k; a++)
        for (long b = 0; b < k; b++) {
            double p = 0, q = 0, units = sqrt(T->row_unit[row[a]] * T->row_unit[row[b]]);
            for (long c = 0; c < k; c++) *(c < rank ? &p : &q) += B[a * k + c] * C[c * k + b];
            P[row[a] * n + row[b]] = p / units, Q[row[a] * n + row[b]] = q / units;
        }
    return 1;
}

/* The same. Where valves that block leave a potential open, or those that conduct a current, some that do neither, by what is decided, do the other thing. */
static int combine_others(Integrator *I, const Decision *D, const double *push, const double *rate) {
    double *side = I->state->side, most = largest_in(D, push, 0, I->valves);
    long n = I->valves, *undecided = I->state->index_rows + 2 * n, count = 0;
    if (combine_rows(I, D)) return 1;
    for (long i = 0; i < n; i++)
        if (fabs(push[i]) * unit_of(own_of(D, i)) <= FITS * most && fabs(rate[i]) / unit_of(own_of(D, i)) <= FITS * most) undecided[count++] = i;
    for (long a = 0; a < count; a++)
        for (long b = a; b < count; b++) { /* one of them, or two */
            long one = undecided[a], other = undecided[b];
            side[one] = 1 - side[one];
            if (other != one) side[other] = 1 - side[other];
            if (combine_rows(I, D)) return 1;
            side[one] = 1 - side[one];
            if (other != one) side[other] = 1 - side[other];
        }
    return 0;
}

static int decision_at(Integrator *I, double t, const double *x, Decision *D);

/* What valves alone are decided by, so much later, by an implicit step, with the reactions of others, T->given_push; 0 when the input function failed. */
static int valves_later(Integrator *I, double later, Decision *D) {
    struct State *T = I->state;
    T->side[index_of(I)] = later;
    int known = decision_at(I, I->t + later, I->x, D);
    T->side[index_of(I)] = 0;
    if (!known) return 0;
    const double *alone = decision_of(I, T->decided, 0).free;
    for (long i = 0; i < D->n; i++) {
        T->given_free[i] = i < D->valves ? alone[i] : 0;
        for (long j = D->valves; j < D->n && i < D->valves; j++) {
            double by = D->W[i * D->n + j] * T->given_push[j];
            T->given_free[i] += by;
            T->free_noise[i] += TOUCHES * EPS * fabs(by);
        }
    }
    return 1;
}

#define SHUT 2 /* in place of a gap: what blocks stays so, whatever it holds back */

/* Of valves that are turned round and whose gates are shut those that conduct go on to, as long as something flows, and those that block do. How many of these there are; -1 when the input
   function failed. */
static int hold_shut(Integrator *I, const Decision *D, long *law) {
    struct State *T = I->state;
    int count = 0, known = 0;
    for (long i = 0; i < I->valves; i++) {
        if (D->gap[i] != SHUT) continue;
        if (!known++ && T->begun && !rows_at(I, I->t, I->x)) return -1;
        int flows = T->begun ? T->side[i] == 0 && T->one_row[i] > T->row_noise[i] : D->free[i] > T->free_noise[i];
        law[i] = flows ? MAY_HOLD : HOLDS;
        count += !flows;
    }
    return count;
}

#define FLIPS 200 /* of rows, until all are as they should be */

/* The compliance of rows `row` (k), in units of rows, into T->index_work. */
static void gather_rows(Integrator *I, const Decision *D, const long *row, long k) {
    const double *unit = I->state->row_unit;
    for (long a = 0; a < k; a++)
        for (long b = 0; b < k; b++) I->state->index_work[a * k + b] = D->W[row[a] * D->n + row[b]] / sqrt(unit[row[a]] * unit[row[b]]);
}

/* Valves that hold, into `row`, without those that depend on others: these open. How many; the inverse of their compliance is in T->index_work + n n. */
static long independent_rows(Integrator *I, const Decision *D, long *law, long *row) {
    long n = I->valves, k = 0, *column = row + n, rank;
    double *G = I->state->index_work, *B = G + n * n;
    for (long i = 0; i < n; i++)
        if (law[i] == HOLDS) row[k++] = i;
    for (;; k = rank) {
        gather_rows(I, D, row, k);
        if (invert_whole(G, B, B + n * n, column, k)) return k;
        gather_rows(I, D, row, k);
        rank = eliminate_whole(G, B, column, k);
        if (rank == k) return 0;
        for (long a = rank; a < k; a++) law[row[column[a]]] = OPENS;
        rank = 0;
        for (long a = 0; a < k; a++)
            if (law[row[a]] == HOLDS) row[rank++] = row[a];
    }
}

/* What the laws of valves are solved by, those among them that are `asked` to hold whatever that takes; their `push` and `rate`, row by row as exact as rounding allows. The first valve that does not hold as it should, or does not stay open; none: their number. */
static long first_wrong(Integrator *I, const Decision *D, const long *asked, long *law, double *push, double *rate) {
    struct State *T = I->state;
    long v = I->valves, n = D->n, *row = T->index_rows, k = independent_rows(I, D, law, row), wrong = v;
    double *B = T->index_work + v * v, *noise = B + v * v + v;
    for (long i = 0; i < v; i++) push[i] = noise[i] = 0;
    for (long a = 0; a < k; a++)
        for (long b = 0; b < k; b++) {
            double part = B[a * k + b] / sqrt(T->row_unit[row[a]] * T->row_unit[row[b]]);
            push[row[a]] -= part * D->free[row[b]];
            noise[row[a]] += fabs(part) * T->free_noise[row[b]];
        }
    for (long i = v - 1; i >= 0; i--) {
        double sum = D->free[i], rounds = T->free_noise[i];
        for (long j = 0; j < v; j++) sum += D->W[i * n + j] * push[j], rounds += fabs(D->W[i * n + j]) * noise[j];
        rate[i] = law[i] == HOLDS ? 0 : sum;
        if (law[i] == HOLDS ? asked[i] != HOLDS && push[i] < -noise[i] : law[i] == OPENS && sum < -rounds) wrong = i;
    }
    return wrong;
}

/* Laws of valves from those that are given on: what is wrong is turned round, one after the other, the first first (Murty, Linear Complementarity, Linear and Nonlinear Programming, 1988, 4.1). Whether
   that has come to an end. */
static int settle_rows(Integrator *I, const Decision *D, const long *asked, long *law, double *push, double *rate) {
    for (long flips = 0; flips < FLIPS; flips++) {
        long wrong = first_wrong(I, D, asked, law, push, rate);
        if (wrong == I->valves) return 1;
        law[wrong] = law[wrong] == HOLDS ? OPENS : HOLDS;
    }
    return 0;
}

/* What rounding makes of a valve's row in the mode that has been set. */
static double rounding_of_row(const Integrator *I, long i) {
    const struct State *T = I->state;
    const double *P = T->side + index_of(I) + 1 + i * I->valves;
    double terms = T->side[i] == 1 ? 0 : T->row_terms[i];
    for (long j = 0; j < I->valves && T->side[i] == 1; j++) terms += fabs(P[j]) * T->row_terms[j];
    return TOUCHES * EPS * terms;
}
