"""View: surfaces, planes, holes and receivers of a model, thinned for a page.

A scene is plain text and numbers: places are 16-bit integers of a common step, values of 16 bits
between the ends of their field. The script view.js draws it with three.js, which every page holds:
without a network, and without a graphics card where the browser emulates one.
"""

import base64
import math
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..diagnosis.thresholds import MATERIAL
from ..files import plain
from ..mesh.faces import face_vectors, faces_of_skin, zone_faces
from ..model.boundary import kinds_of
from ..model.model import Model
from ..model.source import MomentTensor, PointForce
from ..project.checks import Check
from ..project.places import blast_table, extent_of
from ..project.project import Project
from ..project.result import Result
from ..units import plain_number
from .maps import UPWARD, shown_surface, zone_fields
from .pages import page

MOST_BYTES = 1_300_000  # of a page: with 0.6 MB of three.js it grows by 2 MB at most
STEPS = 32_000  # of the longest side of the box
LEVELS = 65_534  # of a field; 0 is no value
STEEP = 0.5  # largest vertical part of the normal of a wall
WALL = 0.02  # of the area of the ground, from which its steep faces are a wall
LEAST_SHOWN = 1e-3  # of the largest value: lower end of logarithmic colours
MOST_FRAMES = 30


class Given(NamedTuple):
    """What a view takes of a project, a model or a result."""

    title: str
    points: np.ndarray  # (n_nodes, 3), m
    zones: np.ndarray  # (n_zones, 4)
    fields: dict[str, np.ndarray]  # of zones: group, block, f_max
    groups: tuple[str, ...]
    surfaces: dict[str, np.ndarray]  # joints: triangles of each
    faults: tuple[str, ...]
    box: np.ndarray | None  # (3, 2), m: what is left out lies outside
    holes: list[dict]  # id, collar, toe, charge, time
    receivers: dict[str, dict]  # position, rows of (quantity, value), share of a limit in %
    sides: dict[str, str]  # what holds each, in words
    sources: list  # positions of forces and moment tensors
    peaks: tuple | None  # points, triangles, velocity of the surface
    jumps: tuple | None  # places, jumps of displacement, normals of contacts
    frames: dict[str, np.ndarray]  # speed of nodes by time
    pieces: int  # tetrahedra that a zone of the model is shown as


def scene(shown: Project | Model | Result) -> dict:
    """Return what a view shows of a project, a model or the result of a run, thinned for a page.

    Parameters
    ----------
    shown : Project, Model or Result
        A project is meshed if it is not yet.

    Returns
    -------
    dict
        Plain numbers and text; `view_of` puts them into a page.

    Examples
    --------
    >>> from pyblast.mesh.builder import structured_box
    >>> from pyblast.model.material import Material
    >>> rock = Material.from_speeds(2700.0, 5000.0, 3000.0)
    >>> drawn = scene(Model(structured_box((2, 2, 2), (40.0, 40.0, 40.0)), {"rock": rock}))
    >>> drawn["parts"][0]["name"], drawn["triangles"]
    ('ground', 48)
    """
    given = _of_result(shown) if isinstance(shown, Result) else _of_model(shown)
    ground = _ground(given)
    parts = [ground, *(_joint(given, name) for name in given.surfaces)]
    parts = [part for part in parts if len(part["triangles"])]
    whole = sum(len(part["triangles"]) for part in parts)
    cell = _thin(parts)
    corners = np.concatenate([part["points"] for part in parts])
    low, size = corners.min(axis=0), float(np.ptp(corners, axis=0).max()) or 1.0
    fields, count = _fields(parts, given), sum(len(part["triangles"]) for part in parts)
    said = f"{count} triangles"
    if cell:
        said += f" of {whole}: what is smaller than {plain_number(cell, 2)} m is not shown"
    return plain({
        "title": given.title, "low": low, "step": size / STEPS, "triangles": count, "said": said,
        "box": given.box, "groups": given.groups, "fields": fields, "wall": _wall(ground),
        "parts": [_packed(part, fields, low, size / STEPS) for part in parts],
        "sides": given.sides, "holes": given.holes, "sources": given.sources,
        "receivers": given.receivers, "times": [float(time) for time in given.frames],
        "located": [],
    })  # fmt: skip


