"""Bits of both doors on several threads: what is compared, and what the table says of it."""

import numpy as np
import pytest

from pyblast import core
from verification import bits
from verification.rows import read_rows

ROWS = read_rows(bits.OUT)
SAME = {"nodes": 13000, "steps": 60, "shared": True, "acts": True, "differs": {"Python, 2": []}}


def test_every_law_stands_in_a_row_of_every_element_that_takes_it():
    made = {element: set() for element in bits.GRIDS}
    for ground, element in bits.ROWS.values():
        made[element] |= {joint.law for joint in bits.JOINTED.get(ground, {}).get("joints", ())}
        made[element] |= {ground.removesuffix(" ground")} & set(core.ZONE_LAWS)

    assert made["15 nodes"] == set(core.JOINT_LAWS)
    assert made["hexahedra"] == set(core.JOINT_LAWS) - {"yielding"}
    assert made["4 nodes"] == {*core.JOINT_LAWS, *core.ZONE_LAWS}


def test_no_stored_row_differs_and_each_model_is_shared_and_acts():
    assert ROWS
    for name, row in ROWS.items():
        assert set(row["differs"]) == {
            f"{door}, {count}" for door in ("Python", "pyblast-run") for count in bits.THREADS
        }
        assert not any(row["differs"].values()), name
        assert row["shared"], name
        assert row["acts"], name


@pytest.mark.skipif(not bits.PROGRAM.is_file(), reason="built without the program pyblast-run")
def test_one_changed_bit_is_found_and_told(monkeypatch):
    name = "elastic joint, hexahedra"
    run = bits.integrated

    def changed(*arguments):
        found = run(*arguments)
        found.state["velocity"][0, 0] = np.nextafter(found.state["velocity"][0, 0], 1.0)
        return found

    monkeypatch.setattr(bits, "THREADS", (1,))
    monkeypatch.setattr(bits, "integrated", changed)

    row = bits.measured(name)

    assert row["differs"] == {"Python, 1": [], "pyblast-run, 1": ["state velocity"]}
    assert "**no**" in "".join(bits.table({name: row}))


def test_the_table_says_what_a_row_lacks():
    idle = bits.table({"one rock, 4 nodes": SAME | {"acts": False, "shared": False}})

    assert "1 of 1" in idle[0]
    assert any("yes, 13000 nodes; too few nodes to share; law idle | – | – |" in x for x in idle)
