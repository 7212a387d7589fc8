/* What is set at zeros of expressions: states, and discrete values, which are the last of the masks. Guards are the last of the rows of modes; each has a side, by which
   its row is multiplied, so that it is positive until the guard passes zero. All that pass in one instant set together, from the values just before; then reactions are
   decided, and guards are looked at again, until none passes any more. What is within rounding of zero is on the side to which the motion leads it. */

#define UNLEFT 12    /* times that a guard passes zero without getting away, which tell that it chatters */

static int changes_modes(const Integrator *I) { return I->masks > 0 || I->set_count > 0; }

static int make_sets(Integrator *I) {
    struct State *T = I->state;
    long n = I->set_count, targets = I->nx + I->discretes, d = I->directions ? direction_blocks(I) * LANES : 0;
    if (!arranged(I, &I->set, &T->set_in, &T->set_out, &T->set_c, 1 + I->nx + I->nu)) return 0;
    if (!I->counted) give_inputs(I, T->set_in);
    if (d && !arranged(I, &I->set_change, &T->set_change_in, &T->set_change_out, &T->set_change_c, 1 + I->nx + I->nu)) return 0;
    if (d && !I->counted) give_inputs(I, T->set_change_in);
    T->set_side = reserve_doubles(I, n + 1);
    T->set_rows = reserve_doubles(I, 6 * n + 1);
    T->set_x = reserve_doubles(I, targets + 1);
    T->lock_noise = reserve_doubles(I, I->set.outputs + 1);
    T->set_fired = reserve(I, sizeof(long) * (size_t)(3 * n + 1));
    T->set_by = reserve(I, sizeof(long) * (size_t)(targets + 1));
    T->discrete_change = reserve_doubles(I, d * I->discretes + 1);
    return I->counted || (T->set_side && T->set_rows && T->set_x && T->lock_noise && T->set_fired && T->set_by && T->discrete_change);
}

/* Changes of discrete values at the start, direction by direction: of those that follow from it, and from parameters. Returns 0 when the input function failed. */
static int begin_discrete_directions(Integrator *I) {
    struct State *T = I->state;
    V *in = T->set_change_in, *change = in + 1 + I->nx + I->nu + I->np, *u = in + 1 + I->nx;
    in[0] = v_all(I->t);
    for (long i = 0; i < I->nx; i++) in[1 + i] = v_all(I->x[i]);
    if (!inputs_at(I, in[0], 1, u)) return 0;
    for (long k = 0; k < I->nu; k++) u[k] = v_all(u[k][0]);
    for (long again = 0; again <= I->discretes; again++) /* those that are said by others */
        for (long b = 0; b < direction_blocks(I); b++) {
            change[0] = v_all(0);
            memcpy(change + 1, T->D + b * I->nx, sizeof(V) * (size_t)I->nx);
            set_directions(I, change + 1 + I->nx, b, I->nu);
            run_kernel(&I->set_change, in, T->set_change_c, T->set_change_out, T->work);
            for (long k = 0; k < I->discretes; k++)
                for (long l = 0; l < LANES; l++)
                    T->discrete_change[(b * LANES + l) * I->discretes + k] = I->discrete_start && isfinite(I->discrete_start[k]) ? 0 : T->set_change_out[k][l];
        }
    return 1;
}

/* Discrete values at the start. */
static enum Code begin_discretes(Integrator *I) {
    struct State *T = I->state;
    V *in = T->set_in;
    double *value = T->side + first_discrete(I);
    for (long k = 0; k < I->discretes; k++) value[k] = I->discrete_start && isfinite(I->discrete_start[k]) ? I->discrete_start[k] : 0;
    for (long again = 0; again <= I->discretes; again++) { /* those that are said by others */
        int changed = 0;
        in[0] = v_all(I->t);
        for (long i = 0; i < I->nx; i++) in[1 + i] = v_all(I->x[i]);
        if (!inputs_at(I, in[0], 1, in + 1 + I->nx)) return INPUT_FAILED;
        run_kernel(&I->set, in, T->set_c, T->set_out, T->work);
        for (long k = 0; k < I->discretes; k++) {
            if (I->discrete_start && isfinite(I->discrete_start[k])) continue;
            changed |= value[k] != T->set_out[k][0];
            value[k] = T->set_out[k][0];
        }
        if (!changed) break;
    }
    for (long k = 0; k < I->discretes; k++) {
        if (isfinite(value[k])) continue;
        I->other = k;
        return BEGINS_NO_NUMBER;
    }
    return !I->directions || begin_discrete_directions(I) ? REACHED_END : INPUT_FAILED;
}

