"""What can be turned: per engine, each knob's values, what they mean to it, and what theory expects."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...engines.registry import engine as make
from ...engines.registry import engine_class
from ...models.errors import InputError

Options = Mapping[str, Any]


@dataclass(frozen=True)
class Knob:
    """One option of an engine and preset, with the values it is turned through.

    Where `without` is given, exponents are of the part of the error that the knob makes: the distance, as a function
    of time, from the run without it. So the time step's error, which is there all along, does not hide the law.
    """

    name: str
    """Of the option: what `--knobs` asks for."""
    title: str
    unit: str
    values: tuple[float, ...]
    """From coarse to fine."""
    options: Callable[[float], Options]
    """What a value means to the engine."""
    why: str
    """Where the expected exponent comes from, or why none is expected."""
    expected: float | None = None
    engine: str | None = None
    """None: any."""
    preset: str = "tuned"
    base: Options = field(default_factory=dict[str, Any])
    """Options that stay as they are, over the preset's."""
    without: Options | None = None
    """Options that take the knob's own error out."""
    repeats: int = 1
    """How often a value is timed, unless its run is long."""

    @property
    def requires(self) -> set[str]:
        """Names of the options it needs."""
        return {*self.base, *self.options(self.values[0])}


def _geometric(coarse: float, fine: float, n: int) -> tuple[float, ...]:
    return tuple(float(value) for value in np.geomspace(coarse, fine, n))


_STEPS = tuple(1e-2 / 2**k for k in range(8))  # 1e-2 to 7.8e-5 s: two decades and a little
_STOCK_STEPS = _STEPS[:6]  # down to 3e-4 s: finer ones are no newcomer's, and cost the most
_FEWER_STEPS = _STEPS[:5]
_SECOND_ORDER: dict[str, str] = {
    "mujoco": "releases are located, and the limits' softness is scaled with the step: tc = h, error ~ tc^2",
    "pymunk": "leapfrog read at its own times",
    "exudyn": "trapezoidal rule, index 2",
}
_STOCK: dict[str, tuple[float | None, str]] = {
    "mujoco": (None, "the limits' softness is fixed: it does not fall with the step"),
    "pymunk": (1.0, "positions and speeds half a step apart, joints corrected at a rate that is not the step's"),
    "exudyn": (2.0, "generalised alpha is of second order in positions; its releases are at a step's end"),
}


def _timestep(engine: str, preset: str) -> Knob:
    expected, why = None, "the order of a plug-in is not known beforehand"
    if preset == "tuned" and engine in _SECOND_ORDER:
        expected, why = 2.0, _SECOND_ORDER[engine]
    elif preset == "stock" and engine in _STOCK:
        expected, why = _STOCK[engine]
    return Knob(
        name="timestep", title="time step h", unit="s", options=lambda h: {"timestep": h},
        values=_STEPS if preset == "tuned" else _STOCK_STEPS, expected=expected, why=why,
        engine=engine, preset=preset, repeats=3,
    )  # fmt: skip


def _integrator(name: str) -> Knob:
    return Knob(
        name="integrator", title=f"time step h, {name}", unit="s", values=_FEWER_STEPS,
        options=lambda h: {"timestep": h}, expected=1.0, why="the integrator is of first order",
        engine="mujoco", base={"integrator": name},
    )  # fmt: skip


def _impedance(softness: float) -> Options:
    d = 1.0 - softness
    return {"solimp": [d, d, 0.001, 0.5, 2.0]}


_BIAS_STEP = 4e-3  # [s] a bias below 1e-300 is zero to the engine: shorter steps would leave no room for short lags


def _bias(lag: float) -> Options:
    """The bias at which an error stands for a mean time `lag` beyond the step it arises in.

    Chipmunk undoes the share c = 1 - bias^h of an error in each step, so (1 - c)^k of it are left k steps later,
    which sums up to h (1 - c) / c.
    """
    return {"error_bias": (lag / (lag + _BIAS_STEP)) ** (1.0 / _BIAS_STEP)}


def _radius(dissipation: float) -> Options:
    return {"spectral_radius": (1.0 - dissipation) / (1.0 + dissipation)}


