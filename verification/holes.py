"""Production blasts by a closed form, whose holes vary: what is named, learned and forecast.

    python -m verification.holes [ROW ...] [--page] [--again] [--minutes N]

Blasts of 30 holes in three rows, 35 to 130 kg, with eight receivers around. Every hole is a centre
of dilatation in a whole space, whose motion is written here and shares no line with the program;
holes and their paths vary by smooth random spectra of another law than the program's. Sites hold
nothing else, or one row of the table of hole effects at 3 % of the energy; nulls vary by 10, 20 or
30 %. Writes the rows that ``verification/holes.json`` lacks and the table of
docs/quality/diagnosis.md; ``--page`` writes the table alone.
"""

import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy import fft, interpolate

from pyblast.blasts.blast import Blast
from pyblast.blasts.hole_effects import ROWS, Pattern
from pyblast.config.config import check_config
from pyblast.diagnosis.calibration import Baseline
from pyblast.diagnosis.case import Case
from pyblast.diagnosis.decision import decide
from pyblast.diagnosis.effects import Scene
from pyblast.diagnosis.error import usual_energy
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.search import search
from pyblast.inference.records import band_functions, noise_of
from pyblast.model.model import Receiver
from pyblast.model.source import TimeFunction
from pyblast.project.project import make_project
from pyblast.sources.inside import Inside
from pyblast.survey import Survey

from .rows import study

OUT = Path(__file__).with_suffix(".json")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "quality" / "diagnosis.md"
BEGIN, END = "<!-- holes: from verification/holes.json -->", "<!-- end of holes -->"
CP, DENSITY, PULSE, MOMENT = 4000.0, 2600.0, 6e-3, 1e11  # m/s, kg/m3, s, N m of 1 kg
DT, SAMPLES, BAND = 2e-3, 200, (5.0, 40.0)  # s, of a record, Hz
NOISE, FIRING, CLOCK, TRIGGER, AMPLITUDE, TRANSFER = 0.02, 1.2e-4, 2e-4, 3e-4, 0.03, 0.1
NEAR = 20.0  # m between holes over which the spectra of their paths are alike
KNOTS = 4  # of a random spectrum, over the logarithm of frequency
SHARE = 0.03  # of the energy of the records that a row changes
NULLS = 4
EFFECTS = ("charge_exponent", "pulse_length", "confinement", "damage_by_earlier_holes",
           "screening", "screening/loss", "screening/delay", "row_number")  # fmt: skip
NAMES = (
    *(row.name for row in ROWS), "delay_scatter", "delay_scatter/pace", "clock_error",
    "clock_error/blast", "misfire_or_charge_error/holes", "misfire_or_charge_error/misfire",
    "misfire_or_charge_error/blast", "instrument_response/gain", "attenuation_Q/along all paths",
)  # fmt: skip
ALL = {f"site {n}": (0.2, EFFECTS[n - NULLS] if n >= NULLS else "", n) for n in range(12)}
ALL |= {
    f"null {percent} %, {n}": (0.01 * percent, "", 1000 * percent + n)
    for n in range(14) for percent in (10, 20, 30)
}  # fmt: skip
PROJECT = {
    "title": "holes",
    "mesh": {"size_m": [800.0, 800.0, 100.0], "origin_m": [-400.0, -400.0, -100.0],
             "edge_m": 100.0, "layers": [{"material": "rock"}]},
    "materials": {"rock": {"density_kg_per_m3": DENSITY, "cp_m_per_s": CP, "cs_m_per_s": 2300.0}},
    "boundaries": {"viscous": ["west", "east", "south", "north", "bottom"]},
    "blast": {"file": "holes.csv", "charge_exponent": 1.0},
    "holes_inside": {"moment_rate_file": "source.csv"},
    "run": {"duration_s": DT * SAMPLES, "compare_band_hz": list(BAND)},
}  # fmt: skip
AZIMUTH = np.radians(10.0 + 45.0 * np.arange(8))
AWAY = np.array([90.0, 140.0, 200.0, 110.0, 260.0, 150.0, 120.0, 180.0])
PLACES = np.column_stack([AWAY * np.cos(AZIMUTH), AWAY * np.sin(AZIMUTH), 0.0 * AWAY])


