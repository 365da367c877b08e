"""Interface to Fortran: the only importer of its cores; indices, views, batches, laws."""

import fcntl
import logging
import os
import subprocess
import sys
import time
import tomllib
from functools import cache
from importlib import resources
from importlib.util import module_from_spec, spec_from_file_location
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .laws import StressLaw, TractionLaw, read_laws

os.environ.setdefault("OMP_WAIT_POLICY", "passive")
if TYPE_CHECKING:  # compiled, without type information
    _core: Any = None
else:
    from . import _core

log = logging.getLogger(__name__)

ENERGIES = (
    "kinetic", "strain", "joint_stored", "joint_dissipated", "zone_dissipated", "damping",
    "dashpots", "input", "insitu", "unbalanced",
)  # fmt: skip
# Sizes of the cores for batches and for single precision, which are loaded when first used.
BATCH_SIZE = 8  # runs in one batch
HEX_WIDTH = {  # hexahedra side by side in memory, by single precision
    False: int(_core.pyblast_kinds.hex_width),
    True: 8,
}
PIECE_SECONDS = 0.3  # wall time of the longest piece of a call that can't be interrupted
LEAST_SHARED = int(_core.pyblast_kinds.least_shared)  # nodes from which threads share a time step
# Lengths that Fortran sets, by the names that stand in arrays.toml.
SIZES = {
    name: int(getattr(_core.pyblast_kinds, name))
    for name in dir(_core.pyblast_kinds)
    if name.startswith(("n_", "hex_"))
}
N_SUMS, N_JOINT_STATE, N_ZONE_STATE = (
    SIZES[f"n_{n}"] for n in ("sums", "joint_state", "zone_state")
)
N_JOINT_PROPERTIES, N_ZONE_PROPERTIES = SIZES["n_joint_properties"], SIZES["n_zone_properties"]


def _array_table():
    """Return the rows of fortran/arrays.toml by group and name, with shapes in Python's order."""
    table = tomllib.loads((resources.files(__package__) / "arrays.toml").read_text("utf-8"))
    return {
        (group, name): {**row, "shape": row["shape"].split(", ")[::-1] if row["shape"] else []}
        for group, records in table.items()
        for arrays in records.values()
        for name, row in arrays.items()
    }


ARRAYS = _array_table()  # of a model file and of its result
STATE = tuple(name for group, name in ARRAYS if group == "state")
# Arrays that differ between the members of a batch, and the axis of the members.
BATCH_AXIS = {
    name: row["shape"].index("n_batch")
    for (_, name), row in ARRAYS.items()
    if "n_batch" in row["shape"]
}


@cache
def batch_core():
    """Return the core that integrates `BATCH_SIZE` models together."""
    try:
        from . import _core_batch as core  # pyright: ignore[reportAttributeAccessIssue]
    except ImportError:
        core = _compiled("_core_batch")
    assert core.pyblast_batch.n_batch == BATCH_SIZE
    return core


@cache
def single_core():
    """Return the core of single precision."""
    try:
        from . import _core_single as core  # pyright: ignore[reportAttributeAccessIssue]
    except ImportError:
        core = _compiled("_core_single")
    assert core.pyblast_kinds.hex_width == HEX_WIDTH[True]
    return core


