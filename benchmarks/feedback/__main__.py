"""``python -m benchmarks.feedback``, from the repository's root."""

import os
import sys


def main() -> int:
    """Restrict the linear algebra to one thread, then run."""
    # Read once, when NumPy is imported; the processes that run the scenarios inherit them.
    for library in ("OMP_NUM", "OPENBLAS_NUM", "MKL_NUM", "BLIS_NUM", "VECLIB_MAXIMUM"):
        os.environ[f"{library}_THREADS"] = "1"
    from benchmarks.feedback.program import run

    return run()


if __name__ == "__main__":
    sys.exit(main())
