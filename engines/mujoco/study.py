"""Tables of MuJoCo for studies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pydantic import JsonValue

from ...models.mechanism import Mechanism
from ...models.mjcf.variants import POINT_INERTIA
from ...models.mjcf.writer import MARGIN
from .. import study
from ..presets import ASSISTED, DEFAULT, GIVEN, SETTINGS
from ..study import (
    Cause,
    Intervention,
    MaintainersNote,
    OptionSet,
    Refinement,
    SweptParameter,
    Tolerance,
)
from .given import GivenMujocoModel
from .options import effective_solref
from .rollout import record_episode

MJCF, PYTHON = "MJCF", "MuJoCo in Python"
# [kg m^2] It shifts the projectile by some 1e-8 m: far above rounding, and still in proportion.
_SEEN_INERTIA = 1e-6
_SOFTEST_LIMIT = 0.9999  # MuJoCo clamps the impedance there


def causes_of_file(settings: Any, constraints: study.ConstraintKinds) -> tuple[Cause, ...]:
    """Causes of a model file's error, moved as it is."""
    causes = [
        Cause("integrator", "the rule of a step, of first order but for RK4",
              Intervention({"integrator": "RK4"})),
        Cause("implicit damping", "Euler's rule takes the damping of joints implicitly",
              Intervention({"explicit_damping": True})),
    ]  # fmt: skip
    if constraints.angles or constraints.points:
        text = "limits and loops give way like the springs and dampers that the file gives them"
        causes.append(Cause("constraint softness", text, Intervention({"stiff": True})))
    if settings["timestep"] is not None:
        step = float(settings["timestep"]) / study.REFINEMENT
        causes.append(study.time_step_cause({"timestep": step}))
    return tuple(causes)


def _causes(settings: Any, constraints: study.ConstraintKinds) -> tuple[Cause, ...]:
    if "solref" not in settings:
        return causes_of_file(settings, constraints)
    finer: dict[str, JsonValue] = {"timestep": float(settings["timestep"]) / study.REFINEMENT}
    if settings["solref"] is None:  # it would follow the step
        finer["solref"] = _stiffest(settings, constraints)
    tighter: dict[str, JsonValue] = {
        "solver": "Newton", "tolerance": min(1e-30, float(settings["tolerance"])),
    }  # fmt: skip
    # Points are pressed in by an acceleration: with softer ones than the step can bear they would
    # jump.
    pressed = ("constraint softness",) if constraints.points else ()
    causes = (
        Cause("margin", "a joint exactly at its limit is not held before it has penetrated",
              Intervention({"margin": MARGIN})),
        _softness(settings, constraints),
        Cause("start transient", "soft limits start without the give that carries their torque",
              Intervention({"preload": True}), after=("margin", *pressed)),
        Cause("solver tolerance", "where MuJoCo's constraint solver stops", Intervention(tighter)),
        Cause("limits kept",
              "stops stay in the model after they have released, and may be met again",
              Intervention({"keep_limits": False}), after=("margin",)),
        Cause("event location",
              "a release is noticed at the end of its step, and the step goes over its kink",
              Intervention({"locate_releases": True}), after=("margin",)),
        Cause("integrator", "the rule of a step, of first order but for RK4",
              Intervention({"integrator": "RK4"})),
        study.time_step_cause(finer),
        Cause("point inertia",
              f"MuJoCo wants an inertia of every body: point masses have {POINT_INERTIA:g} kg m²",
              scaling=Intervention(
                  point_inertia=_SEEN_INERTIA, leaves=_SEEN_INERTIA / POINT_INERTIA)),
    )  # fmt: skip
    # Stiff points that are not held as they move are unstable: no other cause can be taken out
    # before.
    causes = tuple(replace(cause, after=(*cause.after, "moving points")) for cause in causes)
    if constraints.points:
        text = (
            "MuJoCo leaves out of contacts the acceleration that a held point has from the speeds "
            "alone"
        )
        moving_points = Cause("moving points", text, Intervention({"moving_points": True}))
        causes = (moving_points, *causes)
    return study.with_readout(*causes)


def _stiffest(
    settings: Any, constraints: study.ConstraintKinds, refinement: int = 1
) -> list[JsonValue]:
    """The stiffest constraints that a finer step can bear; points are held exactly by then."""
    step = float(settings["timestep"]) / refinement
    exact = {**settings, "solref": None, "moving_points": True, "timestep": step}
    return [*effective_solref(exact, constraints)]


