module pyblast_elasticity
    !! Linear elasticity, isotropic and anisotropic, and the work of stress.
    use pyblast_kinds, only : dp, n_zone_properties
    implicit none
    private
    public :: anisotropic, hooke, hooke_work, work

contains

    pure function hooke(lambda, shear, strain) result(stress)
        !! Isotropic elasticity; theory.md (2.2).
        real(dp), intent(in) :: lambda, shear, strain(6)
        real(dp) :: stress(6), volumetric

        volumetric = lambda*(strain(1) + strain(2) + strain(3))
        stress(1:3) = volumetric + 2.0_dp*shear*strain(1:3)
        stress(4:6) = shear*strain(4:6)
    end function hooke

    pure function work(stress, strain) result(density)
        !! Stress times strain, engineering shears.
        real(dp), intent(in) :: stress(6), strain(6)
        real(dp) :: density

        density = stress(1)*strain(1) + stress(2)*strain(2) + stress(3)*strain(3) &
            + stress(4)*strain(4) + stress(5)*strain(5) + stress(6)*strain(6)
    end function work

    pure subroutine hooke_work(n, lambda, shear, initial, elastic, strain, volume, stored, insitu)
        !! Energy that stressed zones hold, and the work that their initial stress did; (2.31).
        integer, intent(in) :: n
        real(dp), intent(in) :: lambda(n), shear(n)  !! Lame moduli [Pa]
        real(dp), intent(in) :: initial(n, 6)        !! stress at no strain [Pa]
        real(dp), intent(in) :: elastic(n, 6)        !! part of the strain that can be recovered
        real(dp), intent(in) :: strain(n, 6), volume(n)
        real(dp), intent(out) :: stored, insitu      !! [J]
        real(dp) :: all, own
        integer :: i, k

        stored = 0.0_dp
        insitu = 0.0_dp
        !$omp simd private(all, own, k) reduction(+:stored, insitu)
        do i = 1, n
            all = 0.0_dp
            own = 0.5_dp*lambda(i)*(elastic(i, 1) + elastic(i, 2) + elastic(i, 3))**2
            do k = 1, 3
                own = own + shear(i)*(elastic(i, k)**2 + 0.5_dp*elastic(i, k + 3)**2)
            end do
            do k = 1, 6
                own = own + initial(i, k)*elastic(i, k)
                all = all + initial(i, k)*strain(i, k)
            end do
            stored = stored + volume(i)*own
            insitu = insitu + volume(i)*all
        end do
    end subroutine hooke_work

    pure function anisotropic(property, shear, strain) result(stress)
        !! Stress by 21 constants over the shear modulus, in the axes of the model; theory.md (2.19).
        !! Property: upper triangle of the stiffness, row by row.
        real(dp), intent(in) :: property(n_zone_properties)
        real(dp), intent(in) :: shear                !! [Pa]
        real(dp), intent(in) :: strain(6)
        real(dp) :: stress(6)
        integer :: i, j, k

        stress = 0.0_dp
        k = 0
        do i = 1, 6
            k = k + 1
            stress(i) = stress(i) + property(k)*strain(i)
            do j = i + 1, 6
                k = k + 1
                stress(i) = stress(i) + property(k)*strain(j)
                stress(j) = stress(j) + property(k)*strain(i)
            end do
        end do
        stress = shear*stress
    end function anisotropic

end module pyblast_elasticity
