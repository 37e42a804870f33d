"""``python -m benchmarks``, from the repository's root."""

import sys

from benchmarks import single_threaded


def main() -> int:
    """Restrict the linear algebra to one thread, then run."""
    single_threaded()
    from benchmarks.command import run

    return run()


if __name__ == "__main__":
    sys.exit(main())
