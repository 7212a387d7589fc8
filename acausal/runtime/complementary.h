/* Reactions of rows that hold as long as they can: 0 <= r, 0 <= a, one of them zero, for one-sided rows; friction at most its limit, and against the slip
   where it is at its limit. a = start + W r.

   Friction along lines: Lemke's method gives a first answer; in planes: projected Gauss-Seidel sweeps. From there Newton's iteration on the laws written as
   projections, r = max(floor, r - a / w) and alike. Rows that depend on one another are damped, in units in which the diagonal of W is one, and the damping is
   taken out by solving again about the last answer, from zero on: of all answers that is the one of least norm, whatever the order of the rows (with friction that
   slides: the one without a part that moves nothing). Murty, Linear Complementarity, Linear and Nonlinear Programming (1988), chapter 2; Alart, Curnier, Comput.
   Methods Appl. Mech. Engrg. 92 (1991); Jourdan, Alart, Jean, ibid. 155 (1998); Rockafellar, SIAM J. Control Optim. 14 (1976), for the damping. */

#define DAMPED 1e-2    /* in units of the diagonal */
#define UNDAMPED 60    /* answers about the last one, at most */
#define SETTLING 10    /* of these, after which there is a tenth of the damping: rows that nearly depend on one another settle slowly */
#define SWEEPS 16      /* of Gauss and Seidel at first; doubled so many times */
#define DOUBLINGS 8
#define ROUGHLY 2      /* an answer that has not settled */
#define NEWTON 60      /* iterations */
#define ROUNDED 16.0   /* roundings of its terms by which an equation may be open */
#define SPENT 100.0    /* roundings of what reactions do, which leave something of what holds at once */
#define FITS 1e-9      /* of the largest: how far an answer may be from what it should be where it is degenerate */

/* What is decided by, at one place; frictions: first those along lines, then those in planes, then those of patches, by their `pressure`. Limits may grow with `magnitudes` too, those of forces (3 each), which are `force` and
   what reactions add to it. */
typedef struct {
    long n, valves, gaps, lines, planes, frictions, magnitudes; /* valves: the first gaps, see index.h */
    const double *gap, *rate, *free, *W, *J, *hold, *hold_by, *slide, *slide_by, *kind, *back, *bounce, *terms;
    const double *force, *force_by, *hold_size, *slide_size, *pressure;
    const double *gap_noise, *rate_noise;
    const double *values, *rates, *own; /* of valves (v, v), (v, v), (n): see index.h; own: null where it is the diagonal of W */
} Decision;

enum Law {
    OFF,    /* no reaction */
    MAY_HOLD,     /* holds, or not: one-sided, or friction at slip zero */
    MAY_SLIDE,  /* the same with the limit of sliding */
    AGAINST,   /* friction against a slip in the direction that is given */
    HOLDS,  /* found: one-sided and closed, or friction that sticks */
    OPENS,
    STARTS  /* friction that is at its limit: in the direction that is found */
};

enum ImpactLaw { BY_POISSON, BY_NEWTON, BY_ENERGY, ONE_BY_ONE = 4, NO_GAP = 8 }; /* of gaps, their `kind`; one by one and no gap: with others */

/* A problem. law (gaps + frictions); along (3 each): of frictions, what acts against the slip, with the sign turned and by the limit: its direction, but of patches; floor (gaps): least reactions, null: zero; constants: whether limits
   count that do not grow with reactions. Results: law, along, push (n), rate (n). centre (n): what damping draws to. work: n n + 6 n. */
typedef struct {
    const Decision *D;
    const double *start, *floor;
    int constants, kinetic;
    double damping;
    long *law, *asked;
    double *along, *push, *rate, *centre, *work;
} Problem;

/* What a row is measured in: the square root of its compliance; one for what nothing moves here. */
static double unit_of(double compliance) { return compliance > 0 ? sqrt(compliance) : 1; }

/* What a row's own reaction does to it, or something of that unit where it does nothing. */
static double own_of(const Decision *D, long i) { return D->own ? D->own[i] : D->W[i * D->n + i]; }

/* The largest of reactions (n) and of what rows are without them, in units of rows, from the `first` to before the `last` one. */
static double largest_in(const Decision *D, const double *push, long first, long last) {
    double largest = 0;
    for (long i = first; i < last; i++) {
        double unit = unit_of(own_of(D, i));
        largest = fmax(largest, fmax(fabs(push[i]) * unit, fabs(D->free[i]) / unit));
    }
    return largest;
}

