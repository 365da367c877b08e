"""Accuracy: expected error of waveform and peak at each receiver, and the band that a run holds."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import prod

import numpy as np
from scipy.spatial import KDTree

from ..core import JOINT_LAWS
from ..mesh.mesh import zone_edge_lengths
from ..model.boundary import Fixed, FreeField, Roller, StressInput, VelocityInput, Viscous
from ..model.joint import Joint
from ..model.material import ConstantQ
from ..model.model import Model
from ..signals.seismogram import Seismogram, fast_length
from ..signals.spectra import highest_frequency
from ..solver.assembly import time_step
from ..solver.initial_stress import insitu_stress
from ..solver.injection import injected_sources, receivers_beside
from ..solver.moment_density import NearReceiver, flat_response, sheared_width
from ..sources.inside import LOST, phase_error
from .recipe import NODES_FOR_ONE_PER_CENT, WAVELENGTHS, convergence

LEAST_ENERGY, LEAST_PEAK = 0.95, 0.9  # shares of the blast's motion that a run has to hold
HELD = 1.0 / 3.0  # share of the peak of the blast, below which a run is of another blast
PERIODS = 20.0  # of the lowest frequency that is lost, around a pulse
SAMPLES = 200  # along the way to a receiver
THIN = 8.0  # layers thinner than a wavelength over this move as one
STIFF = 0.5  # S speed over that around the sources, of ground through which waves come
# As `PHASE` of tetrahedra at as many edges per wavelength, and the power with which it falls.
TETRAHEDRA = {"quadratic": (0.05, 3.0, 3.5), "linear": (0.12, 10.0, 2.0)}
PRESSED = {"quadratic": 4.5, "linear": 1.5}  # times it for P waves, by their own wavelength
# Of the motion, what layers of hexahedra send back: more where waves run along them, on paths over
# three times their distance.
LAYER, GRAZING, GROWTH, MOST_GRAZING = 0.008, 3.0, 1.5, 0.12
LEAST_TURN = 2.0 * np.pi  # rad of a way, whose share the step takes at entering
LOW = 0.15  # of the energy of the motion, below the frequency by which viscous sides are judged
MARGIN = 1.1  # over what they send back by theory.md (4.5c), and over laws of P waves alone
WIDER, WIDEST = 10.0, 1000.0  # m, steps of padding that would send less back
BEND, BENT = 0.1, 0.08  # of an edge, beyond which a plane bends in the layer; its error
DEEP = 1e6  # m, where no surface is free
HARMONICS = "harmonics"  # part of the error of a run
AMISS = 1.1  # over motion that comes late or rings, as the right one is missing in its place
TAPER = 8.0  # periods of the highest carried frequency beyond the end of a record
FOUND = 3.0  # times the accuracy asked for, from which on an expected error is a finding


@dataclass(frozen=True)
class ReceiverError:
    """Expected error of a run at one receiver.

    Parameters
    ----------
    name : str
    carried : float, Hz
        Highest frequency that the mesh carries on the way from the sources.
    limited_by : str
        The ground on that way that carries least.
    parts : dict of str to float
        Error of the waveform over the motion (root of the energies), by cause: "mesh",
        "step", "slip", "low-pass", "quality", "sphere", "sides", "joint in the layer",
        "near source", and of a run "harmonics".
    peak : float
        Expected error of the peak.
    near : NearReceiver or None
        The source beside it that elements do not resolve.
    """

    name: str
    carried: float
    limited_by: str
    parts: dict[str, float]
    peak: float
    near: NearReceiver | None = None

    @property
    def waveform(self) -> float:
        """Expected error of the waveform over the motion."""
        return float(np.linalg.norm(list(self.parts.values())))

    @property
    def cause(self) -> str:
        """The largest part of the error."""
        return max(self.parts, key=lambda name: self.parts[name])


@dataclass(frozen=True)
class Band:
    """Frequencies of a run beside those of its blast.

    Parameters
    ----------
    carried, needed : float, Hz
        What the mesh carries at all receivers; below what 95 % of the energy of the motion lies
        that enters, before any low-pass.
    limited_by : str
        Ground that sets ``carried``; of the thinnest waves where nothing is received.
    energy_share, peak_share : float
        What the run holds of the energy and of the peak of that motion.
    """

    carried: float
    needed: float
    limited_by: str
    energy_share: float
    peak_share: float

    @property
    def of_its_blast(self) -> bool:
        """Whether the run holds enough of its blast to be one of it, in whatever band."""
        return self.peak_share >= HELD and self.energy_share >= HELD**2

    @property
    def complete(self) -> bool:
        """Whether peaks, frequencies and limits may be compared."""
        return self.energy_share >= LEAST_ENERGY and self.peak_share >= LEAST_PEAK

    def table(self) -> dict:
        """Return the table ``band`` of a summary."""
        return {
            "carried_hz": self.carried, "needed_hz": self.needed, "limited_by": self.limited_by,
            "energy_share": self.energy_share, "peak_share": self.peak_share,
            "complete": self.complete,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Accuracy of the run of a model.

    Parameters
    ----------
    model : Model
    before, after : tuple of Seismogram
        Motions that enter, one for each kind of source, before and after their low-passes.
    start : callable
        ``(position (3,) of a receiver) -> (3,)`` in m, where its waves come from.
    heights : mapping of str to float, m
        Of layers, by their ground.
    inside : bool
        Whether sources stand in the ground, whose waves graze its sides.
    """

    model: Model
    before: tuple[Seismogram, ...]
    after: tuple[Seismogram, ...]
    start: Callable[[np.ndarray], np.ndarray]
    heights: Mapping[str, float]
    inside: bool = True

    @cached_property
    def rows(self) -> tuple[ReceiverError, ...]:
        """The expected error at each receiver.

        Notes
        -----
        The mesh delays each frequency by the rule of nodes per wavelength; constant Q is fitted by
        mechanisms; a low-pass takes its share of the spectrum of what enters, after its attenuation
        by Q; tables say what elements make of motion near a source, and what sides send back.
        Central differences lead on hexahedra; a layer over stiffer ground repeats the delay of its
        mesh; a joint that slips clips what enters through a face, whose corners the mesh delays and
        rounds over its strength. What enters through a face comes back from the end across and
        from joints, on a longer way; dashpots have no impedance of ground with constant Q.
        """
        near = {row.receiver: row for row in receivers_beside(self.model)}
        return tuple(
            self._row(each.name, np.asarray(each.position, dtype=float), near.get(each.name))
            for each in self.model.receivers
        )

    def of_run(self, simulated: Mapping[str, Seismogram]) -> tuple[ReceiverError, ...]:
        """Return the expected errors with harmonics in the records of a run.

        Where joints or ground are not linear, they put motion there that no input has. Above what
        the mesh carries it does not leave, as waves of that length hardly travel in it, and rings
        on. Its part is what the delay of the mesh changes of it there, at most all of it, beyond
        what the parts of mesh and slip say.

        Parameters
        ----------
        simulated : mapping of str to Seismogram
            By receiver.
        """
        laws = (JOINT_LAWS[joint.law].linear for joint in self.model.joints)
        if all(laws) and not any(each.yields for each in self.model.materials.values()):
            return self.rows
        places = {each.name: np.asarray(each.position) for each in self.model.receivers}
        return tuple(
            self._with_harmonics(row, places[row.name], simulated[row.name]) for row in self.rows
        )

    def _with_harmonics(self, row, position, record):
        """Return the expected error at a receiver with what the mesh changes of its record."""
        velocity = _tapered(np.nan_to_num(record.velocity), TAPER / (row.carried * record.dt))
        length = fast_length(2 * len(velocity))
        frequency = np.fft.rfftfreq(length, record.dt)
        change = 1.0 - self._changes(frequency, *self._course(self._way(position)))[0]
        change *= (frequency > row.carried)[:, None] / np.maximum(np.abs(change), 1.0)
        wrong = np.fft.irfft(change * np.fft.rfft(velocity, length, axis=0), length, axis=0)
        wrong = wrong[: len(record.velocity)]
        size = np.linalg.norm(velocity[: len(record.velocity)], axis=1)
        whole = AMISS * float(np.linalg.norm(wrong) / max(np.linalg.norm(size), 1e-300))
        stated = np.hypot(row.parts.get("mesh", 0.0), row.parts.get("slip", 0.0))
        part = np.sqrt(max(0.0, whole**2 - stated**2))
        peak = np.linalg.norm(wrong[size.argmax()]) / max(size.max(), 1e-300)
        peak *= part / max(whole, 1e-300)
        parts = row.parts | {HARMONICS: float(part)}
        return replace(row, parts=parts, peak=float(np.hypot(row.peak, peak)))

    @cached_property
    def band(self) -> Band:
        """The band of the run beside that of its blast."""
        needed = max(highest_frequency(motion) for motion in self.before)
        if self.rows:
            least = min(self.rows, key=lambda row: row.carried)
            carried, ground = least.carried, least.limited_by
        else:
            by_group = self.model.highest_frequency()
            ground = min(by_group, key=lambda name: by_group[name])
            carried = by_group[ground]
        pairs = zip(self.before, self.after, strict=True)
        energy, peak = np.min([held_shares(*pair, carried) for pair in pairs], axis=0)
        return Band(carried, needed, ground, float(energy), float(peak))

    @cached_property
    def _zones(self):
        """Tree of the middles of zones, and their mean edges (n,) in m."""
        mesh = self.model.mesh
        return KDTree(mesh.points[mesh.zones].mean(axis=1)), zone_edge_lengths(mesh).mean(axis=1)

    @cached_property
    def _longest(self):
        """Longest edge (n_groups,) in m of each ground."""
        mesh, edges = self.model.mesh, zone_edge_lengths(self.model.mesh).max(axis=1)
        longest = np.zeros(len(mesh.groups))
        np.maximum.at(longest, mesh.zone_group, edges)
        return longest

    @cached_property
    def _bent(self):
        """Error by planes of joints that leave themselves in the absorbing layer."""
        mesh = self.model.mesh
        if mesh.layer is None:
            return 0.0
        for joint in self.model.joints:
            points = mesh.points[np.unique(mesh.surfaces[joint.surface])]
            beyond = mesh.layer.depths(points).max(axis=1) > 0.0
            middle = points[~beyond].mean(axis=0) if (~beyond).sum() > 2 else None
            if middle is None or not beyond.any():
                continue
            across = np.linalg.svd(points[~beyond] - middle)[2][-1]
            away = np.abs((points - middle) @ across)
            if away[beyond].max() > away[~beyond].max() + BEND * self._longest.max():
                return BENT
        return 0.0

    @cached_property
    def _sheared(self):
        """R/cs in s of the sphere of a source that radiates S waves; theory.md (5.15)."""
        return sheared_width(self.model, injected_sources(self.model))

    @cached_property
    def _speeds(self):
        """S speeds (n_zones,) in m/s."""
        return self.model.zone_values("cs")

    def _sides(self, points):
        """Return the share of the motion that the sides send back to the end of a way."""
        layer = self.model.mesh.layer
        if layer is not None:
            along = points @ np.array(layer.frame, dtype=float).T
            away = np.abs(np.array(layer.inner, dtype=float) - along[:, :, None]).min()
            path = np.linalg.norm(points[-1] - points[0])
            ratio = path / max(away, 0.5 * float(self._zones[1].max()))
            return min(LAYER * max(1.0, ratio / GRAZING) ** GROWTH, MOST_GRAZING)
        return self._sent_back(points) if self.inside and self._viscous else 0.0

    @cached_property
    def _viscous(self):
        """Trees of the nodes of viscous sides, by their names."""
        mesh = self.model.mesh
        names = {each.surface for each in self.model.boundaries if isinstance(each, Viscous)}
        return {n: KDTree(mesh.points[np.unique(mesh.surfaces[n])]) for n in sorted(names)}

    @cached_property
    def _low(self):
        """Frequency in Hz below which the share LOW of the energy of the motion lies."""
        least = [0.25 / (each.dt * len(each.velocity)) for each in self.after]
        return min(map(max, (highest_frequency(each, LOW) for each in self.after), least))

    def _sent_back(self, points, wider=0.0):
        """Return the share of the motion by viscous sides, but the top farther away by some m.

        Of the image of the source in each side, by plane waves and, as dashpots are made for those,
        by what a wave from a point differs from them; theory.md (4.5c).
        """
        beside = np.array([name != "top" for name in self._viscous])
        ends, sponge = points[[0, -1]], self.model.sponge
        path = np.linalg.norm(ends[1] - ends[0])
        away = np.array([tree.query(ends)[0] for tree in self._viscous.values()])
        away += wider * beside[:, None]
        across = away.sum(axis=1)
        image = np.hypot(across, np.sqrt(np.maximum(0.0, path**2 - np.ptp(away, axis=1) ** 2)))
        cosine, speed = across / image, float(self._speeds[self._zones[0].query(points)[1]].mean())
        plane = (1.0 - cosine) / (1.0 + cosine)
        if sponge is not None:
            own = replace(sponge, width=sponge.width + wider)
            plane = np.where(beside, own.reflection(cosine, self._low, speed), plane)
        round_off = speed / (np.pi * self._low * across)
        share = MARGIN * np.linalg.norm(np.hypot(plane, round_off) * path / image)
        return min(float(share), 1.0)

    def padding_for(self, share: float) -> float | None:
        """Return the width in m of padding with which viscous sides send back less than a share.

        It is that of the receiver to which they send most; None where 1 km is too little.
        """
        worst = max(self.rows, key=lambda row: row.parts["sides"])
        places = {each.name: each.position for each in self.model.receivers}
        points = self._way(np.asarray(places[worst.name], dtype=float))
        own = 0.0 if self.model.sponge is None else self.model.sponge.width
        widths = np.arange(WIDER * np.floor(own / WIDER), WIDEST, WIDER) + WIDER
        shares = [self._sent_back(points, width - own) for width in widths]
        enough = np.flatnonzero(np.array(shares) <= share)
        return float(widths[enough[0]]) if len(enough) else None

    def _row(self, name, position, near):
        """Return the expected error at a receiver."""
        points = self._way(position)
        carried, limit = self._least(self._zones[0].query(points)[1])
        motions = [
            self._of_motion(*pair, points) for pair in zip(self.before, self.after, strict=True)
        ]
        parts, peak = max(motions, key=lambda each: sum(each[0].values()), default=({}, 0.0))
        sides = float(np.hypot(parts.get("sides", 0.0), self._sides(points)))
        others = {"sides": sides, "joint in the layer": self._bent}
        others["near source"] = 0.0 if near is None else near.error
        peak, parts = float(np.linalg.norm([peak, *others.values()])), parts | others
        named = near if near is not None and near.named else None
        return ReceiverError(name, carried, limit, parts, peak, named)

    def _course(self, points):
        """Return the zones of the pieces of a way (n, 3), their times in s, and depth of its ends.

        Depth is the sum below a free surface, in m.
        """
        zone = self._zones[0].query(points)[1][1:]
        time = np.linalg.norm(np.diff(points, axis=0), axis=1) / self._waves[zone]
        return zone, time, self._depth(points[[0, -1]])

    def _way(self, end):
        """Return points (n, 3) on the way of waves to a receiver.

        They turn upwards into soft ground: the way goes straight to the stiff ground below the
        receiver, and from there up.
        """
        share, points = np.linspace(0.0, 1.0, SAMPLES)[:, None], self.model.mesh.points
        tree, start = self._zones[0], self.start(end)
        below = end - share * [0.0, 0.0, np.ptp(points[:, 2])]
        below = below[below[:, 2] >= points[:, 2].min()]
        stiff = self._speeds[tree.query(below)[1]] >= STIFF * self._speeds[tree.query(start)[1]]
        turn = below[int(np.argmax(stiff)) if stiff.any() else 0]
        return np.concatenate([start + share * (turn - start), turn + share * (end - turn)])

    def _least(self, zone):
        """Return the frequency in Hz that zones on a way carry, and which ground sets it.

        It is ``cs / (n e)`` of their mean edge e, n edges to a wavelength. A layer of height H
        carries ``cs / 8 H`` at least: below that frequency it moves as one; flat zones of thin
        layers at the top what `Model.thin_layers` says.
        """
        mesh, speed = self.model.mesh, self._speeds[zone]
        edges, group = self.model.edges_per_wavelength * self._zones[1][zone], mesh.zone_group[zone]
        carried = {}
        for number in np.unique(group):
            own, name = group == number, mesh.groups[number]
            carried[name] = 1.0 / float(np.mean(edges[own] / speed[own]))
            carried[name] = max(carried[name], self.model.thin_layers.get(name, 0.0))
            if name in self.heights:
                thin = float(speed[own].mean()) / (THIN * self.heights[name])
                carried[name] = max(carried[name], thin)
        name = min(carried, key=lambda group: carried[group])
        return carried[name], name

    def _of_motion(self, whole, passed, points):
        """Return parts of the error, and that of the peak, of a motion after a way (n, 3).

        What comes back is wrong by its own, longer way, beside the motion or, where they meet,
        with it.
        """
        ways, sides = [self._of_way(whole, passed, points)], 0.0
        for back, share, returns in self._back(points):
            away = self._of_way(whole, passed, np.concatenate([points, back]), share)
            if returns:
                ways.append(away)
            else:
                sides = float(np.linalg.norm(away[0]) / max(np.linalg.norm(ways[0][0]), 1e-300))
        margin = MARGIN if self._compressed else 1.0
        parts = {
            name: margin * _share_of_all([(1.0 - each[name], motion) for motion, each, _ in ways])
            for name in ways[0][1]
        }
        parts["low-pass"] /= margin  # is no estimate
        changed = [(prod(each.values()), motion) for motion, each, _ in ways]
        (change, _), (_, changes, size) = changed[0], ways[0]
        peaks = [_peak_error(changed[:1]), _peak_error(changed)]
        parts |= {"slip": 0.0, "sides": margin * sides}
        for behind, velocity in self._slipped(np.nan_to_num(passed.velocity), points):
            spectrum = size * np.fft.rfft(velocity, _length(whole, passed), axis=0)
            parts["slip"] = max(parts["slip"], _share_of_all([(1.0 - changes["mesh"], spectrum)]))
            peaks += [_peak_error([(change, spectrum)])] if behind else []
        return parts, max(peaks)

    def _of_way(self, whole, passed, points, share=None):
        """Return the spectrum (m, 3) of a motion after a way, what causes make of it, and its size.

        ``share`` of it, a function of the frequencies in Hz, goes on and back at the end.
        """
        frequency, motion, gain = _spectra(whole, passed)
        zone, time, depth = self._course(points)
        loss, fitted = self._attenuation(frequency, zone, time)
        turn = len(zone) if share is None else len(zone) - SAMPLES
        if share is not None and self._softer(zone[[0, turn]]) < 1.0:  # back from a soft layer
            upwards = self._changes(frequency, zone[:turn], time[:turn], depth)
            delayed, led, right = (each**2 for each in upwards)
            early = -2.0 * np.pi * frequency * time[: 1 - 2 * SAMPLES].sum()
            right = np.exp(1j * (np.angle(right) + early[:, None]))
        else:
            delayed, led, right = self._changes(frequency, zone, time, depth)
        size = loss[:, None] * np.conj(right)
        if share is not None:
            size = size * share(frequency)[:, None]
        fitted = (fitted * self._entered(frequency, zone[0]))[:, None]
        spread = flat_response(2.0 * np.pi * frequency * self._sheared)[:, None]
        changes = {"mesh": delayed, "step": led, "low-pass": gain, "quality": fitted,
                   "sphere": spread}  # fmt: skip
        # they are of exp(-i w t), spectra of exp(i w t)
        return size * motion, {name: np.conj(each) for name, each in changes.items()}, size

    @cached_property
    def _face(self):
        """Boundary through which motion enters, axis of its normal, its place along it in m."""
        mesh = self.model.mesh
        for each in () if self.inside else self.model.boundaries:
            if isinstance(each, (StressInput, VelocityInput)):
                points = mesh.points[np.unique(mesh.surfaces[each.surface])]
                axis = int(np.argmin(np.ptp(points, axis=0)))
                return each, axis, float(points[:, axis].mean())
        return None

    @cached_property
    def _compressed(self):
        """Whether P waves alone run: motion along the normal of its face, sides on rollers.

        Joints lie across, and all is linear: others make frequencies that did not enter.
        """
        if self._face is None:
            return False
        mesh, axis, held = self.model.mesh, self._face[1], (Roller, FreeField)
        motion = np.concatenate([np.nan_to_num(each.velocity) for each in self.after])
        inner = {each.surface for each in self.model.joints}
        beside = {
            name for name in set(mesh.surfaces) - inner
            if np.argmin(np.ptp(mesh.points[np.unique(mesh.surfaces[name])], axis=0)) != axis
        }  # fmt: skip
        return bool(
            np.abs(np.delete(motion, axis, axis=1)).max() <= 1e-6 * np.abs(motion).max()
            and beside <= {each.surface for each in self.model.boundaries if isinstance(each, held)}
            and all(abs(normal[axis]) > 0.999 for _, normal, _ in self._lags)
            and all(JOINT_LAWS[each.law].linear for each in self.model.joints)
            and not any(each.yields for each in self.model.materials.values())
        )

    @cached_property
    def _waves(self):
        """Speeds (n_zones,) in m/s of the waves that run: of P waves alone, or of S waves."""
        return self.model.zone_values("cp") if self._compressed else self._speeds

    def _impedance(self, frequency, zone):
        """Return the impedance (m,) of a zone over that of dashpots: complex by constant Q."""
        mesh = self.model.mesh
        law = self.model.materials[mesh.groups[mesh.zone_group[zone]]].law
        if not isinstance(law, ConstantQ):
            return np.ones(len(frequency))
        low = np.maximum(frequency, 1e-3 * law.band[0])
        speed, quality = law.wave(law.qp if self._compressed else min(law.qp, law.qs), 1.0, low)
        return speed / (1.0 + 0.5j / quality)

    def _entered(self, frequency, zone):
        """Return what enters (m,) of motion through the face beside a zone, over what should."""
        if self._face is None or isinstance(self._face[0], VelocityInput):
            return np.ones(len(frequency))
        ratio = self._impedance(frequency, zone)
        return 2.0 / (1.0 + ratio) if self._face[0].surface in self._viscous else 1.0 / ratio

    def _back(self, points):
        """Return ways (n, 3) on from a receiver and back to it, of motion through a face.

        Each with the share that takes it, a function of frequencies in Hz, and whether it should:
        a free or fixed end across sends all back, and of joints the one that makes most of it;
        viscous ends send back what is not of their impedance, which is an error.
        """
        mesh, ways = self.model.mesh, []
        if self._face is None or mesh.layer is not None or self.model.sponge is not None:
            return ways
        if self._softer(self._zones[0].query(points[[0, -1]])[1]) < 1.0:
            return ways  # goes up and down in the layer of the receiver, as `_changes` says
        (_, axis, level), end = self._face, points[-1]
        far, span = end.copy(), (mesh.points[:, axis].min(), mesh.points[:, axis].max())
        far[axis] = max(span, key=lambda each: abs(each - level))
        share = np.linspace(0.0, 1.0, SAMPLES)[:, None]

        def there_and_back(turn):
            return np.concatenate([end + share * (turn - end), turn + share * (end - turn)])[1:]

        joints = [
            (_crossing(end, far, middle, normal), lags[0] if self._compressed else max(lags))
            for middle, normal, lags in self._lags
        ]
        middle = max(highest_frequency(each, 0.5) for each in self.after)
        share_at, lag = max(
            (each for each in joints if 0.0 < each[0] < 1.0), default=(0.0, 0.0),
            key=lambda each: abs(_reflected(middle, each[1])) * each[0],
        )  # fmt: skip
        if lag > 0.0:
            turn = end + share_at * (far - end)
            ways.append((there_and_back(turn), lambda hz: _reflected(hz, lag), True))
        boundaries = self.model.boundaries
        holds = {type(each) for each in boundaries if self._lies(each.surface, far, axis)}
        absorbs = Viscous in holds
        sign = -1.0 if Fixed in holds or (self._compressed and Roller in holds) else 1.0
        last = int(self._zones[0].query(far)[1])

        def returned(hz):
            ratio = self._impedance(hz, last)
            return (ratio - 1.0) / (ratio + 1.0) if absorbs else np.full(len(hz), sign)

        if not absorbs or np.abs(returned(np.array([middle])))[0] > 0.0:
            ways.append((there_and_back(far), returned, not absorbs))
        return ways

    def _lies(self, surface, far, axis):
        """Return whether a surface is the end across, nearer to a point than to the other end."""
        points = self.model.mesh.points
        own = points[np.unique(self.model.mesh.surfaces[surface])]
        half = 0.5 * np.ptp(points[:, axis])
        return np.argmin(np.ptp(own, axis=0)) == axis and bool(
            abs(own[:, axis].mean() - far[axis]) < half
        )

    @cached_property
    def _planes(self):
        """Points (n, 3) of each joint, their middle, its normal (3,), and the zones (n,) beside."""
        mesh, planes = self.model.mesh, []
        for joint in self.model.joints:
            points = mesh.points[np.unique(mesh.surfaces[joint.surface])]
            middle = points.mean(axis=0)
            normal = np.linalg.svd(points - middle, full_matrices=False)[2][-1]
            planes.append((points, middle, normal, self._zones[0].query(points)[1]))
        return planes

    @cached_property
    def _lags(self):
        """Middle, normal (3,) of joints, impedances of P and S over twice their stiffness in s."""
        density, joints = self.model.zone_values("density"), []
        speeds = {"kn": self.model.zone_values("cp"), "ks": self._speeds}
        for joint, (_, middle, normal, zone) in zip(self.model.joints, self._planes, strict=True):
            lags = [
                float((density * speed)[zone].mean()) / (2.0 * max(joint.properties[key], 1e-3))
                for key, speed in speeds.items()
            ]
            joints.append((middle, normal, lags))
        return joints

    @cached_property
    def _sliding(self):
        """Joints that may slip: middle and normal (3,), S impedance, strengths at peak and rest."""
        if self.inside:  # how strong their waves arrive is not known before a run
            return []
        density, joints = self.model.zone_values("density"), []
        for joint, plane in zip(self.model.joints, self._planes, strict=True):
            if JOINT_LAWS[joint.law].linear:
                continue
            points, middle, normal, zone = plane
            pressure = joint.pressure_at(points[:, 2])
            if self.model.insitu is not None:
                xx, yy, zz, yz, zx, xy = insitu_stress(self.model, points).T
                stress = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
                pressure = -np.einsum("i,ijn,j->n", normal, stress, normal)
            impedance = float((density[zone] * self._speeds[zone]).min())
            joints.append((middle, normal, impedance, *_strengths(joint, float(pressure.min()))))
        return joints

    def _slipped(self, velocity, points):
        """Yield velocities (n, 3) behind joints that slip, one for each: shear is clipped.

        Each after whether a way (m, 3) leads through the joint.
        """
        for middle, normal, impedance, peak, rest in self._sliding:
            along = np.outer(velocity @ normal, normal)
            stress = impedance * np.linalg.norm(velocity - along, axis=1)[:, None]
            if stress.max() > peak:
                held = np.minimum(1.0, rest / np.maximum(stress, 1e-300))
                behind = 0.0 < _crossing(points[0], points[-1], middle, normal) < 1.0
                yield behind, along + held * (velocity - along)

    def _depth(self, ends):
        """Return the sum of depths (2, 3) in m of points below the free top of the mesh."""
        viscous = {each.surface for each in self.model.boundaries if isinstance(each, Viscous)}
        if "top" in viscous:
            return DEEP
        points = self.model.mesh.points
        reach = float(self._zones[1].max())
        depth = 0.0
        for end in ends:
            near = np.hypot(*(points[:, :2] - end[:2]).T) <= reach
            depth += float(points[near, 2].max(initial=end[2]) - end[2])
        return depth

    def _changes(self, frequency, zone, time, depth):
        """Return what mesh and step change of a spectrum (m, 1) on a way, and what the way does.

        In the ground of the end, of thickness given and softer than that of the start, waves go up
        and down: ``1 / (cos x - i z sin x)`` of their phase x up, z the ratio of impedances.
        """
        phase, turn = self._phase(frequency, zone, time, depth), 2.0 * np.pi * frequency
        total, last = max(float(time.sum()), 1e-300), self.model.mesh.zone_group[zone]
        up, ratio = float(time[last == last[-1]].sum()) / total, self._softer(zone[[0, -1]])

        def transfer(lag):
            x = turn * total + lag
            ring = 1.0 / (np.cos(up * x) - 1j * ratio * np.sin(up * x))
            return (np.exp(1j * (1.0 - up) * x) * ring)[:, None]

        led = np.zeros(len(frequency))
        if self.model.mesh.hexahedral:
            half = np.clip(0.5 * turn * time_step(self.model)[0], 1e-12, 1.0)
            travel = np.maximum(turn * total, LEAST_TURN)
            led = -travel * (np.arcsin(half) / half - 1.0)
        right = transfer(0.0)
        return transfer(phase) / right, transfer(led) / right, right

    def _softer(self, ends):
        """Return the ratio of impedances of the zones at both ends of a way into a layer, or 1."""
        mesh = self.model.mesh
        if mesh.groups[mesh.zone_group[ends[1]]] not in self.heights:
            return 1.0
        impedance = self.model.zone_values("density")[ends] * self._waves[ends]
        return min(1.0, float(impedance[1] / impedance[0]))

    def _phase(self, frequency, zone, time, depth):
        """Return the phase errors (m,) in rad of a way through zones, by frequency."""
        mesh, speed = self.model.mesh, self._waves[zone]
        kind = "quadratic" if self.model.quadratic else "linear"
        phase, wanted, power = TETRAHEDRA[kind]
        if mesh.hexahedral:
            wanted, power = NODES_FOR_ONE_PER_CENT[mesh.order] / mesh.order, convergence(mesh.order)
        edge, group = self._zones[1][zone].copy(), mesh.zone_group[zone]
        if mesh.hexahedral:  # finer ones around sources don't help the waves beyond them
            edge = self._longest[group].copy()
        for name, height in self.heights.items():
            own = group == mesh.groups.index(name) if name in mesh.groups else np.zeros(0, int)
            edge[own] = np.minimum(edge[own], THIN * height / self.model.edges_per_wavelength)
        for name, carried in self.model.thin_layers.items():
            own = group == mesh.groups.index(name)
            flat = self._speeds[zone][own] / (self.model.edges_per_wavelength * carried)
            edge[own] = np.minimum(edge[own], flat)
        travel = max(float(time.sum()), 1e-300)
        rate = float(time @ (wanted * edge / speed) ** power) / travel
        waves = np.maximum(frequency * travel, WAVELENGTHS) / WAVELENGTHS
        growth = waves * rate * frequency**power
        if not mesh.hexahedral:
            phase *= PRESSED[kind] if self._compressed else 1.0
            return np.minimum(phase * growth, LOST)
        return phase_error(growth, np.exp(-2.0 * np.pi * depth / speed[-1] * frequency))

    def _attenuation(self, frequency, zone, time):
        """Return the loss (m,) by constant Q on a way, and the ratio (m,) to it by mechanisms."""
        mesh, loss = self.model.mesh, np.zeros(len(frequency))
        lag = loss.astype(complex)
        for number in np.unique(mesh.zone_group[zone]):
            law = self.model.materials[mesh.groups[number]].law
            if isinstance(law, ConstantQ):
                quality = law.qp if self._compressed else law.qs
                waves = frequency * float(time[mesh.zone_group[zone] == number].sum())
                inside = np.clip(frequency, *law.band)
                loss -= np.pi * waves / quality
                lag += 2j * np.pi * waves * law.slowness_error(quality, inside)
        return np.exp(loss), np.exp(lag)


