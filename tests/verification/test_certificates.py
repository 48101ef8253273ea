"""Certificates: they cover the checked figures, and whatever computation is left out of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trebucheck as tb
from conftest import again, machine_parameters, machines
from hypothesis import assume, given
from mechanisms import angle_stop, everything, hanging_bob
from trebucheck.comparisons.certify import refuse_contradicted
from trebucheck.models.problem import StopLaw
from trebucheck.models.spec import schema_text
from trebucheck.reference.certification import certificate as module
from trebucheck.reference.certification.certificate import (
    Certificate,
    Computation,
    Figure,
    certified,
    load_certificate,
    reference_uncertainty,
    refusal,
)
from trebucheck.reference.certification.certify import Key, certify, judge
from trebucheck.reference.certification.proved import PROVABLE
from trebucheck.reference.solver import solve

pytestmark = pytest.mark.slow  # many machines, or many integrations: not in `make quick`

BUILD = {"fixed": tb.fixed, "rolling": tb.rolling}


@pytest.fixture(scope="module", params=["fixed", "rolling"])
def committed(request: pytest.FixtureRequest) -> Certificate:
    found = load_certificate(BUILD[request.param]())
    assert found is not None
    return found


# PHYSICS.md, checked figures, as printed: the last digit's unit is the allowance beside the
# uncertainty.
CHECKED: dict[str, dict[tuple[str, str | None, str], str]] = {
    "fixed": {
        ("stop_torque", "hanger rest", "start"): "79630.193261",
        ("stop_torque", "sling rest", "start"): "2671.729500",
        ("total_energy", None, "start"): "208101.5257",
        ("release_time", "hanger rest", ""): "1.194940568904336",
        ("release_time", "sling rest", ""): "1.437345284636296",
        ("coordinate", "theta", "release of sling rest"): "0.727907956797",
        ("coordinate", "phi", "release of sling rest"): "3.869500610387",
        ("coordinate", "alpha", "release of sling rest"): "-0.064285109006",
        ("launch_time", None, ""): "2.742817755771455",
        ("launch_speed", None, ""): "99.400515256270967",
        ("coordinate", "theta", "launch"): "3.987610833710",
        ("coordinate", "phi", "launch"): "10.186176948591",
        ("coordinate", "alpha", "launch"): "1.029242248603",
        ("position_x", "projectile", "launch"): "-10.972922746783",
        ("position_y", "projectile", "launch"): "11.626074067665",
        ("energy_ratio", None, "launch"): "1.424371455",
        ("best_release_time", None, "longest range"): "2.744505",
        ("best_release_speed", None, "longest range"): "99.4228",
        ("best_range", None, "longest range"): "1008.2591",
        ("largest_ratio", None, "fastest"): "1.425803",
        ("largest_ratio_time", None, "fastest"): "2.749423",
        ("position_x", "counterweight", "start"): "3.071068",
        ("position_x_max", "counterweight", "before launch"): "8.785083",
    },
    "rolling": {
        ("stop_torque", "hanger rest", "start"): "72175.546460",
        ("stop_torque", "sling rest", "start"): "1655.136734",
        ("release_time", "hanger rest", ""): "0.826024273006009",
        ("release_time", "sling rest", ""): "1.702658597845621",
        ("coordinate", "theta", "release of sling rest"): "1.741456329850",
        ("coordinate", "phi", "release of sling rest"): "4.883048983440",
        ("coordinate", "alpha", "release of sling rest"): "0.776004937362",
        ("launch_time", None, ""): "2.509621264144581",
        ("launch_speed", None, ""): "112.718321050322281",
        ("coordinate", "theta", "launch"): "4.571534910694",
        ("coordinate", "phi", "launch"): "10.035971513320",
        ("coordinate", "alpha", "launch"): "1.106846450046",
        ("coordinate", "x_p", "launch"): "-0.457082096483",
        ("position_x", "projectile", "launch"): "-6.774751988257",
        ("position_y", "projectile", "launch"): "13.344036624170",
        ("energy_ratio", None, "launch"): "1.831618465",
        ("best_release_time", None, "longest range"): "2.516365",
        ("best_release_speed", None, "longest range"): "114.1360",
        ("best_range", None, "longest range"): "1320.8773",
        ("largest_ratio", None, "fastest"): "2.043272",
        ("largest_ratio_time", None, "fastest"): "2.565851",
        ("position_x", "counterweight", "start"): "3.071068",
        ("position_x_max", "counterweight", "before launch"): "5.481709",
    },
}
BEST_ANGLE = {"fixed": 44.0995, "rolling": 40.4214}  # degrees


def test_the_checked_figures_are_covered(committed: Certificate) -> None:
    for (name, subject, at), printed in CHECKED[committed.model].items():
        figure = committed.figure(name, subject, at)
        assert figure is not None, (name, subject, at)
        # Half a unit of the last printed digit is rounding, a whole one allows for a figure that
        # was cut off.
        digit = 10.0 ** -len(printed.partition(".")[2])
        assert abs(figure.value - float(printed)) <= figure.uncertainty + digit, figure.label
    angle = committed.figure("best_release_angle")
    assert angle is not None
    assert math.degrees(angle.value) == pytest.approx(BEST_ANGLE[committed.model], abs=5e-5)


def test_certificates_are_as_sharp_as_needed(committed: Certificate) -> None:
    """Stated needs: event times to 3e-13 relative, positions up to the launch to 1e-10 m."""
    names = {figure.name for figure in committed.figures}
    assert {"release_time", "launch_time", "position_x", "position_y"} <= names
    for figure in committed.figures:
        if figure.name in ("release_time", "launch_time"):
            assert figure.uncertainty < 3e-13 * figure.value
        if figure.name.startswith("position"):
            assert figure.uncertainty < 1e-10


def _left_out(certificate: Certificate) -> list[tuple[float, str, str]]:
    """Distance over uncertainty for every figure and every independent computation that is left
    out.

    With it go the coarser rungs of its own ladder, but not those of the reference itself: that its
    interpolant is less exact than its steps cannot be learned from computations that have no such
    fault.
    """
    found = {Key(f.name, f.subject, f.at, f.unit, f.time): f.values for f in certificate.figures}
    ratios: list[tuple[float, str, str]] = []
    for out in certificate.computations:
        if not out.independent:
            continue
        kin = (out.formulation, out.integrator)
        own = out.name.startswith("minimal")
        rest = [
            c
            for c in certificate.computations
            if c != out and (own or (c.formulation, c.integrator) != kin)
        ]
        for key, (value, uncertainty) in judge(found, rest).items():
            if out.name in found[key]:
                ratios.append((abs(found[key][out.name] - value) / uncertainty, out.name, str(key)))
    return ratios


def test_a_computation_left_out_is_covered_by_the_others(committed: Certificate) -> None:
    ratios = _left_out(committed)
    assert len(ratios) > 150
    assert max(ratios)[0] <= 1.0, max(ratios)


@pytest.mark.parametrize("build", [tb.fixed, pytest.param(tb.rolling, marks=again)])
@machines(2)
@given(parameters=machine_parameters())
def test_a_computation_left_out_is_covered_on_random_machines(
    build: Callable[[tb.TrebuchetParameters], tb.Mechanism], parameters: tb.TrebuchetParameters
) -> None:
    certificate = certify(build(parameters), parameters)
    assume(certificate.figure("launch_time") is not None)
    ratios = _left_out(certificate)
    assert len(ratios) > 150
    assert max(ratios)[0] <= 1.0, max(ratios)


def test_a_fault_in_one_computation_is_not_covered(committed: Certificate) -> None:
    """The check can fail: a launch speed that is off by a millionth lies outside what the others
    allow.
    """
    figures = tuple(
        f.model_copy(
            update={
                "values": {
                    **f.values,
                    "redundant, 3e-14": f.values["redundant, 3e-14"] * (1 + 1e-6),
                }
            }
        )
        if f.name == "launch_speed"
        else f
        for f in committed.figures
    )
    worst = max(_left_out(committed.model_copy(update={"figures": figures})))
    assert worst[0] > 1.0
    assert "redundant" in worst[1]


def test_the_reference_of_today_lies_within(committed: Certificate) -> None:
    solution = solve(tb.Problem(BUILD[committed.model](), duration=3.0))
    launch, time, speed = (
        solution.launch,
        committed.figure("launch_time"),
        committed.figure("launch_speed"),
    )
    assert launch is not None and time is not None and speed is not None
    assert abs(launch.time - time.value) <= time.uncertainty
    assert abs(launch.speed - speed.value) <= speed.uncertainty
    for figure in committed.figures:
        if figure.name == "position_x" and figure.time is not None:
            x = solution.trajectory(np.array([figure.time])).marker("projectile").position[0, 0]
            assert abs(x - figure.value) <= figure.uncertainty


def test_certificate_belongs_to_one_mechanism_only() -> None:
    assert load_certificate(tb.fixed(tb.TrebuchetParameters(m_b=60.0 * (1 + 1e-15)))) is None


def test_schema_and_round_trip(committed: Certificate) -> None:
    text = (
        module.files("trebucheck.reference.certification") / "certificates" / module.SCHEMA
    ).read_text()
    assert text == schema_text(Certificate)
    assert Certificate.from_json(committed.to_json()) == committed


def test_each_figure_is_proved_or_says_why_it_is_not(committed: Certificate) -> None:
    for figure in committed.figures:
        assert figure.name in PROVABLE
        proved = figure.proved_value is not None and figure.proved_radius is not None
        assert proved != bool(figure.not_proved), figure.label
    # The machines' own are proved without an exception.
    assert not [figure.label for figure in committed.figures if figure.not_proved]


def test_a_figure_that_its_proof_contradicts_is_refused(
    committed: Certificate, tmp_path: Path
) -> None:
    figure = committed.figure("launch_time")
    assert figure is not None
    off = figure.value + 3 * figure.uncertainty
    with pytest.raises(tb.InputError, match="launch_time"):
        Figure(**{**figure.model_dump(), "value": off})
    # An older certificate, without a proof of its own.
    path = tmp_path / "older.json"
    unproved = [
        each.with_fields(proved_value=None, proved_radius=None) for each in committed.figures
    ]
    path.write_text(committed.model_copy(update={"figures": tuple(unproved)}).to_json())
    refuse_contradicted(path, committed)
    place = committed.figures.index(figure)
    unproved[place] = unproved[place].model_copy(update={"value": off})
    path.write_text(committed.model_copy(update={"figures": tuple(unproved)}).to_json())
    with pytest.raises(tb.SimulationError, match="launch_time"):
        refuse_contradicted(path, committed)


def test_ladder_must_fall() -> None:
    with pytest.raises(tb.InputError, match="falling"):
        certify(tb.fixed(), ladder=(1e-12, 1e-10))


def test_a_machine_without_launch_and_marker_is_certified() -> None:
    bob = tb.Body(name="bob", angle="beta", mass=3.0, centre=(2.0, 0), inertia=0.1)
    pivot = tb.PinJoint(
        name="pivot", parent="ground", child="bob", parent_point=(0, 0), child_point=(0, 0)
    )
    machine = tb.Mechanism(
        name="pendulum", bodies=(bob,), joints=(pivot,), gravity=9.81, start=(0.3,)
    )
    certificate = certify(machine, ladder=(1e-10, 1e-12))
    assert certificate.figure("total_energy") is not None
    assert any("paper" in sentence for sentence in certificate.absent)


def test_any_mechanism_is_certified_in_parts_of_its_own_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Springs, slides on bodies and no projectile.

    Coordinates and markers at instants of the duration asked for.
    """
    monkeypatch.setattr(
        "trebucheck.reference.certification.certify.why_not_taylor",
        lambda _: "compilation takes long",
    )
    mechanism = everything()
    certificate = certify(mechanism, duration=0.05, ladder=(1e-10, 1e-13))
    end = [f for f in certificate.figures if f.at == "0.05 s"]
    assert {f.subject for f in end} == {
        *mechanism.coordinates,
        *(marker.name for marker in mechanism.markers),
    }
    units = {f.subject: f.unit for f in end if f.name == "coordinate"}
    assert {name for name, unit in units.items() if unit == "rad"} == set(mechanism.angles)
    # 1e-13 a step over some ten steps, tripled, and the extrapolation from 1e-10, which is no
    # better than a bound.
    assert max(f.uncertainty for f in end) < 1e-11
    assert {c.name.split(",")[0] for c in certificate.computations} == {"minimal", "redundant"}
    assert "taylor, double: compilation takes long" in certificate.absent
    energy = certificate.figure("total_energy")
    assert energy is not None
    assert energy.values["minimal, 1e-13"] == pytest.approx(
        energy.values["redundant, 1e-13"], rel=1e-13
    )


