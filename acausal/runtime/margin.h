/* Reactions of rows that depend on one another, as those of a table on four legs: what holds does so as long as any of them would do, and one of them at its limit
   means nothing. Where those of least norm do not fit, others are carried on from then: those in the middle of all that fit, with their rates, so that all limits are
   met together where none fits any longer.

   Limits that grow with magnitudes of forces grow at least with the parts of these along any direction: with those along what the forces are, which is looked at again.

   The middle: the least of  |l|^2 / 2 - sum log (what is left to each limit), l measured in units of the largest; by Newton's iteration, damped as it may be for such
   functions (Nesterov and Nemirovskii, Interior-Point Polynomial Algorithms, 1994). Whether there is any: all limits are moved outwards by s, the least s is looked for. */

#define NO_MARGIN 1e-12 /* of the largest reaction: limits that leave no more than this leave nothing */
#define BRIEFLY 2e-12   /* the same, where nothing fits a little later: limits that are met within rounding of the time */
#define FROM_LATER 1e-8 /* of the largest: rounding, beside what has grown so much later */
#define AT_REST 1e-7    /* of the largest: accelerations of rows that do not move, before it is known that they do not */
#define HARDEST 1e14    /* weight of s */
#define TURNS 8         /* times that directions of forces are looked at again */
#define HARDLY 1e-4    /* radians by which a direction has turned that is nearly the same */
#define APART_IN_TIME 100.0 /* times the look ahead: places by which the middle's rate is known to rounding */

/* Some of the rows, which are to hold: A l = b in their units, but for so much of the largest, `open`; reactions l = least + N z with z (free). `cone`: frictions among them. */
typedef struct {
    long rows, free, frictions;
    long *row, *friction, *order;
    double size, open, *A, *b, *least, *N, *found, *y, *gradient, *H, *scratch;
    double *drawn, *slope; /* room for rows */
    double *turn; /* of rows: their units in those of the first row of their friction */
    double *limit, *by; /* of frictions, (frictions), (frictions, rows) */
    double *e;          /* directions of the forces that limits depend on (magnitudes, 3) */
} Held;

static int make_margin(Integrator *I) {
    struct State *T = I->state;
    long n = reactions_of(I), F = frictions_of(I);
    if (!I->redundant) return 1;
    T->margin = reserve_doubles(I, 2 * n * n + (n + 1) * (n + 1) + F * n + F + 10 * n + 8 + 3 * I->magnitudes);
    T->margin_rows = reserve(I, sizeof(long) * (size_t)(8 * n + F));
    T->parting.masks = reserve_doubles(I, I->masks);
    T->parting.near_zero = reserve(I, (size_t)I->one_sided + 1);
    T->parting.left_at = NAN;
    return I->counted || (T->margin && T->margin_rows && T->parting.masks && T->parting.near_zero);
}

static Held held_of(const Integrator *I) {
    struct State *T = I->state;
    long n = reactions_of(I), F = frictions_of(I), *k = T->margin_rows;
    double *at = T->margin;
    Held S = {.row = k, .order = k + n, .friction = k + 2 * n, .open = T->parting.inside ? NIL : DEPENDENT};
    S.A = at, S.N = at + n * n, S.H = at + 2 * n * n;
    at += 2 * n * n + (n + 1) * (n + 1);
    S.by = at, S.limit = at + F * n;
    at += F * n + F;
    S.b = at, S.least = at + n, S.found = at + 2 * n, S.y = at + 3 * n, S.gradient = at + 4 * n + 1, S.scratch = at + 5 * n + 2, S.turn = at + 7 * n + 4, S.drawn = at + 8 * n + 4, S.slope = at + 9 * n + 4, S.e = at + 10 * n + 4;
    return S;
}

/* Whether a limit does. */
static int grows_with_magnitudes(const Decision *D, long f) {
    for (long m = 0; m < D->magnitudes; m++)
        if (D->hold_size[f * D->magnitudes + m] != 0) return 1;
    return 0;
}

