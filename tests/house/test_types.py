"""An editor sees the types of the public names: a wrong argument is a type error."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PYRIGHT = shutil.which("pyright", path=Path(sys.executable).parent) or shutil.which("pyright")
PROGRAM = """
from pyblast import Joint

joint = Joint("fault", "elastic", {"kn": 1e9, "ks": 1e9}WRONG)
"""


def type_errors(folder, program):
    """Return the rules of pyright that a program breaks."""
    (folder / "program.py").write_text(program)
    settings = {"extraPaths": [str(Path(__file__).parents[2])], "useLibraryCodeForTypes": False}
    (folder / "pyrightconfig.json").write_text(json.dumps(settings))
    command = [PYRIGHT, "--outputjson", "--project", str(folder), "--pythonpath", sys.executable]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    return [error["rule"] for error in json.loads(done.stdout)["generalDiagnostics"]]


@pytest.mark.skipif(PYRIGHT is None, reason="pyright is not installed")
@pytest.mark.parametrize(("wrong", "rules"), [("", []), (", wrong=3", ["reportCallIssue"])])
def test_a_wrong_argument_of_a_public_class_is_a_type_error(tmp_path, wrong, rules):
    assert type_errors(tmp_path, PROGRAM.replace("WRONG", wrong)) == rules
