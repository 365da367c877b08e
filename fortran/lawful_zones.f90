module pyblast_lawful_zones
    !! Constant-strain tetrahedra one by one, each by the law of its set: anisotropic, or yielding
    !! on patches that share their mean strain.
    use pyblast_kinds, only : dp, n_zone_properties, n_zone_state
    use pyblast_lanes, only : lanes
    use pyblast_elasticity, only : work
    use pyblast_principal_stresses, only : cross
    use pyblast_zone_laws, only : elastic_stress, zone_stress
    implicit none
    private
    public :: lawful_forces

contains

    pure subroutine lawful_forces(n_zones, n_slots, n_rows, lane, law, property, zone_slot, &
                                  zone_lambda, zone_shear, zone_row, zone_patch, row_initial, &
                                  place, motion, damped, lag, row_state, row_lost, force, &
                                  strain_energy, lost, insitu)
        !! Add the corner forces of the zones of one domain, and tell their energies.
        !! Stress is that of the strain of `motion`, and of damping the elastic one of `lag`.
        integer, intent(in) :: n_zones, n_slots, n_rows, lane, law
        real(dp), intent(in) :: property(n_zone_properties)
        integer, intent(in) :: zone_slot(n_zones, 4)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones)   !! [Pa]
        integer, intent(in) :: zone_row(n_zones)                !! its memory; 0 has none
        integer, intent(in) :: zone_patch(n_zones)              !! shares its mean strain; or 0
        real(dp), intent(in) :: row_initial(6, lanes, n_rows)   !! stress at no strain [Pa]
        real(dp), intent(in) :: place(3, n_slots), motion(3, n_slots), lag(3, n_slots)   !! [m]
        logical, intent(in) :: damped                           !! whether there is any lag
        real(dp), intent(inout) :: row_state(n_zone_state, lanes, n_rows), row_lost(lanes, n_rows)
        real(dp), intent(inout) :: force(3, n_slots)            !! [N]
        real(dp), intent(out) :: strain_energy, lost, insitu    !! [J]
        real(dp) :: patch_volume(n_zones), patch_dilation(n_zones), patch_stress(n_zones)
        real(dp) :: gradient(3, 3), volume, strain(6), stress(6), stored, mean
        integer :: z, row, patch

        strain_energy = 0.0_dp
        lost = 0.0_dp
        insitu = 0.0_dp
        patch_stress = 0.0_dp
        call mean_dilation(n_zones, n_slots, place, motion, zone_slot, zone_patch, patch_volume, &
                           patch_dilation)
        do z = 1, n_zones
            row = zone_row(z)
            patch = zone_patch(z)
            call shape_gradients(n_slots, place, zone_slot(z, :), gradient, volume)
            strain = symmetric_gradient(n_slots, motion, zone_slot(z, :), gradient)
            if (patch > 0) strain(1:3) = strain(1:3) &
                + (patch_dilation(patch) - (strain(1) + strain(2) + strain(3)))/3.0_dp
            if (row == 0) then
                stress = elastic_stress(law, property, zone_lambda(z), zone_shear(z), strain)
                strain_energy = strain_energy + 0.5_dp*volume*work(stress, strain)
            else
                call zone_stress(law, property, zone_lambda(z), zone_shear(z), &
                                 row_initial(:, lane, row), strain, row_state(:, lane, row), &
                                 stress, stored, row_lost(lane, row))
                strain_energy = strain_energy + volume*stored
                lost = lost + volume*row_lost(lane, row)
                insitu = insitu + volume*work(row_initial(:, lane, row), strain)
                stress = stress - row_initial(:, lane, row)
            end if
            if (patch > 0) then
                mean = (stress(1) + stress(2) + stress(3))/3.0_dp
                patch_stress(patch) = patch_stress(patch) + volume*mean
                stress(1:3) = stress(1:3) - mean
            end if
            if (damped) then
                strain = symmetric_gradient(n_slots, lag, zone_slot(z, :), gradient)
                stress = stress &
                    + elastic_stress(law, property, zone_lambda(z), zone_shear(z), strain)
            end if
            call add_forces(n_slots, zone_slot(z, :), gradient, volume, stress, force)
        end do
        do z = 1, n_zones
            if (zone_patch(z) == 0) cycle
            call shape_gradients(n_slots, place, zone_slot(z, :), gradient, volume)
            stress = 0.0_dp
            stress(1:3) = patch_stress(zone_patch(z))/patch_volume(zone_patch(z))
            call add_forces(n_slots, zone_slot(z, :), gradient, volume, stress, force)
        end do
    end subroutine lawful_forces

    pure subroutine mean_dilation(n_zones, n_slots, place, motion, zone_slot, zone_patch, &
                                  patch_volume, patch_dilation)
        !! Volume and mean volumetric strain of patches; theory.md (2.32).
        integer, intent(in) :: n_zones, n_slots, zone_slot(n_zones, 4), zone_patch(n_zones)
        real(dp), intent(in) :: place(3, n_slots), motion(3, n_slots)   !! [m]
        real(dp), intent(out) :: patch_volume(n_zones)        !! [m3]
        real(dp), intent(out) :: patch_dilation(n_zones)
        real(dp) :: gradient(3, 3), volume, strain(6)
        integer :: z, p

        patch_volume = 0.0_dp
        patch_dilation = 0.0_dp
        do z = 1, n_zones
            p = zone_patch(z)
            if (p == 0) cycle
            call shape_gradients(n_slots, place, zone_slot(z, :), gradient, volume)
            strain = symmetric_gradient(n_slots, motion, zone_slot(z, :), gradient)
            patch_volume(p) = patch_volume(p) + volume
            patch_dilation(p) = patch_dilation(p) + volume*(strain(1) + strain(2) + strain(3))
        end do
        where (patch_volume > 0.0_dp) patch_dilation = patch_dilation/patch_volume
    end subroutine mean_dilation

    pure subroutine shape_gradients(n_slots, place, slot, gradient, volume)
        !! Gradients of shape functions 2 to 4, columns, and the volume of a zone.
        integer, intent(in) :: n_slots, slot(4)
        real(dp), intent(in) :: place(3, n_slots)
        real(dp), intent(out) :: gradient(3, 3), volume       !! [1/m], [m3]
        real(dp) :: a(3), b(3), c(3), six

        a = place(:, slot(2)) - place(:, slot(1))
        b = place(:, slot(3)) - place(:, slot(1))
        c = place(:, slot(4)) - place(:, slot(1))
        gradient(:, 1) = cross(b, c)
        gradient(:, 2) = cross(c, a)
        gradient(:, 3) = cross(a, b)
        six = dot_product(a, gradient(:, 1))
        gradient = gradient/six
        volume = six/6.0_dp
    end subroutine shape_gradients

    pure function symmetric_gradient(n_slots, motion, slot, gradient) result(strain)
        !! xx yy zz and the engineering shears yz zx xy; theory.md (2.1).
        integer, intent(in) :: n_slots, slot(4)
        real(dp), intent(in) :: motion(3, n_slots), gradient(3, 3)
        real(dp) :: strain(6), d(3, 3)

        d(:, 1) = motion(:, slot(2)) - motion(:, slot(1))
        d(:, 2) = motion(:, slot(3)) - motion(:, slot(1))
        d(:, 3) = motion(:, slot(4)) - motion(:, slot(1))
        d = matmul(d, transpose(gradient))
        strain = [d(1, 1), d(2, 2), d(3, 3), d(2, 3) + d(3, 2), d(3, 1) + d(1, 3), d(1, 2) + d(2, 1)]
    end function symmetric_gradient

    pure subroutine add_forces(n_slots, slot, gradient, volume, stress, force)
        !! f_a = -V stress . grad N_a; the four forces add up to nothing; theory.md (2.3).
        integer, intent(in) :: n_slots, slot(4)
        real(dp), intent(in) :: gradient(3, 3), volume, stress(6)
        real(dp), intent(inout) :: force(3, n_slots)
        real(dp) :: corner(3, 3)
        integer :: k

        do k = 1, 3
            associate (g => gradient(:, k))
                corner(1, k) = -volume*(stress(1)*g(1) + stress(6)*g(2) + stress(5)*g(3))
                corner(2, k) = -volume*(stress(6)*g(1) + stress(2)*g(2) + stress(4)*g(3))
                corner(3, k) = -volume*(stress(5)*g(1) + stress(4)*g(2) + stress(3)*g(3))
            end associate
            force(:, slot(k + 1)) = force(:, slot(k + 1)) + corner(:, k)
        end do
        force(:, slot(1)) = force(:, slot(1)) - (corner(:, 1) + corner(:, 2) + corner(:, 3))
    end subroutine add_forces

end module pyblast_lawful_zones
