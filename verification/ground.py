"""Grounds of random legitimate project files: built as asked, and turned with the file.

    python -m verification.ground [COUNT] [--seed N] [--again] [--minutes N]

Draws boxes with layers, faults, joint sets, hills and sides of every kind, and judges each mesh by
points thrown on what the file asks for and on what stands in the mesh: no code of the builders and
none of their survey is used. Some projects are turned by quarters and mirrored; their records must
turn with them. Others, between sides that reflect, run on hexahedra and on quadratic tetrahedra,
each on two meshes; the motions must agree within the errors that the finer meshes show.
Writes the rows that ``verification/ground.json`` lacks, their summary, and the table of
docs/quality/verification.md; COUNT 300, seed 2026, 25 minutes unless given otherwise.
"""

import sys
import tempfile
import time
from copy import deepcopy
from pathlib import Path

import numpy as np
from scipy.interpolate import LinearNDInterpolator

from pyblast.config.config import check_config
from pyblast.errors import PyblastError
from pyblast.files import write_text
from pyblast.mesh.mesh import locate_in_zones
from pyblast.project.project import make_project
from pyblast.solver.injection import near_receivers
from pyblast.solver.run import simulate

from .markdown import between
from .rows import draws, each_row, read_rows

OUT = Path(__file__).with_suffix(".json")
PAGE = OUT.parents[1] / "docs" / "quality" / "verification.md"
BEGIN, END = "<!-- grounds: from verification/ground.json -->", "<!-- end of grounds -->"
SEED, COUNT, MINUTES = 2026, 300, 25.0
SIDES = {"west": (0, 0), "east": (0, 1), "south": (1, 0), "north": (1, 1), "bottom": (2, 0)}
SHARE = 0.02  # of the wavelength: tolerance of lengths
THROWN = 400  # points on each plane, and in the box
TURNS = ("quarter", "mirrored", "moved", "30 degrees")
ANGLES = {"quarter": 90.0, "30 degrees": 30.0}
MOVED = np.array([137.3, -41.9, 0.0])  # m
PAIRS = 40  # projects that run on both elements
SIDES_OF_PAIRS = "free", "fixed", "roller"
FINER = 1.6  # of the frequency that the second mesh of an element is made for
PULSE = 0.35  # central frequency of the source over the highest; 0.6 % of its peak is left there
PERIODS = 3.0  # of it, after which its pulse is over: one that starts or stops at once is no wave
EDGES = 3.0  # per wavelength of quadratic tetrahedra


def tables_of(seed: int, number: int) -> dict:
    """Return the tables of one project file; heights of a hill stand under ``hill``."""
    rng = np.random.default_rng([seed, number])
    size = [float(v) for v in rng.uniform([90.0, 80.0, 40.0], [220.0, 180.0, 70.0]).round()]
    frequency, hill = float(rng.choice([15.0, 20.0, 30.0])), None
    sides = ["west", "east", "south", "north", "bottom"]
    free = [str(side) for side in sides[:4] if rng.random() < 0.12]
    layers = [{"material": "rock"}]
    if rng.random() < 0.35:
        layers = [{"material": "soil", "thickness_m": round(float(rng.uniform(2.0, 12.0)), 1)},
                  *layers]  # fmt: skip
    faults = [_fault(rng, f"F{n}", size) for n in range(rng.choice(4, p=[0.3, 0.4, 0.2, 0.1]))]
    sets = [_joint_set(rng, "S", layers)] if rng.random() < 0.35 else []
    if rng.random() < 0.15:
        hill = _hill(rng, size)
    joint = {"law": "elastic", "kn_gpa_per_m": 0.4, "ks_gpa_per_m": 0.2}
    inside = [[float(v) for v in (0.15 + 0.7 * rng.random(2)) * size[:2]] for _ in range(4)]
    quality = {"qp": 60.0, "qs": 30.0, "quality_band_hz": [1.0, 60.0]}
    return {
        "title": f"random ground {number}",
        "mesh": {"size_m": size, "origin_m": [0.0, 0.0, -size[2]], "frequency_hz": frequency,
                 "layers": layers, "faults": faults, "joint_sets": sets},
        "materials": {
            "rock": {"density_kg_per_m3": 2600.0, "cp_m_per_s": 3400.0, "cs_m_per_s": 1900.0},
            "soil": {"density_kg_per_m3": 2000.0, "cp_m_per_s": 1500.0, "cs_m_per_s": 750.0,
                     **quality},
        } if len(layers) > 1 else {
            "rock": {"density_kg_per_m3": 2600.0, "cp_m_per_s": 3400.0, "cs_m_per_s": 1900.0}},
        "joints": {part["name"]: joint for part in (*faults, *sets)},
        "boundaries": {"viscous": [s for s in sides if s not in free], "free": ["top", *free]},
        "point_forces": [{"position_m": [*inside[0], -0.4 * size[2]], "file": "f.csv",
                          "direction": [1.0, 2.0, -3.0]}],
        "receivers": [{"name": f"R{n}", "position_m": at} for n, at in enumerate(inside[1:])],
        "run": {"duration_s": PERIODS / (PULSE * frequency) + 0.05},
        "hill": hill,
    }  # fmt: skip


