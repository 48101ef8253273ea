"""`trebucheck explain`, `converge` and `recommend`: why engines differ, and what helps."""

from __future__ import annotations

from ..models.errors import InputError
from .call import Call, command
from .options import folder, option


@command(
    "models engines preset timestep until set beam keyframe qpos qvel ctrl without option resume "
    "jobs cluster timeout quiet json",
    folder("explain", "Folder for explain.html, explain.json and the runs."),
)
def explain_command(call: Call) -> bool:
    """Split each engine's error among its causes, each measured by a run without it.

    Also sets each preset of an engine beside the next and changes one option at a time.
    Writes explain.html (self-contained) and explain.json; prints a summary. A run that fails is
    shown as such and ends nothing; if it is a machine's reference, the exit code is 1.

    Examples:
    trebucheck explain --models fixed --engines mujoco

    trebucheck explain --preset assisted --timestep 5e-4 --set l1=9.5 --out why
    """
    from ..comparisons.explain import explain
    from ..comparisons.report.pages.explain import document

    models, how, store = call.models(), call.run_options(), call.store()
    with call.progress(width=44) as show:
        explanation = explain(models, **how, store=store, progress=show)
    explanation = explanation.made_by(call.command_line)
    text, page = explanation.to_json(), document(explanation)
    call.publish("explain.json", text, page, "explain.html", "Page", store=store)
    return not explanation.failures


@command(
    "models engines preset knobs until set beam keyframe qpos qvel ctrl without option resume "
    "jobs cluster timeout quiet json",
    folder("converge", "Folder for converge.html, converge.json and the runs."),
    knobs=option("--knobs --knob", "Knobs, comma-separated, e.g. timestep,solref; all by default."),
)
def converge_command(call: Call) -> bool:
    """Turn each engine's knobs and see how its error falls: orders, floors, causes, limits.

    Writes converge.html (self-contained) and converge.json; prints orders and laws. A run that
    fails is a failed point of its study; a machine whose reference fails is left out with its
    reason, and the exit code is 1.

    Examples:
    trebucheck converge --out converge

    trebucheck converge --models rolling --engines mujoco --knobs timestep,solref --set l1=9.5

    trebucheck converge --engines mujoco --knobs timestep --option mujoco.integrator=implicit

    trebucheck converge --models pendulum.json --until 5
    """
    from ..comparisons.converge import converge
    from ..comparisons.report.pages.converge import document

    models, how, store = call.models(), call.run_options(), call.store()
    how["knobs"] = call.names("knobs")
    with call.progress() as show:
        studies = converge(models, **how, store=store, progress=show)
    studies = studies.made_by(call.command_line)
    page = document(studies)
    call.publish("converge.json", studies.to_json(), page, "converge.html", store=store)
    return not studies.failures


@command(
    "model position torque release engines until set beam keyframe qpos qvel ctrl without "
    "neighbours resume jobs cluster timeout "
    "quiet json",
    folder("recommend", "Folder for recommend.html, recommend.json, the texts and the trials."),
    position=option(
        "--position", "Largest distance of any marker from the reference (m).", float | None
    ),
    torque=option(
        "--torque",
        "Largest error of any stop's torque: N m (N on points), or a share of the largest: 0.1%.",
    ),
    release=option("--release", "Largest error of any stop's release (s).", float | None),
    neighbours=option(
        "--neighbours",
        "Machines of the same kind the settings are to hold on, too; 0: none.",
        int,
        32,
    ),
    resume=option("--resume", "Take finished trials from the folder again.", bool, False),
)
def recommend_command(call: Call) -> None:
    """Find each engine's cheapest settings that reach an accuracy to the launch or --until.

    Writes recommend.html (self-contained), recommend.json, and beside them the texts to paste into
    the MJCF, the pymunk or the Exudyn script; says what stands in the way where there are no such
    settings. At least one of --position, --torque and --release must be given. Settings must reach
    it on the machine and on the worst of its neighbours, whose lengths, masses and start angles
    differ.

    Examples:
    trebucheck recommend --model rolling --position 1e-3 --torque 0.01%

    trebucheck recommend --model fixed --set l1=9.5 --engines mujoco --position 1e-6 --release 1e-8

    trebucheck recommend --model pendulum.json --position 1e-4 --until 5
    """
    from ..comparisons.recommend import recommend
    from ..comparisons.report.pages.recommend import document, files
    from ..comparisons.runs.model_files import is_file
    from ..models.files import write_text

    target = {name: call.values[name] for name in ("position", "torque", "release")}
    if all(value is None for value in target.values()):
        raise InputError(
            "nothing is asked; give at least one of --position, --torque and --release."
        )
    model, name = call.only_model(), call.model.strip()
    how = {**call.run_options(), **target, "neighbours": call.neighbours}
    if not is_file(name):
        # A named machine stays a name: its neighbours have other parameters.
        model, how["parameters"] = name, call.parameters(name)
    store = call.store()
    with call.progress("references", 30) as show:
        advice = recommend(model, **how, store=store, progress=show)
    advice = advice.made_by(call.command_line)
    for name, text in files(advice).items():
        write_text(call.out / name, text)
    page = document(advice)
    call.publish("recommend.json", advice.to_json(), page, "recommend.html", "Page", store=store)
