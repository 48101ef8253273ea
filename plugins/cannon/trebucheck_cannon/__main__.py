"""Install cannon-es by npm in the version of node/package.json: `python -m trebucheck_cannon`."""

from .engine import CannonEngine

CannonEngine.npm.install()
