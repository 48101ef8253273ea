"""A document and its renderers: what a page, a terminal and Markdown make of the same blocks."""

from __future__ import annotations

import re
from io import StringIO

import numpy as np
import pytest
from rich.console import Console
from trebucheck.comparisons.report import html, markdown, terminal
from trebucheck.comparisons.report.document import (
    Cell,
    Code,
    Column,
    Document,
    Figure,
    Fold,
    Heading,
    Listing,
    Note,
    Text,
    Tile,
    Tiles,
    columns,
    format_number,
    format_percent,
    format_step,
    format_value,
    page_only,
    row,
    sentence,
    table,
    terminal_only,
    without_empty_columns,
)  # fmt: skip
from trebucheck.comparisons.report.plots import (
    Axis,
    Panels,
    Plot,
    Series,
    Style,
    picture,
    with_own_colours,
)


def _page(*blocks: object) -> str:
    """The page without its script and style."""
    text = html.page(Document("A <title>", tuple(blocks), "window"))  # type: ignore[arg-type]
    return re.sub(r"<(script|style)>.*?</\1>", "", text, flags=re.DOTALL)


def _terminal(*blocks: object, width: int = 80) -> str:
    to = Console(width=width, record=True, file=StringIO(), highlight=False)
    terminal.show(Document("A title", tuple(blocks)), to)  # type: ignore[arg-type]
    return to.export_text()


ERRORS = table(
    "engine | position [m] | (steps) | note",
    [
        ("mujoco assisted", Cell("1.3e-8", "good"), 1000, "as ever"),
        ("pymunk assisted", Cell("2.5e-4", "bad"), 1000, ""),
    ],
    "Errors",
)


def test_columns_without_any_value_are_left_out() -> None:
    rows = [
        row("first"),
        ("mujoco", "–", "", Cell("–", "bad"), 3),
        ("pymunk", "", "–", "", ""),
        row("exudyn", "", "failed"),
    ]
    shown = without_empty_columns(table("engine | none | nothing | missed | some", rows))
    assert [column.title for column in shown.columns] == ["engine", "missed", "some"]
    assert [[cell.text for cell in each.cells] for each in shown.rows] == [
        ["first"], ["mujoco", "–", "3"], ["pymunk", "", ""], ["exudyn", "failed"],
    ]  # fmt: skip
    assert [span for _, cells in shown.rows_in("page") for _, span in cells] == [
        3,
        1,
        1,
        1,
        1,
        1,
        1,
        1,
        2,
    ]
    assert without_empty_columns(ERRORS) == ERRORS


def test_marks_are_signs_on_a_page_and_not_only_colours() -> None:
    page = _page(ERRORS, Text("it fails", "bad"), Text("it holds", "good"))
    assert re.search(
        r'<td data-label="[^"]*" class="right good"><span class="sign">✓</span> 1.3e-8</td>', page
    )
    assert re.search(
        r'<td data-label="[^"]*" class="right bad"><span class="sign">✗</span> 2.5e-4</td>', page
    )
    assert re.search(r'<p class="boxed bad"><span class="sign">✗</span> it fails</p>', page)
    assert re.search(r'<p class="boxed good"><span class="sign">✓</span> it holds</p>', page)


def test_tables_have_captions_scopes_and_units() -> None:
    page = _page(ERRORS)
    assert "<caption>Errors</caption>" in page
    assert '<th scope="col" class="right">position [m]</th>' in page
    assert '<th scope="row" class="left">mujoco assisted</th>' in page


@pytest.mark.parametrize("text", ["<b>", "a & b", '"><script>', "{{ 1 }}"])
def test_texts_of_any_block_are_text(text: str) -> None:
    """Messages of engines come from elsewhere.

    None of them is read as HTML, a template, or a style of the terminal.
    """
    styled = f"{text} [bold red]x[/]"
    blocks = (
        Heading(styled, medium="any"),
        Text(styled),
        Text("b", lead=styled),
        Note(styled),
        Listing((Text(styled),)),
        Tiles((Tile(styled, styled),)),
        table([styled], [(Cell(styled, detail=styled, hint=styled),)], styled),
        Code(styled, styled),
        Fold(styled, (Note(styled),)),
    )
    page = _page(*blocks)
    assert "<script>" not in page and "<b>" not in page.replace('<b class="plain">', "").replace(
        '<div class="tile plain"><b>', ""
    )
    assert styled in _terminal(*blocks, width=200)


def test_what_stands_between_backquotes_is_code_on_a_page() -> None:
    shown = _page(Text("run `a <b>` and `c`"), table("what", [("`d`",)]), Text("one ` alone"))
    assert "run <code>a &lt;b&gt;</code> and <code>c</code>" in shown and "<code>d</code>" in shown
    assert "one ` alone" in shown


def test_what_is_for_one_medium_is_not_in_the_other() -> None:
    blocks = (
        page_only(Text("on a page")),
        terminal_only(Text("in a terminal")),
        table(
            (Column("both"), Column("extra", medium="page")),
            [("x", "yy"), row("zz", "ww", medium="page")],
        ),
        Fold("more", (Text("folded"),)),
        Note("how to read it"),
    )
    page, text = _page(*blocks), _terminal(*blocks)
    for part in ("on a page", "folded", "how to read it", "extra", ">yy<", ">ww<"):
        assert part in page and part.strip("><") not in text
    assert "in a terminal" in text and "in a terminal" not in page


def test_a_short_row_spans_the_rest_of_the_shown_columns() -> None:
    failed = table(
        "value | (options) | position | steps",
        [("1", "a = 1", "2", "3"), ("2", "b = 1", "it failed")],
    )
    assert re.search(r'colspan="2">it failed', _page(failed))
    assert "it failed" in _terminal(failed)


