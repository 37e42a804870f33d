"""Holds what was said of a motion, and what was not, against what its file tells."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.sweep.rules import Rule
from benchmarks.sweep.track import Floats, Track, angles

NUMBER = r"([-+]?[\d.]+(?:e[-+]?\d+)?)"
AGREES = 0.02
"""Share by which a number that was told may differ from what is found."""
TOLD, TOLD_TURN = 1e-3, np.radians(0.1)
"""Share of the path, and turn for each whole turn, by which no motion may miss its goal untold."""
BROKEN, SLIPS = 1e-6, 1e-9
"""Violation of a limit (in its unit), and residual of an equality over the largest speed, or 1,
that no motion may have untold."""
LEAVES, LEAVES_MEAN = 0.05, 0.25
"""Share of the path by which no primitive may leave a demonstration, or one of several, untold."""
HURRIES = 2.0
"""How many times as fast as before no motion may be untold, unless its duration was asked for."""
TURNS = 67.5
"""Degrees (rms) by which no constraint may turn the tool untold."""


@dataclass(frozen=True)
class Asked:
    """What a motion was to do.

    Attributes
    ----------
    rules : tuple of Rule
    position, quaternion : array or None
        Of the goal.
    vias : tuple of (fraction, position)
    duration : float
        Seconds, of what was there before or as asked.
    is_duration_given : bool
    """

    rules: tuple[Rule, ...]
    position: Floats | None
    quaternion: Floats | None
    vias: tuple[tuple[float, Floats], ...]
    duration: float
    is_duration_given: bool


@dataclass(frozen=True)
class Facts:
    """What the files tell.

    Attributes
    ----------
    motions : tuple of Track
        At the default step, and at a fine one.
    references : tuple of Track
        The demonstrations, or the motion before it was adapted.
    noise : float
        Of the demonstrations: by how much a distance to them may differ (m).
    is_learned : bool
        From demonstrations; else adapted.
    """

    asked: Asked
    motions: tuple[Track, ...]
    references: tuple[Track, ...]
    noise: float
    is_learned: bool

    @property
    def motion(self) -> Track:
        """At the default step."""
        return self.motions[0]

    def misses(self) -> Iterator[tuple[str, list[float], list[float]]]:
        """Of each place: its name, and each motion's distance (m) and angle (rad) from it."""
        places = [("its goal", 1.0, self.asked.position, self.asked.quaternion)]
        places += [(f"via {at:g}", at, position, None) for at, position in self.asked.vias]
        for name, at, position, quaternion in places:
            off, turned = [], []
            for motion in self.motions:
                here, held = motion.at(at)
                off.append(0.0 if position is None else float(np.linalg.norm(here[0] - position)))
                turned.append(0.0 if quaternion is None else float(angles(held[0], quaternion)))
            yield name, off, turned

    def breaks(self, rule: Rule) -> float:
        """By how much a limit is broken, once the motion is inside; how far if it never is."""
        worst = 0.0
        for motion in self.motions:
            margins = rule.values(motion)
            inside = np.maximum.accumulate(margins >= -BROKEN)
            if not inside.any(axis=0).all():
                worst = max(worst, float(-margins[-1].min()))
            worst = max(worst, float(-margins[inside].min(initial=0.0)))
        return worst

    def slips(self, rule: Rule) -> float:
        """Largest residual of an equality."""
        return max(float(np.abs(rule.values(motion)).max()) for motion in self.motions)


def agrees(told: str, *found: float, share: float = AGREES) -> bool:
    """Whether a number as it was printed is one of those found, but for its rounding."""
    digits = re.sub(r"e.*", "", told).lstrip("+-")
    decimals = len(digits.partition(".")[2])
    exponent = int(told.partition("e")[2] or 0)
    rounding = 0.5 * 10.0 ** (exponent - decimals)
    if not decimals and len(digits) > 3:
        rounding = max(rounding, 0.5 * 10.0 ** (exponent + len(digits) - 3))
    value = float(told)
    return any(abs(value - one) <= share * abs(one) + 1.01 * rounding for one in found)


