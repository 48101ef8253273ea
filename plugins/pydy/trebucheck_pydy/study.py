"""PyDy's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.presets import PRESETS
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    REFINEMENT,
    SETTINGS_SET,
    Cause,
    ConstraintKinds,
    EngineStudy,
    Intervention,
    MaintainersNote,
    Refinement,
    multiplied,
    time_step_cause,
)
from trebucheck_toolkit.alone import own_program
from trebucheck_toolkit.scheme_tables import error_controlled, located_tolerances


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause(
            "tolerance",
            "the local error that the integrator is asked for",
            Intervention({"tolerance": 1e-13, "integrator": "DOP853"}),
        ),
        Cause(
            "dependent speeds",
            "drift of loops, and positions in which a dependent speed has no value",
            Intervention({"mode": "events"}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


STUDY = EngineStudy(
    causes=_causes,
    step_orders=dict.fromkeys(
        PRESETS, error_controlled("DOP853 (default: LSODA): the step is only an upper bound")
    ),
    refinements=(Refinement("tolerance", "a tenth of it", multiplied("tolerance", 0.1)),),
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    snippets=own_program("SymPy and PyDy"),
    # Errors grow some 1e3-fold in the paper's machines; forces are 1e4 N.
    tolerances=located_tolerances(8, "DOP853 at a tolerance of 1e-13", step=4e-3, position=1e-9),
    title="PyDy (SymPy's Kane's method)",
    binding="the Python distributions `pydy` and `sympy`",
    maintainers_note=MaintainersNote(
        chosen="`default` is `System.integrate()` without arguments: SciPy's odeint at its "
        "own tolerances; `settings` hands the same equations to a method of high "
        "order, near machine precision: {{ plain.agrees }} problems agree "
        "where nothing is set, {{ alone.agrees }} with that.",
        not_possible="SymPy's mechanics has no unilateral constraints, so that neither preset has "
        "stops; loops are closed by dependent speeds, which are chosen once, and have no value in "
        "positions where that choice is singular.",
        would_change="Stops and their events in PyDy's System; until then the assisted preset "
        "speaks for the generated equations alone.",
    ),
    colour="#3c5a14",
)
