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
