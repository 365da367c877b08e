"""Which cases there are: blocks, effects and levels of harmless errors, fixed by count and seed."""

from dataclasses import dataclass

import numpy as np

# Registered in docs/quality; nothing may be tuned to them.
PROOF_SEED, PROOF_CASES = 20261127, 60
FRESH_SEED, FRESH_CASES = 20261128, 40  # drawn after some of the former had been answered
DEVELOPMENT_SEED = 7  # of trials while the program is written

FAMILY = {
    "delay_scatter": "source",
    "misfire_or_charge_error": "source",
    "damaged_zone": "source",
    "missing_joint": "path",
    "joint_nonlinear_closure": "path",
    "joint_slip": "path",
    "joint_viscous_fill": "path",
    "attenuation_Q": "path",
    "anisotropy": "path",
    "soft_surface_layer": "receiver",
    "air_blast": "receiver",
    "wrong_coordinates": "receiver",
    "instrument_response": "instrument",
    "sensor_orientation_or_polarity": "instrument",
    "clock_error": "instrument",
}
OUTSIDE = ("void", "second_blast", "reflector", "hum")
PAIRS = (
    ("missing_joint", "clock_error"),
    ("attenuation_Q", "delay_scatter"),
    ("soft_surface_layer", "delay_scatter"),
    ("joint_nonlinear_closure", "instrument_response"),
    ("missing_joint", "misfire_or_charge_error"),
    ("air_blast", "attenuation_Q"),
    ("joint_slip", "sensor_orientation_or_polarity"),
    ("wrong_coordinates", "soft_surface_layer"),
    ("anisotropy", "clock_error"),
    ("damaged_zone", "misfire_or_charge_error"),
    ("joint_viscous_fill", "air_blast"),
    ("delay_scatter", "instrument_response"),
)
POOR = (
    "attenuation_Q", "missing_joint", "soft_surface_layer", "clock_error", "joint_slip",
    "instrument_response",
)  # fmt: skip
SHARES = {"null": 60, "hard null": 12, "single": 60, "two": 12, "out of library": 12, "poor": 4}
NULLS = ("null", "hard null")


@dataclass(frozen=True)
class Draw:
    """One case before anything of it is drawn.

    Parameters
    ----------
    number : int
    block : str
        Of `SHARES`.
    effects : tuple of str
        Labels, or words of `OUTSIDE`.
    level : int
        Of harmless errors: 1, 2, or 3 for twice those of level 2.
    seed : tuple of int
    """

    number: int
    block: str
    effects: tuple[str, ...]
    level: int
    seed: tuple[int, int]

    @property
    def name(self):
        """Its folder."""
        return f"case-{self.number:03d}"


def plan(count: int, seed: int) -> list[Draw]:
    """Return the cases of a benchmark; those of fewer cases are the first of those of more.

    Parameters
    ----------
    count : int
        The blocks keep their shares of the table above, however many cases there are.
    seed : int
    """
    rng = np.random.default_rng([seed, 0])
    order = {
        "single": [(label,) for label in rng.permutation(list(FAMILY)).tolist()],
        "two": [PAIRS[k] for k in rng.permutation(len(PAIRS))],
        "out of library": [(kind,) for kind in rng.permutation(OUTSIDE).tolist()],
        "poor": [(label,) for label in rng.permutation(POOR).tolist()],
    }
    total = sum(SHARES.values())
    rounds = -(-count // total)
    places = sorted(
        ((k + 0.5) / share, block) for block, share in SHARES.items() for k in range(rounds * share)
    )
    done, draws = dict.fromkeys(SHARES, 0), []
    for number, (_, block) in enumerate(places[:count]):
        turn, done[block] = done[block], done[block] + 1
        some = order.get(block, [()])
        level = 3 if block == "hard null" else 1 + turn % 2
        draws.append(Draw(number, block, some[turn % len(some)], level, (seed, 1 + number)))
    return draws
