module pyblast_absorbing_layer
    !! Absorbing layer at nodes and joints: mass and tractions times the stretches of the layer.
    !!
    !! The mass of a node in the array of masses holds the part of its stretch that acts at once; the
    !! rest is a force that depends on the past. Zones of the layer: hex_forces.
    !! Source: theory.md (4.14) to (4.18).
    use pyblast_kinds, only : dp, least_shared
    use pyblast_model_types, only : contact_arrays, layer_arrays, layer_state
    implicit none
    private
    public :: add_layer_forces, update_layer

contains

    subroutine add_layer_forces(layer, contacts, n_nodes, n_slots, n_parts, part_force, velocity, &
                                state, force, zone_force, before, past, power)
        !! Add what the past of the layer does to its nodes, and the stretch of joints that cross it.
        type(layer_arrays), intent(in) :: layer
        type(contact_arrays), intent(in) :: contacts
        integer, intent(in) :: n_nodes, n_slots, n_parts
        real(dp), intent(in) :: part_force(3, n_parts)             !! [N]
        real(dp), intent(in) :: velocity(3, n_nodes)               !! before the step [m/s]
        type(layer_state), intent(inout) :: state
        real(dp), intent(inout) :: force(3, n_nodes)               !! of the nodes [N]
        real(dp), intent(inout) :: zone_force(3, n_nodes)          !! part of it, of zones and layer
        real(dp), intent(out) :: before(:, :)                      !! velocity of the layer's nodes
        real(dp), intent(out) :: past(:, :)                        !! what its past does to them [N]
        real(dp), intent(inout) :: power                           !! that zones and layer take [W]
        real(dp) :: own(3), taken(size(layer%layer_node)), added(3)
        integer :: c, e, k, n, side

        !$omp parallel do schedule(static) default(none) private(e, n, own) &
        !$omp& shared(layer, state, velocity, force, zone_force, before, past, taken) &
        !$omp& if (n_nodes >= least_shared)
        do k = 1, size(layer%layer_node)
            n = layer%layer_node(k)
            own = 0.0_dp
            do e = layer%stretch_start(k), layer%stretch_start(k + 1) - 1
                own = at_once(layer%node_stretch(:, e))*own &
                    + layer%node_stretch(2, e)*state%node_memory(:, e)
            end do
            own = -layer%layer_mass(k)*own
            force(:, n) = force(:, n) + own
            zone_force(:, n) = zone_force(:, n) + own
            before(:, k) = velocity(:, n)
            past(:, k) = own
            taken(k) = dot_product(own, velocity(:, n))
        end do
        !$omp end parallel do
        power = power - sum(taken)
        do k = 1, size(layer%crossing_part)
            c = layer%crossing_part(k)
            own = part_force(:, n_slots + 2*c - 1)
            added = own
            call times_stretches(3, layer%crossing_stretch(:, :, k), state%crossing_memory(:, :, k), added)
            added = added - own
            do side = 1, 2
                n = contacts%contact_node(side, c)
                force(:, n) = force(:, n) + added
                zone_force(:, n) = zone_force(:, n) + added
                power = power - dot_product(added, velocity(:, n))
                added = -added
            end do
        end do
    end subroutine add_layer_forces

    subroutine update_layer(layer, dt, n_nodes, velocity, before, state)
        !! Let the memory of the nodes follow their acceleration in the step.
        type(layer_arrays), intent(in) :: layer
        real(dp), intent(in) :: dt
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: velocity(3, n_nodes)               !! after the step [m/s]
        real(dp), intent(in) :: before(:, :)                       !! of the nodes of the layer [m/s]
        type(layer_state), intent(inout) :: state
        real(dp) :: acceleration(3)
        integer :: first, k, last

        !$omp parallel do schedule(static) default(none) private(acceleration, first, last) &
        !$omp& shared(layer, dt, velocity, before, state) if (n_nodes >= least_shared)
        do k = 1, size(layer%layer_node)
            acceleration = (velocity(:, layer%layer_node(k)) - before(:, k))/dt
            first = layer%stretch_start(k)
            last = layer%stretch_start(k + 1) - 1
            call times_stretches(last - first + 1, layer%node_stretch(:, first:last), &
                                 state%node_memory(:, first:last), acceleration)
        end do
        !$omp end parallel do
    end subroutine update_layer

    pure function at_once(stretch) result(share)
        !! What a stretch does to a value of the same instant.
        real(dp), intent(in) :: stretch(5)
        real(dp) :: share

        share = stretch(1) + stretch(2)*stretch(3)
    end function at_once

    pure subroutine times_stretches(n, stretch, memory, value)
        !! Multiply a vector with stretches, the innermost first; (4.16).
        integer, intent(in) :: n
        real(dp), intent(in) :: stretch(5, n)
        real(dp), intent(inout) :: memory(3, n), value(3)
        real(dp) :: drive(3)
        integer :: a

        do a = 1, n
            drive = stretch(3, a)*value
            memory(:, a) = memory(:, a) + drive
            value = stretch(1, a)*value + stretch(2, a)*memory(:, a)
            memory(:, a) = stretch(4, a)*memory(:, a) + drive
        end do
    end subroutine times_stretches

end module pyblast_absorbing_layer
