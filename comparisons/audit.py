"""Audits of model files: how far a simulation is from the mechanics it stands for, and until when.

The file is moved by its own engine as it is given, and with other integrators and steps; each
motion is held against the reference motion of the mechanism that was read from the file, up to the
first contact, or the predictability horizon.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from ..engines.study import GivenRun, ModelFile, ModelStart
from ..models.arrays import FloatArray
from ..models.errors import InputError, SimulationError
from ..models.kinematics import Kinematics
from ..models.mechanism import Mechanism
from ..models.problem import StopLaw
from ..models.shown import Reported
from ..models.spec import Real, Spec
from .runs.metrics import compared_points
from .runs.model_files import read_model_file
from .runs.results import ResultFile
from .runs.runner import Runner
from .runs.study import Until

FORMAT = "trebucheck-audit-1"
_STEPS = (4.0, 2.0, 1.0, 0.5, 0.25, 0.125)  # tried, in parts of the file's own
_MOST_STEPS = 400_000  # of one run
SHARE = 0.01
"""Part of the motion's size: a simulation has left the motion when it is off by more."""
_TIMES = (0.1, 0.25, 0.5, 1.0)  # at which the error is told, in parts of the compared time
_POINTS = 400  # of a curve
_AT_REST = 1e-9  # [m] size of a motion that is none
_LONGEST = 5.0  # [s] that is compared where no time is asked for

Progress = Callable[[str, int, int], None]


class ErrorAt(Spec):
    """The error up to a time."""

    t: Real = Field(description="[s]")
    error: Real = Field(description="largest distance of any point up to then [m]")


class AuditedRun(Spec):
    """A motion of the file with an integrator and a step."""

    integrator: str
    timestep: Real = Field(description="[s]")
    is_given: bool = Field(description="whether these are the file's own")
    error: Real | None = Field(
        default=None, description="largest distance of any point to the end of what is compared [m]"
    )
    leaves: Real | None = Field(
        default=None,
        description="first time at which it is off by more than a hundredth of the motion's size "
        "[s]; None: it is not",
    )
    steps: int = Field(default=0, description="up to there")
    processor_time: Real | None = Field(default=None, description="of these steps [s]")
    message: str | None = Field(default=None, description="why there is no motion")


class Audit(Reported, ResultFile):
    """How far a model file's simulation is from the mechanics it stands for."""

    format: Literal["trebucheck-audit-1"] = FORMAT
    model: str
    source: str = Field(description="the file")
    mechanism: Mechanism
    mechanism_hash: str
    left_out: tuple[str, ...] = Field(description="features that the mechanism has not")
    asked: Real = Field(description="end that was asked for [s]")
    compared_to: Real = Field(description="end of what is compared [s]")
    ended: str = Field(description="why that is earlier; empty: it is not")
    size: Real = Field(
        description="of the reference motion: the diagonal of the box that the path of the point "
        "that moves farthest fills [m]"
    )
    points: tuple[str, ...] = Field(description="markers, or bodies for their centres of mass")
    accuracy: Real = Field(description="error that is asked for [m]")
    errors: tuple[ErrorAt, ...] = Field(description="of the file as it is given")
    curve: tuple[ErrorAt, ...] = Field(description="the same over time, at that time alone")
    runs: tuple[AuditedRun, ...]
    cheapest: str | None = Field(
        default=None, description="options for the file that hold the accuracy at the least cost"
    )
    is_longest: bool = Field(default=False, description="whether no longer step was tried than it")

    @property
    def given(self) -> AuditedRun:
        """The run with the file's own options."""
        return next(run for run in self.runs if run.is_given)

    def headline(self) -> str:
        """Tell how far the file's simulation is off, and until when it holds a hundredth."""
        given = self.given
        if given.error is None:
            return f"{self.model}: {(given.message or '').rstrip('.')}"
        off = f"{self.model} as given is off by {given.error:.2g} m within {self.compared_to:.4g} s"
        share = given.error / self.size if self.size else 0.0
        if given.leaves is None:
            return f"{off} ({share:.2g} of the motion's size)"
        return f"{off}, by more than 1 % of the motion's size since {given.leaves:.3g} s"

    def rows(self) -> Iterator[dict[str, object]]:
        """A run a row."""
        for run in self.runs:
            yield {"model": self.model, **run.model_dump()}


