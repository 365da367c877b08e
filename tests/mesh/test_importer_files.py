"""Mesh files: gmsh of every version and med give one mesh; inner surfaces are never sides."""

import re
import shutil
from pathlib import Path

import meshio
import numpy as np
import pytest

from pyblast.errors import InputError, ReadError
from pyblast.ground import surface
from pyblast.mesh import mesh as meshes
from pyblast.mesh.importer import read_mesh
from pyblast.model.boundary import Fixed, Roller, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Material
from pyblast.model.model import Model
from pyblast.project.checks import check
from pyblast.project.project import load_project
from pyblast.readers.provenance import ReadLog

REPORTED = Path(__file__).parents[1] / "reported"
gmsh = pytest.importorskip("gmsh", exc_type=ImportError)
SIDES = {"west": 0, "top": 5}


def with_gmsh(test):
    """Mark a test that meshes two boxes in gmsh."""
    return pytest.mark.usefixtures("two_boxes")(test)


@pytest.fixture
def two_boxes():
    """Two boxes, the lower one 2 m and the upper one 1 m high, as a mesh in gmsh."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    lower = gmsh.model.occ.addBox(0, 0, 0, 4, 3, 2)
    upper = gmsh.model.occ.addBox(0, 0, 2, 4, 3, 1)
    gmsh.model.occ.fragment([(3, lower)], [(3, upper)])
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMin", 2.0)
    gmsh.model.mesh.generate(3)
    yield
    gmsh.finalize()


def grouped(twice=False):
    """Tag the boxes, the top, and the surface between them."""
    at = {round(gmsh.model.occ.getCenterOfMass(2, tag)[2], 6): tag
          for _, tag in gmsh.model.getEntities(2)
          if abs(gmsh.model.getNormal(tag, [0.5, 0.5])[2]) > 0.5}  # fmt: skip
    gmsh.model.addPhysicalGroup(3, [1], 7, "rock")
    gmsh.model.addPhysicalGroup(3, [2], 8, "soil")
    gmsh.model.addPhysicalGroup(2, [at[3.0]], 9, "the top")
    gmsh.model.addPhysicalGroup(2, [at[2.0]], 10, "contact")
    if twice:
        gmsh.model.addPhysicalGroup(2, [at[2.0], at[3.0]], 11, "both")


FORMS = [(version, binary) for version in (1.0, 2.2, 4.0, 4.1) for binary in (0, 1)
         if not binary or version in (2.2, 4.1)]  # fmt: skip


def written(path, version, binary, **options):
    gmsh.option.setNumber("Mesh.MshFileVersion", version)
    gmsh.option.setNumber("Mesh.Binary", binary)
    for name, value in options.items():
        gmsh.option.setNumber(f"Mesh.{name}", value)
    gmsh.write(str(path))
    return path


def expected():
    """Volumes of the two boxes, and facets of the two surfaces, as gmsh has them."""
    counts = {}
    for name, tag in (("the top", 9), ("contact", 10)):
        entities = gmsh.model.getEntitiesForPhysicalGroup(2, tag)
        counts[name] = sum(len(gmsh.model.mesh.getElements(2, e)[1][0]) for e in entities)
    return {"rock": 24.0, "soil": 12.0}, counts


@pytest.mark.parametrize(("version", "binary"), FORMS)
@pytest.mark.parametrize("parametric", [0, 1])
@with_gmsh
def test_24_gmsh_of_every_version_has_the_same_groups(version, binary, parametric, tmp_path):
    grouped(twice=True)
    volumes, counts = expected()

    path = written(tmp_path / "m.msh", version, binary, SaveParametric=parametric)
    if (version, binary, parametric) == (2.2, 1, 1):
        with pytest.raises(ReadError, match="is binary gmsh 2 with parameters; write"):
            read_mesh(path)
        return
    mesh = read_mesh(path)

    names = {"group_7": "rock", "group_8": "soil", "surface_9": "the top",
             "surface_10": "contact", "surface_11": "both"}  # fmt: skip
    size = meshes.zone_volumes(mesh)
    assert {
        names.get(group, group): pytest.approx(size[mesh.zone_group == n].sum())
        for n, group in enumerate(mesh.groups)
    } == volumes
    found = {names.get(name, name): len(facets) for name, facets in mesh.surfaces.items()}
    assert found == {**counts, "both": sum(counts.values())}
    assert any(name.startswith("surface_") for name in mesh.surfaces) == (version == 1.0)


@pytest.mark.parametrize(("version", "binary"), FORMS)
@with_gmsh
def test_51_gmsh_of_every_version_without_groups_is_one_rock(version, binary, tmp_path):
    mesh = read_mesh(written(tmp_path / "m.msh", version, binary))

    assert mesh.groups == ("rock",) or version == 1.0  # which writes numbers of entities
    assert meshes.zone_volumes(mesh).sum() == pytest.approx(36.0)
    assert len(mesh.surfaces) == 0 or version == 1.0


@pytest.mark.parametrize(("version", "binary"), [(4.0, 0), (4.1, 0), (4.1, 1)])
@with_gmsh
def test_24_parts_of_a_partition_keep_their_groups(version, binary, tmp_path):
    grouped()
    volumes, counts = expected()
    gmsh.model.mesh.partition(3)

    mesh = read_mesh(written(tmp_path / "m.msh", version, binary))

    size = meshes.zone_volumes(mesh)
    assert {g: pytest.approx(size[mesh.zone_group == n].sum()) for n, g in enumerate(mesh.groups)
            } == volumes  # fmt: skip
    assert {name: len(facets) for name, facets in mesh.surfaces.items()} == counts


@pytest.mark.parametrize(("version", "binary"), [form for form in FORMS if form[0] > 1.0])
@with_gmsh
def test_24_volumes_in_two_groups_are_refused_by_both_names(version, binary, tmp_path):
    grouped()
    gmsh.model.addPhysicalGroup(3, [1, 2], 12, "everything")

    with pytest.raises(InputError, match=r"zones are in the groups (rock|everything) and (rock|e)"):
        read_mesh(written(tmp_path / "m.msh", version, binary))


@pytest.mark.parametrize("groups", [False, True])
@with_gmsh
def test_med_with_and_without_groups(groups, tmp_path):
    if groups:
        grouped()
    gmsh.write(str(tmp_path / "m.med"))

    mesh = read_mesh(tmp_path / "m.med")

    assert meshes.zone_volumes(mesh).sum() == pytest.approx(36.0)
    assert sorted(mesh.groups) == (["rock", "soil"] if groups else ["rock"])


@with_gmsh
def test_24_cells_of_second_order_are_refused_with_the_remedy(tmp_path):
    gmsh.model.mesh.setOrder(2)

    with pytest.raises(ReadError, match="write the mesh in first order"):
        read_mesh(written(tmp_path / "m.msh", 4.1, 0))


@pytest.mark.parametrize("seed", range(16))
@with_gmsh
def test_a_damaged_gmsh_file_is_read_or_refused_in_one_sentence(seed, tmp_path):
    grouped()
    version, binary = FORMS[seed % len(FORMS)]
    path, random = written(tmp_path / "m.msh", version, binary), np.random.default_rng(seed)
    content = bytearray(path.read_bytes())
    for position in random.integers(len(content), size=3):
        content[position] = random.integers(256)
    path.write_bytes(content[: random.integers(20, len(content))] if seed % 2 else content)

    reason = ""
    try:
        read_mesh(path)
    except (ReadError, InputError) as error:
        reason = str(error)

    assert "\n" not in reason


# the files of the reports


@pytest.mark.parametrize("name", ["shared_22", "shared_41", "saveall_41"])
def test_24_facets_keep_all_of_their_groups(name):
    mesh = read_mesh(REPORTED / "24-gmsh-groups" / f"{name}.msh")

    counts = {name: len(facets) for name, facets in mesh.surfaces.items()}
    assert mesh.groups == ("rock", "soil")
    assert counts.pop("plot_these", 214) == 214
    assert counts == {"west": 78, "east": 78, "south": 76, "north": 76, "bottom": 68, "top": 68,
                      "contact": 68}  # fmt: skip


def test_24_names_without_cells_are_refused():
    with pytest.raises(ReadError, match=r"names west, .* tags no cell .*without Mesh\.SaveAll"):
        read_mesh(REPORTED / "24-gmsh-groups" / "saveall_22.msh")


TURNED = {"block": 1, "block_turned": 0}  # notes: in the second one all are left-handed


@pytest.mark.parametrize("name", TURNED)
def test_48_tetrahedra_of_both_orders_are_turned(name):
    log = ReadLog()

    mesh = read_mesh(REPORTED / "48-tetrahedra-of-both-orders" / f"{name}.vtu", log=log)

    assert len(mesh.zones) == 48
    assert meshes.zone_volumes(mesh).min() > 0.0
    assert meshes.zone_volumes(mesh).sum() == pytest.approx(8000.0)
    turned = [line for line in log.lines() if "of 48 zones were turned right-handed" in line]
    assert len(turned) == TURNED[name]


@pytest.mark.parametrize(
    ("name", "zones", "volume"),
    [("block-2.2", 24, 8000.0), ("block-4.1", 24, 8000.0), ("block_fine-4.1", 197, 8000.0),
     ("hollow-4.1", 117, 1434.778)],
)  # fmt: skip
def test_51_files_without_groups_are_one_rock_without_sides(name, zones, volume):
    mesh = read_mesh(REPORTED / "51-gmsh-4-without-groups" / f"{name}.msh")

    assert (mesh.groups, len(mesh.zones), len(mesh.surfaces)) == (("rock",), zones, 0)
    assert meshes.zone_volumes(mesh).sum() == pytest.approx(volume)


# 23: an interface inside is never a side

ROCK = Material.from_speeds(2600.0, 3800.0, 2200.0)


@pytest.mark.parametrize("boundary", [Viscous, Roller, Fixed])
def test_23_no_condition_is_put_between_two_zones(boundary):
    mesh = read_mesh(REPORTED / "23-tagged-interface" / "interface.msh")

    with pytest.raises(InputError, match=r"contact: 68 of its 68 facets lie between two zones"):
        Model(mesh, {"rock": ROCK, "soil": ROCK}, boundaries=[boundary("contact")])
    split, joint = mesh.split(["contact"]), Joint("contact", "elastic", {"kn": 1e9, "ks": 1e9})
    with pytest.raises(InputError, match=r"boundaries.contact: is a joint"):
        Model(split, {"rock": ROCK, "soil": ROCK}, joints=[joint], boundaries=[boundary("contact")])


def test_23_a_tagged_interface_between_layers_is_welded_and_said():
    project = load_project(REPORTED / "23-tagged-interface" / "interface.toml")

    notes = check(project).notes

    assert "Surface contact of the mesh file lies inside: welded, no joint and no side." in notes
    assert {b.surface for b in project.model.boundaries} == {
        "west", "east", "south", "north", "bottom"
    }  # fmt: skip


def test_23_dashpots_at_an_interface_are_refused_wherever_they_are_named():
    project = load_project(REPORTED / "23-tagged-interface" / "as_advised.toml")

    with pytest.raises(InputError, match="contact: 68 of its 68 facets lie between two zones"):
        _ = project.model


@pytest.mark.parametrize("name", ["shared_41", "shared_22"])
def test_24_a_group_of_sides_that_are_named_anyway_is_no_open_side(name, tmp_path):
    text = (REPORTED / "23-tagged-interface" / "interface.toml").read_text()
    (tmp_path / "p.toml").write_text(text.replace("interface.msh", f"{name}.msh"))
    shutil.copy(REPORTED / "24-gmsh-groups" / f"{name}.msh", tmp_path)

    project = load_project(tmp_path / "p.toml")

    assert len(project.model.boundaries) == 5
    assert set(surface.welded_surfaces(project.config.mesh, project.mesh)) == {
        "contact", "plot_these"
    }  # fmt: skip


def test_23_a_surface_within_one_material_is_a_question(tmp_path):
    text = (REPORTED / "23-tagged-interface" / "interface.toml").read_text()
    merged = text.replace('file = "interface.msh"', 'file = "m.msh"\nfile_groups = {soil = "rock"}')
    merged = merged[: merged.index("[materials.soil]")] + merged[merged.index("[boundaries]") :]
    shutil.copy(REPORTED / "23-tagged-interface" / "interface.msh", tmp_path / "m.msh")
    (tmp_path / "p.toml").write_text(merged)

    with pytest.raises(InputError, match="'contact' lies inside 'rock'; say what it is: a joint"):
        _ = load_project(tmp_path / "p.toml").model

    answer = merged.replace('"rock"}', '"rock"}\nfile_welded = ["contact"]')
    (tmp_path / "p.toml").write_text(answer)
    assert len(load_project(tmp_path / "p.toml").model.boundaries) == 5


def test_no_message_advises_what_changes_the_physics(tmp_path):
    text = (REPORTED / "23-tagged-interface" / "interface.toml").read_text()
    (tmp_path / "p.toml").write_text(text.replace('"west", ', ""))
    shutil.copy(REPORTED / "23-tagged-interface" / "interface.msh", tmp_path)

    with pytest.raises(InputError, match="lacks 'west'"):
        _ = load_project(tmp_path / "p.toml").model


# hexahedra


def hexahedra(path, cells=(3, 2, 2), turned=False, prism=False):
    """Write a box of two groups with a surface between, as meshio does."""
    nx, ny, nz = cells
    number = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nx + 1, ny + 1, nz + 1)
    grid = np.meshgrid(*(np.arange(n + 1.0) for n in cells), indexing="ij")
    points = np.stack(grid, axis=-1).reshape(-1, 3)
    corner = [number[i : i + nx, j : j + ny, k : k + nz].ravel()
              for k in (0, 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]  # fmt: skip
    zones = np.stack(corner, axis=1)
    middle = number[1]
    facets = np.stack([middle[:-1, :-1], middle[1:, :-1], middle[1:, 1:], middle[:-1, 1:]], axis=-1)
    facets = facets.reshape(-1, 4)
    east = points[zones].mean(axis=1)[:, 0] > 1.0
    if turned:  # clockwise seen from above
        zones[::2] = zones[::2][:, [0, 3, 2, 1, 4, 7, 6, 5]]
    tags = [np.full(len(facets), 21), np.where(east, 12, 11)]
    blocks = [("quad", facets), ("hexahedron", zones)]
    if prism:
        blocks, tags = [*blocks, ("wedge", zones[:1, [0, 1, 2, 4, 5, 6]])], [*tags, np.array([11])]
    if path.suffix == ".inp":
        named = {"surface_21": 21, "group_11": 11, "group_12": 12}
        sets = {name: [np.flatnonzero(t == tag) for t in tags] for name, tag in named.items()}
        mesh = meshio.Mesh(points, blocks, cell_sets=sets)
    else:
        name = "cell_tags" if path.suffix == ".med" else "gmsh:physical"
        sign = -1 if path.suffix == ".med" else 1
        mesh = meshio.Mesh(points, blocks, cell_data={name: [sign * tag for tag in tags]})
    mesh.write(path, **{"file_format": "gmsh22"} if path.suffix == ".msh" else {})
    return path


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("name", ["m.msh", "m.vtu", "m.xdmf", "m.med", "m.inp"])
def test_hexahedra_of_every_format_are_read_and_split(tmp_path, name, turned):
    mesh = read_mesh(hexahedra(tmp_path / name, turned=turned), joints=["surface_21"], order=3)

    assert (mesh.hexahedral, mesh.order, mesh.groups) == (True, 3, ("group_11", "group_12"))
    assert meshes.zone_volumes(mesh) == pytest.approx(np.ones(12))
    assert meshes.quality(mesh).min() == pytest.approx(1.0)
    assert np.bincount(mesh.zone_group).tolist() == [4, 8]
    split = mesh.split(["surface_21"])
    assert split.blocks().max() == 1
    assert split.contacts.area.sum() == pytest.approx(4.0)


@pytest.mark.parametrize("name", ["m.msh", "m.vtu"])
def test_zones_of_two_kinds_are_named(tmp_path, name):
    with pytest.raises(ReadError, match=r"holds quadrangles, hexahedra, prisms; .*one kind of z"):
        read_mesh(hexahedra(tmp_path / name, prism=True))


def test_cells_that_the_library_would_leave_out_are_refused(tmp_path):
    path = hexahedra(tmp_path / "m.vtu")
    meshio.vtu.write(path, meshio.read(path), binary=False)
    path.write_text(re.sub(r'(Name="types"[^>]*>\s*)\d+', r"\g<1>42", path.read_text()))

    with pytest.raises(ReadError, match=r"cells of a kind that is not read|broken"):
        read_mesh(path)


@pytest.mark.parametrize(("kind", "width"), [("triangle", 3), ("quad", 4)])
@pytest.mark.parametrize("name", ["m.msh", "m.vtu", "m.med", "m.inp"])
def test_a_plane_mesh_is_called_two_dimensional(tmp_path, name, kind, width):
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    options = {"file_format": "gmsh22"} if name == "m.msh" else {}
    meshio.Mesh(points, [(kind, np.arange(width)[None])]).write(tmp_path / name, **options)

    with pytest.raises(ReadError, match="this one is two-dimensional"):
        read_mesh(tmp_path / name)
