"""How errors of the start and of parameters are stretched, and the predictability horizon.

From closed forms.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import mechanisms
import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.runs import stretching as stretchings
from trebucheck.comparisons.runs.metrics import measure
from trebucheck.comparisons.runs.quantities import QUANTITIES
from trebucheck.comparisons.runs.results import Metric
from trebucheck.comparisons.runs.scales import LIMIT, scales_until
from trebucheck.comparisons.runs.stretching import (
    PARTED,
    START_LIMIT,
    Stretching,
    parting,
    stretching_until,
)
from trebucheck.comparisons.runs.tolerances import DEFAULT
from trebucheck.models.library.registry import benchmark
from trebucheck.models.mechanism import Body, Marker
from trebucheck.reference.solver import solve


def _stretched(mechanism: tb.Mechanism, end: float) -> Stretching:
    solution = solve(tb.Problem(mechanism, duration=end))
    return stretching_until(solution, end, scales_until(solution, end))


def _links(n: int, start: float) -> tb.Mechanism:
    """Equal rods of 1 m and 1 kg, each hung from the end of the one before, at rest."""
    names = ["ground", *(f"rod {i}" for i in range(n))]
    rods = tuple(
        Body(name=name, angle=f"{name} angle", mass=1, centre=(0.5, 0), inertia=1 / 12)
        for name in names[1:]
    )
    pins = [
        mechanisms.pin(f"pin {i}", *names[i : i + 2], at=(1.0 if i else 0.0, 0.0)) for i in range(n)
    ]
    tip = Marker(name="tip", body=names[-1], point=(1, 0))
    return tb.Mechanism(
        name="links",
        bodies=rods,
        joints=tuple(pins),
        markers=(tip,),
        gravity=9.81,
        start=(start,) * n,
    )


def test_errors_of_the_start_of_an_even_turn() -> None:
    """Without gravity an angle keeps its error, and an error of the speed makes one that grows with
    time.
    """
    even = mechanisms.hanging_bob(
        gravity=0.0, start_speeds=(1.0,)
    )  # 2 m: the natural speed is its own, 1 rad/s
    found = _stretched(even, 4.0)
    assert found.start == pytest.approx(np.maximum(1.0, found.t), rel=1e-4)
    assert found.horizon == 4.0


def test_errors_of_the_start_of_a_small_swing() -> None:
    """The angle's error is carried on as cos(wt), that of sqrt(g / l) of the speed as sin(wt)."""
    found = _stretched(mechanisms.hanging_bob(start=math.pi / 2 - 1e-3), 2.0)
    assert found.start == pytest.approx(np.ones(len(found.t)), rel=1e-4)


def test_errors_of_an_upright_pendulum_grow_exponentially() -> None:
    """A point mass at rest above its pin: cosh(wt), at once in its configuration."""
    up, w = mechanisms.hanging_bob(start=-math.pi / 2), math.sqrt(9.81 / 2.0)
    found = _stretched(up, 4.0)
    assert found.start == pytest.approx(np.cosh(w * found.t), rel=1e-2)
    assert found.horizon == pytest.approx(math.acosh(START_LIMIT) / w, abs=2 * found.t[1])


def test_a_closed_stop_holds_the_start() -> None:
    """A start that is held by its stop has no error of its own."""
    held = mechanisms.hanging_bob(
        mechanisms.angle_stop(0.0).model_copy(update={"closed": True}), gravity=0.0
    )
    assert _stretched(held, 1.0).start.max() < 1e-6


def test_a_regular_motion_is_predictable_however_long() -> None:
    """A rod's swing: a part of its inertia changes its phase by 1.5 parts in each characteristic
    time.
    """
    found = _stretched(_links(1, 0.3), 20.0)
    assert found.parameters[-1] > LIMIT and found.horizon == 20.0


def test_the_stretching_of_a_small_swing_does_not_depend_on_its_amplitude() -> None:
    """Speeds and changes of forces are parts of small ones: the integrations must resolve them."""
    chain = benchmark("hanging-chain").problem()
    still = np.full(len(chain.mechanism.start), math.pi / 2)
    larger = still + 100 * (np.array(chain.mechanism.start) - still)
    large, small = (
        _stretched(chain.mechanism.model_copy(update={"start": start}), chain.duration)
        for start in (tuple(larger.tolist()), chain.mechanism.start)
    )
    assert small.parameters == pytest.approx(large.parameters, rel=0.05, abs=0.05)


