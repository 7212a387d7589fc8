/* Elementary functions on V (lanes.h): no libm, no tables but the bits of 2/pi, the same bits for all LANES and compilers.

   Any double is an argument: subnormals, signed zeros, infinities and NaN give what C99 Annex F says (which NaN is left open).
   The common path is free of branches; what it does not serve is computed apart when a lane asks for it, and selected by lane.
   Coefficients are minimax (Remez exchange, relative or absolute weight as the final sum needs), computed for this file.
   "dd" is a value as an unevaluated sum hi + lo (Dekker, Numer. Math. 18, 1971; Knuth, TAOCP 2, 4.2.2).
   Background: Muller, Elementary Functions (3rd ed. 2016); Cody & Waite, Software Manual for the Elementary Functions (1980).

   Worst errors found, in units of the last place, over some ten million arguments of each function (with a fused product; in
   brackets without one, where it is worse by 0.05 or more):
   sin, cos 0.80  tan 1.02  asin 0.63  acos 0.61  atan 0.73  atan2 0.86  sinh 0.67 (0.73)  cosh 0.65  tanh 0.66 (0.71)
   asinh 0.78  acosh 0.63  atanh 0.62  exp 0.77  expm1 1.27  log 0.65  log1p 0.65  pow 0.75  hypot 0.74  erf 0.95 (1.09)
   erfinv 1.48 (1.76); floor, ceil, fmod, remainder, fmin, fmax, sign are exact. */
#ifndef ACAUSAL_VECTOR_MATH_H
#define ACAUSAL_VECTOR_MATH_H

typedef unsigned long long VmU __attribute__((vector_size(8 * LANES)));

#define VM_INF __builtin_inf()
#define VM_NAN __builtin_nan("")
#define VM_TINY 0x1p-1022 /* the least normal number */
#define VM_TO_INT 0x1.8p52 /* x + this: the nearest integer stands in the low bits */
#define VM_LN2_HI 0x1.62e42fefa3800p-1 /* 42 bits: times an exponent, exact */
#define VM_LN2_LO 0x1.ef35793c76730p-45
#define VM_PI_HI 0x1.921fb54442d18p+1 /* 50 bits: times 1/4, 1/2, 3/4, exact */
#define VM_PI_LO 0x1.1a62633145c07p-53

/* Polynomials c0 + c1 z + ..., from the constant on. */
#define VM_P1(z, a) v_all(a)
#define VM_P2(z, a, ...) v_fma(z, VM_P1(z, __VA_ARGS__), v_all(a))
#define VM_P3(z, a, ...) v_fma(z, VM_P2(z, __VA_ARGS__), v_all(a))
#define VM_P4(z, a, ...) v_fma(z, VM_P3(z, __VA_ARGS__), v_all(a))
#define VM_P5(z, a, ...) v_fma(z, VM_P4(z, __VA_ARGS__), v_all(a))
#define VM_P6(z, a, ...) v_fma(z, VM_P5(z, __VA_ARGS__), v_all(a))
#define VM_P7(z, a, ...) v_fma(z, VM_P6(z, __VA_ARGS__), v_all(a))
#define VM_P8(z, a, ...) v_fma(z, VM_P7(z, __VA_ARGS__), v_all(a))
#define VM_P9(z, a, ...) v_fma(z, VM_P8(z, __VA_ARGS__), v_all(a))

/* The same in two chains, of even and odd powers; y is z^2. */
#define VM_Q6(z, y, a, b, c, d, e, f) v_fma(z, VM_P3(y, b, d, f), VM_P3(y, a, c, e))
#define VM_Q7(z, y, a, b, c, d, e, f, g) v_fma(z, VM_P3(y, b, d, f), VM_P4(y, a, c, e, g))
#define VM_Q8(z, y, a, b, c, d, e, f, g, h) v_fma(z, VM_P4(y, b, d, f, h), VM_P4(y, a, c, e, g))
#define VM_Q11(z, y, a, b, c, d, e, f, g, h, i, j, k) v_fma(z, VM_P5(y, b, d, f, h, j), VM_P6(y, a, c, e, g, i, k))
#define VM_Q13(z, y, a, b, c, d, e, f, g, h, i, j, k, l, m) v_fma(z, VM_P6(y, b, d, f, h, j, l), VM_P7(y, a, c, e, g, i, k, m))
#define VM_Q15(z, y, a, b, c, d, e, f, g, h, i, j, k, l, m, n, o) \
    v_fma(z, VM_P7(y, b, d, f, h, j, l, n), VM_P8(y, a, c, e, g, i, k, m, o))

/* a + b = result + *e exactly (Knuth). */
INLINE V vm_sum(V a, V b, V *e) {
    V s = a + b, t = s - a;
    *e = (a - (s - t)) + (b - t);
    return s;
}

/* The same where |a| >= |b| or a = 0 (Dekker). */
INLINE V vm_sum_ordered(V a, V b, V *e) {
    V s = a + b;
    *e = b - (s - a);
    return s;
}

/* a b = result + *e exactly, away from overflow and underflow (by the fused product, or Veltkamp's and Dekker's splitting). */
INLINE V vm_product(V a, V b, V *e) {
    V p = a * b;
#if HAVE_FMA
    *e = v_fma(a, b, -p);
#else
    V split = v_all(0x1p27 + 1.0), s = a * split, t = b * split;
    V ah = s - (s - a), bh = t - (t - b), al = a - ah, bl = b - bh;
    *e = ((ah * bh - p) + ah * bl + al * bh) + al * bl;
#endif
    return p;
}

/* a - b c where b c is so close to a that the result is a double. */
INLINE V vm_exact_rest(V a, V b, V c) {
#if HAVE_FMA
    return v_fma(-b, c, a);
#else
    V e, p = vm_product(b, c, &e);
    return (a - p) - e;
#endif
}

/* The quotient (a + al)/(d + dl) as a dd. */
INLINE V vm_quotient(V a, V al, V d, V dl, V *e) {
    V r = v_all(1.0) / d, q = a * r, pl, p = vm_product(q, d, &pl);
    *e = ((((a - p) - pl) + al) - q * dl) * r;
    return q;
}

/* The root of a + al > 0 as a dd. */
INLINE V vm_root(V a, V al, V *e) {
    V s = v_sqrt(a), pl, p = vm_product(s, s, &pl);
    *e = (((a - p) - pl) + al) / (s + s);
    return s;
}

/* x 2^n while the result is normal. */
INLINE V vm_scale(V x, Bits n) { return (V)((Bits)x + (n << 52)); }

