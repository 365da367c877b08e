"""Survey design: Fisher information of receivers and blasts about the parameters."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..config.config import ReceiverConfig
from ..core import BATCH_SIZE
from ..errors import InputError
from ..inference.gauss_newton import DIFFERENCE
from ..inference.nuisances import DESIGN_LEVELS
from ..inference.parameter import Parameter, Problem, problem_of, set_all
from ..inference.records import LEAST_NOISE, band_functions, white_noise
from ..project.checks import carried_band
from ..project.places import on_ground
from ..project.project import Project
from ..simulation.simulation import in_batches
from ..solver.injection import near_receivers
from ..solver.slip import Slip, run_with_slip
from ..sources.inside import NEARLY
from ..survey import Survey
from ..units import plain_number
from .fit import on_mesh_of_band
from .identifiability import (
    FisherInformation,
    Sensitivities,
    is_strength,
    posterior_intervals,
    reason_without_slip,
    weakest,
)
from .parameters import (
    all_blasts,
    candidate_blasts,
    check_parameters,
    common_time_step,
    parameters_of,
    survey_records,
)
from .waveforms import (
    Window,
    mesh_errors_of,
    recorded_waveforms,
    sampled_motion,
    window_of,
)

NOISE = 5e-5  # m/s, rms of a component in the band, where nothing is known
WELL, PARTLY = 0.3, 0.8  # ratio of posterior to prior standard deviation, below
NOT_SENSITIVE = {
    "paper": "PPV and dominant frequency hardly depend on it",
    "waveform": "the motion hardly depends on it",
}


@dataclass(frozen=True)
class SurveyReceiver:
    """A receiver of the survey, or a candidate.

    Parameters
    ----------
    name : str
    position : tuple of 3 float, m
    in_survey : bool
        Whether it is recorded or planned; else it is a candidate.
    gridded : bool
        Whether it is a point of the candidate grid.
    standing : bool
        Whether it stands on the ground, whatever its height.
    """

    name: str
    position: tuple[float, float, float]
    in_survey: bool
    gridded: bool = False
    standing: bool = True

    @property
    def unplaced(self) -> list[float]:
        """Position without the height of the ground where it stands there, m."""
        return list(map(float, self.position[: 2 if self.standing else 3]))


def survey_receivers(projects, in_survey, apart) -> list[SurveyReceiver]:
    """Return the receivers of projects, those of the survey first, and a grid of candidates.

    Parameters
    ----------
    projects : sequence of Project
        The first one has the size of the grid.
    in_survey : sequence of str
        Names of the receivers of the survey.
    apart : float, m
        Smallest distance of a grid point from the receivers.
    """
    known = {r.name: r for project in projects[::-1] for r in project.receivers}
    high = {p.name for each in projects for p in each.config.receivers if len(p.position_m) == 3}
    receivers = [
        SurveyReceiver(name, at.position, name in in_survey, standing=name not in high)
        for name, at in known.items()
    ]
    receivers.sort(key=lambda receiver: not receiver.in_survey)
    positions = np.array([receiver.position for receiver in receivers])
    for point in _grid(projects[0]):
        if np.min(np.linalg.norm(positions - point, axis=1)) >= apart:
            name = f"{point[0]:.0f}, {point[1]:.0f} m"
            receivers.append(SurveyReceiver(name, tuple(point), False, True))
    return receivers


def _grid(project):
    """Return the points of the candidate grid on surface "top", outside the absorbing layer."""
    mesh = project.mesh
    if "top" not in mesh.surfaces:
        return []
    corners = mesh.points[np.unique(mesh.surfaces["top"])]
    corners = corners[~_damped(project, corners)]
    if not len(corners):
        return []
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    counts = project.config.back_analysis.candidate_grid
    axes = [low[k] + (np.arange(n) + 0.5) / n * (high[k] - low[k]) for k, n in enumerate(counts)]
    points = []
    for x in axes[0]:
        for y in axes[1]:
            try:
                point = on_ground(mesh, (float(x), float(y)))
            except InputError:  # the surface does not fill its rectangle
                continue
            points.append(point)
    return [point for point in points if not _damped(project, [point])[0]]


def without_uncertain(projects, receivers, top) -> tuple[list[SurveyReceiver], tuple[str, ...]]:
    """Return receivers without candidates at which a run does not hold, and sentences on those.

    Parameters
    ----------
    projects : sequence of Project
    receivers : sequence of SurveyReceiver
        Those of the survey stay.
    top : float, Hz
        Upper end of the band that counts.
    """
    near, low = set(), {}
    for project in projects:
        surveyed = with_receivers(project, receivers)
        near |= {row.receiver for row in near_receivers(surveyed.model) if not row.trusted}
        for row in surveyed.accuracy.rows:
            if row.carried < NEARLY * top:
                low[row.name] = min(row.carried, low.get(row.name, row.carried))
    candidates = [receiver.name for receiver in receivers if not receiver.in_survey]
    near = [name for name in candidates if name in near]
    low = {name: low[name] for name in candidates if name in low and name not in near}
    lines = []
    if near:
        lines.append(
            f"not candidates, since they stand so near a source that the mesh makes errors above "
            f"20 % (D38): {'; '.join(near)}"
        )
    if low:
        lines.append(
            f"not candidates, since the mesh carries {plain_number(min(low.values()))} Hz or more "
            f"to them, but not the {plain_number(top)} Hz of the band (D40): {'; '.join(low)}"
        )
    return [row for row in receivers if row.name not in near and row.name not in low], tuple(lines)


def _damped(project, positions):
    """Tell which positions (n, 3) lie in the absorbing layer of the elements of a project."""
    positions, layer = np.asarray(positions, dtype=float), project.absorbing_layer
    if project.mesh.layer is not None:
        return project.mesh.layer.depths(positions).max(axis=1) > 0.0
    if layer is not None:
        return layer.alpha(positions, 1.0) > 0.0
    return np.zeros(len(positions), dtype=bool)


def with_receivers(project: Project, receivers) -> Project:
    """Return a project with the receivers of a survey, further ones on its ground."""
    own = {receiver.name: receiver for receiver in project.config.receivers}
    configs = [
        own[receiver.name].model_copy(update={"recorded": None})
        if receiver.name in own
        else ReceiverConfig(name=receiver.name, position_m=receiver.unplaced)
        for receiver in receivers
    ]
    config = project.config.model_copy(update={"receivers": configs})
    shot = replace(project.shots[0], config=config, held=None)
    return replace(project, config=config, span=project.reach, survey=Survey((shot,)))


@dataclass(frozen=True)
class CandidateGain:
    """Gain of information by one more receiver or blast, or its loss without a receiver.

    Parameters
    ----------
    kind : str
        ``receiver``, ``blast``, or ``without`` for a receiver that is left out.
    name : str
    position : tuple of 3 float, m, or None
    gain : float
        Decrease of the log determinant of the posterior covariance: D-optimality.
    worst : float
        Largest ratio of posterior to prior standard deviation, of sensitive parameters.
    worst_path : str
    """

    kind: str
    name: str
    position: tuple[float, float, float] | None
    gain: float
    worst: float
    worst_path: str


def gains_of_candidates(sensitivities, parameters, receivers, blasts, candidates):
    """Return the information of the survey, its `CandidateGain`, and the sorted candidates."""
    count, fired = sum(receiver.in_survey for receiver in receivers), range(len(blasts))

    information = sensitivities.information
    survey = information(fired, range(count))

    def gain(kind, name, position, changed):
        sensitive = survey.sensitive | changed.sensitive
        ratios = np.where(sensitive, changed.ratios, 0.0)
        worst = int(np.argmax(ratios))
        path = parameters[worst].name if sensitive.any() else ""
        decrease = survey.log_determinant - changed.log_determinant
        return CandidateGain(kind, name, position, decrease, float(ratios[worst]), path)

    gains = [
        gain("receiver", receiver.name, receiver.position, information(fired, [*range(count), n]))
        for n, receiver in enumerate(receivers)
        if not receiver.in_survey
    ]
    gains += [
        gain("blast", blast.path.name, None, information([*fired, len(blasts) + n], range(count)))
        for n, blast in enumerate(candidates)
    ]
    if count > 1:
        gains += [
            gain("without", receiver.name, receiver.position,
                 information(fired, [r for r in range(count) if r != n]))
            for n, receiver in enumerate(receivers[:count])
        ]  # fmt: skip
    gains.sort(key=lambda candidate: -candidate.gain)
    return survey, gain("survey", "", None, survey), tuple(gains)


@dataclass(frozen=True, eq=False)
class SurveyDesign:
    """How well receivers and blasts constrain the parameters.

    Parameters
    ----------
    parameters : tuple of Parameter
    values : (n,) float64
        Where the sensitivities are taken, in the units of the parameters.
    misfit : str
        Data of `information`: ``paper`` or ``waveform``.
    information : FisherInformation
    other : FisherInformation
        Of the other data of the two.
    within : (n, 2) float64
        90 % intervals.
    why : dict of str to str
        Parameters that are not identifiable, and why.
    gains : tuple of CandidateGain
    worst : CandidateGain
        Of the survey as it is.
    receivers : tuple of SurveyReceiver
    apart : float, m
        Smallest distance of candidates from receivers: nearer ones share the model error.
    window : Window
    noise : str
        Source of its level.
    levels : dict of str to float
        Of the model error.
    slip : dict of str to Slip
        By blast; empty if no parameter is a strength.
    mesh_error_missing : str
        Why the mesh error is not included; empty where it is.
    uncertain : tuple of str
        Sentences on candidates and frequencies that do not count since a run does not hold there.
    holes : tuple of str
        Sentences on what would tell hole effects that the blast can't tell.
    """

    parameters: tuple[Parameter, ...]
    values: np.ndarray
    misfit: str
    information: FisherInformation
    other: FisherInformation
    within: np.ndarray
    why: dict[str, str]
    gains: tuple[CandidateGain, ...]
    worst: CandidateGain
    receivers: tuple[SurveyReceiver, ...]
    apart: float
    window: Window
    noise: str
    levels: dict[str, float]
    slip: dict[str, Slip]
    mesh_error_missing: str
    uncertain: tuple[str, ...] = ()
    holes: tuple[str, ...] = ()

    def constraint(self, number) -> str:
        """Return how well a parameter is constrained: well, partly, hardly, or not identifiable."""
        if self.parameters[number].name in self.why:
            return "not identifiable"
        return constraint_of(float(self.information.ratios[number]))

    @property
    def trade_offs(self) -> list[tuple[str, str, float]]:
        """Pairs of parameters with a strong posterior correlation, by path."""
        path = [parameter.name for parameter in self.parameters]
        return [(path[i], path[j], rho) for i, j, rho in self.information.trade_offs()]


def constraint_of(ratio: float) -> str:
    """Return how well a ratio of posterior to prior standard deviation constrains a parameter."""
    return "well" if ratio < WELL else "partly" if ratio < PARTLY else "hardly"


def survey_design_at(
    blasts, parameters, unit, *, records, candidates=(), slip=None, progress=None
) -> SurveyDesign:
    """Evaluate how well receivers and blasts constrain the parameters around a point.

    Parameters
    ----------
    blasts : sequence of Project
        The first one holds the table ``[back_analysis]``.
    parameters : tuple of Parameter
    unit : (n,) float64
        The point in the unit cube of the ranges.
    records : sequence of dict of str to Seismogram or None
        For each blast by receiver of the survey; None where a record is only planned.
    candidates : sequence of Project
        Blasts that could be fired and recorded.
    slip : dict of str to Slip, optional
        Of each blast, if known; else it is simulated.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    SurveyDesign

    Raises
    ------
    InputError
        If there is no receiver, or a project or its window is wrong.
    SolverError
        If a model can't be run.
    """
    report = progress or (lambda *_: None)
    everything = [*blasts, *candidates]
    window = window_of(everything)
    in_survey = list(dict.fromkeys(name for blast in records for name in blast))
    slowest = min(material.cs for material in blasts[0].materials.values())
    apart = 0.5 * slowest / math.sqrt(window.band[0] * window.band[1])
    receivers = survey_receivers(everything, in_survey, apart)
    receivers, uncertain = without_uncertain(everything, receivers, window.band[1])
    names = [receiver.name for receiver in receivers]
    noise, source = _noise(blasts, records, names, window)
    used = np.array([[_used(name, blast, in_survey) for name in names] for blast in records])
    used = np.concatenate([used, np.ones((len(candidates), len(names), 3), dtype=bool)])
    used = used[..., None]
    motion, changes = _changes(everything, parameters, unit, receivers, window, report)
    values = ranges_of(parameters).points(unit)
    varied = [set_all(project, parameters, values) for project in everything]
    errors, missing = mesh_errors_of(
        varied, motion, names, window,
        lambda other: with_receivers(other, receivers),
    )  # fmt: skip
    sensitivities = Sensitivities(
        motion * used, changes * used,
        band_functions(window.n_samples, window.dt, window.band), noise,
        DESIGN_LEVELS, blasts[0].config.back_analysis.misfit == "paper",
        [error * used for error in errors],
    )  # fmt: skip
    information, worst, gains = gains_of_candidates(
        sensitivities, parameters, receivers, blasts, candidates
    )
    kind = "paper" if sensitivities.peaks_only else "waveform"
    slip = _slip(blasts, parameters, values, report) if slip is None else slip
    return SurveyDesign(
        tuple(parameters), values, kind, information,
        _of_other_data(sensitivities, len(blasts), in_survey),
        _intervals(parameters, unit, information), _reasons(parameters, blasts, information, slip,
        kind), gains, worst, tuple(receivers), apart, window, source,
        {name: level for name, level in DESIGN_LEVELS.items() if errors or name != "mesh"},
        slip, missing, uncertain,
    )  # fmt: skip


def survey_design_of(project, progress=None) -> SurveyDesign:
    """Evaluate the survey of a project in the middle of the ranges.

    Raises
    ------
    InputError
        If the project has no table ``[back_analysis]``, a name in it is unknown, no receiver stands
        far enough from the sources, or the meshes carry nothing of the band.
    SolverError
        If a model can't be run.
    """
    parameters = parameters_of(project)
    blasts, candidates = all_blasts(project), candidate_blasts(project)
    for blast in (*blasts, *candidates):
        check_parameters(blast, parameters)
    if project.config.back_analysis.misfit == "waveform":
        top = window_of([*blasts, *candidates]).band[1]
        meshed = on_mesh_of_band([*blasts, *candidates], top)
        blasts, candidates = meshed[: len(blasts)], meshed[len(blasts) :]
    records = [survey_records(blast, project) for blast in blasts]
    names = sorted({name for blast in records for name in blast})
    band, less = carried_band([*blasts, *candidates], blasts[0].compared_band, names)
    if less is not None:
        blasts = tuple(blast.compared_in(band) for blast in blasts)
    middle = np.full(len(parameters), 0.5)
    plan = survey_design_at(
        blasts, parameters, middle, records=records, candidates=candidates, progress=progress
    )
    return plan if less is None else replace(plan, uncertain=(*plan.uncertain, less.text))


def ranges_of(parameters) -> Problem:
    """Return the ranges of parameters as a search problem without a misfit."""
    return problem_of(parameters, lambda points: np.zeros(len(points)))


def _used(name, records, in_survey):
    """Return the components of a receiver that count in a blast, (3,): recorded or planned."""
    if name not in in_survey:
        return np.ones(3, dtype=bool)
    if name not in records:
        return np.zeros(3, dtype=bool)
    return np.ones(3, dtype=bool) if records[name] is None else records[name].present


def _of_other_data(sensitivities, n_blasts, in_survey):
    """Return the information of peaks instead of waveforms, or the reverse."""
    other = replace(sensitivities, peaks_only=not sensitivities.peaks_only)
    return other.information(range(n_blasts), range(len(in_survey)))


def _intervals(parameters, unit, information):
    """Return the 90 % intervals in the units of the parameters, (n, 2), extended to the point."""
    ends = posterior_intervals(unit, information)
    ends = np.stack([np.minimum(ends[:, 0], unit), np.maximum(ends[:, 1], unit)], axis=-1)
    problem = ranges_of(parameters)
    return np.stack([problem.points(ends[:, 0]), problem.points(ends[:, 1])], axis=-1)


def _changes(projects, parameters, unit, receivers, window, report):
    """Return motion and its changes by whole ranges: inward differences, run in batches."""
    unit = np.asarray(unit, dtype=np.float64)
    sides = np.where(unit > 0.5, -DIFFERENCE, DIFFERENCE)
    points = ranges_of(parameters).points(np.vstack([unit, unit + np.diag(sides)]))
    total, results = len(projects) * len(points), []
    for number, project in enumerate(projects):
        surveyed = with_receivers(project, receivers)
        step = common_time_step(surveyed, parameters)
        size = BATCH_SIZE if step else 1
        motions = []
        for first in range(0, len(points), size):
            report("plan", number * len(points) + first, total)
            batch = points[first : first + size]
            motions += in_batches([set_all(surveyed, parameters, each) for each in batch], step)
        results.append(sampled_motion(motions, [receiver.name for receiver in receivers], window))
    motion = np.stack(results, axis=1)
    report("plan", total, total)
    return motion[0], (motion[1:] - motion[0]) / sides[:, None, None, None, None]


def _noise(blasts, records, names, window):
    """Return the noise of all receivers, and its source."""
    rms, band = blasts[0].config.back_analysis.noise_mm_per_s, window.band
    measured = all(
        record is not None and -record.start >= (LEAST_NOISE - 1e-6) * window.dt
        for blast in records
        for record in blast.values()
    )
    if rms is not None or not measured:
        source = "as given" if rms is not None else "assumed"
        rms = NOISE if rms is None else 1e-3 * rms
        noise = white_noise(rms, len(names), band, window.dt, window.n_samples)
        return noise, f"{1e3 * rms:g} mm/s rms in the band, {source}"
    gathered = recorded_waveforms(blasts, window)
    noise, known = gathered.noise, gathered.receivers
    level = noise.density(np.linspace(*band, 50)).sum(axis=(1, 2))
    take = [known.index(name) if name in known else int(np.argmax(level)) for name in names]
    noise = replace(
        noise,
        **{part: getattr(noise, part)[take]
           for part in ("coefficients", "variance", "correlation", "inflation")},
    )  # fmt: skip
    return noise, "of the records before the first firing; new receivers as the noisiest one"


def _slip(blasts, parameters, values, report):
    """Return the slip of joints in each blast, if a parameter is a strength."""
    if not any(is_strength(parameter) for parameter in parameters):
        return {}
    slips = {}
    for project in blasts:
        varied = set_all(project, parameters, values)
        weak = weakest(project, parameters, values)
        run, strength = run_with_slip(
            varied.model, varied.duration, varied.shot.highest_frequency, weak, report
        )
        ppv = {name: seismogram.ppv for name, seismogram in run.seismograms.items()}
        slips[project.path.name] = Slip(strength, ppv)
    return slips


def _reasons(parameters, blasts, information, slip, kind):
    """Return the parameters that are not identifiable, and why."""
    reasons, strengths = {}, [blast.strength for blast in slip.values()]
    for parameter, sensitive in zip(parameters, information.sensitive, strict=True):
        text = reason_without_slip(parameter, blasts, strengths) if slip else ""
        if text or not sensitive:
            reasons[parameter.name] = text or NOT_SENSITIVE[kind]
    return reasons
