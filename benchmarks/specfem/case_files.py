"""Files of a case: what its engineer has, and beside it what is true."""

import tomllib
from pathlib import Path

import numpy as np

from examples.case_folder import SIDES, toml, write_project
from pyblast.files import plain, write_bytes, write_text
from pyblast.recordings.seismic import mseed_bytes
from verification.proof.cases import digest_of

from .hearing import shares
from .plan import HARD_NULLS
from .sites import BAND, BEFORE, DT, DURATION, FACE, FURTHER, LARGE, SIZE

START, NETWORK, CODES = "2024-05-01T10:00:00", "PB", ("HHE", "HHN", "HHZ")
LAYERS = {1: ("rock",), 2: ("soil", "rock")}
DEPTH, MARGIN = 80.0, 60.0  # m, of the box of a project, and of the survey around it
PADDING, PADDING_EDGE = 200.0, 35.0  # m
EDGES, SOIL_EDGE = 0.17, 5.5  # of the shortest S wave; m
LEAST = 0.02  # of the energy of a record, from which an effect is in it


def write_case(store: Path, case, recorded):
    """Write a case, its truth last, so that a folder of a truth is a whole one.

    ``case-NN`` has project files ``S1.toml``, ``B1.toml``, ``B2.toml`` with what they name;
    ``truth/case-NN`` has ``truth.toml``, motion without noise and the further blast.
    """
    name, site = case.draw.name, case.believed
    folder, truth = store / name, store / "truth" / name
    for each in (folder / "records", truth):
        each.mkdir(parents=True, exist_ok=True)
    _write_source(folder / "source.csv", site.pulse)
    if site.ground.height is not None:
        _write_surface(folder / "surface.csv", site.ground)
    logged = [blast for blast in site.blasts if blast != FURTHER]
    for blast in logged:
        _write_holes(folder / f"{blast}_holes.csv", site.blasts[blast])
        for receiver, motion in zip(site.names(), recorded.records[blast], strict=True):
            file = folder / "records" / f"{blast}_{receiver}.mseed"
            _write_motion(file, [receiver], motion[None])
        others = [f"{other}.toml" for other in logged if other != blast]
        write_project(folder / f"{blast}.toml", _tables(name, site, blast, others))
    _write_holes(truth / f"{FURTHER}_holes.csv", site.blasts[FURTHER])
    _write_motion(truth / f"{FURTHER}.mseed", site.names(), recorded.records[FURTHER])
    for blast, motion in recorded.clean.items():
        _write_motion(truth / f"clean_{blast}.mseed", site.names(), motion)
    _write_motion(truth / f"believed_{LARGE}.mseed", site.names(), recorded.believed)
    write_text(truth / "truth.toml", _as_toml(truth_of(case, recorded)))


def truth_of(case, recorded) -> dict:
    """Return the tables of ``truth.toml``."""
    names, draw = case.believed.names(), case.draw
    energy = shares(recorded.clean[LARGE], recorded.without)
    touched = energy >= LEAST
    null = draw.effect in HARD_NULLS
    parameters = case.truth["parameters"]
    centre = {}
    if "wx" in parameters:
        middle = -parameters["top"] - 0.5 * parameters["height"]
        centre = {"void_centre_m": [parameters["x"], parameters["y"], middle]}
    misfit = shares(recorded.clean[LARGE], recorded.believed)
    return plain({
        "case": draw.name, "drawn": digest_of(case.truth), "template": draw.template,
        "seed": list(draw.seed),
        "effects": ["null"] if null else [draw.effect], "out_of_library": draw.block == "outside",
        "hard_null": draw.effect if null else "",
        "effect_energy_mean_affected": float(energy[touched].mean()) if touched.any() else 0.0,
        "effect_energy_blast": LARGE, "signal_to_noise": case.snr,
        "affected": {"receivers": [n for n, yes in zip(names, touched, strict=True) if yes]},
        "parameters": {} if null else {draw.effect: parameters},
        "in_project_coordinates": centre, "effect_energy": {LARGE: energy},
        "misfit_believed": {LARGE: {"median": float(np.median(misfit)), "per_receiver": misfit}},
        "nuisance": case.truth["nuisance"], "numerics": recorded.numerics,
        "h1": {"holes": f"{FURTHER}_holes.csv", "records": f"{FURTHER}.mseed"},
    })  # fmt: skip


