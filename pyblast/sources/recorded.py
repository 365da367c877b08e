"""Records that a project file names, in SI units and in the components of their receivers."""

import math
from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..model.model import Receiver
from ..recordings.recording import (
    Recording,
    first_recording,
    in_motion,
    read_recording,
    remove_response,
)
from ..signals.seismogram import GEOGRAPHIC, Seismogram

OF_ONE_RECORD = (
    "start_s", "low_passed_hz", "serial_number", "calibration_date", "location", "operator",
)  # fmt: skip


def shared(config):
    """Return a `RecordingConfig` without what is said of one record of its file alone."""
    return config.model_copy(update=dict.fromkeys(OF_ONE_RECORD) | {"record": 1})


def read_records(config, folder, log=None) -> list[Recording]:
    """Read all records of the file that a `RecordingConfig` names."""
    return read_recording(
        folder / config.file,
        config.format,
        bearing=None if config.bearing_deg is None else math.radians(config.bearing_deg),
        full_scale=(
            None if config.full_scale_mm_per_s is None else 1e-3 * config.full_scale_mm_per_s
        ),
        mapping=None if config.mapping is None else folder / config.mapping,
        unit="counts" if config.is_counts else config.unit,
        sheet=config.sheet,
        log=log,
    )


def record_of(config, folder, records) -> Recording:
    """Return the record of its file that a `RecordingConfig` names, as it says."""
    if config.record > len(records):
        raise InputError(f"record: {config.file} has {len(records)} records, got {config.record}")
    record = records[config.record - 1]
    if "record" not in config.model_fields_set:
        record = first_recording(config.file, records)
    if config.sensitivity is not None:
        record = in_motion(record, config.sensitivity)
    if config.response_file is not None:
        record = remove_response(record, folder / config.response_file)
    stated = {"start": config.start_s, "low_passed": config.low_passed_hz}
    stated = {name: value for name, value in stated.items() if value is not None}
    return replace(record, seismogram=replace(record.seismogram, **stated))


def read_hole(config, folder, log=None) -> Seismogram:
    """Read a single-hole record and remove its mean, which superposition would multiply.

    Raises
    ------
    InputError
        If it is clipped and the configuration does not accept that.
    """
    record = record_of(config, folder, read_records(config, folder, log))
    seismogram, clipped = record.seismogram, record.clipped.sum(axis=0)
    if clipped.any() and not config.accept_clipped:
        names = ", ".join(
            f"{count} of {name}"
            for name, count in zip(seismogram.components, clipped, strict=True)
            if count
        )
        raise InputError(
            f"recorded.file: {config.file}: samples are clipped ({names}), and every hole would "
            "repeat that; record the hole farther away, or set accept_clipped = true"
        )
    return replace(seismogram, velocity=seismogram.velocity - seismogram.velocity.mean(axis=0))


def make_receivers(parts) -> tuple[Receiver, ...]:
    """Turn a list of `ReceiverConfig` into receivers; those without height are to be placed."""
    return tuple(
        Receiver(
            part.name,
            tuple(map(float, part.position_m)),
            None if part.azimuth_deg is None else float(np.radians(part.azimuth_deg)),
            None if part.normal is None else tuple(part.normal),
        )
        for part in parts
    )


def like_simulated(record, azimuth, normal=None) -> Recording:
    """Turn a record into the components of a receiver.

    Parameters
    ----------
    record : Recording
    azimuth : float or None, rad
        Of its first horizontal component; None for east and north.
    normal : (3,) float, optional
        Direction of its only component.

    Raises
    ------
    InputError
        If they can't be made of those of the record.
    """
    if normal is not None:
        return _along_normal(record, normal)
    geographic = tuple(record.seismogram.components) == GEOGRAPHIC
    if azimuth is None and not geographic:
        raise InputError(
            "azimuth_deg: missing at the receiver; the record has longitudinal and transverse "
            "components"
        )
    return record.rotated(azimuth) if azimuth is not None and geographic else record


def _along_normal(record, normal):
    """Turn a record of one component, whatever its name, into motion along a direction."""
    seismogram, unit = record.seismogram, np.asarray(normal) / np.linalg.norm(normal)
    recorded = np.flatnonzero(np.isfinite(seismogram.velocity).any(axis=0))
    if len(recorded) != 1:
        names = ", ".join(seismogram.components[k] for k in recorded)
        raise InputError(
            f"normal: needs a record of one component, this one has {names or 'none'}; give the "
            "record of that sensor alone, or leave normal out"
        )
    across, column = unit == 0.0, seismogram.velocity[:, recorded]
    velocity = np.where(across, np.nan, column * unit)
    clipped = record.clipped[:, recorded] & ~across
    turned = replace(seismogram, velocity=velocity, components=GEOGRAPHIC)
    return replace(record, seismogram=turned, clipped=clipped, offset=(0.0, 0.0, 0.0))
