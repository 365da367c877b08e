"""Stability of joints and blocks before and during a blast."""

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..blasts.peaks import LEVEL
from ..core import JOINT_LAWS
from ..mesh.mesh import zone_volumes
from ..mesh.quality import count_blocks
from ..model.model import Model
from ..solver.preparation import Prepared
from ..solver.run import Run
from ..solver.slip import HISTORY, JointObserver
from ..units import plain_number
from .level import level_error
from .places import extent_of
from .project import Project

GRAVITY = 9.81  # m/s2
MOST_BLOCKS = 10  # the heaviest
LEAST_SLIP = 1e-6  # m, below which a joint is at rest: rounding of the static stage
STILL = 1e-9  # of a force, below which it drives nothing
NAMED = 3  # joints in the sentence


class JointFace(NamedTuple):
    """Face of a block on a joint: unit normal into the block, m2, and its strength in Pa."""

    joint: str
    normal: np.ndarray
    area: float
    cohesion: float
    friction: float  # tangent


class SlidingMode(NamedTuple):
    """Way in which a block moves: mode, unit direction, and the forces along it in N."""

    mode: str
    direction: np.ndarray
    driving: float
    resisting: float

    @property
    def factor(self) -> float:
        """Factor of safety; infinite where the force presses the block into its seat."""
        return self.resisting / self.driving if self.driving > 0.0 else math.inf


class Block(NamedTuple):
    """Block that can leave through the free surface: m3, kg, centre, faces, nodes it stands on."""

    volume: float
    mass: float
    centre: np.ndarray
    planes: tuple[JointFace, ...]
    base: np.ndarray


def sliding_mode(planes: Sequence[JointFace], force) -> SlidingMode:
    """Return how a block moves under a force: it falls, slides on one face or on two, or is held.

    Parameters
    ----------
    planes : sequence of JointFace
    force : (3,) float, N
        Weight, and what else acts on the block.

    Notes
    -----
    Mode analysis of Goodman & Shi (1985), limit equilibrium of a rigid block without moments;
    theory.md (17.2).

    Examples
    --------
    >>> slope, friction = np.radians([35.0, 40.0])
    >>> up = np.array([np.sin(slope), 0.0, np.cos(slope)])
    >>> block = sliding_mode([JointFace("F1", up, 10.0, 0.0, np.tan(friction))], [0.0, 0.0, -1e6])
    >>> block.mode, round(block.factor, 3), round(float(np.tan(friction) / np.tan(slope)), 3)
    ('slides on F1', 1.198, 1.198)
    """
    force = np.asarray(force, dtype=float)
    size = float(np.linalg.norm(force))
    away = np.array([plane.normal @ force for plane in planes])
    if not len(planes) or (away > STILL * size).all():
        return SlidingMode("falls", force / size, size, 0.0)
    normals = np.array([plane.normal for plane in planes])
    along = force - away[:, None] * normals
    for k, plane in enumerate(planes):
        free = np.delete(normals, k, axis=0) @ along[k] >= -STILL * size
        if away[k] <= 0.0 and free.all():
            drive = float(np.linalg.norm(along[k]))
            resist = -away[k] * plane.friction + plane.cohesion * plane.area
            direction = along[k] / drive if drive > STILL * size else np.zeros(3)
            return SlidingMode(f"slides on {plane.joint}", direction, drive, float(resist))
    for i, k in combinations(range(len(planes)), 2):
        edge = np.cross(normals[i], normals[k])
        length = np.linalg.norm(edge)
        if length < STILL:
            continue
        direction = math.copysign(1.0, edge @ force) * edge / length
        others = np.delete(normals, [i, k], axis=0) @ direction >= -STILL
        if normals[i] @ along[k] <= 0.0 and normals[k] @ along[i] <= 0.0 and others.all():
            drive = float(direction @ force)
            pair, rest = normals[[i, k]], drive * direction - force
            reactions = np.linalg.solve(pair @ pair.T, pair @ rest)
            resist = sum(
                float(normal) * planes[n].friction + planes[n].cohesion * planes[n].area
                for normal, n in zip(reactions, (i, k), strict=True)
            )
            mode = f"slides on {planes[i].joint} and {planes[k].joint}"
            return SlidingMode(mode, direction, drive, resist)
    return SlidingMode("is held", np.zeros(3), 0.0, math.inf)


