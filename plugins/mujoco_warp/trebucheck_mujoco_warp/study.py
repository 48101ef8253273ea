"""MuJoCo Warp's entries for studies: orders and causes."""

from __future__ import annotations

from trebucheck.engines.study import EngineStudy, MaintainersNote
from trebucheck_toolkit.alone import own_program
from trebucheck_toolkit.mujoco_models import OPTION_SETS, ORDERS, causes_by

LEAST_TOLERANCE = 1e-6
"""Least tolerance of the solver that `put_model` takes."""

STUDY = EngineStudy(
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
