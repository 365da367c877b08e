"""One case: a believed site, a true world, its records, its truth under seal."""

import io
import os
import shutil
from pathlib import Path

import numpy as np

from pyblast.files import plain

from . import instruments, outside  # noqa: F401  fill EFFECTS
from .case_files import write_asked, write_case
from .effects import EFFECTS, log_uniform
from .nuisances import shaken
from .plan import FAMILY, Draw
from .sealing import digest, seal
from .sites import FURTHER, draw_site
from .worlds import World, ground_motion, noise_of, recorded

SNR = 5.0, 40.0


def draw(draw_of: Draw, store: Path) -> str:
    """Draw a case into a store and return its seal; a case that is there already is only read."""
    name = draw_of.name
    truth_folder = store / "truth" / name
    if (truth_folder / "truth.json").exists():
        return digest((truth_folder / "truth.json").read_bytes())
    rng = np.random.default_rng(draw_of.seed)
    site = draw_site(rng, poor=draw_of.block == "poor")
    true, lags = shaken(site, draw_of.level, rng)
    bare = World(true, lags)
    world, hidden = with_effects(bare, draw_of.effects, rng)
    motion = ground_motion(world)
    snr = log_uniform(rng, *SNR)
    noise = noise_of(site, motion, snr, rng)
    clean = recorded(world, motion)
    same = world.site is bare.site and world.damping is bare.damping
    without = recorded(bare, motion if same else ground_motion(bare))
    truth = {
        "case": name, "block": draw_of.block, "level": draw_of.level, "effects": hidden,
        "snr": snr, "share": share_of(clean, without),
    }  # fmt: skip
    write_case(store / "cases" / name, name, site, recorded(world, motion, noise))
    write_asked(store / "asked" / name, site)
    return _write_truth(truth_folder, truth, clean, without)


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


def _write_truth(folder, truth, clean, without):
    """Write a truth with its motion at once, and return its seal."""
    buffer = io.BytesIO()
    np.savez(
        buffer,
        **{f"clean {b}": v.astype(np.float32) for b, v in clean.items()},
        **{f"without {b}": v.astype(np.float32) for b, v in without.items()},
    )
    text, sealed = seal({**truth, "motion": digest(buffer.getvalue())})
    beside = folder.with_name(f".{folder.name}.{os.getpid()}")
    shutil.rmtree(beside, ignore_errors=True)
    beside.mkdir(parents=True)
    (beside / "motion.npz").write_bytes(buffer.getvalue())
    (beside / "truth.json").write_text(text, encoding="utf-8")
    beside.rename(folder)
    return sealed