def audit(
    source: str | Path | Any,
    until: float = _LONGEST,
    *,
    accuracy: float | None = None,
    keyframe: str | int | None = None,
    qpos: Sequence[float] | None = None,
    qvel: Sequence[float] | None = None,
    ctrl: Sequence[float] | None = None,
    without: Collection[str] = (),
    progress: Progress | None = None,
) -> Audit:
    """Tell how far the simulation of a model file is from the mechanics it stands for.

        >>> import trebucheck as tb
        >>> tb.audit("cartpole.xml", qpos=[0.0, 0.1]).given.leaves  # doctest: +SKIP

    Args:
        source: as of :func:`.runs.model_files.from_mjcf`.
        until: end of what is compared [s]; a contact or the predictability horizon may come first.
        accuracy: error for which the cheapest options are looked for [m]; a hundredth of the
            motion's size if left out.
        keyframe, qpos, qvel, ctrl, without: as of :func:`.runs.model_files.from_mjcf`.
        progress: called before each run.

    Raises:
        InputError: the file, the start, the end or the accuracy is not valid, or nothing moves.
        UnsupportedProblemError: the model cannot be read; the sentence names why.
        SimulationError: the reference cannot move it.
    """
    for what, value in (("until", until), ("accuracy", accuracy)):
        if value is not None and not 0.0 < value < np.inf:
            raise InputError(f"{what} = {value!r} must be a positive number.")
    read = read_model_file(source, ModelStart(keyframe, qpos, qvel, ctrl, without))
    name = str(source) if isinstance(source, str | Path) else "a compiled model"
    shown = "the MJCF text" if name.lstrip().startswith("<") else name
    return _Audited(read, float(until), progress).made(shown, accuracy)