def tables_of_pair(seed: int, number: int) -> dict:
    """Return the tables of one project between sides that reflect, with receivers far away."""
    tables, rng = tables_of(seed, number), np.random.default_rng([seed, number, 2])
    size = np.array(tables["mesh"]["size_m"])
    sides = {key: [] for key in SIDES_OF_PAIRS}
    for side in SIDES:
        sides[str(rng.choice(SIDES_OF_PAIRS))].append(side)
    sides["free"].append("top")
    source = [*(rng.uniform(0.1, 0.2, 2) * size[:2]), -rng.uniform(0.3, 0.7) * size[2]]
    plan = rng.uniform(0.4, 0.9, (8, 2)) * size[:2]
    force = {**tables["point_forces"][0], "position_m": [float(v) for v in source]}
    tables["mesh"]["frequency_hz"] = 30.0
    tables["run"]["duration_s"] = PERIODS / (PULSE * 30.0) + 0.05
    return tables | {
        "boundaries": {"viscous": [], **sides},
        "point_forces": [force],
        "receivers": [{"name": f"R{n}", "position_m": at} for n, at in enumerate(plan.tolist())],
    }


def _fault(rng, name, size):
    """Draw a fault, a third of them of limited extent."""
    part = {
        "name": name,
        "dip_deg": float(rng.choice([90.0, rng.integers(25, 86)])),
        "dip_direction_deg": float(rng.choice([rng.choice([0, 90, 180, 270]), rng.integers(360)])),
        "through_m": [*(float(v) for v in (rng.uniform(0.25, 0.75, 2) * size[:2]).round(1)),
                      -0.5 * size[2]],
    }  # fmt: skip
    if rng.random() < 0.3:
        part["extent_m"] = [float(v) for v in rng.uniform([20.0, 12.0], [60.0, 25.0]).round()]
    return part


def _joint_set(rng, name, layers):
    """Draw a joint set, of all layers or of the last."""
    part = {
        "name": name,
        "dip_deg": float(rng.choice([0.0, 90.0, rng.integers(5, 81)])),
        "dip_direction_deg": float(rng.choice([rng.choice([0, 90, 180, 270]), rng.integers(360)])),
        "spacing_m": round(float(rng.uniform(18.0, 45.0)), 1),
    }
    return part | ({"regions": ["rock"]} if len(layers) > 1 and rng.random() < 0.5 else {})


def _hill(rng, size):
    """Draw the heights (n, 3) of a hill."""
    x, y = np.meshgrid(*(np.arange(-20.0, width + 20.1, 10.0) for width in size[:2]))
    middle, width = rng.uniform(0.3, 0.7, 2) * size[:2], rng.uniform(0.2, 0.5) * min(size[:2])
    away = np.hypot(x - middle[0], y - middle[1]) / width
    height = rng.uniform(3.0, 15.0) * np.exp(-(away**2))
    return np.column_stack([x.ravel(), y.ravel(), height.ravel()]).tolist()