def newmark(velocity: np.ndarray, dt: float, resistance: float) -> np.ndarray:
    """Return how far a block slides on moving ground over time, (n,) m: Newmark's sliding block.

    Parameters
    ----------
    velocity : (n,) float64, m/s
        Of the ground in the direction in which the block can slide, and in that alone; linear
        between samples.
    dt : float, s
    resistance : float, m/s2
        Acceleration at which the block begins to slide.

    Notes
    -----
    Newmark (1965); exact for ground whose velocity is linear between samples. theory.md (17.3).

    Examples
    --------
    A pulse of 4 m/s2 over 0.1 s against a resistance of 1 m/s2, ``V^2/(2 a)(1 - a/A)``:

    >>> ground = -4.0 * np.minimum(1e-3 * np.arange(2000), 0.1)
    >>> round(float(newmark(ground, 1e-3, 1.0)[-1]), 6)
    0.06
    """
    slid, speed = np.zeros(len(velocity)), 0.0
    for n, change in enumerate(np.diff(velocity)):
        pace = -change / dt - resistance
        stops = speed + pace * dt <= 0.0
        lasts = dt if not stops else speed / -pace if pace < 0.0 else 0.0
        slid[n + 1] = slid[n] + speed * lasts + 0.5 * pace * lasts**2
        speed = 0.0 if stops else speed + pace * dt
    return slid


def loose_blocks(model: Model, free: tuple[str, ...] = ("top",)) -> list[Block]:
    """Return the heaviest blocks that can leave through free surfaces past their joints.

    Parameters
    ----------
    model : Model
    free : sequence of str
        Free outer surfaces, as `count_blocks`.
    """
    mesh, nodes = model.mesh, model.nodes
    if nodes.contacts is None:
        return []
    counts, label = count_blocks(mesh, free), mesh.blocks()
    weight = np.bincount(label, model.zone_values("density") * zone_volumes(mesh))
    of_node = np.empty(len(nodes.points), dtype=int)
    of_node[nodes.zone_nodes] = label[:, None]
    chosen = np.flatnonzero(counts.removable)
    chosen = chosen[np.argsort(-weight[chosen], kind="stable")][:MOST_BLOCKS]
    return [
        Block(
            float(counts.volumes[number]), float(weight[number]),
            nodes.points[of_node == number].mean(axis=0), *_seat(model, of_node == number),
        )
        for number in chosen
    ]  # fmt: skip


def _seat(model, mine):
    """Return the faces of a block on its joints, one of each plane, and the nodes beneath it."""
    contacts, vectors, base = model.nodes.contacts, {}, []
    joints = model.numbered_joints
    for side, other, sign in ((contacts.plus, contacts.minus, 1.0),
                              (contacts.minus, contacts.plus, -1.0)):  # fmt: skip
        for k in np.flatnonzero(mine[side] & ~mine[other]):
            normal = sign * contacts.normal[k]
            key = int(contacts.joint[k]), *normal.round(2).tolist()
            vectors[key] = vectors.get(key, 0.0) + contacts.area[k] * normal
            base.append(other[k])
    planes = []
    for (number, *_), vector in vectors.items():
        area, own = float(np.linalg.norm(vector)), joints[number].properties
        sticks = JOINT_LAWS[joints[number].law].sticks
        strength = (own["cohesion"], own["friction"]) if sticks else (math.inf, 0.0)
        planes.append(JointFace(joints[number].surface, vector / area, area, *strength))
    return tuple(planes), np.unique(base)


