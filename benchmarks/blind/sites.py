"""Small sites as their engineer knows them, drawn at random: what is true is another matter."""

from dataclasses import dataclass, replace

import numpy as np

from pyblast.blasts.blast import Blast
from pyblast.config.config import check_config
from pyblast.mesh.mesh import Mesh
from pyblast.model.boundary import Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Damping, Material
from pyblast.model.model import Model, Receiver, SpongeLayer
from pyblast.model.source import Hole, TimeFunction
from pyblast.project.project import Project, make_project
from pyblast.sources.inside import Inside
from pyblast.survey import Survey

from .flat_models import OUTER, Discretization, FlatBox, Plane, flat_mesh

SIZE = 120.0, 90.0, 60.0
BAND = 5.0, 25.0
DT, BEFORE, AFTER = 0.004, 60, 110  # s, samples before the first hole and from it on
FURTHER, HIDDEN = "H1", "RH"  # blast and receiver that no diagnosis reads
APART = 14.0  # m between joints
# Depth in m of charges below the weathered rock, or below the first of the ground: what a charge
# sends from an interface depends on the zones there more than on anything that is hidden.
BELOW, FIRST = (4.0, 7.0), 5.0


@dataclass(frozen=True, eq=False)
class SiteJoint:
    """A vertical joint on the whole plane ``axis`` ("x" or "y") = ``position`` in m."""

    joint: Joint
    axis: str
    position: float


@dataclass(frozen=True, eq=False)
class Site:
    """A site that is drawn, as known or as it is: ground, blasts, receivers.

    Parameters
    ----------
    box : (3, 2) float64, m
    layers : tuple of (name, thickness m or None, Material)
        From the top down.
    joints : tuple of SiteJoint
    receivers : tuple of Receiver
    moment_rate : TimeFunction
        Of 1 kg, N m/s.
    exponent : float
        Of the charge.
    blasts : dict of str to Blast
    band : tuple of 2 float, Hz
    noise_window : tuple of 2 float, s
    ground : tuple
        Fields of factors on the speeds.
    """

    box: np.ndarray
    layers: tuple
    joints: tuple[SiteJoint, ...]
    receivers: tuple[Receiver, ...]
    moment_rate: TimeFunction
    exponent: float
    blasts: dict[str, Blast]
    band: tuple[float, float] = BAND
    noise_window: tuple[float, float] = (-BEFORE * DT, 0.0)
    ground: tuple = ()

    def mesh(self, cut: Discretization) -> Mesh:
        """Mesh the ground, with its joints split."""
        planes = tuple(Plane(j.joint.surface, j.axis, j.position) for j in self.joints)
        layers = tuple((name, thickness) for name, thickness, _ in self.layers)
        return flat_mesh(FlatBox(self.box, layers, planes), cut)

    def model(
        self, blast: str, cut: Discretization, mesh: Mesh, damping: Damping | None = None
    ) -> Model:
        """Model one blast, but for misfires, on a mesh of `mesh`."""
        holes = self.blasts[blast]
        sources = [
            Hole(place, charge, time, self.moment_rate, self.exponent, cut.spread)
            for place, charge, time in zip(holes.centres, holes.charge, holes.times, strict=True)
            if charge > 0.0
        ]
        return Model(
            mesh,
            {name: material for name, _, material in self.layers},
            joints=[j.joint for j in self.joints],
            boundaries=[Viscous(side) for side in OUTER],
            damping=damping,
            sponge=SpongeLayer(tuple(map(tuple, self.box)), cut.padding, self.band[0]),
            sources=sources,
            receivers=self.receivers,
            ground=self.ground,
            quadratic=cut.quadratic,
            single=cut.single,
        )


def tables_of(site: Site, title, **edges) -> dict:
    """Return a site as tables of a project file with edges of its mesh, without receivers."""
    return {
        "title": title,
        "mesh": {
            "size_m": np.ptp(site.box, axis=1).tolist(), "origin_m": site.box[:, 0].tolist(),
            **edges,
            "layers": [{"material": name} | ({} if t is None else {"thickness_m": t})
                       for name, t, _ in site.layers],
            "faults": [
                {"name": j.joint.surface, "dip_deg": 90.0,
                 "dip_direction_deg": 90.0 if j.axis == "x" else 0.0,
                 "through_m": [j.position, j.position, 0.0]}
                for j in site.joints
            ],
        },
        "materials": {name: {"density_kg_per_m3": m.density, "cp_m_per_s": m.cp,
                             "cs_m_per_s": m.cs} for name, _, m in site.layers},
        "joints": {
            j.joint.surface: {
                "law": "elastic", "insitu_pressure_kpa": 1e-3 * j.joint.insitu_pressure,
                **{f"{k}_gpa_per_m": 1e-9 * v for k, v in j.joint.properties.items()},
            }
            for j in site.joints
        },
        "boundaries": {"viscous": list(OUTER), "free": ["top"]},
        "blast": {"file": "holes.csv", "charge_exponent": site.exponent},
        "holes_inside": {"moment_rate_file": "source.csv"},
        "run": {"duration_s": AFTER * DT, "compare_band_hz": list(site.band)},
        "diagnosis": {"noise_window_s": list(site.noise_window)},
    }  # fmt: skip


def project_of(site: Site) -> Project:
    """Return a site as the project of its first blast, with the further ones; without records."""
    project = make_project(check_config(tables_of(site, "drawn", edge_m=10.0)), "drawn.toml")
    ground = {
        "materials": {name: material for name, _, material in site.layers},
        "joints": tuple(j.joint for j in site.joints), "fields": site.ground,
    }  # fmt: skip
    shots = [
        replace(project.shots[0], name=name, fired=blast, held=Inside(site.moment_rate))
        for name, blast in site.blasts.items()
    ]
    return replace(project, survey=Survey(tuple(shots), site.receivers, {}), **ground)


