"""Faults at stops on points and in loops of joints, built into engines.

Each is caught, and its cause is named.
"""

from __future__ import annotations

import re
from pathlib import Path

import faulty
import numpy as np
import pytest
import trebucheck as tb
from conftest import again
from faulty import Fault, run_with, tilted_slot, tilted_wall, without, without_joint
from mechanisms import geared
from trebucheck.comparisons.diagnosis.faults import with_closed_loops
from trebucheck.comparisons.report.pages.tables import diagnosis
from trebucheck.comparisons.runs.results import Outcome
from trebucheck.reference.solver import solve

GATE, MOTION = Outcome.NOT_EQUIVALENT, Outcome.DISAGREES
MILLIMETRE = MILLIRADIAN = 1e-3


def _lower_trough(text: str) -> str:
    """MuJoCo's model with the trough's wall a millimetre lower."""
    wall = re.compile(r'(name="trough_wall"[^>]* pos="0 0 )(\S+?)(")')
    return wall.sub(lambda found: f"{found[1]}{float(found[2]) - MILLIMETRE!r}{found[3]}", text)


def _wheel_aside(text: str) -> str:
    """MuJoCo's model with the wheel a millimetre further along the arm."""
    return text.replace('name="track_point" pos="4 0 0"', 'name="track_point" pos="4.001 0 0"')


def _ball_aside(text: str) -> str:
    """MuJoCo's model with the point in the trough a millimetre off the sling's line."""
    return text.replace('name="trough_point" pos="6 0 0"', 'name="trough_point" pos="6 0 0.001"')


def _still_foot(monkeypatch: pytest.MonkeyPatch) -> None:
    """pymunk's wall is a rod, whose foot then stays where it was."""
    from trebucheck.engines.pymunk import leapfrog as rods

    monkeypatch.setattr(rods.SlidingRod, "move_anchor", lambda *_: None)


def _body_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """Exudyn's forces of walls, which come in the body's frame, taken for the world's."""
    from trebucheck.engines.exudyn import read as _exudyn_constraints

    monkeypatch.setattr(_exudyn_constraints, "turned", lambda local, _: local[:, :2])


HINGED = (
    Fault("trough lower", GATE, "place of the trough", {}, text=_lower_trough),
    Fault(
        "trough's point off the sling's line",
        GATE,
        "point of the trough on the sling",
        {},
        text=_ball_aside,
    ),
    Fault(
        "trough tilted",
        GATE,
        "direction of the trough",
        {"machine": tilted_wall("trough", MILLIRADIAN)},
    ),
    Fault("trough missing", GATE, "trough missing", {"machine": without("trough")}),
    Fault("trough never lets go", MOTION, "release of the trough", {"law": faulty.never("trough")}),
    Fault("sign of the trough's force", MOTION, "wrong sign", {"reading": faulty.flipped_force}),
    Fault(
        "points not held as they move",
        MOTION,
        "moving points",
        {},
        options={"moving_points": False},
    ),
    Fault("foot of the wall stays behind", MOTION, "", {}, "pymunk", patch=_still_foot),
    Fault("force of the wall in the body's frame", GATE, "", {}, "exudyn", patch=_body_frame),
)
FLOATING_ARM = (
    Fault("trough lower", GATE, "place of the trough", {}, text=_lower_trough),
    Fault(
        "trough tilted",
        GATE,
        "direction of the trough",
        {"machine": tilted_wall("trough", MILLIRADIAN)},
        "exudyn",
    ),
    Fault("trough missing", GATE, "trough missing", {"machine": without("trough")}, "pymunk"),
    Fault(
        "track tilted",
        GATE,
        "direction of the track",
        {"machine": tilted_slot("track", MILLIRADIAN)},
        "exudyn",
    ),
    Fault("track missing", GATE, "track missing", {"machine": without_joint("track")}, "pymunk"),
    Fault("wheel aside on the arm", GATE, "place of the track on the arm", {}, text=_wheel_aside),
    Fault(
        "trough never lets go",
        MOTION,
        "release of the trough",
        {"law": faulty.never("trough")},
        "exudyn",
    ),
    Fault(
        "sign of the trough's force",
        MOTION,
        "wrong sign",
        {"reading": faulty.flipped_force},
        "pymunk",
    ),
    Fault(
        "points not held as they move",
        MOTION,
        "moving points",
        {},
        options={"moving_points": False},
    ),
    Fault("foot of the wall stays behind", MOTION, "", {}, "pymunk", patch=_still_foot),
)


SAME = {
    "trough lower",
    "trough missing",
    "sign of the trough's force",
    "points not held as they move",
    "foot of the wall stays behind",
}
"""Faults of the floating arm that are the hinged machine's."""


@pytest.mark.parametrize(
    ("model", "fault"),
    [
        *(("hinged", fault) for fault in HINGED),
        *(
            pytest.param("floating-arm", fault, marks=again if fault.name in SAME else ())
            for fault in FLOATING_ARM
        ),
    ],
    ids=lambda value: value.name if isinstance(value, Fault) else value,
)
def test_a_fault_is_caught_and_named(
    model: str, fault: Fault, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = run_with(fault, model, monkeypatch)
    assert run.outcome is fault.tier, run.message
    assert run.diagnosis is not None
    first = [f"{cause.name} {cause.amount}" for cause in run.diagnosis.causes[:2]]
    assert any(fault.cause in text for text in first), diagnosis(run)


def _with_gear(mechanism: tb.Mechanism, ratio: float | None) -> tb.Mechanism:
    """Change the ratio of the first coupler, or remove it."""
    gear, *others = mechanism.couplers
    if ratio is None:
        return mechanism.model_copy(update={"couplers": tuple(others)})
    gear = gear.model_copy(update={"terms": (gear.terms[0].model_copy(update={"ratio": ratio}),)})
    moved = with_closed_loops(mechanism.model_copy(update={"couplers": (gear, *others)}))
    assert moved is not None
    return moved


@pytest.mark.parametrize(
    ("ratio", "cause", "amount"),
    [(-1.7 * 1.01, "ratio of alpha in the gear", "+1 %"), (None, "gear missing", "")],
)
def test_a_wrong_gear_is_named(
    ratio: float | None, cause: str, amount: str, tmp_path: Path
) -> None:
    mechanism, path = geared(), tmp_path / "motion.nc"
    wrong = solve(tb.Problem(_with_gear(mechanism, ratio), 1.0))
    wrong.trajectory(np.linspace(0.0, 1.0, 201)).to_dataset().to_netcdf(path, engine="h5netcdf")
    found = tb.judge(path, mechanism)
    assert found.outcome is Outcome.DISAGREES and found.diagnosis is not None
    first = found.diagnosis.causes[0]
    assert (first.name, first.amount) == (cause, amount)
    assert first.explained > 0.99
