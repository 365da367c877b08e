module pyblast_zones
    !! Stress and nodal forces of constant-strain tetrahedra, domain by domain.
    !!
    !! A domain is a fixed number of neighbouring zones. It adds the forces of its zones into slots
    !! of its own, one for each of its nodes, so that no sum depends on the number of threads.
    use pyblast_kinds, only : dp, n_zone_properties, n_zone_state
    use pyblast_elasticity, only : work
    use pyblast_zone_laws, only : elastic_stress, zone_stress
    implicit none
    private
    public :: zone_forces

contains

    subroutine zone_forces(n_nodes, n_zones, n_domains, n_slots, n_sets, n_rows, dt, &
                           domain_zone_start, domain_slot_start, slot_node, zone_slot, &
                           zone_gradient, zone_volume, zone_lambda, zone_shear, zone_beta, &
                           zone_set, zone_row, zone_patch, set_law, set_property, row_initial, &
                           displacement, velocity, row_state, row_lost, slot_force, &
                           domain_strain, domain_lost, domain_insitu, domain_damping)
        !! Forces of all zones into the slots, with the energies of each domain.
        !! Source: theory.md (2.1) to (2.4).
        integer, intent(in) :: n_nodes, n_zones, n_domains, n_slots, n_sets, n_rows
        real(dp), intent(in) :: dt                               !! time step [s]
        integer, intent(in) :: domain_zone_start(n_domains + 1)  !! from 1
        integer, intent(in) :: domain_slot_start(n_domains + 1)  !! from 1
        integer, intent(in) :: slot_node(n_slots)                !! from 1
        integer, intent(in) :: zone_slot(4, n_zones)             !! within the domain, from 1
        real(dp), intent(in) :: zone_gradient(3, 3, n_zones)     !! of shape functions 2 to 4 [1/m]
        real(dp), intent(in) :: zone_volume(n_zones)             !! [m3]
        real(dp), intent(in) :: zone_lambda(n_zones)             !! first Lame modulus [Pa]
        real(dp), intent(in) :: zone_shear(n_zones)              !! shear modulus [Pa]
        real(dp), intent(in) :: zone_beta(n_zones)               !! stiffness damping [s]
        integer, intent(in) :: zone_set(n_zones)                 !! law and properties; from 1
        integer, intent(in) :: zone_row(n_zones)                 !! its memory; 0 has none
        integer, intent(in) :: zone_patch(n_zones)               !! shares its mean strain; or 0
        integer, intent(in) :: set_law(n_sets)                   !! from 1
        real(dp), intent(in) :: set_property(n_zone_properties, n_sets)
        real(dp), intent(in) :: row_initial(6, n_rows)           !! stress at no strain [Pa]
        real(dp), intent(in) :: displacement(3, n_nodes)         !! [m]
        real(dp), intent(in) :: velocity(3, n_nodes)             !! half a step earlier [m/s]
        real(dp), intent(inout) :: row_state(n_zone_state, n_rows)
        real(dp), intent(inout) :: row_lost(n_rows)              !! dissipated so far [J/m3]
        real(dp), intent(inout) :: slot_force(3, n_slots)        !! [N]
        real(dp), intent(inout) :: domain_strain(n_domains)      !! [J]
        real(dp), intent(inout) :: domain_lost(n_domains)        !! [J]
        real(dp), intent(inout) :: domain_insitu(n_domains)      !! work of the initial stress [J]
        real(dp), intent(inout) :: domain_damping(n_domains)     !! [W]
        integer :: d, z1, z2, s1, s2

        !$omp parallel do schedule(dynamic) private(z1, z2, s1, s2)
        do d = 1, n_domains
            z1 = domain_zone_start(d)
            z2 = domain_zone_start(d + 1) - 1
            s1 = domain_slot_start(d)
            s2 = domain_slot_start(d + 1) - 1
            call domain_forces(n_nodes, z2 - z1 + 1, s2 - s1 + 1, n_sets, n_rows, dt, &
                               slot_node(s1:s2), zone_slot(:, z1:z2), zone_gradient(:, :, z1:z2), &
                               zone_volume(z1:z2), zone_lambda(z1:z2), zone_shear(z1:z2), &
                               zone_beta(z1:z2), zone_set(z1:z2), zone_row(z1:z2), &
                               zone_patch(z1:z2), set_law, set_property, row_initial, &
                               displacement, velocity, row_state, row_lost, slot_force(:, s1:s2), &
                               domain_strain(d), domain_lost(d), domain_insitu(d), &
                               domain_damping(d))
        end do
        !$omp end parallel do
    end subroutine zone_forces

    pure subroutine domain_forces(n_nodes, n_zones, n_slots, n_sets, n_rows, dt, slot_node, &
                                  zone_slot, zone_gradient, zone_volume, zone_lambda, &
                                  zone_shear, zone_beta, zone_set, zone_row, zone_patch, &
                                  set_law, set_property, row_initial, displacement, velocity, &
                                  row_state, row_lost, slot_force, strain_energy, lost, &
                                  insitu, damping_power)
        !! Forces of the zones of one domain into its own slots; arguments as in zone_forces.
        integer, intent(in) :: n_nodes, n_zones, n_slots, n_sets, n_rows
        real(dp), intent(in) :: dt
        integer, intent(in) :: slot_node(n_slots), zone_slot(4, n_zones)
        real(dp), intent(in) :: zone_gradient(3, 3, n_zones), zone_volume(n_zones)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones), zone_beta(n_zones)
        integer, intent(in) :: zone_set(n_zones), zone_row(n_zones), zone_patch(n_zones)
        integer, intent(in) :: set_law(n_sets)
        real(dp), intent(in) :: set_property(n_zone_properties, n_sets), row_initial(6, n_rows)
        real(dp), intent(in) :: displacement(3, n_nodes), velocity(3, n_nodes)
        real(dp), intent(inout) :: row_state(n_zone_state, n_rows), row_lost(n_rows)
        real(dp), intent(inout) :: slot_force(3, n_slots), strain_energy, lost, insitu
        real(dp), intent(inout) :: damping_power
        real(dp) :: u(3, n_slots), v(3, n_slots), strain(6), stress(6), rate(6), extra(6)
        real(dp) :: corner_force(3, 4), stored, mean
        real(dp) :: patch_volume(n_zones), patch_dilation(n_zones), patch_stress(n_zones)
        integer :: s, z, k, law, row, patch
        logical :: patched

        do s = 1, n_slots
            u(:, s) = displacement(:, slot_node(s))
            v(:, s) = velocity(:, slot_node(s))
        end do
        slot_force = 0.0_dp
        strain_energy = 0.0_dp
        lost = 0.0_dp
        insitu = 0.0_dp
        damping_power = 0.0_dp
        patched = any(zone_patch > 0)
        if (patched) then
            call mean_dilation(n_zones, n_slots, u, zone_slot, zone_gradient, zone_volume, &
                               zone_patch, patch_volume, patch_dilation)
            patch_stress = 0.0_dp
        end if

        do z = 1, n_zones
            law = set_law(zone_set(z))
            row = zone_row(z)
            patch = zone_patch(z)
            associate (property => set_property(:, zone_set(z)), volume => zone_volume(z))
                strain = symmetric_gradient(u, zone_slot(:, z), zone_gradient(:, :, z), n_slots)
                if (patch > 0) strain(1:3) = strain(1:3) &
                    + (patch_dilation(patch) - (strain(1) + strain(2) + strain(3)))/3.0_dp
                if (row == 0) then
                    stress = elastic_stress(law, property, zone_lambda(z), zone_shear(z), strain)
                    strain_energy = strain_energy + 0.5_dp*volume*work(stress, strain)
                else
                    call zone_stress(law, property, zone_lambda(z), zone_shear(z), dt, &
                                     row_initial(:, row), strain, row_state(:, row), stress, &
                                     stored, row_lost(row))
                    strain_energy = strain_energy + volume*stored
                    lost = lost + volume*row_lost(row)
                    insitu = insitu + volume*work(row_initial(:, row), strain)
                    stress = stress - row_initial(:, row)
                end if
                if (patch > 0) then
                    mean = (stress(1) + stress(2) + stress(3))/3.0_dp
                    patch_stress(patch) = patch_stress(patch) + volume*mean
                    stress(1:3) = stress(1:3) - mean
                end if
                if (zone_beta(z) > 0.0_dp) then
                    rate = symmetric_gradient(v, zone_slot(:, z), zone_gradient(:, :, z), n_slots)
                    extra = zone_beta(z)*elastic_stress(law, property, zone_lambda(z), &
                                                        zone_shear(z), rate)
                    damping_power = damping_power + volume*work(extra, rate)
                    stress = stress + extra
                end if
                corner_force = stress_on_corners(stress, zone_gradient(:, :, z), volume)
            end associate
            do k = 1, 4
                s = zone_slot(k, z)
                slot_force(:, s) = slot_force(:, s) + corner_force(:, k)
            end do
        end do
        if (.not. patched) return
        do z = 1, n_zones
            if (zone_patch(z) == 0) cycle
            stress = 0.0_dp
            stress(1:3) = patch_stress(zone_patch(z))/patch_volume(zone_patch(z))
            corner_force = stress_on_corners(stress, zone_gradient(:, :, z), zone_volume(z))
            do k = 1, 4
                s = zone_slot(k, z)
                slot_force(:, s) = slot_force(:, s) + corner_force(:, k)
            end do
        end do
    end subroutine domain_forces

    pure subroutine mean_dilation(n_zones, n_slots, u, zone_slot, zone_gradient, zone_volume, &
                                  zone_patch, patch_volume, patch_dilation)
        !! Volume and mean volumetric strain of patches; theory.md (2.32).
        integer, intent(in) :: n_zones, n_slots
        real(dp), intent(in) :: u(3, n_slots)                 !! [m]
        integer, intent(in) :: zone_slot(4, n_zones)
        real(dp), intent(in) :: zone_gradient(3, 3, n_zones), zone_volume(n_zones)
        integer, intent(in) :: zone_patch(n_zones)
        real(dp), intent(out) :: patch_volume(n_zones)        !! [m3]
        real(dp), intent(out) :: patch_dilation(n_zones)
        real(dp) :: strain(6)
        integer :: z, p

        patch_volume = 0.0_dp
        patch_dilation = 0.0_dp
        do z = 1, n_zones
            p = zone_patch(z)
            if (p == 0) cycle
            strain = symmetric_gradient(u, zone_slot(:, z), zone_gradient(:, :, z), n_slots)
            patch_volume(p) = patch_volume(p) + zone_volume(z)
            patch_dilation(p) = patch_dilation(p) &
                + zone_volume(z)*(strain(1) + strain(2) + strain(3))
        end do
        where (patch_volume > 0.0_dp) patch_dilation = patch_dilation/patch_volume
    end subroutine mean_dilation

    pure function symmetric_gradient(motion, slot, gradient, n_slots) result(strain)
        !! xx yy zz and the engineering shears yz zx xy; theory.md (2.1).
        integer, intent(in) :: n_slots, slot(4)
        real(dp), intent(in) :: motion(3, n_slots), gradient(3, 3)
        real(dp) :: strain(6), d(3, 3)

        d(:, 1) = motion(:, slot(2)) - motion(:, slot(1))
        d(:, 2) = motion(:, slot(3)) - motion(:, slot(1))
        d(:, 3) = motion(:, slot(4)) - motion(:, slot(1))
        associate (g => gradient)
            strain(1) = d(1, 1)*g(1, 1) + d(1, 2)*g(1, 2) + d(1, 3)*g(1, 3)
            strain(2) = d(2, 1)*g(2, 1) + d(2, 2)*g(2, 2) + d(2, 3)*g(2, 3)
            strain(3) = d(3, 1)*g(3, 1) + d(3, 2)*g(3, 2) + d(3, 3)*g(3, 3)
            strain(4) = d(2, 1)*g(3, 1) + d(2, 2)*g(3, 2) + d(2, 3)*g(3, 3) &
                + d(3, 1)*g(2, 1) + d(3, 2)*g(2, 2) + d(3, 3)*g(2, 3)
            strain(5) = d(3, 1)*g(1, 1) + d(3, 2)*g(1, 2) + d(3, 3)*g(1, 3) &
                + d(1, 1)*g(3, 1) + d(1, 2)*g(3, 2) + d(1, 3)*g(3, 3)
            strain(6) = d(1, 1)*g(2, 1) + d(1, 2)*g(2, 2) + d(1, 3)*g(2, 3) &
                + d(2, 1)*g(1, 1) + d(2, 2)*g(1, 2) + d(2, 3)*g(1, 3)
        end associate
    end function symmetric_gradient

    pure function stress_on_corners(stress, gradient, volume) result(force)
        !! f_a = -V stress . grad N_a; the four forces add up to nothing; theory.md (2.3).
        real(dp), intent(in) :: stress(6), gradient(3, 3), volume
        real(dp) :: force(3, 4)
        integer :: k

        do k = 1, 3
            associate (g => gradient(:, k))
                force(1, k + 1) = -volume*(stress(1)*g(1) + stress(6)*g(2) + stress(5)*g(3))
                force(2, k + 1) = -volume*(stress(6)*g(1) + stress(2)*g(2) + stress(4)*g(3))
                force(3, k + 1) = -volume*(stress(5)*g(1) + stress(4)*g(2) + stress(3)*g(3))
            end associate
        end do
        force(:, 1) = -(force(:, 2) + force(:, 3) + force(:, 4))
    end function stress_on_corners

end module pyblast_zones
