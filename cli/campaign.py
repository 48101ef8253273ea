"""`trebucheck campaign run`, `resume`, `show`, `diff` and `machine`: many machines at once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..models.errors import InputError
from . import output
from .agree import FACTOR
from .call import Call, command
from .options import argument, folder, option

if TYPE_CHECKING:
    from ..comparisons.campaigns.store import CampaignStore

campaign_app = typer.Typer(
    help="Many machines at once: where engines part, over parameters or random mechanisms.",
    no_args_is_help=True,
)
_STORE = argument("Folder of a campaign.", Path)
_X = option("--x", "Parameter along the map; the first that varies by default.")
_Y = option("--y", "Parameter up the map; the second that varies by default.")


@campaign_app.command("run")
@command(
    "file x y jobs cluster quiet",
    folder("campaign", "Folder of the store: rows as Parquet files, and campaign.html."),
    file=argument("Description of the campaign (TOML).", Path),
    x=_X,
    y=_Y,
)
def run_command(call: Call) -> bool:
    """Run engines on many machines, or launch them by the reference; keep a row a run.

    The file says which machines (a grid, or a random, Latin hypercube or Sobol design over
    parameters, or random mechanisms), which engines, presets and steps, and what is kept. Rows are
    written chunk by chunk, and can be read meanwhile (pandas, polars, DuckDB). What was
    interrupted goes on by `trebucheck campaign resume`. Exit code 1: nothing could be judged or
    launched.

    Example: trebucheck campaign run arms.toml --out arms --jobs 2
    """
    from ..comparisons.campaigns.campaign import campaign
    from ..comparisons.campaigns.spec import Campaign

    described = Campaign.read(call.file)
    described.axes(call.x, call.y)  # before any run
    with call.progress("preparing") as show:
        store = campaign(
            described,
            call.out,
            jobs=call.jobs,
            cluster=call.cluster,
            progress=show,
            command=call.command_line,
        )
    return _publish(call, store)


@campaign_app.command("resume")
@command("campaign x y jobs cluster quiet", campaign=_STORE, x=_X, y=_Y)
def resume_command(call: Call) -> bool:
    """Make what is missing of a campaign, and what failed for its process's sake.

    Example: trebucheck campaign resume arms
    """
    from ..comparisons.campaigns.campaign import campaign, open_campaign

    begun = open_campaign(call.campaign)
    begun.campaign.axes(call.x, call.y)  # before any run
    with call.progress("preparing") as show:
        store = campaign(
            begun.campaign, call.campaign, jobs=call.jobs, cluster=call.cluster, progress=show
        )
    return _publish(call, store)


@campaign_app.command("show")
@command("campaign x y quiet", campaign=_STORE, x=_X, y=_Y)
def show_command(call: Call) -> bool:
    """Draw the map of a campaign that is there, or grows, and rank its parameters.

    Example: trebucheck campaign show arms --x l1 --y r
    """
    from ..comparisons.campaigns.campaign import open_campaign

    return _publish(call, open_campaign(call.campaign))


@campaign_app.command("diff")
@command(
    "old new factor quiet",
    folder(None, "Page to write; none by default."),
    old=argument("Folder of the campaign of before.", Path),
    new=argument("Folder of the campaign of now.", Path),
    factor=option("--factor", "By which an error must change to have moved.", float, FACTOR),
)
def diff_command(call: Call) -> bool:
    """Compare two campaigns of the same machines run by run, of two versions of an engine, say.

    Exit code 1: a verdict is worse, or a run is missing.

    Example: trebucheck campaign diff arms-4.0 arms-4.1
    """
    from ..comparisons.campaigns.campaign import open_campaign
    from ..comparisons.campaigns.changes import difference
    from ..comparisons.report import html
    from ..comparisons.report.pages.campaign import difference_document
    from ..models.files import write_text

    found = difference(open_campaign(call.old), open_campaign(call.new), call.factor)
    page = difference_document(found)
    files = {} if call.out is None else {"Page": call.out}
    if call.out is not None:
        write_text(call.out, html.page(page))
    output.show(page, call.told, **files)
    return found.passed


@campaign_app.command("machine")
@command(
    "campaign number",
    campaign=_STORE,
    number=argument("Number of the machine.", int, metavar="NUMBER"),
)
def machine_command(call: Call) -> None:
    """Print a machine of a campaign as JSON, to run it alone or to look at it.

    Example: trebucheck campaign machine arms 17
    """
    from ..comparisons.campaigns.campaign import open_campaign
    from ..comparisons.campaigns.machines import machine
    from ..models.problem import mechanism_of

    typer.echo(mechanism_of(machine(open_campaign(call.campaign), call.number)).to_json())


@campaign_app.command("shrink")
@command(
    "campaign number engine preset timestep quiet",
    folder("shrunk", "Folder for machine.json, and for script.py where the adapter writes one."),
    campaign=_STORE,
    number=argument("Number of the machine.", int, metavar="NUMBER"),
    engine=option("--engine", "Engine that disagrees; the campaign's only one by default."),
    preset=option("--preset", "Its preset; the campaign's only one by default."),
)
def shrink_command(call: Call) -> None:
    """Find the least mechanism that still shows a disagreement, for those who write the engine.

    Bodies, elements and digits are taken away as long as the engine breaks the tolerance of the
    quantity that was worst.

    Example: trebucheck campaign shrink wild 17 --engine mujoco --preset settings
    """
    from ..comparisons.campaigns.campaign import open_campaign
    from ..comparisons.campaigns.machines import EngineCase, machine
    from ..comparisons.campaigns.shrink import shrink
    from ..comparisons.report.pages.campaign import shrunk_document
    from ..models.files import refuse_unwritable, write_text

    store = open_campaign(call.campaign)
    runs = store.campaign.runs
    if runs is None:
        raise InputError(f"{store.folder} holds launches, not runs of engines.")
    engine = _only("--engine", call.engine, runs.engines)
    case = EngineCase(engine, _only("--preset", call.preset, runs.presets), call.timestep)
    given = machine(store, call.number)
    refuse_unwritable(call.out)
    with call.progress("the whole machine") as show:
        found = shrink(given, runs, case, show)
    files = {"Machine": call.out / "machine.json"}
    write_text(files["Machine"], found.mechanism.to_json() + "\n")
    if found.script is not None:
        files["Script"] = call.out / "script.py"
        write_text(files["Script"], found.script)
    page = shrunk_document(given, found, runs, case, files["Machine"])
    output.show(page, call.told, **files)


def _only(option: str, asked: str | None, there: Sequence[str]) -> str:
    """The one that is asked for, or the only one there is."""
    if asked is None:
        if len(there) > 1:
            raise InputError(f"{option} is needed; the campaign has: {', '.join(there)}.")
        return there[0]
    if asked not in there:
        raise InputError(f"{option} {asked!r} is none of the campaign's: {', '.join(there)}.")
    return asked


def _publish(call: Call, store: CampaignStore) -> bool:
    """Write the page of a campaign and show it; False where nothing was judged or launched."""
    from ..comparisons.report import html
    from ..comparisons.report.pages.campaign import document
    from ..models.files import write_text

    page = document(store, call.x, call.y)
    path = store.folder / "campaign.html"
    write_text(path, html.page(page))
    output.show(page, call.told, Page=path, Rows=store.row_folder)
    return store.has_result
