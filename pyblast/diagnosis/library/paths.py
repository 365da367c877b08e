"""Effects on the path from blast to receiver: laws of joints."""

from dataclasses import replace

import numpy as np
from scipy import fft

from ...core import JOINT_LAWS
from ...inference.nuisances import hole_parts
from ...project.places import firings_of
from ..hypotheses import elastic_joints, hypothesis, unknown_quality

STIFFEST = 20.0  # largest tangent stiffness of a closing joint, over that at rest
NEVER = 1e12  # Pa, a tensile strength that is never reached


def _on_joint(project, target, change):
    """Return a project with one joint changed; None if its law is not elastic any more."""
    chosen = _joint(project, target)
    joints = (change(joint) if joint is chosen else joint for joint in project.joints)
    return project.changed(joints=joints) if JOINT_LAWS[chosen.law].elastic else None


def _joint(project, target):
    """Return a joint by its surface."""
    return next(joint for joint in project.joints if joint.surface == target)


def _pressure(project, target):
    """Return the normal pressure on a joint at rest, Pa."""
    return _joint(project, target).insitu_pressure


def _filled(project, target, law, relaxation):
    """Return a project with a viscous law of one joint, of one relaxation time in s."""

    def filled(joint):
        kn, ks = joint.properties["kn"], joint.properties["ks"]
        properties = {"kn": kn, "ks": ks, "eta_n": relaxation * kn, "eta_s": relaxation * ks}
        return replace(joint, law=law, properties=properties)

    return _on_joint(project, target, filled)


@hypothesis(
    "joint_nonlinear_closure",
    family="path",
    on="site",
    target="joint",
    axis="both",
    linear=False,
    simulated=(elastic_joints,),
    decided_by="charges of three to one or more on one path across the joint",
)
def joint_nonlinear_closure(project, target, closed):
    """This joint stiffens as it closes: large blasts cross it more easily, in compression."""

    def closing(joint):
        rest = joint.properties["kn"]
        kn = rest * (1.0 - closed) ** 2
        closure = joint.insitu_pressure * (1.0 - closed) / closed / kn
        properties = {"kn": kn, "ks": joint.properties["ks"], "closure": closure,
                      "kn_max": STIFFEST * rest}  # fmt: skip
        return replace(joint, law="closure", properties=properties)

    return _on_joint(project, target, closing) if _pressure(project, target) > 0.0 else None


def _slipping(project, target, cohesion, friction, residual, **insitu):
    """Return a project with a joint of finite strength, and a residual share of it after slip."""

    def slipping(joint):
        properties = {
            **joint.properties, "cohesion": cohesion, "friction": friction, "tension": NEVER,
            "cohesion_residual": residual * cohesion, "friction_residual": residual * friction,
            "tension_residual": NEVER,
        }  # fmt: skip
        return replace(joint, law="coulomb", properties=properties, **insitu)

    return _on_joint(project, target, slipping)


_SLIP = {
    "family": "path", "on": "site", "target": "joint", "axis": "both", "linear": False,
    "simulated": (elastic_joints,),
    "decided_by": "charges of three to one or more across the joint, and on a path that avoids it",
    "further": (("strength", (1e4, 5e4, 1e5, 5e5)), ("residual", (0.8, 1.0))),
}  # fmt: skip


@hypothesis(
    "joint_slip",
    **_SLIP,
)
def joint_slip(project, target, strength, residual):
    """This joint slips: its shear stress is limited by its strength; large blasts lose S waves."""
    pressure, friction = _pressure(project, target), np.tan(np.radians(30.0))
    cohesion = strength - pressure * friction
    if cohesion < 0.0:  # then none, and less friction
        cohesion, friction = 0.0, strength / pressure
    return _slipping(project, target, cohesion, friction, residual)


@hypothesis(
    "joint_slip",
    form="frictional",
    **_SLIP,
)
def joint_frictional_slip(project, target, strength, residual):
    """This joint slips, by friction alone: its shear strength is a share of its normal stress."""
    pressure = _pressure(project, target)
    return (
        _slipping(project, target, 0.0, strength / pressure, residual) if pressure > 0.0 else None
    )


@hypothesis(
    "joint_slip",
    form="with depth",
    **_SLIP,
)
def joint_slip_with_depth(project, target, strength, residual, growth):
    """This joint slips: its strength grows with depth, as the weight on it less that of water."""
    mesh, friction = project.config.mesh, np.tan(np.radians(30.0))
    middle = mesh.origin_m[2] + 0.5 * mesh.size_m[2]
    insitu = {"insitu_gradient": growth / friction, "insitu_level": middle}
    return _slipping(
        project, target, 0.0, friction, residual, insitu_pressure=strength / friction, **insitu
    )


@hypothesis(
    "joint_viscous_fill",
    family="path",
    on="site",
    target="joint",
    axis="both",
    decided_by="receivers close to the joint on both sides, over a wider band",
    simulated=(elastic_joints,),
)
def joint_viscous_fill(project, target, relaxation):
    """The fill of this joint is viscous: it passes more of high frequencies than a spring does."""
    return _filled(project, target, "kelvin", relaxation)


@hypothesis(
    "joint_viscous_fill",
    form="creeping",
    family="path",
    on="site",
    target="joint",
    axis="both",
    decided_by="receivers close to the joint on both sides, over a wider band",
    simulated=(elastic_joints,),
)
def joint_creeping_fill(project, target, relaxation):
    """The fill of this joint creeps: it passes less than a spring does, of low frequencies too."""
    return _filled(project, target, "maxwell", relaxation)


@hypothesis(
    "attenuation_Q",
    form="along all paths",
    family="path",
    on="motion",
    target="site",
    axis="both",
    decided_by="receivers at distances of three to one, without a joint between them",
    needs=(unknown_quality,),
)
def loss_along_paths(scene, motion, target, loss):
    """Waves lose the same share 1/Q of energy in each cycle, beyond what the model has."""
    del target
    case, n = scene.case, motion.shape[-1]
    size = fft.next_fast_len(3 * n, real=True)
    omega = 2.0 * np.pi * fft.rfftfreq(size, case.dt)
    changed = motion.copy()
    for b, name in enumerate(case.blasts):
        fired = firings_of(case.project.of(name), case.receivers)
        for start, spectrum in hole_parts(motion[b], fired, omega, size):
            part = fft.irfft(spectrum, size, axis=-1)[..., :n]
            changed[b] += part @ _lossy(case.band, case.dt * np.arange(n), start, loss) - part
    return changed


def _lossy(band, times, start, loss):
    """Return the operator (n, n) of a loss 1/Q on what arrives at times, of waves from a start.

    Constant Q (Kjartansson 1979) at first order in the loss, with the speed of the middle of the
    band.
    """
    n = len(times)
    frequency = fft.rfftfreq(2 * n, band.dt)
    clipped = np.clip(frequency, band.low, 2.0 * band.high)
    late = np.log(clipped / np.sqrt(band.low * band.high)) / np.pi
    since = np.maximum(times - start, 0.0)
    lost = np.exp(-np.pi * loss * np.multiply.outer(since, clipped))
    arrival = times[:, None] - np.multiply.outer(since, loss * late)
    return fft.irfft(lost * np.exp(-2j * np.pi * frequency * arrival), 2 * n)[:, :n]
