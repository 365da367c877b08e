"""HDF5 files of named arrays: model files, checkpoints, results; written atomically."""

import os
from io import FileIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from .. import core
from ..errors import InputError, ReadError
from ..files import replacing

SCHEMA = 1
MAX_BYTES = 16 * 2**30
PIECE = 2**20  # bytes that share a checksum
_FILTERS = {"gzip", "shuffle", "fletcher32", None}


def write_arrays(
    path: str | Path,
    groups: dict[str, dict[str, Any]],
    attributes: dict[str, Any],
    array_attributes: dict[str, dict[str, Any]] | None = None,
) -> None:
    """Write groups of named arrays atomically: to a temporary file, then rename.

    A folder that is gone is made again.

    Parameters
    ----------
    path : path
    groups : dict of str to dict of str to numpy array or number
    attributes : dict of str to str, int or float
        Of the file.
    array_attributes : dict of str to dict, optional
        Attributes of arrays, by "group/name".
    """
    path, array_attributes = Path(path), array_attributes or {}
    with replacing(path) as beside, _Storage(beside, "w+") as storage:
        try:
            _write_groups(storage, groups, attributes, array_attributes)
        finally:
            if storage.error is not None:
                raise storage.error
        os.fsync(storage.fileno())


def _write_groups(storage, groups, attributes, array_attributes):
    """Write groups of arrays as HDF5 into a storage."""
    with h5py.File(storage, "w", libver=("v108", "v110")) as file:  # tables have checksums, too
        for name, value in attributes.items():
            file.attrs[name] = value
        groups = {**groups, "run": {"schema": np.int32(SCHEMA), **groups.get("run", {})}}
        for group, arrays in groups.items():
            for name, value in arrays.items():
                dataset = file.create_dataset(f"{group}/{name}", data=value, **_layout(value))
                dataset.attrs.update(array_attributes.get(f"{group}/{name}", {}))


