"""Sites as case folders, for other programs and for trials whose truth is known."""

from pathlib import Path

import numpy as np
from obspy import UTCDateTime

from ..errors import InputError
from ..recordings.seismic import mseed_bytes
from .result import write_bytes, write_text
from .site import Site

CODES = ("HHE", "HHN", "HHZ")
NETWORK = "PB"


def write_site(folder, site: Site):
    """Write a case folder that `read_site` reads again.

    Parameters
    ----------
    folder : path
        Made if it is not there.
    site : Site
        With elastic joints and no fields of ground; records of east, north and up.

    Raises
    ------
    InputError
        If the site holds what a case folder can't say.
    """
    if site.ground or site.marks or any(j.joint.law != "elastic" for j in site.joints):
        raise InputError(f"site {site.name}: a case folder holds only elastic joints and layers")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    pulse = site.moment_rate
    times = pulse.start + pulse.dt * np.arange(len(pulse.values))
    rows = [f"{t:.9g},{v:.9g}" for t, v in zip(times, pulse.values, strict=True)]
    write_text(folder / "source.csv", "\n".join(["time_s,moment_rate_per_kg", *rows]) + "\n")
    for name, blast in site.blasts.items():
        lines = ["id,x,y,z,charge_kg,delay_s"]
        for n, (place, charge, time) in enumerate(
            zip(blast.centres, blast.charge, blast.times, strict=True), 1
        ):
            lines.append(f"{n},{_numbers(place)},{charge:.9g},{time:.9g}")
        write_text(folder / f"{name}_holes.csv", "\n".join(lines) + "\n")
        write_bytes(folder / f"{name}.mseed", _records(site, name))
    write_text(folder / "site.toml", _table(site))


def _records(site, blast):
    """Return the records of one blast as miniSEED."""
    records = site.records[blast]
    first = next(iter(records.values())).seismogram
    motion = np.stack([one.seismogram.velocity.T for one in records.values()])
    channels = [[f"{NETWORK}.{name}..{code}" for code in CODES] for name in records]
    start = UTCDateTime(site.time_zeros[blast]) + first.start
    return mseed_bytes(motion, channels, first.dt, str(start))


def _table(site):
    """Return the text of site.toml."""
    lines = [f'case = "{site.name}"', "layers = ["]
    for name, thickness, rock in site.layers:
        height = "" if thickness is None else f", thickness_m = {thickness:.9g}"
        speeds = f"density = {rock.density:.9g}, vp = {rock.cp:.9g}, vs = {rock.cs:.9g}"
        lines.append(f'    {{ name = "{name}"{height}, {speeds} }},')
    lines += ["]", "receivers = ["]
    for one in site.receivers:
        x, y, z = (f"{float(v):.9g}" for v in one.position)
        lines.append(f'    {{ id = "{one.name}", x = {x}, y = {y}, z = {z} }},')
    lines += ["]", "[box]"]
    lines += [
        f"{axis} = [{_numbers(limits, ', ')}]" for axis, limits in zip("xyz", site.box, strict=True)
    ]
    known = site.quality is not None
    lines += ["[attenuation]", f"known = {'true' if known else 'false'}"]
    if known:
        lines += [f"Qp = {site.quality[0]:.9g}", f"Qs = {site.quality[1]:.9g}"]
    for joint in site.joints:
        lines += _joint(joint)
    lines += ["[source]", 'file = "source.csv"', f"charge_exponent = {site.exponent:.9g}"]
    for name in site.blasts:
        lines += [
            "[[blasts]]", f'id = "{name}"', f'holes = "{name}_holes.csv"',
            f'records = "{name}.mseed"', f'time_zero = "{site.time_zeros[name]}"',
        ]  # fmt: skip
    lines += [
        "[recording]", f"band_hz = [{_numbers(site.band, ', ')}]",
        f"noise_window_s = [{_numbers(site.noise_window, ', ')}]",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _joint(one):
    """Return the lines of one joint."""
    lines = [
        "[[joints]]", f'id = "{one.joint.surface}"', f'axis = "{one.axis}"',
        f"position = {one.position:.9g}", 'law = "linear"',
        f"kn = {one.joint.properties['kn']:.9g}", f"ks = {one.joint.properties['ks']:.9g}",
        f"insitu_normal_stress = {one.joint.insitu_pressure:.9g}",
    ]  # fmt: skip
    whole = np.all(np.isinf([*one.extent, *one.depth]))
    lines.append(f"whole_box = {'true' if whole else 'false'}")
    if not whole:
        lines.append(f"extent = [{_numbers(one.extent, ', ')}]")
        lines.append(f"depth = [{_numbers(one.depth, ', ')}]")
    return lines


def _numbers(values, between=","):
    """Return numbers as text that TOML and CSV know."""
    return between.join(f"{float(value):.9g}" for value in values)