def project_of(tables: dict, folder: Path, **mesh):
    """Return the project of some tables, with other keys of its mesh."""
    tables = deepcopy(tables)
    hill = tables.pop("hill")
    central = PULSE * tables["mesh"]["frequency_hz"]
    times = np.arange(0.0, PERIODS / central, 5e-4)
    phase = (np.pi * central * (times - 0.5 * PERIODS / central)) ** 2
    rows = zip(times, 1e6 * (1.0 - 2.0 * phase) * np.exp(-phase), strict=True)
    lines = ["time_s,force_n", *(f"{t:.4f},{force:.6g}" for t, force in rows)]
    (folder / "f.csv").write_text("\n".join(lines) + "\n")
    if hill is not None:
        lines = ["x_m,y_m,z_m", *(",".join(f"{v:.6f}" for v in row) for row in hill)]
        (folder / "hill.csv").write_text("\n".join(lines) + "\n")
        tables["mesh"]["surface_file"] = "hill.csv"
    tables["mesh"] |= mesh
    return make_project(check_config(tables), folder / "project.toml")


# What the file asks for, by formula.


class Asked:
    """Planes, layers and heights of tables, read from the numbers alone."""

    def __init__(self, tables):
        """Read the tables."""
        mesh = tables["mesh"]
        self.low = np.array(mesh["origin_m"])
        self.high = self.low + mesh["size_m"]
        self.standing = [s for s in SIDES if s not in tables["boundaries"]["viscous"]]
        self.depth = mesh["layers"][0].get("thickness_m", 0.0)
        speeds = [tables["materials"][part["material"]]["cs_m_per_s"] for part in mesh["layers"]]
        self.short = SHARE * min(speeds) / mesh["frequency_hz"]
        self.hill = None
        if tables["hill"] is not None:
            places = np.array(tables["hill"])
            self.hill = LinearNDInterpolator(places[:, :2], places[:, 2])
        self.receivers = np.array([part["position_m"] for part in tables["receivers"]])
        self.faults, self.sets = mesh["faults"], mesh["joint_sets"]

    def ground(self, plan):
        """Return the height of the ground at places (n, 2 or 3)."""
        if self.hill is None:
            return np.full(len(plan), self.high[2])
        return self.hill(plan[:, :2])

    def inside(self, points, margin):
        """Return whether points lie in the box and under the ground by a margin."""
        high = [*self.high[:2], np.inf]
        within = ((points > self.low + margin) & (points < np.array(high) - margin)).all(axis=1)
        return within & (points[:, 2] < self.ground(points) - margin)


def frame_of(part):
    """Return strike, direction down the dip and upward normal of a plane."""
    dip, towards = np.radians([part["dip_deg"], part["dip_direction_deg"]])
    level = np.array([np.sin(towards), np.cos(towards), 0.0])
    strike = np.array([-level[1], level[0], 0.0])
    down = np.cos(dip) * level - np.sin(dip) * np.array([0.0, 0.0, 1.0])
    return strike, down, np.cross(strike, down) * np.sign(np.cross(strike, down)[2] or 1.0)


# What stands in the mesh.


def wrong_ground(tables: dict, mesh, rng) -> list[str]:
    """Return in words what is wrong in a mesh, not split."""
    asked = Asked(tables)
    wrong = [*_sides(asked, mesh, rng), *_layers(asked, mesh, rng)]
    for part in asked.faults:
        wrong += _surface(asked, mesh, part, [np.array(part["through_m"])], rng)
    for part in asked.sets:
        normal, middle = frame_of(part)[2], 0.5 * (asked.low + asked.high)
        count = int(np.linalg.norm(asked.high - asked.low) / part["spacing_m"]) + 2
        steps = part["spacing_m"] * np.arange(-count, count + 1)
        wrong += _surface(asked, mesh, part, [middle + step * normal for step in steps], rng)
    return wrong


