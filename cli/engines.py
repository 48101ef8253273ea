"""`trebucheck engines`: what is here and what it can do."""

from __future__ import annotations


def engines_command() -> None:
    """List the engines: installed or not, version, presets and capabilities."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from ..comparisons.compare.terminal import console
    from ..engines.registry import engines

    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for title in ("engine", "version", "presets", "joint forces", "releases", "stop laws"):
        table.add_column(title)
    for status in engines().values():
        can = status.capabilities
        table.add_row(
            status.name,
            status.version if status.installed else "not installed",
            ", ".join(status.presets),
            "yes" if can.joint_reactions else "no",
            "inside a step" if can.located_releases else "at a step's end",
            ", ".join(sorted(can.stop_laws)).replace("release-once, unilateral", "both"),
        )
    console().print(table)
    for status in engines().values():
        console().print(f"{status.name}: {status.capabilities.formulation}")
