"""Presets: `default` and `settings` are the engine alone, `assisted` names all that helps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.engines.presets import ASSISTED, DEFAULT, PRESETS, SETTINGS
from trebucheck.engines.protocol import BuiltinEngine
from trebucheck.engines.registry import engine_class
from trebucheck.engines.supplied import stated
from trebucheck.models.library.registry import library_problem

ALONE = (DEFAULT, SETTINGS)


@dataclass(frozen=True)
class Case:
    """An engine, its own options, and problems: with stops, with a loop, with springs."""

    own: frozenset[str]
    problems: tuple[str, ...]


CASES: Mapping[str, Case] = {
    "mujoco": Case(
        frozenset({"timestep", "integrator", "solver", "tolerance", "iterations", "margin"})
        | {"solref", "solimp"},
        ("fixed", "slider-crank", "spring-pendulum"),
    ),
    "exudyn": Case(
        frozenset({"timestep", "integrator", "loop_integrator", "spectral_radius", "adaptive_step"})
        | {"newton_relative", "newton_absolute", "modified_newton", "minimum_step"}
        | {"ignore_singular", "limit_period", "stop_damping_ratio"},
        ("fixed", "slider-crank", "spring-pendulum"),
    ),
    "pymunk": Case(
        frozenset({"timestep", "iterations", "start_iterations", "error_bias"})
        | {"groove_error_bias", "slot_error_bias", "slot_pin_error_bias", "limit_error_bias"}
        | {"collision_slop", "collision_bias"},
        ("fixed", "slider-crank", "damped-oscillator"),
    ),
}


def _problem(name: str, duration: float = 0.4) -> tb.Problem:
    """A problem of the library, or a machine, for a short time."""
    known = library_problem(name, None)
    if known is None:
        return tb.Problem(tb.model(name), duration=duration)
    return known.model_copy(update={"duration": min(duration, known.duration)})


def _engine(name: str, preset: str = ASSISTED, **options: Any) -> BuiltinEngine:
    made = tb.engine(name, preset, **options)
    assert isinstance(made, BuiltinEngine)
    return made


EVERY = [(name, problem) for name, case in CASES.items() for problem in case.problems]


@pytest.mark.parametrize("preset", ALONE)
@pytest.mark.parametrize(("name", "problem"), EVERY)
def test_a_program_of_the_engine_alone_has_the_same_motion(
    name: str, problem: str, preset: str
) -> None:
    made, given = _engine(name, preset), _problem(problem)
    text = made.script(given)
    assert "trebucheck" not in text.replace("Written by trebucheck", "")
    found: dict[str, Any] = {}
    exec(text, found)
    row = made.simulate(given)
    for key in ("t", "q", "u"):
        assert np.array_equal(found[key], getattr(row, key))


@pytest.mark.parametrize("name", CASES)
def test_every_option_is_the_engines_own_or_assistance(name: str) -> None:
    cls = engine_class(name)
    assert isinstance(cls, type) and issubclass(cls, BuiltinEngine)
    assert cls.assistance is not None
    assisting = {each.option for each in cls.assistance}
    assert sorted([*CASES[name].own, *assisting]) == sorted(set(cls.model_fields) - {"preset"})


@pytest.mark.parametrize("preset", ALONE)
@pytest.mark.parametrize("name", CASES)
def test_nothing_helps_an_engine_that_is_alone(name: str, preset: str) -> None:
    made = _engine(name, preset)
    assert made.assisted_by == () and made.supplied == type(made).readings
    with pytest.raises(tb.InputError, match="takes part in the run"):
        _engine(name).script(_problem(CASES[name].problems[0]))


@pytest.mark.parametrize(("name", "problem"), EVERY)
def test_what_changes_a_state_is_named(name: str, problem: str) -> None:
    """Each option of assistance, switched off: the row names a part of it if a state changes."""
    given, assisted = _problem(problem, 0.2), _engine(name)
    row = assisted.simulate(given)
    named = stated(assisted, given.mechanism)
    assert named is not None
    for each in assisted.assisted_by:
        options = {**assisted.settings, **each.options_without}
        without = _engine(name, **options).simulate(given)
        same = np.array_equal(without.t, row.t) and np.array_equal(without.q, row.q)
        parts = {other.part for other in assisted.assisted_by if other.option == each.option}
        assert same or parts & named.keys(), each.does


@pytest.mark.parametrize(("name", "problem"), EVERY)
def test_without_all_of_it_the_engine_is_alone(name: str, problem: str) -> None:
    given, assisted = _problem(problem, 0.2), _engine(name)
    off: dict[str, Any] = dict(assisted.settings)
    for each in assisted.assisted_by:
        off |= each.options_without
    bare = _engine(name, **off)
    assert bare.assisted_by == ()
    found: dict[str, Any] = {}
    exec(bare.script(given), found)
    assert np.array_equal(found["q"], bare.simulate(given).q)


@pytest.mark.parametrize(
    ("name", "problem"),
    [*EVERY, ("pymunk", "singular-slider-crank"), ("pymunk", "bouncing"), ("exudyn", "bouncing")],
)
def test_settings_are_no_worse_than_the_default(name: str, problem: str) -> None:
    """In coordinates; test_settings_in_matrix.py compares every quantity of all kept results."""
    given = _problem(problem, 1.0)
    solution = tb.solve(given)

    def error(preset: str) -> float:
        run = _engine(name, preset).simulate(given)
        within = run.t <= given.duration
        return float(np.abs(run.q[within] - np.asarray(solution.q(run.t[within]))).max())

    # The reference is known to 1e-9 and better: below that there is nothing to compare.
    assert error(SETTINGS) <= max(error(DEFAULT), 1e-9)


def test_presets_of_former_names_are_read() -> None:
    with pytest.warns(FutureWarning, match="'default'"):
        former = tb.engine("mujoco", "stock")
    assert former == tb.engine("mujoco", DEFAULT)
    with pytest.warns(FutureWarning, match="'assisted'"):
        assert tb.engine("mujoco", "tuned") == tb.engine("mujoco", ASSISTED)
    assert tuple(engine_class("mujoco").presets()) == PRESETS


# --- Defaults, read from the installed engine


def test_the_defaults_of_mujoco_are_its_own() -> None:
    """Options and softness of the default row's model equal those of a model that sets nothing."""
    mujoco = pytest.importorskip("mujoco")
    bare = mujoco.MjModel.from_xml_string(
        """
        <mujoco>
          <worldbody>
            <geom name="floor" type="plane" size="1 1 1"/>
            <body>
              <joint name="hinge" type="hinge" axis="0 1 0" range="-1 1"/>
              <geom name="ball" size="1"/>
              <site name="a"/>
            </body>
            <site name="b"/>
          </worldbody>
          <tendon><spatial range="0 1"><site site="a"/><site site="b"/></spatial></tendon>
          <contact><pair geom1="floor" geom2="ball"/></contact>
          <equality><connect site1="a" site2="b"/></equality>
        </mujoco>
        """
    )
    from trebucheck.engines.mujoco.alone import model_text
    from trebucheck.engines.mujoco.engine import MujocoEngine

    default = _engine("mujoco", DEFAULT)
    assert isinstance(default, MujocoEngine)
    stated_options = {
        "timestep": bare.opt.timestep,
        "integrator": mujoco.mjtIntegrator(bare.opt.integrator).name.removeprefix("mjINT_"),
        "solver": mujoco.mjtSolver(bare.opt.solver).name.removeprefix("mjSOL_"),
        "tolerance": bare.opt.tolerance,
        "iterations": bare.opt.iterations,
        "solref": bare.jnt_solref[0].tolist(),
        "solimp": bare.jnt_solimp[0].tolist(),
        "margin": bare.jnt_margin[0],
    }
    for option, value in stated_options.items():
        ours = default.settings[option]
        assert (ours.upper() if isinstance(ours, str) else ours) == (
            value.upper() if isinstance(value, str) else value
        ), option
    # The models of three problems, against all options of the bare one but for gravity.
    for name in CASES["mujoco"].problems:
        mechanism = _problem(name).mechanism
        model = mujoco.MjModel.from_xml_string(model_text(mechanism, default))
        for option in dir(bare.opt):
            value = getattr(bare.opt, option)
            if option.startswith("_") or callable(value) or option == "gravity":
                continue
            assert np.array_equal(getattr(model.opt, option), value), option
        for kind in ("jnt_solref", "jnt_solimp", "pair_solref", "pair_solimp", "eq_solref"):
            for row in getattr(model, kind):
                assert np.array_equal(row, getattr(bare, kind)[0]), kind
        assert not model.jnt_margin.any() and not model.pair_margin.any()
