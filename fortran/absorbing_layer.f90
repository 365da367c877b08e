module pyblast_absorbing_layer
    !! Absorbing layer at nodes and joints: mass and tractions times the stretches of the layer.
    !!
    !! The mass of a node in the array of masses holds the part of its stretch that acts at once; the
    !! rest is a force that depends on the past. Zones of the layer: hex_forces.
    !! Source: theory.md (4.14) to (4.18).
    use pyblast_kinds, only : dp
    use pyblast_model_types, only : contact_arrays, layer_arrays, layer_state
    implicit none
    private
    public :: add_crossing_forces, add_past, follow_step

contains

    pure subroutine add_past(first, last, n_nodes, n_held, layer_node, velocity, past, force, &
                             zone_force, power)
        !! Add what the past of nodes first to last of the layer does to them.
        integer, intent(in) :: first, last, n_nodes, n_held, layer_node(n_held)
        real(dp), intent(in) :: velocity(3, n_nodes)               !! before the step [m/s]
        real(dp), intent(in) :: past(3, n_held)                    !! of nodes of the layer [N]
        real(dp), intent(inout) :: force(3, n_nodes)               !! of the nodes [N]
        real(dp), intent(inout) :: zone_force(3, n_nodes)          !! part of it, of zones and layer
        real(dp), intent(inout) :: power                           !! that zones and layer take [W]
        integer :: k, n

        do k = first, last
            n = layer_node(k)
            force(:, n) = force(:, n) + past(:, k)
            zone_force(:, n) = zone_force(:, n) + past(:, k)
            power = power - dot_product(past(:, k), velocity(:, n))
        end do
    end subroutine add_past

    pure subroutine follow_step(layer, first, last, dt, n_nodes, velocity, before, state)
        !! Let the memory of nodes first to last of the layer follow their acceleration in a step, and
        !! find what their past does to them in the next.
        type(layer_arrays), intent(in) :: layer
        integer, intent(in) :: first, last, n_nodes
        real(dp), intent(in) :: dt
        real(dp), intent(in) :: velocity(3, n_nodes)               !! after the step [m/s]
        real(dp), intent(in) :: before(3, first:last)              !! of these nodes [m/s]
        type(layer_state), intent(inout) :: state

        call follow(first, last, n_nodes, size(layer%layer_node), 1.0_dp/dt, layer%layer_node, &
                    layer%layer_mass, layer%stretch_start, layer%stretch_row, layer%node_stretch, &
                    velocity, before, state%node_memory, state%node_past)
    end subroutine follow_step

    pure subroutine follow(first, last, n_nodes, n_held, rate, layer_node, layer_mass, &
                           stretch_start, stretch_row, node_stretch, velocity, before, node_memory, &
                           past)
        !! As follow_step. Explicit shapes: through components it takes longer.
        integer, intent(in) :: first, last, n_nodes, n_held
        real(dp), intent(in) :: rate                               !! of steps [1/s]
        integer, intent(in) :: layer_node(n_held), stretch_start(n_held + 1), stretch_row(*)
        real(dp), intent(in) :: layer_mass(n_held), node_stretch(5, *)
        real(dp), intent(in) :: velocity(3, n_nodes), before(3, first:last)
        real(dp), intent(inout) :: node_memory(3, *), past(3, n_held)
        real(dp) :: acceleration(3), memory(3), own(3), kappa, loss, share
        integer :: e, k, r

        do k = first, last
            acceleration = (velocity(:, layer_node(k)) - before(:, k))*rate
            own = 0.0_dp
            do e = stretch_start(k), stretch_start(k + 1) - 1
                r = stretch_row(e)
                kappa = node_stretch(1, r)
                loss = node_stretch(2, r)
                share = node_stretch(3, r)
                memory = node_memory(:, e)
                call times_stretch(kappa, loss, share, node_stretch(4, r), memory, acceleration)
                node_memory(:, e) = memory
                own = (kappa + loss*share)*own + loss*memory
            end do
            past(:, k) = -layer_mass(k)*own
        end do
    end subroutine follow

    subroutine add_crossing_forces(layer, contacts, n_nodes, n_slots, n_parts, part_force, velocity, &
                                   state, force, zone_force, power)
        !! Add the stretch of joints that cross the layer.
        type(layer_arrays), intent(in) :: layer
        type(contact_arrays), intent(in) :: contacts
        integer, intent(in) :: n_nodes, n_slots, n_parts
        real(dp), intent(in) :: part_force(3, n_parts)             !! [N]
        real(dp), intent(in) :: velocity(3, n_nodes)               !! before the step [m/s]
        type(layer_state), intent(inout) :: state
        real(dp), intent(inout) :: force(3, n_nodes)               !! of the nodes [N]
        real(dp), intent(inout) :: zone_force(3, n_nodes)          !! part of it, of zones and layer
        real(dp), intent(inout) :: power                           !! that zones and layer take [W]
        real(dp) :: own(3), added(3)
        integer :: a, c, k, n, side

        do k = 1, size(layer%crossing_part)
            c = layer%crossing_part(k)
            own = part_force(:, n_slots + 2*c - 1)
            added = own
            do a = 1, 3
                call times_stretch(layer%crossing_stretch(1, a, k), layer%crossing_stretch(2, a, k), &
                                   layer%crossing_stretch(3, a, k), layer%crossing_stretch(4, a, k), &
                                   state%crossing_memory(:, a, k), added)
            end do
            added = added - own
            do side = 1, 2
                n = contacts%contact_node(side, c)
                force(:, n) = force(:, n) + added
                zone_force(:, n) = zone_force(:, n) + added
                power = power - dot_product(added, velocity(:, n))
                added = -added
            end do
        end do
    end subroutine add_crossing_forces

    elemental subroutine times_stretch(kappa, loss, share, keeps, memory, value)
        !! Multiply a value with a stretch; (4.16).
        real(dp), intent(in) :: kappa, loss, share, keeps          !! numbers of a stretch
        real(dp), intent(inout) :: memory, value
        real(dp) :: drive

        drive = share*value
        memory = memory + drive
        value = kappa*value + loss*memory
        memory = keeps*memory + drive
    end subroutine times_stretch

end module pyblast_absorbing_layer
