"""`trebucheck certify`, `prove`, `data` and `problems`: what is certain?"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

import typer

from ..models.errors import InputError, SimulationError
from ..models.problem import mechanism_of
from . import options, output
from .call import Call, command
from .options import argument, folder, option

if TYPE_CHECKING:
    from ..comparisons.published import PublishedFigure
    from ..comparisons.report.document import Document
    from ..models.library.benchmark import Benchmark, BenchmarkParameters
    from ..models.mechanism import Mechanism
    from ..models.problem import Problem
    from ..reference.proof.proof import Proof


@command(
    "models set beam duration cluster timeout quiet json",
    folder("certificates", "Folder for one JSON file and one page a machine."),
    json=option("--json", "Print the certificates as a JSON array, and nothing else.", bool, False),
)
def certify_command(call: Call) -> bool:
    """Compute each machine's figures in every independent way; write values and uncertainties.

    Formulations: minimal and redundant coordinates, the paper's equations. Integrators: DOP853 over
    a ladder of tolerances, and Taylor series in double and extended precision where heyoka is
    installed. Beside each figure is what a proof encloses, or why none does. Motions go to the
    launch, or as long as a problem of the library asks for. Ends with exit code 1 if a machine's
    motion could not be computed, or if the proof contradicts a certificate that is there already.

    Examples:
    trebucheck certify --out certificates

    trebucheck certify --models fixed --set l1=9.5

    trebucheck certify --models squeezer
    """
    from ..comparisons.certify import certify, refuse_contradicted
    from ..comparisons.report import html
    from ..comparisons.report.pages.run import certificate_report
    from ..models.files import refuse_unwritable, write_text

    models = call.models()
    refuse_unwritable(call.out)
    certificates: list[str] = []
    for name, model in zip(options.names(call.values["models"], "--models"), models, strict=True):
        mechanism = mechanism_of(model)
        path = call.out / f"{mechanism.name}.json"
        # The line that makes the same figures again.
        line = ["trebucheck", "certify", "--models", name]
        for text in call.set or []:
            line += ["--set", text]
        for flag, value in (("--beam", call.beam), ("--duration", call.duration)):
            if value is not None:
                line += [flag, repr(value)]
        try:
            with call.progress(width=28) as show:
                certificate = certify(
                    model,
                    call.whipper(name),
                    duration=call.duration,
                    timeout=call.timeout,
                    cluster=call.cluster,
                    command=shlex.join(line),
                    progress=lambda what, done, of, m=mechanism, show=show: show(
                        f"{m.name}: {what}", done, of
                    ),
                )
            refuse_contradicted(path, certificate)
        except SimulationError as error:  # the others must not be lost with it
            print(f"error: {mechanism.name}: {error}", file=sys.stderr)
            continue
        certificates.append(certificate.to_json())
        report, page = certificate_report(certificate), path.with_suffix(".html")
        write_text(path, certificate.to_json() + "\n")
        write_text(page, html.page(report))
        if not call.json:  # else all are printed as data at the end
            output.show(report, call.told, Certificate=path, Page=page)
    if call.json:
        typer.echo(f"[{','.join(certificates)}]")
    return len(certificates) == len(models)


@command(
    "model digits until start_bits set beam keyframe qpos qvel ctrl without stop_law most_steps "
    "timeout quiet json",
    folder("proofs", "Folder for NAME.json and NAME.html."),
    model=argument(f"Machine: {options.MACHINES}.", str, "fixed", names=options.machine_names),
    digits=option(
        "--digits",
        "Digits of every figure, 1 to 200, by default 12; with --start-bits the fewest that are "
        "followed, by default 1.",
        int | None,
        None,
    ),
    until=option(
        "--until", "End of the motion (s), a decimal; the problem's own, else the launch."
    ),
    start_bits=option(
        "--start-bits",
        "Bits that the start is known to, such as 24: how long that determines the motion.",
        int | None,
        None,
    ),
    most_steps=option("--most-steps", "Limit of the steps of a trial.", int, 100_000),
    timeout=options.timeout(600.0, "Limit of processor time (s)."),
    json=option("--json", "Print the figures as JSON, and nothing else.", bool, False),
)
def prove_command(call: Call) -> bool:
    """Enclose a motion in ball arithmetic: events, launch and end with proved radii.

    The exact value of every figure is within its radius: nothing is estimated. Proved is the motion
    of the equations, with the doubles of the mechanism's file taken exactly. Ends with exit code 1
    where an inequality stays undecided or a limit is reached, and says which.

    With --start-bits all motions from starts that agree to so many bits are enclosed, and it is
    told until when each number of digits is known; NAME-24-bits.json has it. A problem of the
    library shows its source's figures beside what is proved.

    Examples:
    trebucheck prove fixed --digits 20

    trebucheck prove double-pendulum --until 2.5

    trebucheck prove double-pendulum --start-bits 24
    """
    from ..comparisons.prove import ProofFile, prove
    from ..comparisons.report.pages.run import proof_report
    from ..models.files import refuse_unwritable

    model = call.only_model()
    if call.most_steps < 1:
        raise InputError(f"--most-steps {call.most_steps} must be positive.")
    refuse_unwritable(call.out)
    if call.start_bits is not None:
        return _horizon(call, model)
    with call.progress("proof") as show:
        proof = prove(
            model,
            12 if call.digits is None else call.digits,
            call.until,
            stop_law=call.stop_law,
            most_steps=call.most_steps,
            timeout=call.timeout,
            progress=lambda trial, t: show(f"trial {trial}: t = {t:.4f} s", 0, 1),
        )
    found = ProofFile.of(proof).made_by(call.command_line)
    data, page = f"{found.model}.json", f"{found.model}.html"
    beside = () if call.set else _beside(call.model, proof)
    call.publish(data, found.to_json(), proof_report(found, beside), page, "Page")
    return True


def _beside(name: str, proof: Proof) -> Sequence[PublishedFigure]:
    """Figures of a library problem's source beside its proof; of other models none."""
    from ..comparisons.published import figures_beside
    from ..models.library.registry import benchmarks

    entry = next((each for each in benchmarks() if each.name == name), None)
    return () if entry is None else figures_beside(entry, proof)


