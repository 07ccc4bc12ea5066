/* What an expert would write: the same equations branch-free in vector lanes, a start chosen from a grid in lanes,
 * Levenberg-Marquardt with base, neighbours and several dampings in the lanes of one pass, coarse steps first.
 *
 * Compiled twice: REAL is double (8 lanes) or float (16 lanes). Prints what nlopt.c prints; the time is that of one
 * candidate. */
#include "plain.h"
#include <stdint.h>
#include <string.h>

#ifndef REAL
#define REAL double
#define INTEGER int64_t
#endif
enum { LANES = 64 / sizeof(REAL) };
typedef REAL vec __attribute__((vector_size(64)));
typedef INTEGER mask __attribute__((vector_size(64)));

static inline vec all(double value)
{
    return (vec){ 0 } + (REAL)value;
}
static inline vec pick(mask m, vec yes, vec no)
{
    return m ? yes : no;
}
static inline vec clamp(vec x, vec a)
{
    x = pick(x > a, a, x);
    return pick(x < -a, -a, x);
}
static inline vec size_of(vec x)
{
    return pick(x < 0, -x, x);
}

/* Positions and currents of all lanes at the samples. */
static void simulate_lanes(const double *command, int steps, vec bkl, vec fdj, vec *lvdt, vec *current)
{
    const double h = PERIOD / steps, k = KF + KSF, mf = k / (SNF * SNF), cf = 2 * ZF * sqrt(mf * k);
    const double mobility = 1 / (CSV + ASV * ASV * GPF / GQF), gpq = GP / GQ, leak = 1 / (1 + gpq * CLK);
    const vec half = bkl * (REAL)0.5, breakaway = fdj * (REAL)FSD, zero = all(0), one = all(1);
    vec xf = zero, vf = zero, xs = zero, x = zero, v = zero, user = zero, spool = zero, jack = zero;
    lvdt[0] = zero;
    current[0] = all(saturate(GAP * command[0], CURRENT_LIMIT));
    for (int i = 1; i < SAMPLES; i++) {
        const double rise = (command[i] - command[i - 1]) / steps;
        for (int s = 1; s <= steps; s++) {
            const vec com = all(command[i - 1] + rise * (s - 0.5));
            const vec force = clamp((com - x) * (REAL)GAP, all(CURRENT_LIMIT)) * (REAL)GM;
            vf += (force - xs * (REAL)KSF - xf * (REAL)k - vf * (REAL)cf) * (REAL)(h / (mf + 0.5 * h * cf));
            xf += vf * (REAL)h;
            vf = pick(size_of(xf) > (REAL)XFM, zero, vf);
            xf = clamp(xf, all(XFM));
            const vec push = clamp((xf - vf * (REAL)(0.5 * h)) * (REAL)GPF, all(PSR)) * (REAL)ASV;
            const vec push_sign = pick(push > 0, one, -one);
            spool = pick((spool == 0) & (size_of(push) > (REAL)FSS), push_sign, spool);
            const vec net = push - spool * (REAL)(FSS / FSDS);
            spool = pick(net * spool > 0, spool, zero);
            xs = clamp(xs + pick(spool != 0, net * (REAL)(h * mobility), zero), all(XSM));
            const vec drive = clamp((xs * (REAL)GP - v * (REAL)(gpq * AJ)) * (REAL)leak, all(PSR)) * (REAL)AJ;
            const vec drive_sign = pick(drive > 0, one, -one);
            jack = pick((jack == 0) & (size_of(drive) > breakaway), drive_sign, jack);
            const vec rest = v - jack * fdj * (REAL)(h / MJ), before = v;
            vec next = (rest + xs * (REAL)(h / MJ * AJ * leak * GP)) * (REAL)(1 / (1 + h / MJ * (AJ * AJ * gpq * leak + CJ)));
            const vec pressure = (xs * (REAL)GP - next * (REAL)(gpq * AJ)) * (REAL)leak;
            const vec limited = rest + clamp(pressure, all(PSR)) * (REAL)(h / MJ * AJ);
            next = pick(size_of(pressure) > (REAL)PSR, limited * (REAL)(1 / (1 + h / MJ * CJ)), next);
            jack = pick(next * jack > 0, jack, zero);
            v = pick(jack != 0, next, zero);
            x += (before + v) * (REAL)(0.5 * h);
            user = pick(x - user > half, x - half, user);
            user = pick(user - x > half, x + half, user);
        }
        lvdt[i] = user;
        current[i] = clamp((all(command[i]) - x) * (REAL)GAP, all(CURRENT_LIMIT));
    }
}

static vec lvdt[SAMPLES], current[SAMPLES];
static int evaluations;