/* x 2^n for |n| < 2040, rounded once. */
INLINE V vm_scale_far(V x, Bits n) {
    Bits h = n >> 1;
    return x * vm_scale(v_all(1.0), h) * vm_scale(v_all(1.0), n - h);
}

/* Whether x is negative, by its sign bit. */
INLINE Bits vm_minus(V x) { return (Bits)x < i_all(0); }
INLINE Bits vm_is_nan(V x) { return (Bits)(x != x); }

/* ---- simple ones ---- */

INLINE V v_sign(V x) {
    V r = (V)((Bits)(x > v_all(0.0)) & (Bits)v_all(1.0)) - (V)((Bits)(x < v_all(0.0)) & (Bits)v_all(1.0));
    return v_select(vm_is_nan(x), x, r);
}

/* As C's fmin and fmax: a NaN yields to the other; -0 is below +0. */
INLINE V v_fmin(V x, V y) {
    V r = v_select((Bits)(x < y) | vm_is_nan(y), x, y);
    return v_select((Bits)(x == y), (V)((Bits)x | (Bits)y), r);
}
INLINE V v_fmax(V x, V y) {
    V r = v_select((Bits)(x > y) | vm_is_nan(y), x, y);
    return v_select((Bits)(x == y), (V)((Bits)x & (Bits)y), r);
}

/* Exact. */
INLINE V v_floor(V x) {
    V big = v_all(0x1p52), a = v_abs(x), t = v_copysign((a + big) - big, x);
    t = t - v_truth((Bits)(t > x));
    return v_select((Bits)(a < big), v_copysign(t, x), x);
}
INLINE V v_ceil(V x) { return -v_floor(-x); }

/* ---- sine, cosine, tangent ---- */

/* 2/pi, the bits after the binary point, after 64 zero bits. */
static const unsigned long long vm_two_over_pi[20] __attribute__((unused)) = {
    0, 0xa2f9836e4e441529ULL, 0xfc2757d1f534ddc0ULL, 0xdb6295993c439041ULL, 0xfe5163abdebbc561ULL, 0xb7246e3a424dd2e0ULL,
        0x06492eea09d1921cULL, 0xfe1deb1cb129a73eULL, 0xe88235f52ebb4484ULL, 0xe99c7026b45f7e41ULL, 0x3991d639835339f4ULL,
        0x9c845f8bbdf9283bULL, 0x1ff897ffde05980fULL, 0xef2f118b5a0a6d1fULL, 0x6d367ecf27cb09b7ULL, 0x4f463f669e5fea2dULL,
        0x7527bac7ebe5f17bULL, 0x3d0739f78a5292eaULL, 0x6bfb5fb11f8d5d08ULL, 0x56033046fc7b6babULL};

/* High and low half of a b. */
static unsigned long long vm_wide(unsigned long long a, unsigned long long b, unsigned long long *low) {
    unsigned long long m = 0xffffffffULL, al = a & m, ah = a >> 32, bl = b & m, bh = b >> 32;
    unsigned long long ll = al * bl, lh = al * bh, hl = ah * bl, mid = (ll >> 32) + (lh & m) + (hl & m);
    *low = a * b;
    return ah * bh + (lh >> 32) + (hl >> 32) + (mid >> 32);
}

/* For finite x > 2^29: x 2/pi = n + hi + lo modulo 4, |hi| <= 1/2 (Payne & Hanek, SIGNUM 18, 1983): the significand times the
   192 bits of 2/pi that matter, modulo 2^192. */
static __attribute__((noinline, unused)) void vm_payne_hanek(double x, double *hi, double *lo, long long *n) {
    union { double d; unsigned long long u; } bits = {x};
    int at = (int)(bits.u >> 52) - 1013, word = at >> 6, shift = at & 63;
    unsigned long long m = (bits.u & 0xfffffffffffffULL) | 0x10000000000000ULL, w[3], p[3], h1, h2, low;
    for (int i = 0; i < 3; i++) {
        unsigned long long next = shift ? vm_two_over_pi[word + i + 1] >> (64 - shift) : 0;
        w[i] = vm_two_over_pi[word + i] << shift | next;
    }
    h2 = vm_wide(m, w[2], &p[2]);
    h1 = vm_wide(m, w[1], &low);
    p[1] = low + h2;
    p[0] = m * w[0] + h1 + (p[1] < low);
    unsigned long long quarter = p[0] >> 62, f1 = p[0] << 2 | p[1] >> 62, f0 = p[1] << 2 | p[2] >> 62;
    int up = (int)(f1 >> 63);
    if (up) { f0 = ~f0; f1 = ~f1; } /* minus the fraction, up to 2^-128 */
    double a = (double)(long long)(f1 >> 32) * 0x1p-32, b = (double)(long long)(f1 & 0xffffffffULL) * 0x1p-64;
    double c = (double)(long long)(f0 >> 11) * 0x1p-117, s = a + b, e = (b - (s - a)) + c;
    *hi = up ? -s : s;
    *lo = up ? -e : e;
    *n = (long long)quarter + up;
}

/* The lanes with x >= 2^30 or not finite, reduced. */
OUTLINE void vm_reduce_far(V x, V *r, V *lo, Bits *n) {
    V h = x - x, l = h, e; /* NaN where x is not finite */
    Bits q = i_all(0), far = ~(Bits)(x < v_all(0x1p30)), finite = (Bits)(h == h);
    for (int i = 0; i < LANES; i++) {
        double a = 0.0, b = 0.0;
        long long k = 0;
        if (far[i] & finite[i]) { vm_payne_hanek(x[i], &a, &b, &k); h[i] = a; l[i] = b; q[i] = k; }
    }
    V p = vm_product(h, v_all(0.5 * VM_PI_HI), &e);
    e = e + v_fma(h, v_all(0.5 * VM_PI_LO), l * v_all(0.5 * VM_PI_HI));
    *r = v_select(far, p, *r);
    *lo = v_select(far, e, *lo);
    *n = (far & q) | (~far & *n);
}

