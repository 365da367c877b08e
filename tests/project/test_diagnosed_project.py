"""A project that is diagnosed: its ground, its motion, and what each hypothesis needs."""

import re
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from obspy import UTCDateTime
from small_site import BAND, BEFORE, DT, SAMPLES, recorded, small_site, with_records

from benchmarks.blind.case_files import write_case
from benchmarks.blind.flat_models import flat_box
from benchmarks.blind.sites import Site, SiteJoint
from pyblast.diagnosis.case import case_of
from pyblast.diagnosis.forward import holds, hole_motion, simulation_of
from pyblast.diagnosis.hypotheses import LIBRARY, untestable_labels
from pyblast.diagnosis.library.ground import not_flat
from pyblast.errors import InputError
from pyblast.ground.tables import quality_of
from pyblast.inference.parameter import set_all
from pyblast.project.project import load_project, with_further
from pyblast.project.uncertain_ground import factors_of
from pyblast.recordings.recording import read_stations
from pyblast.runs.parallel import input_hash
from pyblast.workflows.diagnose import (
    check_further,
    diagnose_file,
    predict_file,
    read_case,
)

TOP = 50.0  # m, height of the ground in the project; a site has it at 0
GROUND = """
title = "small"
[mesh]
size_m = [120, 90, 60]
origin_m = [0, 0, -10]
edge_m = 10
padding_m = 30
padding_edge_m = 20
[[mesh.layers]]
material = "rock"
[[mesh.faults]]
name = "J1"
dip_deg = 90
dip_direction_deg = 270
through_m = [60, 45, 20]
extent_m = [50, 30]
[materials.rock]
density_kg_per_m3 = 2600
cp_m_per_s = 2800
cs_m_per_s = 1600
cohesion_kpa = 500
[joints.J1]
law = "elastic"
kn_gpa_per_m = 0.8
ks_gpa_per_m = 0.4
insitu_pressure_kpa = 100
[boundaries]
viscous = ["west", "east", "south", "north", "bottom"]
[holes_inside]
moment_rate_file = "source.csv"
[run]
duration_s = 0.4
compare_band_hz = [4, 25]
"""
FAULT = ("[[mesh.faults]]", "[materials.rock]"), ("[joints.J1]", "[boundaries]")
LAYER = "\n[[mesh.layers]]"
BLAST = """
[blast]
file = "{name}_holes.csv"
shift_m = [0, 0, 50]
charge_exponent = 0.9
"""
RECEIVER = """
[[receivers]]
name = "{name}"
position_m = {place}
[receivers.recorded]
file = "{blast}_{name}.csv"
"""


@cache
def believed():
    """Return the small site with a joint that ends within it, and records."""
    return recorded(reference(extent_m=[50.0, 30.0], through_m=[60.0, 45.0, -30.0])).project


def reference(**fault):
    """Return the small site with holes that are points and another fault, without records."""
    site = small_site()
    mesh = site.config.mesh
    faults = [mesh.faults[0].model_copy(update=fault)]
    return site.changed(
        blasts={name: blast_at(site, name) for name in site.blasts},
        mesh=mesh.model_copy(update={"faults": faults}),
    )


@cache
def whole():
    """Return the small site with its whole joint, holes that are points, and records."""
    return recorded(reference()).project


def blast_at(site, name):
    """Return a blast whose holes are points, as a table of places says."""
    blast = site.blasts[name]
    return replace(blast, collar=blast.centres, toe=blast.centres, diameter=np.nan)


def written(folder, site, *changes):
    """Write the project of a site: a file for each blast; return the path of the first."""
    pulse = site.inside.moment_rate
    times = pulse.start + pulse.dt * np.arange(len(pulse.values))
    write_table(folder / "source.csv", "time_s,moment_rate_per_kg_Nm_per_s", times, pulse.values)
    for name, blast in site.blasts.items():
        order = np.arange(1, len(blast.charge) + 1)
        columns = *blast.centres.T, blast.charge, blast.times
        write_table(folder / f"{name}_holes.csv", "id,x,y,z,charge_kg,delay_s", order, *columns)
        text = GROUND + BLAST.format(name=name)
        for one in site.receivers:
            x, y, z = one.position
            place = [x, y] if z == 0.0 else [x, y, z + TOP]
            text += RECEIVER.format(name=one.name, place=place, blast=name)
            motion = site.of(name).records[one.name].seismogram
            head = "time_s,east_m_per_s,north_m_per_s,vertical_m_per_s"
            write_table(folder / f"{name}_{one.name}.csv", head, motion.times, *motion.velocity.T)
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (folder / f"{name}.toml").write_text(text)
    first = folder / "S1.toml"
    first.write_text(first.read_text() + '\n[diagnosis]\nblasts = ["B1.toml"]\n')
    return first


