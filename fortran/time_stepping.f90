module pyblast_time_stepping
    !! Sum of the forces on a node in fixed order, and its step through time.
    use pyblast_kinds, only : dp, hex_width, least_shared
    use pyblast_batch, only : n_batch
    use pyblast_model_types, only : model_arrays, model_state, nodal_state, nodal_work, node_arrays, &
        receiver_arrays
    use pyblast_absorbing_layer, only : add_past, follow_step
    implicit none
    private
    public :: gather_forces, move_nodes, record_motion, update_memory

    integer, parameter, public :: block_size = 1024   !! nodes whose energies are added together

contains

    subroutine gather_forces(model, state, n_slots, damped, work, power)
        !! Constant load of each node plus its parts, in the order of its list: slots, then sides;
        !! and what the past of the absorbing layer does.
        type(model_arrays), intent(in) :: model
        type(model_state), intent(in) :: state
        integer, intent(in) :: n_slots             !! parts that come from zones
        logical, intent(in) :: damped              !! whether the power of zones is wanted
        type(nodal_work), intent(inout) :: work
        real(dp), intent(out) :: power(n_batch)    !! that zones and layer take from the motion [W]
        integer :: b, first, last, n_nodes, n_parts

        n_nodes = size(state%nodes%velocity, 3)
        n_parts = size(work%part_force, 3)
        !$omp parallel do schedule(static) default(none) private(first, last) &
        !$omp& shared(model, state, n_nodes, n_parts, n_slots, damped, work) &
        !$omp& if (n_batch*n_nodes >= least_shared)
        do b = 1, size(work%block_power, 2)
            first = (b - 1)*block_size + 1
            last = min(b*block_size, n_nodes)
            associate (nodes => model%nodes, velocity => state%nodes%velocity)
                if (model%hexes%order > 0 .and. n_batch == 1) then
                    call gather_block_of_packs(first, last, n_nodes, n_parts, n_slots, &
                                               size(nodes%node_part), damped, nodes%node_start, &
                                               nodes%node_part, work%part_force, nodes%node_load, &
                                               velocity, work%zone_force, work%force, &
                                               work%block_power(1, b))
                else
                    call gather_block(first, last, n_nodes, n_parts, n_slots, &
                                      size(nodes%node_part), damped, nodes%node_start, &
                                      nodes%node_part, work%part_force, nodes%node_load, velocity, &
                                      work%zone_force, work%force, work%block_power(:, b))
                end if
                call add_past(work%layer_start(b), work%layer_start(b + 1) - 1, &
                              n_nodes, size(model%layer%layer_node), model%layer%layer_node, &
                              velocity, state%layer%node_past, work%force, work%zone_force, &
                              work%block_power(1, b))
            end associate
        end do
        !$omp end parallel do
        power = sum(work%block_power, 2)
    end subroutine gather_forces

    pure subroutine gather_block(first, last, n_nodes, n_parts, n_slots, n_own, damped, node_start, &
                                 node_part, part_force, node_load, velocity, zone_force, force, &
                                 power)
        !! Forces of nodes first to last. Explicit shapes: through components it takes longer.
        integer, intent(in) :: first, last, n_nodes, n_parts, n_slots, n_own
        logical, intent(in) :: damped
        integer, intent(in) :: node_start(n_nodes + 1), node_part(n_own)
        real(dp), intent(in) :: part_force(n_batch, 3, n_parts), node_load(n_batch, 3, n_nodes)
        real(dp), intent(in) :: velocity(n_batch, 3, n_nodes)
        real(dp), intent(inout) :: zone_force(n_batch, 3, n_nodes), force(n_batch, 3, n_nodes)
        real(dp), intent(out) :: power(n_batch)
        real(dp) :: own(n_batch, 3), part(n_batch, 3)
        integer :: n, k

        part = 0.0_dp
        do n = first, last
            own = 0.0_dp
            do k = node_start(n), node_start(n + 1) - 1
                if (node_part(k) > n_slots) exit
                own = own + part_force(:, :, node_part(k))
            end do
            force(:, :, n) = node_load(:, :, n) + own
            if (damped) then
                zone_force(:, :, n) = own
                part = part - own*velocity(:, :, n)
            end if
            do k = k, node_start(n + 1) - 1
                force(:, :, n) = force(:, :, n) + part_force(:, :, node_part(k))
            end do
        end do
        power = sum(part, 2)
    end subroutine gather_block

    pure subroutine gather_block_of_packs(first, last, n_nodes, n_parts, n_slots, n_own, damped, &
                                          node_start, node_part, part_force, node_load, velocity, &
                                          zone_force, force, power)
        !! As gather_block, where the parts of hexahedra are (zone, component, node) of their pack.
        integer, intent(in) :: first, last, n_nodes, n_parts, n_slots, n_own
        logical, intent(in) :: damped
        integer, intent(in) :: node_start(n_nodes + 1), node_part(n_own)
        real(dp), intent(in) :: part_force(3*n_parts), node_load(3, n_nodes), velocity(3, n_nodes)
        real(dp), intent(inout) :: zone_force(3, n_nodes), force(3, n_nodes)
        real(dp), intent(out) :: power
        real(dp) :: x, y, z
        integer :: n, k, at

        power = 0.0_dp
        do n = first, last
            x = 0.0_dp
            y = 0.0_dp
            z = 0.0_dp
            do k = node_start(n), node_start(n + 1) - 1
                if (node_part(k) > n_slots) exit
                at = node_part(k) + 2*(node_part(k) - 1 - iand(node_part(k) - 1, hex_width - 1))
                x = x + part_force(at)
                y = y + part_force(at + hex_width)
                z = z + part_force(at + 2*hex_width)
            end do
            if (damped) then
                zone_force(:, n) = [x, y, z]
                power = power - (x*velocity(1, n) + y*velocity(2, n) + z*velocity(3, n))
            end if
            do k = k, node_start(n + 1) - 1
                at = 3*(node_part(k) - 1)
                x = x + part_force(at + 1)
                y = y + part_force(at + 2)
                z = z + part_force(at + 3)
            end do
            force(1, n) = node_load(1, n) + x
            force(2, n) = node_load(2, n) + y
            force(3, n) = node_load(3, n) + z
        end do
    end subroutine gather_block_of_packs

    pure function power_taken(n_nodes, force, velocity) result(power)
        !! Power that forces take from the motion of some nodes [W].
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: force(n_batch, 3, n_nodes), velocity(n_batch, 3, n_nodes)
        real(dp) :: power(n_batch), part(n_batch, 3)
        integer :: n

        part = 0.0_dp
        do n = 1, n_nodes
            part = part - force(:, :, n)*velocity(:, :, n)
        end do
        power = sum(part, 2)
    end function power_taken

    subroutine move_nodes(model, with_energy, damped, state, work, power)
        !! Central differences with mass damping at the mean velocity; theory.md (2.5), (2.6).
        !!
        !! block_energy adds, for each block of nodes, m v_old.v_new/2; m (v_old.v_old +
        !! v_new.v_new)/4; the energy that damping takes on the old and on the new velocity; |force|.
        type(model_arrays), intent(in) :: model
        logical, intent(in) :: with_energy         !! whether all energies are wanted
        logical, intent(in) :: damped              !! whether the power of zones is wanted
        type(model_state), intent(inout) :: state
        type(nodal_work), intent(inout) :: work
        real(dp), intent(out) :: power(n_batch)    !! that zones and layer take from the new motion [W]
        integer :: b, n_nodes

        n_nodes = size(state%nodes%velocity, 3)
        if (.not. damped) work%block_power = 0.0_dp
        !$omp parallel do schedule(static) default(none) &
        !$omp& shared(model, with_energy, damped, state, work, n_nodes) &
        !$omp& if (n_batch*n_nodes >= least_shared)
        do b = 1, size(work%block_power, 2)
            call move_block_in_layer(b, min(b*block_size, n_nodes), model, with_energy, damped, &
                                     state, work)
        end do
        !$omp end parallel do
        power = sum(work%block_power, 2)
    end subroutine move_nodes

    pure subroutine move_block_in_layer(b, last, model, with_energy, damped, state, work)
        !! Move block b of the nodes, and let the memory of the absorbing layer follow.
        integer, intent(in) :: b, last
        type(model_arrays), intent(in) :: model
        logical, intent(in) :: with_energy, damped
        type(model_state), intent(inout) :: state
        type(nodal_work), intent(inout) :: work
        real(dp) :: before(3, block_size)
        integer :: first, k, in_layer

        first = (b - 1)*block_size + 1
        associate (layer => model%layer, velocity => state%nodes%velocity, start => work%layer_start)
            in_layer = start(b + 1) - start(b)
            do k = 1, in_layer
                before(:, k) = velocity(1, :, layer%layer_node(start(b) - 1 + k))
            end do
            call move_block(b, last, model%nodes, model%dt, model%local_damping, with_energy, &
                            state%nodes, work)
            if (in_layer > 0) call follow_step(layer, start(b), start(b + 1) - 1, model%dt, &
                                               size(velocity, 3), velocity, before, state%layer)
            if (damped) work%block_power(:, b) = power_taken( &
                last - first + 1, work%zone_force(:, :, first:last), velocity(:, :, first:last))
        end associate
    end subroutine move_block_in_layer

    pure subroutine move_block(b, last, nodes, dt, local_damping, with_energy, state, work)
        !! Move block b of the nodes, adding up no more energies than are wanted.
        integer, intent(in) :: b, last
        type(node_arrays), intent(in) :: nodes
        real(dp), intent(in) :: dt, local_damping
        logical, intent(in) :: with_energy
        type(nodal_state), intent(inout) :: state
        type(nodal_work), intent(inout) :: work
        integer :: first, n

        first = (b - 1)*block_size + 1
        n = last - first + 1
        if (with_energy .or. local_damping > 0.0_dp) then
            call move_with_energies(n, dt, local_damping, nodes%node_mass(:, first:last), &
                                    nodes%node_alpha(:, first:last), work%force(:, :, first:last), &
                                    state%displacement(:, :, first:last), &
                                    state%velocity(:, :, first:last), work%block_energy(:, :, b))
        else if (any_positive(n, nodes%node_alpha(:, first:last))) then
            call move_with_mass_damping(n, dt, nodes%node_mass(:, first:last), &
                                        nodes%node_alpha(:, first:last), &
                                        work%force(:, :, first:last), &
                                        state%displacement(:, :, first:last), &
                                        state%velocity(:, :, first:last), &
                                        work%block_energy(:, :, b))
        else
            work%block_energy(:, :, b) = 0.0_dp
            call move_free(n, dt, work%step_over_mass(:, :, first:last), work%force(:, :, first:last), &
                           state%displacement(:, :, first:last), state%velocity(:, :, first:last))
        end if
    end subroutine move_block

    pure function any_positive(n_nodes, value) result(yes)
        !! Whether any value is above zero.
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: value(n_batch, n_nodes)
        logical :: yes

        yes = any(value > 0.0_dp)
    end function any_positive

    pure subroutine move_free(n_nodes, dt, step_over_mass, force, displacement, velocity)
        !! Move nodes that nothing damps: the bits of move_with_energies, without the energies.
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: dt
        real(dp), dimension(3*n_batch*n_nodes), intent(in) :: step_over_mass, force
        real(dp), dimension(3*n_batch*n_nodes), intent(inout) :: displacement, velocity
        integer :: k

        do k = 1, 3*n_batch*n_nodes
            velocity(k) = velocity(k) + (step_over_mass(k)*force(k))
            displacement(k) = displacement(k) + dt*velocity(k)
        end do
    end subroutine move_free

    pure subroutine move_with_mass_damping(n_nodes, dt, node_mass, node_alpha, force, displacement, velocity, &
                                energy)
        !! Move nodes with mass damping: the bits of move_with_energies, and the energy that damping takes.
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: dt, node_mass(n_batch, n_nodes), node_alpha(n_batch, n_nodes)
        real(dp), intent(in) :: force(n_batch, 3, n_nodes)
        real(dp), intent(inout) :: displacement(n_batch, 3, n_nodes), velocity(n_batch, 3, n_nodes)
        real(dp), intent(out) :: energy(n_batch, 5)
        real(dp), dimension(n_batch, 3) :: part3, part4
        real(dp), dimension(n_batch) :: old, new, drag, a, step, share
        integer :: n, k

        part3 = 0.0_dp
        part4 = 0.0_dp
        do n = 1, n_nodes
            a = 0.5_dp*dt*node_alpha(:, n)
            step = dt/node_mass(:, n)
            share = 1.0_dp/(1.0_dp + a)
            do k = 1, 3
                old = velocity(:, k, n)
                new = ((1.0_dp - a)*old + (step*force(:, k, n)))*share
                drag = 0.5_dp*(a*node_mass(:, n)*(old + new))
                velocity(:, k, n) = new
                displacement(:, k, n) = displacement(:, k, n) + dt*new
                part3(:, k) = part3(:, k) + drag*old
                part4(:, k) = part4(:, k) + drag*new
            end do
        end do
        energy = 0.0_dp
        energy(:, 3) = sum(part3, dim=2)
        energy(:, 4) = sum(part4, dim=2)
    end subroutine move_with_mass_damping

    pure subroutine move_with_energies(n_nodes, dt, local_damping, node_mass, node_alpha, force, &
                                displacement, velocity, energy)
        !! Move nodes and add up their energies; arguments as in move_nodes.
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: dt, local_damping
        real(dp), intent(in) :: node_mass(n_batch, n_nodes), node_alpha(n_batch, n_nodes)
        real(dp), intent(in) :: force(n_batch, 3, n_nodes)
        real(dp), intent(inout) :: displacement(n_batch, 3, n_nodes), velocity(n_batch, 3, n_nodes)
        real(dp), intent(out) :: energy(n_batch, 5)
        real(dp), dimension(n_batch, 3) :: part1, part2, part3, part4
        real(dp), dimension(n_batch) :: old, new, drag, a, square, step, mass, share
        integer :: n, k

        part1 = 0.0_dp
        part2 = 0.0_dp
        part3 = 0.0_dp
        part4 = 0.0_dp
        energy(:, 5) = 0.0_dp
        do n = 1, n_nodes
            mass = node_mass(:, n)
            a = 0.5_dp*dt*node_alpha(:, n)
            step = dt/mass
            share = 1.0_dp/(1.0_dp + a)
            square = 0.0_dp
            do k = 1, 3
                old = velocity(:, k, n)
                drag = local_damping*merge(sign(1.0_dp, old), 0.0_dp, abs(old) > 0.0_dp) &
                    *abs(force(:, k, n))
                new = ((1.0_dp - a)*old + (step*(force(:, k, n) - drag)))*share
                drag = 0.5_dp*(dt*drag + a*mass*(old + new))
                velocity(:, k, n) = new
                displacement(:, k, n) = displacement(:, k, n) + dt*new
                part1(:, k) = part1(:, k) + mass*(old*new)
                part2(:, k) = part2(:, k) + mass*(old**2 + new**2)
                part3(:, k) = part3(:, k) + drag*old
                part4(:, k) = part4(:, k) + drag*new
                square = square + force(:, k, n)**2
            end do
            energy(:, 5) = energy(:, 5) + sqrt(square)
        end do
        energy(:, 1) = 0.5_dp*sum(part1, dim=2)
        energy(:, 2) = 0.25_dp*sum(part2, dim=2)
        energy(:, 3) = sum(part3, dim=2)
        energy(:, 4) = sum(part4, dim=2)
    end subroutine move_with_energies

    subroutine update_memory(rate, dt, state)
        !! Let each memory follow the displacement at its rate, by the trapezoidal rule; (2.17).
        real(dp), intent(in) :: rate(:)                !! (n_memories) [1/s]; 0 is none
        real(dp), intent(in) :: dt                     !! [s]
        type(nodal_state), intent(inout) :: state      !! displacement after the step
        real(dp) :: share(size(rate))
        integer :: b, first, last, n_nodes

        if (.not. any(rate > 0.0_dp)) return
        n_nodes = size(state%velocity, 3)
        share = 0.5_dp*dt*rate/(1.0_dp + 0.5_dp*dt*rate)
        !$omp parallel do schedule(static) default(none) private(first, last) &
        !$omp& shared(state, dt, share, n_nodes) if (n_batch*n_nodes >= least_shared)
        do b = 1, (n_nodes + block_size - 1)/block_size
            first = (b - 1)*block_size + 1
            last = min(b*block_size, n_nodes)
            call follow(size(share), last - first + 1, dt, share, &
                        state%displacement(:, :, first:last), state%velocity(:, :, first:last), &
                        state%memory(:, :, :, first:last))
        end do
        !$omp end parallel do
    end subroutine update_memory

    pure subroutine follow(n_memories, n_nodes, dt, share, displacement, velocity, memory)
        !! Let the memories of some nodes follow their displacement.
        integer, intent(in) :: n_memories, n_nodes
        real(dp), intent(in) :: dt, share(n_memories)
        real(dp), intent(in) :: displacement(n_batch, 3, n_nodes), velocity(n_batch, 3, n_nodes)
        real(dp), intent(inout) :: memory(n_batch, 3, n_memories, n_nodes)
        real(dp) :: twice(n_batch, 3)
        integer :: n, k

        do n = 1, n_nodes
            twice = 2.0_dp*displacement(:, :, n) - dt*velocity(:, :, n)
            do k = 1, n_memories
                memory(:, :, k, n) = memory(:, :, k, n) &
                    + share(k)*(twice - 2.0_dp*memory(:, :, k, n))
            end do
        end do
    end subroutine follow

    pure subroutine record_motion(receivers, state, n_receivers, motion)
        !! Velocity at points inside zones, by their shape functions.
        type(receiver_arrays), intent(in) :: receivers
        type(nodal_state), intent(in) :: state
        integer, intent(in) :: n_receivers
        real(dp), intent(out) :: motion(n_batch, 3, n_receivers)   !! [m/s]
        integer :: r, k

        do r = 1, n_receivers
            motion(:, :, r) = 0.0_dp
            do k = 1, size(receivers%receiver_node, 1)
                motion(:, :, r) = motion(:, :, r) + receivers%receiver_weight(k, r) &
                    *state%velocity(:, :, receivers%receiver_node(k, r))
            end do
        end do
    end subroutine record_motion

end module pyblast_time_stepping
