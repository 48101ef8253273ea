"""Impulses of an impact through a full mass matrix.

Contacts at once, redundant ones, loops, and times of events.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from trebucheck.engines.impact import Inertia, resolve_impact
from trebucheck.models.arrays import FloatArray

MASS = np.array([[3.0, 1.0], [1.0, 2.0]])
FREE = Inertia(MASS, np.zeros((0, 2)))
AXES = {"a": np.array([1.0, 0.0]), "b": np.array([0.0, 1.0])}


def lost(speeds: FloatArray, after: FloatArray) -> float:
    """Kinetic energy that an impact takes [J]."""
    return 0.5 * float(speeds @ MASS @ speeds - after @ MASS @ after)


def test_one_contact_gives_back_its_restitution() -> None:
    speeds = np.array([-2.0, 0.5])
    impact = resolve_impact(FREE, speeds, {"a": AXES["a"]}, {"a": 0.3}, "mujoco")
    assert impact.left == pytest.approx({"a": 0.6})
    assert MASS @ (impact.speeds - speeds) == pytest.approx([impact.impulses["a"], 0.0])
    # (1 - e^2) v^2 / (2 G M^-1 G^T)
    assert lost(speeds, impact.speeds) == pytest.approx(
        (1 - 0.3**2) * 2.0**2 / (2 * np.linalg.inv(MASS)[0, 0])
    )


def test_contacts_that_would_have_to_pull_take_no_part() -> None:
    """The one that is met accelerates the other away.

    An impulse at both would have to pull there.
    """
    impact = resolve_impact(
        FREE,
        np.array([0.0, -1.0]),
        {"a": -AXES["a"], "b": AXES["b"]},
        {"a": 0.0, "b": 0.0},
        "mujoco",
    )
    assert impact.impulses["a"] == 0.0 < impact.impulses["b"]
    assert impact.left["a"] > 0.0 == pytest.approx(impact.left["b"], abs=1e-15)


def test_both_push_where_both_are_met() -> None:
    impact = resolve_impact(FREE, np.array([-1.0, -1.0]), AXES, {"a": 0.0, "b": 0.5}, "mujoco")
    assert impact.speeds == pytest.approx([0.0, 0.5], abs=1e-15)
    assert MASS @ (impact.speeds + 1.0) == pytest.approx(
        [impact.impulses["a"], impact.impulses["b"]]
    )


def test_redundant_contacts_share_one_impulse() -> None:
    row = np.array([1.0, 1.0])
    once = resolve_impact(FREE, np.array([-1.0, -2.0]), {"a": row}, {"a": 0.5}, "mujoco")
    twice = resolve_impact(
        FREE, np.array([-1.0, -2.0]), {"a": row, "b": row}, {"a": 0.5, "b": 0.5}, "mujoco"
    )
    assert twice.speeds == pytest.approx(once.speeds)
    assert twice.impulses == pytest.approx(dict.fromkeys("ab", once.impulses["a"] / 2))


def test_impulses_respect_loops_that_are_redundant() -> None:
    """Two speeds that a loop holds equal, the loop given twice.

    The contact feels the sum of the inertias.
    """
    loop = np.array([[1.0, -1.0]])
    inertia = Inertia(MASS, np.concatenate([loop, 2 * loop]))
    impact = resolve_impact(inertia, np.array([-1.0, -1.0]), {"a": AXES["a"]}, {"a": 0.0}, "mujoco")
    assert impact.speeds == pytest.approx([0.0, 0.0], abs=1e-14)
    assert impact.impulses["a"] == pytest.approx(MASS.sum())


def test_drift_of_held_contacts_and_loops_is_no_speed_of_an_impact() -> None:
    inertia = Inertia(MASS, np.array([[1.0, -1.0]]))
    drifting = np.array([1.0 + 1e-8, 1.0])
    assert inertia.loops @ inertia.without_drift(drifting, np.zeros((0, 2))) == pytest.approx(
        [0.0], abs=1e-15
    )
    assert FREE.without_drift(drifting, AXES["a"][None])[0] == pytest.approx(0.0, abs=1e-15)


def test_a_root_whose_last_bit_depends_on_what_was_asked_before() -> None:
    """MuJoCo's warm start does that.

    A value that has the other sign when it is asked for again is no error.
    """
    pytest.importorskip("mujoco")
    from trebucheck.engines.events import root_in

    signs = itertools.cycle((-1.0, 1.0))
    found = root_in(lambda part: part - 5e-4 if part else next(signs) * 1e-17, 0.0, 1e-3)
    assert found == pytest.approx(5e-4)