def test_a_chaotic_motion_is_not() -> None:
    found = _stretched(_links(2, 0.0), 5.0)
    index = int(np.searchsorted(found.t, found.horizon))
    assert found.horizon < 4.5 and found.largest[index] <= LIMIT < found.largest[index + 1]


def test_many_bodies_are_changed_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seven bodies take as many integrations as a hundred."""
    changed: list[tuple[float, ...]] = []

    def counted(problem: tb.Problem, *tolerances: float) -> Any:
        changed.append(tuple(body.inertia - 1 / 12 for body in problem.mechanism.bodies))
        return solve(problem, *tolerances)

    monkeypatch.setattr(stretchings, "solve", counted)
    assert _stretched(_links(7, 1.0), 0.01).horizon == 0.01
    assert len(changed) == 1 + 3 + 2  # none, three random combinations, coordinates and speeds
    assert all(np.abs(each) == pytest.approx(1e-6, rel=1e-6) for each in changed[1:4])
    assert len({tuple(np.sign(each)) for each in changed[1:4]}) == 3 and not np.any(changed[4:])


def test_beside_a_pole_forces_are_left_out_and_nothing_else() -> None:
    """Four times, a pole beside the second and the third; the second motion ends before the last.

    Rows are a position, and forces of two joints, of which the first is not unique at the start.
    """
    changed: Any = object.__new__(stretchings._Changed)
    changed.t, changed.scales, changed.unchanged = np.arange(4.0), None, None
    changed.first_force, changed.poles = 1, np.array([False, True, True, False])
    first = np.array([[1, 0, 0, 2], [np.nan, 99, 99, 1], [2, 99, 99, 4]], dtype=complex)
    second = np.array([[1, 3, 0], [1, 99, 99], [2, 99, 99j]], dtype=complex)
    motions = iter((1e-6 * first, 1e-6 * second))
    changed._moved = lambda *_: next(motions)

    def read(*_: object) -> np.ndarray:
        return np.zeros((3, 4), dtype=complex)

    found = [changed.largest(["first"], read).tolist(), changed.largest(["second"], read).tolist()]
    assert found == [pytest.approx([2, 2, 2, 4]), pytest.approx([2, 3, 3, math.inf])]


def test_no_inertia_is_changed_to_less_than_none() -> None:
    """Point masses get as much more as other bodies get less."""
    n, inertia = 7, 1 / 12
    rods = _links(n, 1.0)
    points = [body.model_copy(update={"inertia": 0.0}) for body in rods.bodies]
    several = zip(
        stretchings._with_other_inertias(rods),
        stretchings._with_other_inertias(rods.model_copy(update={"bodies": tuple(points)})),
        strict=True,
    )
    down = 0
    for heavy, light in several:
        changes = [body.inertia - inertia for body in heavy.bodies]
        down += sum(change < 0 for change in changes)
        added = [body.inertia for body in light.bodies]
        assert added == pytest.approx(np.abs(changes), rel=1e-6)
    assert down > 0


def test_a_changed_mechanism_that_cannot_be_moved_to_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It is known until three quarters, half or a quarter of the end."""

    def fails_late(problem: tb.Problem, *tolerances: float) -> Any:
        if problem.duration > 0.6:
            raise tb.SimulationError("it cannot be moved")
        return solve(problem, *tolerances)

    monkeypatch.setattr(stretchings, "solve", fails_late)
    found = _stretched(mechanisms.hanging_bob(), 1.0)
    assert (
        np.isfinite(found.largest[found.t <= 0.5]).all()
        and np.isinf(found.largest[found.t > 0.5]).all()
    )
    assert found.horizon == found.t[found.t <= 0.5][-1]


def test_the_reference_is_not_known_beyond_its_own_rounding() -> None:
    t, one = np.linspace(0.0, 4.0, 5), np.ones(5)
    known = Stretching(t, one, one, np.array([0.0, 1e-6, 9e-5, 1.1e-4, 1.0]), LIMIT * one)
    assert known.horizon == 2.0


# the time of first parting


def _growing(horizon: float, end: float = 4.0) -> Stretching:
    """Exponential, so that the limit is reached at the horizon [s]."""
    t = np.linspace(0.0, end, 401)
    growth = LIMIT ** (t / horizon)
    return Stretching(t, growth, growth, np.zeros(401), np.full(401, LIMIT))


