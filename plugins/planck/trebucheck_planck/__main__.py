"""Install planck.js by npm in the version of node/package.json: `python -m trebucheck_planck`."""

from .bridge import PLANCK

PLANCK.install()
