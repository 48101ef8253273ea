"""What is no valid trajectory is refused with one sentence before it is compared."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from formulas import Formula, times, trolley
from trebucheck.comparisons.runs.runner import refuse_invalid
from trebucheck.models.trajectory import PointMotion

T = times(0.5)
OWN = Formula().trajectory(T)
TOLD = tb.Capabilities(
    joint_reactions=True,
    joint_gaps=False,
    located_releases=True,
    stop_laws=frozenset(tb.StopLaw),
    formulation="-",
)
HOOK = OWN.marker("hook")


def _complaint(trajectory: Any, capabilities: tb.Capabilities = TOLD) -> str:
    with pytest.raises(tb.SimulationError) as refused:
        refuse_invalid("stranger", trajectory, trolley(), capabilities)
    return str(refused.value)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"t": np.concatenate([[1e-9 * T[-1]], T[1:]])},
        {"t": np.concatenate([[0.0, 0.0], T[2:]])},
        {"stop_torques": {"rest": 0 * T}},
        {"release_times": {"rest": None}},
        {"release_times": {"rest": 0.0, "buffer": 1.0}},
        {"impacts": ((0.0, {"rest": 1.0}), (1.0, {}))},
        {"joint_gaps": {"pivot": 0 * T}},
        {"q": 1e100 * np.ones_like(OWN.q)},
        {"q": np.zeros(OWN.q.shape, dtype=np.int64)},
    ],
)
def test_a_valid_one_is_given_back(changes: dict[str, Any]) -> None:
    trajectory = replace(OWN, **changes)
    assert refuse_invalid("stranger", trajectory, trolley(), TOLD) is trajectory


def test_what_is_promised_may_not_be_missing() -> None:
    blind = replace(OWN, stop_torques={}, joint_reactions={})
    without = replace(TOLD, stop_torques=False, joint_reactions=False)
    assert refuse_invalid("stranger", blind, trolley(), without) is blind
    assert "stop_torques lacks 'rest'" in _complaint(replace(OWN, stop_torques={}))
    assert "joint_reactions lacks" in _complaint(replace(OWN, joint_reactions={}))


def test_two_times_are_enough() -> None:
    short = Formula().trajectory(times(2.0))
    assert len(short.t) == 2 and refuse_invalid("stranger", short, trolley(), TOLD) is short


def test_reactions_may_be_missing_where_none_were_promised() -> None:
    untold = replace(TOLD, joint_reactions=False)
    blind = replace(OWN, joint_reactions={})
    assert refuse_invalid("stranger", blind, trolley(), untold) is blind
    assert "joint_reactions lacks 'pivot'" in _complaint(blind)
    assert "joint_reactions lacks 'slot'" in _complaint(
        replace(OWN, joint_reactions={"pivot": HOOK.position})
    )


def _at(values: Any, i: int, value: float) -> Any:
    changed = np.array(values, dtype=np.float64)
    changed[i] = value
    return changed


FAULTS: dict[str, tuple[dict[str, Any], str]] = {
    "another mechanism": (
        {"mechanism": trolley(name="other")},
        "it is of another mechanism, 'other'",
    ),
    "t is a list": ({"t": list(T)}, "t is a list; an array of float64 is needed"),
    "t in single precision": (
        {"t": T.astype(np.float32)},
        "t is an array of float32; an array of float64 is needed",
    ),
    "t of two columns": (
        {"t": np.stack([T, T])},
        "t has the shape (2, 5); at least two times are needed",
    ),
    "one time": ({"t": T[:1]}, "t has the shape (1,); at least two times are needed"),
    "no time": ({"t": T[:0]}, "t has the shape (0,); at least two times are needed"),
    "a time is not a number": ({"t": _at(T, 2, np.nan)}, "t[2] is not finite"),
    "time runs back": ({"t": _at(T, 3, 0.9)}, "t decreases after 1 s"),
    "begins late": ({"t": _at(T, 0, 1.1e-9 * T[-1])}, "it begins at t = 2.2e-09 s instead of 0"),
    "begins early": ({"t": _at(T, 0, -1e-12)}, "it begins at t = -1e-12 s instead of 0"),
    "unknown marker": (
        {"markers": {**OWN.markers, "x": HOOK}},
        "markers has 'x', which the mechanism does not have",
    ),
    "missing marker": ({"markers": {"projectile": HOOK}}, "markers lacks 'hook'"),
    "unknown stop": ({"stop_torques": {"x": 0 * T}}, "stop_torques has 'x'"),
    "unknown release": ({"release_times": {"rest": 1.0, "x": 1.0}}, "release_times has 'x'"),
    "missing release": ({"release_times": {}}, "release_times lacks 'rest'"),
    "unknown joint": (
        {"joint_reactions": {**OWN.joint_reactions, "x": HOOK.position}},
        "joint_reactions has 'x'",
    ),
    "unknown names": ({"stop_torques": {"y": 0 * T, "x": 0 * T}}, "stop_torques has 'x'"),
    "unknown gap": ({"joint_gaps": {"x": 0 * T}}, "joint_gaps has 'x'"),
    "release is not a number": (
        {"release_times": {"rest": np.nan}},
        "the release time of 'rest' is nan s",
    ),
    "release before the start": (
        {"release_times": {"rest": -1e-3}},
        "the release time of 'rest' is -0.001 s",
    ),
    "impact is not a number": ({"impacts": ((np.inf, {}),)}, "an impact's time is inf s"),
    "impact before the start": ({"impacts": ((1.0, {}), (-1.0, {}))}, "an impact's time is -1.0 s"),
    "impact of an unknown stop": ({"impacts": ((1.0, {"x": 1.0}),)}, "impacts has 'x'"),
    "impulse is not a number": (
        {"impacts": ((1.0, {"rest": np.nan}),)},
        "the impulse of 'rest' is nan",
    ),
    "q transposed": ({"q": OWN.q.T}, "q has the shape (3, 5), not (5, 3)"),
    "u of one column": ({"u": OWN.u[:, :1]}, "u has the shape (5, 1), not (5, 3)"),
    "kinetic energy too short": (
        {"kinetic_energy": T[1:]},
        "kinetic_energy has the shape (4,), not (5,)",
    ),
    "potential energy": (
        {"potential_energy": OWN.q},
        "potential_energy has the shape (5, 3), not (5,)",
    ),
    "q is a list": ({"q": OWN.q.tolist()}, "q is a list; an array is needed"),
    "q is text": ({"q": OWN.q.astype(str)}, "q holds no real numbers"),
    "q is complex": ({"q": OWN.q + 1j}, "q holds no real numbers"),
    "q is not finite": ({"q": _at(OWN.q, 3, np.inf)}, "q is not finite at t = 1.5 s"),
    "q is huge": (
        {"q": _at(OWN.q, 3, -1.1e100)},
        "q reaches 1.1e+100, which is too large to compare",
    ),
    "position": (
        {"markers": {**OWN.markers, "hook": replace(HOOK, position=_at(HOOK.position, 1, np.nan))}},
        "position of 'hook' is not finite at t = 0.5 s",
    ),
    "velocity": (
        {"markers": {**OWN.markers, "hook": PointMotion(HOOK.position, HOOK.velocity[:, 0])}},
        "velocity of 'hook' has the shape (5,), not (5, 2)",
    ),
    "torque": (
        {"stop_torques": {"rest": _at(T, 4, -np.inf)}},
        "torque of 'rest' is not finite at t = 2 s",
    ),
    "reaction": (
        {"joint_reactions": {**OWN.joint_reactions, "slot": T}},
        "reaction of 'slot' has the shape (5,), not (5, 2)",
    ),
    "gap": ({"joint_gaps": {"pivot": OWN.q}}, "gap of 'pivot' has the shape (5, 3), not (5,)"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_an_invalid_one_is_refused_in_one_sentence(fault: str) -> None:
    changes, expected = FAULTS[fault]
    complaint = _complaint(replace(OWN, **changes))
    assert complaint.startswith("stranger gave an invalid trajectory: ") and complaint.endswith(".")
    assert expected in complaint


def test_something_else_is_refused() -> None:
    assert _complaint(None) == "stranger gave a NoneType instead of a Trajectory."
