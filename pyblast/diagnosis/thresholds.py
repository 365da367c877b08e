"""Thresholds of a diagnosis: every limit that decides, its unit and what it was measured on."""

from typing import NamedTuple

from ..inference.variation import FEWEST
from ..survey import SHORTEST_RECORD


class Threshold(NamedTuple):
    """A number that a diagnosis decides by.

    Parameters
    ----------
    name : str
    value : float
    unit : str
        Empty for a ratio or a count.
    meaning : str
    measured_on : str
        What its value rests on; ``assumed`` where nothing was measured.
    """

    name: str
    value: float
    unit: str
    meaning: str
    measured_on: str


_ROWS: list[Threshold] = []


def _enter(name, value, unit, meaning, measured_on):
    """Enter a threshold into the table and return its value."""
    _ROWS.append(Threshold(name, value, unit, meaning, measured_on))
    return value


def threshold_rows() -> tuple[Threshold, ...]:
    """Return all thresholds in the order in which a diagnosis meets them."""
    return tuple(_ROWS)


EVIDENCE = "Δ ln evidence"
SIGMA = "standard deviations"
CHI_SQUARE = "reduced chi-square"
NULLS = "nulls of the development seed of the blind benchmark: 1.2 in the median, 1.5 at most"
RIGHT = "right effects of the development seed of the blind benchmark"

