"""A model file as an engine: the file that a mechanism was read from, moved as it is.

An engine with such files has a subclass of :class:`GivenModel` in its study (`as_given`); the
registry makes it by the preset `given`.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from pydantic import Field, JsonValue

from ..models.arrays import FloatArray
from ..models.errors import (
    EngineNotInstalledError,
    InputError,
    SimulationError,
    TrebucheckError,
    UnsupportedProblemError,
)
from ..models.features import Feature
from ..models.kinematics import Kinematics
from ..models.mechanism import Mechanism
from ..models.model_source import ModelSource
from ..models.problem import Problem, StopLaw
from ..models.spec import Positive, Spec
from ..models.trajectory import PointMotion, Provenance, Trajectory
from .presets import GIVEN
from .protocol import ABSENT, Capabilities, version_of
from .study import GivenRun, ModelFile, ModelOptions
from .supplied import NOTHING, Supplied


class GivenModel(Spec, ABC):
    """An engine that moves the file that a mechanism was read from, with nothing left out.

    Options are the file's where they are not set. Joint forces and torques of stops are not read;
    a stop is called released at the end of the last step that begins at it or beyond.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    preset: str = Field(default=GIVEN, description="the preset these options were made from")
    timestep: Positive | None = Field(
        default=None, le=1.0, description="step size [s]; None: the file's"
    )
    integrator: str | None = Field(default=None, description="the engine's name; None: the file's")
    explicit_damping: bool = Field(
        default=False, description="damping that Euler's rule takes implicitly is taken explicitly"
    )
    stiff: bool = Field(
        default=False, description="limits and loops are as stiff as the step can bear"
    )

    name: ClassVar[str]
    package: ClassVar[str]
    """Distribution whose version is reported."""
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=False,
        joint_gaps=False,
        located_releases=False,
        stop_laws=frozenset(StopLaw),
        formulation="as the file has it",
        stop_torques=False,
        features=frozenset(Feature),
    )
    supplied: ClassVar[Supplied] = NOTHING

    @property
    def settings(self) -> dict[str, JsonValue]:
        """Numerical options by name, as JSON values; without the preset's name."""
        return self.model_dump(mode="json", exclude={"preset"})

    @classmethod
    def version(cls) -> str:
        """Version of the engine's package; 'not installed' if there is none."""
        return version_of(cls.package)

    @abstractmethod
    def read(self, source: ModelSource) -> ModelFile:
        """Read a mechanism again from its file, which is moved with these options.

        Raises:
            TrebucheckError: the file cannot be read any more.
        """

    def of(self, mechanism: Mechanism) -> Self:
        """The same with the options of the mechanism's file where none are set.

        Raises:
            UnsupportedProblemError: the mechanism was not read from a file, or is another one now.
        """
        given = self._file_of(mechanism).options
        return self.model_copy(
            update={
                "timestep": self.timestep or given.timestep,
                "integrator": self.integrator or given.integrator,
            }
        )

    def simulate(self, problem: Problem) -> Trajectory:
        """Move the file from the start that it was read with.

        Raises:
            UnsupportedProblemError: the mechanism was not read from a file, or is another one now,
                or its stops are to release once.
            EngineNotInstalledError: the engine's package is not here.
            InputError: the engine has no integrator of that name, or a step is longer than the
                problem.
            SimulationError: the state is not finite any more, or a contact acts before the end.
        """
        mechanism = problem.mechanism
        read, options = self._file_of(mechanism), self.of(mechanism)._model_options()
        known = dict.fromkeys((read.options.integrator, *read.integrators))
        if options.integrator not in known:
            raise InputError(
                f"integrator = {options.integrator!r} is none of those that {self.name} can move "
                f"the file with: {', '.join(known)}."
            )
        if options.timestep > problem.duration:
            raise InputError(
                f"timestep = {options.timestep!r} s must not be longer than the duration of "
                f"{problem.duration!r} s."
            )
        if mechanism.stops and problem.stop_law is not StopLaw.UNILATERAL:
            raise UnsupportedProblemError(
                f"the limits of {mechanism.name!r} stay in its file; {problem.stop_law.value} "
                f"takes them out. The law {StopLaw.UNILATERAL.value} keeps them."
            )
        started = time.perf_counter()
        try:
            run = read.moved(problem.duration, options)
        except TrebucheckError:
            raise
        except Exception as error:
            raise SimulationError(f"{self.name} failed: {type(error).__name__}: {error}") from error
        if run.contact is not None and run.contact < problem.duration:
            raise SimulationError(
                f"a contact acts in the file of {mechanism.name!r} from {run.contact:g} s on, "
                f"which the mechanism has not; it can be compared until then."
            )
        return self._trajectory(problem, read, options, run, time.perf_counter() - started)

    def _model_options(self) -> ModelOptions:
        assert self.integrator is not None  # `of` has set both
        assert self.timestep is not None
        return ModelOptions(self.integrator, self.timestep, self.explicit_damping, self.stiff)

    def _file_of(self, mechanism: Mechanism) -> ModelFile:
        if mechanism.source is None:
            raise UnsupportedProblemError(
                f"the preset {GIVEN!r} moves the model file that a mechanism was read from; "
                f"{mechanism.name!r} was read from none."
            )
        if self.version() == ABSENT:
            raise EngineNotInstalledError(
                f"engine {self.name!r} is not installed here; `pip install {self.package}` brings "
                "it."
            )
        read = self.read(mechanism.source)
        now = read.mechanism.model_copy(update={"name": mechanism.name})
        if now.content_hash != mechanism.content_hash:
            where = mechanism.source.path or "its text"
            raise UnsupportedProblemError(
                f"{mechanism.name!r} is another mechanism than {where} has now: one of them was "
                "changed after it was read."
            )
        return read

    def _trajectory(
        self,
        problem: Problem,
        read: ModelFile,
        options: ModelOptions,
        run: GivenRun,
        wall_time: float,
    ) -> Trajectory:
        mechanism, kinematics = problem.mechanism, Kinematics(problem.mechanism)
        rows = {each.name: kinematics.point(each.body, each.point) for each in mechanism.markers}
        kinetic, potential = read.energies(run.q, run.u)
        return Trajectory(
            mechanism=mechanism,
            t=run.t,
            q=run.q,
            u=run.u,
            markers={
                name: PointMotion(
                    kinematics.position(row, run.q), kinematics.velocity(row, run.q, run.u)
                )
                for name, row in rows.items()
            },
            kinetic_energy=kinetic,
            potential_energy=potential,
            stop_torques={},
            release_times={
                stop.name: _release(run.t, kinematics.gap(stop.name, run.q))
                if stop.closed
                else None
                for stop in mechanism.stops
            },
            joint_reactions={},
            provenance=Provenance(
                engine=self.name,
                engine_version=self.version(),
                preset=self.preset,
                settings=self.of(mechanism).settings,
                mechanism_hash=mechanism.content_hash,
                duration=problem.duration,
                stop_law=problem.stop_law.value,
                steps=len(run.t) - 1,
                wall_time=wall_time,
                processor_time=run.processor_time,
            ),
        )


