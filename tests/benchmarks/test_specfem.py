"""Cases that SPECFEM3D records: their plan, their meshes, and their files, without a wave run."""

import tomllib

import numpy as np
import pytest

from benchmarks.specfem import ground, mesh
from benchmarks.specfem.case_files import write_case
from benchmarks.specfem.effects import EFFECTS
from benchmarks.specfem.hearing import in_band, shares
from benchmarks.specfem.kept import kept
from benchmarks.specfem.plan import BLOCKS, DEVELOPMENT_SEED, HARD_NULLS, SEED, plan
from benchmarks.specfem.records import recorded
from benchmarks.specfem.sites import BEFORE, DT, DURATION, FURTHER, draw_site
from benchmarks.specfem.worlds import drawn, shaken
from pyblast.errors import InputError
from pyblast.project.project import load_project, with_further
from verification.proof.cases import answered, as_crash, digest_of

SPEED = 2500.0  # m/s, of the stub's only wave


def stub(ground, mesh, blasts, pulse, exponent, places, until):
    """Return motion of a full space of one speed, in place of a run."""
    del ground, mesh
    at, found = np.arange(-0.02, until, 1e-3), {}
    for name, holes in blasts.items():
        motion = np.zeros((len(places), 3, len(at)))
        each = (holes[key] for key in ("places", "charges", "times", "scales"))
        for place, charge, fired, scale in zip(*each, strict=True):
            far = np.linalg.norm(np.where(np.isinf(places), 0.0, places) - place, axis=1)
            wave = pulse(at - fired - far[:, None] / SPEED) / far[:, None]
            motion += 1e-15 * charge**exponent * scale * wave[:, None]
        found[name] = at, motion
    return found


def of_effect(effect, seed=DEVELOPMENT_SEED):
    return next(draw for draw in plan(seed) if draw.effect == effect)


@pytest.mark.parametrize("seed", [SEED, DEVELOPMENT_SEED])
def test_a_plan_has_every_effect_as_often_as_stated(seed):
    draws = plan(seed)
    for block, effects in BLOCKS.items():
        own = [draw.effect for draw in draws if draw.block == block]
        assert {effect: own.count(effect) for effect in effects} == effects
    assert len(draws) == sum(sum(effects.values()) for effects in BLOCKS.values()) == 36


def test_a_truth_follows_from_its_seed_and_no_two_are_alike():
    once, again = ([digest_of(drawn(draw).truth) for draw in plan()] for _ in range(2))
    assert once == again
    assert len(set(once)) == len(once)


def test_every_effect_that_is_planned_can_be_drawn():
    planned = {effect for block, effects in BLOCKS.items() for effect in effects
               if block != "hard null"}  # fmt: skip
    assert set(EFFECTS) == planned


@pytest.mark.parametrize("hard", [*HARD_NULLS, ""])
def test_a_null_has_the_errors_of_its_kind_alone(hard):
    rng = np.random.default_rng(2)
    site = draw_site("soil", rng)
    world, errors = shaken(site, hard, rng)
    whole = hard == "all_at_once"
    far = np.nanmax(np.abs(world.site.receivers - site.receivers))
    assert (far > 0.5) == (whole or hard == "moved_receivers")
    assert (world.site.ground.field is not None) == (whole or hard == "uneven_ground")
    spread = np.std(np.concatenate([b.scales for b in world.site.blasts.values()]))
    assert (spread > 0.0) == (whole or hard == "holes_vary") == (errors["hole_spread"] > 0.0)
    for name, holes in site.blasts.items():
        assert np.abs(world.site.blasts[name].times - holes.times).max() <= 0.2e-3


@pytest.mark.parametrize("template", ["flat", "soil", "hill", "bench"])
def test_a_mesh_is_filled_by_elements_that_are_not_turned_over(template):
    site = draw_site(template, np.random.default_rng(4))
    made = mesh.mesh_of(site.ground, (230.0, 180.0), 30.0, breaks=site.breaks())
    corners = made.nodes[made.elements]
    along = [corners[:, to] - corners[:, 0] for to in (1, 3, 4)]
    assert (np.einsum("ij,ij->i", np.cross(along[0], along[1]), along[2]) > 0.0).all()
    x, y = 60.0, 90.0
    assert made.height(x, y) == pytest.approx(float(site.ground.surface(x, y)), abs=1.2)
    top = made.nodes[made.sides[5][1]][..., 2].mean(axis=1)
    assert len(top) == (len(made.lines[0]) - 1) * (len(made.lines[1]) - 1)


def test_a_cavity_is_left_out_of_a_mesh_with_its_size():
    rock = ground.Rock(2600.0, 3500.0, 2000.0)
    limits = (100.0, 116.0), (60.0, 100.0), (-17.0, -7.0)
    hollow = ground.Ground(((None, rock),), bodies=(ground.Body(limits, ground.VOID),))
    made = mesh.mesh_of(hollow, (230.0, 180.0), 30.0)
    corners = made.nodes[made.elements]
    volume = np.prod(corners[:, 6] - corners[:, 0], axis=1).sum()
    whole = np.prod([line[-1] - line[0] for line in made.lines])
    assert whole - volume == pytest.approx(16.0 * 40.0 * 10.0)