/* What the magnitudes by which the limit of a friction grows have of the reaction of a row, or without any (row -1), along the directions there are. */
static double part_along(const Decision *D, const Held *S, long f, long row) {
    double sum = 0;
    for (long c = 0; c < 3 * D->magnitudes; c++) sum += D->hold_size[f * D->magnitudes + c / 3] * S->e[c] * (row < 0 ? D->force[c] : D->force_by[c * D->n + row]);
    return sum;
}

/* Whether the limit of a friction that holds grows with the reaction of a row. */
static int limit_needs(const Decision *D, long f, long row) {
    int needs = D->hold_by[f * D->n + row] != 0;
    for (long c = 0; c < 3 * D->magnitudes; c++) needs |= D->hold_size[f * D->magnitudes + c / 3] != 0 && D->force_by[c * D->n + row] != 0;
    return needs;
}

/* Rows of these laws which hang together with the first one, by their compliances or limits: HOLDS in `law`. */
static void gather(const Decision *D, const long *law, long first, Held *S, long *seen) {
    long n = D->n, laws = D->gaps + D->frictions, count = 0;
    S->rows = S->frictions = 0;
    S->order[count++] = first;
    seen[first] = first + 1;
    for (long at = 0; at < count; at++) {
        long a = S->order[at], i = a < D->gaps ? a : row_of(D, a - D->gaps), size = a < D->gaps ? 1 : rows_of(D, a - D->gaps);
        if (a >= D->gaps) S->friction[S->frictions++] = a - D->gaps;
        for (long k = 0; k < size; k++) S->row[S->rows++] = i + k;
        for (long c = 0; c < laws; c++) {
            if (seen[c] || law[c] != HOLDS) continue;
            long j = c < D->gaps ? c : row_of(D, c - D->gaps), wide = c < D->gaps ? 1 : rows_of(D, c - D->gaps), near = 0;
            for (long k = 0; k < size; k++)
                for (long w = 0; w < wide; w++) near |= fabs(D->W[(i + k) * n + j + w]) > NIL * sqrt(D->W[(i + k) * n + i + k] * D->W[(j + w) * n + j + w]);
            for (long k = 0; k < size && c >= D->gaps; k++) near |= limit_needs(D, c - D->gaps, i + k);
            for (long w = 0; w < wide && a >= D->gaps; w++) near |= limit_needs(D, a - D->gaps, j + w);
            if (near) seen[c] = first + 1, S->order[count++] = c;
        }
    }
}

/* The equations of these rows, at one place: A and b, with what slides; limits. */
static void pose_held(const Decision *D, const long *law, const double *along, Held *S) {
    long n = D->n, m = S->rows;
    for (long a = 0; a < m; a++) {
        long i = S->row[a];
        double unit = 1 / unit_of(D->W[i * n + i]);
        S->b[a] = -D->free[i] * unit;
        for (long c = 0; c < m; c++) {
            long j = S->row[c];
            S->A[a * m + c] = D->W[i * n + j] * unit / unit_of(D->W[j * n + j]);
        }
        for (long f = 0; f < D->frictions; f++) {
            if (law[D->gaps + f] != AGAINST) continue;
            for (long k = 0; k < rows_of(D, f); k++) {
                double part = D->W[i * n + row_of(D, f) + k] * along[3 * f + k] * unit;
                S->b[a] += part * D->slide[f];
                for (long c = 0; c < m && part != 0; c++)
                    if (S->row[c] < D->gaps) S->A[a * m + c] -= part * D->slide_by[f * n + S->row[c]] / unit_of(D->W[S->row[c] * n + S->row[c]]);
            }
        }
    }
    for (long a = 0; a < m; a++) S->turn[a] = 1;
    for (long q = 0; q < S->frictions; q++) {
        long f = S->friction[q], i = row_of(D, f);
        double unit = unit_of(D->W[i * n + i]);
        for (long a = 0; a < m; a++)
            if (S->row[a] > i && S->row[a] < i + rows_of(D, f)) S->turn[a] = unit / unit_of(D->W[S->row[a] * n + S->row[a]]);
        S->limit[q] = (D->hold[f] + part_along(D, S, f, -1)) * unit;
        for (long c = 0; c < m; c++) S->by[q * m + c] = (D->hold_by[f * n + S->row[c]] + part_along(D, S, f, S->row[c])) * unit / unit_of(D->W[S->row[c] * n + S->row[c]]);
        for (long g = 0; g < D->frictions; g++) /* what slides bears on it, too */
            for (long k = 0; k < rows_of(D, g) && law[D->gaps + g] == AGAINST; k++) {
                double part = -along[3 * g + k] * part_along(D, S, f, row_of(D, g) + k) * unit;
                S->limit[q] += part * D->slide[g];
                for (long c = 0; c < m && part != 0; c++)
                    if (S->row[c] < D->gaps) S->by[q * m + c] += part * D->slide_by[g * n + S->row[c]] / unit_of(D->W[S->row[c] * n + S->row[c]]);
            }
    }
}