def _sides(asked, mesh, rng):
    """Yield sides that stand elsewhere, the top by its mean square and under each receiver."""
    for side, (axis, end) in SIDES.items():
        at = mesh.points[np.unique(mesh.surfaces[side]), axis]
        wanted = (asked.low, asked.high)[end][axis]
        if side in asked.standing and np.abs(at - wanted).max() > asked.short:
            yield f"{side} at {at[np.abs(at - wanted).argmax()]:.2f} for {wanted:.2f} m"
        elif (at.max() < wanted - asked.short) if end else (at.min() > wanted + asked.short):
            yield f"{side} leaves out a part of the box"
    top = _top_nodes(mesh)
    plan = rng.uniform(asked.low[:2], asked.high[:2], (10 * THROWN, 2))
    height = LinearNDInterpolator(top[:, :2], top[:, 2])
    off = float(np.sqrt(np.nanmean((height(plan) - asked.ground(plan)) ** 2)))
    if off > asked.short:
        yield f"the top is {off:.2f} m off"
    for number, away in enumerate(height(asked.receivers) - asked.ground(asked.receivers)):
        if not abs(away) <= asked.short:
            yield f"the ground under R{number} is {away:.2f} m off"


def _top_nodes(mesh):
    """Return the nodes (n, 3) of the top, of curved hexahedra those of their upper faces."""
    if mesh.places is None:
        return mesh.points[np.unique(mesh.surfaces["top"])]
    faces = {tuple(face) for face in np.sort(mesh.surfaces["top"], axis=1).tolist()}
    upper = np.sort(mesh.zones[:, 4:], axis=1).tolist()
    over = [tuple(face) in faces for face in upper]
    return mesh.places[over][:, -((mesh.order + 1) ** 2) :].reshape(-1, 3)


def _layers(asked, mesh, rng):
    """Yield layers that are found where another one is asked for."""
    points = rng.uniform(asked.low, asked.high, (THROWN, 3))
    border = asked.high[2] - asked.depth
    points = points[asked.inside(points, asked.short)]
    points = points[np.abs(points[:, 2] - border) > asked.short]
    zones = locate_in_zones(mesh, points, np.inf)[0]
    groups = np.array(mesh.groups)[mesh.zone_group[zones]]
    wanted = np.where((points[:, 2] > border) & (asked.depth > 0.0), "soil", "rock")
    if (groups != wanted).any():
        x, y, z = points[groups != wanted][0]
        yield f"{(groups != wanted).mean():.1%} in another layer, as at ({x:.1f}, {y:.1f}, {z:.1f})"
    if mesh.layer is not None and mesh.layer.depths(points).max(initial=0.0) > 0.0:
        yield "a part of the box lies in the absorbing layer"


def _surface(asked, mesh, part, origins, rng):
    """Yield what is wrong with the facets of a fault or joint set."""
    name, (strike, down, normal) = part["name"], frame_of(part)
    corners = mesh.points[mesh.surfaces[name]]
    reach = 2.0 * np.linalg.norm(asked.high - asked.low)
    half = 0.5 * np.array(part.get("extent_m", [reach, reach]))
    top = np.inf if "regions" not in part else asked.high[2] - asked.depth
    middles = _spread(corners, rng)
    middles = middles[asked.inside(middles, asked.short)]
    away = np.min([np.abs((middles - origin) @ normal) for origin in origins], axis=0)
    if away.max(initial=0.0) > asked.short:
        yield f"{name} lies up to {away.max():.2f} m from its plane"
    local = np.abs((middles - origins[0]) @ np.array([strike, down]).T) - half
    if local.max(initial=-np.inf) > asked.short or (middles[:, 2] > top + asked.short).any():
        yield f"{name} reaches beyond its ends"
    for origin in origins:
        share = rng.uniform(-1.0, 1.0, (40 * THROWN, 2))
        size = np.minimum(half - asked.short, reach) if "extent_m" in part else half / 2.0
        points = origin + share * size @ np.array([strike, down])
        points = points[asked.inside(points, 2.0 * asked.short)][:THROWN]
        points = points[points[:, 2] < top - asked.short]
        missing = _beyond(points, corners, normal, asked.short)
        if missing.mean() > 0.02 if len(missing) > 20 else False:
            yield f"{name} lacks {missing.mean():.0%} of a plane"


def _spread(corners, rng):
    """Return points on facets (n, 3 or 4, 3), several on each."""
    weights = rng.dirichlet(np.ones(corners.shape[1]), (8, len(corners)))
    return np.einsum("knc,ncx->knx", weights, corners).reshape(-1, 3)


