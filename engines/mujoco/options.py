"""Numerical options of the mujoco adapter; defaults are the assisted preset. Needs no MuJoCo."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field

from ...models.spec import NonNegative, Real
from ..study import ConstraintKinds
from ..units import ScaledOptions

_Impedance = Annotated[Real, Field(ge=1e-4, le=0.9999)]


class MujocoOptions(ScaledOptions):
    """Numerical options; their ranges are checked as in every :class:`EngineOptions`."""

    integrator: Literal["RK4", "Euler", "implicit", "implicitfast", "discrete"] = Field(
        default="RK4",
        description="MuJoCo's integrator; all but RK4 are of first order, and 'implicit' chatters "
        "on a limit",
    )
    free_substeps: int = Field(
        default=4,
        ge=1,
        le=1000,
        description="steps of MuJoCo to one `timestep` once no stop holds any more",
    )
    solver: Literal["Newton", "CG", "PGS"] = Field(
        default="Newton", description="MuJoCo's constraint solver"
    )
    tolerance: NonNegative = Field(
        default=1e-30,
        description="gain at which the solver stops; at 0 its line search runs on to its last "
        "iteration",
    )
    iterations: int = Field(default=100, ge=1, le=10_000, description="of the solver, at most")
    solref: tuple[Real, Real] | None = Field(
        default=None,
        description="reference of limits, contacts and equalities: time constant [s] and damping "
        "ratio if positive, -stiffness [1/s^2] and -damping [1/s] if negative; None: scaled with "
        "the time step",
    )
    solimp: tuple[_Impedance, _Impedance, NonNegative, Real, Real] = Field(
        default=(0.9999, 0.9999, 0.001, 0.5, 2.0),
        description="impedance of limits, contacts and equalities: d0, d_width, width, midpoint, "
        "power",
    )
    margin: NonNegative = Field(
        default=1e-12,
        le=1e-2,
        description="nearer than this to its limit, a joint feels it [rad]; 0 misses the start. A "
        "point feels a wall from this times the machine's size [m], or from farther off where "
        "points are held exactly",
    )
    locate_releases: bool = Field(
        default=True, description="find a release inside its step, not at the step's end"
    )
    preload: bool = Field(
        default=True,
        description="press the closed limits in at the start, so that their torques are right from "
        "t = 0; with `moving_points`, make up for the softness of loops at every forward pass",
    )
    moving_points: bool = Field(
        default=True,
        description="hold points exactly: with the acceleration that a point has from the speeds "
        "alone, which MuJoCo leaves out of contacts, and the same feedback through all stages of a "
        "step",
    )
    keep_limits: bool = Field(
        default=False,
        description="leave released and open limits in the model, also under the release-once law; "
        "stops are then met as the springs that MuJoCo's limits are",
    )

    def in_time_unit(self, unit: float) -> Self:
        """The same options for a model whose unit of time is so many seconds."""
        first, second = self.solref or (0.0, 0.0)
        scaled = (first / unit, second) if first > 0 else (first * unit**2, second * unit)
        solref = None if self.solref is None else scaled
        return self.model_copy(update={"timestep": self.timestep / unit, "solref": solref})


def scaled_solref(
    timestep: float, integrator: str, exact_points: bool = False
) -> tuple[float, float]:
    """The `solref` that None stands for: -stiffness, -damping [1/s^2, 1/s] at a time step [s].

    Scaled so, errors fall with the square of the step. Twice the damping is critical and has the
    least rebound; a one-stage integrator throws the joint about with it, and settles in one step
    with half of that. Feedback that is kept through a step of RK4 has a constraint at rest after
    two with one and a half: the matrix ((1 - K/2, 1 - B/2), (-K, 1 - B)) from one step to the next,
    with K = k h^2 = 1 and B = b h, is then nilpotent.

    Args:
        timestep: of MuJoCo [s].
        integrator: MuJoCo's.
        exact_points: of contacts and equalities whose feedback is kept through all stages of a step
            (`moving_points`).
    """
    damping = 1.0 if integrator != "RK4" else 1.5 if exact_points else 2.0
    return -1.0 / timestep**2, -damping / timestep


def effective_solref(
    settings: Mapping[str, Any], constraints: ConstraintKinds
) -> tuple[float, float]:
    """The `solref` of an engine's settings as numbers, given or from the step.

    One pair has to serve angles and points: where a mechanism has both, it is that of the angles.
    """
    if settings["solref"] is not None:
        first, second = settings["solref"]
        return first, second
    exact_points = settings["moving_points"] and not constraints.angles
    return scaled_solref(float(settings["timestep"]), settings["integrator"], exact_points)
