"""Tables in terminals of any width.

No word is cut, no line is too long, and what has no room is named.
"""

from __future__ import annotations

import random
from dataclasses import replace
from functools import cache
from io import StringIO
from itertools import pairwise

import pytest
import trebucheck as tb
from rich.console import Console
from trebucheck.cli.catalogue import engine_document
from trebucheck.cli.truth import problem_list
from trebucheck.comparisons.compare import Comparison
from trebucheck.comparisons.report import terminal
from trebucheck.comparisons.report.document import Column, Document, table
from trebucheck.comparisons.report.pages import compare as report
from trebucheck.comparisons.report.pages.compare import verdict_cell
from trebucheck.comparisons.report.pages.run import certificate_report
from trebucheck.comparisons.report.terminal import fitted
from trebucheck.comparisons.runs.results import Outcome
from trebucheck.engines.options import default_text
from trebucheck.engines.registry import option_table
from trebucheck.models.library.registry import benchmarks
from trebucheck.reference.certification.certificate import load_certificate

WIDTHS = range(50, 201)
LONG = "reference"


def _lines(document: Document, width: int) -> list[str]:
    to = Console(width=width, file=StringIO(), record=True, highlight=False)
    terminal.show(document, to)
    return to.export_text().splitlines()


@cache
def _comparison() -> Comparison:
    """Of one run, repeated with every verdict and for engines with longer names."""
    found = tb.compare(["fixed"], ["reference"], ["assisted"], timestep=5e-3, isolate=False)
    (run,) = found.results.runs
    runs = [
        run.model_copy(update={"engine": name, "outcome": outcome, "wall_time": 0.05})
        for name in ("mujoco", LONG)
        for outcome in Outcome
    ]
    return replace(found, results=found.results.model_copy(update={"runs": tuple(runs)}))


@cache
def _document() -> Document:
    return report.document(_comparison())


@cache
def _agreement(width: int) -> list[str]:
    return _lines(_document(), width)


def _documents() -> list[Document]:
    certificate = load_certificate(tb.fixed())
    assert certificate is not None
    return [_document(), problem_list(benchmarks(None)), certificate_report(certificate)]


@pytest.mark.slow
def test_no_line_is_longer_than_the_terminal() -> None:
    assert all(len(line) <= width for width in WIDTHS for line in _agreement(width))
    for document in _documents():
        for width in (50, 60, 72, 80, 100, 120, 200):
            assert max(map(len, _lines(document, width))) <= width


def test_verdicts_and_engines_are_whole_at_every_width() -> None:
    shown = [*dict.fromkeys(verdict_cell(run).text for run in _comparison().results.runs)]
    for width in WIDTHS:
        lines = _agreement(width)
        for verdict in shown:
            rows = [line for line in lines if line.rstrip().endswith(verdict)]
            assert {line.split()[0] for line in rows} >= {"mujoco", LONG}, (width, verdict)


def test_80_columns_show_all_but_the_time_of_runs_that_agree_or_disagree() -> None:
    found = _comparison()
    judged = (Outcome.AGREES, Outcome.DISAGREES)
    runs = tuple(run for run in found.results.runs if run.engine != LONG and run.outcome in judged)
    text = "".join(
        _lines(
            report.document(
                replace(found, results=found.results.model_copy(update={"runs": runs}))
            ),
            80,
        )
    )
    assert "disagrees 28/28" in text
    missing = text.partition("Not shown in 80 columns: ")[2].partition(".")[0]
    assert missing in ("", "wall")  # the least of them, where exponents have two digits


def test_columns_go_in_the_order_of_their_ranks_and_are_named() -> None:
    gone: list[set[str]] = []
    for width in reversed(WIDTHS):
        text = " ".join(" ".join(_agreement(width)).split())
        named = text.partition("Not shown in")[2].partition("columns: ")[2].partition(".")[0]
        gone.append(set(filter(None, named.split(", "))))
    assert not any(gone[: 201 - 90])
    assert all(before <= after for before, after in pairwise(gone))
    assert gone[-1] and not gone[-1] & {"verdict", "position"}
    first = next(each for each in gone if each)
    assert first == {"wall"}


def test_random_tables_lose_no_word_of_what_they_show() -> None:
    rng = random.Random(13)
    for _ in range(100):
        count = rng.randint(2, 9)
        heads = [Column("w" * rng.randint(1, 12), rank=rng.randint(0, 3)) for _ in range(count)]
        texts = [[_text(rng) for _ in heads] for _ in range(rng.randint(1, 6))]
        given = table(heads, [tuple(each) for each in texts])
        for width in (50, 60, 80, 120, 200):
            layout = fitted(given, width)
            used = sum(column.width for column in layout.columns) + layout.room
            longest = [
                max(map(len, " ".join(c.text for c in f.cells).split()), default=0)
                for f in layout.columns
            ]
            if sum(longest) + len(longest) - 1 <= width and max(len(h.title) for h in heads) <= min(
                longest
            ):
                assert all(
                    f.width >= least for f, least in zip(layout.columns, longest, strict=True)
                )
            assert used <= width or not layout.columns
            kept = {column.column.rank for column in layout.columns[1:]}
            out = {column.rank for column in layout.left_out}
            assert not out or (min(out) >= max(kept, default=0) and 0 not in out)


@pytest.mark.parametrize("width", [44, 60, 72])
def test_options_of_engines_keep_every_word(width: int) -> None:
    for name in tb.engines():
        rows = option_table(name)
        assert len(rows) > 0
        shown = " ".join(" ".join(_lines(engine_document(name), width)).split())
        words = {
            word
            for row in rows
            for value in row.defaults.values()
            for word in default_text(value).split()
        }
        assert words <= set(shown.split()), (name, words - set(shown.split()))


def test_a_row_that_cannot_keep_its_words_becomes_a_list() -> None:
    heads = [Column("first"), Column("second", rank=0), Column("third", rank=0)]
    texts = [tuple(letter * 25 for letter in letters) for letters in ("abc", "def")]
    lines = [line.split() for line in _lines(Document("", (table(heads, texts),)), 60)]
    names = [head.title for head in heads]
    assert lines == [
        *map(list, zip(names, texts[0], strict=True)),
        [],
        *map(list, zip(names, texts[1], strict=True)),
    ]
    untitled = table("|", [("a" * 40, "b" * 40)])
    assert max(map(len, _lines(Document("", (untitled,)), 60))) <= 60


def _text(rng: random.Random) -> str:
    return " ".join("x" * rng.randint(1, 14) for _ in range(rng.randint(1, 8)))


def test_what_is_left_out_where_ranks_are_equal_is_the_rightmost() -> None:
    given = table("engine | first | second | third", [("mujoco", "a" * 20, "b" * 20, "c" * 20)])
    assert [column.title for column in fitted(given, 60).left_out] == ["third"]
    assert not fitted(given, 72).left_out
