module pyblast_yielding_zones
    !! What zones that can yield add to the elastic forces of their set; theory.md (2.41), (2.42).
    !!
    !! Patches share their mean strain: their swelling acts on their nodes, all other strain is that
    !! of linear zones. Plastic strain acts as forces of its own, so that ground which stays elastic
    !! costs no more than a look at how far its nodes have moved since it was last judged.
    use pyblast_kinds, only : dp, n_zone_properties, n_zone_state
    use pyblast_lanes, only : lanes
    use pyblast_elasticity, only : hooke_works
    use pyblast_linear_zones, only : add_forces, linear_strains
    use pyblast_zone_laws, only : elastic_stress, zone_rooms, zone_stress
    implicit none
    private
    public :: judge, patch_forces

    real(dp), parameter :: rounding = 1e-12_dp
    real(dp), parameter :: spare = 1e-3_dp     !! of the way that is left unused

contains

    pure subroutine patch_forces(n_slots, n_patches, n_ends, first, last, patch_start, patch_slot, &
                                 patch_gradient, patch_bulk, motion, force)
        !! Add the forces of patches first to last that swell; theory.md (2.41).
        integer, intent(in) :: n_slots, n_patches, n_ends, first, last
        integer, intent(in) :: patch_start(n_patches + 1), patch_slot(n_ends)
        real(dp), intent(in) :: patch_gradient(3, n_ends)    !! dilation over motion [1/m]
        real(dp), intent(in) :: patch_bulk(n_patches)        !! bulk modulus times volume [J]
        real(dp), intent(in) :: motion(lanes, 3, n_slots)    !! [m]
        real(dp), intent(inout) :: force(lanes, 3, n_slots)  !! [N]
        real(dp) :: pull(lanes)
        integer :: p, e, s, l

        do p = first, last
            pull = 0.0_dp
            do e = patch_start(p), patch_start(p + 1) - 1
                s = patch_slot(e)
                !$omp simd
                do l = 1, lanes
                    pull(l) = pull(l) + (motion(l, 1, s)*patch_gradient(1, e) &
                                         + motion(l, 2, s)*patch_gradient(2, e) &
                                         + motion(l, 3, s)*patch_gradient(3, e))
                end do
            end do
            pull = patch_bulk(p)*pull
            do e = patch_start(p), patch_start(p + 1) - 1
                s = patch_slot(e)
                !$omp simd
                do l = 1, lanes
                    force(l, 1, s) = force(l, 1, s) - pull(l)*patch_gradient(1, e)
                    force(l, 2, s) = force(l, 2, s) - pull(l)*patch_gradient(2, e)
                    force(l, 3, s) = force(l, 3, s) - pull(l)*patch_gradient(3, e)
                end do
            end do
        end do
    end subroutine patch_forces

    pure subroutine judge(n_nodes, n_zones, n_slots, n_rows, first, last, law, tell, dt, &
                          slot_node, property, zone_slot, zone_lambda, zone_shear, zone_row, zone_patch, &
                          row_initial, place, u, velocity, row_state, row_lost, watch, room, &
                          force, strain_energy, lost, insitu)
        !! Forces of plastic strain in the lanes whose nodes strayed far enough for zones to yield.
        integer, intent(in) :: n_nodes, n_zones, n_slots, n_rows, first, last, law
        logical, intent(in) :: tell
        real(dp), intent(in) :: dt
        integer, intent(in) :: slot_node(n_slots), zone_slot(n_zones, 4), zone_row(n_zones)
        integer, intent(in) :: zone_patch(n_zones)
        real(dp), intent(in) :: property(n_zone_properties, lanes), zone_lambda(n_zones)
        real(dp), intent(in) :: zone_shear(n_zones), row_initial(6, lanes, n_rows)
        real(dp), intent(in) :: place(3, n_slots), u(lanes, 3, n_slots), velocity(lanes, 3, n_nodes)
        real(dp), intent(inout) :: row_state(n_zone_state, lanes, n_rows), row_lost(lanes, n_rows)
        real(dp), intent(inout) :: watch(lanes, 3, n_slots), room(lanes)
        real(dp), intent(inout) :: force(lanes, 3, n_slots)
        real(dp), intent(inout) :: strain_energy(lanes), lost(lanes), insitu(lanes)
        real(dp) :: far(lanes), pull(3, n_slots), step(3, n_slots)
        logical :: due
        integer :: l

        far = 0.0_dp
        if (any(room > 0.0_dp)) far = stray(n_slots, u, watch)
        do l = 1, lanes
            due = .not. far(l) < room(l)
            if (.not. (due .or. tell)) cycle
            pull = 0.0_dp
            step = 0.0_dp
            if (due) step = dt*velocity(l, :, slot_node)
            call yielding_forces(n_zones, n_slots, n_rows, first, last, l, law, due, tell, &
                                 property(:, l), zone_slot, zone_lambda, zone_shear, zone_row, &
                                 zone_patch, row_initial, place, u(l, :, :), &
                                 step, row_state, row_lost, room(l), pull, strain_energy(l), &
                                 lost(l), insitu(l))
            if (due) watch(l, :, :) = u(l, :, :)
            if (.not. room(l) > 0.0_dp) force(l, :, :) = pull
        end do
    end subroutine judge

    pure function stray(n_slots, motion, watch) result(far)
        !! How far nodes have moved from where they were, besides what the first of them did [m].
        integer, intent(in) :: n_slots
        real(dp), intent(in) :: motion(lanes, 3, n_slots), watch(lanes, 3, n_slots)
        real(dp) :: far(lanes), first(lanes, 3), square
        integer :: s, l

        first = motion(:, :, 1) - watch(:, :, 1)
        far = 0.0_dp
        do s = 2, n_slots
            !$omp simd private(square)
            do l = 1, lanes
                square = (motion(l, 1, s) - watch(l, 1, s) - first(l, 1))**2 &
                    + (motion(l, 2, s) - watch(l, 2, s) - first(l, 2))**2 &
                    + (motion(l, 3, s) - watch(l, 3, s) - first(l, 3))**2
                if (.not. square <= far(l)) far(l) = square
            end do
        end do
        far = sqrt(far)
    end function stray

    pure subroutine yielding_forces(n_zones, n_slots, n_rows, first, last, lane, law, due, tell, &
                                    property, zone_slot, zone_lambda, zone_shear, zone_row, &
                                    zone_patch, row_initial, place, motion, step, row_state, &
                                    row_lost, room, force, strain_energy, lost, insitu)
        !! Judge the zones first to last of one domain, in one lane: let those yield that must, and
        !! find the forces of plastic strain, and how far nodes may move before any other yields.
        integer, intent(in) :: n_zones, n_slots, n_rows, first, last, lane, law
        logical, intent(in) :: due                              !! whether any zone may yield
        logical, intent(in) :: tell                             !! whether energies are wanted
        real(dp), intent(in) :: property(n_zone_properties)
        integer, intent(in) :: zone_slot(n_zones, 4)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones)   !! [Pa]
        integer, intent(in) :: zone_row(n_zones)                !! its memory
        integer, intent(in) :: zone_patch(n_zones)              !! shares its mean strain; or 0
        real(dp), intent(in) :: row_initial(6, lanes, n_rows)   !! stress at no strain [Pa]
        real(dp), intent(in) :: place(3, n_slots), motion(3, n_slots)   !! [m]
        real(dp), intent(in) :: step(3, n_slots)                !! how motion grew in a step [m]
        real(dp), intent(inout) :: row_state(n_zone_state, lanes, n_rows), row_lost(lanes, n_rows)
        real(dp), intent(inout) :: room                         !! 0 where there is plastic strain [m]
        real(dp), intent(inout) :: force(3, n_slots)            !! [N]
        real(dp), intent(inout) :: strain_energy, lost, insitu  !! [J]; told in tell alone
        real(dp) :: strain(first:last, 6), before(first:last, 6), initial(first:last, 6)
        real(dp) :: volume(first:last), reach(first:last), rooms(first:last)
        logical :: yields(first:last)
        integer :: z

        call mean_strains(n_zones, n_slots, first, last, zone_slot, zone_patch, place, motion, &
                          strain, volume, reach)
        do z = first, last
            initial(z, :) = row_initial(:, lane, zone_row(z))
        end do
        if (due) then
            call zone_rooms(law, last - first + 1, property, zone_lambda(first:last), &
                            zone_shear(first:last), initial, strain, rooms)
            room = max(0.0_dp, minval(rooms/reach)*(1.0_dp - spare) - rounding*maxval(abs(motion)))
            do z = first, last
                yields(z) = .not. rooms(z) > 0.0_dp &
                    .or. any(abs(row_state(7:, lane, zone_row(z))) > 0.0_dp)
            end do
            if (any(yields)) then
                room = 0.0_dp
                call mean_strains(n_zones, n_slots, first, last, zone_slot, zone_patch, place, &
                                  motion - step, before, volume, reach)
                do z = first, last
                    if (yields(z)) call flow(law, property, zone_lambda(z), zone_shear(z), &
                                             initial(z, :), before(z, :), strain(z, :), &
                                             row_state(:, lane, zone_row(z)), &
                                             row_lost(lane, zone_row(z)))
                end do
                call plastic_forces(n_zones, n_slots, n_rows, first, last, lane, law, property, &
                                    yields, zone_slot, zone_lambda, zone_shear, zone_row, &
                                    zone_patch, volume, place, row_state, force)
            end if
        end if
        if (tell) call energies(n_zones, n_rows, first, last, lane, room > 0.0_dp, &
                                zone_lambda, zone_shear, zone_row, initial, strain, volume, &
                                row_state, row_lost, strain_energy, lost, insitu)
    end subroutine yielding_forces

    pure subroutine mean_strains(n_zones, n_slots, first, last, zone_slot, zone_patch, place, &
                                 motion, strain, volume, reach)
        !! Strain of zones first to last that share the mean swelling of their patch; (2.32).
        integer, intent(in) :: n_zones, n_slots, first, last
        integer, intent(in) :: zone_slot(n_zones, 4), zone_patch(n_zones)
        real(dp), intent(in) :: place(3, n_slots), motion(3, n_slots)   !! [m]
        real(dp), intent(out) :: strain(first:last, 6), volume(first:last)
        real(dp), intent(out) :: reach(first:last)     !! largest sum of gradients in the patch [1/m]
        real(dp), dimension(0:last - first + 1) :: whole, swell, most
        integer :: z, p

        call linear_strains(n_zones, n_slots, first, last, zone_slot, place, motion, strain, &
                            volume, reach)
        whole = 0.0_dp
        swell = 0.0_dp
        most = 0.0_dp
        do z = first, last
            p = zone_patch(z)
            whole(p) = whole(p) + volume(z)
            swell(p) = swell(p) + volume(z)*(strain(z, 1) + strain(z, 2) + strain(z, 3))
            most(p) = max(most(p), reach(z))
        end do
        do z = first, last
            p = zone_patch(z)
            if (p == 0) cycle
            strain(z, 1:3) = strain(z, 1:3) &
                + (swell(p)/whole(p) - (strain(z, 1) + strain(z, 2) + strain(z, 3)))/3.0_dp
            reach(z) = most(p)
        end do
    end subroutine mean_strains

    pure subroutine flow(law, property, lambda, shear, initial, before, strain, state, lost)
        !! Let one zone yield if it must; its memory and what it lost follow.
        integer, intent(in) :: law
        real(dp), intent(in) :: property(n_zone_properties), lambda, shear
        real(dp), intent(in) :: initial(6), before(6), strain(6)
        real(dp), intent(inout) :: state(n_zone_state), lost
        real(dp) :: stress(6), stored

        state(1:6) = elastic_stress(law, property, lambda, shear, before - state(7:12))
        call zone_stress(law, property, lambda, shear, initial, strain, state, stress, stored, lost)
    end subroutine flow

    pure subroutine plastic_forces(n_zones, n_slots, n_rows, first, last, lane, law, property, &
                                   yields, zone_slot, zone_lambda, zone_shear, zone_row, &
                                   zone_patch, volume, place, row_state, force)
        !! Forces that plastic strain puts on the nodes, mean stress shared by patches; (2.42).
        integer, intent(in) :: n_zones, n_slots, n_rows, first, last, lane, law
        real(dp), intent(in) :: property(n_zone_properties)
        logical, intent(in) :: yields(first:last)
        integer, intent(in) :: zone_slot(n_zones, 4), zone_row(n_zones), zone_patch(n_zones)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones)
        real(dp), intent(in) :: volume(first:last), place(3, n_slots)
        real(dp), intent(in) :: row_state(n_zone_state, lanes, n_rows)
        real(dp), intent(inout) :: force(3, n_slots)
        real(dp), dimension(0:last - first + 1) :: whole, pressure
        real(dp) :: stress(6), mean
        integer :: z, p

        whole = 0.0_dp
        pressure = 0.0_dp
        do z = first, last
            p = zone_patch(z)
            whole(p) = whole(p) + volume(z)
            if (.not. yields(z)) cycle
            stress = -elastic_stress(law, property, zone_lambda(z), zone_shear(z), &
                                     row_state(7:12, lane, zone_row(z)))
            if (p > 0) then
                mean = (stress(1) + stress(2) + stress(3))/3.0_dp
                pressure(p) = pressure(p) + volume(z)*mean
                stress(1:3) = stress(1:3) - mean
            end if
            call add_forces(n_slots, zone_slot(z, :), place, stress, force)
        end do
        do z = first, last
            p = zone_patch(z)
            if (p == 0 .or. .not. abs(pressure(p)) > 0.0_dp) cycle
            stress = 0.0_dp
            stress(1:3) = pressure(p)/whole(p)
            call add_forces(n_slots, zone_slot(z, :), place, stress, force)
        end do
    end subroutine plastic_forces

    pure subroutine energies(n_zones, n_rows, first, last, lane, quiet, &
                             zone_lambda, zone_shear, zone_row, initial, strain, volume, &
                             row_state, row_lost, strain_energy, lost, insitu)
        !! What zones hold, what they lost, and the work of their initial stress.
        integer, intent(in) :: n_zones, n_rows, first, last, lane, zone_row(n_zones)
        logical, intent(in) :: quiet                           !! whether none has ever yielded
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones)
        real(dp), intent(in) :: initial(first:last, 6), strain(first:last, 6), volume(first:last)
        real(dp), intent(in) :: row_state(n_zone_state, lanes, n_rows), row_lost(lanes, n_rows)
        real(dp), intent(out) :: strain_energy, lost, insitu   !! [J]
        real(dp) :: elastic(first:last, 6)
        integer :: z

        elastic = strain
        lost = 0.0_dp
        if (.not. quiet) then
            do z = first, last
                elastic(z, :) = strain(z, :) - row_state(7:12, lane, zone_row(z))
                lost = lost + volume(z)*row_lost(lane, zone_row(z))
            end do
        end if
        call hooke_works(last - first + 1, zone_lambda(first:last), zone_shear(first:last), &
                         initial, elastic, strain, volume, strain_energy, insitu)
    end subroutine energies

end module pyblast_yielding_zones
