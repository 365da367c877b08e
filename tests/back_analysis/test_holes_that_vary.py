"""Back-analysis of blasts whose holes vary: the level that it learns beside its other errors."""

from types import SimpleNamespace

import numpy as np
import pytest
from residual_case import DT, TIMES, residual_case

from pyblast.back_analysis.fit import ALL_LEVELS, FEW_LEVELS, Fitter
from pyblast.inference.covariance import record_blocks
from pyblast.inference.error_model import ErrorModel
from pyblast.inference.nuisances import Firings, moving_columns
from pyblast.inference.records import Records
from pyblast.inference.variation import Filters, charges_of, filtered_motion

NOISE, BAND, _ = residual_case()
HOLES, RECEIVERS = 10, 3
PLACES = np.array([[12.0 * h, 0.0, -8.0] for h in range(HOLES)])
LEVELS = ALL_LEVELS._replace(scatter=(1e-3, 1e-2, 1e-1), ground=(1.0,))


def fired(count=HOLES):
    """Return holes that fire 20 ms apart and share their path to every receiver."""
    return Firings(0.02 * np.arange(count), np.ones(count), np.zeros((RECEIVERS, count)))


def planned():
    """Return the motion of the blast, (1, n_receivers, 3, n)."""
    motion = np.zeros((1, RECEIVERS, 3, len(TIMES)))
    for start in fired().times:
        for r, c in np.ndindex(RECEIVERS, 3):
            late = TIMES - start - 0.06 - 0.02 * r
            wave = np.cos(2.0 * np.pi * (9.0 + 3.0 * c + r) * late)
            motion[0, r, c] += 1e-4 * np.exp(-0.5 * (late / 0.018) ** 2) * wave
    return motion


def learned(level, levels=LEVELS, count=HOLES, seed=1):
    """Return error and residual of a back-analysis of a blast whose holes vary by a level."""
    rng, motion = np.random.default_rng(seed), planned()
    charges = {0: charges_of(motion[0], fired(), PLACES, DT)}
    own, paths = rng.standard_normal((HOLES, 5)), rng.standard_normal((HOLES, RECEIVERS, 5))
    change = filtered_motion(charges, BAND, 1, {0: Filters(level * own, level * paths)}).change
    valid = np.ones(motion.shape, dtype=bool)
    records = Records(("a",), ("R1", "R2", "R3"), DT, motion + change, valid, BAND, NOISE)
    columns = moving_columns({}, (1, RECEIVERS, 3, BAND.n_functions))
    error = ErrorModel(record_blocks(records, motion), columns, levels)
    noise = error.draws(rng, 1, error.most_probable(0.0 * columns.columns.sum(axis=0))[0])[0]
    project = SimpleNamespace(blast=SimpleNamespace(centres=PLACES[:count]))
    fitter = SimpleNamespace(compared=records, levels=levels, blasts=[project])
    residual, state = BAND.project(change) + noise, SimpleNamespace(motion=motion)
    return Fitter._varied(fitter, error, residual, state, [fired(count)])


@pytest.mark.parametrize("level", [0.0, 0.2])
def test_the_level_of_holes_is_learned_with_the_others(level):
    error, residual = learned(level)

    assert error.most_probable(residual)[0].holes == level


def test_blasts_of_few_holes_show_no_level():
    error, residual = learned(0.2, count=4)

    assert error.levels.holes == (0.0,)
    assert error.offset == 0.0
    assert residual.shape == (1, RECEIVERS, 3, BAND.n_functions)


def test_on_its_way_a_search_is_linear_around_the_plan():
    error, _ = learned(0.2, FEW_LEVELS)

    assert error.levels.holes == FEW_LEVELS.holes
    assert not np.any(error.offset)
