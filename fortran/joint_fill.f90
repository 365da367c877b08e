module pyblast_joint_fill
    !! Joints with a fill that flows, and joints that yield from the first motion on.
    use pyblast_kinds, only : dp, n_joint_properties, n_joint_state
    use pyblast_joint_coulomb, only : split, stored_energy
    implicit none
    private
    public :: kelvin, maxwell, yielding

    real(dp), parameter :: largest_ratio = 0.75_dp

contains

    pure subroutine kelvin(property, dt, initial, normal, jump, step, state, traction, stored)
        !! A spring and a dashpot side by side, its rate foreseen from the last two steps;
        !! theory.md (3.15). Property: kn ks eta_n eta_s. State: rate of the last step.
        real(dp), intent(in) :: property(n_joint_properties), dt, initial(3), normal(3), jump(3)
        real(dp), intent(in) :: step(3)
        real(dp), intent(inout) :: state(n_joint_state)
        real(dp), intent(out) :: traction(3), stored
        real(dp) :: opening, shear(3), rate, shear_rate(3)

        call split(jump, normal, opening, shear)
        traction = initial + property(1)*opening*normal + property(2)*shear
        stored = stored_energy(property(1), property(2), normal, traction)
        if (dt > 0.0_dp) then
            call split(1.5_dp*step/dt - 0.5_dp*state(1:3), normal, rate, shear_rate)
            state(1:3) = step/dt
            traction = traction + property(3)*rate*normal + property(4)*shear_rate
        end if
    end subroutine kelvin

    pure subroutine maxwell(property, dt, initial, normal, jump, step, state, traction, stored)
        !! A spring and a dashpot in a row, by the trapezoidal rule; theory.md (3.16).
        !! Property: kn ks eta_n eta_s. State: traction in excess of the initial one.
        real(dp), intent(in) :: property(n_joint_properties), dt, initial(3), normal(3), jump(3)
        real(dp), intent(in) :: step(3)
        real(dp), intent(inout) :: state(n_joint_state)
        real(dp), intent(out) :: traction(3), stored
        real(dp) :: tn, ts(3), opening, shear(3), x(2)

        x = 0.5_dp*dt*property(1:2)/property(3:4)
        call split(state(1:3), normal, tn, ts)
        call split(step, normal, opening, shear)
        tn = ((1.0_dp - x(1))*tn + property(1)*opening)/(1.0_dp + x(1))
        ts = ((1.0_dp - x(2))*ts + property(2)*shear)/(1.0_dp + x(2))
        state(1:3) = tn*normal + ts
        traction = initial + state(1:3)
        stored = stored_energy(property(1), property(2), normal, state(1:3)) &
            + dot_product(initial, jump)
    end subroutine maxwell

    pure subroutine yielding(property, initial, normal, jump, step, state, traction, stored)
        !! Continuously yielding joint: shear approaches a strength that slip wears down;
        !! theory.md (3.17) to (3.19). Property: kn ks friction friction_initial roughness.
        !! State: shear in excess of the initial one, worn, status, gap, last direction, ratio at
        !! reversal.
        real(dp), intent(in) :: property(n_joint_properties), initial(3), normal(3), jump(3), step(3)
        real(dp), intent(inout) :: state(n_joint_state)
        real(dp), intent(out) :: traction(3), stored
        real(dp) :: tn, shear(3), start(3), opening, along(3), strength, distance, factor, far
        real(dp) :: size

        associate (kn => property(1), ks => property(2), excess => state(1:3), worn => state(4), &
                   status => state(5), gap => state(6), direction => state(7:9), ratio => state(10))
            call split(initial, normal, tn, start)
            tn = tn + kn*dot_product(jump, normal)
            call split(step, normal, opening, along)
            gap = max(0.0_dp, tn/kn)
            status = merge(2.0_dp, 1.0_dp, gap > 0.0_dp)
            if (gap > 0.0_dp) then
                excess = -start
                traction = 0.0_dp
                stored = 0.0_dp
                return
            end if
            shear = start + excess
            strength = -tn*tan(atan(property(4)) - worn)
            distance = norm2(along)
            if (distance > 0.0_dp .and. strength > 0.0_dp) then
                if (dot_product(along, direction) < 0.0_dp) &
                    ratio = min(largest_ratio, dot_product(shear, along)/distance/strength)
                direction = along/distance
                factor = (1.0_dp - dot_product(shear, direction)/strength)/(1.0_dp - ratio)
                far = ks*distance/(strength*(1.0_dp - ratio))
                factor = min(1.0_dp, max(0.0_dp, factor))*(1.0_dp - exp(-far))/far
                shear = shear + factor*ks*along
                worn = worn + (atan(property(4)) - worn - atan(property(3))) &
                    *(1.0_dp - exp(-(1.0_dp - factor)*distance/property(5)))
            end if
            size = norm2(shear)
            if (size > max(0.0_dp, strength)) shear = shear*max(0.0_dp, strength)/size
            excess = shear - start
            traction = tn*normal + shear
            stored = stored_energy(kn, ks, normal, traction)
        end associate
    end subroutine yielding

end module pyblast_joint_fill
