"""Forward simulation of a case: motion at and around its receivers."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from ..project.site import Site
from ..project.site_model import Cut, site_mesh, site_model
from ..runs.greens_bank import greens_functions
from ..runs.parallel import run_all
from .case import Case


@dataclass(eq=False)
class Forward:
    """The solver as a diagnosis sees it; counts its runs.

    Parameters
    ----------
    case : Case
    cut : Cut
    folder : path, optional
        Where runs are kept and found.
    executor : Executor, optional
        As for `run_all`.
    runs, kept : int
        How many were asked for, and how many whole blasts the folder had before any was made here.
    kept_s : float, s
        How long those took when they were made.
    """

    case: Case
    cut: Cut
    folder: str | None = None
    executor: Executor | None = None
    runs: int = 0
    kept: int = 0
    kept_s: float = 0.0
    _meshes: dict = field(default_factory=dict, repr=False)
    _known: set = field(default_factory=set, repr=False)

    def motion(self, site: Site) -> np.ndarray:
        """Return the motion (n_blasts, n_receivers, 3, n_samples) in m/s of one site."""
        return self.motions([site])[0]

    def motions(self, sites: Sequence[Site]) -> np.ndarray:
        """Return the motion (n_sites, n_blasts, n_receivers, 3, n_samples) in m/s of many sites."""
        heard = self.heard([(site, blast) for site in sites for blast in self.case.blasts])
        motion = np.stack(heard)
        return motion.reshape(len(sites), -1, *motion.shape[1:])

    def heard(self, pairs: Sequence[tuple[Site, str]]) -> list[np.ndarray]:
        """Return the motion (n_receivers, 3, n_samples) in m/s of pairs of site and blast."""
        models = [self.model(site, blast) for site, blast in pairs]
        return [self._sampled(run.seismograms) for run in self.made(models)]

    def made(self, models):
        """Run models, or read them where they are kept, and count them."""
        done = run_all(models, self.case.duration, folder=self.folder, executor=self.executor)
        self.runs += len(done)
        for one in done:
            key = one.provenance["input_sha256"], *one.seismograms
            if one.found and key not in self._known:
                self.kept, self.kept_s = self.kept + 1, self.kept_s + one.wall_seconds
            self._known.add(key)
        return done

    def hole_motion(self, site: Site) -> dict[str, np.ndarray]:
        """Return by blast what each hole sends with its believed charge, fired at zero.

        By a run for each hole, or three for each receiver if these are fewer.

        Returns
        -------
        dict of str to (n_holes, n_receivers, 3, n_samples) float64, m/s
        """
        models = [self.model(site, blast) for blast in self.case.blasts]
        sources = [source for model in models for source in model.sources]
        bank = greens_functions(
            replace(models[0], sources=sources),
            self.case.duration,
            folder=self.folder,
            executor=self.executor,
        )
        self.runs += bank.runs
        found = {}
        for blast, model in zip(self.case.blasts, models, strict=True):
            early = [replace(source, time=0.0) for source in model.sources]
            sent = np.stack([self._sampled(bank.blast([one])) for one in early])
            charge = site.blasts[blast].charge
            found[blast] = np.zeros((len(charge), *sent.shape[1:]))
            found[blast][charge > 0.0] = sent
        return found

    def model(self, site: Site, blast: str):
        """Return the model of one blast; sites of one geometry share a mesh."""
        key = geometry(site)
        if key not in self._meshes:
            self._meshes[key] = site_mesh(site, self.cut)
        return site_model(site, blast, self.cut, self._meshes[key])

    def _sampled(self, seismograms):
        """Return seismograms (n_receivers, 3, n_samples) at the instants of the records."""
        dt, n = self.case.dt, self.case.n_samples
        return np.stack(
            [seismograms[name].sampled(0.0, dt, n).velocity.T for name in self.case.receivers]
        )


def geometry(site):
    """Return what the mesh of a site depends on."""
    layers = tuple((name, thickness) for name, thickness, _ in site.layers)
    joints = tuple((j.joint.surface, j.axis, j.position, j.extent, j.depth) for j in site.joints)
    return site.box.tobytes(), layers, joints, site.marks, site.fabric is not None


STEPS = 3  # on either side of a receiver
STEPS_PER_WAVE = 6.0  # of the shortest S wave at the surface


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Motion on a square grid around each receiver, as high as it stands.

    Parameters
    ----------
    ways : (n,) float64, m
        Of the grid, to the east and to the north.
    motion : (n_blasts, n_receivers, n, n, 3, n_samples) float64, m/s
    """

    ways: np.ndarray
    motion: np.ndarray

    def change(self, receiver: int, east: float, north: float):
        """Return what else one receiver would record elsewhere, (n_blasts, 3, n_samples) m/s.

        By cubic splines; beyond the grid as at its rim.
        """
        cardinal = make_interp_spline(self.ways, np.eye(len(self.ways)), 3)
        way = np.clip((east, north), self.ways[0], self.ways[-1])
        here, there = (np.multiply.outer(*cardinal(one)) for one in (np.zeros(2), way))
        return np.tensordot(there - here, self.motion[:, receiver], ([0, 1], [1, 2]))


def surroundings(forward: Forward, site: Site) -> Surroundings:
    """Run every blast of a case with listening points around all receivers."""
    case = forward.case
    slowest = min(material.cs for _, _, material in site.layers)
    ways = np.arange(-STEPS, STEPS + 1) * slowest / (STEPS_PER_WAVE * case.band.high)
    grid = [(x, y) for x in ways for y in ways]
    there = {r.name: r for r in site.receivers}
    points = tuple(
        replace(there[name], name=f"{name} {k}", position=np.add(there[name].position, (x, y, 0.0)))
        for name in case.receivers
        for k, (x, y) in enumerate(grid)
    )
    models = [replace(forward.model(site, blast), receivers=points) for blast in case.blasts]
    done = forward.made(models)
    motion = np.stack(
        [
            [run.seismograms[one.name].sampled(0.0, case.dt, case.n_samples).velocity.T
             for one in points]
            for run in done
        ]
    )  # fmt: skip
    n = len(ways)
    return Surroundings(ways, motion.reshape(len(models), -1, n, n, *motion.shape[2:]))
