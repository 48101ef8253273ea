"""The whole study of the paper is docs/paper.md's.

Its designs, read by other means and looked for from elsewhere.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trebucheck as tb
from conftest import again
from trebucheck.api.mechanics import Spec
from trebucheck.models.library.registry import model, parameters_type
from trebucheck.reference.solver import solve, solve_to_launch
from trebucheck.reference.throw.flight import Projectile, Surroundings, fly
from trebucheck_paper.design.efficiency import (
    BOUNDS,
    SLINGS,
    Machines,
    available_energy,
    fastest_sling,
    kinetic_energy,
    most_efficient,
)
from trebucheck_paper.design.first_forward_swing import Reading, first_forward_swing_of
from trebucheck_paper.design.search import NEARNESS, RANGE, Family, Objective
from trebucheck_paper.design.study import (
    FARTHEST,
    NEAREST,
    Bounds,
    Design,
    design_rolling,
    tolerances,
)
from trebucheck_paper.drag.study import DragStudy
from trebucheck_paper.evidence.claims import Quantity, Study, Verdict
from trebucheck_paper.identification.quantities import Identification
from trebucheck_paper.identification.study import identify
from trebucheck_paper.report import summary
from trebucheck_paper.rows.machines import design_rows
from trebucheck_paper.study import SECTIONS, study

PAGE = Path(__file__).parents[2] / "docs" / "paper.md"
RECORDED = Path(__file__).with_name("recorded")
"""Searches and fits of most of a minute, as they came out: this file, run alone, writes them."""
NEEDED = 1e-6  # [s] the two instants may stand apart

pytestmark = pytest.mark.slow  # one study for all of them


@cache
def paper(*, computed: bool = False) -> Study:
    """Without engines, which have tests of their own.

    The identification is told of another start, of which its search over all starts makes no use.

    Args:
        computed: everything; otherwise what is recorded is read, and the rest computed.
    """

    def from_elsewhere(parameters: tb.TrebuchetParameters, _: Sequence[str]) -> Identification:
        start = {"theta0": 0.5, "phi0": 2.0, "alpha0": 0.3}
        return identify(parameters.model_copy(update=start))

    def read(name: str, kind: type[Spec]) -> Callable[..., Spec]:
        section = kind.from_json((RECORDED / f"{name}.json").read_text())
        return lambda parameters, engines: section

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SECTIONS, "identification", from_elsewhere)
        if not computed:
            for name, kind in KINDS.items():
                patch.setitem(SECTIONS, name, read(name, kind))
        return study(["reference"])


KINDS: dict[str, type[Spec]] = {
    "design": Design,
    "machines": Machines,
    "identification": Identification,
    "drag": DragStudy,
}


@cache
def design() -> Design:
    """Section `design` of that study."""
    return Design.from_json(json.dumps(paper().sections["design"]))


@cache
def machines() -> Machines:
    """Section `machines` of that study."""
    return Machines.from_json(json.dumps(paper().sections["machines"]))


def _cells(markdown: str) -> list[list[str]]:
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in markdown.strip().splitlines()
    ]


@pytest.mark.parametrize("computed", [False, pytest.param(True, marks=again)])
def test_what_becomes_of_the_paper(computed: bool) -> None:
    """Verdicts and our own values are the reference's: no engine is needed to have them.

    The rows follow from the studies every time. The searches themselves are tried below and in the
    tests of each study; all of them, from their own starts, are computed by `make test-all`.
    """
    block = (
        PAGE.read_text().partition("<!-- generated: paper -->\n")[2].partition("<!-- end -->")[0]
    )
    found, printed = _cells(summary(paper(computed=True) if computed else paper())), _cells(block)
    assert [row[:-1] for row in found] == [row[:-1] for row in printed]
    for mine, theirs in zip(found, printed, strict=True):
        if (
            mine[-1] != theirs[-1]
        ):  # four printed digits, the last of which another machine may round otherwise
            assert float(mine[-1].split()[0]) == pytest.approx(
                float(theirs[-1].split()[0]), rel=2e-3
            ), mine


def test_no_proof_is_against_its_verdict() -> None:
    """A proof decides nothing otherwise than the reference's number beyond its uncertainty."""
    decided = 0
    for claim in paper().claims:
        if claim.proved.holds is not None:
            decided += 1
            assert claim.verdict is not (Verdict.FAILS if claim.proved.holds else Verdict.HOLDS)
            assert claim.ours is not None
            known = float(claim.proved.value or "nan"), float(claim.proved.radius or "nan")
            allowed = (claim.ours.uncertainty or 0.0) + known[1]
            assert abs(claim.ours.value - known[0]) <= allowed, claim.name
        else:
            assert claim.proved.why
    assert decided > 30


