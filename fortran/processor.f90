module pyblast_processor
    !! What the processor can do.
    use, intrinsic :: iso_c_binding, only : c_int
    implicit none
    private
    public :: has_wide_vectors

    interface
        pure function wide_vectors() bind(c, name='pyblast_wide_vectors') result(yes)
            import :: c_int
            integer(c_int) :: yes
        end function wide_vectors
    end interface

contains

    pure function has_wide_vectors() result(yes)
        !! Whether the processor has the vectors of x86-64-v3, for which kernels are compiled twice.
        logical :: yes

        yes = wide_vectors() /= 0
    end function has_wide_vectors

end module pyblast_processor