def with_diagnosis(shown: dict, misfits: dict, planes: dict, located: list) -> dict:
    """Return a scene with the answer of a diagnosis: misfits, planes of effects, located residuals.

    Parameters
    ----------
    shown : dict
        Of `scene`.
    misfits : dict of str to float
        Mean chi-square of receivers; colours reach `MATERIAL` at least.
    planes : dict of str to list of (n, 3) float64, m
        Outlines of the faults with effects; where the scene holds one of that name, it is marked.
    located : list of dict
        ``x``, ``y``, ``z`` and ``within_m`` of located residuals.

    Returns
    -------
    dict
    """
    field = _field("misfit", np.array([*misfits.values(), MATERIAL]))
    parts = [part | {"kind": "named"} if part["name"] in planes else part
             for part in shown["parts"]]  # fmt: skip
    for name in planes.keys() - {part["name"] for part in parts}:
        parts.append(_packed(_outlined(name, planes[name]), {}, shown["low"], shown["step"]))
    receivers = {
        name: row | {"values": row["values"] | {"misfit": misfits[name]} if name in misfits else {}}
        for name, row in shown["receivers"].items()
    }  # fmt: skip
    return plain(shown | {
        "parts": parts, "receivers": receivers, "located": located,
        "fields": {"misfit": field} | shown["fields"],
    })  # fmt: skip


def _outlined(name, polygons):
    """Return the plane of an effect of a diagnosis as a part, of outlines of convex polygons."""
    first = np.cumsum([0, *map(len, polygons)])
    fans = [
        (n, n + k, n + k + 1)
        for n, polygon in zip(first, polygons, strict=False) for k in range(1, len(polygon) - 1)
    ]  # fmt: skip
    return _plane(name, "named", np.concatenate(polygons), np.array(fans))


def _of_model(shown):
    """Return what a view takes of a project or a model."""
    project = shown if isinstance(shown, Project) else None
    model = shown.model if isinstance(shown, Project) else shown
    view = model.shown
    joints = [joint.surface for joint in model.joints]
    holes = [] if project is None else [
        {**hole, "blast": shot.name}
        for shot in project.shots if shot.blast for hole in blast_table(shot.blast)["holes"]
    ]  # fmt: skip
    return Given(
        "Model" if project is None else project.title,
        view.mesh.points, view.mesh.zones,
        {name: values[view.zone] for name, values in zone_fields(model).items()},
        model.mesh.groups, {name: view.mesh.surfaces[name] for name in joints},
        tuple(joints if project is None else project.faults),
        None if project is None else extent_of(project), _said_of_holes(holes),
        {receiver.name: {"position": receiver.position, "rows": [], "values": {}}
         for receiver in model.receivers},
        kinds_of(model.boundaries),
        [list(source.position) for source in model.sources
         if isinstance(source, (PointForce, MomentTensor))],
        None, None, {}, len(view.mesh.zones) // len(model.mesh.zones),
    )  # fmt: skip


