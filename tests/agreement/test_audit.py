"""Audits of model files: errors against closed forms, ends, advice, and files that diverge."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.cli.app import main
from trebucheck.comparisons.audit import Audit
from trebucheck.comparisons.report.pages.audit import document
from trebucheck.models.spec import schema_text
from trebucheck.version import __version__

ROOT = Path(__file__).parents[2]
RATE, STEP = 4.0, 0.01


def oscillator(integrator: str = "Euler", step: float = STEP, stiffness: float = RATE**2) -> str:
    """A unit mass on a spring along a slide, with the rate of 4 rad/s."""
    return (
        f'<mujoco model="oscillator"><option integrator="{integrator}" timestep="{step!r}"/>'
        '<worldbody><body name="mass"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        f'<joint name="s" type="slide" axis="1 0 0" stiffness="{stiffness!r}"/>'
        '<site name="here"/></body></worldbody></mujoco>'
    )


def falling(height: float) -> str:
    """A ball that falls onto a floor."""
    return (
        '<mujoco model="ball"><option timestep="0.001"/><worldbody>'
        '<geom name="floor" type="plane" size="1 1 1"/><body name="ball" '
        f'pos="0 0 {height!r}"><joint name="z" type="slide" axis="0 0 1"/>'
        '<geom name="ball" size="0.1" mass="1"/></body></worldbody></mujoco>'
    )


def audited(text: str | Path, until: float, **how: Any) -> Audit:
    """An audit without other engines, unless some are named."""
    return tb.audit(text, until, **{"engines": (), **how})


def run_of(found: Audit, integrator: str, step: float) -> Any:
    """The run with an integrator and a step."""
    return next(
        run
        for run in found.runs
        if run.integrator == integrator and math.isclose(run.timestep, step)
    )


def test_the_error_is_that_of_the_schemes_own_recursion() -> None:
    """MuJoCo's Euler: the speed first, then the place with the new speed."""
    found = audited(oscillator(), 1.0, qpos=[0.5])
    x, v, off = 0.5, 0.0, [0.0]
    for k in range(1, 101):
        v -= RATE**2 * x * STEP
        x += v * STEP
        off.append(abs(x - 0.5 * math.cos(RATE * k * STEP)))
    # The reference's own error, which its tests hold to 1e-11
    assert found.given.error == pytest.approx(max(off), abs=1e-11)
    assert [each.error for each in found.errors] == pytest.approx(
        [max(off[: n + 1]) for n in (10, 50, 100)], abs=1e-11
    )
    assert found.size == pytest.approx(1.0, abs=1e-3)  # from 0.5 to -0.5, by 400 samples
    beyond = next(k for k, each in enumerate(off) if each > 0.01 * found.size)
    assert found.given.leaves == pytest.approx(beyond * STEP)
    assert found.given.steps == 100
    assert found.ended == ""


@pytest.mark.parametrize(("integrator", "order"), [("Euler", 1), ("RK4", 4)])
def test_errors_fall_with_the_order_of_the_integrator(integrator: str, order: int) -> None:
    found = audited(oscillator(), 1.0, qpos=[0.5])
    errors = [run_of(found, integrator, part * STEP).error for part in (1, 0.5, 0.25)]
    ratios = np.log2(np.array(errors[:-1]) / errors[1:])
    assert ratios == pytest.approx([order, order], abs=0.1)


def test_the_cheapest_option_holds_what_it_says(tmp_path: Path) -> None:
    found = audited(oscillator(), 1.0, qpos=[0.5], accuracy=1e-6)
    assert found.cheapest is not None
    assert "RK4" in found.cheapest_option
    text = oscillator()
    begin, end = text.index("<option"), text.index("/>") + 2
    path = tmp_path / "cheapest.xml"
    path.write_text(text[:begin] + found.cheapest_option + text[end:])
    again = audited(path, 1.0, qpos=[0.5])
    assert again.given.error is not None
    assert again.given.error <= 1e-6
    assert audited(oscillator(), 1.0, qpos=[0.5], accuracy=1e-15).cheapest is None


