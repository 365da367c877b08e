"""The march: same bits however it is cut, exact resume, failures named, refusals."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
from command_line import python
from slipping_box import DT, SIDES, TIMES, digest, shaking, slipping_model

from pyblast.errors import InputError, ReadError, SolverError
from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Roller, StressInput, VelocityInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Damping
from pyblast.model.model import Model, Receiver
from pyblast.model.source import PointForce, TimeFunction
from pyblast.signals.seismogram import Seismogram
from pyblast.solver import run
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from verification.columns import ROCK, ricker


def tiny_model(**parts):
    mesh = structured_box((4, 2, 2), (8.0, 4.0, 4.0))
    parts = {"receivers": [Receiver("A", (1.0, 1.0, 1.0))], **parts}
    return Model(mesh, {"rock": ROCK}, **parts)


@pytest.fixture(scope="module")
def whole():
    return simulate(slipping_model(), 0.2)


def test_the_model_of_these_tests_slips_and_opens(whole):
    failed = whole.state["contact_state"][:, 3].astype(int)

    assert whole.prepared.n_steps >= 500
    assert np.count_nonzero(failed & 1) > 20
    assert np.count_nonzero(failed & 2) > 20
    assert whole.balance_error < 0.01


SCRIPT = """
import sys, json
from slipping_box import digest, slipping_model
from pyblast import _core
from pyblast.solver.run import simulate
_core.pyblast_kinds.least_shared = int(sys.argv[1])
result = simulate(slipping_model(), 0.2)
print(json.dumps([digest(result), result.prepared.fingerprint, result.provenance["threads"]]))
"""


@pytest.mark.parametrize(("threads", "least"), [(1, 1), (2, 1), (3, 1), (2, 10**9)])
def test_any_number_of_threads_gives_the_same_bits(threads, least, whole):
    bits, fingerprint, used = python(SCRIPT, least, threads=threads)

    assert used == str(threads)
    assert fingerprint == whole.prepared.fingerprint
    assert bits == digest(whole)


@pytest.mark.parametrize("seconds", [0.0, 0.003])
def test_the_length_of_chunks_changes_no_bit(seconds, whole, monkeypatch):
    monkeypatch.setattr("pyblast.solver.preparation.CHUNK_SECONDS", seconds)
    calls = []

    result = simulate(
        slipping_model(), 0.2, prepared=whole.prepared, progress=lambda *call: calls.append(call)
    )

    assert len(calls) > (20 if seconds == 0.0 else 5)
    assert digest(result) == digest(whole)


def test_a_run_does_not_change_what_was_prepared(whole):
    again = simulate(slipping_model(), 0.2, prepared=whole.prepared)

    assert digest(again) == digest(whole)


class Stop:
    """Interrupt a run at a step, as Ctrl-C does."""

    def __init__(self, step):
        self.step = step

    def __call__(self, stage, done, _):
        if stage == "dynamic" and done >= self.step:
            raise KeyboardInterrupt


@pytest.mark.parametrize("step", [1, 250])
def test_an_interrupted_run_goes_on_with_the_same_bits(step, whole, tmp_path, monkeypatch):
    monkeypatch.setattr("pyblast.solver.preparation.CHUNK_SECONDS", 0.01)
    path = tmp_path / "checkpoint.h5"
    with pytest.raises(KeyboardInterrupt):
        simulate(slipping_model(), 0.2, progress=Stop(step), checkpoint=path)

    result = simulate(slipping_model(), 0.2, resume=path)

    assert digest(result) == digest(whole)


def test_a_checkpoint_of_another_model_is_refused(tmp_path):
    path = tmp_path / "checkpoint.h5"
    with pytest.raises(KeyboardInterrupt):
        simulate(tiny_model(), 0.02, progress=Stop(1), checkpoint=path)

    with pytest.raises(InputError, match="checkpoint of another model or duration"):
        simulate(tiny_model(damping=Damping(0.01, 20.0)), 0.02, resume=path)


def test_a_broken_checkpoint_is_refused(tmp_path):
    path = tmp_path / "checkpoint.h5"
    path.write_bytes(b"no HDF5")

    with pytest.raises(ReadError, match=r"checkpoint\.h5: not a whole HDF5 file"):
        simulate(tiny_model(), 0.02, resume=path)


def test_a_checkpoint_with_another_number_in_it_is_refused(tmp_path):
    path = tmp_path / "checkpoint.h5"
    with pytest.raises(KeyboardInterrupt):
        simulate(tiny_model(), 0.02, progress=Stop(1), checkpoint=path)
    raw = bytearray(path.read_bytes())
    with h5py.File(path) as file:
        raw[file["state/velocity"].id.get_chunk_info(0).byte_offset] ^= 1
    path.write_bytes(raw)

    with pytest.raises(ReadError, match=r"checkpoint\.h5: not a whole HDF5 file .*damaged"):
        simulate(tiny_model(), 0.02, resume=path)


def test_snapshots_hold_the_velocity_at_their_times():
    force = PointForce(np.array([4.0, 2.0, 2.0]), np.eye(3)[0], TimeFunction(1e6 * TIMES, DT))

    result = simulate(tiny_model(sources=[force]), 0.02, snapshot_times=[0.01, 0.02])

    assert list(result.snapshots) == pytest.approx([0.01, 0.02], abs=result.dt)
    last = result.snapshots[max(result.snapshots)]
    assert last == pytest.approx(result.state["velocity"], rel=1e-6)


def test_a_receiver_reads_the_linear_motion_inside_its_zone():
    places = np.random.default_rng(4).uniform([0.0] * 3, [8.0, 4.0, 4.0], size=(5, 3))
    model = tiny_model(receivers=[Receiver(f"{n}", tuple(p)) for n, p in enumerate(places)])
    prepared = prepare(model, 1e-4)
    shift, slope = np.array([1.0, 2.0, 3.0]), 1e-3 * np.arange(9.0).reshape(3, 3)
    velocity = shift + model.mesh.points @ slope.T
    state = {**prepared.state, "velocity": velocity}

    result = simulate(model, 1e-4, prepared=replace(prepared, state=state))

    for n, place in enumerate(places):
        first = result.seismograms[f"{n}"].velocity[0]
        assert first == pytest.approx(shift + slope @ place, rel=1e-12)


def test_an_azimuth_turns_the_components_of_a_receiver():
    force = PointForce(np.array([4.0, 2.0, 2.0]), [1.0, 2.0, 3.0], TimeFunction(1e6 * TIMES, DT))
    receivers = [Receiver("plain", (1.0, 1.0, 1.0)), Receiver("turned", (1.0, 1.0, 1.0), 0.3)]

    records = simulate(tiny_model(sources=[force], receivers=receivers), 0.01).seismograms

    assert records["plain"].components == ("east", "north", "vertical")
    assert records["turned"].components[0] == "longitudinal"
    wanted = np.sin(0.3) * records["plain"].velocity[:, 0]
    wanted += np.cos(0.3) * records["plain"].velocity[:, 1]
    assert records["turned"].velocity[:, 0] == pytest.approx(wanted, abs=1e-15)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("bad_step", [0, 33, 140])
def test_an_input_that_is_not_finite_is_caught_within_fifty_steps(value, bad_step):
    force = PointForce(np.array([4.0, 2.0, 2.0]), np.eye(3)[0], TimeFunction(1e6 * TIMES, DT))
    model = tiny_model(sources=[force])
    prepared = prepare(model, 0.05)
    prepared.constants["history"][bad_step] = value

    with pytest.raises(SolverError, match=r"at step \d+ \(t = .* s\).* at \(.*\) m in 'rock'") as e:
        simulate(model, 0.05, prepared=prepared)

    step = int(str(e.value).split("at step ")[1].split()[0])
    assert bad_step < step <= bad_step + 50


@pytest.mark.parametrize("pressure", [95652.17391304349, 232608.69565217392, 384782.60869565216])
def test_rounding_in_a_closed_joint_at_rest_is_no_growth(pressure):
    mesh = structured_box((8, 12, 12), (30.0, 20.0, 20.0), planes={"J": ("x", 15.0)}).split(["J"])
    rough = {"kn": 1.9e8, "ks": 1.7e8, "kn_max": 5.7e10, "closure": pressure * 0.58 / 0.42 / 1.9e8}
    rough |= {"jrc": 14.0, "jcs": 1.2e8, "friction": 0.7, "peak_slip": 2e-3}
    closed = Joint("J", "barton_bandis", rough, insitu_pressure=pressure)
    quiet = [Viscous(side) for side in SIDES]

    model = Model(mesh, {"rock": ROCK}, joints=[closed], boundaries=quiet)

    assert simulate(model, 0.05).energy["kinetic"].max() < 1e-20


@pytest.mark.parametrize("start", range(15, 27))
@pytest.mark.parametrize("power", [0, 3])
def test_a_load_may_begin_at_any_step(start, power):
    dt = prepare(tiny_model(), 1e-3).constants["dt"]
    push = TimeFunction(1e6 * np.arange(1.0, 200.0) ** power, dt, start=start * dt)
    force = PointForce(np.array([4.0, 2.0, 2.0]), np.eye(3)[0], push)

    result = simulate(tiny_model(sources=[force]), 60 * dt)

    assert result.balance_error < 1e-10


@pytest.mark.parametrize("duration", [0.0, -1.0, np.nan, np.inf])
def test_a_duration_that_is_none_is_refused(duration):
    with pytest.raises(InputError, match="duration: must be positive"):
        simulate(tiny_model(), duration)


def test_a_velocity_on_a_viscous_surface_is_refused_with_the_reason():
    with pytest.raises(InputError, match=r"dashpots would act on a motion.*StressInput"):
        tiny_model(boundaries=[Viscous("west"), VelocityInput("west", shaking())])


def test_a_prescribed_velocity_is_the_motion_of_its_surface():
    receiver = Receiver("A", (0.0, 2.0, 2.0))

    result = simulate(
        tiny_model(boundaries=[VelocityInput("west", shaking())], receivers=[receiver]), 0.1
    )

    record = result.seismograms["A"]
    wanted = 0.3 * ricker(record.times, 25.0)
    inside = record.times < TIMES[-1] - result.dt
    assert record.velocity[inside, 0] == pytest.approx(0.8 * wanted[inside], abs=1e-4)


def test_a_resumed_run_needs_the_same_receivers(tmp_path):
    path = tmp_path / "checkpoint.h5"
    with pytest.raises(KeyboardInterrupt):
        simulate(tiny_model(), 0.02, progress=Stop(1), checkpoint=path)

    with pytest.raises(InputError, match="another model"):
        simulate(tiny_model(receivers=[Receiver("A", (2.0, 1.0, 1.0))]), 0.02, resume=path)


def normal_reflection(boundaries):
    """Return the ratio of energy that dashpots took over the input, for a P wave on a column."""
    mesh = structured_box((40, 1, 1), (200.0, 5.0, 5.0))
    push = Seismogram(ricker(TIMES, 40.0)[:, None] * [1.0, 0.0, 0.0], DT)
    guides = [Roller(side) for side in ("south", "north", "bottom", "top")]
    model = Model(
        mesh, {"rock": ROCK}, boundaries=[*guides, StressInput("west", push), *boundaries]
    )
    result = simulate(model, 0.2)
    return result.energy["dashpots"][-1] / result.energy["input"][-1]


def test_literal_viscous_and_fixed_normal_reflects_a_p_wave_wholly():
    quiet = normal_reflection([Viscous("east")])
    literal = normal_reflection([Viscous("east"), Roller("east")])

    assert quiet > 0.99
    assert literal == pytest.approx(0.0, abs=1e-12)


def test_a_roller_of_the_static_stage_leaves_the_dashpots_alone():
    default = normal_reflection([Viscous("east"), Roller("east", dynamic=False)])

    assert default == pytest.approx(normal_reflection([Viscous("east")]), rel=1e-12)


def test_provenance_names_versions_and_the_hash_of_the_input():
    result = simulate(tiny_model(), 0.005)

    assert result.provenance["input_sha256"] == result.prepared.fingerprint
    assert {"pyblast", "numpy", "threads"} <= set(result.provenance)


def test_a_still_model_stays_still_and_balances():
    result = simulate(tiny_model(), 0.01)

    assert not result.state["velocity"].any()
    assert result.balance_error == 0.0


def test_balance_error_is_the_gap_over_what_was_put_in():
    zero = np.zeros(2)
    names = "strain joint_stored joint_dissipated zone_dissipated damping dashpots insitu"
    energy = dict.fromkeys(names.split(), zero)
    energy |= {"kinetic": np.array([0.0, 3.0]), "input": np.array([0.0, 4.0])}

    assert run.balance_error(energy) == pytest.approx(0.25)
