"""MJX's entries for studies: tolerances, orders and causes, and model files as they are."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import Field
from trebucheck.engines.given import SteppedModel
from trebucheck.engines.presets import SETTINGS
from trebucheck.engines.study import (
    HALF_THE_STEP,
    Cause,
    EngineStudy,
    Intervention,
    MaintainersNote,
    OptionSet,
)
from trebucheck.models.arrays import FloatArray
from trebucheck_toolkit.alone import own_program
from trebucheck_toolkit.mujoco_models import OPTION_SETS, ORDERS, GivenCompiledModel, causes_by
from trebucheck_toolkit.scheme_tables import located_tolerances

_PRECISION = Cause("precision", "numbers of 24 bits", Intervention({"precision": "double"}))


class GivenMjxModel(GivenCompiledModel):
    """MJX on the file itself, in JAX's own precision where no other is asked for."""

    name: ClassVar[str] = "mjx"
    package: ClassVar[str] = "mujoco-mjx"
    ignored: ClassVar[tuple[str, ...]] = (*GivenCompiledModel.ignored, "noslip_iterations")

    precision: Literal["single", "double"] = Field(
        default="single", description="of MJX's numbers (`jax_enable_x64`)"
    )

    def _stepped(self, model: Any, start: Any, controls: FloatArray) -> SteppedModel:
        from .alone import stepped  # loads MJX

        return stepped(model, start, controls, double=self.precision == "double")


STUDY = EngineStudy(
    as_given=GivenMjxModel,
    causes=causes_by({"precision": "double"}, _PRECISION),
    step_orders=ORDERS,
    refinements=(HALF_THE_STEP,),
    option_sets=(
        *OPTION_SETS[:2],
        OptionSet(
            "single precision",
            "settings, in JAX's own precision",
            SETTINGS,
            {"precision": "single"},
        ),
        *OPTION_SETS[2:],
    ),
    tolerances=located_tolerances(),
    snippets=own_program("MJX in Python"),
    title="MJX",
    binding="the Python wheel `mujoco-mjx`",
    maintainers_note=MaintainersNote(
        chosen="Its own defaults are those of an empty MuJoCo model in JAX's single precision; "
        "double precision, RK4, a stiffer `solref` and shorter steps are what its options add: the "
        "free swing keeps {{ plain.error('free-swing', 'position') }} by itself, "
        "{{ alone.error('free-swing', 'position') }} with its options.",
        not_possible="A limit stays in the model when its stop has let go, has no restitution, and "
        "begins without its force; the adapter does these in its place where a row says so. "
        "Energies and torques of limits, which MJX does not tell, are computed from its mass "
        "matrix and its constraint forces.",
        would_change="A reference acceleration that counts the motion of points, and limits that "
        "start with their force, would make most of the assistance needless; sensors of energies "
        "and limits would make the reading MJX's own.",
    ),
    single_precision=lambda settings: settings["precision"] == "single",
    colour="#6a3d9a",
)
