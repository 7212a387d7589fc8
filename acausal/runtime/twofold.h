/* The interpreter's programs once more in twofold precision: values are unevaluated sums of two doubles (Dekker 1971), 32 digits. For rates where the
   constraints of a loop nearly depend on one another, which lose digits in proportion to the cube of the distance from that position.

   Frames are made for twice as many lanes (see acausal/runtime/compiled.py): a value is a vector of leading parts and one of what they leave.
   What positions and loops are made of is exact to 1e-30; other functions of a value are so to first order in its second part only where
   that is easy: they have double accuracy, as laws of forces have. */

typedef struct {
    V hi, lo;
} Pair;

INLINE Pair d_of(V x) { return (Pair){x, v_all(0.0)}; }
INLINE Pair d_quick_sum(V a, V b) { /* |a| >= |b| */
    V s = a + b;
    return (Pair){s, b - (s - a)};
}
INLINE Pair d_sum(V a, V b) {
    V s = a + b, t = s - a;
    return (Pair){s, (a - (s - t)) + (b - t)};
}
INLINE Pair d_product(V a, V b) {
    V p = a * b;
#if HAVE_FMA
    return (Pair){p, v_fma(a, b, -p)};
#else
    V ca = a * v_all(134217729.0), cb = b * v_all(134217729.0), ah = ca - (ca - a), bh = cb - (cb - b), al = a - ah, bl = b - bh;
    return (Pair){p, ((ah * bh - p) + ah * bl + al * bh) + al * bl};
#endif
}
INLINE Pair d_add(Pair a, Pair b) {
    Pair s = d_sum(a.hi, b.hi), t = d_sum(a.lo, b.lo);
    s = d_quick_sum(s.hi, s.lo + t.hi);
    return d_quick_sum(s.hi, s.lo + t.lo);
}
INLINE Pair d_neg(Pair a) { return (Pair){-a.hi, -a.lo}; }
INLINE Pair d_sub(Pair a, Pair b) { return d_add(a, d_neg(b)); }
INLINE Pair d_mul(Pair a, Pair b) {
    Pair p = d_product(a.hi, b.hi);
    return d_quick_sum(p.hi, p.lo + (a.hi * b.lo + a.lo * b.hi));
}
INLINE Pair d_scaled(Pair a, double power_of_two) { return (Pair){a.hi * v_all(power_of_two), a.lo * v_all(power_of_two)}; }
INLINE Pair d_select(Mask m, Pair a, Pair b) { return (Pair){v_select(m, a.hi, b.hi), v_select(m, a.lo, b.lo)}; }
INLINE Mask d_less(Pair a, Pair b) { return (a.hi < b.hi) | ((a.hi == b.hi) & (a.lo < b.lo)); }
INLINE Mask d_equal(Pair a, Pair b) { return (a.hi == b.hi) & (a.lo == b.lo); }
INLINE Mask d_true(Pair a) { return a.hi != v_all(0.0); }
/* A leading part that is zero or not finite, alone. */
INLINE Pair d_or(V first, Pair rest) {
    return d_select((first == v_all(0.0)) | (v_abs(first) > v_all(1e300)) | (first != first), d_of(first), rest);
}
OUTLINE Pair d_div(Pair a, Pair b) {
    V q = a.hi / b.hi;
    Pair r = d_sub(a, d_mul(b, d_of(q)));
    V next = r.hi / b.hi;
    r = d_sub(r, d_mul(b, d_of(next)));
    Pair sum = d_quick_sum(q, next);
    return d_or(q, d_add(sum, d_of(r.hi / b.hi)));
}
OUTLINE Pair d_sqrt(Pair a) {
    V root = v_sqrt(a.hi);
    Pair rest = d_sub(a, d_product(root, root));
    return d_or(root, d_add(d_of(root), d_of(rest.hi / (root + root))));
}

