"""What varies in a family of models, and where runs to learn from are placed."""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from pyblast.errors import InputError

JOINT_KEYS = ("kn", "ks")
DAMPING_KEY = "ratio"


@dataclass(frozen=True)
class Ranges:
    """Ranges of joint stiffness and damping.

    Parameters
    ----------
    limits : dict of str to (low, high)
        ``kn`` and ``ks`` in Pa/m of all joints, or of one as ``kn.NAME``; ``ratio`` of the damping
        of all groups, or of one as ``ratio.GROUP``.

    Raises
    ------
    InputError
        If a key is unknown or given twice, or a range is none.
    """

    limits: dict[str, tuple[float, float]]

    def __post_init__(self):
        """Refuse ranges that are none."""
        if not self.limits:
            raise InputError("ranges: give at least one of kn, ks, ratio")
        for key, (low, high) in self.limits.items():
            quantity, _, place = key.partition(".")
            if quantity not in (*JOINT_KEYS, DAMPING_KEY):
                raise InputError(f"ranges.{key}: must be kn, ks or ratio, or one with .NAME")
            if place and quantity in self.limits:
                raise InputError(f"ranges.{key}: '{quantity}' varies everywhere already; drop one")
            if not 0.0 < low < high < math.inf:
                raise InputError(
                    f"ranges.{key}: must be two ascending positive numbers, got {low:g}, {high:g}"
                )

    def suits(self, model):
        """Refuse ranges of joints or damping that a model does not have."""
        surfaces = [joint.surface for joint in model.joints]
        for key in self.limits:
            quantity, _, place = key.partition(".")
            if quantity in JOINT_KEYS and (place or surfaces[:1]) not in (surfaces[:1], *surfaces):
                known = ", ".join(surfaces) or "none"
                raise InputError(f"ranges.{key}: no such joint; there are {known}")
            if quantity in JOINT_KEYS and not surfaces:
                raise InputError(f"ranges.{key}: the model has no joints; leave it out")
            if quantity == DAMPING_KEY and model.damping is None:
                raise InputError(f"ranges.{key}: the model has no damping; give it one to vary")
            by_group = isinstance(model.damping, dict)
            if (
                quantity == DAMPING_KEY
                and place
                and place not in (model.damping if by_group else ())
            ):
                known = ", ".join(model.damping) if by_group else "one for all groups"
                raise InputError(f"ranges.{key}: no damping of that group; there is {known}")

    def model(self, model, values):
        """Return a model with other stiffness and damping; the rest stays."""
        for key, value in values.items():
            quantity, _, place = key.partition(".")
            if quantity == DAMPING_KEY:
                model = replace(model, damping=_damped(model.damping, place, value))
                continue
            for joint in model.joints:
                if place in ("", joint.surface):
                    model = model.with_joint(joint.surface, **{quantity: value})
        return model

    def check(self, values):
        """Refuse values that are not those of the ranges, or outside of what was trained.

        Raises
        ------
        InputError
        """
        if set(values) != set(self.limits):
            raise InputError(
                f"reduced: needs values of {', '.join(self.limits)}, got "
                f"{', '.join(values) or 'none'}"
            )
        for key, (low, high) in self.limits.items():
            if not low * (1.0 - 1e-12) <= values[key] <= high * (1.0 + 1e-12):
                raise InputError(
                    f"reduced.{key}: trained from {low:g} to {high:g}, got {values[key]:g}; stay "
                    "inside or train a wider range"
                )

    def corner(self, end):
        """Return the values at the lower (0) or upper (1) ends of all ranges."""
        return {key: limit[end] for key, limit in self.limits.items()}

    def middle(self):
        """Return the values in the middle of all ranges, in logarithm."""
        return self.at([0.5] * len(self.limits))

    def at(self, shares):
        """Return the values at shares (n,) of the ranges, even in logarithm."""
        pairs = zip(self.limits.items(), shares, strict=True)
        return {key: float(low * (high / low) ** share) for (key, (low, high)), share in pairs}

    def learning(self, count, seed):
        """Return values to learn from: a Sobol sequence, denser towards the edges (arcsine).

        The first points of a longer sequence are those of a shorter one.
        """
        sobol = qmc.Sobol(len(self.limits), rng=np.random.default_rng(seed))
        unit = sobol.random(2 ** math.ceil(math.log2(max(2, count))))[:count]
        return [self.at(0.5 - 0.5 * np.cos(np.pi * row)) for row in unit]

    def unseen(self, count, seed):
        """Return random values, even in logarithm, that have nothing to do with the learning."""
        rng = np.random.default_rng([seed, 1])
        return [self.at(row) for row in rng.random((count, len(self.limits)))]


def _damped(damping, group, ratio):
    """Return a damping, or one for each group, with another ratio of all or of one group."""
    if not isinstance(damping, dict):
        return replace(damping, ratio=ratio)
    return {
        name: replace(one, ratio=ratio) if group in ("", name) else one
        for name, one in damping.items()
    }