def _layout(value):
    """Return the layout of an array: pieces with checksums; a number stands in a table."""
    shape, layout = np.shape(value), h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    if not shape:
        layout.set_layout(h5py.h5d.COMPACT)
    elif np.size(value):
        rows = max(1, PIECE * shape[0] // np.asarray(value).nbytes)
        layout.set_chunk((min(rows, shape[0]), *shape[1:]))
        layout.set_fletcher32()
    return {"dcpl": layout}


class _Storage(FileIO):
    """File that HDF5 writes into; it keeps the last error, such as a full disk, and goes on.

    HDF5 does not survive a write that fails while it closes a file: the process would end.
    """

    error = None

    def write(self, data):
        """Write all bytes."""
        rest = memoryview(data).cast("B")
        try:
            while len(rest):
                rest = rest[super().write(rest) :]
        except OSError as error:
            self.error = error
        return len(data)

    def truncate(self, size=None):
        """Set the size of the file."""
        try:
            return super().truncate(size)
        except OSError as error:
            self.error = error
            return size


def read_arrays(path: str | Path) -> tuple[dict[str, dict[str, Any]], dict[str, Any]]:
    """Read all groups of arrays and the attributes of a file.

    Returns
    -------
    groups : dict of str to dict of str to numpy array
    attributes : dict

    Raises
    ------
    ReadError
        If the file is no HDF5, is of another schema, or holds links to other places.
    """
    path = Path(path)
    try:
        with h5py.File(path, "r") as file:
            groups = {str(name): _read_group(path, file, name) for name in file}
            schema = groups.get("run", {}).get("schema", "none")
            if not np.array_equal(schema, SCHEMA):
                raise ReadError(f"{path}: schema must be {SCHEMA}, got {schema}")
            return groups, dict(file.attrs)
    except (OSError, KeyError, RuntimeError, ValueError) as error:
        if isinstance(error, ReadError):
            raise
        raise ReadError(
            f"{path}: not a whole HDF5 file of pyblast, damaged or cut short; make it again "
            f"({error})"
        ) from None


def _read_group(path, file, name):
    """Read the arrays of one group; raise ReadError for links and too large arrays."""
    _refuse_link(path, file, name)
    group = file[name]
    if not isinstance(group, h5py.Group):
        raise ReadError(f"{path}: '{name}' must be a group of arrays")
    arrays = {}
    for key in group:
        _refuse_link(path, group, key)
        data = group[key]
        if not isinstance(data, h5py.Dataset) or data.external is not None or data.is_virtual:
            raise ReadError(f"{path}: '{name}/{key}' must be an array held in the file itself")
        if data.nbytes > MAX_BYTES or data.compression not in _FILTERS:
            raise ReadError(f"{path}: '{name}/{key}' is too large or has an unknown compression")
        arrays[key] = data[()]
    return arrays


def _refuse_link(path, group, key):
    """Raise ReadError for soft and external links."""
    if not isinstance(group.get(key, getlink=True), h5py.HardLink):
        raise ReadError(f"{path}: '{key}' is a link to another place; copy the array into the file")


def write_model(
    path: str | Path,
    constants: dict[str, Any],
    state: dict[str, Any],
    run: dict[str, int],
    input_hash: str,
    added: dict[str, np.ndarray],
) -> None:
    """Write a model file for the program ``pyblast-run``.

    Parameters
    ----------
    path : path
    constants, state : dict of str to numpy array
        As from ``core.numbered``.
    run : dict of str to int
        ``n_steps``, ``ledger_every`` and ``fingerprint``.
    input_hash : str
    added : dict of str to numpy array
        ``receiver_motion`` (n_steps, n_receivers, 3) in m/s of injected sources, if there are any.

    Raises
    ------
    InputError
        If an array breaks its row of fortran/arrays.toml, which that program holds against it.
    """
    steps = {name: np.int32(value) for name, value in run.items()}
    groups = {
        "arrays": constants,
        "state": state,
        "run": {"schema": np.int32(SCHEMA), **steps, **added},
    }
    _check_rows(groups)
    write_arrays(path, groups, {"kind": "model", "input_sha256": input_hash})


def _check_rows(groups):
    """Raise InputError where an array breaks its row of the table: shape, kind or range."""
    sizes = dict(core.SIZES)
    for (group, name), row in core.ARRAYS.items():
        if group == "records" or ("optional" in row and name not in groups[group]):
            continue
        value, where = np.asarray(groups[group].get(name)), f"{group}/{name}"
        axes = [axis.partition(" + ") for axis in row["shape"] if axis != "n_batch"]
        for (size, _, more), length in zip(axes, value.shape, strict=False):
            sizes.setdefault(size, int(size) if size.isdigit() else length - int(more or 0))
        wanted = tuple(sizes.get(size, -1) + int(more or 0) for size, _, more in axes)
        kind = "f" if "unit" in row else "i"
        if value.dtype.kind != kind or value.shape != wanted:
            raise InputError(
                f"{where}: must be {wanted} of {kind}, got {value.shape} of {value.dtype}"
            )
        least, range_ = row.get("counts", [1 - row.get("none", False)])[0], row.get("range", "")
        if kind == "f":
            least = {"p": np.nextafter(0.0, 1.0), "n": 0.0}.get(range_[:1], -np.inf)
        bounded = np.isfinite(value) | ("infinite" in range_)
        if not np.all((value >= least) & bounded):
            raise InputError(
                f"{where}: must be {range_ or ('finite' if kind == 'f' else f'at least {least}')}"
            )


def write_checkpoint(
    path: str | Path,
    input_hash: str,
    step: int,
    state: dict[str, Any],
    records: dict[str, np.ndarray],
    snapshots: dict[int, np.ndarray],
) -> None:
    """Write a checkpoint: the state and records of a run, snapshots by step."""
    groups = {
        "state": state,
        "records": records,
        "snapshots": {str(at): velocity for at, velocity in snapshots.items()},
    }
    attributes = {"kind": "checkpoint", "input_sha256": input_hash, "step": step}
    write_arrays(path, groups, attributes)


def read_program_result(
    path: str | Path, fingerprint: int, expected: dict[str, dict[str, Any]]
) -> dict[str, dict[str, np.ndarray]]:
    """Read the result of the program ``pyblast-run`` for a model; given arrays define the shapes.

    Parameters
    ----------
    path : path
    fingerprint : int
        `Prepared.short_fingerprint` of the model.
    expected : dict of str to dict of str to numpy array
        By group, ``records`` and ``state``.

    Raises
    ------
    InputError
        If it belongs to another model.
    ReadError
        If it is no such file, or something is missing or has another shape.
    """
    groups, _ = read_arrays(path)
    of_model = groups["run"].get("fingerprint")
    if of_model is None or "records" not in groups:
        raise ReadError(f"{path}: not a result of pyblast-run; give the second file of its command")
    if int(of_model) != fingerprint:
        raise InputError(
            f"{path}: result of another model, duration or version; write the model of this "
            "project with 'pyblast run --write-model' and run it again"
        )
    return _as_expected(path, groups, expected)


def _as_expected(path, groups, expected):
    """Return arrays by group and name; raise ReadError unless they have the expected shapes."""
    for group, arrays in expected.items():
        for name, array in arrays.items():
            value = groups.get(group, {}).get(name)
            if value is None or value.shape != array.shape or value.dtype != array.dtype:
                raise ReadError(f"{path}: '{group}/{name}' is missing or has a wrong shape")
    return {
        group: {name: np.ascontiguousarray(groups[group][name]) for name in arrays}
        for group, arrays in expected.items()
    }


def read_checkpoint(
    path: str | Path, input_hash: str, state: dict[str, Any], records: dict[str, np.ndarray]
) -> tuple[int, dict[str, np.ndarray], dict[str, np.ndarray], dict[int, np.ndarray]]:
    """Read a checkpoint of the model with this hash; the given arrays define the shapes.

    Returns
    -------
    step : int
    state, records : dict of str to numpy array
    snapshots : dict of int to numpy array

    Raises
    ------
    InputError
        If it belongs to another model.
    ReadError
        If something is missing or has another shape.
    """
    groups, attributes = read_arrays(path)
    if attributes.get("kind") != "checkpoint":
        raise ReadError(f"{path}: not a checkpoint")
    if attributes.get("input_sha256") != input_hash:
        raise InputError(f"{path}: checkpoint of another model or duration; start afresh")
    held = _as_expected(path, groups, {"state": state, "records": records})
    snapshots = {int(at): velocity for at, velocity in groups.get("snapshots", {}).items()}
    return int(attributes["step"]), held["state"], held["records"], snapshots
