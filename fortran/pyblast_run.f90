program pyblast_run
    !! pyblast-run MODEL RESULT: the march of a model file, with the bits of the Python run.
    use, intrinsic :: iso_c_binding, only : c_char, c_int, c_null_char
    use, intrinsic :: iso_fortran_env, only : error_unit, output_unit
    use hdf5, only : hid_t
    use pyblast_kinds, only : dp, n_energies, n_joint_laws, n_joint_properties, n_joint_state, n_sums, &
        n_zone_laws, n_zone_properties, n_zone_state
    use pyblast_model_file
    use pyblast_model_checks, only : check_domains, check_edges, check_patches, &
        want, within
    use pyblast_solver, only : advance
    implicit none

    interface
        integer(c_int) function c_rename(old, new) bind(c, name="rename")
            import :: c_char, c_int
            character(kind=c_char), intent(in) :: old(*), new(*)
        end function c_rename
    end interface

    real(dp), allocatable :: edge_spring(:, :), skew_spring(:, :), patch_gradient(:, :), patch_bulk(:)
    real(dp), allocatable :: slot_place(:, :), zone_lambda(:), zone_shear(:), set_beta(:)
    real(dp), allocatable :: set_branch(:, :, :), memory_rate(:), memory(:, :, :), node_mass(:), node_alpha(:), node_load(:, :)
    real(dp), allocatable :: contact_normal(:, :), contact_area(:), contact_initial(:, :)
    real(dp), allocatable :: joint_property(:, :), load_vector(:, :), load_delay(:), history(:, :)
    real(dp), allocatable :: set_property(:, :), row_initial(:, :), row_state(:, :), row_lost(:)
    real(dp), allocatable :: dashpot_impedance(:, :, :), dashpot_inverse(:, :, :)
    real(dp), allocatable :: fixed_direction(:, :), receiver_weight(:, :)
    real(dp), allocatable :: displacement(:, :), velocity(:, :), contact_traction(:, :)
    real(dp), allocatable :: contact_state(:, :), contact_stored(:), contact_dissipated(:), sums(:)
    real(dp), allocatable :: motion(:, :, :), energy(:, :)
    integer, allocatable :: domain_zone_start(:), domain_slot_start(:), slot_node(:)
    integer, allocatable :: domain_set(:), zone_row(:), zone_patch(:), set_law(:)
    integer, allocatable :: zone_slot(:, :), node_start(:), node_part(:), contact_node(:, :)
    integer, allocatable :: contact_joint(:), joint_law(:), load_node(:), load_history(:)
    integer, allocatable :: dashpot_node(:), fixed_node(:), fixed_history(:), receiver_node(:, :)
    integer, allocatable :: load_lane(:), set_form(:), edge_start(:), edge_slot(:), skew_start(:)
    integer, allocatable :: skew_slot(:, :), domain_patch_start(:), patch_start(:), patch_slot(:)
    real(dp) :: dt, local_damping
    integer :: n_steps, ledger_every, schema
    character(len=:), allocatable :: model, result, message

    call arguments()
    call read_model()
    if (.not. allocated(message)) call check_model()
    if (allocated(message)) call fail(model // ": " // message)
    call march()
    if (allocated(message)) then
        write (error_unit, '(a)') "pyblast-run: " // message
        stop 1, quiet=.true.
    end if
    call write_result()
    if (allocated(message)) call fail(message)

contains

    subroutine arguments()
        !! Take the two paths from the command line.
        integer :: length

        if (command_argument_count() /= 2) call fail("usage: pyblast-run MODEL RESULT")
        call get_command_argument(1, length=length)
        allocate (character(len=length) :: model)
        call get_command_argument(1, model)
        call get_command_argument(2, length=length)
        allocate (character(len=length) :: result)
        call get_command_argument(2, result)
    end subroutine arguments

    subroutine read_model()
        !! Read every array of the model file.
        integer(hid_t) :: file

        call open_file(model, file, message)
        if (allocated(message)) return
        call read_array(file, "march/schema", schema, message)
        call read_array(file, "march/n_steps", n_steps, message)
        call read_array(file, "march/ledger_every", ledger_every, message)
        call read_array(file, "arrays/dt", dt, message)
        call read_array(file, "arrays/local_damping", local_damping, message)
        call read_array(file, "arrays/domain_zone_start", domain_zone_start, message)
        call read_array(file, "arrays/domain_slot_start", domain_slot_start, message)
        call read_array(file, "arrays/domain_set", domain_set, message)
        call read_array(file, "arrays/slot_node", slot_node, message)
        call read_array(file, "arrays/slot_place", slot_place, message)
        call read_array(file, "arrays/zone_slot", zone_slot, message)
        call read_array(file, "arrays/zone_lambda", zone_lambda, message)
        call read_array(file, "arrays/zone_shear", zone_shear, message)
        call read_array(file, "arrays/zone_row", zone_row, message)
        call read_array(file, "arrays/zone_patch", zone_patch, message)
        call read_array(file, "arrays/set_form", set_form, message)
        call read_array(file, "arrays/edge_start", edge_start, message)
        call read_array(file, "arrays/edge_slot", edge_slot, message)
        call read_array(file, "arrays/edge_spring", edge_spring, message)
        call read_array(file, "arrays/skew_start", skew_start, message)
        call read_array(file, "arrays/skew_slot", skew_slot, message)
        call read_array(file, "arrays/skew_spring", skew_spring, message)
        call read_array(file, "arrays/domain_patch_start", domain_patch_start, message)
        call read_array(file, "arrays/patch_start", patch_start, message)
        call read_array(file, "arrays/patch_slot", patch_slot, message)
        call read_array(file, "arrays/patch_gradient", patch_gradient, message)
        call read_array(file, "arrays/patch_bulk", patch_bulk, message)
        call read_array(file, "arrays/set_law", set_law, message)
        call read_array(file, "arrays/set_property", set_property, message)
        call read_array(file, "arrays/set_beta", set_beta, message)
        call read_array(file, "arrays/set_branch", set_branch, message)
        call read_array(file, "arrays/row_initial", row_initial, message)
        call read_array(file, "arrays/memory_rate", memory_rate, message)
        call read_array(file, "arrays/node_start", node_start, message)
        call read_array(file, "arrays/node_part", node_part, message)
        call read_array(file, "arrays/node_mass", node_mass, message)
        call read_array(file, "arrays/node_alpha", node_alpha, message)
        call read_array(file, "arrays/node_load", node_load, message)
        call read_array(file, "arrays/contact_node", contact_node, message)
        call read_array(file, "arrays/contact_normal", contact_normal, message)
        call read_array(file, "arrays/contact_area", contact_area, message)
        call read_array(file, "arrays/contact_joint", contact_joint, message)
        call read_array(file, "arrays/contact_initial", contact_initial, message)
        call read_array(file, "arrays/joint_law", joint_law, message)
        call read_array(file, "arrays/joint_property", joint_property, message)
        call read_array(file, "arrays/load_node", load_node, message)
        call read_array(file, "arrays/load_vector", load_vector, message)
        call read_array(file, "arrays/load_history", load_history, message)
        call read_array(file, "arrays/load_delay", load_delay, message)
        call read_array(file, "arrays/load_lane", load_lane, message)
        call read_array(file, "arrays/history", history, message)
        call read_array(file, "arrays/dashpot_node", dashpot_node, message)
        call read_array(file, "arrays/dashpot_impedance", dashpot_impedance, message)
        call read_array(file, "arrays/dashpot_inverse", dashpot_inverse, message)
        call read_array(file, "arrays/fixed_node", fixed_node, message)
        call read_array(file, "arrays/fixed_direction", fixed_direction, message)
        call read_array(file, "arrays/fixed_history", fixed_history, message)
        call read_array(file, "arrays/receiver_node", receiver_node, message)
        call read_array(file, "arrays/receiver_weight", receiver_weight, message)
        call read_array(file, "state/displacement", displacement, message)
        call read_array(file, "state/velocity", velocity, message)
        call read_array(file, "state/memory", memory, message)
        call read_array(file, "state/row_state", row_state, message)
        call read_array(file, "state/row_lost", row_lost, message)
        call read_array(file, "state/contact_traction", contact_traction, message)
        call read_array(file, "state/contact_state", contact_state, message)
        call read_array(file, "state/contact_stored", contact_stored, message)
        call read_array(file, "state/contact_dissipated", contact_dissipated, message)
        call read_array(file, "state/sums", sums, message)
    end subroutine read_model

    subroutine check_model()
        !! Refuse arrays that do not fit together and indices that point nowhere.
        integer :: nodes, zones, slots, contacts

        nodes = size(node_mass)
        zones = size(zone_lambda)
        slots = size(slot_node)
        contacts = size(contact_area)
        if (schema /= 1) message = "the schema is not 1"
        if (n_steps < 1 .or. ledger_every < 1) message = "'march' needs positive numbers"
        if (.not. (dt > 0.0_dp .and. dt < huge(dt))) message = "'arrays/dt' must be positive"
        call want("zones", [size(zone_slot), size(zone_shear), size(zone_row), size(zone_patch)], &
                  [size(receiver_node, 1), 1, 1, 1]*zones, message)
        call want("zone laws", [size(set_property), size(set_beta), size(set_branch), &
                                size(row_state), size(row_initial)], &
                  [[n_zone_properties, 1, 2*size(memory_rate)]*size(set_law), &
                   [n_zone_state, 6]*size(row_lost)], message)
        call want("edges", [size(edge_start), size(edge_spring), size(skew_start), &
                            size(skew_spring), size(set_form)], &
                  [slots + 1, 6*size(edge_slot), size(domain_zone_start), &
                   3*size(skew_slot, 2), size(set_law)], message)
        call want("patches", [size(domain_patch_start), size(patch_start), size(patch_gradient)], &
                  [size(domain_zone_start), size(patch_bulk) + 1, 3*size(patch_slot)], message)
        call want("slots", [size(slot_place), size(domain_set)], &
                  [3*slots, size(domain_zone_start) - 1], message)
        call want("nodes", [size(node_alpha), size(node_load), size(node_start), &
                            size(displacement), size(velocity), size(memory)], &
                  [nodes, 3*nodes, nodes + 1, [3, 3, 3*size(memory_rate)]*nodes], message)
        call want("contacts", [size(contact_node), size(contact_normal), size(contact_joint), &
                               size(contact_initial), size(contact_traction), &
                               size(contact_state), size(contact_stored), &
                               size(contact_dissipated)], &
                  [2, 3, 1, 3, 3, n_joint_state, 1, 1]*contacts, message)
        call want("joints", [size(joint_property)], [n_joint_properties*size(joint_law)], message)
        call want("loads", [size(load_vector), size(load_history), size(load_delay), &
                            size(load_lane)], [3, 1, 1, 1]*size(load_node), message)
        call want("dashpots", [size(dashpot_impedance), size(dashpot_inverse)], &
                  [9, 9]*size(dashpot_node), message)
        call want("fixed", [size(fixed_direction), size(fixed_history)], [3, 1]*size(fixed_node), message)
        call want("receivers", [size(receiver_weight)], [size(receiver_node)], message)
        call want("parts", [size(node_part), size(sums), size(history, 2), &
                            size(domain_slot_start)], &
                  [slots + 2*contacts, n_sums, n_steps, size(domain_zone_start)], message)
        call within("slot_node", slot_node, 1, nodes, message)
        call within("zone_slot", reshape(zone_slot, [size(zone_slot)]), 1, slots, message)
        call within("node_part", node_part, 1, slots + 2*contacts, message)
        call within("node_start", node_start, 1, size(node_part) + 1, message)
        call within("domain_zone_start", domain_zone_start, 1, zones + 1, message)
        call within("domain_slot_start", domain_slot_start, 1, slots + 1, message)
        call within("contact_node", reshape(contact_node, [size(contact_node)]), 1, nodes, message)
        call within("contact_joint", contact_joint, 1, size(joint_law), message)
        call within("joint_law", joint_law, 1, n_joint_laws, message)
        call within("domain_set", domain_set, 1, size(set_law), message)
        call within("zone_row", zone_row, 0, size(row_lost), message)
        call within("zone_patch", zone_patch, 0, zones, message)
        call within("set_form", set_form, 1, 3, message)
        call within("set_law", set_law, 1, n_zone_laws, message)
        if (minval(load_delay) < 0.0_dp) message = "'arrays/load_delay' must not be negative"
        call within("load_node", load_node, 1, nodes, message)
        call within("load_lane", load_lane, 0, 1, message)
        call within("load_history", load_history, 1, size(history, 1), message)
        call within("dashpot_node", dashpot_node, 1, nodes, message)
        call within("fixed_node", fixed_node, 1, nodes, message)
        call within("fixed_history", fixed_history, 0, size(history, 1), message)
        call within("receiver_node", reshape(receiver_node, [size(receiver_node)]), 1, nodes, message)
        if (allocated(message)) return
        call check_domains(domain_zone_start, domain_slot_start, zone_slot, zone_patch, node_start, &
                           message)
        call check_edges(domain_slot_start, edge_start, edge_slot, skew_start, skew_slot, message)
        call check_patches(domain_slot_start, domain_patch_start, patch_start, patch_slot, message)
    end subroutine check_model

    subroutine march()
        !! Take all steps, telling every tenth of the way.
        integer :: done, chunk, lines, next, info, where, lane

        lines = (n_steps + ledger_every - 1)/ledger_every
        allocate (motion(3, size(receiver_node, 2), n_steps), energy(n_energies, lines))
        done = 0
        do while (done < n_steps)
            chunk = min(max(1, n_steps/10), n_steps - done)
            lines = (done + ledger_every - 1)/ledger_every
            next = (done + chunk + ledger_every - 1)/ledger_every
            call advance(size(node_mass), size(zone_slot, 2), size(zone_lambda), size(domain_zone_start) - 1, &
                         size(slot_node), size(edge_slot), size(skew_slot, 2), size(set_law), &
                         size(row_lost), size(memory_rate), size(patch_bulk), size(patch_slot), &
                         size(node_part), size(contact_area), &
                         size(joint_law), size(load_node), size(history, 1), &
                         size(dashpot_node), size(fixed_node), size(receiver_node, 2), &
                         n_steps, chunk, next - lines, done, ledger_every, dt, local_damping, &
                         domain_zone_start, domain_slot_start, domain_set, slot_node, &
                         slot_place, zone_slot, zone_lambda, zone_shear, zone_row, zone_patch, &
                         set_form, edge_start, edge_slot, edge_spring, skew_start, skew_slot, &
                         skew_spring, domain_patch_start, patch_start, patch_slot, patch_gradient, patch_bulk, &
                         set_law, set_property, set_beta, set_branch, row_initial, memory_rate, &
                         node_start, node_part, node_mass, node_alpha, node_load, &
                         contact_node, contact_normal, contact_area, contact_joint, &
                         contact_initial, joint_law, joint_property, &
                         load_node, load_vector, load_history, load_delay, load_lane, history, &
                         dashpot_node, dashpot_impedance, dashpot_inverse, &
                         fixed_node, fixed_direction, fixed_history, &
                         receiver_node, receiver_weight, &
                         displacement, velocity, memory, row_state, row_lost, contact_traction, &
                         contact_state, contact_stored, contact_dissipated, sums, &
                         motion(:, :, done + 1:done + chunk), energy(:, lines + 1:next), &
                         info, where, lane)
            if (info < 0) then
                message = "the energy is not finite or exceeds five times what was put in"
                return
            end if
            done = done + chunk
            write (output_unit, '(a, i0, a, i0)') "step ", done, " of ", n_steps
            flush (output_unit)
        end do
    end subroutine march

    subroutine write_result()
        !! Write records, ledger and state beside the result, then rename.
        integer(hid_t) :: file

        call create_file(result // ".part", file, message)
        if (allocated(message)) return
        call create_group(file, "march")
        call create_group(file, "records")
        call create_group(file, "state")
        call write_array(file, "march/schema", schema, message)
        call write_array(file, "records/motion", motion, message)
        call write_array(file, "records/energy", energy, message)
        call write_array(file, "state/displacement", displacement, message)
        call write_array(file, "state/velocity", velocity, message)
        call write_array(file, "state/memory", memory, message)
        call write_array(file, "state/row_state", row_state, message)
        call write_array(file, "state/row_lost", row_lost, message)
        call write_array(file, "state/contact_traction", contact_traction, message)
        call write_array(file, "state/contact_state", contact_state, message)
        call write_array(file, "state/contact_stored", contact_stored, message)
        call write_array(file, "state/contact_dissipated", contact_dissipated, message)
        call write_array(file, "state/sums", sums, message)
        call close_file(file, message)
        if (allocated(message)) return
        if (c_rename(result // ".part" // c_null_char, result // c_null_char) /= 0) &
            message = result // ": can't be put in place"
    end subroutine write_result

    subroutine fail(text)
        !! Say one sentence and stop with the exit code of wrong input.
        character(len=*), intent(in) :: text

        write (error_unit, '(a)') "pyblast-run: " // text
        stop 2, quiet=.true.
    end subroutine fail

end program pyblast_run
