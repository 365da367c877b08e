module pyblast_hdf5_arrays
    !! Arrays in and out of HDF5 files; the first failure is kept in `message` and ends all reading.
    !!
    !! Files hold one model: their arrays lack the axis of the batch, which is put in at reading and
    !! left out at writing, at the place `batch_axis`. Files are opened so that they can't be closed
    !! while anything in them is still open.
    use, intrinsic :: iso_c_binding, only : c_loc, c_ptr
    use hdf5
    use pyblast_kinds, only : dp
    implicit none
    private
    public :: close_file, create_file, create_group, has_array, open_file, read_array, write_array

    integer, parameter :: most_axes = 5

    interface read_array
        module procedure read_real_0, read_real_1, read_real_2, read_real_3, read_real_4
        module procedure read_integer_0, read_integer_1, read_integer_2, read_integer_3
    end interface read_array

    interface write_array
        module procedure write_real_2, write_real_3, write_real_4, write_integer_0
    end interface write_array

contains

    subroutine open_file(path, file, message)
        !! Open a file for reading.
        character(len=*), intent(in) :: path
        integer(hid_t), intent(out) :: file
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: access
        integer :: status, closed

        call h5open_f(status)
        call h5eset_auto_f(0, status)
        call strict_access(access)
        call h5fopen_f(path, H5F_ACC_RDONLY_F, file, status, access)
        call h5pclose_f(access, closed)
        if (status /= 0) message = "not an HDF5 file that can be opened"
    end subroutine open_file

    subroutine create_file(path, file, message)
        !! Create a file for writing.
        character(len=*), intent(in) :: path
        integer(hid_t), intent(out) :: file
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: access
        integer :: status, closed

        call strict_access(access)
        call h5fcreate_f(path, H5F_ACC_TRUNC_F, file, status, access_prp=access)
        call h5pclose_f(access, closed)
        if (status /= 0) message = path // ": can't be written"
    end subroutine create_file

    subroutine strict_access(access)
        !! The way to open files that refuse to be closed while something in them is open.
        integer(hid_t), intent(out) :: access
        integer :: status

        call h5pcreate_f(H5P_FILE_ACCESS_F, access, status)
        call h5pset_fclose_degree_f(access, H5F_CLOSE_SEMI_F, status)
    end subroutine strict_access

    subroutine close_file(file, text, message)
        !! Flush and close a file; `text` is what to say if that fails.
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: text
        character(len=:), allocatable, intent(inout) :: message
        integer :: status

        call h5fclose_f(file, status)
        if (status /= 0 .and. .not. allocated(message)) message = text
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

    logical function has_array(file, name)
        !! Whether a file that could be opened holds an array.
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer :: status

        call h5lexists_f(file, name, has_array, status)
        has_array = has_array .and. status == 0
    end function has_array

    subroutine get_lengths(file, name, rank, integers, n, message, batch_axis)
        !! Lengths, in Fortran's order, of an array of the wanted rank and kind of number.
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, intent(in) :: rank                    !! with the axis of the batch
        logical, intent(in) :: integers                !! integers wanted, else reals
        integer(hsize_t), intent(out) :: n(most_axes)
        character(len=:), allocatable, intent(inout) :: message
        integer, intent(in), optional :: batch_axis
        integer(hid_t) :: array, space, kind
        integer(hsize_t) :: stored(most_axes), largest(most_axes)
        integer :: status, axes, class, wanted

        n = 0
        if (allocated(message)) return
        call h5dopen_f(file, name, array, status)
        if (status /= 0) then
            message = "'" // name // "' is missing"
            return
        end if
        wanted = rank
        if (present(batch_axis)) wanted = rank - 1
        call h5dget_space_f(array, space, status)
        call h5sget_simple_extent_ndims_f(space, axes, status)
        call h5dget_type_f(array, kind, status)
        call h5tget_class_f(kind, class, status)
        if (axes /= wanted .or. (integers .neqv. class == H5T_INTEGER_F)) then
            message = "'" // name // "' has the wrong shape or kind of number"
        else if (axes > 0) then
            call h5sget_simple_extent_dims_f(space, stored(:axes), largest(:axes), status)
            n(:axes) = stored(:axes)
            if (present(batch_axis)) n(:rank) = [n(:batch_axis - 1), 1_hsize_t, n(batch_axis:axes)]
        end if
        call h5tclose_f(kind, status)
        call h5sclose_f(space, status)
        call h5dclose_f(array, status)
    end subroutine get_lengths

    subroutine fill(file, name, allocation, kind, address, message)
        !! Read an array to its place, if that could be allocated.
        integer(hid_t), intent(in) :: file, kind
        character(len=*), intent(in) :: name
        integer, intent(in) :: allocation              !! status of the allocation
        type(c_ptr), value :: address
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer :: status, closed

        if (allocated(message)) return
        if (allocation /= 0) then
            message = "'" // name // "' does not fit into memory"
            return
        end if
        call h5dopen_f(file, name, array, status)
        call h5dread_f(array, kind, address, status)
        if (status /= 0) message = "'" // name // "' is cut short"
        call h5dclose_f(array, closed)
    end subroutine fill

    subroutine put(file, name, kind, n, address, message, batch_axis)
        !! Create an array of the given lengths and write it.
        integer(hid_t), intent(in) :: file, kind
        character(len=*), intent(in) :: name
        integer, intent(in) :: n(:)
        type(c_ptr), value :: address
        character(len=:), allocatable, intent(inout) :: message
        integer, intent(in) :: batch_axis                  !! 0: the array has none
        integer(hid_t) :: array, space
        integer :: status, closed

        if (allocated(message)) return
        if (size(n) == 0) then
            call h5screate_f(H5S_SCALAR_F, space, status)
        else if (batch_axis == 0) then
            call h5screate_simple_f(size(n), int(n, hsize_t), space, status)
        else
            call h5screate_simple_f(size(n) - 1, int([n(:batch_axis - 1), n(batch_axis + 1:)], &
                                                     hsize_t), space, status)
        end if
        call h5dcreate_f(file, name, kind, space, array, status)
        if (status == 0) then
            call h5dwrite_f(array, kind, address, status)
            call h5dclose_f(array, closed)
        end if
        if (status /= 0) message = "the result can't be written whole"
        call h5sclose_f(space, closed)
    end subroutine put

    subroutine read_real_0(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), intent(out), target :: value
        character(len=:), allocatable, intent(inout) :: message
        integer(hsize_t) :: n(most_axes)

        value = 0.0_dp
        call get_lengths(file, name, 0, .false., n, message)
        call fill(file, name, 0, H5T_NATIVE_DOUBLE, c_loc(value), message)
    end subroutine read_real_0

    subroutine read_real_1(file, name, value, message, batch_axis)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), contiguous, pointer, intent(out) :: value(:)
        character(len=:), allocatable, intent(inout) :: message
        integer, intent(in), optional :: batch_axis
        integer(hsize_t) :: n(most_axes)
        integer :: status

        call get_lengths(file, name, 1, .false., n, message, batch_axis)
        allocate (value(n(1)), stat=status)
        call fill(file, name, status, H5T_NATIVE_DOUBLE, c_loc(value), message)
    end subroutine read_real_1

    subroutine read_real_2(file, name, value, message, batch_axis)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), contiguous, pointer, intent(out) :: value(:, :)
        character(len=:), allocatable, intent(inout) :: message
        integer, intent(in), optional :: batch_axis
        integer(hsize_t) :: n(most_axes)
        integer :: status

        call get_lengths(file, name, 2, .false., n, message, batch_axis)
        allocate (value(n(1), n(2)), stat=status)
        call fill(file, name, status, H5T_NATIVE_DOUBLE, c_loc(value), message)
    end subroutine read_real_2

    subroutine read_real_3(file, name, value, message, batch_axis)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), contiguous, pointer, intent(out) :: value(:, :, :)
        character(len=:), allocatable, intent(inout) :: message
        integer, intent(in), optional :: batch_axis
        integer(hsize_t) :: n(most_axes)
        integer :: status

        call get_lengths(file, name, 3, .false., n, message, batch_axis)
        allocate (value(n(1), n(2), n(3)), stat=status)
        call fill(file, name, status, H5T_NATIVE_DOUBLE, c_loc(value), message)
    end subroutine read_real_3

    subroutine read_real_4(file, name, value, message, batch_axis)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), contiguous, pointer, intent(out) :: value(:, :, :, :)
        character(len=:), allocatable, intent(inout) :: message
        integer, intent(in), optional :: batch_axis
        integer(hsize_t) :: n(most_axes)
        integer :: status

        call get_lengths(file, name, 4, .false., n, message, batch_axis)
        allocate (value(n(1), n(2), n(3), n(4)), stat=status)
        call fill(file, name, status, H5T_NATIVE_DOUBLE, c_loc(value), message)
    end subroutine read_real_4

    subroutine read_integer_0(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, intent(out), target :: value
        character(len=:), allocatable, intent(inout) :: message
        integer(hsize_t) :: n(most_axes)

        value = 0
        call get_lengths(file, name, 0, .true., n, message)
        call fill(file, name, 0, H5T_NATIVE_INTEGER, c_loc(value), message)
    end subroutine read_integer_0

    subroutine read_integer_1(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, contiguous, pointer, intent(out) :: value(:)
        character(len=:), allocatable, intent(inout) :: message
        integer(hsize_t) :: n(most_axes)
        integer :: status

        call get_lengths(file, name, 1, .true., n, message)
        allocate (value(n(1)), stat=status)
        call fill(file, name, status, H5T_NATIVE_INTEGER, c_loc(value), message)
    end subroutine read_integer_1

    subroutine read_integer_2(file, name, value, message, batch_axis)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, contiguous, pointer, intent(out) :: value(:, :)
        character(len=:), allocatable, intent(inout) :: message
        integer, intent(in), optional :: batch_axis
        integer(hsize_t) :: n(most_axes)
        integer :: status

        call get_lengths(file, name, 2, .true., n, message, batch_axis)
        allocate (value(n(1), n(2)), stat=status)
        call fill(file, name, status, H5T_NATIVE_INTEGER, c_loc(value), message)
    end subroutine read_integer_2

    subroutine read_integer_3(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, contiguous, pointer, intent(out) :: value(:, :, :)
        character(len=:), allocatable, intent(inout) :: message
        integer(hsize_t) :: n(most_axes)
        integer :: status

        call get_lengths(file, name, 3, .true., n, message)
        allocate (value(n(1), n(2), n(3)), stat=status)
        call fill(file, name, status, H5T_NATIVE_INTEGER, c_loc(value), message)
    end subroutine read_integer_3

    subroutine write_real_2(file, name, value, batch_axis, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), intent(in), contiguous, target :: value(:, :)
        integer, intent(in) :: batch_axis
        character(len=:), allocatable, intent(inout) :: message

        call put(file, name, H5T_NATIVE_DOUBLE, shape(value), c_loc(value), message, batch_axis)
    end subroutine write_real_2

    subroutine write_real_3(file, name, value, batch_axis, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), intent(in), contiguous, target :: value(:, :, :)
        integer, intent(in) :: batch_axis
        character(len=:), allocatable, intent(inout) :: message

        call put(file, name, H5T_NATIVE_DOUBLE, shape(value), c_loc(value), message, batch_axis)
    end subroutine write_real_3

    subroutine write_real_4(file, name, value, batch_axis, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        real(dp), intent(in), contiguous, target :: value(:, :, :, :)
        integer, intent(in) :: batch_axis
        character(len=:), allocatable, intent(inout) :: message

        call put(file, name, H5T_NATIVE_DOUBLE, shape(value), c_loc(value), message, batch_axis)
    end subroutine write_real_4

    subroutine write_integer_0(file, name, value, message)
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, intent(in), target :: value
        character(len=:), allocatable, intent(inout) :: message

        call put(file, name, H5T_NATIVE_INTEGER, [integer ::], c_loc(value), message, 0)
    end subroutine write_integer_0

end module pyblast_hdf5_arrays
