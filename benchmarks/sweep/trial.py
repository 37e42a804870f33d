"""Carries jobs out, judges each, and tries the remedies that were named."""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.sweep import judge
from benchmarks.sweep.jobs import Goal, Job, job
from benchmarks.sweep.judge import NUMBER, Asked, Facts
from benchmarks.sweep.program import Said, files, noslip
from benchmarks.sweep.track import Floats, Track, quaternion, times

FINE, FINEST = 1e-3, 2000
"""Step of a control loop (s), and the most steps of a motion that is looked at so closely."""


@dataclass
class Stage:
    """One primitive that was asked for: by learning, or by adapting.

    Attributes
    ----------
    said : Said
        What was said when it was made, or why it was not.
    facts : Facts or None
        None if there is no primitive.
    """

    said: Said
    facts: Facts | None


@dataclass
class Verdict:
    """What became of a job.

    Attributes
    ----------
    outcome : str
        "done", "told" (done, and something had to be known) or "refused".
    sentences : list of (kind, whether true)
        None of what no file tells.
    remedies : list of (kind, whether true)
    contradictions : list of str
    seconds : float
        Of the longest command.
    """

    seed: int
    outcome: str = "done"
    sentences: list[tuple[str, bool | None]] = field(default_factory=list)
    remedies: list[tuple[str, bool]] = field(default_factory=list)
    contradictions: list[str] = field(default_factory=list)
    seconds: float = 0.0


# ---------------------------------------------------------------- carrying out


def stages(asked: Job, folder: Path) -> Iterator[Stage]:
    """Learn, then adapt; ends where no primitive is made."""
    names = []
    for k, recording in enumerate(asked.recordings):
        names.append(folder / f"recording{k}.csv")
        recording.write(names[-1])
    rules = [word for rule in asked.rules for word in ("--constraint", rule.text)]
    learned = folder / "learned.json"
    said = noslip("learn", *names, "--out", learned, *rules, *asked.options)
    if said.code:
        yield Stage(said, None)
        return
    ends = np.mean([recording.positions[-1] for recording in asked.recordings], axis=0)
    fixed = asked.noise == 0 and not any(rule.of_poses for rule in asked.rules)
    wanted = Asked(
        asked.rules,
        ends if fixed else None,
        None,
        (),
        float(np.mean([recording.duration for recording in asked.recordings])),
        is_duration_given=False,
    )
    said, motions = _rolled_out(said, learned, wanted.duration)
    noise = 6 * asked.noise
    yield Stage(said, Facts(wanted, motions, asked.recordings, noise, is_learned=True))
    if asked.goal is None:
        return
    before, adapted = motions[0], folder / "adapted.json"
    wanted, words = _asked(asked, asked.goal, before)
    said = noslip("adapt", learned, "--out", adapted, *words)
    if said.code:
        yield Stage(said, None)
        return
    said, motions = _rolled_out(said, adapted, wanted.duration)
    yield Stage(said, Facts(wanted, motions, (before,), 0.0, is_learned=False))


def _rolled_out(said: Said, primitive: Path, duration: float) -> tuple[Said, tuple[Track, ...]]:
    """Motions of a primitive by default and finely; what is said of them belongs to it."""
    motions, told = [], list(said.warnings)
    duration = noslip_duration(said, duration)
    for name, step in (("motion", None), ("fine", max(FINE, duration / FINEST))):
        path = primitive.with_name(f"{primitive.stem}_{name}.csv")
        if step is not None and motions and step >= np.diff(motions[0].times).max():
            continue
        fine = [] if step is None else ["--time-step", repr(step)]
        rolled = noslip("rollout", primitive, "--out", path, *fine)
        told += [s for s in rolled.sentences if s not in told]
        if path.exists():
            motions.append(Track.read(path))
    return replace(said, warnings=tuple(told)), tuple(motions)


def noslip_duration(said: Said, otherwise: float) -> float:
    """Seconds that a primitive takes, as it says."""
    return float(said.result.get("duration_s", said.result.get("duration", otherwise)))


def _asked(of: Job, goal: Goal, before: Track) -> tuple[Asked, list[str]]:
    """What a goal means for a primitive, and its words on the command line."""
    position = before.positions[-1] + before.length * goal.shift
    turned = times(quaternion(goal.turn), before.quaternions[-1])
    given = goal.seconds or (goal.duration and goal.duration * before.duration)
    duration = given or before.duration
    vias = tuple((at, before.at(at)[0][0] + before.length * shift) for at, shift in goal.vias)
    words = ["--goal-position", _list(position), "--goal-rotation", _list(turned)]
    if given:
        words += ["--duration", repr(duration)]
    for at, point in vias:
        words += ["--via", f"{at!r}:{_list(point)}"]
    is_given = given is not None
    return Asked(of.rules, position, turned, vias, duration, is_duration_given=is_given), words