static long row_of(const Decision *D, long friction) {
    long patch = friction - D->lines - D->planes;
    return friction < D->lines ? D->gaps + friction : D->gaps + D->lines + 2 * (friction - D->lines) + (patch > 0 ? patch : 0);
}
static long rows_of(const Decision *D, long friction) { return friction < D->lines ? 1 : friction < D->lines + D->planes ? 2 : 3; }
static int pressure_of(const Decision *D, long friction) { return friction < D->lines + D->planes ? NO_PATCH : (int)D->pressure[friction - D->lines - D->planes]; }

/* Of slips, accelerations or forces of all rows, those of a friction: how large they are. */
static double size_of(const Decision *D, long friction, const double *of) {
    const double *r = of + row_of(D, friction);
    long rows = rows_of(D, friction);
    return rows == 1 ? fabs(r[0]) : rows == 2 ? hypot(r[0], r[1]) : hypot(hypot(r[0], r[1]), r[2]);
}

/* Which limit a force (rows) needs, at least. */
static double limit_needed(const Decision *D, long friction, const double *r) {
    long rows = rows_of(D, friction);
    return rows == 1 ? fabs(r[0]) : rows == 2 ? hypot(r[0], r[1]) : patch_size(pressure_of(D, friction), r);
}

/* What acts against a slip u (rows), not zero, with the sign turned and by the limit. */
static void against(const Decision *D, long friction, const double *u, double *e) {
    long rows = rows_of(D, friction);
    double slip = rows == 1 ? fabs(u[0]) : hypot(u[0], u[1]);
    if (rows > 2) patch_against(pressure_of(D, friction), u, e);
    else
        for (long k = 0; k < rows; k++) e[k] = u[k] / slip;
}
static double floor_of(const Problem *p, long i) { return p->floor ? p->floor[i] : 0; }

/* Whether the limit of sliding counts for a friction, by what was asked of it. */
static int is_kinetic(const Problem *p, long f) {
    long asked = p->asked[p->D->gaps + f];
    return p->kinetic || asked == AGAINST || asked == MAY_SLIDE;
}

/* The force whose magnitude limits depend on; its size. */
static double force_at(const Problem *p, long m, double *force) {
    const Decision *D = p->D;
    for (long c = 3 * m; c < 3 * m + 3; c++) {
        double sum = p->constants ? D->force[c] : 0;
        for (long k = 0; k < D->n; k++) sum += D->force_by[c * D->n + k] * p->push[k];
        force[c - 3 * m] = sum;
    }
    return sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]);
}

/* The limit of a friction, and what it grows by with each reaction, and with each magnitude. */
static const double *limit_by(const Problem *p, long f) { return (is_kinetic(p, f) ? p->D->slide_by : p->D->hold_by) + f * p->D->n; }
static const double *limit_by_size(const Problem *p, long f) { return (is_kinetic(p, f) ? p->D->slide_size : p->D->hold_size) + f * p->D->magnitudes; }
static double limit_of(const Problem *p, long f) {
    const double *by = limit_by(p, f), *by_size = limit_by_size(p, f);
    double limit = p->constants ? (is_kinetic(p, f) ? p->D->slide : p->D->hold)[f] : 0, force[3];
    for (long k = 0; k < p->D->gaps; k++) limit += by[k] * p->push[k];
    for (long m = 0; m < p->D->magnitudes; m++)
        if (by_size[m] != 0) limit += by_size[m] * force_at(p, m, force);
    return fmax(limit, 0);
}

/* What the limit grows by with each reaction at the reactions there are, magnitudes included, into `by` (n). */
static void limit_slope(const Problem *p, long f, double *by) {
    const Decision *D = p->D;
    const double *by_size = limit_by_size(p, f);
    double force[3];
    memcpy(by, limit_by(p, f), sizeof(double) * (size_t)D->n);
    for (long m = 0; m < D->magnitudes; m++) {
        double size = by_size[m] != 0 ? force_at(p, m, force) : 0;
        for (long k = 0; k < D->n && size > 0; k++)
            for (long c = 0; c < 3; c++) by[k] += by_size[m] * force[c] / size * D->force_by[(3 * m + c) * D->n + k];
    }
}

