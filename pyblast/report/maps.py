"""Maps and grids: the plan of a run, peak velocity over its surface, files for ParaView and GIS."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.patches import Rectangle
from matplotlib.tri import Triangulation

from ..files import replacing, write_text
from ..mesh.faces import face_table, face_vectors, pair_faces, zone_of_face
from ..mesh.hexahedra import face_nodes
from ..mesh.mesh import zone_edge_lengths
from ..mesh.quality import count_blocks
from ..project.checks_ground import frequency_of_edge
from ..solver.initial_stress import yield_states
from ..units import plain_number
from . import figures

UPWARD = 0.2  # least vertical part of the normal of a face that a plan shows
MOST_CELLS = 400  # of a grid along its longer side
NO_DATA = -9999.0
LABELLED_HOLES = 60


def surface_of(model):
    """Return what a plan shows of a model: the faces of its boundary that look upward.

    Returns
    -------
    points : (n_points, 3) float64, m
        All nodes on these faces, those of hexahedra of high order too.
    triangles : (n, 3) int64
    node : (n_points,) int64
        Node of the model at each point.
    """
    zones, points = model.mesh.zones, model.nodes.points
    welded = np.unique(model.mesh.points, axis=0, return_inverse=True)[1].reshape(-1)
    single = pair_faces(welded[zones], len(model.mesh.points))[2]
    zone, local = zone_of_face(zones, np.sort(single))
    if model.mesh.hexahedral:
        quads = model.nodes.zone_nodes[zone[:, None, None], face_nodes(model.mesh.order)[local]]
        corners = [quads[:, :-1, :-1], quads[:, 1:, :-1], quads[:, 1:, 1:], quads[:, :-1, 1:]]
        corners = np.stack([part.ravel() for part in corners], axis=1)
        triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    else:
        triangles = model.nodes.zone_nodes[zone[:, None], face_table(zones)[local]]
    node, triangles = np.unique(upward(points, triangles), return_inverse=True)
    return points[node], triangles.reshape(-1, 3), node


def upward(points, triangles):
    """Return the triangles whose outward normal points upward."""
    normal = face_vectors(points, triangles)
    return triangles[normal[:, 2] > UPWARD * np.linalg.norm(normal, axis=1)]


def shown_surface(result):
    """Return points (n_points, 3) m, triangles (n, 3) and peak velocity m/s of what a plan shows.

    Without the padding of an absorbing layer; the peaks are None where the result holds none, and
    below a top that absorbs waves: that is no surface of ground.
    """
    stored, box = result.arrays["surface_peaks"], result.summary.get("undamped")
    absorbs = "viscous" in result.summary.get("boundaries", {}).get("top", "")
    points, triangles, peak = (stored[name] for name in ("points", "triangles", "velocity"))
    if box is not None:
        corners = points[triangles][:, :, :2]
        overlaps = (corners.max(axis=1) > box[0]) & (corners.min(axis=1) < box[1])
        triangles = triangles[overlaps.all(axis=1)]
    return points, triangles, peak if np.any(peak > 0.0) and not absorbs else None


def plan_figure(result):
    """Draw the plan: contours of peak velocity, holes by firing order, receivers, faults, houses.

    Returns
    -------
    str or None
        A data URI; None where no face looks upward.
    """
    (points, triangles, peak), summary = shown_surface(result), result.summary
    if not len(triangles):
        return None
    plan = Triangulation(points[:, 0], points[:, 1], triangles)
    low, high = _extent(summary.get("undamped") or points[triangles.ravel(), :2], summary)
    ratio = (high[1] - low[1]) / (high[0] - low[0])
    figure = figures._figure(9.6, float(np.clip(8.0 * ratio + 1.2, 3.2, 9.0)))
    axes = figure.subplots()
    if peak is None:
        axes.triplot(plan, color="#e5e5e5", lw=0.3)
    else:
        _draw_contours(figure, axes, plan, 1e3 * peak.astype(float), summary.get("undamped"))
    _draw_faults(axes, result, points[np.unique(triangles)])
    _draw_sources(figure, axes, summary)
    for names, mark, colour, word in (
        (summary["receivers"], "v", figures.SIMULATED, "receiver"),
        (summary.get("houses", {}), "s", "#1d4ed8", "house"),
    ):
        for number, (name, table) in enumerate(names.items()):
            position = table["position"] if isinstance(table, dict) else table
            axes.plot(
                *position[:2], mark, ms=7, color=colour, mec="white", mew=0.7,
                label=word if number == 0 else None,
            )  # fmt: skip
            axes.annotate(
                name, position[:2], (0, 7), textcoords="offset points", fontsize=8, ha="center",
                bbox={"fc": "white", "alpha": 0.75, "lw": 0, "pad": 0.6},
            )  # fmt: skip
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.set_xlabel("east [m]")
    axes.set_ylabel("north [m]")
    axes.tick_params(labelsize=8)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=5, fontsize=7, frameon=False)
    return figures._uri(figure)


def _extent(plane, summary):
    """Return the lower left and upper right corner (2,) m that hold the surface and all marks."""
    plane = np.asarray(plane, dtype=float)
    marks = [table["position"][:2] for table in summary["receivers"].values()]
    marks += [hole["collar"][:2] for hole in (summary.get("blast") or {"holes": []})["holes"]]
    size = np.ptp(plane, axis=0).max()
    near = [m for m in marks if np.all(np.abs(m - plane.mean(axis=0)) < 1.5 * size)]
    both = np.vstack([plane, *[np.reshape(m, (1, 2)) for m in near]])
    edge = 0.03 * np.ptp(both, axis=0).max()
    return both.min(axis=0) - edge, both.max(axis=0) + edge


def levels_of(peaks):
    """Return round values 1, 2, 5 that span peaks, the highest 0.2 % left out."""
    most = float(np.percentile(peaks, 99.8))
    least = max(float(peaks.min()), 1e-3 * most)
    return [
        m * 10.0**k for k in range(-9, 9) for m in (1.0, 2.0, 5.0)
        if least / 2.5 <= m * 10.0**k <= 2.5 * most
    ]  # fmt: skip


def _draw_contours(figure, axes, plan, peak, box=None):
    """Fill the surface by peak velocity in mm/s, with lines at round values."""
    levels = levels_of(peak[plan.triangles])
    drawn = np.clip(peak, levels[0] * 1.0001, levels[-1])
    filled = axes.tricontourf(
        plan, np.log10(drawn), levels=np.log10(levels), cmap="YlOrBr", extend="both"
    )
    lines = axes.tricontour(
        plan, np.log10(drawn), levels=np.log10(levels), colors="#5b4636", linewidths=0.6
    )
    words = {np.log10(level): plain_number(level) for level in levels}
    axes.clabel(lines, fmt=lambda value: words.get(value, ""), fontsize=7)
    if box is not None:  # zones that reach into the padding
        (west, south), (east, north) = box
        corner = Rectangle((west, south), east - west, north - south, transform=axes.transData)
        for drawn_part in (filled, lines):
            drawn_part.set_clip_path(corner)
    bar = figure.colorbar(
        filled, cax=axes.inset_axes((1.02, 0.0, 0.02, 1.0)), label="peak vector sum [mm/s]"
    )
    bar.set_ticks(np.log10(levels), labels=[plain_number(level) for level in levels])


def traces(result, seen):
    """Yield the traces of joints on a surface: name, whether a fault, edges (n, 2, 3) m.

    Parameters
    ----------
    result : Result
    seen : (n, 3) float64, m
        Nodes of the surface; an edge with both ends among them lies on it.
    """
    points, names = result.arrays["mesh"]["points"], result.summary["mesh_names"]
    on_surface = {tuple(p) for p in seen.tolist()}
    for name in names["joints"]:
        corners = points[result.arrays["surfaces"][name]]
        edges = corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2, 3)
        up = [tuple(a) in on_surface and tuple(b) in on_surface for a, b in edges.tolist()]
        yield name, name in names["faults"], edges[up]


def _draw_faults(axes, result, seen):
    """Draw the traces of joints and faults on the surface, faults stronger."""
    labelled = set()
    for _, fault, edges in traces(result, seen):
        colour, width, word = (
            (figures.FAULT, 1.8, "fault") if fault else (figures.INK, 0.6, "joint")
        )
        axes.add_collection(LineCollection(edges[:, :, :2], colors=colour, linewidths=width))
        if len(edges) and word not in labelled:
            axes.plot([], [], color=colour, lw=width, label=word)
            labelled.add(word)


def _draw_sources(figure, axes, summary):
    """Draw holes coloured by firing time and numbered by order, and other sources inside."""
    blast = summary.get("blast")
    if blast is not None:
        holes = blast["holes"]
        times = np.array([hole["time"] for hole in holes])
        position = np.array([hole["collar"][:2] for hole in holes])
        dots = axes.scatter(
            *position.T, c=1e3 * times, cmap="viridis", s=46 if len(holes) <= 40 else 14, zorder=4,
            edgecolors="white", linewidths=0.6, label="hole, by firing order",
        )  # fmt: skip
        order = np.unique(np.round(times, 6), return_inverse=True)[1] + 1
        for number, at in zip(order[:LABELLED_HOLES], position, strict=False):
            axes.annotate(
                str(number), at, (5, 3), textcoords="offset points", fontsize=6.5, zorder=5
            )
        if times.max() > times.min():
            beside = axes.inset_axes((1.16, 0.0, 0.02, 1.0))
            figure.colorbar(dots, cax=beside, label="fires at [ms]")
    sources = summary["sources"]
    for number, table in enumerate((*sources["forces"], *sources["tensors"])):
        label = "source" if number == 0 else None
        axes.plot(*table["position"][:2], "*", color=figures.FAULT, mec="white", ms=10, label=label)


def stereonet_figure(joints, faults):
    """Draw joint sets and faults in a stereonet: lower hemisphere, equal area.

    Parameters
    ----------
    joints : dict of str to dict
        With ``dip`` and ``dip_direction`` in degrees; those without are left out.
    faults : sequence of str
        Names that are drawn as faults.

    Returns
    -------
    str or None
        A data URI: great circles and poles; None where no joint has an orientation.
    """
    shown = {
        (name, row["dip"], row["dip_direction"], name in faults)
        for name, row in joints.items()
        if row.get("dip") is not None
    }
    if not shown:
        return None
    figure = figures._figure(5.2, 4.4)
    axes = figure.subplots()
    circle = np.linspace(0.0, 2.0 * np.pi, 181)
    axes.plot(np.sin(circle), np.cos(circle), color=figures.INK, lw=0.9)
    for degrees, letter in ((0, "N"), (90, "E"), (180, "S"), (270, "W")):
        angle = np.radians(degrees)
        axes.text(1.07 * np.sin(angle), 1.07 * np.cos(angle), letter, ha="center", va="center")
    for number, (name, dip, direction, fault) in enumerate(sorted(shown)):
        colour = figures.FAULT if fault else f"C{number}"
        axes.plot(*great_circle(dip, direction).T, color=colour, lw=1.6 if fault else 1.0)
        x, y = pole(dip, direction)
        axes.plot(x, y, "o", color=colour, ms=6, label=f"{name} {dip:02.0f}/{direction:03.0f}")
    axes.set_aspect("equal")
    axes.axis("off")
    axes.legend(loc="center left", bbox_to_anchor=(1.05, 0.5), fontsize=8, frameon=False)
    return figures._uri(figure)


def equal_area(trend, plunge):
    """Project lines downward: equal area, lower hemisphere of radius 1.

    Parameters
    ----------
    trend, plunge : (n,) float, rad
        Clockwise from north, downward.

    Returns
    -------
    (n, 2) float64
        East and north; ``sqrt(2) sin((pi/2 - plunge) / 2)`` from the centre.
    """
    away = np.sqrt(2.0) * np.sin(0.25 * np.pi - 0.5 * np.asarray(plunge))
    return np.stack([away * np.sin(trend), away * np.cos(trend)], axis=-1)


def pole(dip, direction):
    """Return the pole (2,) of a plane, dip and dip direction in degrees."""
    return equal_area(np.radians(direction + 180.0), np.radians(90.0 - dip))


def great_circle(dip, direction):
    """Return the great circle (91, 2) of a plane, dip and dip direction in degrees."""
    dip, direction = np.radians(dip), np.radians(direction)
    rake = np.linspace(0.0, np.pi, 91)
    strike = np.array([-np.cos(direction), np.sin(direction), 0.0])
    down = np.array(
        [np.cos(dip) * np.sin(direction), np.cos(dip) * np.cos(direction), -np.sin(dip)]
    )
    east, north, up = np.outer(strike, np.cos(rake)) + np.outer(down, np.sin(rake))
    return equal_area(np.arctan2(east, north), np.arcsin(np.clip(-up, -1.0, 1.0)))


def write_surface(folder, result):
    """Write peak velocity over the surface: nodes as CSV, a grid as ESRI ASCII.

    Coordinates are those of the site: what ``blast.shift_m`` added is taken off again.

    Parameters
    ----------
    folder : path
    result : Result
        One without peak velocities, or without faces that look upward, writes nothing.
    """
    points, triangles, peak = shown_surface(result)
    if peak is None or not len(triangles):
        return
    points = points - np.array(result.summary.get("shift_m") or [0.0, 0.0, 0.0])
    node = np.unique(triangles)
    rows = np.c_[points[node], 1e3 * peak[node]]
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows.tolist()]
    head = "east_m,north_m,height_m,peak_vector_sum_mm_per_s"
    write_text(Path(folder) / "surface_peaks.csv", "\n".join([head, *lines]) + "\n")
    write_text(Path(folder) / "surface_peaks.asc", ascii_grid(points, triangles, 1e3 * peak))


def ascii_grid(points, triangles, values):
    """Return values of nodes as an ESRI ASCII grid, linear within each triangle.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    triangles : (n, 3) int
        Seen from above.
    values : (n_nodes,) float
        -9999 is written outside of all triangles.

    Returns
    -------
    str
        Rows from north to south; the cell is half of the median edge, at most 400 along a side.
    """
    plane = points[:, :2].astype(float)
    low, high = plane[triangles.ravel()].min(axis=0), plane[triangles.ravel()].max(axis=0)
    edges = np.linalg.norm(plane[triangles] - plane[np.roll(triangles, 1, axis=1)], axis=2)
    cell = float(max(0.5 * np.median(edges), (high - low).max() / MOST_CELLS))
    count = np.maximum(1, np.ceil((high - low) / cell - 1e-9).astype(int))
    east, north = (low[k] + cell * (0.5 + np.arange(count[k])) for k in range(2))
    rows = _on_grid(plane[triangles], np.asarray(values, dtype=float)[triangles], east, north)[::-1]
    head = (
        f"ncols {count[0]}\nnrows {count[1]}\nxllcorner {low[0]:.9g}\nyllcorner {low[1]:.9g}\n"
        f"cellsize {cell:.9g}\nNODATA_value {NO_DATA:.0f}\n"
    )
    return head + "\n".join(" ".join(f"{v:.6g}" for v in row) for row in rows.tolist()) + "\n"


def _on_grid(corners, values, east, north):
    """Interpolate values (n, 3) of triangles (n, 3, 2) at cell centres; rows by north."""
    grid, cell = np.full((len(north), len(east)), NO_DATA), 1e-9
    for triangle, at_corners in zip(corners, values, strict=True):
        (x0, y0), (x1, y1) = triangle.min(axis=0), triangle.max(axis=0)
        columns = slice(*np.searchsorted(east, (x0 - cell, x1 + cell)))
        rows = slice(*np.searchsorted(north, (y0 - cell, y1 + cell)))
        matrix = np.vstack([triangle.T, np.ones(3)])
        if columns.start == columns.stop or rows.start == rows.stop:
            continue
        x, y = np.meshgrid(east[columns], north[rows])
        share = np.linalg.solve(matrix, np.stack([x.ravel(), y.ravel(), np.ones(x.size)]))
        inside = (share >= -1e-9).all(axis=0).reshape(x.shape)
        grid[rows, columns][inside] = (at_corners @ share).reshape(x.shape)[inside]
    return grid


def zone_fields(model):
    """Return the fields of zones (n_zones,): group, block, highest frequency carried, removable.

    A block is removable if it can leave through a side without a boundary (`count_blocks`).
    """
    mesh, held = model.mesh, {boundary.surface for boundary in model.boundaries}
    block = mesh.blocks().astype(np.int32)
    free = tuple(name for name in mesh.surfaces if name not in held)
    edge = zone_edge_lengths(mesh).mean(axis=1)
    carried = frequency_of_edge(model.zone_values("cs"), edge, model.edges_per_wavelength)
    thin = np.array([model.thin_layers.get(name, 0.0) for name in mesh.groups])
    return {
        "group": mesh.zone_group.astype(np.int32),
        "block": block,
        "removable": count_blocks(mesh, free).removable[block].astype(np.int32),
        "f_max": np.maximum(carried, thin[mesh.zone_group]),
    }


def yield_fields(run):
    """Return stress (Pa) and plastic strains of plastic zones, nan elsewhere; empty without any.

    The stress has ParaView's order xx yy zz xy yz zx.
    """
    constants = run.prepared.constants
    if constants["hex_order"]:
        return {}
    zone, stress, plastic = yield_states(constants, run.state)
    if not len(zone):
        return {}
    values = np.full((len(constants["zone_row"]), 8), np.nan)
    values[zone] = np.hstack([stress, plastic])
    return {
        "stress": values[:, [0, 1, 2, 5, 3, 4]],
        "plastic_shear": values[:, 6],
        "plastic_tension": values[:, 7],
    }


def write_zones(path, points, zones, fields, node_fields=None):
    """Write tetrahedra with values per zone and per node.

    Parameters
    ----------
    path : path
    points : (n_nodes, 3) float64, m
    zones : (n_zones, 4) int32
    fields, node_fields : dict of str to array
    """
    cells = [("tetra", zones)]
    import meshio  # slow to load

    mesh = meshio.Mesh(points, cells, node_fields or {}, {n: [v] for n, v in fields.items()})
    _write(path, mesh)


def write_joints(folder, mesh, displacement=None):
    """Write each joint as a file of its own, and ``model.vtm``, which opens them with the ground.

    Parameters
    ----------
    folder : Path
        Holds ``zones.vtu``.
    mesh : Mesh
        Split, or without joints.
    displacement : (n_nodes, 3) float64, m, optional
    """
    import meshio  # slow to load

    contacts, files = mesh.contacts, {"ground": "zones.vtu"}
    for number, name in enumerate(contacts.names if contacts is not None else ()):
        assert contacts is not None  # it names the joint
        fields, own = {}, contacts.joint == number
        minus, plus, normal = contacts.minus[own], contacts.plus[own], contacts.normal[own]
        if displacement is not None:
            jump = displacement[plus] - displacement[minus]
            across = np.sum(jump * normal, axis=1)
            along = np.linalg.norm(jump - across[:, None] * normal, axis=1)
            for title, values in (("shear offset [m]", along), ("opening [m]", across)):
                fields[title] = np.zeros(len(mesh.points))
                fields[title][minus] = fields[title][plus] = values
        files[name] = f"joint_{number + 1:02d}.vtu"
        cells = [("triangle", mesh.surfaces[name])]
        _write(Path(folder) / files[name], meshio.Mesh(mesh.points, cells, fields))
    rows = "\n".join(
        f'<DataSet index="{k}" name={quoteattr(name)} file="{file}"/>'
        for k, (name, file) in enumerate(files.items())
    )
    head = '<VTKFile type="vtkMultiBlockDataSet" version="1.0"><vtkMultiBlockDataSet>'
    text = f"{head}\n{rows}\n</vtkMultiBlockDataSet></VTKFile>\n"
    write_text(Path(folder) / "model.vtm", text)


def write_motion(folder, points, zones, snapshots):
    """Write node velocities at some instants, and a ParaView collection of them.

    Parameters
    ----------
    folder : Path
    points, zones : arrays of the mesh
    snapshots : dict of float (s) to (n_nodes, 3) float32, m/s
    """
    lines = []
    for number, (time, velocity) in enumerate(sorted(snapshots.items())):
        name = f"motion_{number:03d}.vtu"
        write_zones(Path(folder) / name, points, zones, {}, {"velocity": velocity})
        lines.append(f'<DataSet timestep="{time:.9g}" file="{name}"/>')
    if lines:
        body = "\n".join(lines)
        write_text(
            Path(folder) / "motion.pvd",
            '<VTKFile type="Collection" version="0.1"><Collection>\n'
            f"{body}\n</Collection></VTKFile>\n",
        )


def _write(path, mesh):
    """Write a mesh atomically; `ReadError` if the path can't be written."""
    with replacing(Path(path)) as beside:
        mesh.write(beside, file_format="vtu")
