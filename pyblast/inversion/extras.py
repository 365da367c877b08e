"""What one more receiver or blast would bring, and one receiver less would cost."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Extra:
    """What one more receiver or blast would bring, or one less would cost.

    Parameters
    ----------
    kind : str
        ``receiver``, ``blast``, or ``without`` for a receiver that is left out.
    name : str
    position : tuple of 3 float, m, or None
    gain : float
        By which it lowers the logarithm of the determinant of the covariance of the unknowns.
    worst : float
        Largest standard deviation after over before, of unknowns that are felt at all.
    worst_path : str
    """

    kind: str
    name: str
    position: tuple[float, float, float] | None
    gain: float
    worst: float
    worst_path: str


def extras_of(sensitivities, parameters, places, blasts, candidates):
    """Return what is known as it is, and what extras would bring, best first."""
    scattered = sensitivities.scattered()
    count, fired = sum(place.counts for place in places), range(len(blasts))

    def known(some_blasts, some_receivers):
        return sensitivities.knowledge(some_blasts, some_receivers, scattered)

    now = known(fired, range(count))

    def extra(kind, name, position, then):
        felt = now.felt | then.felt
        shares = np.where(felt, then.shares, 0.0)
        worst = int(np.argmax(shares))
        path = parameters[worst].path if felt.any() else ""
        gain = now.log_determinant - then.log_determinant
        return Extra(kind, name, position, gain, float(shares[worst]), path)

    found = [
        extra("receiver", place.name, place.position, known(fired, [*range(count), number]))
        for number, place in enumerate(places)
        if not place.counts
    ]
    found += [
        extra("blast", one.path.name, None, known([*fired, len(blasts) + number], range(count)))
        for number, one in enumerate(candidates)
    ]
    if count > 1:
        found += [
            extra("without", place.name, place.position,
                  known(fired, [r for r in range(count) if r != number]))
            for number, place in enumerate(places[:count])
        ]  # fmt: skip
    found.sort(key=lambda one: -one.gain)
    return now, extra("as it is", "", None, now), tuple(found)
