"""Derivatives of a reference motion by every physical number of its mechanism, for users."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.library.registry import Model
from ...models.mechanism import Mechanism
from ...models.problem import StopLaw
from ...models.shown import Shown
from ..motion import problem_of
from ..solution import Solution
from ..solver import solve
from .release import Moment, physical_numbers, release_time_tangent, scaled_directions
from .tangent import StateTangent, marker_tangent, one_sided, sides, state_tangent
from .variational import VariationalEquations

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Derivative:
    """Derivative of one quantity of a motion by one number of its mechanism."""

    quantity: str
    """Kind of quantity: "coordinate", "speed", "x", "y", "vx", "vy", "opening time", "impact time",
    "launch time" or "launch speed"."""
    of: str
    """Coordinate, marker, stop or number of the impact that the quantity is of."""
    quantity_unit: str
    """SI unit of the quantity."""
    number: str
    """Name of the mechanism's number, such as "mass of arm"."""
    number_unit: str
    """SI unit of the number."""
    number_value: float
    """Value of the number at which the derivative is taken [number_unit]."""
    value: float
    """The derivative [quantity_unit per number_unit]; NaN where there is none (see the notes)."""


@dataclass(frozen=True, repr=False)
class DerivativeTable(Shown):
    """Derivatives of a motion at one time, and of its events up to it, by a mechanism's numbers."""

    mechanism: Mechanism
    time: float
    """Time that is held when a number changes: states and markers are read there [s]."""
    derivatives: tuple[Derivative, ...]
    notes: tuple[str, ...] = ()
    """Sentences on derivatives that do not exist, or hold for an increase or a decrease only."""

    def derivative(self, quantity: str, of: str, number: str) -> float:
        """One derivative [unit of the quantity per unit of the number].

        Raises:
            InputError: the table does not have it.
        """
        for row in self.derivatives:
            if (row.quantity, row.of, row.number) == (quantity, of, number):
                return row.value
        quantities = dict.fromkeys(f"{row.quantity} of {row.of}" for row in self.derivatives)
        numbers = dict.fromkeys(row.number for row in self.derivatives)
        raise InputError(
            f"there is no derivative of {quantity!r} of {of!r} by {number!r}; there are "
            f"{', '.join(quantities)} by {', '.join(numbers)}."
        )

    def rows(self) -> Iterator[dict[str, object]]:
        """The derivatives, a mapping a row."""
        return (asdict(row) for row in self.derivatives)

    def to_dataframe(self) -> pd.DataFrame:
        """The derivatives as a pandas data frame."""
        import pandas as pd

        return pd.DataFrame(list(self.rows()))

    def headline(self) -> str:
        """The mechanism, the time and the size of the table."""
        return (
            f"Sensitivities of {self.mechanism.name!r} at {self.time:.6g} s: "
            f"{len(self.derivatives)} derivatives"
        )

    def facts(self) -> Iterator[tuple[str, str]]:
        """The ten derivatives by which one per cent of a number moves its quantity most."""
        known = [row for row in self.derivatives if not np.isnan(row.value)]
        known.sort(key=lambda row: -abs(row.value * row.number_value))
        for row in known[:10]:
            unit = f"{row.quantity_unit} per {row.number_unit or '1'}"
            yield f"{row.quantity} of {row.of} by {row.number}", f"{row.value:.6g} {unit}"
        for note in self.notes:
            yield "note", note


