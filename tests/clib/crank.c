/* A crank and slider: its rod and its slider follow the crank, g = (r cos(q0) + l cos(q1) - q2, r sin(q0) + l sin(q1)). */
#include "eom.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "precision.h"
#include "state_one.h"
#include "constraint_checks.h"
#include "dependent_coordinates.h"

enum { CRANK, ROD, SLIDER, N, M = 2 };

static const double r = 0.3, l = 0.7;

static int residual(const double *h, const double *q, double *g)
{
    (void)h;
    g[0] = r * cos(q[CRANK]) + l * cos(q[ROD]) - q[SLIDER];
    g[1] = r * sin(q[CRANK]) + l * sin(q[ROD]);
    return 0;
}

static int jacobian(const double *h, const double *q, double *J)
{
    const double rows[M * N] = { -r * sin(q[CRANK]), -l * sin(q[ROD]), -1.0, r * cos(q[CRANK]), l * cos(q[ROD]), 0.0 };
    (void)h;
    memcpy(J, rows, sizeof rows);
    return 0;
}

static int bias(const double *h, const double *q, const double *v, double *out)
{
    (void)h;
    out[0] = -r * cos(q[CRANK]) * v[CRANK] * v[CRANK] - l * cos(q[ROD]) * v[ROD] * v[ROD];
    out[1] = -r * sin(q[CRANK]) * v[CRANK] * v[CRANK] - l * sin(q[ROD]) * v[ROD] * v[ROD];
    return 0;
}

/* dependent: the crank's angle, velocity and acceleration, a guess of the rod and the slider, the most steps; what follows is
 * printed, out: 3 N, then the derivatives, then g.  checks: violations and rates, a velocity; the status is printed. */
int main(int count, char **words)
{
    double x[8] = { 0.0 };
    for (int i = 2; i < count && i < 10; ++i) { x[i - 2] = atof(words[i]); }
    if (count > 1 && strcmp(words[1], "dependent") == 0) {
        const eom_constraint constraint = { residual, jacobian, bias, 1e-12, 1e-11 };
        double chart[N + M + 1 + N * (M + 1)] = { 0.0, 1.0, 1.0, 1.0, 1.0 }, out[3 * N + M * N + M], work[2 * M];
        const double q[N] = { x[0], x[3], x[4] }, v[N] = { x[1], 9.0, 9.0 }, a[N] = { x[2], 9.0, 9.0 };
        int index[2 * M];
        chart[N + M] = x[5];
        eom_solve_dependent(&constraint, N, M, NULL, q, v, a, chart, out, work, index);
        for (int i = 0; i < 3 * N + M * N + M; ++i) { printf("%.17g ", out[i]); }
    } else if (count > 1 && strcmp(words[1], "constraints") == 0) {
        const double v[N] = { 0.0, x[4], 0.0 };
        printf("%d", eom_check_constraints(N, M, 1e-9, v, x));
    } else {
        double found[2 * N + 5 * M + N] = { 0.0 };
        const double v[N] = { 0.0 }, a[N] = { x[5], 0.0, 0.0 };
        found[N + 3 * M + 1] = x[0]; /* of the second constraint, by accelerations */
        found[N + 4 * M + 1] = x[1]; /* and by velocities */
        found[N + 5 * M + 2] = x[2]; /* a force that no drive gives */
        found[2 * N + 5 * M] = x[3]; /* one that is needed */
        found[N + M] = x[4];         /* a violation */
        printf("%d", eom_check_drives(N, M, 1e-9, v, a, found));
    }
    return 0;
}
