"""The program pyblast-run: the same bits as the Python run, one sentence for a broken file."""

import os
import re
import shutil
import signal
import subprocess
import time
from dataclasses import replace
from importlib import resources

import h5py
import numpy as np
import pytest
from small_project import written

from pyblast import core
from pyblast.errors import InputError, ReadError
from pyblast.files import plain
from pyblast.mesh.builder import Layer, structured_box
from pyblast.mesh.hexahedra import AbsorbingLayer
from pyblast.model.anisotropy import jointed
from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Damping, Material, MohrCoulomb
from pyblast.model.model import InSitu, Model, Receiver
from pyblast.model.source import PointForce, TimeFunction
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.preparation import export, prepare
from pyblast.solver.run import simulate
from pyblast.workflows.run import conclude_program_run, load_project
from pyblast.workflows.run import run as run_project
from verification import fuzz
from verification.contact import properties
from verification.zone import MATERIALS

PROGRAM = resources.files("pyblast") / "bin" / "pyblast-run"
ROCK = Material.from_speeds(2660.0, 3078.0, 1645.0)

pytestmark = pytest.mark.skipif(
    not PROGRAM.is_file(), reason="pyblast was built without the program pyblast-run"
)


@pytest.fixture(scope="module")
def model():
    edges = np.arange(0.0, 41.0, 4.0)
    mesh = structured_box(edges, edges[:4], -edges[3::-1], planes={"J": ("x", 20.0)}).split(["J"])
    time = np.arange(0.0, 0.1, 1e-3)
    velocity = np.outer(np.sin(np.pi * time / 0.1) ** 2, [0.3, 0.2, 0.1])
    joint = Joint(
        "J", "coulomb", {"kn": 1e9, "ks": 5e8, "cohesion": 1e4, "friction": 0.3, "tension": 0.0},
        insitu_pressure=1e5,
    )  # fmt: skip
    return Model(
        mesh,
        {"rock": ROCK},
        joints=[joint],
        boundaries=[
            Viscous("west"),
            Viscous("east"),
            StressInput("west", Seismogram(velocity, 1e-3)),
        ],
        damping=Damping(0.01, 20.0),
        receivers=[Receiver("A", (35.0, 5.0, -5.0))],
    )


@pytest.fixture(scope="module")
def exported(model, tmp_path_factory):
    path = tmp_path_factory.mktemp("standalone") / "model.h5"
    export(prepare(model, 0.15), path)
    return path


def march(*arguments):
    return subprocess.run(
        [PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=60, check=False
    )


def test_the_program_marches_to_the_same_bits_as_python(model, exported, tmp_path):
    here = simulate(model, 0.15)

    done = march(exported, tmp_path / "result.h5")

    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "result.h5") as file:
        motion = file["records/motion"][:, 0]
        state = {name: file[f"state/{name}"][()] for name in here.state}
    assert np.array_equal(motion, here.seismograms["A"].velocity)
    for name, value in here.state.items():
        assert np.array_equal(state[name], value), name
    assert here.state["contact_state"][:, 3].max() > 0.0


def test_implicit_zones_march_to_the_same_bits(tmp_path):
    mesh = structured_box((6, 6, 6), (24.0, 24.0, 24.0), planes={"J": ("x", 12.0)})
    points = mesh.points.copy()
    points[np.argmax((points == 12.0).all(axis=1)), 1] += 3.88
    time = np.arange(0.0, 0.05, 1e-3)
    push = Seismogram(np.outer(np.sin(np.pi * time / 0.05) ** 2, [0.1, 0.5, 0.2]), 1e-3)
    joint = {"kn": 2e10, "ks": 1e10, "cohesion": 0.0, "friction": 0.3, "tension": 0.0}
    model = Model(
        replace(mesh, points=points).split(["J"]),
        {"rock": ROCK},
        joints=[Joint("J", "coulomb", joint, insitu_pressure=1e5)],
        boundaries=[*map(Viscous, ("west", "east", "bottom")), StressInput("west", push)],
        damping=Damping(0.02, 20.0, corner=90.0),
        receivers=[Receiver("A", (20.0, 5.0, 18.0))],
    )
    prepared = prepare(model, 0.05)
    export(prepared, tmp_path / "model.h5")

    done = march(tmp_path / "model.h5", tmp_path / "result.h5")

    here = simulate(model, 0.05, prepared=prepared)
    assert done.returncode == 0, done.stderr
    assert prepared.limit.implicit.zones.any()
    with h5py.File(tmp_path / "result.h5") as file:
        assert np.array_equal(file["records/motion"][:, 0], here.seismograms["A"].velocity)
        assert np.array_equal(file["records/energy"][()], energies(here))
        for name, value in here.state.items():
            assert np.array_equal(file[f"state/{name}"][()], value), name


