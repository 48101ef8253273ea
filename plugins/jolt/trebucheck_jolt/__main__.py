"""Install Jolt Physics by npm in the version of node/package.json: `python -m trebucheck_jolt`."""

from .engine import JoltEngine

JoltEngine.npm.install()
