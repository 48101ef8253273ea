"""Engines as users give them: a name or an engine, one or several, with presets and options."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ..models.errors import InputError
from .protocol import Engine
from .registry import engine, engine_class, engine_names

Engines = str | Engine | Iterable[str | Engine]
"""Names, or engines as `trebucheck.engine` makes them."""
Names = str | Iterable[str]


@dataclass(frozen=True)
class ChosenEngines:
    """Engines by name, their presets, and options over the presets'."""

    names: tuple[str, ...] | None
    """None: every known engine."""
    presets: tuple[str, ...]
    options: Mapping[str, Any]
    """Of every engine that has them, or of one, as 'mujoco.solref'."""


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
        InputError: something is no engine, no engine has such a name, or engines that are objects
            have other presets than were asked for.
    """
    several = [] if given is None else [given] if isinstance(given, str | Engine) else list(given)
    own: dict[str, Any] = {}
    found: dict[str, None] = {}
    for each in several:
        if isinstance(each, Engine):
            found[each.name] = None
            own.update(_own_options(each))
        elif isinstance(each, str):  # pyright: ignore[reportUnnecessaryIsInstance] - of users
            engine_class(each)
            found[each] = None
        else:
            raise InputError(
                f"{each!r} is no engine; there are: {', '.join(engine_names())}, or an engine as "
                "trebucheck.engine makes it."
            )
    made = tuple(dict.fromkeys(each.preset for each in several if isinstance(each, Engine)))
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
    return ChosenEngines(None if given is None else tuple(found), chosen, {**own, **options})


def names_of(given: Names) -> tuple[str, ...]:
    """One or several names as a tuple, each once."""
    return (given,) if isinstance(given, str) else tuple(dict.fromkeys(given))


def _own_options(made: Engine) -> dict[str, Any]:
    """Options of an engine that are not its preset's, as 'mujoco.solref'.

    Raises:
        InputError: the engine's class is not known by its name here.
    """
    if type(made) is not type(engine(made.name, made.preset)):
        raise InputError(
            f"engine {made.name!r} is not the one that is known by that name; a class of your own "
            "is taken by `trebucheck conform`, or installed as a plug-in."
        )
    usual = engine(made.name, made.preset).settings
    return {
        f"{made.name}.{name}": value
        for name, value in made.settings.items()
        if name not in usual or usual[name] != value
    }
