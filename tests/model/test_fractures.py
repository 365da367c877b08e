"""Fractures: Fisher's moments, size laws, P32 against its expectation, files, terminations."""

import numpy as np
import pytest

from pyblast.errors import InputError, ReadError
from pyblast.mesh import tetrahedra
from pyblast.mesh.builder import Fault, Layer, build_mesh
from pyblast.mesh.grid import upward_normal
from pyblast.model import fractures
from pyblast.model.fractures import (
    FractureSet,
    SizeLaw,
    area_within,
    fisher_normals,
    polygon,
    polygon_area,
    read_fractures,
    terminated,
)

BOX = np.array([(0.0, 50.0), (0.0, 40.0), (0.0, 30.0)])
SQUARE = np.array([[10.0, 10.0, 10.0], [30.0, 10.0, 10.0], [30.0, 30.0, 10.0], [10.0, 30.0, 10.0]])


@pytest.mark.parametrize("kappa", [0.5, 5.0, 60.0])
def test_normals_have_the_first_two_moments_of_fisher(kappa):
    mean, count = upward_normal(np.radians(40.0), np.radians(120.0)), 40000
    normals = fisher_normals(mean, kappa, count, np.random.default_rng(4))

    cosine = normals @ mean
    first = 1.0 / np.tanh(kappa) - 1.0 / kappa
    second = 1.0 - 2.0 * first / kappa  # the mean of the squared cosine
    spread = np.sqrt((second - first**2) / count)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
    assert cosine.mean() == pytest.approx(first, abs=4.0 * spread)
    assert np.mean(cosine**2) == pytest.approx(second, abs=4.0 * np.std(cosine**2) / count**0.5)
    across = normals - cosine[:, None] * mean
    assert np.linalg.norm(across.mean(axis=0)) < 5.0 * np.std(across) / count**0.5


@pytest.mark.parametrize(
    ("law", "mean", "square"),
    [
        (SizeLaw("constant", 3.0), 3.0, 9.0),
        (SizeLaw("exponential", 3.0), 3.0, 18.0),
        (SizeLaw("lognormal", 3.0, 1.5), 3.0, 9.0 + 2.25),
        (SizeLaw("power", exponent=3.0, range=(1.0, 10.0)),
         1.5 * (1 - 1e-2) / (1 - 1e-3), 3.0 * (1 - 1e-1) / (1 - 1e-3)),
    ],
)  # fmt: skip
def test_radii_have_the_moments_of_their_law(law, mean, square):
    radii = law.radii((np.arange(200000) + 0.5) / 200000)

    assert radii.mean() == pytest.approx(mean, rel=1e-3)
    assert np.mean(radii**2) == pytest.approx(square, rel=3e-3)
    assert law.mean_area() == pytest.approx(np.pi * square, rel=1e-2)


@pytest.mark.parametrize("name", ["exponential", "lognormal"])
def test_a_truncated_law_keeps_to_its_range(name):
    radii = SizeLaw(name, 3.0, 2.0, range=(1.0, 6.0)).radii(np.linspace(0.0, 1.0, 101))

    assert (radii[0], radii[-1]) == pytest.approx((1.0, 6.0))
    assert (np.diff(radii) > 0.0).all()


@pytest.mark.long
def test_p32_is_that_of_its_expectation(monkeypatch):
    monkeypatch.setattr(fractures, "MOST_FRACTURES", 10**6)
    sizes = SizeLaw("exponential", 4.0, range=(1.0, 12.0))
    areas = [
        sum(area_within(disc, BOX) for disc in
            FractureSet("a", 1.0, 2.0, 10.0, 0.2, sizes, seed).draw(BOX))
        for seed in range(40)
    ]  # fmt: skip
    p32 = np.array(areas) / np.prod(np.ptp(BOX, axis=1))

    assert p32.mean() == pytest.approx(0.2, abs=3.5 * p32.std() / np.sqrt(40))
    assert p32.std() / np.sqrt(40) < 0.05 * 0.2


def test_the_same_seed_draws_the_same_fractures():
    def draw(seed):
        discs = FractureSet("a", 1.0, 2.0, 10.0, 0.05, SizeLaw("constant", 5.0), seed).draw(BOX)
        return np.array([disc.point for disc in discs])

    assert np.array_equal(draw(3), draw(3))
    assert not np.array_equal(draw(3)[:1], draw(4)[:1])


def test_a_polygon_is_cut_out_of_the_rock_with_its_area():
    mesh = build_mesh(BOX, [Layer("rock")], [], [polygon("P", SQUARE)], edge=9.0)

    areas = tetrahedra.triangle_vectors(mesh.points, mesh.surfaces["P"])
    assert np.abs(areas).sum(axis=0) == pytest.approx([0.0, 0.0, 400.0], abs=1e-6)
    corners = mesh.points[mesh.surfaces["P"]].reshape(-1, 3)
    assert corners.min(axis=0) == pytest.approx([10.0, 10.0, 10.0])
    assert corners.max(axis=0) == pytest.approx([30.0, 30.0, 10.0])


