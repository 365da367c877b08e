import meshio
import numpy as np
import pytest

from pyblast.errors import InputError, ReadError
from pyblast.mesh import mesh as meshes
from pyblast.mesh.builder import structured_box
from pyblast.mesh.importer import read_mesh


def raw_mesh(tags=True, **changes):
    """Two groups of cubes with a joint at x = 1 and the top, as meshio sees it."""
    box = structured_box((2, 1, 1), (2.0, 1.0, 1.0), planes={"J": ("x", 1.0)})
    triangles = np.concatenate([box.surfaces["J"], box.surfaces["top"]])
    east = box.points[box.zones].mean(axis=1)[:, 0] > 1.0
    parts = {
        "points": box.points,
        "zones": box.zones,
        "triangles": triangles,
        "zone_tags": np.where(east, 12, 11),
        "triangle_tags": np.repeat([21, 22], [len(box.surfaces["J"]), len(box.surfaces["top"])]),
    } | changes
    cells = [("triangle", parts["triangles"]), ("tetra", parts["zones"])]
    data = {"gmsh:physical": [parts["triangle_tags"], parts["zone_tags"]]} if tags else {}
    return meshio.Mesh(parts["points"], cells, cell_data=data)


def written(folder, raw, name="mesh.vtu"):
    path = folder / name
    raw.write(path)
    return path


