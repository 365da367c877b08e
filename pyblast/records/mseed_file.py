"""Motion at many receivers as miniSEED, as seismographs write it."""

import io

import numpy as np
from obspy import Stream, Trace, UTCDateTime


def mseed_bytes(motion, channels, dt, start):
    """Return the bytes of a file with the components of many receivers.

    Parameters
    ----------
    motion : (n_receivers, 3, n_samples) float, m/s
    channels : sequence of sequence of str
        Identifier of each, such as ``PB.R01..HHE``.
    dt : float, s
    start : str
        ISO instant of the first sample.
    """
    traces = []
    for three, names in zip(motion, channels, strict=True):
        for samples, name in zip(three, names, strict=True):
            header = {"delta": dt, "starttime": UTCDateTime(start)}
            trace = Trace(np.asarray(samples, dtype=np.float32), header)
            trace.id = name
            traces.append(trace)
    buffer = io.BytesIO()
    Stream(traces).write(buffer, format="MSEED")
    return buffer.getvalue()
