"""Straight benches and fills in mapped grids: they stand where they are asked for, in no air."""

import numpy as np
import pytest

from pyblast.mesh.as_built import as_built
from pyblast.mesh.faces import face_vectors
from pyblast.mesh.grid import SIDES, Fault, Fill, Geometry, JointSet, Layer
from pyblast.mesh.hexahedral.mapped import build_mapped
from pyblast.mesh.hexahedral.planes import NotMapped
from pyblast.mesh.mesh import outer_faces, zone_volumes
from pyblast.model.terrain import Bench, bench_triangles, toe_of

BOX = np.array([[0.0, 200.0], [0.0, 120.0], [-60.0, 0.0]])
ROCK = (Layer("rock"),)
OPEN = ("west", "east", "south", "north", "bottom")


def bench(x, height=0.0, dip=70.0, drop=10.0, bearing=0.0, bend=0.0):
    """Return a bench whose crest passes (x, 60) along a bearing, the lower ground to the east."""
    along = np.array([np.sin(np.radians(bearing)), np.cos(np.radians(bearing)), 0.0])
    middle = np.array([x, 60.0, height])
    crest = np.array(
        [middle - 200.0 * along, middle + np.array([bend, 0.0, 0.0]), middle + 200.0 * along]
    )
    crest = crest if bend else crest[::2]
    return Bench(crest, toe_of(crest, drop, np.radians(dip)))


def ground(benches, layers=ROCK, faults=(), sets=(), open_sides=OPEN):
    return Geometry(
        BOX, tuple(layers), tuple(sets), tuple(faults), bench_triangles(benches, BOX),
        frozenset(SIDES) - set(open_sides), tuple((each.crest, each.toe) for each in benches),
    )  # fmt: skip


def built(geometry, edge=30.0):
    return build_mapped(geometry, [edge] * len(geometry.layers), 4)


GROUNDS = {
    "upright": [bench(80.0, dip=90.0)],
    "dipping": [bench(80.0)],
    "two": [bench(60.0), bench(90.0, height=-10.0, drop=12.0)],
    "oblique": [bench(100.0, bearing=20.0)],
    "under the top": [bench(90.0, height=-5.0)],
}


def test_lines_that_waver_within_a_fiftieth_of_a_wave_are_straight():
    geometry = ground([bench(80.0, bend=1.0)])

    assert [str(row) for row in as_built(built(geometry), geometry, 60.0) if not row.good] == []


@pytest.mark.parametrize("name", GROUNDS)
def test_a_straight_bench_is_built_as_asked(name):
    geometry = ground(GROUNDS[name])
    mesh = built(geometry)

    assert [str(row) for row in as_built(mesh, geometry, 60.0) if not row.good] == []
    assert zone_volumes(mesh).min() > 0.0
    faces = {tuple(sorted(face)) for face in outer_faces(mesh).tolist()}
    sides = {tuple(sorted(f)) for side in SIDES for f in mesh.surfaces[side].tolist()}
    assert sides == faces
    assert np.abs(sum(face_vectors(mesh.points, outer_faces(mesh)))).max() < 1e-6


def test_the_volume_of_a_bench_is_that_of_its_profile():
    mesh = built(ground(GROUNDS["two"], open_sides=()))

    front = 140.0 * 10.0 - 0.5 * 10.0**2 / np.tan(np.radians(70.0))
    lower = 110.0 * 12.0 - 0.5 * 12.0**2 / np.tan(np.radians(70.0))
    whole = 200.0 * 60.0
    assert zone_volumes(mesh).sum() == pytest.approx(120.0 * (whole - front - lower), rel=1e-9)
    top = face_vectors(mesh.points, mesh.surfaces["top"])
    assert top[:, 2].sum() == pytest.approx(200.0 * 120.0)
    assert top[:, 0].sum() == pytest.approx(22.0 * 120.0)


