module pyblast_implicit_zones
    !! Implicit zones: the smallest zones by the trapezoidal rule, cluster by cluster of them.
    !!
    !! (D + (dt^2/4) K) a = F - R v with the stiffness K of these zones alone, factored once as L B L^T
    !! in blocks of three. The explicit step with the force D a + R v then gives that motion.
    !! Source: Hughes & Liu (1978); theory.md (2.53), (2.54).
    use pyblast_kinds, only : dp, least_shared
    use pyblast_batch, only : n_batch
    use pyblast_model_types, only : implicit_arrays, implicit_work, n_clusters
    implicit none
    private
    public :: add_implicit_energy, add_layer_to_lines, implicit_forces

contains

    subroutine implicit_forces(zones, n_nodes, velocity, with_energy, force, work)
        !! Replace the force on each node of implicit zones by the one that moves it as they ask.
        type(implicit_arrays), intent(in) :: zones
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: velocity(n_batch, 3, n_nodes)      !! half a step earlier [m/s]
        logical, intent(in) :: with_energy                         !! whether the energy is wanted
        real(dp), intent(inout) :: force(n_batch, 3, n_nodes)      !! [N]
        type(implicit_work), intent(inout) :: work
        integer :: c

        !$omp parallel do schedule(dynamic, 4) default(none) &
        !$omp& shared(zones, n_nodes, velocity, with_energy, force, work) &
        !$omp& if (n_batch*n_nodes >= least_shared)
        do c = 1, n_clusters(zones)
            call move_cluster(zones%cluster_start(c), zones%cluster_start(c + 1) - 1, n_nodes, &
                              size(zones%implicit_node), size(zones%block_row), &
                              zones%implicit_node, zones%column_start, zones%block_row, &
                              zones%block_factor, zones%implicit_inverse, zones%implicit_inertia, &
                              zones%implicit_drag, velocity, force, work%solution)
            if (with_energy) call keep_velocity(zones%cluster_start(c), &
                                                zones%cluster_start(c + 1) - 1, n_nodes, &
                                                zones%implicit_node, velocity, work%solution)
        end do
        !$omp end parallel do
    end subroutine implicit_forces

    pure subroutine move_cluster(first, last, n_nodes, n_implicit, n_blocks, node, column_start, row, &
                                 factor, inverse, inertia, drag, velocity, force, x)
        !! Solve for the acceleration of one cluster. Explicit shapes: through components it takes
        !! longer.
        integer, intent(in) :: first, last, n_nodes, n_implicit, n_blocks
        integer, intent(in) :: node(n_implicit), column_start(n_implicit + 1), row(n_blocks)
        real(dp), intent(in) :: factor(n_batch, 9, n_blocks)
        real(dp), dimension(n_batch, 6, n_implicit), intent(in) :: inverse, inertia, drag
        real(dp), intent(in) :: velocity(n_batch, 3, n_nodes)
        real(dp), intent(inout) :: force(n_batch, 3, n_nodes), x(n_batch, 3, n_implicit)
        real(dp) :: own(n_batch, 3)
        integer :: j, e, n

        do j = first, last
            n = node(j)
            x(:, :, j) = force(:, :, n) - times(drag(:, :, j), velocity(:, :, n))
        end do
        do j = first, last
            own = x(:, :, j)
            do e = column_start(j), column_start(j + 1) - 1
                x(:, 1, row(e)) = x(:, 1, row(e)) - (factor(:, 1, e)*own(:, 1) &
                                                     + factor(:, 4, e)*own(:, 2) + factor(:, 7, e)*own(:, 3))
                x(:, 2, row(e)) = x(:, 2, row(e)) - (factor(:, 2, e)*own(:, 1) &
                                                     + factor(:, 5, e)*own(:, 2) + factor(:, 8, e)*own(:, 3))
                x(:, 3, row(e)) = x(:, 3, row(e)) - (factor(:, 3, e)*own(:, 1) &
                                                     + factor(:, 6, e)*own(:, 2) + factor(:, 9, e)*own(:, 3))
            end do
        end do
        do j = last, first, -1
            n = node(j)
            own = times(inverse(:, :, j), x(:, :, j))
            do e = column_start(j), column_start(j + 1) - 1
                own = own - turned(factor(:, :, e), x(:, :, row(e)))
            end do
            x(:, :, j) = own
            force(:, :, n) = times(inertia(:, :, j), own) + times(drag(:, :, j), velocity(:, :, n))
        end do
    end subroutine move_cluster

    pure subroutine keep_velocity(first, last, n_nodes, node, velocity, old)
        !! Keep the velocity of the nodes of one cluster, whose solution has served.
        integer, intent(in) :: first, last, n_nodes, node(:)
        real(dp), intent(in) :: velocity(n_batch, 3, n_nodes)
        real(dp), intent(inout) :: old(:, :, :)
        integer :: j

        do j = first, last
            old(:, :, j) = velocity(:, :, node(j))
        end do
    end subroutine keep_velocity

    subroutine add_layer_to_lines(zones, n_nodes, node_mass, velocity, layer_force, force, zone_force, &
                                  power, work)
        !! Let the past of the absorbing layer act on the inertia of lines as on that of nodes; (2.58).
        type(implicit_arrays), intent(in) :: zones
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: node_mass(n_batch, n_nodes)        !! with the layer's stretch [kg]
        real(dp), intent(in) :: velocity(n_batch, 3, n_nodes)      !! before the step [m/s]
        real(dp), intent(in) :: layer_force(:, :)                  !! of the layer's nodes [N]
        real(dp), intent(inout) :: force(n_batch, 3, n_nodes)      !! [N]
        real(dp), intent(inout) :: zone_force(n_batch, 3, n_nodes) !! part of it, of zones and layer
        real(dp), intent(inout) :: power                           !! that zones and layer take [W]
        type(implicit_work), intent(inout) :: work
        integer :: c

        !$omp parallel do schedule(dynamic, 4) default(none) &
        !$omp& shared(zones, n_nodes, node_mass, velocity, layer_force, force, zone_force, work) &
        !$omp& if (n_batch*n_nodes >= least_shared)
        do c = 1, n_clusters(zones)
            call add_layer_to_line(zones, zones%cluster_start(c), zones%cluster_start(c + 1) - 1, &
                                   n_nodes, node_mass, velocity, layer_force, force, zone_force, &
                                   work%cluster_energy(:, c), work)
        end do
        !$omp end parallel do
        do c = 1, n_clusters(zones)
            power = power - work%cluster_energy(1, c)
        end do
    end subroutine add_layer_to_lines

    pure subroutine add_layer_to_line(zones, first, last, n_nodes, node_mass, velocity, layer_force, &
                                      force, zone_force, given, work)
        !! Add (L B L^T - D) times what the layer's past does to each mass of one line.
        type(implicit_arrays), intent(in) :: zones
        integer, intent(in) :: first, last, n_nodes
        real(dp), intent(in) :: node_mass(n_batch, n_nodes), velocity(n_batch, 3, n_nodes)
        real(dp), intent(in) :: layer_force(:, :)
        real(dp), intent(inout) :: force(n_batch, 3, n_nodes), zone_force(n_batch, 3, n_nodes)
        real(dp), intent(out) :: given(n_batch)                    !! power of what is added [W]
        type(implicit_work), intent(inout) :: work
        real(dp) :: added(n_batch, 3, first:last), along(n_batch, 3)
        integer :: e, j, k, n

        given = 0.0_dp
        if (all(work%layer_place(first:last) == 0)) return
        do j = first, last
            work%solution(:, :, j) = 0.0_dp
            if (work%layer_place(j) == 0) cycle
            do k = 1, 3
                work%solution(:, k, j) = layer_force(k, work%layer_place(j)) &
                    /node_mass(:, zones%implicit_node(j))
            end do
        end do
        added = 0.0_dp
        do j = first, last
            along = work%solution(:, :, j)
            added(:, :, j) = added(:, :, j) - times(zones%implicit_inertia(:, :, j), along)
            do e = zones%column_start(j), zones%column_start(j + 1) - 1
                along = along + turned(zones%block_factor(:, :, e), &
                                       work%solution(:, :, zones%block_row(e)))
            end do
            along = solved(zones%implicit_inverse(:, :, j), along)
            added(:, :, j) = added(:, :, j) + along
            do e = zones%column_start(j), zones%column_start(j + 1) - 1
                n = zones%block_row(e)
                added(:, :, n) = added(:, :, n) + straight(zones%block_factor(:, :, e), along)
            end do
        end do
        do j = first, last
            n = zones%implicit_node(j)
            force(:, :, n) = force(:, :, n) + added(:, :, j)
            zone_force(:, :, n) = zone_force(:, :, n) + added(:, :, j)
            given = given + sum(added(:, :, j)*velocity(:, :, n), 2)
        end do
    end subroutine add_layer_to_line

    subroutine add_implicit_energy(zones, n_nodes, velocity, work, energy)
        !! Add v_old.((dt^2/4) K) v_new/2, which the kinetic energy of implicit zones holds as well.
        type(implicit_arrays), intent(in) :: zones
        integer, intent(in) :: n_nodes
        real(dp), intent(in) :: velocity(n_batch, 3, n_nodes)      !! after the step [m/s]
        type(implicit_work), intent(inout) :: work                 !! its solution: before the step
        real(dp), intent(inout) :: energy(n_batch)                 !! [J]
        integer :: c

        !$omp parallel do schedule(dynamic, 4) default(none) &
        !$omp& shared(zones, n_nodes, velocity, work) if (n_batch*n_nodes >= least_shared)
        do c = 1, n_clusters(zones)
            work%cluster_energy(:, c) = cluster_energy(zones, zones%cluster_start(c), &
                                                       zones%cluster_start(c + 1) - 1, n_nodes, &
                                                       velocity, work%solution)
        end do
        !$omp end parallel do
        do c = 1, n_clusters(zones)
            energy = energy + work%cluster_energy(:, c)
        end do
    end subroutine add_implicit_energy

    pure function cluster_energy(zones, first, last, n_nodes, velocity, old) result(energy)
        !! v_old.(L B L^T - D) v_new/2 of one cluster.
        type(implicit_arrays), intent(in) :: zones
        integer, intent(in) :: first, last, n_nodes
        real(dp), intent(in) :: velocity(n_batch, 3, n_nodes), old(:, :, :)
        real(dp), dimension(n_batch, 3) :: before, after
        real(dp) :: energy(n_batch)
        integer :: j, e

        energy = 0.0_dp
        do j = first, last
            before = old(:, :, j)
            after = velocity(:, :, zones%implicit_node(j))
            energy = energy - 0.5_dp*sum(before*times(zones%implicit_inertia(:, :, j), after), 2)
            do e = zones%column_start(j), zones%column_start(j + 1) - 1
                before = before + turned(zones%block_factor(:, :, e), old(:, :, zones%block_row(e)))
                after = after + turned(zones%block_factor(:, :, e), &
                                       velocity(:, :, zones%implicit_node(zones%block_row(e))))
            end do
            energy = energy + 0.5_dp*sum(before*solved(zones%implicit_inverse(:, :, j), after), 2)
        end do
    end function cluster_energy

    pure function times(matrix, vector) result(product)
        !! Product of symmetric matrices xx yy zz yz zx xy with vectors.
        real(dp), intent(in) :: matrix(n_batch, 6), vector(n_batch, 3)
        real(dp) :: product(n_batch, 3)

        product(:, 1) = matrix(:, 1)*vector(:, 1) + matrix(:, 6)*vector(:, 2) + matrix(:, 5)*vector(:, 3)
        product(:, 2) = matrix(:, 6)*vector(:, 1) + matrix(:, 2)*vector(:, 2) + matrix(:, 4)*vector(:, 3)
        product(:, 3) = matrix(:, 5)*vector(:, 1) + matrix(:, 4)*vector(:, 2) + matrix(:, 3)*vector(:, 3)
    end function times

    pure function straight(block, vector) result(product)
        !! Product of blocks of nine, column by column, with vectors.
        real(dp), intent(in) :: block(n_batch, 9), vector(n_batch, 3)
        real(dp) :: product(n_batch, 3)
        integer :: k

        do k = 1, 3
            product(:, k) = block(:, k)*vector(:, 1) + block(:, k + 3)*vector(:, 2) &
                + block(:, k + 6)*vector(:, 3)
        end do
    end function straight

    pure function turned(block, vector) result(product)
        !! Product of transposed blocks of nine, column by column, with vectors.
        real(dp), intent(in) :: block(n_batch, 9), vector(n_batch, 3)
        real(dp) :: product(n_batch, 3)
        integer :: k

        do k = 1, 3
            product(:, k) = block(:, 3*k - 2)*vector(:, 1) + block(:, 3*k - 1)*vector(:, 2) &
                + block(:, 3*k)*vector(:, 3)
        end do
    end function turned

    pure function solved(matrix, vector) result(solution)
        !! Vectors by symmetric matrices xx yy zz yz zx xy, by their cofactors.
        real(dp), intent(in) :: matrix(n_batch, 6), vector(n_batch, 3)
        real(dp) :: solution(n_batch, 3), cofactor(n_batch, 6)
        integer :: k

        associate (m => matrix, c => cofactor)
            c(:, 1) = m(:, 2)*m(:, 3) - m(:, 4)**2
            c(:, 2) = m(:, 1)*m(:, 3) - m(:, 5)**2
            c(:, 3) = m(:, 1)*m(:, 2) - m(:, 6)**2
            c(:, 4) = m(:, 5)*m(:, 6) - m(:, 1)*m(:, 4)
            c(:, 5) = m(:, 4)*m(:, 6) - m(:, 2)*m(:, 5)
            c(:, 6) = m(:, 4)*m(:, 5) - m(:, 3)*m(:, 6)
            solution = times(c, vector)
            do k = 1, 3
                solution(:, k) = solution(:, k)/(m(:, 1)*c(:, 1) + m(:, 6)*c(:, 6) + m(:, 5)*c(:, 5))
            end do
        end associate
    end function solved

end module pyblast_implicit_zones
