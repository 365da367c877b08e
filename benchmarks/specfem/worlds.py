"""What is really there: a site with harmless errors, with an effect or with harder errors."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pyblast.files import plain

from .effects import EFFECTS
from .ground import Field
from .plan import HARD_NULLS, Draw
from .sites import Holes, Site, draw_site

EARLY = 0.2e-3  # s, of hole times and clocks, either way
SPEEDS = 0.005, 0.02  # share by which speeds differ
DENSITY = 0.02
REACH, FAR_REACH = 0.5, 2.0  # m, of receivers along each axis; in hard nulls
UNEVEN, VARIES = 0.03, (0.1, 0.3)  # of ground and of holes in hard nulls
SNR = 15.0, 60.0


@dataclass(frozen=True, eq=False)
class World:
    """A true site, and what becomes of its motion before it is written down.

    Parameters
    ----------
    site : Site
    lags : dict of str to (n_receivers,) float64, s
        How late clocks were.
    heard : tuple of callable
        ``(motion, site, blast, times) -> motion`` (n_receivers, 3, n) in m/s.
    """

    site: Site
    lags: dict
    heard: tuple[Callable, ...] = ()

    def with_site(self, **changes):
        """Return the world with changes of its site."""
        return replace(self, site=replace(self.site, **changes))

    def with_ground(self, **changes):
        """Return the world with changes of its ground."""
        return self.with_site(ground=replace(self.site.ground, **changes))

    def with_holes(self, blast, **changes):
        """Return the world with changes of the holes of a blast."""
        holes = replace(self.site.blasts[blast], **changes)
        return self.with_site(blasts={**self.site.blasts, blast: holes})


@dataclass(frozen=True, eq=False)
class Case:
    """A case whose truth is drawn and whose records are not simulated yet.

    Parameters
    ----------
    draw : Draw
    believed : Site
    bare, world : World
        With errors; with the effect as well.
    truth : dict
        Everything that was drawn.
    snr : float
        Median peak of S1 over the root mean square of the noise.
    rng : numpy Generator
        That draws the noise.
    """

    draw: Draw
    believed: Site
    bare: World
    world: World
    truth: dict
    snr: float
    rng: np.random.Generator


def drawn(draw: Draw) -> Case:
    """Draw the truth of a case; it follows from the seed alone."""
    rng = np.random.default_rng(draw.seed)
    site = draw_site(draw.template, rng)
    bare, errors = shaken(site, draw.effect if draw.effect in HARD_NULLS else "", rng)
    world, parameters = (bare, {})
    if draw.effect not in HARD_NULLS:
        world, parameters = EFFECTS[draw.effect](bare, rng)
    snr = float(np.exp(rng.uniform(*np.log(SNR))))
    truth = {
        "case": draw.name, "block": draw.block, "effect": draw.effect, "template": draw.template,
        "seed": list(draw.seed), "snr": snr, "parameters": plain(parameters),
        "nuisance": plain(errors), "layers": _layers(site), "holes": _holes(world.site.blasts),
        "receivers": plain(world.site.receivers[:, :2]),
    }  # fmt: skip
    return Case(draw, site, bare, world, truth, snr, rng)


def shaken(site: Site, hard: str, rng):
    """Return the world that differs from a site by harmless errors, and these errors.

    Parameters
    ----------
    site : Site
    hard : str
        Of `HARD_NULLS`, which errors are larger; empty for none.
    rng : numpy Generator
    """
    whole = hard == "all_at_once"
    factors = [
        [1.0 + rng.uniform(-DENSITY, DENSITY),
         *(1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(*SPEEDS, 2))]
        for _ in site.ground.layers
    ]  # fmt: skip
    layers = tuple(
        (thickness, rock.scaled(*map(float, three)))
        for (thickness, rock), three in zip(site.ground.layers, factors, strict=True)
    )
    reach = FAR_REACH if whole or hard == "moved_receivers" else REACH
    offsets = rng.uniform(-reach, reach, site.receivers.shape)
    early = {name: rng.uniform(-EARLY, EARLY, len(b.times)) for name, b in site.blasts.items()}
    lags = {name: rng.uniform(-EARLY, EARLY, len(site.receivers)) for name in site.blasts}
    spread = float(rng.uniform(*VARIES)) if whole or hard == "holes_vary" else 0.0
    scales = {name: np.exp(rng.normal(-0.5 * spread**2, spread, len(b.times)))
              for name, b in site.blasts.items()}  # fmt: skip
    field = None
    if whole or hard == "uneven_ground":
        field = Field(UNEVEN, float(rng.uniform(30.0, 60.0)), int(rng.integers(2**31)))
    errors = {
        "material_factors_rho_vp_vs": factors, "receiver_offsets_m": offsets,
        "hole_time_s": early, "receiver_clock_s": lags, "hole_spread": spread,
        "hole_scales": scales, "uneven": vars(field) if field else {},
    }  # fmt: skip
    blasts = {
        name: Holes(b.places, b.charges, b.times + early[name], scales[name])
        for name, b in site.blasts.items()
    }
    ground = replace(site.ground, layers=layers, field=field)
    true = replace(site, ground=ground, receivers=site.receivers + offsets, blasts=blasts)
    return World(true, lags), errors


def _layers(site):
    """Return the layers that are believed, as numbers."""
    return [[thickness or 0.0, rock.density, rock.cp, rock.cs]
            for thickness, rock in site.ground.layers]  # fmt: skip


def _holes(blasts):
    """Return the holes of blasts as they fired, as numbers."""
    return {name: plain(np.column_stack([b.places, b.charges, b.times, b.scales]))
            for name, b in blasts.items()}  # fmt: skip
