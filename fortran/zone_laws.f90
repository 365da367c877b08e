module pyblast_zone_laws
    !! Stress laws of zones: one row and one routine for each law; its place in the table is its
    !! number. The grammar of a row is that of pyblast_joint_laws, but for its KIND:
    !!   linear   the stress is linear in the strain
    !!   yields   linearly elastic until it yields, with a memory then; has_memory says so, too
    !!
    !! Strains are xx yy zz and the engineering shears yz zx xy; tension is positive. A law that
    !! has_memory is total: it gives the whole stress, initial stress included.
    use, intrinsic :: ieee_arithmetic, only : ieee_quiet_nan, ieee_value
    use pyblast_kinds, only : dp, n_zone_properties, n_zone_state, n_row
    use pyblast_elasticity, only : anisotropic, hooke, work
    use pyblast_hoek_brown, only : hoek_brown, hoek_brown_margins
    use pyblast_mohr_coulomb, only : mohr_coulomb, yield_margins
    use pyblast_ubiquitous_joints, only : ubiquitous_joints
    implicit none
    private
    public :: elastic_stress, has_memory, strength_changes, zone_law_signature, zone_stress, &
        zone_yield_margins

    integer, parameter, public :: isotropic_law = 1   !! linear: computed by pyblast_tet4
    character(len=n_row), parameter :: rows(*) = [character(len=n_row) :: &
        "elastic: | linear |", &
        "anisotropic: c11[Pa] > 0, c12[Pa], c13[Pa], c14[Pa], c15[Pa], c16[Pa], c22[Pa] > 0, " // &
            "c23[Pa], c24[Pa], c25[Pa], c26[Pa], c33[Pa] > 0, c34[Pa], c35[Pa], c36[Pa], " // &
            "c44[Pa] > 0, c45[Pa], c46[Pa], c55[Pa] > 0, c56[Pa], c66[Pa] > 0 | linear |", &
        "mohr-coulomb: cohesion[Pa] >= 0, friction[tan] >= 0, " // &
            "dilation[tan] >= 0 <= friction = 0, " // &
            "tension[Pa] >= 0, cohesion_residual[Pa] >= 0 = cohesion, " // &
            "friction_residual[tan] >= 0 = friction, " // &
            "dilation_residual[tan] >= 0 <= friction_residual = dilation, " // &
            "tension_residual[Pa] >= 0 = tension, shear_strain[1] >= 0 = 0, " // &
            "tensile_strain[1] >= 0 = 0 | yields | " // &
            "excess plastic_strain plastic_shear plastic_tension", &
        "hoek-brown: sigci[Pa] in MPa > 0, m[1] > 0, s[1] >= 0, a[1] >= 0.5 <= 1 = 0.5, " // &
            "dilation[tan] >= 0 = 0, tension[Pa] >= 0, m_residual[1] > 0 = m, " // &
            "s_residual[1] >= 0 = s, tension_residual[Pa] >= 0 = tension, " // &
            "shear_strain[1] >= 0 = 0, tensile_strain[1] >= 0 = 0 | yields | " // &
            "excess plastic_strain plastic_shear plastic_tension", &
        "ubiquitous: normal_x[1], normal_y[1], normal_z[1], cohesion[Pa] >= 0, " // &
            "friction[tan] >= 0, dilation[tan] >= 0 <= friction = 0, tension[Pa] >= 0 = 0 " // &
            "| yields | " // &
            "excess plastic_strain slip opening"]
    integer, parameter, public :: n_zone_laws = size(rows)

contains

    pure subroutine zone_law_signature(law, signature)
        !! Return the row of a law, blank beyond the last.
        integer, intent(in) :: law                     !! from 1
        character(len=n_row), intent(out) :: signature

        signature = ""
        if (law >= 1 .and. law <= n_zone_laws) signature = rows(law)
    end subroutine zone_law_signature

    pure function has_memory(law) result(yes)
        !! Tell whether a law depends on more than the strain.
        integer, intent(in) :: law
        logical :: yes

        yes = law >= 3
    end function has_memory

    pure function strength_changes(law, property) result(yes)
        !! Tell whether zones that have yielded may be weaker than zone_yield_margins takes them.
        integer, intent(in) :: law
        real(dp), intent(in) :: property(n_zone_properties)
        logical :: yes

        yes = law /= 3 .or. any(abs(property(5:8) - property(1:4)) > 0.0_dp)
    end function strength_changes

    pure subroutine zone_yield_margins(law, n, property, lambda, shear, initial, strain, yield_margin)
        !! Strain that zones at full strength can gain before one may yield; 0 or less where it may now.
        integer, intent(in) :: law, n
        real(dp), intent(in) :: property(n_zone_properties)
        real(dp), intent(in) :: lambda(n), shear(n)    !! Lame moduli [Pa]
        real(dp), intent(in) :: initial(n, 6)          !! stress at no strain [Pa]
        real(dp), intent(in) :: strain(n, 6)
        real(dp), intent(out) :: yield_margin(n)

        select case (law)
        case (3)
            call yield_margins(n, property, lambda, shear, initial, strain, yield_margin)
        case (4)
            call hoek_brown_margins(n, property, lambda, shear, initial, strain, yield_margin)
        case default
            yield_margin = 0.0_dp
        end select
    end subroutine zone_yield_margins

    pure function elastic_stress(law, property, lambda, shear, strain) result(stress)
        !! Stress of the elastic part of a law, of a strain or of a strain rate.
        integer, intent(in) :: law
        real(dp), intent(in) :: property(n_zone_properties)
        real(dp), intent(in) :: lambda, shear          !! Lame moduli [Pa]
        real(dp), intent(in) :: strain(6)
        real(dp) :: stress(6)

        select case (law)
        case (2)
            stress = anisotropic(property, shear, strain)
        case default
            stress = hooke(lambda, shear, strain)
        end select
    end function elastic_stress

    pure subroutine zone_stress(law, property, lambda, shear, initial, strain, state, stress, &
                                stored, lost)
        !! Stress of one zone by a law that has_memory.
        integer, intent(in) :: law
        real(dp), intent(in) :: property(n_zone_properties)
        real(dp), intent(in) :: lambda, shear          !! Lame moduli [Pa]
        real(dp), intent(in) :: initial(6)             !! stress at no strain [Pa]
        real(dp), intent(in) :: strain(6)
        real(dp), intent(inout) :: state(n_zone_state)
        real(dp), intent(out) :: stress(6)             !! [Pa]
        real(dp), intent(out) :: stored                !! recoverable energy [J/m3]
        real(dp), intent(inout) :: lost                !! dissipated so far [J/m3]

        select case (law)
        case (3)
            call mohr_coulomb(property, lambda, shear, initial, strain, state, stress, stored, lost)
        case (4)
            call hoek_brown(property, lambda, shear, initial, strain, state, stress, stored, lost)
        case (5)
            call ubiquitous_joints(property, lambda, shear, initial, strain, state, stress, stored, &
                                   lost)
        case (1, 2)
            stress = initial + elastic_stress(law, property, lambda, shear, strain)
            stored = 0.5_dp*work(stress - initial, strain) + work(initial, strain)
        case default   ! a row without its case
            stress = ieee_value(lambda, ieee_quiet_nan)
            stored = stress(1)
        end select
    end subroutine zone_stress

end module pyblast_zone_laws
