module pyblast_ubiquitous_joints
    !! Elastic rock with planes of weakness everywhere, on which it slips and opens.
    use pyblast_kinds, only : dp, n_zone_properties, n_zone_state
    use pyblast_elasticity, only : hooke, work
    implicit none
    private
    public :: ubiquitous_joints

contains

    pure subroutine ubiquitous_joints(property, lambda, shear, initial, strain, state, stress, &
                                      stored, lost)
        !! Stress whose traction on the planes obeys Coulomb and a tension cut-off; (2.51), (2.52).
        !! State: stress over the initial one, plastic strain, slip and opening strain.
        real(dp), intent(in) :: property(n_zone_properties)
        real(dp), intent(in) :: lambda, shear        !! Lame moduli [Pa]
        real(dp), intent(in) :: initial(6), strain(6)
        real(dp), intent(inout) :: state(n_zone_state)
        real(dp), intent(out) :: stress(6), stored
        real(dp), intent(inout) :: lost              !! [J/m3]
        real(dp) :: along(3), tn, size, strength, slip, opening, change(6)

        associate (normal => property(1:3), cohesion => property(4), friction => property(5), &
                   dilation => property(6), tension => property(7))
            stress = initial + hooke(lambda, shear, strain - state(7:12))
            call tractions(stress, normal, tn, along, size)
            opening = max(0.0_dp, tn - tension)/(lambda + 2.0_dp*shear)
            strength = max(0.0_dp, cohesion - friction*min(tn, tension))
            slip = 0.0_dp
            if (size > strength) then
                slip = (size - strength)/(shear + rise(tn, tension)*friction*dilation)
                if (slip*shear > size) slip = size/shear
                if (tn < tension) opening = slip*dilation
            end if
            if (slip > 0.0_dp .or. opening > 0.0_dp) then
                change = opening*dyad(normal, normal)
                if (size > 0.0_dp) change = change + slip*dyad(normal, along/size)
                state(7:12) = state(7:12) + change
                stress = initial + hooke(lambda, shear, strain - state(7:12))
                lost = lost + work(0.5_dp*(stress + initial + state(1:6)), change)
                state(13) = state(13) + slip
                state(14) = state(14) + opening
            end if
        end associate
        state(1:6) = stress - initial
        stored = work(initial + 0.5_dp*state(1:6), strain - state(7:12))

    contains

        pure function rise(tn, tension) result(stiffness)
            !! Stiffness against opening where the planes are closed [Pa].
            real(dp), intent(in) :: tn, tension
            real(dp) :: stiffness

            stiffness = merge(lambda + 2.0_dp*shear, 0.0_dp, tn < tension)
        end function rise

    end subroutine ubiquitous_joints

    pure subroutine tractions(stress, normal, tn, along, size)
        !! Normal traction on a plane, its shear traction and the size of that.
        real(dp), intent(in) :: stress(6), normal(3)
        real(dp), intent(out) :: tn, along(3), size      !! [Pa]

        along(1) = stress(1)*normal(1) + stress(6)*normal(2) + stress(5)*normal(3)
        along(2) = stress(6)*normal(1) + stress(2)*normal(2) + stress(4)*normal(3)
        along(3) = stress(5)*normal(1) + stress(4)*normal(2) + stress(3)*normal(3)
        tn = dot_product(along, normal)
        along = along - tn*normal
        size = norm2(along)
    end subroutine tractions

    pure function dyad(a, b) result(column)
        !! Strain (a b + b a)/2 with engineering shears.
        real(dp), intent(in) :: a(3), b(3)
        real(dp) :: column(6)

        column(1:3) = a*b
        column(4) = a(2)*b(3) + a(3)*b(2)
        column(5) = a(3)*b(1) + a(1)*b(3)
        column(6) = a(1)*b(2) + a(2)*b(1)
    end function dyad

end module pyblast_ubiquitous_joints
