"""Case folders of a flat project with elastic joints and records, for tests."""

from types import SimpleNamespace

import numpy as np
from small_site import BAND, BEFORE, DT

from benchmarks.blind.case_files import write_case
from benchmarks.blind.sites import Site, SiteJoint
from pyblast.project.flat_box import flat_box


def write_folder(folder, project, zeros=None):
    """Write a project of whole joints as the case folder "small"; its blasts are an hour apart."""
    ground = flat_box(project)
    joints = {joint.surface: joint for joint in project.joints}
    every = (project, *project.further)
    site = Site(
        box=ground.box,
        layers=tuple((name, t, project.materials[name]) for name, t in ground.layers),
        joints=tuple(SiteJoint(joints[p.name], p.axis, p.position) for p in ground.planes),
        receivers=project.receivers,
        moment_rate=project.inside.moment_rate,
        exponent=project.config.blast.charge_exponent,
        blasts=project.blasts,
        band=BAND,
        noise_window=(-BEFORE * DT, 0.0),
    )
    records = {
        one.name: np.stack([one.records[r.name].seismogram.velocity.T for r in site.receivers])
        for one in every
    }
    write_case(folder, "small", site, records, zeros, BEFORE * DT)
    return SimpleNamespace(folder=folder, site=site)
