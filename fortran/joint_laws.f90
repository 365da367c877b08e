module pyblast_joint_laws
    !! Traction laws of joints: one number, one signature line and one routine for each law.
    !!
    !! Traction and jump are vectors in global axes; the normal points from the minus to the plus
    !! side; tension and opening are positive. A law is total in the jump: t = t0 + K (jump - slip).
    use pyblast_kinds, only : dp, n_joint_properties, n_joint_state
    implicit none
    private
    public :: joint_bound, joint_law_signature, joint_traction

contains

    pure subroutine joint_law_signature(law, signature)
        !! Say name, properties and state of a law: the table that Python, files and messages use.
        integer, intent(in) :: law                     !! from 1
        character(len=400), intent(out) :: signature   !! "name: properties | state"

        select case (law)
        case (1)
            signature = "elastic: kn ks |"
        case (2)
            signature = "coulomb: kn ks cohesion friction tension cohesion_residual " // &
                "friction_residual tension_residual | slip_x slip_y slip_z failed status"
        case default
            signature = ""
        end select
    end subroutine joint_law_signature

    pure subroutine joint_bound(law, property, stiffness, viscosity)
        !! Tell the largest tangent stiffness that a law can have, and its viscosity: the time step.
        integer, intent(in) :: law
        real(dp), intent(in) :: property(n_joint_properties)
        real(dp), intent(out) :: stiffness             !! [Pa/m]
        real(dp), intent(out) :: viscosity             !! [Pa s/m]

        select case (law)
        case default
            stiffness = maxval(property(1:2))
            viscosity = 0.0_dp
        end select
    end subroutine joint_bound

    pure subroutine joint_traction(law, property, dt, initial, normal, jump, step, state, &
                                   traction, stored)
        !! Traction of one contact by its law.
        integer, intent(in) :: law
        real(dp), intent(in) :: property(n_joint_properties)
        real(dp), intent(in) :: dt                     !! time step [s]
        real(dp), intent(in) :: initial(3)             !! traction at zero jump [Pa]
        real(dp), intent(in) :: normal(3)              !! unit, from minus to plus
        real(dp), intent(in) :: jump(3)                !! displacement of plus less minus [m]
        real(dp), intent(in) :: step(3)                !! how the jump grew since the last step [m]
        real(dp), intent(inout) :: state(n_joint_state)
        real(dp), intent(out) :: traction(3)           !! on the minus side [Pa]
        real(dp), intent(out) :: stored                !! recoverable energy [J/m2]

        select case (law)
        case (2)
            call coulomb(property, initial, normal, jump, state, traction, stored)
        case default
            call elastic(property, initial, normal, jump, traction, stored)
        end select
    end subroutine joint_traction

    pure subroutine elastic(property, initial, normal, jump, traction, stored)
        !! t = t0 + kn (jump.n) n + ks jump_shear: displacement discontinuity, theory.md (3.1).
        real(dp), intent(in) :: property(n_joint_properties), initial(3), normal(3), jump(3)
        real(dp), intent(out) :: traction(3), stored
        real(dp) :: opening(3)

        associate (kn => property(1), ks => property(2))
            opening = dot_product(jump, normal)*normal
            traction = initial + kn*opening + ks*(jump - opening)
            stored = stored_energy(kn, ks, normal, traction)
        end associate
    end subroutine elastic

    pure subroutine coulomb(property, initial, normal, jump, state, traction, stored)
        !! Elastic until |shear| exceeds cohesion + pressure*friction or the normal traction exceeds
        !! the tension cut-off; residual strength after first failure; theory.md (3.2) to (3.4).
        real(dp), intent(in) :: property(n_joint_properties), initial(3), normal(3), jump(3)
        real(dp), intent(inout) :: state(n_joint_state)
        real(dp), intent(out) :: traction(3), stored
        real(dp) :: strength(3), tn, ts, initial_shear(3), shear_jump(3), shear(3)

        associate (kn => property(1), ks => property(2), slip => state(1:3), failed => state(4), &
                   status => state(5))
            tn = dot_product(initial, normal)
            initial_shear = initial - tn*normal
            tn = tn + kn*dot_product(jump, normal)
            shear_jump = jump - dot_product(jump, normal)*normal
            shear = initial_shear + ks*(shear_jump - slip)
            ts = norm2(shear)

            strength = merge(property(6:8), property(3:5), failed > 0.0_dp)
            status = 0.0_dp
            if (tn > strength(3)) then
                status = 2.0_dp
            else if (ts > strength(1) + max(0.0_dp, -tn)*strength(2)) then
                status = 1.0_dp
            end if
            if (status > 0.0_dp) then
                failed = ior(nint(failed), nint(status))
                strength = property(6:8)
                if (tn > strength(3)) status = 2.0_dp
            end if

            if (status > 1.0_dp) then
                failed = ior(nint(failed), 2)
                slip = shear_jump + initial_shear/ks
                traction = 0.0_dp
            else
                ts = min(1.0_dp, (strength(1) + max(0.0_dp, -tn)*strength(2)) &
                         /max(ts, tiny(ts)))
                if (status > 0.0_dp) then
                    slip = slip + (1.0_dp - ts)*shear/ks
                    shear = ts*shear
                end if
                traction = tn*normal + shear
            end if
            stored = stored_energy(kn, ks, normal, traction)
        end associate
    end subroutine coulomb

    pure function stored_energy(kn, ks, normal, traction) result(energy)
        !! Energy in the two springs of a contact, per area.
        real(dp), intent(in) :: kn, ks, normal(3), traction(3)
        real(dp) :: energy, tn

        tn = dot_product(traction, normal)
        energy = 0.5_dp*(tn**2/kn + max(0.0_dp, dot_product(traction, traction) - tn**2)/ks)
    end function stored_energy

end module pyblast_joint_laws