/* Directions of forces by these reactions. Whether they have turned. */
static int turn_forces(const Decision *D, Held *S, const double *push) {
    int turned = 0;
    for (long m = 0; m < D->magnitudes; m++) {
        double force[3], *e = S->e + 3 * m, size = 0;
        for (long c = 0; c < 3; c++) {
            force[c] = D->force[3 * m + c];
            for (long k = 0; k < D->n; k++) force[c] += D->force_by[(3 * m + c) * D->n + k] * push[k];
            size = hypot(size, force[c]);
        }
        for (long c = 0; c < 3; c++) {
            double now = size > 0 ? force[c] / size : e[c];
            turned |= fabs(now - e[c]) > NIL;
            e[c] = now;
        }
    }
    return turned;
}

/* S->least and S->N by elimination with complete pivoting; 0 where nothing obeys all rows. */
static int solve_held(Held *S) {
    long m = S->rows, rank = 0;
    double *A = S->A, *b = S->b, most = 0;
    for (long c = 0; c < m; c++) S->order[c] = c, most = fmax(most, fabs(b[c]));
    for (; rank < m; rank++) {
        long row = rank, column = rank;
        for (long i = rank; i < m; i++)
            for (long j = rank; j < m; j++)
                if (fabs(A[i * m + j]) > fabs(A[row * m + column])) row = i, column = j;
        if (!(fabs(A[row * m + column]) > DEPENDENT)) break;
        for (long j = 0; j < m; j++) {
            double kept = A[rank * m + j];
            A[rank * m + j] = A[row * m + j], A[row * m + j] = kept;
        }
        for (long i = 0; i < m; i++) {
            double kept = A[i * m + rank];
            A[i * m + rank] = A[i * m + column], A[i * m + column] = kept;
        }
        double kept = b[rank];
        long place = S->order[rank];
        b[rank] = b[row], b[row] = kept;
        S->order[rank] = S->order[column], S->order[column] = place;
        for (long i = 0; i < m; i++) { /* of all rows: what is left is the identity */
            double factor = A[i * m + rank] / A[rank * m + rank];
            if (i == rank || factor == 0) continue;
            for (long j = rank; j < m; j++) A[i * m + j] -= factor * A[rank * m + j];
            b[i] -= factor * b[rank];
        }
    }
    S->free = m - rank;
    for (long i = rank; i < m; i++)
        if (!(fabs(b[i]) <= S->open * most)) return 0;
    for (long k = 0; k < m; k++) {
        long i = S->order[k];
        S->least[i] = k < rank ? b[k] / A[k * m + k] : 0;
        for (long z = 0; z < S->free; z++) S->N[i * S->free + z] = k < rank ? -A[k * m + rank + z] / A[k * m + k] : k - rank == z;
    }
    return 1;
}

