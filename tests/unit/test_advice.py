"""Advice without running an engine.

What is asked, what is tried, what is chosen, and the texts to paste.
"""

from __future__ import annotations

import ast
import json
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import jsonschema
import pytest
import trebucheck as tb
import typer
from trebucheck.__main__ import main
from trebucheck.comparisons import recommend as recommending
from trebucheck.comparisons.recommend import (
    PYTHON,
    TIE,
    Accuracy,
    Advice,
    Ladder,
    Obstacle,
    Search,
    Sweep,
    TargetedRuns,
    TimedSweep,
    cheapest,
    configured,
    option_sets,
    read_torque,
    recommend_study,
    snippets,
)
from trebucheck.comparisons.runs.record import EngineRuns, RunRecord
from trebucheck.comparisons.runs.results import Metric
from trebucheck.comparisons.runs.study import Study
from trebucheck.engines.mujoco.study import MJCF
from trebucheck.engines.mujoco.study import PYTHON as MUJOCO_PYTHON
from trebucheck.engines.study import OptionSet
from trebucheck.models.spec import schema_text

ENGINES = ("mujoco", "pymunk", "exudyn")
LADDER = Ladder.of(1.8, 2.0)
STEPS = LADDER.steps[LADDER.moderate :]


# What is asked


def test_torque_is_read_as_newton_metres_or_as_a_share() -> None:
    assert read_torque("1e-3") == {"torque": 1e-3}
    assert read_torque(" 0.1 % ") == {"torque_share": 0.1 / 100}
    with pytest.raises(tb.InputError, match=r"--torque 'much' is not a number"):
        read_torque("much")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "nothing is asked; give at least one of --position, --torque and --release"),
        (["--position", "0"], "position = 0.0"),
        (["--position", "nan"], "position = nan"),
        (["--position", "-1e-3"], "position = -0.001"),
        (["--position", "0.1%"], "--position"),
        (["--torque", "-5%"], "torque_share = -0.05"),
        (["--torque", "five"], "--torque 'five' is not a number"),
        (["--release", "inf"], "release = inf"),
        (["--position", "1", "--engines", "reference"], "what the others are measured against"),
        (["--position", "1", "--engines", "mujoko"], "did you mean 'mujoco'"),
        (["--position", "1", "--engines", ","], "--engines is empty"),
        (["--position", "1", "--model", "floating"], "no model 'floating'"),
        (["--position", "1", "--model", "fixed,rolling"], "names 2 machines"),
        (["--position", "1", "--neighbours", "-1"], "neighbours = -1 must be between"),
        (["--position", "1", "--timeout", "0"], "'--timeout': 0.0 must be positive"),
        (["--position", "1", "--set", "l1=0"], "l1 = 0.0"),
        (["--position", "1e-14"], "finer than 10 times the reference's own uncertainty"),
    ],
)
def test_wrong_input_gets_a_sentence(
    arguments: list[str], complaint: str, refused: Callable[..., str]
) -> None:
    assert complaint in refused("recommend", *arguments)


def test_a_share_of_the_torque_is_each_machines_own() -> None:
    motion = SimpleNamespace(stop_torques={"rest": __import__("numpy").array([3.0, 200.0, 5.0])})
    trials = cast(
        "EngineRuns", SimpleNamespace(solution=SimpleNamespace(motion=lambda _: motion), end=1.0)
    )
    assert TargetedRuns(trials, Accuracy(torque_share=0.01)).allowed == {"torque": 2.0}
    with pytest.raises(tb.InputError, match="asked in N m and as a share"):
        Accuracy(torque=1.0, torque_share=0.01)


# What is tried


def test_the_ladder_is_of_round_steps_and_follows_the_machines_own_time() -> None:
    assert LADDER.steps[LADDER.moderate :] == STEPS
    assert STEPS == (0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001, 5e-05, 2e-05)
    assert LADDER.steps[: LADDER.moderate] == (0.5, 0.2, 0.1, 0.05, 0.02, 0.01)
    small = Ladder.of(1.8 / 10, 0.2)
    assert small.steps == tuple(float(f"{step / 10:.0e}") for step in LADDER.steps)


