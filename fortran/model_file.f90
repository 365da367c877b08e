module pyblast_model_file
    !! Model files of the program pyblast-run, and its results.
    use hdf5, only : hid_t
    use pyblast_hdf5_arrays, only : close_file, create_file, create_group, open_file, write_integer
    use pyblast_model_arrays, only : read_arrays, write_records
    use pyblast_model_types, only : model_arrays, model_state, run_arrays
    implicit none
    private
    public :: read_model, write_result

contains

    subroutine read_model(path, model, state, run, sizes, message)
        !! Read every array of a model file; the first failure is stated in `message`.
        character(len=*), intent(in) :: path
        type(model_arrays), intent(out) :: model
        type(model_state), intent(out) :: state
        type(run_arrays), intent(out) :: run
        integer, intent(inout) :: sizes(0:)
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: file

        call open_file(path, file, message)
        if (allocated(message)) return
        call read_arrays(file, model, state, run, sizes, message)
        call close_file(file, "arrays of the model are still open", message)
    end subroutine read_model

    subroutine write_result(path, state, run, message)
        !! Write records, energies and state.
        character(len=*), intent(in) :: path
        type(model_state), intent(in) :: state
        type(run_arrays), intent(in) :: run
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: file

        call create_file(path, file, message)
        if (allocated(message)) return
        call create_group(file, "run")
        call create_group(file, "records")
        call create_group(file, "state")
        call write_integer(file, "run/schema", run%schema, message)
        call write_integer(file, "run/fingerprint", run%fingerprint, message)
        call write_records(file, state, run, message)
        if (.not. allocated(message)) call close_file(file, "can't be written whole", message)
    end subroutine write_result

end module pyblast_model_file