/* x = n pi/2 + r + lo for x >= 0, |r| <= pi/4 (Cody & Waite, pi/2 in three doubles; the first difference is exact). */
INLINE V vm_reduce(V x, V *lo, Bits *n) {
    V e, t = v_fma(x, v_all(0x1.45f306dc9c883p-1), v_all(VM_TO_INT)), k = t - v_all(VM_TO_INT);
    V a = vm_exact_rest(x, k, v_all(0.5 * VM_PI_HI)), p = vm_product(k, v_all(0.5 * VM_PI_LO), &e), r = a - p;
    V l = v_fma(k, v_all(0x1.f1976b7ed8fbcp-110), ((a - r) - p) - e);
    Bits q = (Bits)t, far = ~(Bits)(x < v_all(0x1p30));
    if (__builtin_expect(i_any(far), 0)) {
        V fr = r, fl = l;
        Bits fq = q;
        vm_reduce_far(x, &fr, &fl, &fq);
        r = fr;
        l = fl;
        q = fq;
    }
    *lo = l;
    *n = q;
    return r;
}

/* sin(r + lo) = r + *s and cos(r + lo) = *ch + *c. */
INLINE void vm_sincos_parts(V r, V lo, V *s, V *ch, V *c) {
    V z = r * r, zz = z * z, hz = v_all(0.5) * z, w = v_all(1.0) - hz;
    V ps = VM_Q6(z, zz, -0x1.5555555555547p-3, 0x1.111111110f562p-7, -0x1.a01a019ba94b3p-13, 0x1.71de35199053ap-19,
        -0x1.ae5e1a169e52dp-26, 0x1.5d7c5472426d4p-33);
    V pc = VM_Q6(z, zz, 0x1.555555555554ap-5, -0x1.6c16c16c14dc4p-10, 0x1.a01a019c515a5p-16, -0x1.27e4f7c2353fap-22,
        0x1.1ee9b9e259569p-29, -0x1.8f941f5296869p-37);
    *s = v_fma(r * z, ps, lo * w);
    *ch = w;
    *c = v_fma(zz, pc, ((v_all(1.0) - w) - hz) - r * lo);
}

/* All ones where n is odd: sine and cosine change places. */
INLINE Bits vm_odd(Bits n) { return i_all(0) - (n & i_all(1)); }
/* The sign bit where n modulo 4 is 2 or 3. */
INLINE Bits vm_half_turn(Bits n) { return (n & i_all(2)) << 62; }
INLINE Bits vm_sign_bit(V x) { return (Bits)x & (Bits)v_all(-0.0); }

INLINE void vm_sincos(V x, V *s, V *c) {
    Bits n;
    V lo, ds, dc, ch, r = vm_reduce(v_abs(x), &lo, &n);
    vm_sincos_parts(r, lo, &ds, &ch, &dc);
    V sine = r + ds, cosine = ch + dc;
    Bits odd = vm_odd(n);
    *s = (V)((Bits)v_select(odd, cosine, sine) ^ vm_half_turn(n) ^ vm_sign_bit(x));
    *c = (V)((Bits)v_select(odd, sine, cosine) ^ vm_half_turn(n + i_all(1)));
}
OUTLINE void v_sincos(V x, V *s, V *c) {
    V sine, cosine;
    vm_sincos(x, &sine, &cosine);
    *s = sine;
    *c = cosine;
}
OUTLINE V v_sin(V x) {
    V s, c;
    vm_sincos(x, &s, &c);
    return s;
}
OUTLINE V v_cos(V x) {
    V s, c;
    vm_sincos(x, &s, &c);
    return c;
}

/* Sine over cosine, both as dd. */
OUTLINE V v_tan(V x) {
    Bits n;
    V lo, ds, dc, c, e, r = vm_reduce(v_abs(x), &lo, &n);
    vm_sincos_parts(r, lo, &ds, &c, &dc);
    V s = vm_sum_ordered(r, ds, &ds);
    c = vm_sum_ordered(c, dc, &dc);
    Bits odd = vm_odd(n);
    V q = vm_quotient(v_select(odd, -c, s), v_select(odd, -dc, ds), v_select(odd, s, c), v_select(odd, ds, dc), &e);
    return (V)((Bits)(q + e) ^ vm_sign_bit(x));
}

/* ---- exponential and hyperbolic functions ---- */

/* x = n ln 2 + r + lo, |r| <= ln 2 / 2. */
INLINE V vm_exp_reduce(V x, V *lo, Bits *n) {
    V t = v_fma(x, v_all(0x1.71547652b82fep+0), v_all(VM_TO_INT)), k = t - v_all(VM_TO_INT);
    *n = (Bits)t;
    V a = v_fma(-k, v_all(VM_LN2_HI), x), r = v_fma(-k, v_all(VM_LN2_LO), a);
    *lo = v_fma(-k, v_all(VM_LN2_LO), a - r);
    return r;
}

/* (e^r - 1 - r)/r^2. */
INLINE V vm_exp_tail(V r) {
    V z = r * r;
    return VM_Q11(r, z, 0x1p-1, 0x1.5555555555556p-3, 0x1.5555555555556p-5, 0x1.11111111109bp-7, 0x1.6c16c16c15dadp-10,
        0x1.a01a01a7c687ep-13, 0x1.a01a01a94161fp-16, 0x1.71de0da50d83ep-19, 0x1.27e4d4b6b3fap-22, 0x1.af38bfc78f524p-26,
        0x1.1f7f5ab735534p-29);
}

/* y 2^n for n from the reduction of x: beyond the normal range too. */
OUTLINE V vm_exp_far(V x, V y, Bits n) {
    V low = v_all(-746.0), high = v_all(710.0);
    Bits k = n - (Bits)v_all(VM_TO_INT), small = (Bits)(x < low), big = (Bits)(x > high);
    V r = vm_scale_far(y, k & ~(small | big));
    r = v_select(small, v_all(0.0), v_select(big, v_all(VM_INF), r));
    return v_select(vm_is_nan(x), x, r);
}

/* e^(x + l); l is small, 0 unless `paired`. */
INLINE V vm_exp(V x, V l, const int paired) {
    Bits n;
    V lo, e, r = vm_exp_reduce(x, &lo, &n), one = v_all(1.0);
    if (paired) {
        r = vm_sum(r, lo + l, &lo);
        lo = v_fma(r, lo, lo);
    }
    V s = vm_sum_ordered(one, r, &e), y = s + (e + v_fma(r * r, vm_exp_tail(r), lo)), result = vm_scale(y, n);
    Bits far = ~(Bits)(v_abs(x) < v_all(708.0));
    if (__builtin_expect(i_any(far), 0)) result = v_select(far, vm_exp_far(x, y, n), result);
    return result;
}
OUTLINE V v_exp(V x) { return vm_exp(x, v_all(0.0), 0); }

