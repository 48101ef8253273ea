"""Campaigns: designs, descriptions, and a store that loses nothing and has nothing twice."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Barrier
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from campaign_faults import rows
from trebucheck.__main__ import main
from trebucheck.comparisons.campaigns import run as campaign_run
from trebucheck.comparisons.campaigns.agreement import ALL, LEVELS, layers
from trebucheck.comparisons.campaigns.campaign import campaign, open_campaign
from trebucheck.comparisons.campaigns.changes import difference
from trebucheck.comparisons.campaigns.design import Design, DesignPart
from trebucheck.comparisons.campaigns.machines import EngineCase, machine
from trebucheck.comparisons.campaigns.ranking import ranking
from trebucheck.comparisons.campaigns.shrink import shrink
from trebucheck.comparisons.campaigns.spec import Campaign, Runs
from trebucheck.comparisons.campaigns.store import CampaignStore
from trebucheck.comparisons.campaigns.table import DIGITS
from trebucheck.models.errors import UnwritableError
from trebucheck.models.problem import mechanism_of

pytestmark = pytest.mark.own_processes

PENDULUMS: dict[str, Any] = {
    "name": "pendulums",
    "chunk": 2,
    "machines": {
        "model": "pendulum",
        "values": {"length": {"min": 0.5, "max": 1.0, "steps": 2}, "amplitude": [0.5, 1.0]},
    },
    "runs": {"engines": ["mujoco"], "until": 0.2},
}


def _with(**changes: Any) -> dict[str, Any]:
    return PENDULUMS | changes


@pytest.fixture(scope="module")
def pendulums(tmp_path_factory: pytest.TempPathFactory) -> CampaignStore:
    return campaign(PENDULUMS, tmp_path_factory.mktemp("campaign"), jobs=1)


# --- Descriptions


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('name = "a"\n[machines\n', "line 2"),
        (
            'name = "a"\n[machines]\nmodel = "fixed"\nvalues.l1 = { min = 9, max = 8 }\n',
            "line 4: machines.values.l1.* = 9",
        ),
        ('name = "a"\n[machines]\nmodel = "fixed"\nvalues.l1 = [ "x" ]\n', "line 4.*'x'"),
        ('name = "a"\n[machines]\nmodel = "fixed"\nmodels = 3\n', "line 4: machines.models"),
        ('name = "a"\n[machines]\nmodel = "fixd"\nvalues.l1 = 1\n[launches]\n', "'fixd'"),
        (
            'name = "a"\n[machines]\nmodel = "fixed"\nvalues.l1 = 1\n[launches]\ntolerance = 1.0\n',
            "line 6: launches.tolerance = 1.0",
        ),
        ('name = "a"\n[machines]\nfamily = {}\n[launches]\n', "line 2: machines: number"),
        (
            'name = "a"\n[machines]\nfamily = { bodies = 0 }\nnumber = 3\n[launches]\n',
            "line 3: machines.family.bodies = 0",
        ),
        (
            'name = "a"\n[machines]\nmodel = "fixed"\nvalues.l1 = 8.0\n'
            '[runs]\nengines = ["mujoco"]\nquantities = ["positions"]\n',
            "line 7|'positions'",
        ),
    ],
)
def test_a_description_that_is_not_valid_names_line_and_field(
    text: str, told: str, tmp_path: Path
) -> None:
    path = tmp_path / "campaign.toml"
    path.write_text(text)
    with pytest.raises(tb.InputError, match=f"campaign.toml.*({told})"):
        Campaign.read(path)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"machines": PENDULUMS["machines"] | {"values": {"lenght": [1.0]}}}, "'lenght'"),
        ({"runs": {"engines": ["mujocco"]}}, "mujocco"),
        ({"runs": {"engines": ["mujoco"], "tolerances": {"position": "-1"}}}, "'-1'"),
        ({"runs": {"engines": ["mujoco"], "options": {"solreff": 1}}}, "solreff"),
        ({"machines": PENDULUMS["machines"] | {"where": ["lngth > 1"]}}, "'lngth > 1'"),
        ({"machines": PENDULUMS["machines"] | {"where": ["length + 1"]}}, "neither true nor"),
    ],
)
def test_what_no_run_could_have_is_refused_before_anything_is_written(
    changes: dict[str, Any], told: str, tmp_path: Path
) -> None:
    with pytest.raises(tb.InputError, match=told):
        campaign(_with(**changes), tmp_path / "store")
    assert not (tmp_path / "store").exists()


def test_a_path_without_quotes_is_that_of_a_number(tmp_path: Path) -> None:
    path = tmp_path / "campaign.toml"
    path.write_text(
        'name = "a"\n[machines]\nmodel = "fixed"\nvalues.bodies.arm.mass = [1.0, 2.0]\n[launches]\n'
    )
    assert Campaign.read(path).machines.values == {"bodies.arm.mass": (1.0, 2.0)}


# --- Designs


@pytest.mark.parametrize("design", ["random", "latin-hypercube", "sobol"])
def test_values_are_the_same_in_whatever_parts(design: str) -> None:
    values = {"l1": {"min": 8.0, "max": 9.0}, "m_cw": {"min": 1.0, "max": 1e4, "scale": "log"}}
    machines = {"model": "fixed", "design": design, "number": 5000, "values": values}
    given = Campaign.of({"name": "a", "seed": 5, "machines": machines, "launches": {}})
    whole, _ = Design(given).columns(0, 5000)
    for first, last in ((0, 7), (4090, 4100), (4096, 5000), (4999, 5000)):
        part, _ = Design(given).columns(first, last)
        for name, column in part.items():
            assert column.tolist() == whole[name][first:last].tolist()
    assert 8.0 <= whole["l1"].min() < 8.01 and 8.99 < whole["l1"].max() <= 9.0
    assert np.median(whole["m_cw"]) == pytest.approx(100.0, rel=0.2)  # the middle of its powers
    other = Campaign.of({"name": "a", "seed": 6, "machines": machines, "launches": {}})
    assert Design(other).columns(0, 3)[0]["l1"].tolist() != whole["l1"][:3].tolist()


def test_a_grid_has_every_value_and_its_ends() -> None:
    given = Campaign.of(PENDULUMS)
    columns, kept = Design(given).columns(0, 100)
    assert columns["length"].tolist() == [0.5, 0.5, 1.0, 1.0]
    assert columns["amplitude"].tolist() == [0.5, 1.0, 0.5, 1.0]
    assert kept.all() and Design(given).size == 4


def test_conditions_leave_machines_out() -> None:
    where = PENDULUMS["machines"] | {"where": ["length > 0.6", "amplitude < 0.9"]}
    columns, kept = Design(Campaign.of(_with(machines=where))).columns(0, 4)
    assert [columns["length"][kept].tolist(), columns["amplitude"][kept].tolist()] == [[1.0], [0.5]]


# --- Rows


def test_rows_are_what_compare_says(pendulums: CampaignStore) -> None:
    rows = pendulums.to_pandas()
    assert rows["machine"].tolist() == [0, 1, 2, 3]
    for row in rows.to_dict("records"):
        problem = machine(pendulums, row["machine"])
        (run,) = tb.compare(problem, "mujoco", "default", until=0.2, diagnose=False).results.runs
        assert row["outcome"] == run.outcome.value
        assert row["share"] == max(metric.share or 0.0 for metric in run.judged)
        angles = [metric for metric in run.metrics if metric.name == "angle_max"]
        assert row["angle_error"] == angles[0].value
        assert row["angle_tolerance"] == angles[0].tolerance


def test_the_command_of_a_row_makes_it_again(pendulums: CampaignStore) -> None:
    command = pendulums.to_pandas()["repeat"][1]
    assert command == (
        "trebucheck compare --model pendulum --set length=0.5 --set amplitude=1.0 --engine mujoco "
        "--preset default --until 0.2"
    )


def test_the_order_of_completion_changes_nothing(pendulums: CampaignStore, tmp_path: Path) -> None:
    assert rows(campaign(PENDULUMS, tmp_path, jobs=2)) == rows(pendulums)


def test_workers_that_join_are_used() -> None:
    at_once, together = [1], Barrier(4)

    def make(item: int) -> int:
        if item == 0:
            at_once[0] = 2  # and as many calls wait
        else:
            together.wait(30.0)  # for three others
        return item

    made = campaign_run.unordered(make, range(5), lambda: at_once[0])
    assert sorted(made) == [*range(5)]


def test_units_and_meanings_stand_in_the_files(pendulums: CampaignStore) -> None:
    import pyarrow.parquet as pq

    schema = pq.read_schema(pendulums.path(0))
    assert schema.field("length").metadata[b"unit"] == b"m"
    assert schema.field("judged_to").metadata[b"unit"] == b"s"
    assert schema.metadata[b"campaign"].startswith(b"pendulums ")
    assert list(pendulums.file.columns) == schema.names and all(pendulums.file.columns.values())


def test_only_what_is_asked_for_is_kept(tmp_path: Path) -> None:
    runs = PENDULUMS["runs"] | {"quantities": ["angle"], "trajectories": True}
    store = campaign(_with(runs=runs, chunk=4), tmp_path, jobs=1)
    columns = [name for name in store.schema.names if name.endswith("_error")]
    assert columns == ["angle_error"]
    motions = sorted(path.name for path in (tmp_path / "trajectories").iterdir())
    assert motions == [f"{number}-mujoco-default-0.002.nc" for number in range(4)]


# --- Failures


def test_engines_that_crash_hang_or_raise_cost_theirrows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ["crasher", "sleeper", "raiser"]
    announced = [f"{name}=plugin_engines:{name.capitalize()}" for name in names]
    monkeypatch.setenv("TREBUCHECK_ENGINES", " ".join(announced))
    runs = {"engines": [*names, "mujoco"], "until": 0.2, "timeout": 10.0}
    runs |= {"presets": ["default"]}
    machines = PENDULUMS["machines"] | {"values": {"length": 1.0}}
    store = campaign(_with(runs=runs, machines=machines), tmp_path, jobs=1)
    rows = {row["engine"]: row for row in store.to_pandas().to_dict("records")}
    assert [rows[name]["outcome"] for name in names] == ["failed", "timed out", "failed"]
    assert [rows[name]["process_failed"] for name in names] == [True, True, False]
    assert "careless" in rows["raiser"]["message"]
    assert rows["mujoco"]["outcome"] in ("agrees", "disagrees")
    assert store.finished() == set()


def test_what_failed_for_its_processs_sake_alone_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TREBUCHECK_ENGINES", "mended=plugin_engines:Mended")
    monkeypatch.setenv("MENDED", str(tmp_path / "mended"))
    runs = {"engines": ["mended", "mujoco"], "until": 0.2}
    machines = PENDULUMS["machines"] | {"values": {"length": 1.0}}
    given = _with(runs=runs, machines=machines)
    first = campaign(given, tmp_path / "store", jobs=1).to_pandas()
    assert first["process_failed"].tolist() == [True, False]
    (tmp_path / "mended").write_text("")
    again = campaign(given, tmp_path / "store", jobs=1).to_pandas()
    assert again["outcome"].tolist()[0] == "agrees" and not again["process_failed"].any()
    assert again["wall_time"][1] == first["wall_time"][1]


def test_machines_that_cannot_be_built_or_moved_arerows(tmp_path: Path) -> None:
    machines = PENDULUMS["machines"] | {"values": {"length": [1.0, -1.0]}}
    rows = campaign(_with(machines=machines), tmp_path, jobs=1).to_pandas()
    assert rows["outcome"].tolist()[1] == "failed"
    assert "length = -1.0" in rows["message"][1]
    assert rows["outcome"].tolist()[0] != "failed"


MAKE_ROWS = campaign_run.make_rows


def _killed_once(mark: Path, *given: Any) -> Any:
    """Make rows, but end the process in the middle of the first chunk, once."""
    if not mark.exists():
        mark.write_text("killed")
        os.kill(os.getpid(), signal.SIGKILL)
    return MAKE_ROWS(*given)


def test_a_process_that_is_killed_costs_time_alone(
    pendulums: CampaignStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaign_run, "make_rows", partial(_killed_once, tmp_path / "mark"))
    store = campaign(PENDULUMS, tmp_path / "store", jobs=1)
    assert (tmp_path / "mark").exists() and rows(store) == rows(pendulums)


def _always_killed(described: Campaign, machines: DesignPart, kept: Any) -> Any:
    """End the process at machine 1, always."""
    if 1 in machines.numbers:
        os.kill(os.getpid(), signal.SIGKILL)
    return MAKE_ROWS(described, machines, kept)


def test_a_machine_that_always_ends_its_process_is_a_failed_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaign_run, "make_rows", _always_killed)
    rows = campaign(PENDULUMS, tmp_path, jobs=1).to_pandas()
    assert rows["process_failed"].tolist() == [False, True, False, False]
    assert "its process ended by itself" in rows["message"][1]


# --- The store


def test_what_is_there_is_not_made_again(tmp_path: Path, pendulums: CampaignStore) -> None:
    store = campaign(PENDULUMS, tmp_path, jobs=1)
    first, second = store.path(0), store.path(1)
    before = first.stat().st_mtime_ns
    second.write_bytes(second.read_bytes()[:-9])  # as after a fault of the disk
    assert 1 not in store.finished() and len(store.finished()) == store.chunks - 1
    again = campaign(PENDULUMS, tmp_path, jobs=1)
    assert first.stat().st_mtime_ns == before
    assert rows(again) == rows(pendulums) and len(again.finished()) == again.chunks


def test_a_full_disk_ends_it_with_a_sentence_and_an_intact_store(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, content: bytes) -> None:
        if path.name == "chunk-0000001.parquet":
            while not path.with_name("chunk-0000000.parquet").exists():
                time.sleep(0.01)  # chunks are made by two threads, in any order
            raise UnwritableError(f"{path} cannot be written: No space left on device.")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)

    monkeypatch.setattr("trebucheck.comparisons.campaigns.store.write_bytes", full)
    with pytest.raises(UnwritableError, match=r"No space left.*campaign resume"):
        campaign(PENDULUMS, tmp_path, jobs=1)
    assert open_campaign(tmp_path).finished() == {0}
    assert len(open_campaign(tmp_path)) == 2


def test_a_folder_holds_one_campaign_of_one_set_of_versions(tmp_path: Path) -> None:
    store = campaign(_with(chunk=4), tmp_path, jobs=1)
    with pytest.raises(tb.InputError, match="holds another campaign"):
        campaign(_with(name="others"), tmp_path)
    versions = replace(store.file.versions, engines={"mujoco": "3.0"})
    other = store.file.model_copy(update={"versions": versions})
    (tmp_path / "campaign.json").write_text(other.to_json())
    with pytest.raises(tb.InputError, match=r"'mujoco' is 3.0 .* campaign diff"):
        campaign(_with(chunk=4), tmp_path)
    with pytest.raises(tb.InputError, match="holds no campaign"):
        open_campaign(tmp_path / "elsewhere")


def test_a_broken_file_is_named_and_made_again(tmp_path: Path, pendulums: CampaignStore) -> None:
    """Also where the fault is in a column that says nothing of what is missing."""
    shutil.copytree(pendulums.folder, tmp_path / "store")
    store = open_campaign(tmp_path / "store")
    content = bytearray(store.path(0).read_bytes())
    content[40] ^= 0xFF
    store.path(0).write_bytes(content)
    with pytest.raises(tb.InputError, match=r"chunk-0000000.parquet is broken; .*resume"):
        store.to_pandas()
    assert 0 not in store.finished()
    assert rows(campaign(PENDULUMS, store.folder, jobs=1)) == rows(pendulums)


def test_rows_of_no_campaign_are_not_taken_for_those_of_another(
    tmp_path: Path, pendulums: CampaignStore
) -> None:
    shutil.copytree(pendulums.row_folder, tmp_path / "rows")
    with pytest.raises(tb.InputError, match=r"holds rows, and no campaign\.json"):
        campaign(_with(name="others"), tmp_path)


def test_a_campaign_that_no_folder_could_hold_is_refused(tmp_path: Path) -> None:
    value = {"min": 1.0, "max": 2.0, "steps": 10**9}
    machines = PENDULUMS["machines"] | {"values": {"length": value, "mass": value}}
    with pytest.raises(tb.InputError, match=r"has 1000000000000000000 machines"):
        campaign(_with(machines=machines), tmp_path / "store")
    assert not (tmp_path / "store").exists()


def test_a_run_without_its_engine_is_made_when_that_is_installed() -> None:
    absent = {"outcome": "not installed", "process_failed": False}
    assert CampaignStore.is_to_repeat({**absent, "engine": "mujoco"})
    assert not CampaignStore.is_to_repeat(
        {"outcome": "failed", "process_failed": False, "engine": "mujoco"}
    )


def test_a_difference_has_each_run_once(tmp_path: Path) -> None:
    """Machines that cannot be built, and machines that are there twice, among them."""
    machines = PENDULUMS["machines"] | {"values": {"length": [-1.0, -2.0, 1.0, 1.0]}}
    store = campaign(_with(machines=machines), tmp_path, jobs=1)
    found = difference(store, store)
    assert len(found.runs) == 3 * len(store) // 4 and found.passed
    assert (found.only_old, found.only_new) == (0, 0)


# --- Launches


@pytest.mark.skipif(sys.platform != "linux", reason="heyoka has wheels for Linux only")
def test_a_process_that_throws_machines_imports_no_more_than_it_needs() -> None:
    """SymPy, SciPy's integrators, pandas and the engines would take longer than a chunk."""
    code = """
import sys
from trebucheck.comparisons.campaigns.design import Design
from trebucheck.comparisons.campaigns.launched import launch_rows, prepare_process
from trebucheck.comparisons.campaigns.spec import Campaign

machines = {"model": "fixed", "values": {"l1": {"min": 8.0, "max": 11.0, "steps": 2}}}
given = Campaign.of({"name": "a", "machines": machines, "launches": {}})
prepare_process()
launch_rows(given, Design(given).part(0, 2))
print(*sys.modules)
import sympy
assert sympy.Integer(2) == 2  # it is only hidden from heyoka
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, check=True, capture_output=True, text=True, cwd="/")
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert not loaded & {"sympy", "pandas", "numba", "mujoco", "pymunk", "exudyn"}
    assert "heyoka" in loaded and "scipy.integrate" not in done.stdout.split()


def test_launches_are_those_of_the_reference(tmp_path: Path) -> None:
    pytest.importorskip("heyoka", reason="the batch integrator needs heyoka")
    values = {"l1": {"min": 8.0, "max": 11.0}, "m_cw": [2000.0, -1.0]}
    given = {
        "name": "throws",
        "chunk": 10,
        "machines": {"model": "fixed", "design": "random", "number": 20, "values": values},
        "launches": {},
    }
    rows = campaign(given, tmp_path, jobs=1).to_pandas()
    valid = rows[rows["m_cw"] > 0]
    refused = rows[rows["m_cw"] < 0]
    assert len(valid) and len(refused) and len(rows) == 20
    columns = {name: valid[name].to_numpy() for name in ("l1", "m_cw")}
    thrown = tb.launches("fixed", columns)
    assert valid["launch_time"].tolist() == thrown.time.tolist()
    assert valid["launch_speed"].tolist() == thrown.speed.tolist()
    for name, times in thrown.release_times.items():
        np.testing.assert_array_equal(valid[f"release {name}"], times)
    assert not refused["launched"].any() and refused["message"].str.contains("m_cw").all()
    assert rows["mechanism"].is_unique


# --- What follows


def test_levels_are_powers_of_ten_of_the_tolerance(pendulums: CampaignStore) -> None:
    whole, *others = layers(pendulums)
    assert whole.quantity == ALL and "angle" in {layer.quantity for layer in others}
    shares = np.array([0.01, 0.011, 1.0, 1.01, 1e9, np.inf, np.nan, 0.5])
    failed = np.array([False] * 7 + [True])
    levels = replace(whole, share=shares, failed=failed).levels
    assert levels.tolist() == [0, 1, 2, 3, len(LEVELS) - 1, len(LEVELS) - 1, -1, -2]


def test_small_campaigns_have_chunks_for_several_processes_and_large_ones_large_chunks() -> None:
    runs, launches = _with(chunk=None), _with(chunk=None, runs=None, launches={})
    sizes = [1, 16, 17, 300, 1_000_000]
    assert [*map(Campaign.of(runs).chunk_size, sizes)] == [1, 1, 2, 16, 16]
    assert [*map(Campaign.of(launches).chunk_size, sizes)] == [256, 256, 256, 256, 8192]
    assert Campaign.of(launches).chunk_size(16_000) == 1000
    assert Campaign.of(_with(chunk=3)).chunk_size(1_000_000) == 3


def test_axes_are_the_parameters_that_vary(pendulums: CampaignStore) -> None:
    assert pendulums.campaign.axes() == ("length", "amplitude")
    assert pendulums.campaign.axes(x="amplitude") == ("amplitude", "length")
    with pytest.raises(tb.InputError, match="'width' is no parameter"):
        pendulums.campaign.axes(y="width")


def test_the_ranking_finds_the_parameter_that_matters(pendulums: CampaignStore) -> None:
    layer = next(layers(pendulums))
    random = np.random.default_rng(1)
    import pandas as pd

    rows = pd.DataFrame({"length": random.random(400), "amplitude": random.random(400)})
    share = 10.0 ** (3 * rows["length"].to_numpy() + 0.1 * rows["amplitude"].to_numpy())
    failed = np.zeros(400, dtype=bool)
    found = ranking(replace(layer, rows=rows, share=share, failed=failed))
    assert found is not None and list(found.indices) == ["length", "amplitude"]
    assert found.indices["length"] > 3 * found.chance > 1.5 * found.indices["amplitude"]
    for n in range(64, 200, 9):  # whatever the number of machines
        part = replace(layer, rows=rows[:n], share=share[:n], failed=failed[:n])
        assert ranking(part) is not None
    few = replace(layer, rows=rows[:20], share=share[:20], failed=failed[:20])
    assert ranking(few) is None


def test_a_difference_finds_what_is_worse(pendulums: CampaignStore, tmp_path: Path) -> None:
    assert difference(pendulums, pendulums).passed
    runs = PENDULUMS["runs"] | {"timesteps": [2e-3], "options": {"integrator": "RK4"}}
    finer = campaign(_with(runs=runs), tmp_path, jobs=1)
    found = difference(finer, pendulums)
    assert not found.passed and len(found.worse) == len(found.runs) == 4
    grown = {kind.title: found.moved(kind) for kind in found.quantities}
    assert grown["angle"] == (4, 0)
    assert len(difference(pendulums, finer).better) == 4


def test_random_mechanisms_are_those_of_their_seed(tmp_path: Path) -> None:
    machines = {"family": {"bodies": 2, "stops": 0}, "number": 3}
    runs = {"engines": ["exudyn"], "presets": ["settings"], "until": 0.1}
    given = {"name": "wild", "seed": 4, "machines": machines, "runs": runs}
    store = campaign(given, tmp_path, jobs=1)
    rows = store.to_pandas()
    hashes = [mechanism_of(machine(store, k)).content_hash[:DIGITS] for k in range(3)]
    assert rows["mechanism"].tolist() == hashes
    assert all(len(mechanism_of(machine(store, k)).bodies) <= 2 for k in range(3))
    with pytest.raises(tb.InputError, match="numbers of 'wild' are 0 to 2"):
        machine(store, 3)
    assert "trebucheck campaign machine" in rows["repeat"][0]


def test_the_commands_do_what_they_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("lengths.toml").write_text(
        'name = "lengths"\n[machines]\nmodel = "pendulum"\nvalues.length = [0.5, 1.0]\n'
        '[runs]\nengines = ["mujoco"]\nuntil = 0.1\nquantities = ["angle"]\n'
    )
    assert main(["campaign", "run", "lengths.toml", "--out", "store", "--jobs", "1"]) == 0
    assert "2 runs of lengths" in capsys.readouterr().out
    page = Path("store/campaign.html")
    assert "trebucheck campaign run lengths.toml" in page.read_text()
    before = page.read_bytes()
    for words in (["resume", "store"], ["show", "store"], ["diff", "store", "store"]):
        assert main(["campaign", *words]) == 0
    assert page.read_bytes() == before
    capsys.readouterr()
    assert main(["campaign", "machine", "store", "1"]) == 0
    assert tb.Mechanism.from_json(capsys.readouterr().out).name == "pendulum"
    for words, told in (
        (["show", "elsewhere"], "elsewhere holds no campaign"),
        (["show", "store", "--x", "width"], "'width' is no parameter"),
        (["machine", "store", "2"], "machine 2: the numbers of 'lengths' are 0 to 1"),
        (["shrink", "store", "0", "--engine", "pymunk"], "--engine 'pymunk' is none"),
        (["diff", "store", "store", "--factor", "1"], "factor = 1.0 must be"),
        (["run", "none.toml"], "none.toml cannot be read"),
    ):
        assert main(["campaign", *words]) == 2
        assert told in capsys.readouterr().err


def test_pages_of_any_campaign_are_made(pendulums: CampaignStore) -> None:
    page = pendulums.document()
    assert page.verdict.startswith("4 runs of pendulums")
    assert "4 runs of 4 machines" in repr(pendulums)
    assert len(list(pendulums.rows())) == len(pendulums.to_dataframe()) == 4
    assert pendulums.plot().axes
    assert difference(pendulums, pendulums).document().verdict.startswith("4 runs are in both")


def test_shrinking_takes_away_what_does_not_matter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The wrong engine has twice the stiffness of a spring: all but the spring may go."""
    monkeypatch.setenv("TREBUCHECK_ENGINES", "stiff=plugin_engines:Stiff")
    chain = tb.model("double-pendulum")
    spring = tb.SpringDamper(
        name="spring", body=chain.bodies[0].name, point=(0.3, 0.0), relative_point=(1.0, 1.0),
        stiffness=40.0, damping=0.0, rest_length=0.123456,
    )  # fmt: skip
    force = tb.ConstantForce(
        name="force", body=chain.bodies[1].name, point=(0.1, 0.0), force=(1.0, 0.0)
    )
    given = tb.Mechanism(**(dict(chain) | {"force_elements": (force, spring)}))
    runs = Runs(engines=("stiff",), presets=("default",), until=0.5)
    found = shrink(given, runs, EngineCase("stiff", "default"))
    assert [element.name for element in found.mechanism.force_elements] == ["spring"]
    assert len(found.mechanism.bodies) == 1
    assert found.run.outcome.value == "disagrees" and found.script is None
    with pytest.raises(tb.InputError, match="does not disagree"):
        shrink(chain, runs, EngineCase("stiff", "default"))


