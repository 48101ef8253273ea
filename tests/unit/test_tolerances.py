"""Needs, claims, defaults and the reference's uncertainty.

Which tolerance a figure is held against, and which none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import mechanisms
import numpy as np
import pytest
import trebucheck as tb
from formulas import END, WAY, Formula, times, trolley
from trebucheck.comparisons.runs import runner as running
from trebucheck.comparisons.runs import tolerances as module
from trebucheck.comparisons.runs.metrics import measure
from trebucheck.comparisons.runs.quantities import QUANTITIES
from trebucheck.comparisons.runs.record import machine_row
from trebucheck.comparisons.runs.results import Machine, Metric, Run
from trebucheck.comparisons.runs.runner import Runner, reference_uncertainties
from trebucheck.comparisons.runs.scales import Scales, scales_until
from trebucheck.comparisons.runs.study import Until
from trebucheck.comparisons.runs.tolerances import (
    DEFAULT,
    Needs,
    is_table_one,
    judge,
    tolerance_for,
)
from trebucheck.engines.study import EngineStudy, Tolerance
from trebucheck.reference.solver import solve

SCALES = scales_until(Formula(), END)  # type: ignore[arg-type]
TIME = math.sqrt(1 / 3)


def _machine(known: Mapping[str, float] | None = None, **changes: Any) -> Machine:
    fields: dict[str, Any] = {
        "model": "trolley",
        "mechanism": trolley(),
        "mechanism_hash": "",
        "table_one": False,
        "compared_to": END,
        "judged_to": END,
        "stretching": 1.0,
        "scales": SCALES,
        "thrown": "projectile",
        "launch_time": None,
        "launch_speed": None,
        "impacts": 0,
        "reference_uncertainty": dict(known or {}),
        "release_times": {"rest": 0.5},
        "start_torques": {"rest": 20.0, "buffer": 0.0, "wall": 0.0},
    }
    return Machine(**(fields | changes))


def _judged(
    metric: Metric,
    machine: Machine | None = None,
    needs: Mapping[str, Any] | None = None,
    **run: Any,
) -> Metric:
    fields: dict[str, Any] = {
        "model": "trolley",
        "engine": "reference",
        "preset": "assisted",
        "outcome": "not judged",
        "engine_version": "1",
        "metrics": (metric,),
    }
    (judged,) = judge(Run(**(fields | run)), machine or _machine(), Needs.of(needs))
    return judged


def _metric(
    name: str, subject: str | None = None, value: float | None = 0.0, unit: str = "m", **more: Any
) -> Metric:
    return Metric(name=name, subject=subject, value=value, unit=unit, **more)


POSITION = _metric("position_max", "hook")


# needs


@pytest.mark.parametrize(
    ("given", "tolerance"),
    [
        (1e-4, 1e-4),
        ("2e-4", 2e-4),
        ("0.5%", 0.005 * WAY),
        (" 10 % ", 0.1 * WAY),
        (3, 3.0),
        (1, 1.0),
    ],
)
def test_a_need_is_in_the_quantitys_unit_or_in_parts_of_its_scale(
    given: Any, tolerance: float
) -> None:
    judged = _judged(POSITION, needs={"position": given})
    assert judged.tolerance == pytest.approx(tolerance, rel=1e-12)
    assert (judged.source, judged.reason) == ("need", f"{str(given).strip()} was asked for")


NO_NUMBERS = [
    0,
    -1.0,
    "0%",
    "nan",
    "inf",
    "1e999",
    "%",
    "",
    "1 m",
    "0.1%%",
    True,
    "x" * 60,
    "x" * 61,
]


@pytest.mark.parametrize("given", NO_NUMBERS)
def test_a_need_that_is_no_positive_number_is_refused(given: Any) -> None:
    with pytest.raises(
        tb.InputError, match=r"tolerance position = .* must be a positive number"
    ) as refused:
        Needs.of({"position": given})
    shown = str(given) if len(str(given)) <= 60 else "x" * 57 + "..."
    assert f"tolerance position = {shown!r} must" in str(refused.value)


def test_a_need_of_one_subject_goes_before_that_of_all() -> None:
    needs = {"position": 1e-2, "position:hook": 1e-4, "default": "1%"}
    assert _judged(POSITION, needs=needs).tolerance == 1e-4
    assert _judged(_metric("position_max", "projectile"), needs=needs).tolerance == 1e-2
    other = _judged(_metric("velocity_max", "hook", unit="m/s"), needs=needs)
    assert other.tolerance == pytest.approx(0.02) and other.source == "default"
    assert other.reason == "1 % of the range 2 m/s, for every engine"
    assert _judged(POSITION, needs={"position_max": 1e-3}).tolerance == 1e-3
    assert _judged(POSITION, needs={"position:projectile": 1e-9}).source == "default"


def test_needs_are_kept_as_they_were_stated() -> None:
    needs = Needs.of({"position:hook": "0.10%", "release": 1e-3, "default": "2%"})
    assert needs.texts == {"position:hook": "0.10%", "release": "0.001", "default": "2%"}
    assert Needs.of(None).texts == Needs.of({}).texts == {}
    assert needs.default is not None and needs.default.value == 0.02


def test_needs_that_cannot_be_meant_are_refused() -> None:
    with pytest.raises(tb.InputError, match=r"tolerance default = '0.1' must be a percentage"):
        Needs.of({"default": 0.1})
    with pytest.raises(tb.InputError, match=r"'positions' is not of a judged quantity"):
        Needs.of({"positions": 0.1})
    with pytest.raises(tb.InputError, match=r"'position_max:tip' is stated twice, as '1' and '2'"):
        Needs.of({"position:tip": 1, "position_max:tip": 2})


@pytest.mark.parametrize(
    ("stated", "complaint"),
    [
        (
            "position:tip",
            r"tolerance position:tip: there is no such marker; there are \['hook', 'projectile'\]",
        ),
        ("position:rest", "there is no such marker"),
        ("angle:s", r"no such angle; there are \['beta', 'tilt'\]"),
        ("release:buffer", r"no such closed stop; there are \['rest'\]"),
        ("reaction:rest", r"no such joint; there are \['pivot', 'slot'\]"),
        (
            "energy:hook",
            "tolerance energy:hook: there is no such subject; it is of the whole mechanism",
        ),
        ("launch-time:projectile", "it is of the whole mechanism"),
    ],
)
def test_a_need_of_a_subject_that_the_quantity_does_not_have_is_refused(
    stated: str, complaint: str
) -> None:
    """It would never be applied, and an agreement would hide that."""
    with pytest.raises(tb.InputError, match=complaint):
        Needs.of({stated: 1.0}).refuse_unknown_subjects((trolley(),))


def test_a_subject_that_one_of_the_mechanisms_has_is_known() -> None:
    both = (mechanisms.hanging_bob(), trolley())
    Needs.of(
        {"position:bob": 1, "position:hook": 1, "slide:s": 1, "energy": 1, "default": "1%"}
    ).refuse_unknown_subjects(both)
    with pytest.raises(tb.InputError, match="no such marker"):
        Needs.of({"position:hook": 1}).refuse_unknown_subjects(both[:1])


def test_what_was_asked_for_and_the_engine_does_not_tell_is_not_judged() -> None:
    untold = _metric("joint_reaction_max", "slot", None, "N", observed=False)
    asked = _judged(untold, needs={"reaction": "1%"})
    assert asked.unjudged and asked.source == "need" and asked.tolerance is None
    assert not _judged(untold).unjudged and not _judged(untold, needs={"position": 1}).unjudged


# defaults


def test_every_quantity_has_a_default_of_a_thousandth_of_its_scale() -> None:
    assert DEFAULT == 1e-3
    found = measure(Formula().trajectory(times()), Formula(), END)  # type: ignore[arg-type]
    judged = {metric.label: _judged(metric) for metric in found}
    assert {label for label, metric in judged.items() if metric.tolerance is None} == {
        label for label, metric in judged.items() if metric.follows
    }
    expected = {
        "missing_time": TIME,
        "position_max (hook)": WAY,
        "velocity_max (hook)": 2.0,
        "angle_max (beta)": 1.0,
        "angular_speed_max (beta)": 1.0,
        "slide_max (s)": WAY,
        "slide_speed_max (s)": 2.0,
        "launch_time": TIME,
        "launch_speed": 2.0,
        "release_time (rest)": TIME,
        "stop_torque_max (rest)": 20.0,
        "stop_torque_max (wall)": 0.045,
        "joint_reaction_max (slot)": 45.0,
        "kinetic_energy_max": 150.0,
        "potential_energy_max": 150.0,
        "energy_balance": 150.0,
        "horizontal_momentum": 10.0,
        "stop_gap_held (rest)": 1.0,
    }
    assert {label: judged[label].tolerance for label in expected} == pytest.approx(
        {label: 1e-3 * scale for label, scale in expected.items()}
    )
    assert {metric.source for metric in judged.values()} == {"default", None}
    assert (
        judged["position_max (hook)"].reason == f"0.1 % of the range {WAY:.4g} m, for every engine"
    )


def test_defaults_of_a_small_machine_are_parts_of_its_scales() -> None:
    """No tolerance is an absolute value, however far below 1 the scale is."""
    part = 1e-6
    fields = SCALES.model_dump()
    small = {k: v * part for k, v in fields.items() if k != "torques"}
    small["torques"] = {k: v * part for k, v in fields["torques"].items()}
    machine = _machine(scales=Scales(**small))
    found = measure(Formula().trajectory(times()), Formula(), END)  # type: ignore[arg-type]
    judged = [m for m in found if _judged(m).tolerance is not None]
    assert len(judged) > 15
    for metric in judged:
        squared = QUANTITIES[metric.name].scale == "momentum"  # mass times speed
        usual, own = _judged(metric).tolerance, _judged(metric, machine).tolerance
        assert usual is not None
        assert own == pytest.approx(usual * (part**2 if squared else part), rel=1e-9, abs=0)


def test_an_engine_that_does_not_locate_events_may_be_late_by_its_step() -> None:
    release = _metric("release_time", "rest", unit="s")
    settings = {"timestep": 1e-2}
    assert _judged(release, settings=settings).tolerance == pytest.approx(1e-3 * TIME)
    for option in ("locate_releases", "located_releases"):
        late = _judged(release, settings={**settings, option: False})
        assert late.tolerance == pytest.approx(1e-3 * TIME + 1e-2) and late.reason is not None
        assert late.reason.endswith(
            "for every engine, and the step in which it does not locate an event"
        )
        assert _judged(release, settings={**settings, option: True}).tolerance == pytest.approx(
            1e-3 * TIME
        )
        assert _judged(POSITION, settings={**settings, option: False}).tolerance == pytest.approx(
            1e-3 * WAY
        )
        assert _judged(release, settings={option: False}).tolerance == pytest.approx(1e-3 * TIME)


def test_no_tolerance_is_finer_than_the_numbers_of_an_engine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One rounding of the size of the numbers in each step, at random, carried on."""
    single = EngineStudy(single_precision=lambda settings: settings["digits"] == 6)
    monkeypatch.setattr(module, "engine_study", lambda _: single)
    still = SCALES.model_copy(update={"way": 1e-6})
    machine = _machine(scales=still, stretching=5.0)
    eps = float(np.finfo(np.float32).eps)

    def judged(digits: int, value: float = 0.0, **changes: Any) -> Metric:
        metric = _metric("position_max", "hook", value)
        return _judged(metric, machine, settings={"digits": digits}, steps=100, **changes)

    assert judged(16).tolerance == pytest.approx(1e-9)
    # Of 3 m, a hundred times: above the whole motion of a micrometre, and so not judged.
    floor = eps * 3.0 * 10 * 5
    assert judged(6).tolerance is None and "wider than the motion" in str(judged(6).note)
    assert judged(6, 2 * floor).holds is False  # which no rounding excuses
    asked = _judged(
        _metric("position_max", "hook"), machine, {"position": 1e-9}, settings={"digits": 6}
    )
    assert asked.tolerance == 1e-9  # what somebody needs is applied as it is
    machine = machine.model_copy(update={"scales": SCALES.model_copy(update={"way": 2e-4})})
    assert judged(6).tolerance == pytest.approx(floor)
    assert "single-precision" in str(judged(6).reason)


