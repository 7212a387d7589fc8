/* Which names the linker shows: in the package's own library all that Python calls. An exported program has another names.h, which
   hides them and gives them a prefix: `advance` alone would be taken for a function of the C library. */
#define EXPORT __attribute__((visibility("default")))