def blast(name, first, start, choked, rng):
    """Return three rows of ten holes that fire row by row from an end, away from the south."""
    row, number = np.divmod(np.arange(30), 10)
    x = 5.0 * (number + 0.5 * (row % 2)) - 25.0
    order = {"left": number, "right": 9 - number, "middle": np.abs(number - 5)}[start]
    times = 0.017 * order + 0.042 * row + 0.009 * (x > 0.0) * (start == "middle")
    collar = np.column_stack([x + first[0], 4.0 * (row + 1.0) + first[1], 0.0 * x])
    return Blast(
        name, collar, collar - [0.0, 0.0, 14.0], rng.permutation(np.geomspace(35.0, 130.0, 30)),
        times, 0.115, deck=np.column_stack([0.0 * x + 6.0, 0.0 * x + 14.0]), row=row.astype(float),
        stemming=3.5 * np.exp(0.12 * rng.standard_normal(30)), burden=4.0, face=np.pi,
        choked=choked,
    )  # fmt: skip


def blasts(rng):
    """Return three blasts that are recorded, and a fourth that is forecast."""
    plans = (
        ("B1", (0.0, 0.0), "left", False), ("B2", (-15.0, 0.0), "right", True),
        ("B3", (20.0, 12.0), "middle", False), ("B4", (10.0, 0.0), "right", False),
    )  # fmt: skip
    return [blast(*plan, rng) for plan in plans]


def spectra(fired, omega, places, longer=0.0):
    """Return the velocity of each hole, fired at zero, (n_holes, n_receivers, 3, n_omega).

    Of a centre of dilatation in a whole space, near and far field; `longer`: logarithm of the
    factor on the pulse of each hole.
    """
    step = places - fired.centres[:, None]
    r = np.linalg.norm(step, axis=-1)[..., None]
    pulse = PULSE * np.exp(np.broadcast_to(longer, len(fired.charge)))[:, None, None]
    rate = MOMENT * fired.charge[:, None, None] / (1.0 + 1j * omega * pulse) ** 2
    along = (1j * omega / r + CP / r**2) * np.exp(-1j * omega * r / CP) * rate
    return (step / r)[..., None] * along[:, :, None] / (4.0 * np.pi * DENSITY * CP**3)


def grid():
    """Return length and angular frequencies of the transforms."""
    size = fft.next_fast_len(3 * SAMPLES, real=True)
    return size, 2.0 * np.pi * fft.rfftfreq(size, DT)


def seismograms(spectrum):
    """Return motion (..., n_samples) in m/s."""
    return fft.irfft(spectrum, grid()[0])[..., :SAMPLES] / DT


def smooth(rng, shape, level):
    """Return smooth random log spectra (*shape, n_omega): amplitude, and phase half as large."""
    _, omega = grid()
    x = np.log(np.clip(omega / (2.0 * np.pi), *BAND) / BAND[0]) / np.log(BAND[1] / BAND[0])
    knots = level * rng.standard_normal((KNOTS, 2, *shape))
    drawn = interpolate.CubicSpline(np.linspace(0.0, 1.0, KNOTS), knots)(x)
    return np.moveaxis(drawn[:, 0] + 0.5j * drawn[:, 1], 0, -1)


def varied(fired, level, rng, n_receivers):
    """Return factors of holes and their paths that vary by a level, (n_holes, n_receivers, n)."""
    n, size = len(fired.charge), level / np.sqrt(2.0)
    apart = np.linalg.norm(fired.centres[:, None] - fired.centres, axis=-1)
    root = np.linalg.cholesky(np.exp(-((apart / NEAR) ** 2)) + 1e-6 * np.eye(n))
    paths = np.tensordot(root, smooth(rng, (n, n_receivers), size), 1)
    return np.exp(smooth(rng, (n, 1), size) + paths)


