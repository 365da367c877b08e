"""Check that commands, numbers and pictures of the documents are those of the program.

    ./dev docs --check --quick    commands and their options, pictures: what needs no run
    ./dev docs --check            runs the commands of the pages, too, and compares what they give
    ./dev docs --check --write    writes anew what differs

Without ``--quick`` it takes about twenty minutes on two cores; names of chapters (``quickstart``,
``proof``, ``gallery``, ``projects``, ``demo``) run those alone.
"""

import io
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import typer
from matplotlib.image import imread

from pyblast.cli.commands import app
from pyblast.files import write_bytes, write_text

ROOT = Path(__file__).resolve().parents[1]
QUICKSTART = ROOT / "docs" / "quickstart.md"
PAGES = [
    ROOT / "README.md",
    QUICKSTART,
    ROOT / "docs" / "examples.md",
    *sorted((ROOT / "docs" / "guide").glob("*.md")),
]
RELATIVE = 0.05  # by which a number may differ, or by one in its last place
UNLIKE = 0.02  # mean difference of the pixels of pictures, of white against black


@dataclass(frozen=True)
class Chapter:
    """What some commands make: blocks of pages by name, pictures by path below docs/figures.

    Parameters
    ----------
    make : callable
        Runs the commands in a folder and returns blocks and pictures (PNG).
    blocks : dict of str to Path
        Page of each block.
    pictures : tuple of str
    """

    make: Callable[[Path], tuple[dict[str, str], dict[str, bytes]]]
    blocks: dict[str, Path]
    pictures: tuple[str, ...]


def quick_start(folder: Path) -> tuple[dict[str, str], dict[str, bytes]]:
    """Run the commands of the quick start in their order."""
    from . import quickstart_values as values

    for line in shell_lines(QUICKSTART):
        run(line, folder)
    first, search, diagnosis = values.results(folder)
    blocks = {
        "first run": values.sentence(first.summary),
        "search": values.table(search),
        "diagnosis": values.named(diagnosis),
    }
    pictures = values.pictures(first, search, folder)
    return blocks, {f"quickstart/{name}.png": image for name, image in pictures.items()}


def proof(folder: Path) -> tuple[dict[str, str], dict[str, bytes]]:
    """Run the proof of the README."""
    said = run("python examples/concealed/proof.py proof", folder)
    (numbers,) = re.findall(
        r"([\d.]+) % of its energy .*?([\d.]+) % by the .*? at (\d+) of (\d+) receivers", said
    )
    before, after, better, count = numbers
    out = folder / "proof" / "001"
    (effect,) = json.loads((out / "diagnosis.json").read_text("utf-8"))["effects"]
    closed = effect["parameters"]["closed"]
    words = (
        f"pyblast names `{effect['label']}` at {effect['target']}: the fault stiffens as it "
        f"closes, at {closed['value']:.2g} of its largest closure (90 % interval "
        f"{closed['low']:.2g} to {closed['high']:.2g}; the concealed value is 0.69). Of a further "
        f"blast, which no fit used, the calibrated site misses {before} % of the energy (median of "
        f"the receivers), the diagnosed one {after} %; it is better at {better} of {count} "
        "receivers."
    )
    return {"proof": words}, {"concealed.png": (out / "proof.png").read_bytes()}


def demo(folder: Path) -> tuple[dict[str, str], dict[str, bytes]]:
    """Run the example of the paper and draw its section and its view."""
    from .quickstart_values import image_of
    from .view import SHOWN, picture

    run("pyblast run examples/gol_e_gohar/project.toml --out demo", folder)
    report = (folder / "demo" / "001" / "report.html").read_text("utf-8")
    turned = picture(folder, report, 1400, SHOWN["mine"])
    return {}, {"quickstart/gol_e_gohar.png": image_of(report, "Section"), "view/mine.png": turned}


GALLERY = {
    "house_limits": "python examples/01_house_limits.py house_limits.png",
    "site_law": "python examples/02_site_law.py examples/site_peaks.csv site_law.png",
    "best_delays": "python examples/03_best_delays.py best_delays.png",
}


def gallery(folder: Path) -> tuple[dict[str, str], dict[str, bytes]]:
    """Run the examples that draw one figure each."""
    for line in GALLERY.values():
        run(line, folder)
    images = {name: (folder / f"{name}.png").read_bytes() for name in GALLERY}
    return {}, {f"gallery/{name}.png": image for name, image in images.items()}


