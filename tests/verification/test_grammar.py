"""Project files by grammar: those without mistakes are read, and each kind of fault is seen."""

import os
import re
import sys
import tomllib

import numpy as np
import pytest

from pyblast.config.config import Config
from verification import grammar

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="checks in forked processes")


@pytest.mark.parametrize("seed", range(30))
def test_a_file_without_mistakes_is_read(seed):
    made = grammar.drawn(np.random.default_rng(seed))
    text = "\n".join(f"{key} = {grammar.toml(value)}" for key, value in made.tables.items())

    assert tomllib.loads(text) == made.tables
    assert Config.model_validate(made.tables).title == "Drawn"


@pytest.mark.parametrize("mistake", grammar.MISTAKES)
def test_a_mistake_is_made_of_a_seed_alone(mistake):
    once, again = (grammar.drawn(np.random.default_rng(3)) for _ in range(2))
    must = [mistake(np.random.default_rng(4), made) for made in (once, again)]

    assert must[0] == must[1]
    assert repr(once) == repr(again) != repr(grammar.drawn(np.random.default_rng(3)))


SAID = {
    "print('x'); sys.exit(0)": "is accepted, and must not be",
    "1 / 0": "ends with 1: .*ZeroDivisionError",
    "os.kill(os.getpid(), 9)": "ends with -9",
    "sys.exit(2)": "says 0 lines",
    "print('pyblast: a', file=sys.stderr); print('b', file=sys.stderr); sys.exit(2)": "says 2",
    "print('pyblast: got NoneType', file=sys.stderr); sys.exit(2)": "ends with 2: .*NoneType",
    "print('pyblast: \\x1b[31m', file=sys.stderr); sys.exit(2)": "terminals obey",
    "print('pyblast: a', file=sys.stderr); sys.exit(2)": "^$",
}


@pytest.mark.parametrize("does", SAID)
def test_every_kind_of_fault_is_seen(does, tmp_path, monkeypatch):
    monkeypatch.setattr(grammar, "main", lambda: exec(does, {"os": os, "sys": sys}))
    monkeypatch.setattr(sys, "stdout", sys.__stdout__)
    monkeypatch.setattr(sys, "stderr", sys.__stderr__)

    fault, _ = grammar.fault_of(tmp_path, must_refuse=True)

    assert re.search(SAID[does], fault), fault


def test_a_number_that_is_none_is_seen(tmp_path, monkeypatch):
    monkeypatch.setattr(grammar, "checked", lambda _: (3, 1.0))
    (tmp_path / "out.txt").write_text("peak nan mm/s")
    (tmp_path / "err.txt").write_text("")

    assert grammar.fault_of(tmp_path, must_refuse=False) == ("holds nan", 3)
