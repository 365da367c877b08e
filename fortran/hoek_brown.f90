module pyblast_hoek_brown
    !! Hoek-Brown plasticity: a curved surface, mapped back through the tangent planes at the
    !! confining stress that is found.
    use pyblast_kinds, only : dp, n_zone_properties, n_zone_state
    use pyblast_elasticity, only : hooke, work
    use pyblast_mohr_coulomb, only : flow_plastically, plastic_flow, share
    use pyblast_principal_stresses, only : principal
    implicit none
    private
    public :: hoek_brown, hoek_brown_margins

    real(dp), parameter :: rounding = 1e-12_dp
    real(dp), parameter :: steepest = 300.0_dp !! slope near the apex, beyond which rounding reigns
    integer, parameter :: most = 60           !! iterations of the confining stress

    type :: surface
        !! Strength at present: q = sigci (m sigma3/sigci + s)**a, compression positive.
        real(dp) :: sigci, m, s, a, n_psi, cutoff
    end type surface

contains

    pure subroutine hoek_brown(property, lambda, shear, initial, strain, state, stress, stored, lost)
        !! Stress on or inside the yield surface, and its plastic work; theory.md (2.49), (2.50).
        !! State: as of Mohr-Coulomb.
        real(dp), intent(in) :: property(n_zone_properties)
        real(dp), intent(in) :: lambda, shear        !! Lame moduli [Pa]
        real(dp), intent(in) :: initial(6), strain(6)
        real(dp), intent(inout) :: state(n_zone_state)
        real(dp), intent(out) :: stress(6), stored
        real(dp), intent(inout) :: lost              !! [J/m3]
        type(surface) :: rock
        real(dp) :: value(3), axes(3, 3), flow(3)

        stress = initial + hooke(lambda, shear, strain - state(7:12))
        rock = present(property, state(13), state(14))
        if (may_yield(rock, stress)) then
            call principal(stress, value, axes)
            if (-value(3) > strength(rock, -value(1)) .or. value(1) > rock%cutoff) then
                flow = mapped_back(rock, lambda, shear, value)
                call flow_plastically(lambda, shear, rock%n_psi, initial, strain, flow, axes, state, &
                                      stress, lost)
            end if
        end if
        state(1:6) = stress - initial
        stored = work(initial + 0.5_dp*state(1:6), strain - state(7:12))
    end subroutine hoek_brown

    pure subroutine hoek_brown_margins(n, property, lambda, shear, initial, strain, yield_margin)
        !! Strain that zones which never yielded can gain before one may. The surface is concave:
        !! above half the way to the cut-off it is nowhere steeper than there.
        integer, intent(in) :: n
        real(dp), intent(in) :: property(n_zone_properties)
        real(dp), intent(in) :: lambda(n), shear(n)  !! Lame moduli [Pa]
        real(dp), intent(in) :: initial(n, 6), strain(n, 6)
        real(dp), intent(out) :: yield_margin(n)
        type(surface) :: rock
        real(dp) :: stress(6), mean, radius, bulk, bend, spare, slope
        integer :: i

        rock = present(property, 0.0_dp, 0.0_dp)
        do i = 1, n
            stress = initial(i, :) + hooke(lambda(i), shear(i), strain(i, :))
            call bounds(stress, mean, radius)
            bulk = lambda(i) + 2.0_dp*shear(i)/3.0_dp
            bend = sqrt(8.0_dp/3.0_dp)*shear(i)
            spare = 0.5_dp*(rock%cutoff - (mean + radius))
            slope = tangent(rock, spare - rock%cutoff)
            yield_margin(i) = min(spare/(bulk + bend), &
                                  (strength(rock, -(mean + radius)) + (mean - radius)) &
                                  /((slope - 1.0_dp)*bulk + (slope + 1.0_dp)*bend)) &
                - rounding*(abs(mean) + radius)/bend
        end do
    end subroutine hoek_brown_margins

    pure function present(property, shear_part, tensile_part) result(rock)
        !! Strength after some plastic strain: m, s and tension linear from peak to residual.
        real(dp), intent(in) :: property(n_zone_properties)
        real(dp), intent(in) :: shear_part, tensile_part
        type(surface) :: rock
        real(dp) :: fallen

        fallen = share(shear_part, property(10))
        rock%sigci = property(1)
        rock%m = property(2) + fallen*(property(7) - property(2))
        rock%s = property(3) + fallen*(property(8) - property(3))
        rock%a = property(4)
        rock%n_psi = (property(5) + sqrt(1.0_dp + property(5)**2))**2
        rock%cutoff = property(6) + share(tensile_part, property(11))*(property(9) - property(6))
        rock%cutoff = min(rock%cutoff, rock%s*rock%sigci/rock%m)
    end function present

    pure function strength(rock, confining) result(largest)
        !! Largest compression that the rock supports beside a confining one [Pa].
        type(surface), intent(in) :: rock
        real(dp), intent(in) :: confining
        real(dp) :: largest

        largest = confining &
            + rock%sigci*max(rock%m*confining/rock%sigci + rock%s, 0.0_dp)**rock%a
    end function strength

    pure function tangent(rock, confining) result(slope)
        !! Growth of the strength with the confining stress.
        type(surface), intent(in) :: rock
        real(dp), intent(in) :: confining
        real(dp) :: slope, inner

        inner = max(rock%m*confining/rock%sigci + rock%s, tiny(inner))
        slope = min(1.0_dp + rock%a*rock%m*inner**(rock%a - 1.0_dp), steepest)
    end function tangent

    pure subroutine bounds(stress, mean, radius)
        !! Principal stresses lie within a radius 2 sqrt(J2/3) of the mean stress.
        real(dp), intent(in) :: stress(6)
        real(dp), intent(out) :: mean, radius

        mean = (stress(1) + stress(2) + stress(3))/3.0_dp
        radius = 2.0_dp*sqrt((0.5_dp*sum((stress(1:3) - mean)**2) + sum(stress(4:6)**2))/3.0_dp)
    end subroutine bounds

    pure function may_yield(rock, stress) result(may)
        !! Cheap bound that spares most zones the principal stresses.
        type(surface), intent(in) :: rock
        real(dp), intent(in) :: stress(6)
        logical :: may
        real(dp) :: mean, radius

        call bounds(stress, mean, radius)
        may = mean + radius > rock%cutoff .or. radius - mean > strength(rock, -(mean + radius))
    end function may_yield

    pure function mapped_back(rock, lambda, shear, trial) result(flow)
        !! Principal plastic strain that brings a trial stress back to the curved surface.
        type(surface), intent(in) :: rock
        real(dp), intent(in) :: lambda, shear, trial(3)
        real(dp) :: flow(3), confining, slope, next
        integer :: round

        confining = max(-trial(1), -rock%cutoff)
        do round = 1, most
            slope = tangent(rock, confining)
            flow = plastic_flow(lambda, shear, slope, rock%n_psi, &
                                strength(rock, confining) - slope*confining, rock%cutoff, trial)
            next = -maxval(trial - lambda*sum(flow) - 2.0_dp*shear*flow)
            next = max(next, -rock%cutoff)
            if (abs(next - confining) <= rounding*(abs(trial(1)) + abs(trial(3)))) exit
            confining = next
        end do
    end function mapped_back

end module pyblast_hoek_brown
