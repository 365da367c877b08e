module pyblast_contacts
    !! Relative motion across joints, tractions by the law of each joint, forces on both sides.
    use pyblast_kinds, only : dp, least_shared, n_joint_properties, n_joint_state
    use pyblast_lanes, only : lanes
    use pyblast_joint_laws, only : held_tractions, joint_traction
    implicit none
    private
    public :: contact_forces, stored_at_rest

contains

    subroutine contact_forces(n_nodes, n_contacts, n_joints, dt, contact_node, contact_normal, &
                              contact_area, contact_joint, joint_law, joint_property, &
                              contact_initial, displacement, velocity, contact_traction, &
                              contact_state, contact_stored, contact_dissipated, contact_force)
        !! Forces of the tractions in excess of their initial values; theory.md (3.5).
        !!
        !! The energy that a contact dissipates in a step is the work of the mean traction less
        !! what its springs gained: the same sum that the motion of the nodes sees.
        integer, intent(in) :: n_nodes, n_contacts, n_joints
        real(dp), intent(in) :: dt                               !! time step [s]
        integer, intent(in) :: contact_node(2, n_contacts)       !! minus, plus; from 1
        real(dp), intent(in) :: contact_normal(3, n_contacts)    !! unit, from minus to plus
        real(dp), intent(in) :: contact_area(n_contacts)         !! [m2]
        integer, intent(in) :: contact_joint(n_contacts)         !! from 1
        integer, intent(in) :: joint_law(lanes, n_joints)        !! from 1
        real(dp), intent(in) :: joint_property(n_joint_properties, lanes, n_joints)
        real(dp), intent(in) :: contact_initial(3, lanes, n_contacts)  !! traction at no jump [Pa]
        real(dp), intent(in) :: displacement(lanes, 3, n_nodes)  !! [m]
        real(dp), intent(in) :: velocity(lanes, 3, n_nodes)      !! half a step earlier [m/s]
        real(dp), intent(inout) :: contact_traction(3, lanes, n_contacts)      !! [Pa]
        real(dp), intent(inout) :: contact_state(n_joint_state, lanes, n_contacts)
        real(dp), intent(inout) :: contact_stored(lanes, n_contacts)           !! [J/m2]
        real(dp), intent(inout) :: contact_dissipated(lanes, n_contacts)       !! [J/m2]
        real(dp), intent(inout) :: contact_force(lanes, 3, 2, n_contacts)      !! minus, plus [N]
        integer :: c, j

        !$omp parallel do schedule(static) private(j) if (lanes*n_nodes >= least_shared)
        do c = 1, n_contacts
            j = contact_joint(c)
            call contact_pull(joint_law(:, j), joint_property(:, :, j), dt, contact_normal(:, c), &
                              contact_area(c), contact_initial(:, :, c), &
                              displacement(:, :, contact_node(1, c)), &
                              displacement(:, :, contact_node(2, c)), &
                              velocity(:, :, contact_node(1, c)), &
                              velocity(:, :, contact_node(2, c)), contact_traction(:, :, c), &
                              contact_state(:, :, c), contact_stored(:, c), &
                              contact_dissipated(:, c), contact_force(:, :, :, c))
        end do
        !$omp end parallel do
    end subroutine contact_forces

    pure subroutine contact_pull(law, property, dt, normal, area, initial, minus, plus, minus_speed, &
                                 plus_speed, traction, state, stored, dissipated, force)
        !! Force of one contact in all lanes: side by side where it holds, else by its law.
        integer, intent(in) :: law(lanes)
        real(dp), intent(in) :: property(n_joint_properties, lanes), dt, normal(3), area
        real(dp), intent(in) :: initial(3, lanes), minus(lanes, 3), plus(lanes, 3)
        real(dp), intent(in) :: minus_speed(lanes, 3), plus_speed(lanes, 3)
        real(dp), intent(inout) :: traction(3, lanes), state(n_joint_state, lanes)
        real(dp), intent(inout) :: stored(lanes), dissipated(lanes), force(lanes, 3, 2)
        real(dp) :: jump(lanes, 3), step(lanes, 3), pull(lanes, 3), energy(lanes), one(3)
        logical :: held(lanes)
        integer :: l, k

        jump = plus - minus
        step = dt*(plus_speed - minus_speed)
        call held_tractions(law, property, initial, normal, jump, state, pull, energy, held)
        do l = 1, lanes
            if (held(l)) cycle
            call joint_traction(law(l), property(:, l), dt, initial(:, l), normal, jump(l, :), &
                                step(l, :), state(:, l), one, energy(l))
            pull(l, :) = one
        end do
        dissipated = dissipated + stored - energy
        do k = 1, 3
            !$omp simd
            do l = 1, lanes
                dissipated(l) = dissipated(l) + 0.5_dp*(traction(k, l) + pull(l, k))*step(l, k)
                traction(k, l) = pull(l, k)
                force(l, k, 1) = area*(pull(l, k) - initial(k, l))
                force(l, k, 2) = -force(l, k, 1)
            end do
        end do
        stored = energy
    end subroutine contact_pull

    subroutine stored_at_rest(n_contacts, n_joints, contact_normal, contact_joint, joint_law, &
                              joint_property, contact_initial, contact_state, contact_stored)
        !! Energy that the contacts hold before anything moves; arguments as in contact_forces.
        integer, intent(in) :: n_contacts, n_joints, contact_joint(n_contacts)
        integer, intent(in) :: joint_law(lanes, n_joints)
        real(dp), intent(in) :: contact_normal(3, n_contacts)
        real(dp), intent(in) :: joint_property(n_joint_properties, lanes, n_joints)
        real(dp), intent(in) :: contact_initial(3, lanes, n_contacts)
        real(dp), intent(in) :: contact_state(n_joint_state, lanes, n_contacts)
        real(dp), intent(out) :: contact_stored(lanes, n_contacts)             !! [J/m2]
        real(dp) :: state(n_joint_state), traction(3), none(3)
        integer :: c, j, l

        none = 0.0_dp
        do c = 1, n_contacts
            j = contact_joint(c)
            do l = 1, lanes
                state = contact_state(:, l, c)
                call joint_traction(joint_law(l, j), joint_property(:, l, j), 0.0_dp, &
                                    contact_initial(:, l, c), contact_normal(:, c), none, none, &
                                    state, traction, contact_stored(l, c))
            end do
        end do
    end subroutine stored_at_rest

end module pyblast_contacts