GMSH_2 = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
3
2 21 "fault"
3 11 "soil"
3 12 "rock"
$EndPhysicalNames
$Nodes
5
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
5 1 1 1
$EndNodes
$Elements
3
1 2 2 21 1 2 3 4
2 4 2 11 1 1 2 3 4
3 4 2 12 2 2 3 4 5
$EndElements
"""
ABAQUS = """*Heading
*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 0, 1, 0
4, 0, 0, 1
5, 1, 1, 1
*ELEMENT, type=CPS3, ELSET=fault
1, 2, 3, 4
*ELEMENT, type=C3D4, ELSET=soil
2, 1, 2, 3, 4
*ELEMENT, type=C3D4, ELSET=rock
3, 2, 3, 4, 5
"""


@pytest.mark.parametrize(("name", "text"), [("m.msh", GMSH_2), ("m.inp", ABAQUS)])
def test_names_in_the_file_become_groups_and_surfaces(tmp_path, name, text):
    (tmp_path / name).write_text(text)

    mesh = read_mesh(tmp_path / name, joints=["fault"])

    assert sorted(mesh.groups) == ["rock", "soil"]
    assert mesh.split(["fault"]).blocks().max() == 1
    assert meshes.zone_volumes(mesh).min() > 0.0


@pytest.mark.parametrize("name", ["m.vtu", "m.xdmf"])
def test_numbers_in_the_file_become_names(tmp_path, name):
    mesh = read_mesh(written(tmp_path, raw_mesh(), name))

    assert mesh.groups == ("group_11", "group_12")
    assert {name: len(faces) for name, faces in mesh.surfaces.items()} == {
        "surface_21": 2,
        "surface_22": 4,
    }


def test_med_families_become_groups(tmp_path):
    raw = raw_mesh()
    raw.cell_data = {"cell_tags": [-raw.cell_data["gmsh:physical"][k] for k in (0, 1)]}

    mesh = read_mesh(written(tmp_path, raw, "m.med"))

    assert mesh.groups == ("group_11", "group_12")


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("version", [2.2, 4.1])
def test_gmsh_files_of_both_versions_are_read(tmp_path, version, binary):
    gmsh = pytest.importorskip("gmsh", exc_type=ImportError)
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [1], 7, "rock")
    gmsh.model.mesh.generate(3)
    gmsh.option.setNumber("Mesh.MshFileVersion", version)
    gmsh.option.setNumber("Mesh.Binary", int(binary))
    gmsh.write(str(tmp_path / "m.msh"))
    gmsh.finalize()

    mesh = read_mesh(tmp_path / "m.msh")

    assert mesh.groups == ("rock",)
    assert meshes.zone_volumes(mesh).sum() == pytest.approx(1.0)


def test_groups_are_renamed_by_number_and_merged(tmp_path):
    mesh = read_mesh(written(tmp_path, raw_mesh()), groups={"11": "ore", "group_12": "ore"})

    assert mesh.groups == ("ore",)


def test_a_mesh_without_any_tag_is_one_group_of_rock(tmp_path):
    assert read_mesh(written(tmp_path, raw_mesh(tags=False))).groups == ("rock",)


def test_a_mesh_of_opposite_orientation_is_turned(tmp_path):
    zones = raw_mesh().cells[1].data[:, [0, 2, 1, 3]]

    mesh = read_mesh(written(tmp_path, raw_mesh(zones=zones)))

    assert meshes.zone_volumes(mesh).min() > 0.0


def test_a_read_joint_splits_into_two_blocks(tmp_path):
    mesh = read_mesh(written(tmp_path, raw_mesh()), joints=["surface_21"]).split(["surface_21"])

    assert mesh.blocks().max() == 1
    assert mesh.contacts.area.sum() == pytest.approx(1.0)


BASE = raw_mesh()
POINTS, ZONES = BASE.points, BASE.cells[1].data
TRIANGLES = BASE.cells[0].data


def second(points, place):
    """Return points with a second node at the place of an old one, used by the last zone."""
    return np.vstack([points, points[place]])


def with_last_node(node):
    zones = ZONES.copy()
    zones[-1][zones[-1] == zones[-1][0]] = node
    return zones


FAR = np.vstack([POINTS, POINTS[ZONES[0]] + 9.0])
FLAT = POINTS.copy()
FLAT[:, 2] = 0.0
NOT_FINITE = POINTS.copy()
NOT_FINITE[0, 0] = np.nan
FOLDED = POINTS.copy()
FOLDED[FOLDED[:, 0] == 2.0, 0] = 0.3  # the eastern half lies over the western one
TAGS = np.where(np.arange(len(ZONES)) < 2, 0, 11)
FIN = np.vstack([ZONES, [*TRIANGLES[0][::-1], len(POINTS)]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"points": FOLDED}, "pairs of zones lie on the same side of a face that they share"),
        ({"zones": np.vstack([ZONES, ZONES[:1]]), "zone_tags": np.full(13, 1)}, "twice"),
        ({"points": FLAT}, "12 zones are flat"),
        ({"points": NOT_FINITE}, "points must be finite"),
        ({"points": POINTS[:, :2]}, "three coordinates|broken"),
        ({"zones": with_last_node(ZONES[-1][1])}, "1 zones name a node twice"),
        (
            {"points": second(POINTS, ZONES[-1][0]), "zones": with_last_node(len(POINTS))},
            "pairs of nodes lie at the same place",
        ),
        (
            {
                "points": FAR,
                "zones": np.vstack([ZONES, len(POINTS) + np.arange(4)]),
                "zone_tags": np.full(13, 1),
            },
            "falls into 2 parts",
        ),
        (
            {
                "points": np.vstack([POINTS, [0.5, 0.5, 0.5]]),
                "zones": FIN,
                "zone_tags": np.full(13, 1),
            },
            "share a face that two others share already",
        ),
        (
            {"points": 1e5 * POINTS},
            "must be at most 50000 m wide, got 200000, which looks like millimetres",
        ),
        ({"zone_tags": TAGS}, "2 zones have no tag"),
        ({"zone_tags": np.full(12, 0.5)}, "must hold one whole number"),
        ({"zones": np.empty((0, 4), int), "zone_tags": np.empty(0, int)}, "two-dimensional|broken"),
        ({"zones": ZONES + 5}, "name node|broken"),
    ],
)
def test_a_malformed_mesh_is_refused_in_one_sentence(tmp_path, changes, message):
    path = written(tmp_path, raw_mesh(**changes), "m.xdmf")

    with pytest.raises((InputError, ReadError), match=message) as caught:
        read_mesh(path)

    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("m.stl", "solid", "is STL .triangles.; write the mesh as gmsh"),
        ("m.msh", "(0 fluent)", "is Fluent .a mesh of ANSYS Fluent.; write the mesh as gmsh"),
        ("m.msh", "$MeshFormat\n9.9 0 8\n$EndMeshFormat\n", "gmsh format 9.9 is not"),
        ("m.msh", GMSH_2[:200], "broken|holds no tetrahedra"),
        ("m.msh", GMSH_2.replace("2 3 4 5\n", "2 3 4 9\n"), "broken|names node"),
        ("m.vtu", "<VTKFile>", "is VTK XML .no unstructured"),
        (
            "m.vtu",
            '<!DOCTYPE a [<!ENTITY b "c">]><VTKFile type="UnstructuredGrid"/>',
            "document types and entities",
        ),
        ("m.inp", "*NODE\n*INCLUDE, INPUT=secret.inp\n", r"\*INCLUDE, .* is not followed"),
        ("m.inp", ABAQUS.replace("C3D4", "C3D8"), "broken|only tetrahedra"),
        ("m.inp", ABAQUS.replace("0, 1, 0", "0, one, 0"), "broken or no abaqus mesh"),
        ("m.xdmf", "<Xdmf><DataItem>../a.h5:/b</DataItem></Xdmf>", "must lie beside it"),
        ("m.med", "\x89HDF", "does not look like|broken or no med mesh"),
    ],
)
def test_a_broken_file_is_refused_in_one_sentence(tmp_path, name, content, message, capsys):
    (tmp_path / name).write_text(content)

    with pytest.raises(ReadError, match=message) as caught:
        read_mesh(tmp_path / name)

    assert "\n" not in str(caught.value)
    assert capsys.readouterr().out == ""


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ReadError, match="expected a file, found none"):
        read_mesh(tmp_path / "none.msh")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"joints": ["fault"]}, "no surface is tagged 'fault'; there are surface_21, surface_22"),
        ({"joints": ["surface_22"]}, "4 of 4 facets of the joint 'surface_22'"),
        ({"groups": {"soil": "soil"}}, "no volume is tagged 'soil'; there are group_11, group_12"),
    ],
)
def test_names_that_are_not_in_the_file_are_refused(tmp_path, options, message):
    with pytest.raises(InputError, match=message):
        read_mesh(written(tmp_path, raw_mesh()), **options)
