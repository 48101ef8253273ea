"""Engines by name, built-in ones and plug-ins; none is imported before it is asked for."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import sys
from collections.abc import Callable, Generator, Hashable, Iterable, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache, lru_cache
from itertools import chain
from pathlib import Path
from threading import Lock
from typing import Any, NoReturn, Protocol, cast, runtime_checkable

from pydantic import JsonValue

from ..models.errors import InputError, TrebucheckError, UnsupportedProblemError
from ..models.features import Basic, Feature, refuse_features
from ..models.mechanism import Mechanism
from ..models.problem import Problem, StopLaw
from ..models.trajectory import Trajectory
from .inspection import Inspectable, Inspection, State
from .options import (
    OptionField,
    OptionRow,
    current_name,
    option_fields,
    refuse_reserved,
    settings_of,
    unknown_option,
)
from .presets import ASSISTED, GIVEN, PRESETS, resolved
from .protocol import BuiltinEngine, Capabilities, Engine, Simulator, refuse_no_problem
from .study import Cause, ConstraintKinds, EngineStudy
from .supplied import Supplied, stated

PLUGIN_GROUP = "trebucheck.engines"
"""Entry-point group in which another package announces an engine class."""
ANNOUNCED = "TREBUCHECK_ENGINES"
"""Environment variable with engines of packages that are not installed.

Its value is 'name=module:Class', separated by spaces; processes that are started inherit it.
"""

Engines = str | Engine | Iterable[str | Engine]
"""Names, or engines as `trebucheck.engine` makes them."""
Names = str | Iterable[str]

_BUILTIN = {
    "reference": ("reference.engine", "ReferenceEngine"),
    "mujoco": ("mujoco.engine", "MujocoEngine"),
    "pymunk": ("pymunk.engine", "PymunkEngine"),
    "exudyn": ("exudyn.engine", "ExudynEngine"),
}


class EngineClass(Protocol):
    """An engine's class, to which a plug-in's entry point leads."""

    name: str
    capabilities: Capabilities

    def presets(self) -> Mapping[str, Callable[..., Simulator]]:
        """Makers by the name of the preset; one at least of :data:`.presets.PRESETS`."""
        ...

    def is_installed(self) -> bool:
        """Tell whether it can run here."""
        ...

    def version(self) -> str:
        """Version of the engine behind it."""
        ...


def engine_names() -> tuple[str, ...]:
    """Names of known engines, installed or not, the built-in ones first."""
    plugins = sorted({*(point.name for point in _installed()), *_announced()})
    return tuple(_BUILTIN) + tuple(name for name in plugins if name not in _BUILTIN)


def _installed() -> tuple[importlib.metadata.EntryPoint, ...]:
    """Engines of installed distributions; read again when a folder of `sys.path` has changed."""
    changed: list[tuple[Path, int]] = []
    for path in map(Path, sys.path):
        with suppress(OSError):  # there is no such folder or archive
            changed.append((path.absolute(), path.stat().st_mtime_ns))
    return _points_in(tuple(changed))


@lru_cache(maxsize=1)
def _points_in(_: tuple[tuple[Path, int], ...]) -> tuple[importlib.metadata.EntryPoint, ...]:
    return tuple(importlib.metadata.entry_points(group=PLUGIN_GROUP))


def _announced() -> dict[str, importlib.metadata.EntryPoint]:
    """Entry points that the environment variable announces, by name."""
    points: dict[str, importlib.metadata.EntryPoint] = {}
    for pair in os.environ.get(ANNOUNCED, "").split():
        name, _, path = pair.partition("=")
        points[name] = importlib.metadata.EntryPoint(name, path, PLUGIN_GROUP)
    return points


def announce(path: str) -> str:
    """Make a class known by its engine's name, here and in processes started from now on.

    Args:
        path: of the class, as 'package.module:Class'.

    Raises:
        InputError: there is no such class, or its name is missing, unusable or a built-in engine's.
    """
    cls = _loaded(importlib.metadata.EntryPoint(path, path, PLUGIN_GROUP))
    name: object = getattr(cls, "name", None)
    if not isinstance(name, str) or not name or set(name) & set(" =/"):
        raise InputError(
            f"engine {path}: its name is {name!r}; a text without spaces, '=' and '/' is needed."
        )
    if name in _BUILTIN:
        raise InputError(
            f"engine {path}: its name {name!r} is that of an engine of trebucheck; another one "
            f"is needed."
        )
    known = {point.name: point.value for point in _announced().values()} | {name: path}
    os.environ[ANNOUNCED] = " ".join(f"{name}={value}" for name, value in known.items())
    return name


def _loaded(point: importlib.metadata.EntryPoint) -> EngineClass:
    """A plug-in's class; one that lacks a part is refused before that is missed somewhere else."""
    name = f"engine {point.name!r}"
    if not point.pattern.match(point.value):
        raise InputError(
            f"{name}: {point.value!r} is no path of a class; it has the form package.module:Class."
        )
    broken = f"{name} comes from a plug-in that cannot be loaded"
    try:
        with _exit_raised():
            cls: object = point.load()
    except KeyboardInterrupt:
        raise
    except SystemExit as error:
        raise InputError(
            f"{broken}: on import it ends the process, with exit code {error.code!r}."
        ) from error
    except BaseException as error:
        raise InputError(f"{broken}: {type(error).__name__}: {error}.") from error
    if not isinstance(cls, Hashable):
        raise InputError(f"{name}: its entry point leads to {cls!r}; a class is needed.")
    _refuse_unusable(name, cls)
    return cast("EngineClass", cls)