def energies(run):
    """Return the energies (n_lines, n) of a run in the order of the file."""
    return np.transpose([run.energy[name] for name in core.ENERGIES])


def test_yielding_and_anisotropic_ground_marches_to_the_same_bits(tmp_path):
    mesh = structured_box(
        (6, 4, 4), (30.0, 20.0, 20.0), layers=[Layer("weak", 10.0), Layer("schist")]
    )
    weak = Material(
        2500.0, 2e10, 1e10, cohesion=1e6, friction=0.5, tension=5e5, law=MohrCoulomb(0.1)
    )
    time = np.arange(0.0, 0.05, 1e-3)
    push = Seismogram(np.outer(np.sin(np.pi * time / 0.05) ** 2, [1.0, 0.5, 0.2]), 1e-3)
    model = Model(
        mesh,
        {"weak": weak, "schist": jointed(ROCK, (1.0, 0.0, 1.0), 2.0, 5e9, 2e9)},
        boundaries=[*map(Viscous, ("west", "east", "bottom")), StressInput("west", push)],
        receivers=[Receiver("A", (25.0, 5.0, 18.0))],
        insitu=InSitu(9.81, 0.3),
    )
    prepared = prepare(model, 0.05)
    export(prepared, tmp_path / "model.h5")
    here = simulate(model, 0.05, prepared=prepared)

    done = march(tmp_path / "model.h5", tmp_path / "result.h5")

    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "result.h5") as file:
        for name, value in here.state.items():
            assert np.array_equal(file[f"state/{name}"][()], value), name
    assert here.state["row_state"][:, 12].max() > 0.0


def test_hexahedra_with_a_layer_and_a_joint_march_to_the_same_bits(tmp_path):
    edge = 20.0
    lines = [edge * np.arange(-2, 5), edge * np.arange(-2, 5), edge * np.arange(-4, 1)]
    mesh = structured_box(*lines, order=4, planes={"J": ("x", 20.0)})
    inner = ((0.0, 40.0), (0.0, 40.0), (-40.0, np.inf))
    layer = AbsorbingLayer(inner, ((2 * edge, 2 * edge),) * 3)
    joint = Joint("J", "elastic", {"kn": 2e9, "ks": 1e9})
    rock = Material.from_speeds(2660.0, 3078.0, 1645.0, law=ConstantQ(40.0, 20.0))
    pulse = TimeFunction(1e8 * np.hanning(41), 1e-3)
    model = Model(
        replace(mesh, layer=layer).split(["J"]),
        {"rock": rock},
        joints=[joint],
        boundaries=[Viscous(side) for side in ("west", "east", "south", "north", "bottom")],
        sources=[PointForce((10.0, 20.0, -15.0), (1.0, 0.5, -0.3), pulse)],
        receivers=[Receiver("A", (35.0, 5.0, -5.0))],
    )
    here = simulate(model, 0.06)
    export(prepare(model, 0.06), tmp_path / "model.h5")

    done = march(tmp_path / "model.h5", tmp_path / "result.h5")

    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "result.h5") as file:
        assert np.array_equal(file["records/motion"][:, 0], here.seismograms["A"].velocity)
        for name, value in here.state.items():
            assert np.array_equal(file[f"state/{name}"][()], value), name
    assert np.abs(here.seismograms["A"].velocity).max() > 0.0


@pytest.fixture(scope="module")
def quadratic():
    mesh = structured_box((3, 2, 2), (30.0, 20.0, 20.0), planes={"J": ("x", 20.0)}).split(["J"])
    pulse = TimeFunction(1e8 * np.hanning(41), 5e-4)
    return Model(
        mesh,
        {"rock": replace(ROCK, law=ConstantQ(40.0, 20.0))},
        joints=[Joint("J", "elastic", {"kn": 2e9, "ks": 1e9})],
        boundaries=[Viscous("bottom")],
        sources=[PointForce((8.0, 11.0, 13.0), (1.0, 0.5, -0.3), pulse)],
        receivers=[Receiver("A", (25.0, 5.0, 18.0))],
        quadratic=True,
    )