PROJECTS = {
    "bench": "Plan", "fractures": "Plan", "holes_inside": "Plan", "rock_mass": "Plan",
    "water_table": "Section",
}  # fmt: skip


TURNED = "bench", "fractures"


def projects(folder: Path) -> tuple[dict[str, str], dict[str, bytes]]:
    """Run the small project files and take a figure of each report, and the view of some."""
    from .quickstart_values import image_of
    from .view import SHOWN, picture

    images = {}
    for name, title in PROJECTS.items():
        run(f"pyblast run examples/{name}/project.toml --out {name}", folder)
        report = (folder / name / "001" / "report.html").read_text("utf-8")
        images[f"projects/{name}.png"] = image_of(report, title)
        if name in TURNED:
            images[f"view/{name}.png"] = picture(folder, report, 1400, SHOWN.get(name, {}))
    return {}, images


CHAPTERS = {
    "quickstart": Chapter(
        quick_start, dict.fromkeys(("first run", "search", "diagnosis"), QUICKSTART),
        tuple(f"quickstart/{name}.png"
              for name in ("section", "comparison", "values", "residuals", "held_out")),
    ),
    "proof": Chapter(proof, {"proof": ROOT / "README.md"}, ("concealed.png",)),
    "gallery": Chapter(gallery, {}, tuple(f"gallery/{name}.png" for name in GALLERY)),
    "projects": Chapter(projects, {}, (
        *(f"projects/{name}.png" for name in PROJECTS), *(f"view/{name}.png" for name in TURNED),
    )),
    "demo": Chapter(demo, {}, ("quickstart/gol_e_gohar.png", "view/mine.png")),
}  # fmt: skip


