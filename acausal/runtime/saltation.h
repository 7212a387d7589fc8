/* Derivatives of motions through changes of mode. A guard r vanishes at a time that moves with the direction, by dt = -dr / r', with r' along the old flow f-. So the
   state there moves by S + f- dt; impacts are differentiated with the rows that have been found to hold, in both phases; and after it, at a time that does not move,
   S+ = R' (S + f- dt) - f+ dt, along what holds from then on. Aizerman and Gantmacher, Q. J. Mech. Appl. Math. 11 (1958); Leine and Nijmeijer, Dynamics and
   Bifurcations of Non-Smooth Mechanical Systems (2004), chapter 7. */

#define GRAZES 1e6     /* roundings of a guard above its least value, where that is no zero to speak of */
#define TOGETHER 1e-6  /* of what rows change by that vanish together: by how much they may fall apart */
#define APART 1e-9     /* the same of gaps at the start, and where inputs jump, in units of their terms */
#define NO_ROOM 1e-8   /* of what rows change by with reactions that nothing moves by: what is left where none of these fit any longer */
#define SHARES 1e-4    /* the same: reactions that differ by so much have the same slopes of limits */

static int make_saltation(Integrator *I) {
    struct State *T = I->state;
    long n = reactions_of(I), directions = direction_blocks(I) * LANES;
    if (n && !arranged(I, &I->decision_change, &T->decision_change_in, &T->decision_change_out, &T->decision_change_c, 1 + I->nx + I->nu)) return 0;
    if (n && !I->counted) give_inputs(I, T->decision_change_in);
    T->delay = reserve_doubles(I, directions);
    T->decided_change = reserve_doubles(I, directions * I->decision.outputs);
    T->impulse_change = reserve_doubles(I, directions * 2 * n);
    T->slopes = reserve_doubles(I, 2 * I->mode_rows);
    T->flow = reserve_doubles(I, I->nx + 1);
    T->input_rate = reserve_doubles(I, I->nu + 1);
    long weighed = first_set(I);
    T->weight = reserve_doubles(I, I->mode_rows + 1);
    T->flow_before = reserve_doubles(I, I->nx + 1);
    T->unit_of_row = reserve_doubles(I, weighed + 1);
    T->by_carried = reserve_doubles(I, I->redundant ? weighed * n + 2 * weighed * weighed + 3 * weighed : 1);
    T->weighed = reserve(I, sizeof(long) * (size_t)(weighed + 1));
    if (!I->counted && !(T->weight && T->unit_of_row && T->by_carried && T->flow_before && T->weighed)) return 0;
    return I->counted || (T->delay && T->decided_change && T->impulse_change && T->slopes && T->flow && T->input_rate);
}

static Decision change_of_decision(const Integrator *I, long direction) { return decision_of(I, I->state->decided_change + direction * I->decision.outputs, 0); }

/* Time, state and inputs where a kernel of changes has them, and rates of the inputs into T->input_rate. Returns 0 when the input function failed. */
static int put_place(Integrator *I, double t, const double *x, double little, V *in) {
    struct State *T = I->state;
    V *u = in + 1 + I->nx;
    const double times[] = {t - little, t + little, t};
    for (int at = 0; at < 3; at++) {
        if (!inputs_at(I, v_all(times[at]), 1, u)) return 0;
        for (long k = 0; k < I->nu && at < 2; k++) T->input_rate[k] = at ? (u[k][0] - T->input_rate[k]) / (times[1] - times[0]) : u[k][0];
    }
    in[0] = v_all(t);
    for (long i = 0; i < I->nx; i++) in[1 + i] = v_all(x[i]);
    for (long k = 0; k < I->nu; k++) u[k] = v_all(u[k][0]);
    return 1;
}

/* Derivatives of rows along the flow at (t, x), which is left in T->flow. Returns 0 when the input function failed. */
static int find_slopes(Integrator *I, double t, const double *x, double little, double *slopes) {
    struct State *T = I->state;
    V *in = T->row_change_in, *change = in + 1 + I->nx + I->nu + I->np;
    if (!rate_at(I, t, x, T->flow) || !put_place(I, t, x, little, in)) return 0;
    *change++ = v_all(1);
    for (long i = 0; i < I->nx; i++) *change++ = v_all(T->flow[i]);
    for (long k = 0; k < I->nu; k++) *change++ = v_all(T->input_rate[k]);
    for (long k = 0; k < I->np; k++) *change++ = v_all(0);
    run_kernel(&I->row_change, in, T->row_change_c, T->row_change_out, T->work);
    for (long r = 0; r < I->mode_rows; r++) slopes[r] = side_of_row(I, r) * T->row_change_out[r][0];
    return 1;
}

