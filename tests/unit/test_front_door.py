"""What `import trebucheck` gives, and what it must not cost."""

from __future__ import annotations

import doctest
import importlib
import subprocess
import sys

import pytest
import trebucheck as tb

ENGINE_LIBRARIES = ("mujoco", "pymunk", "exudyn")


def _python(code: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.mark.parametrize(
    "code",
    [
        "import trebucheck",
        "import trebucheck as tb; tb.engines(); [tb.engine(name) for name in tb.engines()]",
        "import contextlib, io, trebucheck.__main__ as m; "
        "contextlib.redirect_stdout(io.StringIO()).__enter__(); m.main(['--help']); m.main(['compare', '--help'])",
    ],
    ids=["import", "engines", "help"],
)
def test_no_engine_library_is_loaded(code: str) -> None:
    loaded = _python(
        f"import sys; {code}; print([n for n in {ENGINE_LIBRARIES} if n in sys.modules], file=sys.stderr)"
    )
    assert loaded == ""
    check = f"import sys; {code}; assert not [n for n in {ENGINE_LIBRARIES} if n in sys.modules]"
    _python(check)


@pytest.mark.parametrize(
    "first",
    [
        "tb.engine('reference')",
        "tb.engines()",
        "import trebucheck.engines.registry",
        "from trebucheck import engines",
    ],
)
def test_engines_can_be_called_whatever_was_imported_first(first: str) -> None:
    assert (
        _python(f"import trebucheck as tb; {first}; print('reference' in tb.engines())") == "True"
    )


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
    assert status.presets == ("stock", "tuned")
    assert status.capabilities.formulation


@pytest.mark.parametrize("preset", ["stock", "tuned"])
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
    with pytest.raises(tb.InputError, match="no preset 'best'; there are: stock, tuned"):
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
