"""Keeper of concealed effects: a truth sealed by its digest, opened after the tool has answered."""

import hashlib
import json
import secrets
from dataclasses import asdict
from pathlib import Path

import numpy as np
from real_line import recordings_folder

from pyblast import read_gather
from pyblast.line_records.shots import shot_of

OUTCOMES = Path(__file__).with_name("outcomes.json")


class Sealed:
    """A truth that is read only after `answered`; its digest is printed first."""

    def __init__(self, name, truth):
        """Seal a truth (plain numbers and words) with a drawn salt."""
        self.name, self.salt = name, secrets.token_hex(16)
        self._text = json.dumps(truth, sort_keys=True) + self.salt
        self.digest = hashlib.sha256(self._text.encode()).hexdigest()
        self.said = None
        print(f"{name}: sealed {self.digest}")

    def answered(self, verdicts):
        """Freeze what the tool says."""
        self.said = [asdict(v) for v in verdicts]
        for v in verdicts:
            print(f"  said {v.outcome} {v.label} {v.target or ''}: {v.reason} [p {v.p_value:.3f}]")

    def opened(self):
        """Return the truth, once the tool has answered."""
        if self.said is None:
            raise RuntimeError(f"{self.name}: the tool must answer before the truth is opened")
        return json.loads(self._text[: -len(self.salt)])

    def scored(self, right, **scores):
        """Return the row of the table: digest, truth, answer, scores."""
        truth = self.opened()
        print(f"  truth {truth}: {'right' if right else 'WRONG'} {scores}")
        return {"digest": self.digest, "salt": self.salt, "truth": truth, "said": self.said,
                "right": bool(right), "scores": scores}  # fmt: skip


def keep(section, rows):
    """Write one section of outcomes.json, a line to a test, numbers rounded to 5 digits."""
    known = json.loads(OUTCOMES.read_text(encoding="utf-8")) if OUTCOMES.is_file() else {}
    text = json.dumps(rows, default=_plain)
    known[section] = json.loads(text, parse_float=lambda x: float(f"{float(x):.5g}"))
    sections = [
        f"{json.dumps(name)}: {{\n"
        + ",\n".join(f" {json.dumps(k)}: {json.dumps(v, sort_keys=True)}" for k, v in part.items())
        + "\n}"
        for name, part in sorted(known.items())
    ]
    OUTCOMES.write_text("{\n" + ",\n".join(sections) + "\n}\n", encoding="utf-8")


def _plain(value):
    """Turn numpy numbers and arrays into plain ones."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def wghs(folder, places=(-5, -10, -20, 51, 56, 66)):
    """Return shots of the Wellington line, by place."""
    shots = {}
    for path in sorted((folder / "wghs").glob("*.dat"), key=lambda p: int(p.stem)):
        gather = read_gather(path)
        place = float(gather.source_position[0])
        if place in places:
            shots.setdefault(place, []).append(shot_of(gather))
    return shots


def refraction_line(folder):
    """Return the nine shots of the refraction line."""
    return [shot_of(read_gather(p)) for p in sorted((folder / "refrapy_ex02").glob("*.dat"))]


def crossed_lines(folder):
    """Return the four shots at Soda Lakes; one line after the other."""
    table = np.genfromtxt(folder / "soda_lakes" / "geometry.csv", delimiter=",")
    receivers, shots = table[:96, :2], []
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(receivers, axis=0), axis=1)))
    for path in sorted((folder / "soda_lakes").glob("*.sg2")):
        source = table[table[:, 4] == int(path.stem[-5:])][0, :2]
        offsets = np.linalg.norm(receivers - source, axis=1)
        shots.append(shot_of(read_gather(path), along, 0.0, offsets))
    return shots


def folder_of_recordings():
    """Return the folder of recordings, from the arguments."""
    import sys

    return recordings_folder(sys.argv[1:])
