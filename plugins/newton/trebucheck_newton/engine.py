"""Newton: articulations by MuJoCo's solver or its own Featherstone, state in single precision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, Literal, Self

from pydantic import Field, model_validator
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part
from trebucheck.models.errors import InputError
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import NonNegative, Positive
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.joint_tree import JointLimits, TreeMotion
from trebucheck_toolkit.plain_run import plain_run

from .study import STUDY

if TYPE_CHECKING:
    from .tree import NewtonTree


class NewtonEngine(BuiltinEngine):
    """An articulation of Newton's; the defaults are the assisted preset.

    By itself (:mod:`.alone`) it is one of Newton's solvers, with the limits, springs and forces of
    its joints. The default preset is the first example of its documentation (`basic_pendulum`):
    `SolverXPBD` of which nothing is set, in steps of 1 ms, a tenth of a frame. The settings are
    `SolverMuJoCo` on the processor, by RK4, with stiffer limits.

    Assisted, it is the same with forces of springs and motors that trebucheck computes before each
    step.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "newton"
    package: ClassVar[str] = "newton"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=False,
        stop_laws=frozenset({StopLaw.RELEASE_ONCE}),
        formulation="minimal relative joints, state in single precision; MuJoCo's RK4, limits as "
        "soft constraints (default: bodies by position-based dynamics)",
        features=frozenset(Feature) - {Feature.MOVING_WALL},
        lacking=frozenset({Basic.LOOP, Basic.POINT_STOP, Basic.REBOUND}),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        "solver": "xpbd",
        "limit_frequency": None,
        "springs": "joints",
    }
    settings_options: ClassVar[Mapping[str, object] | None] = {"springs": "joints"}
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        Assistance(
            Part.ELEMENTS,
            "computes the forces of springs, dampers and motors before each step",
            "springs",
            off="joints",
            acts_on=lambda mechanism: bool(mechanism.force_elements),
        ),
    )

    solver: Literal["mujoco", "featherstone", "xpbd"] = Field(
        default="mujoco", description="Newton's solver"
    )
    limit_frequency: Positive | None = Field(
        default=100.0,
        description="of a joint's limit, critically damped for its body alone [rad/s]; None: the "
        "limit's stiffness and damping are Newton's own",
    )
    springs: Literal["given", "joints"] = Field(
        default="given",
        description="what springs and motors are: forces that are given before each step, or "
        "stiffness, damping and forces of Newton's joints",
    )
    angular_damping: NonNegative = Field(
        default=0.0, description="of SolverFeatherstone and SolverXPBD [1/s]"
    )
    iterations: int = Field(default=2, ge=1, le=10_000, description="of SolverXPBD in a step")

    @model_validator(mode="after")
    def _refuse_idle_options(self) -> Self:
        """Refuse given forces without SolverMuJoCo, and options of solvers that are not asked."""
        if self.springs == "given" and self.solver != "mujoco":
            raise InputError(
                f"springs = 'given' asks for solver = 'mujoco'; with {self.solver!r} they are "
                f"'joints'."
            )
        if self.angular_damping and self.solver == "mujoco":
            raise InputError("angular_damping is of other solvers than 'mujoco'.")
        if self.iterations != type(self).model_fields["iterations"].default and (
            self.solver != "xpbd"
        ):
            raise InputError("iterations is an option of solver = 'xpbd' alone.")
        return self

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Elements that the adapter builds none of Newton's for."""
        if self.springs == "given":
            return frozenset()
        # SolverXPBD leaves the stiffness of joints out, and its drives know angles within a turn.
        of_joints = {Feature.ROTATIONAL_SPRING} if self.solver == "xpbd" else frozenset[Feature]()
        return frozenset({Feature.SPRING, Feature.FORCE, *of_joints})

    def _run(self, problem: Problem) -> Recording:
        _quieten()
        # Imported here so that the class, its options and its documentation need no Newton.
        if self.springs == "joints":
            from .alone import run_alone

            return run_alone(problem, self)
        from .motion import Motion

        motion = Motion(problem, self._tree(problem.mechanism))
        return plain_run(problem, motion, self.name, self.timestep)

    def _script(self, problem: Problem) -> str:
        _quieten()
        from .alone import script

        return script(problem, self)

    def _tree(self, mechanism: Mechanism) -> NewtonTree:
        from .tree import NewtonTree

        limits = JointLimits(JointCoordinates(mechanism), "newton")
        closed = [stop.name for stop in mechanism.stops if stop.closed]
        return NewtonTree(mechanism, limits.ranges(closed), self.limit_frequency, self.timestep)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Mass matrix, forces and accelerations of the articulation, in single precision."""
        self.refuse_absence()
        _quieten()
        return TreeMotion(self._tree(mechanism)).inspect(states, roundoff=2.0**-24)


def _quieten() -> None:
    import warp

    warp.config.log_level = warp.LOG_ERROR  # it would tell of each kernel on the standard output
