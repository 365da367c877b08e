module naive
    !! The element loop as anyone would write it first: gather, strain, stress, scatter, move.
    use, intrinsic :: iso_c_binding, only : c_double, c_int
    implicit none
    private
    public :: naive_march

contains

    subroutine naive_march(n_nodes, n_zones, n_steps, dt, zone_node, lambda, shear, place, mass, &
                           alpha, u, v, f) bind(c)
        !! Elastic zones with mass damping, by central differences; one thread.
        integer(c_int), value :: n_nodes, n_zones, n_steps
        real(c_double), value :: dt
        integer(c_int), intent(in) :: zone_node(4, n_zones)
        real(c_double), intent(in) :: lambda(n_zones), shear(n_zones), place(3, n_nodes)
        real(c_double), intent(in) :: mass(n_nodes), alpha(n_nodes)
        real(c_double), intent(inout) :: u(3, n_nodes), v(3, n_nodes), f(3, n_nodes)
        real(c_double) :: area(3, 3), moved(3, 3), edge(3, 3), slope(3, 3), stress(3, 3), pull(3)
        real(c_double) :: six, swell
        integer :: step, z, k, n

        do step = 1, n_steps
            f = 0.0_c_double
            do z = 1, n_zones
                do k = 1, 3
                    edge(:, k) = place(:, zone_node(k + 1, z)) - place(:, zone_node(1, z))
                    moved(:, k) = u(:, zone_node(k + 1, z)) - u(:, zone_node(1, z))
                end do
                area(:, 1) = cross(edge(:, 2), edge(:, 3))
                area(:, 2) = cross(edge(:, 3), edge(:, 1))
                area(:, 3) = cross(edge(:, 1), edge(:, 2))
                six = dot_product(edge(:, 1), area(:, 1))
                slope = matmul(moved, transpose(area))/six
                swell = lambda(z)*(slope(1, 1) + slope(2, 2) + slope(3, 3))
                stress = shear(z)*(slope + transpose(slope))
                do k = 1, 3
                    stress(k, k) = stress(k, k) + swell
                end do
                do k = 1, 3
                    pull = matmul(stress, area(:, k))/6.0_c_double
                    f(:, zone_node(k + 1, z)) = f(:, zone_node(k + 1, z)) - pull
                    f(:, zone_node(1, z)) = f(:, zone_node(1, z)) + pull
                end do
            end do
            do n = 1, n_nodes
                v(:, n) = ((1.0_c_double - 0.5_c_double*dt*alpha(n))*v(:, n) + dt*f(:, n)/mass(n)) &
                    /(1.0_c_double + 0.5_c_double*dt*alpha(n))
                u(:, n) = u(:, n) + dt*v(:, n)
            end do
        end do
    end subroutine naive_march

    pure function cross(a, b) result(c)
        real(c_double), intent(in) :: a(3), b(3)
        real(c_double) :: c(3)

        c = [a(2)*b(3) - a(3)*b(2), a(3)*b(1) - a(1)*b(3), a(1)*b(2) - a(2)*b(1)]
    end function cross

end module naive
