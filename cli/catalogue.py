"""`trebucheck engines`, `models` and `plugin`: what is there, and what it can do."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from . import options, output
from .call import Call, command
from .options import argument, folder, option

if TYPE_CHECKING:
    from ..comparisons.report.document import Document

models_app = typer.Typer(
    help="The machines: list them, show one as JSON, export its MJCF.", no_args_is_help=True
)
plugin_app = typer.Typer(
    help="Engines of your own: write the skeleton of a plug-in.", no_args_is_help=True
)
_MACHINE = argument(options.MACHINES, names=options.machine_names)


@models_app.command("list")
@command("")
def list_command(_: Call) -> None:
    """List the machines there are."""
    from ..models.library.registry import models

    width = max(map(len, models()))
    for name, text in models().items():
        typer.echo(f"{name:<{width}}  {text}")


@models_app.command("show")
@command("name set beam", name=_MACHINE)
def show_command(call: Call) -> None:
    """Print a machine as JSON, with other parameters if asked.

    Example: trebucheck models show rolling --set l1=9.5
    """
    from ..models.problem import mechanism_of

    for model in call.models():
        typer.echo(mechanism_of(model).to_json())


@models_app.command("read")
@command(
    "file keyframe qpos qvel ctrl without",
    folder(None, "JSON file to write; printed where left out."),
    file=argument("MJCF or URDF file of a model that moves in a plane.", Path),
)
def read_command(call: Call) -> None:
    """Read an MJCF or URDF file that moves in a plane, from a start, as a mechanism in JSON.

    Any command takes such a file as a model, too; it then starts where the file says. What is read
    is held against the accelerations of the file's engine at random states. Angles of the result
    count clockwise from the file's zero position.

    Example: trebucheck models read cartpole.xml --qpos 0,0.1 --out cartpole.json
    """
    from ..comparisons.runs.model_files import read_model_file, start_of
    from ..models.files import write_text

    read = read_model_file(call.file, start_of(**call.model_start()))
    if call.out is None:
        typer.echo(read.mechanism.to_json())
    else:
        write_text(call.out, read.mechanism.to_json() + "\n")
        typer.echo(read.mechanism.headline())
        typer.echo(f"Wrote {output.printable(str(call.out))}")
    for what in read.left_out:
        typer.echo(f"Left out: {what}", err=True)


@models_app.command("schema")
@command("")
def schema_command(_: Call) -> None:
    """Print the JSON schema of a mechanism."""
    from ..models.mechanism import mechanism_schema

    typer.echo(mechanism_schema(), nl=False)


@models_app.command("export")
@command(
    "name set beam timestep keyframes sensors finite_inertia",
    folder(None, "Folder to write; the machine's name by default."),
    name=_MACHINE,
    timestep=option(
        "--timestep",
        "Step written into the MJCF (s); 1 ms, or less if the motion is fast.",
        float | None,
    ),
    keyframes=option(
        "",
        "A keyframe at each release, impact and rest and at the launch, from the reference.",
        bool,
        True,
    ),
    sensors=option("", "Without sensors it is read by older versions, too.", bool, True),
    finite_inertia=option(
        "--finite-inertia", "Point masses on pins with an inertia; they move the same.", bool, False
    ),
)
def export_command(call: Call) -> None:
    """Write a machine's MJCF: NAME.xml, and scene.xml with ground, light and camera for the viewer.

    Example: trebucheck models export rolling --set r=7 --out my-rolling
    """
    from ..comparisons.mjcf import step_and_motion
    from ..models.mjcf.variants import Variant
    from ..models.mjcf.writer import write_model_folder
    from ..models.problem import mechanism_of

    variant = Variant(sensors=call.sensors, finite_inertia=call.finite_inertia)
    for model in call.models():
        step, motion = step_and_motion(model, call.timestep, keyframes=call.keyframes)
        mechanism = mechanism_of(model)
        folder = call.out or Path(mechanism.name)
        write_model_folder(mechanism, folder, step, motion, variant)
        typer.echo(f"Wrote {output.printable(str(folder))}")


@models_app.command("path")
@command(
    "name scene",
    name=argument("Name of a machine.", names=options.machine_names),
    scene=option("--scene", "The file with ground, frame, light and camera.", bool, False),
)
def path_command(call: Call) -> None:
    """Print the path of a machine's MJCF file, with its default parameters.

    Example: trebucheck models path rolling
    """
    from ..models.mjcf import mjcf_path

    typer.echo(mjcf_path(call.name, scene=call.scene))


@plugin_app.command("new")
@command(
    "name node package",
    folder(None, "New folder; trebucheck-NAME by default."),
    name=argument("Of the engine: small letters, digits and hyphens."),
    node=option("--node", "The engine is the package of npm of its name.", bool, False),
    package=option("--package", "The engine is this package of npm.", metavar="NAME@VERSION"),
)
def new_command(call: Call) -> None:
    """Write a new folder with pyproject.toml, an engine to fill in, and its tests.

    An existing folder is refused.

    Examples:
    trebucheck plugin new my-engine

    trebucheck plugin new my-engine --package its-package@1.2.3
    """
    from ..conformance.skeleton import write_skeleton

    folder = call.out or Path(f"trebucheck-{call.name}")
    package = f"{call.name}@*" if call.node and call.package is None else call.package
    for path in write_skeleton(call.name, folder, package):
        typer.echo(f"Wrote {output.printable(str(path))}")
    typer.echo(f"\nNext: cd {output.printable(str(folder))}, and the commands of its README.md.")


@command(
    "name",
    name=argument(
        "One engine, to see its options; all are listed without it.",
        str | None,
        None,
        names=options.engine_names,
    ),
)
def engines_command(call: Call) -> None:
    """List the engines, or the options of one: defaults of each preset, values and meaning.

    An option is set by `--option NAME=VALUE` (of one engine: `--option mujoco.solref=-40000,-400`).

    Examples:
    trebucheck engines

    trebucheck engines mujoco
    """
    from ..comparisons.report.document import Document, Listing, Text, table, words
    from ..engines.registry import engines

    if call.name is not None:
        output.show(engine_document(call.name))
        return
    titles = ("engine", "version", "presets", "joint forces", "releases", "stop laws")
    rows: list[tuple[str | bool, ...]] = []
    formulations: list[Text] = []
    for status in engines().values():
        if status.broken:
            rows.append((status.name, "cannot be used", "", "", "", ""))
            formulations.append(Text(status.broken, "strong", lead=f"{status.name}:"))
            continue
        can = status.capabilities
        laws = ", ".join(sorted(can.stop_laws)).replace("release-once, unilateral", "both")
        version = status.version if status.installed else "not installed"
        releases = "inside a step" if can.located_releases else "at a step's end"
        presets = ", ".join(status.presets)
        rows.append((status.name, version, presets, can.joint_reactions, releases, laws))
        formulations.append(Text(can.formulation, "strong", lead=f"{status.name}:"))
    heads = [words(title, wrap=False) for title in titles]
    output.show(Document("engines", (table(heads, rows), Listing(tuple(formulations)))))


def engine_document(name: str) -> Document:
    """The options of an engine; InputError if there is no such engine."""
    from ..comparisons.report.document import Column, Document, Text, ranked, table, words
    from ..engines.options import default_text
    from ..engines.registry import engine_class, option_table, supplied_in
    from ..engines.supplied import sentence

    cls = engine_class(name)
    version = cls.version() if cls.is_installed() else "not installed"
    texts = [Text(cls.capabilities.formulation, "strong", lead=f"{name} ({version}):")]
    for preset in cls.presets():
        if (supplied := supplied_in(name, preset)) is not None:
            texts.append(Text(sentence(supplied), lead=f"{preset}:"))
    rows: list[tuple[str, str, str]] = []
    for row in option_table(name):
        # One default, or a line a preset where they differ.
        defaults = {preset: default_text(value) for preset, value in row.defaults.items()}
        lines = list(dict.fromkeys(defaults.values()))
        if len(lines) > 1:
            lines = [f"{text} ({preset})" for preset, text in defaults.items()]
        meaning = "\n".join(filter(None, (row.meaning, row.values)))
        rows.append((row.name, "\n".join(lines), meaning))
    heads = (Column("option"), words("default"), words("meaning and values"))
    blocks = [*texts, table(ranked(heads, default=0, meaning_and_values=0), rows)]
    if not rows:
        blocks.append(Text(f"{name} does not say which options it has."))
    return Document(name, tuple(blocks))