def changed(row, pattern, theta, omega):
    """Return spectra of holes with a row of the table of a strength, at the receivers."""
    own, longer = pattern.blast, 0.0
    if row is not None and row.kernel == "duration":
        longer = theta * row.covariate(pattern)[:, 0]
    spectrum = spectra(own, omega, pattern.receivers, longer)
    if row is not None and row.kernel != "duration":
        middle = 2.0 * np.pi * np.sqrt(BAND[0] * BAND[1])
        spectrum = spectrum * row.change(pattern, theta).factor(omega, middle)[:, :, None]
    return spectrum


def fired_at(spectrum, times, omega):
    """Return the sum over holes that fire at times, (n_receivers, 3, n_omega)."""
    return np.einsum("hrcf,hf->rcf", spectrum, np.exp(-1j * np.outer(times, omega)))


def strength_of(row, patterns, omega):
    """Return the strength at which a row changes a share of the energy of the records."""
    plan = [fired_at(spectra(p.blast, omega, p.receivers), p.blast.times, omega) for p in patterns]

    def share(theta):
        pairs = zip(patterns, plan, strict=True)
        moved = [
            fired_at(changed(row, p, theta, omega), p.blast.times, omega) - m for p, m in pairs
        ]
        inside = (omega > 2.0 * np.pi * BAND[0]) & (omega < 2.0 * np.pi * BAND[1])
        energy = [np.sum(np.abs(m[..., inside]) ** 2, axis=(1, 2)) for m in (*moved, *plan)]
        return np.mean(np.array(energy[: len(plan)]) / np.array(energy[len(plan) :]))

    theta = LIBRARY[row.name].parameters[0].sigma
    for _ in range(30):
        theta *= np.sqrt(SHARE / share(theta)) ** 0.7
    return float(theta)


def records(row, theta, patterns, level, rng, scales=1.0, late=0.0):
    """Return true motion of each blast at all receivers, with the errors of a survey.

    All holes radiate `scales` (n_holes,) times as much and fire late (n_holes,) s.
    """
    (_, omega), n = grid(), len(patterns[0].receivers)
    transfer = np.exp(smooth(rng, (n, 3), TRANSFER))
    clock = CLOCK * rng.standard_normal(n)
    out = []
    for pattern in patterns:
        own = pattern.blast
        size = np.broadcast_to(scales, len(own.times))[:, None, None, None]
        spectrum = size * changed(row, pattern, theta, omega)
        spectrum = spectrum * varied(own, level, rng, n)[:, :, None]
        error = FIRING * rng.standard_normal(len(own.times)) + TRIGGER * rng.standard_normal()
        total = fired_at(spectrum, own.times + late + error, omega) * transfer
        total = total * np.exp(-1j * np.multiply.outer(clock, omega))[:, None]
        out.append(np.exp(AMPLITUDE * rng.standard_normal()) * seismograms(total))
    return np.array(out)


def scene_of(fired, motion, rng, places=PLACES):
    """Return the scene of a survey whose site is known but for its usual errors."""
    _, omega = grid()
    times = np.arange(0.0, 0.1, DT)
    rate = TimeFunction(MOMENT * times * np.exp(-times / PULSE) / PULSE**2, DT)
    project = make_project(check_config(PROJECT), "holes.toml")
    names = tuple(f"R{n + 1}" for n in range(len(places)))
    receivers = tuple(Receiver(n, tuple(p)) for n, p in zip(names, places.tolist(), strict=True))
    shots = tuple(replace(project.shots[0], name=b.name, fired=b, held=Inside(rate)) for b in fired)
    project = replace(project, survey=Survey(shots, receivers, {}))
    own = [spectra(b, omega, places) for b in fired]
    plan = np.array([
        seismograms(fired_at(s, b.times, omega)) for s, b in zip(own, fired, strict=True)
    ])  # fmt: skip
    quiet = NOISE * np.sqrt(np.mean(plan**2))
    noise = noise_of(quiet * rng.standard_normal((3, len(names), 3, 200)), DT, BAND)
    motion = motion + quiet * rng.standard_normal(motion.shape)
    case = Case(
        tuple(b.name for b in fired), names, DT, motion, np.ones(motion.shape, bool),
        band_functions(SAMPLES, DT, BAND), noise, project=project,
    )  # fmt: skip
    baseline = Baseline(
        case, (), np.zeros(0), np.zeros((0, 0)), project, plan, np.zeros((0, *plan.shape)), plan,
        np.zeros_like(plan), usual_energy(case),
    )  # fmt: skip
    holes = {b.name: seismograms(s) for b, s in zip(fired, own, strict=True)}
    never = SimpleNamespace(runs=0, priced=0.0, executor=None, shots=case.blasts)
    scene = Scene(never, baseline, holes)
    aside = [
        np.array([
            seismograms(fired_at(spectra(b, omega, places + move) - s, b.times, omega))
            for s, b in zip(own, fired, strict=True)
        ])
        for move in np.eye(3)[:2]
    ]  # fmt: skip
    scene.__dict__["surroundings"] = SimpleNamespace(slopes=lambda: np.array(aside))
    return scene


