"""T5: raw files of Soda Lakes; whether clipped samples and dead channels are found.

Truth: counted by the keeper with obspy, from what the source says (2.82 is full scale; channels 47,
58, 59 are dead). Also made: quiet shots clipped at a drawn level, and drawn channels silenced.
Controls: untouched shots of two other lines. Argument: the folder.
"""

import numpy as np
import obspy
from keeper import Sealed, folder_of_recordings, keep

from pyblast.line_records.shots import EffectDecision
from pyblast.recordings.raw import clipped_samples, is_dead

FULL_SCALE, DEAD = 2.82, [47, 58, 59]


def marks(data):
    """Let the tool judge; clipped samples as a set, dead channels as a list, and the verdicts.

    A full scale found in one channel holds for all: they share a converter.
    """
    dead = np.flatnonzero([is_dead(samples) for samples in data]).tolist()
    at, level = clipped_samples(data)
    clipped = [tuple(pair) for pair in np.argwhere(at).tolist()]
    scale = {} if level is None else {"full_scale": (level, level, level)}
    verdicts = (
        EffectDecision("NAMED" if clipped else "NULL", "saturation",
                       f"{len(clipped)} samples stand at full scale", tuple(clipped), scale),
        EffectDecision("NAMED" if dead else "NULL", "dead_channel",
                       f"{len(dead)} channels never move", tuple(dead)),
    )  # fmt: skip
    return set(clipped), dead, verdicts


def judged(name, data, truth):
    """Seal, ask, open, score."""
    sealed = Sealed(name, truth)
    clipped, dead, verdicts = marks(data)
    sealed.answered(verdicts)
    true = {tuple(x) for x in sealed.opened()["clipped"]}
    hits = len(true & clipped)
    return sealed.scored(
        true == clipped and dead == truth["dead"],
        precision=hits / max(len(clipped), 1) if clipped else 1.0,
        recall=hits / len(true) if true else 1.0, clipped=len(clipped), dead=len(dead),
    )  # fmt: skip


def read(path):
    """Return the samples of a file as they are."""
    return np.array([t.data for t in obspy.read(path, format="SEG2")], dtype=float)


def main():
    """Run the test and keep its rows."""
    folder, rng, rows = folder_of_recordings(), np.random.default_rng(5), {}
    for path in sorted((folder / "soda_lakes").glob("*.sg2")):
        data = read(path)
        full = np.argwhere(np.isclose(np.abs(data), FULL_SCALE, rtol=1e-6)).tolist()
        rows[path.stem] = judged(path.stem, data, {"clipped": full, "dead": DEAD})
    others = [*(folder / "refrapy_ex02").glob("*.dat"), *(folder / "wghs").glob("*.dat")]
    others = sorted(others, key=lambda p: (p.parent.name, int(p.stem)))
    for path in others[::6]:
        name, data = f"{path.parent.name}/{path.stem}", read(path)
        level = rng.uniform(0.3, 0.8) * np.abs(data).max()
        truth = np.argwhere(np.abs(data) > level).tolist()
        silent = sorted(rng.permutation(len(data))[:2].tolist())
        truth = [x for x in truth if x[0] not in silent]
        made = np.clip(data, -level, level)
        made[silent] = 0.0
        rows[f"{name} clipped"] = judged(name, made, {"clipped": truth, "dead": silent})
    for path in others:
        name = f"{path.parent.name}/{path.stem}"
        rows[f"{name} untouched"] = judged(name, read(path), {"clipped": [], "dead": []})
    keep("T5", rows)


if __name__ == "__main__":
    main()
