/* A record as the driver writes it, and the parameters of the actuator (appendix A of the source). */
#ifndef RECORD_H
#define RECORD_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

/* Samples, 1 ms apart; steps of the model in a sample. */
enum { SAMPLES = 1000, STEPS = 100 };
#define PERIOD 1e-3
#define STEP (PERIOD / STEPS)

#define GAP 1e4
#define CURRENT_LIMIT 10.0
#define GM 0.01
#define KF 40.0
#define KSF 160.0
#define SNF 2513.0
#define ZF 0.6
#define XFM 1e-4
#define GPF 1e11
#define GQF 0.014
#define PSR 2e7
#define ASV 0.7e-4
#define CSV 1000.0
#define FSS 7.0
#define FSDS 1.2
#define XSM 0.6e-3
#define GP 1e11
#define GQ 0.2
#define CLK 1e-13
#define AJ 8e-4
#define CJ 50.0
#define MJ 20.0
#define XJM 0.2
#define FSD 2.0

/* Ranges of the search: backlash (m), friction (N). */
#define BKL_RANGE 1.5e-3
#define FDJ_RANGE 8000.0

struct record {
    double noise_m, noise_mA;
    double command[SAMPLES], lvdt[SAMPLES], current[SAMPLES];
};

static struct record read_record(const char *path)
{
    struct record r;
    FILE *file = fopen(path, "r");
    if (!file || fscanf(file, "%lf %lf", &r.noise_m, &r.noise_mA) != 2) {
        fprintf(stderr, "%s: not a record\n", path);
        exit(3);
    }
    for (int i = 0; i < SAMPLES; i++)
        if (fscanf(file, "%lf %lf %lf", &r.command[i], &r.lvdt[i], &r.current[i]) != 3) {
            fprintf(stderr, "%s: sample %d\n", path, i);
            exit(3);
        }
    fclose(file);
    return r;
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

#endif
