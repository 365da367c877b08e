import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh import mesh as meshes
from pyblast.mesh import tetrahedra
from pyblast.mesh.builder import Fault, JointSet, Layer, build_mesh, build_mesh_report
from pyblast.mesh.gmsh import SLIVER, thinness

pytest.importorskip("gmsh", exc_type=ImportError)

BOX = ((0.0, 40.0), (0.0, 30.0), (0.0, 20.0))
ROCK = [Layer("soil", 5.0), Layer("rock")]
UPRIGHT = np.pi / 2.0


def crossing_sets(persistence=1.0):
    return [
        JointSet("Jn", np.radians(70.0), np.radians(90.0), 9.0, regions=("rock",)),
        JointSet("Jt", UPRIGHT, 0.0, 8.0, regions=("rock",), persistence=persistence),
    ]


def everywhere(name, dip_direction):
    return JointSet(name, 1.3, dip_direction, 9.0)


def area(mesh, name):
    vectors = tetrahedra.triangle_vectors(mesh.points, mesh.surfaces[name])
    return np.linalg.norm(vectors, axis=1).sum()


@pytest.fixture(scope="module")
def jointed():
    fault = Fault("F1", np.radians(60.0), np.radians(23.0), (18.0, 14.0, 20.0))
    return build_mesh_report(BOX, ROCK, crossing_sets(), [fault], edge=4.0)


def test_zones_fill_the_box_exactly(jointed):
    mesh, _ = jointed

    assert meshes.zone_volumes(mesh).min() > 0.0
    assert meshes.zone_volumes(mesh).sum() == pytest.approx(24000.0, rel=1e-12)


def test_each_layer_has_its_volume(jointed):
    mesh, _ = jointed
    volume = np.bincount(mesh.zone_group, weights=meshes.zone_volumes(mesh))

    assert mesh.groups == ("soil", "rock")
    assert volume == pytest.approx([6000.0, 18000.0], rel=1e-12)


def test_joint_sets_stay_in_their_layers_and_faults_cut_all(jointed):
    mesh, _ = jointed
    highest = {name: mesh.points[faces][..., 2].max() for name, faces in mesh.surfaces.items()}

    assert highest["Jn"] == highest["Jt"] == pytest.approx(15.0)
    assert highest["F1"] == pytest.approx(20.0)


def test_fault_facets_lie_on_their_plane_where_it_was_not_moved(jointed):
    mesh, _ = jointed
    normal = Fault("F1", np.radians(60.0), np.radians(23.0)).unit_normal
    nodes = np.unique(mesh.surfaces["F1"])

    assert np.abs((mesh.points[nodes] - [18.0, 14.0, 20.0]) @ normal).max() < 1e-9


def test_joints_move_by_no_more_than_the_tolerance(jointed):
    _, report = jointed

    assert report.largest <= 0.15 * 4.0
    assert report.refused == 0


def test_repair_leaves_fewer_slivers_and_says_so(jointed):
    mesh, report = jointed
    thin = thinness(mesh.points, mesh.zones)

    assert report.slivers[1] == np.count_nonzero(thin < SLIVER) < 0.5 * report.slivers[0]
    assert report.thinnest[1] == thin.min() > report.thinnest[0]


def test_contacts_of_a_built_mesh_cover_each_joint():
    fault = Fault("F1", np.radians(60.0), np.radians(23.0), (18.0, 14.0, 20.0))
    sets = [everywhere("Jn", 1.2), everywhere("Jt", 0.0)]
    mesh = build_mesh(BOX, [Layer("rock")], sets, [fault], edge=5.0)
    split = mesh.split(["F1", "Jn", "Jt"])
    covered = np.bincount(split.contacts.joint, weights=split.contacts.area)

    assert covered == pytest.approx([area(mesh, name) for name in split.contacts.names], rel=1e-12)


