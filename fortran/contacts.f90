module pyblast_contacts
    !! Relative motion across joints, tractions by the law of each joint, forces on both sides.
    use pyblast_kinds, only : dp, least_shared, n_joint_state
    use pyblast_batch, only : n_batch
    use pyblast_joint_coulomb, only : held_tractions
    use pyblast_joint_laws, only : joint_traction
    use pyblast_model_types, only : contact_arrays, joint_state, nodal_state
    implicit none
    private
    public :: contact_forces, stored_at_rest

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
        integer :: c, n_nodes

        n_nodes = size(nodes%velocity, 3)
        !$omp parallel do schedule(static) default(none) &
        !$omp& shared(contacts, dt, nodes, joints, n_contacts, force) &
        !$omp& if (n_batch*n_nodes >= least_shared)
        do c = 1, n_contacts
            call contact_force(contacts, c, dt, nodes, joints, force(:, :, :, c))
        end do
        !$omp end parallel do
    end subroutine contact_forces

    pure subroutine contact_force(contacts, c, dt, nodes, joints, force)
        !! Force of contact c in all models of a batch: together where it holds, else by its law.
        type(contact_arrays), intent(in) :: contacts
        integer, intent(in) :: c
        real(dp), intent(in) :: dt
        type(nodal_state), intent(in) :: nodes
        type(joint_state), intent(inout) :: joints
        real(dp), intent(inout) :: force(n_batch, 3, 2)
        real(dp), dimension(n_batch, 3) :: jump, step, traction
        real(dp) :: stored(n_batch), own(3)
        logical :: held(n_batch)
        integer :: m, k

        associate (minus => contacts%contact_node(1, c), plus => contacts%contact_node(2, c), &
                   j => contacts%contact_joint(c), u => nodes%displacement, v => nodes%velocity)
            do k = 1, 3
                do m = 1, n_batch
                    jump(m, k) = u(m, k, plus) - u(m, k, minus)
                    step(m, k) = dt*(v(m, k, plus) - v(m, k, minus))
                end do
            end do
            call held_tractions(contacts%joint_law(:, j), contacts%joint_property(:, :, j), &
                                contacts%contact_initial(:, :, c), contacts%contact_normal(:, c), &
                                jump, joints%contact_state(:, :, c), traction, stored, held)
            do m = 1, n_batch
                if (held(m)) cycle
                call joint_traction(contacts%joint_law(m, j), contacts%joint_property(:, m, j), dt, &
                                    contacts%contact_initial(:, m, c), &
                                    contacts%contact_normal(:, c), jump(m, :), step(m, :), &
                                    joints%contact_state(:, m, c), own, stored(m))
                traction(m, :) = own
            end do
            call keep_traction(contacts%contact_area(c), contacts%contact_initial(:, :, c), step, &
                               traction, stored, joints%contact_traction(:, :, c), &
                               joints%contact_stored(:, c), joints%contact_dissipated(:, c), force)
        end associate
    end subroutine contact_force

    pure subroutine keep_traction(area, initial, step, new_traction, new_stored, traction, stored, &
                                  dissipated, force)
        !! Keep the tractions and energies of one contact, and give the force on both its sides.
        real(dp), intent(in) :: area, initial(3, n_batch), step(n_batch, 3)
        real(dp), intent(in) :: new_traction(n_batch, 3), new_stored(n_batch)
        real(dp), intent(inout) :: traction(3, n_batch), stored(n_batch), dissipated(n_batch)
        real(dp), intent(inout) :: force(n_batch, 3, 2)
        integer :: m, k

        dissipated = dissipated + stored - new_stored
        do m = 1, n_batch
            do k = 1, 3
                dissipated(m) = dissipated(m) &
                    + 0.5_dp*(traction(k, m) + new_traction(m, k))*step(m, k)
            end do
        end do
        do k = 1, 3
            !$omp simd
            do m = 1, n_batch
                traction(k, m) = new_traction(m, k)
                force(m, k, 1) = area*(new_traction(m, k) - initial(k, m))
                force(m, k, 2) = -force(m, k, 1)
            end do
        end do
        stored = new_stored
    end subroutine keep_traction

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
