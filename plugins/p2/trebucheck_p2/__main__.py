"""Install p2-es by npm in the version of node/package.json: `python -m trebucheck_p2`."""

from .engine import P2Engine

P2Engine.npm.install()
