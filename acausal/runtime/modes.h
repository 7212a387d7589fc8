/* Modes: which rows of reactions hold. Masks are inputs that are held while a step is taken; guards of masks are rows of switches.h, so steps end where one of
   them becomes negative. Then all rows are decided together, from what `decision` gives at that place, in this order, row by row:

   gaps (one_sided); rates of gaps, slips (n); accelerations of both without reactions (n); W (n, n): accelerations by reactions; J (nx, n): x' by
   reactions; limits of sticking, without reactions (frictions) and by reactions (frictions, n); those of sliding likewise; laws of impact (one_sided), see
   impacts.h; restitution of slips (frictions); restitution (one_sided); kinetic energy; where limits depend on
   magnitudes, their forces (3 each) without reactions and by them (3 each, n), and limits of sticking and of sliding by these (frictions, magnitudes).

   First impacts, where a gap that is closed closes with speed.
   Then accelerations, looked at a little later, where what is exactly at its threshold has passed it.

   Slip in a plane has a direction, which is not smooth where it is zero: near zero friction acts against a direction that is held, that of the slip or of its
   beginning. There slip runs through zero like slip along a line; how it turns so near to zero moves nothing. */

#include "decision.h"

#include "zeno.h"
#include "saltation.h"
#include "impacts.h"
#include "margin.h"
#include "accelerations.h"

#define ENDLESSLY 4e-11 /* of the speed of closing: what is left where blows one after the other have no end, at most */
#define REFINED 3      /* times that impulses are solved for, what they leave open last */
#define CLOSING 1e-9   /* of the slips: a speed of closing that is as good as none */
#define ENDED 1e-6     /* of the slips met: what is left of slips that end all at once where no mode lasts */
#define TURNS 8        /* directions in which it is looked for how what jams is stopped */
#define FIRST_PART 1e-6 /* of the slip, by which it is led to where it jams, at least */
#define UNSETTLED 20   /* changes of mode in one instant, from which on they do */

/* Rows that touch and leave so slowly that gaps do not tell it are held where they are. What happens instead, a bounce, loses the time until it is over, and the
   friction of all that pushes meanwhile; both are first order in its speed, and so is what is done here: the impulse that ends the bounce, turned round, with its friction. All that
   touches has come to rest then. */
static void end_low_bounces(Integrator *I, const Decision *D, Room R) {
    struct State *T = I->state;
    long n = D->n;
    double *left = T->blow, *more = T->blow + n;
    Decision nothing = decision_of(I, T->no_change, 0);
    Problem p = problem_of(I, D, R, D->rate);
    p.kinetic = 1;
    memset(T->no_change, 0, sizeof(double) * (size_t)I->decision.outputs);
    for (int slides = 1; slides >= 0; slides--) { /* where friction that slides leaves no answer, without it */
        double open = 0, most = 0;
        for (long i = 0; i < n; i++) R.push[i] = i >= D->valves && i < D->gaps && R.touching[i];
        for (long i = 0; i < D->gaps; i++) R.law[i] = R.push[i] == 1 ? HOLDS : OFF;
        for (long f = 0; f < D->frictions; f++) R.law[D->gaps + f] = !(limit_of(&p, f) > 0) ? OFF : R.touching[D->gaps + f] == 1 ? HOLDS : slides ? AGAINST : OFF;
        for (int again = 0; again < REFINED; again++) { /* of redundant rows damping leaves something open */
            for (long i = 0; i < n; i++) {
                left[i] = D->rate[i];
                for (long j = 0; j < n && again; j++) left[i] += D->W[i * n + j] * R.before[j];
            }
            change_choice(&p, &nothing, left, 0, T->choice_change, again ? more : R.before);
            for (long i = 0; i < n && again; i++) R.before[i] += more[i];
        }
        for (long i = 0; i < D->gaps; i++) {
            double rate = D->rate[i], unit = unit_of(own_of(D, i));
            for (long j = 0; j < n; j++) rate += D->W[i * n + j] * R.before[j];
            if (R.law[i] == OFF) continue;
            most = fmax(most, fabs(D->rate[i]) / unit);
            open = isfinite(rate) ? fmax(open, fabs(rate) / unit) : INFINITY;
        }
        if (open <= sqrt(FITS) * most) break;
        if (!slides) return; /* what holds is projected */
    }
    for (long i = D->valves; i < D->gaps; i++) R.touching[i] = R.touching[i] ? 2 : 0; /* whatever of their speeds is left */
    if (I->directions) {
        memcpy(R.push, R.before, sizeof(double) * (size_t)n);
        memset(T->impulse_change, 0, sizeof(double) * (size_t)(2 * n * direction_blocks(I) * LANES));
        change_phase(I, &p, 0, 0);
        strike_directions(I, D, R.before);
    }
    for (long j = 0; j < n; j++) T->impulse[j] += R.before[j];
    for (long i = 0; i < I->nx; i++)
        for (long j = 0; j < n; j++) I->x[i] += D->J[i * n + j] * R.before[j];
}

