"""Genesis: its rigid solver on the processor, trees of joints in joint coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part, Supplied
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Positive
from trebucheck_toolkit.joint_tree import TreeMotion
from trebucheck_toolkit.kept_limits import LIMITS_TAKEN_OUT, KeepLimits
from trebucheck_toolkit.slot_carriers import CARRIERS

from .alone import Plan, Tree
from .study import STUDY


class GenesisEngine(BuiltinEngine):
    """Genesis's `scene.step()` on an MJCF model; the defaults are the assisted preset.

    Stops on angles are limits of joints, pins and slots that close loops `connect` equalities,
    torsion springs between bodies that a joint connects the stiffness and damping of that joint.
    Genesis reads no tendons and no springs between points: their forces, and loads, are given to
    its links before each step with every preset. It tells no force of a joint.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "genesis"
    package: ClassVar[str] = "genesis-world"
    module: ClassVar[str] = "genesis"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=False,
        joint_gaps=False,
        located_releases=False,
        stop_laws=frozenset(StopLaw),
        formulation="minimal relative joints, semi-implicit Euler; soft limits and loops",
        features=frozenset(Feature) - {Feature.MOVING_WALL},
        lacking=frozenset({Basic.POINT_STOP, Basic.REBOUND}),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        "keep_limits": True,
        "timestep": 1e-2,
        "precision": "32",
        "integrator": "approximate_implicitfast",
        "constraint_timeconst": 0.01,
        "solimp": None,
        "default_armature": 0.1,
    }
    settings_options: ClassVar[Mapping[str, object] | None] = {"keep_limits": True}
    assistance: ClassVar[tuple[Assistance, ...] | None] = (LIMITS_TAKEN_OUT,)
    readings: ClassVar[Supplied] = {
        Part.ELEMENTS: "forces of loads and of springs on no joint, given before each step",
        Part.MODEL: CARRIERS,
    }

    precision: Literal["32", "64"] = Field(default="64", description="bits of Genesis's numbers")
    integrator: Literal["Euler", "implicitfast", "approximate_implicitfast"] = Field(
        default="Euler", description="Genesis's, all of first order"
    )
    constraint_timeconst: Positive | None = Field(
        default=None,
        description="time constant of limits and loops [s]; none: two steps, Genesis's least",
    )
    solimp: tuple[float, float, float, float, float] | None = Field(
        default=(0.9999, 0.9999, 0.001, 0.5, 2.0),
        description="impedance of limits and loops, as in MJCF; none: MuJoCo's default",
    )
    default_armature: float | None = Field(
        default=None,
        ge=0.0,
        description="rotor inertia that Genesis adds to every joint of an MJCF file [kg m^2, kg]",
    )
    keep_limits: KeepLimits = False

    def _run(self, problem: Problem) -> Recording:
        return Plan(problem, self).run()

    def _script(self, problem: Problem) -> str:
        return Plan(problem, self).program()

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Mass matrix and accelerations that Genesis computes for the model in each state."""
        self.refuse_absence()
        roundoff = 2.0**-24 if self.precision == "32" else 2.0**-53
        return TreeMotion(Tree(mechanism, self)).inspect(states, roundoff)
