"""Checks of importers as documents: terminal, page with fault reports, and comparison."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from trebucheck.api.reports import (
    Block,
    Cell,
    Code,
    Document,
    Heading,
    Listing,
    Mark,
    Table,
    Text,
    format_number,
    row,
    table,
    words,
)

from . import files
from .results import QUANTITIES, Check, FileResult, ImporterResults, ModelResult, Verdict

_MARKS: dict[Verdict, Mark] = {
    Verdict.RIGHT: "good",
    Verdict.WRONG: "bad",
    Verdict.UNDECIDED: "warning",
    Verdict.NOT_OFFERED: "muted",
    Verdict.FAILED: "bad",
}
_SIMPLEST = ("hinge", "slide")  # what is wrong there is wrong everywhere
_REPEATED = 4000  # characters of a file that a report repeats


def document(results: ImporterResults) -> Document:
    """A row a model, and below it expected and found of what is not right."""
    verdict = _verdict(results)
    wrong = tuple(
        Text(
            f"{_sized(check)}.",
            lead=f"{name}, {check.quantity}: {check.verdict}.",
            mark=_MARKS[check.verdict],
        )
        for name, file in _all_files(results)
        for check in file.checks
        if check.verdict in (Verdict.WRONG, Verdict.FAILED, Verdict.UNDECIDED)
    )
    about = (
        f"{versions(results)}; {results.integrator}, {results.precision}, steps of "
        f"{results.timestep:g} s and half"
    )
    blocks: list[Block] = [Text(f"{verdict}."), Text(about, lead="Importer:"), _verdicts(results)]
    return Document("Importer", (*blocks, *([Listing(wrong)] if wrong else [])), verdict=verdict)


def _verdicts(results: ImporterResults) -> Table:
    """A row a model; of a single one a row a quantity."""
    if len(results.models) == 1 and not results.models[0].variants:
        (model,) = results.models
        rows = [row(check.quantity, _cell(check)) for check in model.checks]
        return table([words("quantity"), words(model.model, wrap=False)], rows)
    heads = [words("model", wrap=False), *(words(quantity) for quantity in QUANTITIES)]
    return table(
        heads,
        [
            row(name, *(_cell(file.check(quantity)) for quantity in QUANTITIES))
            for name, file in _all_files(results)
        ],
    )


def page(results: ImporterResults, title: str) -> Document:
    """The same with what the importer printed, and a report ready to file of each fault."""
    said = {name: file.printed for name, file in _all_files(results) if file.printed}
    printed: list[Block] = [Code("", _distinct(said))] if said else []
    blocks: list[Block] = [*document(results).blocks]
    if printed:
        blocks += [Heading("What it says of the files, in its own words", 2), *printed]
    reports = [*fault_reports(results, title)]
    if reports:
        blocks += [Heading("Reports", 2), *(block for report in reports for block in report)]
    return Document(title, tuple(blocks))


def overview(importers: Mapping[str, ImporterResults | None]) -> Document:
    """Tables of several importers: models right in each quantity, and the verdict on each model.

    None stands for an importer that has not been run.
    """
    counted = [words("importer", wrap=False), *(words(quantity) for quantity in QUANTITIES)]
    counts = [
        row(name, *(_tally(results, quantity) for quantity in QUANTITIES))
        for name, results in importers.items()
    ]
    heads = [words("model", wrap=False), *(words(name) for name in importers)]
    rows = [
        row(model, *(whole(results, model) for results in importers.values()))
        for model in files.names()
    ]
    return Document("", (table(counted, counts), table(heads, rows)))


def versions_table(importers: Mapping[str, ImporterResults | None]) -> Document:
    """Versions, integrator, precision and step of several importers; None: not run."""
    rows = [
        row(name, versions(results), results.integrator, results.precision, f"{results.timestep:g}")
        if results
        else row(name, "not run")
        for name, results in importers.items()
    ]
    return Document("", (table("importer | versions | integrator | precision | step [s]", rows),))


def machine_table(importers: Mapping[str, ImporterResults | None], name: str) -> Document:
    """Results of several importers on one model; None: not run."""
    cells = ((who, results, whole(results, name)) for who, results in importers.items())
    rows = [
        row(
            who,
            versions(results) if results else "",
            cell,
            cell.hint if cell.mark in ("bad", "warning") else "",
        )
        for who, results, cell in cells
    ]
    return Document(
        "", (table("importer | versions | verdict | expected and found, or its own words", rows),)
    )


def _verdict(results: ImporterResults) -> str:
    counts = ((results.count(verdict), verdict.value) for verdict in Verdict)
    number = len(results.models)
    return f"{number} model{'' if number == 1 else 's'}: " + ", ".join(
        f"{count} {name}" for count, name in counts if count
    )


def versions(results: ImporterResults) -> str:
    """Versions of the importer's packages, in a line."""
    return (
        ", ".join(f"{name} {version}" for name, version in results.versions.items())
        or results.loader
    )


def _cell(check: Check | None) -> Cell:
    return (
        Cell("")
        if check is None
        else Cell(check.verdict.value, _MARKS[check.verdict], hint=check.text)
    )


