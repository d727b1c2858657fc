"""Set up for every test: one thread a library."""

import os

# Before torch or a BLAS is loaded; pytest reads this file first.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
