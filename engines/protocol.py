"""The protocol of engines: frozen numerical options, capabilities, and `simulate`."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self, cast, runtime_checkable

import numpy as np
from pydantic import Field, JsonValue, model_validator

from ..models.arrays import FloatArray
from ..models.elements import (
    FORCE_ELEMENTS,
    Coupler,
    FreeJoint,
    PointStop,
    PrismaticJoint,
    SlotJoint,
    TranslationJoint,
    WeldJoint,
)
from ..models.errors import (
    EngineNotInstalledError,
    InputError,
    SimulationError,
    TrebucheckError,
    UnsupportedProblemError,
)
from ..models.features import COVERED_BY_FEATURES, Basic, Feature, refuse_features
from ..models.kinematics import immovable_stops, without_stops
from ..models.mechanism import Mechanism
from ..models.problem import Problem, StopLaw
from ..models.spec import Positive, Spec
from ..models.trajectory import PointMotion, Provenance, Trajectory
from .options import current_name
from .presets import ASSISTED, DEFAULT, SETTINGS
from .reading import clocked
from .study import EngineStudy
from .supplied import NOTHING, Assistance, Supplied, by_part

_MOST_STEPS = 20_000_000
# Of a run's samples while it is read, sent from its process, compared and written: seven were
# measured for an engine while it is read (pymunk, Exudyn), and about as many for what follows.
_COPIES = 16
ABSENT = "not installed"
"""Version of a package that is not here."""
_MEMINFO = Path("/proc/meminfo")
_GROUP = Path("/sys/fs/cgroup")


@dataclass(frozen=True)
class Capabilities:
    """Observations that an engine makes, and mechanisms that it can move."""

    joint_reactions: bool  # forces of the joints, as vectors in the world frame
    joint_gaps: bool  # joints are constraints that can part, and the engine tells how far
    located_releases: bool  # a release is found inside a step, not at its end
    stop_laws: frozenset[StopLaw]  # laws of the stops it can follow
    formulation: str  # coordinates and treatment of constraints, in a few words
    stop_torques: bool = True  # torques and forces of the stops
    features: frozenset[Feature] = frozenset()
    """Elements that it can build beside pins, slots in the ground and stops against it."""
    lacking: frozenset[Basic] = frozenset()  # elements of every mechanism that it cannot build
    elements: frozenset[type] = COVERED_BY_FEATURES
    """Classes of elements that it builds; those of later releases must be stated here."""

    def without(self, elements: Collection[Basic | Feature]) -> Capabilities:
        """The same of an engine whose options take these elements away."""
        lacking = self.lacking | {each for each in elements if isinstance(each, Basic)}
        return replace(self, features=self.features.difference(elements), lacking=lacking)


_FEATURES_OF_CLASSES: Mapping[type, Feature] = {
    FreeJoint: Feature.FREE_JOINT,
    TranslationJoint: Feature.TRANSLATION,
    SlotJoint: Feature.MOVING_SLOT,
    PrismaticJoint: Feature.PRISMATIC,
    WeldJoint: Feature.WELD,
    PointStop: Feature.MOVING_WALL,
    **{element: element.feature for element in FORCE_ELEMENTS},
    Coupler: Feature.COUPLER,
}


def built_features(classes: Collection[type]) -> frozenset[Feature]:
    """Features of an engine that builds these classes of elements on every body.

    Gravity in any direction is among them: it is a property of the mechanism, not of an element.
    """
    features = {feature for element, feature in _FEATURES_OF_CLASSES.items() if element in classes}
    return frozenset({*features, Feature.GRAVITY_DIRECTION})


class Simulator(Protocol):
    """Least interface of a plug-in's engine; the registry adds the rest of :class:`Engine`."""

    @property
    def name(self) -> str:
        """The name it is asked for by."""
        ...

    @property
    def capabilities(self) -> Capabilities:
        """Its capabilities."""
        ...

    def simulate(self, problem: Problem) -> Trajectory:
        """Move the mechanism; raises TrebucheckError if it cannot."""
        ...


