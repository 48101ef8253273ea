"""Box2D 3's entries for studies."""

from trebucheck.engines.study import EngineStudy

STUDY = EngineStudy(single_precision=lambda _: True, colour="#e7298a")
