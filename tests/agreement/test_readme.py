"""The README's certified launch time is the certificate's; its tables: test_agreement.py and test_paper_study.py."""

from __future__ import annotations

from pathlib import Path

import trebucheck as tb
from trebucheck.reference.certification.certificate import load_certificate

README = Path(__file__).parents[2] / "README.md"


def test_the_certified_launch_time() -> None:
    certificate = load_certificate(tb.fixed())
    assert certificate is not None
    figure = certificate.figure("launch_time")
    assert figure is not None
    text = " ".join(README.read_text().split())
    assert f"{figure.texts[0]} s, known to {figure.uncertainty:.0e} s" in text
