"""Hypotheses: physics that a model may lack, with their targets and requirements."""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, fields
from importlib.resources import files
from importlib.resources.abc import Traversable
from weakref import WeakKeyDictionary

import numpy as np

from ..blasts.blast import Blast
from ..blasts.hole_effects import Pattern
from ..core import JOINT_LAWS, ZONE_LAWS
from ..errors import InputError, contained, named_error
from ..ground.tables import quality_of
from ..inference.parameter import Parameter
from .case import Case
from .forward import fields_not_kept, not_superposed, probe_offsets, probe_positions_inside
from .thresholds import CHARGE_RATIO, DIRECTIONS, SECTORS


def two_receivers(case: Case) -> str:
    """Require a second receiver, for cross-validation and the null distribution."""
    if np.count_nonzero(np.any(case.valid, axis=(0, 2, 3))) > 1:
        return ""
    return "there is one receiver, and no other to test a prediction"


def two_blasts(case: Case) -> str:
    """Require a second blast, by which an effect of a receiver is cross-validated."""
    if np.count_nonzero(np.any(case.valid, axis=(1, 2, 3))) > 1:
        return ""
    return "there is one blast, and no other to test a prediction"


def charges_apart(case: Case) -> str:
    """Require blasts of small and of large charge within 8 ms."""
    if len(case.blasts) < 2:
        return f"there is one blast: what grows with charge needs two, {CHARGE_RATIO:g} to one"
    blasts = [case.project.blasts[name] for name in case.blasts]
    if any(np.isnan(blast.charge).any() for blast in blasts):
        return "a charge is missing: what grows with charge needs all of them in kg"
    largest = [blast.charge_per_window() for blast in blasts]
    ratio = max(largest) / min(largest)
    if ratio >= CHARGE_RATIO:
        return ""
    return (
        f"the charges of the blasts are {ratio:.2g} to one: what grows with charge needs "
        f"{CHARGE_RATIO:g} to one"
    )


def three_directions(case: Case) -> str:
    """Require paths in three directions, a sixth of half a turn each."""
    positions = [r.position[:2] for r in case.project.receivers if r.name in case.receivers]
    fired = [case.project.blasts[name].centres[:, :2].mean(axis=0) for name in case.blasts]
    paths = (np.array(positions)[:, None] - np.array(fired)).reshape(-1, 2)
    azimuths = np.arctan2(paths[:, 1], paths[:, 0]) % np.pi
    directions = len(set((azimuths * SECTORS / np.pi).astype(int) % SECTORS))
    if directions >= DIRECTIONS:
        return ""
    return f"paths lie in {directions} of {SECTORS} directions, and {DIRECTIONS} are needed"


def unknown_quality(case: Case) -> str:
    """Require ground whose quality factors are not given."""
    known = quality_of(case.project.materials)
    if known is None:
        return ""
    return f"the site gives Qp {known[0]:.3g} and Qs {known[1]:.3g}, and every run has them"


def ground_without_loss(case: Case) -> str:
    """Require ground without quality factors: anisotropy with attenuation is not simulated."""
    if quality_of(case.project.materials) is None:
        return ""
    return "the site gives quality factors, and anisotropic ground with them is not simulated"


def elastic_materials(case: Case) -> str:
    """Require ground that is elastic, so that it may have another law."""
    for name in case.project.ground_materials:
        law = case.project.materials[name].law.name
        if not ZONE_LAWS[law].elastic:
            return f"material {name!r} follows the law {law!r}, and no other beside it"
    return ""


def zones_of_constant_strain(case: Case) -> str:
    """Require zones that may be of constant strain, as anisotropic ground needs them."""
    mesh = case.project.config.mesh
    if mesh.quadratic and (mesh.file is not None or mesh.grid_cells is not None):
        return (
            "anisotropic ground needs zones of constant strain, and those of mesh.file or "
            "mesh.grid_cells are too long without mesh.quadratic: describe it by mesh.layers"
        )
    return ""


def remeshable(case: Case) -> str:
    """Require ground that the project describes, so that it can be meshed with each change."""
    mesh = case.project.config.mesh
    if mesh.file is not None:
        return (
            f"the mesh is read from {mesh.file}, and its geometry can't be changed: describe the "
            "ground by mesh.layers and mesh.faults"
        )
    return ""


def holes_inside(case: Case) -> str:
    """Require holes as sources inside the model."""
    if all(shot.config.holes_inside for shot in case.project.shots):
        return ""
    return "no hole is a source inside the model: give [holes_inside] in place of [input]"


def kept_fields(case: Case) -> str:
    """Require fields of shots and receivers that can be kept."""
    return fields_not_kept(case)


def superposed(case: Case) -> str:
    """Require holes whose motions superpose, so that each can be changed."""
    return not_superposed(case)


