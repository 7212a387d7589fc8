/* Linear equations with masks, in numbers: what programs and compiled kernels have for what would be thousands of statements.

   A system of n rows with m right sides stands in values one after the other: which rows are `active` (n), M by rows (n, n), the damping of rows that may
   depend on one another (n) if it is `damped`, the right sides by rows (n, m), the answers by rows (n, m), and room for work. A row that is not active is one
   of the unit matrix. Active rows are eliminated in their order, without pivots, lane by lane the same whatever others do. Damping is little, and taken out again:
   where M has no inverse the answer is the least one in units of the damping. See acausal/numerics/staged.py. */
#ifndef ACAUSAL_SYSTEMS_H
#define ACAUSAL_SYSTEMS_H
#include "lanes.h"

#define REFINEMENTS 4 /* each takes damping out by a factor of it */
#define CLEANINGS 3   /* of rounding along what M does not see, which is divided by the damping each time; the rest keeps all but their power of the damping */

typedef struct {
    long n, m, damped;
    const V *active, *M, *damping, *right;
    V *answer, *A, *B, *whole; /* work: (n, n), (n, m), and (n, m) twice where it is damped */
    long *row;                 /* which rows are active; `count` of them */
    long count;
} Equations;

INLINE int is_anywhere(V x) { return i_any(x != v_all(0.0)); }

/* A = M + damping of the active rows, made triangular; factors below. */
static void factor_equations(Equations *e) {
    long k = e->count, n = e->n;
    for (long a = 0; a < k; a++) {
        const V *M = e->M + e->row[a] * n;
        V *A = e->A + a * k;
        for (long b = 0; b < k; b++) A[b] = M[e->row[b]];
        if (e->damped) A[a] += e->damping[e->row[a]];
    }
    for (long p = 0; p < k; p++)
        for (long a = p + 1; a < k; a++) {
            V *A = e->A + a * k, *P = e->A + p * k;
            if (!is_anywhere(A[p])) continue;
            A[p] = A[p] / P[p];
            for (long b = p + 1; b < k; b++) A[b] -= A[p] * P[b];
        }
}

/* Right sides of the active rows, in place. */
static void solve_factored(const Equations *e, V *B) {
    long k = e->count, m = e->m;
    for (long p = 0; p < k; p++)
        for (long a = p + 1; a < k; a++) {
            V factor = e->A[a * k + p];
            if (!is_anywhere(factor)) continue;
            for (long c = 0; c < m; c++) B[a * m + c] -= factor * B[p * m + c];
        }
    for (long a = k - 1; a >= 0; a--)
        for (long c = 0; c < m; c++) {
            V sum = v_all(0.0);
            for (long b = a + 1; b < k; b++)
                if (is_anywhere(e->A[a * k + b])) sum += e->A[a * k + b] * B[b * m + c];
            B[a * m + c] = (B[a * m + c] - sum) / e->A[a * k + a];
        }
}

/* right - M found of the active rows, into B. */
static void find_rest(const Equations *e, const V *right, const V *found, V *B) {
    long k = e->count, n = e->n, m = e->m;
    for (long a = 0; a < k; a++)
        for (long c = 0; c < m; c++) {
            V sum = v_all(0.0);
            for (long b = 0; b < k; b++) sum += e->M[e->row[a] * n + e->row[b]] * found[b * m + c];
            B[a * m + c] = right[a * m + c] - sum;
        }
}

/* `at`: a system; afterwards its answers are there. */
OUTLINE void solve_system(V *at, long n, long m, long damped) {
    Equations e = {.n = n, .m = m, .damped = damped, .active = at, .M = at + n, .damping = at + n + n * n};
    e.right = e.damping + (damped ? n : 0);
    e.answer = (V *)e.right + n * m;
    e.A = e.answer + n * m;
    e.B = e.A + n * n;
    e.whole = e.B + n * m;
    e.row = (long *)(void *)(e.whole + (damped ? 2 * n * m : 0));
    for (long i = 0; i < n; i++) {
        Mask off = e.active[i] == v_all(0.0);
        if (is_anywhere(e.active[i])) e.row[e.count++] = i;
        for (long c = 0; c < m; c++) e.answer[i * m + c] = v_select(off, e.right[i * m + c], v_all(0.0));
    }
    long k = e.count;
    if (!k) return;
    for (long a = 0; a < k; a++) {
        long i = e.row[a];
        Mask off = e.active[i] == v_all(0.0);
        for (long c = 0; c < m; c++) e.B[a * m + c] = v_select(off, v_all(0.0), e.right[i * m + c]);
    }
    for (long j = 0; j < n; j++) /* what is known already */
        for (long c = 0; c < m; c++) {
            V known = e.answer[j * m + c];
            if (!is_anywhere(known)) continue;
            for (long a = 0; a < k; a++) {
                long i = e.row[a];
                if (i != j) e.B[a * m + c] -= v_select(e.active[i] == v_all(0.0), v_all(0.0), e.M[i * n + j] * known);
            }
        }
    factor_equations(&e);
    if (damped) {
        V *right = e.whole + n * m;
        for (long q = 0; q < k * m; q++) right[q] = e.B[q];
        solve_factored(&e, e.B);
        for (long q = 0; q < k * m; q++) e.whole[q] = e.B[q];
        for (int again = 0; again < REFINEMENTS; again++) {
            find_rest(&e, right, e.whole, e.B);
            solve_factored(&e, e.B);
            for (long q = 0; q < k * m; q++) e.whole[q] += e.B[q];
        }
        for (long q = 0; q < k * m; q++) e.B[q] = e.whole[q];
        for (int again = 0; again < CLEANINGS; again++) {
            for (long a = 0; a < k; a++)
                for (long c = 0; c < m; c++) e.B[a * m + c] *= e.damping[e.row[a]];
            solve_factored(&e, e.B);
        }
        for (long q = 0; q < k * m; q++) e.B[q] = e.whole[q] - e.B[q];
    } else {
        solve_factored(&e, e.B);
    }
    for (long a = 0; a < k; a++)
        for (long c = 0; c < m; c++) {
            V *x = e.answer + e.row[a] * m + c;
            *x = v_select(e.active[e.row[a]] == v_all(0.0), *x, e.B[a * m + c]);
        }
}
#endif
