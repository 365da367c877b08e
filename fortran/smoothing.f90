module pyblast_smoothing
    !! Smoothing of thin tetrahedra: nodes slide downhill along the planes and lines that hold them.
    !!
    !! The measure of a node is the sum of V0 (sum |g|^2)^2 over its zones, V0 the volume at first and g
    !! the gradients of the shape functions, |g| = 1/altitude: large where a zone is thin.
    use pyblast_kinds, only : dp
    use pyblast_principal_stresses, only : cross
    implicit none
    private
    public :: smooth

    integer, parameter :: most_sweeps = 8
    real(dp), parameter :: settled = 0.05_dp     !! fraction of moved nodes at which smoothing ends
    real(dp), parameter :: step(3) = [0.3_dp, 0.1_dp, 0.03_dp]
        !! tried in turn, over the smallest altitude of a node
    real(dp), parameter :: gain = 1e-3_dp
    real(dp), parameter :: sharpest = 1e-6_dp*sqrt(huge(1.0_dp))   !! of a zone that is inverted
    real(dp), parameter :: flat = 1e-12_dp       !! volume over the product of three edges

contains

    pure subroutine smooth(n_nodes, n_zones, n_own, n_movable, zone_node, weight, movable_node, &
                           projector, zone_start, own_zone, position)
        !! Slide nodes one after the other, again once a neighbour has moved, in a few sweeps.
        integer, intent(in) :: n_nodes, n_zones, n_own, n_movable
        integer, intent(in) :: zone_node(4, n_zones)              !! from 1
        real(dp), intent(in) :: weight(n_zones)                   !! volume at first [m3]
        integer, intent(in) :: movable_node(n_movable)
        real(dp), intent(in) :: projector(3, 3, n_movable)        !! on motions that are allowed
        integer, intent(in) :: zone_start(n_movable + 1), own_zone(n_own)   !! around each of them
        real(dp), intent(inout) :: position(3, n_nodes)           !! [m]
        !f2py threadsafe
        logical :: waiting(n_nodes), moves
        integer :: sweep, k, z, moved

        waiting = .true.
        do sweep = 1, most_sweeps
            moved = 0
            do k = 1, n_movable
                if (.not. waiting(movable_node(k))) cycle
                waiting(movable_node(k)) = .false.
                call slide(n_nodes, n_zones, zone_node, weight, movable_node(k), projector(:, :, k), &
                           own_zone(zone_start(k):zone_start(k + 1) - 1), position, moves)
                if (.not. moves) cycle
                moved = moved + 1
                do z = zone_start(k), zone_start(k + 1) - 1
                    waiting(zone_node(:, own_zone(z))) = .true.
                end do
            end do
            if (moved <= settled*n_movable) exit
        end do
    end subroutine smooth

    pure subroutine slide(n_nodes, n_zones, zone_node, weight, node, projector, own, position, moves)
        !! Move one node downhill by the first step that wins something, if any.
        integer, intent(in) :: n_nodes, n_zones, zone_node(4, n_zones), node, own(:)
        real(dp), intent(in) :: weight(n_zones), projector(3, 3)
        real(dp), intent(inout) :: position(3, n_nodes)
        logical, intent(out) :: moves
        real(dp) :: before, after, reach, sharp, gradient(3, 4), slope(3), downhill(3), start(3)
        integer :: i, c, k

        before = 0.0_dp
        downhill = 0.0_dp
        reach = huge(reach)
        do i = 1, size(own)
            call gradients(position(:, zone_node(:, own(i))), gradient, sharp)
            c = findloc(zone_node(:, own(i)), node, 1)
            slope = matmul(gradient, matmul(gradient(:, c), gradient))
            before = before + weight(own(i))*sharp**2
            downhill = downhill + weight(own(i))*merge(1.0_dp, sharp, sharp > sharpest)*slope
            reach = min(reach, 1.0_dp/norm2(gradient(:, c)))
        end do
        downhill = matmul(projector, downhill)
        downhill = downhill*(reach/max(norm2(downhill), tiny(reach)))
        start = position(:, node)
        do k = 1, size(step)
            position(:, node) = start + step(k)*downhill
            after = 0.0_dp
            do i = 1, size(own)
                call gradients(position(:, zone_node(:, own(i))), gradient, sharp)
                after = after + weight(own(i))*sharp**2
            end do
            moves = after < (1.0_dp - gain)*before
            if (moves) return
        end do
        position(:, node) = start
    end subroutine slide

    pure subroutine gradients(corner, gradient, sharp)
        !! Gradients of the shape functions and the sum of their squares, sharpest if inverted.
        real(dp), intent(in) :: corner(3, 4)                      !! [m]
        real(dp), intent(out) :: gradient(3, 4)                   !! [1/m]
        real(dp), intent(out) :: sharp                            !! [1/m2]
        real(dp) :: a(3), b(3), c(3), volume, size_of
        logical :: sound

        a = corner(:, 2) - corner(:, 1)
        b = corner(:, 3) - corner(:, 1)
        c = corner(:, 4) - corner(:, 1)
        gradient(:, 2) = cross(b, c)
        gradient(:, 3) = cross(c, a)
        gradient(:, 4) = cross(a, b)
        gradient(:, 1) = -(gradient(:, 2) + gradient(:, 3) + gradient(:, 4))
        volume = dot_product(a, gradient(:, 2))
        size_of = norm2(a)*norm2(b)*norm2(c)
        sound = volume > flat*size_of
        gradient = gradient/merge(volume, size_of, sound)
        sharp = merge(sum(gradient**2), 2.0_dp*sharpest, sound)
    end subroutine gradients

end module pyblast_smoothing
