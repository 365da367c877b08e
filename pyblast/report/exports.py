"""Exports of a result: features for GIS, and its motion as a picture that moves."""

import io
import json

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.tri import Triangulation
from PIL import Image

from ..errors import InputError
from ..files import write_bytes, write_text
from ..mesh.faces import faces_of_skin, zone_faces
from . import figures
from .maps import levels_of, shown_surface, traces, upward

LEAST_SPEED = 1e-3  # of the largest: lower end of the colours of a movie
FRAME_MS = 120
MOST_FRAMES = 150
MOST_BYTES = 20_000_000
QUALITY = (80, 60, 40, 20)


def write_features(path, result):
    """Write receivers, holes, traces of joints and contours of peaks as GeoJSON.

    Coordinates are those of the site in m: what ``blast.shift_m`` added is taken off again. The
    file names no reference system, since a project has none.

    Parameters
    ----------
    path : path
    result : Result
    """
    shift = np.array(result.summary.get("shift_m") or [0.0, 0.0, 0.0])

    def placed(form, places, **properties):
        where = np.round(np.asarray(places, dtype=float) - shift, 3).tolist()
        geometry = {"type": form, "coordinates": where}
        return {"type": "Feature", "geometry": geometry, "properties": properties}

    rows, summary = [], result.summary
    for name, table in summary["receivers"].items():
        peaks = {
            f"{kind}_ppv_mm_per_s": round(1e3 * max(v for v in table[kind]["ppv"] if v), 4)
            for kind in ("simulated", "recorded") if table[kind] and any(table[kind]["ppv"])
        }  # fmt: skip
        rows.append(placed("Point", table["position"], kind="receiver", name=name, **peaks))
    rows += [
        placed("LineString", [hole["collar"], hole["toe"]], kind="hole", name=hole["id"],
               charge_kg=hole["charge"], fires_at_ms=1e3 * hole["time"])
        for hole in (summary.get("blast") or {"holes": []})["holes"]
    ]  # fmt: skip
    points, triangles, peak = shown_surface(result)
    for name, fault, edges in traces(result, points[np.unique(triangles)]):
        if len(edges):
            kind = "fault" if fault else "joint"
            rows.append(placed("MultiLineString", edges, kind=kind, name=name))
    if peak is not None:
        rows += _contours(points, triangles, 1e3 * peak.astype(float), shift)
    collection = {"type": "FeatureCollection", "name": summary["title"], "features": rows}
    write_text(path, json.dumps(collection) + "\n")


def _contours(points, triangles, peak, shift):
    """Return contours of the peak vector sum as features, in plan."""
    levels = levels_of(peak[triangles])
    plan = Triangulation(points[:, 0] - shift[0], points[:, 1] - shift[1], triangles)
    drawn = figures._figure(1, 1).subplots().tricontour(plan, peak, levels=levels)
    rows = []
    for level, parts in zip(drawn.levels, drawn.allsegs, strict=True):
        lines = [np.round(part, 3).tolist() for part in parts if len(part) > 1]
        if lines:
            rows.append({
                "type": "Feature",
                "geometry": {"type": "MultiLineString", "coordinates": lines},
                "properties": {"kind": "contour", "peak_vector_sum_mm_per_s": float(level)},
            })  # fmt: skip
    return rows


def write_movie(path, result, progress=None):
    """Write the snapshots of a run as slow motion, an animated WebP of at most 20 MB.

    Above the plan, below a section through its middle: speed in colours that stay, holes that
    have fired, the time.

    Parameters
    ----------
    path : path
    result : Result
    progress : callable, optional
        Called with (stage, done, total).

    Raises
    ------
    InputError
        If the result holds fewer than two snapshots.
    """
    snapshots = sorted(result.arrays.get("snapshots", {}).items(), key=lambda row: float(row[0]))
    if len(snapshots) < 2:
        raise InputError(
            "run.snapshots_s: a movie needs the times of two snapshots or more, such as "
            "snapshots_s = [0.00, 0.01, 0.02]; add them and run again"
        )
    snapshots = snapshots[:: -(-len(snapshots) // MOST_FRAMES)]
    draw, frames = _stage(result), []
    speed = {time: 1e3 * np.linalg.norm(v, axis=1) for time, v in snapshots}
    most = max(float(each.max()) for each in speed.values()) or 1.0
    least = LEAST_SPEED * most
    norm = LogNorm(least, most)
    for number, (time, values) in enumerate(speed.items()):
        if progress is not None:
            progress("movie", number, len(speed))
        frames.append(draw(float(time), np.maximum(values, least), norm))
    for quality in QUALITY:
        stream = io.BytesIO()
        frames[0].save(stream, "WEBP", save_all=True, append_images=frames[1:],
                       duration=FRAME_MS, loop=0, quality=quality)  # fmt: skip
        if len(stream.getvalue()) <= MOST_BYTES:
            break
    write_bytes(path, stream.getvalue())


def _stage(result):
    """Return a function that draws one frame: time in s, speed of the nodes in mm/s, its norm."""
    mesh, summary = result.arrays["mesh"], result.summary
    points, zones = mesh["points"], mesh["zones"]
    welded = np.unique(points, axis=0, return_inverse=True)[1].reshape(-1)[zones]
    zone = np.arange(len(zones))
    outer = faces_of_skin(welded, zone // (len(zones) // summary["model"]["zones"]), zone)
    top = upward(points, zone_faces(zones)[outer])
    box = np.array(summary.get("extent") or np.stack([points.min(0), points.max(0)], axis=1))
    north = float(box[1].mean())
    polygons, zone = figures.section_of_zones(points, zones, north)
    holes = (summary.get("blast") or {"holes": []})["holes"]
    edges = [part for *_, part in traces(result, points[np.unique(top)])]

    def draw(time, speed, norm):
        figure = figures._figure(8.0, 8.0)
        plan, section = figure.subplots(2, 1, height_ratios=[1.6, 1.0])
        where = Triangulation(points[:, 0], points[:, 1], top)
        drawn = plan.tripcolor(where, speed, norm=norm, cmap="magma_r", shading="gouraud")
        cut = PolyCollection(polygons, array=speed[zones[zone]].mean(axis=1), norm=norm,
                             cmap="magma_r")  # fmt: skip
        section.add_collection(cut)
        for part in edges:
            plan.add_collection(LineCollection(part[..., :2], colors=figures.FAULT, linewidths=1.5))
        for fired, colour in ((True, figures.FAULT), (False, "white")):
            at = [hole["collar"][:2] for hole in holes if (hole["time"] <= time) == fired]
            plan.plot(*np.reshape(at, (-1, 2)).T, "o", color=colour, mec="black", ms=5)
        for axis, upright, words in ((plan, 1, "north [m]"), (section, 2, "height [m]")):
            axis.set(xlim=box[0], ylim=box[upright], aspect="equal", ylabel=words)
        section.set_xlabel(f"east [m]; section at north {north:g} m")
        plan.set_title(f"{1e3 * time:.1f} ms", loc="left")
        figure.colorbar(drawn, ax=[plan, section], label="speed [mm/s]", shrink=0.6)
        stream = io.BytesIO()
        figure.savefig(stream, format="png")
        return Image.open(stream).convert("RGB")

    return draw