/* sin x = x + x^3 sum of these x^2k */
static const double sine_series[][2] = {
    {-0x1.5555555555555p-3, -0x1.5555555555555p-57}, {0x1.1111111111111p-7, 0x1.1111111111111p-63},
    {-0x1.a01a01a01a01ap-13, -0x1.a01a01a01a01ap-73}, {0x1.71de3a556c734p-19, -0x1.c154f8ddc6c00p-73},
    {-0x1.ae64567f544e4p-26, 0x1.c062e06d1f209p-80}, {0x1.6124613a86d09p-33, 0x1.f28e0cc748ebep-87},
    {-0x1.ae7f3e733b81fp-41, -0x1.1d8656b0ee8cbp-97}};
/* pi / 2; products of all but the last part with turns are exact */
static const double quarter_turn[] = {0x1.921fb54400000p+0, 0x1.0b4611a600000p-34, 0x1.3198a2e000000p-69, 0x1.b839a252049c1p-104};

/* A sixteenth of what is left of the angle without quarter turns; then four times sin 2a = 2 sin a cos a, 1 - cos 2a = 2 sin^2 a. */
OUTLINE void d_sincos(Pair x, Pair *sine, Pair *cosine) {
    V turns = v_floor(x.hi * v_all(0.6366197723675814) + v_all(0.5));
    Pair r = x;
    for (int k = 0; k < 4; k++) r = d_sub(r, d_product(turns, v_all(quarter_turn[k])));
    r = d_scaled(r, 0.0625);
    Pair square = d_mul(r, r), s = d_of(v_all(0.0)), one = d_of(v_all(1.0));
    for (int k = 6; k >= 0; k--) s = d_add(d_mul(s, square), (Pair){v_all(sine_series[k][0]), v_all(sine_series[k][1])});
    s = d_add(r, d_mul(d_mul(r, square), s));
    square = d_mul(s, s);
    Pair less = d_div(square, d_add(one, d_sqrt(d_sub(one, square))));
    for (int k = 0; k < 4; k++) {
        Pair twice = d_scaled(d_mul(s, d_sub(one, less)), 2.0);
        less = d_scaled(d_mul(s, s), 2.0);
        s = twice;
    }
    Pair c = d_sub(one, less);
    V quadrant = turns - v_all(4.0) * v_floor(turns * v_all(0.25));
    Mask odd = (quadrant == v_all(1.0)) | (quadrant == v_all(3.0));
    Pair a = d_select(odd, c, s), b = d_select(odd, s, c);
    *sine = d_select(quadrant >= v_all(2.0), d_neg(a), a);
    *cosine = d_select((quadrant == v_all(1.0)) | (quadrant == v_all(2.0)), d_neg(b), b);
}
OUTLINE Pair d_sin(Pair x) {
    Pair s, c;
    d_sincos(x, &s, &c);
    return s;
}
OUTLINE Pair d_cos(Pair x) {
    Pair s, c;
    d_sincos(x, &s, &c);
    return c;
}
/* The angle of (x, y): that of the leading parts, turned by what is left of the angle against it. */
OUTLINE Pair d_atan2(Pair y, Pair x) {
    V first = v_atan2(y.hi, x.hi);
    Pair s, c;
    d_sincos(d_of(first), &s, &c);
    Pair across = d_sub(d_mul(y, c), d_mul(x, s)), along = d_add(d_mul(x, c), d_mul(y, s));
    return d_or(first, d_add(d_of(first), d_div(across, along)));
}
INLINE Pair d_truth(Mask m) { return d_of(v_truth(m)); }
INLINE Pair d_one(void) { return d_of(v_all(1.0)); }
INLINE Pair d_rest_of_circle(Pair x) { return d_sqrt(d_mul(d_sub(d_one(), x), d_add(d_one(), x))); }

/* A function of one value, and its derivative there. */
#define FIRST_ORDER(f, slope) d_or(f, d_quick_sum(f, (slope) * A.lo))
#define ALONE(f) d_of(f)

