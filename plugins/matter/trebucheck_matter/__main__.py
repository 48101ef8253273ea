"""Install matter-js by npm in the version of node/package.json: `python -m trebucheck_matter`."""

from .engine import MatterEngine

MatterEngine.npm.install()
