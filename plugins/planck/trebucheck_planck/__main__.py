"""`python -m trebucheck_planck` installs planck.js by npm, in the version of node/package.json, beside this package."""

from .bridge import PLANCK

PLANCK.install()
