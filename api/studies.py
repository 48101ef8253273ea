"""Processes, stores and results of studies, for distributions built on trebucheck."""

# Names are given on as they are imported.
# pyright: reportUnusedImport=false

from __future__ import annotations

from ..comparisons.audit import Audit, audit
from ..comparisons.compare import Comparison, compare
from ..comparisons.data.certified import certified_dataset, content
from ..comparisons.runs.model_files import read_model_file
from ..comparisons.runs.process import Worker
from ..comparisons.runs.results import Outcome, ResultFile, Run
from ..comparisons.runs.runner import failure
from ..comparisons.runs.scales import size
from ..comparisons.runs.store import Store, conditions, digest
from ..comparisons.runs.study import Counter, Progress
from ..comparisons.runs.tolerances import StatedTolerance, is_table_one, tolerance_for
