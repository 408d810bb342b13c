"""Tests of eomgen; BLAS is told to use one thread before anything imports NumPy.

Workers keep all cores busy by themselves, and BLAS threads beside them wait for each other ten times as long as they
compute.
"""

import os

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
