"""Newton's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    SETTINGS_SET,
    EngineStudy,
    MaintainersNote,
    OptionSet,
    StepOrder,
    Tolerance,
)
from trebucheck_toolkit.alone import own_program

PYTHON = "Newton in Python"
_FLOOR = StepOrder(
    None,
    "MuJoCo's RK4 between states of single precision, whose floor it is at",
    "RK4, joint coordinates",
)


STUDY = EngineStudy(
    step_orders={
        DEFAULT: StepOrder(
            None,
            "joints are corrected in two iterations a step, whatever its length",
            "position-based dynamics of bodies",
        ),
        SETTINGS: _FLOOR,
        ASSISTED: _FLOOR,
    },
    option_sets=(
        DEFAULT_SET,
        OptionSet("50 iterations", "default, with 50 iterations", DEFAULT, {"iterations": 50}),
        OptionSet(
            "Featherstone",
            "settings, by SolverFeatherstone without its damping",
            SETTINGS,
            {"solver": "featherstone"},
        ),
        SETTINGS_SET,
        ASSISTED_SET,
    ),
    single_precision=lambda _: True,
    tolerances=(
        Tolerance(
            ASSISTED,
            "release_time",
            2e-3,
            1e-3,
            1,
            "at a step's end, of limits that have settled in 0.1 s",
        ),
    ),
    snippets=own_program(PYTHON),
    title="Newton",
    binding="the Python wheel `newton`, on the processor",
    maintainers_note=MaintainersNote(
        chosen="Its default is the first example's `SolverXPBD`, of which nothing is set; "
        "`SolverMuJoCo` by RK4 is what its options reach: {{ plain.agrees }} problems agree with "
        "the one, {{ alone.agrees }} with the other.",
        not_possible="A state has single precision between steps with any solver; our adapter "
        "builds no loops, no stops on points, and springs on joints alone, though Newton has "
        "loop joints and contacts.",
        would_change="A state in double precision, and limits that begin with their force.",
    ),
    colour="#76b900",
)
