"""What a worker does: read one recording, learn from it, write the primitive, tell the figures."""

from __future__ import annotations

import threading
import warnings
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from noslip._version import __version__
from noslip.constraints.catalog import restore
from noslip.demonstrations.cycles import periods
from noslip.demonstrations.preparation import prepare
from noslip.errors import InputError, NoslipError, NoslipWarning, muted
from noslip.learning import learn
from noslip.many.recordings import content_hash
from noslip.many.settings import of_settings
from noslip.merit import figures_of_merit
from noslip.primitive import ConstrainedDMP
from noslip.recordings import load_demonstrations
from noslip.result_table import RecordingResult
from noslip.trajectory import PoseTrajectory


class Worker:
    """What a process needs for all recordings."""

    def __init__(self, settings: str) -> None:
        self.asked = of_settings(settings)
        if self.asked["noslip"] != __version__:
            raise NoslipError(
                f"a worker runs noslip {__version__}, this is {self.asked['noslip']}; install the "
                "same version on both"
            )
        self.constraints = [restore(data) for data in self.asked["constraints"]]

    def learn(self, name: str, file: Path, primitive: Path | None) -> RecordingResult:
        begin = perf_counter()
        content = content_hash(file)
        figures: dict[str, Any] = {}
        failure = ""
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", NoslipWarning)
            try:
                figures = self._figures(file, primitive)
            except Exception as error:
                failure = as_line(error)
        known = "; ".join(str(w.message) for w in told if issubclass(w.category, NoslipWarning))
        return RecordingResult(
            name=name,
            status="failed" if failure else "learned",
            message=failure or known,
            recording=str(file),
            content=content,
            checksum="" if failure or primitive is None else content_hash(primitive),
            seconds=perf_counter() - begin,
            **figures,
        )

    def _figures(self, file: Path, primitive: Path | None) -> dict[str, Any]:
        loaded = load_demonstrations([file], **self.asked["loading"])
        if len(loaded) != 1:
            raise InputError(f"{file}: holds {len(loaded)} recordings; give files with one each")
        demonstration = prepare(loaded[0], **self.asked["preparation"])
        dmp = learn(demonstration, self.constraints, **self.asked["options"])
        if self.asked["options"].get("rhythmic"):
            with muted():
                demonstration = periods(demonstration, self.asked["options"].get("period"))[0]
        figures = self._compared(dmp, demonstration)
        if primitive is not None:
            dmp.save(primitive)
        return figures

    def _compared(self, dmp: ConstrainedDMP, demonstration: PoseTrajectory) -> dict[str, Any]:
        system = dmp.system
        motion = dmp.rollout()
        merit = figures_of_merit(motion, demonstration, system)
        recorded = figures_of_merit(demonstration, demonstration, system)
        figures: dict[str, Any] = {
            "unit": motion.unit,
            "samples": len(demonstration),
            "duration_s": demonstration.duration,
            "path_length_m": demonstration.path_length,
            "recording_residual_peak": recorded.residual_peak,
            "recording_residual_rms": recorded.residual_rms,
            "motion_duration_s": motion.duration,
            "residual_peak": merit.residual_peak,
            "residual_rms": merit.residual_rms,
            "holds": merit.satisfied,
            "least_margins": ", ".join(f"{k}={v:.6g}" for k, v in merit.least_margins.items()),
            "end_position_error_m": merit.end_error,
            "position_rms_m": merit.position_rms,
            "slowest_edge_speed_m_s": merit.slowest_edge_speed,
            "force_peak_m_s2": merit.force_peak,
        }
        if motion.space.rotations:
            figures |= {
                "end_rotation_error_deg": float(np.degrees(merit.end_rotation_error)),
                "rotation_rms_deg": float(np.degrees(merit.rotation_rms)),
                "rotation_error_deg": float(np.degrees(merit.rotation_error)),
                "angular_speed_peak_rad_s": merit.angular_speed_peak,
                "angular_acceleration_peak_rad_s2": merit.angular_acceleration_peak,
                "torque_peak_rad_s2": merit.torque_peak,
            }
        for record in dmp.record:
            figures |= {
                "iterations": record.iterations,
                "backing": record.backing,
                "smoothing": record.smoothing,
                "left_out": ", ".join(record.left_out),
                "projected_residual": record.residual,
                "position_change_m": record.position_change,
                "rotation_change_deg": float(np.degrees(record.rotation_change)),
            }
        return figures


_worker = lru_cache(maxsize=2)(Worker)
"""Of the last settings and those before: a worker serves a run or two at a time."""
_ONE_THREAD = threading.Lock()
"""Compiled graphs work in buffers of their own: one thread at a time."""


def learn_one(settings: str, name: str, file: str, primitive: str | None) -> RecordingResult:
    """What a worker is asked to do."""
    target = None if primitive is None else Path(primitive)
    with _ONE_THREAD:
        return _worker(settings).learn(name, Path(file), target)


def as_line(error: BaseException) -> str:
    """Return an error as one line; those of noslip speak for themselves."""
    text = " ".join(str(error).split())
    if isinstance(error, NoslipError) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
