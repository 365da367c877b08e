"""Fields of the ground and local damping in a project file, on the small column."""

import numpy as np
import pytest
from small_project import written

from pyblast.errors import InputError
from pyblast.project.project import load_project

DAMAGE = "[ground.damaged_zone]\nreduction = 0.4\nlength_m = 5\n"
INTO_MODEL = ("[-39, 10, 30]", "[15, 10, 30]")


def with_ground(folder, text, *changes):
    return load_project(written(folder, ("[boundaries]", f"{text}[boundaries]"), *changes))


def test_a_gradient_begins_at_the_highest_point(tmp_path):
    model = with_ground(tmp_path, "[ground.gradient]\nreduction = 0.3\nlength_m = 8\n").model

    depth = 30.0 - model.mesh.points[model.mesh.zones].mean(axis=1)[:, 2]

    assert model.speed_factor == pytest.approx(1.0 - 0.3 * np.exp(-depth / 8.0))


def test_ground_around_the_holes_of_the_blast_is_damaged(tmp_path):
    project = with_ground(tmp_path, DAMAGE, INTO_MODEL)

    factor = project.model.speed_factor
    (zone,) = project.model.ground

    assert zone.holes[0] == pytest.approx(np.array([project.blast.collar[0], project.blast.toe[0]]))
    assert 0.6 <= factor.min() < 0.8
    assert factor.max() > 0.95


def test_damaged_ground_may_have_a_material_of_its_own(tmp_path):
    text = f'{DAMAGE}radius_m = 6\nmaterial = "broken"\n'
    broken = "[materials.broken]\ndensity_kg_per_m3 = 2500\nyoung_mpa = 9000\npoisson = 0.3\n"
    model = with_ground(tmp_path, f"{broken}{text}", INTO_MODEL).model

    centres = model.mesh.points[model.mesh.zones].mean(axis=1)
    near = model.ground[0].distance(centres) <= 6.0

    assert near.any()
    assert np.array_equal(model.mesh.zone_group == model.mesh.groups.index("broken"), near)
    assert model.zone_values("density")[near] == pytest.approx(2500.0)


def test_random_ground_is_that_of_its_seed(tmp_path):
    text = "[ground.heterogeneity]\ndeviation = 0.05\nlength_m = 60\nseed = {}\n"

    first, same, other = (
        with_ground(tmp_path, text.format(seed)).model.speed_factor for seed in (3, 3, 4)
    )

    assert np.array_equal(first, same)
    assert not np.array_equal(first, other)
    assert 0.005 < np.log(first).std() < 0.1


def test_local_damping_reaches_the_model(tmp_path):
    project = load_project(
        written(tmp_path, ("duration_s = 0.1", "duration_s = 0.1\nlocal_damping = 0.8"))
    )

    assert project.model.local_damping == 0.8


@pytest.mark.parametrize(
    ("text", "told"),
    [(DAMAGE, "ground.damaged_zone.length_m: the ground begins 41.5 m"),
     (f"{DAMAGE}radius_m = 3\n", "damaged_zone: radius_m and material go together"),
     (f'{DAMAGE}radius_m = 3\nmaterial = "clay"\n', "material: must be one of soil, rock, got"),
     ("[ground.gradient]\nreduction = 1\nlength_m = 3\n", "reduction: must be below 1, got 1"),
     ("[ground.heterogeneity]\ndeviation = 0.1\nlength_m = 2\n", "heterogeneity.length: 2 m has")],
    ids=["far holes", "half a group", "no such rock", "no speed left", "coarse mesh"],
)  # fmt: skip
def test_ground_that_can_not_be_is_refused(tmp_path, text, told):
    with pytest.raises(InputError) as found:
        _ = with_ground(tmp_path, text).model.speed_factor

    assert told in str(found.value)