@contextmanager
def library_of(names):
    """Leave hypotheses of some names in the library."""
    whole = dict(LIBRARY)
    for name in set(whole) - set(names):
        LIBRARY.pop(name)
    try:
        yield
    finally:
        LIBRARY.clear()
        LIBRARY.update(whole)


def measured(name):
    """Return the row of a site: what was hidden, what is answered, how much holes vary."""
    level, effect, seed = ALL[name]
    rng = np.random.default_rng(seed)
    fired = blasts(rng)
    charges = np.concatenate([b.charge for b in fired[:3]])
    reference = float(np.exp(np.mean(np.log(charges))))
    patterns = [Pattern(b, PLACES, reference) for b in fired]
    row = next((each for each in ROWS if each.name == effect), None)
    theta = 0.0 if row is None else strength_of(row, patterns[:3], grid()[1])
    motion = records(row, theta, patterns, level, rng)
    scene = scene_of(fired[:3], motion[:3], rng)
    with library_of(NAMES):
        done = search(scene)
        decision = decide(done)
    classes = list(done.classes().items())[:3]
    named = decision.outcome in ("NAMED", "COMPOSITE")
    labels = sorted({e.label for e in decision.fit.effects} | set(decision.rivals))
    varying = scene.varied.level
    return {
        "variation": level, "effect": effect, "strength": theta, "outcome": decision.outcome,
        "labels": labels, "named": named,
        "right": not labels if not effect else effect.split("/")[0] in labels,
        "scores": {label: round(score, 1) for label, score in classes},
        "required": round(done.required, 1),
        "found": [round(x, 3) for x in (varying.value, varying.low, varying.high)],
        "fitted": {
            e.name: e.values[0][0] for e in decision.fit.effects if len(e.values[0]) == 1
        },
    }  # fmt: skip


def table(rows):
    """Return the lines of the table of sites, and the sums of the nulls."""
    lines = ["| site | hidden | answer | holes vary by, % |", "|---|---|---|---|"]
    for name, row in rows.items():
        if name.startswith("site"):
            found = [round(100 * x) for x in row["found"]]
            said = f"{row['outcome']} {', '.join(row['labels'])}".strip()
            lines.append(
                f"| {name} | {row['effect'] or 'nothing'} | {said} | {found[0]} ({found[1]} to "
                f"{found[2]}) |"
            )
    for percent in (10, 20, 30):
        own = [row for name, row in rows.items() if name.startswith(f"null {percent} %")]
        if own:
            wrong = sum(bool(row["labels"]) for row in own)
            found = np.array([row["found"][0] for row in own])
            near = np.mean(np.abs(100 * found - percent) < percent / 3.0)
            lines.append(
                f"| nulls: {len(own)} | holes vary by {percent} % | {wrong} with a name | "
                f"{100 * np.median(found):.0f} in the median, {100 * near:.0f} % of them within "
                "a third |"
            )
    return lines


def main(arguments):
    """Measure rows and write them and the table."""
    study(arguments, ALL, measured, table, OUT, PAGE, (BEGIN, END))


if __name__ == "__main__":
    main(sys.argv[1:])
