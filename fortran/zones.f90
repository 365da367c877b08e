module pyblast_zones
    !! Nodal forces of the zones, domain by domain.
    !!
    !! A domain is at most a fixed number of neighbouring zones of one set: one law, one damping. It
    !! adds the forces of its zones into slots of its own, one for each of its nodes, so that no sum
    !! depends on the number of threads.
    use pyblast_kinds, only : dp, least_shared, n_quadratic, n_zone_properties, n_zone_state
    use pyblast_lanes, only : lanes
    use pyblast_linear_zones, only : linear_energy, linear_forces
    use pyblast_lane_zones, only : lane_forces
    use pyblast_edges, only : edge_forces
    use pyblast_quadratic_zones, only : quadratic_energy, quadratic_forces
    use pyblast_lawful_zones, only : lawful_forces
    use pyblast_yielding_zones, only : judge, patch_forces
    use pyblast_zone_laws, only : isotropic_law, remembers
    implicit none
    private
    public :: zone_forces

contains

    subroutine zone_forces(n_nodes, n_corners, n_zones, n_domains, n_slots, n_edges, n_skews, &
                           n_patches, n_ends, n_sets, n_rows, n_memories, tell, dt, &
                           domain_zone_start, domain_slot_start, domain_set, slot_node, &
                           slot_place, zone_slot, zone_lambda, zone_shear, zone_row, zone_patch, &
                           set_form, edge_start, edge_slot, edge_spring, skew_start, skew_slot, &
                           skew_spring, domain_patch_start, patch_start, patch_slot, &
                           patch_gradient, patch_bulk, set_law, set_property, set_beta, &
                           set_branch, row_initial, displacement, velocity, memory, row_state, &
                           row_lost, watch, room, slot_force, domain_strain, domain_lost, &
                           domain_insitu)
        !! Forces of all zones into the slots, with the energies of each domain.
        !! Source: theory.md (2.1) to (2.4), (2.14), (2.41) to (2.43).
        integer, intent(in) :: n_nodes, n_domains, n_slots, n_sets, n_rows, n_memories
        integer, intent(in) :: n_corners, n_zones                !! 4 or 15 nodes a zone
        logical, intent(in) :: tell                              !! whether energies are wanted
        real(dp), intent(in) :: dt                               !! [s]
        integer, intent(in), dimension(n_domains + 1) :: domain_zone_start, domain_slot_start  !! from 1
        integer, intent(in) :: domain_set(n_domains)             !! law and damping; from 1
        integer, intent(in) :: slot_node(n_slots)                !! from 1
        real(dp), intent(in) :: slot_place(3, n_slots)           !! from a point of the domain [m]
        integer, intent(in) :: zone_slot(n_zones, n_corners)     !! within the domain, from 1
        real(dp), intent(in) :: zone_lambda(n_zones)             !! first Lame modulus [Pa]
        real(dp), intent(in) :: zone_shear(n_zones)              !! shear modulus [Pa]
        integer, intent(in) :: zone_row(n_zones)                 !! its memory; 0 has none
        integer, intent(in) :: zone_patch(n_zones)               !! shares its mean strain; or 0
        integer, intent(in) :: n_edges, n_skews, n_patches, n_ends
        integer, intent(in) :: set_form(n_sets)      !! 1 zones, 2 edges in batches, 3 edges
        integer, intent(in) :: edge_start(n_slots + 1)           !! from 1
        integer, intent(in) :: edge_slot(n_edges)                !! within the domain, from 1
        real(dp), intent(in) :: edge_spring(6, n_edges)          !! [N/m]
        integer, intent(in) :: skew_start(n_domains + 1)         !! from 1
        integer, intent(in) :: skew_slot(2, n_skews)             !! within the domain, from 1
        real(dp), intent(in) :: skew_spring(3, n_skews)          !! [N/m]
        integer, intent(in) :: domain_patch_start(n_domains + 1) !! from 1
        integer, intent(in) :: patch_start(n_patches + 1)        !! from 1
        integer, intent(in) :: patch_slot(n_ends)                !! within the domain, from 1
        real(dp), intent(in) :: patch_gradient(3, n_ends)        !! [1/m]
        real(dp), intent(in) :: patch_bulk(n_patches)            !! [J]
        integer, intent(in) :: set_law(n_sets)                   !! from 1
        real(dp), intent(in) :: set_property(n_zone_properties, lanes, n_sets)
        real(dp), intent(in) :: set_beta(lanes, n_sets)          !! stiffness damping [s]
        real(dp), intent(in) :: set_branch(lanes, 2, n_memories, n_sets)
            !! springs that relax, over those that stay: of shear, of compression
        real(dp), intent(in) :: row_initial(6, lanes, n_rows)    !! stress at no strain [Pa]
        real(dp), intent(in) :: displacement(lanes, 3, n_nodes)  !! [m]
        real(dp), intent(in) :: velocity(lanes, 3, n_nodes)      !! half a step earlier [m/s]
        real(dp), intent(in) :: memory(lanes, 3, n_memories, n_nodes)   !! what lags behind [m]
        real(dp), intent(inout) :: row_state(n_zone_state, lanes, n_rows)
        real(dp), intent(inout) :: row_lost(lanes, n_rows)       !! dissipated so far [J/m3]
        real(dp), intent(inout) :: watch(lanes, 3, n_slots)
            !! motion when zones were last judged [m]
        real(dp), intent(inout) :: room(lanes, n_domains)
            !! how far nodes may stray from it before zones are judged anew [m]; -1 at first
        real(dp), intent(inout) :: slot_force(lanes, 3, n_slots) !! [N]
        real(dp), intent(inout) :: domain_strain(lanes, n_domains)      !! [J]
        real(dp), intent(inout) :: domain_lost(lanes, n_domains)        !! by yielding [J]
        real(dp), intent(inout) :: domain_insitu(lanes, n_domains)
            !! work of the initial stress [J]
        integer :: d, z1, z2, s1, s2, set

        !$omp parallel do schedule(dynamic) private(z1, z2, s1, s2, set) &
        !$omp& if (lanes*n_nodes >= least_shared)
        do d = 1, n_domains
            z1 = domain_zone_start(d)
            z2 = domain_zone_start(d + 1) - 1
            s1 = domain_slot_start(d)
            s2 = domain_slot_start(d + 1) - 1
            set = domain_set(d)
            call domain_forces(n_nodes, n_corners, n_zones, s2 - s1 + 1, n_edges, n_skews, &
                               n_patches, n_ends, n_rows, n_memories, z1, z2, tell, dt, &
                               slot_node(s1:s2), slot_place(:, s1:s2), zone_slot, zone_lambda, &
                               zone_shear, zone_row, zone_patch, &
                               set_form(set) >= merge(2, 3, lanes > 1), edge_start(s1:s2 + 1), &
                               edge_slot, edge_spring, skew_start(d:d + 1), skew_slot, &
                               skew_spring, domain_patch_start(d:d + 1), patch_start, patch_slot, &
                               patch_gradient, patch_bulk, set_law(set), set_property(:, :, set), &
                               set_beta(:, set), set_branch(:, :, :, set), row_initial, &
                               displacement, velocity, memory, row_state, row_lost, &
                               watch(:, :, s1:s2), room(:, d), slot_force(:, :, s1:s2), &
                               domain_strain(:, d), domain_lost(:, d), domain_insitu(:, d))
        end do
        !$omp end parallel do
    end subroutine zone_forces

    pure subroutine domain_forces(n_nodes, n_corners, n_zones, n_slots, n_edges, n_skews, &
                                  n_patches, n_ends, n_rows, n_memories, first, last, tell, &
                                  dt, slot_node, place, zone_slot, zone_lambda, zone_shear, zone_row, &
                                  zone_patch, edged, edge_start, edge_slot, edge_spring, &
                                  skew_start, skew_slot, skew_spring, first_patch, patch_start, &
                                  patch_slot, patch_gradient, patch_bulk, law, property, beta, &
                                  branch, row_initial, displacement, velocity, memory, row_state, &
                                  row_lost, watch, room, force, strain_energy, lost, insitu)
        !! Forces of zones first to last, one domain; arguments as in zone_forces.
        integer, intent(in) :: n_nodes, n_corners, n_zones, n_slots, n_edges, n_skews, n_patches
        integer, intent(in) :: n_ends, n_rows, n_memories, first, last, law
        logical, intent(in) :: tell, edged
        real(dp), intent(in) :: dt
        integer, intent(in) :: slot_node(n_slots), zone_slot(n_zones, n_corners)
        real(dp), intent(in) :: place(3, n_slots), zone_lambda(n_zones), zone_shear(n_zones)
        integer, intent(in) :: zone_row(n_zones), zone_patch(n_zones), edge_start(n_slots + 1)
        integer, intent(in) :: edge_slot(n_edges), skew_start(2), skew_slot(2, n_skews)
        real(dp), intent(in) :: edge_spring(6, n_edges), skew_spring(3, n_skews)
        integer, intent(in) :: first_patch(2), patch_start(n_patches + 1), patch_slot(n_ends)
        real(dp), intent(in) :: patch_gradient(3, n_ends), patch_bulk(n_patches)
        real(dp), intent(in) :: property(n_zone_properties, lanes), beta(lanes)
        real(dp), intent(in) :: branch(lanes, 2, n_memories), row_initial(6, lanes, n_rows)
        real(dp), intent(in) :: displacement(lanes, 3, n_nodes), velocity(lanes, 3, n_nodes)
        real(dp), intent(in) :: memory(lanes, 3, n_memories, n_nodes)
        real(dp), intent(inout) :: row_state(n_zone_state, lanes, n_rows), row_lost(lanes, n_rows)
        real(dp), intent(inout) :: watch(lanes, 3, n_slots), room(lanes), force(lanes, 3, n_slots)
        real(dp), intent(inout) :: strain_energy(lanes), lost(lanes), insitu(lanes)
        real(dp) :: u(lanes, 3, n_slots), lag(lanes, 3, n_slots, 2), pull(3, n_slots)
        real(dp) :: own(first:merge(last, first - 1, remembers(law) .and. .not. edged))
        integer :: s, l
        logical :: damped, alike

        do s = 1, n_slots
            u(:, :, s) = displacement(:, :, slot_node(s))
        end do
        damped = any(beta > 0.0_dp) .or. any(branch > 0.0_dp)
        alike = remembers(law) .or. .not. any(abs(branch(:, 1, :) - branch(:, 2, :)) > 0.0_dp)
        if (damped) call lags(n_nodes, n_slots, n_memories, slot_node, beta, branch, u, velocity, &
                              memory, lag)
        force = 0.0_dp
        if (remembers(law)) then
            call judge(n_nodes, n_zones, n_slots, n_rows, first, last, law, tell, dt, &
                       slot_node, property, zone_slot, zone_lambda, zone_shear, zone_row, zone_patch, &
                       row_initial, place, u, velocity, row_state, row_lost, watch, room, force, &
                       strain_energy, lost, insitu)
        else if (law /= isotropic_law .and. (tell .or. .not. edged)) then
            do l = 1, lanes
                pull = 0.0_dp
                call lawful_forces(n_zones, n_slots, first, last, law, property(:, l), zone_slot, &
                                   zone_lambda, zone_shear, place, u(l, :, :), damped, &
                                   lag(l, :, :, 1), pull, strain_energy(l))
                if (.not. edged) force(l, :, :) = pull
            end do
            if (.not. edged) return
        end if
        if (damped) then
            lag(:, :, :, 1) = lag(:, :, :, 1) + u
            if (.not. alike) lag(:, :, :, 2) = lag(:, :, :, 2) + u
        else
            lag(:, :, :, 1) = u
            alike = .true.
        end if
        if (size(own) > 0) then
            own = merge(-2.0_dp/3.0_dp*zone_shear(first:last), zone_lambda(first:last), &
                        zone_patch(first:last) > 0)
            call push_zones(n_corners, size(own), n_slots, n_edges, n_skews, 1, size(own), &
                            zone_slot(first:last, :), own, zone_shear(first:last), place, edged, &
                            edge_start, edge_slot, edge_spring, skew_start, skew_slot, &
                            skew_spring, lag(:, :, :, 1), lag(:, :, :, 2), alike, force)
        else
            call push_zones(n_corners, n_zones, n_slots, n_edges, n_skews, first, last, zone_slot, &
                            zone_lambda, zone_shear, place, edged, edge_start, edge_slot, &
                            edge_spring, skew_start, skew_slot, skew_spring, lag(:, :, :, 1), &
                            lag(:, :, :, 2), alike, force)
        end if
        call patch_forces(n_slots, n_patches, n_ends, first_patch(1), first_patch(2) - 1, &
                          patch_start, patch_slot, patch_gradient, patch_bulk, lag(:, :, :, 1), force)
        if (tell .and. law == isotropic_law) &
            call hold_energy(n_nodes, n_corners, n_zones, n_slots, n_memories, first, last, &
                             slot_node, zone_slot, zone_lambda, zone_shear, place, u, memory, &
                             branch, strain_energy)
    end subroutine domain_forces

    pure subroutine push_zones(n_corners, n_zones, n_slots, n_edges, n_skews, first, last, &
                               zone_slot, zone_lambda, zone_shear, place, edged, edge_start, &
                               edge_slot, edge_spring, skew_start, skew_slot, skew_spring, &
                               shearing, swelling, alike, force)
        !! Forces of linear zones, by edges, by zones side by side or by lanes side by side.
        integer, intent(in) :: n_corners, n_zones, n_slots, n_edges, n_skews, first, last
        integer, intent(in) :: zone_slot(n_zones, n_corners)
        logical, intent(in) :: edged
        integer, intent(in) :: edge_start(n_slots + 1), edge_slot(n_edges)
        integer, intent(in) :: skew_start(2), skew_slot(2, n_skews)
        real(dp), intent(in) :: edge_spring(6, n_edges), skew_spring(3, n_skews)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones), place(3, n_slots)
        real(dp), intent(in) :: shearing(lanes, 3, n_slots), swelling(lanes, 3, n_slots)
        logical, intent(in) :: alike
        real(dp), intent(inout) :: force(lanes, 3, n_slots)
        real(dp) :: part(3, n_slots)
        integer :: l

        if (edged) then
            call edge_forces(n_slots, n_edges, n_skews, edge_start, edge_slot, edge_spring, &
                             skew_start(1), skew_start(2) - 1, skew_slot, skew_spring, shearing, &
                             force)
        else if (n_corners == n_quadratic) then
            do l = 1, lanes
                part = 0.0_dp
                call quadratic_forces(n_zones, n_slots, first, last, zone_slot, zone_lambda, &
                                      zone_shear, place, shearing(l, :, :), swelling(l, :, :), &
                                      alike, part)
                force(l, :, :) = part
            end do
        else if (lanes == 1) then
            call linear_forces(n_zones, n_slots, first, last, zone_slot, zone_lambda, zone_shear, &
                               place, shearing, swelling, alike, force)
        else
            call lane_forces(n_zones, n_slots, first, last, zone_slot, zone_lambda, zone_shear, &
                             place, shearing, swelling, alike, force)
        end if
    end subroutine push_zones

    pure subroutine hold_energy(n_nodes, n_corners, n_zones, n_slots, n_memories, first, last, slot_node, &
                                zone_slot, zone_lambda, zone_shear, place, u, memory, branch, &
                                energy)
        !! Energy that linear zones hold in springs that stay and in those that relax; (2.17).
        integer, intent(in) :: n_nodes, n_corners, n_zones, n_slots, n_memories, first, last
        integer, intent(in) :: slot_node(n_slots), zone_slot(n_zones, n_corners)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones), place(3, n_slots)
        real(dp), intent(in) :: u(lanes, 3, n_slots), memory(lanes, 3, n_memories, n_nodes)
        real(dp), intent(in) :: branch(lanes, 2, n_memories)
        real(dp), intent(out) :: energy(lanes)     !! [J]
        integer :: l, k

        do l = 1, lanes
            energy(l) = springs(n_corners, n_zones, n_slots, first, last, zone_slot, zone_lambda, &
                                zone_shear, place, u(l, :, :), [1.0_dp, 1.0_dp])
            do k = 1, n_memories
                if (.not. any(branch(l, :, k) > 0.0_dp)) cycle
                energy(l) = energy(l) &
                    + springs(n_corners, n_zones, n_slots, first, last, zone_slot, zone_lambda, &
                              zone_shear, place, u(l, :, :) - memory(l, :, k, slot_node), &
                              branch(l, :, k))
            end do
        end do
    end subroutine hold_energy

    pure function springs(n_corners, n_zones, n_slots, first, last, zone_slot, zone_lambda, &
                          zone_shear, place, field, share) result(energy)
        !! Energy of one field in springs that have a share of both moduli of the zones [J].
        integer, intent(in) :: n_corners, n_zones, n_slots, first, last
        integer, intent(in) :: zone_slot(n_zones, n_corners)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones)
        real(dp), intent(in) :: place(3, n_slots), field(3, n_slots), share(2)
        real(dp) :: energy

        if (n_corners == n_quadratic) then
            energy = quadratic_energy(n_zones, n_slots, first, last, zone_slot, zone_lambda, &
                                      zone_shear, place, field, share)
        else
            energy = linear_energy(n_zones, n_slots, first, last, zone_slot, zone_lambda, &
                                   zone_shear, place, field, share)
        end if
    end function springs

    pure subroutine lags(n_nodes, n_slots, n_memories, slot_node, beta, branch, u, velocity, &
                         memory, lag)
        !! What damping and memory add to the motion that shear and compression see; (2.14).
        integer, intent(in) :: n_nodes, n_slots, n_memories, slot_node(n_slots)
        real(dp), intent(in) :: beta(lanes), branch(lanes, 2, n_memories), u(lanes, 3, n_slots)
        real(dp), intent(in) :: velocity(lanes, 3, n_nodes), memory(lanes, 3, n_memories, n_nodes)
        real(dp), intent(out) :: lag(lanes, 3, n_slots, 2)
        real(dp) :: shearing(lanes, 3), swelling(lanes, 3), behind(lanes)
        integer :: s, k, n, i, used

        used = merge(n_memories, 0, any(branch > 0.0_dp))
        do s = 1, n_slots
            n = slot_node(s)
            do i = 1, 3
                shearing(:, i) = beta*velocity(:, i, n)
            end do
            swelling = shearing
            do k = 1, used
                do i = 1, 3
                    behind = u(:, i, s) - memory(:, i, k, n)
                    shearing(:, i) = shearing(:, i) + branch(:, 1, k)*behind
                    swelling(:, i) = swelling(:, i) + branch(:, 2, k)*behind
                end do
            end do
            lag(:, :, s, 1) = shearing
            lag(:, :, s, 2) = swelling
        end do
    end subroutine lags

end module pyblast_zones