/* What touches, and which way it slips: of one-sided laws 0 or 1, 2 where they have come to rest; of frictions 1 where the slip is zero, 2 else, with its direction, 3 where that has been held until
   now. */
static void look_at_slips(Integrator *I, const Decision *D, Room R, long row, const double *before) {
    struct State *T = I->state;
    for (long f = 0; f < D->frictions; f++) {
        long i = row_of(D, f), size = rows_of(D, f), first = I->one_sided + 2 * f;
        double *mask = T->side + mask_of(I, f), *e = R.along + 3 * f, slip = size_of(D, f, D->rate), nil = 0, was = 0;
        for (long k = 0; k < size; k++) nil += D->rate_noise[i + k], was += before ? fabs(before[i + k]) : 0;
        nil = fmax(nil, NIL * was);
        int held = size > 1 && mask[2] == 1, stops = row == first && mask[0] == 0 && (size == 1 ? mask[1] != 0 : held), stuck = !before && mask[0] == 1;
        for (long k = 0; k < size; k++) stuck &= !has_jumped(I, D, D->gaps + i + k);
        int passed = !before && size == 1 && mask[1] * D->rate[i] < 0 && !has_jumped(I, D, D->gaps + i); /* in the same instant as the row's */
        int zero = stuck || stops || passed || slip <= nil;
        R.touching[D->gaps + f] = zero ? 1 : held && size == 2 && row == first + 1 && !I->directions ? 3 : 2;
        if (size == 1 || zero) e[0] = D->rate[i] > 0 ? 1 : -1, e[1] = e[2] = 0;
        else if (held && !before && slip < 2 * mask[3] && row != first + 1) memcpy(e, mask + 4, sizeof(double) * (size_t)size);
        else against(D, f, D->rate + i, e);
    }
}

/* How a one-sided row is pushed open by its own reaction, less than none where friction that slips turns it round (Painleve); with all others that hold, in its units. */
static double yield_of(const Decision *D, Room R, long gap) {
    long n = D->n, m = 0, *row = R.place;
    double *A = R.work;
    for (long i = D->valves; i < D->gaps; i++)
        if (i != gap && R.law[i] == HOLDS) row[m++] = i;
    for (long f = 0; f < D->frictions; f++)
        for (long k = 0; k < rows_of(D, f) && R.law[D->gaps + f] == HOLDS; k++) row[m++] = row_of(D, f) + k;
    row[m++] = gap;
    for (long a = 0; a < m; a++)
        for (long b = 0; b < m; b++) {
            double sum = D->W[row[a] * n + row[b]];
            for (long f = 0; f < D->frictions && row[b] < D->gaps; f++)
                for (long k = 0; k < rows_of(D, f) && R.touching[D->gaps + f] == 2; k++)
                    sum -= D->slide_by[f * n + row[b]] * R.along[3 * f + k] * D->W[row[a] * n + row_of(D, f) + k];
            A[a * m + b] = sum / (unit_of(D->W[row[a] * n + row[a]]) * unit_of(D->W[row[b] * n + row[b]]));
        }
    for (long k = 0; k < m - 1; k++)
        for (long a = k + 1; a < m; a++) {
            double factor = A[a * m + k] / A[k * m + k];
            for (long b = k + 1; b < m; b++) A[a * m + b] -= factor * A[k * m + b];
        }
    return A[m * m - 1];
}

/* Whether a row holds as soon as the clock tells another time; -1 when the input function failed. */
static int holds_soon(Integrator *I, long row) {
    struct State *T = I->state;
    double h = 2 * SPENT * EPS * fabs(I->t);
    if (!rate_at(I, I->t, I->x, T->rate)) return -1;
    for (long i = 0; i < I->nx; i++) T->later_x[i] = I->x[i] + h * T->rate[i];
    if (!rows_at(I, I->t + h, T->later_x)) return -1;
    int holds = T->one_row[row] >= -T->row_noise[row];
    return rows_at(I, I->t, I->x) ? holds : -1;
}