def _beyond(points, corners, normal, reach):
    """Return whether points of a plane lie on no facet, (n,) bool."""
    facets = [corners[:, [0, 1, 2]]] + ([corners[:, [0, 2, 3]]] if corners.shape[1] == 4 else [])
    facets = np.concatenate(facets)
    facets = facets[np.abs((facets.mean(axis=1) - points[:1]) @ normal) < 4.0 * reach] if len(
        points) else facets  # fmt: skip
    missing = np.ones(len(points), dtype=bool)
    for a, b, c in facets:
        turn = np.sign(np.cross(b - a, c - a) @ normal)
        sides = [np.cross(q - p, points - p) @ normal * turn / np.linalg.norm(q - p)
                 for p, q in ((a, b), (b, c), (c, a))]  # fmt: skip
        missing &= ~(np.min(sides, axis=0) > -reach)
    return missing


# Turned and mirrored.


def turned(tables: dict, how: str) -> tuple[dict, np.ndarray]:
    """Return tables turned anticlockwise about the vertical, mirrored or moved, and the matrix.

    A ground that is turned by 30 degrees lies in the box around it, so all its sides are open.
    """
    angle = ANGLES.get(how, 0.0)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    matrix = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    if how == "mirrored":
        matrix = np.diag([-1.0, 1.0, 1.0])
    if angle % 90.0 == 0.0:
        matrix = np.round(matrix)
    shift = MOVED if how == "moved" else np.zeros(3)
    other = deepcopy(tables)
    mesh = other["mesh"]
    low, size = np.array(mesh["origin_m"]), np.array(mesh["size_m"])
    corners = low + size * np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    corners = corners @ matrix.T + shift
    mesh["origin_m"] = corners.min(axis=0).tolist()
    mesh["size_m"] = np.ptp(corners, axis=0).tolist()
    for part in (*mesh["faults"], *mesh["joint_sets"]):
        towards = part["dip_direction_deg"]
        towards = -towards if how == "mirrored" else towards - angle
        part["dip_direction_deg"] = float(towards % 360.0)
        if "through_m" in part:
            part["through_m"] = (matrix @ part["through_m"] + shift).tolist()
    _turn_sides(other["boundaries"], matrix)
    for part in other["receivers"]:
        part["position_m"] = (matrix[:2, :2] @ part["position_m"] + shift[:2]).tolist()
    for part in other["point_forces"]:
        part["position_m"] = (matrix @ part["position_m"] + shift).tolist()
        part["direction"] = (matrix @ part["direction"]).tolist()
    if other["hill"] is not None:
        other["hill"] = (np.array(other["hill"]) @ matrix.T + shift).tolist()
    return other, matrix


def turns_of(tables: dict) -> tuple[str, ...]:
    """Return the ways in which a ground can be turned: by 30 degrees if it goes on all around."""
    free = set(tables["boundaries"]["free"]) == {"top"} and tables["hill"] is None
    return TURNS if free else TURNS[:-1]


def _turn_sides(boundaries, matrix):
    """Turn the names of sides, where they have others."""
    looks = {side: np.eye(3)[axis] * (2 * end - 1) for side, (axis, end) in SIDES.items()}
    names = {
        side: next((n for n, v in looks.items() if np.allclose(v, matrix @ along)), side)
        for side, along in looks.items()
    } | {"top": "top"}
    for key in ("viscous", "free"):
        boundaries[key] = [names[side] for side in boundaries[key]]


def records_of(project) -> np.ndarray:
    """Return the velocities (n_receivers, n_samples, 3) in m/s on common times."""
    run = simulate(project.model, project.duration)
    times = np.linspace(0.0, project.duration - 0.01, 600)
    return np.array(
        [
            np.column_stack([np.interp(times, record.times, v) for v in record.velocity.T])
            for record in run.seismograms.values()
        ]
    )


def energy_of_difference(first: np.ndarray, second: np.ndarray) -> float:
    """Return the energy of the difference of records over that of the first."""
    return float(np.sum((first - second) ** 2) / np.sum(first**2))


# Rows.


