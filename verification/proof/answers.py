"""Answers: one case in a process of its own, several side by side, in pieces of some minutes.

python -m verification.proof.answers [--again] FILE CASE
"""

import fcntl
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path

from pyblast.errors import InputError, LostProcessError, PyblastError, ReadError
from verification.rows import Rows, each_row, ended_by_sigterm, program, read_rows

from .cases import answered, as_crash
from .registered import checked

ROOT = Path(__file__).resolve().parents[2]
FILE, TRIALS = ROOT / "verification" / "proof.json", ROOT / "build" / "proof" / "trials.json"
COMMAND = sys.executable, "-m", "verification.proof.answers"
WAIT = 0.2  # s


def first_answers(rows: Rows, version: str) -> Rows:
    """Return the first answer of a version to each case, by case."""
    keys = (key.split() for key in rows)
    return {name: rows[f"{name} {by}"] for name, by, *again in keys if by == version and not again}


def versions(rows: Rows) -> dict[str, int]:
    """Return how many first answers each version gave, most first."""
    digests = {key.split()[1] for key in rows}
    count = {digest: len(first_answers(rows, digest)) for digest in sorted(digests)}
    return dict(sorted(count.items(), key=lambda item: -item[1]))


def next_key(rows: Rows, name: str, version: str) -> str:
    """Return under which key a further answer of a version stands: the first has no number."""
    given = sum(key.split()[:2] == [name, version] for key in rows)
    return f"{name} {version}" + (f" {given + 1}" if given else "")


def answer(path: Path, name: str, again: bool = False, job: Callable = answered):
    """Answer a case and store the row; a version that has answered it is not asked again.

    Parameters
    ----------
    path : Path
        Of all rows.
    name : str
    again : bool
        Whether a further answer is wanted, which stands beside the first.
    job : callable
        Takes name and folder, returns a row.

    Raises
    ------
    InputError
        If the case is not registered or its truth is another one.
    """
    version = program()
    store = ROOT / "build" / "proof" / version / name.partition("-")[0]
    if not name.startswith("trial-"):
        checked(name)

    def row(_):
        try:
            return job(name, store)
        except (InputError, ReadError, LostProcessError):  # the case is not here, or was stopped
            raise
        except Exception as error:  # a crash is an answer, and a wrong one
            return as_crash(name, error)

    store.mkdir(parents=True, exist_ok=True)
    with (store / f"{name}.lock").open("w") as lock:  # two commands may ask for the same case
        fcntl.flock(lock, fcntl.LOCK_EX)
        rows = read_rows(path)
        if again or name not in first_answers(rows, version):
            each_row(path, [next_key(rows, name, version)], row)


def answer_all(
    names: Sequence[str], jobs: int, minutes: float, command: Sequence[str]
) -> list[str]:
    """Answer cases side by side until time is over; what is unfinished then goes on next time.

    Parameters
    ----------
    names : sequence of str
        Of the cases, in this order.
    jobs : int
        Processes at once.
    minutes : float
    command : sequence of str
        Followed by a name it answers that case.

    Returns
    -------
    list of str
        Cases without an answer, those that failed first.
    """
    ends = time.monotonic() + 60.0 * minutes
    waiting, running, failed = deque(names), {}, []
    with ended_by_sigterm():
        try:
            while (waiting or running) and time.monotonic() < ends:
                while waiting and len(running) < jobs:
                    name = waiting.popleft()
                    running[name] = subprocess.Popen([*command, name], cwd=ROOT)
                done = [name for name, child in running.items() if child.poll() is not None]
                failed += [name for name in done if running.pop(name).returncode]
                if not done:
                    time.sleep(WAIT)
        finally:
            for child in running.values():
                child.terminate()
            for child in running.values():
                child.wait()
    return [*failed, *running, *waiting]


if __name__ == "__main__":
    *again, given, case = sys.argv[1:]
    try:
        answer(Path(given), case, again == ["--again"])
    except PyblastError as error:
        sys.exit(str(error))
