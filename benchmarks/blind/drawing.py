"""One case: a believed site, a true world, its truth, and then its records."""

import io
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pyblast.files import plain, write_text

from . import instruments, outside  # noqa: F401  fill EFFECTS
from .case_files import write_asked, write_case
from .effects import EFFECTS, log_uniform
from .nuisances import shaken
from .plan import FAMILY, Draw
from .sites import FURTHER, Site, draw_site
from .worlds import World, ground_motion, noise_of, recorded

SNR = 5.0, 40.0


@dataclass(frozen=True, eq=False)
class Drawn:
    """A case whose truth is drawn and whose records are not simulated yet.

    Parameters
    ----------
    site : Site
        As believed.
    bare, world : World
        With errors, and with effects as well.
    truth : dict
        ``case``, ``block``, ``level``, ``effects``, ``snr``.
    rng : numpy Generator
        That draws the noise.
    """

    site: Site
    bare: World
    world: World
    truth: dict
    rng: np.random.Generator


def drawn(draw: Draw) -> Drawn:
    """Draw the truth of a case; it follows from the seed alone."""
    rng = np.random.default_rng(draw.seed)
    site = draw_site(rng, poor=draw.block == "poor")
    bare = World(*shaken(site, draw.level, rng))
    world, hidden = with_effects(bare, draw.effects, rng)
    truth = {
        "case": draw.name, "block": draw.block, "level": draw.level, "effects": hidden,
        "snr": log_uniform(rng, *SNR),
    }  # fmt: skip
    return Drawn(site, bare, world, truth, rng)


def write_drawn(case: Drawn, store: Path):
    """Simulate the records of a case and write it: what is known, what is asked, what is true.

    Folders ``cases``, ``asked`` and ``truth``; a case that is there already stays.
    """
    name = case.truth["case"]
    if (store / "truth" / name).exists():
        return
    motion = ground_motion(case.world)
    noise = noise_of(case.site, motion, case.truth["snr"], case.rng)
    clean = recorded(case.world, motion)
    same = case.world.site is case.bare.site and case.world.damping is case.bare.damping
    without = recorded(case.bare, motion if same else ground_motion(case.bare))
    write_case(store / "cases" / name, name, case.site, recorded(case.world, motion, noise))
    write_asked(store / "asked" / name, case.site)
    _write_motion(store / "truth" / name, clean, without)


def with_effects(world: World, labels, rng):
    """Return the world with effects in it, and what they are."""
    hidden = []
    for label in labels:
        world, target, parameters = EFFECTS[label](world, rng)
        hidden.append(
            {"label": label, "family": FAMILY.get(label), "target": target,
             "parameters": plain(parameters)}
        )  # fmt: skip
    return world, hidden


def share_of(clean, without):
    """Return the largest share of a record's energy that effects change, of the logged blasts."""
    shares = [
        np.sum((clean[b] - without[b]) ** 2, axis=(1, 2)) / np.sum(clean[b] ** 2, axis=(1, 2))
        for b in clean
        if b != FURTHER
    ]
    return float(np.max(shares))


def _write_motion(folder, clean, without):
    """Write the true motion at once, with the share that effects change."""
    buffer = io.BytesIO()
    np.savez(
        buffer,
        **{f"clean {b}": v.astype(np.float32) for b, v in clean.items()},
        **{f"without {b}": v.astype(np.float32) for b, v in without.items()},
    )
    beside = folder.with_name(f".{folder.name}.{os.getpid()}")
    shutil.rmtree(beside, ignore_errors=True)
    beside.mkdir(parents=True)
    (beside / "motion.npz").write_bytes(buffer.getvalue())
    write_text(beside / "share", f"{share_of(clean, without):.9g}\n")
    beside.rename(folder)
