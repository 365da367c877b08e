program pyblast_run
    !! pyblast-run MODEL RESULT: the run of a model file, with the bits of the Python run.
    use, intrinsic :: iso_c_binding, only : c_char, c_int, c_null_char
    use, intrinsic :: iso_fortran_env, only : error_unit, output_unit
    use pyblast_kinds, only : n_energies
    use pyblast_model_checks, only : check_model
    use pyblast_model_file, only : read_model, run_arrays, write_result
    use pyblast_model_types, only : model_arrays, model_state
    use pyblast_solver, only : integrate
    implicit none

    interface
        integer(c_int) function c_rename(old, new) bind(c, name="rename")
            import :: c_char, c_int
            character(kind=c_char), intent(in) :: old(*), new(*)
        end function c_rename
    end interface

    type(model_arrays) :: model
    type(model_state) :: state
    type(run_arrays) :: run
    character(len=:), allocatable :: model_path, result_path, message

    call read_arguments()
    call read_model(model_path, model, state, run, message)
    if (.not. allocated(message)) call check_model(model, state, run, message)
    if (.not. allocated(message)) call allocate_records()
    if (allocated(message)) call fail(model_path // ": " // message)
    call take_all_steps()
    if (allocated(message)) then
        write (error_unit, '(a)') "pyblast-run: " // message
        stop 1, quiet=.true.
    end if
    if (associated(run%receiver_motion)) &
        run%motion(1, :, :, :) = run%motion(1, :, :, :) + run%receiver_motion
    call write_result(result_path // ".part", state, run, message)
    if (.not. allocated(message)) call put_in_place()
    if (allocated(message)) call fail(message)

contains

    subroutine read_arguments()
        !! Take the two paths from the command line.
        integer :: length
        character(len=6) :: option

        if (command_argument_count() == 1) then
            call get_command_argument(1, option)
            if (option == "--help") call show_help()
        end if
        if (command_argument_count() /= 2) call fail("usage: pyblast-run MODEL RESULT; see --help")
        call get_command_argument(1, length=length)
        allocate (character(len=length) :: model_path)
        call get_command_argument(1, model_path)
        call get_command_argument(2, length=length)
        allocate (character(len=length) :: result_path)
        call get_command_argument(2, result_path)
    end subroutine read_arguments

    subroutine show_help()
        !! Say what the program does, and end.
        write (output_unit, '(a)') &
            "usage: pyblast-run MODEL RESULT", "", &
            "Integrates the model in the file MODEL in time and writes records, energies and the", &
            "final state to RESULT, bit by bit those of the run from Python. Neither file is text:", &
            "both are HDF5.", "", &
            "  pyblast run project.toml --write-model model.h5        writes MODEL", &
            "  pyblast-run model.h5 records.h5", &
            "  pyblast report records.h5 --project project.toml       compares, draws, writes tables", "", &
            "OMP_NUM_THREADS sets the number of threads; it changes no bit of the result.", &
            "Exit codes: 0 done, 1 the motion grew beyond all bounds, 2 wrong input."
        stop 0, quiet=.true.
    end subroutine show_help

    subroutine allocate_records()
        !! Allocate what the run records.
        integer :: lines, status

        lines = ledger_lines(run%n_steps)
        allocate (run%motion(1, 3, size(model%receivers%receiver_node, 2), run%n_steps), &
                  run%energy(n_energies, 1, lines), stat=status)
        if (status /= 0) message = "the records of the run do not fit into memory"
    end subroutine allocate_records

    subroutine take_all_steps()
        !! Take all steps, with a line of progress after every tenth of the way.
        integer :: done, chunk, lines, next, info, where, member

        done = 0
        do while (done < run%n_steps)
            chunk = min(max(1, run%n_steps/10), run%n_steps - done)
            lines = ledger_lines(done)
            next = ledger_lines(done + chunk)
            call integrate(model, state, done, run%ledger_every, &
                           run%motion(:, :, :, done + 1:done + chunk), &
                           run%energy(:, :, lines + 1:next), info, where, member)
            if (info < 0) then
                message = "the energy is not finite or exceeds five times what was put in"
                return
            end if
            done = done + chunk
            write (output_unit, '(a, i0, a, i0)') "step ", done, " of ", run%n_steps
            flush (output_unit)
        end do
    end subroutine take_all_steps

    integer function ledger_lines(n_steps) result(lines)
        !! Lines of energies in the first steps of the run.
        integer, intent(in) :: n_steps

        lines = 0
        if (n_steps > 0) lines = (n_steps - 1)/run%ledger_every + 1
    end function ledger_lines

    subroutine put_in_place()
        !! Give the whole result its name.
        if (c_rename(result_path // ".part" // c_null_char, result_path // c_null_char) /= 0) &
            message = result_path // ": can't be put in place"
    end subroutine put_in_place

    subroutine fail(text)
        !! Say one sentence and stop with the exit code of wrong input.
        character(len=*), intent(in) :: text

        write (error_unit, '(a)') "pyblast-run: " // text
        stop 2, quiet=.true.
    end subroutine fail

end program pyblast_run