#define TWOFOLD(O) \
    O(NEG, d_neg(A)) O(SQ, d_mul(A, A)) O(TWICE, d_scaled(A, 2.0)) O(INV, d_div(d_one(), A)) O(SQRT, d_sqrt(A)) \
    O(FABS, d_select(d_less(A, d_of(v_all(0.0))), d_neg(A), A)) O(NOT, d_truth(~d_true(A))) O(SIGN, ALONE(v_copysign(v_sign(A.hi), A.hi))) \
    O(EXP, FIRST_ORDER(v_exp(A.hi), v_exp(A.hi))) O(LOG, FIRST_ORDER(v_log(A.hi), v_all(1.0) / A.hi)) O(SIN, d_sin(A)) O(COS, d_cos(A)) \
    O(TAN, d_div(d_sin(A), d_cos(A))) O(ASIN, d_atan2(A, d_rest_of_circle(A))) O(ACOS, d_atan2(d_rest_of_circle(A), A)) \
    O(ATAN, d_atan2(A, d_one())) O(SINH, ALONE(v_sinh(A.hi))) O(COSH, ALONE(v_cosh(A.hi))) O(TANH, ALONE(v_tanh(A.hi))) \
    O(ASINH, ALONE(v_asinh(A.hi))) O(ACOSH, ALONE(v_acosh(A.hi))) O(ATANH, ALONE(v_atanh(A.hi))) O(FLOOR, ALONE(v_floor(A.hi))) \
    O(CEIL, ALONE(v_ceil(A.hi))) O(ERF, ALONE(v_erf(A.hi))) O(ERFINV, ALONE(v_erfinv(A.hi))) O(LOG1P, ALONE(v_log1p(A.hi))) \
    O(EXPM1, ALONE(v_expm1(A.hi))) O(ADD, d_add(A, B)) O(SUB, d_sub(A, B)) O(MUL, d_mul(A, B)) O(DIV, d_div(A, B)) \
    O(LT, d_truth(d_less(A, B))) O(LE, d_truth(d_less(A, B) | d_equal(A, B))) O(EQ, d_truth(d_equal(A, B))) O(NE, d_truth(~d_equal(A, B))) \
    O(AND, d_truth(d_true(A) & d_true(B))) O(OR, d_truth(d_true(A) | d_true(B))) O(IF_ELSE_ZERO, d_select(d_true(A), B, d_of(v_all(0.0)))) \
    O(POW, ALONE(v_pow(A.hi, B.hi))) O(FMIN, d_select(d_less(B, A) | (A.hi != A.hi), B, A)) O(FMAX, d_select(d_less(A, B) | (A.hi != A.hi), B, A)) \
    O(FMOD, ALONE(v_fmod(A.hi, B.hi))) O(REMAINDER, ALONE(v_remainder(A.hi, B.hi))) O(COPYSIGN, d_select((v_copysign(A.hi, B.hi) == A.hi), A, d_neg(A))) \
    O(ATAN2, d_atan2(A, B)) O(HYPOT, d_sqrt(d_add(d_mul(A, A), d_mul(B, B)))) \
    O(MUL_ADD, d_add(d_mul(A, B), C)) O(MUL_SUB, d_sub(d_mul(A, B), C)) O(SUB_MUL, d_sub(C, d_mul(A, B))) O(MUL_MUL, d_mul(d_mul(A, B), C)) \
    O(MOVE, A)

/* `in` and `out` are plain values in lanes, for which places are half as far from one another. */
#define INTERPRETER interpret_twofold
#define VALUE Pair
#define OUTSIDE V
#define PARTS 2
#define OF_OUTSIDE d_of
#define TO_OUTSIDE(x) (x).hi
#define OF_NUMBER d_of
#define ALONG
#define SINCOS d_sincos
#define TABLE TWOFOLD
#define SYSTEM(at, n, m, damped) ((void)0) /* programs of pairs have none */
#include "statements.h"
#undef ALONE
#undef FIRST_ORDER
