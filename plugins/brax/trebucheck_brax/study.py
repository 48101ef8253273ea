"""Brax's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from trebucheck.engines import study
from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
from trebucheck_toolkit.alone import caused_by, own_program
from trebucheck_toolkit.scheme_tables import EULER_STEPS, euler_tolerances

_CAUSES = {
    "joints": ("joints are springs, or corrected in part in a step", {"pipeline": "generalized"}),
    "precision": ("numbers of 24 bits", {"precision": "double"}),
    "mass matrix": ("its inverse is improved from the last", {"matrix_inv_iterations": 0}),
    "solver of limits": ("it ends at a residual of fixed size", {"mass_unit": "machine"}),
    "softness": (
        "limits are softer than need be",
        {"solref": None, "solimp": [0.99, 0.99, 0.001, 0.5, 2.0]},
    ),
}
_SOFT = study.StepOrder(None, "first order, and limits of fixed softness", EULER_STEPS.scheme)
STUDY = study.EngineStudy(
    causes=caused_by(_CAUSES),
    step_orders={DEFAULT: _SOFT, SETTINGS: EULER_STEPS, ASSISTED: EULER_STEPS},
    option_sets=(
        study.DEFAULT_SET,
        study.OptionSet("positional", "default with it", DEFAULT, {"pipeline": "positional"}),
        study.OptionSet("spring", "default with it", DEFAULT, {"pipeline": "spring"}),
        study.SETTINGS_SET,
        study.ASSISTED_SET,
    ),
    tolerances=euler_tolerances(ASSISTED),
    snippets=own_program("Brax in Python"),
    single_precision=lambda settings: settings["precision"] == "single",
    title="Brax",
    binding="the Python wheel `brax`",
    maintainers_note=study.MaintainersNote(
        chosen="`default` sets no option, by the pipeline `generalized`, to which Brax's "
        "environments default, in JAX's single precision; `settings` has double precision, shorter "
        "steps, a solved mass matrix and stiffer limits: {{ plain.agrees }} problems agree where "
        "nothing is set, {{ alone.agrees }} with that, {{ best.agrees }} with assistance.",
        not_possible="Brax solves no loops, tells no forces of joints and takes none on bodies; "
        "the solver of its limits ends at a residual of fixed size, so that assisted its masses "
        "are in a unit of the machine's size.",
        would_change="An integrator of higher order, and a solver of limits that ends relative to "
        "their forces.",
    ),
    colour="#d4267f",
)
