/* The LF equations in plain C at the source's step, 1e-5 s. Plain Euler in the order of the blocks is 250 um off on the
 * 4 mm 5 Hz sine. Command, flapper and spool at the middle of a step, the velocity implicit and the position by the
 * trapezoid cost nothing and bring that to 1.5 um. */
#ifndef PLAIN_H
#define PLAIN_H

#include "record.h"

static inline double saturate(double x, double a)
{
    return x > a ? a : x < -a ? -a : x;
}

/* Fills position and current at the samples. */
static void simulate(const double *command, double bkl, double fdj, double *lvdt, double *current)
{
    const double k = KF + KSF, mf = k / (SNF * SNF), cf = 2 * ZF * sqrt(mf * k);
    const double mobility = 1 / (CSV + ASV * ASV * GPF / GQF);
    const double gpq = GP / GQ, leak = 1 / (1 + gpq * CLK), half = 0.5 * bkl;
    double xf = 0, vf = 0, xs = 0, x = 0, v = 0, user = 0;
    int spool = 0, jack = 0;
    lvdt[0] = 0;
    current[0] = saturate(GAP * command[0], CURRENT_LIMIT);
    for (int i = 1; i < SAMPLES; i++) {
        const double rise = (command[i] - command[i - 1]) / STEPS;
        double com = command[i - 1] - 0.5 * rise;
        for (int s = 0; s < STEPS; s++) {
            com += rise;
            const double force = GM * saturate(GAP * (com - x), CURRENT_LIMIT);
            vf += STEP / (mf + 0.5 * STEP * cf) * (force - KSF * xs - k * xf - cf * vf);
            xf += STEP * vf;
            if (fabs(xf) > XFM) {
                xf = copysign(XFM, xf);
                vf = 0;
            }
            const double push = ASV * saturate(GPF * (xf - 0.5 * STEP * vf), PSR);
            if (spool == 0 && fabs(push) > FSS)
                spool = push > 0 ? 1 : -1;
            if (spool != 0) {
                const double net = push - spool * (FSS / FSDS);
                if (net * spool > 0)
                    xs = saturate(xs + STEP * mobility * net, XSM);
                else
                    spool = 0;
            }
            const double drive = AJ * saturate((GP * xs - gpq * AJ * v) * leak, PSR);
            if (jack == 0 && fabs(drive) > FSD * fdj)
                jack = drive > 0 ? 1 : -1;
            if (jack != 0) {
                const double before = v, rest = v - STEP / MJ * jack * fdj;
                v = (rest + STEP / MJ * AJ * leak * GP * xs) / (1 + STEP / MJ * (AJ * AJ * gpq * leak + CJ));
                const double pressure = (GP * xs - gpq * AJ * v) * leak;
                if (fabs(pressure) > PSR)
                    v = (rest + STEP / MJ * AJ * copysign(PSR, pressure)) / (1 + STEP / MJ * CJ);
                if (v * jack <= 0) {
                    v = 0;
                    jack = 0;
                }
                x += 0.5 * STEP * (before + v);
            }
            if (x - user > half)
                user = x - half;
            else if (user - x > half)
                user = x + half;
        }
        lvdt[i] = user;
        current[i] = saturate(GAP * (command[i] - x), CURRENT_LIMIT);
    }
}

/* Sum of squares in units of the noise. */
static inline double cost(const struct record *r, double bkl, double fdj)
{
    double lvdt[SAMPLES], current[SAMPLES], sum = 0;
    simulate(r->command, bkl, fdj, lvdt, current);
    for (int i = 0; i < SAMPLES; i++) {
        const double a = (r->lvdt[i] - lvdt[i]) / r->noise_m, b = (r->current[i] - current[i]) / r->noise_mA;
        sum += a * a + b * b;
    }
    return sum;
}

#endif
