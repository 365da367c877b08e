module pyblast_boundaries
    !! Forces that the outside world puts on nodes, and motions that it prescribes.
    use pyblast_kinds, only : dp, least_shared
    use pyblast_batch, only : n_batch
    use pyblast_model_types, only : boundary_arrays, load_arrays, node_arrays
    implicit none
    private
    public :: load_forces, load_power, load_runs, viscous_forces, reaction_forces

    integer, parameter :: block_size = 512   !! dashpots whose work is added together

contains

    subroutine load_forces(loads, start, step, n_nodes, velocity, run_force, force, power)
        !! Add every load, its vector times the present amplitude of its history, and its power.
        !! Stress on faces, holes and point forces all arrive here; theory.md (4.3), (5.1).
        type(load_arrays), intent(in) :: loads
        integer, intent(in) :: start(:)                       !! of runs of loads on one node
        integer, intent(in) :: step                           !! from 1
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: velocity(n_batch, 3, n_nodes)   !! [m/s]
        real(dp), intent(inout) :: run_force(:, :, :)           !! sum of a run (n_batch, 3, n_runs) [N]
        real(dp), intent(inout) :: force(n_batch, 3, n_nodes)   !! [N]
        real(dp), intent(out) :: power(n_batch)                 !! [W]
        integer :: r, n

        !$omp parallel do schedule(static) default(none) shared(loads, start, step, run_force) &
        !$omp& if (size(loads%load_node) >= least_shared)
        do r = 1, size(start) - 1
            run_force(:, :, r) = force_of_run(loads, start(r), start(r + 1) - 1, step)
        end do
        !$omp end parallel do
        do r = 1, size(start) - 1
            n = loads%load_node(start(r))
            force(:, :, n) = force(:, :, n) + run_force(:, :, r)
        end do
        call load_power(loads, start, n_nodes, velocity, run_force, power)
    end subroutine load_forces

    pure function load_runs(node) result(start)
        !! First load of each run of loads on one node, and the end.
        integer, intent(in) :: node(:)
        integer, allocatable :: start(:)
        integer :: k

        start = [1, pack([(k, k = 2, size(node))], node(2:) /= node(:size(node) - 1)), size(node) + 1]
    end function load_runs

    pure function force_of_run(loads, first, last, step) result(force)
        !! Sum of the loads first to last, which act on one node [N].
        type(load_arrays), intent(in) :: loads
        integer, intent(in) :: first, last, step
        real(dp) :: force(n_batch, 3), part(3)
        integer :: k, m

        force = 0.0_dp
        do k = first, last
            part = loads%load_vector(:, k)*delayed(loads%history, loads%load_history(k), step, &
                                                   loads%load_delay(k))
            do m = max(1, loads%load_member(k)), merge(n_batch, loads%load_member(k), &
                                                     loads%load_member(k) == 0)
                force(m, :) = force(m, :) + part
            end do
        end do
    end function force_of_run

    pure function delayed(history, row, step, delay) result(amplitude)
        !! A history some steps ago, by a cubic through four samples; nothing before the first.
        real(dp), intent(in), contiguous :: history(:, :)     !! (n_histories, n_total)
        integer, intent(in) :: row, step
        real(dp), intent(in) :: delay                         !! [steps]
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
            i = min(first + 2 - k, size(history, 2))
            if (i >= 1) amplitude = amplitude + weight(k)*history(row, i)
        end do
    end function delayed

    pure subroutine load_power(loads, start, n_nodes, velocity, run_force, power)
        !! Power of all loads on the given velocity; arguments as in load_forces.
        type(load_arrays), intent(in) :: loads
        integer, intent(in) :: start(:), n_nodes
        real(dp), intent(in) :: velocity(n_batch, 3, n_nodes), run_force(:, :, :)
        real(dp), intent(out) :: power(n_batch)               !! [W]
        integer :: r

        power = 0.0_dp
        do r = 1, size(start) - 1
            power = power + sum(run_force(:, :, r)*velocity(:, :, loads%load_node(start(r))), 2)
        end do
    end subroutine load_power

    subroutine viscous_forces(boundaries, nodes, dt, n_nodes, velocity, force, work_before, &
                              work_after)
        !! Add the force of viscous boundaries at the mean velocity of the step, -Z (v_old + v_new)/2.
        !!
        !! The new velocity is solved for at each node, so a dashpot costs no time step. No node has
        !! two, and their work is added block by block, so that no sum depends on the threads.
        !! Source: Lysmer & Kuhlemeyer (1969); theory.md (4.1), (4.2).
        type(boundary_arrays), intent(in) :: boundaries
        type(node_arrays), intent(in) :: nodes
        real(dp), intent(in) :: dt                                 !! [s]
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: velocity(n_batch, 3, n_nodes)      !! [m/s]
        real(dp), intent(inout) :: force(n_batch, 3, n_nodes)      !! [N]
        real(dp), intent(out) :: work_before(n_batch), work_after(n_batch)
            !! half a step's energy taken out, on the old and on the new velocity [J]
        real(dp) :: work(n_batch, 2, (size(boundaries%dashpot_node) + block_size - 1)/block_size)
        integer :: b

        !$omp parallel do schedule(static) default(none) &
        !$omp& shared(boundaries, nodes, dt, n_nodes, velocity, force, work) &
        !$omp& if (n_batch*n_nodes >= least_shared)
        do b = 1, size(work, 3)
            call resist_block((b - 1)*block_size + 1, &
                              min(b*block_size, size(boundaries%dashpot_node)), boundaries, nodes, &
                              dt, n_nodes, velocity, force, work(:, :, b))
        end do
        !$omp end parallel do
        work_before = sum(work(:, 1, :), 2)
        work_after = sum(work(:, 2, :), 2)
    end subroutine viscous_forces

    pure subroutine resist_block(first, last, boundaries, nodes, dt, n_nodes, velocity, force, work)
        !! Add the forces of dashpots first to last; arguments as in viscous_forces.
        integer, intent(in) :: first, last, n_nodes
        type(boundary_arrays), intent(in) :: boundaries
        type(node_arrays), intent(in) :: nodes
        real(dp), intent(in) :: dt, velocity(n_batch, 3, n_nodes)
        real(dp), intent(inout) :: force(n_batch, 3, n_nodes)
        real(dp), intent(out) :: work(n_batch, 2)                  !! before and after [J]
        real(dp) :: impedance(3, 3), resistance(3), old(3), new(3)
        integer :: d, n, m

        work = 0.0_dp
        do d = first, last
            n = boundaries%dashpot_node(d)
            impedance = boundaries%dashpot_impedance(:, :, d)
            do m = 1, n_batch
                old = velocity(m, :, n)
                call resist(dt, nodes%node_mass(m, n), nodes%node_alpha(m, n), &
                            impedance, boundaries%dashpot_inverse(:, :, m, d), old, &
                            force(m, :, n), new, resistance)
                work(m, 1) = work(m, 1) + 0.5_dp*dt*dot_product(resistance, old)
                work(m, 2) = work(m, 2) + 0.5_dp*dt*dot_product(resistance, new)
                force(m, :, n) = force(m, :, n) - resistance
            end do
        end do
    end subroutine resist_block

    pure subroutine resist(dt, mass, alpha, impedance, inverse, old, force, new, resistance)
        !! New velocity of a node at a dashpot, and the force that the dashpot takes.
        real(dp), intent(in) :: dt, mass, alpha, impedance(3, 3), inverse(3, 3), old(3), force(3)
        real(dp), intent(out) :: new(3), resistance(3)
        real(dp) :: drive(3)

        drive = mass*(1.0_dp - 0.5_dp*dt*alpha)*old - 0.5_dp*dt*matmul(impedance, old) + dt*force
        new = matmul(inverse, drive)
        resistance = 0.5_dp*matmul(impedance, old + new)
    end subroutine resist

    pure subroutine reaction_forces(boundaries, nodes, dt, amplitude, n_nodes, velocity, force, &
                                    work_before, work_after)
        !! Add the reactions that give nodes a prescribed velocity along directions, or rest.
        !! Directions of one node are orthonormal; theory.md (4.4).
        type(boundary_arrays), intent(in) :: boundaries
        type(node_arrays), intent(in) :: nodes
        real(dp), intent(in) :: dt                                 !! [s]
        real(dp), intent(in) :: amplitude(:)                       !! velocity at the step's end [m/s]
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: velocity(n_batch, 3, n_nodes)      !! [m/s]
        real(dp), intent(inout) :: force(n_batch, 3, n_nodes)      !! [N]
        real(dp), intent(out) :: work_before(n_batch), work_after(n_batch)
            !! energy put in, two halves [J]
        real(dp) :: new, old, damping, reaction, direction(3)
        integer :: f, n, m

        work_before = 0.0_dp
        work_after = 0.0_dp
        do f = 1, size(boundaries%fixed_node)
            n = boundaries%fixed_node(f)
            direction = boundaries%fixed_direction(:, f)
            do m = 1, n_batch
                new = 0.0_dp
                if (boundaries%fixed_history(m, f) > 0) new = amplitude(boundaries%fixed_history(m, f))
                old = dot_product(velocity(m, :, n), direction)
                damping = 0.5_dp*dt*nodes%node_alpha(m, n)
                reaction = nodes%node_mass(m, n) &
                    *((1.0_dp + damping)*new - (1.0_dp - damping)*old)/dt &
                    - dot_product(force(m, :, n), direction)
                force(m, :, n) = force(m, :, n) + reaction*direction
                work_before(m) = work_before(m) + 0.5_dp*dt*reaction*old
                work_after(m) = work_after(m) + 0.5_dp*dt*reaction*new
            end do
        end do
    end subroutine reaction_forces

end module pyblast_boundaries
