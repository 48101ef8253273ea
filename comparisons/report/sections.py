"""Sections that several reports share, and the reports of a single run and of a certificate."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from ...models.mechanism import Mechanism
from ...models.trajectory import Trajectory
from ...reference.certification.certificate import Certificate, Figure
from ..runs.balance import sampled_balance
from ..runs.distance import Farthest
from ..runs.results import Machine, Metric, ResultFile, Run, SingularPosition
from .document import (
    Block,
    Code,
    Document,
    Fold,
    Heading,
    Listing,
    Note,
    Table,
    Text,
    columns,
    page_only,
    ranked,
    table,
)
from .numbers import format_number, format_settings, sentence

Settings = tuple[str, str, str, Mapping[str, object]]
"""Machine, engine (and what else names the run), version, and settings."""


_HORIZON = (
    "there a hundred-thousandth of a body's inertia, or a millionth of the start, moves the mechanism by a thousandth "
    "of its size, and any two integrators differ"
)
"""What is so beyond the predictability horizon."""
_LISTED = 5  # singular positions whose times are stated
_BEYOND = "beyond it only invariants and the time of first parting are judged"


def compared_time(
    launch_time: float | None, compared_to: float | None, judged_to: float | None
) -> str:
    """Until when motions are compared, and why not longer.

    Args:
        launch_time: of the reference [s]; None if it does not launch by the end.
        compared_to: end of the compared motion [s]; None: the launch.
        judged_to: that, or the predictability horizon if earlier [s]; None: the end.
    """
    end = compared_to or launch_time or 0.0
    launches = launch_time is not None and launch_time >= end * (1 - 1e-9)
    text = (
        f"Compared from the start to {f'the launch at {end:.6f}' if launches else f'{end:.6g}'} s."
    )
    if judged_to is None or judged_to >= end:
        return text
    return f"{text} Nothing is compared beyond {judged_to:.6g} s: {_HORIZON}."


def predictable(machine: Machine) -> str:
    """The predictability horizon, how the stretching comes to it, and singular positions on the way."""
    return " ".join([_horizon(machine), *_singular_positions(machine.singular_positions)])


def _singular_positions(passed: Sequence[SingularPosition]) -> Iterator[str]:
    if passed:
        times = ", ".join(f"{each.time:.9g}" for each in passed[:_LISTED])
        more = f" and {len(passed) - _LISTED} times more" if len(passed) > _LISTED else ""
        uncertain, adds = (
            max(p.time_uncertainty for p in passed),
            max(p.uncertainty for p in passed),
        )
        yield (
            "The reference passes singular positions, in which its constraints lose rank, on the smooth branch of its "
            f"motion: at {times} s{more} (uncertain by {uncertain:.1g} s); each adds at most {adds:.1g} of the longest "
            "arm to the uncertainty behind it. Beside them no forces are compared."
        )


def _horizon(machine: Machine) -> str:
    text = f"Predictable to the end, {machine.compared_to:.6g} s."
    if machine.judged_to < machine.compared_to:
        text = f"Predictable until {machine.judged_to:.6g} s; {_BEYOND}: {_HORIZON}."
    found = machine.predictability
    if found is None:
        return text
    rows = zip(found.times, found.parameters, found.start, strict=True)
    grown = ", ".join(f"{_factor(p)} ({_factor(s)}) by {t:.4g} s" for t, p, s in rows)
    return f"{text} Relative errors of parameters (of the start) are stretched {grown}."


def _factor(stretched: float | None) -> str:
    return "without limit" if stretched is None else f"{stretched:.2g} times"


def partings(machine: Machine, runs: Iterable[Run]) -> Iterator[Text]:
    """When each run's motion leaves the reference, where that is compared further than it can be predicted."""
    if machine.judged_to < machine.compared_to:
        found = [(run.label, run.metric("first_parting"), run.metric("base_error")) for run in runs]
        times = (
            f"{label} {_parting(time, error)}" for label, time, error in found if time and error
        )
        yield Text(
            f"First parting from the reference, by a thousandth of a scale: {', '.join(times) or 'none'}."
        )


def _parting(time: Metric, base_error: Metric) -> str:
    if time.value is None:
        return "not by the end"
    return f"at {time.value:.4g} s (base error {format_number(base_error.value)})"


