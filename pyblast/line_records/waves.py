"""Air wave and surface waves along a line: slant stacks, dispersion, layered ground."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft, linalg, optimize, signal, stats

from ..errors import InputError
from .shots import (
    NEEDED,
    SIGNIFICANCE,
    EffectDecision,
    ShotGather,
    interval,
    jackknifed,
    permutation_p,
    shifted,
)

AIR = (312.0, 361.0)  # m/s, speed of sound at -30 to 50 degrees C: 20.05 sqrt(T)
AIR_SPEEDS = np.geomspace(120.0, 2000.0, 340)
N_AIR_DRAWS, N_DELAYS = 99, 15
NEAREST = 3.0  # m, offset within which waves of all speeds overlap


@dataclass(frozen=True, eq=False)
class SlantStack:
    """Slant stack of a shot: envelopes, each over its rms, and the trial delays."""

    envelopes: np.ndarray
    offsets: np.ndarray
    dt: float
    start: float
    delays: np.ndarray

    def stacked(self, speeds: np.ndarray) -> np.ndarray:
        """Return the mean over receivers at each speed and delay (n_speeds, n_delays)."""
        total = np.zeros((len(speeds), len(self.delays)))
        for row, offset in zip(self.envelopes, self.offsets, strict=True):
            times = offset / speeds[:, None] + self.delays
            index = np.rint((times - self.start) / self.dt).astype(int)
            inside = (index >= 0) & (index < len(row))
            total = total + np.where(inside, row[np.clip(index, 0, len(row) - 1)], 0.0)
        return total / len(self.envelopes)


def air_wave(
    shots: Sequence[ShotGather], band: tuple[float, float], *, seed: int = 0
) -> EffectDecision:
    """Test for an air wave: one that leaves the source at its time with the speed of sound.

    Parameters
    ----------
    shots : list of Shot
    band : tuple of 2 float, Hz
        Usable band of the records, to which they are filtered.
    seed : int

    Returns
    -------
    Decision
        "air_blast" with "speed" [m/s], "delay" [s] and "energy", the share of a record's energy in
        the band that lies in the window; ``window`` is its duration relative to the
        time offset/speed. ``held_out`` is the share of energy in the window at every other
        receiver that its two neighbours predict, without and with the air wave. "UNKNOWN" is a
        wave of the speed of sound that does not start with the source or is dispersive.

    Notes
    -----
    Test statistic: the largest slant stack over speeds and delays, against that of envelopes
    shifted circularly by random times, theory.md (15.2). One speed for all shots and one delay
    per shot, because triggers err.
    """
    if not shots:
        raise InputError("air_wave: needs at least one shot")
    slants = [_slants(shot, band) for shot in shots]
    stacks = [slant.stacked(AIR_SPEEDS) for slant in slants]
    speed, most = _peak(stacks)
    rng = np.random.default_rng(seed)
    drawn = [_peak([_circularly_shifted(slant, rng).stacked(AIR_SPEEDS) for slant in slants])[1]
             for _ in range(N_AIR_DRAWS)]  # fmt: skip
    p_value = permutation_p(most, drawn)
    if p_value > SIGNIFICANCE:
        return EffectDecision("NULL", "air_blast", "no wave crosses the line significantly",
                       band=band, p_value=p_value)  # fmt: skip
    estimate = _refined_speed(slants, speed)
    if not AIR[0] < estimate[0] < AIR[1]:
        return EffectDecision(
            "NULL", "air_blast",
            f"the clearest wave has {estimate[0]:.0f} m/s, which is not the speed of sound in air",
            parameters={"speed": estimate}, band=band, p_value=p_value,
        )  # fmt: skip
    delays = [_delay(slant, estimate[0]) for slant in slants]
    window = _window(slants, estimate[0], delays)
    objection = _objection(shots, band, estimate[0], delays, window)
    held = held_out(shots, band, estimate[0], delays, window)
    channels = sorted({int(c) for shot in shots for c in shot.channels})
    shares = [
        share for shot, delay in zip(shots, delays, strict=True)
        for share in _energy_shares(shot.banded(band), estimate[0], delay, window)
    ]  # fmt: skip
    return EffectDecision(
        "UNKNOWN" if objection or held[1] <= held[0] else "NAMED", "air_blast",
        objection
        or f"a wave of {estimate[0]:.0f} m/s leaves the source at its time in all of the band",
        tuple(channels),
        {"speed": estimate, "delay": interval(delays), "energy": interval(shares)}, window, band,
        p_value, held,
    )  # fmt: skip


def _slants(shot, band):
    """Return the slant stack of a shot; delays reach two periods of the lowest frequency."""
    shot = shot.banded(band)
    far = shot.offsets > NEAREST
    if far.sum() < 6:
        raise InputError(f"air_wave: needs 6 receivers beyond {NEAREST:g} m, got {far.sum()}")
    envelopes = np.abs(signal.hilbert(shot.motion[far], axis=1))
    envelopes = envelopes / np.sqrt(np.mean(envelopes**2, axis=1, keepdims=True))
    reach = 2.0 / band[0]
    return SlantStack(
        envelopes, shot.offsets[far], shot.dt, shot.start, np.linspace(-reach, reach, N_DELAYS)
    )


def _peak(stacks):
    """Return the speed of the largest stack, each shot at its best delay, and that stack."""
    ridge = np.mean([stack.max(axis=1) for stack in stacks], axis=0)
    best = int(np.argmax(ridge))
    return float(AIR_SPEEDS[best]), float(ridge[best])


def _circularly_shifted(slant, rng):
    """Return a surrogate: each envelope shifted circularly by a random time."""
    n = slant.envelopes.shape[1]
    index = (np.arange(n) + rng.integers(n, size=(len(slant.envelopes), 1))) % n
    return SlantStack(np.take_along_axis(slant.envelopes, index, 1), slant.offsets, slant.dt,
                  slant.start, slant.delays)  # fmt: skip


def _refined_speed(slants, speed):
    """Return the speed with its 90 % jackknife interval over tenths of the receivers."""
    near = np.linspace(0.94, 1.06, 121) * speed

    def best(skip):
        parts = [_without(slant, skip) for slant in slants]
        return near[np.argmax(np.mean([p.stacked(near).max(axis=1) for p in parts], axis=0))]

    middle, low, high = jackknifed([best(part) for part in range(10)])
    step = near[1] - near[0]
    return middle, min(low, middle - step), max(high, middle + step)


def _without(slant, part):
    """Return the slant stack without one tenth of the receivers."""
    used = np.arange(len(slant.offsets)) % 10 != part
    return SlantStack(
        slant.envelopes[used], slant.offsets[used], slant.dt, slant.start, slant.delays
    )


def _delay(slant, speed):
    """Return the delay of a shot at one speed."""
    return float(slant.delays[np.argmax(slant.stacked(np.array([speed]))[0])])


def _window(slants, speed, delays):
    """Return the window after offset/speed in which aligned envelopes exceed half their peak."""
    lags = np.arange(-0.05, 0.1, 0.25 * slants[0].dt)
    profile = np.zeros(len(lags))
    for slant, delay in zip(slants, delays, strict=True):
        line = SlantStack(slant.envelopes, slant.offsets, slant.dt, slant.start, lags + delay)
        profile = profile + line.stacked(np.array([speed]))[0]
    top = int(np.argmax(profile))
    out = profile < 0.5 * (profile[top] + np.median(profile))
    first = top - int(np.argmax(out[top::-1])) if out[: top + 1].any() else 0
    last = top + int(np.argmax(out[top:])) if out[top:].any() else len(lags) - 1
    return float(lags[first]), float(lags[last])


def _energy_shares(shot, speed, delay, window):
    """Return the share of the energy of each record in the window of the air wave."""
    lag = shot.times - delay - shot.offsets[:, None] / speed
    inside = (lag >= window[0]) & (lag <= window[1])
    energy = shot.motion**2
    whole = energy.sum(axis=1)
    used = (shot.offsets > NEAREST) & (whole > 0.0)
    return ((energy * inside).sum(axis=1)[used] / whole[used]).tolist()


def _objection(shots, band, speed, delays, window):
    """Return what contradicts an air wave, an empty text if nothing does."""
    late = float(np.median(delays))
    if abs(late) > 1.0 / band[0] + window[1] - window[0]:
        return f"the wave starts {1e3 * late:.1f} ms off the source time, as refracted waves do"
    middle = float(np.sqrt(band[0] * band[1]))
    for part in ((band[0], middle), (middle, band[1])):
        slants = [_slants(shot, part) for shot in shots]
        refined = _refined_speed(slants, speed)[0]
        if not AIR[0] < refined < AIR[1]:
            return f"at {part[0]:.0f} to {part[1]:.0f} Hz the wave has {refined:.0f} m/s"
    return ""


def held_out(
    shots: Sequence[ShotGather],
    band: tuple[float, float],
    speed: float,
    delays: Sequence[float],
    window: tuple[float, float],
) -> tuple[float, float]:
    """Return the share of energy predicted at every other receiver: 0, and by the air wave.

    The prediction is the mean waveform of the two neighbours, shifted by the moveout, with the
    geometric mean of their amplitudes; nothing of the receiver itself is used.
    """
    residual = []
    for shot, delay in zip(shots, delays, strict=True):
        shot = shot.banded(band)
        order = np.flatnonzero(shot.offsets > NEAREST)
        moved = shifted(shot.motion, -shot.offsets / speed, shot.dt)
        lag = shot.times - delay
        inside = (lag >= window[0]) & (lag <= window[1])
        for a, n, b in zip(order[:-2:2], order[1:-1:2], order[2::2], strict=False):
            cut = moved[[a, n, b]][:, inside]
            size = np.linalg.norm(cut, axis=1) + np.finfo(float).tiny
            mean = cut[0] / size[0] + cut[2] / size[2]
            mean *= np.sqrt(size[0] * size[2]) / (np.linalg.norm(mean) + np.finfo(float).tiny)
            residual.append(np.sum((cut[1] - mean) ** 2) / (size[1] ** 2 + np.finfo(float).tiny))
    return 0.0, float(1.0 - np.median(residual))


PER_WAVE, DEPTH = 24, 2.0


def rayleigh_speeds(
    frequencies: ArrayLike, thickness: ArrayLike, vs: ArrayLike, poisson: float = 0.4
) -> np.ndarray:
    """Return phase speeds (n,) of the fundamental Rayleigh mode, m/s.

    Parameters
    ----------
    frequencies : (n,) float, Hz
    thickness : (n_layers - 1,) float, m
        The last layer is a half-space.
    vs : (n_layers,) float, m/s
    poisson : float
        Of all layers; a common density cancels.

    Notes
    -----
    Thin-layer method (Lysmer 1970; Kausel and Roesset 1981), theory.md (15.5): an eigenvalue
    problem in the wave number, linear in its square for (k u_x, i u_z), with 24 layers down to
    two wavelengths, where the ground is fixed.
    """
    thickness, vs = np.atleast_1d(np.asarray(thickness, float)), np.asarray(vs, float)
    if len(vs) != len(thickness) + 1 or (vs <= 0).any() or (thickness <= 0).any():
        raise InputError(
            f"rayleigh_speeds: need positive speeds, one more than thicknesses, got {vs} m/s and "
            f"{thickness} m"
        )
    return np.array([_speed(f, thickness, vs, poisson) for f in np.atleast_1d(frequencies)])


def _speed(frequency, thickness, vs, poisson):
    """Return the phase speed of the slowest mode at one frequency."""
    depth = DEPTH * vs.max() / frequency
    share = np.linspace(0.0, 1.0, PER_WAVE + 1) ** 1.6
    planes = np.unique(np.concatenate([depth * share, np.cumsum(thickness)]))
    planes = planes[planes <= depth]
    heights, middles = np.diff(planes), 0.5 * (planes[1:] + planes[:-1])
    mu = vs[np.searchsorted(np.cumsum(thickness), middles)] ** 2
    lame = mu * 2.0 * poisson / (1.0 - 2.0 * poisson)
    a, b, g, m = _matrices(heights, lame, mu)
    stiff = g - (2.0 * np.pi * frequency) ** 2 * m
    x, z = slice(0, None, 2), slice(1, None, 2)
    zero = np.zeros_like(b[x, z])
    lower = np.block([[stiff[x, x], zero], [b[z, x], stiff[z, z]]])
    upper = np.block([[a[x, x], b[x, z]], [zero, a[z, z]]])
    squares = linalg.eigvals(linalg.solve(upper, -lower))
    real = np.abs(squares.imag) < 1e-6 * np.abs(squares.real)
    return 2.0 * np.pi * frequency / np.sqrt(np.max(squares.real[real]))


def _matrices(heights, lame, mu):
    """Return A, B, G, M of (k^2 A + k B + G - omega^2 M) u = 0 for (u_x, i u_z) at planes."""
    n = 2 * len(heights)
    a, b, g, m = (np.zeros((n + 2, n + 2)) for _ in range(4))
    for k, (h, la, s) in enumerate(zip(heights, lame, mu, strict=True)):
        at = slice(2 * k, 2 * k + 4)
        p, d = la + 2.0 * s, la - s
        mass = h / 6.0 * np.array([[2, 0, 1, 0], [0, 2, 0, 1], [1, 0, 2, 0], [0, 1, 0, 2]])
        a[at, at] += mass * np.tile([p, s], 2)
        m[at, at] += mass
        e = la + s
        b[at, at] += 0.5 * np.array([[0, d, 0, -e], [d, 0, e, 0], [0, e, 0, -d], [-e, 0, -d, 0]])
        g[at, at] += np.array(
            [[s, 0, -s, 0], [0, p, 0, -p], [-s, 0, s, 0], [0, -p, 0, p]]
        ) / h  # fmt: skip
    return a[:n, :n], b[:n, :n], g[:n, :n], m[:n, :n]


PHASE_SPEEDS = np.arange(80.0, 700.0, 2.0)
N_PERMUTATIONS, N_FREQUENCIES, FEWEST = 999, 14, 6
N_NULL_STACKS, AGREED = 20, 0.1  # relative scatter of picks over bootstrapped shots
OUTLIER = 3.5  # standard deviations from a smooth curve
STARTS = ((2.0, 0.7, 1.2), (5.0, 0.7, 1.4), (10.0, 0.8, 1.8))
DEEPEST = 0.5  # of the longest wavelength, down to which Vs is given


@dataclass(frozen=True, eq=False)
class Picks:
    """Dispersion picks: phase speeds at frequencies, with standard deviations over shots."""

    frequency: np.ndarray
    speed: np.ndarray
    sigma: np.ndarray


def soft_layer(
    shots: Sequence[ShotGather],
    held: Sequence[ShotGather],
    band: tuple[float, float],
    *,
    poisson: float = 0.4,
    seed: int = 0,
) -> EffectDecision:
    """Test for a soft surface layer: dispersion of Rayleigh waves against a half-space.

    Parameters
    ----------
    shots, held : list of Shot
        To fit, and held out to test: other shots, preferably from the other end of the line.
    band : tuple of 2 float, Hz
        Band in which surface waves dominate.
    poisson : float
    seed : int

    Returns
    -------
    Decision
        "soft_surface_layer" with "thickness" [m], "vs_layer", "vs_below" and "vs_mean" [m/s], the
        time-averaged speed down to half the longest wavelength. ``held_out``: rms misfit of the
        held-out phase speeds in standard deviations, by one speed and by the layer; a name needs
        the layer to explain more than half of the squares that one speed leaves.

    Notes
    -----
    Permutation test of the rank correlation of phase speed and frequency, of all picks; the layer
    is fitted `without_outliers`. Inverse dispersion is "UNKNOWN", no soft layer. Neither a stiff
    layer, a gradient nor a second layer is tried.
    """
    if len(shots) < 3 or len(held) < 3:
        raise InputError(f"soft_layer: needs 3 shots to fit and 3 to judge, got {len(shots)}, "
                         f"{len(held)}")  # fmt: skip
    frequencies = np.geomspace(band[0], band[1], N_FREQUENCIES)
    raw, other = (phase_speeds(part, frequencies, seed=seed) for part in (shots, held))
    picks, other = without_outliers(raw), without_outliers(other)
    if min(len(picks.speed), len(other.speed)) < FEWEST:
        return EffectDecision("UNKNOWN", "soft_surface_layer",
                       "too few frequencies have one clear phase speed", band=band)  # fmt: skip
    steep = stats.spearmanr(raw.frequency, raw.speed)[0]
    rng = np.random.default_rng(seed)
    drawn = [abs(stats.spearmanr(raw.frequency, rng.permutation(raw.speed))[0])
             for _ in range(N_PERMUTATIONS)]  # fmt: skip
    p_value = permutation_p(abs(steep), drawn)
    one_speed = np.average(picks.speed, weights=picks.sigma**-2)
    if p_value > SIGNIFICANCE:
        return EffectDecision(
            "NULL", "soft_surface_layer",
            f"phase speeds do not depart from {one_speed:.0f} m/s significantly",
            band=band, p_value=p_value,
        )  # fmt: skip
    if steep > 0.0:
        return EffectDecision(
            "UNKNOWN", "soft_surface_layer", "waves of higher frequency are faster",
            band=band, p_value=p_value,
        )  # fmt: skip
    values, spread = fit_layer(picks, poisson)
    before = _misfit(other, np.full(len(other.speed), one_speed))
    after = _misfit(other, _speeds(values, other.frequency, poisson))
    left_out = len(raw.speed) - len(picks.speed)
    return EffectDecision(
        "NAMED" if after**2 < (1.0 - NEEDED) * before**2 else "UNKNOWN", "soft_surface_layer",
        f"phase speeds fall from {picks.speed[0]:.0f} to {picks.speed[-1]:.0f} m/s; misfit of "
        f"shots not fitted {before:.1f} standard deviations by one speed, {after:.1f} by the layer"
        + f"; {left_out} of {len(raw.speed)} picks are outliers and not fitted" * (left_out > 0),
        parameters=_with_intervals(values, spread, picks), band=band, p_value=p_value,
        held_out=(before, after),
    )  # fmt: skip


def phase_speeds(
    shots: Sequence[ShotGather], frequencies: np.ndarray, *, n_draws: int = 40, seed: int = 0
) -> Picks:
    """Pick phase speeds at the maxima of the phase stack over receivers, theory.md (15.4).

    A frequency is left out where bootstrapped sets of shots disagree, where the best speed is an
    end of the range, or where receivers of random phases stack as well.
    """
    rng = np.random.default_rng(seed)
    both = np.array([_stacked(shot, frequencies, rng) for shot in shots])
    powers, null = both[:, 0], both[:, 1:].mean(axis=0).max(axis=(0, 1))
    drawn = np.array([
        np.argmax(powers[rng.integers(len(shots), size=len(shots))].mean(axis=0), axis=0)
        for _ in range(n_draws)
    ])  # fmt: skip
    best, sigma = np.argmax(powers.mean(axis=0), axis=0), np.std(PHASE_SPEEDS[drawn], axis=0)
    most = powers.mean(axis=0).max(axis=0)
    clear = (best > 0) & (best < len(PHASE_SPEEDS) - 1) & (sigma < AGREED * PHASE_SPEEDS[best])
    clear &= most > null
    sigma = np.maximum(sigma, 0.01 * PHASE_SPEEDS[best])
    return Picks(frequencies[clear], PHASE_SPEEDS[best[clear]], sigma[clear])


def without_outliers(picks: Picks) -> Picks:
    """Leave out phase speeds that break an otherwise smooth curve, one at a time.

    Roughness is the sum of squares of the deviations of picks from the line through their two
    neighbours, each over its standard deviation. The pick without which it falls most is an
    outlier if it falls by 3.5 squared, or by 3.5 squared times the squared median deviation (in
    units of a normal one) if that is above 1.
    """
    used = np.arange(len(picks.speed))
    while len(used) > FEWEST:
        without = [float(np.sum(_bends(picks, np.delete(used, k)) ** 2)) for k in range(len(used))]
        worst = int(np.argmin(without))
        scale = max(1.0, 1.4826 * float(np.median(np.abs(_bends(picks, np.delete(used, worst))))))
        if np.sum(_bends(picks, used) ** 2) - without[worst] < (OUTLIER * scale) ** 2:
            break
        used = np.delete(used, worst)
    return Picks(picks.frequency[used], picks.speed[used], picks.sigma[used])


def _bends(picks, used):
    """Return deviations (n - 2,) of picks from the line through both neighbours, normalised."""
    x, speed, variance = np.log(picks.frequency[used]), picks.speed[used], picks.sigma[used] ** 2
    share = (x[1:-1] - x[:-2]) / (x[2:] - x[:-2])
    away = speed[1:-1] - (1.0 - share) * speed[:-2] - share * speed[2:]
    return away / np.sqrt(variance[1:-1] + (1.0 - share) ** 2 * variance[:-2]
                          + share**2 * variance[2:])  # fmt: skip


def _stacked(shot, frequencies, rng):
    """Return the power of the phase stack, then of random phases, (1 + 20, n_speeds, n)."""
    size = fft.next_fast_len(8 * shot.motion.shape[1], real=True)
    spectra = fft.rfft(shot.motion, size)[:, np.rint(frequencies * size * shot.dt).astype(int)]
    drawn = np.exp(2j * np.pi * rng.random((N_NULL_STACKS, *spectra.shape)))
    phases = np.concatenate([spectra[None] / np.maximum(np.abs(spectra), 1e-300), drawn])
    turns = np.exp(2j * np.pi * frequencies * shot.offsets[:, None, None] / PHASE_SPEEDS[:, None])
    stacks = [np.einsum("cf,csf->sf", phase, turns) for phase in phases]
    return np.abs(np.array(stacks) / len(spectra)) ** 2


def fit_layer(picks: Picks, poisson: float) -> tuple[np.ndarray, np.ndarray]:
    """Fit a layer: logarithms of thickness, Vs, Vs below, and their covariance."""
    fast = 1.06 * picks.speed

    def residual(x):
        return (_speeds(x, picks.frequency, poisson) - picks.speed) / picks.sigma

    starts = [np.log([h, a * fast.min(), b * fast.max()]) for h, a, b in STARTS]
    low, high = np.log([0.3, 40.0, 60.0]), np.log([40.0, 1500.0, 3000.0])
    fits = [optimize.least_squares(residual, np.clip(x, low, high), bounds=(low, high),
                                   diff_step=1e-2, max_nfev=25) for x in starts]  # fmt: skip
    best = min(fits, key=lambda fit: fit.cost)
    excess = max(1.0, 2.0 * best.cost / (len(picks.speed) - 3))
    return best.x, np.linalg.pinv(best.jac.T @ best.jac) * excess


def _speeds(values, frequencies, poisson):
    """Return phase speeds over one layer."""
    thickness, layer, below = np.exp(values)
    return rayleigh_speeds(frequencies, [thickness], [layer, below], poisson)


def _misfit(picks, speeds):
    """Return the rms misfit in standard deviations."""
    return float(np.sqrt(np.mean(((speeds - picks.speed) / picks.sigma) ** 2)))


def _with_intervals(values, covariance, picks):
    """Return the layer with 90 % intervals from draws of the Gaussian of the fit."""
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