def _parted(base_error: float, stretching: Stretching) -> dict[str, Metric]:
    """Of an engine whose angle is wrong by its base error, stretched."""
    bob, t = mechanisms.hanging_bob(), np.linspace(0.0, 4.0, 4001)
    solution = solve(tb.Problem(bob, duration=4.0))
    own = solution.trajectory(t)
    wrong = base_error * np.interp(t, stretching.t, stretching.largest)
    run = replace(own, q=own.q + wrong[:, None])
    metrics = measure(
        run, solution, stretching.horizon, own, invariants_to=4.0, stretching=stretching
    )
    return {
        metric.name: metric for metric in metrics if metric.name in ("base_error", "first_parting")
    }


@pytest.mark.parametrize("base_error", [1e-4, 1e-6, 1e-8])
def test_the_time_of_first_parting_shows_the_base_error(base_error: float) -> None:
    stretching = _growing(1.5)
    found = _parted(base_error, stretching)
    time, shown = found["first_parting"].value, found["base_error"].value
    assert time == pytest.approx(1.5 * math.log(DEFAULT / base_error) / math.log(LIMIT), abs=0.01)
    assert shown == pytest.approx(
        base_error, rel=0.05
    )  # a sample of the stretching is 3 % more than the one before
    tolerance = DEFAULT * QUANTITIES["base_error"].scale_of(
        scales_of_bob(), None, mechanisms.hanging_bob()
    )
    assert (shown <= tolerance) == (time >= stretching.horizon) == (base_error <= 1e-5)


def scales_of_bob() -> Any:
    return scales_until(solve(tb.Problem(mechanisms.hanging_bob(), duration=1.0)), 1.0)


def test_a_motion_that_does_not_part_has_a_bound_of_its_base_error() -> None:
    stretching = _growing(2.5)
    found = _parted(1e-12, stretching)
    assert found["first_parting"].value is None
    assert found["base_error"].value == pytest.approx(DEFAULT / stretching.largest[-1])


def test_a_predictable_motion_has_no_time_of_first_parting() -> None:
    assert not _parted(1e-3, _growing(4.0)) and not _parted(1e-3, _growing(5.0))


def test_beyond_a_horizon_that_rounding_sets_a_parting_is_no_fault() -> None:
    """The reference is not known there, however little the motion is stretched."""
    growing = _growing(8.0)
    rounded = replace(growing, rounding=np.where(growing.t > 2.0, 1.0, 0.0))
    assert rounded.horizon == 2.0
    late, early = _parted(2e-4, rounded), _parted(9e-4, rounded)
    assert late["first_parting"].value > 2.0 > early["first_parting"].value  # type: ignore[operator]
    assert late["base_error"].value == pytest.approx(1e-5) and early["base_error"].value > 1e-4  # type: ignore[operator]


@pytest.mark.parametrize(("away", "parts"), [(0.99, False), (1.01, True)])
def test_a_marker_has_parted_by_a_part_of_the_length(away: float, parts: bool) -> None:
    """Of a model of 20 cm: coordinates as they should be, the marker a little more or less off."""
    bob, t = mechanisms.hanging_bob(length=0.2), np.linspace(0.0, 4.0, 401)
    own = solve(tb.Problem(bob, duration=4.0)).trajectory(t)
    scales = scales_until(solve(tb.Problem(bob, duration=4.0)), 4.0)
    assert scales.length == pytest.approx(0.2)
    shift = np.where(t > 2.5, away * PARTED * 0.2, 0.0)[:, None] * [0.6, 0.8]
    marker = own.marker("bob")
    wrong = replace(own, markers={"bob": replace(marker, position=marker.position + shift)})
    angles = np.array([True])
    found = {m.name: m for m in parting(wrong, own, angles, scales, _growing(1.5))}
    time = found["first_parting"].value
    assert (time is not None) == parts
    assert time is None or time == pytest.approx(2.51)
    off = replace(own, q=own.q + np.where(t > 1.7, away * PARTED, 0.0)[:, None])
    found = {m.name: m for m in parting(off, own, angles, scales, _growing(1.5))}
    time = found["first_parting"].value
    assert time is None if not parts else time == pytest.approx(1.71)
