module bare_march
    !! Marches of elastic zones alone on one thread, to compare what kinds of zones cost.
    use pyblast_kinds, only : dp, tet15_width
    use pyblast_tet4, only : tet4_forces
    use pyblast_tet15, only : tet15_forces
    implicit none
    private
    public :: march

contains

    subroutine march(n_nodes, n_zones, n_corners, n_domains, n_slots, n_steps, n_links, n_pairs, &
                     n_receivers, dt, zone_start, slot_start, slot_node, zone_slot, lambda, shear, &
                     place, metric, inverse_mass, link_node, link_mass, pair_node, pair_stiffness, pushed, &
                     source, receiver_node, receiver_weight, u, v, seismogram) bind(c)
        !! Forces by domain, springs of joints, tuned mass, central differences, readings.
        integer, value :: n_nodes, n_zones, n_corners, n_domains, n_slots, n_steps
        integer, value :: n_links, n_pairs, n_receivers
        real(dp), value :: dt
        integer, intent(in) :: zone_start(n_domains + 1), slot_start(n_domains + 1)
        integer, intent(in) :: slot_node(n_slots), zone_slot(n_zones, n_corners)
        real(dp), intent(in) :: lambda(n_zones), shear(n_zones), place(3, n_slots)
        real(dp), intent(in) :: metric(tet15_width, 11, *)    !! of packs of quadratic zones
        real(dp), intent(in) :: inverse_mass(3, n_nodes)      !! none where a motion is fixed
        integer, intent(in) :: link_node(2, n_links), pair_node(2, n_pairs)
        real(dp), intent(in) :: link_mass(n_links)            !! gamma (M_l - M_c), by edges [kg]
        real(dp), intent(in) :: pair_stiffness(3, n_pairs)    !! along x y z [N/m]
        real(dp), intent(in) :: pushed(3, n_corners)          !! force of a unit source [N]
        real(dp), intent(in) :: source(n_steps)
        integer, intent(in) :: receiver_node(n_corners, n_receivers + 1)   !! the last: the source
        real(dp), intent(in) :: receiver_weight(n_corners, n_receivers)
        real(dp), intent(inout) :: u(3, n_nodes), v(3, n_nodes)
        real(dp), intent(out) :: seismogram(3, n_receivers, n_steps)
        real(dp) :: f(3, n_nodes), a(3, n_nodes)
        integer :: step, s, r

        do step = 1, n_steps
            call forces(n_nodes, n_zones, n_corners, n_domains, n_slots, zone_start, slot_start, &
                        slot_node, zone_slot, lambda, shear, place, metric, u, f)
            call pull(n_nodes, n_pairs, pair_node, pair_stiffness, u, f)
            do s = 1, n_corners
                associate (n => receiver_node(s, n_receivers + 1))
                    f(:, n) = f(:, n) + pushed(:, s)*source(step)
                end associate
            end do
            if (n_links > 0) then
                a = f*inverse_mass
                call pull(n_nodes, n_links, link_node, spread(-link_mass, 1, 3), a, f)
            end if
            do s = 1, n_nodes
                v(:, s) = v(:, s) + dt*f(:, s)*inverse_mass(:, s)
                u(:, s) = u(:, s) + dt*v(:, s)
            end do
            do r = 1, n_receivers
                seismogram(:, r, step) = matmul(v(:, receiver_node(:, r)), receiver_weight(:, r))
            end do
        end do
    end subroutine march

    subroutine forces(n_nodes, n_zones, n_corners, n_domains, n_slots, zone_start, slot_start, &
                      slot_node, zone_slot, lambda, shear, place, metric, u, f)
        !! Forces of all zones on the nodes.
        integer, intent(in) :: n_nodes, n_zones, n_corners, n_domains, n_slots
        integer, intent(in) :: zone_start(n_domains + 1), slot_start(n_domains + 1)
        integer, intent(in) :: slot_node(n_slots), zone_slot(n_zones, n_corners)
        real(dp), intent(in) :: lambda(n_zones), shear(n_zones), place(3, n_slots), u(3, n_nodes)
        real(dp), intent(in) :: metric(tet15_width, 11, *)
        real(dp), intent(out) :: f(3, n_nodes)
        real(dp), dimension(3, maxval(slot_start(2:) - slot_start(:n_domains))) :: w, part
        integer :: d, s, s1, n, pack, n_packs

        f = 0.0_dp
        pack = 1
        do d = 1, n_domains
            s1 = slot_start(d) - 1
            n = slot_start(d + 1) - slot_start(d)
            do s = 1, n
                w(:, s) = u(:, slot_node(s1 + s))
                part(:, s) = 0.0_dp
            end do
            if (n_corners == 4) then
                call tet4_forces(n_zones, n, zone_start(d), zone_start(d + 1) - 1, zone_slot, &
                                   lambda, shear, place(:, s1 + 1:), w, w, .true., part)
            else
                n_packs = (zone_start(d + 1) - zone_start(d) + tet15_width - 1)/tet15_width
                call tet15_forces(n_zones, n, n_packs, zone_start(d), zone_start(d + 1) - 1, &
                                  zone_slot, metric(1, 1, pack), w, w, .true., part)
                pack = pack + n_packs
            end if
            do s = 1, n
                f(:, slot_node(s1 + s)) = f(:, slot_node(s1 + s)) + part(:, s)
            end do
        end do
    end subroutine forces

    pure subroutine pull(n_nodes, n_pairs, node, stiffness, u, f)
        !! Springs between pairs of nodes.
        integer, intent(in) :: n_nodes, n_pairs, node(2, n_pairs)
        real(dp), intent(in) :: stiffness(3, n_pairs), u(3, n_nodes)
        real(dp), intent(inout) :: f(3, n_nodes)
        real(dp) :: force(3)
        integer :: k

        do k = 1, n_pairs
            force = stiffness(:, k)*(u(:, node(2, k)) - u(:, node(1, k)))
            f(:, node(1, k)) = f(:, node(1, k)) + force
            f(:, node(2, k)) = f(:, node(2, k)) - force
        end do
    end subroutine pull

end module bare_march
