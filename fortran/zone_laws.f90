module pyblast_zone_laws
    !! Stress laws of zones: one number, one signature line and one routine for each law.
    !!
    !! Strains are xx yy zz and the engineering shears yz zx xy; tension is positive. A law that
    !! has_memory is total: it gives the whole stress, initial stress included.
    use pyblast_kinds, only : dp, n_zone_properties, n_zone_state
    use pyblast_elasticity, only : anisotropic, hooke, work
    use pyblast_hoek_brown, only : hoek_brown, hoek_brown_margins
    use pyblast_mohr_coulomb, only : mohr_coulomb, yield_margins
    use pyblast_ubiquitous_joints, only : ubiquitous_joints
    implicit none
    private
    public :: elastic_stress, has_memory, strength_changes, zone_law_signature, zone_stress, &
        zone_yield_margins

    integer, parameter, public :: isotropic_law = 1   !! linear: computed by pyblast_tet4

contains

    pure subroutine zone_law_signature(law, signature)
        !! Say name, properties and state of a law: the table that Python, files and messages use.
        integer, intent(in) :: law                     !! from 1
        character(len=400), intent(out) :: signature   !! "name: properties | state"

        select case (law)
        case (1)
            signature = "elastic: |"
        case (2)
            signature = "anisotropic: c11 c12 c13 c14 c15 c16 c22 c23 c24 c25 c26 c33 c34 c35 " &
                // "c36 c44 c45 c46 c55 c56 c66 |"
        case (3)
            signature = "mohr-coulomb: cohesion friction dilation tension cohesion_residual " &
                // "friction_residual dilation_residual tension_residual shear_strain " &
                // "tensile_strain | excess plastic_strain plastic_shear plastic_tension"
        case (4)
            signature = "hoek-brown: sigci m s a dilation tension m_residual s_residual " &
                // "tension_residual shear_strain tensile_strain | excess plastic_strain " &
                // "plastic_shear plastic_tension"
        case (5)
            signature = "ubiquitous: normal_x normal_y normal_z cohesion friction dilation " &
                // "tension | excess plastic_strain slip opening"
        case default
            signature = ""
        end select
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
        case default
            stress = initial + elastic_stress(law, property, lambda, shear, strain)
            stored = 0.5_dp*work(stress - initial, strain) + work(initial, strain)
        end select
    end subroutine zone_stress

end module pyblast_zone_laws
