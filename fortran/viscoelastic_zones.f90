module pyblast_viscoelastic_zones
    !! Generalised Maxwell body: springs whose part of the stress fades with memory.
    use pyblast_kinds, only : dp, n_mechanisms, n_zone_properties, n_zone_state
    use pyblast_elasticity, only : hooke, work
    implicit none
    private
    public :: viscoelastic

contains

    pure subroutine viscoelastic(property, lambda, shear, dt, initial, strain, state, stress, &
                                 stored, lost)
        !! Stress with one memory a mechanism, by the trapezoidal rule; theory.md (2.14) to (2.17).
        !! Property: rates, shares of the P modulus, shares of the shear modulus.
        !! State: the last strain, then the memory of each mechanism.
        real(dp), intent(in) :: property(n_zone_properties)
        real(dp), intent(in) :: lambda, shear        !! unrelaxed Lame moduli [Pa]
        real(dp), intent(in) :: dt                   !! [s]
        real(dp), intent(in) :: initial(6), strain(6)
        real(dp), intent(inout) :: state(n_zone_state)
        real(dp), intent(out) :: stress(6), stored
        real(dp), intent(inout) :: lost              !! [J/m3]
        real(dp) :: old(6), memory(6), spring(6), mean(6), x, branch_shear, branch_lambda
        integer :: l, k

        old = state(1:6)
        stress = initial + hooke(lambda, shear, strain)
        stored = work(initial, strain) + 0.5_dp*work(hooke(lambda, shear, strain), strain)
        do l = 1, n_mechanisms
            branch_shear = shear*property(2*n_mechanisms + l)
            branch_lambda = (lambda + 2.0_dp*shear)*property(n_mechanisms + l) - 2.0_dp*branch_shear
            k = 6*l + 1
            x = 0.5_dp*dt*property(l)
            memory = ((1.0_dp - x)*state(k:k + 5) + x*(old + strain))/(1.0_dp + x)
            mean = 0.5_dp*(old + strain - state(k:k + 5) - memory)
            lost = lost + work(hooke(branch_lambda, branch_shear, mean), memory - state(k:k + 5))
            spring = hooke(branch_lambda, branch_shear, memory)
            stress = stress - spring
            stored = stored - work(spring, strain) + 0.5_dp*work(spring, memory)
            state(k:k + 5) = memory
        end do
        state(1:6) = strain
    end subroutine viscoelastic

end module pyblast_viscoelastic_zones
