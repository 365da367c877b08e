"""Whether a flipped polarity, a shifted clock or a wrong coordinate of one receiver is named.

Made from the Wellington line (30 hits from both ends): channel, kind and size are drawn by the
keeper. Controls: untouched hits, also by halves; each altered set corrected by what the tool said.
From one end only, clock and place must form one class. Argument: the folder.
"""

from dataclasses import replace

import numpy as np
from keeper import Sealed, folder_of_recordings, keep, wghs

from pyblast.line_records.quality import LABELS, odd_channels
from pyblast.line_records.shots import shifted

BAND, N_OF_EACH = (10.0, 60.0), 6
KNOBS = {"polarity": "factor", "clock_error": "shift", "wrong_coordinates": "move"}


def tampered(shot, kind, channel, size):
    """Alter a receiver: its sign, its clock, or its stated coordinate."""
    n = int(np.flatnonzero(shot.channels == channel)[0])
    motion, places = shot.motion.copy(), shot.places.copy()
    if kind == "polarity":
        motion[n] *= -1.0
    elif kind == "clock_error":
        motion[n] = shifted(motion[n] - motion[n].mean(), size, shot.dt)
    else:
        places[n] -= size
    return replace(shot, motion=motion, places=places)


def drawn(rng):
    """Draw kinds, channels (not the ends) and sizes."""
    for kind in LABELS:
        for _ in range(N_OF_EACH):
            size = {"polarity": -1.0, "clock_error": rng.uniform(2e-3, 20e-3),
                    "wrong_coordinates": rng.uniform(0.5, 1.4)}[kind]  # fmt: skip
            sign = 1.0 if kind == "polarity" else rng.choice([-1.0, 1.0])
            yield kind, int(rng.integers(2, 22)), float(sign * size)


def one(name, shots, kind, channel, size):
    """Alter, seal, ask, open, score."""
    sealed = Sealed(name, {"label": kind, "channel": channel, "size": size})
    said = odd_channels([tampered(shot, kind, channel, size) for shot in shots], BAND)
    sealed.answered(said)
    truth, first = sealed.opened(), said[0]
    right = len(said) == 1 and (first.outcome, first.label, first.target) == (
        "NAMED", truth["label"], (truth["channel"],)
    )  # fmt: skip
    scores = {"held_out": first.held_out}
    if right:
        value, low, high = first.parameters[KNOBS[kind]]
        scores |= {"error": value - truth["size"], "inside_90": bool(low <= truth["size"] <= high)}
    return sealed.scored(right, **scores)


def null(name, shots):
    """Ask where nothing was altered."""
    sealed = Sealed(name, {"label": None})
    said = odd_channels(shots, BAND)
    sealed.answered(said)
    return sealed.scored(said[0].outcome == "NULL")


def main():
    """Run the test and keep its rows."""
    hits, rows = wghs(folder_of_recordings()), {}
    everything = [shot for some in hits.values() for shot in some]
    rng = np.random.default_rng(2017)
    for n, (kind, channel, size) in enumerate(drawn(rng)):
        rows[f"{n + 1:02d} {kind}"] = one(f"{n + 1:02d}", everything, kind, channel, size)
    rows["untouched, all"] = null("untouched, all", everything)
    for k in range(5):
        some = [shots[k] for shots in hits.values()]
        rows[f"untouched, hit {k + 1} of each place"] = null(f"untouched, hit {k + 1}", some)
    left = [shot for place in (-5.0, -10.0, -20.0) for shot in hits[place]]
    name = "clock_error, from one end"
    sealed = Sealed(name, {"label": "clock_error | wrong_coordinates", "channel": 9})
    said = odd_channels([tampered(shot, "clock_error", 9, 8e-3) for shot in left], BAND)
    sealed.answered(said)
    rows[name] = sealed.scored(
        said[0].outcome == "CLASS" and said[0].target == (sealed.opened()["channel"],)
    )
    keep("odd_channels", rows)


if __name__ == "__main__":
    main()