/* x with H x = g, into g, H (d, d) symmetric and positive, by Cholesky; 0 where it is not. Directions that rounding has left nothing of are not gone along. */
static int solve_positive(double *H, double *g, long d) {
    for (long j = 0; j < d; j++) {
        double sum = H[j * d + j], least = 4 * EPS * sum;
        for (long k = 0; k < j; k++) sum -= H[j * d + k] * H[j * d + k];
        if (!(least > 0)) return 0;
        if (!(sum > least)) sum = 1e200 * least;
        H[j * d + j] = sqrt(sum);
        for (long i = j + 1; i < d; i++) {
            double s = H[i * d + j];
            for (long k = 0; k < j; k++) s -= H[i * d + k] * H[j * d + k];
            H[i * d + j] = s / H[j * d + j];
        }
    }
    for (long i = 0; i < d; i++) {
        for (long k = 0; k < i; k++) g[i] -= H[i * d + k] * g[k];
        g[i] /= H[i * d + i];
    }
    for (long i = d - 1; i >= 0; i--) {
        for (long k = i + 1; k < d; k++) g[i] -= H[k * d + i] * g[k];
        g[i] /= H[i * d + i];
    }
    return 1;
}

/* Reactions of least norm in place of any, and all of them in units of the largest of these; 0 where there are none. */
static int take_least(Held *S) {
    long m = S->rows, d = S->free;
    for (long a = 0; a < d; a++) {
        S->y[a] = 0;
        for (long i = 0; i < m; i++) S->y[a] -= S->N[i * d + a] * S->least[i];
        for (long c = 0; c < d; c++) {
            S->H[a * d + c] = 0;
            for (long i = 0; i < m; i++) S->H[a * d + c] += S->N[i * d + a] * S->N[i * d + c];
        }
    }
    if (!solve_positive(S->H, S->y, d)) return 0;
    S->size = 0;
    for (long i = 0; i < m; i++) {
        for (long a = 0; a < d; a++) S->least[i] += S->N[i * d + a] * S->y[a];
        S->size = fmax(S->size, fabs(S->least[i]));
    }
    for (long i = 0; i < m; i++) S->least[i] /= S->size;
    for (long q = 0; q < S->frictions; q++) S->limit[q] /= S->size;
    return S->size > 0;
}

/* What is left to the limits: the least of all. */
static double margin_of(const Held *S, const Decision *D, const double *l) {
    long m = S->rows;
    double least = INFINITY;
    for (long i = 0; i < m; i++)
        if (S->row[i] < D->gaps) least = fmin(least, l[i]);
    for (long q = 0; q < S->frictions; q++) {
        long first = row_of(D, S->friction[q]), wide = rows_of(D, S->friction[q]);
        double c = S->limit[q], t = 0;
        for (long i = 0; i < m; i++) {
            c += S->by[q * m + i] * l[i];
            if (S->row[i] >= first && S->row[i] < first + wide) t = hypot(t, S->turn[i] * l[i]);
        }
        least = fmin(least, c - t);
    }
    return least;
}

/* Adds weight v v' to the lower half of H. */
static void add_square(double *H, const double *v, long d, double weight) {
    for (long a = 0; a < d; a++)
        for (long c = 0; c <= a; c++) H[a * d + c] += weight * v[a] * v[c];
}

