"""Stored Green's functions: a blast as the sum of what was run once for each place."""

from dataclasses import dataclass

import numpy as np
from scipy import fft

from ..errors import InputError
from ..motion.seismogram import Seismogram
from ..solving.model import Receiver
from .unit_sources import history, likeness, place

NEAR = 1e-6  # m: the same place


@dataclass(frozen=True, eq=False)
class GreensFunctions:
    """Motion of receivers by a unit step of moment, or of force, at each of some places.

    Parameters
    ----------
    sources : tuple of Hole, Column, MomentTensor or PointForce
        One for each place, without charge and history.
    receivers : tuple of Receiver
    response : (n_sources, n_receivers, 3, n_steps) float64, m/s per N m or per N
        East, north, vertical; sample k half a step after k steps from the step of moment.
    dt : float, s
        The time step of the model.
    within : float, m
        Sources this near to a place use its response.
    side : str
        "source" or "receiver": where the runs were made.
    runs : int
    said : str
        Which side was chosen and why, and what proves that nothing slips.
    """

    sources: tuple
    receivers: tuple[Receiver, ...]
    response: np.ndarray
    dt: float
    within: float
    side: str
    runs: int
    said: str

    @property
    def duration(self) -> float:
        """For how long after a step of moment its motion is known, s."""
        return self.dt * self.response.shape[-1]

    @property
    def unfinished(self) -> float:
        """Largest motion in the last tenth over the largest of all, worst receiver and place.

        What a hole still does later than `duration` after its firing is unknown, and missing from
        blasts that last longer.
        """
        size = np.linalg.norm(self.response, axis=2)
        return float((size[..., -(size.shape[-1] // 10 + 1) :].max(-1) / size.max(-1)).max())

    def numbers(self, sources) -> np.ndarray:
        """Return the place (n,) that each source uses.

        Raises
        ------
        InputError
            If there is none of its kind within reach.
        """
        places = np.array([place(one) for one in self.sources])
        alike = [likeness(one) for one in self.sources]
        found = np.zeros(len(sources), dtype=int)
        for n, source in enumerate(sources):
            wanted = likeness(source)
            away = np.linalg.norm(places - place(source), axis=1)
            away[[one != wanted for one in alike]] = np.inf
            found[n] = away.argmin()
            if np.isinf(away[found[n]]):
                raise InputError(
                    f"sources[{n}]: no {type(source).__name__} of this shape is stored anywhere; "
                    "add one to the model of the bank"
                )
            if away[found[n]] > self.within + NEAR:
                raise InputError(
                    f"sources[{n}]: the nearest stored place of such a {type(source).__name__} "
                    f"lies {away[found[n]]:g} m away, allowed are {self.within:g} m; add its place "
                    "to the model of the bank"
                )
        return found

    def blast(self, sources, duration: float | None = None) -> dict[str, Seismogram]:
        """Return the seismograms of sources that act together; theory.md (9.1), (9.2).

        Parameters
        ----------
        sources : sequence of Hole, Column, MomentTensor or PointForce
            At the stored places, with any charges, exponents, times and time functions.
        duration : float, s, optional
            Up to `duration`, which is the default, they are those of a run to rounding; see
            `unfinished` for longer ones.

        Raises
        ------
        InputError
            If a source is at no stored place.
        """
        n_known = self.response.shape[-1]
        n = n_known if duration is None else max(2, int(np.ceil(duration / self.dt - 1e-9)))
        size = fft.next_fast_len(n + min(n, n_known), real=True)
        total = np.zeros((len(self.receivers), 3, size // 2 + 1), dtype=complex)
        numbers = self.numbers(sources)
        for number in np.unique(numbers):
            chosen = [s for s, at in zip(sources, numbers, strict=True) if at == number]
            drive = sum(fft.rfft(self.increments(s, n), size) for s in chosen)
            total += fft.rfft(self.response[number, ..., :n], size) * drive
        return self.seismograms(fft.irfft(total, size)[..., :n])

    def increments(self, source, n_steps) -> np.ndarray:
        """Return by how much moment or force grows in each step, (n_steps,)."""
        moment = history(source, self.dt * np.arange(n_steps))
        return np.diff(moment, prepend=0.0)

    def seismograms(self, motion) -> dict[str, Seismogram]:
        """Return motion (n_receivers, 3, n) as seismograms in the receivers' directions."""
        records = {}
        for receiver, velocity in zip(self.receivers, motion, strict=True):
            record = Seismogram(velocity.T, self.dt, 0.5 * self.dt, receiver.name)
            turned = record if receiver.azimuth is None else record.rotated(receiver.azimuth)
            records[receiver.name] = turned
        return records
