"""Set up for every test: compiled loops that are never outdated, one thread a library."""

import os
from pathlib import Path

from thesis_lib.book.compiled import numba_cache

# Before numba, torch or a BLAS is loaded; pytest reads this file first.
os.environ.setdefault("NUMBA_CACHE_DIR", str(numba_cache(Path(__file__).resolve().parents[1])))
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