def _of_result(result):
    """Return what a view takes of a result."""
    summary, arrays = result.summary, result.arrays
    mesh, contacts, box = arrays["mesh"], arrays.get("contacts", {}), summary.get("extent")
    jumps = None
    if "place" in contacts:
        moved = arrays["state"]["displacement"]
        jump = moved[contacts["plus"]] - moved[contacts["minus"]]
        jumps = contacts["place"], jump, contacts["normal"]
    frames = sorted(arrays.get("snapshots", {}).items(), key=lambda row: float(row[0]))
    frames = frames[:: -(-len(frames) // MOST_FRAMES) or 1]
    names, zones = summary["mesh_names"], arrays["zones"]
    return Given(
        summary["title"], mesh["points"], mesh["zones"],
        {name: values for name, values in zones.items() if values.ndim == 1},
        tuple(names["groups"]),
        {name: arrays["surfaces"][name] for name in names["joints"]}, tuple(names["faults"]),
        None if box is None else np.array(box),
        _said_of_holes((summary.get("blast") or {"holes": []})["holes"]),
        {name: _receiver(summary, name) for name in summary["receivers"]},
        summary.get("boundaries", {}),
        [each["position"] for kind in ("forces", "tensors") for each in summary["sources"][kind]],
        shown_surface(result), jumps,
        {time: np.linalg.norm(velocity, axis=1) for time, velocity in frames},
        len(mesh["zones"]) // summary["model"]["zones"],
    )  # fmt: skip


def _said_of_holes(holes):
    """Return holes with their order of firing and their numbers in words."""
    times = sorted({round(hole["time"], 6) for hole in holes})
    return [
        {
            "name": hole["id"], "collar": list(hole["collar"]), "toe": list(hole["toe"]),
            "column": hole.get("column", [hole["collar"], hole["toe"]]),
            "order": times.index(round(hole["time"], 6)) + 1,
            "late": times.index(round(hole["time"], 6)) / max(1, len(times) - 1),
            "rows": [
                *([("blast", hole["blast"])] if hole.get("blast") else []),
                ("fires at", f"{plain_number(1e3 * hole['time'])} ms"),
                ("charge", "not given" if hole["charge"] is None or math.isnan(hole["charge"])
                 else f"{plain_number(hole['charge'])} kg"),
            ],
        }
        for hole in holes
    ]  # fmt: skip


def _receiver(summary, name):
    """Return position, rows and state of a receiver of a result."""
    table = summary["receivers"][name]
    rows = [
        (f"{kind} {component}", f"{plain_number(1e3 * ppv)} mm/s")
        for kind in ("recorded", "simulated") if table[kind]
        for component, ppv in zip(table[kind]["components"], table[kind]["ppv"], strict=True)
        if ppv is not None
    ]  # fmt: skip
    limits = (summary.get("compliance") or {"rows": []})["rows"]
    shares = [row["share"] for row in limits if row["receiver"] == name and row["share"]]
    if shares:
        rows.append(("share of its limit", f"{plain_number(100.0 * max(shares))} %"))
    return {"position": list(table["position"]), "rows": rows, "azimuth": table["azimuth"],
            "values": {"share": 100.0 * max(shares)} if shares else {},
            "over": max(shares, default=0.0) > 1.0}  # fmt: skip


def _ground(given):
    """Return the ground: the outward triangles of each material, with values of their zones."""
    points, zones = given.points, given.zones
    inside = np.arange(len(zones))
    if given.box is not None:
        inside = np.flatnonzero(_touches(given.box, points[zones]))
    welded = np.unique(points, axis=0, return_inverse=True)[1].reshape(-1)[zones]
    body = np.arange(len(zones)) // given.pieces
    face = np.concatenate([
        faces_of_skin(welded, body, inside[given.fields["group"][inside] == group])
        for group in range(len(given.groups))
    ])  # fmt: skip
    triangles = zone_faces(zones)[face]
    values = {name: field[face // 4] for name, field in given.fields.items()}
    part = {"name": "ground", "kind": "ground", "points": points, "triangles": triangles,
            "of_triangle": values, "of_point": {}}  # fmt: skip
    if given.peaks is not None and given.peaks[2] is not None:
        normal = face_vectors(points, triangles)
        up = normal[:, 2] > UPWARD * np.linalg.norm(normal, axis=1)
        outer = np.isin(face, faces_of_skin(welded, body, np.arange(len(zones))))
        places, fine, peak = given.peaks
        if given.box is not None:
            fine = fine[_touches(given.box[:2], places[fine][..., :2])]
        if (up & outer).any():  # not where the box ends within an absorbing layer above
            part = _with_peaks(part, up & outer, places, fine, peak)
    node = cKDTree(points).query(part["points"])[1]
    for number, speed in enumerate(given.frames.values()):
        part["of_point"][f"speed{number}"] = 1e3 * speed[node]
    return part


def _touches(box, corners):
    """Return which bodies (n, k, 2 or 3) reach into a box (2 or 3, 2) by more than rounding."""
    margin = 1e-6 * np.ptp(box)
    above = corners.max(axis=1) > box[:, 0] + margin
    return np.all(above & (corners.min(axis=1) < box[:, 1] - margin), axis=1)


def _with_peaks(part, top, points, triangles, peak):
    """Return the ground with the finer surface of a run, and its peaks, in place of its top."""
    n, middle = len(part["points"]), points[triangles].mean(axis=1)
    coarse = part["points"][part["triangles"][top]].mean(axis=1)
    below = np.flatnonzero(top)[cKDTree(coarse).query(middle)[1]]
    return part | {
        "points": np.concatenate([part["points"], points]),
        "triangles": np.concatenate([part["triangles"][~top], n + np.asarray(triangles)]),
        "of_triangle": {name: np.concatenate([values[~top], values[below]])
                        for name, values in part["of_triangle"].items()},
        "of_point": {"ppv": np.concatenate([np.full(n, np.nan), 1e3 * peak])},
    }  # fmt: skip


def _joint(given, name):
    """Return the plane of a joint within the box, with slip and opening where they are known."""
    points, triangles = given.points, given.surfaces[name]
    if given.box is not None:
        triangles = triangles[_touches(given.box, points[triangles])]
    part = _plane(name, "fault" if name in given.faults else "joint", points, triangles)
    if given.jumps is None or not len(triangles):
        return part
    places, jump, across = given.jumps
    far, near = cKDTree(places).query(points[np.unique(triangles)])
    opening = np.sum(jump * across, axis=1)
    slip = np.linalg.norm(jump - opening[:, None] * across, axis=1)
    for key, values in (("slip", slip), ("opening", opening)):
        of_point = np.full(len(points), np.nan)
        of_point[np.unique(triangles)] = np.where(far < 1e-6 * np.ptp(points), values[near], np.nan)
        part["of_point"][key] = 1e3 * of_point
    return part


def _plane(name, kind, points, triangles):
    """Return the part of a plane, with its area in m², dip and dip direction in degrees."""
    normal = face_vectors(points, triangles).sum(axis=0) if len(triangles) else np.zeros(3)
    normal = normal * (1.0 if normal[2] >= 0.0 else -1.0)
    return {
        "name": name, "kind": kind, "points": points, "triangles": triangles,
        "of_triangle": {}, "of_point": {},
        "area": float(np.linalg.norm(face_vectors(points, triangles), axis=1).sum()),
        "dip": math.degrees(math.atan2(math.hypot(normal[0], normal[1]), normal[2])),
        "direction": math.degrees(math.atan2(normal[0], normal[1])) % 360.0,
    }  # fmt: skip


def _thin(parts):
    """Thin parts in place to what a page holds; return the size in m of what is lost, 0 for none.

    Nodes of a cell of a common grid become one, with the largest of their values; triangles that
    have no corners of their own left are dropped.
    """
    for part in parts:
        _renumber(part, np.arange(len(part["points"])))
    corners = np.concatenate([part["points"] for part in parts])
    low, cell = corners.min(axis=0), 0.0
    whole = [dict(part) for part in parts]
    while sum(map(_bytes, parts)) > MOST_BYTES:
        cell = 1.2 * cell or float(np.ptp(corners, axis=0).max()) / 400.0
        for part, given in zip(parts, whole, strict=True):
            part.update(given)
            at = np.floor((part["points"] - low) / cell).astype(np.int64)
            number = np.ravel_multi_index(at.T, at.max(axis=0) + 1)
            _renumber(part, np.unique(number, return_inverse=True)[1])
    return cell


def _bytes(part):
    """Return what a part takes of a page: corners, places and values of 16 bits as base64."""
    n, triangles = len(part["points"]), len(part["triangles"])
    corners = 3 * triangles * (2 if _wide(part) else 1)
    values = (3 + len(part["of_point"])) * n + len(part["of_triangle"]) * triangles
    return 8 * (corners + values) / 3


def _wide(part):
    """Tell whether numbers of nodes need 32 bits."""
    return len(part["points"]) > 65_535


def _renumber(part, label):
    """Make nodes of one label one node, that of the middle one, and drop what is unused."""
    count = int(label.max(initial=-1)) + 1
    mean = np.stack([np.bincount(label, part["points"][:, k], count) for k in range(3)], axis=1)
    mean /= np.maximum(np.bincount(label, minlength=count), 1)[:, None]
    away = np.linalg.norm(part["points"] - mean[label], axis=1)
    order = np.lexsort([away, label])
    first = order[np.unique(label[order], return_index=True)[1]]
    triangles = label[part["triangles"]]
    own = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    node, triangles = np.unique(triangles[own], return_inverse=True)
    part["of_triangle"] = {name: values[own] for name, values in part["of_triangle"].items()}
    for name, values in part["of_point"].items():
        largest = np.full(count, np.nan)
        np.fmax.at(largest, label, values)
        part["of_point"] = part["of_point"] | {name: largest[node]}
    part["points"], part["triangles"] = part["points"][first][node], triangles.reshape(-1, 3)


FIELDS = {
    "ppv": ("peak vector sum", "mm/s", True),
    "share": ("share of a limit", "%", True),
    "misfit": ("misfit of receivers", "", True),
    "slip": ("shear offset of joints at the end", "mm", False),
    "opening": ("opening of joints at the end", "mm", False),
    "f_max": ("highest frequency carried", "Hz", True),
    "plastic_shear": ("plastic shear strain at the end", "", True),
    "plastic_tension": ("plastic tensile strain at the end", "", True),
    "speed": ("speed", "mm/s", True),
}  # fmt: skip


def _fields(parts, given):
    """Return label, unit, ends and kind of scale of each field that a part or a receiver has."""
    fields = {}
    for key in FIELDS:
        values = [
            values for part in parts
            for name, values in (part["of_point"] | part["of_triangle"]).items()
            if name.rstrip("0123456789") == key
        ]  # fmt: skip
        standing = [row["values"][key] for row in given.receivers.values() if key in row["values"]]
        known = np.concatenate([standing, *(each[np.isfinite(each)] for each in values)])
        if len(known):
            fields[key] = _field(key, known)
    return fields


def _field(key, known):
    """Return label, unit, ends and kind of scale of a field of known values."""
    label, unit, log = FIELDS[key]
    low, high = float(known.min()), float(known.max())
    if log:
        low = max(low, LEAST_SHOWN * high, 1e-300)
    return {"label": label, "unit": unit, "log": log, "low": low,
            "high": high if high > low else low + 1.0}  # fmt: skip


def _packed(part, fields, low, step):
    """Return a part as text: places, corners and values as little-endian integers in base64."""

    def levels(name, values):
        field = fields.get(name.rstrip("0123456789"))
        if field is None:  # a number of a group or block, or no value at all
            return _text(np.nan_to_num(values), "<u2")
        ends = np.array([field["low"], field["high"]])
        with np.errstate(invalid="ignore"):
            inside = np.clip(values, *ends)
        if field["log"]:
            inside, ends = np.log(inside), np.log(ends)
        share = (inside - ends[0]) / (ends[1] - ends[0])
        return _text(np.where(np.isfinite(values), 1.0 + np.round(LEVELS * share), 0.0), "<u2")

    shown = {key: part[key] for key in ("name", "kind", "dip", "direction", "area") if key in part}
    for key in ("slip", "opening", "ppv"):
        values = part["of_point"].get(key, np.zeros(0))
        if np.isfinite(values).any():
            shown[f"largest_{key}"] = float(np.nanmax(values))
    return shown | {
        "points": _text(np.round((part["points"] - low) / step), "<u2"),
        "triangles": _text(part["triangles"], "<u4" if _wide(part) else "<u2"),
        "wide": _wide(part),
        **{kind: {name: levels(name, values) for name, values in part[kind].items()}
           for kind in ("of_point", "of_triangle")},
    }  # fmt: skip


def _text(values, kind):
    """Return values as base64 of little-endian integers."""
    return base64.b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode()


def _wall(ground):
    """Return where the steep faces of the ground's top look, degrees from north; None without."""
    if "ppv" not in ground["of_point"]:
        return None
    top = np.isfinite(ground["of_point"]["ppv"])[ground["triangles"]].all(axis=1)
    normal = face_vectors(ground["points"], ground["triangles"][top])
    size = np.linalg.norm(normal, axis=1)
    steep = normal[np.abs(normal[:, 2]) < STEEP * size].sum(axis=0)
    if np.hypot(*steep[:2]) < WALL * size.sum():
        return None
    return math.degrees(math.atan2(steep[0], steep[1])) % 360.0


class ModelView:
    """View of a project, a model or a result: turns in a notebook, stands in a page.

    Parameters
    ----------
    shown : Project, Model or Result

    Examples
    --------
    >>> from pyblast.mesh.builder import structured_box
    >>> from pyblast.model.material import Material
    >>> rock = Material.from_speeds(2700.0, 5000.0, 3000.0)
    >>> ModelView(Model(structured_box((2, 2, 2), (40.0, 40.0, 40.0)), {"rock": rock}))
    <ModelView 'Model': 48 triangles>
    """

    def __init__(self, shown: Project | Model | Result):
        self.scene = scene(shown)

    @classmethod
    def of_scene(cls, shown: dict) -> "ModelView":
        """Return the view of a scene."""
        view = cls.__new__(cls)
        view.scene = shown
        return view

    def __repr__(self) -> str:
        """Return title and size."""
        return f"<ModelView {self.scene['title']!r}: {self.scene['said']}>"

    def _repr_html_(self) -> str:
        """Return the view for a notebook: a frame of its own, without network."""
        return page("view_frame.html").render(text=self.page(), title=self.scene["title"])

    def page(self, check: Check | None = None) -> str:
        """Return the view as a page of one file, below the findings of a check."""
        return page("view_page.html").render(scene=self.scene, check=check)
