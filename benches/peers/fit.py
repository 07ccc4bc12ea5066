"""SciPy's least_squares on a numba model: the LF equations as plain.h steps them.

Prints what nlopt.c prints. Compilation is not timed.
"""

import sys
from math import sqrt
from time import perf_counter

import numpy as np
from numba import njit
from scipy.optimize import least_squares

SAMPLES, STEPS, PERIOD = 1000, 100, 1e-3
RANGE = np.array([1.5e-3, 8000.0])


@njit(cache=True, fastmath=True)
def saturate(x, a):
    return min(max(x, -a), a)


@njit(cache=True, fastmath=True)
def simulate(command, bkl, fdj, lvdt, current):
    step = PERIOD / STEPS
    k = 200.0
    mf = k / 2513.0**2
    cf = 2 * 0.6 * sqrt(mf * k)
    mobility = 1 / (1000.0 + 0.7e-4**2 * 1e11 / 0.014)
    gpq = 1e11 / 0.2
    leak = 1 / (1 + gpq * 1e-13)
    half = 0.5 * bkl
    xf = vf = xs = x = v = user = 0.0
    spool = jack = 0.0
    lvdt[0] = 0.0
    current[0] = saturate(1e4 * command[0], 10.0)
    for i in range(1, SAMPLES):
        rise = (command[i] - command[i - 1]) / STEPS
        com = command[i - 1] - 0.5 * rise
        for _ in range(STEPS):
            com += rise
            force = 0.01 * saturate(1e4 * (com - x), 10.0)
            vf += step / (mf + 0.5 * step * cf) * (force - 160.0 * xs - k * xf - cf * vf)
            xf += step * vf
            if abs(xf) > 1e-4:
                xf = saturate(xf, 1e-4)
                vf = 0.0
            push = 0.7e-4 * saturate(1e11 * (xf - 0.5 * step * vf), 2e7)
            if spool == 0.0 and abs(push) > 7.0:
                spool = 1.0 if push > 0 else -1.0
            if spool != 0.0:
                net = push - spool * (7.0 / 1.2)
                if net * spool > 0:
                    xs = saturate(xs + step * mobility * net, 0.6e-3)
                else:
                    spool = 0.0
            drive = 8e-4 * saturate((1e11 * xs - gpq * 8e-4 * v) * leak, 2e7)
            if jack == 0.0 and abs(drive) > 2.0 * fdj:
                jack = 1.0 if drive > 0 else -1.0
            if jack != 0.0:
                before = v
                rest = v - step / 20.0 * jack * fdj
                gain = step / 20.0 * 8e-4
                v = (rest + gain * leak * 1e11 * xs) / (1 + gain * 8e-4 * gpq * leak + step / 20.0 * 50.0)
                pressure = (1e11 * xs - gpq * 8e-4 * v) * leak
                if abs(pressure) > 2e7:
                    v = (rest + gain * saturate(pressure, 2e7)) / (1 + step / 20.0 * 50.0)
                if v * jack <= 0:
                    v = 0.0
                    jack = 0.0
                x += 0.5 * step * (before + v)
            if x - user > half:
                user = x - half
            elif user - x > half:
                user = x + half
        lvdt[i] = user
        current[i] = saturate(1e4 * (command[i] - x), 10.0)


def read(path):
    with open(path) as file:
        noise = np.array([float(value) for value in file.readline().split()])
        return noise, np.loadtxt(file)


def identify(noise, record):
    command, measured = np.ascontiguousarray(record[:, 0]), record[:, 1:]
    out = np.zeros((2, SAMPLES))

    def residual(genes):
        simulate(command, genes[0] * RANGE[0], genes[1] * RANGE[1], out[0], out[1])
        return np.concatenate(((measured[:, 0] - out[0]) / noise[0], (measured[:, 1] - out[1]) / noise[1]))

    # A cold start: the best of a coarse grid, then the method of least squares from there.
    grid = [np.array([b, f]) for b in (0.07, 0.2, 0.45) for f in (0.03, 0.1, 0.3, 0.7)]
    start = min(grid, key=lambda genes: np.sum(residual(genes) ** 2))
    found = least_squares(residual, start, bounds=(0, 1), diff_step=1e-4, xtol=1e-6, ftol=1e-8, x_scale=(0.1, 0.1))
    return found.x, len(grid) + found.nfev + 2 * found.njev


def main():
    truth = float(sys.argv[1]), float(sys.argv[2])
    records = [read(path) for path in sys.argv[3:]]
    out = np.zeros((2, SAMPLES))
    command = np.ascontiguousarray(records[0][1][:, 0])
    times = []
    for _ in range(20):
        start = perf_counter()
        simulate(command, *truth, out[0], out[1])
        times.append(perf_counter() - start)
    print(f"simulation {min(times):.9g}")
    for value in out[0]:
        print(f"sample {value:.12g}")
    identify(*records[0])
    for record in records:
        start = perf_counter()
        genes, evaluations = identify(*record)
        seconds = perf_counter() - start
        bkl, fdj = genes * RANGE
        print(f"answer {bkl:.9g} {fdj:.9g} {seconds:.9g} {evaluations}")


main()
