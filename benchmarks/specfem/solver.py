"""One run of SPECFEM3D: holes of a blast as isotropic moment tensors, motion at receivers."""

import os
import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from scipy.io import FortranFile

from pyblast.errors import InputError

from .ground import Ground
from .mesh import Mesh, time_step, write_database

LEAD = 0.02  # s, of a run before the blast's zero
DYNE_CM = 1e7  # of 1 N m
TALL = 1e-3  # m, below the top of the mesh: what stands on the ground is looked for inside
BAND = 3.0, 30.0  # Hz, of attenuation
CENTRE = 10.0  # Hz, for which the matched layer is set, and at which speeds are as stated
MOST_LEFT = 0.3  # of the largest motion at the end of a run: more means that it grows
PROGRAMS = "xgenerate_databases", "xspecfem3D"


def program_folder() -> Path:
    """Return the folder in which SPECFEM3D was built.

    Raises
    ------
    InputError
        If it is not there.
    """
    folder = Path(os.environ.get("PYBLAST_SPECFEM", "build/specfem3d")).resolve()
    if not (folder / "bin" / PROGRAMS[-1]).is_file():
        raise InputError(f"specfem: {folder} holds no bin/{PROGRAMS[-1]}; build SPECFEM3D "
                         "Cartesian and set PYBLAST_SPECFEM to its folder")  # fmt: skip
    return folder


def simulated(ground: Ground, mesh: Mesh, blasts, pulse, exponent, places, until):
    """Run blasts, one after the other, on one mesh.

    Parameters
    ----------
    ground : Ground
    mesh : Mesh
    blasts : dict of str to dict
        ``places`` (n, 3) in m, ``charges`` (n,) in kg, ``times`` (n,) in s and ``scales`` (n,) of
        each.
    pulse : callable
        Moment rate in N m/s of 1 kg at times in s after a hole fires.
    exponent : float
        Of the charge.
    places : (n_receivers, 3) float64, m
        Those at or above the top of the mesh stand on it.
    until : float, s

    Returns
    -------
    dict of str to (times (n,), velocity (n_receivers, 3, n))
        Times in s after the blast's zero, m/s.
    """
    step = time_step(mesh, ground)
    count = int(np.ceil((until + LEAD) / step))
    with tempfile.TemporaryDirectory(prefix="specfem-") as name:
        folder = Path(name)
        _set_up(folder, step, count, ground.q is not None, places, mesh)
        write_database(folder, mesh, ground)
        found = {}
        for blast, holes in blasts.items():
            _write_sources(folder, holes, pulse, exponent, step, count, mesh)
            for program in PROGRAMS[bool(found) :]:  # the model is made once
                _run(folder, program)
            found[blast] = _read(folder, len(places))
    return found


