module pyblast_tet4_batch
    !! The zones of `pyblast_tet4` for models that run together: n_batch side by side.
    !!
    !! Gradients are found once for all n_batch, and nothing is gathered but whole vectors.
    use pyblast_kinds, only : dp
    use pyblast_batch, only : n_batch
    implicit none
    private
    public :: tet4_batch_forces

contains

    pure subroutine tet4_batch_forces(n_zones, n_slots, first, last, zone_slot, zone_lambda, zone_shear, &
                                position, deviatoric, volumetric, same_field, force)
        !! Add the corner forces of zones first to last; arguments as in tet4_forces.
        integer, intent(in) :: n_zones, n_slots, first, last, zone_slot(n_zones, 4)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones), position(3, n_slots)
        real(dp), intent(in) :: deviatoric(n_batch, 3, n_slots), volumetric(n_batch, 3, n_slots)   !! [m]
        logical, intent(in) :: same_field
        real(dp), intent(inout) :: force(n_batch, 3, n_slots)                                !! [N]
        real(dp) :: gradient(3, 3), volume, slope(n_batch, 3, 3), isotropic(n_batch), stress(n_batch, 6)
        integer :: z, slot(4)

        do z = first, last
            slot = zone_slot(z, :)
            call gradients(position(:, slot(1)), position(:, slot(2)), position(:, slot(3)), &
                           position(:, slot(4)), gradient, volume)
            call slopes(deviatoric(:, :, slot(1)), deviatoric(:, :, slot(2)), &
                        deviatoric(:, :, slot(3)), deviatoric(:, :, slot(4)), gradient, slope)
            isotropic = zone_lambda(z)*(slope(:, 1, 1) + slope(:, 2, 2) + slope(:, 3, 3))
            if (.not. same_field) isotropic = isotropic + (zone_lambda(z) + 2.0_dp*zone_shear(z))*( &
                divergence(volumetric(:, :, slot(1)), volumetric(:, :, slot(2)), &
                           volumetric(:, :, slot(3)), volumetric(:, :, slot(4)), gradient) &
                - (slope(:, 1, 1) + slope(:, 2, 2) + slope(:, 3, 3)))
            call stresses(zone_shear(z), isotropic, slope, stress)
            call internal_force(volume, gradient, stress, force(:, :, slot(1)), force(:, :, slot(2)), &
                      force(:, :, slot(3)), force(:, :, slot(4)))
        end do
    end subroutine tet4_batch_forces

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
        !! Gradient of a field of each model: its component, then the axis; theory.md (2.1).
        real(dp), intent(in) :: a(n_batch, 3), b(n_batch, 3), c(n_batch, 3), d(n_batch, 3), g(3, 3)
        real(dp), intent(out) :: slope(n_batch, 3, 3)
        real(dp) :: p, q, r
        integer :: i, l

        do i = 1, 3
            !$omp simd private(p, q, r)
            do l = 1, n_batch
                p = b(l, i) - a(l, i)
                q = c(l, i) - a(l, i)
                r = d(l, i) - a(l, i)
                slope(l, i, 1) = p*g(1, 1) + q*g(1, 2) + r*g(1, 3)
                slope(l, i, 2) = p*g(2, 1) + q*g(2, 2) + r*g(2, 3)
                slope(l, i, 3) = p*g(3, 1) + q*g(3, 2) + r*g(3, 3)
            end do
        end do
    end subroutine slopes

    pure function divergence(a, b, c, d, g) result(dilatation)
        !! Divergence of a field of each model.
        real(dp), intent(in) :: a(n_batch, 3), b(n_batch, 3), c(n_batch, 3), d(n_batch, 3), g(3, 3)
        real(dp) :: dilatation(n_batch)
        integer :: i

        dilatation = 0.0_dp
        do i = 1, 3
            dilatation = dilatation + (b(:, i) - a(:, i))*g(i, 1) + (c(:, i) - a(:, i))*g(i, 2) &
                + (d(:, i) - a(:, i))*g(i, 3)
        end do
    end function divergence

    pure subroutine stresses(shear, isotropic, slope, stress)
        !! xx yy zz yz zx xy of each model; theory.md (2.2).
        real(dp), intent(in) :: shear, isotropic(n_batch), slope(n_batch, 3, 3)
        real(dp), intent(out) :: stress(n_batch, 6)
        integer :: i

        do i = 1, 3
            stress(:, i) = isotropic + 2.0_dp*shear*slope(:, i, i)
        end do
        stress(:, 4) = shear*(slope(:, 2, 3) + slope(:, 3, 2))
        stress(:, 5) = shear*(slope(:, 3, 1) + slope(:, 1, 3))
        stress(:, 6) = shear*(slope(:, 1, 2) + slope(:, 2, 1))
    end subroutine stresses

    pure subroutine internal_force(volume, gradient, s, a, b, c, d)
        !! Add the corner forces of a zone of each model; theory.md (2.3).
        real(dp), intent(in) :: volume, gradient(3, 3), s(n_batch, 6)
        real(dp), intent(inout) :: a(n_batch, 3), b(n_batch, 3), c(n_batch, 3), d(n_batch, 3)
        real(dp) :: g(3, 3), f(n_batch, 3)
        integer :: i, l
        integer, parameter :: row(3, 3) = reshape([1, 6, 5, 6, 2, 4, 5, 4, 3], [3, 3])

        g = -volume*gradient
        do i = 1, 3
            !$omp simd
            do l = 1, n_batch
                f(l, 1) = s(l, row(1, i))*g(1, 1) + s(l, row(2, i))*g(2, 1) + s(l, row(3, i))*g(3, 1)
                f(l, 2) = s(l, row(1, i))*g(1, 2) + s(l, row(2, i))*g(2, 2) + s(l, row(3, i))*g(3, 2)
                f(l, 3) = s(l, row(1, i))*g(1, 3) + s(l, row(2, i))*g(2, 3) + s(l, row(3, i))*g(3, 3)
                b(l, i) = b(l, i) + f(l, 1)
                c(l, i) = c(l, i) + f(l, 2)
                d(l, i) = d(l, i) + f(l, 3)
                a(l, i) = a(l, i) - (f(l, 1) + f(l, 2) + f(l, 3))
            end do
        end do
    end subroutine internal_force

end module pyblast_tet4_batch