def test_figures_that_are_of_no_quantity_are_left_alone() -> None:
    unknown = _metric("of a plug-in")
    assert _judged(unknown) == unknown and unknown.unjudged
    follows = _judged(_metric("position_rms", "hook"), needs={"position": 1e-3})
    assert follows.follows == "position_max" and follows.tolerance is None and not follows.unjudged


# uncertainty


def test_a_tolerance_finer_than_the_reference_is_judged_only_if_surely_broken() -> None:
    machine = _machine({"position_max": 1e-3, "position_max (projectile)": 1e-9})
    judged = _judged(POSITION, machine)
    assert (
        judged.tolerance is None
        and judged.note is not None
        and "10 times the reference's own" in judged.note
    )
    assert judged.unjudged
    assert _judged(_metric("position_max", "projectile"), machine).tolerance == pytest.approx(
        1e-3 * WAY
    )
    # 10 mm of uncertainty beyond a tolerance of 1.918 mm.
    for value, holds in ((0.0119, None), (-0.0119, None), (0.012, False), (-0.012, False)):
        assert _judged(_metric("position_max", "hook", value), machine).holds is holds
    assert _judged(POSITION, _machine({"position_max": 1.9e-4})).holds is True
    assert _judged(POSITION, machine, {"position": 0.01}).holds is True
    assert _judged(POSITION, machine, {"position": 0.0099}).holds is None