/* Whether friction that slips has one answer in the mode that has been set; else `worst` is the law. REACHED_END, NO_MODE or INPUT_FAILED. */
static enum Code has_one_answer(Integrator *I, const Decision *D, Room R) {
    for (long f = 0; f < D->frictions; f++)
        for (long i = 0; i < D->gaps && R.touching[D->gaps + f] == 2; i++) {
            double by = D->slide_by[f * D->n + i], alone = D->W[i * D->n + i];
            for (long k = 0; k < rows_of(D, f); k++) alone -= by * R.along[3 * f + k] * D->W[i * D->n + row_of(D, f) + k];
            if (by == 0 || alone > 0 || !R.touching[i] || I->redundant || yield_of(D, R, i) > 0) continue;
            I->worst = D->gaps + f;
            return NO_MODE;
        }
    int holds = 0;
    for (long i = 0; i < D->gaps; i++) holds |= I->state->side[i] == 1;
    if (!I->magnitudes && !holds) return REACHED_END;
    if (!rows_at(I, I->t, I->x)) return INPUT_FAILED;
    double valves = largest_in(D, R.push, 0, D->valves), others = largest_in(D, R.push, D->valves, D->n);
    for (long i = 0; i < D->gaps; i++) { /* in this mode the equations may say something else: then it is none */
        double unit = unit_of(own_of(D, i)), most = i < D->valves ? valves : others;
        if (I->state->side[i] != 1 || !(I->state->one_row[i] * unit < -ATTRACTS * most) || I->state->one_row[i] >= -MET * I->state->row_noise[i]) continue;
        int soon = i < D->valves ? holds_soon(I, i) : 0;
        if (soon < 0) return INPUT_FAILED;
        if (soon) continue;
        I->worst = i;
        return NO_MODE;
    }
    for (long m = 0; m < I->magnitudes; m++) {
        if (I->state->one_row[first_set(I) - 2 * (I->magnitudes - m) + 1] > 0) continue;
        I->worst = D->gaps;
        while (I->worst < D->gaps + D->frictions - 1 && D->slide_size[(I->worst - D->gaps) * D->magnitudes + m] == 0) I->worst++;
        return NO_MODE;
    }
    return REACHED_END;
}

/* Rates of what takes part by its law, no others: `start` (n). */
static void take_part(const Decision *D, const long *law, double *start) {
    memcpy(start, D->rate, sizeof(double) * (size_t)D->n);
    for (long i = 0; i < D->gaps; i++)
        if (law[i] == OFF) start[i] = 0;
    for (long f = 0; f < D->frictions; f++)
        for (long k = 0; k < rows_of(D, f) && law[D->gaps + f] == OFF; k++) start[row_of(D, f) + k] = 0;
}

/* Impulses that stop all that holds by the masks there are, or presses and slips, as if nothing else could be, into R.push. */
static void stop_all(Integrator *I, const Problem *p, Room R) {
    const Decision *D = p->D;
    for (long k = 0; k < D->gaps + D->frictions; k++) R.place[k] = k < D->gaps && k >= D->valves && I->state->side[k] == 1 ? HOLDS : OFF;
    for (long f = 0; f < D->frictions; f++)
        for (long i = 0; i < D->gaps && R.asked[D->gaps + f] == MAY_HOLD; i++)
            if (R.place[i] == HOLDS && D->slide_by[f * D->n + i] != 0) R.place[D->gaps + f] = HOLDS;
    newton_of_laws(p, R.place);
}

/* Impulses that stop what slips, with all else, or as if it were alone, or turn it: Newton's iteration begins with them, until it comes to an answer. Whether there is one. */
static int stop_slips(Integrator *I, Problem *p, Room R) {
    const Decision *D = p->D;
    const double large[] = {4, 1.2, 20}; /* times the normal impulse that is needed */
    double damping = p->damping;
    p->damping = 0;
    for (int k = -1; k < 3 * TURNS; k++) {
        double angle = PI * (k % TURNS) / TURNS * (k % 2 ? 2 : -2);
        memset(R.push, 0, sizeof(double) * (size_t)D->n);
        memset(R.centre, 0, sizeof(double) * (size_t)D->n);
        for (long f = 0; f < D->frictions; f++)
            for (long i = 0, at = row_of(D, f); k >= 0 && i < D->gaps && R.asked[D->gaps + f] == MAY_HOLD; i++) {
                if (R.asked[i] == OFF || D->slide_by[f * D->n + i] == 0) continue;
                double u = -p->start[at] / unit_of(own_of(D, at)), v = rows_of(D, f) == 2 ? -p->start[at + 1] / unit_of(own_of(D, at + 1)) : 0;
                R.push[at] = cos(angle) * u - sin(angle) * v;
                if (rows_of(D, f) == 2) R.push[at + 1] = sin(angle) * u + cos(angle) * v;
                R.push[i] = large[k / TURNS] * sqrt(u * u + v * v) / D->slide_by[f * D->n + i];
            }
        if (k < 0) stop_all(I, p, R);
        memcpy(R.law, R.asked, sizeof(long) * (size_t)(D->gaps + D->frictions));
        if (!newton_of_laws(p, R.asked)) continue;
        find_rates(p);
        if (answers(p)) return 1;
    }
    p->damping = damping;
    return 0;
}

/* Where friction that slips leaves no acceleration that is possible, what jams is stopped by an impact, plastic, though nothing closes with speed (Genot and Brogliato,
   European Journal of Mechanics A 18, 1999): that of a speed of closing that goes to zero, whose impulses do not. Whether there is one. */