/* (2^n - 1) + 2^n r + 2^n (e^r - 1 - r), the first two summed exactly. */
OUTLINE V v_expm1(V x) {
    Bits n, big = (Bits)(x > v_all(40.0)), low = (Bits)(x < v_all(-40.0));
    V xc = v_select(big, v_all(40.0), v_select(low, v_all(-40.0), x));
    V lo, e, el, r = vm_exp_reduce(xc, &lo, &n), one = v_all(1.0), p = vm_scale(one, n);
    V a = vm_sum(p, -one, &e), s = vm_sum(a, p * r, &el), tail = v_fma(r * r, vm_exp_tail(r), lo);
    V result = s + (el + v_fma(p, tail, e));
    if (__builtin_expect(i_any(big), 0)) result = v_select(big, v_exp(x), result);
    return v_select(vm_is_nan(x) | (Bits)(x == v_all(0.0)), x, result);
}

/* sinh and cosh of x = n ln 2 + r by the addition theorem, as dd; the powers of two are exact. The results times 2^*left. */
INLINE void vm_sinh_cosh(V x, V *sh, V *sl, V *ch, V *cl, Bits *left) {
    Bits n;
    V lo, e, el, r = vm_exp_reduce(x, &lo, &n), z = r * r;
    V ps = VM_P5(z, 0x1.5555555555559p-3, 0x1.111111110f627p-7, 0x1.a01a01b022786p-13, 0x1.71ddf7a8255b3p-19,
        0x1.af6004e21acecp-26);
    V pc = VM_P5(z, 0x1.5555555555558p-5, 0x1.6c16c16c14ffap-10, 0x1.a01a01ad80e14p-16, 0x1.27e4cc0a481cp-22,
        0x1.1f8bea9348ba6p-29);
    V ds = v_fma(r * z, ps, lo), dc = v_fma(z * z, pc, v_fma(r, lo, v_all(0.5) * z));
    n = n - (Bits)v_all(VM_TO_INT);
    Bits over = (Bits)(n > i_all(800)) & (n - i_all(800));
    *left = over;
    n = n - over;
    V p = vm_scale(v_all(0.5), n), q = vm_scale(v_all(0.5), i_all(0) - n);
    V c = p + q, s = p - q, ce = q - (c - p), se = (p - s) - q;
    V pr = vm_product(c, r, &e), h = vm_sum(s, pr, &el);
    *sh = vm_sum_ordered(h, el + (e + v_fma(s, dc, v_fma(c, ds, v_fma(ce, r, se)))), sl);
    pr = vm_product(s, r, &e);
    h = vm_sum_ordered(c, pr, &el);
    *ch = vm_sum_ordered(h, el + (e + v_fma(c, dc, v_fma(s, ds, v_fma(se, r, ce)))), cl);
}

/* |x|, but at most a bound from where on the functions below do not need x itself. */
INLINE V vm_bounded(V x, double bound) {
    V a = v_abs(x);
    return v_select((Bits)(a < v_all(bound)), a, v_all(bound));
}

OUTLINE V v_sinh(V x) {
    V sh, sl, ch, cl;
    Bits left;
    vm_sinh_cosh(vm_bounded(x, 720.0), &sh, &sl, &ch, &cl, &left);
    V r = v_copysign((sh + sl) * vm_scale(v_all(1.0), left), x);
    return v_select(vm_is_nan(x), x, r);
}
OUTLINE V v_cosh(V x) {
    V sh, sl, ch, cl;
    Bits left;
    vm_sinh_cosh(vm_bounded(x, 720.0), &sh, &sl, &ch, &cl, &left);
    return v_select(vm_is_nan(x), x, (ch + cl) * vm_scale(v_all(1.0), left));
}
OUTLINE V v_tanh(V x) {
    V sh, sl, ch, cl, e;
    Bits left;
    vm_sinh_cosh(vm_bounded(x, 22.0), &sh, &sl, &ch, &cl, &left);
    V q = vm_quotient(sh, sl, ch, cl, &e);
    V r = v_copysign(v_select((Bits)(v_abs(x) < v_all(0x1p-30)), v_abs(x), q + e), x);
    return v_select(vm_is_nan(x), x, r);
}

/* ---- logarithms and inverse hyperbolic functions ---- */

/* Normal x > 0 as m 2^k, m from sqrt(1/2) to sqrt(2). */
INLINE V vm_split(V x, V *k) {
    VmU e = (VmU)((Bits)x - (Bits)v_all(0x1.6a09e667f3bcdp-1) + i_all(1024LL << 52)) >> 52;
    *k = (V)((Bits)e + (Bits)v_all(0x1p52)) - v_all(0x1p52 + 1024.0);
    return (V)((Bits)x - (((Bits)e - i_all(1024)) << 52));
}

/* 2 (atanh(s) - s)/s^3 of z = s^2. */
INLINE V vm_log_poly(V z) {
    V zz = z * z;
    return VM_Q8(z, zz, 0x1.5555555555555p-1, 0x1.9999999999d19p-2, 0x1.249249243887ap-2, 0x1.c71c724ccc481p-3,
        0x1.745ce14acbd06p-3, 0x1.3b203bd3c8ca9p-3, 0x1.0f6516a69851cp-3, 0x1.0f22881a6a9c7p-3);
}

/* k ln 2 + log(1 + f) + extra, extra small (-0 adds nothing), from s = f/(2 + f), 1 + f = (1 + s)/(1 - s). */
INLINE V vm_log(V f, V k, V extra) {
    V s = f / (v_all(2.0) + f), z = s * s, he, e, half = vm_product(v_all(0.5) * f, f, &he);
    V h = f - half, rest = (((f - h) - half) - he) + extra;
    rest = v_fma(s, v_fma(z, vm_log_poly(z), half), rest);
    V sum = vm_sum_ordered(k * v_all(VM_LN2_HI), h, &e);
    return sum + (e + v_fma(k, v_all(VM_LN2_LO), rest));
}

/* log of a positive dd, times 2^twice. */
INLINE V vm_log_pair(V x, V lo, V twice) {
    V k, m = vm_split(x, &k);
    return vm_log(m - v_all(1.0), k + twice, lo / x);
}

/* Logarithm where x is not a normal positive number. */
INLINE V vm_log_edges(V x, V r) {
    r = v_select((Bits)(x == v_all(0.0)), v_all(-VM_INF), v_select((Bits)(x < v_all(0.0)), v_all(VM_NAN), r));
    return v_select(vm_is_nan(x) | (Bits)(x == v_all(VM_INF)), x, r);
}

