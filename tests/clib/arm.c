/* Poses and Jacobians of an arm written by hand, one state after the other and in lanes: link lengths in m, then q of each state;
 * per frame and state the pose and the Jacobian are printed, and whether lanes have the same bits. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "lanes.h"

#if defined(FOLLOWS)
enum { FRAMES = 3, N = 2, ARM_TURNS = 0 };
#else
enum { FRAMES = 3, N = 3, ARM_TURNS = 2 };
#endif

#define EOM_FRAMES arm_frames
#include "frames.h"

/* Nodes: the base, the upper link, the forearm, and a frame of each; angles are of q[0] and of the forearm. */
static const EOM_TABLES_OF_FRAMES(6, 5, 2, 3, 2, 3) arm_frames = {
    .run_of = { 0, 0, 1, 2, 3, 4 },
    .behind = { -1, 1, 0, 1, 2 },
    .turned = { 0, 1, 1, 0, 0, 0 },
    .first = { 0, 1, 0, 0, 0 },
    .place = { 0, 1 },
    .body_of = { -1, 0, 1 },
    .parent = { -1, 0 },
    .first_axis = { 0, 1 },
    .count = { 1, 2 },
    .is_rotation = { 1, 0, 1 },
#if defined(FOLLOWS)
    .column = { 0, 1, 0 },
    .has_columns = 1,
#endif
    .first_frame = 3,
    .angles = 2,
    .n = N,
};

#include "state_one.h"
#include "arm.h"
#include "state_lanes.h"
#include "arm.h"

int main(int count, char **words)
{
    double h[2] = { atof(words[1]), atof(words[2]) };
    for (int frame = 0; frame < FRAMES; ++frame) {
        for (int first = 3; first + N <= count; first += N) {
            double q[N], pose[16], jacobian[6 * N];
            lanes many[N], poses[16], jacobians[6 * N];
            int same = 1;
            for (int i = 0; i < N; ++i) {
                q[i] = atof(words[first + i]);
                many[i] = EOM_ALL_LANES(q[i]);
            }
            eom_arm(h, q, frame, pose, jacobian);
            eom_arm_lanes(h, many, frame, poses, jacobians);
            for (int l = 0; l < EOM_LANES; ++l) {
                for (int i = 0; i < 16; ++i) { same &= EOM_LANE(poses[i], l) == pose[i]; }
                for (int i = 0; i < 6 * N; ++i) { same &= EOM_LANE(jacobians[i], l) == jacobian[i]; }
            }
            for (int i = 0; i < 16; ++i) { printf("%.17g ", pose[i]); }
            for (int i = 0; i < 6 * N; ++i) { printf("%.17g ", jacobian[i]); }
            printf("%d\n", same);
        }
    }
    return 0;
}
