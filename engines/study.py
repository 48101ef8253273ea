"""Tables of an engine for studies: causes of error, swept parameters, option sets, tolerances.

Each engine gives an :class:`EngineStudy` by the class method `study`; every field has a default,
which holds for an engine that supplies nothing. The tables hold data and functions of options only:
reading them runs no engine.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from pydantic import JsonValue

from ..models.arrays import FloatArray
from ..models.controls import ControlRecord
from ..models.mechanism import Mechanism
from .presets import ASSISTED, MEANINGS, PRESETS

Options = Mapping[str, Any]

REFINEMENT = 8
"""Steps in one of the base: 1/64 of a second-order error is left, whatever the order is."""


@dataclass(frozen=True)
class ConstraintKinds:
    """Kinds of constraints in a mechanism, for options of engines that act on one kind only."""

    angles: bool = True  # stops on angles
    points: bool = False  # stops on points, joints that close loops, or couplers

    @classmethod
    def of(cls, mechanism: Mechanism | None) -> ConstraintKinds:
        """Read the kinds of a mechanism; with none, of the paper's, whose stops are on angles."""
        if mechanism is None:
            return cls()
        return cls(bool(mechanism.angle_stops), bool(mechanism.point_stops or mechanism.bound_by))


@dataclass(frozen=True)
class Intervention:
    """A change of a run that removes or scales a cause of error."""

    options: Mapping[str, JsonValue] = field(default_factory=dict[str, JsonValue])
    """Options of the engine that are set otherwise."""
    point_inertia: float | None = None  # inertia given to bodies that have none [kg m^2]
    own_kinematics: bool = False
    """Whether positions, speeds and energies are computed from the engine's coordinates."""
    filtered_torques: bool = False  # whether torques are rid of what changes sign with every step
    leaves: float = 0.0
    """What is left of the cause's error: 0 if it is taken out, 2 if it is doubled."""

    def changes(self, settings: Options) -> bool:
        """Tell whether it does anything to a run with these settings."""
        reads = self.own_kinematics or self.filtered_torques or self.point_inertia is not None
        return reads or bool(self._changed_options(settings))

    def _changed_options(self, settings: Options) -> list[str]:
        changed = self.options.items()
        return [name for name, value in changed if not same_value(settings.get(name), value)]

    def described(self, settings: Options) -> str:
        """The change of a run with these settings, in one line."""
        parts: list[str] = []
        for name in self._changed_options(settings):
            old, new = settings.get(name), self.options[name]
            parts.append(f"{name} {_format_option(old)} → {_format_option(new)}")
        if self.point_inertia is not None:
            parts.append(f"point masses given an inertia of {self.point_inertia:g} kg m²")
        if self.own_kinematics:
            parts.append("read from the coordinates instead")
        if self.filtered_torques:
            parts.append(
                "torques passed through a filter that stops what alternates from step to step"
            )
        if 0 < self.leaves < 1:
            parts.append(f"which leaves {self.leaves:.3g} of it")
        elif self.leaves:
            parts.append(f"which makes it {self.leaves:g} times as large")
        return ", ".join(parts)


@dataclass(frozen=True)
class Cause:
    """A named cause of an engine's error."""

    name: str
    explanation: str  # one line
    removal: Intervention | None = None  # takes it out; several removals can be made together
    scaling: Intervention | None = None
    """Makes it larger by itself: the only measure of it, or a second one."""
    after: tuple[str, ...] = ()
    """Causes to be taken out first: with them, this removal would add an error of its own."""

    @property
    def options(self) -> Mapping[str, JsonValue]:
        """The changes of options that measure it; empty where it is not an option's."""
        chosen = self.removal or self.scaling
        return {} if chosen is None else chosen.options


def time_step_cause(
    finer: Mapping[str, JsonValue], leaves: float = 0.0, after: tuple[str, ...] = ()
) -> Cause:
    """The time step as a cause; the `finer` options leave that share of its error."""
    text = "what a step leaves out; taken out by shorter steps, all else as it is"
    return Cause("time step", text, Intervention(finer, leaves=leaves), after=after)


def with_readout(*causes: Cause) -> tuple[Cause, ...]:
    """The causes, and the readout as the last one.

    Last in every order: where joints have drifted, coordinates stand for another mechanism than the
    markers show.
    """
    text = (
        "the engine's markers and energies, against its own coordinates through the machine's "
        "kinematics"
    )
    before = tuple(cause.name for cause in causes if cause.removal is not None)
    return *causes, Cause("readout", text, Intervention(own_kinematics=True), after=before)