def _softness(settings: Any, constraints: study.ConstraintKinds) -> Cause:
    """Softness: an error of (1 - d) tc^2, d impedance, tc time constant."""
    name = "constraint softness"
    text = (
        "limits give way: MuJoCo's stops are springs and dampers, and let through 1 - d of what "
        "they should stop"
    )
    stiffest, solref = _stiffest(settings, constraints), settings["solref"]
    d0, d_width, *shape = settings["solimp"]
    is_softer = solref is not None and not study.same_value(solref, stiffest)
    if is_softer or min(d0, d_width) < _SOFTEST_LIMIT:
        hardest = [_SOFTEST_LIMIT, _SOFTEST_LIMIT, *shape]
        return Cause(name, text, Intervention({"solref": stiffest, "solimp": hardest}))
    # As stiff as this step can bear: stiffer limits need the shorter step. 1 - d, doubled, is the
    # second measure.
    removal = Intervention({"solref": _stiffest(settings, constraints, study.REFINEMENT)})
    twice = [1.0 - 2.0 * (1.0 - d) for d in (d0, d_width)]
    scaling = Intervention({"solimp": [*twice, *shape]}, leaves=2.0)
    return Cause(name, text, removal, scaling, after=("time step",))


# Sweeps of what limits do need no shorter steps where none holds: these are three fifths of a run.
_OF_LIMITS: Mapping[str, object] = {"free_substeps": 1}
_GIVES_WAY = "a limit gives way by (1 - d) tc^2 times the acceleration it withholds"


def _softer(settings: study.Options, constraints: study.ConstraintKinds) -> dict[str, Any] | None:
    stiffness, damping = effective_solref(settings, constraints)
    if stiffness < 0:
        return {"solref": (4.0 * stiffness, 2.0 * damping)}
    # MuJoCo does not go below two steps with the positive form.
    if stiffness >= 4 * float(settings["timestep"]):
        return {"solref": (stiffness / 2, damping)}
    return None


def _stiffer_impedance(settings: study.Options, _: study.ConstraintKinds) -> dict[str, Any] | None:
    solimp = settings["solimp"]
    if min(1 - solimp[0], 1 - solimp[1]) < 2e-4:  # MuJoCo's own bound is 1e-4
        return None
    return {"solimp": ((1 + solimp[0]) / 2, (1 + solimp[1]) / 2, *solimp[2:])}


_NEED = "second order once releases are located, softness scaled with the step"
_SOFT_CONTACT = "(1 - impedance) x step: a contact's softness lags a changing force by up to a step"
_ENERGY_NEED = f"1e-9 of the energy at the start; {_NEED}"


def _snippets(engine: Any, mechanism: Mechanism, _: float) -> dict[str, str]:
    # The model as it is built knows the softness that follows from the step, and where stops are on
    # tendons.
    from .build import load  # loads MuJoCo

    model = load(mechanism, engine)
    points = bool(mechanism.point_stops or mechanism.bound_by)
    beside_the_model = {
        "limits taken out when they release": not engine.keep_limits,
        "releases found inside a step": engine.locate_releases,
        "limits preloaded": engine.preload,
        "shorter steps after the last release": engine.free_substeps > 1,
        "points held through all stages of a step by `mjcb_control`": (
            engine.moving_points and points
        ),
    }
    outside = [text for text, is_needed in beside_the_model.items() if is_needed]
    values: dict[str, Any] = {
        "options": engine,
        "solref": model.jnt_solref[0].tolist(),
        "tendons": model.ntendon > 0,
        "outside": outside,
        "points": points,
    }
    sources = {MJCF: study.filled_template(__name__, "mujoco.xml.j2", **values)}
    # The callback that holds points is no text to paste: such a mechanism is run by trebucheck's
    # own lines.
    if outside and not points:
        sources[PYTHON] = study.filled_template(__name__, "mujoco.py.j2", **values)
    return sources


def _read_model(source: Any, start: study.ModelStart) -> study.ModelFile:
    from .files import read_model  # loads MuJoCo

    return read_model(source, start)


