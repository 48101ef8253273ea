"""What `import trebucheck` gives, and what it must not cost."""

from __future__ import annotations

import ast
import doctest
import importlib
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from conftest import again
from trebucheck.comparisons.runs.study import Study
from trebucheck.engines.presets import PRESETS

ENGINE_LIBRARIES = ("mujoco", "pymunk", "exudyn")


def _python(code: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.strip()


STEPS = (
    "import trebucheck",
    "import trebucheck as tb; tb.engines(); [tb.engine(name) for name in tb.engines()]",
    "import contextlib, io, trebucheck.__main__ as m",
    "contextlib.redirect_stdout(io.StringIO()).__enter__(); m.main(['--help'])",
    "m.main(['compare', '--help'])",
)


def test_no_engine_library_is_loaded() -> None:
    """By any of these steps, one after the other in one process."""
    code = ["import sys"]
    for step in STEPS:
        loaded = f"[n for n in {ENGINE_LIBRARIES} if n in sys.modules]"
        code += [step, f"assert not {loaded}, ({step!r}, {loaded})"]
    _python("\n".join([*code, "assert 'trebucheck' in sys.modules"]))


def test_lists_load_no_library_of_an_engine_or_of_integration() -> None:
    """Neither what engines are made of, nor the parts of SciPy, which take longer than a list."""
    listed = (["engines"], ["models", "list"], ["problems"], ["models", "path", "fixed"])
    heavy = (*ENGINE_LIBRARIES, "scipy.integrate", "scipy.optimize", "scipy.interpolate")
    code = ["import contextlib, io, sys, trebucheck.__main__ as m"]
    code += ["out = io.StringIO(); contextlib.redirect_stdout(out).__enter__()"]
    code += [f"assert m.main({arguments}) == 0" for arguments in listed]
    code += [f"loaded = [n for n in {heavy} if n in sys.modules]", "assert not loaded, loaded"]
    code += ["assert 'mujoco' in out.getvalue() and 'pendulum' in out.getvalue()"]
    _python("\n".join(code))


@pytest.mark.parametrize(
    "first",
    [
        "tb.engine('reference')",
        pytest.param("tb.engines()", marks=again),
        pytest.param("import trebucheck.engines.registry", marks=again),
        "from trebucheck import engines",
        pytest.param("from trebucheck.engines.registry import engines", marks=again),
        "import trebucheck.engines as package; assert package.registry",
    ],
)
def test_engines_is_a_function_whatever_was_imported_first(first: str) -> None:
    code = (
        f"import inspect, trebucheck as tb; {first}; import trebucheck.engines.registry as "
        f"registry; "
        "import trebucheck; assert trebucheck.engines.registry is registry; "
        "print(inspect.isfunction(tb.engines) and 'reference' in tb.engines())"
    )
    assert _python(code) == "True"


def test_type_checkers_see_the_same_names() -> None:
    stub = ast.parse((Path(tb.__file__).parent / "__init__.pyi").read_text())
    imported = {
        alias.name for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    imported |= {node.name for node in stub.body if isinstance(node, ast.FunctionDef)}
    (listed,) = (ast.literal_eval(node.value) for node in stub.body if isinstance(node, ast.Assign))
    assert imported == set(tb.__all__)
    assert sorted(listed) == sorted(tb.__all__)
    for node in stub.body:
        if isinstance(node, ast.ImportFrom) and node.module != "version":
            assert all(tb._HOMES[alias.name] == node.module for alias in node.names)  # pyright: ignore


MODELS: dict[str, Callable[[Path], Any]] = {
    "name": lambda _: "pendulum",
    "number": lambda _: tb.problems()["pendulum"].number,
    "path": lambda folder: folder / "pendulum.json",
    "path as text": lambda folder: str(folder / "pendulum.json"),
    "mechanism": lambda _: tb.model("pendulum"),
    "problem": lambda _: tb.problem("pendulum"),
    "list": lambda _: ["pendulum"],
}
ENGINES: dict[str, Any] = {
    "name": "mujoco",
    "list": ["mujoco"],
    "object": tb.engine("mujoco"),
    "objects": (tb.engine("mujoco"),),
}
SHORT: dict[str, Any] = {"duration": 0.1, "isolate": False}


def _run_of(comparison: Any) -> tuple[str, str, str, str]:
    (run,) = comparison.results.runs
    return run.engine, run.preset, str(run.outcome), comparison.results.machines[0].mechanism_hash


@pytest.mark.parametrize("kind", MODELS)
def test_a_model_is_taken_however_it_is_given(kind: str, tmp_path: Path) -> None:
    (tmp_path / "pendulum.json").write_text(tb.model("pendulum").to_json())
    given = MODELS[kind](tmp_path)
    expected = ("mujoco", "assisted", "agrees", tb.model("pendulum").content_hash)
    assert _run_of(tb.compare(given, "mujoco", "assisted", **SHORT)) == expected
    if kind != "list":
        assert tb.model(given) == tb.model("pendulum")
        assert tb.mjcf_names(given) == tb.mjcf_names("pendulum")
        assert tb.solve(given, 0.2).q([0.0, 0.1]).shape == (2, 1)
        assert tb.check("mujoco", given, **SHORT).outcome == "agrees"
        assert tb.mjcf(given, keyframes=False, timestep=1e-3).startswith("<")


def test_parameters_and_the_start_of_a_model_are_keywords(tmp_path: Path) -> None:
    pendulum = tb.model("double-pendulum")
    assert pendulum.start == (-0.5, -0.5)
    assert tb.model("double-pendulum", start=1.0).start == (1.0, 1.0)  # its parameter
    assert tb.model("double-pendulum", start=[1.0, 0.2]).start == (1.0, 0.2)
    moving = tb.model("double-pendulum", start={"a2": 2.0}, start_speeds={"a1": 3.0}, length=2.0)
    assert (moving.start, moving.start_speeds) == ((-0.5, 2.0), (3.0, 0.0))
    assert moving.bodies[0].centre == (1.0, 0.0)
    (tmp_path / "own.json").write_text(moving.to_json())
    for given in (moving, tmp_path / "own.json"):
        assert tb.model(given, start=np.array([0.1, 0.2])).start == (0.1, 0.2)
        assert tb.model(given) == moving
    long = tb.TrebuchetParameters(l1=9.5, l2=4.2)
    assert tb.model("fixed", tb.TrebuchetParameters(l2=4.2), l1=9.5) == tb.fixed(long)


@pytest.mark.parametrize("kind", ENGINES)
def test_an_engine_is_taken_however_it_is_given(kind: str) -> None:
    found = tb.compare("pendulum", ENGINES[kind], presets="assisted", **SHORT)
    assert _run_of(found)[:3] == ("mujoco", "assisted", "agrees")


@pytest.mark.parametrize(
    ("how", "settings"),
    [
        ({"engines": tb.engine("pymunk", iterations=7)}, {"iterations": 7}),
        ({"engines": "pymunk", "options": {"iterations": 7}}, {"iterations": 7}),
        ({"engines": "pymunk", "options": {"pymunk.iterations": 7}}, {"iterations": 7}),
        ({"engines": "pymunk", "timestep": 2e-3}, {"timestep": 2e-3}),
        ({"engines": "pymunk", "options": {"timestep": 2e-3}}, {"timestep": 2e-3}),
        ({"engines": tb.engine("pymunk", timestep=2e-3)}, {"timestep": 2e-3}),
        (
            {"engines": tb.engine("pymunk", iterations=7), "options": {"pymunk.iterations": 8}},
            {"iterations": 8},
        ),
    ],
)
def test_options_are_given_the_same_way_everywhere(
    how: dict[str, Any], settings: dict[str, Any]
) -> None:
    (run,) = tb.compare("pendulum", presets="assisted", **how, **SHORT).results.runs
    assert settings.items() <= run.settings.items()
    study = Study.of("pendulum", presets="assisted", **how)
    assert settings.items() <= study.engine("pymunk", "assisted").settings.items()


def test_an_engine_given_as_an_object_brings_its_preset() -> None:
    study = Study.of("fixed", [tb.engine("mujoco", "default"), tb.engine("pymunk", "default")])
    assert (study.engines, study.presets) == (("mujoco", "pymunk"), ("default",))
    assert Study.of("fixed", "mujoco").presets == PRESETS


def test_throws_and_certificates_take_names() -> None:
    assert tb.throw("fixed").flight.range == tb.throw(tb.fixed()).flight.range
    assert tb.check(tb.engine("mujoco"), "fixed", isolate=False).outcome == "agrees"


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: tb.compare("p"), "there is no model 'p'"),
        (lambda: tb.compare("fixed", "m"), "no engine 'm'.*; there are: reference, mujoco"),
        (
            lambda: tb.compare("fixed", "mujoco", "t"),
            "no preset 't'; there are: default, settings, assisted",
        ),
        (lambda: tb.throw("f"), "there is no model 'f'.*; there are: fixed, rolling"),
        (lambda: tb.mjcf_names("f"), "there is no model 'f'.*; there are: fixed, rolling"),
        (lambda: tb.certify("f"), "there is no model 'f'.*; there are: fixed, rolling"),
        (lambda: tb.problem("fixed"), "there is no problem 'fixed'"),
        (lambda: tb.problems("x"), "no problem has the tag 'x'; there are: "),
        (lambda: tb.model(3), "3 is no model; a name, "),  # pyright: ignore
        (lambda: tb.compare(3), "3 is no model; a name, "),  # pyright: ignore
        (lambda: tb.compare("fixed", [3]), "3 is no engine; there are: reference, "),  # pyright: ignore
        (lambda: tb.model(["fixed", "rolling"]), "2 models are given; one is needed"),  # pyright: ignore
        (lambda: tb.model("double-pendulum", strat=1.0), "'strat' .did you mean 'start'.*has: N,"),
        (lambda: tb.model("double-pendulum", start=(1.0,)), "1 values; .* needs 2: a1, a2"),
        (lambda: tb.model("double-pendulum", start={"b": 1.0}), "'b'; there are: a1, a2"),
        (lambda: tb.model("double-pendulum", start=(1.0, "x")), "start.1 = 'x'"),  # pyright: ignore
        (lambda: tb.model("double-pendulum", start_speeds=3.0), "start_speeds has 1 values"),
        (lambda: tb.model("fixed", start=(0.0, 1.0, 2.0)), "'hanger rest' is closed, but"),
        (lambda: tb.model(tb.fixed(), l1=9.0), "l1: only a named model has parameters"),
        (lambda: tb.mjcf("fixed", l9=1.0), "model 'fixed' has no parameter 'l9'.*has: l1, l2"),
        (lambda: tb.check("mujoco", "absent.json"), "absent.json"),
        (lambda: tb.explain("fixed", "mujoco", "t"), "no preset 't'; there are: "),
        (lambda: tb.converge("fixed", "mujoco", knobs="k"), "'k'"),
        (
            lambda: tb.compare("fixed", tb.engine("mujoco"), "default"),
            "presets = default, but the engines given have assisted",
        ),
        (
            lambda: tb.explain("fixed", timestep=1e-3, options={"timestep": 2e-3}),
            "timestep = 0.001 s and options = .* differ",
        ),
        (lambda: tb.matrix([]), "no file"),
        (lambda: tb.solve("p"), "there is no model 'p'"),
        (lambda: tb.sensitivities("p"), "there is no model 'p'"),
        (lambda: tb.judge("absent.csv"), "absent.csv"),
    ],
)
def test_what_is_not_valid_is_said_in_one_sentence(
    call: Callable[[], object], sentence: str
) -> None:
    with pytest.raises(tb.InputError, match=sentence):
        call()