def test_no_step_is_longer_than_an_engine_takes_or_a_motion_lasts() -> None:
    assert Ladder.of(100.0, 1e3).steps[0] == 1.0
    brief = Ladder.of(1.8, 1e-2)
    assert brief.moderate == 0 and brief.steps[0] == 2e-3


@pytest.mark.parametrize("name", ENGINES)
def test_every_set_is_valid_at_every_step_and_another_one(name: str) -> None:
    """Each candidate is an engine, and the way back from its text is that engine."""
    sets = option_sets(name)
    assert configured(name, sets[0], 1e-3) == tb.engine(name, "default", timestep=1e-3)
    assert configured(name, sets[-1], 1e-3) == tb.engine(name, "assisted", timestep=1e-3)
    for step in STEPS:
        made = [json.dumps(configured(name, options, step).settings) for options in sets]
    assert len(set(made)) == len(
        sets
    )  # at the shortest step: what is scaled with it may meet the preset's at another


def test_neighbours_stay_in_the_stated_ranges_and_are_always_the_same() -> None:
    base = tb.TrebuchetParameters().model_dump()
    first = list(islice(recommending.of_parameters("rolling", None), 30))
    assert first == list(islice(recommending.of_parameters("rolling", None), 30))
    assert len({mechanism.content_hash for mechanism, _ in first}) == 30
    for _, own in first:
        for name, value in own.items():
            if name.endswith("0"):
                assert abs(value - base[name]) <= recommending.ANGLE
            else:
                largest = recommending.MASS if name.startswith("m_") else recommending.LENGTH
                assert 1 / largest <= value / base[name] <= largest
    assert set(first[0][1]) == set(base) - {"g"}


def test_a_mechanism_of_ones_own_keeps_its_geometry() -> None:
    mechanism = tb.fixed()
    neighbours = list(islice(recommending.of_mechanism(mechanism), 5))
    assert len(neighbours) == 5
    for neighbour, factors in neighbours:
        assert neighbour.joints == mechanism.joints and neighbour.start == mechanism.start
        assert neighbour.gravity == mechanism.gravity * factors["gravity"]
        for body, own in zip(neighbour.bodies, mechanism.bodies, strict=True):
            factor = factors[f"mass of {body.name}"]
            assert (body.mass, body.inertia) == (own.mass * factor, own.inertia * factor)


# What stands in the way


def _verdict(error: Callable[[float], float], allowed: float = 1e-9) -> recommending.Verdict:
    return recommending.classify(STEPS, [error(h) for h in STEPS], allowed, "m")


def test_obstacles_are_told_from_the_course_of_the_error() -> None:
    assert _verdict(lambda h: 3.0 * h**2).obstacle is Obstacle.STEP
    assert _verdict(lambda h: 3.0 * h**2 + 1e-4).obstacle is Obstacle.FLOOR
    assert _verdict(lambda h: 3e-3 * (1 + h)).obstacle is Obstacle.CONSTANT
    assert _verdict(lambda h: h**2 + 1e-14 / h**2).obstacle is Obstacle.ROUNDING
    assert _verdict(lambda _: math.inf).obstacle is Obstacle.FAILURE


def test_a_falling_error_says_which_step_would_do() -> None:
    sentence = _verdict(lambda h: 4.0 * h**2, allowed=4e-12).sentence
    assert "order 2.0" in sentence and "some 1e-06 s would do" in sentence


def test_growth_by_rounding_says_its_power() -> None:
    assert "as 1/step^2.0" in _verdict(lambda h: 6.25e-14 / h**2 if h <= 5e-4 else h**2).sentence


# What is chosen