def test_causes_are_taken_out_one_after_another() -> None:
    """Euler's rule, then the step: RK4 at an eighth of the step leaves h^4 of it."""
    text = oscillator().replace("/><site", ' damping="0.5"/><site')
    found = audited(text, 1.0, qpos=[0.5])
    assert found.given.error is not None
    assert (found.given.leaves, found.causes_to) == (None, 1.0)
    integrator, step = found.causes
    assert sum(each.share or 0.0 for each in found.causes) == pytest.approx(
        1.0 - (step.left or 0.0) / found.given.error, abs=1e-9
    )
    assert (integrator.share or 0.0) > 0.5
    assert step.left == pytest.approx(0.0, abs=1e-9)
    assert integrator.left == pytest.approx(run_of(found, "RK4", STEP).error, rel=1e-6)


def test_a_cause_whose_removal_makes_the_error_larger_stays_in() -> None:
    """Strong damping: Euler's implicit rule bears this step, RK4 does not (5 > 2.8)."""
    text = oscillator().replace("/><site", ' damping="500"/><site')
    found = audited(text, 0.2, qpos=[0.5])
    integrator, step = found.causes
    assert integrator.share is None
    assert found.given.error is not None
    assert integrator.left is None or integrator.left > found.given.error
    # The step is taken out of Euler's rule, which a shorter one makes more accurate.
    assert step.share is not None
    assert 0.0 < step.share <= 1.0


def test_explicit_damping_is_tried_and_its_option_said() -> None:
    """MuJoCo's Euler without `eulerdamp`: the damper's force is that of the old speed."""
    text = oscillator().replace("/><site", ' damping="0.5"/><site')
    found = audited(text, 1.0, qpos=[0.5])
    (explicit,) = (run for run in found.runs if run.explicit_damping)
    v, x = 0.0, 0.5
    for _ in range(100):
        v += STEP * (-(RATE**2) * x - 0.5 * v)
        x += STEP * v
    rate = math.sqrt(RATE**2 - 0.25**2)
    exact = 0.5 * math.exp(-0.25) * (math.cos(rate) + 0.25 / rate * math.sin(rate))
    assert explicit.error is not None
    assert explicit.error >= abs(x - exact) - 1e-9
    assert not any(run.explicit_damping for run in audited(oscillator(), 0.1, qpos=[0.5]).runs)


def test_soft_limits_are_a_cause() -> None:
    """A slide that is pushed onto its limit: MuJoCo's gives way, the mechanism's does not."""
    text = oscillator("RK4", 0.002).replace("/><site", ' range="-1 0.2" limited="true"/><site')
    found = audited(text, 1.0, qpos=[-0.5])
    *_, before, soft, _ = found.causes
    assert "softness" in soft.name
    assert (soft.left or 0.0) < 0.5 * (before.left or 0.0)


def test_a_limit_rebounds_however_stiff_it_is() -> None:
    """A free slide that meets its limit leaves it with exp(-2) of its speed; at rest it stays."""
    text = oscillator("RK4", 1e-4, stiffness=0.0).replace(
        "/><site", ' range="-1 0.2" limited="true" solreflimit="0.0002 1"/><site'
    )
    found = audited(text.replace('integrator="RK4"', 'integrator="RK4" gravity="0 0 0"'), 1.0,
                    qvel=[1.0])  # fmt: skip
    way = 0.8 * math.exp(-2.0)  # back, in the 0.8 s that are left
    # With a time constant of two steps instead of none: RK4 keeps 0.113 of the speed, not 0.135.
    assert found.given.error == pytest.approx(way, rel=0.2)
    *_, softness, rebound = found.causes
    assert "rebound" in rebound.name
    # A damping ratio of 5 keeps less than a hundredth.
    assert (rebound.left or 0.0) < 0.1 * (softness.left or 0.0)