def elastic_joints(case: Case) -> str:
    """Require an elastic joint, if there are joints."""
    laws = {joint.surface: joint.law for joint in case.project.joints}
    if not laws or any(JOINT_LAWS[law].elastic for law in laws.values()):
        return ""
    name, law = next(iter(laws.items()))
    return (
        f"no joint has the law 'elastic' ({name} has {law!r}): give the joint in question the law "
        "'elastic'"
    )


def air_over_layers(case: Case) -> str:
    """Require holes with charges, a free surface on top and a model without air blast."""
    for each in case.project.shots:
        config = each.config
        if config.air_blast is not None:
            return "the project has [air_blast], and every run has it"
        if config.blast is None or np.isnan(each.blast.charge).any():
            return "there is no [blast] with a charge for each hole"
    if "top" not in case.project.mesh.surfaces:
        return "the mesh has no surface 'top', over which air could run: name it in the mesh"
    return ""


def space_around_receivers(case: Case) -> str:
    """Require ground around a receiver, to which it may be moved."""
    if receivers_with_space(case):
        return ""
    offsets = probe_offsets(case, case.project)
    return f"no receiver has {offsets[-1]:.3g} m of ground on all sides: give a wider model"


# Requirements of cross-validation, by the axis of an effect.
TO_HOLD_OUT = {
    "receivers": (two_receivers,),
    "blasts": (two_receivers, two_blasts),
    "both": (two_receivers,),
}


def point_forces(case: Case) -> str:
    """Require shots that are point forces, without holes."""
    if all(each.config.point_forces and each.config.blast is None for each in case.project.shots):
        return ""
    return "not every shot is a point force: give [[point_forces]] in place of [blast]"


def known_source(case: Case) -> str:
    """Require point forces whose histories are known."""
    table = case.project.config.diagnosis
    if table is not None and table.source_s is not None:
        return "the source is unknown (diagnosis.source_s), and no record tells what it should be"
    return point_forces(case)


def pulse_known(case: Case) -> str:
    """Require holes whose moment rate is given, the pulse that may last longer."""
    if all(getattr(shot.inside, "moment_rate", None) is not None for shot in case.project.shots):
        return ""
    return "the pulse of a hole is not given as a moment rate (holes_inside.moment_rate_file)"


def patterns_of(case: Case) -> tuple[Pattern, ...]:
    """Return the pattern of each blast of a case, in their order; asked once a case."""
    if case not in _PATTERNS:
        _PATTERNS[case] = tuple(pattern_of(case, case.project.blasts[name]) for name in case.blasts)
    return _PATTERNS[case]


def pattern_of(case: Case, blast: Blast) -> Pattern:
    """Return the pattern of a blast at the receivers of a case, beside its charges."""
    charges = [case.project.blasts[name].charge for name in case.blasts]
    loaded = np.concatenate(charges)
    loaded = loaded[loaded > 0.0]
    places = {r.name: r.position for r in case.project.receivers}
    receivers = np.array([places[name] for name in case.receivers])
    reference = float(np.exp(np.mean(np.log(loaded)))) if len(loaded) else 1.0
    return Pattern(blast, receivers, reference)


OF_BLAST = " of blast "


def whole_site(case: Case) -> tuple[str, ...]:
    """Return the single target of effects on the whole site."""
    del case
    return ("",)


def joints(case: Case) -> tuple[str, ...]:
    """Return the names of the elastic joints."""
    return tuple(joint.surface for joint in case.project.joints if JOINT_LAWS[joint.law].elastic)


def blasts(case: Case) -> tuple[str, ...]:
    """Return the names of the blasts of the case."""
    return case.blasts


def blasts_of_many_holes(case: Case) -> tuple[str, ...]:
    """Return the names of the blasts with more than one hole."""
    return tuple(name for name in case.blasts if len(case.project.blasts[name].charge) > 1)


def holes(case: Case) -> tuple[str, ...]:
    """Return each hole of the blasts with more than one, with its blast."""
    return tuple(
        dict.fromkeys(
            f"{hole}{OF_BLAST}{name}"
            for name in blasts_of_many_holes(case)
            for hole in case.project.blasts[name].hole_ids
        )
    )


def blast_and_hole(target: str) -> tuple[str, str]:
    """Return the blast of a target, and its hole if the target is a hole."""
    hole, _, blast = target.rpartition(OF_BLAST)
    return blast, hole


def receivers(case: Case) -> tuple[str, ...]:
    """Return the names of the receivers with records."""
    return case.receivers


def receivers_with_space(case: Case) -> tuple[str, ...]:
    """Return the names of the receivers with ground on all sides."""
    offsets = probe_offsets(case, case.project)
    receivers = {r.name: r for r in case.project.receivers}
    return tuple(
        name
        for name in case.receivers
        if probe_positions_inside(case, receivers[name], offsets) is not None
    )