@pytest.mark.parametrize("dip", [90.0, 70.0])
def test_layers_and_joints_end_at_a_bench(dip):
    soil = [Layer("soil", 2.0), Layer("rock")]
    fault = Fault("F", np.radians(90.0), 0.0, (0.0, 60.0, 0.0))
    level = JointSet("S", 0.0, 0.0, 4.0, origin=(0.0, 0.0, -7.0), regions=("rock",))
    geometry = ground([bench(80.0, dip=dip)], soil, [fault], [level] if dip == 90.0 else [])
    mesh = built(geometry)

    assert [str(row) for row in as_built(mesh, geometry, 60.0) if not row.good] == []
    own = mesh.points[mesh.zones[mesh.zone_group == 0]]
    assert own[..., 0].max() == pytest.approx(80.0 + 2.0 / np.tan(np.radians(dip)))
    assert (own[..., 2].min(), own[..., 2].max()) == (-2.0, 0.0)


@pytest.mark.parametrize(
    ("benches", "words"),
    [([bench(80.0, bend=4.0)], "bend, slope or run askew by 4"),
     ([bench(60.0), bench(110.0, -10.0, bearing=1.0)], "bend, slope or run askew"),
     ([bench(60.0, dip=30.0), bench(80.0, -10.0, dip=89.0)], "meet in the box")],
)  # fmt: skip
def test_other_benches_are_refused_with_what_stands_in_the_way(benches, words):
    with pytest.raises(NotMapped, match=words):
        built(ground(benches))


def test_a_layer_above_all_ground_is_refused():
    with pytest.raises(NotMapped, match="a layer ends above the ground"):
        built(ground([bench(90.0, height=-5.0)], [Layer("soil", 2.0), Layer("rock")]))


FILLS = {
    "trench": ((), Fill("fill", np.array([[90.0, 96.0], [0.0, 120.0], [-1.5, 0.0]]))),
    "pit": ((), Fill("fill", np.array([[50.0, 110.0], [30.0, 70.0], [-1.5, 5.0]]))),
    "body": ((), Fill("fill", np.array([[50.0, 110.0], [30.0, 70.0], [-25.0, -10.0]]))),
    "floor": ((bench(80.0),), Fill("fill", np.array([[130.0, 200.0], [0.0, 120.0], [-12.0, 0.0]]))),
}


@pytest.mark.parametrize("name", FILLS)
def test_a_fill_is_built_as_asked(name):
    benches, fill = FILLS[name]
    top = bench_triangles(benches, BOX) if benches else None
    geometry = Geometry(
        BOX, (Layer("soil", 1.0), Layer("rock")), surface=top, standing=frozenset(["top"]),
        benches=tuple((each.crest, each.toe) for each in benches), fills=(fill,),
    )  # fmt: skip
    mesh = build_mapped(geometry, [30.0] * 3, 4)

    rows = as_built(mesh, geometry, 60.0)
    assert [str(row) for row in rows if not row.good] == []
    (volume,) = (row for row in rows if row.quantity == "volume, m3")
    own = mesh.zone_group == mesh.groups.index("fill")
    if name == "body":
        assert volume.asked == pytest.approx(60.0 * 40.0 * 15.0)
    at = mesh.points[mesh.zones[own]]
    inside = ((at >= fill.box[:, 0] - 1e-9) & (at <= fill.box[:, 1] + 1e-9)).all(axis=(1, 2))
    sides = np.isin(fill.box[:2], BOX[:2]).any()  # goes on in the absorbing layer
    assert inside.all() or sides
    thinner = Geometry(
        BOX, geometry.layers, surface=top, standing=geometry.standing, benches=geometry.benches,
        fills=(Fill("fill", fill.box + np.outer([0.0, 0.0, 0.3], [1.0, 0.0])),),
    )  # fmt: skip
    wrong = {row.quantity for row in as_built(mesh, thinner, 60.0) if not row.good}
    assert wrong == {"volume, m3"}
