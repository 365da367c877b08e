"""Air blast: a pressure wave that travels over layered ground (theory.md 5.14)."""

from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np
from scipy import fft

from ...mesh.mesh import locate_in_zones
from ...model.material import Material
from ...project.places import extent_of, on_ground
from ...project.project import Project
from ..hypotheses import air_over_layers, hypothesis

QUALITY = 30.0  # of the ground, which resonates without loss where S waves are slower than air


def ground_response(layers, speed, depths, frequency):
    """Return the velocity of layered ground under a travelling pressure, per unit pressure.

    Parameters
    ----------
    layers : sequence of (thickness m or None, Material)
        Flat layers from the top down; the last is a half-space.
    speed : float, m/s
        Of the pressure p exp(i w (t - x/speed)) Pa.
    depths : (n_depths,) float, m
        Below the ground.
    frequency : (n,) float, Hz
        Positive.

    Returns
    -------
    (n_depths, 2, n) complex128, m/s/Pa
        Along x and upward.

    Notes
    -----
    Potentials that decay from the top and from the bottom of every layer, joined by four
    conditions at each interface: theory.md (5.14).
    """
    rate = 2.0 * np.pi * np.asarray(frequency, dtype=float)
    wave = rate / speed
    fields = [_Layer(rate, wave, thickness, rock) for thickness, rock in layers]
    size = 4 * len(fields) - 2
    table, loads = np.zeros((len(rate), size, size), complex), np.zeros((len(rate), size), complex)
    scale = (2.0 * layers[0][1].shear * wave)[:, None, None]
    units = np.concatenate([np.ones_like(scale)] * 2 + [scale] * 2, axis=1)
    table[:, :2, : fields[0].columns] = (fields[0].fields(0.0) / units)[:, 2:]
    loads[:, 1] = -1.0 / scale[:, 0, 0]
    row, column = 2, 0
    for upper, lower in pairwise(fields):
        after = column + upper.columns
        table[:, row : row + 4, column:after] = upper.fields(upper.thickness) / units
        table[:, row : row + 4, after : after + lower.columns] = -lower.fields(0.0) / units
        row, column = row + 4, after
    amplitude = np.linalg.solve(table, loads[..., None])[..., 0]
    moved = np.stack([_moved(fields, amplitude, depth) for depth in depths])
    return 1j * rate * moved * np.array([1.0, -1.0])[:, None]


def _moved(layers, amplitude, depth):
    """Return displacement (2, n) along x and downward at a depth."""
    column = 0
    for layer in layers[:-1]:
        if depth <= layer.thickness:
            break
        depth, column = depth - layer.thickness, column + layer.columns
    else:
        layer = layers[-1]
    chosen = amplitude[:, column : column + layer.columns]
    return np.einsum("nij,nj->in", layer.fields(depth)[:, :2], chosen)


class _Layer:
    """Waves of one frequency and one wave number in a layer.

    Two decay downward from its top, and two upward from its bottom if it has one.
    """

    def __init__(self, rate, wave, thickness, material):
        lost = 1.0 + 1.0j / QUALITY
        self.thickness, self.wave = thickness, wave
        self.shear, modulus = material.shear * lost, (material.bulk + 4 / 3 * material.shear) * lost
        slow = material.density * rate**2
        self.p = np.sqrt(wave**2 - slow / modulus)
        self.s = np.sqrt(wave**2 - slow / self.shear)
        self.twice = 2.0 * wave**2 - slow / self.shear
        self.columns = 2 if thickness is None else 4

    def fields(self, depth):
        """Return u_x, u_z, s_xz, s_zz (n, 4, columns) by amplitude at a depth in the layer."""
        down = [self._p(-1.0, depth), self._s(-1.0, depth)]
        if self.thickness is not None:
            over = self.thickness - depth
            down += [self._p(1.0, over), self._s(1.0, over)]
        return np.moveaxis(np.array(down), -1, 0).swapaxes(1, 2)

    def _p(self, sign, distance):
        """Return the fields (4, n) of a P wave that grows (1) or decays (-1) downward."""
        k, nu, mu = self.wave, sign * self.p, self.shear
        rows = np.array([-1j * k, nu, -2j * mu * k * nu, mu * self.twice])
        return rows / k * np.exp(-self.p * distance)

    def _s(self, sign, distance):
        """Return the fields (4, n) of an SV wave that grows (1) or decays (-1) downward."""
        k, nu, mu = self.wave, sign * self.s, self.shear
        rows = np.array([-nu, -1j * k + 0.0 * nu, -mu * self.twice, -2j * mu * k * nu])
        return rows / k * np.exp(-self.s * distance)


SAMPLED = 100  # heights from the ground to the bottom at which the material is looked up
HALVINGS = 40  # of the height between two of them, to the interface of layers


