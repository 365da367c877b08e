"""Compliance: peaks of a blast against limit curves, and how each share of a limit follows."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ..errors import Finding
from ..signals.comparison import BUILDING, LimitCurve, load_limits
from ..signals.seismogram import Seismogram
from ..signals.spectra import dominant_frequency, zero_crossing_frequency
from ..units import plain_number
from .peaks import LEVEL, PeakDistribution
from .published_laws import BY_NAME, HARD_ROCK

ORIENTATION = ("din_4150_dwelling", "usbm_plaster")  # shown where no standard is chosen
OF_WALLS = ("rock_intact",)  # the same of a wall of rock
METHOD = "zero crossing at the peak"
SUM = "vector sum"


@dataclass(frozen=True)
class Assessment:
    """Peak of a blast at one receiver against one limit curve.

    Parameters
    ----------
    receiver, kind : str
        Receiver, and "simulated" or "recorded".
    curve : str
        Key of the limit curve.
    quantity : str
        Component that comes nearest to the limit, or "vector sum".
    peak : float, m/s
        Of that quantity.
    frequency : float, Hz
        By zero crossing at the peak; NaN without crossings on both sides.
    limit : float, m/s
        At that frequency, the lowest of the curve where there is none; NaN where the curve has no
        value.
    vector_sum : float, m/s
        Largest length of the velocity vector at one instant.
    distance, charge : float, m, kg
        Of the 8 ms window that is nearest by scaled distance; NaN if unknown.
    high : float, m/s
        95 % of such blasts stay below it; NaN for a record, and where no scatter is known.
    level_by : str
        Law that sets the level of a simulated motion, "" where none does.
    transfer : float
        Factor on the peak of the free ground to that of the place which the curve judges, 1 where
        it judges the ground or the factor is not known.
    spectral_frequency, spectral_limit : float, Hz, m/s
        Frequency of the same component by its spectrum, and the limit there; NaN where unknown.
    """

    receiver: str
    kind: str
    curve: str
    quantity: str
    peak: float
    frequency: float
    limit: float
    vector_sum: float
    distance: float = math.nan
    charge: float = math.nan
    high: float = math.nan
    level_by: str = ""
    transfer: float = 1.0
    spectral_frequency: float = math.nan
    spectral_limit: float = math.nan

    @property
    def share(self) -> float:
        """Peak over limit; above 1 it is exceeded."""
        return self.peak / self.limit

    @property
    def scaled_distance(self) -> float:
        """Distance over the square root of the charge in 8 ms, m/kg^0.5."""
        return self.distance / math.sqrt(self.charge) if self.charge > 0.0 else math.nan

    def table(self) -> dict[str, Any]:
        """Return all values for a table: SI, with share and scaled distance."""
        return asdict(self) | {"share": self.share, "scaled_distance": self.scaled_distance}


def assess(
    motion: Seismogram,
    key: str,
    *,
    kind: str = "simulated",
    window: tuple[float, float] | None = None,
    receiver: str | None = None,
    error: tuple[PeakDistribution, str] | None = None,
    transfer: float | None = None,
) -> Assessment | None:
    """Compare the peaks of a motion with a limit curve.

    Parameters
    ----------
    motion : Seismogram
    key : str
        Of the limit curve, as in `load_limits`.
    kind : str
    window : tuple of 2 float, optional
        Distance in m and charge in kg in 8 ms.
    receiver : str, optional
        The label of the motion by default.
    error : tuple of PeakDistribution and str, optional
        Of the peak over that of the motion (1 as much), and the law that it comes from.
    transfer : float, optional
        From the peak of the free ground to that of a place of the building, where the curve judges
        one.

    Returns
    -------
    Assessment or None
        Of the component with the largest share of its limit; None where the motion has none of the
        components that the curve limits, or is still.

    Notes
    -----
    Each component is taken at its own frequency, half the inverse of the time between the zero
    crossings on both sides of its peak. The vector sum is taken at the frequency of the largest
    component.

    Examples
    --------
    >>> time = np.arange(0.0, 1.0, 1e-3)
    >>> wave = 0.004 * np.sin(20.0 * np.pi * time) * np.exp(-3.0 * time)
    >>> row = assess(Seismogram(np.c_[wave, 0.0 * wave, 0.5 * wave], 1e-3), "din_4150_dwelling")
    >>> row.quantity, round(row.frequency, 1), round(1e3 * row.limit, 2), round(row.share, 2)
    ('east', 10.0, 5.0, 0.74)
    """
    curve, factor = load_limits()[key], 1.0
    if curve.applies_to in BUILDING and transfer is not None:
        factor = transfer
    peaks = ComponentPeaks(
        motion.components, factor * motion.ppv, zero_crossing_frequency(motion).hz,
        factor * motion.pvs,
    )  # fmt: skip
    name = motion.label if receiver is None else receiver
    row = assess_peaks(peaks, key, name, kind, window=window, error=error)
    if row is None:
        return None
    component = row.quantity
    if component == SUM:
        component = motion.components[int(np.nanargmax(motion.ppv))]
    hz = float(dominant_frequency(motion).hz[motion.components.index(component)])
    limit = math.nan if math.isnan(hz) else limit_at(curve, hz)
    return replace(row, transfer=factor, spectral_frequency=hz, spectral_limit=limit)


class ComponentPeaks(NamedTuple):
    """ComponentPeaks of a motion: components, m/s, frequencies in Hz, and the vector sum in m/s."""

    components: Sequence[str]
    ppv: Sequence[float] | np.ndarray
    hz: Sequence[float] | np.ndarray
    pvs: float


def assess_peaks(
    peaks: ComponentPeaks,
    key: str,
    receiver: str,
    kind: str,
    *,
    window: tuple[float, float] | None = None,
    error: tuple[PeakDistribution, str] | None = None,
) -> Assessment | None:
    """Compare peaks whose motion need not be at hand with a limit curve, as `assess`."""
    curve = load_limits()[key]
    distance, charge = window or (math.nan, math.nan)
    above = math.nan if error is None else float(error[0].level(LEVEL))
    rows = [
        Assessment(
            receiver, kind, key, name, size, hz, limit_at(curve, hz), float(peaks.pvs), distance,
            charge, above * size, "" if error is None else error[1],
        )
        for name, size, hz in peaks_under(peaks, curve.quantity)
        if size > 0.0
    ]  # fmt: skip
    known = [row for row in rows if not math.isnan(row.limit)]
    return max(known or rows, key=lambda row: row.share if known else row.peak, default=None)


def peaks_under(peaks: ComponentPeaks, quantity: str) -> list[tuple[str, float, float]]:
    """Return name, peak in m/s and frequency in Hz of what a curve for a quantity limits."""
    rows = [
        (name, float(peak), float(f))
        for name, peak, f in zip(peaks.components, peaks.ppv, peaks.hz, strict=True)
        if not np.isnan(peak)
    ]
    if quantity == SUM:
        return [(SUM, float(peaks.pvs), max(rows, key=lambda row: row[1])[2])]
    limited = {
        "vertical component": {"vertical"},
        "horizontal component": {*peaks.components} - {"vertical"},
    }.get(quantity, {*peaks.components})
    return [row for row in rows if row[0] in limited]


def limit_at(curve: LimitCurve, frequency: float) -> float:
    """Return the limit in m/s at a frequency in Hz, the lowest of the curve where that is NaN."""
    if math.isnan(frequency):
        return float(curve.corners[:, 1].min())
    return float(curve.limit(frequency))


def assess_all(
    motions: dict[str, dict[str, Seismogram]],
    windows: dict[str, tuple[float, float] | None],
    curves: Sequence[str],
    errors: Mapping[str, tuple[PeakDistribution, str] | None] = MappingProxyType({}),
    transfers: Mapping[str, float | None] = MappingProxyType({}),
) -> list[Assessment]:
    """Compare motions of all receivers with limit curves.

    Parameters
    ----------
    motions : dict of str to dict of str to Seismogram
        By "recorded" and "simulated", then by receiver.
    windows : dict of str to tuple of 2 float, or None
        Distance in m and charge in kg in 8 ms of each receiver.
    curves : sequence of str
    errors : mapping of str to tuple of PeakDistribution and str, or None
        Of simulated peaks by receiver, as `assess`.
    transfers : mapping of str to float or None
        Of simulated peaks by receiver, as `assess`; a record is of its own place.
    """
    rows = (
        assess(
            motion,
            key,
            kind=kind,
            window=windows.get(receiver),
            receiver=receiver,
            error=errors.get(receiver) if kind == "simulated" else None,
            transfer=transfers.get(receiver) if kind == "simulated" else None,
        )
        for kind, at_receivers in motions.items()
        for receiver, motion in at_receivers.items()
        for key in curves
    )
    return [row for row in rows if row is not None]


def free_field(curves: Sequence[str], receivers: Sequence[str]) -> Finding | None:
    """D51: free ground beside limits of a place of a building; None where none is compared so.

    Parameters
    ----------
    curves : sequence of str
        Keys of the chosen curves.
    receivers : sequence of str
        Names of those whose transfer from the ground to the building is not given.
    """
    limits = load_limits()
    names = [f"{limits[key].name} ({limits[key].applies_to})" for key in curves
             if limits[key].applies_to in BUILDING]  # fmt: skip
    if not names or not receivers:
        return None
    return Finding(
        "D51",
        "Free field: not the quantity of the standard",
        f"{'; '.join(names)}: judged at that place of the building. The simulation gives the free "
        f"ground at {_some(receivers)}, so the comparison presumes that both move alike; top "
        "floors move more. Give receivers.transfer, the peak at that place over that of the free "
        "ground, from records of one blast at both.",
        numbers={"receivers": float(len(receivers))},
    )


def conclusion(rows: Iterable[dict], chosen: bool) -> str:
    """Return whether the peaks are allowed, one or two sentences.

    Parameters
    ----------
    rows : iterable of dict
        As `Assessment.table`.
    chosen : bool
        Whether the project names its limit curves.
    """
    names = load_limits()
    known = [row for row in rows if not _missing(row["share"])]
    if not known:
        return "Not assessed: no limit curve has a value at the frequencies of the peaks."
    worst = max(known, key=share_at_level)
    text = (
        f"{_percent(share_at_level(worst))} the limit of {names[worst['curve']].name} at "
        f"{worst['receiver']}, {worst['kind']} ({plain_number(1e3 * worst['peak'])} of "
        f"{plain_number(1e3 * worst['limit'])} mm/s"
    )
    text += "" if _missing(worst["frequency"]) else f" at {plain_number(worst['frequency'])} Hz"
    text += _high_words(worst) + ")"
    over = sorted({row["receiver"] for row in known if share_at_level(row) > 1.0})
    if not chosen:
        return (
            f"No standard is chosen (run.limit_curves). For orientation: {text}; "
            f"{'above it at ' + _some(over) if over else 'below it everywhere'}."
        )
    words = f"Not allowed at {_some(over)}: {text}." if over else f"Allowed: at most {text}."
    words += _by_spectrum(known)
    law = unsigned(known)
    if not law:
        return words
    return (
        f"Not to be signed: the level stands on a published law alone ({law}); calibrate it by one "
        "recorded blast of known holes, charges and distance (pyblast source, pyblast sitelaw). "
        f"By that law {words[0].lower()}{words[1:]}"
    )


def _by_spectrum(rows):
    """Return where the frequency of the spectrum decides differently, as a sentence; or ""."""
    for row in rows:
        limit, high = row.get("spectral_limit"), row.get("high")
        if _missing(limit):
            continue
        share = (row["peak"] if _missing(high) else max(row["peak"], high)) / limit
        if (share > 1.0) != (share_at_level(row) > 1.0):
            return (
                f" By the frequency of the spectrum at {row['receiver']}, "
                f"{plain_number(row['spectral_frequency'])} Hz, the limit is "
                f"{plain_number(1e3 * limit)} mm/s and the share {_percent(share)} it: both "
                "frequencies do not decide alike, so say by which one the standard asks."
            )
    return ""


def share_at_level(row: dict) -> float:
    """Return the share of its limit that 95 % of such blasts stay below, that of a record itself.

    Parameters
    ----------
    row : dict
        As `Assessment.table`; NaN without a limit.
    """
    if _missing(row["share"]):
        return math.nan
    high = row.get("high")
    return row["share"] if _missing(high) else max(row["share"], high / row["limit"])


def unsigned(rows: Iterable[dict]) -> str:
    """Return the published law on which alone the level of simulated peaks stands; "" if none."""
    laws = {row.get("level_by") for row in rows} & set(BY_NAME)
    return ", ".join(sorted(laws))


def _high_words(row):
    """Return which level 95 % of such blasts stay below, as part of a sentence."""
    if _missing(row.get("high")):
        return ""
    return (
        f"; {100 * LEVEL:g} % of such blasts stay below {plain_number(1e3 * row['high'])} mm/s by "
        f"{row['level_by']}"
    )


def _some(names):
    """List up to four names."""
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    return ", ".join(names[:4]) + more


def _percent(share):
    """Write how much of a limit a share is: percent, or a factor from 10 up."""
    if share >= 10.0:
        return f"{plain_number(share)} times"
    return f"{plain_number(100.0 * share)} % of"


def _missing(value):
    """Tell whether a number is missing: None from JSON, or NaN."""
    return value is None or math.isnan(value)


def explain(row: dict) -> list[str]:
    """Explain the numbers of a row: formula, inputs, limit, and what would pass.

    Parameters
    ----------
    row : dict
        As `Assessment.table`.

    Returns
    -------
    list of str
        Sentences.

    Notes
    -----
    Charge and distance that would pass follow from the exponents of a published law of scaled
    distance, ``PPV = k (R / W^0.5)^-beta``; a site law of one's own is better.
    """
    curve, peak = load_limits()[row["curve"]], row["peak"]
    what = "|v(t)|, v the velocity vector" if row["quantity"] == SUM else f"|{row['quantity']}(t)|"
    lines = [
        f"Peak = largest {what} of the {row['kind']} motion = {plain_number(1e3 * peak)} mm/s; "
        f"vector sum, at one instant, {plain_number(1e3 * row['vector_sum'])} mm/s."
    ]
    if row.get("transfer", 1.0) != 1.0:
        lines.append(
            f"Both are {plain_number(row['transfer'])} times those of the free ground, for the "
            f"{curve.applies_to} (receivers.transfer)."
        )
    hz, limit = row["frequency"], row["limit"]
    if _missing(hz):
        lines.append(
            "Frequency: the motion does not cross zero on both sides of the peak, so the lowest "
            "value of the curve is taken."
        )
    else:
        lines.append(
            f"Frequency = 1 / (2 x {plain_number(500.0 / hz)} ms between the zero crossings on "
            f"both sides of the peak) = {plain_number(hz)} Hz."
        )
    if not _missing(row["scaled_distance"]):
        lines.append(
            f"Scaled distance = {plain_number(row['distance'])} m / sqrt("
            f"{plain_number(row['charge'])} kg in 8 ms) = {plain_number(row['scaled_distance'])} "
            "m/kg^0.5."
        )
    if _missing(limit):
        lowest = plain_number(float(curve.corners[0, 0]))
        return [*lines, f"Limit: {curve.name} begins at {lowest} Hz and has no value here."]
    lines.append(f"Limit = {plain_number(1e3 * limit)} mm/s: {_corners_around(curve, hz)}.")
    lines.append(f"Share = peak / limit = {plain_number(row['share'])}.")
    return [*lines, _what_passes(row)]


def _corners_around(curve, hz):
    """Return between which corners of the curve a frequency in Hz lies."""
    corners = curve.corners
    if len(corners) == 1 or _missing(hz):
        return f"{curve.name}, lowest value"
    if hz >= corners[-1, 0]:
        return f"{curve.name}, last corner at {plain_number(float(corners[-1, 0]))} Hz"
    k = int(np.searchsorted(corners[:, 0], hz, side="right"))
    (f1, v1), (f2, v2) = corners[k - 1], corners[k]
    return (
        f"{curve.name}, {curve.interpolation} between {plain_number(1e3 * float(v1))} mm/s at "
        f"{plain_number(float(f1))} Hz and {plain_number(1e3 * float(v2))} mm/s at "
        f"{plain_number(float(f2))} Hz"
    )


def _what_passes(row):
    """Return what would pass, or how much room is left."""
    share, law = share_at_level(row), HARD_ROCK
    head = f"At this frequency {plain_number(1e3 * row['limit'])} mm/s would pass"
    if not _missing(row.get("high")):
        head += f" in {100 * LEVEL:g} % of blasts"
    if _missing(row["scaled_distance"]):
        return f"{head}: {plain_number(1.0 / share)} times this peak."
    charge = row["charge"] * share ** (-2.0 / law.beta)
    distance = row["distance"] * share ** (1.0 / law.beta)
    return (
        f"{head}: about {plain_number(charge)} kg in 8 ms at this distance, or this charge at "
        f"{plain_number(distance)} m, where peaks fall as (R/W^0.5)^-{plain_number(law.beta)} "
        f"({law.name}; fit your own by pyblast sitelaw)."
    )


HEADS = (
    ("receiver", "receiver", 1.0), ("motion", "kind", 1.0), ("limit curve", "curve", 1.0),
    ("component", "quantity", 1.0), ("ppv_mm_per_s", "peak", 1e3), ("frequency_hz", "frequency", 1),
    ("vector_sum_mm_per_s", "vector_sum", 1e3), ("distance_m", "distance", 1.0),
    ("charge_in_8_ms_kg", "charge", 1.0), ("scaled_distance_m_per_kg05", "scaled_distance", 1.0),
    ("limit_mm_per_s", "limit", 1e3), ("share_of_limit", "share", 1.0),
    ("ppv_of_95_percent_mm_per_s", "high", 1e3), ("level_by", "level_by", 1.0),
)  # fmt: skip


def compliance_csv(rows: Iterable[dict]) -> str:
    """Return the table of compliance as CSV; empty cells where a value is missing.

    Parameters
    ----------
    rows : iterable of dict
        As `Assessment.table`.
    """
    lines = [",".join(head.replace(" ", "_") for head, _, _ in HEADS) + ",frequency_method"]
    for row in rows:
        cells = [_cell(row[key], factor) for _, key, factor in HEADS]
        lines.append(",".join([*cells, METHOD]))
    return "\n".join(lines) + "\n"


def _cell(value, factor):
    """Return one cell of a CSV table."""
    if isinstance(value, str):
        quoted = value.replace('"', '""')
        return f'"{quoted}"' if any(c in value for c in ',"\n\r') else value
    return "" if _missing(value) else f"{factor * value:.6g}"
