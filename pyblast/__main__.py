"""Run the command line as ``python -m pyblast``."""

from .cli.commands import main

if __name__ == "__main__":
    main()
