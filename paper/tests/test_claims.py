"""The paper's claims: the rules behind the verdicts, and how the study is shown and asked for."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.report.document import sentence
from trebucheck.comparisons.report.html import page
from trebucheck.models.spec import schema_text
from trebucheck_paper import report as shown
from trebucheck_paper.design.efficiency import MachineEfficiency, Machines, SlingThrow, WidestThrow
from trebucheck_paper.evidence.claims import (
    Claim,
    EngineValue,
    Quantity,
    Series,
    Study,
    Verdict,
    parse,
)
from trebucheck_paper.evidence.quantities import fit
from trebucheck_paper.evidence.verdicts import (
    Cause,
    Grid,
    Row,
    as_printed,
    at_least,
    at_most,
    by_reading,
    coincides,
    differs,
    occurs,
    positive,
    spread,
    undecided,
    vanishes,
)
from trebucheck_paper.rows import machine as rows_machine
from trebucheck_paper.rows import machines as rows_machines
from trebucheck_paper.study import UNREACHED, Jobs, order, study

ROOT = Path(__file__).parents[2]
Throws = tuple[float, float | None, float | None]
"""Efficiencies of a machine as built, with its fastest sling, and at best."""


def _q(value: float, uncertainty: float | None = None, unit: str = "m") -> Quantity:
    return Quantity(value=value, uncertainty=uncertainty, unit=unit)


@pytest.mark.parametrize(
    ("text", "value", "half"),
    [
        ("99.4 m/s", 99.4, 0.05),
        ("585°", 585, 0.5),
        ("2.42:1", 2.42, 0.005),
        ("< 0.0005 %", 5e-4, 5e-5),
        ("-3", -3, 0.5),
    ],
)
def test_a_printed_number_is_known_to_half_its_last_digit(
    text: str, value: float, half: float
) -> None:
    number = parse(text)
    assert number.value == value
    assert number.half == pytest.approx(half, rel=1e-15)


def test_a_text_without_a_number_is_refused() -> None:
    with pytest.raises(tb.InputError, match="holds no number"):
        parse("linear")


@pytest.mark.parametrize(
    ("ours", "uncertainty", "verdict"),
    [
        (99.4499, None, Verdict.HOLDS),
        (99.45, 0.0, Verdict.HOLDS),
        (99.4501, None, Verdict.FAILS),
        (99.4501, 2e-4, Verdict.HOLDS),
        (99.36, None, Verdict.HOLDS),
        (99.34, None, Verdict.FAILS),
    ],
)
def test_a_number_holds_to_its_digits_and_our_uncertainty(
    ours: float, uncertainty: float | None, verdict: Verdict
) -> None:
    assert as_printed(_q(ours, uncertainty), "99.4").verdict is verdict


@pytest.mark.parametrize(
    ("on_grid", "verdict"),
    [
        (45.4, Verdict.WITHIN_GRID),
        (
            43.8,
            Verdict.FAILS,
        ),  # as in the paper: 45 lies between this point and the one before it, and at neither
        (46.5, Verdict.FAILS),
    ],
)
def test_a_number_picked_from_a_grid_is_our_value_at_the_point_that_is_best_on_it(
    on_grid: float, verdict: Verdict
) -> None:
    found = as_printed(_q(44.1, unit="deg"), "45", Grid("0.005 s", 2.745, on_grid))
    assert found.verdict is verdict
    assert f"{on_grid:g} at 2.745" in found.why


@pytest.mark.parametrize(
    ("launch", "verdict"), [(3.38, Verdict.OPEN), (6.58, Verdict.HOLDS)], ids=["one of two", "both"]
)
def test_a_text_with_two_meanings_is_decided_only_where_both_agree(
    launch: float, verdict: Verdict
) -> None:
    found = by_reading({"there and back": _q(6.607), "by the launch": _q(launch)}, "6.6 m")
    assert found.verdict is verdict
    assert "by the launch" in found.rule
    assert (
        by_reading({"there and back": _q(6.7), "by the launch": _q(3.38)}, "6.6 m").verdict
        is Verdict.FAILS
    )


def test_only_causes_that_apply_are_given() -> None:
    causes = [Cause(False, "the moon is full"), Cause(True, "the curve goes on rising")]
    why = as_printed(_q(107.7), "100.55", causes=causes).why
    assert "goes on rising" in why
    assert "moon" not in why
    assert "107.7" in why


def test_departures_are_shares_of_what_is_claimed() -> None:
    assert as_printed(_q(110.0), "100").departure == pytest.approx(0.1)
    assert as_printed(_q(5.0), "0").departure == 1.0
    assert occurs(False, "it").departure == 1.0


@pytest.mark.parametrize(
    ("found", "verdict"),
    [
        (positive(_q(1e-3, 1e-4), "the margin"), Verdict.HOLDS),
        (positive(_q(1e-3, 1e-2), "the margin"), Verdict.FAILS),
        (positive(_q(0.0), "the margin"), Verdict.FAILS),
        (vanishes(_q(1e-12, 1e-11), 0.0, "nothing"), Verdict.HOLDS),
        (vanishes(_q(-1e-10, 1e-11), 0.0, "nothing"), Verdict.FAILS),
        (coincides(_q(1e-12, 1e-11), 0.005, "a step"), Verdict.HOLDS),
        (coincides(_q(0.004, 1e-11), 0.005, "a step"), Verdict.WITHIN_GRID),
        (coincides(_q(-0.006, 1e-11), 0.005, "a step"), Verdict.FAILS),
        (at_least(_q(0.99), 0.99, "a need"), Verdict.HOLDS),
        (at_least(_q(0.98), 0.99, "a need"), Verdict.FAILS),
        (at_most(_q(10.0), 10.0, "a need"), Verdict.HOLDS),
        (at_most(_q(10.1), 10.0, "a need"), Verdict.FAILS),
        (at_most(_q(10.1, 0.2), 10.0, "a need"), Verdict.HOLDS),
        (differs(_q(41.5), "46.9"), Verdict.HOLDS),
        (differs(_q(41.48), "41.5"), Verdict.FAILS),
        (differs(_q(46.84), "46.9"), Verdict.HOLDS),
        (differs(_q(46.86), "46.9"), Verdict.FAILS),
        (occurs(True, "a fact"), Verdict.HOLDS),
        (undecided("a datum is missing"), Verdict.OPEN),
    ],
)
def test_the_other_rules(found: object, verdict: Verdict) -> None:
    assert getattr(found, "verdict") is verdict  # noqa: B009
    assert bool(getattr(found, "why")) == (verdict is not Verdict.HOLDS)  # noqa: B009


def test_a_width_is_what_each_figure_used_does_to_the_value() -> None:
    values, widths = {"a": 3.0, "b": 2.0, "c": 9.0}, {"a": 0.1, "b": 0.2}
    value, width = spread(lambda f: f["a"] - 2 * f["b"], values, widths)
    assert value == -1.0
    assert width == pytest.approx(0.1 + 0.4)
    assert spread(lambda f: f["a"] + f["c"], values, widths)[1] is None  # c's is not known
    with pytest.raises(KeyError, match="d"):
        spread(lambda f: f["d"], values, widths)


def test_fits_tell_parabolas_from_what_is_none() -> None:
    t = np.linspace(0.0, 1.0, 50)
    parabola = fit(t, 3 - 2 * t**2, 2)
    assert parabola is not None
    assert parabola.determination == pytest.approx(1.0, abs=1e-12)
    wave = fit(t, np.sin(20 * t), 2)
    assert wave is not None
    assert wave.determination < 0.5
    assert fit(t, np.ones_like(t), 2) is None
    assert fit(t[:3], t[:3], 1) is None


def test_claims_stand_in_the_papers_order() -> None:
    places = [
        "Sec. I",
        "Eq. (5)",
        "Secs. II, IV to VI",
        "Sec. III, Fig. 2",
        "Sec. IV",
        "Table II",
        "Sec. V, Fig. 5",
    ]
    places += ["Secs. VI, VII", "Sec. VII"]
    shuffled = places[4:] + places[:4]
    assert sorted(shuffled, key=order) == places


def _efficiency(
    name: str, built: float, fastest: float | None, best: float | None
) -> MachineEfficiency:
    """A machine of which only the efficiencies matter."""
    rest = {"launch_time": 1.0, "speed": 1.0, "kinetic_energy": 1.0, "arm_angle": 1.0, "sling": 6.0}
    return MachineEfficiency(
        name=name,
        text=name,
        available_energy=1.0,
        total_energy=1.0,
        table_one=SlingThrow(**rest, efficiency=built),
        fastest_sling=None if fastest is None else SlingThrow(**rest, efficiency=fastest),
        most_efficient=None
        if best is None
        else WidestThrow(**rest, efficiency=best, l1=10.0, theta0=0.0),
        speed_uncertainty=None,
    )


@pytest.mark.parametrize(
    ("floating", "rolling", "verdict", "said"),
    [
        ((0.7, 0.8, 0.9), (0.6, 0.7, 0.8), Verdict.HOLDS, ""),
        ((0.3, 0.8, 0.9), (0.6, 0.7, 0.8), Verdict.OPEN, "depends on lengths"),
        (
            (0.3, 0.6, 0.62),
            (0.6, 0.7, 0.8),
            Verdict.OPEN,
            "depends on lengths",
        ),  # its best beats the other as built
        ((0.3, 0.5, 0.59), (0.6, 0.7, 0.8), Verdict.FAILS, "0.983"),
        ((0.3, 0.5, None), (0.6, 0.7, None), Verdict.OPEN, "needs heyoka"),
        ((0.7, 0.8, None), (0.6, 0.7, None), Verdict.HOLDS, ""),
    ],
)
def test_who_beats_whom_is_told_only_where_lengths_do_not_decide(
    floating: Throws, rolling: Throws, verdict: Verdict, said: str
) -> None:
    others = [_efficiency(name, 0.1, 0.1, 0.1) for name in ("fixed", "catapult", "hinged")]
    machines = Machines(
        machines=(
            _efficiency("floating-arm", *floating),
            _efficiency("rolling", *rolling),
            *others,
        ),
        slings=(2.0, 14.0),
        bounds={"l1": (7.0, 13.0), "r": (2.0, 14.0), "theta0": (1.7, 2.6)},
        seconds=0.0,
    )
    rows = rows_machines.efficiency_rows(machines)
    row = next(each for each in rows if "beats the rolling" in each.name)
    assert isinstance(row.ours, Quantity)
    claim = row.judged(row.ours)
    assert claim.verdict is verdict
    assert said in claim.why


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("ours is 3 m", "Ours is 3 m."),
        ("λ is gone", "λ is gone."),
        ("l1 = 9 m is best", "l1 = 9 m is best."),
        ("it ends so.", "It ends so."),
    ],
)
def test_reasons_are_shown_as_sentences(text: str, printed: str) -> None:
    assert sentence(text) == printed


def test_the_papers_energies_tell_machines_apart() -> None:
    """The same comparison with a length off by one part in a million is seen, far above
    rounding."""
    p = tb.TrebuchetParameters()
    other = p.model_copy(update={"r": p.r * (1 + 1e-6)})
    for build, energies in (
        (tb.fixed, rows_machine.fixed_energies),
        (tb.rolling, rows_machine.rolling_energies),
    ):
        assert rows_machine.largest_difference(build(p), p, energies) < 1e-13
        assert rows_machine.largest_difference(build(p), other, energies) > 1e-9


def test_every_number_of_the_paper_has_a_row_or_a_reason() -> None:
    assert all(each.printed and each.why for each in UNREACHED)
    assert {"Table I", "Table II"} <= {each.where for each in UNREACHED}


@pytest.fixture
def small() -> Study:
    """A study of three claims, one of which an engine contradicts."""

    def claim(name: str, where: str, ours: Quantity, printed: str, *engines: EngineValue) -> Claim:
        return Row(name, where, printed, f"the {name}", ours, as_printed).judged(ours, engines)

    agreeing = EngineValue(engine="mujoco", value=99.4001, tolerance=1e-3)
    off = EngineValue(engine="pymunk", value=99.5, tolerance=1e-3)
    absent = EngineValue(engine="exudyn", value=None, note="engine 'exudyn' is not installed here")
    claims = (
        claim("launch speed", "Sec. V", _q(99.4, 1e-9, "m/s"), "99.4 m/s", agreeing, off, absent),
        claim("lever ratio", "Secs. V, VII", _q(1.82, unit=""), "2.42:1"),
        claim("speed at 10.3", "Sec. V", _q(95.8, unit="m/s"), "0 m/s"),
    )
    line = Series(
        figure="Fig. 4",
        name="reference",
        x=(0.0, 1.0),
        y=(1.0, 2.0),
        x_label="t [s]",
        y_label="range [m]",
    )
    return Study(
        made="2000-01-01T00:00:00+00:00",
        versions={"trebucheck": "0"},
        machines=(tb.fixed(),),
        claims=claims,
        series=(line,),
        sections={"drag": {"failed": "it <crashed>"}, "machines": {"any": 1}},
        seconds=1.0,
    )


def test_the_summary_counts_and_ranks(small: Study) -> None:
    assert list(shown.counts(small).values()) == [1, 0, 2, 0]
    assert shown.agreement(small).startswith("1 of 2 values")
    assert [(c.name, e.engine) for c, e in shown.disagreeing(small)] == [("launch speed", "pymunk")]
    # What the paper concludes comes first, though the other departs more; and one of a section is
    # enough.
    assert [claim.name for claim in shown.worst(small.claims, 3)] == ["lever ratio"]
    assert "1 printed numbers" in shown.findings(small)[0]
    assert "and 0 of these" in shown.findings(small)[0]


def test_rows_of_one_fact_count_once_and_by_the_least_favourable(small: Study) -> None:
    """The speed holds and its place does not: stated as one fact, that fact does not hold."""
    lever = small.claims[1]
    holding, place = (
        each.model_copy(update={"fact": lever.name}) for each in (small.claims[0], small.claims[2])
    )
    study = small.model_copy(update={"claims": (holding, place, lever)})
    assert list(shown.counts(study).values()) == [0, 0, 1, 0]
    assert [claim.name for claim in shown.facts(study.claims)] == [
        lever.name
    ]  # the row that the fact is named after
    assert shown.headline(study).startswith("1 claims (of 3 rows")
    assert shown.summary(study).count("2.42:1") == 1
    assert "0 m/s" not in shown.summary(study)
    html = page(shown.document(study))
    assert html.count("the same fact as “lever ratio”") == 2
    assert "(holds)" in html


def test_no_digit_is_shown_that_is_not_known(small: Study) -> None:
    shown_as = {
        (3.96457390692, 2e-2): "3.96",
        (0.0, 0.0): "0",
        (2.74950439, None): "2.7495",
        (99.4005152562, 2e-11): "99.4005153",
        (1e-15, 1e-12): "1e-15",
        (4.8e-15, 1.8e-15): "5e-15",
    }
    claim = small.claims[0]
    claims = tuple(
        claim.model_copy(update={"name": text, "ours": _q(value, width, "N")})
        for (value, width), text in shown_as.items()
    )
    html = page(shown.document(small.model_copy(update={"claims": claims})))
    assert len(shown_as) > 0
    for text in shown_as.values():
        assert f">{text} N<" in html


def test_the_page_stands_for_itself(small: Study) -> None:
    html = page(shown.document(small))
    own = re.sub(
        r"<script>.*?</script>", "", html, flags=re.DOTALL
    )  # the plotting library's code names addresses
    assert 'src="' not in own
    assert 'href="http' not in own
    assert "it &lt;crashed&gt;" in html  # a failed study is said, and escaped
    assert "Machines" in html  # a study that nobody renders is not lost
    for text in ("launch speed", "2.42:1", "not installed here", "Fig. 4", "Table I"):
        assert text in html


def test_json_comes_back_and_keeps_to_its_schema(small: Study) -> None:
    assert Study.from_json(small.to_json()) == small
    published = (ROOT / "paper" / "trebucheck_paper" / "schemas" / "paper.schema.json").read_text()
    assert published == schema_text(Study), "`make generated` writes the schemas anew"
    jsonschema.validate(json.loads(small.to_json()), json.loads(published))


@pytest.mark.slow  # several processes are started
def test_a_job_that_dies_costs_only_itself() -> None:
    # None is a function of this module, which each process would have to load.
    fine, crashes = partial(divmod, 85, 2), partial(os._exit, 3)
    jobs = {"fine": fine, "raises": partial(tb.problem, "no such thing"), "crashes": crashes}
    jobs["last"] = fine
    with Jobs(jobs, at_once=2, timeout=60.0) as running:
        found = {name: (result, why) for name, result, why in running.finished()}
    assert set(found) == set(jobs)
    assert found["fine"] == found["last"] == ((42, 1), None)
    assert "no such thing" in (found["raises"][1] or "")
    assert found["crashes"][0] is None
    assert found["crashes"][1]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--engines", "mujoko"], "did you mean 'mujoco'"),
        (["--engines", ","], "--engines is empty"),
        (["--sections", "colours"], "no section 'colours'"),
        (["--timeout", "0"], "'--timeout': 0.0"),
        (["--timeout", "nan"], "'--timeout': nan"),
        (["--out", "file/paper"], "is not a folder"),
    ],
)
def test_wrong_input_is_one_sentence(
    arguments: list[str], complaint: str, tmp_path: Path, refused: Callable[..., str]
) -> None:
    (tmp_path / "file").write_text("")
    assert complaint in refused("paper", *arguments)


def test_sections_are_checked_before_any_work() -> None:
    with pytest.raises(
        tb.InputError, match="there are: design, machines, sweep, identification, drag"
    ):
        study(["reference"], sections=["colour"])