class Stability:
    """Stability of the joints and removable blocks of a project, watched while it runs.

    Parameters
    ----------
    project : Project
    prepared : Prepared
        Of its model.
    blocks : bool
        Whether its blocks are looked at: some are removable.
    """

    def __init__(self, project: Project, prepared: Prepared, blocks: bool):
        self.project = project
        free = ("top", *project.config.boundaries.free)
        self.blocks = loose_blocks(project.model, free) if blocks else []
        self.observer = JointObserver(
            project.model, prepared, project.shot.highest_frequency, box=extent_of(project),
            followed=[block.base for block in self.blocks],
        )  # fmt: skip

    def table(self, run: Run) -> dict:
        """Return the stability of joints and blocks for the summary of a run, with its sentence.

        Parameters
        ----------
        run : Run
            With this observer.
        """
        self.observer.take_end(run.state)
        joints = {
            joint.surface: self._joint(number, joint, run)
            for number, joint in enumerate(self.observer.joints)
        }
        blocks = [self._block(k, block) for k, block in enumerate(self.blocks)]
        return {"sentence": sentence(joints, blocks), "joints": joints, "blocks": blocks}

    def arrays(self) -> dict[str, dict[str, np.ndarray]]:
        """Return largest slip and opening of contacts, and the history of each joint over time.

        Rows of a history: time in s after the first firing, largest slip and opening in m, yielded
        area in m2, factor of safety.
        """
        records, times = self.observer.records, self._times()
        return {
            "contacts": {name: records[name] for name in ("largest_slip", "largest_opening")},
            "joint_histories": {
                joint.surface: np.column_stack([times, records["history"][:, number]])
                for number, joint in enumerate(self.observer.joints)
            },
        }

    def _times(self):
        """Return the times of the samples in s after the first firing."""
        every = self.observer.every * self.observer.constants["dt"]
        return every * np.arange(len(self.observer.records["history"])) - self.project.lead

    def _joint(self, number, joint, run):
        """Return slip, opening, yielded area, safety and margin of one joint."""
        observer, records = self.observer, self.observer.records
        here = (observer.number == number) & (observer.area > 0.0)
        history = dict(zip(HISTORY, records["history"][:, number].T, strict=True))
        slip, margin = records["largest_slip"] * here, records["margin"][0].copy()
        margin[~here] = np.inf
        largest, weakest = int(np.argmax(slip)), int(np.argmin(margin))
        ended = observer.moved(run.state["contact_state"])
        failed = here & observer.yielded(run.state["contact_state"])
        slips = bool(slip[largest] > LEAST_SLIP or records["largest_opening"][here].any())
        area = float(observer.area[here].sum())
        dt, lead = observer.constants["dt"], self.project.lead
        least = int(np.argmin(history["safety"]))
        return {
            "law": joint.law,
            "has_strength": JOINT_LAWS[joint.law].opens,
            "slips": slips,
            "largest_slip": float(slip[largest]),
            "slip_at": observer.positions[largest] if slips else None,
            "slip_time": float(dt * records["slip_step"][largest] - lead) if slips else None,
            "remaining_slip": float((ended[0] * here).max()),
            "largest_opening": float((records["largest_opening"] * here).max()),
            "remaining_opening": float((ended[1] * here).max()),
            "area": area,
            "yielded_area": float(observer.area[failed].sum()) if slips else 0.0,
            "safety_before": float(history["safety"][0]),
            "safety_least": float(history["safety"][least]),
            "safety_least_time": float(self._times()[least]),
            "safety_after": float(history["safety"][-1]),
            "margin": float(margin[weakest]),
            **self._certainty(observer.positions[largest if slips else weakest], margin[weakest]),
        }

    def _certainty(self, position, margin):
        """Return which level 95 % of such blasts stay below, and the share below the first slip."""
        error = level_error(self.project, position)
        if error is None:
            return {"level_by": "", "high": None, "share_below_margin": None}
        peak, law = error
        return {
            "level_by": law, "high": float(peak.level(LEVEL)),
            "share_below_margin": float(peak.share_below(max(margin, 1e-9))),
        }  # fmt: skip

    def _block(self, number, block):
        """Return safety of a block at rest and in the blast, and how far it slides by Newmark."""
        observer = self.observer
        mode = sliding_mode(block.planes, block.mass * GRAVITY * np.array([0.0, 0.0, -1.0]))
        dt = observer.every * observer.constants["dt"]
        ground = observer.records["followed"][:, number] @ mode.direction
        inertia = max(0.0, float(np.max(-np.diff(ground), initial=0.0)) / dt) * block.mass
        resistance = (mode.resisting - mode.driving) / block.mass
        slid = 0.0 if resistance > 0.0 else math.inf  # held, or gone before the blast
        if 0.0 < resistance < math.inf:
            slid = newmark(ground, dt, resistance)[-1]
        return {
            "volume": block.volume, "mass": block.mass, "centre": block.centre,
            "joints": sorted({plane.joint for plane in block.planes}), "mode": mode.mode,
            "direction": mode.direction, "safety_before": mode.factor,
            "safety_least": mode.resisting / (mode.driving + inertia)
            if mode.driving + inertia > 0.0 else math.inf,
            "slides": float(slid),
        }  # fmt: skip


