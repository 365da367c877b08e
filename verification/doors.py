"""Cases of the suite through project files, on each element: error, stated error, asked accuracy.

    python -m verification.doors [CASE, ELEMENT ...] [--page] [--again] [--minutes N]

Each case is a project as `pyblast run` reads it, once with ``mesh.kind`` auto, once with hexahedra
and once with tetrahedra (of 15 nodes): columns under plane waves with ends, joints, layers and Q,
a plane that slips under a shear wave, plane waves in a half space that pass its viscous sides, and
scenes of `verification.scenes` with sources inside, hexahedra in their absorbing layer, tetrahedra
in padding. A column's incident wave is the motion that the project sends in; what becomes of it is
a closed form that shares no line with the program. The error is the norm of the difference over
that of the motion, at the worst receiver; it stands beside the accuracy asked for and the error
that `Project.accuracy` states. Writes the rows that ``verification/doors.json`` lacks and the
table of docs/quality/verification.md; ``--page`` writes the table alone.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from pyblast.project.project import Project

from . import scenes
from .columns import misfit, ricker
from .page import FAILS, OLD, WEEK, old, shown
from .rows import program, study
from .solutions import joints
from .solutions.free_surface import plane_field
from .solutions.layered_column import layer_gain
from .solutions.lossy_full_space import speed

OUT = Path(__file__).with_suffix(".json")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "quality" / "verification.md"
BEGIN, END = "<!-- doors: from verification/doors.json -->", "<!-- end of doors -->"
ELEMENTS = {
    "auto": {"kind": "auto"},
    "hexahedra": {"kind": "hexahedra"},
    "tetrahedra": {"kind": "tetrahedra", "quadratic": True},
}
FREQUENCY, CARRIED, LOW_PASS = 20.0, 50.0, 80.0  # Hz: of the pulse, of the mesh, of the input
AMPLITUDE, STEP, WINDOW = 0.01, 1e-4, 3.0  # m/s, and s of the spectra
DENSITY, CP, CS = 2600.0, 4000.0, 2300.0
ROCK = {"density_kg_per_m3": DENSITY, "cp_m_per_s": CP, "cs_m_per_s": CS}
SOIL = {"density_kg_per_m3": 2000.0, "cp_m_per_s": 1500.0, "cs_m_per_s": 800.0}
Z, ZS = DENSITY * CP, DENSITY * CS
TURN = 2.0 * np.pi * FREQUENCY
PRESSED = 0.5 * Z * AMPLITUDE  # Pa, of a joint that closes: more than the wave pulls
WIDE, SIDES = 30.0, ["west", "east", "south", "north"]
QUALITY, BAND = 40.0, [4.0, 100.0]
STIFF, FILL = 0.5 * Z * TURN, 0.5 * Z  # Pa/m and Pa s/m
SLIPS, SPRING = 0.4 * ZS * AMPLITUDE, 20.0 * ZS * TURN  # Pa and Pa/m
ACROSS = 60.0, 100.0, 140.0  # m, heights of a joint that slips, of its receiver, of the model
LAYER = 20.0, 120.0  # m of soil on rock
PADDED = {"padding_m": 60.0, "padding_edge_m": 20.0}  # of tetrahedra with sources inside
WIDELY = {"padding_m": 60.0, "padding_edge_m": 30.0}  # of standard scenes, times their scale


@dataclass(frozen=True)
class Door:
    """Case that a project file expresses, of a plane wave that enters through a face.

    Parameters
    ----------
    suite : str
        Numbers of its cases in the suite.
    along : (3,) float
        Motion of the pulse.
    tables : dict
        Of the project, beside those that all share.
    exact : callable
        ``exact(pulse, place)`` returns the velocity (n, 3) at a receiver from the incident
        `Pulse`, at its times.
    hexahedra : bool
        Whether they take it: neither plane waves nor free-field sides.
    """

    suite: str
    along: tuple[float, float, float]
    tables: dict = field(repr=False)
    exact: Callable = field(repr=False)
    hexahedra: bool = True


class Pulse:
    """Incident wave: samples over a window, and what spectra make of it."""

    def __init__(self, motion, along):
        self.times = motion.times[0] + np.arange(0.0, WINDOW, STEP)
        values = motion.velocity @ np.asarray(along)
        self.values = np.interp(self.times, motion.times, values, right=0.0)
        self.omega = 2.0 * np.pi * np.fft.rfftfreq(len(self.times), STEP)

    def passed(self, transfer, delay=0.0):
        """Return the wave (n,) after a transfer function of e^(-i w t) and a delay in s."""
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = np.conj(transfer(self.omega)) if callable(transfer) else transfer
        factor = np.where(np.isfinite(factor), factor, 0.0)
        turned = np.exp(-1j * self.omega * delay)
        return np.fft.irfft(np.fft.rfft(self.values) * factor * turned, len(self.times))


def column(length, receivers, duration=0.35, **parts):
    """Return the tables of a column along x whose sides hold P waves."""
    parts = {"east": "viscous", **parts}
    ends = {"viscous": ["west"], "roller": ["south", "north", "bottom", "top"]}
    if parts["east"] != "free":
        ends[parts["east"]] = [*ends.get(parts["east"], []), "east"]
    mesh = {"size_m": [length, WIDE, WIDE], "layers": [{"material": "rock"}]}
    joined = {}
    if "joint" in parts:
        mesh["faults"] = [fault([0.5 * length, 0.0, 0.0], 90.0)]
        joined = {"joints": {"joint": parts["joint"]}}
    return {
        "mesh": mesh,
        "materials": {"rock": ROCK | parts.get("quality", {})},
        "boundaries": ends,
        **joined,
        "input": {"face": "west"},
        "receivers": placed(*([x, 0.5 * WIDE, 0.5 * WIDE] for x in receivers)),
        "run": {"duration_s": duration},
    }  # fmt: skip


def fault(through, dip):
    """Return the table of a plane across the model."""
    return {"name": "joint", "through_m": through, "dip_deg": dip, "dip_direction_deg": 90.0}


def placed(*places):
    """Return the tables of receivers."""
    return [{"name": f"{n}", "position_m": place} for n, place in enumerate(places)]


def springs(law, **more):
    """Return the table of a joint of some stiffness, in Pa/m."""
    return {"law": law, "kn_pa_per_m": STIFF, "ks_pa_per_m": STIFF, **more}


def behind(through):
    """Return the exact motion beside and behind a joint with a transmission in the column."""

    def exact(pulse, place):
        middle = 300.0
        if place[0] > middle:
            return np.outer(pulse.passed(through, place[0] / CP), [1.0, 0.0, 0.0])
        back = pulse.passed(lambda omega: 1.0 - through(omega), (2.0 * middle - place[0]) / CP)
        return np.outer(pulse.passed(1.0, place[0] / CP) + back, [1.0, 0.0, 0.0])

    return exact


def end(sign):
    """Return the exact motion before an end at 600 m that reflects with a sign."""
    return lambda pulse, place: np.outer(
        pulse.passed(1.0, place[0] / CP) + sign * pulse.passed(1.0, (1200.0 - place[0]) / CP),
        [1.0, 0.0, 0.0],
    )


def fading(pulse, place):
    """Return the exact motion in a column of constant Q."""

    def transfer(omega):
        c = speed(omega, QUALITY, CP, 2.0 * np.pi * np.sqrt(BAND[0] * BAND[1]))
        return np.exp(1j * omega * place[0] / c)

    return np.outer(pulse.passed(transfer), [1.0, 0.0, 0.0])


def closed(pulse, place):
    """Return the exact motion behind a joint that closes."""
    motion = joints.past_closure(
        pulse.times[: 1 + int(0.4 / STEP)], lambda t: np.interp(t, pulse.times, pulse.values), Z,
        STIFF, Z * AMPLITUDE / STIFF, PRESSED,
    )  # fmt: skip
    return np.outer(np.interp(pulse.times - place[0] / CP, pulse.times[: len(motion)], motion),
                    [1.0, 0.0, 0.0])  # fmt: skip


def slid(pulse, place):
    """Return the exact motion behind a stiff Coulomb plane: the incident wave, clipped.

    Behind a spring in a row with a slider, ``dv/dt = 2 ks/z (v_I - v)``, between c/z and -c/z.
    """
    most, share = SLIPS / ZS, -np.expm1(-2.0 * SPRING / ZS * STEP)
    motion = np.zeros(len(pulse.times))
    for n in range(1, len(motion)):
        motion[n] = np.clip(motion[n - 1] + share * (pulse.values[n] - motion[n - 1]), -most, most)
    return np.outer(np.interp(pulse.times - place[2] / CS, pulse.times, motion), [1.0, 0.0, 0.0])


def layered(wave):
    """Return the exact motion of the ground of soil on rock under waves straight up."""
    axis, key = (2, "cp_m_per_s") if wave == "P" else (0, "cs_m_per_s")

    def exact(pulse, place):
        del place
        soil, rock = (SimpleNamespace(density=each["density_kg_per_m3"], cs=each[key])
                      for each in (SOIL, ROCK))  # fmt: skip

        def gain(omega):
            return 2.0 * layer_gain(omega / (2.0 * np.pi), LAYER[0], soil, rock)

        return np.outer(pulse.passed(gain, LAYER[1] / rock.cs), np.eye(3)[axis])

    return exact


def upright(wave):
    """Return the tables of soil on rock under waves straight up."""
    sides = {"roller": SIDES} if wave == "P" else {"free_field": SIDES}
    strain = {} if wave == "P" else {"quadratic": False}  # of zones beside free-field sides
    return {
        "mesh": {"size_m": [WIDE, WIDE, sum(LAYER)], **strain,
                 "layers": [{"material": "soil", "thickness_m": LAYER[0]}, {"material": "rock"}]},
        "materials": {"rock": ROCK, "soil": SOIL},
        "boundaries": {"viscous": ["bottom"], "free": ["top"], **sides},
        "input": {"face": "bottom"},
        "receivers": placed([0.5 * WIDE, 0.5 * WIDE, sum(LAYER)]),
        "run": {"duration_s": 0.5},
    }  # fmt: skip


def oblique(wave, angle):
    """Return the door of a plane wave in a half space whose sides it passes."""
    turned = np.radians(angle)
    along = {"P": (np.sin(turned), 0.0, np.cos(turned)), "SH": (0.0, -1.0, 0.0),
             "SV": (np.cos(turned), 0.0, -np.sin(turned))}[wave]  # fmt: skip
    size = [120.0, 60.0, 80.0]

    def exact(pulse, place):
        trains = plane_field(wave, turned, CP, CS)
        origin = np.array([0.0, 0.0, size[2]])
        first = -origin @ trains[0][0]  # at the corner that the wave meets first
        return sum(
            np.outer(pulse.passed(1.0, (np.asarray(place) - origin) @ slow - first),
                     motion * [1.0, -1.0, 1.0])
            for slow, motion in trains
        )  # fmt: skip

    tables = {
        "mesh": {"size_m": size, "layers": [{"material": "rock"}]},
        "materials": {"rock": ROCK},
        "boundaries": {"viscous": [*SIDES, "bottom"], "free": ["top"]},
        "input": {"enters_as": "plane_wave", "wave": wave, "azimuth_deg": 90.0,
                  "inclination_deg": angle},
        "receivers": placed([60.0, 30.0, 80.0], [90.0, 20.0, 30.0]),
        "run": {"duration_s": 0.3},
    }  # fmt: skip
    return Door("2, 12, L5, L8", along, tables, exact, hexahedra=False)


EAST, PAIR = (1.0, 0.0, 0.0), (150.0, 450.0)
SLIDING = {
    "mesh": {"size_m": [1500.0, WIDE, ACROSS[2]], "layers": [{"material": "rock"}],
             "faults": [fault([750.0, 0.0, ACROSS[0]], 0.0)]},
    "materials": {"rock": ROCK},
    "boundaries": {"viscous": ["bottom", "top", "west", "east"], "roller": ["south", "north"]},
    "joints": {"joint": {"law": "coulomb", "kn_pa_per_m": SPRING, "ks_pa_per_m": SPRING,
                         "cohesion_pa": SLIPS, "friction_angle_deg": 0.0, "tension_kpa": 0.0,
                         "insitu_pressure_kpa": 1e3}},
    "input": {"face": "bottom"},
    "receivers": placed([750.0, 0.5 * WIDE, ACROSS[1]]),
    "run": {"duration_s": 0.19},
}  # fmt: skip
DOORS = {
    "column, P": Door("1, 3", EAST, column(600.0, PAIR), end(0.0)),
    "column, P, free end": Door("4", EAST, column(600.0, PAIR, east="free"), end(1.0)),
    "column, P, fixed end": Door("4", EAST, column(600.0, PAIR, east="fixed"), end(-1.0)),
    "column, P, Qp 40 over ten wavelengths": Door(
        "25", EAST, column(2200.0, (1000.0, 2000.0), 0.8, quality={
            "qp": QUALITY, "qs": 0.6 * QUALITY, "quality_band_hz": BAND}), fading),
    "linear joint, P": Door("5", EAST, column(600.0, PAIR, joint=springs("elastic")), behind(
        lambda omega: joints.through_spring(omega, Z, STIFF))),
    "Kelvin fill, P": Door(
        "11", EAST,
        column(600.0, PAIR, joint=springs("kelvin", eta_n_pa_s_per_m=FILL, eta_s_pa_s_per_m=FILL)),
        behind(lambda omega: joints.through_kelvin(omega, Z, STIFF, FILL))),
    "Maxwell fill, P": Door(
        "11", EAST,
        column(600.0, PAIR, joint=springs("maxwell", eta_n_pa_s_per_m=FILL, eta_s_pa_s_per_m=FILL)),
        behind(lambda omega: joints.through_maxwell(omega, Z, STIFF, FILL))),
    "joint that closes, P": Door(
        "10", EAST, column(600.0, PAIR[1:], joint=springs(
            "closure", closure_mm=1e3 * Z * AMPLITUDE / STIFF,
            insitu_pressure_kpa=1e-3 * PRESSED)), closed),
    "Coulomb plane that slips, S": Door("8", EAST, SLIDING, slid),
    "layered column, P straight up": Door("22", (0.0, 0.0, 1.0), upright("P"), layered("P")),
    "layered column, S straight up": Door(
        "22, L9", EAST, upright("S"), layered("S"), hexahedra=False),
    "half space, P at 30°": oblique("P", 30.0),
    "half space, SV at 20°": oblique("SV", 20.0),
    "half space, SH at 50°": oblique("SH", 50.0),
}  # fmt: skip
OF_SCENES = {"explosion, near": "17", "force, near": "17", "force on the surface": "13, 15",
             "explosion, 20 m deep": "14", "couple below soil": "23",
             "couple beside a level joint": "6", "force on the surface, over 1 km": "13, 15",
             "LOH.1": "23", "LOH.3": "23, 25"}  # fmt: skip
ROWS = {f"{case}, {element}": (case, element) for case in (*DOORS, *OF_SCENES)
        for element in ELEMENTS
        if element != "hexahedra" or case in OF_SCENES or DOORS[case].hexahedra}  # fmt: skip


def project_of(door, element, folder):
    """Return the project of a case on an element, its pulse in a file of a folder."""
    times = np.arange(0.0, 4.0 / FREQUENCY, 5e-4)
    motion = np.outer(1e3 * AMPLITUDE * ricker(times, FREQUENCY), door.along)
    rows = np.column_stack([times, motion])
    np.savetxt(Path(folder) / "pulse.csv", rows, delimiter=",", fmt="%.9g", comments="",
               header="time_s,vx_mm_per_s,vy_mm_per_s,vz_mm_per_s")  # fmt: skip
    tables = door.tables
    hole = {"rows": 1, "holes_per_row": 1, "delay_ms": 0.0, "charge_kg": 100.0, "depth_m": 10.0,
            "diameter_mm": 100.0, "burden_m": 3.0, "spacing_m": 3.0,
            "position_m": [-100.0, 0.0, 0.0]}  # fmt: skip
    return Project.from_dict({
        "title": "Door", **tables,
        "mesh": {"frequency_hz": CARRIED, **ELEMENTS[element], **tables["mesh"]},
        "input": {"low_pass_hz": LOW_PASS, **tables["input"]},
        "blast": hole, "signature": {"recorded": {"file": "pulse.csv"}},
    }, folder)  # fmt: skip


def compared(door, project):
    """Run the project of a plane wave; return errors by receiver."""
    run, pulse = project.simulate(), Pulse(project.input.motion, door.along)
    errors = {}
    for receiver in door.tables["receivers"]:
        record = run.seismograms[receiver["name"]]
        wanted = door.exact(pulse, receiver["position_m"])
        wanted = np.transpose([np.interp(record.times, pulse.times, each) for each in wanted.T])
        errors[receiver["name"]] = misfit(record.velocity, wanted)
    return errors


def padding_of(case):
    """Return the keys of the padding around the tetrahedra of a scene."""
    keys = WIDELY if case in scenes.STANDARD else PADDED
    return {key: scenes.ALL[case].scale * length for key, length in keys.items()}


def measured(name):
    """Return the row of a case on an element."""
    case, element = ROWS[name]
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        if case in DOORS:
            project = project_of(DOORS[case], element, folder)
            errors = compared(DOORS[case], project)
        else:
            padded = padding_of(case) if element == "tetrahedra" else {}
            project = scenes.project(case, "0", folder, **ELEMENTS[element], **padded)
            receivers, _ = scenes.compared(project, case, "0")
            errors = {key: one["error"] for key, one in receivers.items()}
    asked = project.config.mesh.accuracy
    stated = {row.name: round(row.waveform, 4) for row in project.accuracy.rows}
    worst = max(errors, key=errors.get)
    return {
        "case": case, "element": element, "door": "project file",
        "suite": DOORS[case].suite if case in DOORS else OF_SCENES[case],
        "built": project.meshed.reason.split(",")[0],
        "asked": asked, "error": errors[worst], "stated": stated[worst],
        "within_stated": errors[worst] <= stated[worst], "within_asked": errors[worst] <= asked,
        "seconds": round(time.process_time() - began, 1),
    }  # fmt: skip


def table(rows):
    """Return the lines of the table: a case a line, each element beside the others."""
    asked = [row["within_asked"] for row in rows.values()]
    stated = [row["within_stated"] for row in rows.values()]
    lines = [
        f"{sum(stated)} of {len(rows)} errors are within the stated error, {sum(asked)} within "
        "the accuracy asked for.",
        f"{FAILS} marks one beyond the stated error, {OLD} one of another program than {program()}",
        f"or more than {WEEK.days} days old when this was written.",
        "",
        "| case | of the suite | auto | hexahedra | tetrahedra |",
        "|---|---|---|---|---|",
    ]
    for case in (*DOORS, *OF_SCENES):
        own = [rows.get(f"{case}, {element}") for element in ELEMENTS]
        suite = DOORS[case].suite if case in DOORS else OF_SCENES[case]
        cells = [_cell(row) for row in own]
        lines.append(f"| {case} | {suite} | {' | '.join(cells)} |")
    return lines


def _cell(row):
    """Return error, stated and asked in per cent, and a mark."""
    if row is None:
        return "–"
    error, stated = 100.0 * row["error"], 100.0 * row["stated"]
    mark = "✓" if row["within_stated"] else FAILS
    numbers = f"{shown(error, stated, sign='')} ({stated:g}; {100.0 * row['asked']:g})"
    return f"{numbers} {mark} {old(row)}".strip()


def main(arguments):
    """Measure rows and write them and the table."""
    study(arguments, ROWS, measured, table, OUT, PAGE, (BEGIN, END))


if __name__ == "__main__":
    main(sys.argv[1:])
