"""The border between Python and Fortran: types, indices, tables, names."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest

from pyblast import core
from pyblast.mesh.builder import structured_box
from pyblast.model.joint import Joint
from pyblast.model.model import Model, Receiver
from pyblast.solver import assembly
from verification.columns import ROCK

ROOT = Path(__file__).parents[2]
CORE = core._core
MODULES = [getattr(CORE, name) for name in dir(CORE) if name.startswith("pyblast_")]
ROUTINES = [
    getattr(module, name)
    for module in MODULES
    for name in dir(module)
    if type(getattr(module, name)).__name__ == "fortran"
]


def arguments(routine):
    return re.findall(r"^(\w+) : (.*)$", routine.__doc__, re.MULTILINE)


def constants(receivers=()):
    mesh = structured_box((2, 1, 1), (2.0, 1.0, 1.0), planes={"J": ("x", 1.0)}).split(["J"])
    joint = Joint("J", "elastic", {"kn": 1e9, "ks": 1e9})
    model = Model(mesh, {"rock": ROCK}, joints=[joint], receivers=receivers)
    geometry, _ = assembly.geometry_arrays(model)
    return {**geometry, **assembly.dynamic_arrays(model, geometry, 10)}


def test_the_core_has_routines_to_look_at():
    assert len(ROUTINES) >= 10


def test_no_argument_of_the_core_is_single_precision():
    # f2py turns an unknown kind into C float, with no more than a printed note
    found = [r.__doc__ for r in ROUTINES if re.search(r"array\('[fF]'\)", r.__doc__)]

    assert not found


def test_state_is_changed_in_place():
    listed = dict(arguments(CORE.pyblast_border.advance))

    for name in (*core.STATE, "motion", "energy"):
        assert listed[name].startswith("in/output")


def test_every_kernel_argument_of_a_model_has_the_name_of_the_fortran_argument():
    listed = [name for name, kind in arguments(CORE.pyblast_border.advance) if "input" in kind]
    own = {"first_step", "ledger_every", "motion", "energy", *core.STATE}
    sizes = {name for name in listed if name.startswith("n_")}

    counts = {"n_mapped", "n_slabs"}
    assert set(constants()) == set(listed) - own - sizes | counts


def test_every_index_array_is_shifted_and_nothing_else():
    for name, value in constants().items():
        is_index = isinstance(value, np.ndarray) and value.dtype == np.int32
        assert is_index == ("points" in core.ARRAYS["arrays", name]), name


def test_the_table_of_arrays_has_the_shapes_that_the_border_declares():
    text = re.sub(r"&\s*\n\s*", "", (ROOT / "fortran" / "border.f90").read_text())
    text = text[text.index("subroutine advance(") : text.index("end subroutine advance")]
    lines = re.findall(r"^ *(?:integer|real).*, target ::(.*)$", text, re.MULTILINE)
    declared = {
        name: shape.split(", ")[::-1]
        for line in lines
        for name, shape in re.findall(r"(\w+)\(([^)]*)\)", line)
    }
    table = {name: row["shape"] for (group, name), row in core.ARRAYS.items()
             if group in ("arrays", "state") and row["shape"]}  # fmt: skip

    assert declared == table


def test_arrays_cross_the_border_without_a_copy():
    points = np.arange(6.0).reshape(2, 3)

    assert np.shares_memory(core.to_fortran({"displacement": points})["displacement"], points)


def test_indices_count_from_one_in_fortran_and_minus_one_means_none():
    views = core.to_fortran({"fixed_history": np.array([-1, 0, 4], dtype=np.int32)})

    assert views["fixed_history"].tolist() == [[0, 1, 5]]


def test_an_empty_array_becomes_one_row_of_nothing():
    views = core.to_fortran(
        {"load_vector": np.zeros((0, 3)), "load_node": np.zeros(0, dtype=np.int32)}
    )

    assert views["load_vector"].shape == (3, 1)
    assert not views["load_vector"].any()
    assert views["load_node"].tolist() == [1]


@pytest.mark.parametrize("name", ["slot_place", "node_mass", "contact_normal", "history"])
def test_floats_are_double(name):
    assert constants()[name].dtype == np.float64


def test_the_laws_are_as_many_as_fortran_counts():
    assert len(core.JOINT_LAWS) == int(CORE.pyblast_joint_laws.n_joint_laws)
    assert len(core.ZONE_LAWS) == int(CORE.pyblast_zone_laws.n_zone_laws)


def test_a_law_beyond_the_table_has_no_signature():
    beyond = len(core.JOINT_LAWS) + 1

    assert not CORE.pyblast_joint_laws.joint_law_signature(beyond).decode().strip()


def test_the_ledger_has_a_name_for_each_column():
    assert len(core.ENERGIES) == int(CORE.pyblast_kinds.n_energies)


def test_state_that_is_not_contiguous_is_refused():
    arrays = constants([Receiver("a", (0.5, 0.5, 0.5))])
    state = assembly.initial_state(arrays)
    state["displacement"] = np.zeros((len(arrays["node_mass"]), 6))[:, ::2]

    with pytest.raises(ValueError, match="contiguous"):
        core.advance(core.to_fortran(arrays), state, 0, 1, 20)


def test_the_wait_policy_is_set_before_the_core_is_loaded():
    source = inspect.getsource(core)

    assert source.index("OMP_WAIT_POLICY") < source.index("from . import _core")
