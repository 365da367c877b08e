"""Green's functions: superposition of a blast from stored unit responses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from ..errors import InputError
from ..model.boundary import StressInput, VelocityInput
from ..model.model import Model, Receiver
from ..model.source import Column, Hole, MomentTensor, PointForce, TimeFunction
from ..signals.seismogram import Seismogram, fast_length
from ..solver.linear_runs import STICKING_JOINTS
from ..solver.loads import ADDERS, Loads

PointSource = Hole | Column | MomentTensor | PointForce
CHARGES = (Hole, Column)
KINDS = (*CHARGES, MomentTensor, PointForce)
LINEAR_JOINTS = ("elastic", "kelvin", "maxwell", *STICKING_JOINTS)
LINEAR_ZONES = ("elastic", "anisotropic")
NONE = TimeFunction(np.zeros(1), 1.0)


def unit_source(source: PointSource) -> PointSource:
    """Return a unit source without firing time and history."""
    if isinstance(source, CHARGES):
        return replace(source, charge=1.0, time=0.0, moment_rate=NONE, exponent=1.0)
    if isinstance(source, MomentTensor):
        tensor = source.tensor / size(source)
        return replace(source, tensor=tensor, time=0.0, moment_rate=NONE)
    return replace(source, direction=np.asarray(source.direction) / size(source), history=NONE)


def size(source: PointSource) -> float:
    """Return the factor on the history: of the charge, the norm of the tensor or direction."""
    if isinstance(source, CHARGES):
        return source.charge**source.exponent
    vector = source.tensor if isinstance(source, MomentTensor) else source.direction
    return float(np.linalg.norm(vector)) or 1.0


def history(source: PointSource, times: np.ndarray) -> np.ndarray:
    """Return the moment (n,) in N m, or the force in N, at times (n,)."""
    if isinstance(source, PointForce):
        return size(source) * source.history(times)
    return size(source) * source.moment_rate.integral()(times - source.time)


def place(source: PointSource) -> np.ndarray:
    """Return the position of a source, (3,) m; the centre of a column."""
    if isinstance(source, Column):
        return 0.5 * np.add(source.primed, source.end)
    return np.asarray(source.position, dtype=float)


def likeness(source: PointSource) -> tuple:
    """Return the properties that sources at one place must share to have one response."""
    if isinstance(source, Column):
        way = np.round(np.subtract(source.end, source.primed), 9)
        return Column, *way, source.detonation_speed, source.sources
    if isinstance(source, PointForce):
        return PointForce, *np.round(np.asarray(source.direction) / size(source), 9)
    if isinstance(source, MomentTensor):
        return MomentTensor, source.spread, *np.round(source.tensor / size(source), 9).ravel()
    return Hole, source.spread


def loads(model: Model, source: PointSource, n_steps: int, dt: float) -> dict[str, np.ndarray]:
    """Return the load arrays of a source with a unit step history from the second step."""
    collector = Loads()
    ADDERS[type(source)](collector, model, source)
    step = np.ones((n_steps, 1))
    step[0] = 0.0
    return {**collector.arrays(dt * np.arange(n_steps)), "history": step}


def refuse_what_does_not_superpose(model: Model) -> None:
    """Raise InputError for models to which superposition of their holes does not apply.

    Raises
    ------
    InputError
        Naming the part.
    """
    for joint in model.joints:
        if joint.law not in LINEAR_JOINTS:
            raise InputError(
                f"joints.{joint.surface}.law: holes do not superpose across '{joint.law}'; take "
                f"one of {', '.join(LINEAR_JOINTS)}, or run each blast as a whole"
            )
    for group in model.mesh.groups:
        if model.law(group).name not in LINEAR_ZONES:
            raise InputError(
                f"materials.{group}: holes do not superpose in ground of the law "
                f"'{model.law(group).name}'; take elastic ground, or run each blast as a whole"
            )
    if model.local_damping:
        raise InputError(
            "local_damping: holes do not superpose under it; set it to zero, got "
            f"{model.local_damping:g}"
        )
    for boundary in model.boundaries:
        if isinstance(boundary, (StressInput, VelocityInput)):
            raise InputError(
                f"boundaries.{boundary.surface}: stored responses are those of holes alone; take "
                f"the {type(boundary).__name__} out and add its motion afterwards"
            )
    for source in model.sources:
        if type(source) not in KINDS:
            raise InputError(
                f"sources: a {type(source).__name__} is no hole, column, tensor or force at a "
                "place; take it out and add its motion afterwards"
            )
    for part in ("sources", "receivers"):
        if not getattr(model, part):
            raise InputError(f"{part}: none; stored responses lead from sources to receivers")


NEAR = 1e-6  # m, distance of equal positions


@dataclass(frozen=True, eq=False)
class GreensFunctions:
    """Green's functions: response of receivers to a unit step of moment or force at places.

    Parameters
    ----------
    sources : tuple of Hole, Column, MomentTensor or PointForce
        Unit sources, one for each place.
    receivers : tuple of Receiver
    response : (n_sources, n_receivers, 3, n_steps) float64, m/s per N m or per N
        East, north, vertical; sample k half a step after k steps from the step of moment.
    dt : float, s
        The time step of the model.
    within : float, m
        Largest distance of a source from its place.
    side : str
        "source" or "receiver" (reciprocity).
    runs : int
    said : str
        Choice of the side, and the check that no contact slips.
    """

    sources: tuple[PointSource, ...]
    receivers: tuple[Receiver, ...]
    response: np.ndarray
    dt: float
    within: float
    side: str
    runs: int
    said: str

    @property
    def duration(self) -> float:
        """Duration of the responses, s."""
        return self.dt * self.response.shape[-1]

    @property
    def unfinished(self) -> float:
        """Largest motion in the last tenth over the peak, for the worst receiver and place.

        Motion later than `duration` after a firing is missing in longer blasts.
        """
        size = np.linalg.norm(self.response, axis=2)
        return float((size[..., -(size.shape[-1] // 10 + 1) :].max(-1) / size.max(-1)).max())

    def numbers(self, sources: Sequence[PointSource]) -> np.ndarray:
        """Return the number (n,) of the place of each source.

        Raises
        ------
        InputError
            If there is no place of its kind within reach.
        """
        places = np.array([place(unit) for unit in self.sources])
        kinds = [likeness(unit) for unit in self.sources]
        numbers = np.zeros(len(sources), dtype=int)
        for n, source in enumerate(sources):
            kind = likeness(source)
            away = np.linalg.norm(places - place(source), axis=1)
            away[[other != kind for other in kinds]] = np.inf
            numbers[n] = away.argmin()
            if np.isinf(away[numbers[n]]):
                raise InputError(
                    f"sources[{n}]: no {type(source).__name__} of this shape is stored anywhere; "
                    "add one to the model of the bank"
                )
            if away[numbers[n]] > self.within + NEAR:
                raise InputError(
                    f"sources[{n}]: the nearest stored place of such a {type(source).__name__} "
                    f"lies {away[numbers[n]]:g} m away, allowed are {self.within:g} m; add its "
                    "place to the model of the bank"
                )
        return numbers

    def blast(
        self, sources: Sequence[PointSource], duration: float | None = None
    ) -> dict[str, Seismogram]:
        """Return the seismograms of a blast; theory.md (9.1), (9.2).

        Parameters
        ----------
        sources : sequence of Hole, Column, MomentTensor or PointForce
            At the stored places, with any charges, exponents, times and time functions.
        duration : float, s, optional
            Default `duration`, for which the result equals a run to rounding; see `unfinished` for
            longer ones.

        Raises
        ------
        InputError
            If a source is at no stored place.
        """
        n_known = self.response.shape[-1]
        n = n_known if duration is None else max(2, int(np.ceil(duration / self.dt - 1e-9)))
        size = fast_length(n + min(n, n_known))
        total = np.zeros((len(self.receivers), 3, size // 2 + 1), dtype=complex)
        numbers = self.numbers(sources)
        for number in np.unique(numbers):
            chosen = [s for s, at in zip(sources, numbers, strict=True) if at == number]
            drive = np.asarray(
                sum(np.asarray(fft.rfft(self.increments(s, n), size)) for s in chosen)
            )
            total += np.asarray(fft.rfft(self.response[number, ..., :n], size)) * drive
        return self.seismograms(np.asarray(fft.irfft(total, size))[..., :n])

    def increments(self, source: PointSource, n_steps: int) -> np.ndarray:
        """Return the increments of moment or force per step, (n_steps,)."""
        moment = history(source, self.dt * np.arange(n_steps))
        return np.diff(moment, prepend=0.0)

    def seismograms(self, motion: np.ndarray) -> dict[str, Seismogram]:
        """Return motion (n_receivers, 3, n) as seismograms in the receivers' directions."""
        records = {}
        for receiver, velocity in zip(self.receivers, motion, strict=True):
            record = Seismogram(velocity.T, self.dt, 0.5 * self.dt, receiver.name)
            turned = record if receiver.azimuth is None else record.rotated(receiver.azimuth)
            records[receiver.name] = turned
        return records
