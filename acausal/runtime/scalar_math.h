/* Functions of one number, by this package: C libraries differ in last bits, and some compilers bring their own. */

INLINE double of_number(V found) { return found[0]; }
#define cos(x) of_number(v_cos(v_all(x)))
#define sin(x) of_number(v_sin(v_all(x)))
#define atan2(y, x) of_number(v_atan2(v_all(y), v_all(x)))
#define log(x) of_number(v_log(v_all(x)))
#define hypot(x, y) of_number(v_hypot(v_all(x), v_all(y)))
#define pow(x, y) of_number(v_pow(v_all(x), v_all(y)))
