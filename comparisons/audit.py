"""Audits of model files: how far a simulation is from the mechanics it stands for, and until when.

The file is moved by its own engine as it is given, and with other integrators and steps; each
motion is held against the reference motion of the mechanism that was read from the file, up to the
first contact, or as long as the reference is known. So are other engines' motions of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from ..engines.presets import SETTINGS
from ..engines.registry import engine, engine_names
from ..engines.study import Episode, GivenRun, ModelFile, ModelOptions, ModelStart
from ..models.arrays import FloatArray
from ..models.controls import ControlRecord
from ..models.errors import InputError, SimulationError
from ..models.functions import PointCoefficients
from ..models.kinematics import Kinematics
from ..models.mechanism import Mechanism
from ..models.problem import Problem, StopLaw
from ..models.shown import Reported
from ..models.spec import Real, Spec
from ..models.trajectory import Provenance, Trajectory
from .runs.model_files import largest_difference, read_model_file, start_of
from .runs.process import Worker
from .runs.results import REFERENCE, ResultFile
from .runs.runner import Runner, failure, refuse_invalid
from .runs.study import Until

FORMAT = "trebucheck-audit-1"
_STEPS = (4.0, 2.0, 1.0, 0.5, 0.25, 0.125)  # tried, in parts of the file's own
_MOST_STEPS = 400_000  # of one run
SHARE = 0.01
"""Part of the motion's size: a simulation has left the motion when it is off by more."""
_TIMES = (0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # [s] at which the error is told
_POINTS = 400  # of a curve
_AT_REST = 1e-9  # [m] size of a motion that is none
_LONGEST = 5.0  # [s] that is compared where no time is asked for
_STEPS_OF_CAUSES = 10  # at least, over which causes are told apart
_TOUCH = "bodies touch then, which the mechanism does not know"
_TIMEOUT = 60.0  # [s] for a run of another engine

Progress = Callable[[str, int, int], None]


class ErrorAt(Spec):
    """The error up to a time."""

    t: Real = Field(description="[s]")
    error: Real = Field(description="largest distance of any point up to then [m]")


class AuditSample(Spec):
    """The file's simulation, as it is given, at a time."""

    t: Real = Field(description="[s]")
    error: Real = Field(description="largest distance of any point then [m]")
    energy_error: Real = Field(
        description="kinetic and potential energy less that of the reference, both by the file's "
        "engine [J]"
    )
    q: tuple[Real, ...] = Field(description="coordinates of the mechanism [rad or m]")
    u: tuple[Real, ...] = Field(description="speeds")
    kinetic_energy: Real = Field(description="by the file's engine [J]")
    potential_energy: Real = Field(description="by the file's engine [J]")


class AuditedRun(Spec):
    """A motion of the file with an integrator and a step."""

    integrator: str
    timestep: Real = Field(description="[s]")
    explicit_damping: bool = Field(
        default=False, description="whether an integrator with implicit damping goes without it"
    )
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


class CauseShare(Spec):
    """A cause of the error of the file as it is given, and what is left without it."""

    name: str
    change: str = Field(description="of the options, with those of the causes before it")
    left: Real | None = Field(
        default=None,
        description="error without this cause and those before it that have a share [m]",
    )
    share: Real | None = Field(
        default=None, description="of the error as given, that goes with it; None: it stays in"
    )
    message: str | None = Field(default=None, description="why it stays in")


class EngineRun(Spec):
    """A motion of the mechanism by another engine."""

    engine: str
    preset: str
    timestep: Real | None = Field(default=None, description="[s]")
    error: Real | None = Field(
        default=None, description="largest distance of any point to the end of what is compared [m]"
    )
    leaves: Real | None = Field(default=None, description="as of the file's own runs [s]")
    message: str | None = Field(default=None, description="why there is no motion")


class Audit(Reported, ResultFile):
    """How far a model file's simulation is from the mechanics it stands for."""

    format: Literal["trebucheck-audit-1"] = FORMAT
    model: str
    source: str = Field(description="the file")
    engine: str = Field(description="that the file is for")
    engine_version: str
    mechanism: Mechanism
    mechanism_hash: str
    left_out: tuple[str, ...] = Field(description="features that the mechanism has not")
    difference: Real = Field(
        description="largest difference of mass matrix, accelerations, gaps, sites and loops from "
        "the engine's own at random states, in parts of their sizes"
    )
    difference_of: str = Field(description="the quantity that differs most; empty: none does")
    asked: Real = Field(description="end that was asked for [s]")
    compared_to: Real = Field(description="end of what is compared [s]")
    ended: str = Field(description="why that is earlier; empty: it is not")
    horizon: Real | None = Field(
        default=None,
        description="predictability horizon [s]: where a hundred-thousandth of a body's inertia "
        "moves it by a thousandth; None: not within what is compared",
    )
    known_to: Real = Field(
        description="estimated error of the reference at the end by rounding, in parts of scales"
    )
    size: Real = Field(
        description="of the reference motion: the diagonal of the box that the path of the point "
        "that moves farthest fills [m]"
    )
    points: tuple[str, ...] = Field(
        description="sites, and of each body its centre of mass and a point at its radius of "
        "gyration from it"
    )
    accuracy: Real = Field(description="error that is asked for [m]")
    errors: tuple[ErrorAt, ...] = Field(description="of the file as it is given")
    samples: tuple[AuditSample, ...] = Field(description="the same over time")
    runs: tuple[AuditedRun, ...]
    causes_to: Real = Field(
        description="end of what the causes are of [s]: where it leaves a hundredth, but ten "
        "steps at least; or all"
    )
    causes: tuple[CauseShare, ...] = Field(description="taken out one after another")
    engines: tuple[EngineRun, ...] = Field(description="others, with the mechanism that was read")
    cheapest: AuditedRun | None = Field(
        default=None, description="the run that holds the accuracy at the least cost"
    )
    cheapest_option: str = Field(default="", description="its options, to paste into the file")

    @property
    def is_longest(self) -> bool:
        """Tell whether no longer step was tried than that of the cheapest run."""
        tried = max(run.timestep for run in self.runs)
        return self.cheapest is not None and self.cheapest.timestep == tried

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

    def trajectory(self) -> Trajectory:
        """The file's simulation as it is given, at the times of its samples.

        Raises:
            InputError: it has no samples: the file cannot be moved as it is given.
        """
        if not self.samples:
            raise InputError(f"{self.headline()}: it has no trajectory.")
        t, kinetic, potential, q, u = (
            np.array([getattr(each, name) for each in self.samples])
            for name in ("t", "kinetic_energy", "potential_energy", "q", "u")
        )
        given = self.given
        provenance = Provenance(
            engine=self.engine,
            engine_version=self.engine_version,
            preset="given",
            settings={"integrator": given.integrator, "timestep": given.timestep},
            mechanism_hash=self.mechanism_hash,
            duration=float(t[-1]),
            stop_law=StopLaw.UNILATERAL.value,
            steps=given.steps,
            wall_time=given.processor_time or 0.0,
        )
        return Trajectory(
            mechanism=self.mechanism,
            t=t,
            q=q,
            u=u,
            markers={},
            kinetic_energy=kinetic,
            potential_energy=potential,
            stop_torques={},
            release_times={},
            joint_reactions={},
            provenance=provenance,
        )


def audit(
    source: str | Path | Any,
    until: float = _LONGEST,
    *,
    accuracy: float | None = None,
    keyframe: str | int | None = None,
    qpos: Sequence[float] | None = None,
    qvel: Sequence[float] | None = None,
    ctrl: Sequence[float] | ControlRecord | str | Path | None = None,
    without: Collection[str] = (),
    engines: Collection[str] | None = None,
    progress: Progress | None = None,
) -> Audit:
    """Tell how far the simulation of a model file is from the mechanics it stands for.

        >>> import trebucheck as tb
        >>> tb.audit("cartpole.xml", qpos=[0.0, 0.1]).given.leaves  # doctest: +SKIP

    Args:
        source: as of :func:`.runs.model_files.from_mjcf`; an episode of an environment
            (:func:`.runs.model_files.rollout`), whose start and controls these are then; or a
            :class:`..engines.study.ModelFile` of another simulator.
        until: end of what is compared [s]; a contact may come first, the end of an episode, or a
            time beyond which small errors have grown so much that the reference itself is not
            known.
        accuracy: error for which the cheapest options are looked for [m]; a hundredth of the
            motion's size if left out.
        keyframe, qpos, qvel, ctrl, without: as of :func:`.runs.model_files.from_mjcf`.
        engines: other engines that move the mechanism, with the preset `settings`; all that are
            installed if left out.
        progress: called before each run.

    Raises:
        InputError: the file, the start, the end or the accuracy is not valid, nothing moves, or an
            engine is unknown.
        UnsupportedProblemError: the model cannot be read; the sentence names why.
        SimulationError: the reference cannot move it.
    """
    asked: dict[str, Any] = {"until": until, "accuracy": accuracy}
    for what, value in asked.items():
        if value is not None and not (isinstance(value, int | float) and 0.0 < value < np.inf):
            raise InputError(f"{what} = {value!r} must be a positive number.")
    engines = [engines] if isinstance(engines, str) else engines
    for name in engines or ():
        engine(name, SETTINGS)  # refuses one that is unknown before anything is moved
    start = start_of(keyframe, qpos, qvel, ctrl, without)
    if isinstance(source, ModelFile):
        if start != ModelStart():
            raise InputError(f"{source.mechanism.name!r} has a start of its own; give no other.")
        read, shown = source, f"{source.mechanism.name} of {source.engine}"
    elif isinstance(source, Episode):
        if replace(start, without=()) != ModelStart():
            raise InputError(f"{source.name} has a start and controls of its own; give no other.")
        qpos, qvel = source.qpos.tolist(), source.qvel.tolist()
        episode = ModelStart(None, qpos, qvel, source.controls, without)
        read, shown = read_model_file(source.model, episode), f"an episode of {source.name}"
        until = min(until, source.duration)
    else:
        read = read_model_file(source, start)
        name = str(source) if isinstance(source, str | Path) else "a compiled model"
        shown = "the MJCF text" if name.lstrip().startswith("<") else name
    _refuse_open_start(read.mechanism)
    others = engines
    if others is None:
        others = [each for each in engine_names() if each not in (REFERENCE, read.engine)]
    with Worker(_TIMEOUT) as worker:
        return _Audited(read, float(until), worker, progress).made(shown, accuracy, others)


def _refuse_open_start(mechanism: Mechanism) -> None:
    """Raise InputError for a start that is off an equality, before anything is moved."""
    try:
        Problem(mechanism)
    except InputError as error:
        if not mechanism.bound_by:
            raise
        raise InputError(
            f"{error} Give a start that fits (qpos, or a keyframe), or leave the equalities out."
        ) from None


def _points_of(kinematics: Kinematics) -> dict[str, PointCoefficients]:
    """Points whose errors are told: markers, and two of each body, so that no motion is missed.

    They are its centre of mass and, away from its joint, a point at its radius of gyration.
    """
    mechanism = kinematics.mechanism
    ends = [(marker.name, marker.body, complex(*marker.point)) for marker in mechanism.markers]
    for body in mechanism.bodies:
        centre = complex(*body.centre)
        arm = centre - complex(*mechanism.joint_of(body.name).child_point)
        away = math.sqrt(body.inertia / body.mass) * (arm / abs(arm) if abs(arm) > 0 else 1.0)
        ends.append((f"centre of {body.name}", body.name, centre))
        if away:
            ends.append((f"{body.name} at its radius of gyration", body.name, centre + away))
    return {name: kinematics.point(body, (at.real, at.imag)) for name, body, at in ends}


class _Audited:
    """Motions of a file beside its reference motion."""

    def __init__(
        self, read: ModelFile, until: float, worker: Worker, progress: Progress | None
    ) -> None:
        self.read, self.until, self.progress = read, until, progress
        self._worker = worker
        self._kinematics = Kinematics(read.mechanism)
        self._points = _points_of(self._kinematics)
        self._motions: dict[ModelOptions, GivenRun | str] = {}

    @cached_property
    def runner(self) -> Runner:
        """The reference, up to when bodies touch in the last of the motions, if they do in all."""
        motions = [self._moved(options) for options in self.options]
        contacts = [each.contact for each in motions if isinstance(each, GivenRun)]
        known = [time for time in contacts if time is not None]
        end = max(known) if known and len(known) == len(contacts) else self.until
        if end <= 0.0:
            raise _touches_at_start(self.read.mechanism)
        until = Until.of(min(end, self.until))
        return Runner(self.read.mechanism, until=until, law=StopLaw.UNILATERAL)

    @cached_property
    def given(self) -> GivenRun | str:
        """The motion as given, or why there is none."""
        return self._moved(self.read.options)

    @cached_property
    def options(self) -> tuple[ModelOptions, ...]:
        """The file's own, then each integrator at each step."""
        own = self.read.options
        steps = [part * own.timestep for part in _STEPS]
        others = [ModelOptions(*each) for each in product(self.read.integrators, steps)]
        return own, *self.read.variants, *(each for each in others if each != own)

    def _ends(self) -> tuple[float, str]:
        """End of what is compared [s], and why it is earlier than what was asked for.

        Bodies touch where they do in a motion that has not left the reference by then.
        """
        end, ended = self.runner.end, ""
        if end < self.until:
            ended = _TOUCH
        if self.runner.known_until < end:
            end = self.runner.known_until
            ended = "small errors grow so much that the reference is not known beyond it"
        allowed = SHARE * self._size(end)
        for options in self.options:
            moved = self._moved(options)
            if isinstance(moved, str) or moved.contact is None or moved.contact >= end:
                continue
            if self._largest(moved, moved.contact) <= allowed:
                end, ended = moved.contact, _TOUCH
        if end <= 0.0:
            raise _touches_at_start(self.read.mechanism)
        return end, ended

    def _size(self, end: float) -> float:
        """Diagonal of the box that the path of the point that moves farthest fills [m]."""
        way = self._places(self.runner.reference(np.linspace(0.0, end, _POINTS)).q)
        return float(np.linalg.norm(np.ptp(way, axis=0), axis=-1).max())

    def made(self, source: str, accuracy: float | None, others: Collection[str]) -> Audit:
        """Errors of the file as it is given, of other options and engines, and the cheapest."""
        mechanism = self.read.mechanism
        for done, options in enumerate(self.options):
            what = f"{options.integrator}, {options.timestep:g} s"
            self._tell(what, done, len(self.options))
            self._moved(options)
        end, ended = self._ends()
        size = self._size(end)
        if size < _AT_REST:
            raise InputError(
                f"nothing moves in {mechanism.name!r} from this start; give another one "
                "(qpos, qvel or a keyframe), or controls."
            )
        wanted = accuracy if accuracy is not None else SHARE * size
        runs = [self._run(options, end, size) for options in self.options]
        cheapest = self._cheapest(runs, wanted)
        difference, difference_of = largest_difference(self.read)
        least = _STEPS_OF_CAUSES * self.read.options.timestep
        causes_to = min(end, max(runs[0].leaves or end, least))
        return Audit.made_here(
            model=mechanism.name,
            source=source,
            engine=self.read.engine,
            engine_version=self.read.engine_version,
            mechanism=mechanism,
            mechanism_hash=mechanism.content_hash,
            left_out=self.read.left_out,
            difference=difference,
            difference_of=difference_of,
            asked=self.until,
            compared_to=end,
            ended=ended,
            horizon=self.runner.judged_to if self.runner.judged_to < end else None,
            known_to=self.runner.rounding(end),
            size=size,
            points=tuple(self._points),
            accuracy=wanted,
            errors=tuple(self._errors(end)),
            samples=tuple(self._samples(end)),
            runs=tuple(runs),
            causes_to=causes_to,
            causes=tuple(self._causes(causes_to)),
            engines=tuple(self._by_engine(each, end, size) for each in others),
            cheapest=cheapest,
            cheapest_option=self.read.option_text(_options(cheapest)) if cheapest else "",
        )

    def _moved(self, options: ModelOptions) -> GivenRun | str:
        """A motion to the end that is asked for, or why there is none."""
        if options not in self._motions:
            self._motions[options] = self._moved_now(options)
        return self._motions[options]

    def _moved_now(self, options: ModelOptions) -> GivenRun | str:
        steps = self.until / options.timestep
        if steps > _MOST_STEPS:
            return f"it would take {steps:.2g} steps, and {_MOST_STEPS} are taken."
        try:
            return self.read.moved(self.until, options)
        except SimulationError as error:
            return str(error)

    def _errors(self, end: float) -> Iterator[ErrorAt]:
        """Largest errors of the file as it is given up to some times."""
        if isinstance(self.given, GivenRun):
            t, off = self._off(self.given.t, self.given.q, end)
            for time in (*(each for each in _TIMES if each < end), end):
                upto = off[t <= time * (1 + 1e-12)]
                yield ErrorAt(t=time, error=float(upto.max(initial=0.0)))

    def _samples(self, end: float) -> Iterator[AuditSample]:
        """The file as it is given at some of its steps."""
        given = self.given
        if not isinstance(given, GivenRun):
            return
        t, off = self._off(given.t, given.q, end)
        kept = np.unique(np.linspace(0, len(t) - 1, min(len(t), _POINTS)).astype(int))
        expected = self.runner.reference(t[kept])
        kinetic, potential = self.read.energies(given.q[kept], given.u[kept])
        energy = sum(self.read.energies(expected.q, expected.u))
        for k, index in enumerate(kept):
            yield AuditSample(
                t=float(t[index]),
                error=float(off[index]),
                energy_error=float((kinetic + potential - energy)[k]),
                q=tuple(map(float, given.q[index])),
                u=tuple(map(float, given.u[index])),
                kinetic_energy=float(kinetic[k]),
                potential_energy=float(potential[k]),
            )

    def _tell(self, what: str, done: int, of: int) -> None:
        if self.progress:
            self.progress(what, done, of)

    def _run(self, options: ModelOptions, end: float, size: float) -> AuditedRun:
        moved = self._moved(options)
        head: dict[str, Any] = {
            "integrator": options.integrator,
            "timestep": options.timestep,
            "explicit_damping": options.explicit_damping,
            "is_given": options == self.read.options,
        }
        if isinstance(moved, str):
            return AuditedRun(**head, message=moved)
        t, off = self._off(moved.t, moved.q, end)
        if len(t) < 2:
            return AuditedRun(**head, message="its step is longer than what is compared.")
        return AuditedRun(
            **head,
            error=float(off.max()),
            leaves=_first(t, off, SHARE * size),
            steps=len(t) - 1,
            processor_time=moved.processor_time * (len(t) - 1) / (len(moved.t) - 1),
        )

    def _causes(self, end: float) -> Iterator[CauseShare]:
        """Errors up to a time with one cause after another taken out.

        What makes the error larger stays in: an integrator of a higher order can be unstable at a
        step that a file has for its own.
        """
        if not isinstance(self.given, GivenRun):
            return
        options, whole = self.read.options, self._largest(self.given, end)
        before = whole
        for cause in self.read.causes:
            self._tell(f"without {cause.name}", 0, 1)
            changed = cause.without(options)
            moved = self._moved(changed)
            head: dict[str, Any] = {"name": cause.name, "change": cause.change}
            if isinstance(moved, str):
                yield CauseShare(**head, message=moved)
                continue
            left = self._largest(moved, end)
            if left > before or not whole:
                yield CauseShare(**head, left=left, message="the error is no smaller: left in")
                continue
            yield CauseShare(**head, left=left, share=(before - left) / whole)
            options, before = changed, left

    def _by_engine(self, name: str, end: float, size: float) -> EngineRun:
        """The mechanism's motion by another engine."""
        self._tell(name, 0, 1)
        head: dict[str, Any] = {"engine": name, "preset": SETTINGS}
        try:
            other = engine(name, SETTINGS)
            head["timestep"] = other.timestep
            found = self._worker.simulate(other, self.runner.problem(other))
            run = refuse_invalid(other.name, found, self.read.mechanism, other.capabilities)
        except Exception as error:  # an engine may raise anything, and the audit goes on
            return EngineRun(**head, message=failure(error)[1])
        t, off = self._off(run.t, run.q, end)
        return EngineRun(**head, error=float(off.max()), leaves=_first(t, off, SHARE * size))

    def _largest(self, moved: GivenRun, end: float) -> float:
        return float(self._off(moved.t, moved.q, end)[1].max())

    def _off(self, t: FloatArray, q: FloatArray, end: float) -> tuple[FloatArray, FloatArray]:
        """Times up to the end, and the largest distance of any point at each [m]."""
        t = t[t <= end * (1 + 1e-12)]
        expected = self._places(self.runner.reference(t).q)
        return t, np.linalg.norm(self._places(q[: len(t)]) - expected, axis=-1).max(axis=1)

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


def _touches_at_start(mechanism: Mechanism) -> InputError:
    return InputError(
        f"bodies of {mechanism.name!r} touch at the start, which the mechanism does not know; give "
        "another start (qpos, qvel or a keyframe)."
    )


def _options(run: AuditedRun) -> ModelOptions:
    return ModelOptions(run.integrator, run.timestep, run.explicit_damping)


def _first(t: FloatArray, off: FloatArray, allowed: float) -> float | None:
    """First time at which an error is larger than what is allowed; None: at none."""
    beyond = t[off > allowed]
    return float(beyond[0]) if len(beyond) else None