def _compiled(name):
    """Return a core that the set-up from source left out, compiled now, once.

    Raises
    ------
    ImportError
        If this is no set-up from source, or the compiler fails.
    """
    folder = Path(_core.__file__).parents[1]
    if not (folder / "build.ninja").is_file():
        raise ImportError(f"pyblast: lacks {name}; install it again")
    with (folder / "build.ninja").open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # one process compiles, the others wait
        if not list((folder / "fortran").glob(f"{name}.*.so")):
            log.warning("compiles the cores for batches and single precision, once: a minute")
        _build_all(folder)
    (path,) = (folder / "fortran").glob(f"{name}.*.so")
    spec = spec_from_file_location(f"{__package__}.{name}", path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _build_all(folder):
    """Compile all cores in a build folder; changes of the source are compiled for all, then."""
    tools = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    for words in (["configure", folder, "-Dcores=all"], ["compile", "-C", folder]):
        done = subprocess.run(
            [sys.executable, "-m", "mesonbuild.mesonmain", *words], capture_output=True, text=True,
            check=False, env={**os.environ, "PATH": tools},
        )  # fmt: skip
        if done.returncode:
            last = "\n".join((done.stdout + done.stderr).splitlines()[-12:])
            raise ImportError(f"pyblast: can't compile its further cores:\n{last}")


def _rows(signature):
    """Yield the rows of a table of laws, the last one blank."""
    return (signature(number).decode() for number in count(1))


JOINT_LAWS = read_laws(
    TractionLaw,
    _rows(_core.pyblast_joint_laws.joint_law_signature),
    SIZES["n_row"],
    N_JOINT_PROPERTIES,
    N_JOINT_STATE,
)
ZONE_LAWS = read_laws(
    StressLaw,
    _rows(_core.pyblast_zone_laws.zone_law_signature),
    SIZES["n_row"],
    N_ZONE_PROPERTIES,
    N_ZONE_STATE,
)


def property_row(law, properties, width):
    """Return the properties of a law in the order of its signature, zeros after, (width,)."""
    row = np.zeros(width)
    row[: len(law.properties)] = [properties[name] for name in law.properties]
    return row


def joint_bound(law, properties):
    """Return the largest stiffness in Pa/m and the viscosity in Pa s/m of a joint's properties."""
    row = property_row(law, properties, N_JOINT_PROPERTIES)
    return _core.pyblast_joint_laws.joint_bound(law.number + 1, row)


def joint_tangents(law, properties, pressure):
    """Return kn and ks in Pa/m of a joint at rest under a pressure in Pa, zero or more."""
    row = property_row(law, properties, N_JOINT_PROPERTIES)
    return _core.pyblast_joint_laws.joint_tangents(law.number + 1, row, pressure)


def n_threads():
    """Return the number of OpenMP threads of a run that the calling thread starts."""
    return int(_core.pyblast_border.n_threads())


def _one_thread():
    """Take one thread in a process that was forked: the threads of its parent are not in it."""
    _core.pyblast_border.use_threads(1)


os.register_at_fork(after_in_child=_one_thread)
if n_threads() > 8 * (os.cpu_count() or 1):
    log.warning("takes %d threads, one for each processor", os.cpu_count())
    _core.pyblast_border.use_threads(os.cpu_count())


def stored_at_rest(constants, state):
    """Return the initial energy of the contacts, (n_contacts,) J/m2."""
    names = ("contact_normal", "contact_joint", "joint_law", "joint_property", "contact_initial")
    views = to_fortran({name: constants[name] for name in names})
    energy = _core.pyblast_border.stored_at_rest(**views, contact_state=state[:, None].T)
    return energy.T[..., 0]


def smooth(tables, points):
    """Smooth points (n_nodes, 3) in place, with the arguments of ``pyblast_smoothing``."""
    arrays = {
        name: value if value.dtype == np.float64 else value.astype(np.int32)
        for name, value in tables.items()
    }
    _core.pyblast_smoothing.smooth(**to_fortran(arrays), position=points.T)


def numbered(arrays):
    """Return arrays with the indices of Fortran, axes still in Python's order.

    Parameters
    ----------
    arrays : dict of str to numpy array or number
        Float arrays float64, indices int32 from 0 (-1 where there is none).

    Returns
    -------
    dict
        The same names; indices count from 1. An empty array becomes one row of zeros, which has
        no effect in loads, dashpots and the like: f2py takes no empty arrays.
    """
    table = {}
    for name, value in arrays.items():
        if isinstance(value, np.ndarray):
            if not value.size:
                value = np.zeros((1, *value.shape[1:]), dtype=value.dtype)
            if value.dtype == np.int32:
                value = value + np.int32(1)
            value = np.ascontiguousarray(value)
        table[name] = value
    return table


def in_single(arrays):
    """Return arrays in single precision."""
    return {
        name: value.astype(np.float32)
        if isinstance(value, np.ndarray) and value.dtype == np.float64
        else value
        for name, value in arrays.items()
    }


def to_fortran(arrays):
    """Return the views of one model for the kernels: `numbered`, axes reversed, no copy."""
    return _reversed(_with_batch_axis(numbered(arrays)))


def to_fortran_batch(arrays):
    """Return the views of `BATCH_SIZE` stacked models for the kernels."""
    return _reversed(numbered(arrays))


def _with_batch_axis(arrays):
    """Insert the batch axis into arrays that differ between members."""
    return {
        name: np.expand_dims(value, BATCH_AXIS[name]) if name in BATCH_AXIS else value
        for name, value in arrays.items()
    }


def _reversed(arrays):
    """Reverse the axes of arrays, as Fortran counts them."""
    return {
        name: value.T if isinstance(value, np.ndarray) else value for name, value in arrays.items()
    }


def advance(constants, state, first_step, n_steps, ledger_every):
    """Integrate ``n_steps`` time steps; the arrays of ``state`` change in place.

    Parameters
    ----------
    constants : dict
        From `to_fortran`.
    state : dict of str to numpy array
        The names of `STATE`, C-contiguous; float64, or all of them and the constants float32.
    first_step, n_steps, ledger_every : int

    Returns
    -------
    motion : (n_done, n_receivers, 3) float64, m/s
    energy : (n_lines, n_energies) float64, J
    failed : int or None
        Node of the largest velocity, from 0, if the integration stopped early.
    """
    views = _reversed(_with_batch_axis(state))
    core = single_core() if state["velocity"].dtype == np.float32 else _core
    motion, energy, failed = _integrate(core, constants, views, first_step, n_steps, ledger_every)
    return motion[..., 0], energy[:, 0], None if failed is None else failed[0]


def advance_batch(constants, state, first_step, n_steps, ledger_every):
    """Integrate `BATCH_SIZE` models in one batch; as `advance`, from `to_fortran_batch`.

    Returns
    -------
    motion : (n_done, n_receivers, 3, BATCH_SIZE) float64, m/s
    energy : (n_lines, BATCH_SIZE, n_energies) float64, J
    failed : tuple of int or None
        Node and batch member where the integration stopped early.
    """
    core = batch_core()
    return _integrate(core, constants, _reversed(state), first_step, n_steps, ledger_every)


def _integrate(core, constants, state, first_step, n_steps, ledger_every):
    """Integrate in one of the cores, in pieces between which a signal is obeyed.

    As `advance_batch`. Pieces end with rounds of the energy balance, where they change no bit.
    """
    n_batch = int(core.pyblast_batch.n_batch)
    last, real = first_step + n_steps, state["velocity"].dtype
    n_lines = -(-last // ledger_every) - -(-first_step // ledger_every)
    motion = np.zeros((n_steps, constants["receiver_node"].shape[1], 3, n_batch), real)
    energy = np.zeros((n_lines, n_batch, len(ENERGIES)), real)
    done, line, rounds, info, node, member = 0, 0, 1, 0, 0, 0
    while done < n_steps and info >= 0:
        step = first_step + done
        end = min(last, (step // ledger_every + rounds) * ledger_every)
        lines = -(-end // ledger_every) - -(-step // ledger_every)
        began = time.perf_counter()
        info, node, member = core.pyblast_border.advance(
            first_step=step,
            ledger_every=ledger_every,
            motion=motion[done : done + end - step].T,
            energy=energy[line : line + lines].T,
            **constants,
            **{name: state[name] for name in STATE},
        )
        done, line = done + abs(info), line + lines
        took = max(time.perf_counter() - began, 1e-4)
        rounds = max(1, min(4 * rounds, int(rounds * PIECE_SECONDS / took)))
    motion = motion[:done].astype(np.float64, copy=False)
    energy = energy.astype(np.float64, copy=False)
    return motion, energy, (node - 1, member - 1) if info < 0 else None