class _Synthetic:
    """Runs whose errors are a formula.

    Position = constant(options) * step^2 * the machine's own factor.
    """

    def __init__(
        self, factor: float, constants: dict[str, float], cost: dict[str, float], floor: float = 0.0
    ) -> None:
        self.factor, self.constants, self.cost, self.floor = factor, constants, cost, floor
        self.end, self.mechanism = 1.0, tb.fixed()
        self.solution = SimpleNamespace(
            release_times={}, motion=lambda _: SimpleNamespace(stop_torques={})
        )
        self.made: list[tuple[str, float]] = []

    def record(self, engine: Any, repeats: int = 1) -> RunRecord:
        settings = engine.settings
        name, step = str(settings["integrator"]), engine.timestep
        self.made.append((name, step))
        error = self.constants[name] * self.factor * step**2 + self.floor
        position = Metric(name="position_max", subject="projectile", value=error, unit="m")
        return RunRecord(
            engine="mujoco", engine_version="0", preset="assisted", settings=settings,
            given_hash="", metrics=(position,), steps=1,
            wall_times=(self.cost[name] / step,) * repeats,
        )  # fmt: skip


PLAIN, DEAR = (OptionSet(name, "", "assisted", {"integrator": name}) for name in ("Euler", "RK4"))


def _search(
    constants: tuple[float, float],
    cost: tuple[float, float],
    factors: tuple[float, ...] = (1.0,),
    floor: float = 0.0,
) -> tuple[Search, list[Sweep], list[_Synthetic]]:
    names = (PLAIN.name, DEAR.name)
    made = [
        _Synthetic(
            f, dict(zip(names, constants, strict=True)), dict(zip(names, cost, strict=True)), floor
        )
        for f in factors
    ]
    cases = [TargetedRuns(cast(EngineRuns, trials), Accuracy(position=1e-6)) for trials in made]
    search = Search("mujoco", cases, LADDER)
    return search, search.sweeps((PLAIN, DEAR)), made


def _chosen(search: Search, sweeps: list[Sweep]) -> tuple[OptionSet, float] | None:
    found = cheapest(search.timed(sweeps))
    return None if found is None else (found.sweep.options, found.rung.step)


def test_the_longest_step_that_reaches_it_is_found() -> None:
    search, sweeps, _ = _search((1.0, 9e-5), (1.0, 1.0))  # h^2 <= 1e-6, and 9e-5 h^2
    assert [sweep.reached and sweep.reached.step for sweep in sweeps] == [None, 0.1]
    assert _chosen(search, sweeps) == (DEAR, 0.1)
    search, sweeps, _ = _search((1.0, 1.0), (1.0, 10.0))
    assert sweeps[0].reached is not None and sweeps[0].reached.step == 1e-3
    assert sweeps[0].note == "reached; a longer step does not"


def test_where_all_steps_reach_it_that_is_said() -> None:
    _, sweeps, _ = _search((1e-9, 1e-9), (1.0, 10.0))
    assert sweeps[0].reached is not None and sweeps[0].reached.step == LADDER.steps[0]
    assert sweeps[0].note == "reached at the longest step tried"


def test_the_cheaper_run_wins_though_its_step_is_dearer() -> None:
    search, sweeps, _ = _search((4.0, 0.009), (1.0, 2.0))  # steps 5e-4 and 1e-2
    assert _chosen(search, sweeps) == (DEAR, 1e-2)


def test_of_two_as_cheap_the_plainer_one_is_taken() -> None:
    search, sweeps, _ = _search((1.0, 1.0), (1.1, 1.0))
    assert _chosen(search, sweeps) == (PLAIN, 1e-3)


@pytest.mark.parametrize("noise", [0.9, 1.0, 1.1])
def test_of_two_as_cheap_the_longer_step_is_taken(noise: float) -> None:
    """Their costs are equal: half the steps at twice the cost of one."""
    search, sweeps, _ = _search((1.0, 0.25), (noise, 2.0))
    assert _chosen(search, sweeps) == (DEAR, 2e-3)