/* Accelerations (or rates) of a row, with damping. */
static double rate_of(const Problem *p, long i) {
    const Decision *D = p->D;
    double sum = p->start[i] + p->damping * D->W[i * D->n + i] * (p->push[i] - p->centre[i]);
    for (long j = 0; j < D->n; j++) sum += D->W[i * D->n + j] * p->push[j];
    return sum;
}

/* The same of all rows: four sums at a time, none of which waits for another. */
static void damped_rates(const Problem *p) {
    long n = p->D->n, i = 0;
    for (; i + 4 <= n; i += 4) {
        const double *W = p->D->W + i * n, *r = p->push;
        double a[4];
        for (long k = 0; k < 4; k++) a[k] = p->start[i + k] + p->damping * W[k * n + i + k] * (r[i + k] - p->centre[i + k]);
        double s0 = a[0], s1 = a[1], s2 = a[2], s3 = a[3];
        for (long j = 0; j < n; j++) s0 += W[j] * r[j], s1 += W[n + j] * r[j], s2 += W[2 * n + j] * r[j], s3 += W[3 * n + j] * r[j];
        p->rate[i] = s0, p->rate[i + 1] = s1, p->rate[i + 2] = s2, p->rate[i + 3] = s3;
    }
    for (; i < n; i++) p->rate[i] = rate_of(p, i);
}

/* Those of all rows, without damping. */
static void find_rates(const Problem *p) {
    damped_rates(p);
    for (long i = 0; i < p->D->n; i++) p->rate[i] -= p->damping * p->D->W[i * p->D->n + i] * (p->push[i] - p->centre[i]);
}

/* The least of r A r / 2 + c r, A = (a, b; b, e) positive, of forces r of this size: -(A + y) r = c, by Newton's iteration for y on 1 / |r| (More and Sorensen, SIAM J. Sci. Stat.
   Comput. 4, 1983). */
static void least_of_size(double a, double b, double e, const double *c, double size, double *r) {
    double least = 0.5 * (a + e) - hypot(0.5 * (a - e), b), y = fmax(0, hypot(c[0], c[1]) / size - 0.5 * (a + e) - hypot(0.5 * (a - e), b));
    for (int again = 0; again < 30; again++) {
        double p = a + y, q = e + y, det = p * q - b * b, x = -(q * c[0] - b * c[1]) / det, z = -(p * c[1] - b * c[0]) / det, now = hypot(x, z);
        double slope = (q * x * x - 2 * b * x * z + p * z * z) / det, by = now > 0 && slope > 0 ? now * now / slope * (now - size) / size : 0;
        r[0] = x, r[1] = z;
        y = fmax(y + by, -least + 1e-12 * (a + e));
        if (!(fabs(by) > 4 * EPS * (a + e + fabs(y)))) break;
    }
    double now = hypot(r[0], r[1]);
    for (int k = 0; k < 2 && now > 0; k++) r[k] *= size / now;
}

/* One sweep; how much changed, in units of forces over the diagonal. */
static double sweep(const Problem *p) {
    const Decision *D = p->D;
    const double *W = D->W;
    long n = D->n;
    double changed = 0, d = 1 + p->damping;
    for (long i = 0; i < D->gaps; i++) {
        if (p->law[i] != MAY_HOLD) continue;
        double old = p->push[i];
        p->push[i] = fmax(floor_of(p, i), old - rate_of(p, i) / (d * own_of(D, i)));
        changed = fmax(changed, fabs(p->push[i] - old) * unit_of(own_of(D, i)));
    }
    for (long f = 0; f < D->frictions; f++) {
        long i = row_of(D, f), size = rows_of(D, f), law = p->law[D->gaps + f];
        double *r = p->push + i, limit = limit_of(p, f), old[3];
        memcpy(old, r, sizeof(double) * (size_t)size);
        if (law == OFF) continue;
        if (law == AGAINST) {
            for (long k = 0; k < size; k++) r[k] = -limit * p->along[3 * f + k];
        } else if (size == 1) {
            r[0] = fmin(fmax(r[0] - rate_of(p, i) / (d * own_of(D, i)), -limit), limit);
        } else if (size == 3) {
            for (int again = 0; again < 8; again++) {
                double w = d * (W[i * n + i] + W[(i + 1) * (n + 1)] + W[(i + 2) * (n + 1)]), y[3], Q[9];
                for (long k = 0; k < size; k++) y[k] = r[k] - rate_of(p, i + k) / w;
                int inside = !(limit > 0) || patch_size(pressure_of(D, f), y) <= limit;
                for (long k = 0; k < size && !inside; k++) y[k] /= limit;
                if (!inside) nearest_on_patch(pressure_of(D, f), y, y, Q);
                for (long k = 0; k < size; k++) r[k] = inside ? (limit > 0 ? y[k] : 0) : limit * y[k];
            }
        } else {
            double a = d * W[i * n + i], b = W[i * n + i + 1], c = W[(i + 1) * n + i], e = d * W[(i + 1) * n + i + 1], det = a * e - b * c;
            double u = rate_of(p, i), v = rate_of(p, i + 1);
            double x = r[0] - (e * u - b * v) / det, y = r[1] - (a * v - c * u) / det;
            if (law == MAY_SLIDE || !(hypot(x, y) <= limit)) {
                double start[2] = {u - a * r[0] - b * r[1], v - c * r[0] - e * r[1]};
                if (limit > 0) least_of_size(a, 0.5 * (b + c), e, start, limit, r);
                else r[0] = r[1] = 0;
            } else {
                r[0] = x, r[1] = y;
            }
        }
        for (long k = 0; k < size; k++) changed = fmax(changed, fabs(r[k] - old[k]) * unit_of(own_of(D, i + k)));
    }
    return changed;
}

