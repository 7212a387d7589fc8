/* Dry friction of round patches that slide and spin at once, see acausal/numerics/patches.py: of a slip u = (slip of the centre (2), speed of the edge) it does not
   depend on the size; all forces there are, by the limit, are the boundary of a convex body, and u is its normal there. Round about the spin: by (v, w), v >= 0. */

#define BEND 1e-5 /* of an angle: across which the bend of the boundary is taken */

enum Pressure { NO_PATCH, UNIFORM, HERTZ, RING };

/* E of k, and B, D, (D - B) / k^2; k2: k^2, rest: 1 - k^2. */
static void elliptic(double k2, double rest, double *B, double *D, double *C) {
    double a = 1, b = sqrt(rest), part = 1, total = 0, factor = 1;
    for (int n = 0; n < 9; n++) {
        double mean = 0.5 * (a + b), next = n ? part * k2 : 1;
        b = sqrt(a * b), a = mean;
        part = next * next / (16 * a * a);
        factor *= 2;
        total += factor * part;
    }
    double K = 0.5 * PI / a;
    *B = 0.5 * K * (1 - k2 * total), *D = *B + K * k2 * total, *C = K * total;
}

/* Forces over slips where the larger slip is one and the smaller one has the square k2, by the slip and by the spin. */
static void patch_slopes(int pressure, int slides, double k2, double *by_slip, double *by_spin) {
    double B, D, C, rest = 1 - k2;
    if (pressure == HERTZ && !slides) {
        *by_slip = 3 * PI / 32 * (4 - k2), *by_spin = 3 * PI / 128 * (8 - 8 * k2 + 3 * k2 * k2);
    } else if (pressure == HERTZ && k2 < 0.3) {
        double e = 1, moment = 1, power = 1; /* by k^(2 j): E of rings, 2 / pi of it, and their part of the pressure */
        *by_slip = 1, *by_spin = 0;
        for (int j = 1; j < 30; j++) {
            e *= (2 * j - 1.0) / (2 * j);
            moment *= j / (j + 1.5);
            double term = -e * e / (2 * j - 1) * moment * power;
            *by_slip += term * k2, *by_spin -= 2 * j / (2 * j - 1.0) * term;
            power *= k2;
        }
    } else if (pressure == HERTZ) {
        double k = sqrt(k2), c = sqrt(fmax(rest, 0)), angle = atan2(k, c), lost = 3.0 / 64 * ((8 * k2 * k2 + 8 * k2 - 1) * angle + k * c * (1 + 14 * k2)) / (k2 * k);
        *by_slip = 3.0 / 16 * ((4 * k2 - 1) * angle + k * c * (1 + 2 * k2)) / (k2 * k);
        *by_spin = (lost - *by_slip) / k2;
    } else {
        elliptic(k2, fmax(rest, 1e-30), &B, &D, &C);
        double E = B + rest * D, first = 4 / (3 * PI) * (2 * B + rest * D);
        int ring = pressure == RING;
        *by_slip = ring ? 2 / PI * (slides ? E : B) : first;
        if (ring) *by_spin = 2 / PI * (slides ? B : E);
        else *by_spin = 4 / (9 * PI) * (slides ? 3 * B + C - D : B * (3 - k2) + rest * D * (3 - 2 * k2));
    }
}

/* The force by the limit against a slip (v, w). */
static void patch_force(int pressure, double v, double w, double *F, double *T) {
    double large = fmax(fabs(v), fabs(w)), small = fmin(fabs(v), fabs(w)) / large;
    patch_slopes(pressure, fabs(v) >= fabs(w), small * small, F, T);
    *F *= v / large, *T *= w / large;
}

/* How much of the boundary there is per angle of its normal, there. */
static double patch_bend(int pressure, double angle) {
    double F[2], T[2];
    for (int k = 0; k < 2; k++) patch_force(pressure, cos(angle + (k ? BEND : -BEND)), sin(angle + (k ? BEND : -BEND)), F + k, T + k);
    return hypot(F[1] - F[0], T[1] - T[0]) / (2 * BEND);
}

/* The angle of the normal where the boundary is nearest to (P, M), outside; `along`: where a ray to there meets it instead. By Newton's iteration between limits. */
static double patch_angle(int pressure, double P, double M, int along) {
    double lo = -0.5 * PI, hi = 0.5 * PI, at = atan2(2 * M, P), F, T;
    for (int again = 0; again < 60; again++) {
        double c = cos(at), s = sin(at);
        patch_force(pressure, c, s, &F, &T);
        double bend = patch_bend(pressure, at), out = P * c + M * s - (F * c + T * s);
        double value = along ? F * M - P * T : (M - T) * c - (P - F) * s, slope = along ? bend * (P * c + M * s) : bend + fmax(out, 0);
        if (value > 0) lo = at;
        else hi = at;
        double step = slope > 0 ? value / slope : 0, next = at + step;
        if (value == 0 || fabs(step) < 1e-15) break;
        at = next > lo && next < hi ? next : 0.5 * (lo + hi);
    }
    return at;
}

/* The force by the limit, (3), against a slip u. */
static void patch_against(int pressure, const double *u, double *e) {
    double v = hypot(u[0], u[1]), F, T;
    patch_force(pressure, v, u[2], &F, &T);
    for (int k = 0; k < 2; k++) e[k] = v > 0 ? F * u[k] / v : 0;
    e[2] = T;
}

/* By which factor a force (3) is larger than what the patch resists with along it. */
static double patch_size(int pressure, const double *r) {
    double P = hypot(r[0], r[1]), F, T;
    if (!(P > 0 || fabs(r[2]) > 0)) return 0;
    if (!isfinite(P + r[2])) return INFINITY;
    double at = patch_angle(pressure, P, r[2], 1), c = cos(at), s = sin(at);
    patch_force(pressure, c, s, &F, &T);
    return (P * c + r[2] * s) / (F * c + T * s);
}

/* The force e (3), by the limit, that is nearest to one outside, y, by the limit, and its change Q (3, 3) with that. */
static void nearest_on_patch(int pressure, const double *y, double *e, double *Q) {
    double P = hypot(y[0], y[1]), at = patch_angle(pressure, P, y[2], 0), c = cos(at), s = sin(at), F, T;
    double x[2] = {P > 0 ? y[0] / P : 1, P > 0 ? y[1] / P : 0};
    patch_force(pressure, c, s, &F, &T);
    double out = fmax(P * c + y[2] * s - (F * c + T * s), 0), bend = patch_bend(pressure, at), F1, T1;
    patch_force(pressure, fmax(c, 1e-8), s, &F1, &T1);
    double round = F1 / fmax(c, 1e-8), t[3] = {-s * x[0], -s * x[1], c}, n[3] = {-x[1], x[0], 0};
    e[0] = F * x[0], e[1] = F * x[1], e[2] = T;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) Q[3 * i + j] = bend / (bend + out) * t[i] * t[j] + round / (round + out) * n[i] * n[j];
}