def _set_up(folder, step, count, fades, places, mesh):
    """Make the folders of a run with its parameters and receivers."""
    for name in ("DATA", "DATABASES_MPI", "OUTPUT_FILES"):
        (folder / name).mkdir()
    values = {
        "NPROC": 1, "NSTEP": count, "DT": f"{step:.9f}d0", "SUPPRESS_UTM_PROJECTION": ".true.",
        "NGNOD": 8, "MODEL": "default", "STACEY_ABSORBING_CONDITIONS": ".false.",
        "PML_CONDITIONS": ".true.", "f0_FOR_PML": f"{CENTRE}d0",
        "ATTENUATION": f".{str(fades).lower()}.",
        "COMPUTE_FREQ_BAND_AUTOMATIC": ".false.", "ATTENUATION_f0_REFERENCE": f"{CENTRE}d0",
        "MIN_ATTENUATION_PERIOD": f"{1.0 / BAND[1]:.6f}d0",
        "MAX_ATTENUATION_PERIOD": f"{1.0 / BAND[0]:.6f}d0",
        "USE_FORCE_POINT_SOURCE": ".false.", "USE_RICKER_TIME_FUNCTION": ".false.",
        "USE_EXTERNAL_SOURCE_FILE": ".true.", "USE_SOURCES_RECEIVERS_Z": ".true.",
        "SAVE_MESH_FILES": ".false.", "SAVE_SEISMOGRAMS_DISPLACEMENT": ".true.",
        "SAVE_SEISMOGRAMS_VELOCITY": ".false.", "SAVE_SEISMOGRAMS_ACCELERATION": ".false.",
        "NTSTEP_BETWEEN_OUTPUT_INFO": 1000000, "NTSTEP_BETWEEN_OUTPUT_SEISMOS": 1000000,
        "PRINT_SOURCE_TIME_FUNCTION": ".false.", "SIMULATION_TYPE": 1, "GPU_MODE": ".false.",
    }  # fmt: skip
    text = (program_folder() / "DATA" / "Par_file").read_text()
    for key, value in values.items():
        text = re.sub(rf"(?m)^{key}\s*=.*$", f"{key} = {value}", text)
    (folder / "DATA" / "Par_file").write_text(text)
    rows = []
    for n, (x, y, z) in enumerate(places):
        top = mesh.height(x, y) - TALL
        rows.append(f"R{n:02d} PB {y:.4f} {x:.4f} 0.0 {min(z, top):.4f}\n")
    (folder / "DATA" / "STATIONS").write_text("".join(rows))


def _write_sources(folder, holes, pulse, exponent, step, count, mesh):
    """Write the holes of a blast: isotropic moments whose history is the moment rate.

    The displacement that answers to it is the velocity of the blast.
    """
    times, lines = step * np.arange(count) - LEAD, []
    keys = zip(*(holes[k] for k in ("places", "charges", "times", "scales")), strict=True)
    for n, ((x, y, z), charge, fired, scale) in enumerate(keys):
        moment = charge**exponent * scale * pulse(times - fired)
        size = max(float(np.abs(moment).max()), 1.0)
        name = f"DATA/hole{n}.bin"
        with FortranFile(folder / name, "w") as file:
            file.write_record((moment / size).astype(np.float32))
        tensor = [f"M{word}: {size * DYNE_CM * even:.8e}" for word, even in
                  (("rr", 1), ("tt", 1), ("pp", 1), ("rt", 0), ("rp", 0), ("tp", 0))]  # fmt: skip
        top = mesh.height(x, y) - TALL
        lines += [
            "PDE 2024 5 1 10 0 0.00 0 0 0 5 5 hole", f"event name: hole{n}", "time shift: 0.0",
            "half duration: 0.0", f"latorUTM: {y:.4f}", f"longorUTM: {x:.4f}",
            f"depth: {min(z, top):.4f}", *tensor, name,
        ]  # fmt: skip
    (folder / "DATA" / "CMTSOLUTION").write_text("\n".join(lines) + "\n")


def _run(folder, program):
    """Run one of the programs.

    Raises
    ------
    InputError
        If it fails, with the last that it said.
    """
    done = subprocess.run([program_folder() / "bin" / program], cwd=folder, capture_output=True,
                          text=True, check=False)  # fmt: skip
    if done.returncode or "rror" in done.stderr:
        raise InputError(f"specfem: {program} failed: {done.stdout[-800:]}{done.stderr[-800:]}")


def _read(folder, count):
    """Return times and motion of a run, and clear its output."""
    found = []
    for n in range(count):
        three = [next((folder / "OUTPUT_FILES").glob(f"PB.R{n:02d}.?X{c}.semd")) for c in "XYZ"]
        found.append([np.loadtxt(file) for file in three])
    times = found[0][0][:, 0] - LEAD
    motion = np.array([[table[:, 1] for table in three] for three in found])
    peak, last = np.abs(motion).max(), np.abs(motion[..., -len(times) // 20 :]).max()
    if not last <= MOST_LEFT * peak:
        raise InputError("specfem: motion grows to the end of a run; take a shorter step")
    for file in (folder / "OUTPUT_FILES").glob("*.semd"):
        file.unlink()
    return times, motion