def time_step_only(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    """Causes of an engine of which nothing is known but its time step."""
    h = settings.get("timestep")
    return (time_step_cause({"timestep": h / REFINEMENT}),) if isinstance(h, float) else ()


@dataclass(frozen=True)
class SweptParameter:
    """One option of an engine and preset, with the values it is swept through.

    Where `without` is given, exponents are of the part of the error that the parameter makes: the
    difference, as a function of time, to the run without it. So the time step's error, which is
    always there, does not hide the law.
    """

    name: str  # the option's, which `--knobs` asks for
    title: str
    unit: str
    values: tuple[float, ...]  # from coarse to fine
    options: Callable[[float], Options]  # what a value means to the engine
    why: str  # where the expected exponent comes from, or why none is expected
    expected: float | None = None
    preset: str = ASSISTED
    base: Options = field(default_factory=dict[str, Any])
    """Options that stay as they are, over the preset's."""
    without: Options | None = None  # options that take the parameter's own error out
    repeats: int = 1  # how often a value is timed, unless its run is long

    @property
    def requires(self) -> set[str]:
        """Names of the options it needs."""
        return {*self.base, *self.options(self.values[0])}


def geometric(coarse: float, fine: float, n: int) -> tuple[float, ...]:
    """N values in equal ratios."""
    return tuple(float(value) for value in np.geomspace(coarse, fine, n))


SCHEME_NAMES = (
    "RK4, joint coordinates",
    "error-controlled Runge-Kutta, joint coordinates",
    "trapezoidal rule, index 2",
    "generalised alpha, index 3",
    "leapfrog, impulses",
    "semi-implicit Euler, joint coordinates",
    "semi-implicit Euler, impulses",
)
"""Schemes by which engines are grouped: the rule of a step, and what it is applied to.

It is applied to joint coordinates, to the equations of bodies with constraints of an index, or to
impulses between bodies.
"""


@dataclass(frozen=True)
class StepOrder:
    """Power of the time step with which an engine's error is expected to fall."""

    order: float | None  # None: with no power
    reason: str
    scheme: str = ""
    """Name of the scheme, common to all engines with it: of :data:`SCHEME_NAMES` where one fits."""


_Change = Callable[[Options, ConstraintKinds], dict[str, Any] | None]


@dataclass(frozen=True)
class Refinement:
    """One option set a little finer, to see whether an error falls with it."""

    cause: str
    description: str
    change: _Change
    """The changed options at an engine's settings; None where nothing can be refined."""


def multiplied(option: str, factor: float) -> _Change:
    """A :class:`Refinement`'s change that multiplies an option which is set and not zero."""

    def change(settings: Options, _: ConstraintKinds) -> dict[str, Any] | None:
        value = settings.get(option)
        return None if not value else {option: type(value)(value * factor)}

    return change


HALF_THE_STEP = Refinement("time step", "half the time step", multiplied("timestep", 0.5))


@dataclass(frozen=True)
class OptionSet:
    """Options of an engine, all but the time step, that may be recommended."""

    name: str
    description: str  # how it differs from the others, in a few words
    preset: str
    options: Options = field(default_factory=dict[str, Any])  # where they differ from the preset's
    scaled: Callable[[float], Options] = lambda _: {}  # options that follow from the step [s]

    def all_options(self, step: float) -> dict[str, Any]:
        """Options over the preset at a step [s]."""
        return {"timestep": step, **self.options, **self.scaled(step)}


DEFAULT_SET, SETTINGS_SET, ASSISTED_SET = (
    OptionSet(preset, MEANINGS[preset], preset) for preset in PRESETS
)


@dataclass(frozen=True)
class Tolerance:
    """Agreement with the reference that a preset claims, with the reason for its amount."""

    preset: str
    metric: str
    value: float
    timestep: float  # step the value is stated for [s]
    order: int  # order in the step with which the value grows at longer steps
    reason: str  # why just that much
    per: str = ""  # '': in the metric's unit; 'start' or 'peak': times the stop's torque there
    subject: str | None = None  # marker, stop or joint; None: any
    model: str | None = None  # name of the mechanism; None: any
    on_points: bool | None = None
    """Whether it is for stops on points (True), on angles (False), or any (None)."""

    def fits(self, preset: str, metric: str, subject: str | None, mechanism: Mechanism) -> bool:
        """Tell whether it is about this metric."""
        points = {stop.name for stop in mechanism.point_stops}
        return (
            (self.preset, self.metric) == (preset, metric)
            and self.subject in (None, subject)
            and self.model in (None, mechanism.name)
            and self.on_points in (None, subject in points)
        )


@dataclass(frozen=True)
class MaintainersNote:
    """Three sentences for those who maintain an engine, on its page in `docs/engines`.

    They are Jinja templates: a number is not written, but read from the engine's results, as in
    `{{ best.error("pendulum", "position") }}`; `comparisons/report/pages/matrix.py` has what can be
    read.
    """

    chosen: str
    """Which options were set, and why."""
    not_possible: str
    """Features that could not be built, set or read."""
    would_change: str
    """What of the engine, its binding or the adapter would change the results."""


_Snippets = Callable[[Any, Mechanism, float], Mapping[str, str]]


@dataclass(frozen=True)
class ModelStates:
    """Values of an engine's model at n states, in a mechanism's coordinates and names."""

    t: FloatArray
    """Time whose recorded controls act in each state, shape (n,) [s]."""
    q: FloatArray
    """Coordinates, shape (n, n_q)."""
    u: FloatArray
    """Speeds, shape (n, n_q)."""
    a: FloatArray
    """Accelerations without stops and loops, shape (n, n_q)."""
    mass: FloatArray | None
    """Mass matrix, shape (n, n_q, n_q); None: the engine has none."""
    gaps: Mapping[str, FloatArray]
    """Gap of each stop, shape (n,) [rad or m]."""
    markers: Mapping[str, FloatArray]
    """Position of each marker, shape (n, 2) [m]."""
    loops: Mapping[str, tuple[FloatArray, FloatArray]]
    """Distance of each loop joint's points [m], and |sin| of half the error of its angle, (n,).
    """
    couplers: Mapping[str, FloatArray] = field(default_factory=dict[str, Any])
    """Error of each coupler's coordinate, shape (n,) [rad or m]."""


@dataclass(frozen=True)
class GivenRun:
    """A model file moved by its engine as it is given, or with other options."""

    t: FloatArray
    """Times of the steps, shape (n,) [s]."""
    q: FloatArray
    """Coordinates of the mechanism that was read, shape (n, n_q)."""
    u: FloatArray
    """Speeds, shape (n, n_q)."""
    contact: float | None
    """Last time before something acts that the mechanism has not [s]; None: nothing does."""
    processor_time: float
    """Processor time of the steps alone [s]."""


@dataclass(frozen=True)
class ModelStart:
    """Start of a model file, and what of the file is left out."""

    keyframe: str | int | None = None
    """Name or number of the file's keyframe to start from."""
    qpos: Sequence[float] | None = None
    """Positions, in place of the keyframe's or of the file's own."""
    qvel: Sequence[float] | None = None
    """Velocities, in place of the keyframe's or of rest."""
    ctrl: Sequence[float] | ControlRecord | None = None
    """Controls, constant or recorded, in place of the keyframe's or of zeros."""
    without: Collection[str] = ()
    """Features to leave out: "contacts" of the file's own motion, too, "limits", "friction-loss",
    "fluid", "actuators", "equalities", "tendons"."""


@dataclass(frozen=True, eq=False)
class Episode:
    """An episode of an environment: its model, the start, and the controls that were set."""

    name: str
    model: Any
    """Compiled by its engine."""
    qpos: FloatArray
    """Positions at the start, in the model's order."""
    qvel: FloatArray
    """Velocities at the start."""
    controls: ControlRecord
    duration: float
    """When it ended [s]."""


Policy = Callable[[Any], Any]
"""Chooses an action by what was observed."""


@dataclass(frozen=True)
class ModelOptions:
    """Options with which a model file is moved."""

    integrator: str
    timestep: float
    """[s]"""
    explicit_damping: bool = False
    """Whether an integrator that treats damping implicitly, and nothing else, does not."""
    stiff: bool = False
    """Whether limits and loops are as stiff as the step can bear, in place of the file's own."""
    damped: bool = False
    """Whether limits are damped so that nothing rebounds from them, in place of the file's own."""


@dataclass(frozen=True)
class ModelCause:
    """A cause of a model file's error, and the change of its options that takes it out."""

    name: str
    change: str
    """Change, in a few words."""
    without: Callable[[ModelOptions], ModelOptions]

    @classmethod
    def of_integrator(cls, given: ModelOptions, other: str) -> ModelCause:
        """The integrator, with another one in its place."""
        change = f"{other} in place of {given.integrator}"
        return cls("integrator", change, partial(replace, integrator=other))

    @classmethod
    def of_step(cls, given: ModelOptions) -> ModelCause:
        """The time step, with a :data:`REFINEMENT`th of it in its place."""
        step = given.timestep / REFINEMENT
        change = f"a step of {step:g} s in place of {given.timestep:g} s"
        return cls("time step", change, partial(replace, timestep=step))


class ReadsModel(Protocol):
    """Reader of an engine's model files."""

    def __call__(self, source: str | Path | Any, start: ModelStart) -> ModelFile:
        """Read a path, the text of a file, or a compiled model.

        Raises:
            InputError: the file or the start is not valid.
            UnsupportedProblemError: a mechanism has no counterpart of it; the sentence says what.
            ImportError: the engine is not installed.
        """
        ...


@runtime_checkable
class ModelFile(Protocol):
    """A model of an engine's own as a mechanism, and how its coordinates follow from the model's.

    Another simulator's model is one, too, if it has these members: `tb.audit` takes it.
    """

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that was read."""
        ...

    @property
    def left_out(self) -> tuple[str, ...]:
        """Features of the file that the mechanism has not, each in a few words."""
        ...

    @property
    def engine(self) -> str:
        """Name of its engine."""
        ...

    @property
    def engine_version(self) -> str:
        """Version of the engine here."""
        ...

    @property
    def options(self) -> ModelOptions:
        """Options that the file gives."""
        ...

    @property
    def integrators(self) -> tuple[str, ...]:
        """Integrators of the engine that an audit tries."""
        ...

    @property
    def variants(self) -> tuple[ModelOptions, ...]:
        """Options that an audit tries beside integrators and steps."""
        ...

    @property
    def causes(self) -> tuple[ModelCause, ...]:
        """Causes of its error, in the order in which they are taken out, one after another."""
        ...

    def option_text(self, options: ModelOptions) -> str:
        """Text of these options, as it stands in a file."""
        ...

    def random_states(self, number: int) -> ModelStates:
        """The engine's own values at random states, without stops and loops."""
        ...

    def energies(self, q: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The engine's own kinetic and potential energies at states, each of shape (n,) [J]."""
        ...

    def moved(self, duration: float, options: ModelOptions) -> GivenRun:
        """Move the file's own model, nothing left out, for a time [s].

        Raises:
            SimulationError: its state is not finite any more.
        """
        ...


@dataclass(frozen=True)
class EngineStudy:
    """Tables of one engine; each default holds for an engine that states nothing."""

    causes: Callable[[Any, ConstraintKinds], tuple[Cause, ...]] = time_step_only
    """Causes of its error, from settings and kinds of constraints, in the order of removal."""
    swept_parameters: tuple[SweptParameter, ...] = ()
    """Beside the time step, which is swept for every engine."""
    step_orders: Mapping[str, StepOrder] = field(default_factory=dict[str, StepOrder])  # by preset
    refinements: tuple[Refinement, ...] = (HALF_THE_STEP,)
    option_sets: tuple[OptionSet, ...] = ()  # from plain to assisted; none: one a preset
    tolerances: tuple[Tolerance, ...] = ()
    snippets: _Snippets = lambda _engine, _mechanism, _duration: {}
    """Texts to paste by title, from engine, mechanism and a duration [s] that has most launches."""
    single_precision: Callable[[Options], bool] = lambda _: False
    """Whether its state, or what moves it, is rounded to single precision with these options."""
    additions: Callable[[Options], int] = lambda _: 1
    """How often a time step adds to the state with these options: once, or in each substep."""
    read_model: ReadsModel | None = None
    """Reader of MJCF and URDF files."""
    as_given: Callable[..., Any] | None = None
    """Maker of the :class:`.given.GivenModel` that moves such a file as it is, from its options."""
    record_episode: Callable[[str | Any, float, int, Policy | None], Episode] | None = None
    """Recorder of an environment's episode: the environment, its duration [s], a seed, a policy."""
    title: str = ""  # as its authors write it; '': its name
    binding: str = ""
    """Distribution by which it is run, and what that is built from, without its version."""
    maintainers_note: MaintainersNote | None = None
    colour: str | None = None  # in plots, as '#rrggbb'; None: one follows from the engine's name


def same_value(a: JsonValue, b: JsonValue) -> bool:
    """Tell whether two values of an option are equal; in JSON a tuple is a list."""
    return a == b or (
        isinstance(a, list | tuple) and isinstance(b, list | tuple) and list(a) == list(b)
    )


def _format_option(value: JsonValue) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return "(" + ", ".join(_format_option(part) for part in value) + ")"
    return "unset" if value is None else str(value)


def filled_template(module: str, name: str, **values: Any) -> str:
    """A text to paste from a Jinja template in the folder `templates` beside a module.

    In templates, `number` and `numbers` write the shortest decimals that read back to the same
    float64.
    """
    from jinja2 import Environment, StrictUndefined  # only `recommend` needs it

    def number(value: float) -> str:
        return repr(float(value)).removesuffix(".0")

    def numbers(values: Sequence[float]) -> str:
        return " ".join(map(number, values))

    environment = Environment(  # nothing here is HTML
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, autoescape=False
    )
    text = (files(module.rpartition(".")[0]) / "templates" / name).read_text(encoding="utf-8")
    template = environment.from_string(text)
    return template.render(number=number, numbers=numbers, **values).strip("\n")
