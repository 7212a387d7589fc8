/* Which way goes on where the iteration, not accuracy, sets the step size: Gauss by fixed-point iteration, Gauss by Newton's, or Radau. Asked
   before more has been lost to short steps than Newton's first step costs, and again while Newton iterates. Costs are counted, in
   operations on lanes, never measured: the same run takes the same way everywhere. */

#define KRYLOV 12
#define ITERATIONS 10.0  /* of a step by fixed-point iteration */
#define CONTRACTION 0.1 /* by the largest eigenvalue, with which it converges well */

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
    T->krylov = reserve_doubles(I, (KRYLOV + 3) * I->nx + 1);
    return T->krylov != 0;
}

/* The spectrum at the state of now, seen from a Krylov space by differences of rates; states are measured by their sizes, or by what a step of size h
   does to them where they have none. 0 where it cannot be seen, -1 when the input function failed. */
static int find_spectrum(Integrator *I, double h, struct Spectrum *found) {
    struct State *T = I->state;
    long n = I->nx, m = n < KRYLOV ? n : KRYLOV, k = 0;
    if (!make_krylov(I)) return 0;
    double *rates = T->krylov + KRYLOV * n, *size = rates + n, *next = size + n, H[KRYLOV][KRYLOV] = {{0}}, soon = 1e-3 * h;
    unsigned draw = 1;
    *found = (struct Spectrum){0, 0, 0};
    if (!rate_at(I, I->t, I->x, rates)) return -1;
    for (long i = 0; i < n; i++) T->before[i] = I->x[i] + soon * rates[i];
    if (!rate_at(I, I->t + soon, T->before, next)) return -1;
    double norm = 0;
    for (long i = 0; i < n; i++) {
        size[i] = fmax(T->size[i], h * fmax(fabs(rates[i]), fabs(next[i])));
        if (!(size[i] < INFINITY)) return 0;
        T->krylov[i] = (double)((draw = draw * 1664525u + 1013904223u) >> 8) / 16777216.0 - 0.5;
        if (size[i] == 0) T->krylov[i] = 0;
        norm += T->krylov[i] * T->krylov[i];
    }
    for (long i = 0; i < n && norm > 0; i++) T->krylov[i] /= sqrt(norm);
    for (; k < m && norm > 0; k++) { /* Arnoldi's iteration */
        const double *v = T->krylov + k * n;
        for (long i = 0; i < n; i++) T->before[i] = I->x[i] + 1e-7 * size[i] * v[i];
        if (!rate_at(I, I->t, T->before, next)) return -1;
        double all = 0;
        norm = 0;
        for (long i = 0; i < n; i++) {
            next[i] = size[i] > 0 ? (next[i] - rates[i]) / (1e-7 * size[i]) : 0;
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

/* What a step by Newton's iteration costs that begins with a new Jacobian. */
static double newton_cost(const Integrator *I, const Stages *S) {
    return jacobian_cost(I) + factor_cost(I, S->method) + 4 * (sweep_cost(I, S) + direction_cost(I, S->method));
}

static double largest_eigenvalue(const Method *m) {
    double most = 0;
    for (long e = 0; e < m->eigenvalues; e++) most = fmax(most, hypot(m->eigen_re[e], m->eigen_im[e]));
    return most;
}

#define STEEP 2   /* slow steps, less those that are not */
#define BEHIND 8  /* steps by Newton's iteration at least */

static void start_review(Integrator *I) {
    struct State *T = I->state;
    T->review_spent = T->spent;
    T->review_t = I->t;
    T->review_steps = I->steps;
}

/* From now on stages are solved by Newton's iteration, of the method of that number; in steps of size h at first. */
static void turn_to_newton(Integrator *I, long method, double h) {
    struct State *T = I->state;
    T->newton_now = 1;
    T->jacobian_fresh = 0;
    T->turns++;
    T->doubts = 0;
    I->error = I->contraction = 0;
    I->h = h;
    if (method != I->method) T->since_switch = 0;
    I->method = method;
    forget_noise(I);
    start_review(I);
}

static void turn_to_gauss(Integrator *I) {
    struct State *T = I->state;
    T->newton_now = 0;
    T->wasted = T->turned = 0;
    T->hard = 0;
    I->error = I->contraction = 0;
    I->method = 0;
}

/* Number of the Radau method to begin with; 0 where there is none. */
static long first_radau(const Integrator *I) { return I->methods > 1 ? (I->rtol > 1e-4 ? 1 : 2) : 0; }

/* After a step of size h by fixed-point iteration, or a try of one, that the iteration made `slowness` times shorter than accuracy asks for, and that
   cost so much: whether to go on by another way, in steps of size `next`. -1 when the input function failed. */
static int leave_fixed_point(Integrator *I, Stages *S, double h, double next, double contraction, double slowness, double cost) {
    struct State *T = I->state;
    if (I->newton != WHERE_SLOW || present(&I->clearance) || !(slowness > 1)) return 0;
    T->wasted += cost * (1 - 1 / slowness);
    double newton = newton_cost(I, S);
    if (T->wasted < (I->steps == 0 ? 0.5 : 2) * newton + 0.2 * T->turned) return 0;
    T->turned += T->wasted;
    T->wasted = 0;
    struct Spectrum seen;
    int known = find_spectrum(I, h, &seen);
    if (known <= 0) return known;
    double least = 0.1 * fmin(contraction, 1) / largest_eigenvalue(S->method);
    int fast = h * seen.radius > least, before = T->suspected || I->steps == 0;
    T->suspected = fast; /* a look at one moment may deceive: decay and growth take turns in many a motion */
    if (!fast || !before) return 0;
    int decays = seen.decay > 3 * seen.growth && h * seen.decay > least;
    turn_to_newton(I, decays ? first_radau(I) : 0, next);
    return 1;
}

/* Beside singular positions of loops rates are steep and not stiff, and a spectrum says nothing: there Newton's iteration takes over after some
   steps that fixed-point iteration makes short, and leaves some steps behind them. */
static void leave_where_steep(Integrator *I, int slow, int beside) {
    struct State *T = I->state;
    if (I->newton != WHERE_SLOW || !present(&I->clearance)) return;
    if (T->newton_now) {
        if (!beside && I->steps - T->review_steps >= BEHIND) turn_to_gauss(I);
        return;
    }
    T->hard = slow ? T->hard + 1 : T->hard > 0 ? T->hard - 1 : 0;
    if (T->hard >= STEEP) turn_to_newton(I, 0, I->h);
}

/* Now and then while Newton iterates: whether Gauss by fixed-point iteration is cheaper again, or Gauss better left to Radau. -1 when the input
   function failed. */
static int review_newton(Integrator *I, double h) {
    struct State *T = I->state;
    if (I->newton != WHERE_SLOW || present(&I->clearance)) return 0;
    Stages *S = &T->stages[0];
    double look = (KRYLOV + 2) * (double)I->operations + 1e3 + 2.0 * KRYLOV * KRYLOV * (double)I->nx, spent = T->spent - T->review_spent;
    if (spent < 30 * look || I->steps - T->review_steps < 8) return 0;
    struct Spectrum seen;
    int known = find_spectrum(I, h, &seen);
    if (known < 0) return known;
    double steps = (double)(I->steps - T->review_steps), mean = (I->t - T->review_t) / steps;
    start_review(I);
    if (!known || I->h > 1.5 * mean) return 0;
    double possible = fmin(CONTRACTION / (largest_eigenvalue(S->method) * seen.radius), 1.5 * mean);
    double gauss = (ITERATIONS * sweep_cost(I, S) + 3 * (double)I->operations) / possible;
    if ((1.5 + 0.5 * (double)T->turns) * gauss < spent / steps / mean) {
        turn_to_gauss(I);
        I->h = possible;
    } else if (I->method == 0 && first_radau(I) && seen.decay > 3 * seen.growth && h * seen.decay > 1) {
        turn_to_newton(I, first_radau(I), I->h);
    }
    return 0;
}
