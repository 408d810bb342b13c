"""Rows of published methods that are not eomgen's own: what a new method takes, and why these two did not stay."""

from __future__ import annotations

from eomgen.kernel.stepping.methods import EXPLICIT, ROSENBROCK, IntegrationMethod

BS3 = IntegrationMethod(
    "bs3",
    EXPLICIT,
    3,
    2,
    "P. Bogacki, L. F. Shampine, A 3(2) pair of Runge-Kutta formulas, Applied Mathematics Letters 2 (1989) 321",
    evaluations=3,
    a=((), (0.5,), (0.0, 0.75), (2.0 / 9.0, 1.0 / 3.0, 4.0 / 9.0)),
    error=(-5.0 / 72.0, 1.0 / 12.0, 1.0 / 9.0, -1.0 / 8.0),
)
RODAS4 = IntegrationMethod(
    "rodas4",
    ROSENBROCK,
    4,
    3,
    "RODAS: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.7",
    evaluations=6,
    a=(
        (),
        (0.386,),
        (0.1460747075254179, 0.0639252924745821),
        (-0.3308115036677301, 0.7111510251682848, 0.24966047849944542),
        (-4.552557186318031, 1.7101813632413319, 4.014347332103172, -0.17197150902647376),
        (2.4286337654669876, -0.38274873376478463, -1.8557203309295804, 0.5598352992273763, 0.25),
    ),
    gamma=(
        (0.25,),
        (-0.3543, 0.25),
        (-0.13360250526817555, -0.012897494731824468, 0.25),
        (1.526849173006467, -0.5336562887504572, -1.27939288425601, 0.25),
        (6.981190951785019, -2.0929300970061164, -5.870067663032753, 0.73180680825385, 0.25),
        (-2.0801894941809365, 0.5957623556766833, 1.701617798267262, -0.08851451983588043, -0.3786761399271284, 0.25),
    ),
    error=(
        -2.0801894941809365,
        0.5957623556766833,
        1.701617798267262,
        -0.08851451983588043,
        -0.3786761399271284,
        0.25,
    ),
)