static void costs(const struct record *r, int steps, const double genes[LANES][2], double *sums)
{
    vec bkl, fdj, sum = all(0);
    for (int lane = 0; lane < LANES; lane++) {
        bkl[lane] = (REAL)(genes[lane][0] * BKL_RANGE);
        fdj[lane] = (REAL)(genes[lane][1] * FDJ_RANGE);
    }
    evaluations += LANES;
    simulate_lanes(r->command, steps, bkl, fdj, lvdt, current);
    for (int i = 0; i < SAMPLES; i++) {
        const vec a = (all(r->lvdt[i]) - lvdt[i]) * (REAL)(1 / r->noise_m);
        const vec b = (all(r->current[i]) - current[i]) * (REAL)(1 / r->noise_mA);
        sum += a * a + b * b;
    }
    for (int lane = 0; lane < LANES; lane++)
        sums[lane] = (double)sum[lane];
}

/* One pass: dampings of the last normal equations in some lanes, each with its two neighbours. */
static void identify(const struct record *r, double *genes)
{
    enum { TRIALS = LANES / 3, COARSE = STEPS / 5 };
    int steps = COARSE;
    const double width = 1e-4;
    double place[LANES][2], sums[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        place[lane][0] = (lane % 4 + 0.5) / 8;
        place[lane][1] = (lane / 4 + 0.5) / (LANES / 4) / 2;
    }
    costs(r, steps, place, sums);
    int best = 0;
    for (int lane = 1; lane < LANES; lane++)
        best = sums[lane] < sums[best] ? lane : best;
    double here[2] = { place[best][0], place[best][1] }, lowest = 1e300, damping = 1e-3;
    double h[3] = { 0 }, g[2] = { 0 };
    for (int step = 0; step < 20; step++) {
        for (int t = 0; t < TRIALS; t++) {
            const double d = damping * pow(30, t), a = h[0] * (1 + d), c = h[2] * (1 + d), det = a * c - h[1] * h[1];
            const double move[2] = { det > 0 ? (g[0] * c - g[1] * h[1]) / det : 0, det > 0 ? (g[1] * a - g[0] * h[1]) / det : 0 };
            for (int j = 0; j < 3; j++) {
                for (int p = 0; p < 2; p++)
                    place[3 * t + j][p] = fmin(fmax(here[p] + move[p], 0), 1 - width);
                if (j)
                    place[3 * t + j][j - 1] += width;
            }
        }
        for (int lane = 3 * TRIALS; lane < LANES; lane++)
            memcpy(place[lane], place[0], sizeof *place);
        costs(r, steps, place, sums);
        int chosen = 0;
        for (int t = 1; t < TRIALS; t++)
            chosen = sums[3 * t] < sums[3 * chosen] ? t : chosen;
        if (sums[3 * chosen] >= lowest) {
            if (damping > 1e3 && steps == STEPS)
                break;
            damping *= 1000;
            steps = damping > 1e3 ? STEPS : steps;
            continue;
        }
        const double gain = lowest - sums[3 * chosen];
        lowest = sums[3 * chosen];
        memcpy(here, place[3 * chosen], sizeof here);
        damping *= chosen ? 10 : 0.1;
        memset(h, 0, sizeof h);
        memset(g, 0, sizeof g);
        for (int i = 0; i < SAMPLES; i++) {
            const double residual[2] = { (r->lvdt[i] - lvdt[i][3 * chosen]) / r->noise_m,
                                         (r->current[i] - current[i][3 * chosen]) / r->noise_mA };
            for (int channel = 0; channel < 2; channel++) {
                const vec *trace = channel ? current : lvdt;
                const double noise = channel ? r->noise_mA : r->noise_m;
                const double s[2] = { (trace[i][3 * chosen + 1] - trace[i][3 * chosen]) / (width * noise),
                                      (trace[i][3 * chosen + 2] - trace[i][3 * chosen]) / (width * noise) };
                h[0] += s[0] * s[0], h[1] += s[0] * s[1], h[2] += s[1] * s[1];
                g[0] += s[0] * residual[channel], g[1] += s[1] * residual[channel];
            }
        }
        if (gain < 0.05 && steps == STEPS)
            break;
        if (gain < 10 && steps != STEPS) {
            steps = STEPS;
            lowest = 1e300;
            damping = 1e-6;
        }
    }
    memcpy(genes, here, sizeof here);
}

int main(int count, char **arguments)
{
    if (count < 4)
        return 2;
    static struct record r;
    r = read_record(arguments[3]);
    double best = 1e9;
    for (int i = 0; i < 20; i++) {
        const double start = now();
        simulate_lanes(r.command, STEPS, all(atof(arguments[1])), all(atof(arguments[2])), lvdt, current);
        best = fmin(best, now() - start);
    }
    printf("simulation %.9g\n", best / LANES);
    for (int i = 0; i < SAMPLES; i++)
        printf("sample %.12g\n", (double)lvdt[i][0]);
    for (int i = 3; i < count; i++) {
        double genes[2];
        r = read_record(arguments[i]);
        evaluations = 0;
        const double start = now();
        identify(&r, genes);
        printf("answer %.9g %.9g %.9g %d\n", genes[0] * BKL_RANGE, genes[1] * FDJ_RANGE, now() - start, evaluations);
    }
    return 0;
}
