"""Files of programs of one's own: the rule and the step that moved them are named, or their fault.

The programs are written here, by textbook formulas in plain NumPy, and so are the equations of
motion of two rods: nothing of what is tested takes part in them.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.judge import Judgement
from trebucheck.comparisons.runs.results import Outcome

MODEL, END = "double-pendulum", 2.0  # [s]
Rate = Callable[[Any, Any], Any]
Step = Callable[[Rate, float, Any, Any], tuple[Any, Any]]


def _accelerations(inertia: float = 1 / 3, gravity: float = 9.81) -> Rate:
    """Accelerations of two uniform rods of 1 m and 1 kg by their clockwise angles from the x axis.

    Lagrange's equations, with y = -sin(a) along a rod.

    Args:
        inertia: of the second rod about its pin [kg m^2].
        gravity: [m/s^2].
    """

    def rate(q: Any, u: Any) -> Any:
        (a, b), (v, w) = q, u
        c, s = np.cos(a - b) / 2, np.sin(a - b) / 2
        matrix = np.array([[4 / 3, c], [c, inertia]])
        force = [1.5 * gravity * np.cos(a) - s * w**2, 0.5 * gravity * np.cos(b) + s * v**2]
        return np.linalg.solve(matrix, np.array(force))

    return rate


def _euler(f: Rate, h: float, q: Any, u: Any) -> tuple[Any, Any]:
    return q + h * u, u + h * f(q, u)


def _semi_implicit(f: Rate, h: float, q: Any, u: Any) -> tuple[Any, Any]:
    new = u + h * f(q, u)
    return q + h * new, new


def _heun(f: Rate, h: float, q: Any, u: Any) -> tuple[Any, Any]:
    there = q + h * u, u + h * f(q, u)
    return q + h * (u + there[1]) / 2, u + h * (f(q, u) + f(*there)) / 2


def _runge_kutta(f: Rate, h: float, q: Any, u: Any) -> tuple[Any, Any]:
    def g(y: Any) -> Any:
        return np.concatenate([y[2:], f(y[:2], y[2:])])

    y = np.concatenate([q, u])
    a = g(y)
    b = g(y + h / 2 * a)
    c = g(y + h / 2 * b)
    y = y + h / 6 * (a + 2 * b + 2 * c + g(y + h * c))
    return y[:2], y[2:]


def _judged(folder: Path, step: Step, h: float, every: int, rate: Rate) -> Judgement:
    """Judgement of a file with every so many of a program's samples."""
    q, u = np.array([-0.5, -0.5]), np.zeros(2)
    lines = ["t [s],q a1 [rad],q a2 [rad]"]
    for k in range(round(END / h) + 1):
        if k % every == 0:
            lines.append(",".join(repr(float(value)) for value in (k * h, *q)))
        q, u = step(rate, h, q, u)
    file = folder / "own.csv"
    file.write_text("\n".join(lines) + "\n")
    return tb.judge(file, MODEL, duration=END)


@pytest.mark.parametrize(
    ("step", "name", "h", "every"),
    [
        (_euler, "explicit Euler", 1e-3, 10),
        (_euler, "explicit Euler", 5e-4, 20),
        (_semi_implicit, "semi-implicit Euler", 2e-3, 5),
        (_semi_implicit, "semi-implicit Euler", 1 / 240, 4),
        (_heun, "Heun", 2e-2, 1),
        (_runge_kutta, "Runge and Kutta", 0.1, 1),
    ],
)
def test_the_rule_and_the_step_of_a_program_are_named(
    step: Step, name: str, h: float, every: int, tmp_path: Path
) -> None:
    judgement = _judged(tmp_path, step, h, every, _accelerations())
    assert judgement.outcome is Outcome.DISAGREES and judgement.diagnosis is not None
    first = judgement.diagnosis.causes[0]
    assert first.name == "time step of an integrator"
    assert name in first.amount and first.explained > 0.99
    found = float(first.amount.rpartition(", ")[2].removesuffix(" s"))
    assert found == pytest.approx(h, rel=1e-3)


def test_a_wrong_number_in_a_program_is_not_blamed_on_its_step(tmp_path: Path) -> None:
    judgement = _judged(tmp_path, _runge_kutta, 5e-3, 4, _accelerations(inertia=0.34))
    assert judgement.outcome is Outcome.DISAGREES and judgement.diagnosis is not None
    assert "inertia of the rod 2" in judgement.diagnosis.causes[0].name


def test_a_right_program_agrees(tmp_path: Path) -> None:
    """So the equations here are those of the model."""
    judgement = _judged(tmp_path, _runge_kutta, 5e-3, 4, _accelerations())
    assert judgement.outcome is Outcome.AGREES
