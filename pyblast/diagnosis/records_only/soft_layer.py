"""Whether waves along a line slow down with frequency, as over soft ground they do."""

from dataclasses import dataclass

import numpy as np
from scipy import fft, optimize, stats

from ...errors import InputError
from .thin_layers import rayleigh_speeds
from .verdict import SURE, Verdict, share_as_large

SPEEDS = np.arange(80.0, 700.0, 2.0)
N_DRAWS, N_FREQUENCIES, FEWEST = 999, 14, 6
N_CHANCES, AGREED = 20, 0.1  # the share by which picks of drawn shots may differ
STARTS = ((2.0, 0.7, 1.2), (5.0, 0.7, 1.4), (10.0, 0.8, 1.8))
DEEPEST = 0.5  # of the longest wave, to which Vs is told


@dataclass(frozen=True, eq=False)
class Picks:
    """Phase speeds at frequencies, with standard deviations over shots."""

    frequency: np.ndarray
    speed: np.ndarray
    sigma: np.ndarray


def soft_layer(shots, held, band, *, poisson=0.4, seed=0) -> Verdict:
    """Judge a half-space against a layer on a half-space by Rayleigh waves of a line.

    Parameters
    ----------
    shots, held : list of Shot
        To fit, and to judge by: other shots, best from the other end of the line.
    band : tuple of 2 float, Hz
        Where surface waves rule.
    poisson : float
    seed : int

    Returns
    -------
    Verdict
        "soft_surface_layer" with "thickness" [m], "vs_layer", "vs_below" and "vs_mean" [m/s], the
        last by travel time down to half of the longest wave. ``held_out``: misfits in standard
        deviations of the held shots' phase speeds by one speed, and by the layer.

    Notes
    -----
    Chance: phase speeds of one speed whose misfits are dealt to the frequencies anew.
    Inverse dispersion is no soft layer and "UNKNOWN".
    """
    if len(shots) < 3 or len(held) < 3:
        raise InputError(f"soft_layer: needs 3 shots to fit and 3 to judge, got {len(shots)}, "
                         f"{len(held)}")  # fmt: skip
    frequencies = np.geomspace(*band, N_FREQUENCIES)
    picks, other = (phase_speeds(one, frequencies, seed=seed) for one in (shots, held))
    if min(len(picks.speed), len(other.speed)) < FEWEST:
        return Verdict("UNKNOWN", "soft_surface_layer",
                       "too few frequencies have one clear phase speed", band=band)  # fmt: skip
    steep = stats.spearmanr(picks.frequency, picks.speed)[0]
    rng = np.random.default_rng(seed)
    drawn = [abs(stats.spearmanr(picks.frequency, rng.permutation(picks.speed))[0])
             for _ in range(N_DRAWS)]  # fmt: skip
    chance = share_as_large(abs(steep), drawn)
    one_speed = np.average(picks.speed, weights=picks.sigma**-2)
    if chance > SURE:
        return Verdict(
            "NULL", "soft_surface_layer",
            f"phase speeds keep to {one_speed:.0f} m/s, but for what chance makes",
            band=band, chance=chance,
        )  # fmt: skip
    if steep > 0.0:
        return Verdict("UNKNOWN", "soft_surface_layer", "waves of higher frequency are faster",
                       band=band, chance=chance)  # fmt: skip
    values, spread = fit_layer(picks, poisson)
    before = _misfit(other, np.full(len(other.speed), one_speed))
    after = _misfit(other, _speeds(values, other.frequency, poisson))
    return Verdict(
        "NAMED" if after < before else "UNKNOWN", "soft_surface_layer",
        f"phase speeds fall from {picks.speed[0]:.0f} to {picks.speed[-1]:.0f} m/s; of shots not "
        f"fitted one speed leaves {before:.1f}, the layer {after:.1f} standard deviations",
        parameters=_told(values, spread, picks), band=band, chance=chance, held_out=(before, after),
    )  # fmt: skip