/* The first law whose row it was, counted from one. */
static void note_law(const Integrator *I, long *first, long row) {
    if (!*first) *first = 1 + law_of_row(I, row);
}

/* Whether a row tells where the direction of a slip in a plane begins to be held, or has grown so much that it need not be: there the flow is the same to either side. */
static int only_turns(const Integrator *I, long row) {
    long first = I->one_sided + 2 * I->lines, k = row - first;
    if (k < 0 || k >= 2 * (I->planes + I->patches)) return 0;
    const double *mask = I->state->side + mask_of(I, I->lines + k / 2);
    return mask[1] == 1 || (mask[2] == 1 && k % 2);
}

/* What a row changes by with each of the reactions that are carried on, in units of the largest, a row of `by` each; into T->unit_of_row what that is in its own. Returns 0 when the input function failed. */
static int rows_by_carried(Integrator *I, double *by) {
    struct State *T = I->state;
    long n = reactions_of(I);
    double *carried = T->side + carried_of(I) + 1, largest = 0;
    Decision D;
    if (!decision_at(I, I->t, I->x, &D)) return 0;
    for (long j = 0; j < n; j++) largest = fmax(largest, fmax(T->alone[j], fabs(carried[j])) * unit_of(D.W[j * n + j]));
    for (long r = 0; r < first_set(I); r++) {
        long law = law_of_row(I, r);
        T->unit_of_row[r] = largest / unit_of(D.W[(law < D.gaps ? law : row_of(&D, law - D.gaps)) * (n + 1)]);
    }
    for (long j = 0; j < n; j++) {
        double kept = carried[j], part = SHARES * largest / unit_of(D.W[j * n + j]);
        for (int side = 1; side >= -1; side -= 2) {
            carried[j] = kept + side * part;
            int known = rows_at(I, I->t, I->x);
            carried[j] = kept;
            if (!known) return 0;
            for (long r = 0; r < first_set(I); r++) by[r * n + j] = side > 0 ? T->one_row[r] : (by[r * n + j] - T->one_row[r]) / (2 * SHARES);
        }
    }
    return rows_at(I, I->t, I->x);
}

/* Whether a row has been weighed with others. */
static int is_shared(const struct State *T, long row) {
    for (long a = 0; a < T->shared; a++)
        if (T->weighed[a] == row) return 1;
    return 0;
}

/* Weights y >= 0 of k rows whose products are G (k, k), with sum 1, so that y' G y is least; 0 where that is not zero. `A`: room for k (k + 2). */
static int find_weights(const double *G, long k, double *y, double *A) {
    double *b = A + k * k, *given = b + k, sum = 0, left = 0;
    for (long i = 0; i < k; i++) given[i] = y[i] = 1;
    for (int whole = 0; whole < 4;) { /* where G is singular, what it leaves is magnified most */
        memcpy(A, G, sizeof(double) * (size_t)(k * k));
        memcpy(b, y, sizeof(double) * (size_t)k);
        for (long i = 0; i < k; i++) {
            A[i * k + i] += DEPENDENT;
            for (long j = 0; j < k && given[i] == 0; j++) A[i * k + j] = A[j * k + i] = i == j;
        }
        eliminate_dense(A, b, k);
        long least = 0;
        sum = 0;
        for (long i = 0; i < k; i++) b[i] *= given[i], sum += b[i], least = b[i] < b[least] ? i : least;
        for (long i = 0; i < k; i++) y[i] = b[i] / sum;
        if (!(sum > 0)) return 0;
        whole++;
        if (!(y[least] < -SHARES)) continue;
        for (long i = 0; i < k; i++) y[i] = given[i] = given[i] != 0 && i != least;
        whole = 0;
    }
    for (long i = 0; i < k; i++)
        for (long j = 0; j < k; j++) left += y[i] * G[i * k + j] * y[j];
    return left <= SHARES * SHARES;
}