def layers_under(project: Project, x: float, y: float) -> list[tuple[float | None, Material]]:
    """Return thickness in m and material of the layers below the ground at a place.

    From the ground down, None for the thickness of the lowest; layers thinner than a hundredth of
    the depth of the model may be missed.

    Raises
    ------
    InputError
        If there is no ground there.
    """
    mesh, bottom = project.mesh, extent_of(project)[2, 0]
    top = on_ground(mesh, (x, y))[2]

    def group(depths):
        places = [(x, y, top - depth) for depth in np.atleast_1d(depths)]
        return mesh.zone_group[locate_in_zones(mesh, places)[0]]

    depths = (np.arange(SAMPLED) + 0.5) / SAMPLED * (top - bottom)
    own, layers, above = group(depths), [], 0.0
    for k in np.flatnonzero(np.diff(own)):
        over, under = depths[k], depths[k + 1]
        for _ in range(HALVINGS):
            middle = 0.5 * (over + under)
            over, under = (middle, under) if group(middle)[0] == own[k] else (over, middle)
        layers.append((float(over - above), project.materials[mesh.groups[own[k]]]))
        above = over
    return [*layers, (None, project.materials[mesh.groups[own[-1]]])]


_COLUMNS: WeakKeyDictionary = WeakKeyDictionary()  # of each case


def _columns(case):
    """Return the receivers of a case over the same layers, with these and their depths in m."""
    if case not in _COLUMNS:
        project, rows = case.project, {}
        stations = {r.name: r.position for r in project.receivers}
        for r, name in enumerate(case.receivers):
            x, y, z = stations[name]
            layers = tuple(layers_under(project, x, y))
            key = tuple((t and round(t, 6), rock) for t, rock in layers)
            depth = on_ground(project.mesh, (x, y))[2] - z
            known = next((row for row in rows.values() if row[0] == key), None)
            known = rows.setdefault(r, (key, layers, [], [])) if known is None else known
            known[2].append(r)
            known[3].append(depth)
        _COLUMNS[case] = [row[1:] for row in rows.values()]
    return _COLUMNS[case]


AFAR = 100.0  # m: where the pressure of 1 kg is given
GROWTH = 0.45  # of the pressure with the charge: (r/W^(1/3))^-1.35, between usual 1.2 and 1.45
AHEAD = 3.0  # widths of the pulse before its middle that it begins


@hypothesis(
    "air_blast",
    family="receiver",
    on="motion",
    target="site",
    axis="both",
    decided_by="a microphone beside a receiver, or a receiver some metres deep",
    simulated=(air_over_layers,),
)
def air_blast(scene, motion, target, pressure, period, speed, decay, radial):
    """A pressure wave through the air runs over the ground and moves it as it passes.

    The ground around each receiver counts as level: what the wave does to it decays within a
    wavelength in air.
    """
    del target
    case, n = scene.case, motion.shape[-1]
    size = fft.next_fast_len(2 * n, real=True)
    frequency = fft.rfftfreq(size, case.dt)
    pulse = pressure * pulse_spectrum(frequency, period)
    positions = {r.name: np.array(r.position) for r in case.project.receivers}
    axes = {r.name: r.azimuth for r in case.project.receivers}
    moved = np.zeros((len(case.receivers), 2, len(frequency)), complex)
    for layers, own, depths in _columns(case):
        moved[own, :, 1:] = ground_response(layers, speed, depths, frequency[1:])
    moved *= pulse / case.dt
    moved[:, 0] *= radial
    change = np.empty_like(motion)
    for b, name in enumerate(case.blasts):
        blast = case.project.blasts[name]
        for r, receiver in enumerate(case.receivers):
            path = positions[receiver][:2] - blast.collar[:, :2]
            distance = np.linalg.norm(path, axis=1)
            share = blast.charge**GROWTH * (np.maximum(distance, speed * period) / AFAR) ** -decay
            lag = blast.times + distance / speed
            share = np.where(lag < case.duration, share, 0.0)
            along = share[:, None] * np.exp(-2j * np.pi * np.multiply.outer(lag, frequency))
            east, north = (path / np.maximum(distance, 1e-9)[:, None]).T @ along
            if axes[receiver] is not None:
                east, north = along_axes(east, north, axes[receiver])
            spectrum = [east * moved[r, 0], north * moved[r, 0], along.sum(axis=0) * moved[r, 1]]
            change[b, r] = fft.irfft(spectrum, size)[..., :n]
    return motion + change


def along_axes(east, north, azimuth):
    """Return longitudinal and transverse components, of an azimuth in rad."""
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    return sine * east + cosine * north, cosine * east - sine * north


def pulse_spectrum(frequency, period):
    """Return the Fourier transform in s of a pulse of pressure, then suction, of peak one.

    -x exp((1 - x^2)/2) with x = (t - AHEAD s)/s and s = period/(2 pi), at which it is loudest.
    """
    s = period / (2.0 * np.pi)
    turn = 2.0 * np.pi * np.asarray(frequency) * s
    return s * np.sqrt(2.0 * np.pi * np.e) * 1j * turn * np.exp(-0.5 * turn**2 - 1j * AHEAD * turn)
