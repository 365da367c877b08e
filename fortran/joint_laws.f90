module pyblast_joint_laws
    !! Traction laws of joints: one number, one signature line and one routine for each law.
    !!
    !! Traction and jump are vectors in global axes; the normal points from the minus to the plus
    !! side; tension and opening are positive. A law is total in the jump: t = t0 + K (jump - slip).
    !! Of every law that opens, the fifth state says whether it slips (1) or is open (2), the sixth
    !! how wide it is open [m].
    use pyblast_kinds, only : dp, n_joint_properties, n_joint_state
    use pyblast_joint_closure, only : barton_bandis, closure
    use pyblast_joint_fill, only : kelvin, maxwell, yielding
    use pyblast_joint_coulomb, only : coulomb, softening, stored_energy, stress_dependent
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
                "friction_residual tension_residual dilation dilation_slip | " // &
                "slip_x slip_y slip_z failed status gap dilated length"
        case (3)
            signature = "softening: kn ks cohesion friction friction_dynamic weakening_slip " // &
                "tension | slip_x slip_y slip_z failed status gap length"
        case (4)
            signature = "closure: kn ks closure kn_max irrecoverable cohesion friction | " // &
                "slip_x slip_y slip_z failed status gap peak rest started"
        case (5)
            signature = "barton_bandis: kn ks closure kn_max irrecoverable jrc jcs friction " // &
                "peak_slip | slip_x slip_y slip_z failed status gap peak rest started dilated length"
        case (6)
            signature = "stress_dependent: kn ks pressure exponent kn_max cohesion friction | " // &
                "slip_x slip_y slip_z failed status gap dilated length"
        case (7)
            signature = "kelvin: kn ks eta_n eta_s | rate_x rate_y rate_z"
        case (8)
            signature = "maxwell: kn ks eta_n eta_s | excess_x excess_y excess_z"
        case (9)
            signature = "yielding: kn ks friction friction_initial roughness | " // &
                "excess_x excess_y excess_z worn status gap way_x way_y way_z ratio"
        case default
            signature = ""
        end select
    end subroutine joint_law_signature

    pure subroutine joint_bound(law, property, stiffness, viscosity)
        !! Tell the largest tangent stiffness that a law can have, and its viscosity: the time step.
        !! A Kelvin fill shortens the step as twice its viscosity, for it foresees its rate.
        integer, intent(in) :: law
        real(dp), intent(in) :: property(n_joint_properties)
        real(dp), intent(out) :: stiffness             !! [Pa/m]
        real(dp), intent(out) :: viscosity             !! [Pa s/m]

        stiffness = maxval(property(1:2))
        viscosity = 0.0_dp
        select case (law)
        case (4, 5)
            stiffness = max(property(4)/(1.0_dp - property(5)), property(2))
        case (6)
            stiffness = property(5)*max(1.0_dp, property(2)/property(1))
        case (7)
            viscosity = 2.0_dp*maxval(property(3:4))
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
        case (3)
            call softening(property, initial, normal, jump, state, traction, stored)
        case (4)
            call closure(property, initial, normal, jump, state, traction, stored)
        case (5)
            call barton_bandis(property, initial, normal, jump, state, traction, stored)
        case (6)
            call stress_dependent(property, initial, normal, jump, state, traction, stored)
        case (7)
            call kelvin(property, dt, initial, normal, jump, step, state, traction, stored)
        case (8)
            call maxwell(property, dt, initial, normal, jump, step, state, traction, stored)
        case (9)
            call yielding(property, initial, normal, jump, step, state, traction, stored)
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

end module pyblast_joint_laws
