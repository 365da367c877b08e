module pyblast_joint_closure
    !! Joints that stiffen as they close: Bandis' hyperbola, with Coulomb or with Barton's strength.
    use pyblast_kinds, only : dp, n_joint_properties, n_joint_state
    use pyblast_joint_coulomb, only : return_to_strength, split
    implicit none
    private
    public :: barton_bandis, closure

    real(dp), parameter :: steepest = 70.0_dp*acos(-1.0_dp)/180.0_dp
    real(dp), parameter :: slip_over_peak(6) = [1.0_dp, 2.0_dp, 4.0_dp, 10.0_dp, 25.0_dp, 100.0_dp]
    real(dp), parameter :: mobilised(6) = [1.0_dp, 0.85_dp, 0.7_dp, 0.5_dp, 0.4_dp, 0.0_dp]

contains

    pure subroutine closure(property, initial, normal, jump, state, traction, stored)
        !! Hyperbola of closure and Coulomb strength without residual; theory.md (3.9) to (3.12).
        !! Property: kn ks closure kn_max irrecoverable cohesion friction.
        !! State: slip, failed, status, gap, peak, rest, started.
        real(dp), intent(in) :: property(n_joint_properties), initial(3), normal(3), jump(3)
        real(dp), intent(inout) :: state(n_joint_state)
        real(dp), intent(out) :: traction(3), stored
        real(dp) :: pressure, slid

        call normal_closure(property, initial, normal, jump, 0.0_dp, state, pressure, stored)
        call slip_with_friction(property(2), property(6) + pressure*property(7), initial, normal, jump, pressure, &
                 state, traction, stored, slid)
    end subroutine closure

    pure subroutine barton_bandis(property, initial, normal, jump, state, traction, stored)
        !! Hyperbola of closure with the strength of rough walls; theory.md (3.13), (3.14).
        !! Property: kn ks closure kn_max irrecoverable jrc jcs friction peak_slip.
        !! State: slip, failed, status, gap, peak, rest, started, dilated, length.
        real(dp), intent(in) :: property(n_joint_properties), initial(3), normal(3), jump(3)
        real(dp), intent(inout) :: state(n_joint_state)
        real(dp), intent(out) :: traction(3), stored
        real(dp) :: pressure, slid, shear(3), shear_jump(3), along, trial

        call split(jump, normal, along, shear_jump)
        call split(initial, normal, along, shear)
        associate (ks => property(2), length => state(11))
            trial = norm2(shear + ks*(shear_jump - state(1:3)))
            call dilate(property, initial, normal, jump, trial, state, pressure, stored)
            call slip_with_friction(ks, rough_strength(property, length, pressure), initial, normal, jump, &
                     pressure, state, traction, stored, slid)
            length = length + slid
        end associate
    end subroutine barton_bandis

    pure subroutine dilate(property, initial, normal, jump, trial, state, pressure, stored)
        !! Pressure of walls that dilate by what they slip in this step, with what they dilated so
        !! far: slip, dilation, pressure and strength of a step solved together, by false position
        !! (Illinois); theory.md (3.14). A trial shear within the strength dilates nothing.
        real(dp), intent(in) :: property(n_joint_properties), initial(3), normal(3), jump(3)
        real(dp), intent(in) :: trial
        real(dp), intent(inout) :: state(n_joint_state)
        real(dp), intent(out) :: pressure, stored
        real(dp) :: before, peak, low, high, missing, surplus, more, residual
        integer :: k

        before = state(10)
        call normal_closure(property, initial, normal, jump, before, state, pressure, stored)
        more = dilation(property, state(11), pressure, trial)
        if (.not. more > 0.0_dp) return
        peak = state(7)
        low = 0.0_dp
        missing = -more
        high = more
        surplus = 0.0_dp
        do k = 1, 50
            state(7) = peak
            call normal_closure(property, initial, normal, jump, before + more, state, pressure, stored)
            residual = more - dilation(property, state(11), pressure, trial)
            if (abs(residual) <= 1e-12_dp*more) exit
            if (residual < 0.0_dp) then
                low = more
                missing = residual
                if (k > 1) surplus = 0.5_dp*surplus
            else
                high = more
                surplus = residual
                if (k > 1) missing = 0.5_dp*missing
            end if
            more = (low*surplus - high*missing)/(surplus - missing)
        end do
        state(10) = before + more
    end subroutine dilate

    pure function dilation(property, length, pressure, trial) result(more)
        !! Dilation by the slip that brings a trial shear back to the strength; theory.md (3.14).
        real(dp), intent(in) :: property(n_joint_properties), length, pressure, trial
        real(dp) :: more

        more = 0.0_dp
        if (.not. pressure > 0.0_dp) return
        more = max(0.0_dp, trial - rough_strength(property, length, pressure))/property(2)
        more = more*tan(0.5_dp*roughness(property, length, pressure))
    end function dilation

    pure function rough_strength(property, length, pressure) result(strength)
        !! Strength of rough walls; theory.md (3.13).
        real(dp), intent(in) :: property(n_joint_properties), length, pressure
        real(dp) :: strength

        strength = pressure*tan(min(steepest, atan(property(8))) &
                                + roughness(property, length, pressure))
    end function rough_strength

    pure function roughness(property, length, pressure) result(angle)
        !! Angle that rough walls add to friction, together at most 70 degrees; theory.md (3.13).
        !! Dilation has the same bound, else it could give more energy than friction takes.
        real(dp), intent(in) :: property(n_joint_properties), length, pressure
        real(dp) :: angle

        angle = 0.0_dp
        if (.not. pressure > 0.0_dp) return
        angle = property(6)*mobilisation(length/property(9)) &
            *max(0.0_dp, log10(property(7)/pressure))*acos(-1.0_dp)/180.0_dp
        angle = max(0.0_dp, min(angle, steepest - atan(property(8))))
    end function roughness

    pure subroutine normal_closure(property, initial, normal, jump, dilated, state, pressure, stored)
        !! Pressure on the hyperbola, or on the steeper one of unloading; energy of the normal part.
        real(dp), intent(in) :: property(n_joint_properties), initial(3), normal(3), jump(3)
        real(dp), intent(in) :: dilated
        real(dp), intent(inout) :: state(n_joint_state)
        real(dp), intent(out) :: pressure, stored
        real(dp) :: elbow, lost, width, ku, v, y

        associate (kn => property(1), vm => property(3), kn_max => property(4), gap => state(6), &
                   peak => state(7), rest => state(8), started => state(9))
            elbow = vm*(1.0_dp - sqrt(kn/kn_max))
            if (.not. started > 0.0_dp) then
                rest = closure_under(property, elbow, peak, -dot_product(initial, normal))
                started = 1.0_dp
            end if
            v = rest - dot_product(jump, normal) + dilated
            peak = min(max(peak, v), elbow)
            lost = property(5)*max(0.0_dp, peak)
            width = vm - lost
            ku = kn*vm/(width*(1.0_dp - property(5)))
            y = min(max(0.0_dp, v - lost), elbow - lost)/width
            gap = max(0.0_dp, lost - v)
            pressure = ku*width*y/(1.0_dp - y)
            stored = ku*width**2*(-log(1.0_dp - y) - y)
            if (v > elbow) then
                stored = stored + (v - elbow)*(pressure + 0.5_dp*kn_max*(v - elbow))
                pressure = pressure + kn_max*(v - elbow)
            end if
        end associate
    end subroutine normal_closure

    pure function closure_under(property, elbow, peak, pressure) result(v)
        !! Closure at a pressure, after a largest closure; a tension t stands for a gap of t/kn
        !! beyond what is irrecoverable.
        real(dp), intent(in) :: property(n_joint_properties), elbow, peak, pressure
        real(dp) :: v, lost, width, ku, corner

        associate (kn => property(1), vm => property(3))
            corner = kn*elbow/(1.0_dp - elbow/vm)
            if (.not. pressure > 0.0_dp) then
                v = property(5)*max(0.0_dp, peak) + pressure/kn
            else if (pressure > corner) then
                v = elbow + (pressure - corner)/property(4)
            else
                v = vm*pressure/(kn*vm + pressure)
                if (v < peak) then
                    lost = property(5)*peak
                    width = vm - lost
                    ku = kn*vm/(width*(1.0_dp - property(5)))
                    v = lost + width*pressure/(ku*width + pressure)
                end if
            end if
        end associate
    end function closure_under

    pure subroutine slip_with_friction(ks, strength, initial, normal, jump, pressure, state, traction, stored, slid)
        !! Shear under a pressure: elastic up to the strength, nothing while open; without a limit
        !! of strength it stays elastic whatever the gap, as where closure alone is modelled.
        real(dp), intent(in) :: ks, strength, initial(3), normal(3), jump(3), pressure
        real(dp), intent(inout) :: state(n_joint_state), stored
        real(dp), intent(out) :: traction(3), slid
        real(dp) :: tn, shear(3), shear_jump(3), along

        call split(initial, normal, tn, shear)
        call split(jump, normal, along, shear_jump)
        slid = 0.0_dp
        associate (slip => state(1:3), failed => state(4), status => state(5))
            status = 0.0_dp
            if (pressure > 0.0_dp .or. strength > huge(strength)) then
                shear = shear + ks*(shear_jump - slip)
                call return_to_strength(ks, strength, shear, slip, slid)
                if (slid > 0.0_dp) status = 1.0_dp
                traction = shear - pressure*normal
                stored = stored + 0.5_dp*dot_product(shear, shear)/ks
            else
                status = 2.0_dp
                slip = shear_jump + shear/ks
                traction = 0.0_dp
            end if
            failed = ior(nint(failed), nint(status))
        end associate
    end subroutine slip_with_friction

    pure function mobilisation(ratio) result(share)
        !! Share of the roughness that is left after slip over its peak; Barton's table.
        real(dp), intent(in) :: ratio
        real(dp) :: share
        integer :: i

        share = mobilised(1)
        do i = 2, size(mobilised)
            if (ratio > slip_over_peak(i - 1)) share = mobilised(i - 1) + &
                (mobilised(i) - mobilised(i - 1))*min(1.0_dp, log(ratio/slip_over_peak(i - 1)) &
                                                      /log(slip_over_peak(i)/slip_over_peak(i - 1)))
        end do
    end function mobilisation

end module pyblast_joint_closure
