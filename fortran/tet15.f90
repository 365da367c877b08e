module pyblast_tet15
    !! Isotropic quadratic tetrahedra of 15 nodes, in packs that are computed together.
    !!
    !! Nodes: 4 corners, middles of the edges 12 13 14 23 24 34, centroids of the faces opposite to
    !! corners 1 to 4, and of the zone. Sides are straight, moduli the same all over a zone.
    use pyblast_kinds, only : dp, n_tet15, tet15_width
    use pyblast_processor, only : has_wide_vectors
    use pyblast_tet15_kernels, only : tet15_kernel
    implicit none
    private
    public :: tet15_energy, tet15_forces

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
        logical, intent(in) :: same_field                        !! whether both fields are one
        real(dp), intent(inout) :: force(3, n_slots)             !! [N]
        real(dp) :: metric(tet15_width, 11)
        real(dp), dimension(tet15_width, 3, n_tet15) :: u, other, f
        integer :: slot(tet15_width, n_tet15), z
        logical :: wide

        wide = has_wide_vectors()
        do z = first, last, tet15_width
            call slots_of(n_zones, z, last, zone_slot, slot)
            call metric_of(n_zones, n_slots, z, last, zone_lambda, zone_shear, slot, place, metric)
            call gather(n_slots, slot, deviatoric, u)
            if (same_field) then
                call tet15_kernel(wide, metric, u, .false., u, f)
            else
                call gather(n_slots, slot, volumetric, other)
                call tet15_kernel(wide, metric, u, .true., other, f)
            end if
            call collect(n_slots, slot, f, force)
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
        real(dp) :: metric(tet15_width, 11), by_zone(tet15_width)
        real(dp), dimension(tet15_width, 3, n_tet15) :: u, f
        integer :: slot(tet15_width, n_tet15), z, a, c
        logical :: wide

        energy = 0.0_dp
        wide = has_wide_vectors()
        do z = first, last, tet15_width
            call slots_of(n_zones, z, last, zone_slot, slot)
            call metric_of(n_zones, n_slots, z, last, zone_lambda, zone_shear, slot, place, metric)
            metric(:, 10) = share(2)*(metric(:, 10) + 2.0_dp*metric(:, 11)) &
                - 2.0_dp*share(1)*metric(:, 11)
            metric(:, 11) = share(1)*metric(:, 11)
            call gather(n_slots, slot, field, u)
            call tet15_kernel(wide, metric, u, .false., u, f)
            by_zone = 0.0_dp
            do a = 2, n_tet15
                do c = 1, 3
                    by_zone = by_zone - 0.5_dp*(u(:, c, a) - u(:, c, 1))*f(:, c, a)
                end do
            end do
            energy = energy + sum(by_zone)
        end do
    end function tet15_energy

    pure subroutine slots_of(n_zones, z, last, zone_slot, slot)
        !! Slots of the zones from z on; beyond the last they repeat it.
        integer, intent(in) :: n_zones, z, last, zone_slot(n_zones, 15)
        integer, intent(out) :: slot(tet15_width, n_tet15)
        integer :: a, l

        if (z + tet15_width - 1 <= last) then
            do a = 1, n_tet15
                do l = 1, tet15_width
                    slot(l, a) = zone_slot(z + l - 1, a)
                end do
            end do
        else
            do a = 1, n_tet15
                do l = 1, tet15_width
                    slot(l, a) = zone_slot(min(z + l - 1, last), a)
                end do
            end do
        end if
    end subroutine slots_of

    pure subroutine metric_of(n_zones, n_slots, z, last, zone_lambda, zone_shear, slot, place, &
                              metric)
        !! Slopes of the three axes of each zone, and minus its moduli times its volume: none beyond
        !! the last zone. The axes are sums of coordinates, twice (12), (13) and (14); theory.md (2.34).
        integer, intent(in) :: n_zones, n_slots, z, last, slot(tet15_width, n_tet15)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones), place(3, n_slots)
        real(dp), intent(out) :: metric(tet15_width, 11)
        real(dp) :: side(tet15_width, 3, 3), n2(3), n3(3), n4(3), volume6, scale
        integer :: c, l, m

        do m = 1, 3
            do c = 1, 3
                do l = 1, tet15_width
                    side(l, c, m) = place(c, slot(l, m + 1)) - place(c, slot(l, 1))
                end do
            end do
        end do
        do l = 1, tet15_width
            metric(l, 10) = zone_lambda(min(z + l - 1, last))
            metric(l, 11) = zone_shear(min(z + l - 1, last))
        end do
        !$omp simd private(n2, n3, n4, volume6, scale)
        do l = 1, tet15_width
            n2(1) = side(l, 2, 2)*side(l, 3, 3) - side(l, 3, 2)*side(l, 2, 3)
            n2(2) = side(l, 3, 2)*side(l, 1, 3) - side(l, 1, 2)*side(l, 3, 3)
            n2(3) = side(l, 1, 2)*side(l, 2, 3) - side(l, 2, 2)*side(l, 1, 3)
            n3(1) = side(l, 2, 3)*side(l, 3, 1) - side(l, 3, 3)*side(l, 2, 1)
            n3(2) = side(l, 3, 3)*side(l, 1, 1) - side(l, 1, 3)*side(l, 3, 1)
            n3(3) = side(l, 1, 3)*side(l, 2, 1) - side(l, 2, 3)*side(l, 1, 1)
            n4(1) = side(l, 2, 1)*side(l, 3, 2) - side(l, 3, 1)*side(l, 2, 2)
            n4(2) = side(l, 3, 1)*side(l, 1, 2) - side(l, 1, 1)*side(l, 3, 2)
            n4(3) = side(l, 1, 1)*side(l, 2, 2) - side(l, 2, 1)*side(l, 1, 2)
            volume6 = side(l, 1, 1)*n2(1) + side(l, 2, 1)*n2(2) + side(l, 3, 1)*n2(3)
            scale = -2.0_dp/volume6
            metric(l, 1) = scale*(n3(1) + n4(1))
            metric(l, 2) = scale*(n3(2) + n4(2))
            metric(l, 3) = scale*(n3(3) + n4(3))
            metric(l, 4) = scale*(n2(1) + n4(1))
            metric(l, 5) = scale*(n2(2) + n4(2))
            metric(l, 6) = scale*(n2(3) + n4(3))
            metric(l, 7) = scale*(n2(1) + n3(1))
            metric(l, 8) = scale*(n2(2) + n3(2))
            metric(l, 9) = scale*(n2(3) + n3(3))
            volume6 = -volume6/6.0_dp
            if (l > last - z + 1) volume6 = 0.0_dp
            metric(l, 10) = volume6*metric(l, 10)
            metric(l, 11) = volume6*metric(l, 11)
        end do
    end subroutine metric_of

    pure subroutine gather(n_slots, slot, field, u)
        !! Motion of the nodes of zones.
        integer, intent(in) :: n_slots, slot(tet15_width, n_tet15)
        real(dp), intent(in) :: field(3, n_slots)
        real(dp), intent(out) :: u(tet15_width, 3, n_tet15)
        integer :: a, l

        do a = 1, n_tet15
            do l = 1, tet15_width
                u(l, 1, a) = field(1, slot(l, a))
                u(l, 2, a) = field(2, slot(l, a))
                u(l, 3, a) = field(3, slot(l, a))
            end do
        end do
    end subroutine gather

    pure subroutine collect(n_slots, slot, f, force)
        !! Add the forces of zones into slots, node by node.
        integer, intent(in) :: n_slots, slot(tet15_width, n_tet15)
        real(dp), intent(in) :: f(tet15_width, 3, n_tet15)
        real(dp), intent(inout) :: force(3, n_slots)
        integer :: a, l, s

        do a = 1, n_tet15
            do l = 1, tet15_width
                s = slot(l, a)
                force(1, s) = force(1, s) + f(l, 1, a)
                force(2, s) = force(2, s) + f(l, 2, a)
                force(3, s) = force(3, s) + f(l, 3, a)
            end do
        end do
    end subroutine collect

end module pyblast_tet15