def test_numbers_stand_to_the_right_and_texts_to_the_left() -> None:
    found = table(
        "engine | error | law | word",
        [("1", "1e-3", "1.99 ± 0.01", "ok"), ("2", "–", "none", "broken")],
    )
    assert [column.align for column in found.columns] == ["left", "right", "right", "left"]
    assert [column.wrap for column in found.columns] == [False, False, True, False]


def test_a_narrow_terminal_cuts_nothing_off() -> None:
    wide = table(
        "engine | error | torque | outcome",
        [("reference_tuned", "1.234e-11", "1.234e-11", "broken")],
    )
    letters = re.sub(r"\s", "", _terminal(wide, width=24))
    assert "…" not in letters and sorted(letters.replace("─", "")) == sorted(
        "engineerrortorqueoutcomereference_tuned1.234e-111.234e-11broken"
    )


def test_groups_share_a_heading() -> None:
    heads = [
        *columns("cause"),
        Column("first", group="position [m]"),
        Column("second", group="position [m]"),
    ]
    assert '<th scope="colgroup" colspan="2">position [m]</th>' in _page(
        table(heads, [("a", 1.0, 2.0)])
    )


def test_a_table_without_rows_is_not_shown() -> None:
    empty = table("a | b", [])
    assert "<table" not in _page(empty) and not _terminal(empty).strip()


def test_figures_are_drawn_for_pages_alone() -> None:
    drawn: list[str] = []

    def plots() -> Panels:
        drawn.append("once")
        return (
            Plot(
                Axis("t", "s"),
                Axis("x", "m"),
                (Series("body", np.array([0.0, 1.0]), np.array([0.0, np.nan])),),
            ),
        )

    figure = Figure(plots, "Motion", "of all bodies")
    assert "Motion" not in _terminal(figure) and not drawn
    assert "Motion" in _page(figure) and drawn == ["once"]


def _drawn(*names: str, colour: str = "#0072b2", listed: bool = True) -> Plot:
    line = np.array([0.0, 1.0])
    series = [Series(name, line, line, Style(colour), listed=listed) for name in names]
    return Plot(Axis("t", "s"), Axis("x", "m"), tuple(series))


def _legends(*panels: Plot) -> list[list[str]]:
    """Names in the legend above all plots of a page, and in that of each."""
    page = _page(Figure(panels, "Motion"))
    places = re.findall(r'<div class="legend">(.*?)</div>', page, re.DOTALL)
    return [re.findall(r'data-name="(.*?)"', place) for place in places]


def test_plots_have_one_legend_where_they_list_the_same_and_else_each_its_own() -> None:
    assert _legends(_drawn("a", "b"), _drawn("a", "b")) == [["a", "b"]]
    assert _legends(_drawn("tip"), _drawn("a", "b")) == [[], ["tip"], ["a", "b"]]
    assert _legends(_drawn("a"), _drawn("a")) == [[]]
    # What is called alike and looks otherwise is another one.
    assert _legends(_drawn("a", "b"), _drawn("a", "b", colour="#123456"))[0] == []
    figure = picture((_drawn("tip"), _drawn("a", "b")))
    assert not figure.legends
    own = [axes.get_legend() for axes in figure.axes]
    assert [[text.get_text() for text in legend.texts] for legend in own if legend] == [
        ["tip"], ["a", "b"],
    ]  # fmt: skip
    (common,) = picture((_drawn("a", "b"), _drawn("a", "b"))).legends
    assert [text.get_text() for text in common.texts] == ["a", "b"]


def test_no_two_curves_of_a_plot_have_one_colour() -> None:
    many = [f"link {k}" for k in range(40)]
    first, second = with_own_colours((_drawn(*many), _drawn(many[7], "other")))
    colours = {series.name: series.style.colour for series in first.series}
    assert len(set(colours.values())) == 40 and colours["link 0"] == "#0072b2"
    # It is the same in all plots.
    assert second.series[0].style.colour == colours["link 7"]
    assert second.series[1].style.colour != colours["link 7"]
    unlisted = _drawn("slope", listed=False)
    assert with_own_colours((unlisted,)) == (unlisted,)


def test_markdown_is_what_the_readme_holds() -> None:
    text = markdown.text(
        Document("", (Text("Two claims."), table("where | ours [m]", [("Fig. 2", "1|2")], "Table")))
    )
    assert (
        text == "Two claims.\n\n**Table**\n\n| where | ours [m] |\n|---|---|\n| Fig. 2 | 1\\|2 |\n"
    )


def test_formats_of_numbers() -> None:
    assert [format_number(value) for value in (None, 0.0, 1.26e-8, -3.0)] == [
        "–",
        "0",
        "1.3e-8",
        "-3.0e0",
    ]
    assert [format_step(value) for value in (1e-3, 2.5e-4, 1 / 3, "adaptive")] == [
        "1e-3",
        "2.5e-4",
        "3.333e-1",
        "–",
    ]
    assert [format_percent(f) for f in (None, 0.0, 1e-5, 0.0123, -0.2)] == [
        "–",
        "0 %",
        "< 0.1 %",
        "1.2 %",
        "-20 %",
    ]
    assert [format_value(value) for value in (None, True, 1.23456789, 3, "x")] == [
        "–",
        "yes",
        "1.23457",
        "3",
        "x",
    ]
    assert [sentence(text) for text in ("it holds", "g is small", "Done.")] == [
        "It holds.",
        "g is small.",
        "Done.",
    ]