def shell_lines(page: Path) -> list[str]:
    """Return the command lines of the blocks ``sh`` of a page, without comments."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    lines = [re.sub(r"\s+#.*", "", line) for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.strip()]


def command_lines(page: Path) -> list[str]:
    """Return all command lines of a page: of blocks, of indented lines, and in backticks."""
    text = page.read_text(encoding="utf-8")
    indented = re.findall(r"^    ((?:pyblast|python|\./dev) .*)$", text, re.MULTILINE)
    quoted = re.findall(r"`((?:pyblast(?:-run)?|python|\./dev) [^`]+)`", text)
    lines = [*shell_lines(page), *indented, *quoted]
    return [re.sub(r"\s+", " ", re.sub(r"\s+#.*", "", line)) for line in lines]


def wrong_command(line: str) -> str:
    """Return what is wrong with a command line of the documents; empty if nothing is."""
    words = [word for word in shlex.split(line) if not re.match(r"[A-Z_]+=", word)]
    if words[0] == "./dev":
        usage = (ROOT / "dev").read_text(encoding="utf-8")
        unknown = [w for w in words[1:2] if not re.search(rf"\./dev {re.escape(w)}\b", usage)]
        return f"./dev has no job {unknown[0]}" if unknown else ""
    if words[0] == "python":
        return _wrong_script(words[1:])
    if words[0] == "pyblast-run":
        return ""
    group = typer.main.get_command(app)
    if words[1].startswith("-"):
        known = {option for p in group.params for option in (*p.opts, "--help", "--version")}
        return "" if words[1] in known else f"pyblast has no option {words[1]}"
    command = vars(group)["commands"].get(words[1])
    if command is None:
        return f"pyblast has no command {words[1]}"
    known = {option for parameter in command.params for option in parameter.opts} | {"--help"}
    unknown = [w for w in words[2:] if w.startswith("--") and w.split("=")[0] not in known]
    return f"pyblast {words[1]} has no option {', '.join(unknown)}" if unknown else ""


def _wrong_script(words):
    """Return what is wrong with the arguments of Python."""
    if words[0] == "-m":
        path = ROOT / words[1].replace(".", "/")
        there = path.is_dir() or path.with_suffix(".py").exists() or "." not in words[1]
        return "" if there else f"there is no module {words[1]}"
    if not words[0].endswith(".py") or (ROOT / words[0]).exists():
        return ""
    return f"there is no {words[0]}"


def quick_faults(pages: list[Path]) -> Iterator[str]:
    """Yield what is wrong with pages as far as no run is needed to see it."""
    made = {name for chapter in CHAPTERS.values() for name in chapter.pictures}
    for page in pages:
        text, name = page.read_text(encoding="utf-8"), page.name
        for line in command_lines(page):
            if fault := wrong_command(line):
                yield f"{name}: {line}: {fault}"
        for picture in re.findall(r"\]\((?:docs/|\.\./)?figures/([^)]+)\)", text):
            if picture not in made:
                yield f"{name}: no chapter of {__name__} makes {picture}"
    for chapter in CHAPTERS.values():
        for block, page in chapter.blocks.items():
            if page in pages and not _pattern(block).search(page.read_text(encoding="utf-8")):
                yield f"{page.name}: has no block <!-- {block} -->"


def _pattern(block):
    """Return the pattern of a block of a page with its content as group."""
    return re.compile(rf"<!-- {block} -->\n\n?(.*?)\n\n?<!-- end of {block} -->", re.DOTALL)


def run(line: str, folder: Path) -> str:
    """Run a command line of the documents in a folder beside the examples; return what it prints.

    Raises
    ------
    RuntimeError
        If it ends with another code than 0 or 3.
    """
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        shlex.split(line), cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"},
    )  # fmt: skip
    if done.returncode not in (0, 3):
        raise RuntimeError(f"{line}: ended with {done.returncode}: {done.stderr[-2000:]}")
    return done.stdout


def differs(shown: str, made: str) -> bool:
    """Tell whether two texts differ by more than their line breaks and the error of numbers."""
    number = r"(?<![\w.])[+-]?\d+(?:\.\d+)?"
    texts = [" ".join(text.split()) for text in (shown, made)]
    if len({re.sub(number, "#", text) for text in texts}) > 1:
        return True
    pairs = zip(*(re.findall(number, text) for text in texts), strict=True)
    return any(
        abs(float(first) - float(other))
        > 1.01 * max(RELATIVE * abs(float(first)), 0.1 ** len(first.partition(".")[2]))
        for first, other in pairs
    )


def unlike(shown: bytes, made: bytes) -> bool:
    """Tell whether two pictures (PNG) differ to the eye."""
    first, second = (imread(io.BytesIO(image), format="png")[..., :3] for image in (shown, made))
    return first.shape != second.shape or bool(np.abs(first - second).mean() > UNLIKE)


def chapter_faults(name: str, write: bool) -> Iterator[str]:
    """Run the commands of a chapter; yield what differs on the pages, or write it anew."""
    chapter = CHAPTERS[name]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "examples").symlink_to(ROOT / "examples")
        blocks, pictures = chapter.make(Path(folder))
    for block, page in chapter.blocks.items():
        text = page.read_text(encoding="utf-8")
        shown = _pattern(block).search(text)
        if shown is None or not differs(shown[1], blocks[block]):
            continue
        if write:
            anew = f"<!-- {block} -->\n\n{blocks[block]}\n\n<!-- end of {block} -->"
            write_text(page, text[: shown.start()] + anew + text[shown.end() :])
        yield f"{page.name}: {block}: commands now give: {blocks[block]}"
    for picture in chapter.pictures:
        path = ROOT / "docs" / "figures" / picture
        other = not path.exists() or unlike(path.read_bytes(), pictures[picture])
        if write:  # numbers in a picture may change where the eye sees no other lines
            write_bytes(path, pictures[picture])
        if other:
            yield f"docs/figures/{picture}: commands now draw another picture"


def main(arguments: list[str]) -> int:
    """Check, print what is wrong, and return the exit code."""
    quick, write = "--quick" in arguments, "--write" in arguments
    chosen = [name for name in arguments if not name.startswith("-")]
    if unknown := [name for name in chosen if name not in CHAPTERS]:
        sys.stderr.write(f"no chapter {unknown[0]}; known are {', '.join(CHAPTERS)}\n")
        return 2
    faults = 0
    for fault in quick_faults(PAGES):
        sys.stdout.write(f"{fault}\n")
        faults += 1
    for name in [] if quick else chosen or CHAPTERS:
        for fault in chapter_faults(name, write):
            sys.stdout.write(f"{'written: ' if write else ''}{fault}\n")
            faults += not write
    sys.stdout.write(f"{faults} differences\n" if faults else "no differences\n")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