def test_rebounds_are_certified_without_the_formulation_that_has_none() -> None:
    certificate = certify(
        hanging_bob(angle_stop(1.0, 0.5)),
        duration=2.0,
        stop_law=StopLaw.UNILATERAL,
        ladder=(1e-10, 1e-12),
    )
    assert not any(c.name.startswith("redundant") for c in certificate.computations)
    assert any(sentence.startswith("redundant") for sentence in certificate.absent)


def test_uncertainty_comes_from_the_certificate_where_there_is_one(committed: Certificate) -> None:
    machine = BUILD[committed.model]()
    solution = solve(tb.Problem(machine, duration=4.0))
    assert reference_uncertainty(solution).source == "certificate"
    # Past the launch nothing is certified.
    assert reference_uncertainty(solution, end=3.5).source == "estimate"
    other = solve(tb.Problem(tb.fixed(tb.TrebuchetParameters(l1=9.5)), duration=4.0))
    assert reference_uncertainty(other).source == "estimate"


def test_certified_metrics_have_a_figure_each(committed: Certificate) -> None:
    found = certified(committed)
    for metric in (
        "position_max",
        "release_time",
        "launch_time",
        "launch_speed",
        "stop_torque_max",
        "energy_drift",
    ):
        assert (found.of(metric) or 0.0) > 0, metric
    assert found.of("release_time", "sling rest") is not None
    assert found.of("no such metric") is None


def test_values_are_printed_to_the_place_of_their_uncertainty() -> None:
    common = {"name": "speed", "at": "launch", "unit": "m/s", "values": {}}
    assert module.Figure(value=99.40051525627, uncertainty=2.3e-6, **common).texts == (
        "99.4005153",
        "2.3e-06",
    )
    assert module.Figure(value=1234.5, uncertainty=40.0, **common).texts == ("1234", "4.0e+01")


def test_an_unknown_uncertainty_refuses_nothing() -> None:
    assert refusal("position_max", "projectile", 1e-30, None) is None


def test_computation_is_described() -> None:
    assert (
        Computation(name="x", formulation="f", integrator="i", independent=True).tolerance is None
    )
