"""Joints of a project file: keys with units, named by the law table of the core."""

from difflib import get_close_matches

from ..errors import InputError
from ..solving.joints import POSITIVE, Joint, may_be_left_out, saturated
from ..solving.kernels import JOINT_LAWS
from ..units import split_key, to_si
from .config_section import named_error

_STIFFNESSES = ("gpa_per_m", "mpa_per_m", "pa_per_m")
_LENGTHS = ("mm", "m")
_UNITS = {
    **dict.fromkeys(("kn", "ks", "kn_max"), _STIFFNESSES),
    **dict.fromkeys(("closure", "dilation_slip", "weakening_slip", "peak_slip"), _LENGTHS),
    **dict.fromkeys(("friction", "friction_residual", "friction_dynamic"), ("angle_deg",)),
    **dict.fromkeys(("friction_initial", "dilation"), ("angle_deg",)),
    **dict.fromkeys(("eta_n", "eta_s"), ("mpa_s_per_m", "pa_s_per_m")),
    **dict.fromkeys(("irrecoverable", "jrc", "exponent"), ("",)),
    "roughness": _LENGTHS,
    "jcs": ("mpa", "kpa", "pa"),
}
_PRESSURES = ("kpa", "mpa", "pa")


def make_joint(where, surface, config):
    """Turn a `JointConfig` into the `Joint` of one surface.

    Raises
    ------
    InputError
        If the law is unknown, or a key is unknown, missing, without a unit or out of range.
    """
    if config.law not in JOINT_LAWS:
        raise InputError(f"{where}.law: must be one of {', '.join(JOINT_LAWS)}, got {config.law!r}")
    names = JOINT_LAWS[config.law].properties
    properties = {}
    for key, value in (config.model_extra or {}).items():
        stem, unit = split_key(key)
        wanted = _UNITS.get(stem, _PRESSURES)
        if stem not in names or unit not in wanted:
            raise InputError(f"{where}.{key}: unknown key; {_proposal(key, names)}")
        if not value > 0.0 and stem in POSITIVE:
            raise InputError(f"{where}.{key}: must be positive, got {value:g}")
        if value < 0.0:
            raise InputError(f"{where}.{key}: must not be negative, got {value:g}")
        with named_error(where):
            properties[stem] = to_si(key, value)[1]
    for name in names:
        if name not in properties and name not in may_be_left_out(config.law):
            raise InputError(f"{where}.{_key(name)}: missing; add it")
    pressure = to_si("pressure_kpa", config.insitu_pressure_kpa)[1]
    mass = 0.0
    if config.fill_density_kg_per_m3 is not None:
        mass = config.fill_density_kg_per_m3 * to_si("fill_mm", config.fill_thickness_mm)[1]
    shear = tuple(to_si("shear_kpa", config.insitu_shear_kpa)[1])
    joint = Joint(surface, config.law, properties, pressure, shear, mass)
    if config.water_aperture_mm is None:
        return joint
    return saturated(joint, to_si("aperture_mm", config.water_aperture_mm)[1])


def _key(name):
    """Return the key of a property with its first unit."""
    return f"{name}_{_UNITS.get(name, _PRESSURES)[0]}".rstrip("_")


def _proposal(key, names):
    """Propose the key that was probably meant."""
    known = {name: _key(name) for name in names}
    stems = sorted((name for name in names if key.startswith(f"{name}_")), key=len)
    near = [known[stems[-1]]] if stems else get_close_matches(key, known.values(), n=1)
    return f"did you mean {near[0]!r}?" if near else f"known are {', '.join(known.values())}"
