"""Install planck.js by npm in the version of node/package.json: `python -m trebucheck_planck`."""

from .engine import PlanckEngine

PlanckEngine.npm.install()
