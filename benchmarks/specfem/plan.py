"""Which cases SPECFEM3D records: blocks, effects, templates of ground, all fixed by a seed."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

SEED = 20261202  # registered in docs/quality; nothing may be tuned to its cases
DEVELOPMENT_SEED = 11  # of trials while generator and program are written

SINGLE = {
    "soft_surface_layer": 2, "attenuation_Q": 2, "topography": 2, "body": 2,
    "misfire_or_charge_error": 2, "delay_scatter": 2, "wrong_coordinates": 2, "rock_speed": 1,
    "damaged_zone": 1, "instrument_response": 1, "air_blast": 1,
}  # fmt: skip
HARD_NULLS = {"uneven_ground": 3, "moved_receivers": 3, "holes_vary": 3, "all_at_once": 3}
OUTSIDE = {"tunnel": 1, "second_blast": 1, "dyke": 1, "machine": 1, "basin": 1, "contact": 1}
BLOCKS = {"single": SINGLE, "hard null": HARD_NULLS, "outside": OUTSIDE}
TEMPLATES = ("flat", "soil", "hill", "bench")
# What is drawn where: an effect on the top needs a top that files call flat.
FLAT = ("topography", "soft_surface_layer", "basin")


@dataclass(frozen=True)
class Draw:
    """One case before anything of it is drawn.

    Parameters
    ----------
    number : int
    block : str
        Of `BLOCKS`.
    effect : str
        A label of the library, or a word of `HARD_NULLS` or `OUTSIDE`.
    template : str
        Of `TEMPLATES`.
    seed : tuple of int
    """

    number: int
    block: str
    effect: str
    template: str
    seed: tuple[int, int]

    @property
    def name(self):
        """Its folder."""
        return f"case-{self.number:02d}"


def plan(seed: int = SEED) -> list[Draw]:
    """Return the cases of a seed, in an order that mixes the blocks.

    Parameters
    ----------
    seed : int

    Examples
    --------
    >>> len(plan())
    36
    """
    rng = np.random.default_rng([seed, 0])
    wanted = [
        (block, effect)
        for block, effects in BLOCKS.items()
        for effect, count in effects.items()
        for _ in range(count)
    ]
    turns, draws = rng.permutation(np.arange(len(wanted)) % len(TEMPLATES)), []
    for number, at in enumerate(rng.permutation(len(wanted))):
        block, effect = wanted[at]
        template = "flat" if effect in FLAT else TEMPLATES[turns[number]]
        draws.append(Draw(number, block, effect, template, (seed, 1 + number)))
    return draws


def store_of(seed: int = SEED) -> Path:
    """Return the folder of the cases of a seed, ``PYBLAST_SPECFEM_CASES`` by default."""
    folder = Path(__file__).resolve().parents[2] / "build" / "specfem"
    folder = Path(os.environ.get("PYBLAST_SPECFEM_CASES", folder))
    return folder if seed == SEED else folder.with_name(f"{folder.name}-{seed}")
