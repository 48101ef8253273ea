"""The reference as an engine: it passes the same tests as the others.

What integrates is imported when it is asked for, as the libraries of the other engines are.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from ...models.arrays import FloatArray
from ...models.elements import (
    Coupler,
    CubicTorsionSpring,
    RecordedForce,
    RecordedTorque,
    RotorInertia,
    SlideInertia,
    SlideSpringDamper,
    TranslationJoint,
)
from ...models.features import COVERED_BY_FEATURES
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.spec import Real
from ...reference import TOLERANCE
from ...version import __version__
from ..inspection import Dynamics, Inspection, State
from ..presets import ASSISTED
from ..protocol import BuiltinEngine, Capabilities, Recording, built_features
from ..reading import timed_reading
from ..study import EngineStudy, Tolerance
from ..supplied import Assistance

if TYPE_CHECKING:
    from ...reference.solution import Solution

BUILT: frozenset[type] = COVERED_BY_FEATURES | {
    Coupler,
    CubicTorsionSpring,
    RecordedForce,
    RecordedTorque,
    RotorInertia,
    SlideInertia,
    SlideSpringDamper,
    TranslationJoint,
}
"""Classes of elements that both formulations have; the tests hold it against the second one's."""

# The others are measured against the reference, so only an invariant can judge it here; its figures
# are held to independent ones in tests/verification.
_STUDY = EngineStudy(
    tolerances=(
        Tolerance(ASSISTED, "energy_balance", 2e-7, 1.0, 0, "1e-12 of the energy at the start"),
    ),
    colour="#7b8794",
)

_Tolerance = Annotated[Real, Field(ge=2.5e-14, le=1e-2)]


class ReferenceEngine(BuiltinEngine):
    """Lagrangian reference in minimal coordinates; `timestep` is the interval of its samples."""

    name: ClassVar[str] = "reference"
    package: ClassVar[str] = "scipy"
    tables: ClassVar[EngineStudy] = _STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="minimal absolute angles, stops by KKT, DOP853 with located events",
        features=built_features(BUILT),
        elements=BUILT,  # which both formulations have
    )
    # Nothing assists it: its two presets differ in name alone.
    default_options: ClassVar[Mapping[str, object] | None] = {}
    assistance: ClassVar[tuple[Assistance, ...] | None] = ()

    integrator: Literal["dop853", "taylor", "auto"] = Field(
        default="dop853",
        description=(
            "SciPy's DOP853, with Radau's method where dampers shorten its steps; heyoka's Taylor "
            "series; or these where heyoka can take them"
        ),
    )
    rtol: _Tolerance = Field(
        default=TOLERANCE,
        description="relative local error; Taylor series go to the last digit",
    )
    atol: _Tolerance = Field(
        default=TOLERANCE, description="absolute local error [rad, m, rad/s, m/s]"
    )

    @classmethod
    def version(cls) -> str:
        """Version of trebucheck, whose solver it is."""
        return __version__

    def solve(self, problem: Problem) -> Solution:
        """The continuous solution behind :meth:`simulate`.

        Its settings say why "auto" did not take Taylor series.
        """
        from ...reference.solver import solve
        from ...reference.taylor.expressions import why_not_taylor
        from ...reference.taylor.solve import solve_taylor

        if self.integrator == "taylor":
            return solve_taylor(problem)
        reason = why_not_taylor(problem) if self.integrator == "auto" else "asked for"
        if reason is None:
            return solve_taylor(problem)
        solution = solve(problem, self.rtol, self.atol)
        return dataclasses.replace(
            solution, settings={**solution.settings, "integrator": f"dop853: {reason}"}
        )

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The machine once more in redundant coordinates: the gate measures by the minimal ones."""
        from ...reference.certification.redundant import RedundantSystem

        start, dynamics = RedundantSystem(mechanism), list[Dynamics]()
        for state in states:
            placed = {"start": tuple(state.q), "start_speeds": tuple(state.u)}
            system = RedundantSystem(mechanism.model_copy(update=placed))
            y, closed = system.start, state.closed
            rates, torques = system.rates(y, closed)[system.n :], system.torques(y, closed)
            centres = dict[str, FloatArray]()
            for body in mechanism.bodies:
                centres[body.name] = system.point(y, rates, body.name, body.centre)[0]
            dynamics.append(
                Dynamics(
                    accelerations=system.accelerations(y, closed),
                    stop_torques=dict(zip(closed, torques.tolist(), strict=True)),
                    centres=centres,
                    stop_gaps={name: system.gap(y[: system.n], name) for name in closed},
                )
            )
        return Inspection(
            start=start.coordinates(start.start[: start.n]),
            start_speeds=start.speeds(start.start),
            dynamics=tuple(dynamics),
            total_mass=sum(body.mass for body in mechanism.bodies),
        )

    def _run(self, problem: Problem) -> Recording:
        solution = self.solve(problem)
        releases = [time for time in solution.release_times.values() if time]
        # A uniform grid from 0, the end, and the events, sorted and without repeats.
        duration, interval = problem.duration, self.timestep
        grid = interval * np.arange(int(np.floor(duration / interval * (1 + 1e-12))) + 1)
        times = np.unique(np.concatenate([grid[grid <= duration], [duration], releases]))
        with timed_reading():
            trajectory = solution.trajectory(times)
        fields = {field.name for field in dataclasses.fields(Recording)} - {"steps"}
        return Recording(
            **{name: getattr(trajectory, name) for name in fields}, steps=solution.evaluations
        )