def _list(values: Floats) -> str:
    return ",".join(map(repr, np.asarray(values).tolist()))


# ---------------------------------------------------------------- judging


def tried(asked: Job) -> Verdict:
    """Carry a job out, and judge it."""
    verdict = Verdict(asked.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for stage in stages(asked, folder):
            said = stage.said
            verdict.seconds = max(verdict.seconds, said.seconds)
            verdict.contradictions += _misconduct(said, folder)
            facts = stage.facts
            if facts is None:
                verdict.outcome = "refused"
                kinds = [kind for kind, pattern in judge.REFUSALS if re.search(pattern, said.error)]
                kinds += [
                    kind for kind, pattern, _ in judge.SENTENCES if re.search(pattern, said.error)
                ]
                verdict.sentences.append((kinds[0] if kinds else "unread", None))
                if not kinds and said.code > 0:
                    verdict.contradictions.append(f"unread: {said.error}")
            else:
                if said.warnings:
                    verdict.outcome = "told"
                for kind, is_true, sentence in judge.readings(facts, said.sentences):
                    verdict.sentences.append((kind, is_true))
                    if is_true is False or kind == "unread":
                        verdict.contradictions.append(f"{kind}: {sentence}")
                verdict.contradictions += judge.silences(facts, said.sentences)
                verdict.contradictions += _figures(facts, said)
            for kind, is_true, sentence in _remedies(asked, stage, folder):
                verdict.remedies.append((kind, is_true))
                if not is_true:
                    verdict.contradictions.append(f"remedy: {sentence}")
    return verdict


def _misconduct(said: Said, folder: Path) -> Iterator[str]:
    """What no command may do, whatever it is asked."""
    if said.code < 0 or said.other:
        yield f"{said.command.split()[0]}: {said.other[-2000:]}"
    elif said.code and not said.error:
        yield f"{said.command.split()[0]}: exits with {said.code} and says nothing"
    if said.code:
        out = "learned.json" if said.command.startswith("learn") else "adapted.json"
        if out in files(folder):
            yield f"{out} was written by a command that failed"


def _figures(facts: Facts, said: Said) -> Iterator[str]:
    """Figures that were printed as JSON and are not those of the motion."""
    motion, result = facts.motion, said.result

    def differs(name: str, told: float | None, found: float, least: float = 1e-9) -> Iterator[str]:
        if told is not None and abs(told - found) > judge.AGREES * abs(found) + least:
            yield f"{name} is told as {told:.6g}, found as {found:.6g}"

    if facts.is_learned:
        for told, reference in zip(result["demonstrations"], facts.references, strict=True):
            off, turned = motion.off(reference)
            if not facts.noise:
                # The program goes along splines between samples, this along chords.
                bends = np.diff(reference.positions, 2, axis=0)
                least = float(np.linalg.norm(bends, axis=1).max()) / 4 + 1e-9
                yield from differs("path_error", told["path_error"], off.max(), least)
                yield from differs("end_error", told["end_error"], off[-1], least)
                yield from differs("rotation_rms", told["rotation_rms"], _rms(turned), 1e-3)
            yield from differs("speed_peak", told["speed_peak"], judge.peak(motion))
        least = result["least_margins"]
        for rule in facts.asked.rules:
            if rule.is_limit and rule.name in least and rule.name != "acceleration-limit":
                margin = float(rule.values(motion).min())
                yield from differs(f"margin of {rule.name}", least[rule.name], margin, 1e-6)
    else:
        off, turned = (values[0] for values in next(iter(facts.misses()))[1:3])
        yield from differs("end_position_error_m", result["end_position_error_m"], off)
        turn = result["end_rotation_error_deg"]
        yield from differs("end_rotation_error_deg", turn, float(np.degrees(turned)), 1e-5)
        yield from differs(
            "angular_speed_peak", result["angular_speed_peak_rad_s"], judge.turn_peak(motion), 1e-6
        )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


_MISSES = r"the motion (ends|passes|breaks)|no motion found|no trajectory near"
"""Said of a job that is not done."""
_REMEDIES = (
    ("shared metric", r"metric 'shared' mends that", _MISSES),
    ("longer duration", rf"a duration of {NUMBER} s, not {NUMBER}, mends that", _MISSES),
    ("default step", rf"the default step of {NUMBER} s mends that", _MISSES),
    ("without limits", r"; ([\w, -]+) in its way: loosen that, or choose", _MISSES),
    (
        "without limits, on its way",
        r"; ([\w, -]+) in its way: loosen that, or demo",
        r"the primitive leaves",
    ),
    (
        "duration for a limit",
        rf"along its path the motion takes {NUMBER} s; give it that",
        r"cannot be kept in",
    ),
    ("duration for its speed", rf"a duration of {NUMBER} s or more mends that", r"times as fast"),
    ("more basis functions", r"give more basis functions, or none", r"basis functions leave"),
    (
        "priority",
        r"no motion found that keeps ([\w, -]+) between these ",
        r"no motion found that keeps",
    ),
)
"""Kinds of remedies: a name, how to know one, and what is not said any more where it was taken."""


def _remedies(asked: Job, stage: Stage, folder: Path) -> Iterator[tuple[str, bool, str]]:
    """Of each remedy that was named: its kind, whether it is one, and the sentence."""
    for sentence in stage.said.sentences:
        for kind, pattern, mended in _REMEDIES:
            if found := re.search(pattern, sentence):
                done = _followed(asked, kind, found, stage, folder)
                yield kind, not any(re.search(mended, s) for s in done), sentence


def _followed(
    asked: Job, kind: str, found: re.Match[str], stage: Stage, folder: Path
) -> tuple[str, ...]:
    """What is said where a remedy is taken."""
    is_learned, options = stage.said.command.startswith("learn"), asked.options
    if stage.facts is not None and kind in ("longer duration", "default step"):
        # There is a primitive: it can be run otherwise.
        primitive = folder / ("learned.json" if is_learned else "adapted.json")
        words = ["--duration", found.group(1)] if kind == "longer duration" else []
        return noslip("rollout", primitive, "--out", folder / "again.csv", *words).sentences
    if kind == "shared metric":
        changed = replace(asked, options=(*_without(options, "--metric"), "--metric", "shared"))
    elif kind == "more basis functions":
        changed = replace(asked, options=_without(options, "--basis-functions"))
    elif kind.startswith("without limits"):
        changed = asked.without(*found.group(1).split(", "))
    elif kind == "priority":
        names = found.group(1).split(", ")
        soft = tuple(r.softened() if r.name in names else r for r in asked.rules)
        changed = replace(asked, rules=soft)
    elif is_learned:
        changed = asked.slower(float(found.group(1)) / asked.recordings[0].duration)
    else:
        assert asked.goal is not None
        changed = replace(asked, goal=replace(asked.goal, seconds=float(found.group(1))))
    if is_learned:
        changed = replace(changed, goal=None)
    with tempfile.TemporaryDirectory() as name:
        *_, last = stages(changed, Path(name))
    return last.said.sentences


def _without(options: Sequence[str], name: str) -> tuple[str, ...]:
    if name not in options:
        return tuple(options)
    k = options.index(name)
    return (*options[:k], *options[k + 2 :])


# ---------------------------------------------------------------- all of them


def main(arguments: Sequence[str] | None = None) -> int:
    """Try many jobs; exit with 1 if anything that was said is not so."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sweep", description=__doc__)
    parser.add_argument("--jobs", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0, help="of the first job")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, help="a line of JSON for each job")
    chosen = parser.parse_args(arguments)
    # Each has rules of its own, and is done once.
    os.environ["NOSLIP_COMPILE"] = "0"
    seeds = range(chosen.seed, chosen.seed + chosen.jobs)
    found = []
    with multiprocessing.Pool(chosen.processes) as pool:
        for verdict in pool.imap_unordered(of_seed, seeds):
            found.append(verdict)
            for text in verdict.contradictions:
                print(f"\njob {verdict.seed}: {text}", flush=True)
            print(f"\r{len(found)} of {len(seeds)}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    if chosen.out is not None:
        lines = [json.dumps(vars(v)) for v in sorted(found, key=lambda v: v.seed)]
        chosen.out.write_text("\n".join(lines) + "\n")
    print("\n".join(summary(found)))
    return int(any(verdict.contradictions for verdict in found))


def of_seed(seed: int) -> Verdict:
    """Try one job."""
    return tried(job(seed))


def summary(found: Sequence[Verdict]) -> list[str]:
    """What became of all jobs, and how much of what was said could be held against files."""
    outcomes = Counter(verdict.outcome for verdict in found)
    wrong = sum(bool(verdict.contradictions) for verdict in found)
    lines = [
        f"{len(found)} jobs: " + ", ".join(f"{n} {name}" for name, n in sorted(outcomes.items())),
        f"{wrong} contradicted; longest command {max(v.seconds for v in found):.1f} s",
        "",
        f"{'said':34} {'times':>6} {'true':>6} {'false':>6} {'no file tells':>14}",
    ]
    for title, pairs in (
        ("", [pair for verdict in found for pair in verdict.sentences]),
        ("remedy: ", [pair for verdict in found for pair in verdict.remedies]),
    ):
        for kind in sorted({kind for kind, _ in pairs}):
            kinds = [is_true for k, is_true in pairs if k == kind]
            counts = [sum(one is wanted for one in kinds) for wanted in (True, False, None)]
            lines.append(
                f"{title + kind:34} {len(kinds):6} {counts[0]:6} {counts[1]:6} {counts[2]:14}"
            )
    return lines
