"""Ends of ranges, signs and zeros of the small functions that verdicts go through."""

from __future__ import annotations

import math

import pytest
from mechanisms import four_bar, hanging_bob
from trebucheck.comparisons.diagnosis.faults import Component
from trebucheck.comparisons.runs.results import Metric, share_of
from trebucheck.comparisons.runs.scales import extent


@pytest.mark.parametrize(
    ("value", "tolerance", "share"),
    [
        (1.0, 2.0, 0.5),
        (-1.0, 2.0, 0.5),
        (0.0, 0.0, 0.0),
        (None, 1.0, math.inf),
        (None, None, None),
        (1.0, None, None),
    ],
)
def test_a_share_of_a_tolerance(
    value: float | None, tolerance: float | None, share: float | None
) -> None:
    assert share_of(value, tolerance) == share


def test_any_value_is_beyond_a_tolerance_of_zero() -> None:
    share = share_of(1e-200, 0.0)
    assert share is not None and share > 1.0


@pytest.mark.parametrize(
    ("component", "factor", "sensible"),
    [
        (Component("", 0.5, ""), -2.0, True),
        (Component("", 0.5, ""), -2.01, False),
        (Component("", 0.5, ""), 20.0, True),
        (Component("", 0.5, ""), 20.1, False),
        (Component("", 1.0, "rad"), 3.1, True),
        (Component("", 1.0, "rad"), -3.2, False),
        (Component("", 1.0, "m", length=2.0), 2.0, True),
        (Component("", 1.0, "m", length=2.0), -2.1, False),
        (Component("", 1.0, "N m", positive=True), 0.0, True),
        (Component("", 1.0, "N m", positive=True), 1e9, True),
        (Component("", 1.0, "N m", positive=True), -1e-9, False),
        (Component("", 1.0, "N m"), -1e9, True),
        (Component("", 1.0, "N m"), math.inf, False),
    ],
)
def test_a_size_that_a_fault_can_have(component: Component, factor: float, sensible: bool) -> None:
    assert component.is_sensible(factor) is sensible


def test_a_size_is_in_its_unit_or_in_per_cent() -> None:
    assert Component("", 0.01, "").text(0.5) == "+0.5 %"
    assert Component("x", 0.01, "m").text(-2.0) == "x -0.02 m"


def test_a_body_reaches_to_its_farthest_point_or_its_radius_of_gyration() -> None:
    (bob,) = hanging_bob().bodies
    assert extent(hanging_bob(), bob) == 2.0
    stout = bob.model_copy(update={"inertia": 9.0 * 9.0 * bob.mass})
    assert extent(hanging_bob(bodies=(stout,)), stout) == 9.0
    loop = four_bar()
    for body in loop.bodies:
        pivot = loop.joint_of(body.name).child_point
        ends = [j.child_point for j in loop.joints if j.child == body.name]
        ends += [j.parent_point for j in loop.joints if j.parent == body.name]
        assert extent(loop, body) >= max(math.dist(pivot, end) for end in ends) > 0


@pytest.mark.parametrize(
    ("value", "holds"), [(1e-3, True), (-1e-3, True), (1.001e-3, False), (-1.001e-3, False)]
)
def test_a_tolerance_holds_to_its_very_end(value: float, holds: bool) -> None:
    metric = Metric(name="position_max", subject="p", value=value, unit="m", tolerance=1e-3)
    assert metric.holds is holds
