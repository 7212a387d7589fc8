/* Which way goes on: Gauss by fixed-point iteration, Gauss by Newton's, or Radau. What each step has cost is compared with what another way would
   have cost for as much motion; the way changes when what has been lost comes to what the change costs. Costs are counted, in operations on lanes (the
   functions *_cost), never measured: the same run takes the same way everywhere. */

#define KRYLOV 12
#define BALANCED 8      /* sweeps that make rows and columns of a matrix equal */
#define OSCILLATES 0.1  /* of the largest eigenvalue: decay is less */
#define CONTRACTION 0.1 /* by the largest eigenvalue, where it converges well from the first sweep on: matrices that damp are seldom normal */
#define ITERATIONS 10.0 /* of a step whose contraction is what fixed-point iteration aims at */
#define NEWTONS 4.0     /* iterations of a step by Newton's, and */
#define RENEWED 0.7     /* Jacobians and factorisations of it: means of 90 runs */
#define GAIN 1.35       /* what another way promises it has to promise by so much: predictions are not better */
#define TRIAL 8         /* steps that tell what a method costs */
#define SHARE 0.4       /* of the work until then: what the first trial needs if all is well */
#define OTHER 16        /* times longer or shorter steps: what a trial told says nothing here */
#define FORGOTTEN 4     /* times as long steps as may be tried: Gauss makes none */
#define LOOKING 0.03    /* of the work: may be spent on looking */
#define STEEP 2         /* slow steps beside singular positions, less those that are not */
#define BEHIND 8        /* steps by Newton's iteration behind them */

/* Fastest decay and growth, and largest magnitude, of the eigenvalues [1/s] of the linearised rates. */
struct Spectrum {
    double decay, growth, radius;
};

/* Eigenvalues of a Hessenberg matrix (n, n), rows of KRYLOV, by the double shift of Francis; the matrix is lost. 0 when they do not converge.
   Golub and Van Loan, Matrix Computations, section 7.5. */
static int hessenberg_spectrum(double (*H)[KRYLOV], long n, struct Spectrum *found) {
    double norm = 0, moved = 0;
    for (long i = 0; i < n; i++)
        for (long j = 0; j < n; j++) norm += fabs(H[i][j]);
    if (!(norm < INFINITY)) return 0;
    int tries = 0;
    for (long last = n - 1; last >= 0;) {
        long first = last;
        for (; first > 0; first--) {
            double near = fabs(H[first - 1][first - 1]) + fabs(H[first][first]);
            if (fabs(H[first][first - 1]) <= EPS * (near > 0 ? near : norm)) break;
        }
        double a = H[last][last];
        if (last - first < 2) { /* one or two eigenvalues stand alone */
            double real[2] = {a + moved, a + moved}, imaginary = 0;
            if (last > first) {
                double half = 0.5 * (H[last - 1][last - 1] - a), product = H[last][last - 1] * H[last - 1][last], d = half * half + product;
                double root = sqrt(fabs(d));
                imaginary = d < 0 ? root : 0;
                real[0] += half + (d < 0 ? 0 : root);
                real[1] += half - (d < 0 ? 0 : root);
            }
            for (int k = 0; k < 2; k++) {
                found->decay = fmax(found->decay, -real[k]);
                found->growth = fmax(found->growth, real[k]);
                found->radius = fmax(found->radius, hypot(real[k], imaginary));
            }
            last = first - 1;
            tries = 0;
            continue;
        }
        if (++tries > 40) return 0;
        double trace = H[last - 1][last - 1] + a, determinant = H[last - 1][last - 1] * a - H[last - 1][last] * H[last][last - 1];
        if (tries % 10 == 0) { /* another shift, out of a cycle */
            double s = fabs(H[last][last - 1]) + fabs(H[last - 1][last - 2]);
            trace = 1.5 * s;
            determinant = s * s;
        }
        double x = H[first][first] * (H[first][first] - trace) + H[first][first + 1] * H[first + 1][first] + determinant;
        double y = H[first + 1][first] * (H[first][first] + H[first + 1][first + 1] - trace);
        double z = H[first + 1][first] * H[first + 2][first + 1];
        for (long k = first; k < last; k++) { /* reflections chase the bulge down */
            long rows = k + 1 < last ? 3 : 2;
            double scale = fabs(x) + fabs(y) + fabs(z);
            if (scale > 0) {
                double v[3] = {x / scale, y / scale, z / scale}, length = copysign(sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]), v[0]);
                v[0] += length;
                double factor = 1 / (length * v[0]);
                for (long j = k > first ? k - 1 : first; j <= last; j++) {
                    double sum = 0;
                    for (long i = 0; i < rows; i++) sum += v[i] * H[k + i][j];
                    for (long i = 0; i < rows; i++) H[k + i][j] -= factor * sum * v[i];
                }
                for (long i = first; i <= (k + 3 < last ? k + 3 : last); i++) {
                    double sum = 0;
                    for (long j = 0; j < rows; j++) sum += v[j] * H[i][k + j];
                    for (long j = 0; j < rows; j++) H[i][k + j] -= factor * sum * v[j];
                }
            }
            x = H[k + 1][k];
            y = k + 2 <= last ? H[k + 2][k] : 0;
            z = k + 3 <= last ? H[k + 3][k] : 0;
        }
        for (long i = first + 2; i <= last; i++)
            for (long j = first; j < i - 1; j++) H[i][j] = 0;
    }
    return 1;
}

