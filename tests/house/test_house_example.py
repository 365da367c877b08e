import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_house_example_ends_with_a_figure_and_a_ppv(tmp_path):
    figure = tmp_path / "house.png"
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"}
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "01_house_limits.py", figure],
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )

    assert figure.read_bytes().startswith(b"\x89PNG")
    assert "PPV" in done.stdout
