"""`trebucheck engines`: what is here and what it can do."""

from __future__ import annotations

from . import output


def engines_command() -> None:
    """List the engines: installed or not, version, presets and capabilities."""
    from ..comparisons.report.document import Document, Listing, Text, table
    from ..engines.registry import engines

    titles = "engine | version | presets | joint forces | releases | stop laws"
    rows = [
        (
            status.name,
            status.version if status.installed else "not installed",
            ", ".join(status.presets),
            status.capabilities.joint_reactions,
            "inside a step" if status.capabilities.located_releases else "at a step's end",
            ", ".join(sorted(status.capabilities.stop_laws)).replace("release-once, unilateral", "both"),
        )
        for status in engines().values()
    ]
    texts = (Text(f"{status.name}: {status.capabilities.formulation}") for status in engines().values())
    blocks = (table(titles, rows), Listing(tuple(texts)))
    output.show(Document("engines", blocks))
