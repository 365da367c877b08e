"""Rupture of a plane fault in an infinite medium by a spectral boundary integral.

Source: Geubelle & Rice (1995), with the kernels of modes II and III integrated over steps of
constant slip velocity; linear slip weakening. The fault lies in x, z; slip along x is even and slip
along z odd in both coordinates, so that a quarter of the plane is enough.
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import dct, dst, idct, idst
from scipy.interpolate import CubicSpline
from scipy.special import itj0y0, j0, j1

KERNEL_STEP = 0.02


@dataclass(frozen=True)
class Weakening:
    """Strength that falls in proportion to slip.

    Parameters
    ----------
    pressure : float, Pa
    static, dynamic : float
        Friction before any slip, and after the weakening slip.
    slip : float, m
    """

    pressure: float
    static: float
    dynamic: float
    slip: float

    def strength(self, slipped):
        """Return the strength in Pa after some slip in m."""
        left = np.clip(1.0 - slipped / self.slip, 0.0, 1.0)
        return self.pressure * (self.dynamic + left * (self.static - self.dynamic))


def kernel(mode, times, ratio):
    """Return the kernel of mode 2 or 3 at ``T = k cs t``, ratio cp/cs.

    ``C3 = J1(T)/T``; ``C2 = C3 + 3 J0(T) + 4 T [A(T) - A(rT)] - 4/r J0(rT)``, A the integral of
    ``J1(x)/x``: the inverse of ``[(1 + a^2)^2 - 4 a b]/(a s^2) - s``, ``a^2 = 1 + s^2``,
    ``b^2 = 1 + (s/r)^2``.
    """
    times = np.asarray(times, dtype=float)
    antiplane = np.where(times > 0.0, j1(times) / np.where(times > 0.0, times, 1.0), 0.5)
    if mode == 3:
        return antiplane

    def passed(x):
        return itj0y0(x)[0] - j1(x)

    far = 4.0 * times * (passed(times) - passed(ratio * times))
    return antiplane + 3.0 * j0(times) + far - 4.0 / ratio * j0(ratio * times)


def step_weights(mode, k, ratio, rate, n_steps):
    """Return what slip at unit velocity in one step does m steps later, (n_steps, n) 1/Pa of mu.

    Per shear modulus: ``-(k/2) int K(k cs t') dt'`` over the step, K the integral of the kernel.

    Parameters
    ----------
    mode : int
    k : (n,) float, 1/m
    ratio : float
        cp/cs.
    rate : float, m
        cs times the step.
    n_steps : int
    """
    highest = k.max() * rate * (n_steps + 1)
    grid = np.arange(0.0, highest + 3.0 * KERNEL_STEP, KERNEL_STEP)
    twice = CubicSpline(grid, kernel(mode, grid, ratio)).antiderivative(2)
    weights = np.empty((n_steps, len(k)))
    before = np.zeros(len(k))
    for m in range(n_steps):
        after = twice(k * rate * (m + 1))
        weights[m] = 0.5 * (before - after)
        before = after
    return weights


class _Plane:
    """Cosines and sines on a quarter of a plane of half-sampled cells."""

    def __init__(self, shape, cell):
        kx, kz = (np.pi * np.arange(n) / (n * cell) for n in shape)
        self.kx, self.kz = np.meshgrid(kx, kz, indexing="ij")
        self.k = np.hypot(self.kx, self.kz)
        self.k[0, 0] = 1.0
        self.kx, self.kz = self.kx / self.k, self.kz / self.k

    def forward(self, slip):
        """Return the parts along and across the wavenumber of slip (2, nx, nz)."""
        even = dct(dct(slip[0], axis=0, norm="ortho"), axis=1, norm="ortho")
        odd = np.zeros_like(even)
        sines = dst(dst(slip[1], axis=0, norm="ortho"), axis=1, norm="ortho")
        odd[1:, 1:] = sines[:-1, :-1]
        return np.stack([self.kx * even - self.kz * odd, -self.kz * even - self.kx * odd])

    def back(self, parts):
        """Return the field (2, nx, nz) of parts along and across the wavenumber."""
        even = self.kx * parts[0] - self.kz * parts[1]
        odd = -(self.kz * parts[0] + self.kx * parts[1])
        sines = np.zeros_like(odd)
        sines[:-1, :-1] = odd[1:, 1:]
        return np.stack(
            [
                idct(idct(even, axis=0, norm="ortho"), axis=1, norm="ortho"),
                idst(idst(sines, axis=0, norm="ortho"), axis=1, norm="ortho"),
            ]
        )


def rupture(material, law, loaded, fault, cell, shape, duration, passed, courant=0.35):
    """Let a fault break; return cell centres and the time at which each has slipped some way.

    Parameters
    ----------
    material : Material
    law : Weakening
    loaded : callable
        ``loaded(x, z)``: shear stress along x before the rupture, averaged over cells, Pa,
        at places that broadcast.
    fault : (2,) float, m
        Half lengths along x and z; outside nothing slips.
    cell : float, m
    shape : (2,) int
        Cells of the quarter plane along x and z: mirrored and repeated, it must be so wide that
        the waves of its images come late.
    duration : float, s
    passed : float, m
        The slip whose time is taken.
    courant : float
        cs times the step over the cell.

    Returns
    -------
    x, z : (n,) float, m
    start : (nx, nz) float, s
        Infinite where slip stays below ``passed``.
    slip : (nx, nz) float, m
        Along x, at the end.
    """
    x, z = (cell * (np.arange(n) + 0.5) for n in shape)
    held = (x[:, None] > fault[0]) | (z[None, :] > fault[1])
    dt = courant * cell / material.cs
    n_steps = int(np.ceil(duration / dt))
    plane = _Plane(shape, cell)
    ratio, k = material.cp / material.cs, plane.k.ravel()
    weights = np.stack([step_weights(m, k, ratio, courant * cell, n_steps) for m in (2, 3)], 1)
    # From angle to stress: mu, and slip velocity times cs dt over the k of the kernel's argument.
    weights *= material.shear / material.cs
    weights[:, :, 0] = 0.0
    damping = 0.5 * material.shear / material.cs
    stress = np.stack([loaded(x[:, None], z[None, :]), np.zeros(shape)])
    history = np.empty((n_steps, 2, len(k)))
    slip, path = np.zeros((2, *shape)), np.zeros(shape)
    start = np.full(shape, np.inf)

    def moving(field, length):
        """Return the slip velocity (2, nx, nz) under a stress."""
        size = np.hypot(*field)
        excess = np.maximum(0.0, size - law.strength(length)) / damping
        return np.where(held, 0.0, excess / np.maximum(size, 1.0)) * field

    velocity = moving(stress, path)
    for n in range(n_steps):
        past = np.einsum("jmk,jmk->mk", weights[1 : n + 1], history[:n][::-1]) if n else 0.0

        def field(speed, past=past):
            """Return the stress at the end of this step, and the step's part of the history."""
            part = plane.forward(speed).reshape(2, -1)
            change = plane.back((past + weights[0] * part).reshape(2, *shape))
            return stress + change, part

        guess, _ = field(velocity)
        ahead = moving(guess, path + dt * np.hypot(*velocity))
        mean = 0.5 * (velocity + ahead)
        total, history[n] = field(mean)
        speed = np.hypot(*mean)
        new = np.isinf(start) & (path + dt * speed >= passed)
        start[new] = n * dt + (passed - path[new]) / speed[new]
        slip, path = slip + dt * mean, path + dt * speed
        velocity = moving(total, path)
    return x, z, start, slip[0]