def write_table(path, head, *columns):
    """Write columns under a head."""
    rows = zip(*columns, strict=True)
    path.write_text("\n".join([head, *(",".join(f"{v:.12g}" for v in row) for row in rows)]))


def test_a_project_file_holds_what_the_small_site_holds(tmp_path):
    site = believed()
    found = case_of(with_further(load_project(written(tmp_path, site)))).project

    ground, wanted = flat_box(found), flat_box(site)
    up = np.array([[0.0], [0.0], [TOP]])
    np.testing.assert_allclose(ground.box, wanted.box + up, atol=1e-9)
    assert ground.layers == (("rock", None),)
    (rock,), (known,) = found.materials.values(), site.materials.values()
    assert (rock.density, rock.cp, rock.cs) == pytest.approx((2600.0, known.cp, known.cs))
    (one,), (other,) = ground.planes, wanted.planes
    assert (one.name, one.axis, one.position) == (other.name, other.axis, other.position)
    assert (*one.extent, *one.depth) == pytest.approx((*other.extent, *other.depth))
    (joint,), (known,) = found.joints, site.joints
    assert joint.surface == known.surface
    assert joint.properties == pytest.approx(known.properties)
    assert joint.insitu_pressure == pytest.approx(known.insitu_pressure)
    for one, other in zip(found.receivers, site.receivers, strict=True):
        assert one.name == other.name
        assert tuple(one.position) == pytest.approx(np.add(other.position, up[:, 0]))
    assert (quality_of(found.materials), found.config.blast.charge_exponent) == (None, 0.9)
    assert tuple(found.config.run.compare_band_hz) == BAND
    assert list(found.blasts) == ["S1", "B1"]
    raised = site.blasts["B1"].centres + up[:, 0]
    np.testing.assert_allclose(found.blasts["B1"].centres, raised)
    np.testing.assert_allclose(found.blasts["B1"].times, site.blasts["B1"].times)


def test_a_project_has_the_records_and_sends_the_motion_of_its_site(tmp_path, monkeypatch):
    monkeypatch.setattr("pyblast.simulation.simulation.is_single", lambda _: False)
    case = case_of(believed())
    same = case_of(with_further(load_project(written(tmp_path, case.project))))

    assert same.n_samples == SAMPLES
    np.testing.assert_allclose(same.motion, case.motion, rtol=1e-9, atol=1e-15)
    one, other = (simulation_of(part).motion(part.project, ["B1"])[0] for part in (case, same))
    np.testing.assert_allclose(other, one, rtol=1e-6, atol=1e-6 * np.abs(one).max())


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("size_m = [120", 'surface_file = "top.csv"\nsize_m = [120', "mesh.surface_file"),
        ('law = "elastic"', 'law = "kelvin"\neta_n_pa_s_per_m = 1\neta_s_pa_s_per_m = 1', "law"),
        ("dip_deg = 90", "dip_deg = 60", "mesh.faults.J1 has dip_deg 60"),
        ("[run]", "[damping]\nratio = 0.01\nfrequency_hz = 5\n[run]", "damping is damping of one"),
        ("[run]", "[ground.gradient]\nreduction = 0.3\nlength_m = 5\n[run]", "ground.gradient"),
        ("cohesion_kpa = 500", "cohesion_kpa = 500\nyielding = {}", "rock.yielding"),
        ('"north", "bottom"]', '"north"]\nfixed = ["bottom"]', "viscous lacks 'bottom'"),
        ('[holes_inside]\nmoment_rate_file = "source.csv"',
         '[air_blast]\npressure_kpa = 1\nduration_ms = 5', "air_blast"),
    ],
)  # fmt: skip
def test_what_is_no_flat_box_is_said_with_its_key(tmp_path, old, new, told):
    project = with_further(load_project(written(tmp_path, believed(), (old, new))))

    assert re.search(told, not_flat(project))


def test_a_project_without_a_band_is_refused(tmp_path):
    path = written(tmp_path, believed(), ("compare_band_hz = [4, 25]", ""))

    with pytest.raises(InputError, match=r"S1\.toml: diagnosis\.band_hz: missing"):
        case_of(with_further(load_project(path)))


