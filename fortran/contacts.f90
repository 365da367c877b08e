module pyblast_contacts
    !! Relative motion across joints, tractions by the law of each joint, forces on both sides.
    use pyblast_kinds, only : dp, least_shared, n_joint_properties, n_joint_state
    use pyblast_batch, only : n_batch
    use pyblast_joint_coulomb, only : held_tractions
    use pyblast_joint_laws, only : joint_traction
    use pyblast_model_types, only : contact_arrays, joint_state, nodal_state
    implicit none
    private
    public :: contact_forces, stored_at_rest

    integer, parameter :: block_size = 256   !! contacts that one thread computes in a row

contains

    subroutine contact_forces(contacts, dt, nodes, joints, n_contacts, force)
        !! Forces of the tractions in excess of their initial values; theory.md (3.5).
        !!
        !! The energy that a contact dissipates in a step is the work of the mean traction less
        !! what its springs gained: the same sum that the motion of the nodes sees.
        type(contact_arrays), intent(in) :: contacts
        real(dp), intent(in) :: dt                                     !! time step [s]
        type(nodal_state), intent(in) :: nodes
        type(joint_state), intent(inout) :: joints
        integer, intent(in) :: n_contacts
        real(dp), intent(inout) :: force(n_batch, 3, 2, n_contacts)    !! minus, plus [N]
        integer :: b, n_nodes

        n_nodes = size(nodes%velocity, 3)
        !$omp parallel do schedule(static) default(none) &
        !$omp& shared(contacts, dt, nodes, joints, n_nodes, n_contacts, force) &
        !$omp& if (n_batch*n_nodes >= least_shared)
        do b = 1, n_contacts, block_size
            call contact_block(contacts, b, min(b + block_size - 1, n_contacts), dt, n_nodes, &
                               n_contacts, contacts%contact_initial, nodes%displacement, &
                               nodes%velocity, joints%contact_traction, joints%contact_state, &
                               joints%contact_stored, joints%contact_dissipated, force)
        end do
        !$omp end parallel do
    end subroutine contact_forces

    pure subroutine contact_block(contacts, first, last, dt, n_nodes, n_contacts, initial, &
                                  displacement, velocity, traction, state, stored, dissipated, &
                                  force)
        !! Forces of contacts first to last. Explicit shapes: through components it takes longer.
        type(contact_arrays), intent(in) :: contacts
        integer, intent(in) :: first, last, n_nodes, n_contacts
        real(dp), intent(in) :: dt, initial(3, n_batch, n_contacts)
        real(dp), intent(in) :: displacement(n_batch, 3, n_nodes), velocity(n_batch, 3, n_nodes)
        real(dp), intent(inout) :: traction(3, n_batch, n_contacts)
        real(dp), intent(inout) :: state(n_joint_state, n_batch, n_contacts)
        real(dp), intent(inout) :: stored(n_batch, n_contacts), dissipated(n_batch, n_contacts)
        real(dp), intent(inout) :: force(n_batch, 3, 2, n_contacts)
        integer :: c, j, minus, plus

        do c = first, last
            j = contacts%contact_joint(c)
            minus = contacts%contact_node(1, c)
            plus = contacts%contact_node(2, c)
            call contact_force(contacts%joint_law(:, j), contacts%joint_property(:, :, j), dt, &
                               contacts%contact_normal(:, c), contacts%contact_area(c), &
                               initial(:, :, c), displacement(:, :, minus), &
                               displacement(:, :, plus), velocity(:, :, minus), &
                               velocity(:, :, plus), traction(:, :, c), state(:, :, c), &
                               stored(:, c), dissipated(:, c), force(:, :, :, c))
        end do
    end subroutine contact_block

    pure subroutine contact_force(law, property, dt, normal, area, initial, minus, plus, &
                                  minus_velocity, plus_velocity, traction, state, stored, &
                                  dissipated, force)
        !! Force of one contact in all models of a batch: together where it holds, else by its law.
        !! Explicit shapes: through components it takes longer.
        integer, intent(in) :: law(n_batch)
        real(dp), intent(in) :: property(n_joint_properties, n_batch), dt, normal(3), area
        real(dp), intent(in) :: initial(3, n_batch), minus(n_batch, 3), plus(n_batch, 3)
        real(dp), intent(in) :: minus_velocity(n_batch, 3), plus_velocity(n_batch, 3)
        real(dp), intent(inout) :: traction(3, n_batch), state(n_joint_state, n_batch)
        real(dp), intent(inout) :: stored(n_batch), dissipated(n_batch), force(n_batch, 3, 2)
        real(dp), dimension(n_batch, 3) :: jump, step, new
        real(dp) :: energy(n_batch), own(3)
        logical :: held(n_batch)
        integer :: m, k

        jump = plus - minus
        step = dt*(plus_velocity - minus_velocity)
        call held_tractions(law, property, initial, normal, jump, state, new, energy, held)
        do m = 1, n_batch
            if (held(m)) cycle
            call joint_traction(law(m), property(:, m), dt, initial(:, m), normal, jump(m, :), &
                                step(m, :), state(:, m), own, energy(m))
            new(m, :) = own
        end do
        dissipated = dissipated + stored - energy
        do m = 1, n_batch
            do k = 1, 3
                dissipated(m) = dissipated(m) + 0.5_dp*(traction(k, m) + new(m, k))*step(m, k)
            end do
        end do
        do k = 1, 3
            !$omp simd
            do m = 1, n_batch
                traction(k, m) = new(m, k)
                force(m, k, 1) = area*(new(m, k) - initial(k, m))
                force(m, k, 2) = -force(m, k, 1)
            end do
        end do
        stored = energy
    end subroutine contact_force

    pure subroutine stored_at_rest(contacts, contact_state, contact_stored)
        !! Energy that the contacts hold before anything moves.
        type(contact_arrays), intent(in) :: contacts
        real(dp), intent(in) :: contact_state(:, :, :)       !! (n_joint_state, n_batch, n_contacts)
        real(dp), intent(out) :: contact_stored(:, :)        !! (n_batch, n_contacts) [J/m2]
        real(dp) :: state(n_joint_state), traction(3), none(3)
        integer :: c, j, m

        none = 0.0_dp
        do c = 1, size(contacts%contact_joint)
            j = contacts%contact_joint(c)
            do m = 1, n_batch
                state = contact_state(:, m, c)
                call joint_traction(contacts%joint_law(m, j), contacts%joint_property(:, m, j), &
                                    0.0_dp, contacts%contact_initial(:, m, c), &
                                    contacts%contact_normal(:, c), none, none, state, traction, &
                                    contact_stored(m, c))
            end do
        end do
    end subroutine stored_at_rest

end module pyblast_contacts
