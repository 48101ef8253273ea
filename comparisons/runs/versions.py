"""Versions of what makes numbers: runs that belong together need the same."""

from __future__ import annotations

import platform
import socket
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from ...engines.registry import EngineStatus, engine_class, engines
from ...version import __version__
from .store import code_digest, engine_digest


@dataclass(frozen=True)
class Versions:
    """Versions on one machine."""

    host: str
    trebucheck: str
    code: str
    """Digest of trebucheck's code."""
    python: str
    engines: Mapping[str, str]
    """Versions of the installed engines and digests of their adapters, by name."""

    def difference(self, there: Versions) -> str | None:
        """Tell what is another version there, in a part of a sentence; None: nothing is.

        An engine that is installed on one of both alone is no difference: there its runs are
        refused.
        """
        for what, own, other in (
            ("trebucheck", self.trebucheck, there.trebucheck),
            ("the code of trebucheck", self.code, there.code),
            ("Python", self.python, there.python),
        ):
            if own != other:
                return f"{what} is {other} on {there.host} and {own} on {self.host}"
        for name, own in self.engines.items():
            other = there.engines.get(name, own)
            if own != other:
                return f"engine {name!r} is {other} on {there.host} and {own} on {self.host}"
        return None


CODE = ("models", "reference", "engines", "comparisons")
"""Folders of the package whose code takes part in studies."""


def versions_here(
    names: Collection[str] | None = None, folders: Collection[str] = CODE
) -> Versions:
    """Versions in this process.

    Args:
        names: of the engines; None: all that are installed.
        folders: of the package, whose code counts.
    """
    found: dict[str, EngineStatus] = engines()
    return Versions(
        host=socket.gethostname(),
        trebucheck=__version__,
        code=code_digest(*folders)[:12],
        python=".".join(platform.python_version_tuple()[:2]),
        engines={
            name: f"{status.version} (adapter {engine_digest(engine_class(name).__module__)[:8]})"
            for name, status in found.items()
            if status.installed and (names is None or name in names)
        },
    )
