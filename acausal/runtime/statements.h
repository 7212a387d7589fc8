/* The loop of an interpreter over the statements of a program, included once for each kind of values: a function INTERPRETER of values VALUE with the
   operations of TABLE and SINCOS. `in` and `out` hold plain values or these values (OUTSIDE), of which a VALUE takes the room of PARTS; OF_OUTSIDE
   and TO_OUTSIDE make one of the other. SYSTEM solves linear equations (see systems.h). ALONG: more arguments, after a comma. All these names are free again behind it. */
#define AT(k) (*(VALUE *)((char *)frame + s[k]))
#define A AT(2)
#define B AT(3)
#define C AT(4)
#define NEXT goto *labels[*(s += WIDTH)]

static void INTERPRETER(const int *s, const OUTSIDE *in, V *frame, OUTSIDE *out ALONG) {
#define LABEL(name, result) &&at_##name,
    static const void *const labels[] = {&&at_end, &&at_load, &&at_store, &&at_number, &&at_sincos, TABLE(LABEL) &&at_system};
#undef LABEL
    s -= WIDTH;
    NEXT;
at_load: AT(1) = OF_OUTSIDE(*(const OUTSIDE *)((const char *)in + s[2] / PARTS)); NEXT;
at_store: *(OUTSIDE *)((char *)out + s[1] / PARTS) = TO_OUTSIDE(A); NEXT;
at_number: {
    double number;
    memcpy(&number, s + 2, sizeof number);
    AT(1) = OF_NUMBER(v_all(number));
    NEXT;
}
at_sincos: {
    VALUE sine, cosine;
    SINCOS(A, &sine, &cosine);
    AT(1) = sine;
    B = cosine;
    NEXT;
}
#define CASE(name, result) at_##name: AT(1) = result; NEXT;
    TABLE(CASE)
#undef CASE
at_system: SYSTEM(&AT(1), s[2], s[3], s[4]); NEXT;
at_end:;
}

#undef A
#undef B
#undef C
#undef AT
#undef NEXT
#undef INTERPRETER
#undef VALUE
#undef OUTSIDE
#undef PARTS
#undef OF_OUTSIDE
#undef TO_OUTSIDE
#undef OF_NUMBER
#undef ALONG
#undef SINCOS
#undef SYSTEM
#undef TABLE
