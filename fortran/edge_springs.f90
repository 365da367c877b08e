module pyblast_edge_springs
    !! Linear zones taken together as springs along their edges; theory.md (2.39), (2.40).
    !!
    !! Each edge of a set of zones belongs to one domain. All models of a batch share the springs,
    !! and nothing is gathered but whole vectors.
    use pyblast_kinds, only : dp
    use pyblast_batch, only : n_batch
    implicit none
    private
    public :: edge_forces

contains

    pure subroutine edge_forces(n_slots, n_edges, n_skews, edge_start, edge_slot, edge_spring, &
                                first_skew, last_skew, skew_slot, skew_spring, motion, force)
        !! Add the forces of the edges of one domain into its slots.
        integer, intent(in) :: n_slots, n_edges, n_skews
        integer, intent(in) :: edge_start(n_slots + 1)       !! where edges of a slot begin
        integer, intent(in) :: edge_slot(n_edges)            !! other end of each edge, from 1
        real(dp), intent(in) :: edge_spring(6, n_edges)      !! xx yy zz yz zx xy [N/m]
        integer, intent(in) :: first_skew, last_skew         !! those of the domain
        integer, intent(in) :: skew_slot(2, n_skews)         !! both ends, from 1
        real(dp), intent(in) :: skew_spring(3, n_skews)      !! [N/m]
        real(dp), intent(in) :: motion(n_batch, 3, n_slots)    !! [m]
        real(dp), intent(inout) :: force(n_batch, 3, n_slots)  !! [N]
        real(dp) :: own(n_batch, 3), d(3), f(3)
        integer :: s, e, j, l

        do s = 1, n_slots
            own = force(:, :, s)
            do e = edge_start(s), edge_start(s + 1) - 1
                j = edge_slot(e)
                !$omp simd private(d, f)
                do l = 1, n_batch
                    d(1) = motion(l, 1, j) - motion(l, 1, s)
                    d(2) = motion(l, 2, j) - motion(l, 2, s)
                    d(3) = motion(l, 3, j) - motion(l, 3, s)
                    f(1) = edge_spring(1, e)*d(1) + edge_spring(6, e)*d(2) + edge_spring(5, e)*d(3)
                    f(2) = edge_spring(6, e)*d(1) + edge_spring(2, e)*d(2) + edge_spring(4, e)*d(3)
                    f(3) = edge_spring(5, e)*d(1) + edge_spring(4, e)*d(2) + edge_spring(3, e)*d(3)
                    own(l, 1) = own(l, 1) + f(1)
                    own(l, 2) = own(l, 2) + f(2)
                    own(l, 3) = own(l, 3) + f(3)
                    force(l, 1, j) = force(l, 1, j) - f(1)
                    force(l, 2, j) = force(l, 2, j) - f(2)
                    force(l, 3, j) = force(l, 3, j) - f(3)
                end do
            end do
            force(:, :, s) = own
        end do
        do e = first_skew, last_skew
            call skew_edge_force(skew_spring(:, e), motion(:, :, skew_slot(1, e)), &
                       motion(:, :, skew_slot(2, e)), force(:, :, skew_slot(1, e)), &
                       force(:, :, skew_slot(2, e)))
        end do
    end subroutine edge_forces

    pure subroutine skew_edge_force(a, from, to, first, second)
        !! Add the cross product of `a` and the stretch of an edge to the force on both its ends.
        real(dp), intent(in) :: a(3), from(n_batch, 3), to(n_batch, 3)
        real(dp), intent(inout) :: first(n_batch, 3), second(n_batch, 3)
        real(dp) :: x, y, z
        integer :: l

        !$omp simd private(x, y, z)
        do l = 1, n_batch
            x = to(l, 1) - from(l, 1)
            y = to(l, 2) - from(l, 2)
            z = to(l, 3) - from(l, 3)
            first(l, 1) = first(l, 1) + (a(2)*z - a(3)*y)
            first(l, 2) = first(l, 2) + (a(3)*x - a(1)*z)
            first(l, 3) = first(l, 3) + (a(1)*y - a(2)*x)
            second(l, 1) = second(l, 1) + (a(2)*z - a(3)*y)
            second(l, 2) = second(l, 2) + (a(3)*x - a(1)*z)
            second(l, 3) = second(l, 3) + (a(1)*y - a(2)*x)
        end do
    end subroutine skew_edge_force

end module pyblast_edge_springs
