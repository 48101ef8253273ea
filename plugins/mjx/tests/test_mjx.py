"""MJX against the reference, and its measured order."""

import subprocess
import sys

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.reference.solver import solve

FREE_SWING = tb.fixed().model_copy(update={"stops": ()})


def _run(problem: tb.Problem, preset: str, step: float, **options: str) -> tuple[float, float]:
    """Greatest distance of a marker from where it should be [m]; greatest error of a reaction, of
    the greatest."""
    found = tb.engine("mjx", preset, timestep=step, **options).simulate(problem)
    truth = solve(problem).trajectory(found.t)
    forces = [np.abs(f - truth.joint_reactions[n]).max() for n, f in found.joint_reactions.items()]
    peak = max(np.abs(force).max() for force in truth.joint_reactions.values())
    points = [
        np.abs(m.position - truth.markers[name].position).max() for name, m in found.markers.items()
    ]
    return float(max(points)), float(max(forces) / peak)


def test_single_precision_has_its_floor() -> None:
    problem = tb.Problem(FREE_SWING, duration=1.0)
    positions, forces = _run(problem, "settings", 2e-3, precision="single")
    assert 1e-7 < positions < 1e-3 and forces < 1e-3


def test_nothing_is_said_of_warp_and_what_is_printed_stays(
    capsys: pytest.CaptureFixture[str],
) -> None:
    from trebucheck_toolkit.jax_on_cpu import without_words_on_warp

    with without_words_on_warp():
        print("Failed to import warp: No module named 'warp'")
        print("a user's line")
    assert capsys.readouterr().out == "a user's line\n"
    code = "import trebucheck_mjx.build"
    assert (
        subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, text=True
        ).stdout
        == ""
    )
