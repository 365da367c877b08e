"""Fields of shots and receivers give the change of motion that runs give, and one another."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from open_box import ROCK, H, open_box
from scipy.signal import butter, sosfiltfilt

from pyblast.errors import InputError
from pyblast.mesh.builder import structured_box
from pyblast.mesh.mesh import locate_in_zones
from pyblast.model.joint import Joint
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Hole, TimeFunction
from pyblast.runs.bank import bank_of
from pyblast.runs.secondary_sources import ROCK as ROCKS
from pyblast.runs.secondary_sources import by_hole, by_joint, by_rock
from pyblast.solver.run import simulate

DURATION, HIGHEST = 0.35, 20.0
TIMES = 0.004 * np.arange(int(DURATION / 0.004))
STIFFNESS = {"kn": 2e9, "ks": 1e9}
RATE = TimeFunction(1e9 * np.sin(np.pi * np.arange(0.0, 0.1, 1e-3) / 0.1) ** 2, 1e-3)
PLACES = np.array([[0.6, 0.7, -0.4], [1.4, 1.3, -1.2]]) * H


def site(stiffness=STIFFNESS, **parts):
    known = {
        "planes": {"J": ("x", 2 * H)},
        "joints": [Joint("J", "elastic", stiffness)],
        "sources": [Hole(PLACES[0], 20.0, 0.0, RATE)],
        "receivers": [
            Receiver("A", (2.8 * H, 1.7 * H, 0.0), 0.4), Receiver("B", (2.2 * H, 0.2 * H, -60.0))
        ],
    }  # fmt: skip
    return open_box(1, False, injected=False, **known | parts)


@cache
def bank():
    return bank_of([site()], DURATION, HIGHEST)


def in_time(spectra):
    """Return the motion (..., n_receivers, 3, n_times) of spectra by receiver."""
    return np.real(bank().by_receiver(spectra) @ bank().transform.back(TIMES))


@cache
def low_passed(model_of, *asked):
    """Return the motion of a run through the same transform."""
    run = simulate(model_of(*asked), DURATION)
    transform, motion = bank().transform, []
    for record in run.seismograms.values():
        kernel = transform.kernel(record.times, run.dt)
        motion.append(np.real((kernel @ record.velocity).T @ transform.back(TIMES)))
    return np.array(motion)


def misfit(one, other):
    return np.linalg.norm(one - other) / np.linalg.norm(other)


def test_motion_returns_from_its_damped_transform_to_the_end_of_the_record():
    """The end of a record is weighed least, and what leaks into it from its begin is amplified."""
    run = simulate(placed(0), DURATION)
    (record, *_), back = run.seismograms.values(), bank().transform.back(TIMES)
    kernel = bank().transform.kernel(record.times, run.dt)
    returned = np.real((kernel @ record.velocity).T @ back)
    motion = np.array([np.interp(TIMES, record.times, each) for each in record.velocity.T])
    low = butter(4, 0.8 * HIGHEST, fs=1.0 / 0.004, output="sos")
    in_band = [sosfiltfilt(low, each, axis=-1) for each in (returned, motion)]
    assert misfit(*in_band) < 0.005


def softened(share):
    return site({name: (1.0 + share) * value for name, value in STIFFNESS.items()})


def test_a_force_at_one_receiver_moves_another_as_the_reverse():
    model, moved = bank().model, []
    for receiver in model.receivers:
        zone, local = locate_in_zones(model.mesh, receiver.position)
        rows = bank().row[model.nodes.zone_nodes[zone[0]]]
        field = bank().forces[:, :, rows]
        moved.append(np.einsum("a,pkai->ipk", model.nodes.shapes(local)[0], field))
    both = np.concatenate(moved)
    assert np.abs(both - both.swapaxes(0, 1)).max() < 1e-5 * np.abs(both).max()


def placed(number):
    return site(sources=[Hole(PLACES[number], 20.0, 0.0, RATE)])


@pytest.mark.parametrize("number", [0, 1])
def test_fields_of_receivers_give_the_motion_of_a_hole_anywhere(number):
    spectra = by_hole(bank(), placed(number).sources[0])
    assert misfit(in_time(spectra), low_passed(placed, number)) < 0.01


def test_springs_of_a_joint_change_the_motion_as_a_run_does():
    patches = by_joint(bank(), 40.0)
    assert set(patches.names) == {"J"}
    assert len(patches.names) > 4
    assert patches.sizes.sum() == pytest.approx(12.0 * H**2)
    change = in_time(patches.spectra.sum(axis=(0, 1))[0])
    run = low_passed(softened, 0.02) - low_passed(softened, 0.0)
    assert misfit(0.02 * change, run) < 0.04


def of_rock(cp=0.0, cs=0.0, density=0.0):
    """Return the site with a zone of other rock."""
    model = site()
    lines = [H * np.arange(-1, 5), H * np.arange(-1, 4), H * np.arange(-3, 1)]
    other = Material.from_speeds(
        ROCK.density * np.exp(density), ROCK.cp * np.exp(cp - 0.5 * density),
        ROCK.cs * np.exp(cs - 0.5 * density),
    )  # fmt: skip
    mesh = structured_box(*lines, order=4, planes={"J": ("x", 2 * H)})
    inside = np.all(np.abs(mesh.node_places.mean(axis=1) - CUBE) < 0.5 * H, axis=1)
    mesh = regrouped(mesh, inside)
    return replace(model, mesh=mesh.split(["J"]), materials={"rock": ROCK, "other": other})


CUBE = H * np.array([1.5, 1.5, -1.5])


def regrouped(mesh, inside):
    """Return a mesh whose zones inside are those of a second group."""
    order = np.argsort(inside, kind="stable")
    return replace(
        mesh, zones=mesh.zones[order], zone_group=inside[order].astype(mesh.zone_group.dtype),
        groups=("rock", "other"),
    )  # fmt: skip


@pytest.mark.parametrize("name", ["cp", "cs", "density"])
def test_other_rock_changes_the_motion_as_a_run_does(name):
    sources = by_rock(bank())
    inside = np.all(np.abs(sources.centres - CUBE) < 0.5 * H, axis=1)
    assert sources.sizes[inside].sum() == pytest.approx(H**3)
    change = in_time(sources.spectra[inside, ROCKS.index(name), 0].sum(axis=0))
    run = low_passed(of_rock_by, name, 0.01) - low_passed(of_rock_by, name, 0.0)
    assert misfit(0.01 * change, run) < 0.02


def of_rock_by(name, amount):
    return of_rock(**{name: amount})


def test_tetrahedra_are_refused_in_a_sentence():
    box = structured_box((2, 2, 2), (40.0, 40.0, 40.0))
    model = Model(box, {"rock": ROCK}, receivers=[Receiver("A", (20.0, 20.0, 40.0))])
    with pytest.raises(InputError, match="tetrahedra"):
        bank_of([model], DURATION, HIGHEST)


def test_fields_beyond_memory_are_refused_before_any_run(monkeypatch):
    monkeypatch.setattr("pyblast.runs.bank.MOST_BYTES", 1e6)
    with pytest.raises(InputError, match=r"take .* GB, and 0.001 GB are kept at most"):
        bank_of([site()], DURATION, HIGHEST)