/* Where of all reactions that may be carried on none fits any longer, several rows vanish, each at a time that depends on which are: together they do at a time of their own, that of the sum of them
   with weights >= 0 that none of these reactions moves, as the multipliers of the largest margin are. Weights of rows into T->weight: 1 and 0 where there is nothing of that. Returns 0 when the
   input function failed. */
static int weigh_rows(Integrator *I, long row) {
    struct State *T = I->state;
    long n = reactions_of(I), k = 0, *which = T->weighed;
    double *by = T->by_carried, *G = by + first_set(I) * n;
    memset(T->weight, 0, sizeof(double) * (size_t)I->mode_rows);
    T->weight[row] = 1;
    T->shared = T->unshared = 0;
    if (!I->redundant || row >= first_set(I)) return 1;
    if (!rows_by_carried(I, by)) return 0;
    for (long r = 0; r < first_set(I); r++) {
        double most = 0;
        for (long j = 0; j < n; j++) most = hypot(most, by[r * n + j]);
        if (!(most > SHARES * T->unit_of_row[r] && fabs(T->one_row[r]) <= NO_ROOM * most)) continue;
        for (long j = 0; j < n; j++) by[k * n + j] = by[r * n + j] / most;
        T->unit_of_row[k] = most;
        which[k++] = r;
    }
    for (long a = 0; a < k; a++)
        for (long b = 0; b < k; b++) {
            G[a * k + b] = 0;
            for (long j = 0; j < n; j++) G[a * k + b] += by[a * n + j] * by[b * n + j];
        }
    double *y = G + 2 * k * k + 2 * k;
    if (k < 2 || !find_weights(G, k, y, G + k * k)) {
        T->unshared = k < 2 ? 0 : 1 + which[k - 1]; /* as where a force at its limit in a plane vanishes, too */
        memcpy(T->flow_before, T->flow, sizeof(double) * (size_t)I->nx);
        return 1;
    }
    T->weight[row] = 0;
    for (long a = 0; a < k; a++) T->weight[which[a]] = fmax(y[a], 0) / T->unit_of_row[a];
    T->shared = k;
    return 1;
}

/* By what part of themselves a direction moves states and parameters: the largest of all. */
static double part_of_direction(const Integrator *I, long d) {
    const struct State *T = I->state;
    double part = part_of_parameters(I, d);
    for (long i = 0; i < I->nx; i++)
        if (T->size[i] > 0) part = fmax(part, fabs(T->D[d / LANES * I->nx + i][d % LANES]) / T->size[i]);
    return part;
}

/* Notes rows that have been weighed, and that no other reactions would let vanish together so much later as they do in a direction, in lane l of a block. */
static void note_falling_apart(Integrator *I, const double *slopes, long b, long l) {
    struct State *T = I->state;
    long k = T->shared;
    double *G = T->by_carried + first_set(I) * reactions_of(I), *A = G + k * k, *left = A + k * k, most = 0, least = DEPENDENT * part_of_direction(I, b * LANES + l);
    memcpy(A, G, sizeof(double) * (size_t)(k * k));
    for (long a = 0; a < k; a++) {
        double by = T->row_change_out[T->weighed[a]][l], along = slopes[T->weighed[a]] * T->delay[b * LANES + l];
        A[a * k + a] += DEPENDENT;
        left[a] = DEPENDENT * (by + along) / T->unit_of_row[a];
        most = fmax(most, (fabs(by) + fabs(along)) / T->unit_of_row[a]);
    }
    eliminate_dense(A, left, k); /* what is no change by any of these reactions */
    for (long a = 0; a < k; a++)
        if (fabs(left[a]) > fmax(SHARES * most, least)) note_law(I, &I->coincides, T->weighed[a]);
}

