"""Rock masses as media: layered, schistose, jointed, saturated, broken (Hoek and Brown)."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..core import ZONE_LAWS
from ..errors import InputError
from ..units import check_modulus
from .material import Material

VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
NAMES = [(i, j) for i in range(6) for j in range(i, 6)]


@dataclass(frozen=True, eq=False)
class Anisotropic:
    """Anisotropic linear elasticity of any symmetry and orientation.

    Parameters
    ----------
    stiffness : (6, 6) float64, Pa
        In the axes of the model; strains xx yy zz and engineering shears yz zx xy.

    Raises
    ------
    InputError
        If the stiffness is not symmetric and positive definite.

    Notes
    -----
    theory.md (2.19). A factor on the shear modulus of a zone scales the whole stiffness.
    """

    stiffness: np.ndarray
    name: ClassVar[str] = "anisotropic"
    branches = ()  # no relaxation

    def __post_init__(self) -> None:
        """Check symmetry and positive definiteness."""
        matrix = np.array(self.stiffness, dtype=np.float64)
        if matrix.shape != (6, 6) or not np.isfinite(matrix).all():
            raise InputError(f"stiffness: must be 6 x 6 finite numbers, got shape {matrix.shape}")
        largest = np.abs(matrix).max()
        if np.abs(matrix - matrix.T).max() > 1e-9 * largest:
            raise InputError(
                f"stiffness: must be symmetric, differs by {np.abs(matrix - matrix.T).max():.3g} Pa"
            )
        least = np.linalg.eigvalsh(matrix)[0]
        if not least > 1e-12 * largest:
            raise InputError(
                f"stiffness: every strain must store energy, least eigenvalue is {least:.3g} Pa; "
                "check the moduli and Poisson's ratios"
            )
        object.__setattr__(self, "stiffness", 0.5 * (matrix + matrix.T))

    def properties(self, material: Material) -> dict[str, float]:
        """Return the 21 constants over the shear modulus of the material."""
        relative = self.stiffness / material.shear
        return {f"c{i + 1}{j + 1}": relative[i, j] for i, j in NAMES}

    def moduli(self, material: Material) -> tuple[float, float]:
        """Return first Lame modulus and shear modulus of the material, Pa."""
        return material.first_lame, material.shear

    def turned(self, rotation: ArrayLike) -> "Anisotropic":
        """Return the medium rotated by a matrix (3, 3)."""
        return Anisotropic(turned_stiffness(self.stiffness, rotation))


def turned_stiffness(stiffness: np.ndarray, rotation: ArrayLike) -> np.ndarray:
    """Return a stiffness (6, 6) rotated by a matrix (3, 3): theory.md (2.20)."""
    full = np.empty((3, 3, 3, 3))
    for i, (a, b) in enumerate(VOIGT):
        for j, (c, d) in enumerate(VOIGT):
            for pair in ((a, b), (b, a)):
                full[(*pair, c, d)] = full[(*pair, d, c)] = stiffness[i, j]
    turned = np.einsum("ia,jb,kc,ld,abcd->ijkl", *[np.asarray(rotation)] * 4, full)
    return np.array([[turned[a, b, c, d] for c, d in VOIGT] for a, b in VOIGT])


def axes_with_normal(normal: ArrayLike) -> np.ndarray:
    """Return a rotation matrix (3, 3) from the z axis to a normal (3,) of any length.

    Raises
    ------
    InputError
        If the normal is zero.
    """
    normal = np.asarray(normal, dtype=float)
    length = np.linalg.norm(normal)
    if normal.shape != (3,) or not (np.isfinite(length) and length > 0.0):
        raise InputError(f"normal: must be three numbers, not all zero, got {normal}")
    third = normal / length
    first = np.cross(np.eye(3)[int(np.abs(third).argmin())], third)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(third, first), third], axis=1)


def anisotropic(density: float, stiffness: ArrayLike, **strength: float) -> Material:
    """Return an anisotropic material.

    Parameters
    ----------
    density : float, kg/m3
    stiffness : (6, 6) float, Pa
        In the axes of the model; strains xx yy zz and engineering shears yz zx xy.
    **strength : float
        Cohesion, friction, tension of `Material`.

    Returns
    -------
    Material
        Its bulk and shear modulus are the Voigt (1928) averages, used for mesh sizes and the
        absorbing layer.

    Raises
    ------
    InputError
        If the stiffness is not symmetric and positive definite.
    """
    law = Anisotropic(np.asarray(stiffness, dtype=float))
    c = law.stiffness
    bulk = c[:3, :3].sum() / 9.0
    shear = (np.trace(c[:3, :3]) - 3.0 * bulk) / 10.0 + np.trace(c[3:, 3:]) / 5.0
    return Material(density, bulk, shear, law=law, **strength)


def transverse(
    density: float,
    normal: ArrayLike,
    *,
    young: float,
    young_normal: float,
    poisson: float,
    poisson_normal: float,
    shear_normal: float,
    **strength: float,
) -> Material:
    """Return a transversely isotropic material: isotropic in the planes across a normal.

    Parameters
    ----------
    density : float, kg/m3
    normal : (3,) float
    young, young_normal : float, Pa
        Young's modulus in the planes and along the normal.
    poisson, poisson_normal : float
        Poisson's ratio within the planes, and for tension along the normal.
    shear_normal : float, Pa
        Shear modulus of planes that slide on one another.
    **strength : float
        Cohesion, friction, tension of `Material`.

    Raises
    ------
    InputError
        If a modulus is not positive or the stiffness not positive definite.
    """
    compliance = np.zeros((6, 6))
    for name, value in (
        ("young", young), ("young_normal", young_normal), ("shear_normal", shear_normal),
    ):  # fmt: skip
        if not 0.0 < value < np.inf:
            raise InputError(f"material.{name}: must be positive, got {value:g} Pa")
        check_modulus(f"material.{name}", value)
    if not -1.0 < poisson < 1.0:
        raise InputError(f"material.poisson: must lie between -1 and 1, got {poisson:g}")
    compliance[:3, :3] = [
        [1.0 / young, -poisson / young, -poisson_normal / young_normal],
        [-poisson / young, 1.0 / young, -poisson_normal / young_normal],
        [-poisson_normal / young_normal, -poisson_normal / young_normal, 1.0 / young_normal],
    ]
    shears = (1.0 / shear_normal, 1.0 / shear_normal, 2.0 * (1.0 + poisson) / young)
    compliance[range(3, 6), range(3, 6)] = shears
    if not np.linalg.eigvalsh(compliance)[0] > 0.0:
        raise InputError(
            f"material.poisson_normal: {poisson_normal:g} with poisson {poisson:g} is not "
            "positive definite; 2 poisson_normal^2 young/young_normal must stay below "
            "1 - poisson"
        )
    stiffness = turned_stiffness(np.linalg.inv(compliance), axes_with_normal(normal))
    return anisotropic(density, stiffness, **strength)


def jointed(
    material: Material, normal: ArrayLike, spacing: float, kn: float, ks: float
) -> Material:
    """Return the effective medium of rock with parallel joints, for wavelengths of ten spacings.

    Parameters
    ----------
    material : Material
        The rock between the joints; may be an effective medium of other joints.
    normal : (3,) float
        Of the joints.
    spacing : float, m
    kn, ks : float, Pa/m

    Returns
    -------
    Material
        Anisotropic, of the same density and strength.

    Raises
    ------
    InputError
        If a value is not positive, or the material is neither elastic nor anisotropic.

    Notes
    -----
    Compliances add: Schoenberg (1980), Schoenberg & Sayers (1995); theory.md (2.21).
    """
    for name, value in (("spacing", spacing), ("kn", kn), ("ks", ks)):
        if not 0.0 < value < np.inf:
            raise InputError(f"jointed.{name}: must be positive, got {value:g}")
    axes = axes_with_normal(normal)
    across = np.linalg.inv(turned_stiffness(stiffness_of(material), axes.T))
    across[2, 2] += 1.0 / (kn * spacing)
    across[3, 3] += 1.0 / (ks * spacing)
    across[4, 4] += 1.0 / (ks * spacing)
    strength = {name: getattr(material, name) for name in ("cohesion", "friction", "tension")}
    stiffness = turned_stiffness(np.linalg.inv(across), axes)
    return anisotropic(material.density, stiffness, **strength)


def stiffness_of(material: Material) -> np.ndarray:
    """Return the stiffness matrix (6, 6) in Pa of an elastic or anisotropic material.

    Raises
    ------
    InputError
        If the material has another law.
    """
    if isinstance(material.law, Anisotropic):
        return material.law.stiffness
    if material.law.name != "elastic" or material.law.branches:
        law = type(material.law).__name__
        raise InputError(f"jointed: the rock must be elastic, got the law {law}")
    lame, shear = material.first_lame, material.shear
    stiffness = np.diag([2.0 * shear] * 3 + [shear] * 3)
    stiffness[:3, :3] += lame
    return stiffness


def christoffel(stiffness: np.ndarray, normal: ArrayLike) -> np.ndarray:
    """Return the Christoffel tensor (..., 3, 3) in Pa for unit normals (..., 3); (2.22)."""
    x, y, z = np.moveaxis(np.asarray(normal, dtype=float), -1, 0)
    o = np.zeros_like(x)
    rows = np.array([[x, o, o, o, z, y], [o, y, o, z, o, x], [o, o, z, y, x, o]])
    along = np.moveaxis(rows, (0, 1), (-2, -1))
    return along @ stiffness @ np.swapaxes(along, -1, -2)


def impedance(density: ArrayLike, stiffness: np.ndarray, normal: ArrayLike) -> np.ndarray:
    """Return the impedance matrix (..., 3, 3) in Pa s/m of waves along unit normals; (2.23).

    The matrix square root of density times `christoffel`.
    """
    squared, direction = np.linalg.eigh(christoffel(stiffness, normal))
    scaled = direction * np.sqrt(np.asarray(density)[..., None, None] * squared[..., None, :])
    return scaled @ np.swapaxes(direction, -1, -2)


@dataclass(frozen=True)
class HoekBrown:
    """Hoek-Brown plasticity with tension cut-off, hardening or softening.

    Largest compression ``sigma1 = sigma3 + sigci (m sigma3/sigci + s)**a``.

    Parameters
    ----------
    sigci : float, Pa
        Uniaxial compressive strength of the intact rock.
    m, s, a : float
        Of the rock mass; see `of_rock_mass`.
    dilation : float
        Tangent of the dilation angle.
    tension : float or None, Pa
        Tensile strength, at most and by default that of the surface, ``s sigci/m``.
    m_residual, s_residual : float or None
    tension_residual : float or None, Pa
        Each is the peak value where not given.
    shear_strain, tensile_strain : float
        Plastic strains over which m and s, and the tension, fall to their residual values.

    Raises
    ------
    InputError
        If a value is out of its range, or the dilation exceeds the friction at high stress.

    Notes
    -----
    E. Hoek, C. Carranza-Torres, B. Corkum, Hoek-Brown failure criterion - 2002 edition, Proc.
    NARMS-TAC, Toronto 2002, 267-273; theory.md (2.49), (2.50). Softening depends on the mesh.

    Examples
    --------
    >>> rock = HoekBrown.of_rock_mass(30e6, 15.0, 50.0, 0.5)
    >>> round(rock.m, 3), round(rock.s, 5), round(rock.a, 3)
    (1.387, 0.00127, 0.506)
    """

    sigci: float
    m: float
    s: float
    a: float = 0.5
    dilation: float = 0.0
    tension: float | None = None
    m_residual: float | None = None
    s_residual: float | None = None
    tension_residual: float | None = None
    shear_strain: float = 0.0
    tensile_strain: float = 0.0
    name: ClassVar[str] = "hoek-brown"
    branches = ()  # no relaxation

    @classmethod
    def of_rock_mass(
        cls, sigci: float, mi: float, gsi: float, disturbance: float = 0.0, **law: float
    ) -> "HoekBrown":
        """Return the law of a rock mass.

        Parameters
        ----------
        sigci : float, Pa
        mi : float
            Of the intact rock.
        gsi : float
            Geological strength index, 0 to 100.
        disturbance : float
            0, undisturbed, to 1, by blasting.
        **law : float
            Other parameters of the law.
        """
        if not 0.0 <= gsi <= 100.0 or not 0.0 <= disturbance <= 1.0 or not mi > 0.0:
            raise InputError(
                "material.gsi: needs gsi from 0 to 100, disturbance from 0 to 1 and a positive "
                f"mi, got {gsi:g}, {disturbance:g} and {mi:g}"
            )
        m = mi * math.exp((gsi - 100.0) / (28.0 - 14.0 * disturbance))
        s = math.exp((gsi - 100.0) / (9.0 - 3.0 * disturbance))
        a = 0.5 + (math.exp(-gsi / 15.0) - math.exp(-20.0 / 3.0)) / 6.0
        return cls(sigci, m, s, a, **law)

    def __post_init__(self) -> None:
        """Check the strengths."""
        ZONE_LAWS[self.name].check("material", vars(self))
        friction = self.equivalent(self.sigci)[1]
        if self.dilation > friction:
            raise InputError(
                f"material.dilation: must not exceed the friction up to sigci, got tangents "
                f"{self.dilation:g} and {friction:g}; dilation above friction creates energy"
            )

    def strength(self, confining: ArrayLike) -> np.ndarray:
        """Return the largest compression in Pa beside confining pressures (n,) in Pa."""
        confining = np.asarray(confining, dtype=float)
        inner = np.maximum(self.m * confining / self.sigci + self.s, 0.0)
        return confining + self.sigci * inner**self.a

    def equivalent(self, largest: float) -> tuple[float, float]:
        """Return cohesion in Pa and friction (tangent) of the fitted Mohr-Coulomb line.

        Parameters
        ----------
        largest : float, Pa
            Confining pressure up to which the line is fitted; equations (12) and (13) of Hoek,
            Carranza-Torres and Corkum (2002).
        """
        a, m, s = self.a, self.m, self.s
        share = largest / self.sigci
        power = (s + m * share) ** (a - 1.0)
        both = (1.0 + a) * (2.0 + a)
        sine = 6.0 * a * m * power / (2.0 * both + 6.0 * a * m * power)
        cohesion = self.sigci * ((1.0 + 2.0 * a) * s + (1.0 - a) * m * share) * power
        cohesion /= both * math.sqrt(1.0 + 6.0 * a * m * power / both)
        return cohesion, sine / math.sqrt(1.0 - sine**2)

    def moduli(self, material: Material) -> tuple[float, float]:
        """Return the elastic Lame moduli, Pa."""
        return material.first_lame, material.shear

    def properties(self, material: Material) -> dict[str, float]:  # noqa: ARG002
        """Return peak and residual strengths for the routine."""
        tip = self.s * self.sigci / self.m
        tension = tip if self.tension is None else min(self.tension, tip)
        return ZONE_LAWS[self.name].complete("material", {**vars(self), "tension": tension})


@dataclass(frozen=True)
class UbiquitousJoints:
    """Elastic rock with parallel planes of weakness everywhere: Coulomb strength, no tension.

    Parameters
    ----------
    normal : tuple of 3 float
        Of the planes.
    cohesion, tension : float, Pa
        The tension is limited to the apex, cohesion over friction.
    friction, dilation : float
        Tangents; the dilation at most the friction.

    Raises
    ------
    InputError
        If a value is out of range; theory.md (2.51), (2.52).
    """

    normal: tuple[float, float, float]
    cohesion: float
    friction: float
    dilation: float = 0.0
    tension: float = 0.0
    name: ClassVar[str] = "ubiquitous"
    branches = ()  # no relaxation

    def __post_init__(self) -> None:
        """Check the strengths."""
        length = float(np.linalg.norm(self.normal))
        if not 0.0 < length < math.inf:
            raise InputError(f"material.normal: must be finite and not zero, got {self.normal}")
        object.__setattr__(self, "normal", tuple(float(x) / length for x in self.normal))
        ZONE_LAWS[self.name].complete("material", self._given())

    def moduli(self, material: Material) -> tuple[float, float]:
        """Return the elastic Lame moduli, Pa."""
        return material.first_lame, material.shear

    def properties(self, material: Material) -> dict[str, float]:  # noqa: ARG002
        """Return the normal and the strengths for the routine."""
        tip = self.cohesion / self.friction if self.friction > 0.0 else math.inf
        return {**self._given(), "tension": min(self.tension, tip)}

    def _given(self):
        """Return the properties as they were given."""
        strength = {k: v for k, v in vars(self).items() if k != "normal"}
        return dict(zip(("normal_x", "normal_y", "normal_z"), self.normal, strict=True)) | strength
