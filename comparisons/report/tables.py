"""Tables and paragraphs that several pages share: verdicts, causes, horizons, provenance."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from ...models.mechanism import Mechanism
from ...reference.certification.certificate import Figure
from ..runs.results import Machine, Metric, ResultFile, Run, SingularPosition
from .document import (
    Block,
    Code,
    Fold,
    Heading,
    Note,
    Table,
    Text,
    columns,
    page_only,
    ranked,
    table,
)
from .numbers import format_number, format_settings

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