/* Rates of all guards at (t, x) into `slope`, 0 where they are no more than rounding. Returns 0 when the input function failed. */
static int find_set_slopes(Integrator *I, double *slope) {
    struct State *T = I->state;
    V *in = T->set_in, *out = T->set_out + I->set.outputs - I->set_count;
    double *noise = slope + I->set_count;
    for (long k = 0; k < I->set_count; k++) noise[k] = 0;
    for (long from = 0; from < COUNTED; from += LANES) {
        for (long l = 0; l < LANES; l++)
            for (long i = -1; i < I->nx; i++) {
                double value = i < 0 ? I->t : I->x[i], unit = from + l > 0 ? EPS * (i < 0 ? fabs(I->t) : fmax(T->size[i], fabs(value))) : 0;
                in[1 + i][l] = value + unit * ((double)(drawn((from + l) * (I->nx + 1) + i) >> 29) / 2 - 1.75);
            }
        if (!inputs_at(I, in[0], LANES, in + 1 + I->nx)) return 0;
        run_kernel(&I->set, in, T->set_c, T->set_out, T->work);
        for (long k = 0; k < I->set_count; k++) {
            if (from == 0) slope[k] = out[k][0];
            for (long l = 0; l < LANES; l++) {
                double change = fabs(out[k][l] - slope[k]);
                if (change < INFINITY) noise[k] = fmax(noise[k], ROUNDINGS * change);
            }
        }
    }
    for (long k = 0; k < I->set_count; k++)
        if (!(fabs(slope[k]) > noise[k])) slope[k] = 0;
    return 1;
}

/* Guards into T->set_rows, 0 where they are within rounding of it, and behind them the sides to which they are led: 0 where that is not seen. Returns 0 when the input function failed. */
static int look_ahead(Integrator *I, double planned) {
    struct State *T = I->state;
    long n = I->set_count, first = first_set(I), left = 0;
    double *value = T->set_rows, *side = T->set_rows + n, *slope = T->set_rows + 2 * n, *zero = T->set_rows + 4 * n, *rest = T->set_rows + 5 * n, *x = T->set_x, *rate = T->most;
    if (!rows_at(I, I->t, I->x)) return 0;
    for (long k = 0; k < n; k++) {
        int rests = rests_at_zero(I, first + k, T->one_row[first + k], I->t, I->x, planned);
        if (rests < 0) return 0;
        rest[k] = rests ? at_rest(I, first + k) : 0;
        double s = T->set_side[k], noise = fmax(MET * T->row_noise[first + k], fmax(zero[k], rest[k]));
        value[k] = T->one_row[first + k] / (s != 0 ? s : 1);
        side[k] = value[k] > noise ? 1 : value[k] < -noise ? -1 : 0;
        if (side[k] == 0) value[k] = 0, left++;
    }
    if (left && !find_set_slopes(I, slope)) return 0;
    for (long k = 0; k < n && left; k++) {
        if (side[k] != 0 || slope[k] == 0 || rest[k] > 0) continue;
        side[k] = slope[k] > 0 ? 1 : -1;
        left--;
    }
    for (double part = LATER; part < TOO_LATE && left; part *= 100) { /* as reactions are decided */
        double later = part * planned;
        if (!rate_at(I, I->t, I->x, rate)) return 0;
        for (long i = 0; i < I->nx; i++) x[i] = I->x[i] + 0.5 * later * rate[i];
        if (!rate_at(I, I->t + 0.5 * later, x, rate)) return 0;
        for (long i = 0; i < I->nx; i++) x[i] = I->x[i] + later * rate[i];
        if (!rows_at(I, I->t + later, x)) return 0;
        for (long k = 0; k < n; k++) {
            double s = T->set_side[k], there = T->one_row[first + k] / (s != 0 ? s : 1), noise = fmax(MET * T->row_noise[first + k], 2 * rest[k]);
            if (side[k] != 0 || !(fabs(there) > noise)) continue;
            side[k] = there > 0 ? 1 : -1;
            left--;
        }
    }
    return 1;
}