static int make_krylov(Integrator *I) {
    struct State *T = I->state;
    if (T->krylov) return 1;
    T->krylov = reserve_doubles(I, (KRYLOV + 2) * I->nx + 1);
    return T->krylov != 0;
}

/* Entry of the last Jacobian; 0 beside its pattern. */
static double entry(const Integrator *I, long row, long column) {
    for (long a = I->pattern.start[column]; a < I->pattern.start[column + 1]; a++)
        if (I->pattern.row[a] == row) return I->state->J[a];
    return 0;
}

/* States without a size get one from neighbours that have: as large as would make rows and columns equal, or as a step of size h moves them. */
static void size_others(const Integrator *I, double h, double *size) {
    for (int reached = 1; reached;) {
        reached = 0;
        for (long j = 0; j < I->nx; j++) {
            if (size[j] == 0) continue;
            for (long a = I->pattern.start[j]; a < I->pattern.start[j + 1]; a++) {
                long i = I->pattern.row[a];
                double there = fabs(I->state->J[a]), back = fabs(entry(I, j, i)), found = size[j] * (back > 0 ? sqrt(there / back) : h * there);
                if (size[i] > 0 || !(found > 0) || !(found < INFINITY)) continue;
                size[i] = found;
                reached = 1;
            }
        }
    }
}

/* Sizes (n) of states in which rows and columns of the Jacobian are about equal, but for the diagonal: from those that states have, or that a step of size h
   gives them. 0: a state that stays zero. Osborne (1960). Returns 0 when the input function failed. */
static int balance(Integrator *I, double h, double *size) {
    struct State *T = I->state;
    long n = I->nx;
    double *row = T->krylov, *column = row + n;
    if (!rate_at(I, I->t, I->x, row)) return 0;
    for (long i = 0; i < n; i++) T->before[i] = I->x[i] + h * row[i];
    if (!rate_at(I, I->t + h, T->before, column)) return 0;
    for (long i = 0; i < n; i++) {
        double moved = h * fmax(fabs(row[i]), fabs(column[i]));
        size[i] = fmax(T->size[i], moved < INFINITY ? moved : 0);
    }
    size_others(I, h, size);
    for (int sweep = 0; sweep < BALANCED; sweep++) {
        for (long i = 0; i < n; i++) row[i] = column[i] = 0;
        for (long j = 0; j < n; j++)
            for (long a = I->pattern.start[j]; a < I->pattern.start[j + 1]; a++) {
                long i = I->pattern.row[a];
                if (i == j || size[i] == 0) continue;
                double entry = fabs(T->J[a]) * size[j] / size[i];
                row[i] += entry;
                column[j] += entry;
            }
        for (long i = 0; i < n; i++) {
            double factor = sqrt(sqrt(row[i] / column[i]));
            if (factor > 0 && factor < INFINITY) size[i] *= factor;
        }
    }
    return 1;
}

