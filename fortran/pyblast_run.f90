program pyblast_run
    !! pyblast-run MODEL RESULT: the run of a model file, with the bits of the Python run.
    use, intrinsic :: iso_c_binding, only : c_char, c_int, c_null_char
    use, intrinsic :: iso_fortran_env, only : error_unit, output_unit
    use omp_lib, only : omp_get_max_threads, omp_get_num_procs, omp_set_num_threads
    use pyblast_kinds, only : n_energies
    use pyblast_model_arrays, only : is_finite, known_sizes
    use pyblast_model_checks, only : check_model
    use pyblast_model_file, only : read_model, write_result
    use pyblast_model_types, only : model_arrays, model_state, run_arrays
    use pyblast_solver, only : integrate
    implicit none

    interface
        subroutine c_end(text, code) bind(c, name="pyblast_end")
            !! Say one sentence and end; no part of a result is left.
            import :: c_char, c_int
            character(kind=c_char), intent(in) :: text(*)
            integer(c_int), value :: code
        end subroutine c_end

        subroutine c_begin_result(model, result) bind(c, name="pyblast_begin_result")
            !! Take the place of the result, and end by signals from now on.
            import :: c_char
            character(kind=c_char), intent(in) :: model(*), result(*)
        end subroutine c_begin_result

        subroutine c_fail_result(result) bind(c, name="pyblast_fail_result")
            !! Say that the result can't be written, and end.
            import :: c_char
            character(kind=c_char), intent(in) :: result(*)
        end subroutine c_fail_result

        subroutine c_put_in_place(result) bind(c, name="pyblast_put_in_place")
            !! Give the whole result its name.
            import :: c_char
            character(kind=c_char), intent(in) :: result(*)
        end subroutine c_put_in_place
    end interface

    integer, parameter :: most_threads = 8   !! for each processor
    type(model_arrays) :: model
    type(model_state) :: state
    type(run_arrays) :: run
    integer, allocatable :: sizes(:)
    character(len=:), allocatable :: model_path, result_path, message

    call read_arguments()
    call limit_threads()
    sizes = known_sizes()
    call read_model(model_path, model, state, run, sizes, message)
    if (.not. allocated(message)) call check_model(model, run, sizes, message)
    if (.not. allocated(message)) call allocate_records()
    if (allocated(message)) call fail(model_path // ": " // message, 2)
    call c_begin_result(model_path // c_null_char, result_path // c_null_char)
    call take_all_steps()
    if (associated(run%receiver_motion)) &
        run%motion(1, :, :, :) = run%motion(1, :, :, :) + run%receiver_motion
    if (.not. is_finite(state, run)) call fail("the motion is not finite", 1)
    call write_result(result_path // ".part", state, run, message)
    if (allocated(message)) call c_fail_result(result_path // c_null_char)
    call c_put_in_place(result_path // c_null_char)

contains

    subroutine read_arguments()
        !! Take the two paths from the command line.
        integer :: length
        character(len=6) :: option

        if (command_argument_count() == 1) then
            call get_command_argument(1, option)
            if (option == "--help") call show_help()
        end if
        if (command_argument_count() /= 2) call fail("usage: pyblast-run MODEL RESULT; see --help", 2)
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
            "Exit codes: 0 done, 1 the motion grew beyond all bounds, 2 wrong input or a result that", &
            "can't be written, 130 interrupted."
        stop 0, quiet=.true.
    end subroutine show_help

    subroutine limit_threads()
        !! Take no more threads than there are processors where far more are asked for.
        character(len=100) :: text

        if (omp_get_max_threads() <= most_threads*omp_get_num_procs()) return
        call omp_set_num_threads(omp_get_num_procs())
        write (text, '(a, i0, a)') "takes ", omp_get_num_procs(), " threads, one for each processor"
        call say(error_unit, "pyblast-run: " // trim(text))
    end subroutine limit_threads

    subroutine allocate_records()
        !! Allocate what the run records.
        integer :: lines, status

        lines = ledger_lines(run%n_steps)
        allocate (run%motion(1, 3, size(model%receivers%receiver_node, 2), run%n_steps), stat=status)
        if (status == 0) allocate (run%energy(n_energies, 1, lines), stat=status)
        if (status /= 0) message = "the records of the run do not fit into memory"
    end subroutine allocate_records

    subroutine take_all_steps()
        !! Take all steps, with a line of progress after every tenth of the way.
        integer :: done, chunk, lines, next, info, where, member
        character(len=100) :: text

        done = 0
        do while (done < run%n_steps)
            chunk = min(max(1, run%n_steps/10), run%n_steps - done)
            lines = ledger_lines(done)
            next = ledger_lines(done + chunk)
            call integrate(model, state, done, run%ledger_every, &
                           run%motion(:, :, :, done + 1:done + chunk), &
                           run%energy(:, :, lines + 1:next), info, where, member)
            if (info < 0) call fail("the energy is not finite or exceeds five times what was put in", 1)
            done = done + chunk
            write (text, '(a, i0, a, i0)') "step ", done, " of ", run%n_steps
            call say(output_unit, trim(text))
        end do
    end subroutine take_all_steps

    integer function ledger_lines(n_steps) result(lines)
        !! Lines of energies in the first steps of the run.
        integer, intent(in) :: n_steps

        lines = 0
        if (n_steps > 0) lines = (n_steps - 1)/run%ledger_every + 1
    end function ledger_lines

    subroutine say(unit, text)
        !! Print a line; one that nobody can read costs no run.
        integer, intent(in) :: unit
        character(len=*), intent(in) :: text
        integer :: status

        write (unit, '(a)', iostat=status) text
        if (status == 0) flush (unit, iostat=status)
        if (status /= 0) return
    end subroutine say

    subroutine fail(text, code)
        !! Say one sentence and end.
        character(len=*), intent(in) :: text
        integer, intent(in) :: code

        call c_end(text // c_null_char, int(code, c_int))
    end subroutine fail

end program pyblast_run