static int strike_without_closing(Integrator *I, Room R) {
    struct State *T = I->state;
    Decision D;
    long n = reactions_of(I), laws = I->one_sided + frictions_of(I);
    double *start = R.compressed, fast = 0, most = 0;
    if (!frictions_of(I) || !decision_at(I, I->t, I->x, &D)) return 0;
    Problem p = problem_of(I, &D, R, start);
    p.kinetic = 1;
    for (long i = 0; i < D.gaps; i++) R.law[i] = i >= D.valves && R.touching[i] ? MAY_HOLD : OFF;
    for (long f = 0; f < D.frictions; f++) {
        long *law = R.law + D.gaps + f;
        *law = OFF;
        for (long i = 0; i < D.gaps; i++)
            if (R.touching[i] && D.slide_by[f * n + i] != 0) *law = MAY_HOLD;
        for (long k = row_of(&D, f); k < row_of(&D, f) + rows_of(&D, f) && *law == MAY_HOLD; k++) fast = fmax(fast, fabs(D.rate[k]) / unit_of(own_of(&D, k)));
    }
    take_part(&D, R.law, start);
    for (long i = 0; i < n; i++) /* what closes a little later, if nothing acts */
        if (R.law[i < D.gaps ? i : 0] != OFF || i >= D.gaps) most = fmax(most, fabs(D.free[i]) / unit_of(own_of(&D, i)));
    for (long i = 0; i < n && most > 0; i++) start[i] = (i < D.gaps ? 0 : start[i]) + CLOSING * fast / most * D.free[i];
    most = 0;
    memcpy(R.asked, R.law, sizeof(long) * (size_t)laws);
    int stopped = T->jams && stop_slips(I, &p, R);
    if (!stopped) {
        memcpy(R.law, R.asked, sizeof(long) * (size_t)laws);
        if (!complementary(&p, R.place, T->lemke, T->basis)) return 0;
    }
    take_part(&D, R.asked, start);
    memcpy(R.centre, R.push, sizeof(double) * (size_t)n);
    if (!newton_of_laws(&p, R.asked)) {
        if (!stopped) return 0;
        memcpy(R.push, R.centre, sizeof(double) * (size_t)n);
    }
    find_rates(&p);
    for (long i = 0; i < n; i++) most = fmax(most, fabs(R.push[i]) * unit_of(own_of(&D, i)));
    if ((!stopped && !answers(&p)) || !(most > NIL * fast)) return 0;
    for (long j = 0; j < n; j++) T->impulse[j] += R.push[j];
    for (long i = 0; i < I->nx; i++)
        for (long j = 0; j < n; j++) I->x[i] += D.J[i * n + j] * R.push[j];
    memcpy(R.before, D.rate, sizeof(double) * (size_t)n);
    for (long k = 0; k < first_discrete(I); k++) T->side[k] = 0;
    if (!decision_at(I, I->t, I->x, &D)) return 0;
    look_at_slips(I, &D, R, -1, R.before);
    return 1;
}

/* Slip in a plane that turns until what presses grows beyond all bounds, which takes no time any more, is led there by impulses, with all else that accelerates. Whether there is such slip; -1 when the input function failed. */
static int lead_to_jam(Integrator *I, const Decision *D, Room R) {
    struct State *T = I->state;
    long n = D->n;
    for (long k = D->lines * D->gaps; k < D->frictions * D->gaps; k++) {
        long f = k / D->gaps, gap = k % D->gaps, i = row_of(D, f), size = rows_of(D, f);
        double *e = R.along + 3 * f, was[3], pace = size_of(D, f, R.rate);
        if (R.touching[D->gaps + f] != 2 || R.law[D->gaps + f] != AGAINST || R.law[gap] != HOLDS || D->slide_by[f * n + gap] == 0 || !(yield_of(D, R, gap) > 0)) continue;
        memcpy(was, e, sizeof was);
        for (double part = FIRST_PART; part < 1; part *= 2) {
            double time = part * size_of(D, f, D->rate) / pace, next[3] = {0, 0, 0};
            for (long m = 0; m < size; m++) next[m] = D->rate[i + m] + time * R.rate[i + m];
            against(D, f, next, e);
            if (yield_of(D, R, gap) > 0) continue;
            if (!rate_at(I, I->t, I->x, T->rate)) return -1;
            for (long j = 0; j < n; j++) T->impulse[j] += time * R.push[j];
            for (long q = 0; q < I->nx; q++) I->x[q] += time * T->rate[q];
            return 1;
        }
        memcpy(e, was, sizeof was);
    }
    return 0;
}

/* Slips that are nothing beside how fast all is, and that leave no acceleration that is possible: they are zero. Whether there are such. */
static int end_least_slips(const Integrator *I, const Decision *D, Room R) {
    long n = D->n, found = 0;
    double fast = sqrt(2 * fmax(D->bounce[D->gaps], 0));
    for (long f = 0; f < D->frictions; f++) {
        long i = row_of(D, f);
        if (R.touching[D->gaps + f] != 2 || !(size_of(D, f, D->rate) <= NEAR_ZERO * fast * unit_of(own_of(D, i)))) continue;
        R.touching[D->gaps + f] = 1;
        for (long k = 0; k < I->one_sided; k++) found |= R.touching[k] && D->slide_by[f * n + k] != 0;
    }
    return found != 0;
}

