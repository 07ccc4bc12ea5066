/* Plain C and NLopt: DIRECT-L for the basin, SBPLX for its bottom, on normalised parameters.
 *
 * Prints the time of a simulation and its position samples for the first record, then a line for each record:
 * backlash, friction, seconds, evaluations. */
#include "plain.h"
#include <nlopt.h>

static int evaluations;

static double objective(unsigned n, const double *genes, double *gradient, void *data)
{
    (void)n, (void)gradient;
    evaluations++;
    return cost(data, genes[0] * BKL_RANGE, genes[1] * FDJ_RANGE);
}

static void search(nlopt_algorithm algorithm, double tolerance, int budget, double *genes, struct record *r)
{
    double lowest;
    nlopt_opt opt = nlopt_create(algorithm, 2);
    nlopt_set_lower_bounds1(opt, 0);
    nlopt_set_upper_bounds1(opt, 1);
    nlopt_set_min_objective(opt, objective, r);
    nlopt_set_xtol_rel(opt, 0);
    nlopt_set_xtol_abs1(opt, tolerance);
    nlopt_set_initial_step1(opt, 0.02);
    nlopt_set_maxeval(opt, budget);
    nlopt_optimize(opt, genes, &lowest);
    nlopt_destroy(opt);
}

int main(int count, char **arguments)
{
    if (count < 4)
        return 2;
    const double truth[2] = { atof(arguments[1]), atof(arguments[2]) };
    static struct record r;
    static double lvdt[SAMPLES], current[SAMPLES];
    r = read_record(arguments[3]);
    double best = 1e9;
    for (int i = 0; i < 20; i++) {
        const double start = now();
        simulate(r.command, truth[0], truth[1], lvdt, current);
        best = fmin(best, now() - start);
    }
    printf("simulation %.9g\n", best);
    for (int i = 0; i < SAMPLES; i++)
        printf("sample %.12g\n", lvdt[i]);
    for (int i = 3; i < count; i++) {
        r = read_record(arguments[i]);
        double genes[2] = { 0.5, 0.5 };
        evaluations = 0;
        const double start = now();
        /* DIRECT's boxes shrink by thirds: 60 evaluations find the basin, SBPLX is then the faster one. */
        search(NLOPT_GN_DIRECT_L, 1e-3, 60, genes, &r);
        search(NLOPT_LN_SBPLX, 1e-5, 400, genes, &r);
        printf("answer %.9g %.9g %.9g %d\n", genes[0] * BKL_RANGE, genes[1] * FDJ_RANGE, now() - start, evaluations);
    }
    return 0;
}
