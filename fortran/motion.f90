module pyblast_motion
    !! Sum of the forces on a node in fixed order, and its step through time.
    use pyblast_kinds, only : dp
    implicit none
    private
    public :: gather_forces, move_nodes, record_motion

    integer, parameter, public :: block_size = 1024   !! nodes whose energies are added together

contains

    subroutine gather_forces(n_nodes, n_parts, node_start, node_part, part_force, node_load, force)
        !! Constant load of each node plus its parts, in the order of its list.
        integer, intent(in) :: n_nodes, n_parts
        integer, intent(in) :: node_start(n_nodes + 1)    !! from 1
        integer, intent(in) :: node_part(n_parts)         !! slot or side of a contact; from 1
        real(dp), intent(in) :: part_force(3, n_parts)    !! [N]
        real(dp), intent(in) :: node_load(3, n_nodes)     !! [N]
        real(dp), intent(inout) :: force(3, n_nodes)      !! [N]
        integer :: n, k

        !$omp parallel do schedule(static) private(k)
        do n = 1, n_nodes
            force(:, n) = node_load(:, n)
            do k = node_start(n), node_start(n + 1) - 1
                force(:, n) = force(:, n) + part_force(:, node_part(k))
            end do
        end do
        !$omp end parallel do
    end subroutine gather_forces

    subroutine move_nodes(n_nodes, n_blocks, dt, local_damping, node_mass, node_alpha, force, &
                          displacement, velocity, block_energy)
        !! Central differences with mass damping at the mean velocity; theory.md (2.5), (2.6).
        !!
        !! block_energy adds, for each block of nodes, m v_old.v_new/2; m (v_old.v_old +
        !! v_new.v_new)/4; the energy that damping takes on the old and on the new velocity; |force|.
        integer, intent(in) :: n_nodes, n_blocks
        real(dp), intent(in) :: dt                             !! [s]
        real(dp), intent(in) :: local_damping                  !! share of the force; 0 in dynamics
        real(dp), intent(in) :: node_mass(n_nodes)             !! [kg]
        real(dp), intent(in) :: node_alpha(n_nodes)            !! mass damping [1/s]
        real(dp), intent(in) :: force(3, n_nodes)              !! [N]
        real(dp), intent(inout) :: displacement(3, n_nodes)    !! [m]
        real(dp), intent(inout) :: velocity(3, n_nodes)        !! [m/s]
        real(dp), intent(inout) :: block_energy(5, n_blocks)   !! [J]
        real(dp) :: old(3), new(3), drag(3), a
        integer :: b, n

        !$omp parallel do schedule(static) private(n, old, new, drag, a)
        do b = 1, n_blocks
            block_energy(:, b) = 0.0_dp
            do n = (b - 1)*block_size + 1, min(b*block_size, n_nodes)
                old = velocity(:, n)
                drag = local_damping*merge(sign(1.0_dp, old), 0.0_dp, abs(old) > 0.0_dp)*abs(force(:, n))
                a = 0.5_dp*dt*node_alpha(n)
                new = ((1.0_dp - a)*old + dt*(force(:, n) - drag)/node_mass(n))/(1.0_dp + a)
                drag = 0.5_dp*dt*drag + 0.5_dp*a*node_mass(n)*(old + new)
                velocity(:, n) = new
                displacement(:, n) = displacement(:, n) + dt*new
                block_energy(1, b) = block_energy(1, b) + 0.5_dp*node_mass(n)*dot_product(old, new)
                block_energy(2, b) = block_energy(2, b) &
                    + 0.25_dp*node_mass(n)*(dot_product(old, old) + dot_product(new, new))
                block_energy(3, b) = block_energy(3, b) + dot_product(drag, old)
                block_energy(4, b) = block_energy(4, b) + dot_product(drag, new)
                block_energy(5, b) = block_energy(5, b) + norm2(force(:, n))
            end do
        end do
        !$omp end parallel do
    end subroutine move_nodes

    pure subroutine record_motion(n_nodes, n_receivers, receiver_node, receiver_weight, velocity, &
                                  motion)
        !! Velocity at points inside zones, linear between the four nodes.
        integer, intent(in) :: n_nodes, n_receivers
        integer, intent(in) :: receiver_node(4, n_receivers)       !! from 1
        real(dp), intent(in) :: receiver_weight(4, n_receivers)    !! add up to one
        real(dp), intent(in) :: velocity(3, n_nodes)               !! [m/s]
        real(dp), intent(out) :: motion(3, n_receivers)            !! [m/s]
        integer :: r, k

        do r = 1, n_receivers
            motion(:, r) = 0.0_dp
            do k = 1, 4
                motion(:, r) = motion(:, r) &
                    + receiver_weight(k, r)*velocity(:, receiver_node(k, r))
            end do
        end do
    end subroutine record_motion

end module pyblast_motion