@dataclass(frozen=True)
class SteppedModel:
    """States of a compiled model at the start and after each of n steps."""

    qpos: FloatArray
    """Shape (n + 1, nq)."""
    qvel: FloatArray
    """Shape (n + 1, nv)."""
    contact: int | None
    """Number of the first step in which bodies touch, from 0; None: they never do."""
    processor_time: float
    """Processor time of the steps alone [s]."""


class ModelStepper(Protocol):
    """An engine that steps MuJoCo's compiled models, as MuJoCo does; :mod:`.mujoco.planar`."""

    @property
    def engine(self) -> str:
        """Name of the engine."""
        ...

    @property
    def engine_version(self) -> str:
        """Version of the engine here."""
        ...

    @property
    def integrators(self) -> tuple[str, ...]:
        """Integrators that an audit tries."""
        ...

    def stepped(self, model: Any, start: Any, controls: FloatArray) -> SteppedModel:
        """Step a model, which is the stepper's own, once for each row of controls.

        Args:
            model: MuJoCo's.
            start: MuJoCo's data, of which the stepper takes a copy.
            controls: of all actuators, held for a step, shape (n, nu).

        Raises:
            SimulationError: the engine gave up.
            NotImplementedError: the engine has not what the model needs; its own words.
        """
        ...


def _release(t: FloatArray, gap: FloatArray) -> float | None:
    """End of the last step that begins at a stop or beyond it [s]; None: it is there at the end."""
    held = np.flatnonzero(gap <= 0.0)
    if not len(held):
        return 0.0
    return float(t[held[-1] + 1]) if held[-1] + 1 < len(t) else None