def test_quadratic_zones_and_a_joint_run_to_the_same_bits(quadratic, tmp_path):
    here = simulate(quadratic, 0.05)
    export(prepare(quadratic, 0.05), tmp_path / "model.h5")

    done = march(tmp_path / "model.h5", tmp_path / "result.h5")

    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "result.h5") as file:
        assert np.array_equal(file["records/motion"][:, 0], here.seismograms["A"].velocity)
    assert np.abs(here.seismograms["A"].velocity).max() > 0.0


def test_packs_of_quadratic_zones_that_are_too_few_are_refused(quadratic, tmp_path):
    export(prepare(quadratic, 0.01), tmp_path / "model.h5")
    with h5py.File(tmp_path / "model.h5", "r+") as file:
        packs = file["arrays/pack_metric"][:-1]
        del file["arrays/pack_metric"]
        file["arrays/pack_metric"] = packs

    done = march(tmp_path / "model.h5", tmp_path / "result.h5")

    assert done.returncode == 2
    assert "quadratic zones" in done.stderr


def test_all_laws_of_zones_and_joints_together_march_to_the_same_bits(tmp_path):
    names = list(MATERIALS)
    layers = [*(Layer(name, 4.0) for name in names[:-1]), Layer(names[-1])]
    laws = list(core.JOINT_LAWS)
    planes = {law: ("x", 8.0 * (n + 1)) for n, law in enumerate(laws)}
    edges = np.arange(0.0, 8.0 * len(laws) + 9.0, 4.0)
    grid = edges, [0.0, 4.0], np.arange(-4.0 * len(names), 1.0, 4.0)
    mesh = structured_box(*grid, layers=layers, planes=planes)
    time = np.arange(0.0, 0.05, 1e-3)
    push = Seismogram(np.outer(np.sin(np.pi * time / 0.025) ** 3, [2.0, 1.0, 0.5]), 1e-3)
    model = Model(
        mesh.split(laws),
        MATERIALS,
        joints=[Joint(law, law, properties(law), 3e5, (0.0, 1e4, 0.0), 10.0) for law in laws],
        boundaries=[  # pushed from both sides: no law is far from where the motion enters
            *(Viscous(side) for side in ("west", "east")),
            *(StressInput(side, push) for side in ("west", "east")),
        ],
        receivers=[Receiver("A", (edges[-1] - 2.0, 2.0, -2.0))],
    )
    prepared = prepare(model, 0.1)
    export(prepared, tmp_path / "model.h5")
    here = simulate(model, 0.1, prepared=prepared)

    done = march(tmp_path / "model.h5", tmp_path / "result.h5")

    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "result.h5") as file:
        assert np.array_equal(file["records/motion"][:, 0], here.seismograms["A"].velocity)
        for name, value in here.state.items():
            assert np.array_equal(file[f"state/{name}"][()], value), name
    moved = here.state["contact_traction"] != prepared.constants["contact_initial"]
    assert moved.any(axis=1).all()
    for law in core.JOINT_LAWS.values():
        mine = prepared.constants["joint_law"][prepared.constants["contact_joint"]] == law.number
        remembered = here.state["contact_state"][mine][:, : len(law.state)]
        assert remembered.any() or not law.state, law.name
    assert here.state["row_state"].any()