@cache
def _refuse_unusable(name: str, cls: object) -> None:
    """Raise InputError if a plug-in's class lacks a part, or one gives or raises something else.

    Args:
        name: of the engine, as the sentence is to name it.
        cls: what its entry point leads to.
    """
    declared = getattr(cls, "capabilities", None)
    if not isinstance(declared, Capabilities):
        has = f"has capabilities of type {type(declared).__name__}"
        if declared is None:
            has = "has no `capabilities`"
        raise InputError(f"{name}: its class {has}; a trebucheck.Capabilities is needed.")
    if not callable(getattr(cls, "presets", None)):
        raise InputError(
            f"{name}: its class has no `presets()`; makers by name, as {', '.join(PRESETS)}, are "
            "needed."
        )
    if isinstance(cls, type) and issubclass(cls, BuiltinEngine) and not hasattr(cls, "package"):
        version = getattr(cls.version, "__func__", None)
        if version is BuiltinEngine.version.__func__:
            raise InputError(
                f"{name}: its class has no `package`, the distribution whose version is reported; "
                "an engine that is none has is_installed() and version() of its own."
            )
    for method, kind, needed in _METHODS:
        if not (method == "study" and not hasattr(cls, method)):
            _refuse_answer(name, cls, method, kind, needed)


_METHODS: tuple[tuple[str, type, str], ...] = (
    ("presets", Mapping, "makers by name"),
    ("version", object, "a text"),  # whether it is one is for `conform` to tell
    ("is_installed", bool, "True or False"),
    ("study", EngineStudy, "a trebucheck.engines.study.EngineStudy"),
)
"""Methods of an engine's class, the types of what they give, and these in words."""


def _refuse_answer(name: str, cls: object, method: str, kind: type, needed: str) -> None:
    """Raise InputError if a method of an engine's class raises, or gives something else."""
    try:
        with _exit_raised():
            answer: object = getattr(cls, method)()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise InputError(
            f"{name}: {method}() of its class raises {type(error).__name__}: {error}; {needed} is "
            "needed."
        ) from error
    if not isinstance(answer, kind):
        raise InputError(f"{name}: {method}() of its class gives {answer!r}; {needed} is needed.")