def _share_of_all(ways):
    """Return the norm of changes of spectra (m, 3) of some ways over theirs: apart, or together."""
    wrong, whole = [change * motion for change, motion in ways], [motion for _, motion in ways]
    return max(
        float(np.linalg.norm(each[0]) / max(np.linalg.norm(each[1]), 1e-300))
        for each in ((wrong, whole), (sum(wrong), sum(whole)))
    )


def _peak_error(ways):
    """Return how far changes of the spectra (m, 3) of some ways put the peak of their sum."""
    right, shown = (
        np.linalg.norm(np.fft.irfft(each, axis=0), axis=1).max()
        for each in (sum(own for _, own in ways), sum(change * own for change, own in ways))
    )
    return float(abs(shown / max(right, 1e-300) - 1.0))


def _crossing(start, end, middle, normal):
    """Return the share of a straight way at which it crosses a plane; infinity where it doesn't."""
    slope = float((end - start) @ normal)
    return float((middle - start) @ normal) / slope if abs(slope) > 1e-9 else np.inf


def _reflected(frequency, lag):
    """Return the share (m,) that a joint sends back, of impedance over twice its stiffness in s."""
    return 1.0 - 1.0 / (1.0 + 2j * np.pi * frequency * lag)


def _strengths(joint: Joint, pressure: float) -> tuple[float, float]:
    """Return the shear strength of a joint under a pressure, at its peak and after it, in Pa.

    Beyond the shear at rest; roughness, which strengthens a joint, is left out.
    """
    given, rest = joint.properties, float(np.linalg.norm(joint.insitu_shear))
    cohesion, friction = given.get("cohesion", 0.0), given.get("friction", 0.0)
    after = given.get("friction_residual", given.get("friction_dynamic", friction))
    peak = cohesion + friction * max(pressure, 0.0) - rest
    residual = given.get("cohesion_residual", cohesion) + after * max(pressure, 0.0) - rest
    return max(peak, 0.0), max(residual, 0.0)


