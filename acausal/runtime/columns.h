/* A function at many points at once, side by side in lanes: what is read of a motion. */
#ifndef ONLY_COMPILED_KERNELS

/* Results (outputs, n) of a kernel t, x, u, p -> y at n points: times t (n), states x (nx, n), inputs u (nu, n), row by row; parameters p
   (np). What comes out at a point does not depend on those beside it. */
int columns(const Kernel *k, long nx, long nu, long np, const double *p, long n, const double *t, const double *x, const double *u, double *y) {
    size_t values = (size_t)(k->inputs + k->outputs + k->constants + k->work + 4);
    char *raw = malloc(sizeof(V) * values + 64);
    if (!raw) return OUT_OF_MEMORY;
    V *in = (V *)(raw + (64 - (size_t)raw % 64)), *out = in + k->inputs + 1, *c = out + k->outputs + 1, *w = c + k->constants + 1;
    for (long i = 0; i < np; i++) in[1 + nx + nu + i] = v_all(p[i]);
    prepare_kernel(k, in, c, w);
    for (long m = 0; m < n; m += LANES) {
        long count = n - m < LANES ? n - m : LANES;
        size_t bytes = sizeof(double) * (size_t)count;
        for (long i = 0; i < 1 + nx + nu; i++) {
            const double *row = i == 0 ? t : i <= nx ? x + (i - 1) * n : u + (i - 1 - nx) * n;
            if (count < LANES) in[i] = v_all(row[m + count - 1]);
            memcpy(in + i, row + m, bytes);
        }
        run_kernel(k, in, c, out, w);
        for (long i = 0; i < k->outputs; i++) memcpy(y + i * n + m, out + i, bytes);
    }
    free(raw);
    return REACHED_END;
}
#endif