/* The end of a row of A (n, n), behind which there are zeros only; not before `least`. */
static long end_of_row(const double *A, long n, long row, long least) {
    long end = n;
    while (end > least && A[row * n + end - 1] == 0) end--;
    return end;
}

/* x with A x = b, into b; A (n, n) is used up. Rows without a pivot give zero. Most rows tell one of x alone: those of laws that say what a force is. */
static void eliminate_dense(double *A, double *b, long n) {
    for (long k = 0; k < n; k++) {
        long best = k, end = end_of_row(A, n, k, k + 1);
        if (end > k + 1 || A[k * n + k] == 0) {
            for (long i = k + 1; i < n; i++)
                if (fabs(A[i * n + k]) > fabs(A[best * n + k])) best = i;
        }
        if (best != k) {
            for (long j = 0; j < n; j++) {
                double kept = A[k * n + j];
                A[k * n + j] = A[best * n + j], A[best * n + j] = kept;
            }
            double kept = b[k];
            b[k] = b[best], b[best] = kept;
            end = end_of_row(A, n, k, k + 1);
        }
        if (!(fabs(A[k * n + k]) > 1e-300)) continue;
        for (long i = k + 1; i < n; i++) {
            double factor = A[i * n + k] / A[k * n + k];
            if (factor == 0) continue;
            for (long j = k + 1; j < end; j++) A[i * n + j] -= factor * A[k * n + j];
            b[i] -= factor * b[k];
        }
    }
    for (long k = n - 1; k >= 0; k--) {
        for (long j = k + 1; j < n; j++) b[k] -= A[k * n + j] * b[j];
        b[k] = fabs(A[k * n + k]) > 1e-300 ? b[k] / A[k * n + k] : 0;
    }
}

/* What is left of the laws, b (n), in units in which the diagonal of W is one, and its derivative A (n, n) with the sign turned. Laws that may hold are
   found. Returns the norm of b; `open`: whether it is more than rounding. */
