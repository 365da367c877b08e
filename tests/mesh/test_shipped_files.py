"""Geometries that gmsh ships: their meshes are read from every format as gmsh has them, or refused.

ezdxf, tifffile and meshio install no files to read.
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from pyblast.errors import InputError, ReadError
from pyblast.mesh import mesh as meshes
from pyblast.mesh.importer import read_mesh

gmsh = pytest.importorskip("gmsh", exc_type=ImportError)
FOLDER = Path(sys.prefix) / "share" / "doc" / "gmsh"
FORMS = [(1.0, 0), (2.2, 0), (2.2, 1), (4.0, 0), (4.1, 0), (4.1, 1)]
SHORT = ("sphere", "cone", "shell_sewing", "cylinder_with_hole", "homology", "t14", "thrusections",
         "hex", "pripyrtet", "t1", "simple4")  # fmt: skip
LONG = ("baffles", "boolean", "chamfer", "coherence", "extend_field", "fillet", "fillet3",
        "hyperboloid", "periodic", "periodic_embedded", "pipe", "primitives", "revolve", "revolve2",
        "simple5", "thicksolid", "transfinite", "twist", "cube", "filter", "piece", "t16", "t18",
        "t19", "t20", "t4", "t6", "t10", "t11", "t12")  # fmt: skip


def geometries(names):
    """Return the geometry files of names that are installed."""
    return sorted(path for path in FOLDER.rglob("*.geo") if path.stem in names)


def compare(path, folder):
    """Mesh a geometry; read it from every format, compare with gmsh, and return the outcomes."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        gmsh.option.setNumber("Mesh.MeshSizeFactor", 4)
        gmsh.model.mesh.generate(3)
        return Counter(one_form(folder / "m.msh", *form) for form in FORMS)
    finally:
        gmsh.finalize()


def one_form(path, version, binary):
    """Write a format, read it, and hold zones and facets of groups against those of gmsh."""
    gmsh.option.setNumber("Mesh.MshFileVersion", version)
    gmsh.option.setNumber("Mesh.Binary", binary)
    gmsh.write(str(path))
    mesh, reason = outcome(path)
    if mesh is None:
        assert "\n" not in reason
        kinds = ("first order", "with one kind", "two-dimensional", "parts that share", "no tag")
        return next(kind for kind in kinds if kind in reason)
    assert len(mesh.zones) == count(3, None if version == 1.0 else gmsh.model.getPhysicalGroups(3))
    assert meshes.zone_volumes(mesh).min() > 0.0
    if version > 1.0:
        for dimension, tag in gmsh.model.getPhysicalGroups(2):
            name = gmsh.model.getPhysicalName(dimension, tag) or f"surface_{tag}"
            if gmsh.model.getPhysicalGroups(3) and name in mesh.surfaces:
                assert len(mesh.surfaces[name]) == on_zones((dimension, tag), mesh.hexahedral)
    return "read"


def nodes_of(kind, corners, entities):
    """Return the nodes (n, corners) of cells of one kind in entities of gmsh."""
    parts = [gmsh.model.mesh.getElementsByType(kind, tag)[1] for tag in entities]
    return np.concatenate([np.empty(0, np.int64), *parts]).astype(np.int64).reshape(-1, corners)


def on_zones(group, hexahedral):
    """Return how many facets of a group are faces of zones in groups: others have no ground."""
    volumes = [gmsh.model.getEntitiesForPhysicalGroup(*g) for g in gmsh.model.getPhysicalGroups(3)]
    zones = nodes_of(*((5, 8) if hexahedral else (4, 4)), np.unique(np.concatenate(volumes)))
    corners = [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    corners = corners if hexahedral else [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]
    faces = {tuple(sorted(zone[face].tolist())) for zone in zones for face in corners}
    entities = gmsh.model.getEntitiesForPhysicalGroup(*group)
    facets = nodes_of(*((3, 4) if hexahedral else (2, 3)), entities)
    return sum(tuple(sorted(each)) in faces for each in facets.tolist())


def outcome(path):
    """Return the mesh of a file, or None and why it is refused."""
    try:
        return read_mesh(path), ""
    except (ReadError, InputError) as error:
        return None, str(error)


def count(dimension, groups):
    """Return the number of cells of groups in gmsh, of all where there are none."""
    entities = [tag for _, tag in gmsh.model.getEntities(dimension)]
    if groups:
        entities = np.unique(
            np.concatenate([gmsh.model.getEntitiesForPhysicalGroup(*group) for group in groups])
        ).tolist()
    parts = [gmsh.model.mesh.getElements(dimension, tag)[1] for tag in entities]
    return sum(len(tags) for part in parts for tags in part)


@pytest.mark.parametrize("names", [SHORT, pytest.param(LONG, marks=pytest.mark.long)])
@pytest.mark.skipif(not geometries(SHORT), reason="gmsh is installed without its examples")
def test_meshes_of_the_examples_of_gmsh_are_read_as_gmsh_has_them_or_refused(
    names, tmp_path, capsys
):
    total = sum((compare(path, tmp_path) for path in geometries(names)), Counter())

    with capsys.disabled():
        sys.stdout.write(f"\n{len(geometries(names))} geometries of gmsh: {dict(total)}\n")
    assert total["read"] >= 6 * len(FORMS)
