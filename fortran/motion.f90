module pyblast_motion
    !! Sum of the forces on a node in fixed order, and its step through time.
    use pyblast_kinds, only : dp, least_shared
    use pyblast_lanes, only : lanes
    implicit none
    private
    public :: gather_forces, move_nodes, record_motion, remember, zone_power

    integer, parameter, public :: block_size = 1024   !! nodes whose energies are added together

contains

    subroutine gather_forces(n_nodes, n_parts, n_slots, n_blocks, damped, node_start, node_part, &
                             part_force, node_load, velocity, zone_force, force, block_power, &
                             power)
        !! Constant load of each node plus its parts, in the order of its list: slots, then sides.
        integer, intent(in) :: n_nodes, n_parts, n_slots, n_blocks
        logical, intent(in) :: damped                     !! whether the power of zones is wanted
        integer, intent(in) :: node_start(n_nodes + 1)    !! from 1
        integer, intent(in) :: node_part(n_parts)         !! slot or side of a contact; from 1
        real(dp), intent(in) :: part_force(lanes, 3, n_parts)    !! [N]
        real(dp), intent(in) :: node_load(lanes, 3, n_nodes)     !! [N]
        real(dp), intent(in) :: velocity(lanes, 3, n_nodes)      !! [m/s]
        real(dp), intent(inout) :: zone_force(lanes, 3, n_nodes) !! of slots alone, if damped [N]
        real(dp), intent(inout) :: force(lanes, 3, n_nodes)      !! [N]
        real(dp), intent(inout) :: block_power(lanes, n_blocks)  !! [W]
        real(dp), intent(out) :: power(lanes)                    !! as in zone_power [W]
        real(dp) :: own(lanes, 3), part(lanes, 3)
        integer :: b, n, k

        !$omp parallel do schedule(static) private(n, k, own, part) &
        !$omp& if (lanes*n_nodes >= least_shared)
        do b = 1, n_blocks
            part = 0.0_dp
            do n = (b - 1)*block_size + 1, min(b*block_size, n_nodes)
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
            block_power(:, b) = sum(part, 2)
        end do
        !$omp end parallel do
        power = sum(block_power, 2)
    end subroutine gather_forces

    subroutine zone_power(n_nodes, n_blocks, zone_force, velocity, block_power, power)
        !! Power that the zones take from the motion of the nodes [W].
        integer, intent(in) :: n_nodes, n_blocks
        real(dp), intent(in) :: zone_force(lanes, 3, n_nodes), velocity(lanes, 3, n_nodes)
        real(dp), intent(inout) :: block_power(lanes, n_blocks)
        real(dp), intent(out) :: power(lanes)
        real(dp) :: part(lanes, 3)
        integer :: b, n

        !$omp parallel do schedule(static) private(n, part) if (lanes*n_nodes >= least_shared)
        do b = 1, n_blocks
            part = 0.0_dp
            do n = (b - 1)*block_size + 1, min(b*block_size, n_nodes)
                part = part - zone_force(:, :, n)*velocity(:, :, n)
            end do
            block_power(:, b) = sum(part, 2)
        end do
        !$omp end parallel do
        power = sum(block_power, 2)
    end subroutine zone_power

    subroutine move_nodes(n_nodes, n_blocks, dt, tell, local_damping, node_mass, node_alpha, &
                          force, displacement, velocity, block_energy)
        !! Central differences with mass damping at the mean velocity; theory.md (2.5), (2.6).
        !!
        !! block_energy adds, for each block of nodes, m v_old.v_new/2; m (v_old.v_old +
        !! v_new.v_new)/4; the energy that damping takes on the old and on the new velocity; |force|.
        integer, intent(in) :: n_nodes, n_blocks
        real(dp), intent(in) :: dt                             !! [s]
        logical, intent(in) :: tell                            !! whether all energies are wanted
        real(dp), intent(in) :: local_damping                  !! share of the force; 0 in dynamics
        real(dp), intent(in) :: node_mass(lanes, n_nodes)      !! [kg]
        real(dp), intent(in) :: node_alpha(lanes, n_nodes)     !! mass damping [1/s]
        real(dp), intent(in) :: force(lanes, 3, n_nodes)       !! [N]
        real(dp), intent(inout) :: displacement(lanes, 3, n_nodes)   !! [m]
        real(dp), intent(inout) :: velocity(lanes, 3, n_nodes)       !! [m/s]
        real(dp), intent(inout) :: block_energy(lanes, 5, n_blocks)  !! [J]
        integer :: b, first, last

        !$omp parallel do schedule(static) private(first, last) if (lanes*n_nodes >= least_shared)
        do b = 1, n_blocks
            first = (b - 1)*block_size + 1
            last = min(b*block_size, n_nodes)
            if (tell .or. local_damping > 0.0_dp) then
                call move_damped(last - first + 1, dt, local_damping, node_mass(:, first:last), &
                                 node_alpha(:, first:last), force(:, :, first:last), &
                                 displacement(:, :, first:last), velocity(:, :, first:last), &
                                 block_energy(:, :, b))
            else if (any(node_alpha(:, first:last) > 0.0_dp)) then
                call move_slowed(last - first + 1, dt, node_mass(:, first:last), &
                                 node_alpha(:, first:last), force(:, :, first:last), &
                                 displacement(:, :, first:last), velocity(:, :, first:last), &
                                 block_energy(:, :, b))
            else
                block_energy(:, :, b) = 0.0_dp
                call move_free(last - first + 1, dt, node_mass(:, first:last), &
                               force(:, :, first:last), displacement(:, :, first:last), &
                               velocity(:, :, first:last))
            end if
        end do
        !$omp end parallel do
    end subroutine move_nodes

    pure subroutine move_free(n_nodes, dt, node_mass, force, displacement, velocity)
        !! Move nodes that nothing damps: the bits of move_damped, without the energies.
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: dt, node_mass(lanes, n_nodes), force(lanes, 3, n_nodes)
        real(dp), intent(inout) :: displacement(lanes, 3, n_nodes), velocity(lanes, 3, n_nodes)
        real(dp) :: step(lanes)
        integer :: n, k

        do n = 1, n_nodes
            step = dt/node_mass(:, n)
            do k = 1, 3
                velocity(:, k, n) = velocity(:, k, n) + (step*force(:, k, n))
                displacement(:, k, n) = displacement(:, k, n) + dt*velocity(:, k, n)
            end do
        end do
    end subroutine move_free

    pure subroutine move_slowed(n_nodes, dt, node_mass, node_alpha, force, displacement, velocity, &
                                energy)
        !! Move nodes with mass damping: the bits of move_damped, and the energy that damping takes.
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: dt, node_mass(lanes, n_nodes), node_alpha(lanes, n_nodes)
        real(dp), intent(in) :: force(lanes, 3, n_nodes)
        real(dp), intent(inout) :: displacement(lanes, 3, n_nodes), velocity(lanes, 3, n_nodes)
        real(dp), intent(out) :: energy(lanes, 5)
        real(dp), dimension(lanes, 3) :: part3, part4
        real(dp), dimension(lanes) :: old, new, drag, a, step, share
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
    end subroutine move_slowed

    pure subroutine move_damped(n_nodes, dt, local_damping, node_mass, node_alpha, force, &
                                displacement, velocity, energy)
        !! Move nodes and add up their energies; arguments as in move_nodes.
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: dt, local_damping
        real(dp), intent(in) :: node_mass(lanes, n_nodes), node_alpha(lanes, n_nodes)
        real(dp), intent(in) :: force(lanes, 3, n_nodes)
        real(dp), intent(inout) :: displacement(lanes, 3, n_nodes), velocity(lanes, 3, n_nodes)
        real(dp), intent(out) :: energy(lanes, 5)
        real(dp), dimension(lanes, 3) :: part1, part2, part3, part4
        real(dp), dimension(lanes) :: old, new, drag, a, pull, step, mass, share
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
            pull = 0.0_dp
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
                pull = pull + force(:, k, n)**2
            end do
            energy(:, 5) = energy(:, 5) + sqrt(pull)
        end do
        energy(:, 1) = 0.5_dp*sum(part1, dim=2)
        energy(:, 2) = 0.25_dp*sum(part2, dim=2)
        energy(:, 3) = sum(part3, dim=2)
        energy(:, 4) = sum(part4, dim=2)
    end subroutine move_damped

    subroutine remember(n_nodes, n_memories, dt, memory_rate, displacement, velocity, memory)
        !! Let each memory follow the displacement at its rate, by the trapezoidal rule; (2.17).
        integer, intent(in) :: n_nodes, n_memories
        real(dp), intent(in) :: dt                                !! [s]
        real(dp), intent(in) :: memory_rate(n_memories)           !! [1/s]; 0 is none
        real(dp), intent(in) :: displacement(lanes, 3, n_nodes)   !! after the step [m]
        real(dp), intent(in) :: velocity(lanes, 3, n_nodes)       !! of the step [m/s]
        real(dp), intent(inout) :: memory(lanes, 3, n_memories, n_nodes)   !! [m]
        real(dp) :: both(lanes, 3), share(n_memories)
        integer :: n, k

        if (.not. any(memory_rate > 0.0_dp)) return
        share = 0.5_dp*dt*memory_rate/(1.0_dp + 0.5_dp*dt*memory_rate)
        !$omp parallel do schedule(static) private(k, both) if (lanes*n_nodes >= least_shared)
        do n = 1, n_nodes
            both = 2.0_dp*displacement(:, :, n) - dt*velocity(:, :, n)
            do k = 1, n_memories
                memory(:, :, k, n) = memory(:, :, k, n) &
                    + share(k)*(both - 2.0_dp*memory(:, :, k, n))
            end do
        end do
        !$omp end parallel do
    end subroutine remember

    pure subroutine record_motion(n_nodes, n_corners, n_receivers, receiver_node, receiver_weight, &
                                  velocity, motion)
        !! Velocity at points inside zones, by their shape functions.
        integer, intent(in) :: n_nodes, n_corners, n_receivers
        integer, intent(in) :: receiver_node(n_corners, n_receivers)      !! from 1
        real(dp), intent(in) :: receiver_weight(n_corners, n_receivers)   !! add up to one
        real(dp), intent(in) :: velocity(lanes, 3, n_nodes)        !! [m/s]
        real(dp), intent(out) :: motion(lanes, 3, n_receivers)     !! [m/s]
        integer :: r, k

        do r = 1, n_receivers
            motion(:, :, r) = 0.0_dp
            do k = 1, n_corners
                motion(:, :, r) = motion(:, :, r) &
                    + receiver_weight(k, r)*velocity(:, :, receiver_node(k, r))
            end do
        end do
    end subroutine record_motion

end module pyblast_motion
