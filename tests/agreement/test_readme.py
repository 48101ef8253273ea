"""The certified launch time that a page prints is the certificate's, and the README's table is the
page's.

The page's tables: test_agreement.py and test_paper_study.py.
"""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest
import trebucheck as tb
from trebucheck.reference.certification.certificate import load_certificate

ROOT = Path(__file__).parents[2]
PAGE, README = ROOT / "docs" / "agreement.md", ROOT / "README.md"


def test_the_certified_launch_time() -> None:
    certificate = load_certificate(tb.fixed())
    assert certificate is not None
    figure = certificate.figure("launch_time")
    assert figure is not None
    text = " ".join(PAGE.read_text().split())
    assert f"{figure.texts[0]} s, known to {figure.uncertainty:.0e} s" in text


def test_the_readmes_table_is_the_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    table = importlib.import_module("generate").small_table(PAGE.read_text())
    # Three figures a machine; three presets of three engines.
    assert [line.count("|") for line in table.splitlines()] == [8] * (2 + 9)
    assert f"<!-- generated: table -->\n{table}<!-- end -->" in README.read_text()


def test_the_readme_is_short_and_light() -> None:
    text = README.read_text()
    assert len(text.splitlines()) <= 80
    pictures = re.findall(r"\((docs/pictures/[^)]+)\)", text)
    assert pictures
    assert all((ROOT / name).stat().st_size < 1_000_000 for name in pictures)


@pytest.mark.parametrize(
    "page", [README, *sorted((ROOT / "docs").glob("*.md"))], ids=lambda page: page.name
)
def test_links_lead_to_files(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text()):
        assert target.startswith("http") or (page.parent / target).exists(), (
            f"{page.name}: {target}"
        )
