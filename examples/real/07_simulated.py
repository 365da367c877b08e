"""Effects concealed in real records, diagnosed against a simulation by `pyblast diagnose`.

Two steps: `seal` draws what is concealed in each trial from a seed and writes the SHA-256 of each
truth, with its salt, into simulated_truths.json; `run` makes project files, calls the command,
opens the truths, and keeps their rows; `gather` writes simulated.json and the table of the page.
Arguments: the step, the folder of recordings, a folder for project files and runs, and a part such
as 0/2, or a set. Trials go in an order that is drawn, too; those that have a row are not run again,
and a trial that is interrupted has none.
"""

import hashlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import real_projects as sets
from real_line import recordings_folder
from scipy import fft

SEED = 20261123
SEALED = Path(__file__).with_name("simulated_truths.json")
ROWS = Path(__file__).with_name("simulated.json")
PAGE = Path(__file__).resolve().parents[2] / "docs" / "quality" / "real_recordings.md"
BEGIN, END = "<!-- simulated: begin -->\n", "<!-- simulated: end -->"
HAMMER = [
    *["gain", "polarity", "clock", "coordinates"] * 3,
    *["swap", "response", "clip", "loss"] * 2,
]
BLOCK = ["gain", "gain", "polarity", "polarity", "clock", "swap", "ball", "ball"]
NULLS = {"wghs": 8, "ball_drop": 4}
NAMES = {
    "gain": "instrument_response", "polarity": "sensor_orientation_or_polarity",
    "clock": "clock_error", "coordinates": "wrong_coordinates", "swap": "swapped_channels",
    "response": "instrument_response", "clip": "clipped_channel", "loss": "attenuation_Q",
    "ball": "source_function",
}  # fmt: skip
PHYSICS = "loss", "ball"
REFUSED = 2  # exit status of an input that is refused
NEEDED = 0.5  # of what the truth explains beyond the believed model, for a name to be right


def drawn():
    """Return what each trial conceals, drawn from the seed."""
    rng = np.random.default_rng(SEED)
    kinds = [("wghs", kind) for kind in [*HAMMER, *[None] * NULLS["wghs"]]]
    kinds += [("ball_drop", kind) for kind in [*BLOCK, *[None] * NULLS["ball_drop"]]]
    return [
        {"set": name, "trial": n + 1, "concealed": kind, "draw": rng.random(40).tolist(),
         "salt": hashlib.sha256(rng.bytes(16)).hexdigest()[:16]}
        for n, (name, kind) in enumerate(kinds)
    ]  # fmt: skip


def digest(truth):
    """Return the SHA-256 of a truth with its salt."""
    return hashlib.sha256(json.dumps(truth, sort_keys=True).encode()).hexdigest()


def seal():
    """Write the digests of all truths."""
    rows = [{"set": t["set"], "trial": t["trial"], "sha256": digest(t)} for t in drawn()]
    SEALED.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


def filtered(samples, dt, change):
    """Return samples with their spectrum multiplied by ``change(frequency)``."""
    size = fft.next_fast_len(2 * samples.shape[-1], real=True)
    spectrum = fft.rfft(samples, size) * change(fft.rfftfreq(size, dt))
    return fft.irfft(spectrum, size)[..., : samples.shape[-1]]


def late(samples, dt, shift):
    """Return samples late by a shift in s."""
    return filtered(samples, dt, lambda f: np.exp(-2j * np.pi * f * shift))


def lossy(shot, loss):
    """Return all records of a shot after ground that loses more: 1/Q from the time of the shot."""
    n, dt, middle = shot.data.shape[1], shot.dt, 20.0
    f = fft.rfftfreq(2 * n, dt)
    t = np.maximum(shot.start + dt * np.arange(n), 0.0)
    kept = np.clip(f, 5.0, 100.0)
    phase = -2j * np.pi * f * (dt * np.arange(n)[:, None] - loss * t[:, None]
                               * np.log(kept / middle) / np.pi)  # fmt: skip
    operator = fft.irfft(np.exp(phase - np.pi * loss * t[:, None] * kept), 2 * n)[:, :n]
    return replace(shot, data=shot.data @ operator)