static double look_at_laws(const Problem *p, const long *asked, double *A, double *b, const double *unit, int *open) {
    const Decision *D = p->D;
    const double *W = D->W;
    long n = D->n;
    double sum = 0, *by = p->work + n * n + 4 * n;
    *open = 0;
    memset(A, 0, sizeof(double) * (size_t)(n * n));
    damped_rates(p);
    for (long f = -D->gaps; f < D->frictions; f++) {
        long first = f < 0 ? f + D->gaps : row_of(D, f), size = f < 0 ? 1 : rows_of(D, f), law = asked[D->gaps + f];
        double w = 0, limit = f < 0 ? 0 : limit_of(p, f), e[3] = {0, 0, 0}, y[3] = {0, 0, 0}, Q[9], far = 0;
        for (long k = first; k < first + size; k++) w += own_of(D, k);
        w *= 1 + p->damping;
        for (long k = 0; k < size && w > 0; k++) y[k] = p->push[first + k] - p->rate[first + k] / w;
        if (law == MAY_HOLD || law == MAY_SLIDE) {
            far = f < 0 ? 0 : limit_needed(D, f, y);
            if (!(w > 0) && f >= 0) { /* a joint whose slip turns round while all goes on: nothing that it does stops that */
                for (long k = 0; k < size; k++) y[k] = -p->rate[first + k];
                far = limit_needed(D, f, y) > 0 ? INFINITY : 0;
            }
            law = f < 0 ? (y[0] > floor_of(p, first) ? HOLDS : OPENS) : !(limit > 0) ? OFF : far <= limit ? HOLDS : STARTS;
        }
        p->law[D->gaps + f] = law;
        for (long k = 0; k < size && law == AGAINST; k++) e[k] = -p->along[3 * f + k];
        if (law == STARTS && size < 3) against(D, f, y, e);
        else if (law == STARTS) {
            for (long k = 0; k < size; k++) y[k] /= limit;
            nearest_on_patch(pressure_of(D, f), y, e, Q);
        }
        if (law == AGAINST || law == STARTS) limit_slope(p, f, by);
        for (long k = 0; k < size; k++) {
            long i = first + k;
            double terms = fabs(p->push[i]) / unit[i];
            if (law == HOLDS) {
                b[i] = -p->rate[i] * unit[i];
                terms = (fabs(p->start[i]) + p->damping * W[i * n + i] * (fabs(p->push[i]) + fabs(p->centre[i]))) * unit[i];
                for (long j = 0; j < n && !*open; j++) terms += fabs(W[i * n + j] * p->push[j]) * unit[i]; /* one that is open is enough */
                for (long j = 0; j < n; j++) A[i * n + j] = W[i * n + j] * unit[i] * unit[j];
                A[i * n + i] += p->damping * W[i * n + i] * unit[i] * unit[i];
            } else {
                double held = law == OPENS ? floor_of(p, i) : law == AGAINST || law == STARTS ? limit * e[k] : 0;
                b[i] = (held - p->push[i]) / unit[i];
                A[i * n + i] += 1;
                double moved = e[k]; /* by the limit */
                for (long m = 0; m < size && size > 2 && law == STARTS; m++) moved -= Q[3 * k + m] * y[m];
                for (long j = 0; j < n && limit > 0 && (law == AGAINST || law == STARTS); j++)
                    if (by[j] != 0) A[i * n + j] -= by[j] * moved * unit[j] / unit[i];
                if (law == STARTS && size > 1 && w > 0) {
                    for (long m = 0; m < size; m++) { /* the direction turns: (1 - e e') / far */
                        double part = size > 2 ? Q[3 * k + m] : limit / far * ((k == m) - e[k] * e[m]);
                        A[i * n + first + m] -= part * unit[first + m] / unit[i];
                        for (long j = 0; j < n; j++) A[i * n + j] += part * W[(first + m) * n + j] / w * unit[j] / unit[i];
                        A[i * n + first + m] += part * p->damping * W[(first + m) * (n + 1)] / w * unit[first + m] / unit[i];
                        terms += fabs(part * p->rate[first + m] / w) / unit[i];
                    }
                }
            }
            sum += b[i] * b[i];
            *open |= !(fabs(b[i]) <= ROUNDED * EPS * terms);
            if (!isfinite(b[i])) *open = 1, sum = INFINITY;
        }
    }
    return sqrt(sum);
}

/* Newton's iteration on the laws, from the reactions there are. Returns whether it came to an end. */
static int newton_of_laws(const Problem *p, const long *asked) {
    long n = p->D->n;
    double *A = p->work, *b = A + n * n, *unit = b + n, *last = unit + n, *step = A + n * n + 5 * n;
    int open;
    for (long i = 0; i < n; i++) unit[i] = 1 / unit_of(own_of(p->D, i));
    double left = look_at_laws(p, asked, A, b, unit, &open), least = left;
    for (long again = 0, since = 0; again < NEWTON && open; again++) {
        if (!isfinite(left)) return 0;
        memcpy(last, p->push, sizeof(double) * (size_t)n);
        eliminate_dense(A, b, n);
        double part = 1, changed = 0, most = 0, before = left;
        for (long i = 0; i < n; i++) {
            b[i] *= unit[i];
            changed = fmax(changed, fabs(b[i]) / unit[i]);
            most = fmax(most, fabs(last[i]) / unit[i]);
        }
        if (!isfinite(changed)) return 0;
        memcpy(step, b, sizeof(double) * (size_t)n);
        for (int halved = 0; halved < 6; halved++, part *= 0.5) {
            for (long i = 0; i < n; i++) p->push[i] = last[i] + part * step[i];
            left = look_at_laws(p, asked, A, b, unit, &open);
            if (left < (1 - 0.1 * part) * before || changed <= 1e-10 * most) break;
        }
        if (open && changed <= 4 * EPS * most && part == 1) return 1;
        since = left < 0.9 * least ? 0 : since + 1;
        least = fmin(least, left);
        if (since > 12) return changed <= 1e-12 * most;
    }
    return !open;
}