/* Slips in planes that are all but over end at once: beside them directions turn faster than others can follow, as those of feet that hold what slides on them. Whether there are such. */
static int end_small_slips(const Decision *D, Room R) {
    int found = 0;
    for (long f = D->lines; f < D->frictions; f++)
        if (R.touching[D->gaps + f] == 2 && size_of(D, f, D->rate) <= ENDED * R.met[f]) R.touching[D->gaps + f] = 1, found = 1;
    return found;
}

/* Where slip in a plane stops against a direction that is held, others that are held as well stop with it (2 in `wanted`), as those of feet of one body, if all of them stick then: one
   after the other they would let the first go again. Whether there are such. */
static int stop_together(const Integrator *I, const Decision *D, Room R, long row, long *wanted) {
    int found = 0, stops = row >= I->one_sided + 2 * I->lines && row < I->one_sided + 2 * frictions_of(I) && R.touching[I->one_sided + (row - I->one_sided) / 2] == 1;
    for (long f = D->lines; f < D->frictions; f++) {
        const double *mask = I->state->side + mask_of(I, f);
        long *touching = R.touching + D->gaps + f;
        wanted[f] = stops && *touching == 2 && mask[2] == 1 && size_of(D, f, D->rate) <= mask[3];
        if (wanted[f]) *touching = 1, found = 1;
    }
    return found;
}

/* Whether all of these stick; else they slip as they did. */
static int all_stick(const Decision *D, Room R, enum Code code, const long *wanted) {
    int all = code == REACHED_END;
    for (long f = D->lines; f < D->frictions; f++) all &= !wanted[f] || R.law[D->gaps + f] == HOLDS;
    for (long f = D->lines; f < D->frictions && !all; f++)
        if (wanted[f]) R.touching[D->gaps + f] = 2;
    return all;
}

/* Slips that have been put to zero by what holds now, as that of the third foot of what stands still on two, are over, too. Whether there are such; -1 when the input function failed. */
static int end_with_others(Integrator *I, Room R) {
    Decision D;
    long F = I->lines + I->planes, slides = 0, ended = 0;
    for (long f = 0; f < F; f++) slides |= R.touching[I->one_sided + f] == 2 && R.law[I->one_sided + f] == AGAINST;
    if (!slides || I->directions) return 0;
    if (!decision_at(I, I->t, I->x, &D)) return -1;
    for (long f = 0; f < F; f++) {
        if (R.touching[D.gaps + f] != 2 || R.law[D.gaps + f] != AGAINST || size_of(&D, f, D.rate) > slip_noise(&D, f)) continue;
        R.touching[D.gaps + f] = ended = 1;
    }
    return ended != 0;
}

/* Whether no other gap closes while impacts are bridged; -1 when the input function failed. */
static int meets_nothing_else(Integrator *I, Room R) {
    struct State *T = I->state;
    Decision D;
    if (!decision_at(I, T->rest_t, T->rest_x, &D)) return -1;
    for (long i = 0; i < D.gaps; i++)
        if (!R.touching[i] && !T->rests[i] && D.gap[i] < -D.gap_noise[i]) return 0;
    return 1;
}

/* Of the gaps that leave, those that fall back before that is seen, by the accelerations that have been decided: they touch. Whether there are any; `rate`: of gaps. */
static int fall_back(const Integrator *I, const Decision *D, Room R, const double *rate, long *leaves) {
    int low = 0;
    for (long i = 0; i < D->gaps; i++) {
        if (!leaves[i] || rate[i] > least_rate(I, D, i, R.rate[i])) continue;
        leaves[i] = 0;
        R.touching[i] = low = 1;
    }
    return low;
}

/* Frictions whose slip was zero after each of so many impacts of theirs. */
static void note_sticking(Integrator *I, const Decision *D, Room R) {
    struct State *T = I->state;
    const char *struck = T->struck + T->impacts % REMEMBERED * D->gaps;
    for (long f = 0; f < D->frictions; f++)
        for (long i = 0; i < D->gaps; i++) {
            if (!struck[i] || D->slide_by[f * D->n + i] == 0) continue;
            T->sticks[f] = R.touching[D->gaps + f] == 1 ? T->sticks[f] + 1 : 0;
        }
}

/* How hard the impact is that has been decided, as a root of an energy, and how well its instant is known, by rounding of gaps. */
static void note_strength(Integrator *I, const Decision *D, Room R) {
    struct State *T = I->state;
    long at = T->impacts % REMEMBERED;
    double *size = T->impact_size + at, *noise = T->impact_noise + at;
    *size = *noise = 0;
    for (long i = 0; i < D->gaps; i++) {
        if (!T->struck[at * D->gaps + i]) continue;
        *size += fabs(T->impulse[i]) * unit_of(own_of(D, i));
        *noise = fmax(*noise, D->gap_noise[i] / (TOUCHES * fabs(R.before[i])));
    }
}

