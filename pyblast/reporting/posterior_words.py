"""What is told of a posterior: numbers for the result file, sentences for page and terminal."""

import numpy as np

SHOWN = 0.5  # correlations below are not told


def summarise_posterior(found, parameters):
    """Return a posterior as plain numbers, None where none was asked for.

    Parameters
    ----------
    found : Posterior or None
    parameters : sequence of Parameter
    """
    if found is None:
        return None
    intervals = [None] * len(parameters) if found.doubt else found.intervals.tolist()
    return {
        "doubt": found.doubt,
        "mesh_doubt": found.mesh_doubt,
        "seed": found.seed,
        "runs": found.runs,
        "checks": len(found.log_weights),
        "effective_checks": found.effective,
        "effective_checks_corrected": found.corrected,
        "autocorrelation_steps": found.chains.autocorrelation,
        "steps": found.chains.places.shape[1],
        "split_r_hat": found.chains.r_hat,
        "accepted": found.chains.accepted,
        "independent_draws": found.chains.independent,
        "parameters": [
            {"path": one.path, "low": one.low, "high": one.high, "log": one.log,
             "median": None if found.doubt else float(np.median(column)), "interval_90": interval}
            for one, column, interval in zip(parameters, found.samples.T, intervals, strict=True)
        ],
        "correlation": found.correlation,
        "samples": found.samples,
    }  # fmt: skip


def posterior_lines(table) -> list[str]:
    """Say what a summarised posterior tells and what it rests on; nothing without one."""
    if table is None:
        return []
    worst, slowest = (float(np.max(table[key])) for key in ("split_r_hat", "autocorrelation_steps"))
    checks = (
        f"{table['runs']} runs; the last {table['checks']} check the emulator on which the walks "
        f"went, and agree with it as well as {table['effective_checks']:.1f} that agree wholly, "
        f"after their correction {table['effective_checks_corrected']:.1f}; split R-hat "
        f"{worst:.4f}, autocorrelation {slowest:.0f} of {table['steps']} steps, seed "
        f"{table['seed']}"
    )
    doubt = [f"{table['mesh_doubt']}; it is not in the intervals"] * bool(table["mesh_doubt"])
    if table["doubt"]:
        return [f"no intervals: {table['doubt']}", checks]
    rows = table["parameters"]
    told = [
        f"{one['path']}: {one['median']:.4g}, 90 % between {one['interval_90'][0]:.4g} and "
        f"{one['interval_90'][1]:.4g}"
        for one in rows
    ]
    correlation = np.asarray(table["correlation"])
    for i, j in zip(*np.triu_indices(len(rows), 1), strict=True):
        if abs(correlation[i, j]) >= SHOWN:
            told.append(
                f"{rows[i]['path']} and {rows[j]['path']}: correlation {correlation[i, j]:+.2f}, "
                "one makes up for the other"
            )
    return [*told, *doubt, checks]