def _as_toml(tables):
    """Return nested tables as TOML."""
    heads = [f"{key} = {toml(value)}" for key, value in tables.items()
             if not isinstance(value, dict)]  # fmt: skip
    parts = [f"\n[{key}]\n" + "\n".join(f"{k} = {toml(v)}" for k, v in value.items())
             for key, value in tables.items() if isinstance(value, dict)]  # fmt: skip
    text = "\n".join([*heads, *parts]) + "\n"
    tomllib.loads(text)
    return text


def _tables(name, site, blast, others):
    """Return the tables of the project file of a blast."""
    layers = site.ground.layers
    names = LAYERS[len(layers)]
    edge = round(EDGES * layers[-1][1].cs / BAND[1], 1)
    rows = [{"material": material} | ({} if thickness is None else
            {"thickness_m": thickness, "edge_m": SOIL_EDGE})
            for material, (thickness, _) in zip(names, layers, strict=True)]  # fmt: skip
    surface = {} if site.ground.height is None else {"surface_file": "surface.csv"}
    return {
        "title": f"{name} {blast}",
        "mesh": {
            "size_m": [*SIZE, DEPTH], "origin_m": [0.0, 0.0, -DEPTH], "edge_m": edge,
            "quadratic": True, "padding_m": PADDING, "padding_edge_m": PADDING_EDGE, **surface,
            "layers": rows,
        },
        "materials": {
            material: {"density_kg_per_m3": round(rock.density), "cp_m_per_s": round(rock.cp),
                       "cs_m_per_s": round(rock.cs)}
            for material, (_, rock) in zip(names, layers, strict=True)
        },
        "boundaries": {"viscous": SIDES, "free": ["top"]},
        "blast": {"file": f"{blast}_holes.csv", "charge_exponent": site.exponent},
        "holes_inside": {"moment_rate_file": "source.csv"},
        "receivers": [
            {"name": receiver, "position_m": [float(v) for v in place if not np.isnan(v)],
             "recorded": {"file": f"records/{blast}_{receiver}.mseed", "unit": "m_per_s",
                          "start_s": -BEFORE}}
            for receiver, place in zip(site.names(), site.receivers, strict=True)
        ],
        "run": {"duration_s": DURATION, "compare_band_hz": list(BAND)},
        "diagnosis": {"band_hz": list(BAND), "noise_window_s": [-BEFORE, 0.0], "blasts": others},
    }  # fmt: skip


def _write_source(path, pulse):
    """Write the moment rate of 1 kg."""
    step = 5e-4
    at = step * np.arange(int(np.ceil(pulse.length / step)) + 2)
    rows = [f"{t:.5f},{v:.6e}" for t, v in zip(at, pulse(at), strict=True)]
    write_text(path, "\n".join(["time_s,moment_rate_per_kg_Nm_per_s", *rows]) + "\n")


def _write_surface(path, ground):
    """Write the survey of the surface, every `FACE` m."""
    x, y = (np.arange(-MARGIN, size + MARGIN + FACE, FACE) for size in SIZE)
    grid = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    heights = ground.surface(*grid.T)
    rows = [f"{a:g},{b:g},{z:.2f}" for (a, b), z in zip(grid, heights, strict=True)]
    write_text(path, "\n".join(["x_m,y_m,z_m", *rows]) + "\n")


def _write_holes(path, holes):
    """Write a hole table: middles of charges."""
    rows = [
        f"{n},{x:.3f},{y:.3f},{z:.3f},{charge:.3f},{time:.4f}"
        for n, ((x, y, z), charge, time) in enumerate(
            zip(holes.places, holes.charges, holes.times, strict=True), 1
        )
    ]
    write_text(path, "\n".join(["id,x,y,z,charge_kg,delay_s", *rows]) + "\n")


def _write_motion(path, receivers, motion):
    """Write motion (n_receivers, 3, n) in m/s as miniSEED."""
    channels = [[f"{NETWORK}.{name}..{code}" for code in CODES] for name in receivers]
    write_bytes(path, mseed_bytes(motion, channels, DT, START))