def test_every_cell_between_upright_joints_becomes_a_block():
    joints = [JointSet("a", UPRIGHT, UPRIGHT, 10.0, (10.0, 0.0, 0.0))]
    joints.append(JointSet("b", UPRIGHT, 0.0, 10.0, (0.0, 10.0, 0.0)))
    mesh = build_mesh(BOX, [Layer("rock")], joints, edge=6.0).split("ab")

    assert mesh.blocks().max() + 1 == 12
    assert np.bincount(mesh.contacts.joint, weights=mesh.contacts.area) == pytest.approx(
        [3 * 600.0, 2 * 800.0], rel=1e-12
    )


def test_area_of_a_dipping_set_follows_from_its_spacing():
    joints = JointSet("a", np.radians(50.0), np.radians(30.0), 4.0)
    mesh = build_mesh(((0, 60), (0, 60), (0, 40)), [Layer("rock")], [joints], edge=10.0)
    spacing = 60.0 * 60.0 * 40.0 / area(mesh, "a")

    assert spacing == pytest.approx(4.0, rel=0.02)


def test_two_builds_are_identical():
    one, other = (build_mesh(BOX, ROCK, crossing_sets(0.5), edge=5.0, seed=3) for _ in range(2))

    assert np.array_equal(one.points, other.points)
    assert np.array_equal(one.zones, other.zones)
    assert np.array_equal(one.surfaces["Jt"], other.surfaces["Jt"])


def test_persistence_is_the_share_of_open_joint_area():
    half, whole = (build_mesh(BOX, ROCK, crossing_sets(p), edge=5.0) for p in (0.5, 1.0))

    assert area(half, "Jt") / area(whole, "Jt") == pytest.approx(0.5, abs=0.1)


def test_a_fault_of_limited_extent_has_its_area_and_a_single_tip():
    fault = Fault("F", np.radians(50.0), np.radians(40.0), (20.0, 15.0, 10.0), extent=(14.0, 9.0))
    mesh = build_mesh(BOX, [Layer("rock")], [], [fault], edge=4.0)
    split = mesh.split("F")

    assert area(mesh, "F") == pytest.approx(14.0 * 9.0, rel=1e-9)
    assert split.blocks().max() == 0


def test_a_round_fault_has_the_area_of_its_disc():
    fault = Fault("F", 0.3, 1.0, (20.0, 15.0, 10.0), radius=6.0)

    mesh = build_mesh(BOX, [Layer("rock")], [], [fault], edge=4.0)

    assert area(mesh, "F") == pytest.approx(np.pi * 36.0, rel=1e-9)


@pytest.mark.parametrize("edge", [3.0, 5.0])
def test_mean_edge_is_as_asked(edge):
    mesh = build_mesh(BOX, [Layer("rock")], edge=edge)

    assert meshes.zone_edge_lengths(mesh).mean() == pytest.approx(edge, rel=0.1)


def test_layers_have_their_own_edges():
    mesh = build_mesh(BOX, [Layer("soil", 5.0, 1.5), Layer("rock", None, 4.0)])
    mean = meshes.zone_edge_lengths(mesh).mean(axis=1)

    assert mean[mesh.zone_group == 0].mean() == pytest.approx(1.5, rel=0.1)
    assert mean[mesh.zone_group == 1].mean() > 2.0


def test_padding_grows_outward_and_faults_go_on_in_it():
    sets = [JointSet("a", UPRIGHT, UPRIGHT, 10.0)]
    fault = Fault("F", UPRIGHT, 0.0, (0.0, 12.0, 0.0))
    mesh = build_mesh(BOX, ROCK, sets, [fault], edge=5.0, padding=(60.0, 25.0))
    span = {name: np.ptp(mesh.points[mesh.surfaces[name]][..., 0]) for name in ("a", "F", "top")}

    assert span["F"] == span["top"] == pytest.approx(160.0)
    assert span["a"] < 40.0
    assert mesh.points[:, 2].min() == pytest.approx(-60.0)