def other_ball(shot, force, size):
    """Return the records of a drop of a ball of another radius (Hertz: t as R, impulse as R^3)."""
    times, values = force
    window = times <= sets.SCALE * 6.66e-6

    def spectrum(f):
        return np.exp(-2j * np.pi * np.multiply.outer(f, times[window])) @ values[window]

    def change(f):
        believed = spectrum(f)
        least = 0.05 * np.abs(believed).max()
        return size**3 * spectrum(size * f) * np.conj(believed) / np.maximum(
            np.abs(believed) ** 2, least**2)  # fmt: skip

    data = filtered(shot.data - shot.data[:, :50].mean(axis=1, keepdims=True), shot.dt, change)
    return replace(shot, data=data)


def conceal(shots, truth, force):
    """Return the shots with the concealed effect, and its targets."""
    kind, u = truth["concealed"], truth["draw"]
    counts = {}
    for shot in shots:
        for name in shot.receivers:
            counts[name] = counts.get(name, 0) + 1
    often = sorted(name for name, n in counts.items() if n >= min(3, max(counts.values())))
    line = truth["set"] == "wghs"
    often = often[2:-2] if line else often
    target = often[int(u[20] * len(often))]
    sign = 1.0 if u[21] < 0.5 else -1.0
    if kind is None:
        return shots, []
    if kind == "loss":
        return [lossy(shot, 0.03 + 0.04 * u[22]) for shot in shots], [""]
    if kind == "ball":
        chosen = shots[int(u[22] * len(shots))].name
        size = 1.3 + 0.4 * u[23] if sign > 0 else 0.6 + 0.2 * u[23]
        return [other_ball(s, force, size) if s.name == chosen else s for s in shots], [chosen]
    if kind == "swap":
        places = {n: np.array(s.receivers[n][:2]) for s in shots for n in s.receivers}
        shared = {n for s in shots if target in s.receivers for n in s.receivers}
        near = sorted(
            (n for n in often if n != target and n in shared),
            key=lambda n: float(np.linalg.norm(places[n] - places[target])),
        )
        other = near[int(u[22] * min(4, len(near)))]
        return [swapped(shot, target, other) for shot in shots], [target, other]
    changed = [one_receiver(shot, target, kind, sign, u) for shot in shots]
    return changed, [target]


def swapped(shot, first, second):
    """Return a shot with two channels exchanged; one alone is lost where the other is absent."""
    names = list(shot.receivers)
    data = shot.data.copy()
    if first in names and second in names:
        a, b = names.index(first), names.index(second)
        data[[a, b]] = data[[b, a]]
        if shot.code == "N":  # the loader turns the sign by the face that is believed
            sides = np.sign(shot.receivers[first][1] * shot.receivers[second][1])
            data[[a, b]] *= sides
    elif first in names or second in names:
        return without(shot, first if first in names else second)
    return replace(shot, data=data)


def without(shot, name):
    """Return a shot without the record of a receiver."""
    data = shot.data.copy()
    data[list(shot.receivers).index(name)] = np.nan
    return replace(shot, data=data)


def one_receiver(shot, target, kind, sign, u):
    """Return a shot with the record of one receiver changed."""
    if target not in shot.receivers:
        return shot
    names, data = list(shot.receivers), shot.data.copy()
    r, dt = names.index(target), shot.dt
    rest = data[r] - data[r, : max(int(-shot.start / dt) - 5, 1)].mean()
    if kind == "gain":
        data[r] *= 0.5 if sign < 0 else 2.0
    elif kind == "polarity":
        data[r] *= -1.0
    elif kind == "clock":
        data[r] = late(rest, dt, 3e-3 * sign)
    elif kind == "response":
        corner, damping = 10.0 + 8.0 * u[22], 0.3 + 0.4 * u[23]

        def sensed(f):
            s = 1j * f / corner
            return s**2 / (1.0 + 2.0 * damping * s + s**2)

        data[r] = filtered(rest, dt, sensed)
    elif kind == "clip":
        level = (0.15 + 0.2 * u[22]) * np.abs(rest).max()
        data[r] = np.clip(rest, -level, level)
    elif kind == "coordinates":  # stood 2 m further: its record is that of the neighbour
        data[r] = data[r + int(sign)]
        return without(replace(shot, data=data), names[r + int(sign)])
    return replace(shot, data=data)