/* Slips whose directions were held go on as they came where they are on their way, or do not begin here. Whether there are such. */
static int keep_their_ways(const Decision *D, Room R, enum Code code) {
    int found = 0;
    for (long f = D->lines; f < D->lines + D->planes; f++) {
        const double *slip = D->rate + row_of(D, f), *rate = R.rate + row_of(D, f);
        double along = slip[0] * rate[0] + slip[1] * rate[1], aside = fabs(slip[0] * rate[1] - slip[1] * rate[0]);
        long *touching = R.touching + D->gaps + f;
        if (*touching != 3 || (code == REACHED_END && R.law[D->gaps + f] == STARTS && along > 0 && aside > OFF_COURSE * along)) continue;
        *touching = 2;
        found = 1;
    }
    return found;
}

/* Gaps that are below zero by more than rounding, at a tolerance that allows for it, are put to zero where they strike or leave, as what holds is: positions are moved, speeds
   stay. 1 where there are such gaps, -1 when the input function failed. */
static int lift(Integrator *I, Decision *D, Room R) {
    struct State *T = I->state;
    long n = D->n, deep = 0;
    double *sides = T->lifted, *before = T->later_x;
    memcpy(sides, T->side, sizeof(double) * (size_t)I->masks);
    memcpy(before, I->x, sizeof(double) * (size_t)I->nx);
    memset(T->side, 0, sizeof(double) * (size_t)first_discrete(I));
    for (long i = 0; i < D->gaps; i++) {
        T->side[i] = R.touching[i] && D->gap[i] < -D->gap_noise[i];
        deep |= T->side[i] == 1;
    }
    if (deep) project(I, I->t, I->x);
    memcpy(T->side, sides, sizeof(double) * (size_t)I->masks);
    if (!deep) return 0;
    for (long i = 0; i < I->nx; i++)
        for (long j = 0; j < n; j++)
            if (D->J[i * n + j] != 0) I->x[i] = before[i];
    return decision_at(I, I->t, I->x, D) ? 1 : -1;
}

#include "bridge.h"

/* What touches after an impact with no speed but rounding of all that has struck stays beside one another: that speed, and the gap, are put to zero, since they would part it in flight,
   so that it strikes in pieces later. So are others to what restitution makes of them, where rounding is all that is missing. 0 when the input function failed. */
static int stay_beside(Integrator *I, Decision *D, Room R) {
    struct State *T = I->state;
    long n = D->n, found = 0;
    double *missing = R.compressed, *end = T->blow;
    Decision nothing = decision_of(I, T->no_change, 0);
    memset(T->no_change, 0, sizeof(double) * (size_t)I->decision.outputs);
    for (long k = 0; k < D->gaps + D->frictions; k++) R.law[k] = OFF;
    for (long i = 0; i < n; i++) R.push[i] = R.floor[i] = 0;
    double fastest = 0;
    for (long i = 0; i < D->gaps; i++)
        if (R.touching[i]) fastest = fmax(fastest, -R.before[i] / unit_of(D->W[i * n + i]));
    for (long i = 0; i < D->gaps; i++) {
        double struck = 0;
        for (long j = 0; j < n; j++) struck += fabs(D->W[i * n + j] * T->impulse[j]);
        double left = is_alone(D, i) ? ENDLESSLY * fmax(fastest * unit_of(D->W[i * n + i]), struck) : 0; /* by blows without end */
        double noise = fmax(D->rate_noise[i], fmax(TOUCHES * EPS * struck, left)), back = fabs(R.before[i]) <= noise || fabs(D->rate[i]) <= left ? 0 : -D->bounce[i] * R.before[i];
        if (!R.touching[i] || D->terms[i] < 0 || is_speed(D, i) || !(fabs(D->rate[i] - back) <= noise)) continue;
        R.law[i] = HOLDS;
        R.push[i] = 1, R.floor[i] = back;
        found |= back == 0 && fabs(D->rate[i]) > D->rate_noise[i] / ROUNDINGS; /* a rounding of its own parts it by no more than gaps are rounded */
    }
    if (!found) return 1;
    for (int again = 0; again < 2; again++) { /* the first ones are rounded as large as they are */
        Problem p = problem_of(I, D, R, missing);
        p.kinetic = 1;
        p.damping = I->redundant ? DEPENDENT : 0;
        for (long i = 0; i < n; i++) missing[i] = D->rate[i] - R.floor[i];
        change_choice(&p, &nothing, missing, 0, T->choice_change, end);
        for (long i = 0; i < I->nx; i++) {
            double moved = 0;
            for (long j = 0; j < n; j++) moved += D->J[i * n + j] * end[j];
            if (isfinite(moved)) I->x[i] += moved;
        }
        if (!decision_at(I, I->t, I->x, D)) return 0;
    }
    for (long i = 0; i < D->gaps; i++) {
        T->side[i] = R.law[i] == HOLDS && R.floor[i] == 0;
        R.law[i] = T->side[i] == 1 ? HOLDS : OFF;
    }
    if (I->redundant) T->side[carried_of(I) - 1] = DAMPING * least_pivot(D, R.law, R.work, R.place);
    project(I, I->t, I->x);
    memset(T->side, 0, sizeof(double) * (size_t)first_discrete(I));
    return decision_at(I, I->t, I->x, D);
}