class _Audited:
    """Motions of a file beside its reference motion."""

    def __init__(self, read: ModelFile, until: float, progress: Progress | None) -> None:
        self.read, self.until, self.progress = read, until, progress
        self.runner = Runner(read.mechanism, until=Until.of(until), law=StopLaw.UNILATERAL)
        self._kinematics = Kinematics(read.mechanism)
        self._points = compared_points(self._kinematics)

    def made(self, source: str, accuracy: float | None) -> Audit:
        """Errors of the file as it is given, the runs with other options, and the cheapest."""
        given = self._moved(*self._own)
        end, ended = self._end(given)
        way = self._places(self.runner.reference(np.linspace(0.0, end, _POINTS)).q)
        size = float(np.linalg.norm(np.ptp(way, axis=0), axis=-1).max())
        if size < _AT_REST:
            raise InputError(
                f"nothing moves in {self.read.mechanism.name!r} from this start; give another one "
                "(qpos, qvel or a keyframe), or controls."
            )
        wanted = accuracy if accuracy is not None else SHARE * size
        runs = [*self._runs(given, end, size)]
        cheapest = self._cheapest(runs, wanted)
        errors, curve = list[ErrorAt](), list[ErrorAt]()
        if isinstance(given, GivenRun):
            t, off = self._off(given, end)
            for part in _TIMES:
                upto = off[t <= part * end]
                errors.append(ErrorAt(t=part * end, error=float(upto.max(initial=0.0))))
            kept = np.unique(np.linspace(0, len(t) - 1, min(len(t), _POINTS)).astype(int))
            curve += [ErrorAt(t=float(t[k]), error=float(off[k])) for k in kept]
        mechanism = self.read.mechanism
        return Audit.made_here(
            model=mechanism.name,
            source=source,
            mechanism=mechanism,
            mechanism_hash=mechanism.content_hash,
            left_out=self.read.left_out,
            asked=self.until,
            compared_to=end,
            ended=ended,
            size=size,
            points=tuple(self._points),
            accuracy=wanted,
            errors=tuple(errors),
            curve=tuple(curve),
            runs=tuple(runs),
            cheapest=cheapest and self.read.option_text(cheapest.integrator, cheapest.timestep),
            is_longest=cheapest is not None
            and cheapest.timestep == max(run.timestep for run in runs),
        )

    @property
    def _own(self) -> tuple[str, float]:
        """Integrator and step [s] of the file."""
        return self.read.integrator, self.read.timestep

    def _moved(self, integrator: str, step: float) -> GivenRun | str:
        """A motion to the end that is asked for, or why there is none."""
        if self.until / step > _MOST_STEPS:
            return f"it would take {self.until / step:.2g} steps, and {_MOST_STEPS} are taken."
        try:
            return self.read.moved(self.until, integrator, step)
        except SimulationError as error:
            return str(error)

    def _end(self, given: GivenRun | str) -> tuple[float, str]:
        """End of what is compared [s], and why it is earlier than what was asked for."""
        end, ended = self.until, ""
        if self.runner.judged_to < end:
            end = self.runner.judged_to
            ended = "no double-precision simulation predicts the motion beyond it"
        contact = given.contact if isinstance(given, GivenRun) else None
        if contact is not None and contact < end:
            end, ended = contact, "bodies touch there, which the mechanism does not know"
        return end, ended

    def _runs(self, given: GivenRun | str, end: float, size: float) -> Iterator[AuditedRun]:
        """The file's own options, then each integrator at each step."""
        yield self._run(given, self._own, end, size)
        steps = [part * self.read.timestep for part in _STEPS]
        others = [each for each in product(self.read.integrators, steps) if each != self._own]
        for done, (integrator, step) in enumerate(others):
            if self.progress:
                self.progress(f"{integrator}, {step:g} s", done, len(others))
            yield self._run(self._moved(integrator, step), (integrator, step), end, size)

    def _run(
        self, moved: GivenRun | str, options: tuple[str, float], end: float, size: float
    ) -> AuditedRun:
        integrator, step = options
        head: dict[str, Any] = {
            "integrator": integrator,
            "timestep": step,
            "is_given": options == self._own,
        }
        if isinstance(moved, str):
            return AuditedRun(**head, message=moved)
        t, off = self._off(moved, end)
        if len(t) < 2:
            return AuditedRun(**head, message="its step is longer than what is compared.")
        beyond = t[off > SHARE * size]
        return AuditedRun(
            **head,
            error=float(off.max()),
            leaves=float(beyond[0]) if len(beyond) else None,
            steps=len(t) - 1,
            processor_time=moved.processor_time * (len(t) - 1) / (len(moved.t) - 1),
        )

    def _off(self, moved: GivenRun, end: float) -> tuple[FloatArray, FloatArray]:
        """Times up to the end, and the largest distance of any point at each [m]."""
        t = moved.t[moved.t <= end * (1 + 1e-12)]
        expected = self._places(self.runner.reference(t).q)
        return t, np.linalg.norm(self._places(moved.q[: len(t)]) - expected, axis=-1).max(axis=1)

    def _places(self, q: FloatArray) -> FloatArray:
        """Places of the points, shape (n, n_points, 2) [m]."""
        rows = self._points.values()
        return np.stack([self._kinematics.position(row, q) for row in rows], axis=1)

    @staticmethod
    def _cheapest(runs: Sequence[AuditedRun], wanted: float) -> AuditedRun | None:
        """The run with the least cost that holds an error; ties go to the larger step.

        The cost of a step is that of all runs with an integrator together, which noise does not
        turn.
        """
        costs: dict[str, float] = {}
        for name in {run.integrator for run in runs}:
            of_name = [run for run in runs if run.integrator == name and run.steps]
            spent = sum(run.processor_time or 0.0 for run in of_name)
            costs[name] = spent / max(1, sum(run.steps for run in of_name))
        held = [run for run in runs if run.error is not None and run.error <= wanted]
        return min(
            held,
            key=lambda run: (costs[run.integrator] * run.steps, -run.timestep),
            default=None,
        )
