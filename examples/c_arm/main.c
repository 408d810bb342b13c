/* The PUMA 560 on its way to a pose under PD control: energy and position of the flange over time, as CSV. */
#include <eomgen/puma560.h>

#include <math.h>
#include <stdio.h>

enum { N = PUMA560_DOF, STEPS = 1000, EVERY = 50, STATES = STEPS / EVERY + 1 };

int main(void)
{
    static const double start[N] = { 0.0, -0.5, 0.5, 0.0, 0.0, 0.0 }, rest[N] = { 0.0 };
    static const double target[N] = { 0.8, -1.0, 1.2, 0.3, -0.4, 0.6 };
    static const double feedforward[N] = { 0.0 };
    static const double kp[N] = { 400.0, 900.0, 400.0, 60.0, 60.0, 60.0 };
    static const double kd[N] = { 40.0, 120.0, 40.0, 6.0, 6.0, 6.0 };
    const double dt = 1e-3;

    const double parameters[PUMA560_PARAMETERS] = PUMA560_DEFAULTS;
    double h[PUMA560_HOISTED]; /* what depends on parameters alone */
    puma560_setup(parameters, h);

    double q[STATES * N], v[STATES * N];
    const puma560_drive drive = { .u = feedforward, .kp = kp, .kd = kd, .target = target };
    const long long failed = puma560_rollout(h, start, rest, &drive, dt, STEPS, EVERY, 0, q, v);
    if (failed >= 0) {
        fprintf(stderr, "no acceleration in step %lld\n", failed / N);
        return 1;
    }

    puts("t,kinetic,potential,x,y,z");
    for (int i = 0; i < STATES; ++i) {
        double energy[2], pose[16];
        puma560_energy(h, q + i * N, v + i * N, energy);
        puma560_frame_pose(h, q + i * N, PUMA560_FRAME_tcp, pose);
        if (!isfinite(energy[0])) {
            fprintf(stderr, "the steps are too long\n");
            return 1;
        }
        printf("%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n", i * EVERY * dt, energy[0], energy[1], pose[3], pose[7], pose[11]);
    }
    return 0;
}
