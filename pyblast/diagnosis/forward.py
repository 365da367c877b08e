"""From sites to motion at the receivers of a case: many runs side by side, none made twice."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np

from ..ensembles.banks import greens_functions
from ..ensembles.many_runs import run_all
from ..projects.site import Site
from ..projects.site_model import Cut, site_mesh, site_model
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
