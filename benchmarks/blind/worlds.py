"""True worlds: a site with errors and effects, run on a mesh of its own, heard with real noise."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from pyblast.model.material import Damping
from pyblast.solver.run import run_many

from .flat_models import Discretization
from .noise import real_noise
from .nuisances import LEAD
from .sites import AFTER, BAND, BEFORE, DT, Site

# Another mesh than the diagnosis takes: constant strain, more zones to a wave, wider sponge.
EDGES = 9.0  # to the shortest S wave of the band in the layer that is most of the ground
PADDING = 0.5  # of the longest S wave of the band; a diagnosis has 0.2, and 0.4 to correct it
GROWTH = 1.1


@dataclass(frozen=True, eq=False)
class World:
    """What is really there.

    Parameters
    ----------
    site : Site
        True values, places, holes, laws of joints, ground; all holes fire `LEAD` later.
    lags : dict of str to dict of str to float, s
        How late the clock of each receiver was in each blast.
    damping : Damping, optional
    heard : tuple of callable
        ``(velocity, site, blast, receiver) -> velocity`` (3, n): what becomes of a record.
    """

    site: Site
    lags: dict
    damping: Damping | None = None
    heard: tuple[Callable, ...] = ()

    def with_site(self, **changes):
        """Return the world with changes of its site."""
        return replace(self, site=replace(self.site, **changes))

    def with_blast(self, name, **changes):
        """Return the world with changes of one blast."""
        blasts = self.site.blasts
        return self.with_site(blasts={**blasts, name: replace(blasts[name], **changes)})

    def hearing(self, change):
        """Return the world with one more change of what is recorded."""
        return replace(self, heard=(*self.heard, change))


def ground_motion(world: World) -> dict[str, np.ndarray]:
    """Run all blasts; return by blast the motion (n_receivers, 3, n_samples) in m/s.

    It begins ``BEFORE`` samples before the first hole fires.
    """
    site = world.site
    cs = site.layers[-1][2].cs
    cut = Discretization(cs / BAND[1] / EDGES, PADDING * cs / BAND[0], GROWTH)
    mesh = site.mesh(cut)
    models = [site.model(blast, cut, mesh, world.damping) for blast in site.blasts]
    runs = run_many(models, LEAD + AFTER * DT)
    found = {}
    for blast, run in zip(site.blasts, runs, strict=True):
        after = [run.seismograms[r.name].sampled(LEAD, DT, AFTER).velocity.T
                 for r in site.receivers]  # fmt: skip
        found[blast] = np.pad(np.stack(after), ((0, 0), (0, 0), (BEFORE, 0)))
    return found


def noise_of(site, motion, snr, rng) -> dict[str, np.ndarray]:
    """Draw real noise for all records, some receivers noisier than others.

    Parameters
    ----------
    site : Site
    motion : dict of str to (n_receivers, 3, n_samples) float64, m/s
    snr : float
        Median peak of the smallest blast over the root of the mean square of the noise.
    rng : numpy Generator
    """
    weakest = min(motion, key=lambda name: site.blasts[name].charge.sum())
    level = np.median(np.abs(motion[weakest]).max(axis=(1, 2))) / snr
    uneven = level * np.exp(rng.normal(0.0, 0.3, len(site.receivers)))[:, None, None]
    shape = len(site.receivers), 3
    return {name: uneven * real_noise(rng, shape, BEFORE + AFTER, DT, BAND) for name in site.blasts}


def recorded(world: World, motion, noise=None) -> dict[str, np.ndarray]:
    """Return what the receivers write down, (n_receivers, 3, n_samples) m/s by blast."""
    found = {}
    for blast, moved in motion.items():
        whole = moved if noise is None else moved + noise[blast]
        rows = []
        for receiver, velocity in zip(world.site.receivers, whole, strict=True):
            for change in world.heard:
                velocity = change(velocity, world.site, blast, receiver.name)
            rows.append(delayed(velocity, world.lags[blast][receiver.name]))
        found[blast] = np.stack(rows)
    return found


def delayed(velocity, lag, dt=DT):
    """Return samples (..., n), ``dt`` s apart, that come ``lag`` (...) s later."""
    n = velocity.shape[-1]
    size = fft.next_fast_len(2 * n, real=True)
    turns = np.exp(-2j * np.pi * fft.rfftfreq(size, dt) * np.asarray(lag)[..., None])
    return fft.irfft(fft.rfft(velocity, size) * turns, size)[..., :n]
