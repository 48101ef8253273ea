"""Install Havok by npm in the version of node/package.json: `python -m trebucheck_havok`."""

from .engine import HavokEngine

HavokEngine.npm.install()