/* The spectrum of the last Jacobian, seen from a Krylov space, in steps of size h. 0 where it cannot be seen, -1 when the input function failed. */
static int find_spectrum(Integrator *I, double h, struct Spectrum *found) {
    struct State *T = I->state;
    long n = I->nx, m = n < KRYLOV ? n : KRYLOV, k = 0;
    if (!make_krylov(I)) return 0;
    double *size = T->krylov + KRYLOV * n, *next = size + n, H[KRYLOV][KRYLOV] = {{0}}, norm = 0;
    unsigned draw = 1;
    *found = (struct Spectrum){0, 0, 0};
    if (!balance(I, h, size)) return -1;
    for (long i = 0; i < n; i++) {
        T->krylov[i] = (double)((draw = draw * 1664525u + 1013904223u) >> 8) / 16777216.0 - 0.5;
        if (size[i] == 0) T->krylov[i] = 0;
        norm += T->krylov[i] * T->krylov[i];
    }
    for (long i = 0; i < n && norm > 0; i++) T->krylov[i] /= sqrt(norm);
    for (; k < m && norm > 0; k++) { /* Arnoldi's iteration */
        const double *v = T->krylov + k * n;
        double all = 0;
        norm = 0;
        for (long i = 0; i < n; i++) next[i] = 0;
        for (long j = 0; j < n; j++)
            for (long a = I->pattern.start[j]; a < I->pattern.start[j + 1]; a++) next[I->pattern.row[a]] += T->J[a] * size[j] * v[j];
        for (long i = 0; i < n; i++) {
            next[i] = size[i] > 0 ? next[i] / size[i] : 0;
            all += next[i] * next[i];
        }
        for (long j = 0; j <= k; j++) {
            const double *w = T->krylov + j * n;
            for (long i = 0; i < n; i++) H[j][k] += w[i] * next[i];
            for (long i = 0; i < n; i++) next[i] -= H[j][k] * w[i];
        }
        for (long i = 0; i < n; i++) norm += next[i] * next[i];
        if (!(norm > 1e-12 * all) || k + 1 == m) {
            k++;
            break;
        }
        H[k + 1][k] = norm = sqrt(norm);
        for (long i = 0; i < n; i++) T->krylov[(k + 1) * n + i] = next[i] / norm;
    }
    if (!hessenberg_spectrum(H, k, found)) return 0;
    if (found->decay < 1e-5 * found->radius) found->decay = 0;
    return 1;
}

/* What a step by Newton's iteration costs. */
static double newton_cost(const Integrator *I, const Stages *S) {
    return step_cost(I) + RENEWED * (jacobian_cost(I) + factor_cost(I, S->method)) + NEWTONS * (sweep_cost(I, S) + direction_cost(I, S->method));
}

/* What a step by fixed-point iteration costs that is a part of the longest one. */
static double sweeps_cost(const Integrator *I, double part) {
    double iterations = fmin(ITERATIONS, 2 + (ITERATIONS - 2) * log(PLAIN) / log(PLAIN * part));
    return step_cost(I) + iterations * sweep_cost(I, &I->state->stages[0]);
}

static double look_cost(const Integrator *I) {
    double m = (double)(I->nx < KRYLOV ? I->nx : KRYLOV);
    return (double)I->operations + 5 * (m + 2 * BALANCED) * (double)I->pattern.start[I->nx] + 3 * m * m * (double)I->nx;
}

static double largest_eigenvalue(const Method *m) {
    double most = 0;
    for (long e = 0; e < m->eigenvalues; e++) most = fmax(most, hypot(m->eigen_re[e], m->eigen_im[e]));
    return most;
}