def test_every_public_name_is_there() -> None:
    assert set(tb.__all__) <= set(dir(tb))
    for name in tb.__all__:
        assert getattr(tb, name) is not None


def test_unknown_names_are_attribute_errors() -> None:
    with pytest.raises(AttributeError, match="nonsense"):
        tb.nonsense  # noqa: B018


@pytest.mark.parametrize("name", ["reference", "mujoco", "pymunk", "exudyn"])
def test_built_in_engines_are_known(name: str) -> None:
    status = tb.engines()[name]
    assert status.presets == (("default", "assisted") if name == "reference" else PRESETS)
    assert status.capabilities.formulation


@pytest.mark.parametrize("preset", ["default", "assisted"])
@pytest.mark.parametrize("name", ["reference", "mujoco", "pymunk", "exudyn"])
@pytest.mark.parametrize("value", [0.0, -1e-3, float("nan"), float("inf"), "fast", 2.0])
def test_a_step_is_positive_finite_and_below_a_second(
    name: str, preset: str, value: object
) -> None:
    with pytest.raises(tb.InputError, match="timestep = "):
        tb.engine(name, preset, timestep=value)


def test_unknown_engines_presets_and_options_are_named() -> None:
    with pytest.raises(tb.InputError, match=r"no engine 'mujoko' \(did you mean 'mujoco'\?\)"):
        tb.engine("mujoko")
    with pytest.raises(tb.InputError, match="no preset 'best'; there are: default, "):
        tb.engine("reference", "best")
    with pytest.raises(tb.InputError, match="colour is not a field it has"):
        tb.engine("reference", colour="red")