OUTLINE V vm_log_far(V x, V r) {
    Bits small = (Bits)(x < v_all(VM_TINY)) & (Bits)(x > v_all(0.0));
    V k, m = vm_split(x * v_all(0x1p54), &k);
    r = v_select(small, vm_log(m - v_all(1.0), k - v_all(54.0), v_all(-0.0)), r);
    return vm_log_edges(x, r);
}
OUTLINE V v_log(V x) {
    V k, m = vm_split(x, &k), r = vm_log(m - v_all(1.0), k, v_all(-0.0));
    Bits usual = (Bits)(x >= v_all(VM_TINY)) & (Bits)(x < v_all(VM_INF));
    if (__builtin_expect(i_any(~usual), 0)) r = vm_log_far(x, r);
    return r;
}

/* 1 + x with its rounding error; x itself is the argument while 1 + x is near 1. */
OUTLINE V v_log1p(V x) {
    V e, k, u = vm_sum(v_all(1.0), x, &e), m = vm_split(u, &k);
    Bits near = (Bits)(k == v_all(0.0));
    V f = v_select(near, x, m - v_all(1.0)), extra = v_select(near | (Bits)(x > v_all(0x1p60)), v_all(0.0), e / u);
    V r = v_select((Bits)(x == v_all(0.0)), x, vm_log(f, k, extra));
    Bits usual = (Bits)(x > v_all(-1.0)) & (Bits)(x < v_all(VM_INF));
    if (__builtin_expect(i_any(~usual), 0)) r = v_select(usual, r, vm_log_edges(v_all(1.0) + x, r));
    return r;
}

/* log(x + sqrt(1 + x^2)), with x + x^2/(1 + sqrt(1 + x^2)) as the argument of log(1 + f) for small x. */
OUTLINE V v_asinh(V x) {
    V a = v_abs(x), one = v_all(1.0), e, hl, sl, wl, fl, k;
    V p = vm_product(a, a, &e), h = vm_sum(p, one, &hl), s = vm_root(h, hl + e, &sl), w = vm_sum(a, s, &wl);
    V f = vm_sum_ordered(a, p / (one + s), &fl);
    Bits small = (Bits)(a < v_all(0.25)), big = (Bits)(a > v_all(0x1p28));
    w = v_select(big, a, w);
    wl = v_select(big, v_all(0.0), wl + sl);
    V m = vm_split(w, &k), extra = v_select(small, fl, wl) / v_select(small, one + f, w);
    k = v_select(small, v_all(0.0), k) + v_truth(big);
    V r = vm_log(v_select(small, f, m - one), k, extra);
    r = v_select((Bits)(a < v_all(0x1p-28)) | ~(Bits)(a < v_all(VM_INF)), a, r);
    return v_copysign(r, x);
}

/* log(x + sqrt(x^2 - 1)) with t = x - 1: x^2 - 1 = t (t + 2), and t + sqrt(t (t + 2)) is the argument of log(1 + f). */
OUTLINE V v_acosh(V x) {
    V one = v_all(1.0), t = x - one, gl, bl, sl, wl, fl, k, g = vm_sum(t, v_all(2.0), &gl);
    V b = vm_product(t, g, &bl), s = vm_root(b, v_fma(t, gl, bl), &sl), w = vm_sum(x, s, &wl), f = vm_sum(s, t, &fl);
    Bits small = (Bits)(x < v_all(1.0625)), big = (Bits)(x > v_all(0x1p28));
    w = v_select(big, x, w);
    wl = v_select(big, v_all(0.0), wl + sl);
    V m = vm_split(w, &k), extra = v_select(small, fl + sl, wl) / v_select(small, one + f, w);
    k = v_select(small, v_all(0.0), k) + v_truth(big);
    V r = vm_log(v_select(small, f, m - one), k, extra);
    r = v_select((Bits)(x == one), v_all(0.0), v_select((Bits)(x < one), v_all(VM_NAN), r));
    return v_select(vm_is_nan(x) | (Bits)(x == v_all(VM_INF)), x, r);
}

/* Half the log of (1 + x)/(1 - x), or the series in x that the logarithm itself uses. */
OUTLINE V v_atanh(V x) {
    V a = v_abs(x), one = v_all(1.0), z = a * a, nl, dl, ql, n = vm_sum(one, a, &nl), d = vm_sum(one, -a, &dl);
    V q = vm_quotient(n, nl, d, dl, &ql), r = v_all(0.5) * vm_log_pair(q, ql, v_all(0.0));
    r = v_select((Bits)(a < v_all(0.1715)), v_fma(a * z, v_all(0.5) * vm_log_poly(z), a), r);
    r = v_select((Bits)(a == one), v_all(VM_INF), v_select((Bits)(a > one), v_all(VM_NAN), r));
    return v_select(vm_is_nan(x), x, v_copysign(r, x));
}

/* ---- power ---- */

/* log of normal x > 0, times 2^twice, as a dd with about 70 bits: the series of vm_log with its first terms in dd. */
INLINE V vm_log_long(V x, V twice, V *lo) {
    V k, m = vm_split(x, &k), f = m - v_all(1.0), dl, sl, zl, cl, e, tl, d = vm_sum_ordered(v_all(2.0), f, &dl);
    V s = vm_quotient(f, v_all(0.0), d, dl, &sl), z = vm_product(s, s, &zl), zz = z * z;
    zl = v_fma(s + s, sl, zl);
    V a = VM_Q7(z, zz, 0x1.24924924927ep-2, 0x1.c71c71c6563f6p-3, 0x1.745d17d9c3f07p-3, 0x1.3b13777443e7ep-3,
        0x1.111deed567269p-3, 0x1.de98e95203a65p-4, 0x1.e811ca9b06173p-4);
    V p = vm_product(z, a, &e);
    V t = vm_sum_ordered(v_all(0x1.999999999999ap-2), p, &tl);
    tl = tl + (v_fma(zl, a, e) + v_all(-0x1.999999999999ap-56));
    p = vm_product(z, t, &e);
    e = e + v_fma(z, tl, zl * t);
    t = vm_sum_ordered(v_all(0x1.5555555555555p-1), p, &tl);
    tl = tl + (e + v_all(0x1.5555555555555p-55));
    V c = vm_product(s, z, &cl); /* s^3 */
    cl = cl + v_fma(s, zl, sl * z);
    p = vm_product(c, t, &e);
    e = e + v_fma(c, tl, cl * t);
    k = k + twice;
    V al, bl, sum = vm_sum_ordered(k * v_all(VM_LN2_HI), s + s, &al), h = vm_sum_ordered(sum, p, &bl);
    V rest = (al + bl) + v_fma(k, v_all(VM_LN2_LO), e + (sl + sl));
    return vm_sum_ordered(h, rest, lo);
}

