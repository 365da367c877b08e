module pyblast_solver
    !! Integration through time: the only place that orders the kernels.
    use, intrinsic :: ieee_arithmetic, only : ieee_get_underflow_mode, ieee_is_nan, &
        ieee_set_underflow_mode
    use omp_lib, only : omp_get_max_threads, omp_get_thread_num
    use pyblast_kinds, only : dp, n_energies
    use pyblast_batch, only : n_batch
    use pyblast_model_types, only : allocate_domain_work, domain_work, model_arrays, &
        model_state, n_clusters, n_zone_parts, nodal_work
    use pyblast_implicit_zones, only : add_implicit_energy, add_layer_to_lines, implicit_forces
    use pyblast_internal_forces, only : zone_forces
    use pyblast_absorbing_layer, only : add_crossing_forces
    use pyblast_contacts, only : contact_forces
    use pyblast_boundaries, only : load_forces, load_power, load_runs, reaction_forces, &
        viscous_forces
    use pyblast_time_stepping, only : block_size, gather_forces, move_nodes, record_motion, &
        update_memory
    use pyblast_energy_balance, only : grows, insitu_work, write_energies
    implicit none
    private
    public :: integrate

    integer, parameter :: double = kind(1.0d0)

    type :: step_work
        !! What one step computes for the balance of energies.
        real(dp) :: before(n_batch, 4), after(n_batch, 4)
            !! half-step work: damping, dashpots, input, on zones [J]; first entries serve reactions
        real(dp) :: insitu(n_batch)                        !! of loads and contacts [J]
    end type step_work

