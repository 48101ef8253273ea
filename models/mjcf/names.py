"""Names as MJCF files have them: letters, digits, `_`, `-` and `.`; importers refuse or misread others.

The writer names elements after the mechanism ("sling pin", "sling pin/force"); in the finished tree
every other character becomes `_`, and what is then taken gets a number. Names that differ stay
different, whatever they name.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from itertools import count

_REFERENCES = (
    "name", "body", "body1", "body2", "joint", "joint1", "joint2", "geom1", "geom2", "site", "site1", "site2",
    "refsite", "tendon", "tendon1", "objname",
)  # fmt: skip
_OTHERS = re.compile(r"[^\w.-]")


def names_in(root: ET.Element) -> dict[str, str]:
    """The name that each element's name becomes, by the one that the writer gave it."""
    return valid_names(
        name for element in _named(root) if (name := element.get("name")) is not None
    )


def rename(root: ET.Element) -> None:
    """Replace the names in a tree, and all references to them."""
    names = names_in(root)
    for element in _named(root):
        for attribute in _REFERENCES:
            if (name := element.get(attribute)) is not None:
                element.set(attribute, names.get(name, name))


def _named(root: ET.Element) -> Iterator[ET.Element]:
    """Elements with names; keyframes, which a file may or may not have, have theirs apart."""
    return (element for element in root.iter() if element.tag != "key")


def valid_names(names: Iterable[str], taken: Iterable[str] = ()) -> dict[str, str]:
    """A valid name for each, all different; those that are valid already keep theirs, unless it is taken."""
    names, taken = tuple(dict.fromkeys(names)), set(taken)
    new = {name: name for name in names if not _OTHERS.search(name) and name not in taken}
    taken.update(new)
    for name in names:
        if name not in new:
            new[name] = _free(_OTHERS.sub("_", name), taken)
            taken.add(new[name])
    return new


def _free(name: str, taken: set[str]) -> str:
    """The name, or with the first number that makes it one that is not taken."""
    return (
        name
        if name not in taken
        else next(new for i in count(2) if (new := f"{name}_{i}") not in taken)
    )