def draw_site(rng, poor=False) -> Site:
    """Draw a site with the further blast and the hidden receiver, without records.

    Parameters
    ----------
    rng : numpy Generator
    poor : bool
        One blast and one receiver beside those that are hidden.
    """
    bench = np.array([rng.uniform(22.0, 32.0), rng.uniform(28.0, 55.0)])
    joints, layers = _joints(rng), _layers(rng)
    bench = *bench, -(layers[0][1] or FIRST) - rng.uniform(*BELOW)
    blasts = {
        "S1": _blast(rng, bench, 5.0, 1, rng.uniform(8.0, 15.0)),
        "B1": _blast(rng, bench, 5.0, rng.integers(1, 5), rng.uniform(25, 60)),
        "B2": _blast(rng, bench, 5.0, rng.integers(4, 9), rng.uniform(90, 200)),
        FURTHER: _blast(rng, bench, 6.0, 3, rng.uniform(60.0, 120.0)),
    }
    if poor:
        del blasts["S1"], blasts["B1"]
    elif rng.random() < 0.4:
        del blasts["B1"]
    receivers = _receivers(rng, 1 if poor else int(rng.integers(5, 8)), joints)
    return Site(
        box=np.array([[0.0, SIZE[0]], [0.0, SIZE[1]], [-SIZE[2], 0.0]]),
        layers=layers, joints=joints, receivers=receivers,
        moment_rate=_pulse(rng), exponent=round(float(rng.uniform(0.75, 0.95)), 3), blasts=blasts,
    )  # fmt: skip


def _layers(rng):
    """Draw rock, in four of ten sites under slower rock."""
    cs = rng.uniform(1400.0, 1900.0)
    rock = Material.from_speeds(rng.uniform(2500, 2800), cs * rng.uniform(1.7, 1.95), cs)
    if rng.random() > 0.4:
        return (("rock", None, rock),)
    slow = rng.uniform(0.65, 0.85)  # thin beside its shortest wave, which keeps runs short
    above = Material.from_speeds(rock.density - 150.0, slow * rock.cp, slow * rock.cs)
    return ("weathered", round(float(rng.uniform(10.0, 15.0)), 1), above), ("rock", None, rock)


def _joints(rng):
    """Draw one to three joints between the bench and the far receivers."""
    found = []
    for number in range(rng.integers(1, 4)):
        axis = "y" if number == 2 else "x"
        limits = (62.0, 78.0) if axis == "y" else (45.0, 90.0)
        place = round(float(rng.uniform(*limits)), 1)
        if any(j.axis == axis and abs(j.position - place) < APART for j in found):
            continue
        kn = float(np.exp(rng.uniform(np.log(4e8), np.log(2e9))))
        values = {"kn": round(kn, -6), "ks": round(kn * rng.uniform(0.3, 0.8), -6)}
        pressure = round(float(rng.uniform(0.8e5, 3e5)), -3)
        joint = Joint(f"J{number + 1}", "elastic", values, insitu_pressure=pressure)
        found.append(SiteJoint(joint, axis, place))
    return tuple(found)


def _blast(rng, bench, reach, count, charge):
    """Draw a row or two of holes near a place whose charges sum to about ``charge`` kg."""
    n, start = np.arange(count), np.array(bench)
    start[:2] += rng.uniform(-reach, reach, 2)
    centres = start + np.column_stack([n % 2 * 4.0, n // 2 * 4.5, 0.0 * n])
    centres[:, :2] += rng.uniform(-0.3, 0.3, (count, 2))
    weights = charge / count * rng.uniform(0.9, 1.1, count)
    centres, weights = centres.round(2), weights.round(2)
    delays = n * rng.choice([0.017, 0.025, 0.033])
    return Blast("", centres, centres, weights, delays, np.full(count, 0.1))


def _receivers(rng, count, joints):
    """Draw receivers, most of them beyond the first joint, and the hidden one."""
    places = []
    while len(places) <= count:
        x = rng.uniform(12.0, 112.0) if len(places) % 3 == 2 else rng.uniform(65.0, 112.0)
        place = np.array([x, rng.uniform(10.0, 80.0)]).round(1)
        gaps = [abs(place["xy".index(j.axis)] - j.position) for j in joints]
        near = [np.linalg.norm(place - np.array(other[:2])) for other in places]
        bench = abs(place[0] - 30.0) < 14.0
        if not bench and min([*gaps, 99.0]) > 3.0 and min([*near, 99.0]) > 9.0:
            places.append((*place.tolist(), 0.0))
    if count > 1 and rng.random() < 0.5:
        places[0] = (*places[0][:2], round(float(rng.uniform(-25.0, -8.0)), 1))
    named = [*(f"R{n + 1:02d}" for n in range(count)), HIDDEN]
    return tuple(Receiver(name, place) for name, place in zip(named, places, strict=True))


def _pulse(rng):
    """Draw the moment rate of 1 kg."""
    length, step = rng.uniform(0.05, 0.08), 0.001
    times = np.arange(0.0, length + step, step)
    shape = np.sin(np.pi * np.minimum(times / length, 1.0)) ** 2
    rate = rng.uniform(2e9, 6e9) * shape / (shape.sum() * step)
    return TimeFunction(rate, step, 0.0)
