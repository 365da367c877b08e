"""What records can tell, as numbers and sentences."""

from dataclasses import asdict

import numpy as np

from .slip_words import slip_lines

KINDS = {"paper": "PPV and dominant frequency", "waveform": "waveforms"}
SHOWN = 5  # receivers in tables


def summarise_plan(plan) -> dict:
    """Return everything that pages and tables show of a `Plan`, as plain numbers and words."""
    shares, others = plan.knowledge.shares, plan.other.shares
    return {
        "by": KINDS[plan.misfit],
        "by_other": KINDS["paper" if plan.misfit == "waveform" else "waveform"],
        "band_hz": plan.window.band,
        "noise": plan.noise,
        "levels": plan.levels,
        "mesh_doubt": plan.mesh_doubt,
        "parameters": [
            {
                **asdict(one),
                "value": plan.values[k],
                "share": shares[k],
                "share_other": others[k],
                "verdict": plan.verdict(k),
                "why": plan.why.get(one.path, ""),
                "within": plan.within[k],
            }
            for k, one in enumerate(plan.parameters)
        ],
        "covariance": plan.knowledge.covariance,
        "log_determinant": plan.knowledge.log_determinant,
        "worst": plan.worst.worst,
        "worst_path": plan.worst.worst_path,
        "trade_offs": [
            {"first": first, "second": second, "correlation": rho}
            for first, second, rho in plan.trade_offs
        ],
        "receivers": [asdict(one) for one in plan.places if one.counts],
        "apart": plan.apart,
        "gridded": sum(one.gridded for one in plan.places),
        "extras": [asdict(one) for one in plan.extras],
        "slip": [
            line for name, one in plan.slip.items() for line in slip_lines(name, _slip_table(one))
        ],
    }


def _slip_table(slip):
    """Return what `slip_lines` takes of a blast."""
    strength = {name: asdict(one) for name, one in slip.strength.items()}
    factor = min((one.factor for one in slip.strength.values()), default=np.inf)
    receivers = {name: {"simulated": {"ppv": ppv.tolist()}} for name, ppv in slip.ppv.items()}
    return {"strength": strength, "factor": factor, "receivers": receivers}


def best_extras(plan):
    """Return rows of the table of extras: best receivers, all blasts, all that may be spared."""
    kinds = {
        kind: [one for one in plan["extras"] if one["kind"] == kind]
        for kind in ("receiver", "blast", "without")
    }
    more = sorted(kinds["receiver"][:SHOWN] + kinds["blast"], key=lambda one: -one["gain"])
    return more + kinds["without"]


def told_lines(plan) -> list[str]:
    """Say what trades off, what can't be told, and what would help most."""
    lines = [
        f"{one['first']} and {one['second']} trade off: the errors of both go together with a "
        f"correlation of {one['correlation']:+.2f}"
        for one in plan["trade_offs"]
    ]
    lines += [
        f"{one['path']}: not identifiable: {one['why']}" for one in plan["parameters"] if one["why"]
    ]
    more = [one for one in plan["extras"] if one["kind"] != "without"]
    if more:
        best = more[0]
        place = "a receiver at " if best["position"] is not None else "the blast "
        worst = (
            f" and leaves {best['worst']:.2f} of the worst known, {best['worst_path']}, instead of "
            f"{plan['worst']:.2f}"
            if best["worst_path"] == plan["worst_path"]
            else f"; the worst known is then {best['worst_path']} with {best['worst']:.2f}"
        )
        lines.append(
            f"most would be learnt from {place}{best['name']}: it lowers ln det of the covariance "
            f"by {best['gain']:.2g}{worst}"
        )
    if plan["extras"]:
        lines.append(
            "ln det is that of the covariance of all unknowns: where it falls by 1.4, the region "
            "in which they lie together has half its size"
        )
    if not plan["gridded"]:
        lines.append(
            "no receiver was tried but those of the project: no place of "
            "back_analysis.candidate_grid lies on the surface, outside of the rim and at least "
            f"{plan['apart']:.0f} m (half a wavelength of S) from every receiver"
        )
    if plan["mesh_doubt"]:
        lines.append(plan["mesh_doubt"])
    return lines


def beside_laboratory(one) -> str:
    """Say where a value lies against those of the laboratory."""
    if one["laboratory"] is None or one["why"]:
        return ""
    low, high = one["laboratory"]
    if one["within"][1] < low:
        return "below the laboratory"
    if one["within"][0] > high:
        return "above the laboratory"
    return "as in the laboratory" if low <= one["value"] <= high else "not told apart from it"