@pytest.mark.long
def test_other_projects_are_run_on_their_own_mesh_and_say_what_they_do_not_test(tmp_path):
    dips = ("dip_deg = 90", "dip_deg = 60"), ("extent_m = [50, 30]", "")
    rough = ("edge_m = 10\n", "edge_m = 30\n"), ("padding_edge_m = 20", "padding_edge_m = 30")
    case = case_of(read_case(written(tmp_path, believed(), *dips, *rough)))
    simulation = simulation_of(case)
    told = untestable_labels(case)

    few_holes = {"damage_by_earlier_holes", "screening", "second_deck", "stemming"}
    assert told.keys() == {"anisotropy", "candidate", "side", "source_function"} | few_holes
    assert "paths lie in 2 of 6 directions" in told["anisotropy"]
    assert {one.name for one in factors_of(case.project)} == {
        "rock.cp", "rock.cs", "J1.kn", "J1.ks"
    }  # fmt: skip
    holes = hole_motion(simulation, case, case.project)
    blast = case.project.blasts["S1"]
    np.testing.assert_array_equal(blast.times, 0.0)
    whole = simulation.motion(case.project, ["S1"])[0]
    np.testing.assert_allclose(holes["S1"][0], whole, atol=2e-2 * np.abs(whole).max())
    stiffer = set_all(case.project, factors_of(case.project), [1.0, 1.0, np.e, np.e])
    changed = simulation.motion(stiffer, ["S1"])[0]
    assert 0.01 < np.abs(changed - whole).max() / np.abs(whole).max() < 1.0
    slips = LIBRARY["joint_slip"].apply(case.project, "J1", strength=1e3, residual=0.5)
    assert np.abs(simulation.motion(slips, ["B1"])[0]).max() > 0.0
    assert not holds(
        simulation,
        case.project,
        LIBRARY["wrong_coordinates/blast"].apply(case.project, "B1", east=500.0, north=0.0),
    )


def model_of(simulation, project, shot="B1"):
    """Return the model of a blast of a project, as it is run."""
    return simulation.model(simulation.of(project, shot))


def test_another_geometry_is_the_model_of_a_file_that_has_it(tmp_path):
    folders = [tmp_path / name for name in ("dips", "none")]
    for folder in folders:
        folder.mkdir()
    dips = ("dip_deg = 90", "dip_deg = 60"), ("extent_m = [50, 30]", "")
    fault, joint = (GROUND[GROUND.index(a) : GROUND.index(b)] for a, b in FAULT)
    case = case_of(read_case(written(folders[0], believed(), *dips)))
    box = f"padding_m = 30\npadding_edge_m = 20\nquadratic = true{LAYER}"
    other = (fault, ""), (joint, ""), (f"padding_m = 30\npadding_edge_m = 20{LAYER}", box)
    there = case_of(read_case(written(folders[1], believed(), *other)))
    simulation, project = simulation_of(case), case.project
    mesh = project.config.mesh.model_copy(update={"faults": []})
    changed = project.changed(mesh=mesh, joints=())
    wanted = model_of(simulation_of(there), there.project)

    assert project.mesh.hexahedral
    assert input_hash(model_of(simulation, changed)) == input_hash(wanted)
    assert input_hash(model_of(simulation, project)) != input_hash(wanted)
    smaller = project.changed(mesh=mesh.model_copy(update={"size_m": [20, 20, 9]}))
    assert not holds(simulation, project, smaller)


def test_receivers_without_a_height_stand_on_another_surface(tmp_path):
    dips = ("dip_deg = 90", "dip_deg = 60"), ("extent_m = [50, 30]", "")
    case = case_of(read_case(written(tmp_path, believed(), *dips)))
    corners = np.array([(x, y, TOP) for x in (-50.0, 170.0) for y in (-50.0, 140.0)])
    higher = case.project.changed(surface=corners + np.array([0.0, 0.0, 4.0]))
    plain, finer = simulation_of(case), simulation_of(case, finer=True)
    before, after, fine = (
        model_of(simulation, project, "S1")
        for simulation, project in ((plain, case.project), (plain, higher), (finer, higher))
    )  # fmt: skip
    heights = [[one.position[2] for one in model.receivers] for model in (before, after, fine)]

    np.testing.assert_allclose(np.subtract(heights[1], heights[0]), [4.0, 4.0, 4.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(heights[2], heights[1], atol=1e-6)
    assert len(fine.nodes.points) > len(after.nodes.points)


def test_quality_factors_of_all_layers_are_those_of_the_site(tmp_path):
    quality = "cohesion_kpa = 500\nqp = 40\nqs = 30\nquality_band_hz = [2, 40]"
    path = written(tmp_path, believed(), ("cohesion_kpa = 500", quality))
    project = case_of(read_case(path)).project
    law = project.of("S1").model.materials["rock"].law

    assert quality_of(project.materials) == (law.qp, law.qs) == (40.0, 30.0)


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("cp_m_per_s = 2800", "cp_m_per_s = 2900", "materials"),
        ("charge_exponent = 0.9", "charge_exponent = 0.8", "blast.charge_exponent"),
    ],
)
def test_blasts_of_other_ground_or_another_source_are_refused(tmp_path, old, new, key):
    path = written(tmp_path, believed())
    other = tmp_path / "B1.toml"
    other.write_text(other.read_text().replace(old, new))

    with pytest.raises(InputError, match=rf"B1\.toml: {key}: differs from S1\.toml"):
        with_further(load_project(path))