/* Which guards pass zero here, into T->set_fired, and how many of them set something; `row`: the one that has been found, or -1. -1: the input function failed. */
static long find_passing(Integrator *I, long row, double planned, int begins) {
    struct State *T = I->state;
    long n = I->set_count, first = first_set(I), count = 0, *fired = T->set_fired, *before = T->set_fired + n;
    double *value = T->set_rows, *led = T->set_rows + n, *slope = T->set_rows + 2 * n;
    for (long k = 0; k < n && begins; k++) T->set_side[k] = 1;
    if (!look_ahead(I, planned)) return -1;
    for (long k = 0; k < n; k++) {
        long wanted = I->set_direction[k];
        double old = T->set_side[k], new = led[k] != 0 ? led[k] : old;
        if (first + k == row && led[k] != 0 && !(value[k] == 0 && slope[k] * old > 0)) new = -old; /* unless it only seemed so within rounding */
        fired[k] = 0;
        if (begins) { /* what begins at zero has the side from which it counts */
            old = new;
            if (value[k] == 0 && led[k] != 0 && wanted == (led[k] > 0 ? 1 : -1)) old = -new;
            if (led[k] == 0) old = new = wanted ? (double)-wanted : 1;
        }
        T->set_side[k] = new;
        if (new == old) continue;
        fired[k] = wanted == 0 ? !before[k] : wanted == (new > 0 ? 1 : -1);
        count += fired[k];
    }
    for (long k = 0; k < n; k++) before[k] |= fired[k];
    return count;
}

/* Whether a guard passes zero again and again without getting away from it; `row`: the one that does. */
static int never_leaves(Integrator *I, long row) {
    struct State *T = I->state;
    long set = first_set(I), k = I->steps - 1 - I->first, *near = T->set_fired + 2 * I->set_count;
    for (long j = 0; j < I->set_count; j++)
        if (T->far[set + j]) near[j] = 0;
    if (row < set || k < 0 || I->offset[k] < 0) return 0;
    Path p = {I, I->coefficients + I->offset[k], I->states + k * I->nx, I->states + (k + 1) * I->nx,
              I->stage_count[k], I->stage_count[k], row, I->times[k], I->times[k + 1] - I->times[k], 0, 0, 0, 1, 1, 0, 0, 1};
    if (one_value(&p, 0.5) > 100 * T->row_noise[row]) near[row - set] = 0;
    return ++near[row - set] > UNLEFT;
}

/* New values of all targets of the guards that pass: states into T->set_x, discrete values behind them; T->set_by tells by whom. */
static enum Code find_values(Integrator *I) {
    struct State *T = I->state;
    V *in = T->set_in;
    double *value = T->set_x;
    memcpy(value, I->x, sizeof(double) * (size_t)I->nx);
    memcpy(value + I->nx, T->side + first_discrete(I), sizeof(double) * (size_t)I->discretes);
    for (long k = 0; k < I->nx + I->discretes; k++) T->set_by[k] = -1;
    in[0] = v_all(I->t);
    for (long i = 0; i < I->nx; i++) in[1 + i] = v_all(I->x[i]);
    if (!inputs_at(I, in[0], 1, in + 1 + I->nx)) return INPUT_FAILED;
    run_kernel(&I->set, in, T->set_c, T->set_out, T->work);
    for (long k = 0; k < I->set_count; k++)
        for (long j = I->set_first[k]; T->set_fired[k] && j < I->set_first[k + 1]; j++) {
            long target = I->set_target[j];
            double new = T->set_out[I->discretes + j][0];
            I->worst = k;
            I->other = j;
            if (!isfinite(new)) return SETS_NO_NUMBER;
            if (T->set_by[target] >= 0 && value[target] != new) {
                I->other = T->set_by[target];
                return SETS_TWICE;
            }
            value[target] = new;
            T->set_by[target] = j;
        }
    I->worst = -1;
    return REACHED_END;
}

/* Derivatives of all that, at the time at which it happens. Returns 0 when the input function failed. */
static int set_directions_anew(Integrator *I, double planned) {
    struct State *T = I->state;
    V *in = T->set_change_in, *change = in + 1 + I->nx + I->nu + I->np;
    if (!put_place(I, I->t, I->x, BACK * planned, in)) return 0;
    for (long b = 0; b < direction_blocks(I); b++) {
        put_directions(I, b, change);
        run_kernel(&I->set_change, in, T->set_change_c, T->set_change_out, T->work);
        for (long target = 0; target < I->nx + I->discretes; target++) {
            if (T->set_by[target] < 0) continue;
            V found = T->set_change_out[I->discretes + T->set_by[target]];
            if (target < I->nx) T->D[b * I->nx + target] = found;
            for (long l = 0; l < LANES && target >= I->nx; l++) T->discrete_change[(b * LANES + l) * I->discretes + target - I->nx] = found[l];
        }
    }
    return 1;
}