/* How much later the row vanishes, direction by direction, into T->delay. Returns 0 when the input function failed. */
static int find_delays(Integrator *I, long row, double planned) {
    struct State *T = I->state;
    if (T->delayed++) return 1; /* what goes on in the same instant */
    double little = BACK * planned, *x = T->later_x, *slopes = T->slopes, *earlier = slopes + I->mode_rows;
    memset(T->delay, 0, sizeof(double) * (size_t)(direction_blocks(I) * LANES));
    if (row < 0 || (row >= first_set(I) - 2 * I->magnitudes && row < first_set(I))) return 1; /* where a force turns the flow goes on */
    if (!rate_at(I, I->t, I->x, T->flow)) return 0;
    for (long i = 0; i < I->nx; i++) x[i] = I->x[i] - little * T->flow[i];
    if (!find_slopes(I, I->t - little, x, little, earlier) || !find_slopes(I, I->t, I->x, little, slopes) || !rows_at(I, I->t, I->x)) return 0;
    if (row < first_set(I) && T->one_row[row] - little * slopes[row] < -MET * T->row_noise[row]) return 1; /* it has not come to zero, but jumped there when something else did; the side of what sets has gone over by now */
    if (!weigh_rows(I, row)) return 0;
    double slope = 0, before = 0, noise = 0;
    for (long r = 0; r < I->mode_rows; r++) {
        if (T->weight[r] == 0) continue;
        slope += T->weight[r] * slopes[r], before += T->weight[r] * earlier[r], noise += T->weight[r] * T->row_noise[r];
    }
    double bend = (slope - before) / little; /* what bends down goes through zero, however slowly */
    if (slope == 0 || (!only_turns(I, row) && !(slope * slope > GRAZES * noise * bend))) {
        note_law(I, &I->grazed, row);
        return 1;
    }
    V *in = T->row_change_in, *change = in + 1 + I->nx + I->nu + I->np;
    for (long b = 0; b < direction_blocks(I); b++) {
        change[0] = v_all(0);
        memcpy(change + 1, T->D + b * I->nx, sizeof(V) * (size_t)I->nx);
        set_directions(I, change + 1 + I->nx, b, I->nu);
        run_kernel(&I->row_change, in, T->row_change_c, T->row_change_out, T->work);
        for (long r = first_set(I); r < I->mode_rows; r++) T->row_change_out[r] *= v_all(side_of_row(I, r));
        V change_of_sum = v_all(0);
        for (long r = 0; r < I->mode_rows; r++)
            if (T->weight[r] != 0) change_of_sum = v_fma(v_all(T->weight[r]), T->row_change_out[r], change_of_sum);
        for (long l = 0; l < LANES; l++) T->delay[b * LANES + l] = -change_of_sum[l] / slope;
        for (long l = 0; l < LANES && b * LANES + l < I->directions && T->shared; l++) note_falling_apart(I, slopes, b, l);
        for (long r = 0; r < I->mode_rows; r++) {
            if (I->row_switch[r] == I->row_switch[row] || is_shared(T, r) || !(fabs(T->one_row[r]) <= MET * T->row_noise[r])) continue;
            for (long l = 0; l < LANES; l++) { /* what vanishes here, too, goes on vanishing together with it, or not */
                double by = T->row_change_out[r][l], along = slopes[r] * T->delay[b * LANES + l];
                if (fabs(by + along) > TOGETHER * (fabs(by) + fabs(along))) note_law(I, &I->coincides, r);
            }
        }
    }
    return 1;
}

/* All directions move along a flow, for so many delays. */
static void move_directions(Integrator *I, const double *flow, double factor) {
    struct State *T = I->state;
    for (long b = 0; b < direction_blocks(I); b++)
        for (long i = 0; i < I->nx; i++)
            for (long l = 0; l < LANES; l++) T->D[b * I->nx + i][l] += factor * flow[i] * T->delay[b * LANES + l];
}

/* Changes of time, state, inputs and parameters with a block of directions, where rows vanish. */
static void put_directions(Integrator *I, long b, V *change) {
    struct State *T = I->state;
    memcpy(change, T->delay + b * LANES, sizeof(V));
    memcpy(change + 1, T->D + b * I->nx, sizeof(V) * (size_t)I->nx);
    set_directions(I, change + 1 + I->nx, b, I->nu);
    for (long k = 0; k < I->nu; k++) change[1 + I->nx + k] += v_all(T->input_rate[k]) * change[0];
}

/* To where the row vanishes. Returns 0 when the input function failed. */
static int meet_row_by_directions(Integrator *I, long row, double planned) {
    if (!find_delays(I, row, planned)) return 0;
    if (row >= 0) move_directions(I, I->state->flow, 1);
    return 1;
}