/* One of Newton's steps for the middle, of y = (z, s) with weight tau of s, tau = 0: without s. Returns its length in the metric there, -1 where it fails. */
static double step_to_middle(Held *S, const Decision *D, double tau) {
    long m = S->rows, d = S->free, e = d + (tau > 0);
    double *g = S->gradient, *v = S->scratch, *w = v + e, s = tau > 0 ? S->y[d] : 0, *l = S->found;
    memset(S->H, 0, sizeof(double) * (size_t)(e * e));
    memset(g, 0, sizeof(double) * (size_t)e);
    for (long i = 0; i < m; i++) {
        const double *N = S->N + i * d;
        l[i] = S->least[i];
        for (long a = 0; a < d; a++) l[i] += N[a] * S->y[a];
        for (long a = 0; a < d; a++) g[a] -= l[i] * N[a], v[a] = N[a];
        if (e > d) v[d] = 0;
        add_square(S->H, v, e, 1);
        if (S->row[i] >= D->gaps) continue;
        if (e > d) v[d] = 1;
        double left = l[i] + s;
        if (!(left > 0)) return -1;
        for (long a = 0; a < e; a++) g[a] += v[a] / left;
        add_square(S->H, v, e, 1 / (left * left));
    }
    for (long q = 0; q < S->frictions; q++) {
        long first = row_of(D, S->friction[q]), wide = rows_of(D, S->friction[q]);
        double c = S->limit[q] + s, left;
        memset(v, 0, sizeof(double) * (size_t)e);
        for (long i = 0; i < m; i++) {
            c += S->by[q * m + i] * l[i];
            for (long a = 0; a < d && S->by[q * m + i] != 0; a++) v[a] += S->by[q * m + i] * S->N[i * d + a];
        }
        if (e > d) v[d] = 1;
        left = c * c;
        for (long i = 0; i < m; i++)
            if (S->row[i] >= first && S->row[i] < first + wide) left -= S->turn[i] * S->turn[i] * l[i] * l[i];
        if (!(left > 0 && c > 0)) return -1;
        for (long a = 0; a < e; a++) w[a] = c * v[a];
        add_square(S->H, v, e, -2 / left);
        for (long i = 0; i < m; i++) {
            if (S->row[i] < first || S->row[i] >= first + wide) continue;
            for (long a = 0; a < d; a++) w[a] -= S->turn[i] * S->turn[i] * l[i] * S->N[i * d + a], v[a] = S->turn[i] * S->N[i * d + a];
            if (e > d) v[d] = 0;
            add_square(S->H, v, e, 2 / left);
        }
        for (long a = 0; a < e; a++) g[a] += 2 / left * w[a];
        add_square(S->H, w, e, 4 / (left * left));
    }
    if (e > d) { /* s does not fall below -1 */
        g[d] += 1 / (1 + s) - tau;
        S->H[d * e + d] += 1 / ((1 + s) * (1 + s));
    }
    memcpy(w, g, sizeof(double) * (size_t)e);
    if (!solve_positive(S->H, g, e)) return -1;
    double length = 0;
    for (long a = 0; a < e; a++) length += w[a] * g[a];
    length = sqrt(fmax(length, 0));
    for (long a = 0; a < e; a++) S->y[a] += g[a] / (length > 0.25 ? 1 + length : 1);
    return length;
}

/* Reactions that hold these rows within their limits, into S->found: 2 those of least norm, 1 the middle of all, 0 where there are none to speak of. */
static int find_middle(Held *S, const Decision *D) {
    if (!solve_held(S) || S->free == 0 || !take_least(S)) return 0; /* what depends on nothing is left as it is */
    long d = S->free;
    memset(S->y, 0, sizeof(double) * (size_t)d);
    double out = -margin_of(S, D, S->least), length = 1;
    if (!(out < -NIL)) {
        S->y[d] = 1.1 * out + 1;
        double tau = 10;
        for (int steps = 0; !(S->y[d] < -NO_MARGIN); steps++) {
            length = step_to_middle(S, D, tau);
            if (length < 0 || tau > HARDEST || steps > 400) return 0;
            if (length < 0.25 && S->y[d] * tau > 4 * (double)(S->rows + 1)) return 0; /* near the path of these s is no further above the least */
            if (length < 0.25) tau *= 10;
        }
        length = 1;
    }
    if (out < -NIL) { /* those of least norm will do */
        memcpy(S->found, S->least, sizeof(double) * (size_t)S->rows);
        return 2;
    }
    for (int again = 0; again < 100 && length > 1e-10; again++) length = step_to_middle(S, D, 0);
    if (length < 0) return 0;
    for (long i = 0; i < S->rows; i++) {
        S->found[i] = S->least[i];
        for (long a = 0; a < d; a++) S->found[i] += S->N[i * d + a] * S->y[a];
    }
    return margin_of(S, D, S->found) > NO_MARGIN;
}

