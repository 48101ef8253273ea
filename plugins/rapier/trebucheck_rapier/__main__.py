"""`python -m trebucheck_rapier` installs Rapier by npm, in the version of node/package.json, beside this package."""

from .bridge import RAPIER

RAPIER.install()
