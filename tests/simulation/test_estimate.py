"""Estimate: what a mesh then has, within seconds, a budget, and offers that keep to it."""

import re
import time

import pytest
from small_project import INSIDE, written

from pyblast.errors import InputError
from pyblast.project.checks import check
from pyblast.project.checks_ground import summarise_model
from pyblast.project.project import load_project
from pyblast.simulation.estimate import _Counts

UNSIZED = ("grid_cells = [12, 4, 6]\n", "")
EDGES = ("grid_cells = [12, 4, 6]", "edge_m = 6")
LAYERS = '[[mesh.layers]]\nmaterial = "rock"'
SOIL = (LAYERS, '[[mesh.layers]]\nmaterial = "soil"\nthickness_m = 2\n' + LAYERS)
SLOW = ("[materials.rock]", "[materials.soil]\ndensity_kg_per_m3 = 1900\ncp_m_per_s = 800\n"
        "cs_m_per_s = 300\nqp = 30\nqs = 15\nquality_band_hz = [3, 60]\n"
        "[materials.rock]")  # fmt: skip
DEEP = ("position_m = [14, 10, 30]", "position_m = [14, 10, 20]")
ONE_MESH = ("[mesh]", "[mesh]\nnear_source_work = 1")
TETRAHEDRA = ("[mesh]", '[mesh]\nkind = "tetrahedra"')
LARGE = ("size_m = [60, 20, 30]", "size_m = [6000, 2000, 3000]")
MIDDLE = ("through_m = [30, 0, 0]", "through_m = [3000, 0, 0]")


def project(folder, *changes):
    return load_project(written(folder, *changes, text=INSIDE))


@pytest.mark.parametrize(
    "changes",
    [(UNSIZED,), (UNSIZED, SOIL, SLOW, DEEP), (EDGES, TETRAHEDRA), ()],
    ids=["plain", "thin soil", "tetrahedra", "grid of tetrahedra"],
)
def test_an_estimate_is_near_what_is_built(tmp_path, changes):
    own = project(tmp_path, ONE_MESH, *changes)

    cost, built = own.cost, summarise_model(own)

    assert ("hexahedra" in cost.elements) is built.elements.startswith("hexahedra")
    assert 0.6 < cost.zones / built.zones < 1.7
    assert 0.4 < cost.nodes / built.nodes < 1.7
    assert 0.6 < cost.steps / built.steps < 1.7
    assert 0.3 < 60.0 * cost.minutes / built.seconds < 3.0


def test_a_run_costs_about_the_fourth_power_of_its_frequency(tmp_path):
    once, twice = (
        project(tmp_path, LARGE, MIDDLE, ("grid_cells = [12, 4, 6]", f"frequency_hz = {hz}"))
        for hz in (30, 60)
    )

    assert 2.0**3.4 < twice.cost.seconds / once.cost.seconds < 2.0**4.4


def test_a_run_beyond_its_budget_is_priced_before_its_mesh_with_what_keeps_to_it(tmp_path):
    dear = project(tmp_path, UNSIZED, LARGE)
    began = time.process_time()

    found = check(dear, priced=True)

    assert time.process_time() - began < 2.0
    assert found.summary is None
    (finding,) = found.findings
    assert finding.code == "D49"
    assert finding.failed
    offered = re.search(r"mesh.frequency_hz = (\d+) in place of (\d+)", finding.text)
    assert offered is not None
    for factor, keeps in ((1.0, True), (1.2, False)):
        hz = factor * float(offered[1])
        other = project(tmp_path, ("grid_cells = [12, 4, 6]", f"frequency_hz = {hz}"), LARGE)
        assert (other.dear is None) is keeps


def test_only_a_mesh_that_nobody_sized_is_refused(tmp_path):
    little = ("[mesh]", "[mesh]\nminutes = 1e-6")
    own = project(tmp_path, UNSIZED, little)
    sized = project(tmp_path, EDGES, little)

    with pytest.raises(InputError, match=r"project.toml: mesh.minutes: It has hexahedra of order"):
        own.mesh  # noqa: B018
    assert sized.dear is not None
    assert len(sized.mesh.zones)
    assert "D49" not in {finding.code for finding in check(sized).findings}
    assert check(sized, priced=True).summary is None


@pytest.mark.parametrize("kind", ["hexahedra", "tetrahedra"])
def test_edges_without_end_are_priced_at_once(tmp_path, kind):
    tiny = ("grid_cells = [12, 4, 6]", f'edge_m = 1e-4\nkind = "{kind}"')
    began = time.process_time()

    dear = project(tmp_path, tiny).dear

    assert time.process_time() - began < 2.0
    assert dear is not None
    assert dear.numbers["nodes"] > 1e12


@pytest.mark.parametrize(
    ("nodes", "in_layer", "wanted"), [(37_485, 0.79, 2.5e-7), (125_125, 0.64, 5.6e-7)]
)
def test_memories_that_caches_do_not_hold_cost_what_was_measured(nodes, in_layer, wanted):
    counts = _Counts(4, nodes / 69.0, nodes, 0.0, 1.0, in_layer, 0.0)

    assert counts.seconds / nodes == pytest.approx(wanted, rel=0.2)
