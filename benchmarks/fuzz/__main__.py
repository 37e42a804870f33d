"""Run a fuzzer from the command line; see the package."""

from __future__ import annotations

import argparse
import json
import random
import sys
import tempfile
from pathlib import Path

from benchmarks.fuzz import exported
from benchmarks.fuzz.program import run
from benchmarks.fuzz.targets import TARGETS

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__)
    parser.add_argument("target", choices=sorted([*TARGETS, "exported"]))
    parser.add_argument("--executions", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(2**32))
    given = parser.parse_args()
    if given.target == "exported":
        with tempfile.TemporaryDirectory() as folder:
            exported.export(Path(folder))
            done = exported.run(exported.build(Path(folder)), given.executions, given.seed)
        print(f"first seed {given.seed}\n{done.stdout}{done.stderr[-3000:]}")
        sys.exit(done.returncode)
    tally = run(given.target, range(given.seed, given.seed + given.executions)).to_dict()
    print(json.dumps({"target": given.target, "first seed": given.seed} | tally, indent=1))
    sys.exit(1 if tally["found"] else 0)
