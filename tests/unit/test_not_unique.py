"""What constraints leave open, in a comparison.

When a stop opens that carries nothing, or whose load others share.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import G, angle_stop, pin
from trebucheck.comparisons.runs.metrics import measure
from trebucheck.comparisons.runs.results import Metric
from trebucheck.comparisons.runs.scales import scales_until
from trebucheck.comparisons.runs.stretching import stretching_until
from trebucheck.models.elements import GROUND, Stop, WeldJoint
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem
from trebucheck.reference.equations import Equations, consistent_coordinates, consistent_speeds
from trebucheck.reference.solver import solve

END = 0.5
CLOSED = angle_stop(0.0, body="second").model_copy(
    update={"relative_to": "first", "limit": 0.0, "closed": True}
)


def _rod(name: str, inertia: float = 0.1) -> Body:
    return Body(name=name, angle=name, mass=1.0, centre=(0.5, 0.0), inertia=inertia)


def _triangle() -> Mechanism:
    """A pendulum of three rods that a weld makes rigid, with a stop between two of them."""
    tip = (0.9, 0.3)
    joints = (
        pin("pivot", GROUND, "first"),
        pin("elbow", "first", "second", at=tip),
        pin("wrist", "second", "third", at=tip),
    )
    weld = WeldJoint(
        name="weld", parent="first", child="third", parent_point=(2.3, 0.6), child_point=(0.5, 0.0)
    )
    return Mechanism(
        name="triangle",
        bodies=(_rod("first"), _rod("second"), _rod("third")),
        joints=(*joints, weld),
        gravity=G,
        stops=(CLOSED,),
        start=(0.3, 0.3, 0.3),
    )


def _rotor() -> Mechanism:
    """A balanced rotor at rest on its stop."""
    rotor = Body(name="rotor", angle="a", mass=2.0, centre=(0.0, 0.0), inertia=0.5)
    stop = Stop(name="stop", body="rotor", sense=1, limit=0.3, closed=True)
    return Mechanism(
        name="rotor",
        bodies=(rotor,),
        joints=(pin("pin", GROUND, "rotor"),),
        stops=(stop,),
        gravity=G,
        start=(0.3,),
    )


def _measured(mechanism: Mechanism, release: float | None) -> Metric | None:
    """The metric of the stop's release, of the reference's motion with another time of it."""
    solution, name = solve(Problem(mechanism, duration=1.1 * END)), mechanism.stops[0].name
    found = replace(
        solution.trajectory(np.linspace(0.0, 1.1 * END, 200)), release_times={name: release}
    )
    return next((m for m in measure(found, solution, END) if m.name == "release_time"), None)


@pytest.mark.parametrize("mechanism", [_triangle(), _rotor()], ids=lambda mechanism: mechanism.name)
def test_a_release_that_changes_no_motion_is_not_judged(mechanism: Mechanism) -> None:
    metric = _measured(mechanism, 0.0)
    assert metric is not None
    assert not metric.observed
    assert "not unique" in str(metric.note)


@pytest.mark.parametrize(("aside", "release"), [(-1e-3, 0.0), (1e-3, None)])
def test_a_release_is_judged_where_something_presses_or_pulls(
    aside: float, release: float | None
) -> None:
    """Pressed on, the stop stays closed; pulled off, it opens at the start."""
    rotor = _rotor()
    loaded = rotor.model_copy(
        update={"bodies": (rotor.bodies[0].model_copy(update={"centre": (aside, 0.0)}),)}
    )
    metric = _measured(loaded, release)
    assert metric is not None
    assert metric.observed
    assert metric.value is None


def test_a_stop_that_follows_from_a_loop_takes_no_freedom() -> None:
    """A slightly other start keeps its speeds but for the change itself, and the motion stays
    predictable.
    """
    mechanism = _triangle().model_copy(update={"start_speeds": (0.7, 0.7, 0.7)})
    equations = Equations(mechanism)
    near = consistent_coordinates(equations, np.array([0.300001, 0.299999, 0.3]), (CLOSED.name,))
    assert near is not None
    np.testing.assert_allclose(
        consistent_speeds(equations, near, np.full(3, 0.7), (CLOSED.name,)), 0.7, atol=1e-5
    )
    solution = solve(Problem(mechanism, duration=END))
    assert stretching_until(solution, END, scales_until(solution, END)).horizon == END