def test_an_event_of_one_run_is_surely_broken_unless_the_reference_lacks_it() -> None:
    missing = _metric("release_time", "rest", None, "s")
    assert _judged(missing).holds is False
    assert _judged(missing, _machine({"release_time": 1e-3})).holds is False
    assert _judged(missing, _machine({"release_time": TIME})).holds is None


def _claiming(*tolerances: Tolerance, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "engine_study", lambda _: EngineStudy(tolerances=tolerances))


def _claim(
    metric: str = "position_max", value: float = 1e-4, step: float = 1e-3, **more: Any
) -> Tolerance:
    return Tolerance("assisted", metric, value, step, 2, "why", **more)


TABLE_ONE = tb.fixed()


@pytest.fixture(scope="module")
def table_one() -> Machine:
    """The machine for which claims are stated."""
    return machine_row(Runner(TABLE_ONE), Needs())


STEP = {"settings": {"timestep": 1e-3}}


def test_a_claim_holds_on_table_one_as_it_is_stated(
    table_one: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    _claiming(_claim(), _claim("joint_reaction_max", 1e9), monkeypatch=monkeypatch)
    metric = _metric("position_max", "projectile")
    judged = _judged(metric, table_one, **STEP)
    assert (judged.tolerance, judged.source, judged.reason) == (
        1e-4,
        "claim",
        "0.0001 stated at 0.001 s (why)",
    )
    grown = _judged(metric, table_one, settings={"timestep": 2e-3})
    assert grown.tolerance == pytest.approx(4e-4)
    assert grown.reason == "0.0001 stated at 0.001 s, grown with order 2 to 0.002 s (why)"
    capped = _judged(metric, table_one, settings={"timestep": 0.1})
    assert (
        capped.tolerance == pytest.approx(1e-3 * table_one.scales.way)
        and capped.source == "default"
        and capped.reason is not None
    )
    assert capped.reason.startswith(
        f"0.1 % of the range {table_one.scales.way:.4g} m, for every engine; the claim is looser"
    )
    assert _judged(metric, table_one).source == "default"  # an engine without a step claims nothing
    assert _judged(metric, table_one, needs={"default": "1%"}, **STEP).tolerance == pytest.approx(
        1e-2 * table_one.scales.way
    )
    assert _judged(metric, table_one, needs={"position": "1%"}, **STEP).source == "need"
    assert _judged(metric, table_one, preset="default", **STEP).source == "default"
    assert (
        _judged(_metric("joint_reaction_max", "fulcrum", unit="N"), table_one, **STEP).source
        == "default"
    )


def test_a_claim_is_no_finer_than_the_reference_can_vouch_for(
    table_one: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    _claiming(_claim(), monkeypatch=monkeypatch)
    metric = _metric("position_max", "projectile")

    def judged(uncertainty: float) -> Metric:
        return _judged(
            metric,
            table_one.model_copy(update={"reference_uncertainty": {"position_max": uncertainty}}),
            **STEP,
        )

    assert judged(1e-5).tolerance == 1e-4
    raised = judged(1e-4)
    assert raised.tolerance == pytest.approx(1e-3) and raised.source == "claim"
    assert (
        raised.reason
        == "0.0001 stated at 0.001 s (why); raised to ten times the reference's uncertainty"
    )
    assert judged(2.5e-3).tolerance == pytest.approx(0.025)
    assert judged(2.7e-3).tolerance is None
    need = _judged(
        metric,
        table_one.model_copy(update={"reference_uncertainty": {"position_max": 1e-4}}),
        {"position": 5e-4},
    )
    assert need.tolerance is None  # a need is not raised


def test_claims_beyond_the_launch_of_table_one_grow(
    table_one: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are stated up to it.

    Further on an error is as much larger as the motion is stretched.
    """
    _claiming(_claim(value=1e-6), monkeypatch=monkeypatch)
    metric, launch = _metric("position_max", "projectile"), table_one.launch_time
    usual = table_one.stretching
    assert launch is not None and table_one.judged_to == launch

    def judged(**changes: Any) -> float | None:
        return _judged(metric, table_one.model_copy(update=changes), **STEP).tolerance

    assert judged(stretching=3 * usual) == pytest.approx(
        1e-6
    )  # to the launch: as stated, whatever it is
    assert judged(judged_to=1.01 * launch, stretching=3 * usual) == pytest.approx(3e-4)
    assert judged(judged_to=1.01 * launch, stretching=usual) == pytest.approx(1e-6)
    assert judged(
        judged_to=0.5 * launch, stretching=0.1 * usual, thrown="counterweight"
    ) == pytest.approx(1e-6)
    assert judged(stretching=3 * usual, thrown="counterweight") == pytest.approx(3e-4)
    assert judged(stretching=3 * usual, launch_time=None) == pytest.approx(3e-4)


def test_a_claim_on_another_machine_is_the_same_part_of_its_scale(
    table_one: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tenth of the size, the square root of a tenth of the time, and a hundred times as much."""
    _claiming(_claim(value=1e-6), monkeypatch=monkeypatch)
    s = table_one.scales
    small = s.model_copy(
        update={"length": 0.1 * s.length, "way": 0.1 * s.way, "time": 0.1**0.5 * s.time}
    )
    machine = table_one.model_copy(update={"table_one": False, "scales": small})
    metric = _metric("position_max", "projectile")
    equal = _judged(metric, machine, settings={"timestep": 0.1**0.5 * 1e-3})
    assert equal.tolerance == pytest.approx(1e-6 * 0.1 * 100) and equal.source == "claim"
    stated = (
        "1e-06 stated at 0.001 s (why) on Table I, to its launch; the same part of the scale, times"
    )
    assert equal.reason == f"{stated} 100"
    assert _judged(
        metric, machine, settings={"timestep": 2 * 0.1**0.5 * 1e-3}
    ).tolerance == pytest.approx(4e-5)
    stretched = machine.model_copy(update={"stretching": 2 * table_one.stretching})
    twice = _judged(metric, stretched, settings={"timestep": 0.1**0.5 * 1e-3})
    assert twice.tolerance == pytest.approx(2e-5)
    assert twice.reason == f"{stated} 200"
    calm = machine.model_copy(update={"stretching": 0.1 * table_one.stretching})
    assert _judged(metric, calm, settings={"timestep": 0.1**0.5 * 1e-3}) == equal


def test_claims_per_torque_are_parts_of_it(
    table_one: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    per = {"per": "start", "metric": "stop_torque_max", "value": 1e-6}
    machine = table_one.model_copy(
        update={"start_torques": {"hanger rest": 100.0, "sling rest": 0.0, "arm stop": -1.0}}
    )
    scale = machine.scales.torques

    def judged(subject: str, machine: Machine = machine) -> float | None:
        return _judged(_metric("stop_torque_max", subject, unit="N m"), machine, **STEP).tolerance

    _claiming(_claim(**per), monkeypatch=monkeypatch)
    assert judged("hanger rest") == pytest.approx(1e-4)
    assert judged("sling rest") == pytest.approx(1e-6 * scale["sling rest"])
    assert judged("arm stop") == pytest.approx(1e-6 * scale["arm stop"])
    elsewhere = machine.model_copy(update={"table_one": False})
    assert judged("hanger rest", elsewhere) == pytest.approx(1e-4 * scale["hanger rest"])
    told = _judged(_metric("stop_torque_max", "hanger rest", unit="N m"), machine, **STEP)
    assert told.reason == "1e-06 of the start value stated at 0.001 s (why)"
    _claiming(_claim(**{**per, "per": "peak"}), monkeypatch=monkeypatch)
    assert judged("hanger rest") == pytest.approx(1e-6 * scale["hanger rest"])
    # One in N m is the same part of the least torque of a rest.
    _claiming(_claim("stop_torque_max", 1e-3), monkeypatch=monkeypatch)
    assert judged("hanger rest", elsewhere) == pytest.approx(
        0.1 * scale["hanger rest"] / scale["sling rest"]
    )


def test_claims_are_of_motions_without_impacts(
    table_one: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    _claiming(_claim(), monkeypatch=monkeypatch)
    metric = _metric("position_max", "projectile")
    assert _judged(metric, table_one.model_copy(update={"impacts": 1}), **STEP).source == "default"


def test_claims_are_of_trees_of_pins_slots_and_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    """What an engine does with loops and springs it has claimed nothing about."""
    _claiming(_claim(value=1e-7), monkeypatch=monkeypatch)
    metric = _metric("position_max", "projectile")
    damper = tb.RotationalSpringDamper(name="damper", body="arm", damping=0.1)
    sprung = trolley().model_copy(update={"force_elements": (damper,)})
    prop = tb.PinJoint(
        name="prop", parent="ground", child="arm", parent_point=(0, 0), child_point=(0, 0)
    )
    looped = trolley().model_copy(update={"joints": (*trolley().joints, prop)})
    found = [
        _judged(metric, _machine(mechanism=each), **STEP).source
        for each in (trolley(), sprung, looped)
    ]
    assert found == ["claim", "default", "default"]


def test_the_claim_at_the_next_shorter_step_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    _claiming(
        _claim(value=4e-6, step=1e-4),
        _claim(value=1e-4),
        _claim(value=9e-4),
        _claim("other"),
        monkeypatch=monkeypatch,
    )

    def value(step: float | None, **more: Any) -> float | None:
        stated = tolerance_for(
            "e", "assisted", "position_max", "tip", TABLE_ONE, step, **{"table_one": True, **more}
        )
        return None if stated is None else stated.value

    assert value(1e-3) == value(1e-3 * (1 - 1e-10)) == 1e-4
    assert value(9e-4) == pytest.approx(81 * 4e-6)
    assert value(1e-4) == value(1e-9) == 4e-6
    assert value(3e-3) == pytest.approx(9e-4)
    assert value(1e-3, table_one=False) == pytest.approx(1e-3)
    assert value(None) is None
    assert (
        tolerance_for("e", "default", "position_max", "tip", TABLE_ONE, 1e-3, table_one=True)
        is None
    )


def test_table_one_is_a_named_machine_with_its_own_parameters() -> None:
    assert is_table_one(tb.fixed()) and is_table_one(tb.rolling())
    assert not is_table_one(tb.fixed(tb.TrebuchetParameters(l1=9.0)))
    assert not is_table_one(trolley())


# what the reference is known to


@pytest.fixture(scope="module")
def bob() -> tuple[Any, Scales]:
    """A pendulum's motion, and its scales up to 1 s."""
    solution = solve(tb.Problem(mechanisms.hanging_bob(), duration=1.4))
    return solution, scales_until(solution, 1.0)


def test_an_estimate_covers_every_quantity_and_roundings(bob: tuple[Any, Scales]) -> None:
    solution, scales = bob
    known = reference_uncertainties(solution, 1.0, scales, "projectile")
    assert known.source == "estimate"
    labels = {m.label for m in measure(solution.trajectory(times(0.05, 1.0)), solution, 1.0)}
    assert labels - set(known.values) == {"missing_time"}
    eps = 64 * np.finfo(float).eps
    assert known.values["position_max"] >= known.values["position_max (bob)"] >= eps * scales.length
    assert known.values["energy_balance"] >= eps * scales.largest_energy
    assert all(0 < value < 1e-8 for value in known.values.values())


def test_an_estimate_is_four_times_the_distance_to_a_coarser_integration(
    bob: tuple[Any, Scales], monkeypatch: pytest.MonkeyPatch
) -> None:
    solution, scales = bob
    asked: list[tuple[float, ...]] = []

    def coarse(problem: tb.Problem, *tolerances: float) -> Any:
        asked.append((problem.duration, *tolerances))
        return _Shifted(solve(problem))

    monkeypatch.setattr(running, "solve", coarse)
    known = reference_uncertainties(solution, 1.0, scales, "projectile").values
    assert known["position_max (bob)"] == pytest.approx(4 * 0.05, rel=1e-6)
    assert known["angle_max (beta)"] == pytest.approx(4 * 0.01, rel=1e-6)
    assert known["velocity_max"] < 1e-9
    reference_uncertainties(solution, 1.0, scales, "projectile", 1.3)
    reference_uncertainties(solution, 1.4, scales, "projectile")
    assert asked == [(pytest.approx(t), 1e-12, 1e-12) for t in (1.02, 1.3 * 1.02, 1.4)]


def test_an_integration_that_agrees_leaves_sixty_four_roundings_of_the_scale(
    bob: tuple[Any, Scales], monkeypatch: pytest.MonkeyPatch
) -> None:
    solution, scales = bob
    monkeypatch.setattr(running, "solve", lambda *_: solution)
    known = reference_uncertainties(solution, 1.0, scales, "projectile").values
    mechanism, rounding = solution.problem.mechanism, 64 * float(np.finfo(float).eps)
    for metric in measure(solution.trajectory(times(0.05, 1.0)), solution, 1.0):
        quantity = QUANTITIES[metric.name]
        scale = quantity.size_of(scales, metric.subject, mechanism)
        if not metric.name.startswith(("missing_time", "energy_drift", "energy_balance")):
            assert known[metric.label] == pytest.approx(rounding * scale, rel=1e-9, abs=0), (
                metric.label
            )
    assert known["energy_balance"] >= rounding * scales.largest_energy
    assert "missing_time" not in known


@pytest.mark.parametrize(("time", "known"), [(0.7, True), (None, False)])
def test_the_base_error_is_known_where_the_coarser_integration_parts(
    bob: tuple[Any, Scales], monkeypatch: pytest.MonkeyPatch, time: float | None, known: bool
) -> None:
    """Else what it has is a bound."""
    solution, scales = bob
    metrics = (
        _metric("base_error", None, 1e-9, "1"),
        _metric("first_parting", None, time, "s"),
        _metric("position_max", "bob", 1e-9, "m"),
    )
    monkeypatch.setattr(running, "measure", lambda *_, **__: metrics)
    values = reference_uncertainties(solution, 1.0, scales, "projectile").values
    assert ("base_error" in values) == known
    assert "position_max" in values and "first_parting" not in values


def test_an_event_of_one_integration_only_is_as_uncertain_as_its_scale() -> None:
    missing = _metric("release_time", "rest", None, "s")
    assert running._distance(missing, SCALES, Formula()) == pytest.approx(TIME)  # type: ignore[arg-type]
    early = _metric("release_time", "rest", -2.0, "s")
    assert running._distance(early, SCALES, Formula()) == 2.0  # type: ignore[arg-type]


class _Shifted:
    """A solution whose bob is 50 mm aside and 10 mrad off, the more so later."""

    def __init__(self, solution: Any) -> None:
        self._solution = solution

    def launch_at(self, *asked: Any) -> Any:
        return self._solution.launch_at(*asked)

    def trajectory(self, t: Any) -> tb.Trajectory:
        found = self._solution.trajectory(t)
        motion = found.marker("bob")
        moved = replace(
            motion, position=motion.position + np.outer(np.minimum(t, 1.0), [0.03, -0.04])
        )
        return replace(
            found, markers={"bob": moved}, q=found.q + 0.01 * np.minimum(t, 1.0)[:, None]
        )


def test_a_certificate_goes_before_the_estimate_up_to_the_launch(table_one: Machine) -> None:
    assert table_one.uncertainty_source == "certificate"
    known = table_one.reference_uncertainty
    assert {
        "position_max",
        "release_time (hanger rest)",
        "velocity_max (projectile)",
        "energy_balance",
    } <= set(known)
    assert "position_max (projectile)" not in known  # the certificate has one for all
    further = Runner(TABLE_ONE, until=Until.of(3.0))
    assert further.uncertainties.source == "estimate"
    own = Runner(tb.fixed(tb.TrebuchetParameters(l1=9.0)))
    assert own.uncertainties.source == "estimate"


@pytest.mark.parametrize("name", ["impulse", "impact-speed:hook"])
def test_what_only_files_tell_is_no_need_of_an_engine(name: str) -> None:
    """It would be in no row, and so seem kept."""
    title = name.partition(":")[0]
    with pytest.raises(
        tb.InputError, match=rf"tolerance '{title}' is of files only \(trebucheck judge\)"
    ):
        Needs.of({name: 1.0}).refuse_what_only_files_tell()
    with pytest.raises(tb.InputError, match="is of files only"):
        tb.compare(["bouncing"], ["reference"], tolerances={"impulse": 1.0})
    with pytest.raises(tb.InputError, match="is of files only"):
        tb.check("reference", "bouncing", impulse=1.0)