def shots_of(truth, hammer, drops):
    """Return trusted, questioned and held-out shots of a trial."""
    u = truth["draw"]
    if truth["set"] == "ball_drop":
        trusted = drops[1::3]
        rest = [shot for shot in drops if shot not in trusted]
        order = np.argsort(u[: len(rest)])
        held = {rest[k].name for k in order[:3]}
        return trusted, [s for s in rest if s.name not in held], [s for s in rest if s.name in held]
    trusted = [shot for shot in hammer if shot.name.endswith("_1")]
    questioned, held = [], []
    for p, first in enumerate(trusted):
        stem = first.name[:-1]
        order = 2 + np.argsort(u[4 * p : 4 * p + 4]) if 4 * p + 4 <= 24 else [2, 3]
        for k, into in zip(order, (questioned, held), strict=False):
            into.append(next(s for s in hammer if s.name == f"{stem}{k}"))
    return trusted, questioned, held


def diagnosed(folder, truth, changed, groups, force):
    """Write the project of a trial, call the command, return diagnosis.json."""
    hammer = truth["set"] == "wghs"
    trusted, _, held = groups
    keys = {"trusted": [s.name for s in trusted], "held_out": [s.name for s in held]}
    if hammer:
        keys |= {"band_hz": [10.0, 35.0], "until_s": 0.35, "source_s": 0.1, "calibrate": False}
    else:
        keys |= {"band_hz": [50.0, 100.0], "until_s": 0.11, "trigger_s": 3e-3, "calibrate": False}
    first = sets.write_project(
        folder / f"{truth['set']}_{truth['trial']:02d}",
        sets.WGHS_GROUND if hammer else sets.BLOCK_GROUND,
        [*trusted, *changed], force, keys,
    )  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-m", "pyblast", "diagnose", str(first), "--out",
         str(folder / truth["set"])], capture_output=True, text=True, check=False,
    )  # fmt: skip
    last = done.stdout.strip().splitlines()[-1] if done.stdout.strip() else done.stderr
    if done.returncode not in (0, REFUSED):
        print(done.stdout, done.stderr, flush=True)
        raise SystemExit(done.returncode)
    if "results: " not in last:
        return done.stderr
    result = Path(last.rsplit("results: ", 1)[1])
    return json.loads((result / "diagnosis.json").read_text(encoding="utf-8"))


def row_of(truth, targets, said):
    """Return the row of a trial: outcome, names, and whether they are right."""
    kind = truth["concealed"]
    row = {"set": truth["set"], "trial": truth["trial"], "concealed": kind, "targets": targets,
           "physics": kind in PHYSICS, "blind": True, "sha256": digest(truth)}  # fmt: skip
    if isinstance(said, str):
        return row | {"outcome": "REFUSED", "named": [], "right": False, "reason": said,
                      "explained_before": None, "explained_after": None}  # fmt: skip
    named = [e["label"] for e in said["effects"] if e["named"]]
    where = [e["target"] if isinstance(e["target"], str) else " and ".join(e["target"])
             for e in said["effects"]]  # fmt: skip
    clipped = said["data_quality"].get("clipped", {})
    if kind == "clip" and set(clipped) & set(targets):
        named, where = ["clipped_channel"], list(clipped)
    held = said["held_out_blasts"]
    own = held["receivers"].get(targets[0]) if targets else None
    before, after = own or (held["explained_before"], held["explained_after"])
    right = named == ([] if kind is None else [NAMES[kind]])
    right = right and (not targets or any(all(t in w for t in targets) for w in where))
    return row | {
        "outcome": said["outcome"], "named": named, "where": where, "class": said["class"],
        "right": bool(right), "explained_before": before, "explained_after": after,
        "best": said["evidence"]["best_labels"],
        "code_sha256": said["provenance"]["code_sha256"],
        "receivers": {k: v[0] for k, v in held["receivers"].items()},
        "delta_ln_evidence": said["evidence"]["delta_ln_evidence"],
        "null_threshold": said["evidence"]["null_threshold"],
        "largest_chi_square": said["located"]["largest_chi_square"], "wall_s": said["wall_s"],
    }  # fmt: skip


def rows_of(folder):
    """Return the rows of the trials that were run, by trial."""
    path = folder / "rows.jsonl"
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    rows = [json.loads(line) for line in text.splitlines()]
    return {row["trial"]: row for row in rows}