/* Directions of what slips, as it does at this place: where it has hardly turned since then, since what is at its threshold may be passed by that alone. */
static void turn_slips(const Decision *D, Room R) {
    for (long f = D->lines; f < D->frictions; f++) {
        double *e = R.along + 3 * f, now[3], turned = 0;
        if (R.law[D->gaps + f] != AGAINST || !(size_of(D, f, D->rate) > 0)) continue;
        against(D, f, D->rate + row_of(D, f), now);
        for (long k = 0; k < rows_of(D, f); k++) turned = hypot(turned, now[k] - e[k]);
        if (turned < HARDLY) memcpy(e, now, sizeof(double) * (size_t)rows_of(D, f));
    }
}

/* Rows at a time that is so much later, or earlier. 0 when the input function failed. */
static int decision_later(Integrator *I, double later, Decision *D) {
    struct State *T = I->state;
    double *x = T->later_x;
    if (later == 0) return decision_at(I, I->t, I->x, D);
    if (T->parting.inside && later > 0) {
        const Stages *S = T->parting.inside;
        state_within(I->nx, I->x, S->a, S->s, S->blocks * LANES, later / T->parting.h, T->parting.h, x);
        return decision_at(I, I->t + later, x, D);
    }
    if (!rate_at(I, I->t, I->x, T->rate)) return 0;
    for (long i = 0; i < I->nx; i++) x[i] = I->x[i] + 0.5 * later * T->rate[i];
    if (!rate_at(I, I->t + 0.5 * later, x, T->rate)) return 0; /* what is at its threshold by its rate too passes it by the next */
    int moved = 1;
    for (long i = 0; i < I->nx; i++) {
        x[i] = I->x[i] + later * T->rate[i];
        moved &= isfinite(x[i]) != 0;
    }
    return decision_at(I, I->t + (moved ? later : 0), moved ? x : I->x, D);
}

/* Where the masks begin that say what is carried on: since when, reactions (n) at that time, their rates (n). */
static long carried_of(const Integrator *I) { return first_discrete(I) - 1 - 2 * reactions_of(I); }

/* Whether all rows move the same with these changes of the reactions, `change` (rows, every `apart`), in their units. */
static int moves_nothing(const Held *S, const Decision *D, const long *law, const double *along, const double *change, long apart) {
    long n = D->n;
    for (long i = 0; i < n; i++) {
        const double *W = D->W + i * n;
        double sum = 0;
        for (long a = 0; a < S->rows; a++) {
            long j = S->row[a];
            double by = W[j];
            for (long f = 0; f < D->frictions && j < D->gaps; f++)
                for (long k = 0; k < rows_of(D, f) && law[D->gaps + f] == AGAINST; k++) by -= D->slide_by[f * D->n + j] * along[3 * f + k] * W[row_of(D, f) + k];
            sum += by * change[a * apart] / unit_of(D->W[j * n + j]);
        }
        if (!(fabs(sum) <= DEPENDENT * unit_of(W[i]))) return 0;
    }
    return 1;
}

/* The same whichever reactions hold them, of all that would. */
static int move_alike(const Held *S, const Decision *D, const long *law, const double *along) {
    int alike = 1;
    for (long z = 0; z < S->free && alike; z++) alike = moves_nothing(S, D, law, along, S->N + z, S->free);
    return alike;
}