def receivers_with_axes(case: Case) -> tuple[str, ...]:
    """Return the names of the receivers that recorded both, east and north."""
    rotated = {r.name for r in case.project.receivers if r.azimuth is not None}
    both = np.all(np.any(case.valid, axis=(0, 3))[:, :2], axis=1)
    return tuple(
        name
        for name, two in zip(case.receivers, both.tolist(), strict=True)
        if two and name not in rotated
    )


def receivers_of_several_components(case: Case) -> tuple[str, ...]:
    """Return the names of the receivers that recorded more than one component."""
    several = case.valid.any(axis=(0, 3)).sum(axis=1) > 1
    return tuple(name for name, more in zip(case.receivers, several, strict=True) if more)


TARGETS = {"site": whole_site, "joint": joints, "blast": blasts, "receiver": receivers}


FAMILIES = ("source", "path", "receiver", "instrument")
CHANGES = ("site", "holes", "motion")
AXES = ("receivers", "blasts", "both")


@dataclass(frozen=True)
class Hypothesis:
    """Hypothesis: physics that a model may lack.

    Parameters
    ----------
    label : str
        Its name in results.
    form : str
        Distinguishes hypotheses of one label; empty if there is only one.
    claim : str
        The claim in one sentence.
    family : str
        Of `FAMILIES`.
    on : str
        What it changes, of `CHANGES`.
    target : str
        Kind of its targets, one word.
    targets : callable
        ``(case) -> tuple of str``: all targets; the search tries each.
    axis : str
        What is held out in cross-validation, of `AXES`.
    parameters : tuple of Parameter
    apply : callable
        ``(project, target, **parameters) -> Project or None`` on the site, ``(pattern, target,
        **parameters) -> HoleChange`` on holes, ``(scene, motion, target, **parameters) ->
        motion`` on motion.
    mesh_control : callable or None
        ``(project, target, **parameters) -> Project``: the mesh of the effect without the effect.
        For effects that change the mesh, so that mesh error is not mistaken for physics.
    linear : bool
        Whether the relative change is the same for small and large blasts. If not, the effect is
        screened on two blasts.
    decided_by : str
        The measurement that would distinguish it from other effects.
    needs : tuple of callable
        ``(case) -> str``: why the records cannot test it; empty if they can.
    simulated : tuple of callable
        ``(case) -> str``: why it cannot be simulated in a project, so that it has no targets there;
        empty if it can.
    odd : bool
        Whether its change of motion turns its sign, to first order, with the sign of its parameters
        of mean zero; then only one of two starting values that mirror each other may be run.
    stored : callable or None
        ``(scene) -> (values, changes)``: one value of each parameter, and the change of motion
        by them at each target, (n_targets, n_blasts, n_receivers, 3, n_functions), to first order
        and in the band, by stored fields in place of runs. It admits an effect to a fit by runs.
    single : bool
        Whether only the best target is claimed, however many would pay.
    further : tuple of (str, tuple of float)
        Further starting values of some parameters, tried where the best screened target is.
    begins : callable or None
        ``(scene) -> tuple of values``, one of each parameter: a further starting point, estimated
        from the residuals of the calibrated site.
    described : callable or None
        ``(target, **parameters) -> str``: the target at values of the parameters, if these move it.
    """

    label: str
    form: str
    claim: str
    family: str
    on: str
    target: str
    targets: Callable
    axis: str
    parameters: tuple[Parameter, ...]
    apply: Callable
    mesh_control: Callable | None = None
    linear: bool = True
    decided_by: str = ""
    needs: tuple[Callable, ...] = ()
    simulated: tuple[Callable, ...] = ()
    single: bool = False
    begins: Callable | None = None
    further: tuple[tuple[str, tuple[float, ...]], ...] = ()
    described: Callable | None = None
    odd: bool = False
    stored: Callable | None = None

    @property
    def name(self) -> str:
        """Its key in the library: the label, with its form after a slash."""
        return f"{self.label}/{self.form}" if self.form else self.label

    def untestable(self, case) -> str:
        """Return why the records of a case cannot test it; empty if they can. Asked once a case."""
        known = _REASONS.setdefault(case, {})
        if id(self) not in known:
            why: dict[str, str] = {}
            with contained(why, self.name):
                why[self.name] = self._untestable(case)
            known[id(self)] = self, why[self.name]
        return known[id(self)][1]

    def _untestable(self, case):
        """Return the first reason that applies."""
        why = next(filter(None, (need(case) for need in self.simulated)), "")
        if why:
            return why
        if not self.targets(case):
            none = f"this site has no {self.target} to which it could apply"
            return _FAILED.get(case, {}).get(self.targets, none)
        return next(filter(None, (need(case) for need in self.needs)), "")


