"""Draws the pictures in docs/images anew, each by the command that a reader would type.

python docs/draw.py

python docs/draw.py blade viewer

All of them take a quarter of an hour; ``improving`` is most of it.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).resolve().parent
ROOT, IMAGES = DOCS.parent, DOCS / "images"
COLORS = 256
"""Of a picture, as far apart as they can be, so that rare ones stay: it looks the same, in a third
of the bytes."""
RECORDINGS = ROOT.parent / "shared" / "data" / "contour_following"
"""Of a person who leads a tool along a contour: not part of the project."""
VIEWS = {"viewer": "cut", "viewer_arm": "arm", "viewer_shield": "shield", "viewer_found": "found"}
"""Pictures of the viewer, and what each is of."""
DEMO = {"snapshots": "numerical_example/snapshots", "demo_cuts": "excision/cuts"}
"""Pictures that ``noslip demo`` writes, and where."""
RECORDED = ("other_placement", "viewer_found")
"""Drawn from those recordings."""


def commands(scratch: Path, recordings: Path) -> dict[str, list[str]]:
    """Return what draws each picture, by its name: arguments of Python, run in the project's root.

    Each writes ``NAME.png`` into a scratch folder.
    """

    def out(name: str) -> list[str]:
        return ["--out", str(scratch / f"{name}.png")]

    examples = [path.stem for path in (ROOT / "examples").glob("*.py")]
    drawn = {name: [f"examples/{name}.py", *out(name)] for name in sorted(examples)}
    drawn["other_placement"] += ["--recordings", str(recordings)]
    for name in DEMO:
        drawn[name] = ["-m", "noslip", "demo", "--out", str(scratch / "demo")]
    drawn["improving"] = ["-m", "benchmarks.improving", *out("improving")]
    for name, of in VIEWS.items():
        shown = str(recordings / "data_demo_c_2.csv") if of == "found" else of
        drawn[name] = ["tests/viewer/picture.py", "--of", shown, *out(name)]
    return drawn


def draw(name: str, recordings: Path) -> None:
    """Draw one picture into docs/images."""
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        # The package of this checkout, and what its tests share.
        paths = [str(ROOT / "src"), str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")]
        subprocess.run(
            [sys.executable, *commands(scratch, recordings)[name]],
            cwd=ROOT,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
            check=True,
            stdout=subprocess.DEVNULL,
        )
        if name in DEMO:
            shutil.move(scratch / f"demo/{DEMO[name]}.png", scratch / f"{name}.png")
        with Image.open(scratch / f"{name}.png") as drawn:
            few = drawn.convert("RGB").quantize(
                COLORS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
            )
        few.save(IMAGES / f"{name}.png", optimize=True)


def main() -> None:
    """Draw those that are named, or all."""
    known = commands(Path(), RECORDINGS)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="pictures, by the names of their files; all")
    parser.add_argument(
        "--recordings", type=Path, default=RECORDINGS, help="folder of contour runs (%(default)s)"
    )
    given = parser.parse_args()
    if strangers := [name for name in given.names if name not in known]:
        parser.error(f"no picture {strangers[0]!r}; there are {', '.join(known)}")
    failed = []
    for name in given.names or known:
        if name in RECORDED and not given.recordings.is_dir():
            print(f"{name}: left as it is, for there are no recordings in {given.recordings}")
            continue
        print(name, flush=True)
        try:
            draw(name, given.recordings)
        except subprocess.CalledProcessError:
            failed.append(name)
    if failed:
        raise SystemExit(f"not drawn: {', '.join(failed)}")


if __name__ == "__main__":
    main()
