"""Tell whether, how well and why (not) the engines agree, and how that is shown."""

from .runs import model_files as model_files  # files that a model may be given by