/* What Annex F.9.4.4 asks where x is not positive and finite or y is huge; r is |x|^y. */
OUTLINE V vm_pow_edges(V x, V y, V r) {
    V a = v_abs(x), b = v_abs(y), one = v_all(1.0), zero = v_all(0.0), big = v_all(0x1p52), inf = v_all(VM_INF);
    V whole = (b + big) - big;
    Bits integer = (Bits)(b >= big) | (Bits)(whole == b), below = (Bits)(b < big);
    Bits low = (below & (Bits)(b + big)) | (~below & (Bits)b);
    Bits odd = vm_odd(low & integer & (Bits)(b < v_all(0x1p53))), down = (Bits)(y < zero), sign = vm_minus(x) & odd;
    V edge = v_select(down, inf, zero), far = v_select(down, zero, inf);
    r = v_select((Bits)(a == zero), edge, v_select((Bits)(a == inf), far, r));
    r = v_select(sign, -r, r);
    r = v_select((Bits)(x < zero) & (Bits)(a < inf) & ~integer, v_all(VM_NAN), r);
    V grown = v_select((Bits)((Bits)(a > one) == (Bits)(y > zero)), inf, zero);
    r = v_select((Bits)(b == inf), v_select((Bits)(a == one), one, grown), r);
    r = v_select(vm_is_nan(x) | vm_is_nan(y), x + y, r);
    return v_select((Bits)(x == one) | (Bits)(y == zero), one, r);
}

/* e^(y log|x|), the logarithm and the product as dd. */
OUTLINE V v_pow(V x, V y) {
    V a = x, b = y, twice = v_all(0.0), lo, e, bound = v_all(0x1p64);
    Bits usual = (Bits)(x >= v_all(VM_TINY)) & (Bits)(x < v_all(VM_INF)) & (Bits)(v_abs(y) < bound);
    int edges = i_any(~usual);
    if (__builtin_expect(edges, 0)) {
        a = v_abs(x);
        Bits small = (Bits)(a < v_all(VM_TINY));
        a = v_select(small, a * v_all(0x1p54), a);
        twice = v_select(small, v_all(-54.0), twice);
        b = v_select((Bits)(v_abs(y) < bound), y, v_copysign(bound, y));
    }
    V h = vm_log_long(a, twice, &lo), p = vm_product(b, h, &e), r = vm_exp(p, v_fma(b, lo, e), 1);
    if (__builtin_expect(edges, 0)) r = v_select(usual, r, vm_pow_edges(x, y, r));
    return r;
}

/* ---- inverse trigonometric functions, hypot ---- */

/* (atan(t) - t)/t^3 of z = t^2, |t| <= 1/2. */
INLINE V vm_atan_poly(V z) {
    V zz = z * z;
    return VM_Q13(z, zz, -0x1.5555555555552p-2, 0x1.99999999990e5p-3, -0x1.2492492453eb8p-3, 0x1.c71c71ab2b9b3p-4,
        -0x1.745d13968070fp-4, 0x1.3b1361380f769p-4, -0x1.110c77a5cfb7p-4, 0x1.e183437a91385p-5, -0x1.ac75102176de7p-5,
        0x1.78051c3235ac7p-5, -0x1.3032de9e49823p-5, 0x1.83e59a414dc3ap-6, -0x1.1287da145c988p-7);
}

/* n/d, 0 <= n <= d, in a range where the reduction neither overflows nor loses digits. */
OUTLINE void vm_atan2_far(V *n, V *d) {
    V inf = v_all(VM_INF), zero = v_all(0.0), one = v_all(1.0);
    V up = v_select((Bits)(*d < v_all(0x1p-400)), v_all(0x1p600), v_select((Bits)(*d > v_all(0x1p400)), v_all(0x1p-600), one));
    V a = *n * up, b = *d * up;
    Bits both = (Bits)(*n == inf), one_inf = (Bits)(*d == inf) & ~both, none = (Bits)(*d == zero);
    a = v_select(one_inf | none | (Bits)(a < v_all(0x1p-800)), zero, a);
    *n = v_select(both, one, a);
    *d = v_select(both | one_inf | none, one, b);
}

/* The angle as j pi/4 +- atan(t): t = n/d up to 1/2, (n - d)/(n + d) beyond, as a dd by one division. */
OUTLINE V v_atan2(V y, V x) {
    V ax = v_abs(x), ay = v_abs(y), zero = v_all(0.0), e;
    Bits steep = (Bits)(ay > ax), left = vm_minus(x);
    V n = v_select(steep, ax, ay), d = v_select(steep, ay, ax);
    Bits usual = (Bits)(d > v_all(0x1p-400)) & (Bits)(d < v_all(0x1p400)) & ((Bits)(n > v_all(0x1p-800)) | (Bits)(n == zero));
    int edges = i_any(~usual);
    if (__builtin_expect(edges, 0)) {
        V fn = n, fd = d;
        vm_atan2_far(&fn, &fd);
        n = fn;
        d = fd;
    }
    Bits wide = (Bits)(n + n > d);
    V dl, sum = vm_sum_ordered(d, n, &dl), den = v_select(wide, sum, d), num = v_select(wide, n - d, n);
    V t = vm_quotient(num, zero, den, v_select(wide, dl, zero), &e), z = t * t;
    V rest = v_fma(t * z, vm_atan_poly(z), e);
    /* angle = wide pi/4 + atan; steep: pi/2 - angle; left: pi - angle */
    V j = v_truth(wide);
    j = v_select(steep, v_all(2.0) - j, j);
    j = v_select(left, v_all(4.0) - j, j);
    Bits sign = (steep ^ left) & (Bits)v_all(-0.0);
    t = (V)((Bits)t ^ sign);
    rest = (V)((Bits)rest ^ sign);
    V base = vm_sum_ordered(j * v_all(0.25 * VM_PI_HI), t, &e);
    V r = base + (e + v_fma(j, v_all(0.25 * VM_PI_LO), rest));
    if (__builtin_expect(edges, 0)) {
        Bits thin = ~usual & (Bits)(j == zero) & (Bits)(ax > zero) & (Bits)(ax < v_all(VM_INF));
        r = v_select(thin & (Bits)(ay < ax * v_all(0x1p-30)), ay / ax, r);
        r = v_select(vm_is_nan(x) | vm_is_nan(y), x + y, r);
    }
    return v_copysign(r, y);
}
OUTLINE V v_atan(V x) { return v_atan2(x, v_all(1.0)); }

