/* Values in lanes: the type V holds LANES doubles, the type Bits as many 64-bit integers (masks are all ones or all zeros).

   LANES is 1, 2, 4 or 8, set before this file is included; it is chosen by what the processor has otherwise. One source serves all
   widths, and every lane computes what LANES = 1 computes, to the bit: only operations that IEEE 754 rounds correctly are used, in
   an order that this source fixes. Contractions are written out (`v_fma`), never left to the compiler: build with
   -ffp-contract=off. Where the processor has no fused multiply-add, `v_fma` rounds twice on all widths. */
#ifndef ACAUSAL_LANES_H
#define ACAUSAL_LANES_H
#include "names.h"

#ifndef LANES
#if defined(__AVX512F__)
#define LANES 8
#elif defined(__AVX__)
#define LANES 4
#else
#define LANES 2
#endif
#endif

typedef double V __attribute__((vector_size(8 * LANES)));
typedef long long Bits __attribute__((vector_size(8 * LANES)));
typedef Bits Mask;

#ifndef __has_builtin
#define __has_builtin(x) 0
#endif
#define INLINE static inline __attribute__((always_inline, unused))
#define OUTLINE static __attribute__((noinline, unused))
#define HIDDEN __attribute__((visibility("hidden")))

#if LANES == 1
#define EACH(x) {x}
#elif LANES == 2
#define EACH(x) {x, x}
#elif LANES == 4
#define EACH(x) {x, x, x, x}
#else
#define EACH(x) {x, x, x, x, x, x, x, x}
#endif

/* All lanes x. */
INLINE V v_all(double x) { return (V)EACH(x); }
INLINE Bits i_all(long long x) { return (Bits)EACH(x); }

/* Lane by lane: m ? a : b. */
INLINE V v_select(Bits m, V a, V b) { return (V)((m & (Bits)a) | (~m & (Bits)b)); }

/* Whether any lane of a mask is set. */
#if LANES == 8 && defined(__AVX512DQ__) && !defined(__clang__)
INLINE int i_any(Bits m) { return __builtin_ia32_cvtq2mask512(m) != 0; }
#elif LANES == 4 && defined(__AVX__)
INLINE int i_any(Bits m) { return __builtin_ia32_movmskpd256((V)m) != 0; }
#else
INLINE int i_any(Bits m) {
    long long r = 0;
    for (int i = 0; i < LANES; i++) r |= m[i];
    return r != 0;
}
#endif

/* Lane by lane the larger one; not a number where a is not. */
INLINE V v_larger(V a, V b) { return v_select(b > a, b, a); }

/* Lanes in another order. */
#ifdef __clang__
#define SHUFFLED(x, ...) __builtin_shufflevector(x, x, __VA_ARGS__)
#else
#define SHUFFLED(x, ...) __builtin_shuffle(x, (Bits){__VA_ARGS__})
#endif

/* x = F(x, x in another order), until the first lane has come together with all others: neighbours, pairs, halves. */
#if LANES == 8
#define ALL_LANES(F, x) x = F(x, SHUFFLED(x, 1, 0, 3, 2, 5, 4, 7, 6)), x = F(x, SHUFFLED(x, 2, 3, 0, 1, 6, 7, 4, 5)), x = F(x, SHUFFLED(x, 4, 5, 6, 7, 0, 1, 2, 3))
#elif LANES == 4
#define ALL_LANES(F, x) x = F(x, SHUFFLED(x, 1, 0, 3, 2)), x = F(x, SHUFFLED(x, 2, 3, 0, 1))
#elif LANES == 2
#define ALL_LANES(F, x) x = F(x, SHUFFLED(x, 1, 0))
#else
#define ALL_LANES(F, x) (void)0
#endif

INLINE V v_plus(V a, V b) { return a + b; }

/* The sum of all lanes, of neighbours first. */
INLINE double v_sum(V x) {
    ALL_LANES(v_plus, x);
    return x[0];
}

/* The largest lane; not a number where one is. */
INLINE V v_greater(V a, V b) { return v_select((Bits)(a >= b) | (Bits)(a != a), a, b); }
INLINE double v_largest(V x) {
    ALL_LANES(v_greater, x);
    return x[0];
}

INLINE V v_abs(V x) { return (V)((Bits)x & i_all(0x7fffffffffffffffLL)); }
INLINE V v_copysign(V x, V sign) {
    Bits bit = i_all((long long)0x8000000000000000ULL);
    return (V)(((Bits)x & ~bit) | ((Bits)sign & bit));
}
/* 1.0 where a mask is set, 0.0 elsewhere. */
INLINE V v_truth(Bits m) { return (V)(m & (Bits)v_all(1.0)); }

/* a b + c, rounded once where the processor can. */
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA) || defined(__aarch64__)
#define HAVE_FMA 1
#if LANES == 1
INLINE V v_fma(V a, V b, V c) { V r = {__builtin_fma(a[0], b[0], c[0])}; return r; }
#elif __has_builtin(__builtin_elementwise_fma)
INLINE V v_fma(V a, V b, V c) { return __builtin_elementwise_fma(a, b, c); }
#elif defined(__x86_64__) && LANES == 8 && defined(__AVX512F__) && !defined(__clang__)
INLINE V v_fma(V a, V b, V c) { return __builtin_ia32_vfmaddpd512_mask(a, b, c, (unsigned char)-1, 4); }
#elif defined(__x86_64__) && LANES == 4 && !defined(__clang__)
INLINE V v_fma(V a, V b, V c) { return __builtin_ia32_vfmaddpd256(a, b, c); }
#elif defined(__x86_64__) && LANES == 2 && !defined(__clang__)
INLINE V v_fma(V a, V b, V c) { return __builtin_ia32_vfmaddpd(a, b, c); }
#else
INLINE V v_fma(V a, V b, V c) {
    V r = a;
    for (int i = 0; i < LANES; i++) r[i] = __builtin_fma(a[i], b[i], c[i]);
    return r;
}
#endif
#else
#define HAVE_FMA 0
INLINE V v_fma(V a, V b, V c) { return a * b + c; }
#endif

/* Square root, correctly rounded. */
#if LANES > 1 && __has_builtin(__builtin_elementwise_sqrt)
INLINE V v_sqrt(V x) { return __builtin_elementwise_sqrt(x); }
#elif defined(__x86_64__) && LANES == 8 && defined(__AVX512F__) && !defined(__clang__)
INLINE V v_sqrt(V x) { return __builtin_ia32_sqrtpd512_mask(x, x, -1, 4); }
#elif defined(__x86_64__) && LANES == 4 && defined(__AVX__) && !defined(__clang__)
INLINE V v_sqrt(V x) { return __builtin_ia32_sqrtpd256(x); }
#elif defined(__x86_64__) && LANES == 2 && !defined(__clang__)
INLINE V v_sqrt(V x) { return __builtin_ia32_sqrtpd(x); }
#else
INLINE V v_sqrt(V x) {
    V r = x;
    for (int i = 0; i < LANES; i++) r[i] = __builtin_sqrt(x[i]);
    return r;
}
#endif

#endif
