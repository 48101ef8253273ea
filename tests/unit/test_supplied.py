"""What engines say that trebucheck supplies.

How much of a run is theirs, and that the built-in ones say what is so.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import trebucheck as tb
from trebucheck.engines.protocol import BuiltinEngine, Recording
from trebucheck.engines.supplied import (
    HELD,
    LIMITED,
    MOVED,
    NOTHING,
    Own,
    Part,
    all_by,
    by_part,
    concerned,
    idle_options,
    own,
    sentence,
    stated,
)

PLUGINS = Path(__file__).parents[2] / "plugins"
BASES = {"(NodeEngine)": "node_engine.py", "(BodyEngine)": "body_plan.py"}
"""Modules of the toolkit that have the base classes of engines."""
ALL = concerned(stops=True, impacts=True, loops=True, elements=True)


@pytest.mark.parametrize(
    ("supplied", "stopped", "free"),
    [
        (NOTHING, Own.ALL, Own.ALL),
        (LIMITED, Own.MOST, Own.ALL),
        (HELD, Own.STEPS, Own.ALL),
        ({Part.STEPS: "while something is held", **HELD}, Own.STEPS, Own.ALL),
        (MOVED, Own.DYNAMICS, Own.DYNAMICS),
    ],
)
def test_what_a_mechanism_does_not_have_is_not_counted(
    supplied: dict[str, str], stopped: Own, free: Own
) -> None:
    assert own(supplied) is own(supplied, ALL) is stopped
    assert own(supplied, concerned(stops=False, impacts=False, loops=False, elements=False)) is free


def test_springs_that_are_pushed_by_trebucheck_leave_most_or_the_steps() -> None:
    sprung = concerned(stops=False, impacts=False, loops=False, elements=True)
    assert own(HELD, sprung) is Own.MOST  # its integrator takes them
    assert own({Part.STEPS: "with springs", **HELD}, sprung) is Own.STEPS


def test_impacts_are_of_stops_that_may_be_met() -> None:
    assert (
        own({Part.IMPACTS: ""}, concerned(stops=True, impacts=False, loops=False, elements=False))
        is Own.ALL
    )
    assert (
        own({Part.IMPACTS: ""}, concerned(stops=True, impacts=True, loops=False, elements=False))
        is Own.MOST
    )


def test_it_is_said_in_a_sentence() -> None:
    assert sentence({}) == "All of a run is the engine's own."
    told = {Part.EVENTS: "", Part.ELEMENTS: "dampers"}
    parts = "when stops open and are met; springs, dampers and motors (dampers)"
    assert sentence(told) == f"Trebucheck supplies: {parts}. The rest is the engine's own."


def test_an_engine_that_does_not_say_is_not_taken_to_supply_all() -> None:
    assert stated(object()) is None

    class Silent(BuiltinEngine):
        name, package = "silent", "scipy"

        def _run(self, problem: tb.Problem) -> Recording:
            raise NotImplementedError

    assert stated(Silent()) is None  # the default of an engine that is made from our base class


def test_mujoco_says_what_is_done_in_its_place() -> None:
    for preset in ("default", "settings"):
        assert stated(tb.engine("mujoco", preset)) == {}
    located = stated(tb.engine("mujoco", "default", locate_releases=True))
    assert located is not None and set(located) == {Part.EVENTS}
    parts = {Part.EVENTS, Part.IMPACTS, Part.START, Part.CORRECTIONS, Part.SUBSTEPS, Part.UNITS}
    assisted = tb.engine("mujoco")
    everything = stated(assisted)
    assert everything is not None and set(everything) == parts
    # A pendulum has no stops, no points and a size that needs no units of its own.
    pendulum = stated(assisted, tb.model("pendulum"))
    assert pendulum is not None and set(pendulum) == {Part.SUBSTEPS}


@pytest.mark.parametrize(
    "path", sorted(PLUGINS.glob("*/trebucheck_*/engine.py")), ids=lambda path: path.parts[-3]
)
def test_an_adapter_that_uses_a_shared_driver_says_so(path: Path) -> None:
    """Of the plug-ins here, by their text: their engines are not installed."""
    text = path.read_text(encoding="utf-8")
    for base, module in BASES.items():
        if base in text:
            toolkit = PLUGINS / "toolkit" / "trebucheck_toolkit"
            text += (toolkit / module).read_text(encoding="utf-8")
    declared = text.partition("def supplied")[2].partition("def ")[0]
    declared += text.partition("assistance: ClassVar")[2].partition("def ")[0]
    declared += "".join(re.findall(r"^_\w+: Supplied = .*", text, re.MULTILINE))
    assert declared
    drivers = (
        ("EventDriver(", r"HELD|MOVED|Part\.EVENTS"),
        ("LimitedMotion(problem, tree", r"LIMITED|Part\.ELEMENTS"),
    )
    for call, names in drivers:
        assert call not in text or re.search(names, declared), (
            f"it calls {call}...) and does not say so"
        )


def test_one_option_switches_off_all_that_it_supplies() -> None:
    by_mode = all_by("mode", "step", MOVED)
    assert by_part(by_mode) == dict(MOVED)
    assert all(each.options_without == {"mode": "step"} for each in by_mode)
    pendulum = tb.model("pendulum")
    assert by_part(each for each in by_mode if each.acts_on(pendulum)) == {Part.STEPS: ""}


def test_an_option_is_idle_where_none_of_its_assistance_can_act() -> None:
    """Beside the units of small mechanisms: corrections of points, and what is done of stops."""
    of_size = {"scaled_units"}
    assert idle_options(tb.engine("mujoco"), tb.fixed()) == of_size | {"moving_points"}
    of_stops = {"own_limits", "stop_stiffness", "locate_releases"}
    assert idle_options(tb.engine("exudyn"), tb.fixed()) == of_size | {"restarts"}
    pendulum = tb.model("pendulum")
    assert idle_options(tb.engine("exudyn"), pendulum) == of_size | of_stops | {"restarts"}
    assert not idle_options(tb.engine("reference"), tb.fixed())  # it states none