def provenance(
    result: ResultFile, runs: Iterable[Settings], mechanisms: Sequence[tuple[str, Mechanism]]
) -> tuple[Block, ...]:
    """The end of a page: versions, the settings of each run, and each machine's mechanism."""
    software = f"trebucheck {result.trebucheck_version}, Python {result.python_version}, {result.platform}."
    rows = [
        (model, label, version, format_settings(settings))
        for model, label, version, settings in runs
    ]
    command = (
        []
        if result.command is None
        else [page_only(Code("The command that makes this again", result.command))]
    )
    return (
        Heading("Provenance", 2),
        Note(software),
        *(
            []
            if result.jobs == 1
            else [Text(f"Wall times: {result.jobs} runs at once, which disturb each other.")]
        ),
        *command,
        table("machine | engine | version | settings", rows, "Settings of every run", "page"),
        *(mechanism_as_data(model, mechanism) for model, mechanism in mechanisms),
    )


def mechanism_as_data(model: str, mechanism: Mechanism) -> Fold:
    """A mechanism's JSON behind its hash."""
    title = f"{model}: the mechanism as JSON, hash {mechanism.content_hash[:16]}"
    return Fold(title, (Code("", mechanism.to_json()),))


def certified_figures(figures: Iterable[Figure], caption: str) -> Table:
    """One line a figure: value, uncertainty, unit."""
    rows = [(figure.label, *figure.texts, figure.unit) for figure in figures]
    heads = ranked(columns("figure | value | uncertainty | unit"), value=0, uncertainty=0, unit=0)
    return table(heads, rows, caption)


def certificate_report(certificate: Certificate) -> Document:
    """Figures of events, and folded away, those at chosen times, the computations, and the mechanism."""
    number = sum(computation.independent for computation in certificate.computations)
    title = f"{certificate.model}: {len(certificate.figures)} figures from {number} independent computations"
    events = [figure for figure in certificate.figures if figure.time is None]
    timed = [figure for figure in certificate.figures if figure.time is not None]
    further = f"{len(timed)} further figures, at chosen times"
    left_out = tuple(Text(sentence, "warning", lead="left out:") for sentence in certificate.absent)
    heads = "computation | formulation | integrator | tolerance | independent"
    made = [
        (c.name, c.formulation, c.integrator, c.tolerance, c.independent)
        for c in certificate.computations
    ]
    blocks = (
        certified_figures(events, "Figures of the motion and its events"),
        Text(f"{further}, are in the file.", "muted", medium="terminal"),
        Fold(further, (page_only(certified_figures(timed, further)),)),
        Listing(left_out),
        Fold(
            "The computations",
            (table(heads, made, "Each was made alone; the uncertainty is what they differ by"),),
        ),
        Note(
            f"Uncertainty: {sentence(certificate.rule)} Versions: {format_settings(certificate.versions)}."
        ),
        Note(f"Mechanism {certificate.mechanism_hash}."),
    )
    return Document(title, blocks, f"trebucheck certify: {certificate.model}", certificate.command)


def run_report(trajectory: Trajectory, distance: Farthest | str | None = None) -> Document:
    """What one run found.

    Args:
        distance: from the reference, or why that is not known; None: not asked for.
    """
    run = trajectory.provenance
    title = f"{trajectory.mechanism.name}, {run.engine} {run.preset} ({run.engine_version})"
    rows = [
        *_quantities(trajectory),
        *([] if distance is None else [("from the reference", _far(distance))]),
    ]
    verdict = "" if distance is None else f"{title}: {_far(distance)} from the reference"
    return Document(title, (table("|", rows, title),), verdict=verdict)


def _far(distance: Farthest | str) -> str:
    if isinstance(distance, str):
        return f"not known: {distance}"
    place = f"{distance.point} at {distance.time:.6g} s; compared to {distance.until:.6g} s"
    return f"{format_number(distance.distance)} m ({place})"


def _quantities(trajectory: Trajectory) -> Iterator[tuple[str, str]]:
    yield "simulated", f"{trajectory.t[-1]:.6g} s in {trajectory.provenance.steps} steps"
    yield "wall time", f"{trajectory.provenance.wall_time:.3f} s"
    for name, time in trajectory.release_times.items():
        if trajectory.mechanism.stop(name).closed:
            yield f"{name} opens", "not" if time is None else f"{time:.9f} s"
    for name, torque in trajectory.stop_torques.items():
        stop = trajectory.mechanism.stop(name)
        yield f"{name}, largest {stop.effort}", f"{torque.max():.6g} {stop.force_unit}"
    launch = trajectory.launch() if "projectile" in trajectory.markers else None
    if launch is not None:
        yield "launch (velocity at 45 deg)", f"{launch.time:.9f} s"
        yield "launch speed", f"{launch.speed:.8f} m/s"
    balance, _ = sampled_balance(trajectory)
    drift = np.abs(balance - balance[0]).max()
    yield "energy drift", f"{drift:.3g} J of {trajectory.total_energy[0]:.6g} J"
