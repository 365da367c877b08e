module pyblast_tet4_general
    !! Constant-strain tetrahedra one by one, each by the linear law of its set.
    use pyblast_kinds, only : dp, n_zone_properties
    use pyblast_elasticity, only : work
    use pyblast_tet4, only : tet4_strains, tet4_stress_forces
    use pyblast_zone_laws, only : elastic_stress
    implicit none
    private
    public :: tet4_general_forces

contains

    pure subroutine tet4_general_forces(n_zones, n_slots, first, last, law, property, zone_slot, &
                                  zone_lambda, zone_shear, position, motion, damped, lag, force, &
                                  strain_energy)
        !! Add the corner forces of zones first to last, all of one domain, and with_energy their energy.
        !! Stress is that of the strain of `motion`, and of damping that of `lag`.
        integer, intent(in) :: n_zones, n_slots, first, last, law
        real(dp), intent(in) :: property(n_zone_properties)
        integer, intent(in) :: zone_slot(n_zones, 4)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones)   !! [Pa]
        real(dp), intent(in) :: position(3, n_slots), motion(3, n_slots), lag(3, n_slots)   !! [m]
        logical, intent(in) :: damped                           !! whether there is any lag
        real(dp), intent(inout) :: force(3, n_slots)            !! [N]
        real(dp), intent(out) :: strain_energy                  !! [J]
        real(dp), dimension(first:last, 6) :: strain, more, stress
        real(dp) :: volume(first:last), reach(first:last)
        integer :: z

        strain_energy = 0.0_dp
        call tet4_strains(n_zones, n_slots, first, last, zone_slot, position, motion, strain, &
                            volume, reach)
        if (damped) call tet4_strains(n_zones, n_slots, first, last, zone_slot, position, lag, more, &
                                        volume, reach)
        do z = first, last
            stress(z, :) = elastic_stress(law, property, zone_lambda(z), zone_shear(z), strain(z, :))
            strain_energy = strain_energy + 0.5_dp*volume(z)*work(stress(z, :), strain(z, :))
            if (damped) stress(z, :) = stress(z, :) &
                + elastic_stress(law, property, zone_lambda(z), zone_shear(z), more(z, :))
        end do
        call tet4_stress_forces(n_zones, n_slots, first, last, zone_slot, position, stress, force)
    end subroutine tet4_general_forces

end module pyblast_tet4_general
