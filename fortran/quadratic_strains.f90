module pyblast_quadratic_strains
    !! Strain in quadratic tetrahedra and the forces of stress, for zones side by side.
    !!
    !! Motion is kept as coefficients of the 15 products of barycentric coordinates, strain and
    !! stress as those of 14 of them. Most gradients of products are not there, so that this takes a
    !! third of the work of a sum over 14 points; theory.md (2.33) to (2.36).
    use pyblast_kinds, only : dp, n_abreast, n_quadratic, n_quadratic_strains
    implicit none
    private
    public :: integrals, loads, strains, stresses, to_coefficients

    integer, parameter :: edge_end(2, 6) = reshape([1, 2, 1, 3, 1, 4, 2, 3, 2, 4, 3, 4], [2, 6])
    integer, parameter :: face_edge(3, 4) = reshape([8, 9, 10, 6, 7, 10, 5, 7, 9, 5, 6, 8], [3, 4])

contains

    pure subroutine to_coefficients(c)
        !! Coefficients in place of the motion of nodes, that of corner 1 being none: theory.md (2.33).
        real(dp), intent(inout) :: c(n_abreast, 3, n_quadratic)
        real(dp) :: corners(n_abreast, 3), edges(n_abreast, 3)
        integer :: a, l

        corners = c(:, :, 2) + c(:, :, 3) + c(:, :, 4)
        do a = 1, 6
            c(:, :, 4 + a) = 4.0_dp*c(:, :, 4 + a) &
                - 2.0_dp*(c(:, :, edge_end(1, a)) + c(:, :, edge_end(2, a)))
        end do
        do l = 1, 4
            edges = c(:, :, face_edge(1, l)) + c(:, :, face_edge(2, l)) + c(:, :, face_edge(3, l))
            c(:, :, 10 + l) = 27.0_dp*c(:, :, 10 + l) - 9.0_dp*(corners - c(:, :, l)) - 3.0_dp*edges
        end do
        edges = c(:, :, 5) + c(:, :, 6) + c(:, :, 7) + c(:, :, 8) + c(:, :, 9) + c(:, :, 10)
        c(:, :, 15) = 256.0_dp*c(:, :, 15) - 64.0_dp*corners - 16.0_dp*edges &
            - 4.0_dp*(c(:, :, 11) + c(:, :, 12) + c(:, :, 13) + c(:, :, 14))
    end subroutine to_coefficients

    pure subroutine strains(c, g, e)
        !! Strain as coefficients of the 4 coordinates, of their products: theory.md (2.34).
        real(dp), intent(in) :: c(n_abreast, 3, n_quadratic), g(n_abreast, 3, 4)
        real(dp), intent(out) :: e(n_abreast, 6, n_quadratic_strains)
        integer :: a, i, j, k, l

        e = 0.0_dp
        do k = 2, 4
            call add_dyad(c(:, :, k), g(:, :, k), e(:, :, 1))
        end do
        do k = 2, 4
            e(:, :, k) = e(:, :, 1)
        end do
        do a = 1, 6
            i = edge_end(1, a)
            j = edge_end(2, a)
            k = edge_end(1, 7 - a)
            l = edge_end(2, 7 - a)
            call add_dyad(c(:, :, 4 + a), g(:, :, j), e(:, :, i))
            call add_dyad(c(:, :, 4 + a), g(:, :, i), e(:, :, j))
            call add_dyad(c(:, :, 10 + l), g(:, :, k), e(:, :, 4 + a))
            call add_dyad(c(:, :, 10 + k), g(:, :, l), e(:, :, 4 + a))
        end do
        do l = 1, 4
            call add_dyad(c(:, :, 15), g(:, :, l), e(:, :, 10 + l))
        end do
    end subroutine strains

    pure subroutine add_dyad(c, g, e)
        !! Add the strain of a motion c along a gradient g: xx yy zz and the shears yz zx xy.
        real(dp), intent(in) :: c(n_abreast, 3), g(n_abreast, 3)
        real(dp), intent(inout) :: e(n_abreast, 6)
        integer :: i

        !$omp simd
        do i = 1, n_abreast
            e(i, 1) = e(i, 1) + c(i, 1)*g(i, 1)
            e(i, 2) = e(i, 2) + c(i, 2)*g(i, 2)
            e(i, 3) = e(i, 3) + c(i, 3)*g(i, 3)
            e(i, 4) = e(i, 4) + c(i, 2)*g(i, 3) + c(i, 3)*g(i, 2)
            e(i, 5) = e(i, 5) + c(i, 3)*g(i, 1) + c(i, 1)*g(i, 3)
            e(i, 6) = e(i, 6) + c(i, 1)*g(i, 2) + c(i, 2)*g(i, 1)
        end do
    end subroutine add_dyad

    pure subroutine stresses(lambda, mu, swelling, e)
        !! Stress in place of strain, from the dilation of another field; theory.md (2.14).
        real(dp), intent(in) :: lambda(n_abreast), mu(n_abreast), swelling(n_abreast, n_quadratic_strains)
        real(dp), intent(inout) :: e(n_abreast, 6, n_quadratic_strains)
        real(dp) :: mean(n_abreast)
        integer :: a, j

        do a = 1, n_quadratic_strains
            mean = (lambda + 2.0_dp*mu)*swelling(:, a) &
                - 2.0_dp*mu*(e(:, 1, a) + e(:, 2, a) + e(:, 3, a))
            do j = 1, 3
                e(:, j, a) = mean + 2.0_dp*mu*e(:, j, a)
                e(:, j + 3, a) = mu*e(:, j + 3, a)
            end do
        end do
    end subroutine stresses

    pure subroutine integrals(e, y)
        !! Integrals of stress times each of the 14 products, over six volumes: theory.md (2.35)
        real(dp), intent(in) :: e(6*n_abreast, n_quadratic_strains)
        real(dp), intent(out) :: y(6*n_abreast, n_quadratic_strains)
        real(dp) :: near(6*n_abreast, 4), one(6*n_abreast), ones(6*n_abreast)
        integer :: a, b, k, l

        near(:, 1) = e(:, 5) + e(:, 6) + e(:, 7)
        near(:, 2) = e(:, 5) + e(:, 8) + e(:, 9)
        near(:, 3) = e(:, 6) + e(:, 8) + e(:, 10)
        near(:, 4) = e(:, 7) + e(:, 9) + e(:, 10)
        one = e(:, 1) + e(:, 2) + e(:, 3) + e(:, 4)
        ones = 42.0_dp*one + 3.5_dp*(near(:, 1) + near(:, 2) + near(:, 3) + near(:, 4))
        do k = 1, 4
            y(:, k) = (ones + 42.0_dp*e(:, k) + 7.0_dp*near(:, k) - e(:, 10 + k))*(1.0_dp/5040.0_dp)
            y(:, 10 + k) = (2.0_dp*e(:, 10 + k) - 36.0_dp*e(:, k) - 9.0_dp*near(:, k)) &
                *(1.0_dp/181440.0_dp)
        end do
        do a = 1, 6
            k = edge_end(1, a)
            l = edge_end(2, a)
            b = 7 - a
            y(:, 4 + a) = (28.0_dp*(one + (e(:, k) + e(:, l))) + 8.0_dp*(near(:, k) + near(:, l)) &
                           + 4.0_dp*e(:, 4 + b) + (e(:, 10 + edge_end(1, b)) &
                                                   + e(:, 10 + edge_end(2, b))))*(1.0_dp/20160.0_dp)
        end do
    end subroutine integrals

    pure subroutine loads(g, e, f)
        !! Nodal forces of integrals of stress: theory.md (2.36).
        real(dp), intent(in) :: g(n_abreast, 3, 4), e(n_abreast, 6, n_quadratic_strains)
        real(dp), intent(out) :: f(n_abreast, 3, n_quadratic)
        real(dp) :: total(n_abreast, 6)
        integer :: a, i, j, k, l

        f = 0.0_dp
        total = e(:, :, 1) + e(:, :, 2) + e(:, :, 3) + e(:, :, 4)
        do l = 1, 4
            call add_traction(total, g(:, :, l), f(:, :, l))
            call add_traction(e(:, :, 10 + l), g(:, :, l), f(:, :, 15))
        end do
        do a = 1, 6
            i = edge_end(1, a)
            j = edge_end(2, a)
            k = edge_end(1, 7 - a)
            l = edge_end(2, 7 - a)
            call add_traction(e(:, :, i), g(:, :, j), f(:, :, 4 + a))
            call add_traction(e(:, :, j), g(:, :, i), f(:, :, 4 + a))
            call add_traction(e(:, :, 4 + a), g(:, :, k), f(:, :, 10 + l))
            call add_traction(e(:, :, 4 + a), g(:, :, l), f(:, :, 10 + k))
        end do
        call to_nodes(f)
    end subroutine loads

    pure subroutine add_traction(s, g, f)
        !! Add the product of a stress and a gradient.
        real(dp), intent(in) :: s(n_abreast, 6), g(n_abreast, 3)
        real(dp), intent(inout) :: f(n_abreast, 3)
        integer :: i

        !$omp simd
        do i = 1, n_abreast
            f(i, 1) = f(i, 1) + s(i, 1)*g(i, 1) + s(i, 6)*g(i, 2) + s(i, 5)*g(i, 3)
            f(i, 2) = f(i, 2) + s(i, 6)*g(i, 1) + s(i, 2)*g(i, 2) + s(i, 4)*g(i, 3)
            f(i, 3) = f(i, 3) + s(i, 5)*g(i, 1) + s(i, 4)*g(i, 2) + s(i, 3)*g(i, 3)
        end do
    end subroutine add_traction

    pure subroutine to_nodes(f)
        !! Forces on nodes in place of forces on coefficients; those of corner 1 close the sum.
        real(dp), intent(inout) :: f(n_abreast, 3, n_quadratic)
        integer :: a, j, l

        do l = 1, 4
            f(:, :, 10 + l) = f(:, :, 10 + l) - 4.0_dp*f(:, :, 15)
        end do
        do a = 5, 10
            f(:, :, a) = f(:, :, a) - 16.0_dp*f(:, :, 15)
        end do
        do l = 1, 4
            do j = 1, 3
                a = face_edge(j, l)
                f(:, :, a) = f(:, :, a) - 3.0_dp*f(:, :, 10 + l)
            end do
        end do
        do l = 2, 4
            f(:, :, l) = f(:, :, l) - 64.0_dp*f(:, :, 15) - 9.0_dp*( &
                f(:, :, 11) + f(:, :, 12) + f(:, :, 13) + f(:, :, 14) - f(:, :, 10 + l))
        end do
        do a = 1, 6
            do j = 1, 2
                l = edge_end(j, a)
                f(:, :, l) = f(:, :, l) - 2.0_dp*f(:, :, 4 + a)
            end do
        end do
        f(:, :, 5:10) = 4.0_dp*f(:, :, 5:10)
        f(:, :, 11:14) = 27.0_dp*f(:, :, 11:14)
        f(:, :, 15) = 256.0_dp*f(:, :, 15)
        f(:, :, 1) = -sum(f(:, :, 2:), dim=3)
    end subroutine to_nodes

end module pyblast_quadratic_strains