/* The middle of what holds these rows at a time that is so much later, into `found`; 0 where there is none, or it is of least norm, -1 when the input function failed. */
static int middle_at(Integrator *I, const long *law, const double *along, double later, Held *S, double *found) {
    Decision D;
    if (!decision_later(I, later, &D)) return -1;
    turn_slips(&D, room_of(I));
    pose_held(&D, law, along, S);
    if (find_middle(S, &D) != 1) return 0;
    for (long a = 0; a < S->rows; a++) found[a] = S->found[a] * S->size / unit_of(D.W[S->row[a] * D.n + S->row[a]]);
    return 1;
}

/* Whether a friction moves any of these rows. */
static int moves_with(const Decision *D, const Held *S, long f) {
    for (long a = 0; a < S->rows; a++)
        for (long k = row_of(D, f); k < row_of(D, f) + rows_of(D, f); k++)
            if (fabs(D->W[S->row[a] * D->n + k]) > NIL * sqrt(D->W[S->row[a] * (D->n + 1)] * D->W[k * (D->n + 1)])) return 1;
    return 0;
}

/* Whether rows of these laws that hang together with the first one may all hold, by what is known of them `later`, where that takes more than `least`: then they do, carry the
   middle on, and `push` is that.
   -1 when the input function failed. */
static int hold_together(Integrator *I, const long *law, long first, const double *along, double later, double little, double least, int decided, long *seen, double *push) {
    struct State *T = I->state;
    long n = reactions_of(I), at = carried_of(I);
    double *carried = T->side + at + 1, *drift = carried + n;
    Decision D;
    Held S = held_of(I);
    if (!decision_later(I, later, &D)) return -1;
    turn_slips(&D, room_of(I));
    gather(&D, law, first, &S, seen);
    for (long f = 0; f < D.frictions; f++) /* what is not linear: those of least norm are taken */
        if (law[D.gaps + f] == AGAINST ? grows_with_magnitudes(&D, f) && moves_with(&D, &S, f) : law[D.gaps + f] == HOLDS && seen[D.gaps + f] == first + 1 && rows_of(&D, f) > 2) return 0;
    int found = 0;
    for (int turned = 1, again = 0; turned && again < TURNS; again++) {
        S.size = 0;
        pose_held(&D, law, along, &S);
        found = find_middle(&S, &D);
        memcpy(S.drawn, push, sizeof(double) * (size_t)n);
        for (long a = 0; a < S.rows; a++) S.drawn[S.row[a]] = S.found[a] * S.size / unit_of(D.W[S.row[a] * (n + 1)]);
        turned = !found && S.size > 0 && turn_forces(&D, &S, S.drawn);
    }
    if (!found || !(S.size > least) || ((found == 1 || decided) && !move_alike(&S, &D, law, along))) return 0;
    if (found == 1 && later == 0 && !(margin_of(&S, &D, S.found) > BRIEFLY)) return 0;
    for (long a = 0; a < S.rows; a++) {
        long i = S.row[a];
        push[i] = S.found[a] * S.size / unit_of(D.W[i * n + i]);
        if (found == 1) carried[i] = push[i];
    }
    if (found == 2) return 1;
    double *base = S.drawn, since = later;
    if (later > 0 && middle_at(I, law, along, 0, &S, base) > 0) since = 0; /* what is carried on is that of now, however far one looks ahead */
    else if (middle_at(I, law, along, later, &S, base) <= 0) return 1;
    T->side[at] = I->t + since;
    for (long a = 0; a < S.rows; a++) carried[S.row[a]] = base[a], drift[S.row[a]] = 0;
    static const double part[] = {-25.0 / 12, 4, -3, 4.0 / 3, -0.25}; /* of values one after the other: their slope at the first one */
    for (int back = 0; back < 2; back++) { /* later, or where nothing fits there, earlier */
        double by = back ? -APART_IN_TIME * little : APART_IN_TIME * little, *slope = S.slope;
        int fits = 1;
        for (long a = 0; a < S.rows; a++) slope[a] = part[0] * carried[S.row[a]];
        for (int k = 1; k < 5 && fits; k++) {
            fits = middle_at(I, law, along, since + k * by, &S, base);
            if (fits < 0) return -1;
            for (long a = 0; a < S.rows; a++) slope[a] += part[k] * base[a];
        }
        if (!fits) continue;
        for (long a = 0; a < S.rows; a++) {
            long i = S.row[a];
            double unit = unit_of(D.W[i * n + i]);
            drift[i] = fabs(slope[a]) * unit > 10 * NIL * S.size ? slope[a] / by : 0;
        }
        break;
    }
    return 1;
}

