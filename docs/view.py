"""Pictures and measures of the view on pages: what a browser without a graphics card shows.

    python -m docs.view mine=examples/gol_e_gohar/project.toml bench=results/001 other=page.html

Each case is a project file, a folder of results or a page that holds a view. Writes NAME.png (1400
pixels wide) and NAME_telephone.png (390 points wide) to docs/figures/view, and the rows of the
table of docs/reference/results.md: triangles, size, time to the first picture, from the start of
the navigation until its pixels can be read, and processor time of the whole browser, from its start
to its end, which does not grow with what else the machine does. The least of three.
"""

import html
import io
import json
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

HERE = Path(__file__).resolve().parent
PAGE = HERE / "reference/results.md"
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
SOFTWARE = ("--headless", "--no-sandbox", "--hide-scrollbars", "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader")  # fmt: skip
REPEATS = 3
SHOWN = {"mine": {"field": "block"}, "fractures": {"cut": "north"}}  # what is chosen, else nothing
COLOURS = 160  # of a picture
TIMED = """var canvas = document.querySelector(".view canvas"), gl = canvas.getContext("webgl2");
gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
var said = document.querySelector(".view summary").textContent;
var hint = document.querySelector(".view .readout").textContent;
document.title = JSON.stringify([performance.now(), said, hint]);"""
ALONE = """document.body.className = "";
document.body.replaceChildren(document.querySelector(".view"));
Object.entries(%s).forEach(function (one) {
  var select = document.querySelector(".view ." + one[0]);
  select.value = one[1]; select.onchange();
});
window.dispatchEvent(new Event("resize"));"""


def main(cases):
    """Draw and measure the cases."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, source in (case.split("=", 1) for case in cases):
            text = page_of(source)
            seconds, processor, said = measured(Path(folder), text)
            size = len(text.encode()) / 1e6
            rows.append(f"| {name} | {said} | {size:.2f} | {seconds:.1f} | {processor:.1f} |")
            sys.stdout.write(f"{rows[-1]}\n")
            for width, ending in ((1400, ""), (390, "_telephone")):
                path = HERE / f"figures/view/{name}{ending}.png"
                path.write_bytes(picture(Path(folder), text, width, SHOWN.get(name, {})))
    known = PAGE.read_text(encoding="utf-8")
    head = "| page | triangles | MB | s | processor s |\n|---|---|---|---|---|\n"
    table = re.compile(re.escape(head) + r"(\|.*\n)*")
    PAGE.write_text(table.sub(lambda _: head + "\n".join(rows) + "\n", known), encoding="utf-8")


def page_of(source):
    """Return the page of a project, of results or of a file."""
    from pyblast.project.project import load_project
    from pyblast.project.result import read_result
    from pyblast.report.view import ModelView

    if source.endswith(".html"):
        return Path(source).read_text(encoding="utf-8")
    shown = load_project(source) if source.endswith(".toml") else read_result(source)
    return ModelView(shown).page()


def measured(folder, text):
    """Return the times in s to the first picture and of the processor, and the triangles."""
    found = []
    for _ in range(REPEATS):
        page, before = folder / "page.html", used()
        page.write_text(with_script(text, TIMED), encoding="utf-8")
        out = browser("--window-size=1400,1000", "--dump-dom", f"file://{page}")
        shown = json.loads(html.unescape(re.search(r"<title>(.*?)</title>", out)[1]))
        found.append((shown[0] / 1e3, used() - before))
        if not shown[2].startswith("Drag"):
            raise SystemExit(f"the page draws no view: {shown[2]}")
    triangles = re.search(r"\((\d+) triangles", shown[1])[1]
    return *(min(row) for row in zip(*found, strict=True)), triangles


def used():
    """Return the processor time in s of the browsers so far."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def picture(folder, text, width, chosen):
    """Return the view of a page of a width as a PNG of few colours, without its margins."""
    page, outer, shot = folder / "page.html", folder / "outer.html", folder / "shot.png"
    page.write_text(with_script(text, ALONE % json.dumps(chosen)), encoding="utf-8")
    outer.write_text(
        f'<body style="margin: 0"><iframe src="page.html" style="width: {width}px; height: 900px; '
        'border: 0"></iframe>', encoding="utf-8",
    )  # fmt: skip
    browser(f"--screenshot={shot}", f"--window-size={max(width, 500)},900",
            "--virtual-time-budget=3000", f"file://{outer}")  # fmt: skip
    image = Image.open(shot).convert("RGB").crop((0, 0, width, 900))
    drawn = Image.eval(image.convert("L"), lambda value: 255 - value).getbbox()
    made = io.BytesIO()
    image = image.crop((drawn[0], 0, drawn[2], drawn[3] + 4)).quantize(COLOURS)
    image.save(made, "png", optimize=True)
    return made.getvalue()


def with_script(text, script):
    """Return a page that runs a script after its own."""
    return text.replace("</body>", f"<script>{script}</script></body>")


def browser(*options):
    """Return what the browser prints."""
    done = subprocess.run(
        [CHROMIUM, *SOFTWARE, *options], capture_output=True, text=True, timeout=300, check=True
    )
    return done.stdout


if __name__ == "__main__":
    main(sys.argv[1:])
