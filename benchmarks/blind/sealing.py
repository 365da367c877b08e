"""Seals on truths before a run, locks on answers before truths are opened."""

import hashlib
import json
import secrets
from pathlib import Path

from pyblast.errors import InputError
from pyblast.files import write_text

SEALS, LOCKS = "seals.json", "locks"


def seal(truth: dict) -> tuple[str, str]:
    """Return a truth with salt as text, and the seal on it: its SHA-256."""
    text = json.dumps({**truth, "salt": secrets.token_hex(16)}, indent=1, sort_keys=True) + "\n"
    return text, digest(text.encode())


def digest(content: bytes) -> str:
    """Return the SHA-256 of bytes."""
    return hashlib.sha256(content).hexdigest()


def publish(store: Path, seals: dict[str, str], plan: dict) -> str:
    """Write all seals with the plan of the benchmark, and return the one hash of them."""
    table = {"plan": plan, "seals": dict(sorted(seals.items()))}
    root = digest(json.dumps(table, sort_keys=True).encode())
    write_text(store / SEALS, json.dumps({**table, "root": root}, indent=1) + "\n")
    return root


def published(store: Path) -> dict:
    """Return what was published: plan, seals, root.

    Raises
    ------
    InputError
        If nothing was, or it was changed since.
    """
    try:
        table = json.loads((store / SEALS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise InputError(f"blind: {store / SEALS} can't be read; draw the cases first") from None
    inside = {key: table[key] for key in ("plan", "seals")}
    if table["root"] != digest(json.dumps(inside, sort_keys=True).encode()):
        raise InputError(f"blind: {store / SEALS} was changed after it was published")
    return table


def freeze(store: Path, name: str, answer: dict, seals: dict):
    """Write an answer once, with a lock: its hash and the seal of its truth.

    Raises
    ------
    InputError
        If there is an answer already: one to a case.
    """
    lock = store / LOCKS / f"{name}.json"
    if lock.exists():
        raise InputError(f"blind: {name} is answered already; answers are not changed")
    text = json.dumps(answer, indent=1) + "\n"
    path = store / "answers" / f"{name}.json"
    for folder in (lock.parent, path.parent):
        folder.mkdir(parents=True, exist_ok=True)
    write_text(path, text)
    write_text(lock, json.dumps({"answer": digest(text.encode()), "truth": seals[name]}) + "\n")


def opened(store: Path, name: str, seals: dict) -> tuple[dict, dict]:
    """Open a truth beside its frozen answer.

    Raises
    ------
    InputError
        If the truth breaks its seal, or the answer its lock, or the case is not answered.
    """
    truth = (store / "truth" / name / "truth.json").read_bytes()
    if digest(truth) != seals[name]:
        raise InputError(f"blind: the truth of {name} is not the one that was sealed")
    try:
        lock = json.loads((store / LOCKS / f"{name}.json").read_text(encoding="utf-8"))
    except OSError:
        raise InputError(f"blind: {name} has no frozen answer; run it first") from None
    answer = (store / "answers" / f"{name}.json").read_bytes()
    if digest(answer) != lock["answer"] or lock["truth"] != seals[name]:
        raise InputError(f"blind: the answer to {name} is not the one that was frozen")
    return json.loads(truth), json.loads(answer)


def data_of(truth: dict, path: Path) -> bytes:
    """Return the bytes of the motion that belongs to a truth.

    Raises
    ------
    InputError
        If it is not what was sealed with it.
    """
    content = path.read_bytes()
    if digest(content) != truth["motion"]:
        raise InputError(f"blind: {path} is not the motion that was sealed")
    return content
