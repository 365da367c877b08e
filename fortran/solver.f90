module pyblast_solver
    !! The march through time: the only place that orders the kernels.
    use, intrinsic :: ieee_arithmetic, only : ieee_is_nan, ieee_set_underflow_mode
    use pyblast_kinds, only : dp, n_energies, n_joint_properties, n_joint_state, n_sums, &
        n_zone_properties, n_zone_state
    use pyblast_lanes, only : lanes
    use pyblast_zones, only : zone_forces
    use pyblast_contacts, only : contact_forces
    use pyblast_boundaries, only : load_forces, load_power, reaction_forces, viscous_forces
    use pyblast_motion, only : block_size, gather_forces, move_nodes, record_motion, &
        remember, zone_power
    use pyblast_ledger, only : grows, insitu_work, write_ledger
    implicit none
    private
    public :: advance

    integer, parameter :: double = kind(1.0d0)

contains

    subroutine advance(n_nodes, n_corners, n_zones, n_domains, n_slots, n_edges, n_skews, &
                       n_sets, n_rows, n_memories, n_patches, n_ends, n_parts, n_contacts, n_joints, n_loads, &
                       n_histories, n_dashpots, n_fixed, n_receivers, n_total, n_steps, n_ledger, &
                       first_step, ledger_every, dt, local_damping, &
                       domain_zone_start, domain_slot_start, domain_set, slot_node, slot_place, &
                       zone_slot, zone_lambda, zone_shear, zone_row, zone_patch, set_form, &
                       edge_start, edge_slot, edge_spring, skew_start, skew_slot, skew_spring, &
                       domain_patch_start, patch_start, patch_slot, patch_gradient, patch_bulk, &
                       set_law, set_property, set_beta, set_branch, row_initial, memory_rate, &
                       node_start, node_part, node_mass, node_alpha, node_load, &
                       contact_node, contact_normal, contact_area, contact_joint, &
                       contact_initial, joint_law, joint_property, &
                       load_node, load_vector, load_history, load_delay, load_lane, history, &
                       dashpot_node, dashpot_impedance, dashpot_inverse, &
                       fixed_node, fixed_direction, fixed_history, &
                       receiver_node, receiver_weight, &
                       displacement, velocity, memory, row_state, row_lost, contact_traction, &
                       contact_state, contact_stored, contact_dissipated, sums, &
                       motion, energy, info, where, lane)
        !! March n_steps from first_step; stop early when the motion is no longer finite.
        !! Arguments without a note are those of the kernels that use them.
        integer, intent(in) :: n_nodes, n_zones, n_domains, n_slots, n_sets, n_rows, n_parts
        integer, intent(in) :: n_memories, n_corners, n_edges, n_skews, n_patches, n_ends
        integer, intent(in) :: n_contacts, n_joints, n_loads, n_histories, n_dashpots, n_fixed
        integer, intent(in) :: n_receivers
        integer, intent(in) :: n_total                       !! steps that the histories cover
        integer, intent(in) :: n_steps                       !! steps of this call
        integer, intent(in) :: n_ledger                      !! ledger lines of this call
        integer, intent(in) :: first_step                    !! from 0
        integer, intent(in) :: ledger_every                  !! steps between ledger lines
        real(dp), intent(in) :: dt, local_damping
        integer, intent(in) :: domain_zone_start(n_domains + 1), domain_slot_start(n_domains + 1)
        integer, intent(in) :: domain_set(n_domains), slot_node(n_slots), zone_slot(n_zones, n_corners)
        real(dp), intent(in) :: slot_place(3, n_slots), zone_lambda(n_zones), zone_shear(n_zones)
        integer, intent(in) :: zone_row(n_zones), zone_patch(n_zones), set_law(n_sets)
        integer, intent(in) :: set_form(n_sets), edge_start(n_slots + 1), edge_slot(n_edges)
        integer, intent(in) :: skew_start(n_domains + 1), skew_slot(2, n_skews)
        real(dp), intent(in) :: edge_spring(6, n_edges), skew_spring(3, n_skews)
        integer, intent(in) :: domain_patch_start(n_domains + 1), patch_start(n_patches + 1)
        integer, intent(in) :: patch_slot(n_ends)
        real(dp), intent(in) :: patch_gradient(3, n_ends), patch_bulk(n_patches)
        real(dp), intent(in) :: set_property(n_zone_properties, lanes, n_sets)
        real(dp), intent(in) :: set_beta(lanes, n_sets), set_branch(lanes, 2, n_memories, n_sets)
        real(dp), intent(in) :: row_initial(6, lanes, n_rows), memory_rate(n_memories)
        integer, intent(in) :: node_start(n_nodes + 1), node_part(n_parts)
        real(dp), intent(in) :: node_mass(lanes, n_nodes), node_alpha(lanes, n_nodes)
        real(dp), intent(in) :: node_load(lanes, 3, n_nodes)
        integer, intent(in) :: contact_node(2, n_contacts), contact_joint(n_contacts)
        real(dp), intent(in) :: contact_normal(3, n_contacts), contact_area(n_contacts)
        real(dp), intent(in) :: contact_initial(3, lanes, n_contacts)
        integer, intent(in) :: joint_law(lanes, n_joints)
        real(dp), intent(in) :: joint_property(n_joint_properties, lanes, n_joints)
        integer, intent(in) :: load_node(n_loads), load_history(n_loads), load_lane(n_loads)
        real(dp), intent(in) :: load_vector(3, n_loads), load_delay(n_loads)
        real(dp), intent(in) :: history(n_histories, n_total)  !! amplitude at each step
        integer, intent(in) :: dashpot_node(n_dashpots)
        real(dp), intent(in) :: dashpot_impedance(3, 3, n_dashpots)
        real(dp), intent(in) :: dashpot_inverse(3, 3, lanes, n_dashpots)
        integer, intent(in) :: fixed_node(n_fixed), fixed_history(lanes, n_fixed)
        real(dp), intent(in) :: fixed_direction(3, n_fixed)
        integer, intent(in) :: receiver_node(n_corners, n_receivers)
        real(dp), intent(in) :: receiver_weight(n_corners, n_receivers)
        real(dp), intent(inout) :: displacement(lanes, 3, n_nodes), velocity(lanes, 3, n_nodes)
        real(dp), intent(inout) :: memory(lanes, 3, n_memories, n_nodes)
        real(dp), intent(inout) :: row_state(n_zone_state, lanes, n_rows), row_lost(lanes, n_rows)
        real(dp), intent(inout) :: contact_traction(3, lanes, n_contacts)
        real(dp), intent(inout) :: contact_state(n_joint_state, lanes, n_contacts)
        real(dp), intent(inout) :: contact_stored(lanes, n_contacts)
        real(dp), intent(inout) :: contact_dissipated(lanes, n_contacts)
        real(dp), intent(inout) :: sums(n_sums, lanes)
        real(dp), intent(inout) :: motion(lanes, 3, n_receivers, n_steps)  !! at mid-steps [m/s]
        real(dp), intent(inout) :: energy(n_energies, lanes, n_ledger)     !! [J], last one [-]
        integer, intent(out) :: info    !! steps done if all went well, else minus that number
        integer, intent(out) :: where   !! node of the largest velocity after a failure
        integer, intent(out) :: lane    !! in which it was
        !f2py threadsafe
        real(dp), allocatable :: force(:, :, :), part_force(:, :, :), block_energy(:, :, :)
        real(dp), allocatable :: domain_strain(:, :), domain_lost(:, :), domain_insitu(:, :)
        real(dp), allocatable :: block_power(:, :), load_amplitude(:), watch(:, :, :), room(:, :)
        real(dp), allocatable :: zone_force(:, :, :)
        real(dp) :: before(lanes, 4), after(lanes, 4), insitu(lanes)
        integer :: i, step, l, n_blocks
        logical :: alarm, damped, tell

        n_blocks = (n_nodes + block_size - 1)/block_size
        allocate (force(lanes, 3, n_nodes), part_force(lanes, 3, n_parts))
        allocate (block_energy(lanes, 5, n_blocks), domain_strain(lanes, n_domains))
        allocate (domain_lost(lanes, n_domains), domain_insitu(lanes, n_domains))
        allocate (block_power(lanes, n_blocks), load_amplitude(n_loads))
        allocate (zone_force(lanes, 3, n_nodes))
        allocate (watch(lanes, 3, n_slots), room(lanes, n_domains))
        !$omp parallel
        call ieee_set_underflow_mode(gradual=dp == double)   ! else far ahead of waves all is slow
        !$omp end parallel
        room = -1.0_dp
        domain_lost = 0.0_dp
        domain_insitu = 0.0_dp
        before = 0.0_dp
        after = 0.0_dp
        damped = any(set_beta > 0.0_dp) .or. any(set_branch > 0.0_dp)
        l = 0
        where = 0
        lane = 0
        info = n_steps
        do i = 1, n_steps
            step = first_step + i
            tell = modulo(step - 1, ledger_every) == 0
            call zone_forces(n_nodes, n_corners, n_zones, n_domains, n_slots, n_edges, n_skews, &
                             n_patches, n_ends, n_sets, n_rows, n_memories, &
                             tell, dt, domain_zone_start, domain_slot_start, &
                             domain_set, slot_node, slot_place, zone_slot, zone_lambda, &
                             zone_shear, zone_row, zone_patch, set_form, edge_start, edge_slot, &
                             edge_spring, skew_start, skew_slot, skew_spring, &
                             domain_patch_start, patch_start, patch_slot, patch_gradient, &
                             patch_bulk, set_law, set_property, set_beta, set_branch, &
                             row_initial, displacement, velocity, memory, row_state, row_lost, &
                             watch, room, part_force, domain_strain, domain_lost, domain_insitu)
            call contact_forces(n_nodes, n_contacts, n_joints, dt, contact_node, &
                                contact_normal, contact_area, contact_joint, joint_law, &
                                joint_property, contact_initial, displacement, velocity, &
                                contact_traction, contact_state, contact_stored, &
                                contact_dissipated, part_force(:, :, n_slots + 1:))
            call gather_forces(n_nodes, n_parts, n_slots, n_blocks, damped, node_start, node_part, &
                               part_force, node_load, velocity, zone_force, force, block_power, &
                               before(:, 4))
            call load_forces(n_nodes, n_loads, n_histories, n_total, step, load_node, &
                             load_vector, load_history, load_delay, load_lane, history, &
                             velocity, load_amplitude, force, before(:, 3))
            call viscous_forces(n_nodes, n_dashpots, dt, node_mass, node_alpha, dashpot_node, &
                                dashpot_impedance, dashpot_inverse, velocity, force, &
                                before(:, 2), after(:, 2))
            call reaction_forces(n_nodes, n_fixed, n_histories, dt, node_mass, node_alpha, &
                                 fixed_node, fixed_direction, fixed_history, &
                                 history(:, step), velocity, force, before(:, 1), after(:, 1))
            before(:, 3) = before(:, 1) + 0.5_dp*dt*before(:, 3)
            before(:, 4) = 0.5_dp*dt*before(:, 4)
            if (tell) insitu = insitu_work(n_nodes, n_contacts, node_load, contact_node, &
                                           contact_area, contact_initial, displacement)
            call move_nodes(n_nodes, n_blocks, dt, tell, local_damping, node_mass, node_alpha, &
                            force, displacement, velocity, block_energy)
            call load_power(n_nodes, n_loads, load_node, load_vector, load_lane, load_amplitude, &
                            velocity, after(:, 3))
            after(:, 3) = after(:, 1) + 0.5_dp*dt*after(:, 3)
            if (damped) call zone_power(n_nodes, n_blocks, zone_force, velocity, block_power, &
                                        after(:, 4))
            after(:, 4) = 0.5_dp*dt*after(:, 4)
            call remember(n_nodes, n_memories, dt, memory_rate, displacement, velocity, memory)
            before(:, 1) = sum(block_energy(:, 3, :), 2)
            after(:, 1) = sum(block_energy(:, 4, :), 2)
            call record_motion(n_nodes, n_corners, n_receivers, receiver_node, receiver_weight, velocity, &
                               motion(:, :, :, i))

            if (tell) then
                l = l + 1
                call write_ledger(n_contacts, n_domains, n_blocks, step == 1, damped, &
                                  contact_area, contact_stored, contact_dissipated, &
                                  domain_strain, domain_lost, domain_insitu, block_energy, &
                                  before, insitu, sums, energy(:, :, l))
                do lane = 1, lanes
                    call grows(energy(:, lane, l), sum(block_energy(lane, 2, :)), after(lane, 3), &
                               step == 1, sums(:, lane), alarm)
                    if (.not. alarm) cycle
                    info = -i
                    where = fastest(velocity(lane, :, :))
                    return
                end do
            end if
            sums(1:4, :) = sums(1:4, :) + transpose(before + after)
        end do
    end subroutine advance

    pure function fastest(velocity) result(node)
        !! The node of the largest velocity, or one that is not a number.
        real(dp), intent(in) :: velocity(:, :)
        real(dp) :: speed(size(velocity, 2))
        integer :: node

        speed = norm2(velocity, 1)
        node = maxloc(merge(huge(speed), speed, ieee_is_nan(speed)), 1)
    end function fastest

end module pyblast_solver