def test_fractures_of_one_name_share_a_joint_surface():
    upright = SQUARE[:, [2, 0, 1]] + [30.0, 0.0, -5.0]
    mesh = build_mesh(
        BOX, [Layer("rock")], [], [polygon("P", SQUARE - [5, 0, 0]), polygon("P", upright)],
        edge=9.0,
    )  # fmt: skip

    areas = tetrahedra.triangle_vectors(mesh.points, mesh.surfaces["P"])
    assert np.abs(areas).sum(axis=0) == pytest.approx([400.0, 0.0, 400.0], rel=1e-6)
    assert mesh.split(["P"]).contacts is not None


def test_a_fracture_ends_at_a_fault_on_the_side_of_its_middle():
    fault = Fault("F", np.radians(90.0), np.radians(90.0), (24.0, 0.0, 0.0))

    (part,) = terminated([polygon("P", SQUARE)], [fault])

    assert polygon_area(part.polygon) == pytest.approx(14.0 * 20.0)
    assert part.polygon[:, 0].max() == pytest.approx(24.0)


FAB = """BEGIN FORMAT
Format = Ascii
END FORMAT
BEGIN FRACTURE
1 4 1 0.0
1 10 10 10
2 30 10 10
3 30 30 10
4 10 30 10
0 0 0 1
2 3 1 0.0
1 0 0 0
2 4 0 0
3 0 3 0
0 0 0 1
END FRACTURE
"""


def test_fractures_are_read_from_tables_and_texts(tmp_path):
    (tmp_path / "a.csv").write_text(
        "x_m,y_m,z_m,dip_deg,dip_direction_deg,radius_m\n10,20,5,90,90,4\n20,20,5,0,0,2\n"
    )
    rows = "".join(f"p,{x},{y},{z}\n" for x, y, z in SQUARE)
    (tmp_path / "b.csv").write_text("fracture,x_m,y_m,z_m\n" + rows + "q,0,0,0\nq,4,0,0\nq,0,3,0\n")
    (tmp_path / "c.fab").write_text(FAB)

    discs = read_fractures(tmp_path / "a.csv", "D")
    assert [polygon_area(disc.polygon) for disc in discs] == pytest.approx(
        [16.0 * np.pi, 4.0 * np.pi]
    )
    assert discs[0].unit_normal == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)
    for name in ("b.csv", "c.fab"):
        areas = [polygon_area(each.polygon) for each in read_fractures(tmp_path / name, "P")]
        assert areas == pytest.approx([400.0, 6.0])


BENT = np.add(SQUARE, [[0, 0, 0], [0, 0, 0], [0, 0, 8], [0, 0, 0]])
DENTED = np.vstack([SQUARE, [[25.0, 15.0, 10.0]]])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: polygon("P", BENT), "is not plane"),
        (lambda: polygon("P", DENTED), "is not convex"),
        (lambda: polygon("P", SQUARE[:2]), "three finite corners"),
        (lambda: polygon("P", SQUARE[[0, 1, 1]]), "lie on one line"),
        (lambda: FractureSet("a", 1, 1, 5, 5.0, SizeLaw("constant", 1.0)).draw(BOX), "at most 500"),
        (lambda: SizeLaw("power", range=(0.0, 1.0)), "positive exponent"),
        (lambda: SizeLaw("lognormal", 2.0), "needs a deviation"),
        (lambda: SizeLaw("gamma", 2.0), "must be one of constant"),
        (lambda: SizeLaw("constant", 2.0, range=(3.0, 1.0)), "range that rises"),
    ],
)
def test_what_can_not_be_cut_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "x,y\n", "missing columns: z .m."),
        ("a.csv", "fracture,x_m,y_m,z_m\np,1,2\n", "line 2, column 4"),
        ("a.csv", "x_m,y_m,z_m,dip_deg,dip_direction_deg,radius_m\n1,2,3,95,0,2\n", "line 2: dip"),
        ("a.csv", "x_m;y_m;z_m\n1;2;3,5\n", "needs beside x_m,y_m,z_m the columns dip_deg"),
        ("c.fab", "BEGIN\n", "holds no block"),
        ("c.fab", FAB.replace("4 10 30 10\n", ""), "fracture . can't be read"),
        ("d.dxf", "0\nEOF\n", "holds no faces"),
    ],
)
def test_a_broken_file_of_fractures_is_refused(name, text, message, tmp_path):
    (tmp_path / name).write_text(text)

    with pytest.raises(ReadError, match=message):
        read_fractures(tmp_path / name, "P")


def test_discs_are_read_under_usual_titles_with_decimal_commas(tmp_path):
    plain = "x_m,y_m,z_m,dip_deg,dip_direction_deg,radius_m\n1.5,2,3,60,90,2.5\n"
    titles = "East;North;RL;Dip;Dip direction;Radius (m)\n1,5;2;3;60;90;2,5\n"
    (tmp_path / "a.csv").write_text(plain)
    (tmp_path / "b.csv").write_text(titles)

    first, second = (read_fractures(tmp_path / name, "P")[0] for name in ("a.csv", "b.csv"))

    np.testing.assert_allclose(first.polygon, second.polygon)
    np.testing.assert_allclose(first.normal, [np.sin(np.pi / 3), 0.0, 0.5], atol=1e-12)
