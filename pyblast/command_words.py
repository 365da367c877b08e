"""What all commands share: words of their arguments, errors as one sentence and an exit code."""

from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from . import console
from .errors import PyblastError, SolverError

ProjectFile = Annotated[Path, typer.Argument(help="The project file, such as project.toml.")]
Full = Annotated[
    bool, typer.Option("--full", help="Take the larger run of table [full] of the file.")
]


@contextmanager
def told():
    """Turn every error into one sentence and an exit code: 1 solver, 2 input, 130 interrupted."""
    try:
        yield
    except SolverError as error:
        console.complain(error)
        raise typer.Exit(1) from None
    except PyblastError as error:
        console.complain(error)
        raise typer.Exit(2) from None
    except KeyboardInterrupt as stop:
        console.complain(f"interrupted; {stop}" if stop.args else "interrupted")
        raise typer.Exit(130) from None
