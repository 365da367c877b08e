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

    pure subroutine tet15_forces(n_zones, n_slots, n_packs, first, last, zone_slot, metric, &
                                 deviatoric, volumetric, same_field, force)
        !! Add the nodal forces of zones first to last, all of one domain, into its slots.
        !! Shear sees the strain of one field, compression that of another; theory.md (2.14).
        integer, intent(in) :: n_zones, n_slots, n_packs, first, last
        integer, intent(in) :: zone_slot(n_zones, 15)            !! within the domain, from 1
        real(dp), intent(in) :: metric(tet15_width, 11, n_packs)
            !! of packs from zone first on: slopes of three axes [1/m], minus the Lame moduli times
            !! the volume [J]
        real(dp), intent(in) :: deviatoric(3, n_slots), volumetric(3, n_slots)   !! [m]
        logical, intent(in) :: same_field                        !! whether both fields are one
        real(dp), intent(inout) :: force(3, n_slots)             !! [N]
        real(dp), dimension(tet15_width, 3, n_tet15) :: u, other, f
        integer :: p, z
        logical :: wide

        wide = has_wide_vectors()
        p = 0
        do z = first, last, tet15_width
            p = p + 1
            call gather(n_zones, n_slots, z, last, zone_slot, deviatoric, u)
            if (same_field) then
                call tet15_kernel(wide, metric(:, :, p), u, .false., u, f)
            else
                call gather(n_zones, n_slots, z, last, zone_slot, volumetric, other)
                call tet15_kernel(wide, metric(:, :, p), u, .true., other, f)
            end if
            call collect(n_zones, n_slots, z, last, zone_slot, f, force)
        end do
    end subroutine tet15_forces

    pure function tet15_energy(n_zones, n_slots, n_packs, first, last, zone_slot, metric, field, &
                               share) result(energy)
        !! Strain energy of a field in springs that have a share of both moduli of the zones.
        integer, intent(in) :: n_zones, n_slots, n_packs, first, last, zone_slot(n_zones, 15)
        real(dp), intent(in) :: metric(tet15_width, 11, n_packs), field(3, n_slots)
        real(dp), intent(in) :: share(2)              !! of shear modulus and of that of P waves
        real(dp) :: energy                            !! [J]
        real(dp) :: own(tet15_width, 11), by_zone(tet15_width)
        real(dp), dimension(tet15_width, 3, n_tet15) :: u, f
        integer :: a, c, p, z
        logical :: wide

        energy = 0.0_dp
        wide = has_wide_vectors()
        p = 0
        do z = first, last, tet15_width
            p = p + 1
            own = metric(:, :, p)
            own(:, 10) = share(2)*(own(:, 10) + 2.0_dp*own(:, 11)) - 2.0_dp*share(1)*own(:, 11)
            own(:, 11) = share(1)*own(:, 11)
            call gather(n_zones, n_slots, z, last, zone_slot, field, u)
            call tet15_kernel(wide, own, u, .false., u, f)
            by_zone = 0.0_dp
            do a = 2, n_tet15
                do c = 1, 3
                    by_zone = by_zone - 0.5_dp*(u(:, c, a) - u(:, c, 1))*f(:, c, a)
                end do
            end do
            energy = energy + sum(by_zone)
        end do
    end function tet15_energy

    pure subroutine gather(n_zones, n_slots, z, last, zone_slot, field, u)
        !! Motion of the nodes of the zones from z on; beyond the last they repeat it.
        integer, intent(in) :: n_zones, n_slots, z, last, zone_slot(n_zones, n_tet15)
        real(dp), intent(in) :: field(3, n_slots)
        real(dp), intent(out) :: u(tet15_width, 3, n_tet15)
        integer :: a, l, s

        if (z + tet15_width - 1 <= last) then
            do a = 1, n_tet15
                do l = 1, tet15_width
                    s = zone_slot(z + l - 1, a)
                    u(l, 1, a) = field(1, s)
                    u(l, 2, a) = field(2, s)
                    u(l, 3, a) = field(3, s)
                end do
            end do
        else
            do a = 1, n_tet15
                do l = 1, tet15_width
                    u(l, :, a) = field(:, zone_slot(min(z + l - 1, last), a))
                end do
            end do
        end if
    end subroutine gather

    pure subroutine collect(n_zones, n_slots, z, last, zone_slot, f, force)
        !! Add the forces of the zones from z on into slots, node by node.
        integer, intent(in) :: n_zones, n_slots, z, last, zone_slot(n_zones, n_tet15)
        real(dp), intent(in) :: f(tet15_width, 3, n_tet15)
        real(dp), intent(inout) :: force(3, n_slots)
        integer :: a, l, s

        do a = 1, n_tet15
            do l = 1, min(tet15_width, last - z + 1)
                s = zone_slot(z + l - 1, a)
                force(1, s) = force(1, s) + f(l, 1, a)
                force(2, s) = force(2, s) + f(l, 2, a)
                force(3, s) = force(3, s) + f(l, 3, a)
            end do
        end do
    end subroutine collect

end module pyblast_tet15