# Usual errors
ENERGY_SHARE = _enter(
    "ENERGY_SHARE", 0.01, "energy of a record",
    "Usual error of each record: coordinates, clocks, small heterogeneity", NULLS,
)  # fmt: skip
MESH_SHARE = _enter(
    "MESH_SHARE", 0.28, "energy that a finer mesh changes",
    "Usual error of the finer mesh itself", "`python -m benchmarks cuts`, the median",
)  # fmt: skip
FEWEST_HOLES = _enter(
    "FEWEST_HOLES", FEWEST, "holes of a blast", "Fewest that show how much holes vary",
    "of one hole alone, twice its charge read as variation of 50 to 98 %",
)  # fmt: skip
# Records
_enter("SHORTEST_RECORD", SHORTEST_RECORD, "longest record", "No record may end earlier", "assumed")
WRONG_UNIT = _enter(
    "WRONG_UNIT", 100.0, "", "Records so many times larger or smaller than simulated are refused",
    "no missing physics does that; mm/s are 1000 times m/s",
)  # fmt: skip
CHARGE_RATIO = _enter(
    "CHARGE_RATIO", 3.0, "", "Largest over smallest charge in 8 ms, for effects that grow with it",
    "assumed",
)  # fmt: skip
SECTORS = _enter("SECTORS", 6, "", "Sectors of half a turn in which paths may lie", "assumed")
DIRECTIONS = _enter(
    "DIRECTIONS", 3, "sectors", "Sectors with a path that anisotropy needs", "assumed"
)
# Scores
LEAST_SCORE = _enter(
    "LEAST_SCORE", 10.0, EVIDENCE, "Least score of a class beside which something is missing",
    "real nulls 01 and 04 of the sites: at most 7",
)  # fmt: skip
DRAWS = _enter("DRAWS", 300, "", "Draws without an effect at the learned levels", "assumed")
DRAWN_LEVEL = _enter(
    "DRAWN_LEVEL", 0.98, "", "Quantile of the largest score of these draws", "convention: 2 %"
)
NUMERICAL = _enter(
    "NUMERICAL", 3.0, EVIDENCE, "Lead over the score of what the better mesh may leave", "assumed"
)
LEAD = _enter(
    "LEAD", 5.0, EVIDENCE, "Lead of a named effect over every other, after both were fitted",
    "a Bayes factor of 150",
)  # fmt: skip
REFIT_GAIN = _enter(
    "REFIT_GAIN", 3.0, "score", "Evidence that a fit may have; where that stays behind the best "
    "fit, an effect is not fitted", "sites 02 and 07: 1.2 to 1.5",
)  # fmt: skip
FARTHEST = _enter(
    "FARTHEST", 2.0, "simulated change", "To which a change is taken as linear in its strength",
    "assumed",
)  # fmt: skip
FAR_OFF = _enter(
    "FAR_OFF", 3.0, SIGMA, "Calibrated value beside which nothing ends as NULL",
    "priors of good surveys: 0.3 % of true values lie beyond",
)  # fmt: skip
IDEALISED = _enter(
    "IDEALISED", 0.05, "energy of a change", "Error of the law by which an effect is simulated",
    "closure of site 07, whose law differs: half a per cent of the motion of 11",
)  # fmt: skip
CARRIED = _enter(
    "CARRIED", 0.5, "highest frequency that a mesh carries",
    "Frequency below which harmonics of joints that close or slip are taken",
    "closure of a small box: 1 to 5 % off below it, as much as they are above, by meshes of 1, "
    "1.5, 2, 3 and 4 times the band and tetrahedra",
)  # fmt: skip
NOT_LINEAR = _enter(
    "NOT_LINEAR", 0.1, "evidence of a fit",
    "Score beside a fit that may be its own non-linear part", "assumed",
)  # fmt: skip
# Search
MATERIAL = _enter(
    "MATERIAL", 2.0, CHI_SQUARE, "Mean of a receiver or a blast below which nothing is missing",
    NULLS,
)  # fmt: skip
DECISIVE = _enter(
    "DECISIVE", 6.0, EVIDENCE,
    "Least gain of an effect, of another mode, or of two or three held-out subsets together",
    "a Bayes factor of 400, very strong: Kass & Raftery (1995)",
)  # fmt: skip
MOST_EXPLAINED = _enter(
    "MOST_EXPLAINED", 2.0 / 3.0, "excess",
    "Explained share from which poor candidates are not fitted, and above which what remains does "
    "not count", RIGHT,
)  # fmt: skip
MOST_EFFECTS = _enter("MOST_EFFECTS", 3, "", "Effects at once", "assumed")
DEAREST = _enter(
    "DEAREST", 0.1, "budget that is left",
    "Work of the runs of one effect above which it is not tried",
    "a soft layer of 1 m takes 12 times the reference; slivers of a site took 180 to 3,700 times",
)  # fmt: skip
ORDINARY = _enter(
    "ORDINARY", 3.0, "runs of the reference", "Price of a run that is never too dear", "assumed",
)  # fmt: skip
# Cross-validation
LEAST_LOSS = _enter(
    "LEAST_LOSS", 0.5, EVIDENCE,
    "Expected gain of a subset by the effect, below which it is not held out", "assumed",
)  # fmt: skip
GAIN_LEFT = _enter(
    "GAIN_LEFT", 0.75, "gain",
    "Share of what held-out subsets gain that must be left after what others lose", "assumed",
)  # fmt: skip
STANDARD_ERRORS = _enter(
    "STANDARD_ERRORS", 2.0, "standard errors", "Least sum of the gains of held-out subsets",
    "assumed",
)  # fmt: skip
FEW_SUBSETS = _enter(
    "FEW_SUBSETS", 3, "subsets", "Up to so many have no standard error: each must gain", "assumed"
)
CONSTRAINED = _enter(
    "CONSTRAINED", 0.5, "prior variance",
    "Posterior variance of a parameter below which the other records constrain it",
    "the closing joint of the README and two true effects of the blind benchmark",
)  # fmt: skip
# Decision
USUAL_LEVEL = _enter(
    "USUAL_LEVEL", 0.05, "energy", "Learned error above which something unknown is missing",
    "nulls of the development seed of the blind benchmark: 5 times the usual error at most",
)  # fmt: skip
LARGE = _enter(
    "LARGE", 0.3, "largest charge", "Charge of a blast of which a named effect must explain more",
    "assumed",
)  # fmt: skip
OUTLIER_LEVEL = _enter(
    "OUTLIER_LEVEL", 0.95, "", "Quantile that a receiver with an effect of its own must exceed",
    "convention: a significance level of 5 %",
)  # fmt: skip
REMAINS = _enter(
    "REMAINS", 4.0, CHI_SQUARE,
    "Mean of a receiver or a blast above which something else is missing",
    f"{RIGHT}: 0.9 to 1.9 in the worst blast, below 3 at each receiver",
)  # fmt: skip
OPEN_SET = _enter(
    "OPEN_SET", 0.3, "Δ ln evidence of sources anywhere",
    "Evidence of the best effects below which their cause is outside of the library",
    "sites 07 (named: 0.8) and 10 (a void: 0.02); drawn cases of six classes: none of the library",
)  # fmt: skip
MESH_CHANGE = _enter(
    "MESH_CHANGE", 1.0, CHI_SQUARE, "Change by a finer mesh above which an answer is corrected",
    "a blind case with a missing joint, changed by 1.4",
)  # fmt: skip
# Reported beside the answer
RESOLVED = _enter(
    "RESOLVED", 0.25, "volume of the ground",
    "Volume that holds a located residual with 90 %, above which no place is reported", "assumed",
)  # fmt: skip
FAR_FROM_PRIOR = _enter(
    "FAR_FROM_PRIOR", 2.5, SIGMA, "Calibrated value that hints at missing physics", "assumed"
)
