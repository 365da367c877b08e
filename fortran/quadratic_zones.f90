module pyblast_quadratic_zones
    !! Isotropic quadratic tetrahedra of 15 nodes whose stress is linear in fields of motion.
    !!
    !! Nodes: 4 corners, middles of the edges 12 13 14 23 24 34, centroids of the faces opposite to
    !! corners 1 to 4, and of the zone. Sides are straight, moduli the same all over a zone.
    use pyblast_kinds, only : dp, n_abreast, n_quadratic, n_quadratic_strains
    use pyblast_quadratic_strains, only : integrals, loads, strains, stresses, to_coefficients
    implicit none
    private
    public :: quadratic_energy, quadratic_forces

contains

    pure subroutine quadratic_forces(n_zones, n_slots, first, last, zone_slot, zone_lambda, &
                                     zone_shear, place, shearing, swelling, alike, force)
        !! Add the nodal forces of zones first to last, all of one domain, into its slots.
        !! Shear sees the strain of one field, compression that of another; theory.md (2.14).
        integer, intent(in) :: n_zones, n_slots, first, last
        integer, intent(in) :: zone_slot(n_zones, 15)     !! within the domain, from 1
        real(dp), intent(in) :: zone_lambda(n_zones)             !! first Lame modulus [Pa]
        real(dp), intent(in) :: zone_shear(n_zones)              !! shear modulus [Pa]
        real(dp), intent(in) :: place(3, n_slots)                !! of corners 1 to 4 [m]
        real(dp), intent(in) :: shearing(3, n_slots), swelling(3, n_slots)   !! [m]
        logical, intent(in) :: alike                             !! whether both fields are one
        real(dp), intent(inout) :: force(3, n_slots)             !! [N]
        real(dp) :: g(n_abreast, 3, 4), volume6(n_abreast), lambda(n_abreast), mu(n_abreast)
        real(dp) :: c(n_abreast, 3, n_quadratic), other(n_abreast, n_quadratic_strains)
        real(dp), dimension(n_abreast, 6, n_quadratic_strains) :: e, y
        integer :: slot(n_abreast, n_quadratic), z

        do z = first, last, n_abreast
            call moduli(n_zones, z, last, zone_lambda, zone_shear, zone_slot, lambda, mu, slot)
            call gradients(n_slots, slot, place, g, volume6)
            if (.not. alike) then
                call gather(n_slots, slot, swelling, c)
                call to_coefficients(c)
                call strains(c, g, e)
                other = e(:, 1, :) + e(:, 2, :) + e(:, 3, :)
            end if
            call gather(n_slots, slot, shearing, c)
            call to_coefficients(c)
            call strains(c, g, e)
            if (alike) other = e(:, 1, :) + e(:, 2, :) + e(:, 3, :)
            call stresses(-volume6*lambda, -volume6*mu, other, e)
            call integrals(e, y)
            call loads(g, y, c)
            call collect(min(n_abreast, last - z + 1), n_slots, slot, c, force)
        end do
    end subroutine quadratic_forces

    pure function quadratic_energy(n_zones, n_slots, first, last, zone_slot, zone_lambda, &
                                   zone_shear, place, field, share) result(energy)
        !! Strain energy of a field in springs that have a share of both moduli of the zones.
        integer, intent(in) :: n_zones, n_slots, first, last, zone_slot(n_zones, 15)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones)
        real(dp), intent(in) :: place(3, n_slots), field(3, n_slots)
        real(dp), intent(in) :: share(2)              !! of shear modulus and of that of P waves
        real(dp) :: energy                            !! [J]
        real(dp) :: g(n_abreast, 3, 4), volume6(n_abreast), lambda(n_abreast), mu(n_abreast)
        real(dp) :: c(n_abreast, 3, n_quadratic)
        real(dp), dimension(n_abreast, 6, n_quadratic_strains) :: e, s, y
        integer :: slot(n_abreast, n_quadratic), z, n

        energy = 0.0_dp
        do z = first, last, n_abreast
            n = min(n_abreast, last - z + 1)
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
    end function quadratic_energy

    pure subroutine moduli(n_zones, z, last, zone_lambda, zone_shear, zone_slot, lambda, mu, slot)
        !! What belongs to the zones from z on; lanes beyond the last repeat it.
        integer, intent(in) :: n_zones, z, last, zone_slot(n_zones, 15)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones)
        real(dp), intent(out) :: lambda(n_abreast), mu(n_abreast)
        integer, intent(out) :: slot(n_abreast, n_quadratic)
        integer :: i, at

        do i = 1, n_abreast
            at = min(z + i - 1, last)
            lambda(i) = zone_lambda(at)
            mu(i) = zone_shear(at)
            slot(i, :) = zone_slot(at, :)
        end do
    end subroutine moduli

    pure subroutine gradients(n_slots, slot, place, g, volume6)
        !! Gradients of the barycentric coordinates, and six volumes.
        integer, intent(in) :: n_slots, slot(n_abreast, n_quadratic)
        real(dp), intent(in) :: place(3, n_slots)
        real(dp), intent(out) :: g(n_abreast, 3, 4)       !! [1/m]
        real(dp), intent(out) :: volume6(n_abreast)       !! [m3]
        real(dp) :: a(3), b(3), c(3)
        integer :: i

        do i = 1, n_abreast
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
        integer, intent(in) :: n_slots, slot(n_abreast, n_quadratic)
        real(dp), intent(in) :: field(3, n_slots)
        real(dp), intent(out) :: c(n_abreast, 3, n_quadratic)
        integer :: a, i

        do a = 1, n_quadratic
            do i = 1, n_abreast
                c(i, :, a) = field(:, slot(i, a)) - field(:, slot(i, 1))
            end do
        end do
    end subroutine gather

    pure subroutine collect(n, n_slots, slot, f, force)
        !! Add the forces of n zones into slots, zone by zone.
        integer, intent(in) :: n, n_slots, slot(n_abreast, n_quadratic)
        real(dp), intent(in) :: f(n_abreast, 3, n_quadratic)
        real(dp), intent(inout) :: force(3, n_slots)
        integer :: a, i

        do i = 1, n
            do a = 1, n_quadratic
                force(:, slot(i, a)) = force(:, slot(i, a)) + f(i, :, a)
            end do
        end do
    end subroutine collect

end module pyblast_quadratic_zones