/* The same with changes of what is decided by there. */
static int meet_directions(Integrator *I, long row, double planned) {
    struct State *T = I->state;
    if (!meet_row_by_directions(I, row, planned)) return 0;
    V *in = T->decision_change_in, *change = in + 1 + I->nx + I->nu + I->np;
    if (!put_place(I, I->t, I->x, BACK * planned, in)) return 0;
    for (long b = 0; b < direction_blocks(I); b++) {
        put_directions(I, b, change);
        run_kernel(&I->decision_change, in, T->decision_change_c, T->decision_change_out, T->work);
        for (long l = 0; l < LANES; l++)
            for (long o = 0; o < I->decision.outputs; o++) T->decided_change[(b * LANES + l) * I->decision.outputs + o] = T->decision_change_out[o][l];
    }
    return 1;
}

/* Gaps that touch at the start, or where inputs jump, and would not if the motion were another one: its derivatives are then others to either side. */
static void note_closed(Integrator *I, const Decision *D, const long *touching) {
    struct State *T = I->state;
    for (long d = 0; d < I->directions; d++) {
        double part = 0;
        for (long i = 0; i < I->nx; i++)
            if (T->size[i] > 0) part = fmax(part, fabs(T->D[d / LANES * I->nx + i][d % LANES]) / T->size[i]);
        Decision change = change_of_decision(I, d);
        for (long k = 0; k < D->gaps; k++) {
            if (!touching[k] || T->side[k] == 1 || D->rate[k] > D->rate_noise[k]) continue;
            if (fabs(change.gap[k]) > APART * part * D->gap_noise[k] / (TOUCHES * EPS)) note_law(I, &I->coincides, k);
        }
    }
}

/* What a limit of sliding changes by, where what decides changes by `d` and reactions do not. */
static double limit_change(const Problem *p, const Decision *d, long f) {
    const Decision *D = p->D;
    double change = 0, force[3];
    for (long k = 0; k < D->n; k++) change += d->slide_by[f * D->n + k] * p->push[k];
    for (long m = 0; m < D->magnitudes; m++) {
        double size = force_at(p, m, force);
        change += d->slide_size[f * D->magnitudes + m] * size;
        for (long k = 0; k < D->n && size > 0; k++)
            for (long c = 0; c < 3; c++) change += D->slide_size[f * D->magnitudes + m] * force[c] / size * d->force_by[(3 * m + c) * D->n + k] * p->push[k];
    }
    return change;
}

/* Changes of reactions that are solved for by a choice of laws (`complementary`), where what decides changes by `d`, start and floors by these. */
static void change_choice(const Problem *p, const Decision *d, const double *start, const double *floor, double *room, double *push) {
    const Decision *D = p->D;
    const double *W = D->W;
    long n = D->n;
    double *M = room, *A = M + n * n, *right = A + n * n, *b = right + n, *y = b + n, *rate = y + n, *by = rate + 3 * n;
    memset(M, 0, sizeof(double) * (size_t)(n * n));
    for (long i = 0; i < n; i++) {
        rate[i] = start[i];
        for (long j = 0; j < n; j++) rate[i] += d->W[i * n + j] * p->push[j];
    }
    for (long i = 0; i < n; i++) right[i] = y[i] = 0, M[i * n + i] = 1;
    for (long law = 0; law < D->gaps + D->frictions; law++) {
        long f = law - D->gaps, first = f < 0 ? law : row_of(D, f), size = f < 0 ? 1 : rows_of(D, f), is = p->law[law];
        double limit = f < 0 ? 0 : limit_of(p, f), change = f < 0 ? 0 : limit_change(p, d, f), *e = p->along + 3 * f, speed = f < 0 || size == 1 ? 0 : hypot(p->rate[first], p->rate[first + 1]) - p->damping * FITS * hypot(p->start[first], p->start[first + 1]);
        if (f >= 0) limit_slope(p, f, by);
        for (long k = 0; k < size; k++) {
            long i = first + k;
            double unit = 1 / unit_of(W[i * n + i]);
            if (is == HOLDS) {
                for (long j = 0; j < n; j++) M[i * n + j] = W[i * n + j] * unit / unit_of(W[j * n + j]);
                right[i] = -rate[i] * unit;
            } else if (f < 0) {
                right[i] = is == OPENS && floor ? floor[i] / unit : 0;
            } else if (is != OFF && limit > 0) {
                right[i] = -change * e[k] / unit;
                for (long j = 0; j < n; j++) M[i * n + j] += by[j] * e[k] / (unit * unit_of(W[j * n + j]));
                if (is != STARTS || !(speed > 0)) continue;
                double along = e[0] * rate[first] + e[1] * rate[first + 1];
                right[i] -= limit / speed * (rate[i] - along * e[k]) / unit;
                for (long j = 0; j < n; j++) {
                    double w = e[0] * W[first * n + j] + e[1] * W[(first + 1) * n + j];
                    M[i * n + j] += limit / speed * (W[i * n + j] - w * e[k]) / (unit * unit_of(W[j * n + j]));
                }
            }
        }
    }
    for (int again = 0, left = 1; again < 60 && left; again++) {
        memcpy(A, M, sizeof(double) * (size_t)(n * n));
        for (long i = 0; i < n; i++) {
            b[i] = right[i];
            for (long j = 0; j < n; j++) b[i] -= M[i * n + j] * y[j];
            A[i * n + i] *= 1 + p->damping;
        }
        eliminate_dense(A, b, n);
        double changed = 0, most = 0;
        for (long i = 0; i < n; i++) {
            y[i] += b[i];
            changed = fmax(changed, fabs(b[i])), most = fmax(most, fabs(y[i]));
        }
        left = changed > ROUNDED * EPS * most;
    }
    for (long i = 0; i < n; i++) push[i] = y[i] / unit_of(W[i * n + i]);
}

