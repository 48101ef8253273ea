"""JAX for an adapter: on the processor, without other libraries' lines, compiled once and kept.

To be imported before JAX.
"""

from __future__ import annotations

import io
import logging
import os
from collections.abc import Generator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")  # double precision is not to be had elsewhere
logging.getLogger("absl").setLevel(logging.ERROR)

_WITHOUT_WARP = ("Failed to import warp:", "Failed to import mujoco_warp:")


@contextmanager
def without_words_on_warp() -> Generator[None, None, None]:
    """Drop MJX's line on a missing Warp, which it does not need; other output is kept."""
    printed = io.StringIO()
    try:
        with redirect_stdout(printed):
            yield
    finally:
        kept = [
            line
            for line in printed.getvalue().splitlines(keepends=True)
            if not line.startswith(_WITHOUT_WARP)
        ]
        print("".join(kept), end="")


def keep_compiled() -> None:
    """Have JAX keep what it compiles in the user's cache, unless it keeps it elsewhere.

    Compiling is most of a run's time; what is taken from there is the same program.
    """
    import jax  # pyright: ignore[reportMissingImports]  # installed where this is called

    if jax.config.jax_compilation_cache_dir is None:
        caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        jax.config.update("jax_compilation_cache_dir", str(caches / "trebucheck" / "jax"))