def test_steps_that_cannot_be_taken_are_refused() -> None:
    with pytest.raises(
        tb.InputError, match=r"timestep = 0\.5 s must not be longer than the duration"
    ):
        tb.engine("reference", timestep=0.5).simulate(tb.Problem(tb.fixed(), duration=0.1))
    with pytest.raises(tb.InputError, match="steps of"):
        tb.engine("reference", timestep=1e-12).simulate(tb.Problem(tb.fixed(), duration=1.0))


@pytest.mark.parametrize("module", ["trebucheck", "trebucheck.reference.throw.throw"])
def test_examples_in_docstrings_are_true(module: str) -> None:
    failed, tried = doctest.testmod(importlib.import_module(module))
    assert tried > 0
    assert failed == 0


OLD_NAMES_OF_FUNCTIONS = """
from comparisons.compare.stored import stored
from comparisons.diff.data import data
from comparisons.judge.read import read
from comparisons.problems.check import check
"""


def test_an_old_module_s_name_does_not_hide_the_function_of_that_name() -> None:
    code = ["import importlib, warnings", 'warnings.simplefilter("ignore")']
    for line in OLD_NAMES_OF_FUNCTIONS.split("\n")[1:-1]:
        old, name = line.removeprefix("from ").split(" import ")
        new = old.rpartition(".")[0]
        code.append(f"""
new = importlib.import_module("trebucheck.{new}")
function = new.{name}
importlib.import_module("trebucheck.{old}")
assert callable(new.{name})
from trebucheck.{old} import {name}
assert {name} is function is new.{name}
""")
    assert _python("\n".join(code)) == ""