def test_quality_of_p_waves_is_that_stated():
    rock, q = ground.Rock(2600.0, 3500.0, 2000.0), 12.0
    share = 4.0 / 3.0 * (rock.cs / rock.cp) ** 2
    p = 1.0 / ((1.0 - share) / mesh._bulk(rock, q) + share / q)
    assert p == pytest.approx(mesh.P_OVER_S * q)


@pytest.mark.filterwarnings("ignore:.*constant offset")
@pytest.mark.parametrize("effect", ["holes_vary", "delay_scatter", "air_blast", "machine"])
def test_files_of_a_case_are_read_as_projects_and_hide_what_is_true(tmp_path, effect):
    draw = of_effect(effect)
    case = drawn(draw)
    made = recorded(case, stub)
    write_case(tmp_path, case, made)
    folder = tmp_path / draw.name
    project = with_further(load_project(folder / "B2.toml"))
    assert sorted(project.blasts) == ["B1", "B2", "S1"]
    assert FURTHER not in "".join(file.name for file in folder.rglob("*"))
    for blast in project.blasts:
        one = project.of(blast)
        believed = case.believed.blasts[blast]
        np.testing.assert_allclose(one.blast.times, believed.times, atol=1e-9)
        np.testing.assert_allclose(one.blast.centres, believed.places, atol=1e-3)
        for n, record in enumerate(one.records.values()):
            motion = record.seismogram.velocity.T
            assert motion.shape == (3, round((BEFORE + DURATION) / DT))
            offset = (motion - made.records[blast][n]).mean(axis=-1, keepdims=True)
            size = np.abs(motion).max()  # an offset of noise is taken off by the reader
            np.testing.assert_allclose(motion - offset, made.records[blast][n], atol=1e-5 * size)
    truth = tomllib.loads((tmp_path / "truth" / draw.name / "truth.toml").read_text())
    assert truth["effects"] == (["null"] if effect in HARD_NULLS else [effect])
    assert (truth["effect_energy_mean_affected"] > 0.0) == (effect not in HARD_NULLS)


def test_a_case_that_was_stopped_goes_on_with_its_next_run(tmp_path):
    draw, done = of_effect("delay_scatter"), []

    def stopped(ground, mesh, blasts, *rest):
        if len(done) == 3:
            raise KeyboardInterrupt
        done.append(blasts)
        return stub(ground, mesh, blasts, *rest)

    with pytest.raises(KeyboardInterrupt):
        recorded(drawn(draw), kept(tmp_path, stopped))
    left = []
    made = recorded(drawn(draw), kept(tmp_path, lambda *asked: left.append(1) or stub(*asked)))
    whole = recorded(drawn(draw), stub)
    assert len(left) == 4  # of seven: four blasts, a finer mesh, without the effect, as believed
    for name, motion in whole.records.items():
        np.testing.assert_array_equal(made.records[name], motion)


def test_noise_is_as_large_as_stated():
    case = drawn(of_effect("holes_vary"))
    made = recorded(case, stub)
    noise = in_band(made.records["S1"] - made.clean["S1"])
    level = np.median(np.abs(made.clean["S1"]).max(axis=(1, 2))) / case.snr
    assert np.sqrt(np.mean(noise**2)) == pytest.approx(level, rel=0.35)


def test_a_share_of_energy_is_that_of_the_difference():
    motion = np.zeros((1, 3, 500))
    motion[0, 0] = np.sin(2.0 * np.pi * 12.0 * DT * np.arange(500))
    assert shares(motion, 0.9 * motion) == pytest.approx([0.01])


def test_a_case_that_is_not_made_or_of_another_draw_is_refused_and_no_crash(tmp_path, monkeypatch):
    monkeypatch.setenv("PYBLAST_SPECFEM_CASES", str(tmp_path))
    with pytest.raises(InputError, match="makes it"):
        answered("specfem-04", tmp_path)
    file = tmp_path / "truth" / "case-04" / "truth.toml"
    file.parent.mkdir(parents=True)
    file.write_text('drawn = "0"\n')
    with pytest.raises(InputError, match="is of another draw"):
        answered("specfem-04", tmp_path)


def test_a_crash_on_a_hard_null_counts_as_one_on_a_null():
    null, single = (next(draw for draw in plan() if draw.block == block)
                    for block in ("hard null", "single"))  # fmt: skip
    assert as_crash(null.name.replace("case", "specfem"), ValueError())["block"] == "hard null"
    assert as_crash(single.name.replace("case", "specfem"), ValueError())["truth"] == [
        single.effect
    ]
