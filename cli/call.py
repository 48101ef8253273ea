"""Commands from their options: declared once in `options.OPTIONS`, read once here."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import typer

from ..models.problem import Problem, mechanism_of
from . import options, output
from .options import OPTIONS, Declared

if TYPE_CHECKING:
    from ..comparisons.report.document import Document
    from ..comparisons.runs.process import Worker
    from ..comparisons.runs.store import Store
    from ..comparisons.runs.study import Progress
    from ..models.mechanism import Mechanism


class Call:
    """One call of a command: the values of its options, and what commands make of them."""

    def __init__(self, context: typer.Context, values: Mapping[str, Any]) -> None:
        self.context, self.values = context, values
        self.told = output.Told(values.get("quiet", False), values.get("json", False))

    def __getattr__(self, name: str) -> Any:
        if name not in self.values:
            raise AttributeError(f"this command has no option {name!r}")
        return self.values[name]

    @property
    def command_line(self) -> str | None:
        """The line that makes the same again; None where there was none."""
        return output.command_line(self.context)

    def models(self) -> list[Mechanism | Problem]:
        """Models of --models or --model, named ones with the parameters of --set and --beam."""
        text = self.values.get("models", self.values.get("model"))
        return options.given(text, self.values.get("set"), self.values.get("beam"))

    def only_model(self) -> Mechanism | Problem:
        """The one model of a command that takes one.

        Raises:
            InputError: several are named.
        """
        command = self.context.info_name or ""
        return options.only(self.model, self.values.get("set"), self.values.get("beam"), command)

    def only_mechanism(self) -> Mechanism:
        """The mechanism of the one model."""
        return mechanism_of(self.only_model())

    def parameters(self) -> options.Chosen:
        """Values of --set and --beam, before it is known of which model."""
        return options.parameters(self.values.get("set"), self.values.get("beam"))

    def names(self, option: str) -> list[str] | None:
        """A comma list; None, which stands for all, where nothing is said."""
        return options.chosen_names(self.values[option], f"--{option}")

    def run_options(self) -> dict[str, Any]:
        """Keywords of a study: its models, engines, presets, and how they are run."""
        found: dict[str, Any] = {"models": self.models()}
        engines = self.names("engines") if "engines" in self.values else None
        if "engines" in self.values:
            found["engines"] = engines
        if "preset" in self.values:
            found["presets"] = options.names(self.preset, "--preset")
        if "option" in self.values:
            step = self.values.get("timestep")
            found["options"] = options.engine_options(self.option, step, engines)
        if "tolerance" in self.values:
            found["tolerances"] = options.needs(self.tolerance, self.tolerances)
        for name in ("duration", "until", "stop_law", "timeout", "jobs", "diagnose"):
            if name in self.values:
                found[name] = self.values[name]
        return found

    def store(self, trajectories: str = "trials", records: str = "trials") -> Store:
        """The store of runs in the folder of --out, which is refused if it cannot be written to."""
        from ..comparisons.runs.store import Store
        from ..models.files import refuse_unwritable

        refuse_unwritable(self.out)
        return Store(self.out / trajectories, self.resume, self.out / records)

    def worker(self, isolate: bool = True) -> Worker:
        """Processes for runs of at most --timeout."""
        from ..comparisons.runs.process import Worker

        return Worker(options.positive(self.timeout, "--timeout"), isolate)

    def progress(
        self, what: str = "reference", width: int = 40
    ) -> AbstractContextManager[Progress]:
        """The progress bar; see :func:`.output.progress`."""
        return output.progress(what, width, self.told)

    def publish(
        self, data: str, text: str, report: Document, page: str, called: str = "Report", **more: Any
    ) -> None:
        """Write data and page, of these names, into the folder of --out; show the report."""
        output.publish(
            (self.out / data, text), report, self.out / page, called, told=self.told, **more
        )


Answer = bool | None
"""Answer of a command: False for exit code 1."""


def command(
    names: str, out: Declared | None = None, **own: object
) -> Callable[[Callable[[Call], Answer]], Callable[..., None]]:
    """Make a command of a function of its call.

    Args:
        names: of its options, in the order of the help: of `OPTIONS`, or of `own`.
        out: its --out, last in the help.
        own: options that are this command's alone, or other defaults of shared ones.

    Returns:
        What Typer takes: the signature is made of the options, the help is the docstring.
    """
    declared: dict[str, Declared] = {}
    for name in names.split():
        choice = own.get(name, OPTIONS.get(name))
        if not isinstance(choice, Declared):
            choice = replace(OPTIONS[name], default=choice)
        declared[name] = choice
    if out is not None:
        declared["out"] = out
    kind = inspect.Parameter.KEYWORD_ONLY
    parameters = [inspect.Parameter("context", kind, annotation=typer.Context)]
    for name, option in declared.items():
        parameters.append(
            inspect.Parameter(name, kind, default=option.default, annotation=option.annotation)
        )
    signature = inspect.Signature(parameters)

    def register(function: Callable[[Call], Answer]) -> Callable[..., None]:
        def run(context: typer.Context, **values: Any) -> None:
            if function(Call(context, values)) is False:
                raise typer.Exit(1)

        run.__doc__, run.__name__ = function.__doc__, function.__name__
        run.__module__ = function.__module__
        run.__signature__ = signature  # pyright: ignore[reportFunctionMemberAccess]
        run.__annotations__ = {each.name: each.annotation for each in parameters}
        return run

    return register
