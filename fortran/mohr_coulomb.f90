module pyblast_mohr_coulomb
    !! Mohr-Coulomb plasticity with tension cut-off, mapped back exactly in principal stresses.
    use pyblast_kinds, only : dp, n_zone_properties, n_zone_state
    use pyblast_elasticity, only : hooke, work
    use pyblast_principal_stresses, only : cross, principal
    implicit none
    private
    public :: flow_plastically, mohr_coulomb, plastic_flow, share, yield_margins

    real(dp), parameter :: rounding = 1e-12_dp

contains

    pure subroutine mohr_coulomb(property, lambda, shear, initial, strain, state, stress, stored, &
                                 lost)
        !! Stress on or inside the yield surface, and its plastic work; theory.md (2.25) to (2.31).
        !! Property: strengths (tangents of angles), residual strengths, strains to reach them.
        !! State: stress over the initial one, plastic strain, its shear and its tensile part.
        real(dp), intent(in) :: property(n_zone_properties)
        real(dp), intent(in) :: lambda, shear        !! Lame moduli [Pa]
        real(dp), intent(in) :: initial(6), strain(6)
        real(dp), intent(inout) :: state(n_zone_state)
        real(dp), intent(out) :: stress(6), stored
        real(dp), intent(inout) :: lost              !! [J/m3]
        real(dp) :: n_phi, n_psi, uniaxial, cutoff, value(3), axes(3, 3), flow(3)

        stress = initial + hooke(lambda, shear, strain - state(7:12))
        call strength(property, state(13), state(14), n_phi, n_psi, uniaxial, cutoff)
        if (may_yield(stress, n_phi, uniaxial, cutoff)) then
            call principal(stress, value, axes)
            if (n_phi*value(1) - value(3) > uniaxial .or. value(1) > cutoff) then
                flow = plastic_flow(lambda, shear, n_phi, n_psi, uniaxial, cutoff, value)
                call flow_plastically(lambda, shear, n_psi, initial, strain, flow, axes, state, &
                                      stress, lost)
            end if
        end if
        state(1:6) = stress - initial
        stored = work(initial + 0.5_dp*state(1:6), strain - state(7:12))
    end subroutine mohr_coulomb

    pure subroutine flow_plastically(lambda, shear, n_psi, initial, strain, flow, axes, state, &
                                     stress, lost)
        !! Add a principal plastic strain to the state; find the stress and the plastic work.
        real(dp), intent(in) :: lambda, shear        !! Lame moduli [Pa]
        real(dp), intent(in) :: n_psi                !! of dilation
        real(dp), intent(in) :: initial(6), strain(6), flow(3), axes(3, 3)
        real(dp), intent(inout) :: state(n_zone_state)
        real(dp), intent(out) :: stress(6)
        real(dp), intent(inout) :: lost              !! [J/m3]
        real(dp) :: change(6), part
        integer :: k

        do k = 1, 3
            change(k) = sum(flow*axes(k, :)**2)
        end do
        change(4) = 2.0_dp*sum(flow*axes(2, :)*axes(3, :))
        change(5) = 2.0_dp*sum(flow*axes(3, :)*axes(1, :))
        change(6) = 2.0_dp*sum(flow*axes(1, :)*axes(2, :))
        state(7:12) = state(7:12) + change
        stress = initial + hooke(lambda, shear, strain - state(7:12))
        lost = lost + work(0.5_dp*(stress + initial + state(1:6)), change)
        part = -sum(min(flow, 0.0_dp))
        state(13) = state(13) + (1.0_dp + n_psi)*part
        state(14) = state(14) + max(0.0_dp, sum(flow) - (n_psi - 1.0_dp)*part)
    end subroutine flow_plastically

    pure subroutine yield_margins(n, property, lambda, shear, initial, strain, yield_margin)
        !! Strain that zones which never yielded can gain before one may; theory.md (2.43).
        !! Positive only where mohr_coulomb would find no yielding.
        integer, intent(in) :: n
        real(dp), intent(in) :: property(n_zone_properties)
        real(dp), intent(in) :: lambda(n), shear(n)  !! Lame moduli [Pa]
        real(dp), intent(in) :: initial(n, 6), strain(n, 6)
        real(dp), intent(out) :: yield_margin(n)
        real(dp) :: n_phi, n_psi, uniaxial, cutoff, isotropic, mean, radius, bulk, bend
        real(dp) :: xx, yy, zz, yz, zx, xy
        integer :: i

        call strength(property, 0.0_dp, 0.0_dp, n_phi, n_psi, uniaxial, cutoff)
        !$omp simd private(isotropic, mean, radius, bulk, bend, xx, yy, zz, yz, zx, xy)
        do i = 1, n
            isotropic = lambda(i)*(strain(i, 1) + strain(i, 2) + strain(i, 3))
            xx = initial(i, 1) + isotropic + 2.0_dp*shear(i)*strain(i, 1)
            yy = initial(i, 2) + isotropic + 2.0_dp*shear(i)*strain(i, 2)
            zz = initial(i, 3) + isotropic + 2.0_dp*shear(i)*strain(i, 3)
            yz = initial(i, 4) + shear(i)*strain(i, 4)
            zx = initial(i, 5) + shear(i)*strain(i, 5)
            xy = initial(i, 6) + shear(i)*strain(i, 6)
            mean = (xx + yy + zz)/3.0_dp
            radius = 2.0_dp*sqrt((0.5_dp*((xx - mean)**2 + (yy - mean)**2 + (zz - mean)**2) &
                                  + (yz**2 + zx**2 + xy**2))/3.0_dp)
            bulk = lambda(i) + 2.0_dp*shear(i)/3.0_dp
            bend = sqrt(8.0_dp/3.0_dp)*shear(i)
            yield_margin(i) = min((uniaxial - (n_phi*(mean + radius) - (mean - radius))) &
                          /((n_phi - 1.0_dp)*bulk + (n_phi + 1.0_dp)*bend), &
                          (cutoff - (mean + radius))/(bulk + bend)) &
                - rounding*(abs(mean) + radius)/bend
        end do
    end subroutine yield_margins

    pure subroutine strength(property, shear_part, tensile_part, n_phi, n_psi, uniaxial, cutoff)
        !! Strength after some plastic strain: linear from peak to residual; theory.md (2.29).
        real(dp), intent(in) :: property(n_zone_properties)
        real(dp), intent(in) :: shear_part, tensile_part   !! plastic strains so far
        real(dp), intent(out) :: n_phi, n_psi              !! of friction and dilation
        real(dp), intent(out) :: uniaxial                  !! uniaxial compressive strength [Pa]
        real(dp), intent(out) :: cutoff                    !! largest tension [Pa]
        real(dp) :: current(4), softening(4), root

        softening(1:3) = share(shear_part, property(9))
        softening(4) = share(tensile_part, property(10))
        current = property(1:4) + softening*(property(5:8) - property(1:4))
        root = current(2) + sqrt(1.0_dp + current(2)**2)
        n_phi = root**2
        n_psi = (current(3) + sqrt(1.0_dp + current(3)**2))**2
        uniaxial = 2.0_dp*current(1)*root
        cutoff = current(4)
        if (cutoff*current(2) > current(1)) cutoff = current(1)/current(2)
    end subroutine strength

    pure function share(strain, limit) result(part)
        !! How far softening has come: 0 at the peak, 1 at the residual strength.
        real(dp), intent(in) :: strain, limit
        real(dp) :: part

        part = merge(1.0_dp, 0.0_dp, strain > 0.0_dp)
        if (strain < limit) part = strain/limit
    end function share

    pure function may_yield(stress, n_phi, uniaxial, cutoff) result(may)
        !! Cheap bound: principal stresses lie within 2 sqrt(J2/3) of the mean stress.
        real(dp), intent(in) :: stress(6), n_phi, uniaxial, cutoff
        logical :: may
        real(dp) :: mean, radius

        mean = (stress(1) + stress(2) + stress(3))/3.0_dp
        radius = 2.0_dp*sqrt((0.5_dp*sum((stress(1:3) - mean)**2) + sum(stress(4:6)**2))/3.0_dp)
        may = n_phi*(mean + radius) - (mean - radius) > uniaxial .or. mean + radius > cutoff
    end function may_yield

    pure function plastic_flow(lambda, shear, n_phi, n_psi, uniaxial, cutoff, trial) result(flow)
        !! Principal plastic strain that brings a trial stress back to the surface; theory.md (2.28).
        !!
        !! Of the faces, edges and corners of the surface it takes the first whose plastic
        !! multipliers are positive and whose stress breaks no other plane; rounding may leave none
        !! perfect, then the least imperfect.
        real(dp), intent(in) :: lambda, shear, n_phi, n_psi, uniaxial, cutoff
        real(dp), intent(in) :: trial(3)             !! principal stresses, descending [Pa]
        real(dp) :: flow(3)
        real(dp) :: normal(3, 6), direction(3, 6), limit(6), amount(3), strain(3), fault, least
        integer, parameter :: active(3, 11) = reshape([ &
            1, 0, 0, 4, 0, 0, 1, 4, 0, 1, 2, 0, 1, 3, 0, 4, 5, 0, 4, 5, 6, &
            1, 4, 5, 2, 4, 5, 1, 2, 4, 1, 3, 4], [3, 11])
        integer :: s, k

        normal = planes(n_phi)
        direction = planes(n_psi)
        limit(1:3) = uniaxial
        limit(4:6) = cutoff
        least = huge(least)
        flow = 0.0_dp
        do s = 1, 11
            amount = multipliers(lambda, shear, normal, direction, limit, active(:, s), trial)
            strain = 0.0_dp
            do k = 1, 3
                if (active(k, s) > 0) strain = strain + amount(k)*direction(:, active(k, s))
            end do
            fault = max(-2.0_dp*shear*minval(amount), &
                        broken(trial - lambda*sum(strain) - 2.0_dp*shear*strain, normal, limit))
            if (fault < least) then
                least = fault
                flow = strain
            end if
            if (least < 1e-12_dp*(abs(trial(1)) + abs(trial(3)))) exit
        end do
    end function plastic_flow

    pure function planes(n) result(normal)
        !! Normals of the six planes: shear between stresses 1 and 3, 2 and 3, 1 and 2; tension.
        real(dp), intent(in) :: n
        real(dp) :: normal(3, 6)

        normal = 0.0_dp
        normal(1, 1) = n
        normal(3, 1) = -1.0_dp
        normal(2, 2) = n
        normal(3, 2) = -1.0_dp
        normal(1, 3) = n
        normal(2, 3) = -1.0_dp
        normal(1, 4) = 1.0_dp
        normal(2, 5) = 1.0_dp
        normal(3, 6) = 1.0_dp
    end function planes

    pure function multipliers(lambda, shear, normal, direction, limit, active, trial) result(amount)
        !! Plastic multipliers that put a stress on up to three planes; 0 where there is no plane.
        real(dp), intent(in) :: lambda, shear, normal(3, 6), direction(3, 6), limit(6), trial(3)
        integer, intent(in) :: active(3)             !! planes; 0 has none
        real(dp) :: amount(3)
        real(dp) :: m(3, 3), right(3)
        integer :: i, j

        m = 0.0_dp
        right = 0.0_dp
        do i = 1, 3
            m(i, i) = 2.0_dp*shear
            if (active(i) == 0) cycle
            right(i) = dot_product(normal(:, active(i)), trial) - limit(active(i))
            do j = 1, 3
                if (active(j) == 0) cycle
                m(i, j) = lambda*sum(normal(:, active(i)))*sum(direction(:, active(j))) &
                    + 2.0_dp*shear*dot_product(normal(:, active(i)), direction(:, active(j)))
            end do
        end do
        do i = 1, 3
            amount(i) = dot_product(right, cross(m(:, modulo(i, 3) + 1), m(:, modulo(i + 1, 3) + 1)))
        end do
        amount = amount/dot_product(m(:, 1), cross(m(:, 2), m(:, 3)))
    end function multipliers

    pure function broken(stress, normal, limit) result(fault)
        !! How far principal stresses break the planes or their order [Pa].
        real(dp), intent(in) :: stress(3), normal(3, 6), limit(6)
        real(dp) :: fault

        fault = max(maxval(matmul(stress, normal) - limit), stress(2) - stress(1), &
                    stress(3) - stress(2))
    end function broken

end module pyblast_mohr_coulomb
