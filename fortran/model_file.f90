module pyblast_model_file
    !! Arrays in and out of HDF5 files; the first failure is kept in `message` and ends all reading.
    use hdf5
    use pyblast_kinds, only : dp
    implicit none
    private
    public :: close_file, create_file, create_group, open_file, read_array, write_array

    interface read_array
        module procedure read_real_0, read_real_1, read_real_2, read_real_3
        module procedure read_integer_0, read_integer_1, read_integer_2
    end interface read_array

    interface write_array
        module procedure write_real_1, write_real_2, write_real_3, write_integer_0
    end interface write_array

contains

    subroutine open_file(path, file, message)
        !! Open a file for reading.
        character(len=*), intent(in) :: path
        integer(hid_t), intent(out) :: file
        character(len=:), allocatable, intent(inout) :: message
        integer :: status

        call h5open_f(status)
        call h5eset_auto_f(0, status)
        call h5fopen_f(path, H5F_ACC_RDONLY_F, file, status)
        if (status /= 0) message = "not an HDF5 file that can be opened"
    end subroutine open_file

    subroutine create_file(path, file, message)
        !! Create a file for writing.
        character(len=*), intent(in) :: path
        integer(hid_t), intent(out) :: file
        character(len=:), allocatable, intent(inout) :: message
        integer :: status

        call h5fcreate_f(path, H5F_ACC_TRUNC_F, file, status)
        if (status /= 0) message = path // ": can't be written"
    end subroutine create_file

    subroutine close_file(file, message)
        !! Flush and close a file.
        integer(hid_t), intent(in) :: file
        character(len=:), allocatable, intent(inout) :: message
        integer :: status

        call h5fclose_f(file, status)
        if (status /= 0 .and. .not. allocated(message)) message = "the result can't be written whole"
    end subroutine close_file

    subroutine create_group(file, name)
        !! Create a group of arrays.
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer(hid_t) :: group
        integer :: status

        call h5gcreate_f(file, name, group, status)
        call h5gclose_f(group, status)
    end subroutine create_group

    subroutine open_array(file, name, rank, whole, array, n, message)
        !! Open an array of the wanted rank and kind of number; its lengths in Fortran's order.
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, intent(in) :: rank
        logical, intent(in) :: whole                   !! whole numbers wanted, else reals
        integer(hid_t), intent(out) :: array
        integer(hsize_t), intent(out) :: n(3)
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: space, kind
        integer(hsize_t) :: largest(3)
        integer :: status, found, class

        n = 1
        array = -1
        if (allocated(message)) return
        call h5dopen_f(file, name, array, status)
        if (status /= 0) then
            message = "'" // name // "' is missing"
            return
        end if
        call h5dget_space_f(array, space, status)
        call h5sget_simple_extent_ndims_f(space, found, status)
        call h5dget_type_f(array, kind, status)
        call h5tget_class_f(kind, class, status)
        if (found /= rank .or. (whole .neqv. class == H5T_INTEGER_F)) then
            message = "'" // name // "' has the wrong shape or kind of number"
            return
        end if
        if (rank > 0) call h5sget_simple_extent_dims_f(space, n(1:rank), largest(1:rank), status)
    end subroutine open_array

    subroutine finish(array, name, status, message)
        !! Close an array and note a failure of its reading or writing.
        integer(hid_t), intent(in) :: array
        character(len=*), intent(in) :: name
        integer, intent(in) :: status
        character(len=:), allocatable, intent(inout) :: message
        integer :: closed

        if (status /= 0 .and. .not. allocated(message)) message = "'" // name // "' is cut short"
        call h5dclose_f(array, closed)
    end subroutine finish

    subroutine read_real_0(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), intent(out) :: value
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer(hsize_t) :: n(3)
        integer :: status

        value = 0.0_dp
        call open_array(file, name, 0, .false., array, n, message)
        if (allocated(message)) return
        call h5dread_f(array, H5T_NATIVE_DOUBLE, value, n(1:1), status)
        call finish(array, name, status, message)
    end subroutine read_real_0

    subroutine read_real_1(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), allocatable, intent(out) :: value(:)
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer(hsize_t) :: n(3)
        integer :: status

        call open_array(file, name, 1, .false., array, n, message)
        allocate (value(n(1)))
        if (allocated(message)) return
        call h5dread_f(array, H5T_NATIVE_DOUBLE, value, n(1:1), status)
        call finish(array, name, status, message)
    end subroutine read_real_1

    subroutine read_real_2(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), allocatable, intent(out) :: value(:, :)
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer(hsize_t) :: n(3)
        integer :: status

        call open_array(file, name, 2, .false., array, n, message)
        allocate (value(n(1), n(2)))
        if (allocated(message)) return
        call h5dread_f(array, H5T_NATIVE_DOUBLE, value, n(1:2), status)
        call finish(array, name, status, message)
    end subroutine read_real_2

    subroutine read_real_3(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), allocatable, intent(out) :: value(:, :, :)
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer(hsize_t) :: n(3)
        integer :: status

        call open_array(file, name, 3, .false., array, n, message)
        allocate (value(n(1), n(2), n(3)))
        if (allocated(message)) return
        call h5dread_f(array, H5T_NATIVE_DOUBLE, value, n, status)
        call finish(array, name, status, message)
    end subroutine read_real_3

    subroutine read_integer_0(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, intent(out) :: value
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer(hsize_t) :: n(3)
        integer :: status

        value = 0
        call open_array(file, name, 0, .true., array, n, message)
        if (allocated(message)) return
        call h5dread_f(array, H5T_NATIVE_INTEGER, value, n(1:1), status)
        call finish(array, name, status, message)
    end subroutine read_integer_0

    subroutine read_integer_1(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, allocatable, intent(out) :: value(:)
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer(hsize_t) :: n(3)
        integer :: status

        call open_array(file, name, 1, .true., array, n, message)
        allocate (value(n(1)))
        if (allocated(message)) return
        call h5dread_f(array, H5T_NATIVE_INTEGER, value, n(1:1), status)
        call finish(array, name, status, message)
    end subroutine read_integer_1

    subroutine read_integer_2(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, allocatable, intent(out) :: value(:, :)
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer(hsize_t) :: n(3)
        integer :: status

        call open_array(file, name, 2, .true., array, n, message)
        allocate (value(n(1), n(2)))
        if (allocated(message)) return
        call h5dread_f(array, H5T_NATIVE_INTEGER, value, n(1:2), status)
        call finish(array, name, status, message)
    end subroutine read_integer_2

    subroutine write_real_1(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), intent(in) :: value(:)
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer :: status

        call new_array(file, name, shape(value), H5T_NATIVE_DOUBLE, array)
        call h5dwrite_f(array, H5T_NATIVE_DOUBLE, value, int(shape(value), hsize_t), status)
        call finish(array, name, status, message)
    end subroutine write_real_1

    subroutine write_real_2(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), intent(in) :: value(:, :)
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer :: status

        call new_array(file, name, shape(value), H5T_NATIVE_DOUBLE, array)
        call h5dwrite_f(array, H5T_NATIVE_DOUBLE, value, int(shape(value), hsize_t), status)
        call finish(array, name, status, message)
    end subroutine write_real_2

    subroutine write_real_3(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), intent(in) :: value(:, :, :)
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer :: status

        call new_array(file, name, shape(value), H5T_NATIVE_DOUBLE, array)
        call h5dwrite_f(array, H5T_NATIVE_DOUBLE, value, int(shape(value), hsize_t), status)
        call finish(array, name, status, message)
    end subroutine write_real_3

    subroutine write_integer_0(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, intent(in) :: value
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer :: status

        call new_array(file, name, [integer ::], H5T_NATIVE_INTEGER, array)
        call h5dwrite_f(array, H5T_NATIVE_INTEGER, value, [1_hsize_t], status)
        call finish(array, name, status, message)
    end subroutine write_integer_0

    subroutine new_array(file, name, n, kind, array)
        !! Create an array of the given lengths.
        integer(hid_t), intent(in) :: file, kind
        character(len=*), intent(in) :: name
        integer, intent(in) :: n(:)
        integer(hid_t), intent(out) :: array
        integer(hid_t) :: space
        integer :: status

        if (size(n) == 0) then
            call h5screate_f(H5S_SCALAR_F, space, status)
        else
            call h5screate_simple_f(size(n), int(n, hsize_t), space, status)
        end if
        call h5dcreate_f(file, name, kind, space, array, status)
        call h5sclose_f(space, status)
    end subroutine new_array

end module pyblast_model_file