_PATTERNS: WeakKeyDictionary = WeakKeyDictionary()  # of the blasts of a case
_REASONS: WeakKeyDictionary = WeakKeyDictionary()  # why not testable, by case and hypothesis
_FAILED: WeakKeyDictionary = WeakKeyDictionary()  # errors of lists of targets, by case and list
LIBRARY: dict[str, Hypothesis] = {}


def read_priors(path: Traversable) -> dict[str, tuple[Parameter, ...]]:
    """Return the parameters with their priors that a table holds, by the name of a hypothesis.

    Raises
    ------
    InputError
        If a key is unknown, or a prior breaks a rule of `Parameter`; with hypothesis and parameter.
    """
    keys = {each.name for each in fields(Parameter)} - {"name", "laboratory"}
    priors: dict[str, tuple[Parameter, ...]] = {}
    for name, table in tomllib.loads(path.read_text(encoding="utf-8")).items():
        for parameter, row in table.items():
            where = f"{path.name}: {name}.{parameter}"
            if foreign := row.keys() - keys:
                known = ", ".join(sorted(keys))
                raise InputError(f"{where}: unknown key {min(foreign)!r}; known are {known}")
            for key in ("mean", "sigma", "starts"):
                if key not in row:
                    raise InputError(f"{where}: {key}: missing")
            with named_error(f"{path.name}: {name}"):
                prior = Parameter(parameter, **{**row, "starts": tuple(row["starts"])})
            priors[name] = (*priors.get(name, ()), prior)
    return priors


PRIORS = read_priors(files("pyblast.diagnosis").joinpath("library", "priors.toml"))


def hypothesis(
    label, *, family, on, target, axis, parameters=None, form="", targets=None, mesh_control=None,
    linear=True, decided_by="", needs=(), simulated=(), single=False, begins=None,
    further=(), described=None, odd=False, stored=None,
):  # fmt: skip
    """Enter the decorated function into the library; arguments as of `Hypothesis`.

    The function is ``apply``, and the first sentence of its docstring the claim. ``targets`` may
    be left out for kinds of targets in `TARGETS`, ``parameters`` where ``library/priors.toml`` has
    a table of that name. Requirements of cross-validation, and of different charges if it is not
    linear, are added before its own ``needs``.

    Raises
    ------
    InputError
        If a word is not in the lists above, the name exists already, or there is no claim or no
        prior.
    """
    listed = TARGETS if targets is None else (target,)
    for word, allowed in ((family, FAMILIES), (on, CHANGES), (target, listed), (axis, AXES)):
        if word not in allowed:
            raise InputError(f"hypothesis {label}: need one of {', '.join(allowed)}, got {word!r}")
    possible = _where_simulated(targets or TARGETS[target], simulated)
    needs = (*TO_HOLD_OUT[axis], *(() if linear else (charges_apart,)), *needs)
    name = f"{label}/{form}" if form else label
    if parameters is None and name not in PRIORS:
        raise InputError(f"hypothesis {name}: give its parameters, or a table in priors.toml")
    chosen = PRIORS[name] if parameters is None else tuple(parameters)

    def enter(function):
        claim = (function.__doc__ or "").strip().split("\n\n")[0]
        entry = Hypothesis(
            label, form, " ".join(claim.split()), family, on, target, possible, axis,
            chosen, function, mesh_control, linear, decided_by, needs, simulated, single,
            begins, tuple(further), described, odd, stored,
        )  # fmt: skip
        if entry.name in LIBRARY:
            raise InputError(f"hypothesis {entry.name}: is in the library already")
        if not claim:
            raise InputError(f"hypothesis {entry.name}: needs a docstring with its claim")
        LIBRARY[entry.name] = entry
        return function

    return enter


def _where_simulated(targets, simulated):
    """Return a function that lists targets, once a case, only if an effect can be simulated.

    An error in it lists none.
    """
    listed: WeakKeyDictionary = WeakKeyDictionary()

    def possible(case):
        if case not in listed:
            listed[case] = ()
            with contained(_FAILED.setdefault(case, {}), possible):
                listed[case] = () if any(need(case) for need in simulated) else targets(case)
        return listed[case]

    return possible


def untestable_labels(case) -> dict[str, str]:
    """Return the labels that the records of a case cannot test in any form, with the reason."""
    reasons_of = {}
    for label in dict.fromkeys(hypothesis.label for hypothesis in LIBRARY.values()):
        forms = [form for form in LIBRARY.values() if form.label == label]
        reasons = [form.untestable(case) for form in forms]
        if all(reasons):
            reasons_of[label] = reasons[0]
    return reasons_of