def sensitivities(
    mechanism: Model,
    at: float | None = None,
    *,
    numbers: Iterable[str] | None = None,
    duration: float | None = None,
    stop_law: StopLaw | str | None = None,
) -> DerivativeTable:
    """Differentiate a motion by the numbers of its mechanism, through releases and impacts.

    Nothing is differenced: the variational equations are integrated with the motion. Quantities are
    coordinates, speeds, and positions and velocities of markers at one fixed time; the times at
    which stops open and impacts happen before it; and, if it is the launch's, its time and speed.
    With a number the start changes by the least that keeps loops closed and closed stops touching.

        >>> from trebucheck.reference.sensitivity.sensitivities import sensitivities
        >>> table = sensitivities("pendulum", at=1.0, numbers=["gravity"])
        >>> [(row.quantity, row.of) for row in table.derivatives][:2]
        [('coordinate', 'phi'), ('speed', 'phi')]

    Args:
        mechanism: a mechanism, a problem, a name of the library, or the path of a JSON file.
        at: the time [s]; left out, the launch, or the end of the motion if nothing is launched.
        numbers: names of those to differentiate by, as in the table; all if left out.
        duration: of the motion [s]; as in :func:`..motion.solve`.
        stop_law: "release-once" or "unilateral"; as in :func:`..motion.solve`.

    Returns:
        A row for each quantity and number, in SI units per SI unit.

    Raises:
        InputError: nothing has that name, a value is not valid, or `at` lies outside the motion.
        UnsupportedProblemError: the motion passes a singular position, or does not depend smoothly
            on its numbers; or the mechanism has an element or number that has no derivative here.
        SimulationError: an integrator gave up.
    """
    solution = solve(problem_of(mechanism, duration, stop_law))
    described, launch = solution.problem.mechanism, solution.launch
    if at is None:
        at = solution.segments[-1].end if launch is None else launch.time
    chosen, notes = physical_numbers(described)
    if numbers is not None:
        by_name = {number.name: number for number in chosen}
        chosen = []
        for name in numbers:
            if name not in by_name:
                raise InputError(f"there is no number {name!r}; there are: {', '.join(by_name)}.")
            chosen.append(by_name[name])
    names = tuple(number.name for number in chosen)
    values = np.array([number.value for number in chosen])
    scale, directions = scaled_directions(values, [number.direction for number in chosen])
    equations = VariationalEquations(described, directions, names)
    state = state_tangent(solution, equations, at)
    none = np.isnan(sides(state.kinks, len(chosen)))
    rows: list[Derivative] = []
    for quantity, of, unit, slopes in _quantities(solution, equations, state):
        derivatives = np.where(none, np.nan, slopes / scale)
        for number, value in zip(chosen, derivatives.tolist(), strict=True):
            row = quantity, of, unit, number.name, number.unit, number.value, value
            rows.append(Derivative(*row))
    return DerivativeTable(described, at, tuple(rows), (*notes, *one_sided(state.kinks, names)))


def _quantities(
    solution: Solution, equations: VariationalEquations, state: StateTangent
) -> Iterator[tuple[str, str, str, FloatArray]]:
    """Kind, subject and unit of each quantity, and its derivatives along the directions, (m,)."""
    mechanism = solution.problem.mechanism
    for i, name in enumerate(mechanism.coordinates):
        unit = "rad" if i < len(mechanism.angles) else "m"
        yield "coordinate", name, unit, state.dq[:, i]
        yield "speed", name, f"{unit}/s", state.du[:, i]
    for marker in mechanism.markers:
        point = marker_tangent(equations, state, marker.name)
        for axis, component in enumerate("xy"):
            yield component, marker.name, "m", point.d_position[:, axis]
            yield f"v{component}", marker.name, "m/s", point.d_velocity[:, axis]
    for name, slopes in state.d_release_times.items():
        if not np.isnan(slopes).all():
            yield "opening time", name, "s", slopes
    for i, (_, slopes) in enumerate(state.d_impact_times, start=1):
        yield "impact time", str(i), "s", slopes
    launch = solution.launch
    if launch is not None and launch.time == state.t:
        point = marker_tangent(equations, state)
        d_time = release_time_tangent(solution, equations, state, point, Moment(launch.time))
        d_velocity = point.d_velocity + d_time[:, None] * point.acceleration
        yield "launch time", "projectile", "s", d_time
        yield "launch speed", "projectile", "m/s", d_velocity @ point.velocity / launch.speed