/* (asin(x) - x)/x^3 of z = x^2, |x| <= 1/2. */
INLINE V vm_asin_poly(V z) {
    V zz = z * z;
    return VM_Q13(z, zz, 0x1.5555555555578p-3, 0x1.333333332df2p-4, 0x1.6db6db722ad4bp-5, 0x1.f1c71a8bd2c27p-6,
        0x1.6e8bdfe0df7b1p-6, 0x1.1c49de6357edep-6, 0x1.ca213b924fd7bp-7, 0x1.7577d15f2186ap-7, 0x1.61894b23e437ep-7,
        0x1.e17030da58822p-9, 0x1.64fbd5ca9aebcp-6, -0x1.59ee056114cecp-6, 0x1.0be1cf39e22f1p-5);
}

/* asin of |x|, or of sqrt((1 - |x|)/2) beyond 1/2, as a dd. */
INLINE V vm_asin_parts(V a, Bits far, V *rest) {
    V h = v_all(0.5) * (v_all(1.0) - a), sl, s = vm_root(h, v_all(0.0), &sl);
    sl = v_select((Bits)(h == v_all(0.0)), h, sl);
    V z = v_select(far, h, a * a), t = v_select(far, s, a);
    *rest = v_fma(t * z, vm_asin_poly(z), v_select(far, sl, v_all(0.0)));
    return t;
}

OUTLINE V v_asin(V x) {
    V a = v_abs(x), one = v_all(1.0), rest, e;
    Bits far = (Bits)(a > v_all(0.5));
    V t = vm_asin_parts(a, far, &rest), base = vm_sum_ordered(v_all(0.5 * VM_PI_HI), v_all(-2.0) * t, &e);
    V r = base + (e + v_fma(v_all(-2.0), rest, v_all(0.5 * VM_PI_LO)));
    r = v_select((Bits)(a > one), v_all(VM_NAN), v_select(far, r, t + rest));
    return v_select(vm_is_nan(x), x, v_copysign(r, x));
}

OUTLINE V v_acos(V x) {
    V a = v_abs(x), one = v_all(1.0), zero = v_all(0.0), two = v_all(2.0), rest, e;
    Bits far = (Bits)(a > v_all(0.5)), minus = (Bits)(x < zero);
    V t = vm_asin_parts(a, far, &rest);
    V j = v_select(far, v_select(minus, one, zero), v_all(0.5)); /* j pi -+ asin */
    V f = v_select(far, two, one);
    f = v_select((far & minus) | (~far & ~minus), -f, f);
    V base = vm_sum_ordered(j * v_all(VM_PI_HI), f * t, &e), r = base + (e + v_fma(f, rest, j * v_all(VM_PI_LO)));
    r = v_select((Bits)(a > one), v_all(VM_NAN), r);
    return v_select(vm_is_nan(x), x, r);
}

/* The root of the squares, summed as dd. */
INLINE V vm_hypot(V x, V y) {
    V xl, yl, e, sl, p = vm_product(x, x, &xl), q = vm_product(y, y, &yl), h = vm_sum(p, q, &e);
    V s = vm_root(h, e + (xl + yl), &sl);
    return s + sl;
}
OUTLINE V vm_hypot_far(V x, V y) {
    V a = v_fmax(v_abs(x), v_abs(y)), one = v_all(1.0), inf = v_all(VM_INF), zero = v_all(0.0);
    Bits big = (Bits)(a > v_all(0x1p400)), small = (Bits)(a < v_all(0x1p-400));
    V up = v_select(big, v_all(0x1p-700), v_select(small, v_all(0x1p700), one));
    V down = v_select(big, v_all(0x1p700), v_select(small, v_all(0x1p-700), one));
    V u = x * up, v = y * up, tiny = v_all(0x1p-480);
    u = v_select((Bits)(v_abs(u) < tiny), zero, u);
    v = v_select((Bits)(v_abs(v) < tiny), zero, v);
    V r = v_select((Bits)(a == zero), zero, vm_hypot(u, v) * down);
    r = v_select(vm_is_nan(x) | vm_is_nan(y), x + y, r);
    return v_select((Bits)(v_abs(x) == inf) | (Bits)(v_abs(y) == inf), inf, r);
}
OUTLINE V v_hypot(V x, V y) {
    V a = v_abs(x), b = v_abs(y), low = v_all(0x1p-400), high = v_all(0x1p400), zero = v_all(0.0);
    Bits usual = ((Bits)(a > low) | (Bits)(a == zero)) & ((Bits)(b > low) | (Bits)(b == zero));
    usual = usual & (Bits)(a < high) & (Bits)(b < high) & (Bits)(a + b > zero);
    V r = vm_hypot(x, y);
    if (__builtin_expect(i_any(~usual), 0)) r = v_select(usual, r, vm_hypot_far(x, y));
    return r;
}

/* ---- remainders, exact ---- */

/* Significand and exponent of a > 0 finite: a = m 2^e. */
static inline __attribute__((unused)) unsigned long long vm_integer(double a, int *e) {
    union { double d; unsigned long long u; } bits = {a};
    int raw = (int)(bits.u >> 52 & 0x7ff);
    *e = (raw ? raw : 1) - 1075;
    return (bits.u & 0xfffffffffffffULL) | (raw ? 0x10000000000000ULL : 0);
}

/* x modulo y for finite x >= 0, y > 0: long division of integers, eleven bits at a time. */
static __attribute__((noinline, unused)) double vm_long_division(double x, double y) {
    int ex, ey;
    unsigned long long m = vm_integer(x, &ex), d = vm_integer(y, &ey), r;
    if (x < y) return x;
    r = m % d;
    for (int left = ex - ey; left > 0 && r; left -= 11) r = (r << (left < 11 ? left : 11)) % d;
    union { unsigned long long u; double d; } up = {(unsigned long long)(ey + 1023 + (ey < -1022 ? 200 : 0)) << 52};
    return (double)(long long)r * up.d * (ey < -1022 ? 0x1p-200 : 1.0);
}