def phase_speeds(shots, frequencies, *, n_draws=40, seed=0) -> Picks:
    """Pick the speed at which phases of all receivers stack best, theory.md (15.4).

    A frequency is left out where drawn sets of shots do not agree, where the best speed is an end
    of those tried, or where receivers of drawn phases stack as well in 5 %.
    """
    rng = np.random.default_rng(seed)
    both = np.array([_stacked(shot, frequencies, rng) for shot in shots])
    powers, chance = both[:, 0], both[:, 1:].mean(axis=0).max(axis=(0, 1))
    drawn = np.array([
        np.argmax(powers[rng.integers(len(shots), size=len(shots))].mean(axis=0), axis=0)
        for _ in range(n_draws)
    ])  # fmt: skip
    best, sigma = np.argmax(powers.mean(axis=0), axis=0), np.std(SPEEDS[drawn], axis=0)
    most = powers.mean(axis=0).max(axis=0)
    clear = (best > 0) & (best < len(SPEEDS) - 1) & (sigma < AGREED * SPEEDS[best])
    clear &= most > chance
    sigma = np.maximum(sigma, 0.01 * SPEEDS[best])
    return Picks(frequencies[clear], SPEEDS[best[clear]], sigma[clear])


def _stacked(shot, frequencies, rng):
    """Return the power of the phase stack, and those of drawn phases, (1 + 20, n_speeds, n)."""
    size = fft.next_fast_len(8 * shot.motion.shape[1], real=True)
    found = fft.rfft(shot.motion, size)[:, np.rint(frequencies * size * shot.dt).astype(int)]
    drawn = np.exp(2j * np.pi * rng.random((N_CHANCES, *found.shape)))
    phases = np.concatenate([found[None] / np.maximum(np.abs(found), 1e-300), drawn])
    turns = np.exp(2j * np.pi * frequencies * shot.offsets[:, None, None] / SPEEDS[:, None])
    stacks = [np.einsum("cf,csf->sf", one, turns) for one in phases]
    return np.abs(np.array(stacks) / len(found)) ** 2


def fit_layer(picks, poisson):
    """Return thickness, Vs of the layer, Vs below, and their covariance, in logarithms."""
    fast = 1.06 * picks.speed

    def remainder(x):
        return (_speeds(x, picks.frequency, poisson) - picks.speed) / picks.sigma

    starts = [np.log([h, a * fast.min(), b * fast.max()]) for h, a, b in STARTS]
    low, high = np.log([0.3, 40.0, 60.0]), np.log([40.0, 1500.0, 3000.0])
    fits = [optimize.least_squares(remainder, np.clip(x, low, high), bounds=(low, high),
                                   diff_step=1e-2, max_nfev=25) for x in starts]  # fmt: skip
    best = min(fits, key=lambda fit: fit.cost)
    excess = max(1.0, 2.0 * best.cost / (len(picks.speed) - 3))
    return best.x, np.linalg.pinv(best.jac.T @ best.jac) * excess


def _speeds(values, frequencies, poisson):
    """Return phase speeds over one layer."""
    thickness, layer, below = np.exp(values)
    return rayleigh_speeds(frequencies, [thickness], [layer, below], poisson)


def _misfit(picks, speeds):
    """Return the root mean square of misfits in standard deviations."""
    return float(np.sqrt(np.mean(((speeds - picks.speed) / picks.sigma) ** 2)))


def _told(values, covariance, picks):
    """Return the layer with 90 % intervals, by draws of the fit."""
    rng = np.random.default_rng(0)
    depth = DEEPEST * np.max(picks.speed / picks.frequency)
    drawn = np.exp(rng.multivariate_normal(values, covariance, 500))
    h = np.minimum(drawn[:, 0], depth)
    mean = depth / (h / drawn[:, 1] + (depth - h) / drawn[:, 2])
    best = np.exp(values)
    top = min(best[0], depth)
    centre = [*best, depth / (top / best[1] + (depth - top) / best[2])]
    ends = np.quantile(np.column_stack([drawn, mean]), [0.05, 0.95], axis=0)
    names = ("thickness", "vs_layer", "vs_below", "vs_mean")
    return {name: (float(c), float(lo), float(hi))
            for name, c, lo, hi in zip(names, centre, *ends, strict=True)}  # fmt: skip