def meters(number: str, unit: str) -> str:
    """A printed length in meters."""
    return str(float(number) / 1e3) if unit == "mm" else number


# ---------------------------------------------------------------- what was not said


def silences(facts: Facts, sentences: Sequence[str]) -> Iterator[str]:
    """What the files tell and the program did not."""
    text = " | ".join(sentences)
    length, asked = facts.motion.length, facts.asked
    whole = max(1.0, facts.motion.turning / (2 * np.pi))
    for name, off, turned in facts.misses():
        allowed = TOLD * length + BROKEN + (facts.noise if facts.is_learned else 0.0)
        if max(off) > 1.02 * allowed and f"from {name}" not in text and not _left(text):
            yield f"misses {name} by {max(off):.3g} m, untold"
        if max(turned) > 1.02 * TOLD_TURN * whole and f"from {name}" not in text:
            yield f"misses {name} by {np.degrees(max(turned)):.3g} degrees, untold"
    for rule in asked.rules:
        is_hard = rule.is_limit and not rule.is_soft
        if is_hard and facts.breaks(rule) > 1.02 * BROKEN and rule.name not in text:
            yield f"breaks {rule.name} by {facts.breaks(rule):.3g}, untold"
        top = max(1.0, *(np.linalg.norm(m.steps.linear, axis=1).max() for m in facts.motions))
        if not rule.is_limit and facts.slips(rule) > SLIPS * top and rule.name not in text:
            yield f"violates {rule.name} by {facts.slips(rule):.3g}, untold"
    longer = abs(facts.motion.duration - asked.duration) > 1e-6 * asked.duration
    if longer and "the motion takes" not in text:
        yield f"takes {facts.motion.duration:.5g} s, not {asked.duration:.5g}, untold"
    if facts.is_learned:
        share = LEAVES if len(facts.references) == 1 else LEAVES_MEAN
        for reference in facts.references:
            off = facts.motion.off(reference)[0].max()
            if off > 1.02 * share * reference.length + facts.noise and not _left(text):
                yield f"leaves its demonstration by {off:.3g} of {reference.length:.3g} m, untold"
        if len(facts.references) == 1:
            turned = np.degrees(np.sqrt(np.mean(facts.motion.off(facts.references[0])[1] ** 2)))
            if turned > 1.1 * TURNS and "turns the tool by" not in text:
                yield f"turns the tool by {turned:.3g} degrees (rms), untold"
    elif not asked.is_duration_given:
        ratio = peak(facts.motion) / max(peak(facts.references[0]), 1e-12)
        if ratio > 1.05 * HURRIES and "times as fast" not in text:
            yield f"moves {ratio:.3g} times as fast as before, untold"


def _left(text: str) -> bool:
    """Whether it was said that the demonstration is left."""
    return "the primitive leaves" in text or "leave the demonstration" in text


def peak(motion: Track) -> float:
    """Largest speed (m/s)."""
    return float(np.linalg.norm(motion.steps.linear, axis=1).max())


def turn_peak(motion: Track) -> float:
    """Largest angular speed (rad/s)."""
    return float(np.linalg.norm(motion.steps.angular, axis=1).max())


# ---------------------------------------------------------------- what was said

Check = Callable[[Facts, re.Match[str]], bool | None]
"""Whether a sentence is true; None if the files do not tell."""


def _missed(facts: Facts, found: re.Match[str]) -> bool | None:
    length, unit, share, degrees, place = found.groups()
    of_poses = any(rule.of_poses for rule in facts.asked.rules)
    for name, off, turned in facts.misses():
        if name != place:
            continue
        if facts.is_learned and (facts.noise or len(facts.references) > 1 or of_poses):
            # The goal is what projection and fit made of the demonstrations' ends.
            return None
        if length is not None and not agrees(meters(length, unit), *off):
            return False
        if share is not None:
            shares = [o / m.length for o, m in zip(off, facts.motions, strict=True)]
            if not agrees(share, *shares):
                return False
        if degrees is not None and facts.asked.quaternion is None:
            return None
        return degrees is None or agrees(degrees, *np.degrees(turned))
    return False


