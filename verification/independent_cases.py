"""Cases of the independent program as projects, and what their truth files say of them.

Nothing in pyblast reads a truth file. The study uses them to switch on the physics that a case
conceals with the parameters it was made with, and to take the nuisances away.
"""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

from examples.case_folder import write_projects
from pyblast.diagnosis import library  # noqa: F401  fills the library
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Material
from pyblast.model.model import Receiver
from pyblast.model.source import AirBlast, TimeFunction
from pyblast.project.project import Project, load_project, with_further
from pyblast.recordings.recording import read_stations

OPEN = "open ground"
AIR_STEP = 0.05  # of the air pulse, in its s
STIFFEST = 400.0  # largest tangent of a closing joint over its initial stiffness


WRITTEN = Path(__file__).resolve().parents[1] / "build" / "cases"


def case_project(cases, name) -> Project:
    """Return a case folder as the project of its first blast, with the further ones."""
    project = with_further(load_project(write_projects(cases / name, WRITTEN / name)))
    places = ((one.name, tuple(one.position_m)) for one in project.config.receivers)
    return project.changed(receivers=tuple(Receiver(*place) for place in places))


def truth_of(cases, site):
    """Return the truth file of a site as a table."""
    return tomllib.loads((cases / "truth" / site.title / "truth.toml").read_text())


def true_site(cases, site):
    """Return a site with its true nuisances, and its records without noise."""
    folder, nuisance = cases / "truth" / site.title, truth_of(cases, site)["nuisance"]
    materials = {
        name: replace(Material.from_speeds(m.density * rho, m.cp * vp, m.cs * vs), law=m.law)
        for (name, m), (rho, vp, vs) in zip(
            site.materials.items(), nuisance["material_factors_rho_vp_vs"], strict=True
        )
    }
    joints = tuple(
        replace(j, properties={"kn": j.properties["kn"] * kn, "ks": j.properties["ks"] * ks})
        for j, (kn, ks) in zip(site.joints, nuisance["joint_factors_kn_ks"], strict=True)
    )  # fmt: skip
    receivers = tuple(
        replace(r, position=(r.position[0] + x, r.position[1] + y, min(0.0, r.position[2] + z)))
        for r, (x, y, z) in zip(site.receivers, nuisance["receiver_offsets_m"], strict=True)
    )
    blasts, records = {}, {}
    for name, blast in site.blasts.items():
        times = blast.times + np.array(nuisance["hole_time_s"][name])
        blasts[name] = replace(blast, times=np.maximum(times, 0.0))
        known = site.of(name).records
        records[name] = {
            station: replace(one, seismogram=replace(
                one.seismogram, start=known[station].seismogram.start
            ))
            for station, one in read_stations(folder / f"clean_{name}.mseed").items()
        }  # fmt: skip
    return site.changed(
        materials=materials, joints=joints, receivers=receivers, blasts=blasts, records=records
    )


def with_effect(site, truth):
    """Return a site with the physics that its truth file names, at the parameters given there."""
    for effect in effects_of(truth):
        site = EFFECTS[effect](site, truth["parameters"][effect], truth)
    return site


def effects_of(truth):
    """Return the names of the effects of a case; none for a null."""
    return [effect for effect in truth["effects"] if effect != "null"]


def _attenuation(site, parameters, truth):
    """Give all ground constant Q."""
    del truth
    law = ConstantQ.around(parameters["Qp"], parameters["Qs"], site.config.band_hz)
    return site.changed(
        materials={name: replace(one, law=law) for name, one in site.materials.items()}
    )


def _soft_layer(site, parameters, truth):
    """Put a slower layer of the same density on top."""
    del truth
    return LIBRARY["soft_surface_layer"].apply(
        site, "", thickness=parameters["thickness"], slower=parameters["factor"]
    )


