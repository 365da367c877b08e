"""Records of a case: its worlds run by SPECFEM3D, sampled, heard, with noise."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.blind.worlds import delayed

from .hearing import coloured, shares
from .mesh import mesh_of, time_step
from .sites import BAND, BEFORE, DT, DURATION, LARGE, SINGLE, SIZE
from .solver import LEAD, simulated
from .worlds import Case

FINER = 1.5  # edges of the second mesh are shorter by this factor
ENDS = 0.45  # s, after which a single hole is over: the second mesh is run so long


@dataclass(frozen=True, eq=False)
class Recorded:
    """Motion of a case, (n_receivers, 3, n) in m/s by blast from `BEFORE` s before its zero on.

    Parameters
    ----------
    clean, records : dict of str to array
        As heard without noise, and with it.
    without : array
        Of B2, clean, of the world without its effect; of hard nulls the same as ``clean``.
    believed : array
        Of B2, of the site as its engineer knows it.
    numerics : dict
        Elements, time step in s, and for S1 by receiver the energy by which a mesh of `FINER`
        edges differs.
    """

    clean: dict
    records: dict
    without: np.ndarray
    believed: np.ndarray
    numerics: dict


def recorded(case: Case, run=simulated) -> Recorded:
    """Run what a case needs.

    Parameters
    ----------
    case : Case
    run : callable
        As `benchmarks.specfem.solver.simulated`.
    """
    truth, blasts = case.world.site, case.believed.blasts
    motion = _motion(truth, blasts, run)
    finer = _motion(truth, [SINGLE], run, FINER, ENDS)[SINGLE]
    clean = _heard(case.world, motion)
    other = _motion(case.bare.site, [LARGE], run) if _differs(case) else {LARGE: motion[LARGE]}
    without = _heard(case.bare, other)[LARGE]
    believed = _motion(case.believed, [LARGE], run)[LARGE]
    level = np.median(np.abs(clean[SINGLE]).max(axis=(1, 2))) / case.snr
    records = {name: clean[name] + coloured(case.rng, clean[name].shape, level) for name in blasts}
    mesh = mesh_of(truth.ground, SIZE, BAND[1], breaks=truth.breaks())
    numerics = {
        "elements": len(mesh.elements), "dt": time_step(mesh, truth.ground),
        "finer": FINER, "mesh_error": shares(*(each[..., times() < ENDS]
                                               for each in (finer, motion[SINGLE]))),
    }  # fmt: skip
    return Recorded(clean, records, without, believed, numerics)


def _differs(case):
    """Tell whether the ground moves in another way without the effect."""
    bare, true = case.bare.site, case.world.site
    return (bare.ground is not true.ground or bare.receivers is not true.receivers
            or bare.blasts[LARGE] is not true.blasts[LARGE])  # fmt: skip


def _motion(site, blasts, run, finer=1.0, until=DURATION):
    """Return the motion of blasts of a site on one mesh, sampled."""
    mesh = mesh_of(site.ground, SIZE, BAND[1], finer, site.breaks())
    places = site.receivers.copy()
    on_ground = np.isnan(places[:, 2])
    places[on_ground, 2] = np.inf
    holes = {name: vars(site.blasts[name]) for name in blasts}
    found = run(site.ground, mesh, holes, site.pulse, site.exponent, places, until)
    return {name: _sampled(*each) for name, each in found.items()}


def times():
    """Return the times in s of the samples of a record, zero at the blast's."""
    return DT * np.arange(round((BEFORE + DURATION) / DT)) - BEFORE


def _sampled(at, velocity):
    """Return velocity at the times of a record; at rest before a run begins."""
    wanted = times()
    values = CubicSpline(at, velocity, axis=-1)(np.clip(wanted, -LEAD, at[-1]))
    return np.where(wanted > -LEAD, values, 0.0)


def _heard(world, motion):
    """Return what is written down without noise."""
    found = {}
    for name, moved in motion.items():
        for change in world.heard:
            moved = change(moved, world.site, name, times())
        found[name] = delayed(moved, np.asarray(world.lags[name])[:, None], DT)
    return found
