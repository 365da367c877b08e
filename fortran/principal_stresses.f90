module pyblast_principal_stresses
    !! Principal stresses and their axes.
    use pyblast_kinds, only : dp
    implicit none
    private
    public :: cross, principal

contains

    pure subroutine principal(stress, value, axes)
        !! Principal stresses in descending order and their axes, by Jacobi's rotations (1846).
        real(dp), intent(in) :: stress(6)
        real(dp), intent(out) :: value(3)
        real(dp), intent(out) :: axes(3, 3)          !! columns
        real(dp) :: a(3, 3), old(3), t, c, s
        integer :: sweep, i, j, k

        a = reshape(stress([1, 6, 5, 6, 2, 4, 5, 4, 3]), [3, 3])
        axes = 0.0_dp
        do k = 1, 3
            axes(k, k) = 1.0_dp
        end do
        do sweep = 1, 10
            if (abs(a(1, 2)) + abs(a(2, 3)) + abs(a(1, 3)) <= 1e-17_dp*sum(abs(stress))) exit
            do k = 1, 3
                i = max(1, k - 1)
                j = min(3, k + 1)
                if (.not. abs(a(i, j)) > 0.0_dp) cycle
                t = 0.5_dp*(a(j, j) - a(i, i))/a(i, j)
                t = sign(1.0_dp, t)/(abs(t) + sqrt(1.0_dp + t**2))
                c = 1.0_dp/sqrt(1.0_dp + t**2)
                s = t*c
                old = a(:, i)
                a(:, i) = c*old - s*a(:, j)
                a(:, j) = s*old + c*a(:, j)
                old = a(i, :)
                a(i, :) = c*old - s*a(j, :)
                a(j, :) = s*old + c*a(j, :)
                old = axes(:, i)
                axes(:, i) = c*old - s*axes(:, j)
                axes(:, j) = s*old + c*axes(:, j)
            end do
        end do
        call sort_descending(a, value, axes)
    end subroutine principal

    pure subroutine sort_descending(a, value, axes)
        !! Order the diagonal of a matrix and the columns that belong to it.
        real(dp), intent(in) :: a(3, 3)
        real(dp), intent(out) :: value(3)
        real(dp), intent(inout) :: axes(3, 3)
        integer :: order(3)

        value = [a(1, 1), a(2, 2), a(3, 3)]
        order = [maxloc(value), 0, minloc(value, back=.true.)]
        order(2) = 6 - order(1) - order(3)
        value = value(order)
        axes = axes(:, order)
    end subroutine sort_descending

    pure function cross(a, b) result(c)
        !! Vector product.
        real(dp), intent(in) :: a(3), b(3)
        real(dp) :: c(3)

        c = [a(2)*b(3) - a(3)*b(2), a(3)*b(1) - a(1)*b(3), a(1)*b(2) - a(2)*b(1)]
    end function cross

end module pyblast_principal_stresses
