module pyblast_contacts
    !! Relative motion across joints, tractions by the law of each joint, forces on both sides.
    use pyblast_kinds, only : dp, n_joint_properties, n_joint_state
    use pyblast_lanes, only : lanes
    use pyblast_joint_laws, only : joint_traction
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
        real(dp) :: jump(3), step(3), traction(3), stored
        integer :: c, j, l

        !$omp parallel do schedule(static) private(j, l, jump, step, traction, stored)
        do c = 1, n_contacts
            j = contact_joint(c)
            do l = 1, lanes
                associate (minus => contact_node(1, c), plus => contact_node(2, c))
                    jump = displacement(l, :, plus) - displacement(l, :, minus)
                    step = dt*(velocity(l, :, plus) - velocity(l, :, minus))
                end associate
                call joint_traction(joint_law(l, j), joint_property(:, l, j), dt, &
                                    contact_initial(:, l, c), contact_normal(:, c), jump, step, &
                                    contact_state(:, l, c), traction, stored)
                contact_dissipated(l, c) = contact_dissipated(l, c) + contact_stored(l, c) - stored &
                    + 0.5_dp*dot_product(contact_traction(:, l, c) + traction, step)
                contact_traction(:, l, c) = traction
                contact_stored(l, c) = stored
                contact_force(l, :, 1, c) = contact_area(c)*(traction - contact_initial(:, l, c))
                contact_force(l, :, 2, c) = -contact_force(l, :, 1, c)
            end do
        end do
        !$omp end parallel do
    end subroutine contact_forces

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