def test_table_one_is_read_as_the_checked_figures_have_it() -> None:
    fixed, rolling = design().paper_fixed, design().paper_rolling
    # PHYSICS.md, to the digits it prints.
    for found, figures in (
        (fixed, (2.744505, 44.0995, 99.4228, 1008.2591, 2.749423)),
        (rolling, (2.516365, 40.4214, 114.1360, 1320.8773, 2.565851)),
    ):
        assert found.best_time == pytest.approx(figures[0], abs=6e-7)
        assert np.degrees(found.angle) == pytest.approx(figures[1], abs=6e-5)
        assert found.speed == pytest.approx(figures[2], abs=6e-5)
        assert found.range == pytest.approx(figures[3], abs=6e-5)
        assert found.fastest_time == pytest.approx(figures[4], abs=6e-7)


@pytest.mark.parametrize("name", [FARTHEST, NEAREST])
def test_the_two_instants_coincide_by_another_reading(name: str) -> None:
    """The house's own range-optimal release, and a scan of the speed around it."""
    found = design().named(name)
    assert found is not None
    assert abs(found.throwing.gap) < NEEDED and abs(found.difference.value) < NEEDED
    projectile = Projectile(solve_to_launch(tb.rolling(found.throwing.parameters)))
    best = projectile.best_release(Surroundings(gravity=found.throwing.parameters.g))
    assert best is not None
    assert best.time == pytest.approx(found.throwing.best_time, abs=NEEDED)
    times = best.time + np.linspace(-0.05, 0.05, 2001)
    _, velocity, _ = projectile.states(times)
    fastest = times[np.argmax(np.sum(velocity**2, axis=1))]
    assert fastest == pytest.approx(
        best.time, abs=5e-5
    )  # half the scan's interval, and its rounding
    assert fly(best, Surroundings(gravity=9.81)).range == pytest.approx(
        found.throwing.range, rel=1e-9
    )


def test_the_rows_on_designs_name_the_bounds_within_which_they_hold() -> None:
    """Outside of them a coinciding machine does throw as far.

    The same one, with its lengths scaled as the row says.
    """
    rows = {
        row.name: row.judged(row.ours)
        for row in design_rows(design())
        if isinstance(row.ours, Quantity)
    }
    for name in ("such a machine throws farther", "coinciding gives the largest range"):
        assert rows[name].verdict is Verdict.FAILS
        for text in (rows[name].quantity, rows[name].why):
            for bound in (
                "r 2 to 12 m",
                "h 2 to 14 m",
                "l1 7 to 13 m",
                "l1 + l2 = 14 m",
                "masses and start angles",
            ):
                assert bound in text
    paper, farthest = design().paper_rolling, design().designs[0].throwing
    size = paper.range / farthest.range
    assert f"lengths {size:.3g} times" in rows["such a machine throws farther"].why
    p = farthest.parameters
    scaled = p.model_copy(update={name: size * getattr(p, name) for name in ("l1", "l2", "r", "h")})
    swing = first_forward_swing_of(tb.rolling(scaled))
    assert swing is not None
    assert swing.range == pytest.approx(paper.range, rel=1e-8)
    assert abs(swing.delay(Reading.RANGE_OPTIMAL)) < NEEDED


