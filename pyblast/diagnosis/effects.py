"""Effects: what they change of the motion, by runs, by stored holes, by operators."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import fft

from ..project.flat_box import quality_of
from ..project.project import Project
from .calibration import Baseline, carried, with_values
from .forward import Forward, Surroundings, geometry, surroundings
from .hypotheses import FAMILIES, LIBRARY, blast_and_hole


@dataclass(frozen=True)
class Effect:
    """A hypothesis at a place, with values of its parameters.

    Parameters
    ----------
    name : str
        In the library.
    target : str
        One of those of its hypothesis; empty for the whole site.
    values : tuple of tuple of float
        Of each parameter, in its unit: one value, or one for each hole.
    """

    name: str
    target: str
    values: tuple[tuple[float, ...], ...]

    @property
    def hypothesis(self):
        """The entry of the library."""
        return LIBRARY[self.name]

    @property
    def where(self):
        """Its name and its target, whatever its values."""
        return self.name, self.target

    @property
    def label(self):
        """Its name in results, whatever its form."""
        return self.hypothesis.label

    @property
    def parameters(self):
        """Values by name."""
        pairs = zip(self.hypothesis.parameters, self.values, strict=True)
        return {k.name: np.array(some) if k.per_hole else some[0] for k, some in pairs}


@dataclass(eq=False)
class Scene:
    """What hypotheses are tried on.

    Parameters
    ----------
    forward : Forward
    baseline : Baseline
    holes : dict of str to (n_holes, n_receivers, 3, n_samples) float64, m/s
        By blast, the motion of each hole with its planned charge, fired at zero; a blast is
        missing where its holes do not superpose.
    """

    forward: Forward
    baseline: Baseline
    holes: dict
    _sent: dict = field(default_factory=dict, repr=False)
    _corrections: dict = field(default_factory=dict, repr=False)

    def __post_init__(self):
        """Remember what the calibration has run already."""
        baseline, here = self.baseline, geometry(self.case.project)
        nothing = tuple(np.zeros(len(baseline.values)).tolist()), ()
        for b in range(len(self.case.blasts)):
            self._corrections[here, b] = baseline.correction[b]
            self._sent[nothing, b] = baseline.reference[b]
            self._sent[(tuple(baseline.values.tolist()), ()), b] = baseline.motion[b]

    @property
    def case(self):
        """The records."""
        return self.forward.case

    @cached_property
    def surroundings(self) -> Surroundings:
        """Motion around the receivers in the calibrated ground: a run of each blast, once."""
        return surroundings(self.forward, self.baseline.project)

    def project(self, values, effects) -> Project | None:
        """Return the project with factors and with all effects that change it; None if it can't be.

        Such are effects that exclude one another, and holes that would leave the model.
        """
        project = with_values(self.case.project, self.baseline.unknowns, values)
        for effect in _acting(effects, "site"):
            if project is not None:
                project = effect.hypothesis.apply(project, effect.target, **effect.parameters)
        return project if project is None or self.forward.holds(project) else None

    def sent(self, states, blasts=None) -> list[np.ndarray | None]:
        """Return simulated motion, (n_blasts, n_receivers, 3, n_samples) m/s each, by runs.

        Parameters
        ----------
        states : sequence of (values, effects)
        blasts : sequence of int, optional
            Indices of those that are run; the records stand in for the others.

        Returns
        -------
        list
            None where an effect can't be.
        """
        blasts = tuple(range(len(self.case.blasts)) if blasts is None else blasts)
        keys = [(tuple(map(float, values)), _acting(effects, "site")) for values, effects in states]
        projects = {key: self.project(*key) for key in dict.fromkeys(keys)}
        possible = [key for key, project in projects.items() if project is not None]
        self._run([(key, b) for key in possible for b in blasts], projects)
        return [self._gathered(key, blasts) if key in possible else None for key in keys]

    def _run(self, asked, projects):
        """Make the runs that are missing, those of mesh controls too, side by side."""
        asked = [one for one in asked if one not in self._sent]
        bare = {key: self._bare(key[1]) for key, _ in asked}
        plain = {(geometry(bare[key]), b): bare[key] for key, b in asked}
        plain = {cut: one for cut, one in plain.items() if cut not in self._corrections}
        pairs = [(projects[key], b) for key, b in asked] + [(p, b) for (_, b), p in plain.items()]
        done = self.forward.heard([(project, self.case.blasts[b]) for project, b in pairs])
        for cut, motion in zip(plain, done[len(asked) :], strict=True):
            self._corrections[cut] = self.baseline.reference[cut[1]] - motion
        for (key, b), motion in zip(asked, done[: len(asked)], strict=True):
            correction = self._corrections[geometry(bare[key]), b]
            if quality_of(projects[key]) != quality_of(self.case.project):
                before = self.baseline.reference[b] - correction
                band = self.case.band.low, self.case.band.high
                correction = carried(correction, before, motion, self.case.dt, band)
            self._sent[key, b] = motion + correction

    def _bare(self, effects):
        """Return the reference project meshed as effects ask for: the mesh control."""
        project = self.case.project
        for effect in effects:
            if effect.hypothesis.bare is not None:
                project = effect.hypothesis.bare(project, effect.target, **effect.parameters)
        return project

    def _gathered(self, key, blasts):
        """Return the motion of one state; records where a blast was not asked for."""
        return np.stack(
            [
                self._sent[key, b] if b in blasts else self.case.motion[b]
                for b in range(len(self.case.blasts))
            ]
        )

    def received(self, sent, effects) -> np.ndarray:
        """Return what the receivers record of it, with effects on holes and on motion."""
        motion = sent
        for effect in _acting(effects, "holes"):
            motion = motion + self._by_holes(effect)
        return with_motion_effects(self, motion, effects)

    def _by_holes(self, effect):
        """Return what other times and scales of the holes of one blast change."""
        name, _ = blast_and_hole(effect.target)
        blast, at = self.case.project.blasts[name], self.case.blasts.index(name)
        delays, scales = effect.hypothesis.apply(blast, effect.target, **effect.parameters)
        times, holes, n = blast.times, self.holes.get(name), self.case.n_samples
        if holes is None:  # all holes alike
            holes, times = self.baseline.motion[[at]], np.zeros(1)
            delays, scales = delays[:1], scales[:1]
        other = (delays != 0.0) | (scales != 1.0)
        delays, scales, times, holes = delays[other], scales[other], times[other], holes[other]
        latest = int(np.max([times, times + delays], initial=0.0) / self.case.dt) + 1
        size = fft.next_fast_len(n + max(n, latest), real=True)  # what is late must not come round
        turns = -2j * np.pi * fft.rfftfreq(size, self.case.dt)
        nominal = np.exp(np.multiply.outer(times, turns))
        changed = scales[:, None] * np.exp(np.multiply.outer(times + delays, turns))
        spectrum = fft.rfft(holes, size) * (changed - nominal)[:, None, None]
        change = np.zeros((len(self.case.blasts), *holes.shape[1:]))
        change[at] = fft.irfft(spectrum.sum(axis=0), size)[..., :n]
        return change


def with_motion_effects(scene, motion, effects) -> np.ndarray:
    """Return motion with the effects that act on it, at the receivers of a scene or a place."""
    for effect in _acting(effects, "motion"):
        motion = effect.hypothesis.apply(scene, motion, effect.target, **effect.parameters)
    return motion


def _acting(effects, on):
    """Return the effects on one thing in the order in which they act, whatever was found first.

    From the source over path and receiver to the instrument; those of one family as they stand in
    the library.
    """
    order = list(LIBRARY)
    some = [effect for effect in effects if effect.hypothesis.on == on]
    return tuple(
        sorted(some, key=lambda e: (FAMILIES.index(e.hypothesis.family), order.index(e.name)))
    )
