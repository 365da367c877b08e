"""What records must hold so that an effect can be tested: rules that need no search."""

import numpy as np

from .case import Case

APART = 3.0  # largest charge over the smallest that shows what depends on amplitude
SECTORS = 6  # of half a turn, in which paths may lie
DIRECTIONS = 3  # of them that tell waves along from waves across


def two_receivers(case: Case) -> str:
    """Ask for a second receiver: one alone can't foretell, and chance has nothing to shuffle."""
    if np.count_nonzero(np.any(case.valid, axis=(0, 2, 3))) > 1:
        return ""
    return "there is one receiver: no other that it would have to foretell"


def two_blasts(case: Case) -> str:
    """Ask for a second blast, which an effect of a receiver must foretell."""
    if np.count_nonzero(np.any(case.valid, axis=(1, 2, 3))) > 1:
        return ""
    return "there is one blast: no other that it would have to foretell"


def charges_apart(case: Case) -> str:
    """Ask for blasts of small and of large charge, by what fires within 8 ms."""
    if len(case.blasts) < 2:
        return f"there is one blast: what grows with charge needs two, {APART:g} to one"
    most = [case.site.blasts[name].charge_per_window() for name in case.blasts]
    ratio = max(most) / min(most)
    if ratio >= APART:
        return ""
    return (
        f"the charges of the blasts are {ratio:.2g} to one: what grows with charge needs "
        f"{APART:g} to one"
    )


def three_directions(case: Case) -> str:
    """Ask for paths in three directions, a sixth of half a turn each."""
    heard = [r.position[:2] for r in case.site.receivers if r.name in case.receivers]
    fired = [case.site.blasts[name].centres[:, :2].mean(axis=0) for name in case.blasts]
    ways = (np.array(heard)[:, None] - np.array(fired)).reshape(-1, 2)
    turns = np.arctan2(ways[:, 1], ways[:, 0]) % np.pi
    there = len(set((turns * SECTORS / np.pi).astype(int) % SECTORS))
    if there >= DIRECTIONS:
        return ""
    return f"paths lie in {there} of {SECTORS} directions: {DIRECTIONS} tell along from across"


def unknown_quality(case: Case) -> str:
    """Ask for ground of which nobody has said how it fades waves."""
    if case.site.quality is None:
        return ""
    p, s = case.site.quality
    return f"the site gives it, Qp {p:.3g} and Qs {s:.3g}, and every run has it"


def ground_without_loss(case: Case) -> str:
    """Ask for ground that does not fade waves: with a grain as well, it is not simulated."""
    if case.site.quality is None:
        return ""
    return "the site gives quality factors, and ground with them and a grain is not simulated"


# What must be there to hold out, by the axis of an effect.
TO_HOLD_OUT = {
    "receivers": (two_receivers,),
    "blasts": (two_receivers, two_blasts),
    "both": (two_receivers,),
}