def test_records_without_time_before_the_blast_are_refused(tmp_path):
    path = written(tmp_path, believed(), ('R2.csv"', 'R2.csv"\nstart_s = 0.01'))

    with pytest.raises(InputError, match=r"S1\.toml: receivers\.R2\.recorded: begins at 0\.01 s"):
        case_of(read_case(path))


def test_a_project_is_read_where_a_diagnosis_begins(tmp_path, monkeypatch):
    path = written(tmp_path, believed())
    calls = []

    def made(project, *_, **__):
        calls.append(project.title)
        raise InputError("stop")

    monkeypatch.setattr("pyblast.workflows.diagnose.diagnose", made)
    with pytest.raises(InputError, match="stop"):
        diagnose_file(path, tmp_path / "out")
    assert calls == ["small"]


def write_site(folder, project):
    """Write a flat project as the blind benchmark does its sites; return the first file."""
    ground = flat_box(project)
    joints = {joint.surface: joint for joint in project.joints}
    site = Site(
        box=ground.box,
        layers=tuple((name, t, project.materials[name]) for name, t in ground.layers),
        joints=tuple(SiteJoint(joints[p.name], p.axis, p.position) for p in ground.planes),
        receivers=project.receivers, moment_rate=project.inside.moment_rate,
        exponent=project.config.blast.charge_exponent, blasts=project.blasts,
        band=BAND, noise_window=(-BEFORE * DT, 0.0),
    )  # fmt: skip
    records = {
        name: np.stack([table[r.name].seismogram.velocity.T for r in site.receivers])
        for name, table in project.survey.recordings.items()
    }
    write_case(folder, "small", site, records, BEFORE * DT)
    return folder / "S1.toml"


