"""Records joined to the blasts of a log: stations, peaks and features of each record, refusals."""

import math
import re
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from ..blasts.blast import Blast
from ..blasts.compliance import ComponentPeaks
from ..blasts.hole_tables import read_blast
from ..errors import InputError, PyblastError, ReadError
from ..readers.cells import plain_word, wanted_by
from ..readers.provenance import ReadLog
from ..readers.tables import Table, read_table
from ..recordings.recording import Recording, read_recording
from ..signals.spectra import zero_crossing_frequency

TOLERANCE = 900.0  # s between a blast of the log and the trigger of an instrument
HOUR, DAY = 3600.0, 86400.0
BESIDE, EARTH = 50.0, 6.371e6  # m from a station to the place in a header; radius of the earth
APART = 60.0  # s by which the nearest of two blasts must be nearer
HOURS = (0, 1, -1, 2, -2, *range(3, 13), *range(-3, -13, -1))  # clocks in another time zone
SURER, FEWEST = 1.5, 3  # times as many records as by its own time, and how many, that show it
ENERGY = 0.05, 0.95  # shares of the energy between which a record lasts
DATES = "%Y-%m-%d", "%d.%m.%Y", "%Y/%m/%d", "%d-%b-%Y", "%d %b %Y", "%d %B %Y", "%Y%m%d"
_CLOCK = (r"(.*?)(?:[T ]+(\d{1,2})[:.](\d\d)(?:[:.](\d\d(?:\.\d+)?))?\s*(?:([AaPp])[Mm])?"
          r"(Z|[+-]\d\d:?\d\d)?)?")  # fmt: skip
_SLASHES = r"(\d{1,2})/(\d{1,2})/\d{4}"
PRACTICE = "bench", "explosive", "delays"  # what a log says beside time, place and charge


@dataclass(frozen=True)
class LoggedBlast:
    """Blast of a log.

    Parameters
    ----------
    name : str
    time : str
        ISO; a date alone where the log has no clock.
    position : tuple of 3 float, m
        East, north, up; NaN where the log lacks it.
    charge : float, kg
        Largest within 8 ms; NaN where it is not known.
    practice : dict of str to str
        Texts of the columns bench, explosive and delays, as far as the log has them.
    holes : str
        File of its hole table beside the log, or "".
    plan : Blast or None
        That table.
    """

    name: str
    time: str
    position: tuple[float, float, float]
    charge: float
    practice: Mapping[str, str]
    holes: str = ""
    plan: Blast | None = field(default=None, repr=False, compare=False)

    def table(self) -> dict:
        """Return the blast as plain values."""
        return {key: value for key, value in vars(self).items() if key != "plan"}

    @property
    def has_clock(self) -> bool:
        """Whether the log has a time of day."""
        return len(self.time) > len("2000-01-01")


@dataclass(frozen=True)
class Station:
    """Place where an instrument stands.

    Parameters
    ----------
    name, serial : str
        Serial number, or "" where the name of a file tells the place.
    position : tuple of 3 float, m
    trigger : float, m/s
        Below it nothing is recorded; NaN where it is not known.
    geographic : tuple of 2 float, rad
        Latitude and longitude; NaN where they are not known.
    """

    name: str
    serial: str
    position: tuple[float, float, float]
    trigger: float
    geographic: tuple[float, float] = (math.nan, math.nan)


@dataclass(frozen=True)
class RecordPeaks:
    """Peaks of one record, and what tells changes of sensor, ground and practice apart, SI.

    Parameters
    ----------
    file, serial, time, instrument : str
    components : tuple of str
    ppv, hz : (n_components,) float, m/s and Hz
        NaN where a component is absent, dead or has no zero crossings.
    pvs : float, m/s
        Largest vector at one instant.
    overpressure : float, Pa
        NaN without microphone.
    features : (6,) float
        See `FEATURES`.
    spoilt : tuple of str
        Components that are dead or clipped.
    notes : tuple of str
        Of the reader.
    geographic : tuple of 2 float, rad
        Latitude and longitude of the header; NaN where it has none.
    """

    file: str
    serial: str
    time: str
    instrument: str
    components: tuple[str, ...]
    ppv: tuple[float, ...]
    hz: tuple[float, ...]
    pvs: float
    overpressure: float
    features: tuple[float, ...]
    spoilt: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    geographic: tuple[float, ...] = (math.nan, math.nan)

    @property
    def largest(self) -> float:
        """Largest peak of a component in m/s; NaN where one is spoilt or none is there."""
        return math.nan if self.spoilt else self.at_least

    @property
    def at_least(self) -> float:
        """Largest peak of a component in m/s, of those that are not dead; NaN without any."""
        return max((peak for peak in self.ppv if peak > 0.0), default=math.nan)

    @property
    def peaks(self) -> ComponentPeaks:
        """Peaks for a comparison with limit curves."""
        return ComponentPeaks(self.components, self.ppv, self.hz, self.pvs)

    @property
    def frequency(self) -> float:
        """Zero-crossing frequency in Hz of the largest component; NaN without one."""
        rows = [row for row in zip(self.ppv, self.hz, strict=True) if row[0] > 0.0]
        return max(rows, default=(0.0, math.nan))[1]

    @classmethod
    def from_table(cls, table: Mapping) -> "RecordPeaks":
        """Return the record of a table from JSON, where null is NaN."""
        fields = {
            key: tuple(math.nan if v is None else v for v in value)
            if isinstance(value, list) else math.nan if value is None else value
            for key, value in table.items()
        }  # fmt: skip
        return cls(**fields)


