"""Sizes of faults: how they are corrected until they fit, and which of two fits is better."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mechanisms import G, pin
from trebucheck.comparisons.diagnosis import fit as fitting
from trebucheck.comparisons.diagnosis.case import PATIENCE, Case, fit
from trebucheck.comparisons.diagnosis.faults import Component, Fault
from trebucheck.comparisons.diagnosis.fit import (
    Fit,
    _Lead,
    _leads,
    _solved,
    better,
    faults_at_the_same_motion,
    first_part,
)
from trebucheck.comparisons.runs.results import RankedCause
from trebucheck.models.elements import GROUND
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem
from trebucheck.reference.solver import solve

N, WIDTH = 25, 2
T = np.linspace(0.04, 1.0, N)
SHAPE = np.stack([T, 1.0 - 0.5 * T], axis=1).ravel()
OTHER = np.stack([np.cos(9 * T), T**2], axis=1).ravel()


def _fault(n: int, group: str = "group") -> Fault:
    components = tuple(Component("xyz"[k] if n > 1 else "", 1e-3, "kg") for k in range(n))
    return Fault(f"fault of {n}", "machine", components, group, lambda _: None)


def _fit(n: int, explained: float) -> Fit:
    return Fit(_fault(n), np.ones(n), explained)


def _case(deviation: np.ndarray) -> Any:
    return SimpleNamespace(t=T, deviation=deviation)


def _lead(*factors: float, explained: float = 0.9, signatures: Any = (SHAPE,)) -> _Lead:
    return _Lead(_fault(len(factors)), np.array(factors), explained, np.array(signatures), 1)


Signature = Callable[[np.ndarray], np.ndarray | None]


def _found(
    monkeypatch: pytest.MonkeyPatch, lead: _Lead, deviation: np.ndarray, signature: Signature,
    part: float = 1.0,
) -> tuple[Fit | None, list[list[float]], set[int]]:  # fmt: skip
    """The fit, the sizes that were solved, and with how much patience."""
    asked: list[list[float]] = []
    patience: set[int] = set()

    def measured(_: Any, given: _Lead, factors: np.ndarray, most: int) -> np.ndarray | None:
        assert given is lead
        asked.append(factors.tolist())
        patience.add(most)
        return signature(factors)

    monkeypatch.setattr(fitting, "_measured", measured)
    return _solved(_case(deviation), lead, part), asked, patience


def test_a_size_is_corrected_in_one_step_where_its_effect_is_linear(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, asked, patience = _found(monkeypatch, _lead(2.0), 3.0 * SHAPE, lambda f: f[0] * SHAPE)
    assert found is not None and found.factors == pytest.approx([3.0])
    assert found.explained == pytest.approx(1.0)
    assert asked == [[2.0], [pytest.approx(3.0)]] and patience == {PATIENCE}


def test_a_size_is_corrected_by_the_secant_through_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    """An effect of f to the power of 3/2: six sizes on both sides of the right one, and nearer."""
    found, asked, _ = _found(
        monkeypatch, _lead(3.0), 4.0 * SHAPE, lambda f: f[0] * abs(f[0]) ** 0.5 * SHAPE
    )
    sizes = [3.0]
    while len(sizes) < 6:
        sizes.append(4.0 / sizes[-1] ** 0.5)
    assert asked == [[pytest.approx(size)] for size in sizes]
    assert found is not None and found.factors.tolist() == asked[-1]
    assert found.explained == pytest.approx(1 - abs(1 - sizes[-1] ** 1.5 / 4.0))


def test_several_numbers_are_corrected_to_first_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left is fitted with the signatures of the lead."""
    lead = _lead(1.0, 1.0, signatures=(SHAPE, OTHER))
    deviation = 2.0 * SHAPE - 0.5 * OTHER
    found, asked, _ = _found(monkeypatch, lead, deviation, lambda f: f[0] * SHAPE + f[1] * OTHER)
    assert found is not None and found.factors == pytest.approx([2.0, -0.5])
    assert len(asked) == 2