def _sized(check: Check) -> str:
    text = check.text.rstrip(".")
    if check.error is None or check.tolerance is None:
        return text
    return (
        f"{text} (error {format_number(check.error)}, tolerance {format_number(check.tolerance)})"
    )


def _all_files(results: ImporterResults) -> Iterator[tuple[str, FileResult]]:
    """List each model's file and the variants that were tried, with a name."""
    for model in results.models:
        yield model.model, model
        yield from ((f"{model.model} ({tried.variant})", tried) for tried in model.variants)


def _tally(results: ImporterResults | None, quantity: str) -> Cell:
    if results is None:
        return Cell("not run", "muted")
    right, undecided = (
        results.count(verdict, quantity) for verdict in (Verdict.RIGHT, Verdict.UNDECIDED)
    )
    wrong = sum(results.count(verdict, quantity) for verdict in (Verdict.WRONG, Verdict.FAILED))
    if not right + wrong + undecided:
        return Cell(Verdict.NOT_OFFERED.value, "muted")
    text = f"{right} of {right + wrong + undecided}"
    return Cell(
        f"{text} ({undecided} undecided)" if undecided else text, "bad" if wrong else "good"
    )


def whole(results: ImporterResults | None, name: str) -> Cell:
    """Quantities of a model in some words: the first that is not right, and its variant."""
    model = next((each for each in results.models if each.model == name), None) if results else None
    if model is None:
        return Cell("not run", "muted")
    cell = _in_a_word(model)
    if not model.variants:
        return cell
    right = next((tried.variant for tried in model.variants if tried.fault is None), None)
    also = f"; {right}: right" if right else "; no variant right"
    return replace(cell, text=f"{cell.text}{also}")


def _in_a_word(file: FileResult) -> Cell:
    for verdicts in ((Verdict.FAILED, Verdict.WRONG), (Verdict.UNDECIDED,)):
        for check in file.checks:
            if check.verdict in verdicts:
                what = (
                    "refused" if check.quantity == "loads" else f"{check.quantity} {check.verdict}"
                )
                return Cell(what, _MARKS[check.verdict], hint=check.text)
    missing = [check.quantity for check in file.checks if check.verdict == Verdict.NOT_OFFERED]
    return Cell("right" if not missing else f"right; {', '.join(missing)} not offered", "good")


def _distinct(said: Mapping[str, str]) -> str:
    """Distinct printed lines, without places in files, each with the first model that caused it."""
    lines: dict[str, str] = {}
    for model, text in said.items():
        for line in text.splitlines():
            lines.setdefault(line.rpartition(".xml:")[2].lstrip("0123456789: "), model)
    return "\n".join(f"{model}: {line}" for line, model in lines.items() if line.strip())


def fault_reports(results: ImporterResults, title: str) -> Iterator[tuple[Block, ...]]:
    """Reports ready to file: of each fault the smallest model, expected, found, and versions."""
    for model, check, others in _faults(results):
        expected = files.expected(model.model)
        also = f" The same quantity is also wrong in: {', '.join(others)}." if others else ""
        what = (
            "cannot be loaded" if check.quantity == "loads" else f"{check.quantity} {check.verdict}"
        )
        yield (
            Heading(f"{model.model}: {what}", 3),
            Text(f"{_sized(check)}.{also}", lead="Expected and found:"),
            Text(
                "the equations of motion of the same mechanism, solved without reading the file.",
                lead="Truth:",
            ),
            Text(
                f"{versions(results)}; Python {results.python_version}, {results.platform}.",
                lead="Versions:",
            ),
            Code(f"{model.model}.xml", expected.xml[:_REPEATED]),
            Code("Call", _call(check, title)),
        )


def _faults(results: ImporterResults) -> Iterator[tuple[ModelResult, Check, list[str]]]:
    """Distinct faults: models by their first wrong quantity; the simplest stand for the others."""
    groups: dict[str, list[tuple[ModelResult, Check]]] = {}
    for model in results.models:
        first = next(
            (c for c in model.checks if c.verdict in (Verdict.WRONG, Verdict.FAILED)), None
        )
        if first is not None:
            groups.setdefault(first.quantity, []).append((model, first))
    for group in groups.values():
        # A machine has many features: it is reported where nothing smaller shows the fault, and
        # then only the first.
        found = [each for each in group if not each[0].feature.endswith(" machine")] or group[:1]
        simple = [each for each in found if each[0].model in _SIMPLEST]
        for model, check in simple[:1] or found:
            others = [other.model for other, _ in found if other is not model] if simple else []
            yield model, check, others


def _call(check: Check, title: str) -> str:
    """Call that produced the result, as the adapter writes it."""
    calls: Mapping[str, str] = {
        "loads": "load(path)",
        "joints": "load(path).joints",
        "total mass": "load(path).total_mass()",
        "mass matrix": "load(path).mass_matrix(q)",
        "accelerations": "load(path).acceleration(q, u)",
        "ranges": "load(path).limits()",
        "start": "load(path).start()",
    }
    return (
        f"{calls.get(check.quantity, 'load(path).simulate(q, u, interval, count, steps)')}  # "
        f"importers/{title}/load.py"
    )