/* Whether what has been solved is an answer. */
static int answers(const Problem *p) {
    const Decision *D = p->D;
    long n = D->n;
    double force = 0, rate = 0;
    for (long i = 0; i < n; i++) {
        double unit = unit_of(own_of(D, i));
        force = fmax(force, fabs(p->push[i]) * unit);
        rate = fmax(rate, fabs(p->start[i]) / unit);
    }
    double far = FITS * fmax(force, rate);
    for (long i = 0; i < D->gaps; i++) {
        double unit = unit_of(own_of(D, i));
        if (p->law[i] == HOLDS && (p->push[i] - floor_of(p, i)) * unit < -far) return 0;
        if (p->law[i] == OPENS && p->rate[i] / unit < -far) return 0;
        int exact = i < D->valves; /* else it grows without end where friction turns it round */
        if (p->law[i] == HOLDS && !(fabs(p->rate[i]) / unit <= (exact ? FITS : sqrt(FITS)) * rate + (exact ? SPENT * EPS : FITS) * force)) return 0;
    }
    for (long f = 0; f < D->frictions; f++) {
        long i = row_of(D, f), law = p->law[D->gaps + f];
        double unit = unit_of(own_of(D, i));
        if (law == HOLDS) {
            if ((limit_needed(D, f, p->push + i) - limit_of(p, f)) * unit > far) return 0;
        } else if (law == STARTS && rows_of(D, f) == 1 && p->rate[i] * p->along[3 * f] / unit < -far) {
            return 0;
        }
    }
    return 1;
}

/* A linear complementarity problem w = M z + q, w, z >= 0, one of each pair zero, by Lemke's method with the lexicographic rule. `table` (n, 2 n + 2): columns of w
   (-> 1), z (-M), the covering variable (-1) and q. `basis` (n): number of the variable of each row; z k is n + k. 1 where solved, 0 where there is no
   solution on the way. */
static int lemke(double *table, long *basis, long n) {
    long width = 2 * n + 2, cover = 2 * n, last = 2 * n + 1, row = -1;
    double least = 0;
    for (long i = 0; i < n; i++) {
        basis[i] = i;
        if (table[i * width + last] < least) least = table[i * width + last], row = i;
    }
    if (row < 0) return 1;
    long entering = cover;
    for (long steps = 0; steps < 50 * (n + 1); steps++) {
        double *p = table + row * width, pivot = p[entering];
        for (long j = 0; j < width; j++) p[j] /= pivot;
        for (long i = 0; i < n; i++) {
            double factor = table[i * width + entering];
            if (i == row || factor == 0) continue;
            for (long j = 0; j < width; j++) table[i * width + j] -= factor * p[j];
            table[i * width + entering] = 0;
        }
        long left = basis[row];
        basis[row] = entering;
        if (left == cover) return 1;
        entering = left < n ? left + n : left - n;
        row = -1;
        for (long i = 0; i < n; i++) {
            double a = table[i * width + entering];
            if (!(a > 1e-12)) continue;
            if (row < 0) {
                row = i;
                continue;
            }
            double b = table[row * width + entering];
            double here = table[i * width + last] / a, there = table[row * width + last] / b, tie = 1e-13 * (fabs(here) + fabs(there));
            int less = here < there - tie, more = here > there + tie;
            if (!less && !more && basis[row] == cover) more = 1; /* the covering variable leaves first */
            if (!less && !more && basis[i] == cover) less = 1;
            for (long j = 0; j < n && !less && !more; j++) {
                here = table[i * width + j] / a, there = table[row * width + j] / b;
                less = here < there, more = here > there;
            }
            if (less) row = i;
        }
        if (row < 0) return 0;
    }
    return 0;
}

/* Which rows hold, where friction is along lines only. Unknowns: one-sided reactions above their floors; friction above its lower limit, and its slip
   downwards. `place` (n), `table` and `basis`: room. */