/* Whether all meets that is held by what is remembered. */
static enum Code meet_locks(Integrator *I) {
    struct State *T = I->state;
    long first = I->discretes + I->set_first[I->set_count], n = (I->set.outputs - I->set_count - first) / 2;
    double *noise = T->lock_noise;
    if (n == 0) return REACHED_END;
    V *in = T->set_in, *gap = T->set_out + first, *terms = gap + n;
    for (long k = 0; k < n; k++) noise[k] = 0;
    for (long from = 0; from < COUNTED; from += LANES) {
        for (long l = 0; l < LANES; l++)
            for (long i = -1; i < I->nx; i++) {
                double value = i < 0 ? I->t : I->x[i], unit = from + l > 0 ? EPS * (i < 0 ? fabs(I->t) : fmax(T->size[i], fabs(value))) : 0;
                in[1 + i][l] = value + unit * ((double)(drawn((from + l) * (I->nx + 1) + i) >> 29) / 2 - 1.75);
            }
        if (!inputs_at(I, in[0], LANES, in + 1 + I->nx)) return INPUT_FAILED;
        run_kernel(&I->set, in, T->set_c, T->set_out, T->work);
        for (long k = 0; k < n; k++) {
            if (from == 0) noise[n + k] = gap[k][0], noise[k] = EPS * fabs(terms[k][0]);
            for (long l = 0; l < LANES; l++) noise[k] = fmax(noise[k], ROUNDINGS * fabs(gap[k][l] - noise[n + k]));
        }
    }
    for (long k = 0; k < n; k++) {
        if (fabs(noise[n + k]) <= noise[k] * fmax(KNOWN, I->rtol) / EPS) continue;
        I->worst = k;
        I->apart = fabs(noise[n + k]);
        return SETS_APART;
    }
    return REACHED_END;
}

/* What is imposed takes velocities by a plastic impact: then a step of no length leads to the state after it. */
static enum Code impose_locks(Integrator *I, int begins) {
    struct State *T = I->state;
    double *before = T->set_x;
    int strikes = 0;
    enum Code code = meet_locks(I);
    if (code != REACHED_END) return code;
    memcpy(before, I->x, sizeof(double) * (size_t)I->nx);
    if (!give_to_projection(I, I->t, T->side)) return INPUT_FAILED;
    T->projection_in[0] = v_all(I->t);
    for (long i = 0; i < I->nx; i++) T->projection_in[1 + i] = v_all(I->x[i]);
    run_masked(I, OF_PROJECTION, T->projection_in, T->projection_c, T->projection_out);
    for (long i = 0; i < I->nx; i++) { /* what has been at rest so far has no size by which `project` could judge */
        if (!isfinite(T->projection_out[i][0])) return NON_FINITE;
        I->x[i] = T->projection_out[i][0];
        T->size[i] = fmax(T->size[i], fabs(I->x[i]));
    }
    project(I, I->t, I->x);
    for (long i = 0; i < I->nx; i++) {
        strikes |= !(fabs(I->x[i] - before[i]) <= UNSEEN * fmax(T->size[i], fabs(I->x[i])));
        T->size[i] = fmax(T->size[i], fabs(I->x[i]));
    }
    if (!strikes) return REACHED_END;
    memset(T->carry, 0, sizeof(double) * (size_t)I->nx);
    memset(T->impulse, 0, sizeof(double) * (size_t)reactions_of(I));
    return (!begins || note_transition(I, -1)) && keep_straight(I, 0) ? REACHED_END : OUT_OF_MEMORY;
}

static int has_locks(const Integrator *I) { return I->set.outputs > I->discretes + I->set_first[I->set_count] + I->set_count; }

/* What has passed zero sets what it sets, all together. */
static enum Code set_all(Integrator *I, double planned) {
    struct State *T = I->state;
    int jumps = 0;
    long reactions = first_discrete(I);
    enum Code code = find_values(I);
    if (code != REACHED_END) return code;
    if (I->directions && !set_directions_anew(I, planned)) return INPUT_FAILED;
    if (!look_before_knot(I, I->t)) return INPUT_FAILED; /* what holds lets go where its gap or its slip is set to something else */
    memcpy(T->side + reactions, T->set_x + I->nx, sizeof(double) * (size_t)I->discretes);
    memset(T->impulse, 0, sizeof(double) * (size_t)reactions_of(I));
    for (long k = 0; k < I->set_count; k++)
        if (T->set_fired[k] && !note_transition(I, first_set(I) + k)) return OUT_OF_MEMORY;
    for (long i = 0; i < I->nx; i++) jumps |= T->set_x[i] != I->x[i];
    if (!jumps && !has_locks(I)) return REACHED_END;
    memset(T->side, 0, sizeof(double) * (size_t)reactions); /* what holds by reactions may open */
    for (long i = 0; i < I->nx; i++) {
        I->x[i] = T->set_x[i];
        T->size[i] = fmax(T->size[i], fabs(I->x[i]));
    }
    if (!jumps) { /* what is held moves gaps by the rounding of others: that is no jump of theirs */
        T->crossed = 0;
        return impose_locks(I, 0);
    }
    if (has_locks(I)) code = meet_locks(I);
    if (code != REACHED_END) return code;
    project(I, I->t, I->x);
    for (long i = 0; i < I->nx; i++) {
        if (T->set_by[i] < 0 || fabs(I->x[i] - T->set_x[i]) <= fmax(KNOWN, I->rtol) * T->size[i]) continue;
        I->other = T->set_by[i];
        for (long k = 0; k < I->set_count; k++)
            if (I->set_first[k] <= I->other && I->other < I->set_first[k + 1]) I->worst = k;
        return SETS_BOUND;
    }
    memset(T->carry, 0, sizeof(double) * (size_t)I->nx);
    return keep_straight(I, 0) ? REACHED_END : OUT_OF_MEMORY;
}