@pytest.mark.parametrize("name", [FARTHEST, NEAREST])
def test_the_conditions_of_an_optimum_hold(name: str) -> None:
    found = design().named(name)
    assert found is not None
    # Central differences of 1e-4 know slopes to some 1e-6; the search stops at 1e-9 km, whose root
    # is 3e-5.
    assert found.optimality.residual < 1e-4
    assert len(found.optimality.neighbours) == 4
    assert max(found.optimality.neighbours) < 0
    assert found.optimality.active == ()


def test_coinciding_costs_range() -> None:
    """The gain that the paper hopes for does not come about.

    The machine that throws farthest has its peak later.
    """
    found, free = design().named(FARTHEST), design().unconstrained
    assert found is not None and free is not None
    assert found.throwing.range > design().paper_fixed.range
    assert free.range > design().paper_rolling.range > found.throwing.range
    assert free.gap > 1e-2


def test_nearest_is_nearer_and_farthest_throws_farther() -> None:
    far, near = design().named(FARTHEST), design().named(NEAREST)
    assert far is not None and near is not None
    assert near.change < far.change and near.throwing.range < far.throwing.range


def test_at_45_degrees_the_angle_is_45_at_the_peak() -> None:
    found = next(each for each in design().designs if each.reading is Reading.FORTY_FIVE)
    assert found.throwing.fastest_time == pytest.approx(found.throwing.launch_time, abs=NEEDED)
    assert found.throwing.gap < 0  # the best angle is less than 45 degrees, so it comes later


def test_within_all_constraints() -> None:
    assert len(design().designs) > 0
    for each in design().designs:
        throwing, p = each.throwing, each.throwing.parameters
        assert p.l1 + p.l2 == pytest.approx(14.0, abs=1e-12)
        assert (p.m_b, p.m_cw, p.m_a, p.g) == (60.0, 3000.0, 1000.0, 9.81)
        for name in ("r", "h", "l1"):
            low, high = getattr(design().bounds, name)
            assert low <= getattr(p, name) <= high
        assert throwing.arm_angle < 1.5 * np.pi
        assert throwing.sling_release < min(throwing.best_time, throwing.fastest_time)


def test_a_machine_that_throws_nothing_is_no_design() -> None:
    parameters = tb.TrebuchetParameters.with_beam(
        9.0, r=8.0, h=4.0
    )  # its best release only goes over the fulcrum
    assert first_forward_swing_of(tb.rolling(parameters)) is None


def test_tolerances_grow_with_the_bar() -> None:
    found = first_forward_swing_of(tb.rolling(), solve)
    assert found is not None
    small, large = tolerances(found, 1e-6), tolerances(found, 1e-3)
    for name, value in small.items():
        assert value > 0 and large[name] == pytest.approx(1e3 * value, rel=1e-9)
    assert tolerances(found, None) == {}


@pytest.mark.parametrize(
    ("name", "objective", "start"),
    [
        (FARTHEST, RANGE, [4.4, 13.0, 11.0]),
        pytest.param(NEAREST, NEARNESS, [3.79, 12.0, 12.0], marks=pytest.mark.again),
    ],
    ids=["farthest", "nearest"],
)
def test_another_start_leads_to_the_same_design(
    name: str, objective: Objective, start: list[float]
) -> None:
    family = Family(tb.TrebuchetParameters(), 14.0, Bounds())
    expected = design().named(name)
    assert expected is not None
    reached = family.maximised([np.array(start) / family.scale], objective)
    assert reached
    assert objective.value(family, reached[0]) == pytest.approx(
        objective.value(family, family.scaled(expected.throwing.parameters)), abs=1e-6
    )


@pytest.mark.parametrize(
    ("fields", "message"),
    [({"r": (5.0, 4.0)}, "r = "), ({"l1": (7.0, 14.0)}, "below the arm's length")],
)
def test_bounds_that_make_no_sense_are_refused(
    fields: dict[str, tuple[float, float]], message: str
) -> None:
    with pytest.raises(tb.InputError, match=message):
        design_rolling(bounds=Bounds(**fields), engines=())


