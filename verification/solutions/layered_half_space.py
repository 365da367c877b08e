"""Motion of a layered half space by a buried double couple, by integration over wavenumbers.

Global matrix of plane waves at every frequency and wavenumber (Chin, Hedstrom & Thigpen 1984),
summed over discrete wavenumbers at complex frequencies (Bouchon 1981). Depth points down, fields
vary as e^(i k x - i omega t).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import jv

DECAY = 7.0  # e-folds of the artificial fading over the window
GRACE = 10.0  # e-folds that waves evanescent at the source lose before the sum ends


@dataclass(frozen=True)
class Bed:
    """A layer: thickness in m (infinite: the half space), density, and moduli as functions.

    Parameters
    ----------
    thickness, density : float
    p_modulus, shear : callable
        ``modulus(omega)`` in Pa at complex angular frequencies.
    """

    thickness: float
    density: float
    p_modulus: object
    shear: object

    @classmethod
    def of(cls, thickness, material):
        """Make a bed of a material, elastic or of constant quality."""
        law, stiff = material.law, material.density * material.cp**2
        if not law.branches:
            return cls(
                thickness, material.density, lambda _: stiff + 0j, lambda _: material.shear + 0j
            )
        lame, shear = law.moduli(material)

        def modulus(relaxed, wave):
            def at(omega):
                lag = -1j * omega
                springs = ((getattr(one, wave), one.rate) for one in law.branches)
                return relaxed * (1.0 + sum(stiff * lag / (rate + lag) for stiff, rate in springs))

            return at

        return cls(
            thickness,
            material.density,
            modulus(lame + 2.0 * shear, "compression"),
            modulus(shear, "shear"),
        )


def cut(beds, depths):
    """Return the beds cut at depths, so that each depth is an interface."""
    pieces, top = [], 0.0
    for bed in beds:
        bottom = top + bed.thickness
        stops = [top, *sorted(d for d in set(depths) if top < d < bottom), bottom]
        for low, high in pairwise(stops):
            pieces.append(Bed(high - low, bed.density, bed.p_modulus, bed.shear))
        top = bottom
    return pieces


def plane_waves(bed, omega, k):
    """Return matrices (n, 4, 4) of down P, S and up P, S, and their vertical wavenumbers (n, 2).

    Rows are horizontal and vertical displacement, shear and normal traction on a level.
    """
    shear = bed.shear(omega)
    down_p = np.sqrt(k**2 - bed.density * omega**2 / bed.p_modulus(omega))
    down_s = np.sqrt(k**2 - bed.density * omega**2 / shear)
    twist = shear * (2.0 * k**2 - bed.density * omega**2 / shear)
    slant_p, slant_s = 2j * k * shear * down_p, 2j * k * shear * down_s
    ik = 1j * k
    columns = (
        (ik, -down_p, -slant_p, twist),
        (down_s, ik, -twist, -slant_s),
        (ik, down_p, slant_p, twist),
        (-down_s, ik, -twist, slant_s),
    )
    return np.moveaxis(np.array(columns), -1, 0).swapaxes(1, 2), np.stack([down_p, down_s], -1)


def transverse_waves(bed, omega, k):
    """Return the same for SH waves, matrices (n, 2, 2) of down and up, wavenumbers (n, 1)."""
    shear = bed.shear(omega)
    down = np.sqrt(k**2 - bed.density * omega**2 / shear)
    one = np.ones_like(down)
    columns = ((one, -shear * down), (one, shear * down))
    return np.moveaxis(np.array(columns), -1, 0).swapaxes(1, 2), down[:, None]


def response(beds, waves, omega, k, source, receiver, free=True, joint=None):
    """Return displacement over force at two interfaces, (n, m, m): row motion, column force.

    Parameters
    ----------
    beds : sequence of Bed
        Cut at source and receiver.
    waves : callable
        `plane_waves` (m = 2) or `transverse_waves` (m = 1).
    omega : complex, rad/s
    k : (n,) float, 1/m
    source, receiver : int
        Number of the interface, from 0 at the ground; the source is not at the ground.
    free : bool
        Whether the ground is free; else the uppermost bed goes on above it.
    joint : tuple of int and (m,) float, optional
        Interface that slips and opens by its traction over a stiffness in Pa/m.
    """
    shapes, slowness = zip(*(waves(bed, omega, k) for bed in beds), strict=True)
    m = slowness[0].shape[1]
    size = 2 * m * (len(beds) - 1) + m
    stiff = abs(beds[-1].shear(omega)) * abs(omega) / 1e3  # evens out rows of motion and traction
    scale = np.r_[np.ones(m), np.full(m, stiff)][:, None]
    matrix = np.zeros((len(k), size, size), complex)
    forces = np.zeros((len(k), size, m), complex)
    fading = [np.exp(-s * b.thickness) for s, b in zip(slowness[:-1], beds, strict=False)]
    first = shapes[0] / scale
    if free:
        matrix[:, :m, :m] = first[:, m:, :m]
        matrix[:, :m, m : 2 * m] = first[:, m:, m:] * fading[0][:, None, :]
    else:
        matrix[:, :m, :m] = np.eye(m)
    for j in range(len(beds) - 1):
        rows = slice(m + 2 * m * j, 3 * m + 2 * m * j)
        at, after = 2 * m * j, 2 * m * (j + 1)
        above, below = shapes[j] / scale, shapes[j + 1] / scale
        if joint is not None and j + 1 == joint[0]:  # motion below is that above, and the slip
            above = above.copy()
            above[:, :m] += shapes[j][:, m:] / np.asarray(joint[1])[:, None]
        matrix[:, rows, at : at + m] = -above[:, :, :m] * fading[j][:, None, :]
        matrix[:, rows, at + m : after] = -above[:, :, m:]
        matrix[:, rows, after : after + m] = below[:, :, :m]
        if j + 2 < len(beds):
            matrix[:, rows, after + m : after + 2 * m] = below[:, :, m:] * fading[j + 1][:, None]
        if j + 1 == source:
            forces[:, rows.start + m : rows.stop] = -np.eye(m) / stiff
    unknown = np.linalg.solve(matrix, forces)
    at = 2 * m * receiver
    motion = shapes[receiver][:, :m, :m] @ unknown[:, at : at + m]
    if receiver < len(beds) - 1:
        up = shapes[receiver][:, :m, m:] * fading[receiver][:, None, :]
        motion = motion + up @ unknown[:, at + m : at + 2 * m]
    return motion


def strike_slip(beds, depth, offset, receiver_depth, omega, k, free=True, joint=None):
    """Return displacement over a moment Mxy = Myx, (3,) m/(N m), along radius, across and down.

    Parameters
    ----------
    beds : sequence of Bed
    depth, receiver_depth : float, m
    offset : (2,) float, m
        Along x and y.
    omega : complex, rad/s
    k : (n,) float, 1/m
        Even, from zero.
    free : bool
    joint : tuple of 3 float, optional
        Depth in m, normal and shear stiffness in Pa/m of a plane that slips and opens.
    """
    pieces = cut(beds, (depth, receiver_depth, *(() if joint is None else joint[:1])))
    levels = np.cumsum([0.0, *(b.thickness for b in pieces[:-1])])
    source, receiver = (int(np.argmin(np.abs(levels - d))) for d in (depth, receiver_depth))
    slips = [None, None]
    if joint is not None:
        at, (kn, ks) = int(np.argmin(np.abs(levels - joint[0]))), joint[1:]
        slips = [(at, (ks, kn)), (at, (ks,))]
    along, across = (
        response(pieces, waves, omega, k[1:], source, receiver, free, slip)
        for waves, slip in zip((plane_waves, transverse_waves), slips, strict=True)
    )
    across = across[:, 0, 0]
    radius, turn = np.hypot(*offset), 2.0 * np.arctan2(offset[1], offset[0])
    one, two, three = (jv(n, k[1:] * radius) for n in (1, 2, 3))
    weight = k[1:] ** 2 * k[1] / (4.0 * np.pi)
    radial = np.sum(weight * (along[:, 0, 0] * (one - three) + across * (one + three)))
    transverse = np.sum(weight * (along[:, 0, 0] * (one + three) + across * (one - three)))
    down = 2j * np.sum(weight * along[:, 1, 0] * two)
    return np.array([radial * np.sin(turn), transverse * np.cos(turn), down * np.sin(turn)])


def strike_slip_motion(
    beds, depth, offset, times, moment_rate, highest, receiver_depth=0.0, free=True, joint=None
):
    """Return the velocity (n, 3) of the ground east, north, up by a moment Mxy.

    Parameters
    ----------
    beds : sequence of Bed
    depth : float, m
    offset : (2,) float, m
    times : (n,) float, s
    moment_rate : callable
        N m/s at times.
    highest : float, Hz
        Where the moment rate has nothing more to give.
    receiver_depth : float, m
    free, joint
        As in `strike_slip`.
    """
    window = 1.3 * times.max()
    fade = DECAY / window
    fastest = max(np.sqrt(abs(b.p_modulus(1e6)) / b.density) for b in beds)
    slowest = min(np.sqrt(abs(b.shear(1e-6)) / b.density) for b in beds)
    omega = 2.0 * np.pi * np.arange(np.ceil(highest * window)) / window + 1j * fade
    step = 2.0 * np.pi / (2.0 * (np.hypot(*offset) + fastest * window))
    samples = np.linspace(0.0, window, 4000)
    spectrum = np.exp(1j * np.outer(omega, samples)) @ moment_rate(samples) * samples[1]
    motion = np.zeros((len(times), 3))
    for w, amplitude in zip(omega, spectrum, strict=True):
        k = np.arange(0.0, 1.2 * abs(w) / slowest + GRACE / abs(depth - receiver_depth), step)
        # Moment times -i omega is moment rate, displacement times -i omega is velocity.
        field = strike_slip(beds, depth, offset, receiver_depth, w, k, free, joint) * amplitude
        share = 1.0 if w.real > 0.0 else 0.5
        motion += 2.0 * share / window * np.real(np.exp(-1j * w * times)[:, None] * field)
    along = np.asarray(offset) / np.hypot(*offset)
    across = np.array([-along[1], along[0]])
    flat = motion[:, :1] * along + motion[:, 1:2] * across
    return np.column_stack([flat, -motion[:, 2]])
