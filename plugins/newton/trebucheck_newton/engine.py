"""Newton: articulations by MuJoCo's solver or by its own Featherstone, with a state of single precision."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import Field
from trebucheck.engines.plain_run import plain_run
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.models.features import Basic, Feature
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Positive

from .study import STUDY


class NewtonEngine(BuiltinEngine):
    """An articulation of Newton's; the defaults are the tuned preset.

    Tuned, it is moved by `SolverMuJoCo` on the processor, by RK4. The stock preset is `SolverFeatherstone`.

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
        formulation="minimal relative joints, state in single precision; MuJoCo's RK4, limits as soft constraints "
        "(stock: Featherstone's algorithm by semi-implicit Euler, no stops)",
        features=frozenset(Feature) - {Feature.MOVING_WALL},
        lacking=frozenset({Basic.LOOP, Basic.POINT_STOP, Basic.REBOUND}),
    )
    stock_options: ClassVar[Mapping[str, object]] = {"solver": "featherstone"}

    solver: Literal["mujoco", "featherstone"] = Field(default="mujoco", description="Newton's solver")
    limit_frequency: Positive = Field(
        default=100.0, description="of a joint's limit, critically damped for its body alone [rad/s]"
    )

    def _run(self, problem: Problem) -> Recording:
        import warp

        warp.config.log_level = warp.LOG_ERROR  # it would tell of each kernel on the standard output
        from .motion import Motion

        motion = Motion(problem, self.solver, self.timestep, self.limit_frequency)
        return plain_run(problem, motion, self.name, self.timestep)
