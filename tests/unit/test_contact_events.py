"""What the engines' event loops share: releases, impacts, which contacts touch, rest and push."""

from __future__ import annotations

import numpy as np
import pytest
from trebucheck.engines import events as event_rules
from trebucheck.engines.events import (
    ContactEvents,
    active_contacts,
    refuse_moving_gaps,
    resting,
)
from trebucheck.models.elements import Stop
from trebucheck.models.errors import SimulationError, UnsupportedProblemError
from trebucheck.models.library.trebuchet import fixed
from trebucheck.models.mechanism import Mechanism

HANGER, SLING = "hanger rest", "sling rest"


def bouncing() -> Mechanism:
    """The fixed trebuchet whose stops have a restitution."""
    mechanism = fixed()
    stops = tuple(stop.model_copy(update={"restitution": 0.5}) for stop in mechanism.stops)
    return mechanism.model_copy(update={"stops": stops})


def test_the_first_opening_of_a_stop_that_was_closed_counts() -> None:
    events = ContactEvents(fixed(), "engine")
    events.release([HANGER], 0.5)
    events.release(events.releases, 0.7)
    closed = {stop.name for stop in fixed().stops if stop.closed}
    assert closed >= {HANGER, SLING}
    assert events.releases == {
        name: {HANGER: 0.5}.get(name, 0.7) if name in closed else None for name in events.releases
    }


def test_contacts_that_touch_take_part_in_an_impact() -> None:
    events, gaps = ContactEvents(fixed(), "engine"), {HANGER: 1e-12, SLING: 1e-3}
    names = tuple(events.releases)
    met = next(name for name in names if name not in gaps)
    assert events.touching(1.0, met, (), lambda name: gaps.get(name, 1.0)) == tuple(
        name for name in names if name in (HANGER, met)
    )
    events.note_impact(1.0, {SLING: 2.0, HANGER: 0.0})
    assert SLING in events.touching(1.0 + 1e-10, met, (), lambda _: 1.0)
    assert HANGER not in events.touching(1.0 + 1e-10, met, (), lambda _: 1.0)
    assert SLING not in events.touching(1.0 + 1e-8, met, (), lambda _: 1.0)


def test_slow_and_named_contacts_are_plastic() -> None:
    events, machine = ContactEvents(bouncing(), "engine"), bouncing()
    q, u = np.array(machine.start), np.ones(len(machine.start))
    assert events.restitution({HANGER: -1.0, SLING: -1e-7}, q, u) == {HANGER: 0.5, SLING: 0.0}
    assert events.restitution({HANGER: -1.0, SLING: -1.0}, q, u, plastic=(HANGER,)) == {
        HANGER: 0.0,
        SLING: 0.5,
    }


def test_impacts_without_an_end_are_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_rules, "MOST_IMPACTS", 1)
    events = ContactEvents(fixed(), "engine")
    events.note_impact(0.0, {})
    events.retract_impact()
    events.note_impact(0.1, {})
    with pytest.raises(
        SimulationError, match=r"^engine gave up at t = 0\.2 s: 1 impacts, and no end\.$"
    ):
        events.note_impact(0.2, {})


def test_what_does_not_move_rests() -> None:
    assert resting({"a": 1e-10, "b": -1e-10, "c": 1e-3}) == ("a", "b")


@pytest.mark.parametrize("pushing", [("a", "b", "c"), ("b",), ("a", "c"), ()])
def test_pivoting_finds_the_contacts_that_push(pushing: tuple[str, ...]) -> None:
    names = ("a", "b", "c")

    def violated(active: tuple[str, ...]) -> str | None:
        return next((name for name in names if (name in active) != (name in pushing)), None)

    assert active_contacts(names, violated) == pushing


def test_a_choice_that_comes_twice_is_accepted() -> None:
    assert active_contacts(("a",), lambda _: "a") == ("a",)


def test_a_closed_stop_whose_gap_changes_is_refused() -> None:
    mechanism = fixed()
    refuse_moving_gaps(mechanism, "engine")
    stop = mechanism.stop(HANGER)
    assert isinstance(stop, Stop)
    speeds = tuple(
        0.25 * stop.sense if body.name == stop.body else 0.0 for body in mechanism.bodies
    )
    with pytest.raises(
        UnsupportedProblemError,
        match=r"^engine cannot start with stop .* changes at -?0\.25 rad/s:",
    ):
        refuse_moving_gaps(mechanism.model_copy(update={"start_speeds": speeds}), "engine")
