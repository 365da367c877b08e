module pyblast_anisotropic_zones
    !! Linear elasticity of any symmetry.
    use pyblast_kinds, only : dp, n_zone_properties
    implicit none
    private
    public :: anisotropic

contains

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

end module pyblast_anisotropic_zones
