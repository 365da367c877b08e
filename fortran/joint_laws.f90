module pyblast_joint_laws
    !! Traction laws of joints: one row and one routine for each law; its place in the table is its
    !! number. What there is to know of a law stands in its row; Python, project files, messages and
    !! checks follow from it, pyblast/laws.py reads it. A row is "NAME: PROPERTIES | KIND | STATE".
    !!
    !! PROPERTIES, in the order of the routine, a comma between: NAME[UNIT] in FILE RULES = DEFAULT
    !!   UNIT     SI, that the routine gets; 1: pure number, tan: tangent of an angle
    !!   in FILE  unit of its key in project files, if not the first of PROPERTY_UNITS in units.py
    !!   RULES    > >= < <= before a number or the name of another; finite, unless "<= inf";
    !!            "needs OTHER": where this one is not zero, the other must not be zero either
    !!   DEFAULT  number, inf, name of one before, or number*name; without it it must be given
    !! KIND
    !!   linear   the traction is linear in the jump and its past: motions superpose
    !!   sticks   elastic, with kn and ks, until it slips or opens: motions superpose until then
    !!   stiffens the stiffness follows the pressure: joint_tangents and joint_bound have its case
    !!   flows    creeps under a constant load, so that a static stage takes it as elastic
    !! STATE, in the order of the routine: names; "=0" behind one that belongs to the displacement
    !!   and begins at zero in each stage. Of a law that opens, the fifth is status (1: slips, 2: is
    !!   open), the sixth gap, how wide it is open [m]; one that sticks has slip_x slip_y slip_z
    !!   failed before them.
    !!
    !! Traction and jump are vectors in global axes; the normal points from the minus to the plus
    !! side; tension and opening are positive. A law is total in the jump: t = t0 + K (jump - slip).
    use, intrinsic :: ieee_arithmetic, only : ieee_quiet_nan, ieee_value
    use pyblast_kinds, only : dp, n_joint_properties, n_joint_state, n_row
    use pyblast_joint_closure, only : barton_bandis, closure
    use pyblast_joint_fill, only : kelvin, maxwell, yielding
    use pyblast_joint_coulomb, only : coulomb, softening, stored_energy, stress_dependent
    implicit none
    private
    public :: joint_bound, joint_law_signature, joint_tangents, joint_traction

    character(len=*), parameter :: springs = "kn[Pa/m] > 0, ks[Pa/m] > 0"
    character(len=*), parameter :: slip = "slip_x=0 slip_y=0 slip_z=0 failed status gap"
    character(len=n_row), parameter :: rows(*) = [character(len=n_row) :: &
        "elastic: " // springs // " | linear |", &
        "coulomb: " // springs // ", cohesion[Pa] >= 0, friction[tan] >= 0, tension[Pa] >= 0, " // &
            "cohesion_residual[Pa] >= 0 = cohesion, friction_residual[tan] >= 0 = friction, " // &
            "tension_residual[Pa] >= 0 = 0, " // &
            "dilation[tan] >= 0 <= friction_residual needs dilation_slip = 0, " // &
            "dilation_slip[m] >= 0 <= inf = 0 | sticks | " // slip // " dilated=0 length", &
        "softening: " // springs // ", cohesion[Pa] >= 0 = 0, friction[tan] >= 0, " // &
            "friction_dynamic[tan] >= 0 <= friction, weakening_slip[m] > 0, " // &
            "tension[Pa] >= 0 = 0 | sticks | " // slip // " length", &
        "closure: " // springs // ", closure[m] > 0, kn_max[Pa/m] > kn = 100*kn, " // &
            "irrecoverable[1] >= 0 <= 0.9 = 0, cohesion[Pa] >= 0 <= inf = inf, " // &
            "friction[tan] >= 0 = 0 | stiffens | " // slip // " peak rest started=0", &
        "barton_bandis: " // springs // ", closure[m] > 0, kn_max[Pa/m] > kn = 100*kn, " // &
            "irrecoverable[1] >= 0 <= 0.9 = 0, jrc[1] >= 0, jcs[Pa] in MPa > 0, " // &
            "friction[tan] >= 0, peak_slip[m] > 0 | stiffens | " // slip // &
            " peak rest started=0 dilated=0 length", &
        "stress_dependent: " // springs // ", pressure[Pa] > 0, exponent[1] >= 0, " // &
            "kn_max[Pa/m] > kn = 10*kn, cohesion[Pa] >= 0 <= inf = inf, " // &
            "friction[tan] >= 0 = 0 | stiffens | " // slip // " dilated=0 length", &
        "kelvin: " // springs // ", eta_n[Pa s/m] >= 0, eta_s[Pa s/m] >= 0 | linear | " // &
            "rate_x=0 rate_y=0 rate_z=0", &
        "maxwell: " // springs // ", eta_n[Pa s/m] > 0, eta_s[Pa s/m] > 0 | linear flows | " // &
            "excess_x=0 excess_y=0 excess_z=0", &
        "yielding: " // springs // ", friction[tan] >= 0, " // &
            "friction_initial[tan] >= friction = friction, roughness[m] > 0 | | " // &
            "excess_x=0 excess_y=0 excess_z=0 worn status gap way_x way_y way_z ratio"]
    integer, parameter, public :: n_joint_laws = size(rows)

contains

    pure subroutine joint_law_signature(law, signature)
        !! Return the row of a law, blank beyond the last.
        integer, intent(in) :: law                     !! from 1
        character(len=n_row), intent(out) :: signature

        signature = ""
        if (law >= 1 .and. law <= n_joint_laws) signature = rows(law)
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

    pure subroutine joint_tangents(law, property, pressure, kn, ks)
        !! Tangent stiffness of a joint at rest under a normal pressure, of one that closes on its
        !! loading path; theory.md (3.8), (3.10).
        integer, intent(in) :: law
        real(dp), intent(in) :: property(n_joint_properties)
        real(dp), intent(in) :: pressure               !! zero or more [Pa]
        real(dp), intent(out) :: kn, ks                !! [Pa/m]
        real(dp) :: share

        kn = property(1)
        ks = property(2)
        select case (law)
        case (4, 5)
            kn = min(kn*(1.0_dp + pressure/(kn*property(3)))**2, property(4))
        case (6)
            share = (pressure/property(3))**property(4)
            share = min(max(share, 0.01_dp), property(5)/kn)
            kn = share*kn
            ks = share*ks
        end select
    end subroutine joint_tangents

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
        case (1)
            call elastic(property, initial, normal, jump, traction, stored)
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
        case default   ! a row without its case
            traction = ieee_value(stored, ieee_quiet_nan)
            stored = traction(1)
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
