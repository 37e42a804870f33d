"""What became of the goals that ``noslip adapt`` was given: a table, and sentences."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields

from noslip.constraints.check import residual_text
from noslip.errors import one_line
from noslip.named_columns import records_text


@dataclass(frozen=True)
class Outcome:
    """What became of one goal: a row of the summary.

    Attributes
    ----------
    name : str
    converged : bool
        Whether there is a primitive; if not, ``message`` says why and the rest is None.
    holds : bool or None
        Whether its motion keeps every constraint and hard limit.
    end_position_error_m, end_rotation_error_deg : float or None
        From the goal to the end of the motion; None of what is left free.  Of vectors, as
        ``path_error_m``, in their own unit, and nothing turns.
    path_error_m : float or None
        Farthest that the motion is from its projected path.
    residual_peak : float or None
        Of the equalities, in their units (SI).
    angular_speed_peak_rad_s, angular_speed_ratio : float or None
        The latter over that of the original primitive, None if that never turns.
    iterations : int or None
        Of the projection.
    duration_s : float or None
    maneuver : str
        That the motion was planned from; empty of the demonstration's own, led elsewhere.
    code : str
        Of the refusal, see :class:`noslip.errors.Refusal`; empty where there is none.
    needed_duration_s : float or None
        With which the refusal says that it goes.
    message : str
        Why it failed, or what a person should know.
    """

    name: str
    converged: bool
    holds: bool | None = None
    end_position_error_m: float | None = None
    end_rotation_error_deg: float | None = None
    path_error_m: float | None = None
    residual_peak: float | None = None
    angular_speed_peak_rad_s: float | None = None
    angular_speed_ratio: float | None = None
    iterations: int | None = None
    duration_s: float | None = None
    maneuver: str = ""
    code: str = ""
    needed_duration_s: float | None = None
    message: str = ""

    @property
    def failed(self) -> bool:
        """Whether there is no primitive, or one that breaks its constraints."""
        return not (self.converged and self.holds)


def csv_text(outcomes: list[Outcome]) -> str:
    """Return the summary: a header, then a row a goal; empty cells of what there is not."""
    return records_text([field.name for field in fields(Outcome)], map(asdict, outcomes))


def sentences(outcome: Outcome, unit: str = "m") -> list[str]:
    """Say what became of one goal."""
    return _achieved([outcome], unit) + ([outcome.message] if outcome.message else [])


def sentences_together(outcomes: list[Outcome], unit: str = "m") -> list[str]:
    """Say what became of several goals, and of which one something must be known."""
    done = [outcome for outcome in outcomes if outcome.converged]
    lines = [f"adapted to {len(done)} of {len(outcomes)} goals"]
    lines += _achieved(done, unit) if done else []
    return lines + [
        one_line(f"{outcome.name}: {'FAILED, ' if outcome.failed else ''}{outcome.message}")
        for outcome in outcomes
        if outcome.message
    ]


def _achieved(outcomes: list[Outcome], unit: str) -> list[str]:
    """Say the largest numbers of all outcomes that have them."""

    def most(name: str) -> float | None:
        found = [getattr(outcome, name) for outcome in outcomes]
        return max((value for value in found if value is not None), default=None)

    off, turned, residual, speed, ratio = (
        most(name)
        for name in (
            "end_position_error_m",
            "end_rotation_error_deg",
            "residual_peak",
            "angular_speed_peak_rad_s",
            "angular_speed_ratio",
        )
    )
    ends = [] if off is None else [residual_text(off, unit, below="")]
    ends += [] if turned is None else [f"{turned:.3g} degrees"]
    lines = [f"ends within {' and '.join(ends)} of the goal"] if ends else []
    times = "" if ratio is None else f", {ratio:.3g} times that of the original"
    lines.append(f"residual {residual_text(residual or 0.0, '1', order='at most')}")
    if speed is not None:
        lines.append(f"angular speed at most {speed:.3g} rad/s{times}")
    return lines