@pytest.mark.long
def test_projects_with_the_ground_at_other_heights_foretell_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr("pyblast.simulation.simulation.is_single", lambda _: False)
    mesh = "edge_m = 10\npadding_m = 30\npadding_edge_m = 20"
    same = "edges_per_wavelength = 10\nfrequency_hz = 25\npadding_m = 80\npadding_edge_m = 19.2"
    project = written(tmp_path, whole(), ("extent_m = [50, 30]", ""), (mesh, same))
    site = write_site(tmp_path / "site", whole())
    lines = (tmp_path / "B1_holes.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    raised = [",".join([i, x, y, f"{float(z) + TOP:.12g}", *rest]) for i, x, y, z, *rest in rows]
    (tmp_path / "raised.csv").write_text("\n".join([lines[0], *raised]))
    known = {"model": {"values": [0.1, -0.1, 0.2, 0.0], "effects": []}}
    found = []
    for file, holes in ((site, "B1_holes.csv"), (project, "raised.csv")):
        check_further(file, tmp_path / holes)
        out = tmp_path / f"{holes}.mseed"
        predict_file(file, tmp_path / "out", known, tmp_path / holes, out)
        found.append(read_stations(out))

    for name, one in found[0].items():
        other = found[1][name]
        motion = one.seismogram.velocity
        assert one.header["channels"]["north"] == f"PB.{name}..HHN"
        assert other.header["channels"]["north"] == f".{name}..DPN"
        np.testing.assert_allclose(
            other.seismogram.velocity, motion, rtol=1e-5, atol=1e-5 * np.abs(motion).max()
        )
    assert UTCDateTime(found[1]["R1"].time).timestamp == pytest.approx(-BEFORE * DT, abs=1e-6)


@pytest.mark.parametrize(("threads", "again"), [("1", False), ("2", False), (None, True)])
def test_a_finished_diagnosis_is_read_whatever_the_number_of_threads(
    tmp_path, monkeypatch, threads, again
):
    file, out = written(tmp_path, whole()), tmp_path / "out"
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setattr("pyblast.workflows.diagnose.diagnose", lambda *_, **__: SimpleNamespace(
        summary={"minutes": 3.0, "seed": 1}
    ))  # fmt: skip
    monkeypatch.setattr(
        "pyblast.workflows.diagnose.write_diagnosis_report",
        lambda path, *_: path.write_text("page"),
    )
    diagnose_file(file, out, minutes=3.0)
    monkeypatch.delattr("pyblast.workflows.diagnose.diagnose")
    (tmp_path / "pred.mseed").write_text("what a forecast left beside what is read")
    if threads:
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
    if again:
        holes = tmp_path / "S1_holes.csv"
        holes.write_text(holes.read_text() + "\n")
        with pytest.raises(NameError, match="diagnose"):
            diagnose_file(file, out, minutes=3.0)
    else:
        assert diagnose_file(file, out, minutes=3.0)["minutes"] == 3.0


def test_a_forecast_never_takes_the_place_of_what_a_project_reads(tmp_path):
    path = written(tmp_path, believed())
    holes = tmp_path / "further.csv"
    holes.write_text("id,x,y,z,charge_kg,delay_s\n1,30,30,45,10,0\n")

    check_further(path, holes, [tmp_path / "out.mseed"])
    for name in ("B1_R2.csv", "S1.toml", "source.csv", "further.csv", "x/../B1.toml"):
        with pytest.raises(InputError, match="is read or written by the diagnosis"):
            check_further(path, holes, [tmp_path / name])
    with pytest.raises(InputError, match="is read or written by the diagnosis"):
        check_further(path, holes, [tmp_path / "out.mseed"] * 2)
    with pytest.raises(InputError, match="must be a file in an existing folder"):
        check_further(path, holes, [tmp_path / "no" / "out.mseed"])


def test_a_forecast_may_lie_beside_a_diagnosis_and_never_takes_its_place(tmp_path):
    path, out = written(tmp_path, believed()), tmp_path / "out"
    holes = tmp_path / "further.csv"
    holes.write_text("id,x,y,z,charge_kg,delay_s\n1,30,30,45,10,0\n")

    check_further(path, holes, [out / "pred.mseed"], out)
    assert not out.exists()
    for name in ("diagnosis.json", "report.html"):
        with pytest.raises(InputError, match="is read or written by the diagnosis"):
            check_further(path, holes, [out / name], out)
    with pytest.raises(InputError, match="must be a file in an existing folder, or in --out"):
        check_further(path, holes, [out / "inner" / "pred.mseed"], out)


@pytest.mark.parametrize(
    ("cells", "told"),
    [
        ("30,30,40,nan,0", "hole 1: its charge is missing"),
        ("30,30,40,0,0", "no hole has a charge"),
        ("300,30,40,5,0", "hole 1: lies outside of the box"),
        ("30,30,40,5,9", "hole 1: fires at 9 s, but the prediction ends"),
    ],
)
def test_holes_that_foretell_nothing_are_refused(tmp_path, cells, told):
    path = written(tmp_path, believed())
    holes = tmp_path / "further.csv"
    holes.write_text(f"id,x,y,z,charge_kg,delay_s\n1,{cells}\n")

    with pytest.raises(InputError, match=told):
        check_further(path, holes)


def test_one_record_that_ends_early_does_not_cut_the_others():
    site = whole()
    known = site.survey.recordings
    one = known["B1"]["R1"]
    seismogram = replace(one.seismogram, velocity=one.seismogram.velocity[:70])
    short = replace(one, seismogram=seismogram, clipped=np.zeros((70, 3), dtype=bool))
    records = {**known, "B1": {**known["B1"], "R1": short}}

    with pytest.raises(InputError, match=r"B1: the record of R1 ends 0\.0\d+ s after"):
        case_of(with_records(site, records))


def test_a_further_blast_that_can_not_be_foretold_is_refused_before_any_run(tmp_path):
    path = written(tmp_path, believed())
    holes = tmp_path / "S1_holes.csv"

    with pytest.raises(InputError, match=r"S1_holes.csv: hole 1: lies outside of the box"):
        check_further(path, holes)  # 50 m too low
    for one in tmp_path.glob("*.toml"):
        one.write_text(one.read_text().replace('name = "R1"', 'name = "crest_1"'))
    head, row = holes.read_text().splitlines()[:2]
    cells = row.split(",")
    raised = tmp_path / "raised.csv"
    raised.write_text("\n".join([head, ",".join([*cells[:3], "45", *cells[4:]])]))
    with pytest.raises(InputError, match="receiver 'crest_1': miniSEED holds 5 characters"):
        check_further(path, raised)