contains

    subroutine integrate(model, state, first_step, ledger_every, motion, energy, info, where, member)
        !! Integrate from first_step; stop early when the motion is no longer finite.
        !! Numbers far ahead of waves underflow, which is slow: in single precision they become zero.
        type(model_arrays), intent(in) :: model
        type(model_state), intent(inout) :: state
        integer, intent(in) :: first_step                  !! from 0
        integer, intent(in) :: ledger_every                !! steps between lines of energies
        real(dp), intent(inout) :: motion(:, :, :, :)
            !! at mid-steps (n_batch, 3, n_receivers, n_steps) [m/s]
        real(dp), intent(inout) :: energy(:, :, :)
            !! (n_energies, n_batch, n_lines) [J], last one [-]
        integer, intent(out) :: info    !! steps done if all went well, else minus that number
        integer, intent(out) :: where   !! node of the largest velocity after a failure
        integer, intent(out) :: member    !! model of the batch in which it was
        logical, allocatable :: gradual(:)
        integer :: thread

        allocate (gradual(0:omp_get_max_threads() - 1))
        !$omp parallel default(none) shared(gradual) private(thread)
        thread = omp_get_thread_num()
        call ieee_get_underflow_mode(gradual(thread))
        call ieee_set_underflow_mode(gradual=dp == double)
        !$omp end parallel
        call take_steps(model, state, first_step, ledger_every, motion, energy, info, where, member)
        !$omp parallel default(none) shared(gradual)
        call ieee_set_underflow_mode(gradual(omp_get_thread_num()))
        !$omp end parallel
    end subroutine integrate

    subroutine take_steps(model, state, first_step, ledger_every, motion, energy, info, where, member)
        !! Take all steps; arguments as in integrate.
        type(model_arrays), intent(in) :: model
        type(model_state), intent(inout) :: state
        integer, intent(in) :: first_step, ledger_every
        real(dp), intent(inout) :: motion(:, :, :, :), energy(:, :, :)
        integer, intent(out) :: info, where, member
        type(nodal_work) :: nodal
        type(domain_work) :: domains
        type(step_work) :: work
        logical :: alarm, damped, with_energy
        integer :: i, step, line

        call allocate_domain_work(model%mesh, model%hexes, domains)
        call allocate_nodal_work(model, nodal)
        work%before = 0.0_dp
        work%after = 0.0_dp
        damped = any(model%ground%set_beta > 0.0_dp) .or. any(model%ground%set_branch > 0.0_dp) &
            .or. model%layer%n_slabs > 0
        line = 0
        where = 0
        member = 0
        info = size(motion, 4)
        do i = 1, size(motion, 4)
            step = first_step + i
            with_energy = modulo(step - 1, ledger_every) == 0
            call take_step(model, state, step, with_energy, damped, nodal, domains, work)
            call record_motion(model%receivers, state%nodes, size(motion, 3), motion(:, :, :, i))
            if (with_energy) then
                line = line + 1
                call write_energies(model%contacts, state, domains, nodal%block_energy, step == 1, &
                                    damped, work%before, work%insitu, energy(:, :, line))
                do member = 1, n_batch
                    call grows(energy(:, member, line), sum(nodal%block_energy(member, 2, :)), &
                               work%after(member, 3), step == 1, state%sums(:, member), alarm)
                    if (.not. alarm) cycle
                    info = -i
                    where = fastest(state%nodes%velocity(member, :, :))
                    return
                end do
            end if
            state%sums(1:4, :) = state%sums(1:4, :) + transpose(work%before + work%after)
        end do
    end subroutine take_steps

    subroutine take_step(model, state, step, with_energy, damped, nodal, domains, work)
        !! One step: forces at the old displacement, the new motion, and the work that was done.
        type(model_arrays), intent(in) :: model
        type(model_state), intent(inout) :: state
        integer, intent(in) :: step                        !! from 1
        logical, intent(in) :: with_energy                 !! whether energies are wanted
        logical, intent(in) :: damped                      !! whether zones are damped
        type(nodal_work), intent(inout) :: nodal
        type(domain_work), intent(inout) :: domains
        type(step_work), intent(inout) :: work
        integer :: n_nodes, n_slots, n_contacts

        n_nodes = size(model%nodes%node_mass, 2)
        n_slots = n_zone_parts(model)
        n_contacts = size(model%contacts%contact_joint)
        associate (dt => model%dt, v => state%nodes%velocity, before => work%before, &
                   after => work%after)
            call zone_forces(model, state%nodes, state%zones, with_energy, domains, n_slots, &
                             nodal%part_force)
            call contact_forces(model%contacts, dt, state%nodes, state%joints, n_contacts, &
                                nodal%part_force(:, :, n_slots + 1:))
            call gather_forces(model, state, n_slots, damped, nodal, before(:, 4))
            if (model%layer%n_slabs > 0) call add_crossing_forces( &
                model%layer, model%contacts, n_nodes, n_slots, n_slots + 2*n_contacts, &
                nodal%part_force, v, state%layer, nodal%force, nodal%zone_force, before(1, 4))
            if (model%layer%n_slabs > 0 .and. n_clusters(model%implicit) > 0) &
                call add_layer_to_lines(model%implicit, n_nodes, model%nodes%node_mass, v, &
                                        state%layer%node_past, nodal%force, nodal%zone_force, &
                                        before(1, 4), nodal%implicit)
            call load_forces(model%loads, nodal%load_start, step, n_nodes, v, nodal%load_force, &
                             nodal%force, before(:, 3))
            if (n_clusters(model%implicit) > 0) call implicit_forces( &
                model%implicit, n_nodes, v, with_energy, nodal%force, nodal%implicit)
            call viscous_forces(model%boundaries, model%nodes, dt, n_nodes, v, nodal%force, &
                                before(:, 2), after(:, 2))
            call reaction_forces(model%boundaries, model%nodes, dt, model%loads%history(:, step), &
                                 n_nodes, v, nodal%force, before(:, 1), after(:, 1))
            before(:, 3) = before(:, 1) + 0.5_dp*dt*before(:, 3)
            before(:, 4) = 0.5_dp*dt*before(:, 4)
            if (with_energy) work%insitu = insitu_work( &
                n_nodes, n_contacts, model%nodes%node_load, model%contacts%contact_node, &
                model%contacts%contact_area, model%contacts%contact_initial, &
                state%nodes%displacement)
            call move_nodes(model, with_energy, damped, state, nodal, after(:, 4))
            if (with_energy .and. n_clusters(model%implicit) > 0) call add_implicit_energy( &
                model%implicit, n_nodes, v, nodal%implicit, nodal%block_energy(:, 1, 1))
            call load_power(model%loads, nodal%load_start, n_nodes, v, nodal%load_force, after(:, 3))
            after(:, 3) = after(:, 1) + 0.5_dp*dt*after(:, 3)
            after(:, 4) = 0.5_dp*dt*after(:, 4)
            call update_memory(model%ground%memory_rate, dt, state%nodes)
            before(:, 1) = sum(nodal%block_energy(:, 3, :), 2)
            after(:, 1) = sum(nodal%block_energy(:, 4, :), 2)
        end associate
    end subroutine take_step

    pure subroutine allocate_nodal_work(model, work)
        !! Allocate the forces of a step and the sums over blocks of nodes.
        type(model_arrays), intent(in) :: model
        type(nodal_work), intent(out) :: work
        integer :: n_nodes, n_blocks, n_held, position(size(model%nodes%node_mass, 2)), b, k

        n_nodes = size(model%nodes%node_mass, 2)
        n_blocks = (n_nodes + block_size - 1)/block_size
        allocate (work%force(n_batch, 3, n_nodes), work%zone_force(n_batch, 3, n_nodes))
        allocate (work%part_force(n_batch, 3, n_zone_parts(model) &
                                  + 2*size(model%contacts%contact_joint)))
        allocate (work%block_energy(n_batch, 5, n_blocks), work%block_power(n_batch, n_blocks))
        work%load_start = load_runs(model%loads%load_node)
        allocate (work%load_force(n_batch, 3, size(work%load_start) - 1))
        allocate (work%layer_start(n_blocks + 1), source=1)
        n_held = merge(size(model%layer%layer_node), 0, model%layer%n_slabs > 0)
        do k = 1, n_held
            b = (model%layer%layer_node(k) - 1)/block_size + 1
            work%layer_start(b + 1) = k + 1
        end do
        do b = 2, n_blocks + 1
            work%layer_start(b) = max(work%layer_start(b), work%layer_start(b - 1))
        end do
        allocate (work%implicit%solution(n_batch, 3, size(model%implicit%implicit_node)))
        allocate (work%implicit%cluster_energy(n_batch, n_clusters(model%implicit)))
        position = 0
        position(model%layer%layer_node(:n_held)) = [(k, k=1, n_held)]
        work%implicit%layer_place = position(model%implicit%implicit_node)
        allocate (work%step_over_mass(n_batch, 3, n_nodes))
        work%step_over_mass = spread(model%dt/model%nodes%node_mass, 2, 3)
    end subroutine allocate_nodal_work

    pure function fastest(velocity) result(node)
        !! The node of the largest velocity, or one that is not a number.
        real(dp), intent(in) :: velocity(:, :)
        real(dp) :: speed(size(velocity, 2))
        integer :: node

        speed = norm2(velocity, 1)
        node = maxloc(merge(huge(speed), speed, ieee_is_nan(speed)), 1)
    end function fastest

end module pyblast_solver