/* Whether a friction is pressed by something, by a row that holds for one. */
static int may_press(const Decision *D, long f, const long *law) {
    int presses = D->hold[f] > 0 || grows_with_magnitudes(D, f);
    for (long i = 0; i < D->gaps; i++) presses |= law[i] == HOLDS && limit_needs(D, f, i);
    return presses;
}

/* Laws that have been found for accelerations, of which some say that what is at rest is at a limit, or that it moves: where others of its reactions hold it, it holds.
   `asked`: what may; `rate`: accelerations, null where nothing has been found. Returns how many groups of rows do, -1 when the input function failed. */
static int hold_more(Integrator *I, const Decision *D, const long *asked, long *law, const double *along, const double *rate, double *push, double later) {
    struct State *T = I->state;
    long laws = D->gaps + D->frictions, n = D->n, *seen = T->margin_rows + 3 * n + frictions_of(I), *given = seen + laws, *moves = given + laws, *done = moves + laws, *stays = done + laws;
    Held S = held_of(I);
    memset(S.e, 0, sizeof(double) * (size_t)(3 * D->magnitudes));
    turn_forces(D, &S, push);
    int found = 0;
    double largest = 0;
    for (long i = 0; i < n; i++) largest = fmax(largest, fmax(fabs(push[i]) * unit_of(D->W[i * n + i]), fabs(D->free[i]) / unit_of(D->W[i * n + i])));
    for (long k = 0; k < laws; k++) {
        long i = k < D->gaps ? k : row_of(D, k - D->gaps), size = k < D->gaps ? 1 : rows_of(D, k - D->gaps);
        moves[k] = done[k] = 0;
        stays[k] = T->side[k < D->gaps ? k : mask_of(I, k - D->gaps)] == 1;
        for (long r = i; r < i + size; r++) moves[k] |= !rate || !(fabs(rate[r]) <= AT_REST * largest * unit_of(D->W[r * n + r]));
    }
    for (int pass = 0; pass < (T->parting.inside ? 2 : 3); pass++) { /* what held goes on to, if that may be; what is found to; whatever might, here and now */
        memset(seen, 0, sizeof(long) * (size_t)laws);
        for (long k = 0; k < laws; k++) {
            int may = asked[k] == MAY_HOLD || asked[k] == MAY_SLIDE;
            given[k] = law[k] == STARTS ? AGAINST : law[k];
            int rests = k < D->gaps ? stays[k] && pass == 0 : may_press(D, k - D->gaps, given); /* where it takes no force, as by an answer in which nothing presses there, it holds as well */
            if (may && (pass == 2 || (!moves[k] && rests))) given[k] = HOLDS;
        }
        for (long k = 0; k < laws; k++) {
            if (seen[k] || done[k] || given[k] != HOLDS || (pass == 2 && (law[k] == HOLDS || !(moves[k] || stays[k] || law[k] == STARTS)))) continue;
            int held = hold_together(I, given, k, along, pass == 2 ? 0 : later, later, pass == 2 ? FROM_LATER * largest : 0, rate != 0, seen, push);
            if (held < 0) return -1;
            for (long c = 0; c < laws && held; c++)
                if (seen[c] == k + 1) law[c] = HOLDS, done[c] = 1;
            found += held;
        }
    }
    return found;
}