def test_a_size_that_makes_no_sense_is_halved_until_it_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, asked, _ = _found(
        monkeypatch, _lead(16.0), 3.0 * SHAPE, lambda f: f[0] * SHAPE if f[0] < 5 else None
    )
    assert [size for (size,) in asked] == pytest.approx([16.0, 8.0, 4.0, 3.0])
    assert found is not None and found.factors == pytest.approx([3.0])
    never, asked, _ = _found(monkeypatch, _lead(64.0), SHAPE, lambda _: None)
    assert never is None and len(asked) == 6


def test_the_best_size_that_could_be_solved_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a correction leads to what cannot be solved, or to what fits worse."""
    found, asked, _ = _found(
        monkeypatch, _lead(2.0), 3.0 * SHAPE, lambda f: f[0] * SHAPE if f[0] < 2.5 else None
    )
    assert found is not None and found.factors.tolist() == [2.0] and len(asked) == 2
    assert found.explained == pytest.approx(2 / 3)
    found, asked, _ = _found(
        monkeypatch, _lead(2.0), 3.0 * SHAPE, lambda f: (2.0 if f[0] < 2.5 else 9.0) * SHAPE
    )
    assert found is not None and found.factors.tolist() == [2.0] and len(asked) == 2


@pytest.mark.parametrize(("explained", "solved"), [(0.5, 1), (0.51, 6)])
def test_what_fits_badly_is_not_corrected(
    monkeypatch: pytest.MonkeyPatch, explained: float, solved: int
) -> None:
    """It has less patience, too. What is solved gains a hundredth each time, and fits never."""
    shares = iter(0.3 + 0.01 * np.arange(10))
    lead = _lead(1.0, explained=explained)
    _, asked, patience = _found(monkeypatch, lead, SHAPE, lambda _: next(shares) * SHAPE)
    assert len(asked) == solved and patience == {3 if solved == 1 else PATIENCE}


@pytest.mark.parametrize(("gain", "solved"), [(0.0029, 2), (0.0031, 6)])
def test_corrections_that_gain_too_little_are_the_last(
    monkeypatch: pytest.MonkeyPatch, gain: float, solved: int
) -> None:
    shares = iter(0.3 + gain * np.arange(10))
    _, asked, _ = _found(monkeypatch, _lead(1.0), SHAPE, lambda _: next(shares) * SHAPE)
    assert len(asked) == solved


def test_a_size_is_corrected_by_the_first_part_of_the_motion_then_by_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An effect that goes astray after 0.3: 3 fits the beginning, and the whole is never fitted."""
    early = np.repeat(T <= 0.33, WIDTH)

    def astray(f: np.ndarray) -> np.ndarray:
        return np.where(early, f[0] * SHAPE, f[0] ** 2 * SHAPE)

    deviation = np.where(early, 3.0 * SHAPE, 6.0 * SHAPE)
    found, asked, _ = _found(monkeypatch, _lead(2.0), deviation, astray, 0.08)
    assert asked[1] == pytest.approx([3.0])
    whole = fit(deviation, astray(np.array([3.0]))[None])[0]
    assert asked[2] == pytest.approx(3.0 * whole)
    assert found is not None and found.explained == pytest.approx(
        max(1 - np.linalg.norm(deviation - astray(np.array(f))) / np.linalg.norm(deviation)
            for f in asked)
    )  # fmt: skip


def test_the_first_part_of_a_motion_is_so_many_of_its_times() -> None:
    case = _case(SHAPE)
    assert [first_part(case, part) for part in (0.01, 0.08, 0.3, 1.0)] == [2, 4, 16, 50]


@pytest.mark.parametrize(
    ("simple", "general", "chosen"),
    [
        (0.90, 0.96, 2),  # it leaves less than half
        (0.90, 0.94, 1),
        (0.999, 1.0, 1),  # what is left is the fit's own error
        (0.9989, 0.9999, 2),
        (0.5, 0.4, 1),
    ],
)
def test_two_numbers_have_to_leave_less_than_half_of_what_one_leaves(
    simple: float, general: float, chosen: int
) -> None:
    one, two = _fit(1, simple), _fit(2, general)
    for found in (better(one, two), better(two, one)):
        assert len(found.factors) == chosen


def test_of_as_many_numbers_the_one_that_leaves_less_is_better() -> None:
    less, more = _fit(2, 0.6), _fit(2, 0.7)
    assert better(less, more) is more is better(more, less)


