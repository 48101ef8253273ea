"""MuJoCo: a tree of relative joints whose stops are soft limits and contacts, and whose loops are soft ties."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.spec import NonNegative, Real
from ..inspection import Inspection, State
from ..protocol import BuiltinEngine, Capabilities, Recording

_Impedance = Annotated[Real, Field(ge=1e-4, le=0.9999)]


class MujocoEngine(BuiltinEngine):
    """MuJoCo on the MJCF of :mod:`...models.mjcf.writer`; the defaults are the tuned preset.

    Stops are joint limits, which MuJoCo treats as soft: a stop gives way by about 1e-10 rad at a step of 1e-3 s,
    and by four times that at twice the step, for the tuned limits are scaled with it. Under the release-once law
    a limit is taken out of the model when it releases, and those open at the start are out from the beginning;
    under the unilateral law all stay in, and an impact is that of a stiff, damped spring, spread over some steps.

    Stops on points are frictionless contacts of a ball with a plane, slots that close a loop are two of them, pins
    that do are `connect` equalities. MuJoCo holds points only roughly: it leaves the acceleration that a point has
    from the speeds alone out of contacts, and scaled with the step a stiff reference acceleration follows the inner
    stages of RK4. The tuned preset mends both in `mjcb_control` (:mod:`.moving_points`); they then give way by some
    1e-9 m at 1e-3 s.

    The stock preset leaves every limit in the model for the whole run, as a newcomer would, whatever the law: it
    keeps to release-once only while no stop is met again. It calls a stop released at the end of the first step
    after which its limit carries no torque.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "mujoco"
    package: ClassVar[str] = "mujoco"
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="minimal relative joints, stops and loops as soft limits, contacts and equalities "
        "(convex optimisation), RK4; "
        "releases located inside a step (stock: at its end, and limits never removed)",
    )
    # The documentation sends those who want energy conserved to RK4; the rest are its defaults.
    stock_options: ClassVar[Mapping[str, object]] = {
        "free_substeps": 1,
        "tolerance": 1e-8,
        "solref": (0.02, 1.0),
        "solimp": (0.9, 0.95, 0.001, 0.5, 2.0),
        "locate_releases": False,
        "preload": False,
        "moving_points": False,
        "keep_limits": True,
    }

    integrator: Literal["RK4", "Euler", "implicit", "implicitfast", "discrete"] = Field(
        default="RK4",
        description="MuJoCo's integrator; all but RK4 are of first order, and 'implicit' chatters on a limit",
    )
    free_substeps: int = Field(
        default=4, ge=1, le=1000, description="steps of MuJoCo to one `timestep` once no stop holds any more"
    )
    solver: Literal["Newton", "CG", "PGS"] = Field(default="Newton", description="MuJoCo's constraint solver")
    tolerance: NonNegative = Field(
        default=1e-30, description="gain at which the solver stops; at 0 its line search runs on to its last iteration"
    )
    iterations: int = Field(default=100, ge=1, le=10_000, description="of the solver, at most")
    solref: tuple[Real, Real] | None = Field(
        default=None,
        description="reference of limits, contacts and equalities: time constant [s] and damping ratio if positive, "
        "-stiffness [1/s^2] and -damping [1/s] if negative; None: scaled with the time step",
    )
    solimp: tuple[_Impedance, _Impedance, NonNegative, Real, Real] = Field(
        default=(0.9999, 0.9999, 0.001, 0.5, 2.0),
        description="impedance of limits, contacts and equalities: d0, d_width, width, midpoint, power",
    )
    margin: NonNegative = Field(
        default=1e-12,
        le=1e-2,
        description="nearer than this to its limit, a joint feels it [rad]; 0 misses the start. A point feels a wall "
        "from this times the machine's size [m], or from farther off where points are held exactly",
    )
    locate_releases: bool = Field(default=True, description="find a release inside its step, not at the step's end")
    preload: bool = Field(
        default=True, description="press the closed limits in at the start, so that their torques are right from t = 0"
    )
    moving_points: bool = Field(
        default=True,
        description="hold points exactly: with the acceleration that a point has from the speeds alone, which MuJoCo "
        "leaves out of contacts, and the same feedback through all stages of a step",
    )
    keep_limits: bool = Field(
        default=False, description="leave released and open limits in the model even under the release-once law"
    )

    def _run(self, problem: Problem) -> Recording:
        # Imported here so that the class, its options and its documentation need no MuJoCo.
        from .step import run

        return run(problem, self)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model's mass matrix, forces and forward dynamics in each state, its closed limits at rest."""
        from .inspect import inspect

        return inspect(mechanism, states, self)