def test_no_motion_is_missed_where_sites_hardly_move() -> None:
    """A site on the axis, one in the world, and a wheel whose centre of mass is on its axle."""
    sites = '<site name="here" pos="0 0 0"/>'
    wheel = (
        '<mujoco model="wheel"><option timestep="0.01"/><worldbody><site name="target"/>'
        '<body name="wheel"><inertial pos="0 0 0" mass="2" diaginertia="0.5 0.5 0.5"/>'
        f'<joint name="j" axis="0 1 0" stiffness="8"/>{sites}</body></worldbody></mujoco>'
    )
    for text in (wheel, wheel.replace(sites, "")):
        found = audited(text, 1.0, qpos=[0.5])
        # Rate 4 /s and a radius of gyration of 0.5 m: Euler's error of the angle, at that radius.
        angles = np.array([each.q[0] for each in found.samples])
        assert found.size > 0.4
        off = 0.5 * max(abs(2.0 * np.sin(0.5 * (a - 0.5 * math.cos(RATE * each.t))))
                        for a, each in zip(angles, found.samples, strict=True))  # fmt: skip
        assert found.given.error == pytest.approx(off, rel=1e-6)


def test_a_start_off_an_equality_costs_no_run() -> None:
    text = (
        '<mujoco model="m"><worldbody><body name="b"><joint name="j" axis="0 1 0"/>'
        '<geom size="0.1" pos="0.3 0 0"/><body name="c"><joint name="k" axis="0 1 0"/>'
        '<geom size="0.1" pos="0.3 0 0"/></body></body></worldbody>'
        '<equality><joint joint1="j" joint2="k"/></equality></mujoco>'
    )
    with pytest.raises(tb.InputError, match="leave the equalities out"):
        audited(text, 1.0, qpos=[0.3, 0.0], progress=lambda *_: pytest.fail("a run was made"))


def test_energy_is_off_as_the_rule_says() -> None:
    """Semi-implicit Euler keeps v^2 + w^2 x^2 + h w^2 x v: E is off by -h w^2 (x v) / 2."""
    found = audited(oscillator(), 1.0, qpos=[0.5])
    samples = found.samples
    expected = [0.5 * STEP * RATE**2 * each.q[0] * each.u[0] for each in samples]
    assert [abs(each.energy_error) for each in samples] == pytest.approx(
        np.abs(expected), abs=1e-10
    )
    motion = found.trajectory()
    assert motion.kinetic_energy == pytest.approx(0.5 * motion.u[:, 0] ** 2, rel=1e-12, abs=1e-15)
    assert motion.provenance.preset == "given"


def test_other_engines_move_what_was_read() -> None:
    found = audited(oscillator(), 0.5, qpos=[0.5], engines=("exudyn", "pymunk"))
    exudyn, pymunk = found.engines
    assert exudyn.error is not None
    assert exudyn.error < 1e-5
    # Places and speeds are half a step apart, which is h/2 of the greatest speed.
    assert pymunk.error == pytest.approx(0.5 * pymunk.timestep * 0.5 * RATE, rel=0.01)
    # Its adapter has no inertias along slides, which the row says
    driven = oscillator().replace('type="slide"', 'type="slide" armature="0.1"')
    (refused,) = audited(driven, 0.5, qpos=[0.5], engines=("pymunk",)).engines
    assert refused.error is None
    assert "inertias along slides" in (refused.message or "")
    with pytest.raises(tb.InputError, match="nosuch"):
        audited(oscillator(), 0.5, qpos=[0.5], engines=("nosuch",))


def test_bodies_that_touch_at_the_start_are_refused() -> None:
    with pytest.raises(tb.InputError, match="touch at the start"):
        audited(falling(0.05), 1.0)


