"""Projects that once ended with wrong levels: thin soil on rock, rock that yields at holes."""

import numpy as np
import pytest
from command_line import call

from pyblast import Project
from pyblast.blasts.published_laws import BY_NAME
from pyblast.project.checks import check
from pyblast.project.level import predicted_peak

GRANITE = {"density_kg_per_m3": 2650, "cp_m_per_s": 4800, "cs_m_per_s": 2700}
SOIL = {"density_kg_per_m3": 1900, "cp_m_per_s": 800, "cs_m_per_s": 350}
HOUSE = [140, 40]


def quarry(soil=False, **hole):
    """Return 18 delayed holes of 60 kg in granite, with four metres of soil or without."""
    layers = [{"material": "soil", "thickness_m": 4}] * soil + [{"material": "granite"}]
    return {
        "title": "Quarry, 18 holes",
        "mesh": {"size_m": [160, 80, 40], "edge_m": 8, "layers": layers},
        "materials": {"granite": GRANITE} | ({"soil": SOIL} if soil else {}),
        "boundaries": {"viscous": ["west", "east", "south", "north", "bottom"], "free": ["top"]},
        "blast": {"rows": 18, "holes_per_row": 1, "delay_ms": 17, "charge_kg": 60,
                  "diameter_mm": 89, "depth_m": 14, "burden_m": 0.5, "spacing_m": 3,
                  "position_m": [25, 40, 36]},
        "holes_inside": {"charged_hole": {
            "material": "granite", "charge_kg": 60, "radius_m": 0.3, "law": "AS 2187.2-1993",
            "distance_m": 120} | hole},
        "receivers": [{"name": "house", "position_m": HOUSE, "azimuth_deg": 270}],
        "run": {"duration_s": 0.6, "limit_curves": ["din_4150_dwelling"]},
    }  # fmt: skip


def test_a_quarry_in_rock_has_the_level_of_its_law():
    project = Project.from_dict(quarry(frequency_hz=15))

    motion = project.simulate().seismograms["house"]

    band = project.accuracy.band
    predicted = predicted_peak(project, project.receivers[0].position)
    assert band.complete
    assert 1e3 * predicted == pytest.approx(
        1e3 * BY_NAME["AS 2187.2-1993"].ppv(118.0, 60.0), rel=0.1
    )
    # Delays of 17 ms are a quarter of a period: holes two apart cancel.
    assert 0.4 < np.abs(motion.velocity).max() / predicted < 2.0


def test_four_metres_of_soil_do_not_set_what_the_rock_sends():
    rock, soil = (Project.from_dict(quarry(has, frequency_hz=15)) for has in (False, True))

    with_soil = soil.accuracy.band

    # The pulse enters as it does without the soil; the soil limits its receiver, and that is said.
    assert soil.inside.low_pass == rock.inside.low_pass
    assert np.array_equal(soil.inside.moment_rate.values, rock.inside.moment_rate.values)
    assert with_soil.limited_by == "soil"
    assert not with_soil.complete
    (finding,) = (f for f in check(soil).findings if f.code == "D40")
    assert finding.failed
    assert "'soil' decides that" in finding.text
    assert "min in place of" in finding.text


def test_a_pulse_of_a_cavity_is_not_lifted_to_the_level_by_its_low_pass():
    """3 ms: cut at 30 Hz and lifted to the law, its moment would be 205 times too large."""
    slow, fast = (Project.from_dict(quarry(**hole)).inside for hole in
                  ({"frequency_hz": 15}, {"peak_time_ms": 3}))  # fmt: skip

    peaks = [np.abs(inside.moment_rate.integral().values).max() for inside in (slow, fast)]

    assert fast.low_pass is not None
    assert peaks[1] < 0.1 * peaks[0]


@pytest.mark.long
def test_the_commands_end_with_three_and_name_no_frequency(tmp_path):
    lines = call("check", _written(tmp_path, quarry(True, peak_time_ms=3)))

    assert lines.exit_code == 3
    assert "D40 FAILS" in lines.output


def _written(folder, tables):
    """Write nested tables as a project file."""
    rows = [f"title = {tables.pop('title')!r}"]
    layers = tables["mesh"].pop("layers")
    receivers = tables.pop("receivers")
    hole = tables.pop("holes_inside")["charged_hole"]
    materials = tables.pop("materials")
    parts = {"mesh": tables.pop("mesh"), **tables, "holes_inside.charged_hole": hole}
    parts |= {f"materials.{name}": part for name, part in materials.items()}
    for name, part in parts.items():
        rows += [f"[{name}]", *(f"{key} = {value!r}" for key, value in part.items())]
    for name, several in (("mesh.layers", layers), ("receivers", receivers)):
        for part in several:
            rows += [f"[[{name}]]", *(f"{key} = {value!r}" for key, value in part.items())]
    path = folder / "project.toml"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_rock_that_yields_at_holes_takes_what_the_level_has():
    """Three delayed holes in jointed schist: elastic and yielding ground take alike."""
    schist = {"density_kg_per_m3": 2700, "young_mpa": 30000, "poisson": 0.25, "cohesion_kpa": 800,
              "friction_angle_deg": 38, "tension_kpa": 200}  # fmt: skip
    joints = {"kn_gpa_per_m": 5, "ks_gpa_per_m": 2, "cohesion_kpa": 200, "friction_angle_deg": 33,
              "tension_kpa": 0}  # fmt: skip
    work = {}
    for yields in (False, True):
        tables = quarry(frequency_hz=12)
        tables["materials"] = {"schist": schist | ({"yielding": {}} if yields else {})}
        tables["mesh"] = {
            "size_m": [100, 80, 50], "edge_m": 12, "kind": "tetrahedra",
            "layers": [{"material": "schist"}],
            "faults": [{"name": "F", "dip_deg": 65, "dip_direction_deg": 270,
                        "through_m": [70, 40, 40]}],
        }  # fmt: skip
        tables["joints"] = {"F": joints}
        tables["insitu"] = {"horizontal_ratio": 0.6}
        tables["blast"] |= {"rows": 3, "delay_ms": 42, "charge_kg": 150, "diameter_mm": 165,
                            "depth_m": 16, "position_m": [30, 40, 46]}  # fmt: skip
        tables["holes_inside"]["charged_hole"] |= {
            "material": "schist", "charge_kg": 150, "distance_m": 70,
        }  # fmt: skip
        tables["receivers"][0]["position_m"] = [95, 40]
        project = Project.from_dict(tables)
        run = project.simulate()
        work[yields] = run.energy["input"][-1]
        assert work[yields] < 0.02 * 450.0 * 3.8e6
        assert "D21" not in {f.code for f in check(project).findings}

    assert work[True] == pytest.approx(work[False], rel=0.1)
