"""Motion at many receivers as miniSEED, as seismographs write it."""

import io

import numpy as np
from obspy import Stream, Trace, UTCDateTime

from ..errors import InputError
from .seismic_formats import SEED_COMPONENTS

LONGEST = 5  # characters of a station that the format holds
BANDS = (1000.0, "G"), (250.0, "D"), (80.0, "E"), (0.0, "S")  # of channels, by samples a second


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


def channel_names(station, known, dt):
    """Return what the channels east, north and vertical of a record are called in a file.

    Parameters
    ----------
    station : str
    known : dict of str to str
        Identifiers by component, as the record was read; what lacks is called alike.
    dt : float, s

    Raises
    ------
    InputError
        If nothing is known, and the format can't hold the name of the station.

    Notes
    -----
    Unknown channels are those of geophones, ``.R01..GPE``: SEED manual 2.4, appendix A.
    """
    if not known and len(station) > LONGEST:
        raise InputError(
            f"receiver {station!r}: miniSEED holds {LONGEST} characters of a name, shorten it"
        )
    band = next(letter for least, letter in BANDS if round(1.0 / dt, 6) >= least)
    stem = next(iter(known.values()), f".{station}..{band}P?")[:-1]
    return [known.get(name, stem + letter) for letter, name in SEED_COMPONENTS.items()]
