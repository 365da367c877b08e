module pyblast_elasticity
    !! Isotropic elasticity and the work of stress, shared by all laws of zones.
    use pyblast_kinds, only : dp
    implicit none
    private
    public :: hooke, work

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

end module pyblast_elasticity