def _closure(site, parameters, truth):
    """Let the affected joint close as a hyperbola whose tangent at rest is its stiffness.

    At rest it is closed by the share r of its largest closure: kni = kn (1 - r)^2 and
    kni Vm = p0 (1 - r)/r.
    """
    r, pressure = parameters["r"], parameters["sn0"]

    def closing(joint):
        kn = joint.properties["kn"] * (1.0 - r) ** 2
        properties = {
            "kn": kn,
            "ks": joint.properties["ks"],
            "closure": pressure * (1.0 - r) / r / kn,
            "kn_max": STIFFEST * kn,
        }
        return Joint(joint.surface, "closure", properties, pressure)

    return _on_affected(site, truth, closing)


def _slip(site, parameters, truth):
    """Let the affected joint slip; it never opens, as in the program that made the records."""
    friction = np.tan(np.radians(parameters["friction_deg"]))
    strength = {
        "cohesion": parameters["cohesion"],
        "friction": friction,
        "tension": 1e12,
        "cohesion_residual": 0.0,
        "friction_residual": parameters["residual"] * friction,
        "tension_residual": 1e12,
    }

    def slipping(joint):
        return Joint(joint.surface, "coulomb", {**joint.properties, **strength}, parameters["sn0"])

    return _on_affected(site, truth, slipping)


def _air_blast(site, parameters, truth):
    """Leave the site: the air blast is a source, see `air_blasts`."""
    del parameters, truth
    return site


def air_blasts(site, blast, truth):
    """Return the air blasts of the holes of a blast; none where the case has none.

    The truth file gives P1_Pa, an exponent and s, not the pulse. It was read off the noise-free
    record of the single hole, where the ground is at rest before the air arrives: 340 m/s from the
    point above the hole, the slope of a Gaussian -x exp(-x^2/2), x = (t - 3s)/s, pressure first,
    and about P1/r from the nearest receiver on. Within that distance nothing is known; P1/r there
    would send a surface wave that the records do not have, so the pressure does not grow. Off B1
    follows that the exponent is that of the charge over the one of S1. No level was fitted.
    """
    if "air_blast" not in effects_of(truth):
        return ()
    parameters, holes = truth["parameters"]["air_blast"], site.blasts[blast]
    single, spread = site.blasts["S1"].charge[0], parameters["s"]
    x = np.arange(0.0, 10.0, AIR_STEP) - 3.0
    above = (*site.blasts["S1"].centres[0, :2], 0.0)
    nearest = min(np.linalg.norm(np.subtract(r.position, above)) for r in site.receivers)
    pulse = -parameters["P1_Pa"] / nearest * x * np.exp(-0.5 * x**2)
    strengths = (holes.charge / single) ** parameters["exponent"]
    return tuple(
        AirBlast(
            OPEN,
            (centre[0], centre[1], 0.0),
            TimeFunction(strength * pulse, AIR_STEP * spread),
            nearest,
            time=time,
        )
        for centre, strength, time in zip(holes.centres, strengths, holes.times, strict=True)
    )


def with_open_ground(mesh, box):
    """Return a mesh with a surface for the air: the top of a box (3, 2) in m.

    The cells beyond the box are longer than the waves of the air and would send them back.
    """
    middle = mesh.points[mesh.surfaces["top"]].mean(axis=1)[:, :2]
    inside = ((middle > box[:2, 0]) & (middle < box[:2, 1])).all(axis=1)
    return replace(mesh, surfaces={**mesh.surfaces, OPEN: mesh.surfaces["top"][inside]})


def _on_affected(site, truth, change):
    """Change the joints that the truth file calls affected."""
    affected = truth["affected"]["joints"]
    return site.changed(joints=[change(j) if j.surface in affected else j for j in site.joints])


EFFECTS = {
    "attenuation_Q": _attenuation,
    "soft_surface_layer": _soft_layer,
    "joint_nonlinear_closure": _closure,
    "joint_slip": _slip,
    "air_blast": _air_blast,
}