def test_a_contact_ends_what_is_compared() -> None:
    found = audited(falling(1.0), 2.0)
    touches = math.sqrt(2 * 0.9 / 9.81)
    # The most accurate runs that hold the motion touch within their step of it.
    assert touches - 2e-3 <= found.compared_to <= touches
    assert run_of(found, "RK4", 1e-3).error < 1e-12
    assert "touch" in found.ended
    # The given step's error of a fall: h/2 g t.
    assert found.given.error == pytest.approx(0.5e-3 * 9.81 * touches, rel=0.01)


def test_a_step_beyond_the_end_is_no_run_that_holds() -> None:
    found = audited(oscillator(), 0.02, qpos=[0.5])
    coarse = run_of(found, "RK4", 4 * STEP)
    assert coarse.error is None
    assert "longer" in (coarse.message or "")
    assert run_of(found, "RK4", 2 * STEP).error is not None


def test_an_unpredictable_motion_ends_what_is_compared() -> None:
    """Two rods from above: their motion is not known for a minute, and predicted for less."""
    rods = (
        '<mujoco model="rods"><option timestep="0.02"/><worldbody><body name="a">'
        '<joint name="a" type="hinge" axis="0 1 0"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 1" size=".05"/><body name="b" pos="0 0 1">'
        '<joint name="b" type="hinge" axis="0 1 0"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 1" size=".05"/>'
        "</body></body></worldbody></mujoco>"
    )
    found = audited(rods, 60.0, qpos=[0.1, 0.2])
    assert found.compared_to < 60.0
    assert "not known" in found.ended
    assert found.horizon is not None
    assert found.horizon < found.compared_to
    assert found.known_to <= 1e-4


def test_what_diverges_is_a_row_and_not_a_lost_audit() -> None:
    """An explicit Euler step is unstable beyond 2 / rate: four of these are, one is not."""
    found = audited(oscillator(step=0.015, stiffness=1e4), 3.0, qpos=[0.1])
    coarse = run_of(found, "Euler", 0.06)
    assert coarse.error is None or coarse.error > 1.0
    assert found.given.error is not None
    assert math.isfinite(found.given.error)


@pytest.mark.parametrize(
    ("until", "how", "message"),
    [
        (-1.0, {}, "until = -1.0"),
        (math.nan, {}, "until"),
        (math.inf, {}, "until"),
        (1.0, {"accuracy": 0.0}, "accuracy = 0.0"),
        (1.0, {"qpos": [0.0, 1.0]}, "qpos"),
        (1.0, {"qpos": [0.0]}, "nothing moves"),
    ],
)
def test_what_is_not_valid_is_refused(until: float, how: dict[str, Any], message: str) -> None:
    with pytest.raises(tb.InputError, match=message):
        audited(oscillator(), until, **how)


def test_the_page_shows_the_runs_numbers_and_json_comes_back() -> None:
    found = audited(oscillator(), 1.0, qpos=[0.5])
    assert Audit.from_json(found.to_json()) == found
    assert found.trebucheck_version == __version__
    page = document(found)
    assert page.verdict == found.headline()
    assert len(found.to_dataframe()) == len(found.runs)
    schema = ROOT / "comparisons" / "schemas" / "audit.schema.json"
    assert schema.read_text() == schema_text(Audit), "`make generated` writes the schemas anew"


def test_the_command_writes_its_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "oscillator.xml", tmp_path / "out"
    path.write_text(oscillator())
    words = ["audit", str(path), "--qpos", "0.5", "--until", "1", "--out", str(out)]
    assert main(words) == 0
    told = capsys.readouterr().out
    assert "as given is off by" in told
    assert "<option integrator=" in told
    assert (out / "audit.html").read_text().count("RK4") > 3
    assert Audit.from_json((out / "audit.json").read_text()).model == "oscillator"
    assert main(["audit", str(tmp_path / "absent.xml"), "--out", str(out)]) == 2