PAGE = Path(__file__).parents[2] / "docs" / "campaigns.md"


def _blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def test_the_description_of_the_page_is_one() -> None:
    (text,) = _blocks("toml")
    given = Campaign.of(tomllib.loads(text))
    assert given.machines.number == 4096 and given.runs is not None
    Campaign.read(PAGE.parents[1] / "examples" / "arms.toml")


def test_the_questions_of_the_page_have_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    duckdb = pytest.importorskip("duckdb", reason="DuckDB is of the extra test")
    pytest.importorskip("polars", reason="polars is of the extra test")
    monkeypatch.chdir(tmp_path)
    fields = tomllib.loads((PAGE.parents[1] / "examples" / "arms.toml").read_text())
    for interval in fields["machines"]["values"].values():
        interval["steps"] = 2
    campaign(fields, "arms", jobs=2)
    answers = [duckdb.sql(text).fetchall() for text in _blocks("sql")]
    assert len(answers) == 3 and all(answers)
    by_engine = {(engine, preset): (runs, agree) for engine, preset, runs, agree, _ in answers[0]}
    assert by_engine["mujoco", "settings"] == (4, 1.0) and by_engine["mujoco", "default"][1] == 0.0
    for text in _blocks("python"):
        exec(compile(text, str(PAGE), "exec"), {})
    told = capsys.readouterr().out
    assert "trebucheck compare --model fixed --set l1=" in told and "disagrees" in told
