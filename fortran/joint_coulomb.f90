module pyblast_joint_coulomb
    !! Joints that slip and open: Coulomb friction, slip weakening, stress-dependent stiffness.
    use pyblast_kinds, only : dp, n_joint_properties, n_joint_state
    use pyblast_batch, only : n_batch
    implicit none
    private
    public :: coulomb, held_tractions, return_to_strength, softening, split, stored_energy, &
        stress_dependent

    real(dp), parameter :: rounding = 1e-12_dp   !! within which a law decides, not its bound

contains

    pure subroutine coulomb(property, initial, normal, jump, state, traction, stored)
        !! Elastic until |shear| exceeds cohesion + pressure*friction or the normal traction exceeds
        !! the tension cut-off; residual strength after first failure, dilation while it slips
        !! under pressure, up to a length of slip; theory.md (3.2) to (3.4), (3.6).
        real(dp), intent(in) :: property(n_joint_properties), initial(3), normal(3), jump(3)
        real(dp), intent(inout) :: state(n_joint_state)
        real(dp), intent(out) :: traction(3), stored
        real(dp) :: strength(3), tn, shear(3), shear_jump(3), initial_shear(3), slid, rise

        associate (kn => property(1), ks => property(2), slip => state(1:3), failed => state(4), &
                   status => state(5), gap => state(6), dilated => state(7), length => state(8))
            call split(initial, normal, tn, initial_shear)
            shear_jump = jump - dot_product(jump, normal)*normal
            tn = tn + kn*(dot_product(jump, normal) - dilated)
            shear = initial_shear + ks*(shear_jump - slip)
            strength = present_strength(property(3:5), property(6:8), failed)
            status = merge(1.0_dp, 0.0_dp, norm2(shear) > shear_strength(strength(1), strength(2), tn))
            if (tn > strength(3)) status = 2.0_dp
            if (status > 0.0_dp) then
                failed = ior(nint(failed), nint(status))
                strength = property(6:8)
                if (tn > strength(3)) status = 2.0_dp
            end if
            gap = 0.0_dp
            if (status > 1.0_dp) then
                failed = ior(nint(failed), 2)
                slip = shear_jump + initial_shear/ks
                gap = tn/kn
                traction = 0.0_dp
            else
                if (status > 0.0_dp) then
                    rise = 0.0_dp
                    if (tn < 0.0_dp .and. length < property(10)) rise = kn*property(9)
                    slid = max(0.0_dp, norm2(shear) - strength(1) - max(0.0_dp, -tn)*strength(2)) &
                        /(ks + rise*strength(2))
                    rise = rise*min(slid, max(0.0_dp, property(10) - length))
                    tn = tn - rise
                    dilated = dilated + rise/kn
                    call return_to_strength(ks, shear_strength(strength(1), strength(2), tn), shear, slip, &
                                            slid)
                    length = length + slid
                end if
                traction = tn*normal + shear
            end if
            stored = stored_energy(kn, ks, normal, traction)
        end associate
    end subroutine coulomb

    pure subroutine held_tractions(law, property, initial, normal, jump, state, traction, stored, &
                                   held)
        !! Traction of one contact of each model where its springs hold it: elastic, or Coulomb that
        !! neither slips nor opens; (3.1) to (3.3). Where `held` is false the law itself must say.
        integer, intent(in) :: law(n_batch)
        real(dp), intent(in) :: property(n_joint_properties, n_batch), initial(3, n_batch)
        real(dp), intent(in) :: normal(3), jump(n_batch, 3)
        real(dp), intent(inout) :: state(n_joint_state, n_batch)
        real(dp), intent(out) :: traction(n_batch, 3), stored(n_batch)
        logical, intent(out) :: held(n_batch)
        real(dp) :: open, first, spring, along, slide(3), shear(3), square, limit, strength(3), bonded
        integer :: l

        !$omp simd private(open, first, spring, along, slide, shear, square, limit, strength, bonded)
        do l = 1, n_batch
            bonded = merge(1.0_dp, 0.0_dp, law(l) == 2)
            open = jump(l, 1)*normal(1) + jump(l, 2)*normal(2) + jump(l, 3)*normal(3)
            first = initial(1, l)*normal(1) + initial(2, l)*normal(2) + initial(3, l)*normal(3)
            spring = property(1, l)*(open - bonded*state(7, l))
            along = first + spring
            slide(1) = property(2, l)*((jump(l, 1) - open*normal(1)) - bonded*state(1, l))
            slide(2) = property(2, l)*((jump(l, 2) - open*normal(2)) - bonded*state(2, l))
            slide(3) = property(2, l)*((jump(l, 3) - open*normal(3)) - bonded*state(3, l))
            shear(1) = (initial(1, l) - first*normal(1)) + slide(1)
            shear(2) = (initial(2, l) - first*normal(2)) + slide(2)
            shear(3) = (initial(3, l) - first*normal(3)) + slide(3)
            strength(1) = present_strength(property(3, l), property(6, l), state(4, l))
            strength(2) = present_strength(property(4, l), property(7, l), state(4, l))
            strength(3) = present_strength(property(5, l), property(8, l), state(4, l))
            square = shear(1)**2 + shear(2)**2 + shear(3)**2
            limit = shear_strength(strength(1), strength(2), along)
            held(l) = law(l) == 1 .or. (law(l) == 2 .and. along <= strength(3) &
                                        .and. square <= limit*limit*(1.0_dp - rounding))
            traction(l, 1) = initial(1, l) + (spring*normal(1) + slide(1))
            traction(l, 2) = initial(2, l) + (spring*normal(2) + slide(2))
            traction(l, 3) = initial(3, l) + (spring*normal(3) + slide(3))
            stored(l) = 0.5_dp*(along**2/property(1, l) + square/property(2, l))
        end do
        do l = 1, n_batch
            if (held(l) .and. law(l) == 2 .and. any(abs(state(5:6, l)) > 0.0_dp)) &
                state(5:6, l) = 0.0_dp
        end do
    end subroutine held_tractions

    pure elemental function present_strength(peak, residual, failed) result(strength)
        !! Peak strength until the first failure, residual strength after it; theory.md (3.4).
        real(dp), intent(in) :: peak, residual, failed
        real(dp) :: strength

        strength = merge(residual, peak, failed > 0.0_dp)
    end function present_strength

    pure elemental function shear_strength(cohesion, friction, tn) result(strength)
        !! Coulomb's strength under a normal traction, tension positive; theory.md (3.2).
        real(dp), intent(in) :: cohesion, friction, tn
        real(dp) :: strength

        strength = cohesion + max(0.0_dp, -tn)*friction
    end function shear_strength

    pure subroutine softening(property, initial, normal, jump, state, traction, stored)
        !! Coulomb strength that falls in proportion to slip, from cohesion and static friction to
        !! dynamic friction alone; theory.md (3.7).
        !!
        !! Slip and strength of a step are solved together. A spring softer than the weakening
        !! can't follow it: the strength then falls to its end at once.
        real(dp), intent(in) :: property(n_joint_properties), initial(3), normal(3), jump(3)
        real(dp), intent(inout) :: state(n_joint_state)
        real(dp), intent(out) :: traction(3), stored
        real(dp) :: tn, shear(3), shear_jump(3), initial_shear(3), slid, pressure, last, drop, remaining
        real(dp) :: excess

        associate (kn => property(1), ks => property(2), slip => state(1:3), failed => state(4), &
                   status => state(5), gap => state(6), length => state(7))
            call split(initial, normal, tn, initial_shear)
            shear_jump = jump - dot_product(jump, normal)*normal
            tn = tn + kn*dot_product(jump, normal)
            shear = initial_shear + ks*(shear_jump - slip)
            status = 0.0_dp
            gap = 0.0_dp
            if (tn > merge(0.0_dp, property(7), failed > 0.0_dp)) then
                status = 2.0_dp
                failed = ior(nint(failed), 2)
                slip = shear_jump + initial_shear/ks
                length = max(length, property(6))
                gap = tn/kn
                traction = 0.0_dp
            else
                pressure = max(0.0_dp, -tn)
                last = pressure*property(5)
                drop = (property(3) + pressure*property(4) - last)/property(6)
                remaining = max(0.0_dp, property(6) - length)
                excess = norm2(shear) - last - drop*remaining
                if (excess > 0.0_dp) then
                    status = 1.0_dp
                    if (excess < (ks - drop)*remaining) last = norm2(shear) - ks*excess/(ks - drop)
                    call return_to_strength(ks, last, shear, slip, slid)
                    length = length + slid
                end if
                failed = ior(nint(failed), nint(status))
                traction = tn*normal + shear
            end if
            stored = stored_energy(kn, ks, normal, traction)
        end associate
    end subroutine softening

    pure subroutine stress_dependent(property, initial, normal, jump, state, traction, stored)
        !! Coulomb with stiffness that follows the pressure before the blast; an initial tension
        !! stands for a gap of t0/kn; theory.md (3.8).
        real(dp), intent(in) :: property(n_joint_properties), initial(3), normal(3), jump(3)
        real(dp), intent(inout) :: state(n_joint_state)
        real(dp), intent(out) :: traction(3), stored
        real(dp) :: like(n_joint_properties), share, tn, start(3)

        call split(initial, normal, tn, start)
        share = max(0.0_dp, -tn)/property(3)
        share = min(max(share**property(4), 1.0e-2_dp), property(5)/property(1))
        like = 0.0_dp
        like(1:2) = share*property(1:2)
        like(3:4) = property(6:7)
        like(6:7) = property(6:7)
        start = initial + (share - 1.0_dp)*max(0.0_dp, tn)*normal
        call coulomb(like, start, normal, jump, state, traction, stored)
    end subroutine stress_dependent

    pure subroutine return_to_strength(ks, strength, shear, slip, slid)
        !! Bring shear back to its strength; what it exceeds becomes slip along it.
        real(dp), intent(in) :: ks, strength
        real(dp), intent(inout) :: shear(3), slip(3)
        real(dp), intent(out) :: slid                  !! length of this slip [m]
        real(dp) :: size, share

        slid = 0.0_dp
        size = norm2(shear)
        if (size > strength) then
            share = 1.0_dp - strength/size
            slid = share*size/ks
            slip = slip + share*shear/ks
            shear = (1.0_dp - share)*shear
        end if
    end subroutine return_to_strength

    pure subroutine split(vector, normal, along, across)
        !! Part of a vector along the normal, and what is left.
        real(dp), intent(in) :: vector(3), normal(3)
        real(dp), intent(out) :: along, across(3)

        along = dot_product(vector, normal)
        across = vector - along*normal
    end subroutine split

    pure function stored_energy(kn, ks, normal, traction) result(energy)
        !! Energy in the two springs of a contact, per area.
        real(dp), intent(in) :: kn, ks, normal(3), traction(3)
        real(dp) :: energy, tn

        tn = dot_product(traction, normal)
        energy = 0.5_dp*(tn**2/kn + max(0.0_dp, dot_product(traction, traction) - tn**2)/ks)
    end function stored_energy

end module pyblast_joint_coulomb
