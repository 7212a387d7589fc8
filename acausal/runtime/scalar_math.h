/* Functions of one number, by this package: C libraries differ in last bits, and some compilers bring their own. */

INLINE double of_number(V found) { return found[0]; }
#define cos(x) of_number(v_cos(v_all(x)))
#define sin(x) of_number(v_sin(v_all(x)))
#define atan2(y, x) of_number(v_atan2(v_all(y), v_all(x)))
#define log(x) of_number(v_log(v_all(x)))
#define hypot(x, y) of_number(v_hypot(v_all(x), v_all(y)))

/* x^y for x >= 0 and |y| < 20 to 1e-5 of it: for what chooses steps, never for states. */
static double power(double x, double y) {
    union {
        double value;
        unsigned long long bits;
    } part = {x}, scale;
    if (!(x > 0) || x == INFINITY || y != y) return x == 0 || x == INFINITY ? (y == 0 ? 1 : (x == 0) == (y > 0) ? 0 : INFINITY) : NAN;
    double exponent = 0;
    if (x < 0x1p-1022) part.value = x * 0x1p54, exponent = -54;
    exponent += (double)(long)(part.bits >> 52) - 1023;
    part.bits = (part.bits & 0xfffffffffffffULL) | 0x3ff0000000000000ULL;
    if (part.value > 1.4142135623730951) part.value *= 0.5, exponent += 1;
    double s = (part.value - 1) / (part.value + 1), q = s * s; /* log2 of 1/sqrt(2) ... sqrt(2), by the inverse hyperbolic tangent */
    double log2 = 2.8853900817779268 * s * (1 + q * (1.0 / 3 + q * (1.0 / 5 + q * (1.0 / 7))));
    double z = y * (exponent + log2), whole = floor(z + 0.5), f = 0.69314718055994531 * (z - whole);
    if (!(fabs(whole) < 1022)) return whole > 0 ? INFINITY : 0;
    scale.bits = (unsigned long long)((long long)whole + 1023) << 52;
    return scale.value * (1 + f * (1 + f * (1.0 / 2 + f * (1.0 / 6 + f * (1.0 / 24 + f * (1.0 / 120))))));
}