def _broken(facts: Facts, found: re.Match[str]) -> bool | None:
    name, number, unit = found.groups()
    rules = [rule for rule in facts.asked.rules if rule.name == name]
    if name == "acceleration-limit":
        # The first kick is from the velocity at the start, which no file tells.
        return None
    return bool(rules) and agrees(meters(number, unit), facts.breaks(rules[0]))


def _slower(facts: Facts, found: re.Match[str]) -> bool | None:
    after, before, name = found.groups()
    (rule,) = (rule for rule in facts.asked.rules if rule.name == name)
    margins = [float(rule.values(motion).min()) for motion in facts.motions]
    holds = rule.is_soft or min(margins) >= -BROKEN
    # The least duration: there the limit binds.
    scale = peak(facts.motion) if "speed" in name else turn_peak(facts.motion)
    # In a step, unless noise makes the start, which no file tells, the fastest.
    of_speed = ("rate" in name or "speed" in name) and not facts.noise
    binds = not of_speed or min(np.abs(margins)) <= AGREES * scale
    tells = agrees(after, facts.motion.duration) and agrees(before, facts.asked.duration)
    return tells and holds and binds


def _left_by(facts: Facts, found: re.Match[str]) -> bool | None:
    off, length = (float(number) / 1e3 for number in found.groups())
    if facts.noise:
        return None
    return any(
        agrees(str(off), float(facts.motion.off(reference)[0].max()), share=0.03)
        and agrees(str(length), reference.length)
        for reference in facts.references
    )


def _end_moved(facts: Facts, found: re.Match[str]) -> bool | None:
    where, off, unit = found.groups()
    if facts.noise:
        return None
    k = {"starts": 0, "ends": -1}[where]
    mean = np.mean([reference.positions[k] for reference in facts.references], axis=0)
    moved = float(np.linalg.norm(facts.motion.positions[k] - mean))
    return agrees(meters(off, unit), moved, share=0.03)


def _faces_away(facts: Facts, found: re.Match[str]) -> bool | None:
    if facts.noise:
        return None
    end = facts.motion.quaternions[-1]
    apart = [float(np.degrees(angles(end, each.quaternions[-1]))) for each in facts.references]
    return agrees(found.group(1), max(apart), share=0.03)


def _turned(facts: Facts, found: re.Match[str]) -> bool | None:
    if facts.noise or len(facts.references) > 1:
        return None
    turned = np.sqrt(np.mean(facts.motion.off(facts.references[0])[1] ** 2))
    return agrees(found.group(1), float(np.degrees(turned)), share=0.05)


def _few_functions(facts: Facts, found: re.Match[str]) -> bool | None:
    if facts.noise or facts.asked.rules or len(facts.references) > 1:
        return None
    (reference,) = facts.references
    off, turned = (values.max() for values in facts.motion.off(reference))
    share = max(off / reference.length, turned / max(reference.turning, 2 * np.pi))
    return agrees(found.group(1), float(share), share=0.05)


def _hurries(facts: Facts, found: re.Match[str]) -> bool | None:
    told, times = found.groups()
    usual = peak(facts.references[0])
    found_peaks = [peak(motion) for motion in facts.motions]
    return agrees(told, *found_peaks) and agrees(times, *(p / usual for p in found_peaks))


def _takes_longer(facts: Facts, found: re.Match[str]) -> bool | None:
    after, before = found.groups()
    return agrees(after, facts.motion.duration) and agrees(before, facts.asked.duration)


def _turns_fast(facts: Facts, found: re.Match[str]) -> bool | None:
    now, before = found.groups()
    return agrees(now, *map(turn_peak, facts.motions), share=0.05) and agrees(
        before, turn_peak(facts.references[0]), share=0.05
    )


def _apart(facts: Facts, found: re.Match[str]) -> bool | None:
    starts = np.array([reference.positions[0] for reference in facts.references])
    gaps = np.linalg.norm(starts[:, None] - starts, axis=2)
    lengths = [reference.length for reference in facts.references]
    gap, length = found.groups()
    if facts.noise:
        return None
    return agrees(gap, float(gaps.max())) and agrees(length, float(np.median(lengths)))


def _cannot_say(*_: object) -> None:
    return None


