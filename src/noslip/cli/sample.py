"""``noslip sample``: a distribution in, motions like those that it was learned from out.

noslip sample cuts.json --count 20 --out samples/

noslip sample cuts.json --via 0.5:0.02,0.02,0 --seed 1 --out samples/

noslip sample cuts.json --given width=0.05 --mean wide.json --out samples/
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from noslip import _arguments
from noslip.cli import options, output
from noslip.constraints.check import residual_text
from noslip.errors import InputError
from noslip.recordings.formats import write_recording
from noslip.saving import load_distribution

MOST = 100_000
"""Files of one folder."""


def run(
    distribution: Annotated[
        Path,
        typer.Argument(
            help="A distribution written by noslip learn --distribution.", show_default=False
        ),
    ],
    out: Annotated[Path, options.out("the samples: a folder of CSV")],
    count: Annotated[
        int, typer.Option(metavar="N", min=1, max=MOST, help="How many samples.")
    ] = 10,
    seed: options.Seed = 0,
    via: options.Vias = [],  # noqa: B006 - typer's way to say none
    given: Annotated[
        list[str],
        options.optional(
            "NAME=X", "A number that the motions depend on, as it was named; repeatable."
        ),
    ] = [],  # noqa: B006
    mean: Annotated[
        Path | None, options.optional("FILE", "Write the mean's primitive too: .json.")
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Draw motions from a distribution: all keep its constraints, and pass what --via names.

    Warns of what lies far from all demonstrations.
    """
    options.output(mean, "--mean")
    learned = load_distribution(distribution)
    context = dict(_given(text) for text in given)
    boundaries = [options.via(text, learned.space) for text in via]
    if boundaries or context:
        learned = learned.condition(*boundaries, context=context)
    with output.progress("sampling", count) as progress:
        motions = learned.sample(count, seed=seed, progress=progress)
    out.mkdir(parents=True, exist_ok=True)
    digits = len(str(count - 1))
    for number in range(count):
        write_recording(motions[number], out / f"sample_{number:0{digits}}.csv")
    if mean is not None:
        learned.mean.save(mean)
    residual = float(np.abs(motions.constraint_residuals).max(initial=0.0))
    result: dict[str, Any] = {
        "samples": str(out),
        "count": count,
        "duration": learned.duration,
        "constraints": list(learned.system.names),
        "residual_peak": residual,
        "mean": None if mean is None else str(mean),
    }
    if as_json:
        output.print_json(result)
        return
    typer.echo(f"wrote {count} motions of {learned.duration:.4g} s to {out}")
    if learned.system.equalities.size:
        typer.echo(f"residual of all: {residual_text(residual, '1')} (peak)")
    if mean is not None:
        typer.echo(f"wrote {mean}")


def _given(text: str) -> tuple[str, float]:
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise InputError(f"--given: expected NAME=X, got {text!r}")
    try:
        return name, _arguments.finite(f"--given {name}", float(value))
    except ValueError:
        raise InputError(f"--given: {name} must be a number, got {value!r}") from None
