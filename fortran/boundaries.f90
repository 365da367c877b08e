module pyblast_boundaries
    !! Forces that the outside world puts on nodes, and motions that it prescribes.
    use pyblast_kinds, only : dp
    use pyblast_lanes, only : lanes
    implicit none
    private
    public :: load_forces, load_power, viscous_forces, reaction_forces

contains

    pure subroutine load_forces(n_nodes, n_loads, n_histories, n_total, step, load_node, &
                                load_vector, load_history, load_delay, load_lane, history, &
                                velocity, load_amplitude, force, power)
        !! Add every load, its vector times the present amplitude of its history, and tell its power.
        !! Stress on faces, holes and point forces all arrive here; theory.md (4.3), (5.1).
        integer, intent(in) :: n_nodes, n_loads, n_histories, n_total
        integer, intent(in) :: step                           !! from 1
        integer, intent(in) :: load_node(n_loads)             !! from 1
        real(dp), intent(in) :: load_vector(3, n_loads)       !! force per unit of the history
        integer, intent(in) :: load_history(n_loads)          !! from 1
        real(dp), intent(in) :: load_delay(n_loads)           !! steps behind its history
        integer, intent(in) :: load_lane(n_loads)             !! from 1; 0 is every one
        real(dp), intent(in) :: history(n_histories, n_total)
        real(dp), intent(in) :: velocity(lanes, 3, n_nodes)   !! [m/s]
        real(dp), intent(inout) :: load_amplitude(n_loads)    !! of this step
        real(dp), intent(inout) :: force(lanes, 3, n_nodes)   !! [N]
        real(dp), intent(out) :: power(lanes)                 !! [W]
        integer :: k, l

        do k = 1, n_loads
            load_amplitude(k) = delayed(n_histories, n_total, history, load_history(k), step, &
                                        load_delay(k))
            do l = max(1, load_lane(k)), merge(lanes, load_lane(k), load_lane(k) == 0)
                force(l, :, load_node(k)) = force(l, :, load_node(k)) &
                    + load_vector(:, k)*load_amplitude(k)
            end do
        end do
        call load_power(n_nodes, n_loads, load_node, load_vector, load_lane, load_amplitude, &
                        velocity, power)
    end subroutine load_forces

    pure function delayed(n_histories, n_total, history, row, step, delay) result(amplitude)
        !! A history some steps ago, by a cubic through four samples; nothing before the first.
        integer, intent(in) :: n_histories, n_total, row, step
        real(dp), intent(in) :: history(n_histories, n_total), delay
        real(dp) :: amplitude, x, weight(4)
        integer :: first, i, k

        first = step - floor(delay)
        x = delay - floor(delay)
        if (.not. x > 0.0_dp) then
            amplitude = 0.0_dp
            if (first >= 1) amplitude = history(row, first)
            return
        end if
        weight = [-x*(1.0_dp - x)*(2.0_dp - x)/6.0_dp, (1.0_dp - x**2)*(2.0_dp - x)/2.0_dp, &
                  x*(1.0_dp + x)*(2.0_dp - x)/2.0_dp, -x*(1.0_dp - x**2)/6.0_dp]
        amplitude = 0.0_dp
        do k = 1, 4
            i = min(first + 2 - k, n_total)
            if (i >= 1) amplitude = amplitude + weight(k)*history(row, i)
        end do
    end function delayed

    pure subroutine load_power(n_nodes, n_loads, load_node, load_vector, load_lane, &
                               load_amplitude, velocity, power)
        !! Power of all loads on the given velocity; arguments as in load_forces.
        integer, intent(in) :: n_nodes, n_loads, load_node(n_loads), load_lane(n_loads)
        real(dp), intent(in) :: load_vector(3, n_loads), load_amplitude(n_loads)
        real(dp), intent(in) :: velocity(lanes, 3, n_nodes)
        real(dp), intent(out) :: power(lanes)                 !! [W]
        integer :: k, l

        power = 0.0_dp
        do k = 1, n_loads
            do l = max(1, load_lane(k)), merge(lanes, load_lane(k), load_lane(k) == 0)
                power(l) = power(l) &
                    + load_amplitude(k)*dot_product(load_vector(:, k), velocity(l, :, load_node(k)))
            end do
        end do
    end subroutine load_power

    pure subroutine viscous_forces(n_nodes, n_dashpots, dt, node_mass, node_alpha, dashpot_node, &
                                   dashpot_impedance, dashpot_inverse, velocity, force, &
                                   work_before, work_after)
        !! Add the force of quiet boundaries at the mean velocity of the step, -Z (v_old + v_new)/2.
        !!
        !! The new velocity is solved for at each node, so a dashpot costs no time step.
        !! Source: Lysmer & Kuhlemeyer (1969); theory.md (4.1), (4.2).
        integer, intent(in) :: n_nodes, n_dashpots
        real(dp), intent(in) :: dt                                 !! [s]
        real(dp), intent(in) :: node_mass(lanes, n_nodes)          !! [kg]
        real(dp), intent(in) :: node_alpha(lanes, n_nodes)         !! mass damping [1/s]
        integer, intent(in) :: dashpot_node(n_dashpots)            !! from 1
        real(dp), intent(in) :: dashpot_impedance(3, 3, n_dashpots)  !! Z = sum of area*rho*c [N s/m]
        real(dp), intent(in) :: dashpot_inverse(3, 3, lanes, n_dashpots)
            !! inverse of m (1 + alpha dt/2) I + Z dt/2 [1/kg]
        real(dp), intent(in) :: velocity(lanes, 3, n_nodes)        !! [m/s]
        real(dp), intent(inout) :: force(lanes, 3, n_nodes)        !! [N]
        real(dp), intent(out) :: work_before(lanes), work_after(lanes)
            !! half a step's energy taken out, on the old and on the new velocity [J]
        real(dp) :: resistance(3), drive(3), old(3), new(3)
        integer :: d, n, l

        work_before = 0.0_dp
        work_after = 0.0_dp
        do d = 1, n_dashpots
            n = dashpot_node(d)
            do l = 1, lanes
                old = velocity(l, :, n)
                drive = node_mass(l, n)*(1.0_dp - 0.5_dp*dt*node_alpha(l, n))*old &
                    - 0.5_dp*dt*matmul(dashpot_impedance(:, :, d), old) + dt*force(l, :, n)
                new = matmul(dashpot_inverse(:, :, l, d), drive)
                resistance = 0.5_dp*matmul(dashpot_impedance(:, :, d), old + new)
                work_before(l) = work_before(l) + 0.5_dp*dt*dot_product(resistance, old)
                work_after(l) = work_after(l) + 0.5_dp*dt*dot_product(resistance, new)
                force(l, :, n) = force(l, :, n) - resistance
            end do
        end do
    end subroutine viscous_forces

    pure subroutine reaction_forces(n_nodes, n_fixed, n_histories, dt, node_mass, node_alpha, &
                                    fixed_node, fixed_direction, fixed_history, amplitude, &
                                    velocity, force, work_before, work_after)
        !! Add the reactions that give nodes a prescribed velocity along directions, or rest.
        !! Directions of one node are orthonormal; theory.md (4.4).
        integer, intent(in) :: n_nodes, n_fixed, n_histories
        real(dp), intent(in) :: dt                                 !! [s]
        real(dp), intent(in) :: node_mass(lanes, n_nodes)          !! [kg]
        real(dp), intent(in) :: node_alpha(lanes, n_nodes)         !! mass damping [1/s]
        integer, intent(in) :: fixed_node(n_fixed)                 !! from 1
        real(dp), intent(in) :: fixed_direction(3, n_fixed)        !! unit
        integer, intent(in) :: fixed_history(lanes, n_fixed)       !! from 1; 0 means at rest
        real(dp), intent(in) :: amplitude(n_histories)             !! velocity at the step's end [m/s]
        real(dp), intent(in) :: velocity(lanes, 3, n_nodes)        !! [m/s]
        real(dp), intent(inout) :: force(lanes, 3, n_nodes)        !! [N]
        real(dp), intent(out) :: work_before(lanes), work_after(lanes)
            !! energy put in, two halves [J]
        real(dp) :: new, old, damping, reaction
        integer :: f, n, l

        work_before = 0.0_dp
        work_after = 0.0_dp
        do f = 1, n_fixed
            n = fixed_node(f)
            do l = 1, lanes
                new = 0.0_dp
                if (fixed_history(l, f) > 0) new = amplitude(fixed_history(l, f))
                old = dot_product(velocity(l, :, n), fixed_direction(:, f))
                damping = 0.5_dp*dt*node_alpha(l, n)
                reaction = node_mass(l, n)*((1.0_dp + damping)*new - (1.0_dp - damping)*old)/dt &
                    - dot_product(force(l, :, n), fixed_direction(:, f))
                force(l, :, n) = force(l, :, n) + reaction*fixed_direction(:, f)
                work_before(l) = work_before(l) + 0.5_dp*dt*reaction*old
                work_after(l) = work_after(l) + 0.5_dp*dt*reaction*new
            end do
        end do
    end subroutine reaction_forces

end module pyblast_boundaries
