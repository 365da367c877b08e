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
        !! Property: rates (none after the last mechanism), shares of the P and the shear modulus.
        !! State: the last strain, then the memory of each mechanism.
        real(dp), intent(in) :: property(n_zone_properties)
        real(dp), intent(in) :: lambda, shear        !! unrelaxed Lame moduli [Pa]
        real(dp), intent(in) :: dt                   !! [s]
        real(dp), intent(in) :: initial(6), strain(6)
        real(dp), intent(inout) :: state(n_zone_state)
        real(dp), intent(out) :: stress(6), stored
        real(dp), intent(inout) :: lost              !! [J/m3]
        real(dp) :: memory(6), change(6), spring(6), x, m_shear, m_lambda
        integer :: l, k

        stress = initial + hooke(lambda, shear, strain)
        stored = 0.5_dp*work(stress + initial, strain)
        do l = 1, n_mechanisms
            if (.not. property(l) > 0.0_dp) exit
            m_shear = shear*property(2*n_mechanisms + l)
            m_lambda = (lambda + 2.0_dp*shear)*property(n_mechanisms + l) - 2.0_dp*m_shear
            x = 0.5_dp*dt*property(l)
            k = 6*l + 1
            change = (x/(1.0_dp + x))*(state(1:6) + strain - 2.0_dp*state(k:k + 5))
            memory = state(k:k + 5) + change
            state(k:k + 5) = memory
            lost = lost + work(hooke(m_lambda, m_shear, change), change)/(2.0_dp*x)
            spring = hooke(m_lambda, m_shear, memory)
            stress = stress - spring
            stored = stored - work(spring, strain - 0.5_dp*memory)
        end do
        state(1:6) = strain
    end subroutine viscoelastic

end module pyblast_viscoelastic_zones