def sentence(joints: dict[str, dict], blocks: Sequence[dict]) -> str:
    """Return whether joints and blocks slip, by how much, where, and with what certainty.

    Parameters
    ----------
    joints, blocks
        As `Stability.table`.
    """
    able = {name: row for name, row in joints.items() if row["has_strength"]}
    moved = sorted(able, key=lambda name: (-able[name]["largest_slip"], able[name]["margin"]))
    words = [_said_of_joint(name, able[name]) for name in moved[:NAMED]]
    if len(moved) > NAMED:
        others = [name for name in moved[NAMED:] if able[name]["slips"]]
        words.append(f"Of {len(moved) - NAMED} more joints {len(others) or 'none'} slip.")
    held = [name for name in joints if name not in able]
    if held:
        words.append(f"By their law never slip: {', '.join(held)}.")
    return " ".join([*words, *_said_of_blocks(blocks)])


def _said_of_joint(name, row):
    """Return the sentences on one joint."""
    factors = ", ".join(
        f"{plain_number(row[key])} {words}"
        for key, words in (("safety_before", "before"), ("safety_least", "at least"),
                           ("safety_after", "after"))
        if math.isfinite(row[key])
    )  # fmt: skip
    safety = f" Safety of it as a whole against sliding: {factors}." if factors else ""
    if not row["slips"]:
        return f"{name} does not slip.{safety}{_margin_words(row)}"
    x, y, z = (plain_number(value) for value in row["slip_at"])
    text = (
        f"{name} slips by up to {_mm(row['largest_slip'])} at ({x}, {y}, {z}) m, "
        f"{plain_number(1e3 * row['slip_time'])} ms after the first firing, over "
        f"{plain_number(100.0 * row['yielded_area'] / row['area'])} % of its "
        f"{plain_number(row['area'])} m2; up to {_mm(row['remaining_slip'])} remain"
    )
    if row["largest_opening"] > LEAST_SLIP:
        text += f", it opens by up to {_mm(row['largest_opening'])}"
    text += f".{safety}"
    if row["level_by"]:
        text += (
            f" That is of the median blast by {row['level_by']}: half of such blasts are stronger, "
            f"5 % by more than {plain_number(row['high'])} times."
        )
    return text


def _margin_words(row):
    """Return at which factor on the blast a joint would first slip, and for which share of them."""
    if not math.isfinite(row["margin"]):
        return ""
    if row["margin"] == 0.0:
        return " Contacts that carry nothing before the blast open in any blast."
    text = f" It would first slip in a blast {plain_number(row['margin'])} times as strong"
    if not row["level_by"]:
        return f"{text}."
    sure = row["high"] < row["margin"]
    return (
        f"{text}; {plain_number(100.0 * row['share_below_margin'])} % of such blasts by "
        f"{row['level_by']} stay below that, so it is {'' if sure else 'not '}sure at "
        f"{100.0 * LEVEL:g} %."
    )


def _said_of_blocks(blocks):
    """Return the sentence on removable blocks, the least safe one named."""
    if not blocks:
        return []
    worst = min(blocks, key=lambda row: (row["safety_least"], -row["mass"]))
    position = ", ".join(plain_number(value) for value in worst["centre"])
    least = f"{plain_number(worst['volume'])} m3 at ({position}) m {worst['mode']}"
    if not math.isfinite(worst["safety_before"]):
        return [f"The weight of each of {len(blocks)} removable blocks presses it into its seat."]
    if worst["safety_before"] <= 1.0:
        return [
            f"Of {len(blocks)} removable blocks the least safe, {least}: safety "
            f"{plain_number(worst['safety_before'])} under its weight alone, so it does not stand "
            "before the blast: the strength of its joints is too low, or something holds it."
        ]
    return [
        f"Of {len(blocks)} removable blocks the least safe, {least}: safety "
        f"{plain_number(worst['safety_before'])} under its weight, "
        f"{plain_number(worst['safety_least'])} with the largest acceleration of its seat; "
        f"it slides {_mm(worst['slides'])} (Newmark)."
    ]


def _mm(length):
    """Return a length in mm."""
    return f"{plain_number(1e3 * length)} mm"
