module pyblast_tet15
    !! Isotropic quadratic tetrahedra of 15 nodes whose stress is linear in fields of motion.
    !!
    !! Nodes: 4 corners, middles of the edges 12 13 14 23 24 34, centroids of the faces opposite to
    !! corners 1 to 4, and of the zone. Sides are straight, moduli the same all over a zone.
    use pyblast_kinds, only : dp, tet15_width, n_tet15, n_tet15_strains
    implicit none
    private
    public :: tet15_energy, tet15_forces

    integer, parameter :: edge_end(2, 6) = reshape([1, 2, 1, 3, 1, 4, 2, 3, 2, 4, 3, 4], [2, 6])
    integer, parameter :: face_edge(3, 4) = reshape([8, 9, 10, 6, 7, 10, 5, 7, 9, 5, 6, 8], [3, 4])

contains

    pure subroutine tet15_forces(n_zones, n_slots, first, last, zone_slot, zone_lambda, &
                                     zone_shear, place, deviatoric, volumetric, same_field, force)
        !! Add the nodal forces of zones first to last, all of one domain, into its slots.
        !! Shear sees the strain of one field, compression that of another; theory.md (2.14).
        integer, intent(in) :: n_zones, n_slots, first, last
        integer, intent(in) :: zone_slot(n_zones, 15)     !! within the domain, from 1
        real(dp), intent(in) :: zone_lambda(n_zones)             !! first Lame modulus [Pa]
        real(dp), intent(in) :: zone_shear(n_zones)              !! shear modulus [Pa]
        real(dp), intent(in) :: place(3, n_slots)                !! of corners 1 to 4 [m]
        real(dp), intent(in) :: deviatoric(3, n_slots), volumetric(3, n_slots)   !! [m]
        logical, intent(in) :: same_field                             !! whether both fields are one
        real(dp), intent(inout) :: force(3, n_slots)             !! [N]
        real(dp) :: g(tet15_width, 3, 4), volume6(tet15_width), lambda(tet15_width), mu(tet15_width)
        real(dp) :: c(tet15_width, 3, n_tet15), other(tet15_width, n_tet15_strains)
        real(dp), dimension(tet15_width, 6, n_tet15_strains) :: e, y
        integer :: slot(tet15_width, n_tet15), z

        do z = first, last, tet15_width
            call moduli(n_zones, z, last, zone_lambda, zone_shear, zone_slot, lambda, mu, slot)
            call gradients(n_slots, slot, place, g, volume6)
            if (.not. same_field) then
                call gather(n_slots, slot, volumetric, c)
                call to_coefficients(c)
                call strains(c, g, e)
                other = e(:, 1, :) + e(:, 2, :) + e(:, 3, :)
            end if
            call gather(n_slots, slot, deviatoric, c)
            call to_coefficients(c)
            call strains(c, g, e)
            if (same_field) other = e(:, 1, :) + e(:, 2, :) + e(:, 3, :)
            call stresses(-volume6*lambda, -volume6*mu, other, e)
            call integrals(e, y)
            call loads(g, y, c)
            call collect(min(tet15_width, last - z + 1), n_slots, slot, c, force)
        end do
    end subroutine tet15_forces

    pure function tet15_energy(n_zones, n_slots, first, last, zone_slot, zone_lambda, &
                                   zone_shear, place, field, share) result(energy)
        !! Strain energy of a field in springs that have a share of both moduli of the zones.
        integer, intent(in) :: n_zones, n_slots, first, last, zone_slot(n_zones, 15)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones)
        real(dp), intent(in) :: place(3, n_slots), field(3, n_slots)
        real(dp), intent(in) :: share(2)              !! of shear modulus and of that of P waves
        real(dp) :: energy                            !! [J]
        real(dp) :: g(tet15_width, 3, 4), volume6(tet15_width), lambda(tet15_width), mu(tet15_width)
        real(dp) :: c(tet15_width, 3, n_tet15)
        real(dp), dimension(tet15_width, 6, n_tet15_strains) :: e, s, y
        integer :: slot(tet15_width, n_tet15), z, n

        energy = 0.0_dp
        do z = first, last, tet15_width
            n = min(tet15_width, last - z + 1)
            call moduli(n_zones, z, last, zone_lambda, zone_shear, zone_slot, lambda, mu, slot)
            lambda = share(2)*(lambda + 2.0_dp*mu) - 2.0_dp*share(1)*mu
            mu = share(1)*mu
            call gradients(n_slots, slot, place, g, volume6)
            call gather(n_slots, slot, field, c)
            call to_coefficients(c)
            call strains(c, g, e)
            s = e
            call stresses(0.5_dp*volume6*lambda, 0.5_dp*volume6*mu, &
                          e(:, 1, :) + e(:, 2, :) + e(:, 3, :), s)
            call integrals(s, y)
            energy = energy + sum(e(:n, :, :)*y(:n, :, :))
        end do
    end function tet15_energy

    pure subroutine moduli(n_zones, z, last, zone_lambda, zone_shear, zone_slot, lambda, mu, slot)
        !! What belongs to the zones from z on; n_batch beyond the last repeat it.
        integer, intent(in) :: n_zones, z, last, zone_slot(n_zones, 15)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones)
        real(dp), intent(out) :: lambda(tet15_width), mu(tet15_width)
        integer, intent(out) :: slot(tet15_width, n_tet15)
        integer :: i, at

        do i = 1, tet15_width
            at = min(z + i - 1, last)
            lambda(i) = zone_lambda(at)
            mu(i) = zone_shear(at)
            slot(i, :) = zone_slot(at, :)
        end do
    end subroutine moduli

    pure subroutine gradients(n_slots, slot, place, g, volume6)
        !! Gradients of the barycentric coordinates, and six volumes.
        integer, intent(in) :: n_slots, slot(tet15_width, n_tet15)
        real(dp), intent(in) :: place(3, n_slots)
        real(dp), intent(out) :: g(tet15_width, 3, 4)       !! [1/m]
        real(dp), intent(out) :: volume6(tet15_width)       !! [m3]
        real(dp) :: a(3), b(3), c(3)
        integer :: i

        do i = 1, tet15_width
            a = place(:, slot(i, 2)) - place(:, slot(i, 1))
            b = place(:, slot(i, 3)) - place(:, slot(i, 1))
            c = place(:, slot(i, 4)) - place(:, slot(i, 1))
            g(i, :, 2) = [b(2)*c(3) - b(3)*c(2), b(3)*c(1) - b(1)*c(3), b(1)*c(2) - b(2)*c(1)]
            g(i, :, 3) = [c(2)*a(3) - c(3)*a(2), c(3)*a(1) - c(1)*a(3), c(1)*a(2) - c(2)*a(1)]
            g(i, :, 4) = [a(2)*b(3) - a(3)*b(2), a(3)*b(1) - a(1)*b(3), a(1)*b(2) - a(2)*b(1)]
            volume6(i) = a(1)*g(i, 1, 2) + a(2)*g(i, 2, 2) + a(3)*g(i, 3, 2)
            g(i, :, 2:4) = g(i, :, 2:4)/volume6(i)
            g(i, :, 1) = -(g(i, :, 2) + g(i, :, 3) + g(i, :, 4))
        end do
    end subroutine gradients

    pure subroutine gather(n_slots, slot, field, c)
        !! Motion of the nodes less that of corner 1.
        integer, intent(in) :: n_slots, slot(tet15_width, n_tet15)
        real(dp), intent(in) :: field(3, n_slots)
        real(dp), intent(out) :: c(tet15_width, 3, n_tet15)
        integer :: a, i

        do a = 1, n_tet15
            do i = 1, tet15_width
                c(i, :, a) = field(:, slot(i, a)) - field(:, slot(i, 1))
            end do
        end do
    end subroutine gather

    pure subroutine collect(n, n_slots, slot, f, force)
        !! Add the forces of n zones into slots, zone by zone.
        integer, intent(in) :: n, n_slots, slot(tet15_width, n_tet15)
        real(dp), intent(in) :: f(tet15_width, 3, n_tet15)
        real(dp), intent(inout) :: force(3, n_slots)
        integer :: a, i

        do i = 1, n
            do a = 1, n_tet15
                force(:, slot(i, a)) = force(:, slot(i, a)) + f(i, :, a)
            end do
        end do
    end subroutine collect

    pure subroutine to_coefficients(c)
        !! Coefficients in place of the motion of nodes, that of corner 1 being none: theory.md (2.33).
        real(dp), intent(inout) :: c(tet15_width, 3, n_tet15)
        real(dp) :: corners(tet15_width, 3), edges(tet15_width, 3)
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
        real(dp), intent(in) :: c(tet15_width, 3, n_tet15), g(tet15_width, 3, 4)
        real(dp), intent(out) :: e(tet15_width, 6, n_tet15_strains)
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
        real(dp), intent(in) :: c(tet15_width, 3), g(tet15_width, 3)
        real(dp), intent(inout) :: e(tet15_width, 6)
        integer :: i

        !$omp simd
        do i = 1, tet15_width
            e(i, 1) = e(i, 1) + c(i, 1)*g(i, 1)
            e(i, 2) = e(i, 2) + c(i, 2)*g(i, 2)
            e(i, 3) = e(i, 3) + c(i, 3)*g(i, 3)
            e(i, 4) = e(i, 4) + c(i, 2)*g(i, 3) + c(i, 3)*g(i, 2)
            e(i, 5) = e(i, 5) + c(i, 3)*g(i, 1) + c(i, 1)*g(i, 3)
            e(i, 6) = e(i, 6) + c(i, 1)*g(i, 2) + c(i, 2)*g(i, 1)
        end do
    end subroutine add_dyad

    pure subroutine stresses(lambda, mu, volumetric, e)
        !! Stress in place of strain, from the dilation of another field; theory.md (2.14).
        real(dp), intent(in) :: lambda(tet15_width), mu(tet15_width), volumetric(tet15_width, n_tet15_strains)
        real(dp), intent(inout) :: e(tet15_width, 6, n_tet15_strains)
        real(dp) :: mean(tet15_width)
        integer :: a, j

        do a = 1, n_tet15_strains
            mean = (lambda + 2.0_dp*mu)*volumetric(:, a) &
                - 2.0_dp*mu*(e(:, 1, a) + e(:, 2, a) + e(:, 3, a))
            do j = 1, 3
                e(:, j, a) = mean + 2.0_dp*mu*e(:, j, a)
                e(:, j + 3, a) = mu*e(:, j + 3, a)
            end do
        end do
    end subroutine stresses

    pure subroutine integrals(e, y)
        !! Integrals of stress times each of the 14 products, over six volumes: theory.md (2.35)
        real(dp), intent(in) :: e(6*tet15_width, n_tet15_strains)
        real(dp), intent(out) :: y(6*tet15_width, n_tet15_strains)
        real(dp) :: near(6*tet15_width, 4), one(6*tet15_width), ones(6*tet15_width)
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
        real(dp), intent(in) :: g(tet15_width, 3, 4), e(tet15_width, 6, n_tet15_strains)
        real(dp), intent(out) :: f(tet15_width, 3, n_tet15)
        real(dp) :: total(tet15_width, 6)
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
        real(dp), intent(in) :: s(tet15_width, 6), g(tet15_width, 3)
        real(dp), intent(inout) :: f(tet15_width, 3)
        integer :: i

        !$omp simd
        do i = 1, tet15_width
            f(i, 1) = f(i, 1) + s(i, 1)*g(i, 1) + s(i, 6)*g(i, 2) + s(i, 5)*g(i, 3)
            f(i, 2) = f(i, 2) + s(i, 6)*g(i, 1) + s(i, 2)*g(i, 2) + s(i, 4)*g(i, 3)
            f(i, 3) = f(i, 3) + s(i, 5)*g(i, 1) + s(i, 4)*g(i, 2) + s(i, 3)*g(i, 3)
        end do
    end subroutine add_traction

    pure subroutine to_nodes(f)
        !! Forces on nodes in place of forces on coefficients; those of corner 1 close the sum.
        real(dp), intent(inout) :: f(tet15_width, 3, n_tet15)
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

end module pyblast_tet15