_QUANTITY = rf"{NUMBER} (m|mm)"
SENTENCES: tuple[tuple[str, str, Check], ...] = (
    (
        "misses a place",
        rf"(?:ends|passes) (?:{_QUANTITY})?(?: \({NUMBER} (?:of|times) its path\))?(?: and )?"
        rf"(?:{NUMBER} degrees)? from (its goal|via [\d.]+)",
        _missed,
    ),
    ("breaks a limit", rf"breaks ([\w-]+) by {NUMBER} (\S+)", _broken),
    (
        "takes longer for a limit",
        rf"the motion takes {NUMBER} s instead of {NUMBER} s, the least in which it keeps '(.*)' a",
        _slower,
    ),
    ("a duration is too short", r"'(.*)' cannot be kept in", _cannot_say),
    ("another shape keeps a limit", r"'(.*)' is kept in .* by a motion of another", _cannot_say),
    (
        "takes longer to a far goal",
        rf"the motion takes {NUMBER} s, not {NUMBER}, (?:in which it would|at the pace of)",
        _takes_longer,
    ),
    ("backs up", rf"the motion backs up along {_QUANTITY}", _cannot_say),
    (
        "moves fast",
        rf"the motion moves at {NUMBER} m/s, {NUMBER} times as fast as its law does",
        _hurries,
    ),
    (
        "turns fast",
        rf"to pass its via points the motion turns at {NUMBER} rad/s, not {NUMBER};",
        _turns_fast,
    ),
    (
        "too few basis functions",
        rf"basis functions leave the demonstration by {NUMBER} of its path or turning",
        _few_functions,
    ),
    ("turns the tool", rf"the constraint turns the tool by {NUMBER} degrees \(rms\)", _turned),
    ("limits left to the run time", r"its projection cannot keep", _cannot_say),
    ("needs smoothing", r"converged only with", _cannot_say),
    (
        "leaves a demonstration",
        rf"the primitive leaves .* by {NUMBER} mm of a path of {NUMBER} mm",
        _left_by,
    ),
    (
        "an end is moved",
        rf"the primitive (starts|ends) {_QUANTITY} from where demonstrations do, which break",
        _end_moved,
    ),
    ("faces away", rf"the primitive ends facing away from .*, by {NUMBER} degrees", _faces_away),
    ("starts apart", rf"their starts lie {NUMBER} m apart, paths are {NUMBER} m long", _apart),
    ("out of step", r"are out of step, by", _cannot_say),
    ("units asked after", r"are its .* in other units than", _cannot_say),
)
"""Kinds of sentences: a name, how to know one, and whether one is true."""
REFUSALS: tuple[tuple[str, str], ...] = (
    ("no projection converges", r"no trajectory near it found that satisfies"),
    ("a kept rotation swings", r"with the positions held, a rotation that is kept does not fit"),
    ("limits cannot be kept between the ends", r"no motion found that keeps"),
    ("the goal violates a rule", r"violates '.*' by .* no motion that satisfies it"),
    ("no motion leads from the start there", r"rules? out; no motion that satisfies"),
    ("via points too near", r"no motion found that passes all of"),
    ("demonstrations contradict", r"(run in opposite directions|hold the tool opposite ways)"),
    ("rules contradict", r"contradict each other"),
    ("nothing near the start", r"no pose found near the one given"),
    ("the metric leaves nothing free", r"asks nothing of what the metric leaves free"),
    ("turns too far between samples", r"so that nothing says which way round"),
    ("cannot be filtered or resampled", r"(lowpass|low-pass|--rate)"),
)
"""Kinds of errors that leave no motion to hold them against."""


def readings(facts: Facts, sentences: Sequence[str]) -> Iterator[tuple[str, bool | None, str]]:
    """Of each sentence its kind, and whether it is true; a kind of its own if it is unknown."""
    for sentence in sentences:
        known = False
        for kind, pattern, check in SENTENCES:
            for found in re.finditer(pattern, sentence):
                known, is_true = True, check(facts, found)
                yield kind, None if is_true is None else bool(is_true), sentence
        if not known:
            yield "unread", None, sentence