/* From now on steps are weighed anew. */
static void begin_weighing(Integrator *I) {
    struct Costs *C = &I->state->costs;
    C->regret = C->cost = C->motion = 0;
    C->mark = I->work;
}

/* From now on stages are solved by Newton's iteration, of the method of that number; in steps of size h at first. */
static void turn_to_newton(Integrator *I, long method, double h) {
    struct State *T = I->state;
    T->newton_now = 1;
    T->jacobian_fresh = 0;
    I->error = I->contraction = 0;
    I->h = h;
    if (method != I->method) T->since_switch = 0;
    I->method = method;
    forget_noise(I);
    begin_weighing(I);
}

/* Where modes have changed: how slips turned before says nothing of those that begin now, nor does what rounding made of states that nothing else moved. */
static void forget_mode(Integrator *I) {
    struct State *T = I->state;
    if (!slips_turn(I)) return;
    T->costs.turns = 0;
    T->costs.newton_rate = INFINITY;
    memset(T->known, 0, sizeof(double) * (size_t)I->nx);
}

static void turn_to_gauss(Integrator *I) {
    I->state->newton_now = 0;
    I->state->costs.hard = 0;
    I->error = I->contraction = 0;
    I->method = 0;
    begin_weighing(I);
}

/* Number of the Radau method to begin with; 0 where there is none but Gauss. */
static long some_radau(const Integrator *I) {
    long wanted = (I->method_list[0].kind == GAUSS) + (I->rtol > 1e-4 ? 0 : I->rtol > 1e-9 ? 1 : 2);
    return wanted < I->methods ? wanted : I->methods - 1;
}

/* The same, where what is stiff lasts. */
static long first_radau(const Integrator *I) { return slips_turn(I) && I->method_list[0].kind == GAUSS ? 0 : some_radau(I); }

static int is_beside(const Integrator *I, const Stages *S) {
    for (long j = 0; j < S->s && present(&I->clearance); j++)
        if (!(S->clear[j] >= NEARBY)) return 1;
    return 0;
}

/* Loops that may pass singular positions: beside these rates are steep and not stiff, a spectrum says nothing, and what steps cost there says nothing of other
   places. Newton's iteration takes over after some steps that fixed-point iteration makes short, and leaves some steps behind the position; but for a motion that
   decays from its first step on, as long as it has not been beside one. Whether that rule holds. */
static int is_steep(Integrator *I, const Stages *S, int slow) {
    struct State *T = I->state;
    struct Costs *C = &T->costs;
    if (I->newton != WHERE_SLOW || !present(&I->clearance)) return 0;
    int beside = is_beside(I, S);
    C->passes |= beside;
    if (T->newton_now) {
        if (C->decays && !C->passes) return 1;
        if (I->method) turn_to_newton(I, 0, I->h);
        if (++C->behind >= BEHIND && !beside) turn_to_gauss(I);
        return 1;
    }
    C->hard = slow ? C->hard + 1 : C->hard > 0 ? C->hard - 1 : 0;
    if (C->hard < STEEP) return 1;
    C->behind = 0;
    turn_to_newton(I, 0, I->h);
    return 1;
}

/* Sees the spectrum for steps of size h, and with it what fixed-point iteration would cost. What only oscillates stays with Gauss, which keeps its
   energy. 0 when the input function failed. */
static int look(Integrator *I, double h) {
    struct Costs *C = &I->state->costs;
    const Stages *S = &I->state->stages[0];
    struct Spectrum seen;
    int known = find_spectrum(I, h, &seen);
    C->looked = I->work += look_cost(I) - (double)I->operations;
    if (known <= 0) return !known;
    C->decays = seen.decay > 3 * seen.growth && h * seen.decay > 1;
    C->fade = seen.decay / (seen.radius * seen.radius);
    double contraction = I->copies && seen.decay < OSCILLATES * seen.radius ? sqrt(SQUARED) : CONTRACTION, reach = contraction / (largest_eigenvalue(S->method) * seen.radius);
    C->sweeps = sweeps_cost(I, 1) / reach;
    C->reach = reach;
    return 1;
}

