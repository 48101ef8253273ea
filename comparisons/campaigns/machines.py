"""The machines of a campaign, each from its number and its values, and the study of one."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...engines.protocol import Engine
from ...models.errors import InputError
from ...models.library.registry import (
    library_problem,
    model,
    model_of,
    named_parameters,
    parameters_type,
    varied,
)
from ...models.mechanism import Mechanism
from ...models.problem import Problem, mechanism_of
from ...models.spec import SpecError
from ...models.stacked import stack_of
from ...reference.taylor.expressions import refuse_absence
from ...reference.taylor.numbers import PROJECTILE
from ..compare import FinishedRun, MachineRuns, RunKey
from ..runs.process import Worker
from ..runs.study import Study
from .design import Design, DesignPart
from .random_mechanisms import random_mechanism
from .spec import Campaign, Runs
from .store import CampaignStore


@dataclass(frozen=True)
class EngineCase:
    """An engine, its preset and its step."""

    engine: str
    preset: str
    timestep: float | None = None  # [s]; None: the preset's own


def machine(store: CampaignStore, number: int) -> Mechanism | Problem:
    """A machine of a campaign by its number.

    Raises:
        InputError: there is none of that number, or its values are not valid together.
    """
    if not 0 <= number < store.file.machines:
        raise InputError(
            f"machine {number}: the numbers of {store.campaign.name!r} are 0 to "
            f"{store.file.machines - 1}."
        )
    columns, _ = Design(store.campaign).columns(number, number + 1)
    (row,) = DesignPart(np.array([number]), columns).rows()
    return machine_of(store.campaign, row)


def machine_of(described: Campaign, row: Mapping[str, Any]) -> Mechanism | Problem:
    """The machine of a row, as a problem where the model is one of the library.

    Raises:
        InputError: the values are not valid together; the sentence names them.
    """
    machines = described.machines
    if machines.family is not None:
        return random_mechanism(described.seed + int(row["machine"]), family=machines.family)
    given = machines.model
    assert given is not None
    values = {name: float(row[name]) for name in machines.values}
    if not isinstance(given, str):
        return varied(given, values)[0]
    if values.keys() <= parameters_type(given).model_fields.keys():
        return model_of(given, named_parameters(given, values))
    made, problem = varied(given, values)[0], library_problem(given)
    return made if problem is None else problem.model_copy(update={"mechanism": made})


def parameters(name: str) -> set[str]:
    """Names of the parameters of a named machine or problem."""
    return set(parameters_type(name).model_fields)


def refuse_impossible(described: Campaign) -> None:
    """Refuse what no run could have: an unknown parameter, engine, option or tolerance.

    Raises:
        InputError: there is something of that kind; the sentence names it.
    """
    machines = described.machines
    if machines.model is None:
        given = random_mechanism(described.seed, family=machines.family)
    else:
        given = model(machines.model)
        first = dict.fromkeys(machines.values, 0.0)
        if isinstance(machines.model, str) and first.keys() & parameters(machines.model):
            with suppress(SpecError):  # of the values; a machine's own are judged with it
                named_parameters(machines.model, first)
        else:
            stack_of(given, {name: np.zeros(1) for name in first})
    if described.runs is not None:
        study_of(described.runs, given)
        return
    refuse_absence()
    if given.marker(PROJECTILE) is None:
        raise InputError(
            f"model {given.name!r} has no marker {PROJECTILE!r} that could be launched."
        )


def study_of(runs: Runs, given: Mechanism | Problem, step: float | None = None) -> Study:
    """The study of one machine with the options of a campaign.

    Args:
        runs: what is asked for.
        given: the machine.
        step: of every engine [s]; None: the presets' own.

    Raises:
        InputError: an engine, a preset, an option or a tolerance is not valid.
    """
    return Study.of(
        given,
        runs.engines,
        runs.presets,
        options=runs.options,
        timestep=step,
        until=runs.until,
        stop_law=runs.stop_law,
        tolerances=runs.tolerances,
        diagnose=runs.diagnose,
        timeout=runs.timeout,
    )


def again(
    machine: Sequence[str],
    runs: Runs,
    case: EngineCase,
    given: Mechanism | Problem | None = None,
) -> str:
    """Command that makes a run of a campaign again on its own.

    Args:
        machine: options that name the machine.
        runs: options of the campaign's runs.
        case: engine, preset and step.
        given: the machine where its file is named, which keeps no duration and law of a problem.
    """
    words = ["trebucheck", "compare", *machine, "--engine", case.engine, "--preset", case.preset]
    until, law = runs.until, runs.stop_law
    if isinstance(given, Problem):
        until, law = until or given.duration, law or given.stop_law.value
    if case.timestep is not None:
        words += ["--timestep", repr(case.timestep)]
    if until is not None:
        words += ["--until", str(until)]
    if law is not None:
        words += ["--stop-law", law]
    for name, value in runs.tolerances.items():
        words += ["--tolerance", f"{name}={value}"]
    for name, value in runs.options.items():
        words += ["--option", f"{name}={json.dumps(value)}"]
    return shlex.join(words)


class MovedMachine:
    """A machine that the reference has moved, and on which engines run.

    Args:
        given: the machine.
        runs: what is asked for.
        worker: in which engines run.

    Raises:
        InputError: the end of its motion is not valid, or the reference cannot begin.
        SimulationError: the reference failed.
    """

    def __init__(self, given: Mechanism | Problem, runs: Runs, worker: Worker) -> None:
        self._given, self._runs = given, runs
        self._studies: dict[float | None, Study] = {None: study_of(runs, given)}
        self.compared = MachineRuns(self._studies[None], mechanism_of(given), worker)
        """The machine as `compare` has it."""

    def engine(self, case: EngineCase) -> Engine:
        """Engine of a case, with the step that it has on this machine."""
        study = self._studies.get(case.timestep)
        if study is None:
            study = self._studies[case.timestep] = study_of(self._runs, self._given, case.timestep)
        row = self.compared.machine
        return study.engine_for(row.model, row.scales, study.engine(case.engine, case.preset))

    def run(self, case: EngineCase, engine: Engine) -> FinishedRun:
        """Run the engine of a case, and judge it."""
        return self.compared.run(
            RunKey(self.compared.machine.model, case.engine, case.preset), engine
        )
