"""Measurements against the paper's method and against the usual library; ``make bench``."""

import os


def single_threaded() -> None:
    """Restrict the linear algebra to one thread, here and in the processes that are started.

    It is read once, when NumPy is imported.
    """
    for library in ("OMP_NUM", "OPENBLAS_NUM", "MKL_NUM", "BLIS_NUM", "VECLIB_MAXIMUM"):
        os.environ[f"{library}_THREADS"] = "1"