/* What predictions do not tell, a trial of some steps does, each time that as much work has been done as before. Until now method `before` cost
   so much per time. */
static void begin_trial(Integrator *I, long before, double paid) {
    struct Costs *C = &I->state->costs;
    C->paid = paid;
    C->before = before;
    C->size = I->h;
    C->trial = TRIAL;
    C->trial_work = I->work;
    C->trial_t = I->t;
}

/* Slips that begin slowly have directions that decay many times in a step, of which Gauss leaves nearly all: so Radau goes on after a step of size h, until Gauss leaves little. */
static void let_settle(Integrator *I, double h) {
    struct State *T = I->state;
    double decay = 0, s = (double)I->method_list[0].stages;
    for (long i = 0; i < I->nx; i++) decay -= fmin(entry(I, i, i), 0);
    if (h * decay > s * (s + 1)) return;
    T->settling = 0;
    if (I->method) turn_to_newton(I, 0, I->h);
}

/* The size of steps that accuracy would allow after one of size h, from how fast the first `count` Legendre coefficients of the rates decay. Later ones are
   nothing but rounding where steps are short. */
static double free_size(const Integrator *I, const Stages *S, double h, long count) {
    const struct State *T = I->state;
    long width = S->blocks * LANES;
    double sizes[64] = {0}, largest = 0, r = 0, order = (double)S->method->order;
    for (long i = 0; i < I->nx; i++) {
        double noise = fmax(T->noise[i], LEFT * T->scale[i] / h); /* less is what the iteration leaves */
        for (long k = 0; k < count; k++) sizes[k] = fmax(sizes[k], heard(S->a[i * width + k], (double)(2 * k + 1) * noise) * (h / T->scale[i]));
    }
    for (long k = 0; k < count; k++) largest = fmax(largest, sizes[k]);
    double as_fast = largest; /* largest r^k */
    for (long k = 1; k < count; k++) {
        as_fast *= r;
        if (sizes[k] > as_fast) r = power((as_fast = sizes[k]) / largest, 1 / (double)k);
    }
    return r > 0 ? h * CAREFUL * power(largest * power(r, order), -1 / (order + 1)) : INFINITY;
}

/* After a step of size h by fixed-point iteration that cost so much, which might have been `limit` long for the iteration to converge as well, or a
   try in vain (h = 0): whether Newton's iteration goes on, in steps of size `next`. */
static int leave_fixed_point(Integrator *I, Stages *S, double h, double limit, double next, double cost) {
    struct Costs *C = &I->state->costs;
    if (slips_turn(I) && limit == INFINITY) return 0; /* a guess that left nothing to do says nothing of iterations, of which the next may not converge */
    if (I->newton != WHERE_SLOW || (present(&I->clearance) && (I->steps > 0 || is_beside(I, S)))) return 0;
    double newton = newton_cost(I, S), possible = h == 0 ? INFINITY : limit < 2 * h ? free_size(I, S, h, S->s < 3 ? S->s : 3) : limit;
    C->regret += cost - GAIN * fmin(newton * (limit < possible ? h / possible : h > 0), C->newton_rate * h);
    C->cost += cost;
    C->motion += h;
    if (C->regret <= 0) begin_weighing(I);
    if (C->regret < (1 + (double)C->turns) * newton) return 0;
    if (h > 0 && C->cost < GAIN * C->newton_rate * C->motion) { /* whether that is so with rounding looked at */
        if (!I->state->noisy) sample_noise(I, S, 0, 0);
        possible = free_size(I, S, h, S->s);
        forget_noise(I);
        if (C->cost < GAIN * newton * C->motion / possible) {
            begin_weighing(I);
            return 0;
        }
    }
    C->sweeps = C->motion > 0 ? C->cost / C->motion : INFINITY;
    C->since = C->turned_work = I->work;
    C->turned_t = I->t;
    C->turns++;
    C->undecided = 1;
    turn_to_newton(I, 0, next);
    return 1;
}

