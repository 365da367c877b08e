"""Simulation: runs of shots in states of their ground, counted, and the motion that they give."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol, Self, TypeVar

import numpy as np

from ..model.model import Model
from ..runs.greens import PointSource, greens_functions
from ..runs.parallel import CachedRun, find_run, is_single, run_all
from ..signals.seismogram import Seismogram
from ..solver.assembly import Step
from ..solver.run import run_many, simulate
from .estimate import Cost, cost_of


class State(Protocol):
    """State: ground with shots, of which models are made, such as a `Project`."""

    model: cached_property[Model]  # of the first shot, from `lead` before the first firing on
    cost: cached_property[Cost | None]  # of its run, before it is meshed

    @property
    def lead(self) -> float:
        """Time in s from the start of a run to the first firing."""
        ...

    @property
    def duration(self) -> float:
        """Duration of a run in s, the lead included."""
        ...

    def simulated(self, motion: Mapping[str, Seismogram]) -> dict[str, Seismogram]:
        """Return seismograms of a run of the model from the first firing on."""
        ...

    def of(self, name: str) -> Self:
        """Return one of the shots alone, in the same ground."""
        ...

    def suited(self, finer: bool = False) -> Self:
        """Return the state with zones that its laws allow, finer ones if that is wanted."""
        ...


S = TypeVar("S", bound=State)


@dataclass(eq=False)
class Simulation:
    """Simulation: runs of shots in states of their ground; counts them, and knows no records.

    States may differ in anything, their geometry included: each geometry is meshed once, and all
    shots share the mesh.

    Parameters
    ----------
    shots, receivers : tuple of str
    dt : float, s
    n_samples : int
        Of the instants, from the first firing on, at which motion is wanted.
    duration : float, s
        Of a run, from its start.
    folder : path, optional
        Folder of stored runs.
    executor : Executor, optional
        As for `run_all`.
    finer : bool
        Whether to run on finer meshes than those of the states.
    injected : bool
        Whether explosions may be injected; stored responses of holes are not.
    received : callable
        ``(shot, motion) -> motion``: what source and instruments make of simulated motion.
    runs, cached : int
        Number of runs, and number of those that were in the folder already.
    cached_s : float, s
        Time that the latter took when they were run.
    priced : float, s
        Processor time of all runs by their price, whichever machine they were run on.
    """

    shots: tuple[str, ...]
    receivers: tuple[str, ...]
    dt: float
    n_samples: int
    duration: float
    folder: str | Path | None = None
    executor: Executor | None = None
    finer: bool = False
    injected: bool = False
    received: Callable[[str, np.ndarray], np.ndarray] = lambda _, motion: motion
    runs: int = 0
    cached: int = 0
    cached_s: float = 0.0
    priced: float = 0.0
    _known: set = field(default_factory=set, repr=False)

    def motion(self, state: State, shots: Sequence[str] | None = None) -> np.ndarray:
        """Simulate shots of a state, all by default, (n_shots, n_receivers, 3, n_samples) in m/s.

        Raises
        ------
        InputError
            If its ground can't be meshed, or a source or receiver lies outside of it.
        SolverError
            If a run fails.
        """
        return self.motions([state], shots)[0]

    def motions(self, states: Sequence[State], shots: Sequence[str] | None = None) -> np.ndarray:
        """Simulate n states as `motion` does, (n, n_shots, n_receivers, 3, n_samples) in m/s."""
        shots = self.shots if shots is None else tuple(shots)
        own = [self.of(state, shot) for state in states for shot in shots]
        motion = np.stack(self.simulate(own, shots * len(states)))
        return motion.reshape(len(states), -1, *motion.shape[1:])

    def simulate(self, own: Sequence[State], shots: Sequence[str]) -> list[np.ndarray]:
        """Simulate states of one shot each, see `of`, and return their motion as `motion` does."""
        done = self.run([self.model(each) for each in own])
        return [
            self.received(shot, self.sampled(run.seismograms, each.lead))
            for each, run, shot in zip(own, done, shots, strict=True)
        ]

    def of(self, state: S, shot: str) -> S:
        """Return a state with one of its shots, on the mesh on which it is run."""
        return state.suited(self.finer).of(shot)

    def model(self, own: State) -> Model:
        """Return the model of a state of one shot, as it is run."""
        model = own.model
        injected = model.injected if self.injected else False
        return replace(model, single=is_single(model), injected=injected)

    def price(self, own: State) -> float:
        """Return the price in s of a run of a state of one shot; a stored one has its time step."""
        model = self.model(own)
        stored = find_run(model, self.duration, self.folder)
        return cost_of(model, self.duration, None if stored is None else stored.dt).seconds

    def run(self, models: Sequence[Model]) -> list[CachedRun]:
        """Run models, or read their stored runs, and count them."""
        done = run_all(models, self.duration, folder=self.folder, executor=self.executor)
        self.runs += len(done)
        for model, run in zip(models, done, strict=True):
            self.priced += cost_of(model, self.duration, run.dt).seconds
            key = run.provenance["input_sha256"], *run.seismograms
            if run.from_cache and key not in self._known:
                self.cached, self.cached_s = self.cached + 1, self.cached_s + run.wall_seconds
            self._known.add(key)
        return done

    def sampled(
        self,
        motion: Mapping[str, Seismogram],
        lead: float,
        receivers: Sequence[str] | None = None,
    ) -> np.ndarray:
        """Return motion of a run at the instants, (n_receivers, 3, n_samples); zero if none.

        Parameters
        ----------
        motion : dict of str to Seismogram
            By receiver; 0 s is the start of the run.
        lead : float, s
        receivers : sequence of str, optional
            Others than those of the simulation.
        """
        receivers = self.receivers if receivers is None else receivers
        sampled = np.zeros((len(receivers), 3, self.n_samples))
        for r, name in enumerate(receivers):
            if name in motion:
                seismogram = motion[name].sampled(lead, self.dt, self.n_samples)
                sampled[r] = np.nan_to_num(seismogram.velocity).T
        return sampled

    def by_source(self, own: Sequence[State]) -> list[np.ndarray]:
        """Simulate each source at a point of states of one shot each, fired at zero.

        By one run for each, or three for each receiver (reciprocity) if these are fewer.

        Returns
        -------
        list of (n_sources, n_receivers, 3, n_samples) float64, m/s
        """
        models = [self.model(each) for each in own]
        sources = [[s for s in model.sources if isinstance(s, PointSource)] for model in models]
        bank = greens_functions(
            replace(models[0], sources=[source for row in sources for source in row]),
            self.duration,
            folder=self.folder,
            executor=self.executor,
        )
        self.runs += bank.runs
        self.priced += bank.runs * cost_of(models[0], self.duration, bank.dt).seconds
        return [
            np.stack([self.sampled(bank.blast([replace(source, time=each.lead)]), each.lead)
                      for source in row])
            for each, row in zip(own, sources, strict=True)
        ]  # fmt: skip


def in_batches(states: Sequence[State], step: Step | None = None) -> list[dict[str, Seismogram]]:
    """Run states of one shot each in double precision, and return what their receivers record.

    Parameters
    ----------
    states : sequence of State
    step : Step, optional
        Of all their models, which then run in batches; else each has its own.

    Returns
    -------
    list of dict of str to Seismogram
        By receiver, from the first firing on.

    Raises
    ------
    SolverError
        If a model can't be run.
    """
    if step is None:
        runs = [simulate(state.model, state.duration) for state in states]
    else:
        runs = run_many([state.model for state in states], states[0].duration, step=step)
    return [state.simulated(run.seismograms) for state, run in zip(states, runs, strict=True)]