def _length(whole, passed):
    """Return the samples of spectra of a motion and of its low-passed one."""
    return fast_length(2 * max(len(whole.velocity), len(passed.velocity)))


def _spectra(whole, passed):
    """Return frequencies (m,) in Hz, the spectrum (m, 3) of a motion, and the gain of a filter."""
    n = _length(whole, passed)
    frequency = np.fft.rfftfreq(n, whole.dt)
    motion = np.fft.rfft(np.nan_to_num(whole.velocity), n, axis=0)
    if passed is whole or passed.velocity is whole.velocity:
        return frequency, motion, np.ones_like(motion, dtype=float)
    after = np.abs(np.fft.rfft(np.nan_to_num(passed.velocity), n, axis=0))
    return frequency, motion, np.minimum(after / np.maximum(np.abs(motion), 1e-300), 1.0)


def _tapered(velocity, samples):
    """Return a motion (n, 3) that goes on after its end, turned about it, and ends in a taper."""
    after = min(int(np.ceil(samples)), len(velocity) - 1)
    taper = np.cos(np.linspace(0.0, 0.5 * np.pi, after + 1)[1:, None]) ** 2
    turned = 2.0 * velocity[-1] - velocity[-2 : -2 - after : -1]
    return np.concatenate([velocity, taper * turned])


def held_shares(whole: Seismogram, passed: Seismogram, carried: float) -> tuple[float, float]:
    """Return which share of energy and peak of a motion its low-passed one has up to a frequency.

    Parameters
    ----------
    whole, passed : Seismogram
    carried : float, Hz
    """
    velocity = np.nan_to_num(passed.velocity)
    periods = int(np.ceil(PERIODS / (carried * passed.dt)))
    padded = fast_length(len(velocity) + periods)  # a pulse may be shorter than a period
    spectrum = np.fft.rfft(velocity, padded, axis=0)
    spectrum[np.fft.rfftfreq(padded, passed.dt) > carried] = 0.0
    carried_motion = np.fft.irfft(spectrum, padded, axis=0)
    before = np.nan_to_num(whole.velocity)
    energy, peak = np.sum(before**2), np.abs(before).max()
    if not peak > 0.0:
        return 1.0, 1.0
    return np.sum(carried_motion**2) / energy, np.abs(carried_motion).max() / peak
