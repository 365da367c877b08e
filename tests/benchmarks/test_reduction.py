"""Small systems answer as full runs do, say how well, and refuse what they cannot know."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reduction import reduced_model, snapshots
from benchmarks.reduction.families import Ranges, family
from benchmarks.reduction.projection import project, solve
from benchmarks.reduction.reduced_model import reduced
from pyblast.errors import InputError
from pyblast.mesh.builder import structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model.anisotropy import jointed as medium
from pyblast.model.boundary import FreeField, Roller, StressInput, VelocityInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Damping, Material
from pyblast.model.model import InSitu, Model, Receiver, SpongeLayer
from pyblast.model.source import Column, Hole, TimeFunction
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.run import simulate
from verification.columns import ROCK, ricker

TIMES = np.arange(0.0, 0.04, 5e-4)
SOIL = Material.from_speeds(2200.0, 2500.0, 1200.0)
STIFFNESS = {"kn": 2e9, "ks": 1e9}
STRONG = {**STIFFNESS, "cohesion": 5e6, "friction": 0.6, "tension": 5e6}
SIDES = ("west", "east", "south", "north", "bottom")
RANGES = {"kn": (1e9, 4e9), "ks": (5e8, 2e9), "ratio": (0.01, 0.05)}
VALUES = {"kn": 1.3e9, "ks": 1.7e9, "ratio": 0.03}


def shaking(amplitude=0.05):
    return Seismogram(amplitude * ricker(TIMES, 80.0)[:, None] * [0.8, 0.5, -0.3], TIMES[1])


def cube(cells=2):
    """Return two groups, cut by one joint across both."""
    mesh = structured_box((cells, 2, 2), (20.0, 16.0, 16.0), planes={"J": ("x", 10.0)})
    group = (mesh.points[mesh.zones].mean(axis=1)[:, 2] > 8.0).astype(int)
    return Mesh(mesh.points, mesh.zones, group, ("rock", "soil"), mesh.surfaces).split(["J"])


def jointed(law="elastic", properties=STIFFNESS, cells=2, **parts):
    known = {
        "materials": {"rock": ROCK, "soil": SOIL},
        "boundaries": [*map(Viscous, SIDES), StressInput("west", shaking())],
        "damping": Damping(0.02, 50.0, corner=400.0),
        "receivers": [Receiver("A", (4.0, 11.0, 13.0)), Receiver("B", (18.0, 6.0, 12.0), 0.6)],
    }
    return Model(cube(cells), joints=[Joint("J", law, properties)], **{**known, **parts})


RATE = TimeFunction(1e8 * ricker(TIMES, 80.0), TIMES[1])
BY_GROUP = {"rock": Damping(0.02, 50.0, corner=400.0), "soil": Damping(0.03, 50.0)}
MODELS = {
    "low-passed damping": jointed(),
    "lagged damping by group": jointed(damping=BY_GROUP),
    "constant Q, mass damping": jointed(
        damping=Damping(0.02, 50.0, stiffness=False),
        materials={"rock": replace(ROCK, law=ConstantQ(30.0, 20.0, (5.0, 100.0))), "soil": SOIL},
    ),
    "stuck by friction, stressed": jointed("coulomb", STRONG, insitu=InSitu()),
    "hole, column, sponge, rollers": jointed(
        boundaries=[Viscous("west"), Viscous("east"), Roller("bottom"), Roller("south")],
        sources=[
            Hole(np.array([6.0, 9.0, 6.0]), 20.0, 0.004, RATE),
            Column((12.0, 8.0, 12.0), (13.0, 8.0, 4.0), 3.0, 0.002, RATE),
        ],
        sponge=SpongeLayer(((5.0, 15.0), (4.0, 12.0), (6.0, 16.0)), 6.0),
    ),
}  # fmt: skip


def whole_basis(one):
    """Return every motion that the supports of a family allow."""
    constants = one.prepared(one.ranges.middle()).constants
    free = np.eye(3 * len(constants["node_mass"]), dtype=np.float32)
    held = 3 * constants["fixed_node"] + np.abs(constants["fixed_direction"]).argmax(axis=1)
    real = np.abs(constants["fixed_direction"]).max(axis=1) > 0.0
    return np.delete(free, held[real], axis=1)


def waveforms(records):
    return np.concatenate([one.velocity for one in records.values()], axis=1)


def off(one, small, found, values):
    """Return how far a solution is from a run, over the largest motion."""
    known = simulate(one.model(values), one.duration, prepared=one.stressed(values))
    motion = small.contour.to_time(found.velocity).reshape(one.n_steps, -1, 3)
    wanted = waveforms(known.seismograms)
    got = waveforms(reduced_model.seismograms(one.base, motion, one.dt))
    return np.abs(got - wanted).max() / np.abs(wanted).max()


@pytest.mark.parametrize("name", MODELS)
def test_with_a_whole_basis_seismograms_are_those_of_a_run(name):
    one = family(MODELS[name], Ranges(RANGES), 0.12, 1e5)

    small = project(one, [whole_basis(one)], 1e-9, 0)
    found = solve(small, VALUES)

    assert off(one, small, found, VALUES) < 1e-6
    half = project(one, [whole_basis(one)[:, ::2]], 1e-9, 0)
    assert found.residual < 1e-9 * solve(half, VALUES).residual


FREE_FIELD = jointed(
    boundaries=[Viscous("bottom"), Viscous("east"), StressInput("bottom", shaking()),
                FreeField("east")]
)  # fmt: skip


def test_free_field_sides_push_alike_while_joints_alone_vary():
    values = {"kn": 1.3e9, "ks": 1.7e9}
    one = family(FREE_FIELD, Ranges({key: RANGES[key] for key in values}), 0.24, 1e5)

    small = project(one, [whole_basis(one)], 1e-9, 0)

    assert off(one, small, solve(small, values), values) < 1e-6


def learnt(model=None, seed=0, runs=5, **options):
    known = {"highest": 300.0, "held_out": 2, **options}
    return reduced(model or jointed(cells=6), RANGES, 0.08, runs=runs, seed=seed, **known)


@pytest.fixture(scope="module")
def small():
    return learnt()


def test_the_estimated_error_is_near_that_of_full_runs(small):
    for values in small.family.ranges.validation(4, 9):
        found = small.confirm(values)

        worst = max(found.error.values())
        assert worst < 0.05
        assert 0.4 < found.prediction.error / worst < 4.0
        assert found.failed == 0


def test_a_prediction_has_the_samples_and_directions_of_a_run(small):
    found = small.confirm(VALUES)

    for name, one in found.run.seismograms.items():
        other = found.prediction.seismograms[name]
        assert (other.dt, other.start, other.components) == (one.dt, one.start, one.components)
        assert other.velocity.shape == one.velocity.shape


def test_calibration_tells_residual_estimate_and_truth(small):
    table = str(small.calibration).splitlines()

    assert len(table) == 1 + 2
    assert table[0].split()[:3] == ["residual", "estimated", "true"]
    assert small.calibration.factor * small.calibration.residual[0] >= small.calibration.error[0]


def test_more_runs_err_less(small):
    errors = [max(one.confirm(VALUES).error.values()) for one in (learnt(runs=2), small)]

    assert errors[1] < 0.5 * errors[0]


def test_the_same_seed_learns_the_same_and_another_one_not(small):
    again, other = learnt(), learnt(seed=1)

    assert again.trained == small.trained
    assert again.predict(VALUES).residual == small.predict(VALUES).residual
    assert other.trained != small.trained


def test_each_joint_and_group_varies_alone():
    ranges = {"kn.J": (1e9, 4e9), "ratio.soil": (0.01, 0.05)}

    one = Ranges(ranges).model(jointed(damping=BY_GROUP), {"kn.J": 3e9, "ratio.soil": 0.04})

    assert one.joints[0].properties == {"kn": 3e9, "ks": 1e9}
    assert (one.damping["rock"].ratio, one.damping["soil"].ratio) == (0.02, 0.04)


def test_runs_side_by_side_teach_what_single_ones_do():
    one = family(jointed(), Ranges(RANGES), 0.08, 300.0)
    values = one.ranges.validation(3, 4)

    for together, value in zip(snapshots.samples(one, values), values, strict=True):
        alone = snapshots.samples(one, [value])[0]

        assert np.abs(together.motion - alone.motion).max() < 1e-12 * np.abs(alone.motion).max()
        spread = [modes @ modes.T for modes in (together.modes, alone.modes)]
        assert np.abs(spread[0] - spread[1]).max() < 1e-5 * np.abs(spread[1]).max()


def test_a_run_in_store_is_not_made_again(tmp_path, monkeypatch):
    first = learnt(runs=2, store=tmp_path)
    monkeypatch.setattr(snapshots, "_integrate", None)

    second = learnt(runs=2, store=tmp_path)

    assert len(list(tmp_path.iterdir())) == 2 + 2
    assert second.predict(VALUES).residual == first.predict(VALUES).residual
    with pytest.raises(TypeError):
        learnt(runs=3, store=tmp_path)


def test_it_refuses_where_contacts_of_a_full_run_slip():
    def with_cohesion(cohesion):
        strength = {**STIFFNESS, "cohesion": cohesion, "friction": 0.0, "tension": 1e9}
        return jointed("coulomb", strength)

    strong = learnt(with_cohesion(1e8), runs=3).predict(VALUES)
    barely, slips = (with_cohesion(share * 1e8 * strong.strength_used) for share in (1.05, 0.95))

    assert learnt(barely, runs=3).confirm(VALUES).failed == 0
    with pytest.raises(InputError, match=r"joints.J: \d+ of \d+ monitored contacts slip or open"):
        learnt(slips, runs=3).predict(VALUES)
    one = family(slips, Ranges(RANGES), 0.08, 300.0)
    ended = simulate(one.model(VALUES), one.duration, prepared=one.stressed(VALUES))
    assert reduced_model.count_failed(ended) > 0


def test_it_refuses_what_it_was_not_trained_for(small):
    with pytest.raises(InputError, match=r"reduced.kn: trained from 10{9} to 40{9}, got 50{9}"):
        small.predict({**VALUES, "kn": 5e9})
    with pytest.raises(InputError, match="reduced: needs values of kn, ks, ratio, got kn"):
        small.predict({"kn": 2e9})


MOVED = [VelocityInput("west", shaking()), Viscous("east")]
ANISOTROPIC = medium(SOIL, (1.0, 0.0, 0.0), 5.0, 1e9, 1e9)
REFUSED = {
    r"joints.J.law: .* got 'closure'": jointed("closure", {**STIFFNESS, "closure": 1e-3}),
    r"materials.soil: .* got 'anisotropic'": jointed(
        materials={"rock": ROCK, "soil": ANISOTROPIC}
    ),
    r"boundaries.west: .* cannot prescribe velocity": jointed(boundaries=MOVED),
    r"local_damping: .* got 0.8": jointed(local_damping=0.8),
    r"ranges.ratio: the model has no damping": jointed(damping=None),
    r"reduced: the model has no receivers": jointed(receivers=[]),
    r"reduced: the model has no source": jointed(boundaries=[Viscous("west")]),
    r"reduced: the model has no source that moves": jointed(
        boundaries=[StressInput("west", shaking(0.0))]
    ),
    r"reduced: .* a free-field side follows the damping": FREE_FIELD,
    r"reduced.highest: .* above 300 Hz": jointed(
        boundaries=[
            StressInput("west", Seismogram(0.05 * np.eye(80)[10:11].T * [1.0, 0.0, 0.0], 5e-4))
        ]
    ),
}  # fmt: skip


@pytest.mark.parametrize("message", REFUSED)
def test_it_refuses_what_is_not_linear_or_not_told(message):
    with pytest.raises(InputError, match=message):
        learnt(REFUSED[message], runs=1)


BAD_RANGES = {
    "ranges.kn.K: no such joint; there are J": {"kn.K": (1.0, 2.0)},
    "ranges.mass: must be kn, ks or ratio": {"mass": (1.0, 2.0)},
    "ranges.kn.J: 'kn' varies everywhere": {"kn": (1.0, 2.0), "kn.J": (1.0, 2.0)},
    "ranges.ks: must be two ascending positive": {"ks": (2.0, 1.0)},
    "ranges.ratio.soil: no damping of that group": {"ratio.soil": (0.01, 0.02)},
}


@pytest.mark.parametrize("message", BAD_RANGES)
def test_it_refuses_ranges_that_are_none(message):
    with pytest.raises(InputError, match=message):
        reduced(jointed(), BAD_RANGES[message], 0.08, highest=300.0)
