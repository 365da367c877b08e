module edge_loops
    !! Edges of all domains on one thread, to compare kinds of numbers that springs are kept in.
    use pyblast_kinds, only : dp
    use pyblast_batch, only : n_batch
    use pyblast_edge_springs, only : edge_forces
    implicit none
    private
    public :: loops

contains

    subroutine loops(n_times, n_nodes, n_domains, n_slots, n_edges, n_skews, slot_start, &
                     slot_node, edge_start, edge_slot, edge_spring, skew_start, skew_slot, &
                     skew_spring, displacement, force) bind(c)
        !! Gather the motion of each domain and compute its forces, some times.
        integer, value :: n_times, n_nodes, n_domains, n_slots, n_edges, n_skews
        integer, intent(in) :: slot_start(n_domains + 1), slot_node(n_slots)
        integer, intent(in) :: edge_start(n_slots + 1), edge_slot(n_edges)
        real(dp), intent(in) :: edge_spring(6, n_edges)      !! xx yy zz yz zx xy [N/m]
        integer, intent(in) :: skew_start(n_domains + 1), skew_slot(2, n_skews)
        real(dp), intent(in) :: skew_spring(3, n_skews), displacement(n_batch, 3, n_nodes)
        real(dp), intent(out) :: force(n_batch, 3, n_slots)
        real(dp) :: u(n_batch, 3, maxval(slot_start(2:) - slot_start(:n_domains)))
        integer :: time, d, s1, s2

        do time = 1, n_times
            do d = 1, n_domains
                s1 = slot_start(d)
                s2 = slot_start(d + 1) - 1
                u(:, :, :s2 - s1 + 1) = displacement(:, :, slot_node(s1:s2))
                force(:, :, s1:s2) = 0.0_dp
                call edge_forces(s2 - s1 + 1, n_edges, n_skews, edge_start(s1:s2 + 1), edge_slot, &
                                 edge_spring, skew_start(d), skew_start(d + 1) - 1, skew_slot, &
                                 skew_spring, u(:, :, :s2 - s1 + 1), force(:, :, s1:s2))
            end do
        end do
    end subroutine loops

end module edge_loops