/* Whether directions of slips are held now that were not by these masks: they are over before time tells which way they turn, since what presses has grown. */
static int ends_at_once(const Integrator *I, const double *masks) {
    int found = 0;
    for (long f = I->lines; f < frictions_of(I); f++) found |= masks[mask_of(I, f) + 1] == 1 && I->state->side[mask_of(I, f) + 2] == 1;
    return found;
}

/* Slip that jams is led there and stopped, unless it is over at once. REACHED_END, NO_MODE where it does not jam, or INPUT_FAILED. */
static enum Code stop_jam(Integrator *I, Decision *D, Room R, double planned) {
    enum Code code = decide_accelerations(I, R, planned);
    if (code != REACHED_END) return code;
    if (!decision_at(I, I->t, I->x, D)) return INPUT_FAILED;
    look_at_slips(I, D, R, -1, 0);
    int led = lead_to_jam(I, D, R);
    if (led == 0) return ends_at_once(I, I->state->lifted + I->masks) ? REACHED_END : NO_MODE;
    if (led < 0 || !decision_at(I, I->t, I->x, D)) return INPUT_FAILED;
    look_at_slips(I, D, R, -1, 0);
    if (!strike_without_closing(I, R)) return NO_MODE;
    if (!decision_at(I, I->t, I->x, D) || !stay_beside(I, D, R)) return INPUT_FAILED;
    look_at_slips(I, D, R, -1, R.before);
    return REACHED_END;
}

