"""Install Rapier by npm in the version of node/package.json: `python -m trebucheck_rapier`."""

from .engine import RapierEngine

RapierEngine.npm.install()
