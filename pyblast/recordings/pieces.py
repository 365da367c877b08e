"""Pieces of channels: joined by their times, and cut to the time that channels have in common."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import PyblastWarning, ReadError
from ..readers.provenance import FileRead

if TYPE_CHECKING:
    import obspy

_MINISEED_CLOCK = 1.001e-6  # s, step of the times of its pieces
_FEW = 5  # samples at an end that go without a word
_LARGER = 1.1  # a peak outside of the common time over that inside, to count
_CONSIDERABLE = 0.5  # such a peak over that of all channels


def leave_out(path: Path | str, entry: FileRead, part: str, why: str) -> None:
    """Log and warn of a part of a file that is left out."""
    entry.dropped(part, why)
    warnings.warn(f"{path}: {part} is left out, {why}", PyblastWarning, stacklevel=6)


class Stretch(NamedTuple):
    """Stretch of samples (n,) of a channel without gaps, from a start in s."""

    name: str
    start: float
    samples: np.ndarray


def stretches_of(
    path: Path | str, traces: "Sequence[obspy.Trace]"
) -> tuple[list[list[Stretch]], float]:
    """Join the pieces of each channel; return its stretches between gaps, and the interval in s.

    Pieces that touch or overlap with equal samples are joined, times are taken to the nearest
    sample. Starts count from the first of all traces.

    Raises
    ------
    ReadError
        If sampling or types differ, or pieces overlap with other samples.
    """
    dt = common_step([trace.stats.delta for trace in traces], max(t.stats.npts for t in traces))
    if dt is None:
        raise ReadError(f"{path}: channels differ in sampling rate")
    zero = min(trace.stats.starttime for trace in traces)
    channels: dict[str, list] = {}
    for trace in sorted(traces, key=lambda trace: trace.stats.starttime):
        start, parts = trace.stats.starttime - zero, channels.setdefault(trace.id, [])
        if parts and parts[-1].samples.dtype.kind != trace.data.dtype.kind:
            raise ReadError(f"{path}, {trace.id}: pieces of a channel differ in type")
        if not parts:
            parts.append(Stretch(trace.id, start, trace.data))
            continue
        first = parts[-1]
        missing = _missing(first, start, dt, trace.stats.get("_format"))
        if missing > 0:
            parts.append(Stretch(trace.id, start, trace.data))
            continue
        shared, own = min(-missing, len(trace.data)), first.samples[missing:] if missing else []
        if shared and not np.array_equal(own[:shared], trace.data[:shared]):
            raise ReadError(
                f"{path}, {trace.id}: overlap of {-missing * dt:g} s at {trace.stats.starttime} "
                "with other samples, cut the file there"
            )
        parts[-1] = first._replace(samples=np.concatenate([first.samples, trace.data[shared:]]))
    return list(channels.values()), dt


def common_step(steps: Sequence[float], n_samples: int) -> float | None:
    """Return the interval that steps share but for rounding, None if they don't.

    Rounded steps drift apart by less than half a sample over a record, and by no more than 0.1 %.
    """
    middle = float(np.median(steps))
    return middle if np.ptp(steps) / middle < min(1e-3, 0.5 / max(n_samples, 1)) else None


def _missing(first, start, dt, file_format):
    """Return the samples between a stretch and a piece from a start in s; negative: they overlap.

    A start is exact to what its header can say: in miniSEED pieces nearer than that touch.
    """
    gap = start - first.start - len(first.samples) * dt
    return 0 if file_format == "MSEED" and abs(gap) <= _MINISEED_CLOCK else round(gap / dt)


class Window(NamedTuple):
    """Common time of channels: their stretches, its start in s, and its number of samples."""

    stretches: list[Stretch]
    start: float
    length: int

    def skip(self, number: int, dt: float) -> int:
        """Return how many samples of one of its channels come before it."""
        return round((self.start - self.stretches[number].start) / dt)

    def samples(self, number: int, dt: float) -> np.ndarray:
        """Return the samples (length,) of one of its channels."""
        skip = self.skip(number, dt)
        return self.stretches[number].samples[skip : skip + self.length]

    def within(self, dt: float) -> "Window":
        """Return the window with the samples that all of its channels have."""
        parts = enumerate(self.stretches)
        return self._replace(length=min(len(part.samples) - self.skip(n, dt) for n, part in parts))


def common_windows(
    path: Path | str, channels: Sequence[Sequence[Stretch]], dt: float, entry: FileRead
) -> list[Window]:
    """Return the times that channels have in common: one, or several where there are gaps.

    A channel that would cut the peak of another is left out; both that and what else is cut is
    logged and warned of.

    Raises
    ------
    ReadError
        If the channels have no two samples in common.
    """
    channels = list(channels)
    if all(len(parts) == 1 for parts in channels):
        while (short := _cutting([parts[0] for parts in channels], dt)) is not None:
            (part,) = channels.pop(short)
            leave_out(
                path, entry, f"channel {part.name}",
                f"its {len(part.samples) * dt:g} s would cut the peak of another channel",
            )  # fmt: skip
    windows = [Window([part], part.start, len(part.samples)) for part in channels[0]]
    for parts in channels[1:]:
        windows = [
            shared for window in windows for part in parts
            if (shared := _shared(window, part, dt)) is not None
        ]  # fmt: skip
    windows = [window.within(dt) for window in windows]
    windows = [window for window in windows if window.length > 1]
    if not windows:
        raise ReadError(f"{path}: channels have no two samples at a time in common")
    if len(windows) > 1:
        text = f"{len(windows)} records: gaps lie between their stretches"
        entry.remark(text)
        warnings.warn(f"{path}: read as {text}", PyblastWarning, stacklevel=5)
    else:
        _say_ends(path, entry, windows[0], dt)
    return windows


def _say_ends(path, entry, window, dt):
    """Say which channel begins late or ends early, and how much of the others that cuts."""
    parts = window.stretches
    starts = np.array([part.start for part in parts])
    ends = starts + dt * np.array([len(part.samples) for part in parts])
    for times, n, word in ((starts, starts.argmax(), "begins"), (ends, ends.argmin(), "ends")):
        if np.ptp(times) > (_FEW + 0.5) * dt:
            what = "late" if word == "begins" else "early"
            amount = f"up to {np.ptp(times):.4g} s of the other channels"
            _cut(path, entry, f"{amount}: {parts[n].name} {word} {what}")


def _cut(path, entry, text):
    """Log and warn of samples that are not used."""
    part, _, why = text.partition(": ")
    entry.cut(part, why)
    warnings.warn(f"{path}: cut are {text}", PyblastWarning, stacklevel=6)


def _shared(window, part, dt):
    """Return a window with one more stretch, None where they share fewer than two samples."""
    start = max(window.start, part.start)
    end = min(window.start + window.length * dt, part.start + len(part.samples) * dt)
    length = round((end - start) / dt)
    return Window([*window.stretches, part], start, length) if length > 1 else None


def _cutting(parts, dt):
    """Return the channel whose span cuts a considerable peak of another one, None for none."""
    if len(parts) < 2:
        return None
    starts = np.array([part.start for part in parts])
    ends = starts + dt * np.array([len(part.samples) for part in parts])
    sizes = [np.abs(part.samples.astype(float)) for part in parts]
    largest, begin, end = max(size.max() for size in sizes), starts.max(), ends.min()
    for start, size in zip(starts, sizes, strict=True):
        first, last = max(0, round((begin - start) / dt)), max(0, round((end - start) / dt))
        inside = size[first:last].max(initial=0.0)
        if size.max() > max(_LARGER * inside, _CONSIDERABLE * largest):
            spans = [
                np.delete(ends, n).min() - np.delete(starts, n).max() for n in range(len(parts))
            ]
            return int(np.argmax(spans))
    return None
