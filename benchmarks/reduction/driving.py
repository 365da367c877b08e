"""What drives a family of models, seen through a basis on the line of complex frequencies."""

import numpy as np

from pyblast.errors import InputError

MOST_ABOVE = 1e-3  # of the energy of what drives, above the highest frequency


def driving(constants, basis, line):
    """Return the forces of all loads on the directions of a basis, (n_frequencies, n_basis).

    Parameters
    ----------
    constants : dict
        Of a prepared model.
    basis : (3 n_nodes, n_basis) float64
    line : Line

    Raises
    ------
    InputError
        If the loads hold too much above the highest frequency.

    Notes
    -----
    Loads of one history and one delay are added up first. Delays that fall between steps are
    those of the kernel: a cubic through four samples.
    """
    vectors, delays = constants["load_vector"], constants["load_delay"]
    keys = np.stack([constants["load_history"], delays], axis=1)
    kinds, number = np.unique(keys, axis=0, return_inverse=True)
    columns = basis.reshape(-1, 3, basis.shape[1])
    pushed = np.zeros((len(kinds), basis.shape[1]))
    for kind in range(len(kinds)):
        here = np.flatnonzero(number.ravel() == kind)
        node = constants["load_node"][here]
        pushed[kind] = np.einsum("li,lir->r", vectors[here], columns[node])
    heard = line.transform(constants["history"])
    _refuse_higher(heard, line)
    heard = heard[: len(line.z), kinds[:, 0].astype(int)]
    return (heard * _delayed(line.z[:, None], kinds[:, 1])) @ pushed


def _refuse_higher(heard, line):
    """Refuse histories whose rates hold much above the highest frequency."""
    hertz = np.arange(len(heard)) / (line.n_period * line.dt)
    energy = (hertz[:, None] * np.abs(heard)) ** 2
    above = energy[hertz > line.highest].sum(axis=0)
    share = float(np.max(above / np.maximum(energy.sum(axis=0), np.finfo(float).tiny)))
    if share > MOST_ABOVE:
        raise InputError(
            f"reduced.highest: {100.0 * share:.2g} % of the energy that drives lies above "
            f"{line.highest:g} Hz; low-pass the sources or raise it"
        )


def _delayed(z, delay):
    """Return the symbol of delays in steps, as the kernel reads them."""
    whole = np.floor(delay)
    x = delay - whole
    weights = (
        -x * (1.0 - x) * (2.0 - x) / 6.0,
        (1.0 - x**2) * (2.0 - x) / 2.0,
        x * (1.0 + x) * (2.0 - x) / 2.0,
        -x * (1.0 - x**2) / 6.0,
    )
    cubic = sum(weight * z ** (1 - k) for k, weight in enumerate(weights))
    return z**-whole * np.where(x > 0.0, cubic, 1.0)
