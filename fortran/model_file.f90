module pyblast_model_file
    !! Model files of the program pyblast-run, and its results.
    use hdf5, only : hid_t
    use pyblast_kinds, only : dp
    use pyblast_hdf5_arrays
    use pyblast_model_types, only : boundary_arrays, contact_arrays, edge_arrays, ground_arrays, hex_arrays, layer_arrays, &
        implicit_arrays, load_arrays, mesh_arrays, model_arrays, model_state, node_arrays, patch_arrays, &
        receiver_arrays
    implicit none
    private
    public :: read_model, write_result

    type, public :: run_arrays
        !! How far a model is integrated, and what is recorded.
        integer :: schema, n_steps
        integer :: fingerprint                                   !! of the model, given back in the result
        integer :: ledger_every                                  !! steps between lines of energies
        real(dp), contiguous, pointer :: motion(:, :, :, :)
            !! (1, 3, n_receivers, n_steps) [m/s]
        real(dp), contiguous, pointer :: receiver_motion(:, :, :) => null()
            !! of injected sources, added to what is recorded (3, n_receivers, n_steps) [m/s]
        real(dp), contiguous, pointer :: energy(:, :, :)         !! (n_energies, 1, n_lines) [J]
    end type run_arrays

contains

    subroutine read_model(path, model, state, run, message)
        !! Read every array of a model file; the first failure is stated in `message`.
        character(len=*), intent(in) :: path
        type(model_arrays), intent(out) :: model
        type(model_state), intent(out) :: state
        type(run_arrays), intent(out) :: run
        character(len=:), allocatable, intent(inout) :: message
        integer(hid_t) :: file

        call open_file(path, file, message)
        if (allocated(message)) return
        call read_array(file, "run/schema", run%schema, message)
        call read_array(file, "run/n_steps", run%n_steps, message)
        call read_array(file, "run/fingerprint", run%fingerprint, message)
        call read_array(file, "run/ledger_every", run%ledger_every, message)
        call read_array(file, "arrays/dt", model%dt, message)
        call read_array(file, "arrays/local_damping", model%local_damping, message)
        call read_mesh(file, model%mesh, message)
        call read_hexes(file, model%hexes, message)
        call read_layer(file, model%layer, message)
        call read_edges(file, model%edges, message)
        call read_patches(file, model%patches, message)
        call read_ground(file, model%ground, message)
        call read_nodes(file, model%nodes, message)
        call read_contacts(file, model%contacts, message)
        call read_loads(file, model%loads, message)
        call read_boundaries(file, model%boundaries, message)
        call read_implicit(file, model%implicit, message)
        call read_receivers(file, model%receivers, message)
        call read_state(file, state, message)
        if (.not. allocated(message)) then
            if (has_array(file, "run/receiver_motion")) &
                call read_array(file, "run/receiver_motion", run%receiver_motion, message)
        end if
        call close_file(file, "arrays of the model are still open", message)
    end subroutine read_model

    subroutine read_mesh(file, mesh, message)
        integer(hid_t), intent(in) :: file
        type(mesh_arrays), intent(inout) :: mesh
        character(len=:), allocatable, intent(inout) :: message

        call read_array(file, "arrays/domain_zone_start", mesh%domain_zone_start, message)
        call read_array(file, "arrays/domain_slot_start", mesh%domain_slot_start, message)
        call read_array(file, "arrays/domain_set", mesh%domain_set, message)
        call read_array(file, "arrays/slot_node", mesh%slot_node, message)
        call read_array(file, "arrays/slot_place", mesh%slot_place, message)
        call read_array(file, "arrays/zone_slot", mesh%zone_slot, message)
        call read_array(file, "arrays/zone_lambda", mesh%zone_lambda, message)
        call read_array(file, "arrays/zone_shear", mesh%zone_shear, message)
        call read_array(file, "arrays/zone_row", mesh%zone_row, message)
        call read_array(file, "arrays/zone_patch", mesh%zone_patch, message)
    end subroutine read_mesh

    subroutine read_hexes(file, hexes, message)
        integer(hid_t), intent(in) :: file
        type(hex_arrays), intent(inout) :: hexes
        character(len=:), allocatable, intent(inout) :: message

        call read_array(file, "arrays/hex_order", hexes%order, message)
        call read_array(file, "arrays/n_mapped", hexes%n_mapped, message)
        call read_array(file, "arrays/hex_slope", hexes%hex_slope, message)
        call read_array(file, "arrays/hex_weight", hexes%hex_weight, message)
        call read_array(file, "arrays/pack_node", hexes%pack_node, message)
        call read_array(file, "arrays/pack_set", hexes%pack_set, message)
        call read_array(file, "arrays/pack_metric", hexes%pack_metric, message)
        call read_array(file, "arrays/pack_brick", hexes%pack_brick, message)
    end subroutine read_hexes

    subroutine read_layer(file, layer, message)
        integer(hid_t), intent(in) :: file
        type(layer_arrays), intent(inout) :: layer
        character(len=:), allocatable, intent(inout) :: message

        call read_array(file, "arrays/n_slabs", layer%n_slabs, message)
        call read_array(file, "arrays/slab_start", layer%slab_start, message)
        call read_array(file, "arrays/slab_axis", layer%slab_axis, message)
        call read_array(file, "arrays/slab_stretch", layer%slab_stretch, message)
        call read_array(file, "arrays/slab_lag", layer%slab_lag, message)
        call read_array(file, "arrays/layer_frame", layer%layer_frame, message)
        call read_array(file, "arrays/layer_node", layer%layer_node, message)
        call read_array(file, "arrays/layer_mass", layer%layer_mass, message)
        call read_array(file, "arrays/stretch_start", layer%stretch_start, message)
        call read_array(file, "arrays/node_stretch", layer%node_stretch, message)
        call read_array(file, "arrays/crossing_part", layer%crossing_part, message)
        call read_array(file, "arrays/crossing_stretch", layer%crossing_stretch, message)
    end subroutine read_layer

    subroutine read_edges(file, edges, message)
        integer(hid_t), intent(in) :: file
        type(edge_arrays), intent(inout) :: edges
        character(len=:), allocatable, intent(inout) :: message

        call read_array(file, "arrays/edge_start", edges%edge_start, message)
        call read_array(file, "arrays/edge_slot", edges%edge_slot, message)
        call read_array(file, "arrays/edge_spring", edges%edge_spring, message)
        call read_array(file, "arrays/skew_start", edges%skew_start, message)
        call read_array(file, "arrays/skew_slot", edges%skew_slot, message)
        call read_array(file, "arrays/skew_spring", edges%skew_spring, message)
    end subroutine read_edges

    subroutine read_patches(file, patches, message)
        integer(hid_t), intent(in) :: file
        type(patch_arrays), intent(inout) :: patches
        character(len=:), allocatable, intent(inout) :: message

        call read_array(file, "arrays/domain_patch_start", patches%domain_patch_start, message)
        call read_array(file, "arrays/patch_start", patches%patch_start, message)
        call read_array(file, "arrays/patch_slot", patches%patch_slot, message)
        call read_array(file, "arrays/patch_gradient", patches%patch_gradient, message)
        call read_array(file, "arrays/patch_bulk", patches%patch_bulk, message)
    end subroutine read_patches

    subroutine read_ground(file, ground, message)
        integer(hid_t), intent(in) :: file
        type(ground_arrays), intent(inout) :: ground
        character(len=:), allocatable, intent(inout) :: message

        call read_array(file, "arrays/set_form", ground%set_form, message)
        call read_array(file, "arrays/set_law", ground%set_law, message)
        call read_array(file, "arrays/set_property", ground%set_property, message, 2)
        call read_array(file, "arrays/set_beta", ground%set_beta, message, 1)
        call read_array(file, "arrays/set_branch", ground%set_branch, message, 1)
        call read_array(file, "arrays/row_initial", ground%row_initial, message, 2)
        call read_array(file, "arrays/memory_rate", ground%memory_rate, message)
    end subroutine read_ground

    subroutine read_nodes(file, nodes, message)
        integer(hid_t), intent(in) :: file
        type(node_arrays), intent(inout) :: nodes
        character(len=:), allocatable, intent(inout) :: message

        call read_array(file, "arrays/node_start", nodes%node_start, message)
        call read_array(file, "arrays/node_part", nodes%node_part, message)
        call read_array(file, "arrays/node_mass", nodes%node_mass, message, 1)
        call read_array(file, "arrays/node_alpha", nodes%node_alpha, message, 1)
        call read_array(file, "arrays/node_load", nodes%node_load, message, 1)
    end subroutine read_nodes

    subroutine read_contacts(file, contacts, message)
        integer(hid_t), intent(in) :: file
        type(contact_arrays), intent(inout) :: contacts
        character(len=:), allocatable, intent(inout) :: message

        call read_array(file, "arrays/contact_node", contacts%contact_node, message)
        call read_array(file, "arrays/contact_normal", contacts%contact_normal, message)
        call read_array(file, "arrays/contact_area", contacts%contact_area, message)
        call read_array(file, "arrays/contact_joint", contacts%contact_joint, message)
        call read_array(file, "arrays/contact_initial", contacts%contact_initial, message, 2)
        call read_array(file, "arrays/joint_law", contacts%joint_law, message, 1)
        call read_array(file, "arrays/joint_property", contacts%joint_property, message, 2)
    end subroutine read_contacts

    subroutine read_loads(file, loads, message)
        integer(hid_t), intent(in) :: file
        type(load_arrays), intent(inout) :: loads
        character(len=:), allocatable, intent(inout) :: message

        call read_array(file, "arrays/load_node", loads%load_node, message)
        call read_array(file, "arrays/load_vector", loads%load_vector, message)
        call read_array(file, "arrays/load_history", loads%load_history, message)
        call read_array(file, "arrays/load_delay", loads%load_delay, message)
        call read_array(file, "arrays/load_member", loads%load_member, message)
        call read_array(file, "arrays/history", loads%history, message)
    end subroutine read_loads

    subroutine read_boundaries(file, boundaries, message)
        integer(hid_t), intent(in) :: file
        type(boundary_arrays), intent(inout) :: boundaries
        character(len=:), allocatable, intent(inout) :: message

        call read_array(file, "arrays/dashpot_node", boundaries%dashpot_node, message)
        call read_array(file, "arrays/dashpot_impedance", boundaries%dashpot_impedance, message)
        call read_array(file, "arrays/dashpot_inverse", boundaries%dashpot_inverse, message, 3)
        call read_array(file, "arrays/fixed_node", boundaries%fixed_node, message)
        call read_array(file, "arrays/fixed_direction", boundaries%fixed_direction, message)
        call read_array(file, "arrays/fixed_history", boundaries%fixed_history, message, 1)
    end subroutine read_boundaries

    subroutine read_implicit(file, zones, message)
        integer(hid_t), intent(in) :: file
        type(implicit_arrays), intent(inout) :: zones
        character(len=:), allocatable, intent(inout) :: message

        call read_array(file, "arrays/cluster_start", zones%cluster_start, message)
        call read_array(file, "arrays/implicit_node", zones%implicit_node, message)
        call read_array(file, "arrays/column_start", zones%column_start, message)
        call read_array(file, "arrays/block_row", zones%block_row, message)
        call read_array(file, "arrays/block_factor", zones%block_factor, message, 1)
        call read_array(file, "arrays/implicit_inverse", zones%implicit_inverse, message, 1)
        call read_array(file, "arrays/implicit_inertia", zones%implicit_inertia, message, 1)
        call read_array(file, "arrays/implicit_drag", zones%implicit_drag, message, 1)
    end subroutine read_implicit

    subroutine read_receivers(file, receivers, message)
        integer(hid_t), intent(in) :: file
        type(receiver_arrays), intent(inout) :: receivers
        character(len=:), allocatable, intent(inout) :: message

        call read_array(file, "arrays/receiver_node", receivers%receiver_node, message)
        call read_array(file, "arrays/receiver_weight", receivers%receiver_weight, message)
    end subroutine read_receivers

    subroutine read_state(file, state, message)
        integer(hid_t), intent(in) :: file
        type(model_state), intent(inout) :: state
        character(len=:), allocatable, intent(inout) :: message

        call read_array(file, "state/displacement", state%nodes%displacement, message, 1)
        call read_array(file, "state/velocity", state%nodes%velocity, message, 1)
        call read_array(file, "state/memory", state%nodes%memory, message, 1)
        call read_array(file, "state/row_state", state%zones%row_state, message, 2)
        call read_array(file, "state/row_lost", state%zones%row_lost, message, 1)
        call read_array(file, "state/slab_memory", state%zones%slab_memory, message)
        call read_array(file, "state/node_memory", state%layer%node_memory, message)
        call read_array(file, "state/crossing_memory", state%layer%crossing_memory, message)
        call read_array(file, "state/contact_traction", state%joints%contact_traction, message, 2)
        call read_array(file, "state/contact_state", state%joints%contact_state, message, 2)
        call read_array(file, "state/contact_stored", state%joints%contact_stored, message, 1)
        call read_array(file, "state/contact_dissipated", state%joints%contact_dissipated, message, 1)
        call read_array(file, "state/sums", state%sums, message, 2)
    end subroutine read_state

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
        call write_array(file, "run/schema", run%schema, message)
        call write_array(file, "run/fingerprint", run%fingerprint, message)
        call write_array(file, "records/motion", run%motion, 1, message)
        call write_array(file, "records/energy", run%energy, 2, message)
        call write_array(file, "state/displacement", state%nodes%displacement, 1, message)
        call write_array(file, "state/velocity", state%nodes%velocity, 1, message)
        call write_array(file, "state/memory", state%nodes%memory, 1, message)
        call write_array(file, "state/row_state", state%zones%row_state, 2, message)
        call write_array(file, "state/row_lost", state%zones%row_lost, 1, message)
        call write_array(file, "state/slab_memory", state%zones%slab_memory, 0, message)
        call write_array(file, "state/node_memory", state%layer%node_memory, 0, message)
        call write_array(file, "state/crossing_memory", state%layer%crossing_memory, 0, message)
        call write_array(file, "state/contact_traction", state%joints%contact_traction, 2, message)
        call write_array(file, "state/contact_state", state%joints%contact_state, 2, message)
        call write_array(file, "state/contact_stored", state%joints%contact_stored, 1, message)
        call write_array(file, "state/contact_dissipated", state%joints%contact_dissipated, 1, message)
        call write_array(file, "state/sums", state%sums, 2, message)
        call close_file(file, "the result can't be written whole", message)
    end subroutine write_result

end module pyblast_model_file