def test_a_fit_tells_its_cause() -> None:
    found = Fit(_fault(2), np.array([5.0, -2.0]), 0.8)
    assert found.cause == RankedCause(
        name="fault of 2", kind="machine", amount="x +0.005 kg, y -0.002 kg", explained=0.8
    )


# which suspects are solved


def _signature(share: float) -> np.ndarray:
    """Explains so much of SHAPE: 1 - share is the sine of the angle between the two."""
    unit = SHAPE / np.linalg.norm(SHAPE)
    across = OTHER - unit * (unit @ OTHER)
    across /= np.linalg.norm(across)
    left = 1.0 - share
    return (1 - left**2) ** 0.5 * unit + left * across


def _led(*suspects: tuple[str, float, float]) -> list[tuple[str, int, float]]:
    """Group, reading and share of the leads, of groups with the shares by both readings."""
    rows = [
        (_fault(1, group), np.array([[_signature(own)], [_signature(others)]]))
        for group, own, others in suspects
    ]
    found = _leads(_case(SHAPE), rows, 1.0)
    return [(lead.fault.group, lead.reading, round(lead.explained, 6)) for lead in found]


def test_the_three_groups_that_fit_best_are_solved_by_the_reading_that_fits() -> None:
    found = _led(("a", 0.1, 0.5), ("b", 0.8, 0.3), ("c", 0.2, 0.6), ("d", 0.4, 0.45))
    assert found == [("b", 0, 0.8), ("c", 1, 0.6), ("a", 1, 0.5)]


def test_members_of_a_group_that_fit_nearly_as_well_as_its_best_are_solved() -> None:
    assert _led(("a", 0.5, 0.0), ("a", 0.495, 0.0), ("a", 0.485, 0.0), ("b", 0.4, 0.0)) == [
        ("a", 0, 0.5),
        ("a", 0, 0.495),
        ("b", 0, 0.4),
    ]


@pytest.mark.parametrize(("exact", "solved"), [(2, 3), (5, 5), (9, 6)])
def test_up_to_six_groups_that_account_for_all_of_it_are_solved(exact: int, solved: int) -> None:
    suspects = [(f"{k}", 0.9995 if k < exact else 0.9, 0.0) for k in range(10)]
    assert len(_led(*suspects)) == solved


# faults that move nothing


def _rotor(factor: float) -> dict[str, RankedCause]:
    """Causes of the pin's force of a balanced rotor that turns evenly, off by a factor."""
    body = Body(name="rotor", angle="a", mass=2.0, centre=(0.0, 0.0), inertia=0.5)
    machine = Mechanism(
        name="rotor", bodies=(body,), joints=(pin("pin", GROUND, "rotor"),), gravity=G,
        start=(0.3,), start_speeds=(1.0,),
    )  # fmt: skip
    solution = solve(Problem(machine, duration=1.2))
    right = solution.trajectory(np.linspace(0.0, 1.0, 41))
    forces = {name: factor * force for name, force in right.joint_reactions.items()}
    case = Case(replace(right, joint_reactions=forces), solution, 1.0)
    return {cause.name: cause for cause in faults_at_the_same_motion(case)}


def test_faults_that_move_nothing_explain_forces() -> None:
    """More weight: of the mass or of gravity. What moves the rotor is no such fault."""
    found = _rotor(1.01)
    for name in ("gravity", "mass of the rotor"):
        assert found[name].explained == pytest.approx(1.0, abs=1e-6)
        assert found[name].amount == "+1 %"
    assert found["direction of gravity"].explained < 0.1
    assert found["no gravity"].explained == pytest.approx(-100.0)
    assert not [name for name in found if "friction" in name or "torque" in name]
    assert "centre of mass of the rotor, x" not in found and "inertia of the rotor" not in found


def test_a_force_that_is_missing_is_that_of_gravity() -> None:
    assert _rotor(0.0)["no gravity"].explained == pytest.approx(1.0)
    assert _rotor(0.5)["gravity"].amount == "-50 %"
    assert _rotor(-1.0)["gravity reversed"].explained == pytest.approx(1.0)
