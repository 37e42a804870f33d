"""Run a fuzzer from the command line; see the package."""

from __future__ import annotations

import argparse
import json
import random
import sys

from benchmarks.fuzz.program import run
from benchmarks.fuzz.targets import TARGETS

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__)
    parser.add_argument("target", choices=sorted(TARGETS))
    parser.add_argument("--executions", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(2**32))
    given = parser.parse_args()
    tally = run(given.target, range(given.seed, given.seed + given.executions)).to_dict()
    print(json.dumps({"target": given.target, "first seed": given.seed} | tally, indent=1))
    sys.exit(1 if tally["found"] else 0)
