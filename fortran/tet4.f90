module pyblast_tet4
    !! Isotropic constant-strain tetrahedra whose stress is linear in fields of motion.
    !!
    !! Zones are computed side by side, `width` at a time. Gradients come anew from the corners in
    !! every step, for that is cheaper than to read them; theory.md (2.1) to (2.3).
    use pyblast_kinds, only : dp
    implicit none
    private
    public :: tet4_energy, tet4_forces, tet4_strains, tet4_stress_forces

    integer, parameter :: width = 32

contains

    pure subroutine tet4_forces(n_zones, n_slots, first, last, zone_slot, zone_lambda, &
                                  zone_shear, position, deviatoric, volumetric, same_field, force)
        !! Add the corner forces of zones first to last, all of one domain, into its slots.
        !! Shear sees the strain of one field, compression that of another; theory.md (2.14).
        integer, intent(in) :: n_zones, n_slots, first, last
        integer, intent(in) :: zone_slot(n_zones, 4)             !! within the domain, from 1
        real(dp), intent(in) :: zone_lambda(n_zones)             !! first Lame modulus [Pa]
        real(dp), intent(in) :: zone_shear(n_zones)              !! shear modulus [Pa]
        real(dp), intent(in) :: position(3, n_slots)                !! [m]
        real(dp), intent(in) :: deviatoric(3, n_slots), volumetric(3, n_slots)   !! [m]
        logical, intent(in) :: same_field                             !! whether both fields are one
        real(dp), intent(inout) :: force(3, n_slots)             !! [N]
        real(dp) :: area(width, 3, 3), inverse(width), strain(width, 6), other(width, 6)
        real(dp) :: isotropic(width), corner(width, 3, 3)
        integer :: z, n

        do z = first, last, width
            n = min(width, last - z + 1)
            associate (s1 => zone_slot(z:, 1), s2 => zone_slot(z:, 2), s3 => zone_slot(z:, 3), &
                       s4 => zone_slot(z:, 4), lambda => zone_lambda(z:), mu => zone_shear(z:))
                call face_areas(n, n_slots, s1, s2, s3, s4, position, area, inverse)
                call strains(n, n_slots, s1, s2, s3, s4, deviatoric, area, inverse, strain)
                isotropic(:n) = lambda(:n)*(strain(:n, 1) + strain(:n, 2) + strain(:n, 3))
                if (.not. same_field) then
                    call strains(n, n_slots, s1, s2, s3, s4, volumetric, area, inverse, other)
                    isotropic(:n) = isotropic(:n) + (lambda(:n) + 2.0_dp*mu(:n))*( &
                        (other(:n, 1) - strain(:n, 1)) + (other(:n, 2) - strain(:n, 2)) &
                        + (other(:n, 3) - strain(:n, 3)))
                end if
                call tractions(n, mu, isotropic, strain, area, corner)
                call collect(n, n_slots, s1, s2, s3, s4, corner, force)
            end associate
        end do
    end subroutine tet4_forces

    pure subroutine tet4_strains(n_zones, n_slots, first, last, zone_slot, position, field, strain, &
                                   volume, reach)
        !! Strain that a field gives zones first to last, and what bounds it: no strain exceeds the
        !! largest motion of a corner times the sum of the lengths of the four gradients.
        integer, intent(in) :: n_zones, n_slots, first, last, zone_slot(n_zones, 4)
        real(dp), intent(in) :: position(3, n_slots), field(3, n_slots)
        real(dp), intent(out) :: strain(first:last, 6), volume(first:last)   !! [m3]
        real(dp), intent(out) :: reach(first:last)                           !! [1/m]
        real(dp) :: area(width, 3, 3), inverse(width), e(width, 6)
        integer :: z, n, k

        do z = first, last, width
            n = min(width, last - z + 1)
            associate (s1 => zone_slot(z:, 1), s2 => zone_slot(z:, 2), s3 => zone_slot(z:, 3), &
                       s4 => zone_slot(z:, 4))
                call face_areas(n, n_slots, s1, s2, s3, s4, position, area, inverse)
                call strains(n, n_slots, s1, s2, s3, s4, field, area, inverse, e)
            end associate
            strain(z:z + n - 1, :) = e(:n, :)
            volume(z:z + n - 1) = 1.0_dp/(6.0_dp*inverse(:n))
            reach(z:z + n - 1) = sqrt((area(:n, 1, 1) + area(:n, 1, 2) + area(:n, 1, 3))**2 &
                                      + (area(:n, 2, 1) + area(:n, 2, 2) + area(:n, 2, 3))**2 &
                                      + (area(:n, 3, 1) + area(:n, 3, 2) + area(:n, 3, 3))**2)
            do k = 1, 3
                reach(z:z + n - 1) = reach(z:z + n - 1) &
                    + sqrt(area(:n, 1, k)**2 + area(:n, 2, k)**2 + area(:n, 3, k)**2)
            end do
            reach(z:z + n - 1) = reach(z:z + n - 1)*inverse(:n)
        end do
    end subroutine tet4_strains

    pure subroutine tet4_stress_forces(n_zones, n_slots, first, last, zone_slot, position, stress, &
                                       force)
        !! Add the corner forces of a given stress in zones first to last; theory.md (2.3).
        integer, intent(in) :: n_zones, n_slots, first, last, zone_slot(n_zones, 4)
        real(dp), intent(in) :: position(3, n_slots), stress(first:last, 6)
        real(dp), intent(inout) :: force(3, n_slots)
        real(dp) :: area(width, 3, 3), inverse(width), s(width, 6), corner(width, 3, 3)
        integer :: z, n, i, k

        do z = first, last, width
            n = min(width, last - z + 1)
            s(:n, :) = -stress(z:z + n - 1, :)/6.0_dp
            if (.not. any(abs(s(:n, :)) > 0.0_dp)) cycle
            associate (s1 => zone_slot(z:, 1), s2 => zone_slot(z:, 2), s3 => zone_slot(z:, 3), &
                       s4 => zone_slot(z:, 4))
                call face_areas(n, n_slots, s1, s2, s3, s4, position, area, inverse)
                do k = 1, 3
                    !$omp simd
                    do i = 1, n
                        corner(i, 1, k) = s(i, 1)*area(i, 1, k) + s(i, 6)*area(i, 2, k) &
                            + s(i, 5)*area(i, 3, k)
                        corner(i, 2, k) = s(i, 6)*area(i, 1, k) + s(i, 2)*area(i, 2, k) &
                            + s(i, 4)*area(i, 3, k)
                        corner(i, 3, k) = s(i, 5)*area(i, 1, k) + s(i, 4)*area(i, 2, k) &
                            + s(i, 3)*area(i, 3, k)
                    end do
                end do
                call collect(n, n_slots, s1, s2, s3, s4, corner, force)
            end associate
        end do
    end subroutine tet4_stress_forces

    pure subroutine face_areas(n, n_slots, s1, s2, s3, s4, position, area, inverse)
        !! Twice the area vectors of the faces opposite corners 2 to 4, and one over six volumes.
        integer, intent(in) :: n, n_slots, s1(n), s2(n), s3(n), s4(n)
        real(dp), intent(in) :: position(3, n_slots)
        real(dp), intent(out) :: area(width, 3, 3), inverse(width)   !! [m2], [1/m3]
        real(dp) :: ax, ay, az, bx, by, bz, cx, cy, cz
        integer :: i

        !$omp simd private(ax, ay, az, bx, by, bz, cx, cy, cz)
        do i = 1, n
            ax = position(1, s2(i)) - position(1, s1(i))
            ay = position(2, s2(i)) - position(2, s1(i))
            az = position(3, s2(i)) - position(3, s1(i))
            bx = position(1, s3(i)) - position(1, s1(i))
            by = position(2, s3(i)) - position(2, s1(i))
            bz = position(3, s3(i)) - position(3, s1(i))
            cx = position(1, s4(i)) - position(1, s1(i))
            cy = position(2, s4(i)) - position(2, s1(i))
            cz = position(3, s4(i)) - position(3, s1(i))
            area(i, 1, 1) = by*cz - bz*cy
            area(i, 2, 1) = bz*cx - bx*cz
            area(i, 3, 1) = bx*cy - by*cx
            area(i, 1, 2) = cy*az - cz*ay
            area(i, 2, 2) = cz*ax - cx*az
            area(i, 3, 2) = cx*ay - cy*ax
            area(i, 1, 3) = ay*bz - az*by
            area(i, 2, 3) = az*bx - ax*bz
            area(i, 3, 3) = ax*by - ay*bx
            inverse(i) = 1.0_dp/(ax*area(i, 1, 1) + ay*area(i, 2, 1) + az*area(i, 3, 1))
        end do
    end subroutine face_areas

    pure subroutine strains(n, n_slots, s1, s2, s3, s4, field, area, inverse, strain)
        !! Strain of a field: xx yy zz and the engineering shears yz zx xy; theory.md (2.1).
        integer, intent(in) :: n, n_slots, s1(n), s2(n), s3(n), s4(n)
        real(dp), intent(in) :: field(3, n_slots), area(width, 3, 3), inverse(width)
        real(dp), intent(out) :: strain(width, 6)
        real(dp) :: ax, ay, az, bx, by, bz, cx, cy, cz
        integer :: i

        !$omp simd private(ax, ay, az, bx, by, bz, cx, cy, cz)
        do i = 1, n
            ax = field(1, s2(i)) - field(1, s1(i))
            ay = field(2, s2(i)) - field(2, s1(i))
            az = field(3, s2(i)) - field(3, s1(i))
            bx = field(1, s3(i)) - field(1, s1(i))
            by = field(2, s3(i)) - field(2, s1(i))
            bz = field(3, s3(i)) - field(3, s1(i))
            cx = field(1, s4(i)) - field(1, s1(i))
            cy = field(2, s4(i)) - field(2, s1(i))
            cz = field(3, s4(i)) - field(3, s1(i))
            strain(i, 1) = inverse(i)*(ax*area(i, 1, 1) + bx*area(i, 1, 2) + cx*area(i, 1, 3))
            strain(i, 2) = inverse(i)*(ay*area(i, 2, 1) + by*area(i, 2, 2) + cy*area(i, 2, 3))
            strain(i, 3) = inverse(i)*(az*area(i, 3, 1) + bz*area(i, 3, 2) + cz*area(i, 3, 3))
            strain(i, 4) = inverse(i)*(ay*area(i, 3, 1) + by*area(i, 3, 2) + cy*area(i, 3, 3) &
                                       + az*area(i, 2, 1) + bz*area(i, 2, 2) + cz*area(i, 2, 3))
            strain(i, 5) = inverse(i)*(az*area(i, 1, 1) + bz*area(i, 1, 2) + cz*area(i, 1, 3) &
                                       + ax*area(i, 3, 1) + bx*area(i, 3, 2) + cx*area(i, 3, 3))
            strain(i, 6) = inverse(i)*(ax*area(i, 2, 1) + bx*area(i, 2, 2) + cx*area(i, 2, 3) &
                                       + ay*area(i, 1, 1) + by*area(i, 1, 2) + cy*area(i, 1, 3))
        end do
    end subroutine strains

    pure subroutine tractions(n, shear, isotropic, strain, area, corner)
        !! Corner forces f_a = -V sigma g_a, V g_a being a sixth of `area`; theory.md (2.2), (2.3).
        integer, intent(in) :: n
        real(dp), intent(in) :: shear(n), isotropic(n), strain(width, 6), area(width, 3, 3)
        real(dp), intent(out) :: corner(width, 3, 3)
        real(dp) :: mean, mu, xx, yy, zz, yz, zx, xy
        integer :: i, k

        do k = 1, 3
            !$omp simd private(mean, mu, xx, yy, zz, yz, zx, xy)
            do i = 1, n
                mu = -shear(i)/6.0_dp
                mean = -isotropic(i)/6.0_dp
                xx = mean + 2.0_dp*mu*strain(i, 1)
                yy = mean + 2.0_dp*mu*strain(i, 2)
                zz = mean + 2.0_dp*mu*strain(i, 3)
                yz = mu*strain(i, 4)
                zx = mu*strain(i, 5)
                xy = mu*strain(i, 6)
                corner(i, 1, k) = xx*area(i, 1, k) + xy*area(i, 2, k) + zx*area(i, 3, k)
                corner(i, 2, k) = xy*area(i, 1, k) + yy*area(i, 2, k) + yz*area(i, 3, k)
                corner(i, 3, k) = zx*area(i, 1, k) + yz*area(i, 2, k) + zz*area(i, 3, k)
            end do
        end do
    end subroutine tractions

    pure subroutine collect(n, n_slots, s1, s2, s3, s4, corner, force)
        !! Add corner forces into slots, zone by zone; those of a zone add up to nothing.
        integer, intent(in) :: n, n_slots, s1(n), s2(n), s3(n), s4(n)
        real(dp), intent(in) :: corner(width, 3, 3)
        real(dp), intent(inout) :: force(3, n_slots)
        integer :: i, j

        do i = 1, n
            do j = 1, 3
                force(j, s2(i)) = force(j, s2(i)) + corner(i, j, 1)
                force(j, s3(i)) = force(j, s3(i)) + corner(i, j, 2)
                force(j, s4(i)) = force(j, s4(i)) + corner(i, j, 3)
                force(j, s1(i)) = force(j, s1(i)) &
                    - (corner(i, j, 1) + corner(i, j, 2) + corner(i, j, 3))
            end do
        end do
    end subroutine collect

    pure function tet4_energy(n_zones, n_slots, first, last, zone_slot, zone_lambda, &
                                zone_shear, position, field, share) result(energy)
        !! Strain energy of a field in springs that have a share of both moduli of the zones.
        integer, intent(in) :: n_zones, n_slots, first, last, zone_slot(n_zones, 4)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones)
        real(dp), intent(in) :: position(3, n_slots), field(3, n_slots)
        real(dp), intent(in) :: share(2)              !! of shear modulus and of that of P waves
        real(dp) :: energy                            !! [J]
        real(dp) :: area(width, 3, 3), inverse(width), e(width, 6), lambda, mu
        integer :: z, i, n

        energy = 0.0_dp
        do z = first, last, width
            n = min(width, last - z + 1)
            associate (s1 => zone_slot(z:, 1), s2 => zone_slot(z:, 2), s3 => zone_slot(z:, 3), &
                       s4 => zone_slot(z:, 4))
                call face_areas(n, n_slots, s1, s2, s3, s4, position, area, inverse)
                call strains(n, n_slots, s1, s2, s3, s4, field, area, inverse, e)
            end associate
            do i = 1, n
                mu = share(1)*zone_shear(z + i - 1)
                lambda = share(2)*(zone_lambda(z + i - 1) + 2.0_dp*zone_shear(z + i - 1)) - 2.0_dp*mu
                energy = energy + (0.5_dp*lambda*(e(i, 1) + e(i, 2) + e(i, 3))**2 &
                                   + mu*(e(i, 1)**2 + e(i, 2)**2 + e(i, 3)**2) &
                                   + 0.5_dp*mu*(e(i, 4)**2 + e(i, 5)**2 + e(i, 6)**2)) &
                    /(6.0_dp*inverse(i))
            end do
        end do
    end function tet4_energy

end module pyblast_tet4
