"""A file's motion against the reference: metrics of what it gives, a sentence on what it lacks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from ...models.arrays import FloatArray
from ...models.kinematics import Kinematics
from ...models.library.registry import Model, model_of
from ...models.mechanism import Mechanism
from ...models.problem import StopLaw
from ...models.spec import Spec
from ...models.trajectory import PointMotion, Provenance, Trajectory
from ...reference.equations import Equations
from ..diagnosis.case import ENERGIES
from ..diagnosis.diagnose import diagnose_motion, failed_diagnosis
from ..runs.metrics import not_observed
from ..runs.record import machine_row
from ..runs.results import (
    Diagnosis,
    Machine,
    Measured,
    Metric,
    Outcome,
    ResultFile,
    Run,
    verdict_on,
)
from ..runs.runner import Runner
from ..runs.study import REFERENCE, Counter, Progress, Study, one_end
from ..runs.tolerances import judge as judge_run
from .read import GivenImpact, GivenMotion, jumps, merged, read
from .read import metrics as impact_metrics

NOT_GIVEN = "the file does not give it"


class Judgement(Measured, ResultFile):
    """On one file."""

    format: Literal["trebucheck-judgement-1"] = "trebucheck-judgement-1"
    file: str
    sha256: str = Field(description="of the file")
    machine: Machine
    samples: int
    given: tuple[str, ...] = Field(
        description="columns of the file, and what follows from them by kinematics"
    )
    metrics: tuple[Metric, ...]
    diagnosis: Diagnosis | None = Field(
        default=None, description="of a motion that breaks a tolerance"
    )

    @property
    def outcome(self) -> Outcome:
        """The verdict on what is given."""
        return verdict_on(self.metrics)


def judge(
    file: str | Path,
    model: Model = "fixed",
    *,
    parameters: Spec | None = None,
    duration: float | None = None,
    until: str | float | None = None,
    stop_law: StopLaw | str | None = None,
    tolerances: Mapping[str, float | str] | None = None,
    diagnosed: bool = True,
    progress: Progress | None = None,
) -> Judgement:
    """Judge a motion from a file against the reference, in every quantity that it gives.

        >>> import trebucheck as tb
        >>> judgement = tb.judge("mine.csv", "rolling")  # doctest: +SKIP
        >>> judgement.outcome, judgement.given  # doctest: +SKIP

    Args:
        file: CSV with names and units in its first line, or NetCDF (.nc); as `trebucheck judge`
            reads it.
        model: name of a machine or of a problem of the library, path of a mechanism's .json file, a
            mechanism, or a problem.
        parameters: of the named model; its defaults if left out.
        duration: end of the compared motion [s]; a problem's own, else the launch, if left out.
        until: the end in other words: 'launch:MARKER', 'release:STOP', or a time [s].
        stop_law: 'release-once' or 'unilateral'; a problem's own, else 'release-once', if left out.
        tolerances: needs by quantity, as `tb.compare` takes them.
        diagnosed: look for the causes of what is broken, which takes seconds.
        progress: called before each part.

    Raises:
        InputError: the file cannot be read, or is not a motion of the mechanism, or a name or value
            is not valid.
        SimulationError: the reference cannot move it.
    """
    study = Study(
        [model_of(model, parameters)],
        [],
        (),
        stop_law=stop_law,
        until=one_end(duration, until),
        tolerances=tolerances,
        progress=progress,
    )
    return judge_file(Path(file), study, diagnosed)


def judge_file(path: Path, study: Study, diagnosed: bool = True) -> Judgement:
    """Judge a file on the one mechanism of a study; see :func:`judge`.

    Nothing that the file says of itself is believed: mechanism, engine and settings are not read;
    points and energies that it does not give follow from its coordinates and speeds, if it gives
    those, and else are not judged.

    Args:
        path: of the file.
        study: its one mechanism, the end of the compared motion, the law of its stops, and needs.
        diagnosed: look for the causes of what is broken, which takes seconds.

    Raises:
        InputError: the file cannot be read, or is not a motion of the mechanism.
        SimulationError: the reference cannot move it.
    """
    (mechanism,) = study.mechanisms
    given = read(path, mechanism)
    counter = Counter(2, study.progress)
    counter.start("reference")
    runner = Runner(mechanism, None, study.end_of(mechanism), study.law_of(mechanism))
    machine = machine_row(runner, study.needs)
    own = _Motion(given, runner)
    measured = [*runner.measured(own.trajectory), *own.beside_impacts()]
    metrics = tuple(metric if own.tells(metric) else untold(metric) for metric in measured)
    # Of no engine: nobody's claims apply, and an event that is given is taken as located.
    run = Run(
        model=mechanism.name,
        engine=REFERENCE,
        preset="file",
        outcome=Outcome.NOT_JUDGED,
        engine_version="",
        metrics=metrics,
    )
    counter.start("causes")
    judged = run.model_copy(update={"metrics": judge_run(run, machine, study.needs)})
    return Judgement.made_here(
        file=path.name,
        sha256=given.sha256,
        machine=machine,
        samples=len(given.t),
        given=tuple(sorted(own.told)),
        metrics=judged.metrics,
        diagnosis=own.diagnosed(judged.broken) if diagnosed and judged.broken else None,
    )


def untold(metric: Metric) -> Metric:
    """The same as of a file that does not give it."""
    return not_observed(metric.name, metric.subject, metric.unit, NOT_GIVEN)


@dataclass
class _Motion:
    """Make a trajectory of the file's motion; the rest is the reference's, unjudged."""

    given: GivenMotion
    runner: Runner

    def __post_init__(self) -> None:
        self.mechanism: Mechanism = self.runner.mechanism
        self.keep = self.given.t <= self.runner.solution.problem.duration
        self.t = self.given.t[self.keep]
        self.reference = self.runner.reference(self.t)
        self.told: set[str] = {name for name in self.given.values if name != "t"}
        self.told |= {f"release {name}" for name in self.given.releases}
        self.impacts = self._impacts()
        self.told |= {f"impact {impact.stop}" for impact in self.impacts}
        self.trajectory = self._trajectory()

    def _column(self, name: str) -> FloatArray | None:
        found = self.given.values.get(name)
        return None if found is None else found[self.keep]

    def _columns(self, names: list[str], otherwise: FloatArray) -> FloatArray:
        """All or none of them, as :func:`.read.read` sees to."""
        found = [column for column in map(self._column, names) if column is not None]
        return np.stack(found, axis=1) if found else otherwise

    def _trajectory(self) -> Trajectory:
        r, m = self.reference, self.mechanism
        q = self._columns([f"q {name}" for name in m.coordinates], r.q)
        u = self._columns([f"u {name}" for name in m.coordinates], r.u)
        return Trajectory(
            mechanism=m,
            t=self.t,
            q=q,
            u=u,
            markers=self._markers(q, u),
            kinetic_energy=self._energy(
                "kinetic energy", self._moving, Kinematics(m).kinetic_energy(q, u)
            ),
            potential_energy=self._energy(
                "potential energy", self._placed, Equations(m).potential_energy(q)
            ),
            stop_torques={
                s.name: v for s in m.stops if (v := self._column(f"stop {s.name}")) is not None
            },
            release_times={**r.release_times, **self.given.releases},
            impacts=merged(self.impacts),
            joint_reactions={
                j.name: self._columns([f"joint {j.name} {axis}" for axis in "xy"], r.t)
                for j in m.joints
                if f"joint {j.name} x" in self.told
            },
            provenance=Provenance(
                "file", "", "", {}, m.content_hash, float(self.t[-1]), "", 0, 0.0
            ),
        )

    def _impacts(self) -> tuple[GivenImpact, ...]:
        """Impacts as the file names them, or as its speeds show them."""
        names = self.mechanism.coordinates
        if self.given.impacts or not self._moving:
            return self.given.impacts
        q, u = (
            self._columns([f"{kind} {name}" for name in names], self.reference.q) for kind in "qu"
        )
        return tuple(jumps(self.t, q, u, Kinematics(self.mechanism), self.runner.scales.length))

    def beside_impacts(self) -> Iterator[Metric]:
        """Impulses, and speeds before and after."""
        return impact_metrics(
            self.trajectory, self.impacts, self.runner.solution, self.runner.judged_to
        )

    def diagnosed(self, broken: Sequence[Metric]) -> Diagnosis:
        """When and in what it leaves the reference, and which faults account for it."""
        try:
            return diagnose_motion(
                broken,
                self.trajectory,
                self.runner.solution,
                self.runner.end,
                told=frozenset(self._quantities()),
            )
        except Exception as error:  # it solves many changed mechanisms
            return failed_diagnosis(broken, error)

    def _quantities(self) -> Iterator[str]:
        """Quantities that the file itself gives, by the names that a diagnosis has for it.

        Without what follows from that: a mistake in its coordinates would show in all points, as a
        wrong motion does.
        """
        m = self.mechanism
        columns = {
            **{f"position of the {marker.name}": [f"{marker.name} x"] for marker in m.markers},
            **{f"velocity of the {marker.name}": [f"{marker.name} vx"] for marker in m.markers},
            **{f"{stop.effort} of the {stop.name}": [f"stop {stop.name}"] for stop in m.stops},
            **{f"force of the {joint.name}": [f"joint {joint.name} x"] for joint in m.joints},
            **{name: [name] for name in ENERGIES},
            "coordinates": [f"q {name}" for name in m.coordinates],
            "speeds of coordinates": [f"u {name}" for name in m.coordinates],
        }
        yield from (
            name for name, needed in columns.items() if self.given.values.keys() >= set(needed)
        )

    @property
    def _placed(self) -> bool:
        return all(f"q {name}" in self.told for name in self.mechanism.coordinates)

    @property
    def _moving(self) -> bool:
        return self._placed and all(f"u {name}" in self.told for name in self.mechanism.coordinates)

    def _energy(self, name: str, follows: bool, otherwise: FloatArray) -> FloatArray:
        column = self._column(name)
        self.told |= {name} if follows else set()
        return otherwise if column is None else column

    def _markers(self, q: FloatArray, u: FloatArray) -> dict[str, PointMotion]:
        kinematics, markers = Kinematics(self.mechanism), dict[str, PointMotion]()
        for marker in self.mechanism.markers:
            row = kinematics.point(marker.body, marker.point)
            expected = self.reference.marker(marker.name)
            place = kinematics.position(row, q) if self._placed else expected.position
            speed = kinematics.velocity(row, q, u) if self._moving else expected.velocity
            self.told |= {f"{marker.name} x"} if self._placed else set()
            self.told |= {f"{marker.name} vx"} if self._moving else set()
            names = [[f"{marker.name} {v}{axis}" for axis in "xy"] for v in ("", "v")]
            markers[marker.name] = PointMotion(
                self._columns(names[0], place), self._columns(names[1], speed)
            )
        return markers

    def tells(self, metric: Metric) -> bool:
        """Whether the file gives what a metric is of."""
        return all(each in self.told for each in self._needed(metric))

    def _needed(self, metric: Metric) -> list[str]:
        name, subject = metric.name, metric.subject
        closed = [f"release {stop.name}" for stop in self.mechanism.stops if stop.closed]
        thrown = self.runner.until.thrown
        energies = ["kinetic energy", "potential energy"]
        state = [f"{kind} {each}" for kind in "qu" for each in self.mechanism.coordinates]
        placed = state[: len(state) // 2]
        needed = {
            "position_max": [f"{subject} x"],
            "position_rms": [f"{subject} x"],
            "velocity_max": [f"{subject} vx"],
            "angle_max": [f"q {subject}"],
            "slide_max": [f"q {subject}"],
            "angular_speed_max": [f"u {subject}"],
            "slide_speed_max": [f"u {subject}"],
            "launch_time": [f"{thrown} x", f"{thrown} vx", *closed],
            "launch_speed": [f"{thrown} x", f"{thrown} vx", *closed],
            "release_time": [f"release {subject}"],
            "impact_time": [f"impact {subject}"],
            "impact_speed": [
                f"u {subject}" if subject in self.mechanism.coordinates else f"{subject} vx"
            ],
            "kinetic_energy_max": energies[:1],
            "potential_energy_max": energies[1:],
            "energy_balance": energies,
            "energy_drift": energies,
            "energy_drift_kinetic": energies,
            "horizontal_momentum": state,
            "stop_gap_held": [*placed, f"release {subject}"],
            "stop_penetration": placed,
            "complementarity": [*placed, f"stop {subject}"],
            "stop_torque_max": [f"stop {subject}"],
            "joint_reaction_max": [f"joint {subject} x"],
        }
        return needed.get(name, [])
