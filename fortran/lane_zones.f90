module pyblast_lane_zones
    !! The zones of `pyblast_linear_zones` for models that march together: lanes side by side.
    !!
    !! Gradients are found once for all lanes, and nothing is gathered but whole vectors.
    use pyblast_kinds, only : dp
    use pyblast_lanes, only : lanes
    implicit none
    private
    public :: lane_forces

contains

    pure subroutine lane_forces(n_zones, n_slots, first, last, zone_slot, zone_lambda, zone_shear, &
                                place, shearing, swelling, alike, force)
        !! Add the corner forces of zones first to last; arguments as in linear_forces.
        integer, intent(in) :: n_zones, n_slots, first, last, zone_slot(n_zones, 4)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones), place(3, n_slots)
        real(dp), intent(in) :: shearing(lanes, 3, n_slots), swelling(lanes, 3, n_slots)   !! [m]
        logical, intent(in) :: alike
        real(dp), intent(inout) :: force(lanes, 3, n_slots)                                !! [N]
        real(dp) :: gradient(3, 3), volume, slope(lanes, 3, 3), swell(lanes), stress(lanes, 6)
        integer :: z, slot(4)

        do z = first, last
            slot = zone_slot(z, :)
            call gradients(place(:, slot(1)), place(:, slot(2)), place(:, slot(3)), &
                           place(:, slot(4)), gradient, volume)
            call slopes(shearing(:, :, slot(1)), shearing(:, :, slot(2)), &
                        shearing(:, :, slot(3)), shearing(:, :, slot(4)), gradient, slope)
            swell = zone_lambda(z)*(slope(:, 1, 1) + slope(:, 2, 2) + slope(:, 3, 3))
            if (.not. alike) swell = swell + (zone_lambda(z) + 2.0_dp*zone_shear(z))*( &
                divergence(swelling(:, :, slot(1)), swelling(:, :, slot(2)), &
                           swelling(:, :, slot(3)), swelling(:, :, slot(4)), gradient) &
                - (slope(:, 1, 1) + slope(:, 2, 2) + slope(:, 3, 3)))
            call stresses(zone_shear(z), swell, slope, stress)
            call push(volume, gradient, stress, force(:, :, slot(1)), force(:, :, slot(2)), &
                      force(:, :, slot(3)), force(:, :, slot(4)))
        end do
    end subroutine lane_forces

    pure subroutine gradients(a, b, c, d, gradient, volume)
        !! Gradients of shape functions 2 to 4 and the volume of a zone of four corners.
        real(dp), intent(in) :: a(3), b(3), c(3), d(3)
        real(dp), intent(out) :: gradient(3, 3), volume       !! [1/m], [m3]
        real(dp) :: p(3), q(3), r(3), six

        p = b - a
        q = c - a
        r = d - a
        gradient(:, 1) = [q(2)*r(3) - q(3)*r(2), q(3)*r(1) - q(1)*r(3), q(1)*r(2) - q(2)*r(1)]
        gradient(:, 2) = [r(2)*p(3) - r(3)*p(2), r(3)*p(1) - r(1)*p(3), r(1)*p(2) - r(2)*p(1)]
        gradient(:, 3) = [p(2)*q(3) - p(3)*q(2), p(3)*q(1) - p(1)*q(3), p(1)*q(2) - p(2)*q(1)]
        six = dot_product(p, gradient(:, 1))
        gradient = gradient/six
        volume = six/6.0_dp
    end subroutine gradients

    pure subroutine slopes(a, b, c, d, g, slope)
        !! Gradient of a field in each lane: its component, then the axis; theory.md (2.1).
        real(dp), intent(in) :: a(lanes, 3), b(lanes, 3), c(lanes, 3), d(lanes, 3), g(3, 3)
        real(dp), intent(out) :: slope(lanes, 3, 3)
        real(dp) :: p, q, r
        integer :: i, l

        do i = 1, 3
            !$omp simd private(p, q, r)
            do l = 1, lanes
                p = b(l, i) - a(l, i)
                q = c(l, i) - a(l, i)
                r = d(l, i) - a(l, i)
                slope(l, i, 1) = p*g(1, 1) + q*g(1, 2) + r*g(1, 3)
                slope(l, i, 2) = p*g(2, 1) + q*g(2, 2) + r*g(2, 3)
                slope(l, i, 3) = p*g(3, 1) + q*g(3, 2) + r*g(3, 3)
            end do
        end do
    end subroutine slopes

    pure function divergence(a, b, c, d, g) result(swell)
        !! Divergence of a field in each lane.
        real(dp), intent(in) :: a(lanes, 3), b(lanes, 3), c(lanes, 3), d(lanes, 3), g(3, 3)
        real(dp) :: swell(lanes)
        integer :: i

        swell = 0.0_dp
        do i = 1, 3
            swell = swell + (b(:, i) - a(:, i))*g(i, 1) + (c(:, i) - a(:, i))*g(i, 2) &
                + (d(:, i) - a(:, i))*g(i, 3)
        end do
    end function divergence

    pure subroutine stresses(shear, swell, slope, stress)
        !! xx yy zz yz zx xy in each lane; theory.md (2.2).
        real(dp), intent(in) :: shear, swell(lanes), slope(lanes, 3, 3)
        real(dp), intent(out) :: stress(lanes, 6)
        integer :: i

        do i = 1, 3
            stress(:, i) = swell + 2.0_dp*shear*slope(:, i, i)
        end do
        stress(:, 4) = shear*(slope(:, 2, 3) + slope(:, 3, 2))
        stress(:, 5) = shear*(slope(:, 3, 1) + slope(:, 1, 3))
        stress(:, 6) = shear*(slope(:, 1, 2) + slope(:, 2, 1))
    end subroutine stresses

    pure subroutine push(volume, gradient, s, a, b, c, d)
        !! Add the corner forces of a zone in each lane; theory.md (2.3).
        real(dp), intent(in) :: volume, gradient(3, 3), s(lanes, 6)
        real(dp), intent(inout) :: a(lanes, 3), b(lanes, 3), c(lanes, 3), d(lanes, 3)
        real(dp) :: g(3, 3), f(lanes, 3)
        integer :: i, l
        integer, parameter :: row(3, 3) = reshape([1, 6, 5, 6, 2, 4, 5, 4, 3], [3, 3])

        g = -volume*gradient
        do i = 1, 3
            !$omp simd
            do l = 1, lanes
                f(l, 1) = s(l, row(1, i))*g(1, 1) + s(l, row(2, i))*g(2, 1) + s(l, row(3, i))*g(3, 1)
                f(l, 2) = s(l, row(1, i))*g(1, 2) + s(l, row(2, i))*g(2, 2) + s(l, row(3, i))*g(3, 2)
                f(l, 3) = s(l, row(1, i))*g(1, 3) + s(l, row(2, i))*g(2, 3) + s(l, row(3, i))*g(3, 3)
                b(l, i) = b(l, i) + f(l, 1)
                c(l, i) = c(l, i) + f(l, 2)
                d(l, i) = d(l, i) + f(l, 3)
                a(l, i) = a(l, i) - (f(l, 1) + f(l, 2) + f(l, 3))
            end do
        end do
    end subroutine push

end module pyblast_lane_zones
