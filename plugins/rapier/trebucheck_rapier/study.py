"""Rapier's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.presets import PRESETS
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    HALF_THE_STEP,
    REFINEMENT,
    SETTINGS_SET,
    Cause,
    ConstraintKinds,
    EngineStudy,
    Intervention,
    MaintainersNote,
    Options,
    Refinement,
    StepOrder,
    time_step_cause,
)
from trebucheck_toolkit.alone import own_program


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause(
            "substeps and passes",
            "impulses of few passes leave joints apart, which is undone bit by bit",
            Intervention(
                {"substeps": max(8, settings["substeps"]), "passes": max(4, settings["passes"])}
            ),
        ),
        Cause(
            "sleep",
            "bodies that hardly move are stopped",
            Intervention({"allow_sleep": False}),
        ),
        Cause(
            "limits that stay",
            "a stop that is open for good is met again, or half a turn on",
            Intervention({"opening": 1e-4, "move_limits": True}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


def _lighter_carriages(settings: Options, _: ConstraintKinds) -> dict[str, Any] | None:
    carriage = settings["carriage"]
    return None if carriage is None else {"carriage": 0.1 * carriage}


_SCHEME = "semi-implicit Euler, impulses"
_REASON = (
    "semi-implicit Euler in substeps of Cartesian coordinates; at short steps the floor of single "
    "precision"
)
STUDY = EngineStudy(
    causes=_causes,
    step_orders={preset: StepOrder(1.0, _REASON, _SCHEME) for preset in PRESETS},
    snippets=own_program("Rapier in Node.js"),
    refinements=(
        HALF_THE_STEP,
        Refinement("mass in slots", "a tenth of it", _lighter_carriages),
    ),
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    single_precision=lambda _: True,
    additions=lambda settings: settings["substeps"],
    title="Rapier",
    binding="the npm package `@dimforge/rapier2d-compat`, moved by Node.js, in single precision",
    maintainers_note=MaintainersNote(
        chosen="`default` is a world that sets nothing; `settings` has impulse joints with "
        "shorter steps, more substeps and passes and no sleep, as its multibody joints lose "
        "energy at any step: {{ plain.agrees }} problems agree where nothing is set, "
        "{{ alone.agrees }} with that, {{ best.agrees }} with assistance.",
        not_possible="Its interface of JavaScript has no joint that slides and turns, so that "
        "slots need a carriage of ours, and tells no forces of joints and limits: reactions are "
        "not judged, and releases are looked back for from how gaps open; our adapter builds no "
        "stops on points and no restitution, and gives springs as forces, not as Rapier's joints.",
        would_change="A build in double precision, a joint for slots, and forces of joints in the "
        "interface: at short steps rounding is what is left.",
    ),
    colour="#b8860b",
)