def cut(file):
    raw = file.read_bytes()
    file.write_bytes(raw[: len(raw) // 2])


def remove_array(file):
    with h5py.File(file, "r+") as handle:
        del handle["arrays/zone_slot"]


def lengthen(file):
    with h5py.File(file, "r+") as handle:
        del handle["arrays/node_mass"]
        handle["arrays/node_mass"] = np.ones(7)


def empty(file):
    with h5py.File(file, "r+") as handle:
        del handle["arrays/node_start"]
        handle["arrays/node_start"] = np.zeros(0, dtype=np.int32)


def point_outside(file):
    with h5py.File(file, "r+") as handle:
        handle["arrays/load_node"][0] = 10**6


def point_before(file):
    with h5py.File(file, "r+") as handle:
        handle["arrays/zone_slot"][0, 0] = 0


def change_kind(file):
    with h5py.File(file, "r+") as handle:
        del handle["arrays/dt"]
        handle["arrays/dt"] = "soon"


def age(file):
    with h5py.File(file, "r+") as handle:
        handle["run/schema"][()] = 0


def stop_time(file):
    with h5py.File(file, "r+") as handle:
        handle["arrays/dt"][()] = np.nan


def raise_order(file):
    with h5py.File(file, "r+") as handle:
        handle["arrays/hex_order"][()] = 2**31 - 1


def lose_delay(file):
    with h5py.File(file, "r+") as handle:
        handle["arrays/load_delay"][0] = np.nan


def put_two_dashpots_on_a_node(file):
    with h5py.File(file, "r+") as handle:
        handle["arrays/dashpot_node"][1] = handle["arrays/dashpot_node"][0]


@pytest.mark.parametrize(
    "damage",
    [cut, remove_array, lengthen, empty, point_outside, point_before, change_kind, age, stop_time,
     raise_order, lose_delay, put_two_dashpots_on_a_node],
)  # fmt: skip
def test_a_broken_model_file_is_refused_in_one_sentence(damage, exported, tmp_path):
    broken = tmp_path / "broken.h5"
    shutil.copy(exported, broken)
    damage(broken)

    done = march(broken, tmp_path / "result.h5")

    assert done.returncode == 2
    assert done.stderr.startswith("pyblast-run: ")
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "result.h5").exists()


@pytest.mark.long
def test_damage_at_random_is_refused_in_one_sentence_or_leaves_a_model(tmp_path):
    row = fuzz.fuzz("model file", 0, 45, 5, tmp_path)

    assert row["faults"] == []
    assert row["refused"] > 25


OUT_OF_RANGE = {
    "arrays/node_mass": -1.0,
    "arrays/contact_area": -1.0,
    "arrays/zone_shear": -1.0,
    "arrays/receiver_weight": np.nan,
    "arrays/history": np.inf,
    "arrays/joint_property": np.nan,
    "state/memory": np.nan,
    "state/slab_memory": -np.inf,
}


@pytest.mark.parametrize("name", OUT_OF_RANGE)
def test_numbers_that_no_model_has_are_refused_by_the_name_of_their_array(name, exported, tmp_path):
    broken = tmp_path / "broken.h5"
    shutil.copy(exported, broken)
    with h5py.File(broken, "r+") as file:
        values = file[name][()]
        values.flat[-1] = OUT_OF_RANGE[name]
        file[name][...] = values

    done = march(broken, tmp_path / "result.h5")

    assert done.returncode == 2
    assert f"'{name}' must be " in done.stderr


@pytest.mark.parametrize("load", [1e200, 1e308])
def test_a_load_beyond_all_bounds_ends_the_run(load, exported, tmp_path):
    broken = tmp_path / "broken.h5"
    shutil.copy(exported, broken)
    with h5py.File(broken, "r+") as file:
        file["arrays/history"][5] = load

    done = march(broken, tmp_path / "result.h5")

    assert done.returncode == 1
    assert not (tmp_path / "result.h5").exists()


def test_one_changed_byte_of_an_array_is_noticed(exported, tmp_path):
    broken = tmp_path / "broken.h5"
    raw = bytearray(exported.read_bytes())
    with h5py.File(exported) as file:
        for name in ("arrays/node_mass", "arrays/zone_slot", "state/velocity"):
            raw[file[name].id.get_chunk_info(0).byte_offset + 7] ^= 1
            broken.write_bytes(raw)

            done = march(broken, tmp_path / "result.h5")

            assert done.returncode == 2
            assert "damaged" in done.stderr


def test_a_result_has_checksums(exported, tmp_path):
    march(exported, tmp_path / "result.h5")

    with h5py.File(tmp_path / "result.h5") as file:
        assert all(file[name].fletcher32 for name in ("records/motion", "state/velocity"))


@pytest.mark.parametrize("size", [0, 1000, 20_000, 60_000])
def test_a_full_disk_ends_with_one_sentence_and_leaves_nothing(size, exported, tmp_path):
    resource = pytest.importorskip("resource")  # a limit of the size of files stands for it

    done = subprocess.run(
        [PROGRAM, exported, tmp_path / "result.h5"], capture_output=True, text=True, timeout=60,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)), check=False,
    )  # fmt: skip

    assert done.returncode == 2
    assert re.fullmatch(r"pyblast-run: \S+result.h5: can't be written \(.*\)\n", done.stderr)
    assert not list(tmp_path.iterdir())