def geometry_row(seed: int, number: int) -> dict:
    """Return what one project became: elements, what is wrong, or why it was refused."""
    tables, began = tables_of(seed, number), time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        try:
            ground = project_of(tables, Path(folder)).meshed
        except PyblastError as error:
            return {"refused": str(error), "cpu_seconds": time.process_time() - began}
    cpu = time.process_time() - began
    wrong = wrong_ground(tables, ground.mesh, np.random.default_rng([seed, number, 1]))
    return {"elements": ground.reason, "wrong": wrong, "cpu_seconds": cpu}


def turned_row(seed: int, number: int, how: str) -> dict:
    """Return how far the records of a turned project differ from those of the project, turned.

    They agree where the difference at each receiver is at most the sum of the errors that both
    runs expect there.
    """
    tables, began = tables_of(seed, number), time.process_time()
    if how not in turns_of(tables):
        return {"left_out": "its free sides or its hill do not turn by 30 degrees"}
    other, matrix = turned(tables, how)
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        try:
            projects = [project_of(tables, Path(first)), project_of(other, Path(second))]
            records, others = (records_of(project) for project in projects)
        except PyblastError as error:
            return {"refused": str(error), "cpu_seconds": time.process_time() - began}
        expected = np.sum([[r.waveform for r in each.accuracy.rows] for each in projects], axis=0)
    pairs = zip(records @ matrix.T, others, strict=True)
    apart = np.sqrt([energy_of_difference(*pair) for pair in pairs])
    return {
        "elements": [project.meshed.reason for project in projects],
        "energy_of_difference": energy_of_difference(records @ matrix.T, others),
        "apart": apart.tolist(),
        "expected": expected.tolist(),
        "within": bool((apart <= expected).all()),
        "cpu_seconds": time.process_time() - began,
    }


def pair_row(seed: int, number: int) -> dict:
    """Return how hexahedra and tetrahedra differ in motion, and the errors that each states.

    Each error is the difference to a finer mesh over 1 - r^2, r being the ratio of their edges:
    what remains of an error of second order. Receivers too near to the source, as the program says
    in finding D38, are left out.
    """
    tables = tables_of_pair(seed, number)
    meshes = [
        ("hexahedra", {"frequency_hz": tables["mesh"]["frequency_hz"]}),
        ("hexahedra", {"frequency_hz": tables["mesh"]["frequency_hz"] * FINER}),
        ("tetrahedra", _tetrahedra(tables, 1.0)),
        ("tetrahedra", _tetrahedra(tables, FINER)),
    ]
    began, motions, elements = time.process_time(), [], []
    far = np.ones(len(tables["receivers"]), dtype=bool)
    for kind, mesh in meshes:
        with tempfile.TemporaryDirectory() as folder:
            try:
                project = project_of(tables, Path(folder), kind=kind, **mesh)
                motions.append(records_of(project))
            except PyblastError as error:
                return {"refused": f"{kind}: {error}", "cpu_seconds": time.process_time() - began}
        elements.append(project.meshed.reason)
        near = {each.receiver for each in near_receivers(project.model)}
        far &= np.array([receiver.name not in near for receiver in project.model.receivers])
    hexahedra, finer, tetrahedra, smaller = (motion[far] for motion in motions)

    def apart(first, second):
        return np.sqrt(energy_of_difference(finer, finer + second - first)) if far.any() else np.nan

    remains = 1.0 - FINER**-2
    errors = apart(hexahedra, finer) / remains, apart(tetrahedra, smaller) / remains
    return {
        "elements": elements[0],
        "receivers": int(far.sum()),
        "difference": float(apart(hexahedra, tetrahedra)),
        "finer_difference": float(apart(finer, smaller)),
        "hexahedra_error": float(errors[0]),
        "tetrahedra_error": float(errors[1]),
        "within": bool(apart(hexahedra, tetrahedra) <= sum(errors)),
        "cpu_seconds": time.process_time() - began,
    }


def _tetrahedra(tables, finer):
    """Return the keys of a mesh of quadratic tetrahedra for the frequency of tables."""
    top, layers = tables["mesh"]["frequency_hz"] * finer, []
    for part in tables["mesh"]["layers"]:
        edge = tables["materials"][part["material"]]["cs_m_per_s"] / (EDGES * top)
        layers.append({**part, "edge_m": edge})
    return {"layers": layers, "edge_m": layers[-1]["edge_m"], "quadratic": True}