def test_what_is_as_cheap_is_a_matter_of_one_factor() -> None:
    rung, sweep = SimpleNamespace(step=1.0), SimpleNamespace()

    def timed(cost: float) -> TimedSweep:
        run = SimpleNamespace(costs=(2 * cost, cost), wall_times=(cost,))
        return TimedSweep(*map(cast, (Any, Any, Any), (sweep, rung, run)))

    first, near, far = timed(0.99 * TIE), timed(1.0), timed(1.01 * TIE)
    assert cheapest([first, near]) is first
    assert cheapest([far, near]) is near
    assert cheapest([first, far], below=TIE) is first and cheapest([far], below=TIE) is None
    assert cheapest([]) is None


def test_every_neighbour_was_measured_at_the_recommended_step() -> None:
    factors = (1.0, *(0.5 + 0.1 * i for i in range(20)), 24.0)
    search, sweeps, made = _search((1.0, 1.0), (1.0, 10.0), factors)
    assert _chosen(search, sweeps) == (PLAIN, 2e-4)  # 24 * h^2 <= 1e-6
    assert sweeps[0].reached is not None
    assert sorted(sweeps[0].reached.trials) == list(range(len(factors)))
    assert all((PLAIN.name, 2e-4) in trials.made for trials in made)


def test_a_set_that_must_be_dearer_is_not_run_on_the_neighbours() -> None:
    _, sweeps, made = _search((1.0, 1.0), (1000.0, 1.0), (1.0, 0.5, 0.7))
    plain = sweeps[0]
    assert plain.reached is None
    assert not [name for trials in made[1:] for name, _ in trials.made if name == PLAIN.name]


def test_a_set_is_not_run_at_steps_that_must_be_dearer() -> None:
    """One reaches it at 0.1 s; the other would need 1e-3 s, a hundred times the cost."""
    search, sweeps, (machine,) = _search((1.0, 9e-5), (1.0, 1.0))
    assert _chosen(search, sweeps) == (DEAR, 0.1)
    assert min(step for name, step in machine.made if name == PLAIN.name) > 1e-3


def test_a_set_that_a_neighbour_makes_dearer_is_given_up() -> None:
    """The machine itself is as cheap with both; a neighbour needs a fifth of the step with one.

    That one waits then, and no other neighbour is run at its shorter step.
    """
    constants = {PLAIN.name: 1.0, DEAR.name: 1.0}
    made = [_Synthetic(f, constants, {PLAIN.name: 1.0, DEAR.name: 1.5}) for f in (1.0, 24.0, 0.9)]
    made[1].constants = {PLAIN.name: 1.0, DEAR.name: 1e-3}
    cases = [TargetedRuns(cast(EngineRuns, trials), Accuracy(position=1e-6)) for trials in made]
    search = Search("mujoco", cases, LADDER)
    sweeps = search.sweeps((PLAIN, DEAR))
    assert sweeps[0].reached is None
    assert PLAIN.name not in {name for name, _ in made[2].made}
    assert _chosen(search, sweeps) == (DEAR, 1e-3)


def test_a_floor_is_given_up_and_named() -> None:
    search, sweeps, _ = _search((1.0, 1.0), (1.0, 1.0), floor=1e-5)
    assert _chosen(search, sweeps) is None
    verdict = recommending.explain(search, sweeps)
    assert verdict.obstacle is Obstacle.FLOOR
    assert (
        "error of the position of 1.0e-05 m on this machine, where 1.0e-06 m are asked"
        in verdict.sentence
    )