def test_a_surveyed_surface_becomes_the_top():
    x, y = np.meshgrid(np.linspace(0.0, 40.0, 9), np.linspace(0.0, 30.0, 7))
    survey = np.column_stack([x.ravel(), y.ravel(), 18.0 + 0.1 * x.ravel()])

    mesh = build_mesh(BOX, ROCK, crossing_sets(), edge=5.0, surface=survey)
    top = mesh.points[np.unique(mesh.surfaces["top"])]

    assert top[:, 2] == pytest.approx(18.0 + 0.1 * top[:, 0], abs=1e-9)
    assert meshes.zone_volumes(mesh).min() > 0.0


def test_normals_follow_dip_and_dip_direction():
    normal = JointSet("a", np.radians(30.0), np.radians(90.0), 1.0).normal

    assert normal == pytest.approx([0.5, 0.0, np.sqrt(0.75)])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda: build_mesh(((0, 1), (0, 1)), ROCK, edge=1.0), "box: needs"),
        (lambda: build_mesh(BOX, ROCK), "layer 'soil'.edge: must be positive, got None"),
        (lambda: build_mesh(BOX, ROCK, edge=1.0, padding=(5.0, 0.5)), "padding: needs"),
        (lambda: build_mesh(BOX, [Layer("a"), Layer("b")], edge=1.0), "only the last layer"),
        (lambda: build_mesh(BOX, [Layer("a", 30.0), Layer("b")], edge=1.0), "must be thinner"),
        (lambda: build_mesh(BOX, [Layer("a", 3.0)], edge=1.0), "must reach the bottom"),
        (lambda: build_mesh(BOX, ROCK, crossing_sets() * 2, edge=1.0), "name of its own"),
        (
            lambda: build_mesh(BOX, ROCK, [JointSet("a", 0, 0, 1.0, None, ("ore",))], edge=1.0),
            "a.regions: must be among soil, rock, got 'ore'",
        ),
        (lambda: build_mesh(BOX, ROCK, edge=4.0, surface=[[0, 0, 1]]), "surface: needs three"),
        (lambda: JointSet("a", 60.0, 0.0, 1.0), "a.dip: must lie between"),
        (lambda: JointSet("a", 1.0, 0.0, 0.0), "a.spacing: must be positive"),
        (lambda: JointSet("a", 1.0, 0.0, 1.0, persistence=0.0), "a.persistence: must lie"),
        (lambda: Fault("F"), "F.dip: must lie between"),
        (lambda: Fault("F", 1.0), "F.dip_direction: missing"),
        (lambda: Fault("F", normal=(0.0, 0.0, 0.0)), "F.normal: must not be zero"),
        (lambda: Fault("F", 1.0, 1.0, extent=(1.0, 1.0), radius=1.0), "not both"),
        (lambda: Fault("F", 1.0, 1.0, radius=-1.0), "must be positive"),
    ],
)
def test_wrong_input_is_refused_in_one_sentence(change, message):
    with pytest.raises(InputError, match=message):
        change()


def test_edges_are_short_within_a_refinement_and_grow_beyond_it():
    fine = (((10, 20), (10, 20), (10, 20)), 2.0)
    mesh = build_mesh(((0, 60), (0, 30), (0, 20)), [Layer("rock")], edge=8.0, refinements=[fine])
    middle = mesh.points[mesh.zones].mean(axis=1)
    edges = meshes.zone_edge_lengths(mesh).mean(axis=1)
    within = ((middle > 12.0) & (middle < 18.0)).all(axis=1)

    assert edges[within].mean() == pytest.approx(2.0, rel=0.1)
    assert edges[middle[:, 0] > 45.0].mean() == pytest.approx(8.0, rel=0.2)


def test_a_refinement_that_ends_before_it_begins_is_refused():
    with pytest.raises(InputError, match="low < high"):
        build_mesh(((0, 9), (0, 9), (0, 9)), [Layer("rock")], edge=3.0,
                   refinements=[(((5, 4), (0, 9), (0, 9)), 1.0)])  # fmt: skip