@pytest.mark.parametrize("name", ["fixed", "floating-arm"])
def test_no_machine_within_the_bounds_is_more_efficient(name: str) -> None:
    """Neighbours of the best one, by the other integrator, to what the last look can miss."""
    best = machines().named(name).most_efficient
    if best is None:
        pytest.skip("heyoka, which makes the search fast enough, is not installed")
    assert best.sling is not None
    chosen = {"l1": best.l1, "r": best.sling}
    if parameters_type(name).model_fields["theta0"].default > 1.0:
        chosen["theta0"] = best.theta0  # free where the arm begins backward
    assert best.efficiency == pytest.approx(_efficiency_of(name, chosen), rel=1e-8)
    assert all(low <= chosen[key] <= high for key, (low, high) in BOUNDS.items() if key in chosen)
    for key, value in chosen.items():
        for aside in (-0.1, 0.1):
            beside = chosen | {key: float(np.clip(value + aside, *BOUNDS[key]))}
            # The last places stand 4 cm apart: between them the efficiency can be a thousandth
            # larger, not more.
            assert _efficiency_of(name, beside) <= best.efficiency * 1.001


def test_a_search_over_machines_finds_what_is_recorded() -> None:
    pytest.importorskip("heyoka")
    recorded = machines().named("fixed")
    sling, widest = fastest_sling("fixed"), most_efficient("fixed")
    assert sling is not None and recorded.fastest_sling is not None
    assert sling[0] == pytest.approx(recorded.fastest_sling.sling, abs=1e-6)
    assert sling[2].speed == pytest.approx(recorded.fastest_sling.speed, rel=1e-8)
    assert widest is not None and recorded.most_efficient is not None
    assert widest.efficiency == pytest.approx(recorded.most_efficient.efficiency, rel=1e-8)
    assert widest.chosen["l1"] == pytest.approx(recorded.most_efficient.l1, abs=1e-6)


def _efficiency_of(name: str, chosen: dict[str, float]) -> float:
    machine = model(name, parameters_type(name)(**chosen, l2=14.0 - chosen["l1"]))
    launch = solve_to_launch(machine).launch
    return (
        0.0 if launch is None else kinetic_energy(machine, launch.speed) / available_energy(machine)
    )


@pytest.mark.parametrize("name", ["fixed", "hinged"])
def test_no_other_sling_is_faster(name: str) -> None:
    """Inside the lengths looked at, on a grid that shares no point with the search's."""
    found = machines().named(name).fastest_sling
    assert found is not None
    compared = 0
    for r in np.linspace(SLINGS[0] + 0.1, SLINGS[1] - 0.1, 23):
        machine = model(name, parameters_type(name)(r=float(r)))
        solution = solve_to_launch(machine)
        if solution.launch is None:
            continue
        arm = float(solution.motion(np.array([solution.launch.time])).q[0, 0])
        if name == "hinged" or arm < 3 * np.pi / 2:
            compared += 1
            assert solution.launch.speed <= found.speed * (1 + 1e-9)
    assert compared >= 8


def test_the_paper_singles_out_its_start() -> None:
    """Figures alone lead to it: the identification was told of another one."""
    pytest.importorskip("heyoka")
    found = Identification.from_json(json.dumps(paper().sections["identification"]))
    assert found.parameters.theta0 == 0.5
    assert found.singled_out == pytest.approx((0.0, np.pi, -np.pi / 4), abs=1e-12)
    assert found.fit.compatible
    assert found.nested and all(each.compatible for each in found.nested)
    assert found.search is not None
    assert [s.miss <= 1 for s in found.search.solutions].count(True) == 1
    assert found.conditioning.rank == 3


def test_it_survives_json() -> None:
    assert Design.from_json(design().to_json()) == design()
    assert json.loads(design().to_json()) == paper().sections["design"]


if __name__ == "__main__":  # PYTHONPATH=tests python paper/tests/test_paper_study.py
    for name in KINDS:
        text = json.dumps(paper(computed=True).sections[name], separators=(",", ":"))
        (RECORDED / f"{name}.json").write_text(text + "\n")