def run(recordings, folder, part=(0, 1), only=None):
    """Run the trials, every n-th of them, or those of a set, and write their rows."""
    hammer = sets.wghs_shots(recordings)
    drops = [sets.decimated(shot, 10) for shot in sets.ball_drops(recordings)]
    forces = {"wghs": sets.ricker(), "ball_drop": sets.hertz_force(recordings)}
    sealed = {row["trial"]: row["sha256"] for row in json.loads(SEALED.read_text())}
    trials = drawn()
    order = np.random.default_rng(0).permutation(len(trials))
    for truth in [trials[k] for k in order[part[0] :: part[1]]]:
        if truth["trial"] in rows_of(folder) or only not in (None, truth["set"]):
            continue
        assert sealed[truth["trial"]] == digest(truth), "the truths are not those that were sealed"
        force = forces[truth["set"]]
        groups = shots_of(truth, hammer, drops)
        changed, targets = conceal([*groups[1], *groups[2]], truth, force)
        said = diagnosed(folder, truth, changed, groups, force)
        row = row_of(truth, targets, said)
        print({k: row.get(k) for k in ("set", "trial", "concealed", "targets", "outcome", "named",
                                       "where", "right", "explained_before", "explained_after",
                                       "largest_chi_square", "wall_s")}, flush=True)  # fmt: skip
        with (folder / "rows.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


def gather(folder):
    """Write simulated.json from the rows of all parts."""
    rows = sorted(rows_of(folder).values(), key=lambda row: row["trial"])
    for row in rows:
        same = [r for r in rows if r["set"] == row["set"] and "receivers" in r]
        nulls = [r["receivers"] for r in same if r["concealed"] is None]
        best = [r[row["targets"][0]] for r in nulls if row["targets"] and row["targets"][0] in r]
        row["explained_by_truth"] = float(np.mean(best)) if best else None
        if best and row["right"] and row["concealed"] != "clip":
            row["right"] = bool(row["explained_after"] > NEEDED * row["explained_by_truth"])
    for row in rows:
        row.pop("receivers", None)
    text = ",\n".join(json.dumps(row) for row in rows)
    text = json.dumps(json.loads(f"[{text}]", parse_float=lambda x: float(f"{float(x):.4g}")))
    ROWS.write_text(text.replace("}, {", "},\n{") + "\n", encoding="utf-8")
    write_table(json.loads(text))


def table(rows):
    """Return the rows of the page on real recordings, and what they sum up to."""
    lines = [
        "| set | concealed | at | answer | named, or best candidate | right "
        "| explained before, after, by the truth |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        shares = [row.get(f"explained_{when}") for when in ("before", "after", "by_truth")]
        shares = ", ".join("–" if share is None else f"{share:.2f}" for share in shares)
        best = [] if row["outcome"] in ("NULL", "REFUSED") else row["best"]
        found = ", ".join(row["named"]) or (f"({', '.join(best)})" if best else "–")
        where = " and ".join(row["targets"])
        kind = "nothing" if row["concealed"] is None else row["concealed"]
        right = "yes" if row["right"] else "no" if row["named"] or kind == "nothing" else "–"
        lines.append(
            f"| {row['set']} | {kind} | {where} | {row['outcome']} | {found} | {right} | {shares} |"
        )
    hidden = [row for row in rows if row["concealed"] is not None]
    nulls = [row for row in rows if row["concealed"] is None]
    named = [row for row in rows if row["named"]]
    right = [row for row in hidden if row["right"]]
    alarms = [row for row in nulls if row["named"]]
    lines += [
        "",
        f"{len(rows)} of the {len(drawn())} sealed trials have run.",
        f"{len(right)} of {len(hidden)} concealed effects were named rightly (target two thirds),",
        f"{len([r for r in named if r['right']])} of {len(named)} names were right, and "
        f"{len(alarms)} of {len(nulls)} untouched sets had a name.",
    ]
    return "\n".join(lines) + "\n"


def write_table(rows):
    """Write the table into the page between its marks."""
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    text = before + BEGIN + table(rows) + END + rest.split(END)[1]
    PAGE.write_text(text, encoding="utf-8")


def main():
    """Take the step that is asked for."""
    step, *rest = sys.argv[1:] or ["seal"]
    if step == "seal":
        seal()
        return
    folder = Path(rest[1])
    folder.mkdir(parents=True, exist_ok=True)
    if step == "gather":
        gather(folder)
        return
    part, only = (0, 1), None
    for word in rest[2:]:
        if "/" in word:
            part = tuple(int(x) for x in word.split("/"))
        else:
            only = word
    run(recordings_folder(rest[:1]), folder, part, only)


if __name__ == "__main__":
    main()