/* All rows are decided at (t, x): impacts, then modes. `row`: the guard of masks that has become negative, -1: none in particular. */
static enum Code decide_reactions(Integrator *I, long row, double planned) {
    struct State *T = I->state;
    Decision D;
    Room R = room_of(I);
    long gaps = I->one_sided, n = reactions_of(I), *leaves = T->leaves;
    int impacts = 0;
    if (I->valves && T->begun) project(I, I->t, I->x); /* what has been held at zero through states is where it may change */
    if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
    for (long i = 0; i < gaps; i++) {
        R.touching[i] = D.gap[i] <= D.gap_noise[i] || (T->side[i] == 1 && !has_jumped(I, &D, i)) || i == row;
        if ((!T->begun || has_jumped(I, &D, i)) && D.gap[i] < -fmax(D.gap_noise[i], T->begun && !T->just_set ? 0 : I->rtol * fabs(D.terms[i]))) {
            I->worst = i;
            return OVERLAPS;
        }
        double known = D.gap_noise[i] + D.rate_noise[i] * T->pace; /* a gap moves by the rounding of all that holds it, or what it belongs to */
        if (!T->just_set && D.gap[i] < -deepest(I, known, fmax(D.gap_noise[i] / (TOUCHES * EPS), T->gap_terms[i]))) return falls(I, i, -D.gap[i]); /* what has been set moves gaps by the rounding of others */
        int strikes = R.touching[i] && D.rate[i] < -(i == row ? 4 : 1) * D.rate_noise[i];
        T->struck[T->impacts % REMEMBERED * gaps + i] = strikes != 0;
        impacts |= strikes; /* what begins to hold where its speed vanishes strikes nothing */
    }
    int lifted = T->begun && !T->just_set && !I->directions ? lift(I, &D, R) : 0;
    if (lifted < 0) return INPUT_FAILED;
    if (I->directions) {
        if (!meet_directions(I, row, planned)) return INPUT_FAILED;
        if (row < 0) note_closed(I, &D, R.touching);
    }
    look_at_slips(I, &D, R, row, 0);
    if (T->changes > UNSETTLED && !I->directions) end_small_slips(&D, R);
    memset(T->impulse, 0, sizeof(double) * (size_t)n);
    if (T->jams) {
        enum Code stopped = stop_jam(I, &D, R, planned);
        if (stopped != REACHED_END) return stopped;
    }
    if (impacts) {
        I->worst = row >= 0 && row < gaps ? row : 0;
        enum Code struck = impact(I, &D, R);
        if (struck != REACHED_END) return struck;
        for (long i = 0; i < I->nx; i++)
            for (long j = 0; j < n; j++) I->x[i] += D.J[i * n + j] * T->impulse[j];
        if (I->directions) strike_directions(I, &D, T->impulse);
        memcpy(R.before, D.rate, sizeof(double) * (size_t)n);
        for (long k = 0; k < first_discrete(I); k++) T->side[k] = 0;
        if (!decision_at(I, I->t, I->x, &D) || !stay_beside(I, &D, R)) return INPUT_FAILED;
        look_at_slips(I, &D, R, -1, R.before);
        note_strength(I, &D, R);
    } else if (!T->jams) {
        note_between(I, row);
    }
    double *rate = R.compressed;
    memcpy(rate, D.rate, sizeof(double) * (size_t)n);
    for (long i = 0; i < gaps; i++) { /* open, if it bounces */
        leaves[i] = R.touching[i] && rate[i] > (impacts || T->jams ? fmax(D.rate_noise[i], NIL * fabs(R.before[i])) : least_rate(I, &D, i, D.free[i]));
        if (leaves[i]) R.touching[i] = 0;
    }
    int together = impacts || T->jams || I->directions ? 0 : stop_together(I, &D, R, row, T->sticks_now);
    enum Code code = decide_accelerations(I, R, planned);
    if (together && !all_stick(&D, R, code, T->sticks_now)) code = decide_accelerations(I, R, planned);
    if (keep_their_ways(&D, R, code)) code = decide_accelerations(I, R, planned);
    int low = code == REACHED_END && fall_back(I, &D, R, rate, leaves), over = 0;
    if (impacts) {
        note_sticking(I, &D, R);
        foresee_rest(I, row < gaps ? row : -1);
        over = comes_to_rest(I, low);
        if (over) over = go_on_held(I, R, planned);
        if (over == HELD && I->directions && (low || act_alike(I, &D))) { /* derivatives are those of what is held from here on */
            for (long i = 0; i < gaps; i++)
                if (T->rests[i]) R.touching[i] = 1, leaves[i] = 0;
            over = 0;
            low = 1;
        }
        if (over > 0) over = meets_nothing_else(I, R);
        if (over < 0) return INPUT_FAILED;
    }
    lifted |= low;
    if (over || low) {
        memcpy(T->lifted, T->side, sizeof(double) * (size_t)I->masks);
        memset(T->side, 0, sizeof(double) * (size_t)first_discrete(I));
        if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
    }
    if (over) {
        code = bridge(I, &D, R, row, planned, T->lifted, rate);
        row = BRIDGE;
        impacts = 0;
    }
    while (!over && low) { /* what does not leave keeps others */
        if (I->directions && !meet_directions(I, -1, planned)) return INPUT_FAILED;
        end_low_bounces(I, &D, R);
        if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
        look_at_slips(I, &D, R, -1, rate);
        memcpy(rate, D.rate, sizeof(double) * (size_t)n);
        code = decide_accelerations(I, R, planned);
        low = code == REACHED_END && fall_back(I, &D, R, rate, leaves);
        if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
    }
    if (code == NO_MODE && !I->directions) {
        if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
        if (end_least_slips(I, &D, R)) code = decide_accelerations(I, R, planned);
    }
    if (code == NO_MODE && !I->directions && strike_without_closing(I, R)) {
        impacts = 1;
        code = decide_accelerations(I, R, planned);
    }
    if (code == REACHED_END) code = has_one_answer(I, &D, R);
    if (code == NO_MODE && !I->directions) { /* what is left of slips shares what feet carry as no law does */
        if (!decision_at(I, I->t, I->x, &D)) return INPUT_FAILED;
        if (end_small_slips(&D, R)) code = decide_accelerations(I, R, planned);
        if (code == REACHED_END) code = has_one_answer(I, &D, R);
    }
    if (code != REACHED_END) return code;
    int freed = let_go(I, R), begins = start_together(I, R, planned);
    if (begins < 0 || freed < 0) return INPUT_FAILED;
    lifted |= begins | freed;
    T->settling |= (begins | freed) && I->newton == WHERE_SLOW && some_radau(I);
    for (int more = 1; more;) {
        memcpy(T->later_x, I->x, sizeof(double) * (size_t)I->nx);
        project(I, I->t, I->x);
        for (long i = 0; i < I->nx; i++) {
            take_size(I, i);
            lifted |= fabs(I->x[i] - T->later_x[i]) > UNSEEN * T->size[i];
        }
        more = end_with_others(I, R);
        if (more < 0) return INPUT_FAILED;
        code = more ? decide_accelerations(I, R, planned) : code;
        if (code != REACHED_END) return code;
    }
    memset(T->carry, 0, sizeof(double) * (size_t)I->nx);
    if (!note_transition(I, row)) return OUT_OF_MEMORY;
    if (row == BRIDGE) end_bridge(I);
    else if ((impacts || lifted || T->jams) && !keep_straight(I, 0)) return OUT_OF_MEMORY;
    return REACHED_END;
}

#include "sets.h"
#include "apart.h"

/* A part of the time in which states change by their sizes [s], where it is not known how long the motion is. */
static double part_of_motion(Integrator *I) {
    struct State *T = I->state;
    double time = INFINITY;
    if (!rate_at(I, I->t, I->x, T->rate)) return 0;
    for (long i = 0; i < I->nx; i++)
        if (T->size[i] > 0 && isfinite(T->rate[i])) time = fmin(time, T->size[i] / fabs(T->rate[i]));
    return time < INFINITY ? 1e-3 * time : 1e-3;
}

static enum Code begin_modes(Integrator *I) {
    double planned = I->step > 0 ? I->step : I->end > I->t ? 1e-3 * (I->end - I->t) : part_of_motion(I), h = I->h;
    enum Code code = decide_modes(I, -1, planned);
    I->h = h;
    I->state->changed_at = -INFINITY;
    return code;
}
