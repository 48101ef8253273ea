"""`trebucheck engines`: what is here and what it can do."""

from __future__ import annotations


def engines_command() -> None:
    """List the engines: installed or not, version, presets and capabilities."""
    from rich.table import Table

    from ...engines.registry import engines
    from ..terminal import console

    table = Table(title="Engines", title_justify="left")
    columns = ("engine", "version", "presets", "joint forces", "releases", "stop laws", "formulation")
    for column in columns:
        table.add_column(column, overflow="fold")
    for status in engines().values():
        can = status.capabilities
        table.add_row(
            status.name,
            status.version if status.installed else "not installed",
            ", ".join(status.presets),
            "yes" if can.joint_reactions else "no",
            "inside a step" if can.located_releases else "at a step's end",
            ", ".join(sorted(can.stop_laws)),
            can.formulation,
        )
    console().print(table)
