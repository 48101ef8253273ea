"""Commands from their options: declared once in `options.OPTIONS`, read once here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from functools import cached_property
from inspect import Parameter, Signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ..models.errors import InputError
from ..models.mechanism import Mechanism
from ..models.problem import Problem, mechanism_of
from . import options, output
from .options import OPTIONS

if TYPE_CHECKING:
    from ..comparisons.report.document import Document
    from ..comparisons.runs.process import Worker
    from ..comparisons.runs.store import Store
    from ..comparisons.runs.study import Progress
    from ..models.library.trebuchet import TrebuchetParameters
    from ..models.spec import Spec


class Call:
    """One call of a command: the values of its options, and what commands make of them."""

    def __init__(self, context: typer.Context, values: Mapping[str, Any]) -> None:
        self.context, self.values = context, values
        self.told = output.Told(values.get("quiet", False), values.get("json", False))
        self.command_line = output.command_line(context)

    def __getattr__(self, name: str) -> Any:
        if name not in self.values:
            raise AttributeError(f"this command has no option {name!r}")
        return self.values[name]

    @cached_property
    def numbers(self) -> dict[str, float]:
        """Values of --set; InputError if a text is not NAME=NUMBER."""
        texts = options.assignments(self.values.get("set"), "--set")
        return {name: options.number(text, f"--set {name} =") for name, text in texts.items()}

    def parameters(self, name: str) -> Spec | None:
        """Parameters of a named machine from --set and --beam; None where nothing was chosen.

        Raises:
            InputError: the machine, or one of the names, is unknown, or a value is not valid.
        """
        from ..models.library.registry import parameters_type
        from ..models.library.trebuchet import short_end

        kind, values, beam = parameters_type(name), dict(self.numbers), self.values.get("beam")
        fields = kind.model_fields
        for parameter in values:
            if parameter not in fields:
                raise InputError(
                    f"--set {parameter}: there is no such parameter; there are: "
                    f"{', '.join(fields)} (of {name})."
                )
        if beam is not None:
            if not {"l1", "l2"} <= fields.keys():
                raise InputError(
                    f"--beam {beam!r} keeps l1 + l2 of a trebuchet; these parameters have no "
                    f"l1 and l2."
                )
            if "l2" in values:
                raise InputError("--beam chooses l2 itself; leave out --set l2, or --beam.")
            values["l2"] = short_end(values.get("l1", float(fields["l1"].default)), beam)
        return kind(**values) if values else None

    def whipper(self, name: str) -> TrebuchetParameters | None:
        """The same for a machine of the paper; None, too, for any other."""
        from ..models.library.registry import models
        from ..models.library.trebuchet import TrebuchetParameters

        parameters = self.parameters(name) if name in models() else None
        return parameters if isinstance(parameters, TrebuchetParameters) else None

    def models(self, text: str | None = None) -> list[Mechanism | Problem]:
        """Mechanisms by name or from files, and problems of the library.

        Named ones have the parameters of --set and --beam.

        Args:
            text: comma list; the value of --models, --model or NAME where left out.

        Raises:
            InputError: a name is unknown, a parameter is not valid, or a file cannot be read or is
                not a mechanism.
        """
        from ..comparisons.runs.model_files import SUFFIXES, from_mjcf, is_file, read_file
        from ..models.library.registry import library_problem, model

        if text is None:
            keys = self.values.keys() & {"models", "model", "name"}
            text = str(self.values[keys.pop()])
        changed = bool(self.numbers) or self.values.get("beam") is not None
        models: list[Mechanism | Problem] = []
        for name in options.names(text, "--models"):
            if not is_file(name):
                self._refuse_start(name)
                parameters = self.parameters(name)
                models.append(library_problem(name, parameters) or model(name, parameters))
            elif changed:
                raise InputError(
                    f"--set and --beam are for named machines; {name} holds its own values."
                )
            elif Path(name).suffix.lower() in SUFFIXES and self._started():
                models.append(from_mjcf(name, **self.model_start()))
            else:
                self._refuse_start(name)
                models.append(read_file(Path(name)))
        return models

    def _started(self) -> list[str]:
        """Options that are given of a model file's start, and of what of it is left out."""
        names = ("keyframe", "qpos", "qvel", "ctrl", "without")
        values = {name: self.values.get(name) for name in names}
        return [f"--{name} {value!s}" for name, value in values.items() if value is not None]

    def _refuse_start(self, name: str) -> None:
        """Refuse a start for a model that has its own.

        Raises:
            InputError: one is given.
        """
        from ..comparisons.runs.model_files import SUFFIXES

        if started := self._started():
            raise InputError(
                f"{', '.join(started)}: {name!r} has a start of its own; these options are for "
                f"model files ({', '.join(SUFFIXES)})."
            )

    def only_model(self) -> Mechanism | Problem:
        """The one model of a command that takes one.

        Raises:
            InputError: as of :meth:`models`, or several are named.
        """
        models = self.models()
        if len(models) != 1:
            text = self.values.get("model", self.values.get("name"))
            raise InputError(
                f"--model {text!r} names {len(models)} machines; `{self.context.info_name}` takes "
                "one."
            )
        return models[0]

    def only_mechanism(self) -> Mechanism:
        """The mechanism of the one model."""
        return mechanism_of(self.only_model())

    def model_start(self) -> dict[str, Any]:
        """Keywords of a model file's start, and of what of it is left out."""
        from ..models.controls import SUFFIXES

        how: dict[str, Any] = {}
        for name in ("qpos", "qvel", "ctrl"):
            text = self.values[name]
            if name == "ctrl" and text is not None and text.lower().endswith(SUFFIXES):
                how[name] = Path(text)
            elif text is not None:
                how[name] = options.numbers(text, f"--{name}")
        return {**how, "keyframe": self.keyframe, "without": self.names("without") or ()}

    def names(self, option: str) -> list[str] | None:
        """A comma list; None, which stands for all, where nothing is said."""
        return options.chosen_names(self.values[option], f"--{option}")

    def run_options(self) -> dict[str, Any]:
        """Keywords of a study: its engines, presets, and how they are run; not its models."""
        from ..comparisons.runs.tolerances import ToleranceFile

        keywords: dict[str, Any] = {}
        engines = None
        if "engines" in self.values:
            engines = keywords["engines"] = self.names("engines")
        if "preset" in self.values:
            keywords["presets"] = options.chosen_names(self.preset, "--preset")
        if "option" in self.values:
            step = self.values.get("timestep")
            keywords["options"] = options.engine_options(self.option, step, engines)
        if "tolerance" in self.values:
            file: Path | None = self.tolerances
            tolerances = {} if file is None else dict(ToleranceFile.load(file).tolerances)
            # Those of the command line go first.
            keywords["tolerances"] = tolerances | options.assignments(self.tolerance, "--tolerance")
        for name in (
            "duration",
            "until",
            "stop_law",
            "timeout",
            "jobs",
            "cluster",
            "diagnose",
            "sweep",
        ):
            if name in self.values:
                keywords[name] = self.values[name]
        return keywords

    def store(self, trajectories: str = "trials", records: str = "trials") -> Store:
        """The store of runs in the folder of --out, which is refused if it cannot be written to."""
        from ..comparisons.runs.store import Store
        from ..models.files import refuse_unwritable

        refuse_unwritable(self.out)
        return Store(self.out / trajectories, self.resume, self.out / records)

    def worker(self, isolate: bool = True) -> Worker:
        """Processes for runs of at most --timeout."""
        from ..comparisons.runs.process import Worker

        return Worker(self.timeout, isolate)

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
    names: str, out: Parameter | None = None, **own: object
) -> Callable[[Callable[[Call], Answer]], Callable[..., None]]:
    """Make a command of a function of its call.

    Args:
        names: of its options, in the order of the help: of `OPTIONS`, or of `own`.
        out: its --out, last in the help.
        own: options that are this command's alone, or other defaults of shared ones.

    Returns:
        What Typer takes: the signature is made of the options, the help is the docstring.

    Raises:
        ValueError: an option of its own is not among the names.
    """
    if unnamed := own.keys() - set(names.split()):
        raise ValueError(f"options without a place in the help: {', '.join(sorted(unnamed))}")
    parameters = [Parameter("context", Parameter.KEYWORD_ONLY, annotation=typer.Context)]
    for name in names.split():
        option = own.get(name, OPTIONS.get(name))
        if not isinstance(option, Parameter):
            option = OPTIONS[name].replace(default=option)
        parameters.append(option.replace(name=name))
    if out is not None:
        parameters.append(out.replace(name="out"))

    def register(function: Callable[[Call], Answer]) -> Callable[..., None]:
        def run(context: typer.Context, **values: Any) -> None:
            if function(Call(context, values)) is False:
                raise typer.Exit(1)

        run.__doc__, run.__name__ = function.__doc__, function.__name__
        run.__module__ = function.__module__
        run.__signature__ = Signature(parameters)  # pyright: ignore[reportFunctionMemberAccess]
        run.__annotations__ = {each.name: each.annotation for each in parameters}
        return run

    return register