def test_what_is_no_file_and_the_model_itself_are_never_replaced(exported, tmp_path):
    model = tmp_path / "model.h5"
    shutil.copy(exported, model)
    (tmp_path / "link").symlink_to(model)
    os.mkfifo(tmp_path / "pipe")

    for result in (tmp_path, tmp_path / "link", tmp_path / "pipe", model):
        done = march(model, result)

        assert done.returncode == 2
        assert f"{result}: can't be written (" in done.stderr
    assert model.read_bytes() == exported.read_bytes()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_program_though_it_was_ignored_before(number, exported, tmp_path):
    slow = tmp_path / "slow.h5"
    shutil.copy(exported, slow)
    with h5py.File(slow, "r+") as file:
        for name, length in (("run/n_steps", 10**6), ("arrays/history", (10**6, 3))):
            del file[name]
            file[name] = np.int32(length) if np.ndim(length) == 0 else np.zeros(length)
    before = signal.signal(number, signal.SIG_IGN)
    try:
        process = subprocess.Popen(
            [PROGRAM, slow, tmp_path / "result.h5"], stderr=subprocess.PIPE, text=True
        )
    finally:
        signal.signal(number, before)
    while not (tmp_path / "result.h5.part").exists() and process.poll() is None:
        time.sleep(0.01)

    process.send_signal(number)

    assert process.wait(2.0) == 130
    assert process.stderr.read() == "pyblast-run: interrupted; no result is written\n"
    assert list(tmp_path.iterdir()) == [slow]


def test_far_too_many_threads_are_as_many_as_there_are_processors(exported, tmp_path):
    march(exported, tmp_path / "one.h5")

    done = subprocess.run(
        [PROGRAM, exported, tmp_path / "many.h5"], capture_output=True, text=True, timeout=60,
        env={**os.environ, "OMP_NUM_THREADS": "100000"}, check=False,
    )  # fmt: skip

    assert done.returncode == 0
    assert "one for each processor" in done.stderr
    with h5py.File(tmp_path / "one.h5") as one, h5py.File(tmp_path / "many.h5") as many:
        assert np.array_equal(one["records/motion"], many["records/motion"])


def test_a_model_that_breaks_the_table_is_not_written(model, tmp_path):
    prepared = prepare(model, 0.15)
    wrong = {**prepared.constants, "node_mass": -prepared.constants["node_mass"]}

    with pytest.raises(InputError, match="arrays/node_mass: must be positive"):
        export(replace(prepared, constants=wrong), tmp_path / "model.h5")
    short = {**prepared.state, "velocity": prepared.state["velocity"][:-1]}
    with pytest.raises(InputError, match=r"state/velocity: must be \(\d+, 3\) of f, got"):
        export(replace(prepared, state=short), tmp_path / "model.h5")
    astray = {**prepared.constants, "load_node": prepared.constants["load_node"] - 10**6}
    with pytest.raises(InputError, match="arrays/load_node: must be at least 1"):
        export(replace(prepared, constants=astray), tmp_path / "model.h5")
    assert not list(tmp_path.iterdir())


def test_wrong_usage_is_told(tmp_path):
    done = march(tmp_path / "model.h5")

    assert done.returncode == 2
    assert "usage: pyblast-run MODEL RESULT" in done.stderr


def test_a_result_of_the_program_is_compared_and_reported_as_the_run_from_python(tmp_path):
    project = load_project(written(tmp_path))
    outcome = run_project(project, tmp_path / "python", report=False)
    export(outcome.run.prepared, tmp_path / "model.h5")
    assert march(tmp_path / "model.h5", tmp_path / "records.h5").returncode == 0

    reported = conclude_program_run(project, tmp_path / "records.h5", tmp_path / "program")

    own, same = (plain(one.result.summary) for one in (outcome, reported))
    assert same["receivers"] == own["receivers"]
    assert same["energy"] == own["energy"]
    assert (reported.folder / "report.html").is_file()


def test_a_result_of_the_program_for_another_model_is_refused(tmp_path, exported):
    march(exported, tmp_path / "records.h5")
    project = load_project(written(tmp_path))

    with pytest.raises(InputError, match=r"result of another model.*--write-model"):
        conclude_program_run(project, tmp_path / "records.h5", tmp_path / "out")
    with pytest.raises(ReadError, match="not a result of pyblast-run"):
        conclude_program_run(project, exported, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_program_says_how_it_is_used():
    done = march("--help")

    assert done.returncode == 0
    assert "--write-model" in done.stdout
    assert "usage: pyblast-run MODEL RESULT" in march().stderr
