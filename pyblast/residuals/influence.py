"""Which blast, receiver, component or time a claim hangs on."""

import numpy as np


def influence(white, columns, precision, n_windows=8):
    """Return which share of a gain hangs on each blast, receiver, component and time window.

    Parameters
    ----------
    white : (n_blasts, n_receivers, 3, n_samples) float
        Whitened residual of the smaller model, in time.
    columns : (n_columns, n_blasts, n_receivers, 3, n_samples) float
        Whitened changes by one unit of what the larger model adds.
    precision : (n_columns, n_columns) float
        Of the prior of these units.
    n_windows : int
        Equal parts of the time.

    Returns
    -------
    gain : float
        ``b^T (A + precision)^-1 b`` with ``A = J^T J`` and ``b = J^T r``: twice the gain in log
        likelihood.
    shares : dict of str to float64 array
        ``1 - gain without it / gain`` for each ``blast``, ``receiver``, ``component``, ``channel``
        (n_receivers, 3) and ``window``; below zero where leaving it out helps. theory.md (7.27).
    """
    white, columns = np.asarray(white, dtype=float), np.asarray(columns, dtype=float)
    windows = np.array_split(np.arange(white.shape[-1]), n_windows)
    normal = np.stack(
        [np.einsum("ibrct,jbrct->ijbrc", columns[..., w], columns[..., w]) for w in windows], -1
    )
    right = np.stack([np.sum((columns * white)[..., w], axis=-1) for w in windows], -1)

    def gain(left_out=None):
        kept = np.ones(right.shape[1:]) if left_out is None else left_out
        a = np.einsum("ijbrcw,brcw->ij", normal, kept) + precision
        b = np.einsum("ibrcw,brcw->i", right, kept)
        return float(b @ np.linalg.solve(a, b))

    whole = gain()
    axes = {"blast": (0,), "receiver": (1,), "component": (2,), "channel": (1, 2), "window": (3,)}
    shares = {}
    for name, along in axes.items():
        shape = tuple(right.shape[1:][axis] for axis in along)
        shares[name] = np.empty(shape)
        for place in np.ndindex(shape):
            kept = np.ones(right.shape[1:])
            where = [slice(None)] * 4
            for axis, n in zip(along, place, strict=True):
                where[axis] = n
            kept[tuple(where)] = 0.0
            shares[name][place] = 1.0 - gain(kept) / whole if whole > 0.0 else 0.0
    return whole, shares
