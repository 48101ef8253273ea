"""A certificate's figures as a table, and a certificate as a document."""

from __future__ import annotations

from collections.abc import Iterable

from ...reference.certification.certificate import Certificate, Figure
from .document import Document, Listing, Table, Text, table


def certified_figures(figures: Iterable[Figure], caption: str) -> Table:
    """One line a figure: value, uncertainty, unit."""
    rows = [(figure.label, *figure.texts, figure.unit) for figure in figures]
    return table("figure | value | uncertainty | unit", rows, caption)


def document(certificate: Certificate) -> Document:
    """The figures, and what was left out of the computations."""
    number = sum(computation.independent for computation in certificate.computations)
    title = f"{certificate.model}: {len(certificate.figures)} figures from {number} independent computations"
    left_out = (Text(sentence, "warning", lead="left out:") for sentence in certificate.absent)
    return Document(title, (certified_figures(certificate.figures, title), Listing(tuple(left_out))))