/* Before the first step of size h by Newton's iteration: with Radau where the Jacobian decays. 0 when the input function failed. */
static int choose_newton(Integrator *I, double h) {
    struct Costs *C = &I->state->costs;
    double sweeps = C->sweeps;
    C->undecided = 0;
    if (!refresh_jacobian(I)) return 0;
    if (!first_radau(I)) return 1;
    if (!look(I, h)) return 0;
    C->sweeps = sweeps;
    if (C->decays) I->method = first_radau(I);
    return 1;
}

/* After a step of a trial. It ends after so many steps that do not grow any more, or when it has become too dear. */
static void judge_trial(Integrator *I, int grows, double newton) {
    struct Costs *C = &I->state->costs;
    if (I->work - C->trial_work < C->paid * (I->t - C->trial_t) + 2 * newton) {
        if (grows) begin_weighing(I);
        if (grows || --C->trial) return;
    }
    if (I->method) C->radau = I->method;
    C->trial = 0;
    C->since = C->wait = I->work;
    if (GAIN * C->cost < C->paid * C->motion) begin_weighing(I);
    else turn_to_newton(I, C->before, fmax(I->h, C->size));
    C->size = I->h;
}

/* Of what is fastest and decays, -a +- ib, steps of Gauss leave exp(-2 s (s + 1) a / (h (a^2 + b^2))): how many times longer they are than those that forget
   a fifth of it. */
static double too_long(const Integrator *I) {
    double s = (double)I->method_list[0].stages;
    return I->h / (8 * s * (s + 1) * I->state->costs.fade);
}

/* After a step of size h by Newton's iteration: whether fixed-point iteration is cheaper again, or the other method worth a trial. 0 when the input function
   failed. */
static int review_newton(Integrator *I, Stages *S, double h) {
    struct Costs *C = &I->state->costs;
    if (I->newton != WHERE_SLOW) return 1;
    double cost = I->work - C->mark, newton = newton_cost(I, S);
    int grows = I->h > 1.5 * h;
    C->mark = I->work;
    C->cost = (1 - 1.0 / TRIAL) * C->cost + cost;
    C->motion = (1 - 1.0 / TRIAL) * C->motion + h;
    if (C->sweeps < INFINITY) C->regret = fmax(0, C->regret + cost - GAIN * fmax(C->sweeps * h, sweeps_cost(I, C->reach > h ? h / C->reach : 1)));
    if (C->regret == 0 || I->h > 2 * C->short_size) { /* short steps do not last */
        C->regret = 0;
        C->short_size = I->h;
    }
    if (C->regret > (1 + (double)C->turns) * newton) {
        C->trial = 0;
        C->turns++;
        C->newton_rate = (I->work - C->turned_work) / (I->t - C->turned_t);
        turn_to_gauss(I);
        if (C->reach > 0) I->h = fmin(I->h, C->reach);
        return 1;
    }
    if (C->decays && I->method == 0 && first_radau(I) && too_long(I) > FORGOTTEN) {
        C->trial = 0;
        C->size = I->h;
        turn_to_newton(I, C->radau ? C->radau : first_radau(I), I->h);
        return 1;
    }
    if (C->trial) {
        judge_trial(I, grows, newton);
        return 1;
    }
    if (LOOKING * (I->work - C->looked) > look_cost(I) && !look(I, h)) return 0;
    if (!C->decays || !first_radau(I) || too_long(I) > 1) return 1;
    int other = fmax(I->h / C->size, C->size / I->h) > OTHER, steady = I->h * TRIAL < 1.5 * C->motion;
    if (steady && I->work - C->since > fmax(other ? 0 : C->wait, TRIAL * newton / SHARE)) {
        begin_trial(I, I->method, C->cost / C->motion);
        turn_to_newton(I, I->method ? 0 : C->radau ? C->radau : first_radau(I), I->h);
    }
    return 1;
}
