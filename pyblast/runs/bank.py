"""Bank: transformed fields of shots and of receivers over a mesh."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ..errors import InputError
from ..mesh.mesh import locate_in_zones
from ..model.model import Model
from ..signals.seismogram import Seismogram
from ..solver.preparation import peak_interval, prepare
from ..solver.run import simulate
from .greens import in_components, receiver_forces, receiver_loads
from .parallel import at_rest

DECAY = np.log(300.0)  # of the damped transform over its period
LONGER = 1.5  # period over duration
TAPER = 1.2, 1.6  # times the highest frequency of interest, between which spectra end
SAMPLES = 8  # a period of the end of spectra; what a mesh carries beyond is folded back
TOGETHER = 48  # samples that are transformed at once
MOST_BYTES = 2e9  # of the fields of a bank and of the products of these in parts of zones


@dataclass(frozen=True)
class DampedTransform:
    """Fourier transform of damped motion, at complex frequencies s = σ + 2πik/T; theory.md (9.9).

    Parameters
    ----------
    duration : float, s
        Of the motion.
    highest : float, Hz
        Highest frequency of interest.
    """

    duration: float
    highest: float

    @property
    def period(self) -> float:
        """Period T in s; what lasts longer comes back three hundred times smaller."""
        return LONGER * self.duration

    @cached_property
    def frequencies(self) -> np.ndarray:
        """Frequencies (n,) in Hz."""
        return np.arange(int(np.ceil(TAPER[1] * self.highest * self.period)) + 1) / self.period

    @cached_property
    def s(self) -> np.ndarray:
        """Complex frequencies (n,), 1/s."""
        return DECAY / self.period + 2j * np.pi * self.frequencies

    def kernel(self, times: np.ndarray, dt: float) -> np.ndarray:
        """Return the factors (n, n_times) of samples of an interval in their transform."""
        return dt * np.exp(-np.outer(self.s, times))

    def back(self, times: np.ndarray) -> np.ndarray:
        """Return (n, n_times): the real part of spectra @ this is the motion."""
        low, high = (self.highest * factor for factor in TAPER)
        share = np.clip((high - self.frequencies) / (high - low), 0.0, 1.0)
        weight = np.where(self.frequencies > 0.0, 1.0, 0.5) * (1.0 - np.cos(np.pi * share))
        return weight[:, None] * np.exp(np.outer(self.s, times)) / self.period


class FieldObserver:
    """Transform of the displacement or velocity of nodes, taken while a run goes on.

    Parameters
    ----------
    transform : DampedTransform
    nodes : (n_nodes,) int
    displacement : bool
        Whether of displacement, else of velocity.
    dt : float, s
    every : int
        Steps between samples.
    """

    def __init__(self, transform, nodes, displacement, dt, every):
        self.transform, self.nodes, self.displacement = transform, nodes, displacement
        self.dt, self.every = dt, every
        self.records = {}  # a run with fields has no checkpoint
        self._sum = np.zeros((2 * len(transform.s), 3 * len(nodes)), np.float32)
        self._block = np.empty((TOGETHER, 3 * len(nodes)), np.float32)
        self._times = []

    def sample(self, step, state, velocity) -> None:
        """Take the field at a step; velocities (n_nodes, 3) are those of half a step before."""
        field = state["displacement"] if self.displacement else velocity
        self._block[len(self._times)] = field[self.nodes].ravel()
        self._times.append(self.dt * (step if self.displacement else step - 0.5))
        if len(self._times) == TOGETHER:
            self._add()

    def _add(self):
        """Add the samples of the block to the sum."""
        kernel = self.transform.kernel(np.array(self._times), self.every * self.dt)
        parts = np.concatenate([kernel.real, kernel.imag]).astype(np.float32)
        self._sum += parts @ self._block[: len(self._times)]
        self._times = []

    def spectra(self) -> np.ndarray:
        """Return the transform so far, (n_frequencies, n_nodes, 3) complex64."""
        if self._times:
            self._add()
        half = len(self.transform.s)
        both = (self._sum[:half] + 1j * self._sum[half:]).astype(np.complex64)
        return both.reshape(half, len(self.nodes), 3)


@dataclass(frozen=True, eq=False)
class Bank:
    """Bank: fields of shots, and of unit forces at receivers, in a part of a mesh.

    Parameters
    ----------
    model : Model
        Its mesh, its ground and its receivers.
    transform : DampedTransform
    zones : (n_zones,) int
        Zones outside of the absorbing layer, whose nodes are kept.
    nodes : (n_nodes,) int
        Those nodes, and those around further places, ascending.
    shots : (n_shots, n_frequencies, n_nodes, 3) complex64, m/s times s
        Velocity by each shot.
    forces : (n_forces, n_frequencies, n_nodes, 3) complex64, m/N
        Displacement by a unit force at each receiver along each axis, see `greens.receiver_forces`.
    runs : int
    """

    model: Model
    transform: DampedTransform
    zones: np.ndarray
    nodes: np.ndarray
    shots: np.ndarray
    forces: np.ndarray
    runs: int

    @cached_property
    def row(self) -> np.ndarray:
        """Row of each node of the model among the kept ones, (n_all,); -1 where it is not kept."""
        row = np.full(len(self.model.nodes.points), -1)
        row[self.nodes] = np.arange(len(self.nodes))
        return row

    @cached_property
    def measured(self) -> np.ndarray:
        """Matrices (n_receivers, 3, 3) from motion along east, north, up to what is measured."""
        axes = Seismogram(np.eye(3), 1.0, 0.0, "")
        return np.array([np.nan_to_num(r.measured(axes).velocity) for r in self.model.receivers])

    def at_places(self, places: np.ndarray) -> np.ndarray:
        """Return the spectra (n_shots, n, 3, n_frequencies) of the velocity at places (n, 3) in m.

        Along east, north, up. The places lie in zones that are kept.
        """
        zone, local = locate_in_zones(self.model.mesh, places)
        rows = self.row[self.model.nodes.zone_nodes[zone]]
        weights = self.model.nodes.shapes(local).astype(np.float32)
        return np.einsum("pa,bkpai->bpik", weights, self.shots[:, :, rows], optimize=True)

    def by_receiver(self, spectra: np.ndarray) -> np.ndarray:
        """Return spectra (..., n_forces, n_frequencies) as the receivers measure the motion.

        Returns
        -------
        (..., n_receivers, 3, n_frequencies) complex
        """
        flat = spectra.reshape(-1, *spectra.shape[-2:]).swapaxes(0, 1)
        own = in_components(self.model.receivers, receiver_forces(self.model.receivers), flat)
        own = np.einsum("nrkf,rkc->nrcf", own, self.measured)
        return own.reshape(*spectra.shape[:-2], *own.shape[1:])


def bank_of(
    models: Sequence[Model],
    duration: float,
    highest: float,
    places: np.ndarray | None = None,
    *,
    executor: Executor | None = None,
    progress: Callable = lambda *_: None,
) -> Bank:
    """Run shots, and a force at each receiver along each axis, and keep their fields.

    Parameters
    ----------
    models : sequence of Model
        One for each shot, alike but for their sources; of hexahedra.
    duration : float, s
    highest : float, Hz
        Highest frequency of interest.
    places : (n, 3) float64, m, optional
        Where fields are kept, too, in the absorbing layer as well.
    executor : Executor, optional
        As for `run_all`.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    Bank
        Of the zones outside of the absorbing layer. A force at a receiver acts on the linear
        ground: joints that may slip have their stiffness.

    Raises
    ------
    InputError
        If the zones are tetrahedra, or the fields would take more than `MOST_BYTES`.
    SolverError
        If a run is unstable.

    Notes
    -----
    Theory.md (9.9). The forces are pulses as short as a period of the highest frequency, by whose
    transform fields are divided.
    """
    model = models[0]
    if not model.mesh.hexahedral:
        raise InputError("bank: the zones are tetrahedra; fields are kept in hexahedra alone")
    transform = DampedTransform(duration, highest)
    zones, axes = _kept_zones(model), receiver_forces(model.receivers)
    others = zones[:0] if places is None else locate_in_zones(model.mesh, places)[0]
    nodes = np.unique(model.nodes.zone_nodes[np.concatenate([zones, others])])
    both = 24.0 * (len(models) + len(axes)) + 10.0 * len(models) * len(axes)  # and of 27 parts
    needed = both * len(transform.s) * len(nodes)
    if needed > MOST_BYTES:
        raise InputError(
            f"bank: fields at {len(nodes)} nodes for {len(axes)} forces and {len(models)} shots "
            f"take {1e-9 * needed:.2g} GB, and {1e-9 * MOST_BYTES:g} GB are kept at most; take "
            "longer zones or fewer receivers"
        )
    tasks = [partial(_of_shot, each, duration, transform, nodes) for each in models]
    tasks += [partial(_of_force, model, duration, transform, nodes, n) for n in range(len(axes))]
    waiting = tasks if executor is None else [executor.submit(task).result for task in tasks]
    fields = []
    for done, field in enumerate(waiting):
        progress("fields of shots and receivers", done, len(tasks))
        fields.append(field())
    shots, forces = np.array(fields[: len(models)]), np.array(fields[len(models) :])
    return Bank(model, transform, zones, nodes, shots, forces, len(tasks))


def _kept_zones(model):
    """Return the zones of a model outside of its absorbing layer."""
    layer, middles = model.mesh.layer, model.mesh.node_places.mean(axis=1)
    inside = np.zeros(len(middles), bool) if layer is None else layer.depths(middles).any(axis=-1)
    return np.flatnonzero(~inside)


def _of_shot(model, duration, transform, nodes):
    """Return the transformed velocity (n_frequencies, n_nodes, 3) of nodes in a run of a shot."""
    return _observed(model, prepare(model, duration), transform, nodes, False)


def _of_force(model, duration, transform, nodes, number):
    """Return the transformed displacement by a unit force at a receiver."""
    still = replace(model, sources=[], insitu=None, injected=False)
    prepared = prepare(still, duration)
    dt, (constants, state) = prepared.constants["dt"], at_rest(prepared.constants)
    times = dt * np.arange(prepared.n_steps + 1)
    pulse = _pulse(times, 1.0 / transform.highest)
    loads = receiver_loads(still, number, pulse[:, None])
    prepared = replace(prepared, constants=constants | loads, state=state)
    field = _observed(still, prepared, transform, nodes, True)
    return field / (transform.kernel(times, dt) @ pulse)[:, None, None].astype(np.complex64)


def _observed(model, prepared, transform, nodes, displacement):
    """Run a prepared model and return the transform of the field at nodes."""
    dt, duration = prepared.constants["dt"], transform.duration
    every = peak_interval(dt, TAPER[1] * transform.highest, prepared, SAMPLES)
    observer = FieldObserver(transform, nodes, displacement, dt, every)
    simulate(model, duration, prepared=prepared, observer=observer)
    return observer.spectra()


def _pulse(times, length):
    """Return a Blackman pulse of unit height, (n,), that begins at zero."""
    turn = 2.0 * np.pi * np.clip(times / length, 0.0, 1.0)
    return 0.42 - 0.5 * np.cos(turn) + 0.08 * np.cos(2.0 * turn)
