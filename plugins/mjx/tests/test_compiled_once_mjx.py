"""What JAX compiles is compiled once a model: for runs of every length, and their readings."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.library.registry import library_problem
from trebucheck_mjx import alone
from trebucheck_mjx.build import jax
from trebucheck_mjx.engine import MjxEngine


def _pendulum(duration: float) -> tb.Problem:
    pendulum = library_problem("pendulum", None)
    assert pendulum is not None
    return pendulum.model_copy(update={"duration": duration})


@pytest.mark.parametrize("preset", ["default", "settings", "assisted"])
def test_a_longer_run_compiles_nothing_again(preset: str) -> None:
    engine = MjxEngine.presets()[preset]()
    short = engine.simulate(_pendulum(0.01))
    compiled: list[str] = []

    def note(name: str, _: float, **__: str | int) -> None:
        if name == "/jax/core/compile/backend_compile_duration":
            compiled.append(name)

    jax.monitoring.register_event_duration_secs_listener(note)
    try:
        long = engine.simulate(_pendulum(0.5))
        assert not compiled
        jax.jit(lambda x: x + len(compiled))(1.0)  # it would be noted
        assert compiled
    finally:
        jax.monitoring.unregister_event_duration_listener(note)
    assert len(long.t) > alone.CHUNK
    assert np.array_equal(long.q[: len(short.t) - 1], short.q[:-1])


@pytest.mark.parametrize("given", [None, "elsewhere"])
def test_compiled_programs_are_kept_in_the_users_cache_or_where_the_user_says(
    tmp_path: Path, given: str | None
) -> None:
    told = {"XDG_CACHE_HOME": str(tmp_path)}
    if given is not None:
        told["JAX_COMPILATION_CACHE_DIR"] = str(tmp_path / given)
    code = "import trebucheck_mjx.build, jax; print(jax.config.jax_compilation_cache_dir)"
    kept = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, env=kept | told
    )
    assert Path(done.stdout.strip()) == tmp_path / (given or "trebucheck/jax")
