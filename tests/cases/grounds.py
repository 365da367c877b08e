"""The small site on every kind of ground, with noise for records: no run is made."""

import copy
import tomllib
from dataclasses import replace
from functools import cache

import numpy as np
from small_project import CARRIED, TEXT
from small_site import BAND, BEFORE, DT, SAMPLES, TABLES, of_shots, small_site, with_records

from pyblast.config.config import check_config
from pyblast.diagnosis.case import case_of
from pyblast.project.project import make_project
from pyblast.recordings.recording import Recording
from pyblast.signals.seismogram import Seismogram

OBLIQUE = {"name": "J1", "dip_deg": 90.0, "dip_direction_deg": 40.0, "through_m": [60.0, 45.0, 0.0]}
CROSSING = {"name": "J2", "dip_deg": 75.0, "dip_direction_deg": 160.0, "joint": "J1",
            "through_m": [60.0, 45.0, 0.0]}  # fmt: skip
SET = {"name": "J1", "dip_deg": 70.0, "dip_direction_deg": 90.0, "spacing_m": 50.0}
STRONG = {"cohesion_kpa": 9e3, "friction_angle_deg": 50.0, "tension_kpa": 5e3, "yielding": {}}
SURVEY = np.array(
    [[x, y, -0.02 * (x + 300.0)] for x in (-300.0, 60.0, 400.0) for y in (-300.0, 45.0, 400.0)]
)
MESHES = {
    "flat": {"faults": []},
    "upright": {},
    "oblique": {"faults": [OBLIQUE]},
    "dipping": {"faults": [OBLIQUE | {"dip_deg": 60.0}]},
    "disc": {"faults": [OBLIQUE | {"dip_deg": 60.0, "radius_m": 30.0}]},
    "crossing": {"faults": [OBLIQUE | {"dip_deg": 60.0}, CROSSING]},
    "joint set": {"faults": [], "joint_sets": [SET]},
    "survey": {},
    "bench": {"faults": [], "benches": [{"crest_m": [[75.0, 0.0, 0.0], [75.0, 90.0, 0.0]],
                                        "height_m": 8.0, "face_dip_deg": 70.0}]},
    "yielding": {},
}  # fmt: skip
GROUNDS = (*MESHES, "face")


@cache
def case_on(ground):
    """Return the case of the small site on a kind of ground."""
    project = through_a_face() if ground == "face" else site_on(ground)
    rng, shape = np.random.default_rng(3), (BEFORE + SAMPLES, 3)

    def record():
        motion = Seismogram(rng.normal(size=shape), DT, -BEFORE * DT)
        return Recording(motion, "", "", None, np.zeros(shape, dtype=bool))

    return case_of(
        with_records(
            project, {b: {r.name: record() for r in project.stations} for b in project.blasts}
        )
    )


def site_on(ground):
    """Return the small site on a kind of ground, with holes inside."""
    tables, site = copy.deepcopy(TABLES), small_site()
    tables["mesh"] |= MESHES[ground]
    if ground == "yielding":
        tables["materials"]["rock"] |= STRONG
        tables["mesh"]["edge_m"] = 12.0  # carries some of the band
    if not tables["mesh"]["faults"] and "joint_sets" not in tables["mesh"]:
        tables["joints"] = {}
    config = check_config(tables)
    project = make_project(config, "small.toml")
    project = of_shots(project, site.blasts, site.inside.moment_rate, site.stations)
    if ground == "survey":
        return project.changed(surface=survey(), receivers=on_slope(site.stations))
    project = project.changed(
        receivers=below_bench(site.stations) if ground == "bench" else site.receivers
    )
    return project.changed(mesh=project.for_band(BAND[1]))


def survey():
    """Return places (9, 3) of a surface that falls to the east, in m."""
    plan = [(x, y) for x in (-300.0, 60.0, 400.0) for y in (-300.0, 45.0, 400.0)]
    return np.array([(x, y, slope(x)) for x, y in plan])


def slope(east):
    """Return the height of that surface in m."""
    return -0.02 * (east + 300.0)


def on_slope(receivers):
    """Return receivers of the top on the surveyed surface."""
    return [
        replace(r, position=(*r.position[:2], -0.02 * (r.position[0] + 300.0)))
        if r.position[2] == 0.0
        else r
        for r in receivers
    ]


def below_bench(receivers):
    """Return receivers behind the face on the lower ground."""
    return [
        replace(r, position=(*r.position[:2], -8.0))
        if r.position[0] > 78.0 and r.position[2] == 0.0 else r
        for r in receivers
    ]  # fmt: skip


def through_a_face():
    """Return the column on rock whose motion enters through a face; it carries the band."""
    text = TEXT
    for soft, stiff in CARRIED[:2]:
        text = text.replace(soft, stiff)
    tables = tomllib.loads(text)
    tables["diagnosis"] = {"noise_window_s": [-BEFORE * DT, 0.0]}
    tables["run"]["compare_band_hz"] = list(BAND)
    return make_project(check_config(tables), "small.toml")