_KNOBS: tuple[Knob, ...] = (
    Knob(
        name="solref", title="limits' time constant tc", unit="s", values=_geometric(3.2e-2, 5e-4, 8),
        options=lambda tc: {"solref": [tc, 1.0]}, expected=2.0, engine="mujoco", base={"timestep": 2.5e-4},
        why="a limit gives way by (1 - d) tc^2 times the acceleration it withholds",
    ),
    Knob(
        name="solimp", title="limits' softness 1 - d", unit="1", values=_geometric(0.3, 1e-4, 8), options=_impedance,
        expected=1.0, engine="mujoco", base={"timestep": 5e-4, "solref": [0.02, 1.0]},
        why="a limit gives way by (1 - d) tc^2 times the acceleration it withholds (d: its impedance)",
    ),
    Knob(
        name="tolerance", title="solver's tolerance", unit="1", values=_geometric(1e-2, 1e-14, 7),
        options=lambda tolerance: {"tolerance": tolerance}, engine="mujoco", base={"timestep": 1e-3},
        without={"tolerance": 1e-30},
        why="Newton's method converges in leaps: the error falls in leaps, too, as one more iteration is made",
    ),
    *map(_integrator, ("Euler", "implicit", "implicitfast", "discrete")),
    Knob(
        name="iterations", title="iterations of the impulse solver", unit="1", values=(1, 3, 10, 30, 100, 300, 1000),
        options=lambda n: {"iterations": round(n)}, engine="pymunk", base={"timestep": 1e-3},
        without={"iterations": 2000}, why="Gauss-Seidel converges geometrically, not by a power, and starts warm",
    ),
    Knob(
        name="error_bias", title="lag of the joints' correction h bias^h / (1 - bias^h)", unit="s",
        values=_geometric(0.3, 3e-4, 13), options=_bias, expected=1.0, engine="pymunk", base={"timestep": _BIAS_STEP},
        without={"error_bias": 0.0},
        why="joints drift at a steady rate, and a share 1 - bias^h of it is undone in a step: the rest lags",
    ),
    Knob(
        name="pivot_mass", title="mass of a body pinned to the ground", unit="of its own", values=_geometric(1, 1e8, 9),
        options=lambda mass: {"pivot_mass": mass}, engine="pymunk", base={"timestep": 1e-3},
        without={"pivot_mass": 1e9}, why="the mass only conditions the solver: its effect should vanish as it grows",
    ),
    Knob(
        name="newton_relative", title="Newton's relative tolerance", unit="1", values=_geometric(1e-2, 1e-14, 7),
        options=lambda tolerance: {"newton_relative": tolerance}, engine="exudyn", base={"timestep": 1e-3},
        without={"newton_relative": 1e-15},
        why="Newton's method converges in leaps: the error falls in leaps, too, as one more iteration is made",
    ),
    Knob(
        name="spectral_radius", title="dissipation (1 - rho) / (1 + rho) of generalised alpha", unit="1",
        values=_geometric(1, 1e-2, 7), options=_radius, expected=2.0, engine="exudyn", preset="stock",
        base={"timestep": 1e-3}, without={"spectral_radius": 1 - 1e-6},
        why="being of second order, the rule has no term linear in the dissipation; beta = (1 + it)^2 / 4 has a square",
    ),
    Knob(
        name="stop_stiffness", title="stiffness k of penalty stops", unit="N m/rad", values=_geometric(1e8, 1e12, 9),
        options=lambda k: {"stop_stiffness": k}, expected=-1.0, engine="exudyn", base={"timestep": 1e-3},
        without={"stop_stiffness": None}, why="a spring gives way by torque / k",
    ),
)  # fmt: skip


def knob_names() -> tuple[str, ...]:
    """What `--knobs` can ask for."""
    return tuple(dict.fromkeys(["timestep", *(knob.name for knob in _KNOBS)]))


def knobs(engine: str, names: list[str] | None = None) -> list[Knob]:
    """Every knob of an engine, or those asked for; knobs whose options its version does not have are left out.

    Raises:
        InputError: there is no such engine or knob.
    """
    for name in names or ():
        if name not in knob_names():
            raise InputError(f"there is no knob {name!r}; there are: {', '.join(knob_names())}.")
    own = [knob for knob in _KNOBS if knob.engine == engine and knob.requires <= option_names(engine)]
    presets = [preset for preset in ("tuned", "stock") if preset in engine_class(engine).presets()]
    every = [*(_timestep(engine, preset) for preset in presets), *own]
    return [knob for knob in every if names is None or knob.name in names]


def option_names(engine: str) -> set[str]:
    """Names of an engine's options."""
    return set(make(engine, "tuned").settings)