@runtime_checkable
class Engine(Simulator, Protocol):
    """Extension point: an engine with its numerical options.

    Name, preset and settings determine it: `engine(name, preset, **settings)` makes it again.
    """

    @property
    def preset(self) -> str:
        """The preset that the options were made from."""
        ...

    @property
    def settings(self) -> dict[str, JsonValue]:
        """Numerical options by name, as JSON values; without the preset's name."""
        ...

    @property
    def timestep(self) -> float | None:
        """Step size [s]; None where the engine has none."""
        ...


@dataclass(frozen=True)
class Recording:
    """Result of an engine's run; fields as in :class:`..models.trajectory.Trajectory`."""

    t: FloatArray
    q: FloatArray
    u: FloatArray
    markers: Mapping[str, PointMotion]
    kinetic_energy: FloatArray
    potential_energy: FloatArray
    stop_torques: Mapping[str, FloatArray]
    release_times: Mapping[str, float | None]
    joint_reactions: Mapping[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    joint_gaps: Mapping[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    impacts: tuple[tuple[float, Mapping[str, float]], ...] = ()
    steps: int = 0


@cache
def version_of(package: str) -> str:
    """Version of a distribution; 'not installed' if there is none.

    Read once: its metadata takes milliseconds to parse, as long as a short run.
    """
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ABSENT


class EngineOptions(Spec):
    """Numerical options of an engine: frozen, validated, recorded with every trajectory."""

    preset: str = Field(default=ASSISTED, description="the preset these options were made from")
    timestep: Positive = Field(default=1e-3, le=1.0, description="step size [s]")

    @model_validator(mode="before")
    @classmethod
    def _read_old_names(cls, options: Any) -> Any:
        """Take options by the names that they had in an earlier release."""
        if not isinstance(options, Mapping):
            return options
        given = dict(cast("Mapping[str, Any]", options))
        for name in list(given):
            current = current_name(name, cls.model_fields)
            if current not in given:  # an option under both names is refused as unknown
                given[current] = given.pop(name)
        return given

    @property
    def settings(self) -> dict[str, JsonValue]:
        """Numerical options by name, as JSON values; without the preset's name."""
        return self.model_dump(mode="json", exclude={"preset"})


class BuiltinEngine(EngineOptions, ABC):
    """Base class of engines; fields are numerical options, their defaults the assisted preset."""

    name: ClassVar[str]
    package: ClassVar[str]
    """Distribution whose version is reported, and module that must be importable."""
    module: ClassVar[str | None] = None
    """The module, where it has another name than the distribution."""
    capabilities: ClassVar[Capabilities]
    default_options: ClassVar[Mapping[str, object] | None] = None
    """The engine's own defaults, where they differ from the assisted preset; None: no such preset.

    An engine without steps of its own has neither this nor :attr:`settings_options`.
    """
    settings_options: ClassVar[Mapping[str, object] | None] = None
    """Options of the engine itself with the least error, where they differ from `assisted`."""
    assistance: ClassVar[tuple[Assistance, ...] | None] = None
    """All that trebucheck does in the engine's place, each with the options that switch it off.

    None: not stated.
    """
    readings: ClassVar[Supplied] = NOTHING
    """Quantities that the adapter computes from the engine's motion, with every option."""
    tables: ClassVar[EngineStudy] = EngineStudy()
    """Entries for studies; the default is those of any engine."""

    @classmethod
    def presets(cls) -> dict[str, Callable[..., Self]]:
        """Makers of this engine by the name of the preset."""
        changed = {DEFAULT: cls.default_options, SETTINGS: cls.settings_options, ASSISTED: {}}
        return {
            preset: partial(cls._made, preset, options)
            for preset, options in changed.items()
            if options is not None
        }

    @classmethod
    def _made(cls, preset: str, changed: Mapping[str, object], /, **options: Any) -> Self:
        fields: dict[str, Any] = {**changed, "preset": preset, **options}
        return cls(**fields)

    @classmethod
    def study(cls) -> EngineStudy:
        """The tables that studies use of this engine."""
        return cls.tables

    @classmethod
    def is_installed(cls) -> bool:
        """Tell whether the engine's package is installed; a folder left behind is not enough.

        A class without a package is all of its engine.
        """
        name = cls.module or getattr(cls, "package", "")
        if cls.version() == ABSENT:
            return False
        return not name or importlib.util.find_spec(name) is not None

    @classmethod
    def version(cls) -> str:
        """Version of the engine's package; 'not installed' if there is none."""
        return version_of(cls.package)

    def simulate(self, problem: Problem) -> Trajectory:
        """Move the mechanism from its start.

        Raises:
            EngineNotInstalledError: the engine's package is not here.
            UnsupportedProblemError: the engine cannot build the mechanism or follow its stops' law.
            SimulationError: the engine gave up, crashed or left the finite numbers.
        """
        self._refuse_what_cannot_run(problem)
        mechanism, (movable, idle) = problem.mechanism, _without_idle_stops(problem)
        started = time.perf_counter()
        try:
            # Overflow on the way to a divergence is reported once, by the check of the result.
            with np.errstate(all="ignore"), clocked() as clock:
                recording = self._run(movable)
        except TrebucheckError:
            raise
        except Exception as error:
            raise SimulationError(f"{self.name} failed: {type(error).__name__}: {error}") from error
        wall, processor = time.perf_counter() - started, clock.elapsed()
        self._refuse_wrong_result(problem, recording)
        if idle:
            no_torques = dict.fromkeys(idle, np.zeros(len(recording.t)))
            recording = replace(
                recording,
                stop_torques={**recording.stop_torques, **no_torques},
                release_times={**recording.release_times, **dict.fromkeys(idle)},
            )
        provenance = Provenance(
            engine=self.name,
            engine_version=self.version(),
            preset=self.preset,
            settings=self.settings,
            mechanism_hash=mechanism.content_hash,
            duration=problem.duration,
            stop_law=problem.stop_law.value,
            steps=recording.steps,
            wall_time=wall,
            processor_time=processor,
            reading_time=clock.reading,
        )
        fields = {key: value for key, value in vars(recording).items() if key != "steps"}
        return Trajectory(mechanism=mechanism, provenance=provenance, **fields)

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Elements that these options take away from its capabilities."""
        return frozenset()

    @property
    def assisted_by(self) -> tuple[Assistance, ...]:
        """The assistance that these options ask for; the engine is alone where there is none."""
        settings = self.settings
        return tuple(each for each in self.assistance or () if each.is_on(settings))

    @property
    def supplied(self) -> Supplied | None:
        """Parts of a run that trebucheck does with these options; None: not stated."""
        if self.assistance is None:
            return None
        return {**self.readings, **by_part(self.assisted_by)}

    def script(self, problem: Problem) -> str:
        """A program with nothing but the engine's interface whose states are those of a run.

        It leaves arrays `t` [s] of shape (n,) and `q`, `u` of shape (n, n_q): the coordinates and
        speeds of the mechanism, equal to those of :meth:`simulate` to the last bit.

        Raises:
            InputError: with these options trebucheck does a part of the run.
            UnsupportedProblemError: the adapter writes no program, or cannot build the mechanism.
        """
        self._refuse_what_cannot_run(problem)
        if self.supplied is None or self.assisted_by:
            does = "; ".join(each.does or each.part for each in self.assisted_by) or "not stated"
            raise InputError(
                f"{self.name} has no program of its own with these options, as trebucheck takes "
                f"part in the run: {does}. The presets {DEFAULT!r} and {SETTINGS!r} have one."
            )
        return self._script(_without_idle_stops(problem)[0])

    def _script(self, problem: Problem) -> str:
        """Write the program of :meth:`script`."""
        raise UnsupportedProblemError(f"the adapter of {self.name} writes no program of a run.")

    @abstractmethod
    def _run(self, problem: Problem) -> Recording:
        """Build, run and read out; docs/plugins.md has units, signs and frames of the recording."""

    @classmethod
    def absence(cls) -> str:
        """A sentence for an engine that is not installed, with the command that installs it."""
        return f"engine {cls.name!r} is not installed here; `pip install {cls.package}` brings it."

    def refuse_absence(self) -> None:
        """Raise EngineNotInstalledError if the engine is not here, before its library is missed."""
        if not self.is_installed():
            raise EngineNotInstalledError(self.absence())

    def _refuse_what_cannot_run(self, problem: Problem) -> None:
        refuse_no_problem(problem)
        self.refuse_absence()
        able, law = self.capabilities.without(self.lacking), problem.stop_law
        who = f"{self.name} with these options" if self.lacking else self.name
        refuse_features(problem.mechanism, able.features, who, able.lacking, law, able.elements)
        if problem.mechanism.stops and problem.stop_law not in self.capabilities.stop_laws:
            laws = ", ".join(sorted(self.capabilities.stop_laws))
            raise UnsupportedProblemError(
                f"{self.name} cannot follow the {problem.stop_law.value} law of a stop; it can "
                f"follow: {laws}."
            )
        if self.timestep > problem.duration:
            raise InputError(
                f"timestep = {self.timestep!r} s must not be longer than the duration of "
                f"{problem.duration!r} s."
            )
        steps, most = problem.duration / self.timestep, _MOST_STEPS
        if steps > most:
            raise InputError(
                f"timestep = {self.timestep!r} s makes more than {most} steps of "
                f"{problem.duration!r} s; at least {problem.duration / most:.3g} s is needed."
            )
        need, available = steps * _sample_size(problem.mechanism), available_memory()
        if need > available:
            raise InputError(
                f"timestep = {self.timestep!r} s makes {steps:.3g} steps of {problem.duration!r} "
                f"s, for which some {need / 1e9:.3g} GB of memory are needed and "
                f"{available / 1e9:.3g} GB are available; at least "
                f"{self.timestep * need / available:.3g} s is needed."
            )

    def _refuse_wrong_result(self, problem: Problem, recording: Recording) -> None:
        """Check type, coordinates and speeds; everything else is judged with the trajectory."""
        if not isinstance(recording, Recording):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise SimulationError(
                f"{self.name}: _run returned {type(recording).__name__}; a Recording is needed."
            )
        needed = (*np.shape(recording.t), len(problem.mechanism.coordinates))
        for name in ("q", "u"):
            if (shape := np.shape(getattr(recording, name))) != needed:
                raise SimulationError(
                    f"{self.name}: {name} has shape {shape}; {needed}, (samples, coordinates), "
                    f"is needed."
                )
        finite = np.isfinite(recording.q).all(axis=1) & np.isfinite(recording.u).all(axis=1)
        if not finite.all():
            first = float(recording.t[int(np.argmin(finite))])
            raise SimulationError(
                f"{self.name} diverged: its state is not finite at t = {first:.6g} s."
            )


def _without_idle_stops(problem: Problem) -> tuple[Problem, tuple[str, ...]]:
    """The problem without stops whose gap nothing can change, and their names.

    Such a stop has no unique force: engines run without them.
    """
    mechanism, idle = problem.mechanism, immovable_stops(problem.mechanism)
    if not idle:
        return problem, idle
    return problem.model_copy(update={"mechanism": without_stops(mechanism, idle)}), idle


def refuse_no_problem(given: object) -> None:
    """Raise InputError for a mechanism, or anything else, that is given for a problem."""
    if not isinstance(given, Problem):
        what = "a Mechanism" if isinstance(given, Mechanism) else type(given).__name__
        raise InputError(
            f"simulate({what}) does not say for how long: simulate(tb.Problem(mechanism, "
            f"duration=2.6)) does, in s."
        )


def _sample_size(mechanism: Mechanism) -> int:
    """Memory for one instant of a trajectory, with its copies [B]."""
    # Time, energies, states, points.
    columns = 3 + 2 * len(mechanism.coordinates) + 4 * len(mechanism.markers)
    columns += len(mechanism.stops) + 3 * len(mechanism.joints)  # forces; reactions and drifts
    return 8 * columns * _COPIES


def available_memory() -> float:
    """Memory that can be taken without swapping [B]; infinite if unknown."""
    limits = [float("inf")]
    with suppress(OSError, ValueError):  # Linux; counts what is only cached as available
        for line in _MEMINFO.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                limits.append(1024.0 * int(line.split()[1]))
    with suppress(OSError, ValueError):  # a container's limit; "max" where it has none
        limit, used = (int((_GROUP / f"memory.{name}").read_text()) for name in ("max", "current"))
        limits.append(float(limit - used))
    if not _MEMINFO.exists():
        with suppress(OSError, ValueError, AttributeError):
            limits.append(float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")))
    return min(limits)
