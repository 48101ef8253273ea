"""Install PhysX by npm in the version of node/package.json: `python -m trebucheck_physx`."""

from .engine import PhysxEngine

PhysxEngine.npm.install()
