"""MuJoCo Warp's entries for studies: orders and causes, and model files as they are."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import Field
from trebucheck.engines.given import SteppedModel
from trebucheck.engines.study import EngineStudy, MaintainersNote
from trebucheck.models.arrays import FloatArray
from trebucheck_toolkit.alone import own_program
from trebucheck_toolkit.mujoco_models import OPTION_SETS, ORDERS, GivenCompiledModel, causes_by

LEAST_TOLERANCE = 1e-6
"""Least tolerance of the solver that `put_model` takes."""


class GivenWarpModel(GivenCompiledModel):
    """MuJoCo Warp on the file itself; `put_model` raises a smaller tolerance to 1e-6."""

    name: ClassVar[str] = "mujoco_warp"
    package: ClassVar[str] = "mujoco-warp"

    precision: Literal["single"] = Field(default="single", description="of MuJoCo Warp's numbers")

    def _stepped(self, model: Any, start: Any, controls: FloatArray) -> SteppedModel:
        from .world import stepped  # loads Warp

        return stepped(model, start, controls)


STUDY = EngineStudy(
    as_given=GivenWarpModel,
    causes=causes_by({"tolerance": LEAST_TOLERANCE}),
    step_orders=ORDERS,
    option_sets=OPTION_SETS,
    single_precision=lambda _: True,
    snippets=own_program("MuJoCo Warp in Python"),
    title="MuJoCo Warp",
    binding="the Python wheel `mujoco-warp`, on the processor",
    maintainers_note=MaintainersNote(
        chosen="Its own defaults are those of an empty MuJoCo model; RK4, a stiffer `solref` and "
        "shorter steps are what its options add: the free swing keeps "
        "{{ plain.error('free-swing', 'position') }} by itself, "
        "{{ alone.error('free-swing', 'position') }} with its options, which is rounding.",
        not_possible="Its numbers are of single precision with any option. A limit stays in the "
        "model when its stop has let go, has no restitution, and begins without its force; the "
        "adapter does these in its place where a row says so.",
        would_change="States in double precision, a reference acceleration that counts the motion "
        "of points, and limits that start with their force.",
    ),
    colour="#4b0082",
)