static int choose_lines(const Problem *p, long *place, double *table, long *basis) {
    const Decision *D = p->D;
    long n = D->n, gaps = D->gaps, in = 0, held = 0;
    double *unit = p->work;
    for (long i = 0; i < n; i++) unit[i] = 1 / unit_of(own_of(D, i)), place[i] = -1;
    for (long i = 0; i < gaps; i++)
        if (p->law[i] == MAY_HOLD) place[i] = in++;
    for (long f = 0; f < D->lines; f++)
        if (p->law[gaps + f] == MAY_HOLD || p->law[gaps + f] == MAY_SLIDE) place[gaps + f] = in + held++;
    long size = in + 2 * held, width = 2 * size + 2;
    double *line = table + size * width;
    memset(table, 0, sizeof(double) * (size_t)(size * width));
    for (long i = 0; i < gaps; i++) p->push[i] = p->law[i] == MAY_HOLD ? floor_of(p, i) : 0;
    for (long i = 0; i < n; i++) {
        if (place[i] < 0) continue;
        double q = p->start[i] * unit[i];
        memset(line, 0, sizeof(double) * (size_t)(in + held + 1));
        for (long j = 0; j < n; j++) {
            double w = D->W[i * n + j] * unit[i] * (i == j ? 1 + p->damping : 1);
            if (place[j] >= 0) line[place[j]] += w * unit[j];
            if (j < gaps) {
                q += w * p->push[j];
                continue;
            }
            long f = j - gaps;
            double part = place[j] >= 0 ? -1 : p->law[j] == AGAINST ? -p->along[3 * f] : 0;
            if (part == 0) continue;
            const double *by = limit_by(p, f);
            q += w * part * limit_of(p, f);
            for (long k = 0; k < gaps; k++)
                if (place[k] >= 0) line[place[k]] += w * part * by[k] * unit[k];
        }
        double *first = table + place[i] * width;
        first[place[i]] = 1;
        for (long k = 0; k < in + held; k++) first[size + k] = -line[k];
        if (i >= gaps) first[size + place[i] + held] = -1;
        first[2 * size] = -1;
        first[2 * size + 1] = q;
        if (i < gaps) continue;
        double *second = table + (place[i] + held) * width;
        const double *by = limit_by(p, i - gaps);
        for (long k = 0; k < gaps; k++)
            if (place[k] >= 0) second[size + place[k]] -= 2 * by[k] * unit[k] / unit[i];
        second[place[i] + held] = 1;
        second[size + place[i]] = 1;
        second[2 * size] = -1;
        second[2 * size + 1] = 2 * limit_of(p, i - gaps) / unit[i];
    }
    if (size && !lemke(table, basis, size)) return 0;
    double *value = line; /* of unknowns, NAN where they are not in the basis */
    for (long k = 0; k < size; k++) value[k] = NAN;
    for (long r = 0; r < size; r++)
        if (basis[r] >= size && basis[r] < 2 * size) value[basis[r] - size] = table[r * width + 2 * size + 1];
    for (long i = 0; i < gaps; i++)
        if (place[i] >= 0) {
            p->law[i] = value[place[i]] > 0 ? HOLDS : OPENS;
            p->push[i] = floor_of(p, i) + (value[place[i]] > 0 ? value[place[i]] * unit[i] : 0);
        }
    for (long f = 0; f < D->lines; f++) {
        long i = gaps + f, k = place[i];
        if (k < 0) continue;
        int low = isnan(value[k]), high = !isnan(value[k + held]); /* a slip upwards leaves the force at its lower limit, and the other way round */
        double limit = limit_of(p, f), force = low ? -limit : high ? limit : value[k] * unit[i] - limit;
        p->push[i] = force;
        p->along[3 * f] = low ? 1 : -1;
        p->law[i] = !(limit > 0) ? OFF : low || high ? STARTS : HOLDS;
    }
    return 1;
}

/* An answer with the damping there is, about `centre`: from what is there, else from sweeps. */
static int damped_answer(const Problem *p, const long *asked) {
    long n = p->D->n, laws = p->D->gaps + p->D->frictions;
    double *kept = p->work + n * n + 3 * n;
    if (newton_of_laws(p, asked)) return 1;
    for (long i = 0; i < n; i++) p->push[i] = i < p->D->gaps && asked[i] == MAY_HOLD ? floor_of(p, i) : 0;
    for (long doubled = 0, sweeps = SWEEPS; doubled < DOUBLINGS; doubled++, sweeps *= 2) {
        memcpy(p->law, asked, sizeof(long) * (size_t)laws);
        for (long k = 0; k < sweeps; k++) {
            double most = 0, changed = sweep(p);
            for (long i = 0; i < n; i++) most = fmax(most, fabs(p->push[i]) * unit_of(own_of(p->D, i)));
            if (!(changed > EPS * most)) break;
        }
        memcpy(kept, p->push, sizeof(double) * (size_t)n);
        if (newton_of_laws(p, asked)) return 1;
        memcpy(p->push, kept, sizeof(double) * (size_t)n);
    }
    return 0;
}

