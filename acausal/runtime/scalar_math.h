/* Functions of one number, by this package: C libraries differ in last bits, and some compilers bring their own. */

INLINE double of_number(V found) { return found[0]; }
#define cos(x) of_number(v_cos(v_all(x)))
#define sin(x) of_number(v_sin(v_all(x)))
#define atan2(y, x) of_number(v_atan2(v_all(y), v_all(x)))
#define log(x) of_number(v_log(v_all(x)))
#define hypot(x, y) of_number(v_hypot(v_all(x), v_all(y)))
#define pow to_power

/* x^y of sizes of steps and of errors, which ten digits serve: half as long as `v_pow`. */
static double to_power(double x, double y) {
    if (!(x > 0 && x < INFINITY)) return x < 0 || x != x || y != y ? NAN : y == 0 ? 1 : (x > 0) == (y > 0) ? INFINITY : 0;
    union {
        double number;
        long long bits;
    } part = {x < VM_TINY ? x * 0x1p64 : x}, scale;
    long long e = (part.bits - 0x3fe6a09e667f3bcdLL) >> 52; /* what is left lies between the roots of a half and of two */
    part.bits -= e * (1LL << 52);
    double s = (part.number - 1) / (part.number + 1), z = s * s, z2 = z * z;
    double series = (1 + z * (1. / 3)) + z2 * ((1. / 5 + z * (1. / 7)) + z2 * ((1. / 9 + z * (1. / 11)) + z2 * (1. / 13)));
    double exponent = y * ((double)(x < VM_TINY ? e - 64 : e) + 2 / VM_LN2 * s * series);
    if (!(fabs(exponent) < 1020)) return exponent > 0 ? INFINITY : exponent < 0 ? 0 : NAN;
    double whole = exponent + VM_TO_INT - VM_TO_INT, r = VM_LN2 * (exponent - whole), r2 = r * r, r4 = r2 * r2;
    double low = 1 + r + r2 * (1. / 2 + r * (1. / 6)), middle = 1. / 24 + r * (1. / 120) + r2 * (1. / 720 + r * (1. / 5040));
    scale.bits = (1023 + (long long)whole) * (1LL << 52);
    return scale.number * (low + r4 * (middle + r4 * (1. / 40320 + r * (1. / 362880))));
}