/* All that changes at (t, x): what is set, and which rows hold. `row`: the guard that has become negative, -1: none in particular. */
static enum Code decide_modes(Integrator *I, long row, double planned) {
    struct State *T = I->state;
    int begins = !T->begun, set = row >= first_set(I), reactions = reactions_of(I) > 0;
    enum Code code = REACHED_END;
    long count = 0;
    T->pace = planned;
    T->changes = fabs(I->t - T->changed_at) <= INSTANT * planned ? T->changes + 1 : 0;
    T->changed_at = T->parting.since = I->t;
    T->delayed = 0;
    for (long k = 0; k < I->set_count; k++) T->set_fired[k] = T->set_fired[I->set_count + k] = 0, T->set_rows[4 * I->set_count + k] = 0;
    if (set) { /* so far from zero is at zero in this instant */
        if (!rows_at(I, I->t, I->x)) return INPUT_FAILED;
        double value = fabs(T->one_row[row]), known = T->row_noise[row] * fmax(MET, I->rtol / (ROUNDINGS * EPS));
        T->set_rows[4 * I->set_count + row - first_set(I)] = value <= known ? value : 0;
    }
    if (never_leaves(I, row) || T->changes > CHANGES) {
        I->worst = law_of_row(I, row);
        return CHATTERS;
    }
    if (begins && I->discretes && has_locks(I)) {
        code = impose_locks(I, 1);
        if (code != REACHED_END) return code;
    }
    for (int pass = 0;; pass++) {
        if (pass > 0 || set || (row < 0 && !begins)) {
            count = I->set_count ? find_passing(I, pass == 0 ? row : -1, planned, begins && pass == 1) : 0;
            if (count < 0) return INPUT_FAILED;
            if (pass == 0 && set && !count) { /* it passes in the direction that does not count */
                I->h = planned;
                T->pending = -1;
                return REACHED_END;
            }
            if (count && pass > CHANGES) {
                for (long k = 0; k < I->set_count; k++)
                    if (T->set_fired[k]) I->worst = law_of_row(I, first_set(I) + k);
                return CHATTERS;
            }
            if (pass == 0 && I->directions && !meet_row_by_directions(I, row, planned)) return INPUT_FAILED;
            if (count) code = set_all(I, planned);
            if (code != REACHED_END) return code;
            if (count && I->held > I->masks && !agree(I, I->t, I->x, 1)) return INPUT_FAILED; /* conditions of what has been set */
        }
        I->state->just_set = count > 0;
        if (reactions && (pass == 0 || count)) code = decide_reactions(I, pass == 0 && !set ? row : -1, planned);
        else if (begins && pass == 0) code = note_transition(I, -1) ? REACHED_END : OUT_OF_MEMORY;
        if (code != REACHED_END) return code;
        if (pass > 0 && !count) break;
    }
    if (I->directions && !leave_directions(I)) return INPUT_FAILED;
    for (long r = 0; r < I->row_count; r++) T->far[r] = 0;
    forget_rates(I);
    forget_mode(I);
    I->h = T->begins_in > 0 ? fmin(planned, T->begins_in) : planned;
    T->begins_in = 0;
    T->pending = -1;
    T->crossed = 0;
    return REACHED_END;
}

/* Where steps fall to rounding since slip jams, it is stopped by an impact. Whether it was so. */
static int jams(Integrator *I, double planned) {
    int slides = 0;
    for (long f = I->lines; f < frictions_of(I); f++) slides |= I->state->side[mask_of(I, f)] != 1;
    if (!slides || I->directions) return 0;
    I->state->jams = 1;
    enum Code code = decide_modes(I, -1, planned);
    I->state->jams = 0;
    return code == REACHED_END && first_step(I);
}