/* Changes of the impulses of a phase that has just been solved; `compressed`: impulses of the first. */
static void change_phase(Integrator *I, const Problem *p, int phase, const double *compressed) {
    struct State *T = I->state;
    const Decision *D = p->D;
    long n = D->n;
    double *room = T->choice_change, *start = room + 2 * n * n + 4 * n, *floor = start + n;
    for (long d = 0; d < I->directions; d++) {
        double *first = T->impulse_change + 2 * n * d, *push = first + phase * n;
        Decision change = change_of_decision(I, d);
        for (long i = 0; i < n; i++) {
            start[i] = change.rate[i];
            for (long j = 0; j < n && phase; j++) start[i] += change.W[i * n + j] * compressed[j] + D->W[i * n + j] * first[j];
        }
        for (long i = 0; i < D->gaps; i++) floor[i] = phase && compressed[i] > 0 ? change.bounce[i] * compressed[i] + D->bounce[i] * first[i] : 0;
        change_choice(p, &change, start, floor, room, push);
    }
}

/* x jumps by J times these impulses. */
static void strike_directions(Integrator *I, const Decision *D, const double *impulse) {
    struct State *T = I->state;
    long n = D->n;
    for (long d = 0; d < I->directions; d++) {
        const double *change = T->impulse_change + 2 * n * d;
        Decision dD = change_of_decision(I, d);
        for (long i = 0; i < I->nx; i++) {
            double sum = 0;
            for (long j = 0; j < n; j++) sum += dD.J[i * n + j] * impulse[j] + D->J[i * n + j] * (change[j] + change[n + j]);
            T->D[d / LANES * I->nx + i][d % LANES] += sum;
        }
    }
}

/* Notes rows that have vanished together at a time that is not known, if that matters: where rates jump. Returns 0 when the input function failed. */
static int note_unshared(Integrator *I) {
    struct State *T = I->state;
    Decision D;
    long row = T->unshared - 1;
    T->unshared = 0;
    if (row < 0) return 1;
    if (!decision_at(I, I->t, I->x, &D)) return 0;
    for (long i = 0; i < I->nx; i++) {
        double most = 0;
        for (long j = 0; j < D.n; j++) most += fabs(D.J[i * D.n + j]) * T->alone[j];
        if (fabs(T->flow[i] - T->flow_before[i]) > APART * most) note_law(I, &I->coincides, row);
    }
    return 1;
}

/* Back to a time that does not move, in the new mode. Returns 0 when the input function failed. */
static int leave_directions(Integrator *I) {
    struct State *T = I->state;
    if (!rate_at(I, I->t, I->x, T->flow) || !note_unshared(I)) return 0;
    move_directions(I, T->flow, -1);
    if (I->ng) project_directions(I);
    return 1;
}
