"""Mistakes in the field and at the desk that records show by themselves, and acts that mend them.

They are looked for before anything is calibrated, by correlations with the motion of the reference:
a record whose components, sign, unit or place in a list is wrong would shift what is calibrated,
and be explained by ground that is not there.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations, permutations, product

import numpy as np
from scipy import fft

from ..blasts.blast import Blast
from ..errors import InputError
from ..inference.records import COMPONENTS
from ..project.project import Project
from ..recordings.recording import Recording
from ..signals.seismogram import GEOGRAPHIC
from ..simulation.simulation import Simulation
from .case import Case, case_of

MOST = 6  # mistakes at one site
FEWEST = 3  # receivers, of which one may stand out
MISFIT = 0.05  # 1 - correlation below which nothing is asked of a record
SLIGHT = 0.02  # the same of all records of a blast, at their own times
RATIO = 4.0  # misfit before to misfit after, at least
OTHERS = 2.5  # misfit after to the median misfit of the other receivers, at most
AMBIGUOUS = 1.5  # misfit by the second best act to that by the best, at least
COPY = 1e-8  # 1 - correlation of a record with its copy, at most
EARLY = 0.25  # of a period at the centre of the band, by which records may be late in any case
LATE = 0.5  # s, by which the time zero of a blast may be wrong
NEAREST = 0.6  # of the logarithm of a factor, by which it may miss that of a unit
SCATTER = 0.15  # of the logarithm of amplitudes, at least
UNITS = {
    1e3: "1,000 (mm/s read as m/s)",
    1e2: "100 (cm/s read as m/s)",
    25.4: "25.4 (inches)",
    10.0: "10",
}
QUARTER = np.pi / 2
SQUARE = np.radians(6.0)  # a turn within this of quarter turns is one
SMALL_TURN = np.radians(10.0)
MOST_STEPS = 4  # of Gauss-Newton
STEP = 5.0  # m, of the derivative by the position of a blast


# Labels of the library for the same.
LABELS = {
    "components": "sensor_orientation_or_polarity",
    "turned": "sensor_orientation_or_polarity",
    "unit": "instrument_response",
    "integrated": "instrument_response",
    "differentiated": "instrument_response",
    "receivers": "swapped_channels",
    "delays": "delay_scatter",
    "place": "wrong_coordinates",
}


@dataclass(frozen=True, eq=False)
class Mistake:
    """Mistake: where it was made, the act that mends it, and the fit before and after.

    Parameters
    ----------
    kind : str
        Such as ``components`` or ``unit``.
    target : str
        Receiver, pair of receivers or blast.
    act : str
        What to do, as an instruction.
    before, after : float
        Correlation of the records concerned with the reference, before and after the act.
    mended : callable
        Takes a project, returns it with the act done.
    """

    kind: str
    target: str
    act: str
    before: float
    after: float
    mended: Callable[[Project], Project]

    @property
    def ratio(self) -> float:
        """Misfit before the act over that after it."""
        return (1.0 - self.before) / max(1.0 - self.after, 1e-6)

    def row(self) -> dict:
        """Return the mistake as a row of ``diagnosis.json``."""
        before, after = round(self.before, 3), round(self.after, 3)
        return {
            "kind": self.kind,
            "label": LABELS.get(self.kind),
            "target": self.target,
            "act": self.act,
            "correlation_before": before,
            "correlation_after": after,
        }


def mistakes_of(project: Project, simulated: Callable[[Case], Simulation]) -> tuple[list, Project]:
    """Find mistakes one by one, the plainest first, each after those before it are mended.

    Parameters
    ----------
    project : Project
        With its records.
    simulated : callable
        ``(case) -> Simulation``.

    Returns
    -------
    mistakes : list of Mistake
    project : Project
        With all acts done.

    Raises
    ------
    SolverError
        If a run of the reference fails.
    """
    mistakes: list[Mistake] = []
    while len(mistakes) < MOST:
        case = case_of(project)
        mistake = plainest(case, simulated(case), project)
        if mistake is None:
            break
        mistakes.append(mistake)
        project = mistake.mended(project)
    return mistakes, project


def plainest(case: Case, simulation: Simulation, project: Project) -> Mistake | None:
    """Return the mistake in a project that shows most plainly, None if none does."""
    compared = Compared.of(case, simulation.motion(case.project), project)
    copy = _copy(compared)
    if copy is not None:
        return copy
    offered = [m for search in (_of_receivers, _of_pairs, _of_blasts) for m in search(compared)]
    mistake = plainest_act(offered)
    if mistake is not None and mistake.kind != "time zero":
        return mistake
    rivals = [] if mistake is None else [mistake]  # holes off their place are late as well
    return plainest_act([*rivals, *_of_plans(simulation, compared)])


def plainest_act(offered: Sequence[Mistake]) -> Mistake | None:
    """Return the act that mends most of what it concerns, if no other mends it nearly as well."""
    for mistake in sorted(offered, key=lambda m: -m.ratio):
        rivals = [m for m in offered if m.target == mistake.target and m.act != mistake.act]
        if all(1.0 - m.after > AMBIGUOUS * (1.0 - mistake.after) for m in rivals):
            return mistake
    return None


@dataclass(frozen=True, eq=False)
class Compared:
    """Correlations of all records with the motion of the reference, in the band.

    Parameters
    ----------
    case : Case
    recorded, simulated : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Zero where samples are not valid.
    axes : dict of str to tuple
        By receiver: azimuth of the axes of its records, None for east and north, and their names.
    """

    case: Case
    recorded: np.ndarray
    simulated: np.ndarray
    axes: dict[str, tuple]

    @classmethod
    def of(cls, case: Case, motion, project: Project) -> "Compared":
        """Compare the records of a case of a project with a motion."""
        shown = case.in_band(np.where(case.valid, motion, 0.0))
        return cls(case, case.in_band(case.motion), shown, _axes(project, case.receivers))

    @cached_property
    def lags(self) -> int:
        """Samples by which any record may be late, because speeds are not known exactly."""
        band = self.case.band
        return max(1, int(EARLY / np.sqrt(max(band.low, 0.3 * band.high) * band.high) / band.dt))

    def products(self, recorded, simulated, lags=None) -> np.ndarray:
        """Return products of components, (..., 3, 3, 2 n + 1) for lags of -n to n samples.

        Parameters
        ----------
        recorded, simulated : (..., 3, n_samples) float
        lags : int, optional
        """
        n, lags = recorded.shape[-1], self.lags if lags is None else lags
        size = fft.next_fast_len(2 * n, real=True)
        spectrum, reference = fft.rfft(recorded, size), fft.rfft(simulated, size)
        all_lags = fft.irfft(spectrum[..., :, None, :] * reference[..., None, :, :].conj(), size)
        return np.roll(all_lags, lags, axis=-1)[..., : 2 * lags + 1]

    def present(self, r) -> np.ndarray:
        """Return the numbers of the blasts that a receiver recorded."""
        return np.flatnonzero(_size(self.recorded)[:, r] > 0.0)

    def recorders(self, b) -> np.ndarray:
        """Return the numbers of the receivers that recorded a blast."""
        return np.flatnonzero(_size(self.recorded)[b] > 0.0)

    def correlation(self, recorded, simulated, lags=None) -> np.ndarray:
        """Return the largest correlation (...) of motions (..., 3, n_samples) over lags."""
        products = np.trace(self.products(recorded, simulated, lags), axis1=-3, axis2=-2)
        return products.max(axis=-1) / np.maximum(_size(recorded) * _size(simulated), 1e-300)

    @cached_property
    def plain(self) -> np.ndarray:
        """Correlation of each record as it is, (n_blasts, n_receivers); nan where there is none."""
        nothing = _size(self.recorded) == 0.0
        return np.where(nothing, np.nan, self.correlation(self.recorded, self.simulated))

    @cached_property
    def strict(self) -> np.ndarray:
        """Correlation of each record at its own times, (n_blasts, n_receivers); nan for none."""
        nothing = _size(self.recorded) == 0.0
        return np.where(nothing, np.nan, self.correlation(self.recorded, self.simulated, 0))

    @cached_property
    def amplitude(self) -> np.ndarray:
        """Logarithm of recorded over simulated amplitude, (n_blasts, n_receivers)."""
        recorded, simulated = _size(self.recorded), _size(self.simulated)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(recorded > 0.0, np.log(recorded / simulated), np.nan)

    def usual(self, but=()) -> float:
        """Return the median misfit of receivers, some left out."""
        others = [r for r in range(len(self.case.receivers)) if r not in but]
        means = np.nanmean(self.plain[:, others], axis=0)
        return float(1.0 - np.median(means)) if len(others) > 1 else MISFIT

    def accepts(self, before, after, but=()) -> bool:
        """Tell whether an act mends records: by their correlations in each blast."""
        misfit, remaining = 1.0 - np.mean(before), 1.0 - np.mean(after)
        return bool(
            misfit >= max(MISFIT, RATIO * remaining)
            and np.all(np.asarray(after) > before)
            and remaining <= max(MISFIT, OTHERS * self.usual(but))
        )


def _mistake(kind, target, act, before, after, mended):
    """Return a mistake from the correlations of the records concerned."""
    return Mistake(kind, target, act, float(np.mean(before)), float(np.mean(after)), mended)


def _size(motion):
    """Return the norm of motions (..., 3, n_samples)."""
    return np.sqrt(np.sum(motion**2, axis=(-2, -1)))


# What is copied


def _copy(compared):
    """Return records that are those of another blast, the same to the digit, as a mistake."""
    case, plain = compared.case, compared.strict
    for a, b in combinations(range(len(case.blasts)), 2):
        first, second = case.motion[a], case.motion[b]
        both = (_size(first) > 0.0) & (_size(second) > 0.0)
        alike = np.sum(first * second, axis=(1, 2))[both] / (_size(first) * _size(second))[both]
        if not len(alike) or np.any(1.0 - alike > COPY):
            continue
        fits = [float(np.mean(plain[blast][both])) for blast in (a, b)]
        wrong, right = (a, b) if fits[0] < fits[1] else (b, a)
        name, other = case.blasts[wrong], case.blasts[right]
        act = f"give the records of {name}: those in their place are the records of {other}"
        return _mistake(
            "copy",
            name,
            act,
            min(fits),
            max(fits),
            partial(_without, blast=name),
        )
    return None


# Mistakes at one receiver


def _of_receivers(compared) -> Iterator[Mistake]:
    """Yield mistakes at one receiver that mend all of its records, beside two others at least."""
    case, plain = compared.case, compared.plain
    if len(case.receivers) < FEWEST:
        return
    for r, name in enumerate(case.receivers):
        blasts = compared.present(r)
        if not len(blasts):
            continue
        before = plain[blasts, r]
        recorded, simulated = compared.recorded[blasts, r], compared.simulated[blasts, r]
        if 1.0 - np.mean(before) >= MISFIT:
            yield from _of_components(compared, r, name, before, recorded, simulated)
            yield from _of_calculus(compared, r, name, before, blasts)
        yield from _of_unit(compared, r, name, blasts)


def _of_components(compared, r, name, before, recorded, simulated):
    """Yield exchanged, reversed and turned components of a receiver, in the axes of its records."""
    azimuth, names = compared.axes[name]
    recorded, simulated = (_along(motion, azimuth) for motion in (recorded, simulated))
    products = compared.products(recorded, simulated)
    size = np.maximum(_size(recorded) * _size(simulated), 1e-300)

    def mistake(kind, act, after, change):
        return _mistake(
            kind, name, act, before, after, partial(changed_records, change=change, receiver=name)
        )

    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        parts = [
            sign * products[:, i, j] for i, (j, sign) in enumerate(zip(order, signs, strict=True))
        ]
        after = np.sum(parts, axis=0).max(axis=-1) / size
        same = order == (0, 1, 2) and min(signs) > 0.0
        if not same and compared.accepts(before, after, (r,)):
            act = f"{_said(order, signs, names)} at {name}"
            yield mistake("components", act, after, partial(_rearranged, order=order, signs=signs))
    along = products[:, 0, 0] + products[:, 1, 1]
    across = products[:, 1, 0] - products[:, 0, 1]
    lag = np.argmax(np.hypot(along, across) + products[:, 2, 2], axis=-1)
    rows = np.arange(len(lag))
    turn = float(np.arctan2(across[rows, lag].sum(), along[rows, lag].sum()))
    if abs(turn) < SMALL_TURN or abs((turn + 0.5 * QUARTER) % QUARTER - 0.5 * QUARTER) < SQUARE:
        return
    after = (np.cos(turn) * along + np.sin(turn) * across + products[:, 2, 2]).max(axis=-1) / size
    if compared.accepts(before, after, (r,)):
        clockwise = np.degrees(turn if azimuth is None else -turn)
        act = f"turn the horizontals of {name} by {clockwise:.0f}°, clockwise from above"
        yield mistake("turned", act, after, partial(_turned, turn=turn))


def _axes(project, receivers):
    """Return the azimuth of the axes of the recordings of receivers, and the names of the axes."""
    axes: dict[str, tuple] = dict.fromkeys(receivers, (None, COMPONENTS))
    for shot in project.shots:
        azimuths = {part.name: part.azimuth for part in project.of(shot.name).stations}
        for name, record in project.survey.recordings[shot.name].items():
            names = tuple(record.seismogram.components)
            if name in axes and names != GEOGRAPHIC and azimuths.get(name) is not None:
                axes[name] = azimuths[name], names
    return axes


def _along(motion, azimuth):
    """Return motion (..., 3, n_samples) along the axes of its records."""
    if azimuth is None:
        return motion
    east, north, up = np.moveaxis(motion, -2, 0)
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    return np.stack([sine * east + cosine * north, cosine * east - sine * north, up], axis=-2)


def _said(order, signs, names):
    """Return the act on components in words: which are exchanged, which reversed."""
    moved = [c for c in range(3) if order[c] != c]
    parts = []
    if len(moved) == 2:
        parts = [f"exchange {names[moved[0]]} and {names[moved[1]]}"]
    elif moved:
        listed = ", ".join(f"{names[c]} is {names[order[c]]}" for c in moved)
        parts = [f"exchange the components ({listed})"]
    turned = [names[order[c]] for c in range(3) if signs[c] < 0.0]
    parts += [f"reverse {' and '.join(turned)}"] if turned else []
    return ", then ".join(parts)


def _of_calculus(compared, r, name, before, blasts):
    """Yield records that hold acceleration or displacement in place of velocity."""
    usual, spread = _usual_amplitude(compared, r)
    case = compared.case
    motion = np.where(case.valid, case.motion, 0.0)[blasts, r]
    simulated = compared.simulated[blasts, r]
    for word, whole, act in (
        ("acceleration", case.dt * np.cumsum(motion, axis=-1), "integrate"),
        ("displacement", np.gradient(motion, case.dt, axis=-1), "differentiate"),
    ):
        changed = whole @ case.band.basis @ case.band.basis.T
        after = compared.correlation(changed, simulated)
        level = np.median(np.log(_size(changed) / np.maximum(_size(simulated), 1e-300))) - usual
        if _mends(before, after) and abs(level) < 3.0 * spread:
            yield _mistake(
                f"{act}d",
                name,
                f"{act} the records of {name}: they are {word}, not velocity",
                before,
                after,
                partial(changed_records, change=partial(_calculus, how=act), receiver=name),
            )


def _usual_amplitude(compared, but):
    """Return the median logarithm of amplitudes of the other receivers, and its scatter."""
    levels = np.nanmedian(compared.amplitude, axis=0)
    others = np.delete(levels, but)
    others = others[np.isfinite(others)]
    if not len(others):
        return 0.0, np.inf
    usual = float(np.median(others))
    return usual, max(SCATTER, 1.4826 * float(np.median(np.abs(others - usual))))


def _of_unit(compared, r, name, blasts):
    """Yield records of one receiver that fit but for a factor, that of another unit."""
    usual, spread = _usual_amplitude(compared, r)
    level = compared.amplitude[blasts, r] - usual
    misfit = 1.0 - np.mean(compared.plain[blasts, r])
    if np.any(np.abs(level) < 6.0 * spread) or misfit > max(MISFIT, OTHERS * compared.usual((r,))):
        return
    for factor, words in UNITS.items():
        for sign, how in ((1.0, "divide"), (-1.0, "multiply")):
            error = np.abs(level - sign * np.log(factor))
            if np.all(error < min(3.0 * spread, NEAREST)):
                before, after = (np.exp(-np.abs(e)) for e in (level, error))
                yield _mistake(
                    "unit",
                    name,
                    f"{how} the records of {name} by {words}",
                    before,
                    after,
                    partial(
                        changed_records,
                        change=partial(_scaled, factor=factor**-sign),
                        receiver=name,
                    ),
                )


# Mistakes between receivers, and of one blast


def _of_pairs(compared) -> Iterator[Mistake]:
    """Yield receivers that have been exchanged."""
    case, plain = compared.case, compared.plain
    poor = [r for r in range(len(case.receivers)) if 1.0 - np.nanmean(plain[:, r]) >= MISFIT]
    for a, b in combinations(poor, 2):
        blasts = np.intersect1d(compared.present(a), compared.present(b))
        if not len(blasts):
            continue
        before = plain[np.ix_(blasts, np.array([a, b]))].ravel()
        crossed = compared.correlation(
            compared.recorded[np.ix_(blasts, np.array([a, b]))],
            compared.simulated[np.ix_(blasts, np.array([b, a]))],
        ).ravel()
        if compared.accepts(before, crossed, (a, b)):
            names = case.receivers[a], case.receivers[b]
            yield _mistake(
                "receivers",
                " and ".join(names),
                f"exchange the records of {names[0]} and {names[1]}",
                before,
                crossed,
                partial(_exchanged, first=names[0], second=names[1]),
            )


def _of_blasts(compared) -> Iterator[Mistake]:
    """Yield blasts whose time zero is wrong: all records are late by one time, others are not.

    What the others are late by is of the speeds of the reference, and is taken off.
    """
    case = compared.case
    reach = min(int(LATE / case.dt), case.n_samples // 4)
    recorded, simulated = compared.recorded, compared.simulated
    products = np.trace(compared.products(recorded, simulated, reach), axis1=2, axis2=3)
    size = _overlapping(recorded, reach) * _overlapping(simulated, reach)[..., ::-1]
    curves = np.where(size > 0.0, products / np.maximum(size, 1e-300), 0.0)
    shifts = np.argmax(curves.mean(axis=1), axis=-1) - reach
    for b, name in enumerate(case.blasts):
        present = compared.recorders(b)
        others = np.delete(shifts, b)
        shift = shifts[b] - (int(np.median(others)) if len(others) else 0)
        if len(present) < 3 or abs(shift) < 2 or np.any(2 * np.abs(others) > abs(shift)):
            continue
        before, after = compared.strict[b, present], curves[b, present, reach + shift]
        if _mends(before, after):
            seconds = shift * case.dt
            act = f"correct time zero of {name}: its records are {1e3 * abs(seconds):.0f} ms "
            yield _mistake(
                "time zero",
                name,
                act + ("late" if seconds > 0.0 else "early"),
                before,
                after,
                partial(changed_records, change=partial(_shifted, seconds=-seconds), blast=name),
            )


def _overlapping(motion, reach):
    """Return the norm of what overlaps with itself shifted, (..., 2 n + 1) for -n to n samples."""
    energy = np.cumsum(np.sum(motion**2, axis=-2), axis=-1)
    early = energy[..., -1 : -reach - 2 : -1][..., ::-1]  # without its last samples
    late = (
        energy[..., -1:] - np.concatenate([0.0 * energy[..., :1], energy], -1)[..., 1 : reach + 1]
    )
    return np.sqrt(np.concatenate([early, late], axis=-1))


def _mends(before, after, least=MISFIT):
    """Tell whether misfits fall far enough, without regard to other receivers."""
    misfit, remaining = 1.0 - np.mean(before), 1.0 - np.mean(after)
    return bool(misfit >= max(least, RATIO * remaining))


# The plan of a blast, by runs of others


def _of_plans(simulation, compared) -> Iterator[Mistake]:
    """Yield plans of a blast that its records contradict: its delays, and the place of its holes.

    Only of a blast whose misfit is far above that of the others, since each takes runs.
    """
    case, misfit = compared.case, 1.0 - np.nanmean(compared.strict, axis=1)
    for b, name in enumerate(case.blasts):
        others = np.delete(misfit, b)
        if misfit[b] < SLIGHT or (len(others) and misfit[b] < RATIO * np.min(others)):
            continue
        delays = list(_of_delays(simulation, compared, b, name))
        yield from delays or _of_place(simulation, compared, b, name)


def _of_delays(simulation, compared, b, name):
    """Yield other delays of a blast: in the opposite order, or those of another blast."""
    blasts = compared.case.project.blasts
    own = blasts[name]
    if len(own.times) < 2:
        return
    plans = {"in the opposite order": own.times.min() + own.times.max() - own.times}
    for other, blast in blasts.items():
        if other != name and len(blast.times) == len(own.times):
            plans[f"of {other}"] = blast.times
    for words, times in plans.items():
        if np.allclose(times, own.times):
            continue
        fired = replace(own, times=times)
        yield from _judged(
            simulation,
            compared,
            b,
            fired,
            "delays",
            f"correct the delays of {name}: its records are those of delays {words}",
        )


def _of_place(simulation, compared, b, name):
    """Yield the place of all holes of a blast, off along east and north."""
    own = compared.case.project.blasts[name]
    try:
        offset = _offset(simulation, compared, b, own)
    except InputError:  # a step would leave the ground: no place in it mends the records
        return
    act = (
        f"correct the coordinates of {name}: its records are those of holes "
        f"{np.hypot(*offset):.1f} m off ({offset[0]:+.1f} m east, {offset[1]:+.1f} m north)"
    )
    yield from _judged(simulation, compared, b, _moved(own, offset), "place", act)


def _offset(simulation, compared, b, own):
    """Return by how much the holes of a blast are off, (2,) in m, by Gauss-Newton steps."""
    name, present, offset = compared.case.blasts[b], compared.recorders(b), np.zeros(2)
    for _ in range(MOST_STEPS):
        at = _motion(simulation, compared.case, name, _moved(own, offset))
        slopes = [
            (_motion(simulation, compared.case, name, _moved(own, offset + STEP * unit)) - at)
            / STEP
            for unit in np.eye(2)
        ]
        size = _size(at)[present, None, None]
        columns = np.stack([(slope[present] / size).ravel() for slope in slopes], axis=1)
        wrong = ((compared.recorded[b] - at)[present] / size).ravel()
        step = np.linalg.lstsq(columns, wrong, rcond=None)[0]
        offset = offset + np.clip(step, -3.0 * STEP, 3.0 * STEP)
        if np.hypot(*step) < 0.3 * STEP:
            break
    return offset


def _judged(simulation, compared, b, fired, kind, act):
    """Yield the mistake that another plan of a blast mends, if it does."""
    name = compared.case.blasts[b]
    present = compared.recorders(b)
    motion = _motion(simulation, compared.case, name, fired)
    after = compared.correlation(compared.recorded[b], motion, 0)[present]
    before = compared.strict[b, present]
    if _mends(before, after, SLIGHT):
        yield _mistake(
            kind,
            name,
            act,
            before,
            after,
            lambda project: project.changed(blasts=project.blasts | {name: fired}),
        )


def _motion(simulation, case, name, fired):
    """Return the motion of one blast with another plan in the band, (n_receivers, 3, n_samples)."""
    project = case.project.changed(blasts=case.project.blasts | {name: fired})
    motion = simulation.motion(project, [name])[0]
    b = case.blasts.index(name)
    every = np.zeros_like(case.motion)
    every[b] = np.where(case.valid[b], motion, 0.0)
    return case.in_band(every)[b]


def _moved(blast: Blast, offset) -> Blast:
    """Return a blast moved along east and north."""
    by = np.array([*offset, 0.0])
    return replace(blast, collar=blast.collar + by, toe=blast.toe + by)


# Acts on the records of a project


def changed_records(
    project: Project,
    change: Callable[[Recording], Recording],
    receiver: str | None = None,
    blast: str | None = None,
) -> Project:
    """Return a project with all recordings changed, or those of a receiver or a blast."""

    def act(shot, table):
        return {
            name: change(record)
            if receiver in (None, name) and blast in (None, shot)
            else record
            for name, record in table.items()
        }  # fmt: skip

    return replace(project, survey=project.survey.edited(act))


def _without(project, blast) -> Project:
    """Return a project without the records of one blast."""
    shots = tuple(shot for shot in project.shots if shot.name != blast)
    first = project.of(shots[0].name)
    return replace(first, survey=replace(project.survey, shots=shots))


def _exchanged(project, first, second) -> Project:
    """Return a project in which two receivers have exchanged their records."""
    names = {first: second, second: first}

    def act(_, table):
        return {names.get(name, name): record for name, record in table.items()}

    return replace(project, survey=project.survey.edited(act))


def with_velocity(record: Recording, velocity, **other) -> Recording:
    """Return a record with other velocities."""
    return replace(record, seismogram=replace(record.seismogram, velocity=velocity), **other)


def _rearranged(record, order, signs) -> Recording:
    """Return a record whose components are put in their places: i holds what j should."""
    velocity, clipped = record.seismogram.velocity.copy(), record.clipped.copy()
    for i, (j, sign) in enumerate(zip(order, signs, strict=True)):
        velocity[:, j] = sign * record.seismogram.velocity[:, i]
        clipped[:, j] = record.clipped[:, i]
    return with_velocity(record, velocity, clipped=clipped)


def _turned(record, turn) -> Recording:
    """Return a record whose horizontals are turned back by an angle in rad."""
    velocity, clipped = record.seismogram.velocity.copy(), record.clipped.copy()
    east, north = record.seismogram.velocity[:, :2].T
    velocity[:, 0] = np.cos(turn) * east + np.sin(turn) * north
    velocity[:, 1] = np.cos(turn) * north - np.sin(turn) * east
    clipped[:, :2] |= clipped[:, 1::-1]
    return with_velocity(record, velocity, clipped=clipped)


def _scaled(record, factor) -> Recording:
    """Return a record times a factor."""
    return with_velocity(record, factor * record.seismogram.velocity)


def _calculus(record, how) -> Recording:
    """Return a record integrated or differentiated."""
    seismogram = record.seismogram
    if how == "integrate":
        velocity = np.cumsum(seismogram.velocity, axis=0) * seismogram.dt
        velocity -= np.linspace(0.0, 1.0, len(velocity))[:, None] * velocity[-1]
    else:
        velocity = np.gradient(seismogram.velocity, seismogram.dt, axis=0)
    return with_velocity(record, velocity)


def _shifted(record, seconds) -> Recording:
    """Return a record that begins later."""
    seismogram = record.seismogram
    return replace(record, seismogram=replace(seismogram, start=seismogram.start + seconds))
