module probes
    !! What the machine can do: a stream from memory, and multiply-add from registers.
    use, intrinsic :: iso_c_binding, only : c_double, c_int
    implicit none
    private
    public :: multiply_add, triad

    integer, parameter :: width = 96      !! twelve vectors of eight: hides four cycles of latency

contains

    subroutine triad(n, scale, a, b, c) bind(c)
        !! a = b + scale c: 24 bytes and two operations an entry.
        integer(c_int), value :: n
        real(c_double), value :: scale
        real(c_double), intent(in) :: b(n), c(n)
        real(c_double), intent(inout) :: a(n)
        integer :: i

        !$omp parallel do simd schedule(static)
        do i = 1, n
            a(i) = b(i) + scale*c(i)
        end do
    end subroutine triad

    subroutine multiply_add(n_rounds, n_threads, scale, total) bind(c)
        !! 192 operations a round on each thread, nothing but registers.
        integer(c_int), value :: n_rounds, n_threads
        real(c_double), value :: scale
        real(c_double), intent(inout) :: total(n_threads)
        real(c_double) :: x(width)
        integer :: t, k, i

        !$omp parallel do schedule(static) private(x, k, i)
        do t = 1, n_threads
            x = [(real(i, c_double), i=1, width)]
            do k = 1, n_rounds
                !$omp simd
                do i = 1, width
                    x(i) = x(i)*scale + 1.0e-3_c_double
                end do
            end do
            total(t) = sum(x)
        end do
    end subroutine multiply_add

end module probes