# log10 of the horizontal and the vertical level, two Stokes parameters of the horizontal motion
# (which a turned sensor turns), log10 of frequency and duration.
FEATURES = "horizontal", "vertical", "along", "across", "frequency", "duration"


def features_of(velocity: np.ndarray, dt: float) -> np.ndarray:
    """Return the features of motions: levels, polarization, frequency, duration.

    Parameters
    ----------
    velocity : (..., n_samples, 3) float64, m/s
        Two horizontal components and the vertical one.
    dt : float, s

    Returns
    -------
    (..., 6) float64
        NaN where nothing moves, see `FEATURES`.
    """
    energy = np.cumsum((velocity**2).sum(axis=-1), axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = energy / energy[..., -1:]
        lasts = dt * ((share > ENERGY[0]) & (share < ENERGY[1])).sum(axis=-1)
        slope = np.diff(velocity, axis=-2) / dt
        squares = dt * np.einsum("...ti,...tj->...ij", velocity, velocity)
        first, second, upright = (squares[..., k, k] for k in range(3))
        whole = first + second
        frequency = np.sqrt(dt * (slope**2).sum(axis=(-2, -1)) / (whole + upright)) / (2 * np.pi)
        values = [
            0.5 * np.log10(whole / lasts), 0.5 * np.log10(upright / lasts),
            (first - second) / whole, 2.0 * squares[..., 0, 1] / whole,
            np.log10(frequency), np.log10(lasts),
        ]  # fmt: skip
    stacked = np.stack(values, axis=-1)
    return np.where(np.isfinite(stacked), stacked, np.nan)


def record_peaks(file: str, recording: Recording, notes: tuple[str, ...] = ()) -> RecordPeaks:
    """Return the peaks and features of a recording."""
    motion = recording.seismogram
    cut = recording.clipped.any(axis=0)
    spoilt = tuple(
        name for name, clipped in zip(motion.components, cut, strict=True)
        if clipped or name in recording.dead
    )  # fmt: skip
    features = np.full(len(FEATURES), np.nan)
    if motion.present.all() and not spoilt:
        features = features_of(motion.velocity, motion.dt)
    return RecordPeaks(
        file, recording.serial, recording.time, recording.instrument or "text",
        tuple(motion.components), tuple(map(float, motion.ppv)),
        tuple(map(float, zero_crossing_frequency(motion).hz)), float(motion.pvs),
        float(recording.peak_overpressure), tuple(map(float, features)), spoilt, notes,
        _geographic(recording.header),
    )  # fmt: skip


def _geographic(header: Mapping) -> tuple[float, float]:
    """Return latitude and longitude of a header in rad; NaN where it has none, or zeros."""
    known = {plain_word(key): str(value) for key, value in header.items()}
    angles = []
    for words in (("latitude", "gpslatitude", "lat"), ("longitude", "gpslongitude", "lon")):
        text = next((known[word] for word in words if word in known), "")
        match = re.fullmatch(r"\s*([NSEW]?)\s*([-+]?\d+\.\d+)\s*°?\s*([NSEW]?)\s*", text)
        sign = -1.0 if match and {match[1], match[3]} & {"S", "W"} else 1.0
        angles.append(math.nan if match is None else sign * math.radians(float(match[2])))
    return (angles[0], angles[1]) if any(angles) else (math.nan, math.nan)


def read_peaks(path: Path, name: str) -> list[RecordPeaks]:
    """Read the records of a file.

    Raises
    ------
    ReadError, InputError
        With the reason where none can be joined to a blast.
    """
    recordings, notes = read_quietly(path)
    return [record_peaks(name, recording, notes) for recording in recordings]


def read_quietly(path: Path) -> tuple[list[Recording], tuple[str, ...]]:
    """Read the recordings of a file, with what the reader warns of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        recordings = read_recording(path)
    return recordings, tuple(
        str(note.message).removeprefix(f"{path}").lstrip(":, ") for note in caught
    )


def read_log(path: Path, log: ReadLog | None = None) -> list[LoggedBlast]:
    """Read a log of blasts: date or time, place, charge in 8 ms; text or workbook.

    Parameters
    ----------
    path : Path
        Titles such as ``blast, date, time, x (m), y (m), z (m), charge (kg)``; optional bench,
        explosive, delays, and holes: the file of a hole table beside the log, from which come
        charge and place where the log lacks them.
    log : ReadLog, optional

    Returns
    -------
    list of LoggedBlast
        By time.

    Raises
    ------
    ReadError, InputError
        If a column, a date or a hole table is missing or can't be read, or a name stands twice.
    """
    table = read_table(path, wanted_by("log"), None, log, kind="log of blasts")
    blasts, slashed = [], _slashed(table.values["date"])
    for k, line in enumerate(table.lines):
        text = " ".join(filter(None, (_text(table, name, k) for name in ("date", "clock"))))
        charge, position = _value(table, "charge", k), _position(table, k)
        if not (math.isnan(charge) or charge > 0.0):
            raise InputError(
                f"{table.where}, line {line}, charge: must be positive, got {charge:g}"
            )
        plan = None
        if holes := _text(table, "holes", k):
            try:
                plan = read_blast(Path(path).parent / holes, log=log)
            except PyblastError as error:
                raise ReadError(f"{table.where}, line {line}, holes: {error}") from None
            charge = plan.charge_per_window() if math.isnan(charge) else charge
            position = tuple(plan.centres.mean(axis=0)) if math.isnan(position[0]) else position
        practice = {n: _text(table, n, k) for n in PRACTICE if n in table.values}
        name = _text(table, "name", k) or str(k + 1)
        blasts.append(
            LoggedBlast(
                name,
                _instant(table.where, line, text, slashed),
                position,
                charge,
                practice,
                holes,
                plan,
            )
        )
    _refuse_repeated(table.where, "blast", [blast.name for blast in blasts])
    return sorted(blasts, key=lambda blast: blast.time)


def read_stations_of(path: Path, log: ReadLog | None = None) -> list[Station]:
    """Read a table of stations: name, place, optional serial number and trigger level.

    Raises
    ------
    ReadError, InputError
        If a column or a place is missing, or a name or a serial number stands twice.
    """
    table = read_table(path, wanted_by("stations"), None, log, kind="table of stations")
    stations = [
        Station(_text(table, "name", k), _text(table, "serial", k), _position(table, k),
                _value(table, "trigger", k),
                (_value(table, "latitude", k), _value(table, "longitude", k)))
        for k in range(len(table.lines))
    ]  # fmt: skip
    for line, station in zip(table.lines, stations, strict=True):
        if not station.name or not np.isfinite(station.position).all():
            raise ReadError(f"{table.where}, line {line}: a station needs its name, x and y")
    _refuse_repeated(table.where, "station", [station.name for station in stations])
    _refuse_repeated(table.where, "serial", [s.serial for s in stations if s.serial])
    return stations


def _refuse_repeated(where, what, names):
    """Raise InputError where a name stands twice."""
    name, count = Counter(names).most_common(1)[0] if names else ("", 0)
    if count > 1:
        raise InputError(f"{where}: {what} {name!r} stands in two lines; name each one")


def _text(table: Table, name, k) -> str:
    """Return a text of a table, "" where it has none."""
    return table.values[name][k].strip() if name in table.values else ""


def _value(table: Table, name, k) -> float:
    """Return a number of a table, NaN where it has none."""
    return float(table.values[name][k]) if name in table.values else math.nan


def _position(table: Table, k) -> tuple[float, float, float]:
    """Return the place of a row: NaN where east or north is missing, height 0 where that is."""
    x, y, z = (_value(table, name, k) for name in "xyz")
    return x, y, 0.0 if math.isnan(z) else z


def _instant(where, line, text, slashed) -> str:
    """Return a date with or without time of day in ISO form; ``slashed`` reads 3/14/2026."""
    day, hour, minute, second, half, _ = re.fullmatch(_CLOCK, text.strip()).groups()
    for layout in DATES if len(slashed) > 1 else (*DATES, *slashed):
        with suppress(ValueError):
            when = datetime.strptime(day, layout)
            if hour is None:
                return when.date().isoformat()
            hours = int(hour) % 12 + 12 * (half in ("p", "P")) if half else int(hour)
            clock = timedelta(hours=hours, minutes=int(minute), seconds=float(second or 0.0))
            if clock < timedelta(days=1):
                return (when + clock).isoformat()
    why = ""
    if re.fullmatch(_SLASHES, day):
        why = (
            "; dates of the log stand in both orders" if slashed
            else "; no date of the log says whether day or month comes first"
        )  # fmt: skip
    raise ReadError(
        f"{where}, line {line}, date: expected one such as 2026-03-14 11:02, got {text[:40]!r}{why}"
    )


def _slashed(texts) -> list[str]:
    """Return in which order dates with slashes stand, none where all may be read both ways."""
    pairs = [(int(m[1]), int(m[2])) for m in map(re.compile(_SLASHES).match, texts) if m]
    return [
        layout for k, layout in enumerate(("%d/%m/%Y", "%m/%d/%Y"))
        if any(pair[k] > 12 for pair in pairs)
    ]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Joined:
    """Records by blast and station.

    Parameters
    ----------
    blasts : list of LoggedBlast
    stations : list of Station
    records : dict of (int, int) to RecordPeaks
        By number of blast and station.
    unjoined : list of (file, reason)
        Records that were not joined.
    clocks : dict of str to dict of int to int
        Number of records of a station by the hours that their clock is off.
    """

    blasts: list[LoggedBlast]
    stations: list[Station]
    records: dict[tuple[int, int], RecordPeaks]
    unjoined: list[tuple[str, str]]
    clocks: dict[str, dict[int, int]]

    @property
    def distance(self) -> np.ndarray:
        """Distances (n_blasts, n_stations) in m; NaN where a place is missing."""
        return np.linalg.norm(self.away, axis=-1)

    @property
    def away(self) -> np.ndarray:
        """Vectors from stations to blasts, (n_blasts, n_stations, 3) m."""
        blasts = np.array([blast.position for blast in self.blasts]).reshape(-1, 1, 3)
        stations = np.array([station.position for station in self.stations]).reshape(1, -1, 3)
        return blasts - stations

    def values(self, name: str, width: int = 0) -> np.ndarray:
        """Return an attribute of all records, (n_blasts, n_stations[, width]); NaN without one."""
        shape = (len(self.blasts), len(self.stations), *((width,) if width else ()))
        values = np.full(shape, np.nan)
        for key, record in self.records.items():
            values[key] = getattr(record, name)
        return values

    @property
    def silent(self) -> np.ndarray:
        """Whether a station that stood there did not trigger, (n_blasts, n_stations) bool.

        It stood there from its first to its last record, and its trigger level is known.
        """
        recorded = np.isfinite(self.values("pvs"))
        begun = np.maximum.accumulate(recorded, axis=0)
        goes_on = np.maximum.accumulate(recorded[::-1], axis=0)[::-1]
        known = np.isfinite([station.trigger for station in self.stations])
        return begun & goes_on & ~recorded & known


def joined(
    blasts: Sequence[LoggedBlast], stations: Sequence[Station], records: Sequence[RecordPeaks]
) -> Joined:
    """Join records to the blasts of a log by place and time, or by the names in their path.

    Parameters
    ----------
    blasts : sequence of LoggedBlast
        By time.
    stations : sequence of Station
    records : sequence of RecordPeaks

    Returns
    -------
    Joined
        A clock that is whole hours off, for a season or always, joins where three records or more
        fit only so. Of several records of one blast at one station the strongest counts.
    """
    unjoined: list[tuple[str, str]] = []
    own: dict[int, list[RecordPeaks]] = {}
    for record in records:
        number, reason = _station_of(record, stations)
        if number is None:
            unjoined.append((record.file, reason))
        else:
            own.setdefault(number, []).append(record)
    matches: dict[tuple[int, int], RecordPeaks] = {}
    clocks: dict[str, dict[int, int]] = {}
    fired = np.array([_seconds(blast.time) for blast in blasts])
    clock = np.array([blast.has_clock for blast in blasts])
    for number, rows in sorted(own.items()):
        hours = _clocks(fired, clock, [_seconds(row.time) for row in rows])
        off = Counter(hours[hours != 0].tolist())
        if off:
            clocks[stations[number].name] = dict(off)
        for row, late in zip(rows, hours, strict=True):
            blast, reason = _blast_of(blasts, fired, clock, row, float(late))
            before = None if blast is None else matches.get((blast, number))
            if blast is None:
                unjoined.append((row.file, reason))
            elif before is None:
                matches[blast, number] = row
            else:
                weak, strong = sorted((before, row), key=lambda each: each.pvs)
                matches[blast, number] = strong
                how = "is weaker than" if weak.pvs < strong.pvs else "repeats"
                unjoined.append((weak.file, f"{how} {strong.file} of the same blast"))
    return Joined(list(blasts), list(stations), matches, unjoined, clocks)


def _words(file):
    """Return the words of a path: folders, name without ending, and its parts."""
    path = Path(file)
    whole = [*path.parts[:-1], path.stem, *re.split(r"[\s_]+", path.stem)]
    return {word.casefold() for word in whole}


def _station_of(record, stations):
    """Return the number of the station of a record: by serial number, path or coordinates."""
    by_serial = [n for n, s in enumerate(stations) if s.serial and s.serial == record.serial]
    if by_serial:
        return by_serial[0], ""
    words = _words(record.file)
    named = [n for n, s in enumerate(stations) if s.name.casefold() in words]
    if len(named) == 1:
        return named[0], ""
    away = [_metres(record.geographic, station.geographic) for station in stations]
    if min(away) < BESIDE:
        return int(np.argmin(away)), ""
    serial = f"serial number {record.serial!r}" if record.serial else "no serial number"
    known = ", ".join(s.name for s in stations[:6])
    return None, (
        f"has {serial}, and its path names {'several' if named else 'none'} of the stations {known}"
    )


def _metres(first, second):
    """Return the distance in m of two places by latitude and longitude; infinite where unknown."""
    north, east = np.subtract(first, second)
    metres = EARTH * math.hypot(north, east * math.cos(first[0]))
    return math.inf if math.isnan(metres) else metres


def _seconds(time):
    """Return an ISO time, as its clock showed it, in s; NaN where there is none."""
    if not time:
        return math.nan
    return datetime.fromisoformat(time).replace(tzinfo=UTC).timestamp()


def _away(fired, clock, when):
    """Return the seconds from each blast to a record; 0 on the day of one without a clock."""
    since = when - fired
    return np.where(clock, np.abs(since), np.where((since >= 0) & (since < DAY), 0.0, math.inf))


def _clocks(fired, clock, times):
    """Return by how many hours the clock of each record of one station is off."""
    times = np.array(times)
    hours, waiting = np.zeros(len(times), dtype=int), np.isfinite(times)
    near = {
        h: np.array([_away(fired, clock, t - HOUR * h).min(initial=np.inf) for t in times])
        <= TOLERANCE
        for h in HOURS
    }
    while waiting.any():
        count = {h: int((near[h] & waiting).sum()) for h in HOURS}
        best = max(HOURS, key=count.__getitem__)
        best = best if count[best] >= max(FEWEST, SURER * count[0]) else 0
        if count[best] == 0:
            break
        hours[near[best] & waiting] = best
        waiting &= ~near[best]
    return hours


def _blast_of(blasts, fired, clock, record, hours):
    """Return the number of the blast of a record, None with the reason where there is none."""
    when = _seconds(record.time) - HOUR * hours
    if math.isnan(when):
        words = _words(record.file)
        named = [k for k, blast in enumerate(blasts) if blast.name.casefold() in words]
        if len(named) == 1:
            return named[0], ""
        return None, "has no time, and its path does not name one blast of the log"
    away = _away(fired, clock, when)
    near = np.flatnonzero(away <= TOLERANCE)
    began = f"began at {datetime.fromtimestamp(when, UTC):%Y-%m-%d %H:%M}"
    if not len(near):
        nearest = blasts[int(np.argmin(np.abs(when - fired)))]
        return None, (
            f"{began}, and no blast of the log was fired within {TOLERANCE / 60:.0f} min; the "
            f"nearest is {nearest.name}, {nearest.time}"
        )
    first, *others = sorted(near.tolist(), key=lambda k: away[k])
    if others and away[others[0]] - away[first] < APART:
        names = f"{blasts[first].name} and {blasts[others[0]].name}"
        return None, f"{began}, when {names} fit alike; log their times"
    return first, ""