/* |x| modulo y > 0: by a quotient below 2^53, which is right or one too large, or by long division. NaN without a result. */
OUTLINE V vm_modulo(V x, V y) {
    V big = v_all(0x1p52), q = x / y, n = (q + big) - big;
    n = v_select((Bits)(q < big), n - v_truth((Bits)(n > q)), q);
    V r = vm_exact_rest(x, n, y);
    r = r + (V)((Bits)(r < v_all(0.0)) & (Bits)y);
    Bits usual = (Bits)(q < v_all(0x1p53)) & (Bits)(y > v_all(0x1p-800)) & (Bits)(y < v_all(0x1p900)) & (Bits)(x < v_all(0x1p900));
    Bits ok = (Bits)(x < v_all(VM_INF)) & (Bits)(y > v_all(0.0)) & (Bits)(y == y);
    if (__builtin_expect(i_any(~(usual & ok)), 0)) {
        for (int i = 0; i < LANES; i++)
            if (!usual[i] && ok[i]) r[i] = y[i] < VM_INF ? vm_long_division(x[i], y[i]) : x[i];
        r = v_select(ok, r, v_all(VM_NAN));
    }
    return r;
}

INLINE V vm_nan_sum(V x, V y, V r) { return v_select(vm_is_nan(x) | vm_is_nan(y), x + y, r); }

OUTLINE V v_fmod(V x, V y) { return vm_nan_sum(x, y, v_copysign(vm_modulo(v_abs(x), v_abs(y)), x)); }

/* Nearest multiple, ties to the even one: modulo 2 y, then one or two subtractions (b - r is exact where it decides). */
OUTLINE V v_remainder(V x, V y) {
    V a = v_abs(x), b = v_abs(y);
    Bits huge = (Bits)(b >= v_all(0x1p1023)) & (Bits)(a < v_all(VM_INF));
    V r = v_select(huge, a, vm_modulo(a, b + b)), once = r - b;
    r = v_select((Bits)(r > b - r), v_select((Bits)(once >= b - once), once - b, once), r);
    return vm_nan_sum(x, y, (V)((Bits)r ^ vm_sign_bit(x)));
}

/* ---- error function ---- */

/* erf(x)/x - 1, |x| <= 1: a series in z = x^2, its first two terms in dd. */
INLINE V vm_erf_poly(V x) {
    V zl, pl, ul, z = vm_product(x, x, &zl), zz = z * z, c = v_all(-0x1.812746b0379e6p-2), p = vm_product(z, c, &pl);
    V u = vm_sum(v_all(0x1.06eba8214db69p-3), p, &ul);
    V rest = VM_Q11(z, zz, 0x1.ce2f21a042b19p-4, -0x1.b82ce312842f6p-6, 0x1.565bcd0d98d86p-8, -0x1.c02db3d3c754fp-11,
        0x1.f9a320f4bbe43p-14, -0x1.f4d1d0e71b34fp-17, 0x1.b9de2ae47281p-20, -0x1.5f16348e2f4aep-23, 0x1.f754aed01b31ap-27,
        -0x1.376a9611fa64dp-30, 0x1.02ab156acb385p-34);
    return u + v_fma(zz, rest, v_fma(c, zl, (pl + ul) + v_all(-0x1.ca38add6025p-57)));
}

/* e^(x^2) erfc(x), 1 <= x <= 6, in u = (x - 3)/(x + 3). */
INLINE V vm_erfcx(V x) {
    V u = (x - v_all(3.0)) / (x + v_all(3.0)), z = u * u;
    return VM_Q15(u, z, 0x1.6e9827d229d2ep-3, -0x1.4e102b9cf84c7p-2, 0x1.f6ff204105b6fp-3, -0x1.336ffbef0d8cap-3,
        0x1.258b13afe71b7p-4, -0x1.8fa58eb07d538p-6, 0x1.17c8397e825ffp-8, 0x1.73101799c7b15p-11, -0x1.3908a2ef1ac3ap-11,
        0x1.7b9e0a0b63c6ep-15, 0x1.0cc31b2344e85p-14, -0x1.ae4752ad69adep-17, -0x1.0dd8a67b3e1d3p-17, 0x1.00ceb4f7e6863p-19,
        0x1.445084b072a4fp-20);
}

/* e^(-x^2), the square as a dd. */
INLINE V vm_gauss(V x) {
    V e, p = vm_product(x, x, &e);
    return vm_exp(-p, -e, 1);
}

OUTLINE V v_erf(V x) {
    V a = v_abs(x), one = v_all(1.0), c = v_select((Bits)(a < v_all(6.0)), a, v_all(6.0));
    Bits small = (Bits)(a < v_all(1.0));
    V r = v_select(small, v_fma(a, vm_erf_poly(c), a), v_fma(-vm_gauss(c), vm_erfcx(c), one));
    return v_select(vm_is_nan(x), x, v_copysign(r, x));
}

/* A minimax start of 19 bits in w = -log(1 - y^2) (after Giles, GPU Computing Gems 2, 2011), then Halley's step on erf, or on
   erfc against the exact 1 - y beyond erf(1). */
OUTLINE V v_erfinv(V y) {
    V a = v_abs(y), one = v_all(1.0), c = v_select((Bits)(a < one), a, v_all(0.5)), below = one - c;
    V w = -v_log(below * (one + c)), s = v_sqrt(w);
    V low = VM_P9(w, 0x1.c5bf886f47a54p-1, 0x1.db2a63498579cp-3, 0x1.7a4998ef9973dp-7, -0x1.3082ae655a35fp-9,
        -0x1.29b7962ed62cep-13, 0x1.cf1c795e5d9d2p-15, -0x1.4658d1d873869p-21, -0x1.b9e857d9f980ep-21, 0x1.16f5d1d5bee71p-24);
    V high = VM_P9(s, 0x1.2240be37937dp-5, -0x1.3271623457a42p-3, -0x1.7cd26e821fd5ep-6, 0x1.ec29cb7417888p-5,
        -0x1.c53f42aaef603p-6, 0x1.abd4a8a28aa29p-8, -0x1.cb681c665fc7cp-11, 0x1.0b5c110878fbp-14, -0x1.06edfd46f12f6p-19);
    V x = v_select((Bits)(w < v_all(4.0)), c * low, s + high);
    V g = vm_gauss(x), near = v_fma(x, vm_erf_poly(x), x - c), far = v_fma(-g, vm_erfcx(x), below);
    V t = v_all(0x1.c5bf891b4ef6bp-1) * v_select((Bits)(x < v_all(1.0)), near, far) / g;
    x = x - t / v_fma(x, t, one);
    x = v_select((Bits)(a == one), v_all(VM_INF), v_select((Bits)(a > one), v_all(VM_NAN), x));
    return v_select(vm_is_nan(y), y, v_copysign(x, y));
}

#endif