def summary(seed: int, rows: dict) -> dict:
    """Return counts and worst differences of all rows."""
    grounds = [row for name, row in rows.items() if name.startswith("project")]
    refused = [row["refused"] for row in grounds if "refused" in row]
    reasons = {}
    for text in refused:
        kind = " ".join(word for word in text.split() if not any(c.isdigit() for c in word))[:80]
        reasons[kind] = reasons.get(kind, 0) + 1
    turned = {name: row for name, row in rows.items() if name.startswith("turned")}
    turned = {name: row for name, row in turned.items() if "within" in row}
    apart = {
        how: [row["energy_of_difference"] ** 0.5 for n, row in turned.items() if n.endswith(how)]
        for how in TURNS
    }
    pairs = [row for name, row in rows.items() if name.startswith("pair") and row.get("receivers")]
    differences = [row["difference"] for row in pairs]
    return {
        "seed": seed,
        "projects": len(grounds),
        "wrong": sum(bool(row.get("wrong")) for row in grounds),
        "refused": len(refused),
        "reasons": reasons,
        "hexahedra": sum(row.get("elements", "").startswith("hexa") for row in grounds),
        "turned": len(turned),
        "turned_within": sum(row["within"] for row in turned.values()),
        "turned_apart": {how: [float(np.median(v)), max(v)] for how, v in apart.items() if v},
        "motion_pairs": len(pairs),
        "motion_pairs_within": sum(row["within"] for row in pairs),
        "motion_pairs_difference": [float(each(differences)) for each in (np.median, max)]
        if pairs
        else None,
        "cpu_seconds_worst": max((row["cpu_seconds"] for row in grounds), default=None),
    }


def table(found: dict) -> list[str]:
    """Return the lines of the page from a summary."""
    lines = [
        f"| projects of seed {found['seed']} | {found['projects']} |",
        f"| on hexahedra | {found['hexahedra']} |",
        f"| built otherwise than asked, without a message | {found['wrong']} |",
        f"| refused | {found['refused']} |",
        f"| longest set-up, CPU s | {found['cpu_seconds_worst']:.2g} |",
    ]
    if found["turned"]:
        lines += [f"| runs compared with a turned, mirrored or moved one | {found['turned']} |",
                  "| of these within their expected errors | "
                  f"{found['turned_within']} |"]  # fmt: skip
        for how, (median, most) in found["turned_apart"].items():
            words = f"{100.0 * median:.2g} %, at most {100.0 * most:.2g} %"
            lines.append(f"| difference of records, {how}, of the amplitude | {words} |")
    if found["motion_pairs"]:
        median, most = (f"{100.0 * part:.2g} %" for part in found["motion_pairs_difference"])
        apart = f"{median}, at most {most}"
        lines += [f"| run on both hexahedra and tetrahedra | {found['motion_pairs']} |",
                  f"| of these within their stated errors | {found['motion_pairs_within']} |",
                  f"| difference between the elements, of the amplitude | {apart} |"]  # fmt: skip
    return ["| grounds | |", "|---|---|", *lines]


def paged(page: str, found: dict) -> str:
    """Return the page with the table of a summary."""
    return between(page, (BEGIN, END), table(found))


def main(arguments: list[str]) -> None:
    """Compute the rows that the file lacks."""
    seed, count, limits = draws(arguments, SEED, COUNT, MINUTES)
    print(f"ground: {count} projects of seed {seed}", flush=True)
    jobs: dict[str, tuple] = {f"project {n:03}": (geometry_row, n) for n in range(count)}
    jobs |= {f"pair {n:03}": (pair_row, n) for n in range(min(count, PAIRS))}
    jobs |= {f"turned {n:03} {how}": (turned_row, n, how) for n in range(count) for how in TURNS}

    def job(name):
        make, *rest = jobs[name]
        return make(seed, *rest)

    each_row(OUT, jobs, job, **limits)
    rows = {name: row for name, row in read_rows(OUT).items() if name in jobs}
    each_row(OUT, ["summary"], lambda _: summary(seed, rows), again=True)
    write_text(PAGE, paged(PAGE.read_text(), read_rows(OUT)["summary"]))


if __name__ == "__main__":
    main(sys.argv[1:])
