"""Shot gathers: all channels of a geophone line for one shot, from SEG-2 and SEG-Y."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, ReadError
from ..units import FACTORS
from .raw import MAX_FILE_BYTES, at_level, is_dead, plateau_level, read_bytes
from .seismic import read_traces, sniff_seismic

_LENGTH_UNITS = {"METERS": "m", "CENTIMETERS": "cm", "FEET": "ft", "MILLIMETERS": "mm"}


@dataclass(frozen=True, eq=False)
class Gather:
    """Shot gather: the channels of a geophone line for one shot.

    Parameters
    ----------
    data : (n_channels, n_samples) float64, ``unit``
    dt : float, s
    start : float, s
        Time of the first sample from the trigger; negative with a pre-trigger.
    source_position : (3,) float64, m
        NaN where the header has none.
    receiver_positions : (n_channels, 3) float64, m
        NaN where the headers have none, or the same for every channel.
    unit : str
        "V" where the header scales the samples, otherwise "counts".
    dead : (n_channels,) bool
        Channels with constant samples.
    clipped : (n_channels, n_samples) bool
        Samples at the converter's full scale.
    full_scale : float or None, ``unit``
        As given, or detected as a plateau in one of the channels; None where nothing clips.
    header : dict
        Header values; a tuple where they differ between channels.
    """

    data: np.ndarray
    dt: float
    start: float
    source_position: np.ndarray
    receiver_positions: np.ndarray
    unit: str
    dead: np.ndarray
    clipped: np.ndarray
    full_scale: float | None = None
    label: str = ""
    time: str = ""
    header: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the shapes."""
        n_channels, n_samples = np.shape(self.data)
        expected = {
            "receiver_positions": (n_channels, 3), "source_position": (3,),
            "dead": (n_channels,), "clipped": (n_channels, n_samples),
        }  # fmt: skip
        for name, shape in expected.items():
            if np.shape(getattr(self, name)) != shape:
                raise InputError(
                    f"gather.{name}: must have shape {shape}, got {np.shape(getattr(self, name))}"
                )

    @property
    def times(self) -> np.ndarray:
        """Time of each sample, (n_samples,) s."""
        return self.start + self.dt * np.arange(self.data.shape[1])

    @property
    def offsets(self) -> np.ndarray:
        """Distance of each receiver from the source, (n_channels,) m."""
        return np.linalg.norm(self.receiver_positions - self.source_position, axis=1)


def read_gather(
    path: str | Path,
    format: str | None = None,
    *,
    full_scale: float | None = None,
    max_bytes: int = MAX_FILE_BYTES,
) -> Gather:
    """Read a shot gather from SEG-2 or SEG-Y.

    Parameters
    ----------
    path : str or Path
    format : str, optional
        "SEG2" or "SEGY"; detected from the content if not given.
    full_scale : float, optional
        Level of clipping in the unit of the file; detected as a plateau if not given.
    max_bytes : int
        Largest size of the file.

    Raises
    ------
    InputError
        If ``format`` is unknown.
    ReadError
        If the file has another format, is cut short, or its channels differ in sampling.

    Notes
    -----
    The SEG-2 header DESCALING_FACTOR turns counts into millivolts; SEG-2 positions are in the
    header's UNITS. A full scale detected in one channel holds for all: they share a converter.

    Examples
    --------
    >>> gather = read_gather("shot_012.sg2")  # doctest: +SKIP
    >>> gather.offsets.max()  # doctest: +SKIP
    """
    path = Path(path)
    content = read_bytes(path, max_bytes)
    format = format or sniff_seismic(content)
    if format not in _HEADERS:
        raise (ReadError if format is None else InputError)(
            f"{path}: expected a gather in SEG2 or SEGY, got {format or 'neither'}"
        )
    traces = read_traces(path, content, format)
    if len({(trace.stats.npts, trace.stats.delta) for trace in traces}) > 1:
        raise ReadError(f"{path}: channels differ in number of samples or sampling rate")
    values = _HEADERS[format](path, traces)
    data = np.array([trace.data for trace in traces], dtype=np.float64)
    data *= np.reshape(values.pop("factor"), (-1, 1))
    dead = np.array([is_dead(samples) for samples in data])
    clipped, full_scale = _clipped(data, full_scale)
    return Gather(
        data=data, dt=float(traces[0].stats.delta), dead=dead, clipped=clipped,
        full_scale=full_scale, label=path.stem, time=str(traces[0].stats.starttime), **values,
    )  # fmt: skip