def test_what_was_reached_is_told_of_the_best_step_measured() -> None:
    """Steps that the order gave no hope for are measured for the explanation.

    The least of their errors is told.
    """
    search, sweeps, _ = _search((1e6, 1e6), (1.0, 1.0))
    assert all(STEPS[-1] not in sweep.rungs for sweep in sweeps)
    verdict = recommending.explain(search, sweeps)
    assert verdict.obstacle is Obstacle.STEP
    best = 1e6 * STEPS[-1] ** 2
    assert f" at {STEPS[-1]:g} s, has an error of the position of {best:.1e} m" in verdict.sentence
    search, sweeps, made = _search((1e6, 1e6), (1.0, 1.0))
    before = len(made[0].made)
    assert recommending.explain(search, sweeps, further=False).obstacle is Obstacle.STEP
    assert {step for _, step in made[0].made[before:]} <= {*sweeps[0].rungs, *sweeps[1].rungs}


# Texts to paste


@pytest.mark.parametrize("name", ENGINES)
def test_texts_are_what_they_say(name: str) -> None:
    sets = list(option_sets(name))
    assert len(sets) > 0
    for options in sets:
        texts = snippets(name, tb.rolling(), options.preset, options.all_options(5e-4))
        for title, text in texts.items():
            if title == MJCF:
                root = ET.fromstring(f"<mujoco>{text}</mujoco>")
                assert float(root.find("option").get("timestep")) == 5e-4  # type: ignore[union-attr]
            elif "Python" in title:
                ast.parse(text)
        scope: dict[str, Any] = {}
        exec(texts[PYTHON], scope)
        assert scope["engine"] == configured(name, options, 5e-4)


@pytest.mark.parametrize("name", ENGINES)
def test_the_command_gives_the_same_engine(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    import shlex

    from trebucheck.comparisons.runs.study import Study

    made: list[Any] = []
    right = Study.engine

    def engine(study: Study, *arguments: Any) -> Any:
        made.append(right(study, *arguments))
        raise tb.InputError("enough")

    monkeypatch.setattr(Study, "engine", engine)
    sets = list(option_sets(name))
    assert len(sets) > 0
    for options in sets:
        command = snippets(name, tb.rolling(), options.preset, options.all_options(5e-4))
        words = shlex.split(command["trebucheck on the command line"])
        assert words[0] == "trebucheck"
        assert main([*words[1:], "--out", str(tmp_path)]) == 2
        assert made[-1] == configured(name, options, 5e-4)


@pytest.mark.needs("mujoco")
def test_what_mjcf_cannot_say_is_said() -> None:
    sets = {options.name: options for options in option_sets("mujoco")}
    alone, assisted = (
        snippets("mujoco", tb.fixed(), sets[n].preset, sets[n].all_options(1e-3))
        for n in ("settings", "assisted")
    )
    assert MUJOCO_PYTHON not in alone and "Not MJCF" not in alone[MJCF]
    assert "Not MJCF" in assisted[MJCF] and "def preload" in assisted[MUJOCO_PYTHON]
    assert re.search(r'solreflimit="-1000000 -2000"', assisted[MJCF])


# The file


def test_the_schema_is_the_published_one() -> None:
    import trebucheck.comparisons

    path = Path(trebucheck.comparisons.__path__[0]) / "schemas" / "recommend.schema.json"
    assert path.read_text() == schema_text(Advice)


def test_an_engine_that_is_not_here_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    from trebucheck.engines.exudyn.engine import ExudynEngine

    monkeypatch.setattr(ExudynEngine, "is_installed", classmethod(lambda _: False))
    advice = recommend_study(
        Study(["fixed"], ["exudyn"], isolate=False), Accuracy(position=1e-3), neighbours=0
    )
    assert advice.engine("exudyn").choice is None
    assert advice.engine("exudyn").message == "exudyn is not installed here."
    assert "alone" in advice.rule
    jsonschema.validate(json.loads(advice.to_json()), json.loads(schema_text(Advice)))
    assert Advice.from_json(advice.to_json()) == advice


def test_the_command_takes_as_many_neighbours_as_the_function() -> None:
    from trebucheck.cli.app import app

    commands: Any = typer.main.get_command(app)
    defaults = {each.name: each.default for each in commands.commands["recommend"].params}
    assert defaults["neighbours"] == recommending.NEIGHBOURS