_EXIT, _EXIT_LOCK = os._exit, Lock()
_raising: list[None] = []  # an entry a thread in which `os._exit` is to raise


@contextmanager
def _exit_raised() -> Generator[None, None, None]:
    """Make `os._exit` an exception, as `sys.exit` is: a plug-in must not end a study in silence."""
    with _EXIT_LOCK:
        _raising.append(None)
        os._exit = _raise_exit
    try:
        yield
    finally:
        with _EXIT_LOCK:
            _raising.pop()
            if not _raising:
                os._exit = _EXIT


def _raise_exit(status: int) -> NoReturn:
    raise SystemExit(status)


def engine_class(name: str) -> EngineClass:
    """The class of an engine; InputError if none has that name, or its plug-in cannot be loaded."""
    if name in _BUILTIN:
        module, cls = _BUILTIN[name]
        # By name: an engine, with its library, is imported when it is asked for.
        return cast("EngineClass", getattr(importlib.import_module(f".{module}", __package__), cls))
    for point in (*_announced().values(), *_installed()):
        if point.name == name:
            return _loaded(point)
    known = engine_names()
    close = get_close_matches(name, known, n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    if ":" in name:
        hint = (
            " (a class that is not installed is taken by `conform` and `pytest --trebucheck`; "
            "else install it)"
        )
    raise InputError(f"there is no engine {name!r}{hint}; there are: {', '.join(known)}.")


def engine_study(name: str) -> EngineStudy:
    """Tables that studies use of an engine; the default if its class has none or is unknown."""
    try:
        study = getattr(engine_class(name), "study", EngineStudy)
    except InputError:
        return EngineStudy()
    return cast("EngineStudy", study())


def causes_of(engine: Engine, mechanism: Mechanism | None = None) -> tuple[Cause, ...]:
    """Causes of error that an engine with these options may have, in the order of removal.

    Nothing is run. A cause whose options are already set as its removal would set them is left out.
    Some are there only where the mechanism holds points, by stops or by loops of joints.
    """
    settings = engine.settings
    causes: list[Cause] = []
    for cause in engine_study(engine.name).causes(settings, ConstraintKinds.of(mechanism)):
        ways = (cause.removal, cause.scaling)
        if any(way is not None and way.changes(settings) for way in ways):
            causes.append(cause)
    names = {cause.name for cause in causes}
    return tuple(
        replace(cause, after=tuple(name for name in cause.after if name in names))
        for cause in causes
    )


@dataclass(frozen=True)
class EngineStatus:
    """Availability of an engine: version, presets and capabilities."""

    name: str
    installed: bool
    version: str
    presets: tuple[str, ...]
    capabilities: Capabilities
    broken: str = ""
    """A sentence on why its plug-in cannot be used; empty where it can."""


_UNKNOWN = Capabilities(False, False, False, frozenset(), "not known", stop_torques=False)
"""Capabilities of an engine whose class cannot be used."""


def engines() -> dict[str, EngineStatus]:
    """List known engines by name, installed or not, without importing any engine's library.

    A plug-in that cannot be used is in the list and says why.
    """
    status: dict[str, EngineStatus] = {}
    for name in engine_names():
        try:
            cls = engine_class(name)
        except InputError as error:
            status[name] = EngineStatus(name, False, "broken", (), _UNKNOWN, str(error))
            continue
        version, presets = str(cls.version()), tuple(cls.presets())
        status[name] = EngineStatus(name, cls.is_installed(), version, presets, cls.capabilities)
    return status


def engine(name: str, preset: str = ASSISTED, **options: Any) -> Engine:
    """An engine with its numerical options.

    Args:
        name: one of :func:`engines`.
        preset: 'default' (what the engine does where nothing is set), 'settings' (the best that its
            own options reach), 'assisted' (with what trebucheck does in its place), or 'given' (a
            model file moved as it is, for mechanisms that were read from one).
        options: any field of the engine, over the preset's; `timestep` [s] in every engine.

    Raises:
        InputError: the name, the preset or an option is unknown or not valid.
    """
    makers = _makers(name)
    preset = resolved(preset, makers)
    if preset not in makers:
        raise InputError(f"{name} has no preset {preset!r}; there are: {', '.join(makers)}.")
    try:
        with _exit_raised():
            simulator = makers[preset](**options)
            is_whole = isinstance(simulator, Engine)  # which reads the properties of a plug-in's
            return simulator if is_whole else completed(simulator, preset, options)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        known = option_names(name) or tuple(options)
        for unknown in (option for option in options if option not in known):
            raise unknown_option(name, unknown, known) from None
        if name in _BUILTIN or isinstance(error, TrebucheckError | MemoryError):
            raise
        if options and isinstance(error, TypeError):  # perhaps of an option that it does not take
            raise
        raise InputError(
            f"engine {name!r} cannot be made with the preset {preset!r}: "
            f"{type(error).__name__}: {error}."
        ) from error


def all_presets(name: str) -> tuple[str, ...]:
    """Names of all presets of an engine, that of model files among them."""
    return tuple(_makers(name))


def _makers(name: str) -> Mapping[str, Callable[..., Simulator]]:
    """Makers of an engine by the name of the preset, that of model files among them."""
    given = engine_study(name).as_given
    return {**engine_class(name).presets(), **({} if given is None else {GIVEN: given})}


def presets_of(name: str, asked: Iterable[str] = PRESETS) -> tuple[str, ...]:
    """Those of some presets that an engine has, in their order, or all of a former release's.

    Args:
        name: of the engine.
        asked: names; :data:`.presets.PRESETS` stands for all that move any mechanism.
    """
    asked, known = tuple(asked), tuple(_makers(name))
    if asked == PRESETS:
        return tuple(sorted((each for each in known if each != GIVEN), key=_shown_at))
    found = (resolved(preset, known) for preset in asked)
    return tuple(dict.fromkeys(preset for preset in found if preset in known))


def _shown_at(preset: str) -> int:
    return PRESETS.index(preset) if preset in PRESETS else len(PRESETS)


def option_names(name: str) -> tuple[str, ...] | None:
    """Names of an engine's options; None where the class of a plug-in does not tell them."""
    fields = option_fields(engine_class(name))
    return None if fields is None else tuple(field.name for field in fields)


def option_table(name: str) -> tuple[OptionRow, ...]:
    """Options of an engine; of a class that does not tell them, those that its presets set."""
    cls = engine_class(name)
    settings = {preset: engine(name, preset).settings for preset in cls.presets()}
    fields = option_fields(cls)
    if fields is None:
        fields = tuple(map(OptionField, dict.fromkeys(chain.from_iterable(settings.values()))))
    rows: list[OptionRow] = []
    for field in fields:
        defaults = {
            preset: values[field.name]
            for preset, values in settings.items()
            if field.name in values
        }
        rows.append(OptionRow(field.name, defaults, field.values, field.meaning))
    return tuple(rows)


def options_for(name: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Options of one engine among those of several.

    Names without an engine are for every one that has them; 'mujoco.solref' goes first.
    """
    known = option_names(name)
    shared, own = dict[str, Any](), dict[str, Any]()
    for key, value in options.items():
        owner, dot, option = key.rpartition(".")
        option = current_name(option, known)
        if owner == name:
            own[option] = value
        elif not dot and (known is None or option in known):
            shared[option] = value
    return shared | own


def refuse_unknown_options(options: Mapping[str, Any], names: Sequence[str]) -> None:
    """Raise InputError if an option belongs to none of these engines; values are checked later."""
    refuse_reserved({key.rpartition(".")[2]: value for key, value in options.items()})
    for key in options:
        owner, dot, option = key.rpartition(".")
        if dot and owner not in names:
            raise InputError(
                f"option {key}: {owner!r} is not among the engines asked for: {', '.join(names)}."
            )
        known = [option_names(name) for name in ([owner] if dot else names)]
        if all(own is not None and current_name(option, own) not in own for own in known):
            every = list(dict.fromkeys(option for own in known for option in own or ()))
            raise unknown_option(owner or ", ".join(names), option, every)


def with_options(base: Engine, changes: Mapping[str, JsonValue]) -> Engine:
    """The engine made again, with options set otherwise; InputError if it cannot take them."""
    if not changes:
        return base
    try:
        return engine(base.name, base.preset, **{**base.settings, **changes})
    except TypeError as error:
        raise InputError(
            f"options of the engine {base.name!r} cannot be changed: {error}."
        ) from error


def capabilities_of(name: str, preset: str) -> Capabilities:
    """Capabilities of an engine with the options of a preset."""
    try:
        return able(engine(name, preset))
    except Exception:  # of a class that cannot be made, which is said where it is to move something
        return engine_class(name).capabilities


def supplied_in(name: str, preset: str) -> dict[str, str] | None:
    """Parts of a run that trebucheck does with a preset; None if not stated, or not makeable."""
    try:
        return stated(engine(name, preset))
    except Exception:  # which is said where it is to move something
        return None


# --- Engines as users give them: names or engines, with presets and options


@dataclass(frozen=True)
class ChosenEngines:
    """Engines by name, their presets, and options over the presets'."""

    names: tuple[str, ...] | None  # None: every known engine
    presets: tuple[str, ...]
    options: Mapping[str, Any]  # of every engine that has them, or of one, as 'mujoco.solref'


def engines_of(
    given: Engines | None,
    presets: Names | None,
    options: Mapping[str, Any],
    default: tuple[str, ...],
) -> ChosenEngines:
    """Engines, presets and options, however they are given.

    An engine that is an object stands for its name, its preset, and those of its options that are
    not the preset's.

    Args:
        given: one or several; None: every known engine.
        presets: one or several; None: those of the engines that are objects, else the default.
        options: over the presets'; over those of engines that are objects, too.
        default: presets where none are said.

    Raises:
        InputError: something is no engine, no engine has such a name, an object's class is not the
            one known by its name, or objects have other presets than were asked for.
    """
    several = [] if given is None else [given] if isinstance(given, str | Engine) else list(given)
    names: dict[str, None] = {}
    own_presets: dict[str, None] = {}
    own_options: dict[str, Any] = {}
    for item in several:
        if isinstance(item, Engine):
            names[item.name] = own_presets[item.preset] = None
            usual = engine(item.name, item.preset)
            if type(item) is not type(usual):
                raise InputError(
                    f"engine {item.name!r} is not the one that is known by that name; a class of "
                    "your own is taken by `trebucheck conform`, or installed as a plug-in."
                )
            for option, value in item.settings.items():
                if option not in usual.settings or usual.settings[option] != value:
                    own_options[f"{item.name}.{option}"] = value
        elif isinstance(item, str):  # pyright: ignore[reportUnnecessaryIsInstance] - of users
            engine_class(item)
            names[item] = None
        else:
            raise InputError(
                f"{item!r} is no engine; there are: {', '.join(engine_names())}, or an engine as "
                "trebucheck.engine makes it."
            )
    made = tuple(own_presets)
    chosen = names_of(presets) if presets is not None else made or default
    if made and chosen != made:
        raise InputError(
            f"presets = {', '.join(chosen)}, but the engines given have {', '.join(made)}; give "
            "their names instead."
        )
    if len(made) > 1:
        raise InputError(
            f"engines of the presets {', '.join(made)} are given; give their names, and "
            "presets and options beside them."
        )
    every = None if given is None else tuple(names)
    return ChosenEngines(every, chosen, {**own_options, **options})


def names_of(given: Names) -> tuple[str, ...]:
    """One or several names as a tuple, each once."""
    return (given,) if isinstance(given, str) else tuple(dict.fromkeys(given))


# --- Engines of plug-ins that tell no more than they must


def able(engine: Simulator) -> Capabilities:
    """Capabilities of an engine with its present options."""
    return engine.capabilities.without(getattr(engine, "lacking", ()))


def refuse_unbuildable(engine: Simulator, mechanism: Mechanism, law: StopLaw) -> None:
    """Refuse a mechanism with elements that an engine does not build.

    Raises:
        UnsupportedProblemError: the sentence names the elements.
    """
    can = able(engine)
    refuse_features(mechanism, can.features, engine.name, can.lacking, law, can.elements)


@dataclass(frozen=True)
class CompletedEngine:
    """A plug-in's engine without preset, settings or time step, completed by the registry."""

    simulator: Simulator
    preset: str
    settings: dict[str, JsonValue]
    timestep: float | None

    @property
    def name(self) -> str:
        """Name of the plug-in's engine."""
        return self.simulator.name

    @property
    def capabilities(self) -> Capabilities:
        """Capabilities of the plug-in's engine."""
        return self.simulator.capabilities

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Its `lacking`, if it has it."""
        return getattr(self.simulator, "lacking", frozenset())

    @property
    def supplied(self) -> Supplied | None:
        """Its `supplied`, if it has it; else None."""
        return getattr(self.simulator, "supplied", None)

    def simulate(self, problem: Problem) -> Trajectory:
        """Move the mechanism by the plug-in's engine."""
        refuse_no_problem(problem)
        refuse_unbuildable(self, problem.mechanism, problem.stop_law)
        return self.simulator.simulate(problem)


@dataclass(frozen=True)
class CompletedInspectable(CompletedEngine):
    """The same for an engine that shows its built model."""

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Inspect by the plug-in's engine."""
        return cast("Inspectable", self.simulator).inspect(mechanism, states)


def completed(simulator: Simulator, preset: str, options: Mapping[str, Any]) -> CompletedEngine:
    """A plug-in's engine, made from a preset with options, as :class:`.protocol.Engine` asks."""
    settings = settings_of(simulator, options)
    step = getattr(simulator, "timestep", settings.get("timestep"))
    cls = CompletedInspectable if isinstance(simulator, Inspectable) else CompletedEngine
    return cls(simulator, preset, settings, float(step) if isinstance(step, int | float) else None)


def script_of(engine: Engine, problem: Problem) -> str:
    """A program with nothing but the engine's interface; :meth:`.protocol.BuiltinEngine.script`.

    Raises:
        InputError: with these options trebucheck takes part in the run.
        UnsupportedProblemError: the adapter writes no program, or cannot build the mechanism.
    """
    if not isinstance(engine, BuiltinEngine):
        raise UnsupportedProblemError(f"the adapter of {engine.name} writes no program of a run.")
    return engine.script(problem)


# --- Engines' own interactive viewers


@runtime_checkable
class Viewable(Protocol):
    """An engine with a viewer; one of a plug-in may have it as well."""

    def view(self, mechanism: Mechanism) -> None:
        """Open a window on the mechanism, and return when it is closed."""


def has_viewer(name: str) -> bool:
    """Tell whether an engine of that name is here and has a viewer."""
    cls = engine_class(name)
    return hasattr(cls, "view") and cls.is_installed()


def view(engine: Engine, mechanism: Mechanism) -> None:
    """Open an engine's own viewer until it is closed; InputError without viewer or display."""
    if not isinstance(engine, Viewable):
        raise InputError(
            f"{engine.name} has no viewer of its own; `trebucheck animate` writes a page to play."
        )
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise InputError(
            "a viewer needs a display, and there is none here (neither DISPLAY nor WAYLAND_DISPLAY "
            "is set); `trebucheck animate` writes a file instead."
        )
    engine.view(mechanism)