STUDY = study.EngineStudy(
    read_model=_read_model,
    as_given=GivenMujocoModel,
    record_episode=record_episode,
    causes=_causes,
    swept_parameters=(
        SweptParameter(
            name="solref", title="limits' time constant tc", unit="s",
            values=study.geometric(3.2e-2, 5e-4, 8), options=lambda tc: {"solref": [tc, 1.0]},
            expected=2.0, base={**_OF_LIMITS, "timestep": 2.5e-4}, why=_GIVES_WAY,
        ),
        SweptParameter(
            name="solimp", title="limits' softness 1 - d", unit="1",
            values=study.geometric(0.3, 1e-4, 8),
            options=lambda softness: {"solimp": [1.0 - softness, 1.0 - softness, 0.001, 0.5, 2.0]},
            expected=1.0, base={**_OF_LIMITS, "timestep": 5e-4, "solref": [0.02, 1.0]},
            why=f"{_GIVES_WAY} (d: its impedance)",
        ),
        SweptParameter(
            name="tolerance", title="solver's tolerance", unit="1",
            values=study.geometric(1e-2, 1e-14, 7),
            options=lambda tolerance: {"tolerance": tolerance}, base={"timestep": 1e-3},
            without={"tolerance": 1e-30},
            why="Newton's method converges in leaps: the error falls in leaps, too, as one more "
                "iteration is made",
        ),
        *(
            SweptParameter(
                name="integrator", title=f"time step h, {name}", unit="s",
                values=tuple(1e-2 / 2**k for k in range(5)), options=lambda h: {"timestep": h},
                expected=1.0, why="the integrator is of first order", base={"integrator": name},
            )
            for name in ("Euler", "implicit", "implicitfast", "discrete")
        ),
    ),
    step_orders={
        DEFAULT: study.StepOrder(
            None, "Euler's rule is of first order, and the limits' softness is fixed: it does not "
            "fall with the step", "semi-implicit Euler, joint coordinates",
        ),
        SETTINGS: study.StepOrder(
            None, "the limits' softness falls with the step's square, but a step goes over the "
            "kink at a release, wherever that is in it", "RK4, joint coordinates",
        ),
        GIVEN: study.StepOrder(
            None, "integrator, damping and softness are those of the file", "as the file has it",
        ),
        ASSISTED: study.StepOrder(
            2.0, "releases are located, and the limits' softness is scaled with the step: tc = h, "
            "error ~ tc^2", "RK4, joint coordinates",
        ),
    },
    refinements=(
        study.HALF_THE_STEP,
        Refinement("softness of the limits", "half the limits' time constant", _softer),
        Refinement("softness of the limits", "half the limits' 1 - d", _stiffer_impedance),
        Refinement("solver's tolerance", "a hundredth of the tolerance",
                   study.multiplied("tolerance", 0.01)),
        Refinement("solver's iterations", "four times the iterations",
                   study.multiplied("iterations", 4)),
    ),
    option_sets=(
        study.DEFAULT_SET,
        OptionSet("RK4", "default, with the integrator RK4", DEFAULT, {"integrator": "RK4"}),
        OptionSet("stiffer limits",
                  "RK4, with a time constant of the limits of two steps, the shortest MuJoCo takes",
                  DEFAULT, {"integrator": "RK4"}, scaled=lambda h: {"solref": (2 * h, 1.0)}),
        OptionSet("Euler, stiff limits",
                  "settings, with MuJoCo's default integrator", SETTINGS, {"integrator": "Euler"}),
        OptionSet("implicitfast, stiff limits",
                  "settings, with the integrator that MuJoCo recommends for most models", SETTINGS,
                  {"integrator": "implicitfast"}),
        study.SETTINGS_SET,
        OptionSet("limits removed", "settings, and a limit is taken out after its release",
                  SETTINGS, {"keep_limits": False}),
        OptionSet("releases located",
                  "the same, with releases found inside the step and limits preloaded",
                  ASSISTED, {"free_substeps": 1}),
        study.ASSISTED_SET,
    ),
    tolerances=(
        Tolerance(ASSISTED, "position_max", 1e-7, 1e-3, 2, _NEED),
        Tolerance(ASSISTED, "release_time", 1e-8, 1e-3, 2, _NEED, on_points=False),
        Tolerance(ASSISTED, "release_time", 1e-7, 1e-3, 1, _SOFT_CONTACT, on_points=True),
        Tolerance(ASSISTED, "launch_speed", 3e-7, 1e-3, 2, _NEED),
        Tolerance(ASSISTED, "stop_torque_max", 1e-6, 1e-3, 2, _NEED, per="start"),
        Tolerance(ASSISTED, "energy_balance", 2e-4, 1e-3, 2, _ENERGY_NEED),
    ),
    snippets=_snippets,
    title="MuJoCo",
    binding="the Python wheel `mujoco`",
    maintainers_note=MaintainersNote(
        chosen="Its own defaults are what it does where nothing is set; a stiffer `solref`, "
        "RK4 and shorter steps are what its options add, since soft limits and equalities are "
        "most of the error: of joint forces on the fixed machine "
        "{{ plain.error('fixed', 'reaction') }} by itself, "
        "{{ alone.error('fixed', 'reaction') }} with its options.",
        not_possible="A limit stays in the model when its stop has let go, has no "
        "restitution, and begins without its force; a contact leaves out the motion of its "
        "point ((dJ/dt) qvel). The adapter does these in its place where a row says so.",
        would_change="A reference acceleration that counts the motion of points, and limits "
        "that start with their force, would make most of the assistance needless.",
    ),
    colour="#0072B2",
)  # fmt: skip
