module pyblast_hdf5_arrays
    !! Arrays in and out of HDF5 files; the first failure is kept in `message` and ends all reading.
    !!
    !! Files hold one model: their arrays lack the axis of the batch. Files are opened so that they
    !! can't be closed while anything in them is still open.
    use, intrinsic :: iso_c_binding, only : c_loc, c_ptr
    use hdf5
    use pyblast_kinds, only : dp
    implicit none
    private
    public :: close_file, create_file, create_group, has_array, open_file
    public :: check_range, read_integers, read_reals, write_integer, write_reals

    integer, parameter, public :: finite = 0, not_negative = 1, positive = 2, not_negative_or_infinite = 3
        !! ranges of real numbers

    integer, parameter :: most_axes = 5, axis_of_batch = 1
    integer(hsize_t), parameter :: piece = 2**17          !! numbers that share a checksum

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
        !! Create a file for writing, whose tables have checksums, too.
        character(len=*), intent(in) :: path
        integer(hid_t), intent(out) :: file
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: access
        integer :: status, closed

        call strict_access(access)
        call h5pset_libver_bounds_f(access, H5F_LIBVER_V18_F, H5F_LIBVER_V110_F, status)
        call h5fcreate_f(path, H5F_ACC_TRUNC_F, file, status, access_prp=access)
        call h5pclose_f(access, closed)
        if (status /= 0) message = "can't be written"
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

        call h5fflush_f(file, H5F_SCOPE_LOCAL_F, status)
        if (status == 0) call h5fclose_f(file, status)
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

    subroutine open_array(file, name, kind, axes, extra, sizes, array, n, message)
        !! Open an array that has the wanted kind of number and axes, and count its numbers.
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, intent(in) :: kind                        !! class of HDF5
        integer, intent(in) :: axes(:), extra(:)           !! as of read_reals
        integer, intent(inout) :: sizes(0:)
        integer(hid_t), intent(out) :: array
        integer(hsize_t), intent(out) :: n
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: space, own_kind
        integer(hsize_t) :: lengths(most_axes), largest(most_axes), stored, width
        integer :: status, rank, class

        n = 0
        call h5dopen_f(file, name, array, status)
        if (status /= 0) then
            message = "'" // name // "' is missing"
            return
        end if
        call h5dget_space_f(array, space, status)
        call h5sget_simple_extent_ndims_f(space, rank, status)
        call h5dget_type_f(array, own_kind, status)
        call h5tget_class_f(own_kind, class, status)
        call h5tget_size_f(own_kind, width, status)
        call h5tclose_f(own_kind, status)
        lengths = 1
        if (rank /= count(axes /= axis_of_batch) .or. class /= kind) then
            message = "'" // name // "' has the wrong shape or kind of number"
        else
            if (rank > 0) call h5sget_simple_extent_dims_f(space, lengths(:rank), largest(:rank), status)
            call match(name, pack(axes, axes /= axis_of_batch), pack(extra, axes /= axis_of_batch), &
                       lengths(:rank), sizes, message)
            call h5dget_storage_size_f(array, stored, status)
            if (.not. allocated(message) .and. product(real(lengths, dp))*width > stored) &
                message = "'" // name // "' is not stored whole and uncompressed"
            n = product(lengths)
        end if
        call h5sclose_f(space, status)
        if (allocated(message)) call h5dclose_f(array, status)
    end subroutine open_array

    subroutine match(name, axes, extra, lengths, sizes, message)
        !! Compare lengths with the sizes that are known, and learn the others.
        character(len=*), intent(in) :: name
        integer, intent(in) :: axes(:), extra(:)
        integer(hsize_t), intent(in) :: lengths(:)
        integer, intent(inout) :: sizes(0:)
        character(len=:), allocatable, intent(inout) :: message
        character(len=60) :: text
        integer :: i, known

        do i = 1, size(axes)
            if (sizes(axes(i)) < 0 .and. lengths(i) >= extra(i) .and. lengths(i) < huge(1)) &
                sizes(axes(i)) = int(lengths(i)) - extra(i)
            known = max(sizes(axes(i)), 0)                       ! 0: too short to tell
            if (lengths(i) == known + extra(i) .or. allocated(message)) cycle
            write (text, '(a, i0, a, i0)') "' has ", lengths(i), " numbers along an axis of ", known + extra(i)
            message = "'" // name // trim(text)
        end do
    end subroutine match

    subroutine read_reals(file, name, axes, extra, range, sizes, values, message)
        !! Read an array of real numbers and check their range.
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, intent(in) :: axes(:)                     !! number of the size of each axis; 0: none
        integer, intent(in) :: extra(:)                    !! that each axis has beside its size
        integer, intent(in) :: range
        integer, intent(inout) :: sizes(0:)                !! -1: not yet known
        real(dp), contiguous, pointer, intent(out) :: values(:)
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer(hsize_t) :: n
        integer :: status

        call open_array(file, name, H5T_FLOAT_F, axes, extra, sizes, array, n, message)
        if (allocated(message)) return
        allocate (values(n), stat=status)
        call fill(array, name, status, H5T_NATIVE_DOUBLE, c_loc(values), message)
        if (allocated(message)) return
        select case (range)
        case (finite)
            if (.not. all(abs(values) <= huge(1.0_dp))) message = "finite"
        case (not_negative)
            if (.not. all(values >= 0.0_dp .and. values <= huge(1.0_dp))) message = "finite and not negative"
        case (positive)
            if (.not. all(values > 0.0_dp .and. values <= huge(1.0_dp))) message = "finite and positive"
        case (not_negative_or_infinite)
            if (.not. all(values >= 0.0_dp)) message = "not negative"
        end select
        if (allocated(message)) message = "'" // name // "' must be " // message
    end subroutine read_reals

    subroutine read_integers(file, name, axes, extra, sizes, values, message)
        !! Read an array of integers; as read_reals.
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, intent(in) :: axes(:), extra(:)
        integer, intent(inout) :: sizes(0:)
        integer, contiguous, pointer, intent(out) :: values(:)
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array
        integer(hsize_t) :: n
        integer :: status

        call open_array(file, name, H5T_INTEGER_F, axes, extra, sizes, array, n, message)
        if (allocated(message)) return
        allocate (values(n), stat=status)
        call fill(array, name, status, H5T_NATIVE_INTEGER, c_loc(values), message)
    end subroutine read_integers

    subroutine fill(array, name, allocation, kind, address, message)
        !! Read an open array to its place, if that could be allocated, and close it.
        integer(hid_t), intent(in) :: array, kind
        character(len=*), intent(in) :: name
        integer, intent(in) :: allocation                  !! status of the allocation
        type(c_ptr), value :: address
        character(len=:), allocatable, intent(inout) :: message
        integer :: status, closed

        if (allocation /= 0) then
            message = "'" // name // "' does not fit into memory"
        else
            call h5dread_f(array, kind, address, status)
            if (status /= 0) message = "'" // name // "' is damaged: it can't be read, or its checksum differs"
        end if
        call h5dclose_f(array, closed)
    end subroutine fill

    subroutine check_range(name, n, values, low, high, ascends, message)
        !! Refuse integers out of their range, or that do not ascend.
        character(len=*), intent(in) :: name
        integer, intent(in) :: n, values(n), low, high
        logical, intent(in) :: ascends
        character(len=:), allocatable, intent(inout) :: message
        character(len=60) :: text

        if (allocated(message)) return
        write (text, '(a, i0, a, i0)') "' must lie between ", low, " and ", high
        if (any(values < low .or. values > high)) then
            message = "'" // name // trim(text)
        else if (ascends) then
            if (any(values(2:) < values(:n - 1))) message = "'" // name // "' must ascend"
        end if
    end subroutine check_range

    subroutine put(file, name, kind, n, address, message)
        !! Create an array of the given lengths, with checksums, and write it.
        integer(hid_t), intent(in) :: file, kind
        character(len=*), intent(in) :: name
        integer, intent(in) :: n(:)
        type(c_ptr), value :: address
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: array, space, layout
        integer(hsize_t) :: lengths(size(n)), chunk(size(n))
        integer :: status, closed

        if (allocated(message)) return
        lengths = n
        call h5pcreate_f(H5P_DATASET_CREATE_F, layout, status)
        if (size(n) == 0) then
            call h5screate_f(H5S_SCALAR_F, space, status)
            call h5pset_layout_f(layout, H5D_COMPACT_F, status)
        else
            call h5screate_simple_f(size(n), lengths, space, status)
            chunk = lengths
            if (all(n > 0)) then
                chunk(size(n)) = min(lengths(size(n)), max(1_hsize_t, piece/product(lengths(:size(n) - 1))))
                call h5pset_chunk_f(layout, size(n), chunk, status)
                call h5pset_fletcher32_f(layout, status)
            end if
        end if
        call h5dcreate_f(file, name, kind, space, array, status, dcpl_id=layout)
        if (status == 0) then
            call h5dwrite_f(array, kind, address, status)
            call h5dclose_f(array, closed)
            status = merge(status, closed, status /= 0)
        end if
        if (status /= 0) message = "can't be written whole"
        call h5pclose_f(layout, closed)
        call h5sclose_f(space, closed)
    end subroutine put

    subroutine write_reals(file, name, n, batch, values, message)
        !! Write an array of real numbers without the axis of the batch; 0: it has none.
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, intent(in) :: n(:), batch
        real(dp), intent(in), target :: values(product(int(n, hsize_t)))
        character(len=:), allocatable, intent(inout) :: message
        integer :: i

        call put(file, name, H5T_NATIVE_DOUBLE, pack(n, [(i /= batch, i=1, size(n))]), c_loc(values), &
                 message)
    end subroutine write_reals

    subroutine write_integer(file, name, value, message)
        !! Write a number.
        integer(hid_t), intent(in) :: file
        character(len=*), intent(in) :: name
        integer, intent(in), target :: value
        character(len=:), allocatable, intent(inout) :: message

        call put(file, name, H5T_NATIVE_INTEGER, [integer ::], c_loc(value), message)
    end subroutine write_integer

end module pyblast_hdf5_arrays
