"""Genesis's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
from trebucheck.engines.study import EngineStudy, MaintainersNote, StepOrder
from trebucheck_toolkit.alone import caused_by, own_program
from trebucheck_toolkit.scheme_tables import EULER_STEPS, euler_tolerances

_CAUSES = {
    "armature": ("every joint has a rotor inertia that it has not", {"default_armature": None}),
    "precision": ("numbers of 24 bits", {"precision": "64"}),
    "constraint softness": (
        "limits and loops are softer than the step can bear",
        {"constraint_timeconst": None, "solimp": [0.9999, 0.9999, 0.001, 0.5, 2.0]},
    ),
}
STUDY = EngineStudy(
    causes=caused_by(_CAUSES),
    step_orders={
        DEFAULT: StepOrder(
            None,
            "of first order, but the rotor inertia of each joint does not fall with the step",
            EULER_STEPS.scheme,
        ),
        SETTINGS: EULER_STEPS,
        ASSISTED: EULER_STEPS,
    },
    tolerances=(*euler_tolerances(SETTINGS), *euler_tolerances(ASSISTED)),
    single_precision=lambda settings: settings["precision"] == "32",
    snippets=own_program("Genesis in Python"),
    title="Genesis",
    binding="the Python wheel `genesis-world`, on the processor",
    maintainers_note=MaintainersNote(
        chosen="Its defaults are those of its options: single precision, long steps, a rotor "
        "inertia on every joint of a file that has none: {{ plain.agrees }} problems agree. "
        "Double precision, no rotor inertia, short steps and the shortest time constant of "
        "constraints are what its options reach: {{ alone.agrees }}.",
        not_possible="Genesis tells no force of a joint, reads no tendons, and its integrators are "
        "all of first order; our adapter builds no stops on points and no restitution.",
        would_change="Forces of joints and of equalities in its interface; an integrator of higher "
        "order; a limit that pushes from the first step, where the gap is zero; no rotor inertia "
        "where a file has none.",
    ),
    colour="#5b2a86",
)
