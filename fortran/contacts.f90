module pyblast_contacts
    !! Relative motion across joints, tractions by the law of each joint, forces on both sides.
    use pyblast_kinds, only : dp, n_joint_properties, n_joint_state
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
        integer, intent(in) :: joint_law(n_joints)               !! from 1
        real(dp), intent(in) :: joint_property(n_joint_properties, n_joints)
        real(dp), intent(in) :: contact_initial(3, n_contacts)   !! traction at zero jump [Pa]
        real(dp), intent(in) :: displacement(3, n_nodes)         !! [m]
        real(dp), intent(in) :: velocity(3, n_nodes)             !! half a step earlier [m/s]
        real(dp), intent(inout) :: contact_traction(3, n_contacts)             !! [Pa]
        real(dp), intent(inout) :: contact_state(n_joint_state, n_contacts)
        real(dp), intent(inout) :: contact_stored(n_contacts)                  !! [J/m2]
        real(dp), intent(inout) :: contact_dissipated(n_contacts)              !! [J/m2]
        real(dp), intent(inout) :: contact_force(3, 2, n_contacts)             !! minus, plus [N]
        real(dp) :: jump(3), step(3), traction(3), stored
        integer :: c, j

        !$omp parallel do schedule(static) private(j, jump, step, traction, stored)
        do c = 1, n_contacts
            associate (minus => contact_node(1, c), plus => contact_node(2, c))
                jump = displacement(:, plus) - displacement(:, minus)
                step = dt*(velocity(:, plus) - velocity(:, minus))
            end associate
            j = contact_joint(c)
            call joint_traction(joint_law(j), joint_property(:, j), dt, contact_initial(:, c), &
                                contact_normal(:, c), jump, step, contact_state(:, c), traction, &
                                stored)
            contact_dissipated(c) = contact_dissipated(c) + contact_stored(c) - stored &
                + 0.5_dp*dot_product(contact_traction(:, c) + traction, step)
            contact_traction(:, c) = traction
            contact_stored(c) = stored
            contact_force(:, 1, c) = contact_area(c)*(traction - contact_initial(:, c))
            contact_force(:, 2, c) = -contact_force(:, 1, c)
        end do
        !$omp end parallel do
    end subroutine contact_forces

    subroutine stored_at_rest(n_contacts, n_joints, contact_normal, contact_joint, joint_law, &
                              joint_property, contact_initial, contact_state, contact_stored)
        !! Energy that the contacts hold before anything moves; arguments as in contact_forces.
        integer, intent(in) :: n_contacts, n_joints, contact_joint(n_contacts), joint_law(n_joints)
        real(dp), intent(in) :: contact_normal(3, n_contacts)
        real(dp), intent(in) :: joint_property(n_joint_properties, n_joints)
        real(dp), intent(in) :: contact_initial(3, n_contacts)
        real(dp), intent(in) :: contact_state(n_joint_state, n_contacts)
        real(dp), intent(out) :: contact_stored(n_contacts)                    !! [J/m2]
        real(dp) :: state(n_joint_state), traction(3), none(3)
        integer :: c, j

        none = 0.0_dp
        do c = 1, n_contacts
            j = contact_joint(c)
            state = contact_state(:, c)
            call joint_traction(joint_law(j), joint_property(:, j), 0.0_dp, contact_initial(:, c), &
                                contact_normal(:, c), none, none, state, traction, &
                                contact_stored(c))
        end do
    end subroutine stored_at_rest

end module pyblast_contacts