def _horizon(call: Call, model: Mechanism | Problem) -> bool:
    """Tell until when a start of some bits determines a motion."""
    from ..comparisons.horizon import horizon
    from ..comparisons.report.pages.horizon import document

    with call.progress("horizon") as show:
        found = horizon(
            model,
            call.start_bits,
            call.until,
            digits=1 if call.digits is None else call.digits,
            stop_law=call.stop_law,
            most_steps=call.most_steps,
            timeout=call.timeout,
            progress=lambda what, t: show(f"{what}: t = {t:.4f} s", 0, 1),
        )
    found = found.made_by(call.command_line)
    name = f"{found.model}-{found.start_bits}-bits"
    call.publish(f"{name}.json", found.to_json(), document(found), f"{name}.html", "Page")
    return True


@command(
    "name set check timeout",
    folder(None, "NetCDF file to write; NAME.nc by default."),
    name=argument(
        f"{options.MACHINES}; all are listed where left out.",
        str | None,
        None,
        names=options.machine_names,
    ),
    check=option("--check", "Verify the checksums of all published files.", bool, False),
)
def data_command(call: Call) -> bool:
    """List the published certified trajectories, write one as NetCDF, or verify their checksums.

    Every value has its uncertainty beside it; releases, impacts, rests, the launch and the
    predictability horizon are in the file, too, which xarray.open_dataset reads. With --set, or of
    a mechanism of your own, it is computed now. --check ends with exit code 1 if a file is missing
    or changed.

    Examples:
    trebucheck data squeezer --out squeezer.nc

    trebucheck data pendulum --set length=2

    trebucheck data --check
    """
    from ..comparisons.data import certified
    from ..comparisons.runs.model_files import is_file
    from ..models.files import refuse_unwritable, write_bytes
    from ..models.trajectory import write_dataset

    if call.name is None or call.check:
        if call.name is not None or call.set or call.out is not None:
            raise InputError(
                "a name, --set and --out are for one trajectory; --check and the list are of all "
                "of them."
            )
        states = list(certified.states())
        output.show(_trajectories(states))
        return not call.check or all(state == "good" for *_, state in states)
    path: Path = call.out or Path(f"{Path(call.name).stem}.nc")
    model = call.only_model()
    refuse_unwritable(path.parent, path.name)
    name = mechanism_of(model).name
    if not call.set and not is_file(call.name) and name in certified.published():
        write_bytes(path, certified.content(name))
    else:
        with call.worker(isolate=False) as worker:
            dataset = worker.compute(partial(certified.certified_dataset, model))
            write_dataset(dataset, path, compressed=True)
    typer.echo(f"Wrote {output.printable(str(path))}")
    return True


def _trajectories(states: Iterable[tuple[str, str, int, str]]) -> Document:
    """A table of names, digests, sizes [bytes] and whether the files are as published."""
    from ..comparisons.report.document import Cell, Column, Document, ranked, table, words

    rows = [
        (name, f"{size / 1024:.0f}", digest, Cell(state, "good" if state == "good" else "bad"))
        for name, digest, size, state in states
    ]
    heads = [
        words("name", wrap=False),
        Column("size", "kB"),
        words("SHA-256", wrap=False),
        words("checksum"),
    ]
    return Document("Published trajectories", (table(ranked(heads, checksum=0), rows),))


@command(
    "name tag set timeout",
    name=argument(
        "Name of one problem, to see its figures.",
        str | None,
        None,
        names=options.problem_names,
    ),
    tag=option("--tag", "List only problems with this tag, e.g. loop."),
)
def problems_command(call: Call) -> bool:
    """List the benchmark problems, or show one: source, figures beside the reference's, conditions.

    A problem's name stands wherever a machine's does; it brings its own duration and stop law. Of
    one problem, the exit code is 1 if the reference misses a figure or a condition.

    Examples:
    trebucheck problems --tag loop

    trebucheck problems pendulum --set length=2

    trebucheck compare --model slider-crank
    """
    from ..models.library.registry import benchmark, benchmarks

    if call.name is None:
        if call.set:
            raise InputError(
                "--set is for one problem; name it, e.g. trebucheck problems pendulum --set "
                "length=2."
            )
        output.show(problem_list(benchmarks(call.tag)))
        return True
    from ..comparisons.problems import check
    from ..comparisons.report.pages.problems import document

    if call.tag is not None:
        raise InputError(
            f"--tag {call.tag} selects from the list; leave it out, or the name {call.name}."
        )
    chosen = benchmark(call.name)
    parameters = cast("BenchmarkParameters | None", call.parameters(chosen.name))
    with call.worker(isolate=False) as worker:
        checked = worker.compute(partial(check, chosen, parameters))
    output.show(document(checked))
    return checked.holds


def problem_list(problems: Iterable[Benchmark]) -> Document:
    """Name, tags, a line and the source of each problem."""
    from ..comparisons.report.document import Document, table, words

    heads = [words("name", wrap=False), *map(words, ("tags", "problem", "source"))]
    rows: list[tuple[str, ...]] = []
    for each in problems:
        rows.append((each.name, ", ".join(each.tags), each.text, each.source))
    return Document("Problems", (table(heads, rows),))
