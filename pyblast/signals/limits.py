"""Vibration limit curves of standards; the data in limits.toml are unverified."""

import tomllib
from dataclasses import dataclass
from importlib import resources

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..units import to_si

INTERPOLATIONS = ("log-log", "linear")
QUANTITIES = ("peak component", "vertical component", "horizontal component", "vector sum")


@dataclass(frozen=True, eq=False)
class LimitCurve:
    """Limit of particle velocity as a function of frequency.

    Parameters
    ----------
    name, source : str
    verified : bool
        Whether a named person compared the numbers with the standard. An unverified curve is
        plotted with that label and gives no pass or fail.
    quantity : str
        What the limit applies to: "peak component", "vector sum", ...
    corners : (n_corners, 2) float64, Hz and m/s
        Rising frequency; a step has two corners at one frequency.
    interpolation : str
        "log-log" or "linear" between corners.
    note : str

    Raises
    ------
    InputError
        If the corners do not rise, a limit is not positive or a name is unknown.
    """

    name: str
    source: str
    verified: bool
    quantity: str
    corners: np.ndarray
    interpolation: str = "linear"
    note: str = ""

    def __post_init__(self) -> None:
        """Check the fields once."""
        corners = np.array(self.corners, dtype=np.float64)
        where = f"limit curve {self.name!r}"
        if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) == 0:
            raise InputError(f"{where}: corners need shape (n, 2), got {corners.shape}")
        if not np.all(corners > 0.0) or not np.all(np.isfinite(corners)):
            raise InputError(f"{where}: frequencies and limits must be positive")
        if np.any(np.diff(corners[:, 0]) < 0.0):
            raise InputError(f"{where}: frequencies must rise")
        if self.interpolation not in INTERPOLATIONS:
            raise InputError(f"{where}: interpolation is one of {INTERPOLATIONS}")
        if self.quantity not in QUANTITIES:
            raise InputError(f"{where}: quantity is one of {QUANTITIES}, got {self.quantity!r}")
        corners.setflags(write=False)
        object.__setattr__(self, "corners", corners)

    def limit(self, frequency: ArrayLike) -> np.ndarray:
        """Return the limit at each frequency.

        Parameters
        ----------
        frequency : float or array, Hz

        Returns
        -------
        array of float64, m/s
            NaN below the first corner, where the curve is undefined; the last value above the
            last corner. At a step the lower of the two values.
        """
        frequency = np.asarray(frequency, dtype=np.float64)
        values = np.minimum(self._from(frequency, "left"), self._from(frequency, "right"))
        return np.where(frequency < self.corners[0, 0], np.nan, values)

    def _from(self, frequency, side):
        """Interpolate in the segment that ends ("left") or begins ("right") at a corner."""
        hz, limit = self.corners.T
        if len(hz) == 1:
            return np.full(frequency.shape, limit[0])
        segment = np.clip(np.searchsorted(hz, frequency, side=side) - 1, 0, len(hz) - 2)
        ends = hz[segment], hz[segment + 1], limit[segment], limit[segment + 1]
        x = np.clip(frequency, hz[0], hz[-1])
        if self.interpolation == "log-log":
            x, *ends = np.log(x), *np.log(ends)
        left, right, low, high = ends
        width = np.where(right > left, right - left, 1.0)
        value = low + (high - low) * np.where(right > left, (x - left) / width, 1.0)
        return np.exp(value) if self.interpolation == "log-log" else value


def load_limits() -> dict[str, LimitCurve]:
    """Load the limit curves that come with pyblast.

    Returns
    -------
    dict of str to LimitCurve
        By key ("usbm_plaster", "din_4150_dwelling", ...), all with ``verified`` false.

    Examples
    --------
    >>> curve = load_limits()["usbm_plaster"]
    >>> curve.verified
    False
    """
    text = resources.files("pyblast.signals").joinpath("limits.toml").read_text(encoding="utf-8")
    return {key: _curve(entry) for key, entry in tomllib.loads(text).items()}


def _curve(entry):
    """Return the curve of one entry of the data file, in SI."""
    keys = ("frequency_hz", "limit_mm_per_s")
    columns = [to_si(key, entry.pop(key))[1] for key in keys]
    return LimitCurve(corners=np.array(columns).T, **entry)