/* The same of valves alone, whose laws are OFF or MAY_HOLD, or HOLDS: which hold is all that is asked. */
static int choose_valves(const Problem *p, long *place, double *table, long *basis) {
    Decision D = *p->D;
    Problem own = *p;
    D.gaps = D.valves;
    D.lines = D.planes = D.frictions = D.magnitudes = 0;
    own.D = &D;
    own.damping = 0;
    memset(p->push, 0, sizeof(double) * (size_t)D.n);
    memset(p->centre, 0, sizeof(double) * (size_t)D.n);
    if (!choose_lines(&own, place, table, basis)) return 0;
    find_rates(&own);
    return answers(&own);
}

/* Solves a problem whose laws are OFF, MAY_HOLD, MAY_SLIDE or AGAINST: then they are OFF, AGAINST, HOLDS, OPENS or STARTS. `place` (n): room. Returns whether
   there is an answer; ROUGHLY, where it has not settled, since what slips does so hardly at all. */
static int complementary(const Problem *p, long *place, double *table, long *basis) {
    const Decision *D = p->D;
    long *asked = p->asked, n = D->n;
    memcpy(asked, p->law, sizeof(long) * (size_t)(D->gaps + D->frictions));
    memset(p->centre, 0, sizeof(double) * (size_t)n);
    int chosen = D->frictions == D->lines && D->magnitudes == 0 && choose_lines(p, place, table, basis);
    if (!chosen)
        for (long i = 0; i < n; i++) p->push[i] = i < D->gaps && asked[i] == MAY_HOLD ? floor_of(p, i) : 0;
    double last = INFINITY;
    int whole = p->damping == 0;
    double part = 0.1;
    Problem less = *p;
    for (long again = 0; again < (p->damping > 0 ? UNDAMPED : 1); again++) {
        if (again > 0 && again % SETTLING == 0) less.damping *= part;
        while (!damped_answer(&less, asked)) {
            if (!(less.damping < p->damping)) return 0;
            less.damping *= 10; /* what grows until its slip ends has no answer with less */
            part = 1;
            memcpy(p->push, p->centre, sizeof(double) * (size_t)n);
        }
        double changed = 0, most = 0;
        for (long i = 0; i < n; i++) {
            changed = fmax(changed, fabs(p->push[i] - p->centre[i]) * unit_of(own_of(D, i)));
            most = fmax(most, fabs(p->push[i]) * unit_of(own_of(D, i)));
        }
        memcpy(p->centre, p->push, sizeof(double) * (size_t)n);
        whole |= changed <= ROUNDED * EPS * most || (changed <= FITS * most && changed >= 0.5 * last);
        if (whole) break;
        last = changed;
    }
    find_rates(p);
    for (long f = 0; f < D->frictions; f++) { /* the way of the slip; of what would carry more, if others of the rows that depend on it did not have to carry the rest: against the force */
        long i = row_of(D, f), size = rows_of(D, f), *law = p->law + D->gaps + f;
        double speed = size_of(D, f, p->rate), force = size_of(D, f, p->push), *e = p->along + 3 * f;
        int full = *law == HOLDS && p->damping > 0 && force > 0 && limit_needed(D, f, p->push + i) >= (1 - FITS) * limit_of(p, f);
        if (full) *law = STARTS;
        if (*law != STARTS) continue;
        int told = size == 1 && 2 * force > limit_of(p, f); /* by the force, unless that is nothing but rounding beside others */
        if (!told && speed > 0 && !full) against(D, f, p->rate + i, e);
        else
            for (long k = 0; k < size; k++) e[k] = size == 1 ? (p->push[i] > 0 ? -1 : 1) : -p->push[i + k] / (size > 2 ? limit_of(p, f) : force);
    }
    return !answers(p) ? 0 : whole ? 1 : ROUGHLY;
}