def _clipped(data, full_scale):
    """Return the clipped samples and the full scale, given or detected in any channel."""
    if full_scale is not None:
        return np.abs(data) >= full_scale * (1.0 - 1e-6), full_scale
    levels = [level for level in map(plateau_level, data) if level is not None]
    if not levels:
        return np.zeros(data.shape, bool), None
    return np.any([at_level(np.abs(data), level) for level in levels], axis=0), max(levels)


def _seg2_header(path, traces):
    """Read scale, delay and positions from SEG-2 headers."""
    headers = [dict(trace.stats.seg2) for trace in traces]
    scaled = [header.get("DESCALING_FACTOR") for header in headers]
    factor = 1.0
    if all(scaled):
        factor = FACTORS["mv"] * np.array(
            [_number(path, n, "DESCALING_FACTOR", text) for n, text in enumerate(scaled)]
        )
    delays = {_number(path, n, "DELAY", h.get("DELAY", "0")) for n, h in enumerate(headers)}
    if len(delays) > 1:
        raise ReadError(f"{path}: channels start at different times: {sorted(delays)} s")
    symbol = _LENGTH_UNITS.get(str(headers[0].get("UNITS", "METERS")).upper(), "m")
    receivers = FACTORS[symbol] * np.array(
        [_place(path, n, "RECEIVER_LOCATION", header) for n, header in enumerate(headers)]
    )
    if len(traces) > 1 and np.all(receivers == receivers[0]):
        receivers = np.full((len(traces), 3), np.nan)
    return {
        "factor": factor, "unit": "V" if all(scaled) else "counts", "start": delays.pop(),
        "receiver_positions": receivers, "header": _summary(headers),
        "source_position": FACTORS[symbol] * _place(path, 0, "SOURCE_LOCATION", headers[0]),
    }  # fmt: skip


def _segy_header(path, traces):
    """Read delay and positions from SEG-Y trace headers."""
    headers = [trace.stats.segy.trace_header for trace in traces]
    delays = {header.delay_recording_time for header in headers}
    if len(delays) > 1:
        raise ReadError(f"{path}: channels start at different times: {sorted(delays)} ms")
    places = {}
    for side in ("source_coordinate", "group_coordinate"):
        scale = [float(h.scalar_to_be_applied_to_all_coordinates or 1) for h in headers]
        scale = np.array([s if s > 0 else -1.0 / s for s in scale])
        xy = np.array([[getattr(h, f"{side}_x"), getattr(h, f"{side}_y")] for h in headers])
        places[side] = np.column_stack([scale[:, None] * xy, np.zeros(len(headers))])
    receivers = places["group_coordinate"]
    if len(traces) > 1 and np.all(receivers == receivers[0]):
        receivers = np.full((len(traces), 3), np.nan)
    return {
        "factor": 1.0, "unit": "counts", "start": FACTORS["ms"] * delays.pop(),
        "receiver_positions": receivers, "source_position": places["source_coordinate"][0],
        "header": {"textual": "SEGY"},
    }  # fmt: skip


def _place(path, channel, key, header):
    """Read one to three coordinates; NaN if absent."""
    texts = str(header.get(key, "")).split()[:3]
    values = [_number(path, channel, key, text) for text in texts]
    return np.array(values + [0.0] * (3 - len(values))) if values else np.full(3, np.nan)


def _number(path, channel, key, text):
    """Read a number of a channel's header."""
    try:
        value = float(str(text).split()[0])
    except (ValueError, IndexError):
        value = np.nan
    if not np.isfinite(value):
        raise ReadError(f"{path}, channel {channel + 1}, {key}: expected a number, got '{text}'")
    return value


def _summary(headers):
    """Return one value per key where all channels agree, a tuple where they differ."""
    keys = dict.fromkeys(key for header in headers for key in header)
    columns = {key: [header.get(key, "") for header in headers] for key in keys}
    return {
        key: column[0] if all(value == column[0] for value in column) else tuple(column)
        for key, column in columns.items()
    }


_HEADERS = {"SEG2": _seg2_header, "SEGY": _segy_header}
