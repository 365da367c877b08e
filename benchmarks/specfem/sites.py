"""Sites as their engineer knows them: ground, blasts, receivers, drawn at random by template."""

from dataclasses import dataclass

import numpy as np

from .ground import Ground, Rock

SIZE = 230.0, 180.0  # m
BAND = 4.0, 25.0  # Hz
DT, BEFORE, DURATION = 0.002, 0.25, 0.75  # s: sampling, record before the zero, and after it
SINGLE, LARGE = "S1", "B2"  # blasts: of one hole, and in which effects of single blasts are hidden
FURTHER = "H1"  # blast that no diagnosis reads
FACE = 5.0  # m, of which lines of a slope are multiples, as the survey of the surface is
APART = 14.0  # m, between receivers


@dataclass(frozen=True)
class Hill:
    """A hill with a Gaussian section: height and width in m, place of its top."""

    height: float
    width: float
    place: tuple[float, float]

    def __call__(self, x, y):
        """Return heights in m."""
        far = (x - self.place[0]) ** 2 + (y - self.place[1]) ** 2
        return self.height * np.exp(-0.5 * far / self.width**2)


@dataclass(frozen=True)
class Bench:
    """A slope from a floor up to the level of zero, between two lines across x, in m."""

    height: float
    toe: float
    crest: float

    def __call__(self, x, y):
        """Return heights in m."""
        return np.interp(x + 0.0 * y, [self.toe, self.crest], [-self.height, 0.0])


@dataclass(frozen=True, eq=False)
class Holes:
    """Holes of a blast: places (n, 3) in m, charges in kg, times in s, scales of their moments."""

    places: np.ndarray
    charges: np.ndarray
    times: np.ndarray
    scales: np.ndarray


@dataclass(frozen=True)
class Pulse:
    """Moment rate of 1 kg in N m/s: sin⁴ over a length in s, which has no corner."""

    size: float
    length: float

    def __call__(self, times):
        """Return the rate at times in s after a hole fires."""
        share = np.asarray(times) / self.length
        return self.size * np.sin(np.pi * np.clip(share, 0.0, 1.0)) ** 4


@dataclass(frozen=True, eq=False)
class Site:
    """A site, as believed or as it is.

    Parameters
    ----------
    template : str
    ground : Ground
    receivers : (n, 3) float64, m
        On the ground where z is NaN.
    blasts : dict of str to Holes
    pulse : Pulse
    exponent : float
        Of the charge.
    """

    template: str
    ground: Ground
    receivers: np.ndarray
    blasts: dict[str, Holes]
    pulse: Pulse
    exponent: float

    def names(self):
        """Return the names of the receivers."""
        return [f"R{n:02d}" for n in range(1, 1 + len(self.receivers))]

    def breaks(self):
        """Return further lines of a mesh along x and y: foot and head of a slope."""
        height = self.ground.height
        return ((height.toe, height.crest) if isinstance(height, Bench) else (), ())


def draw_site(template: str, rng) -> Site:
    """Draw a site of a template: flat, soil, hill or bench."""
    cs = float(rng.uniform(1800.0, 2600.0))
    rock = Rock(float(rng.uniform(2550, 2800)), cs * float(rng.uniform(1.68, 1.85)), cs)
    layers, height, deep = ((None, rock),), None, 8.0
    pit = float(rng.uniform(185.0, 200.0)), float(rng.uniform(70.0, 110.0))
    if template == "soil":
        slow, thickness = float(rng.uniform(0.42, 0.55)), round(rng.uniform(8.0, 11.0), 1)
        soil = Rock(float(rng.uniform(1900.0, 2150.0)), slow * rock.cp, slow * rock.cs)
        layers, deep = ((thickness, soil), (None, rock)), thickness + 3.0
    elif template == "hill":
        place = float(rng.uniform(80.0, 130.0)), float(rng.uniform(50.0, 130.0))
        height = Hill(float(rng.uniform(9.0, 15.0)), float(rng.uniform(48.0, 60.0)), place)
    elif template == "bench":
        crest = FACE * round(rng.uniform(160.0, 170.0) / FACE)
        rise = round(rng.uniform(8.0, 12.0), 1)
        height = Bench(rise, crest - 4 * FACE, crest)
    ground = Ground(layers, height)
    counts = {"S1": 1, "B1": rng.integers(6, 10), "B2": rng.integers(8, 13), FURTHER: 8}
    charges = {
        "S1": rng.uniform(9.0, 14.0), "B1": rng.uniform(5.0, 9.0), "B2": rng.uniform(45.0, 75.0),
        FURTHER: rng.uniform(30.0, 45.0),
    }  # fmt: skip
    blasts = {name: _blast(rng, pit, deep, counts[name], charges[name], ground) for name in counts}
    return Site(
        template, ground, _receivers(rng, int(rng.integers(9, 12)), ground, template), blasts,
        Pulse(float(rng.uniform(1e11, 2e11)), float(rng.uniform(0.08, 0.105))),
        round(rng.uniform(0.82, 0.98), 2),
    )  # fmt: skip


def _blast(rng, pit, deep, count, charge, ground):
    """Draw two rows of holes of about one charge, somewhere about a place."""
    n, start = np.arange(count), np.array(pit) + rng.uniform(-9.0, 9.0, 2) * (0.5, 1.5)
    rows = np.column_stack([n // 5 * 4.5, n % 5 * 5.0])
    x, y = (start + rows + rng.uniform(-0.4, 0.4, (count, 2))).T
    z = ground.surface(x, y) - deep - rng.uniform(1.0, 2.0, count)
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.021, 0.03, count - 1))])
    weights = (charge * rng.uniform(0.9, 1.1, count)).round(2)
    return Holes(np.column_stack([x, y, z]).round(3), weights, times.round(4), np.ones(count))


def _receivers(rng, count, ground, template):
    """Draw receivers west of the blasts, two of them in boreholes; none on a slope."""
    places = []
    east = 225.0 if template == "bench" else 165.0
    while len(places) < count:
        x, y = rng.uniform(12.0, east), rng.uniform(12.0, 168.0)
        slope = template == "bench" and abs(x - ground.height.crest + 2 * FACE) < 5 * FACE
        near = [np.hypot(x - a, y - b) for a, b, _ in places]
        if slope or (x > 165.0 and 45.0 < y < 155.0) or min([*near, 99.0]) < APART:
            continue
        buried = template != "hill" and len(places) < 2
        places.append((x, y, float(ground.surface(x, y)) - rng.uniform(12, 20) if buried
                       else np.nan))  # fmt: skip
    return np.array(places).round(2)
