module pyblast_model_checks
    !! What the arrays of a model file must keep to, so that no kernel reads outside of them.
    use pyblast_kinds, only : dp, hex_width, n_joint_laws, n_joint_properties, n_joint_state, n_sums, &
        n_tet15, n_zone_laws, n_zone_properties, n_zone_state
    use pyblast_model_file, only : run_arrays
    use pyblast_model_types, only : edge_arrays, hex_arrays, implicit_arrays, layer_arrays, &
        layer_state, mesh_arrays, model_arrays, model_state, n_zone_packs, n_zone_parts, patch_arrays
    use pyblast_zone_laws, only : has_memory
    implicit none
    private
    public :: check_model

    real(dp), parameter :: longest_delay = 1e9_dp   !! [steps], so that they can be counted

contains

    subroutine check_model(model, state, run, message)
        !! Refuse arrays that do not fit together and indices that point nowhere.
        type(model_arrays), intent(in) :: model
        type(model_state), intent(in) :: state
        type(run_arrays), intent(in) :: run
        character(len=:), allocatable, intent(inout) :: message

        if (run%schema /= 1) message = "the schema is not 1"
        if (run%n_steps < 1 .or. run%ledger_every < 1) message = "'run' needs positive numbers"
        if (.not. (model%dt > 0.0_dp .and. model%dt < huge(model%dt))) &
            message = "'arrays/dt' must be positive"
        call check_mesh_sizes(model, message)
        call check_packs(model%mesh, model%hexes, size(model%nodes%node_mass), &
                         size(model%ground%set_law), message)
        call check_layer(model%layer, state%layer, size(state%zones%slab_memory), model%hexes, &
                         size(model%nodes%node_mass), size(model%contacts%contact_area), message)
        call check_node_sizes(model, run%n_steps, message)
        if (associated(run%receiver_motion)) &
            call require_size("'run/receiver_motion'", shape(run%receiver_motion), &
                              [3, size(model%receivers%receiver_node, 2), run%n_steps], message)
        call check_state_sizes(model, state, message)
        call check_mesh_indices(model, message)
        call check_node_indices(model, message)
        call check_implicit(model%implicit, size(model%nodes%node_mass), message)
        if (allocated(message)) return
        call check_domains(model%mesh, model%nodes%node_start, message)
        call check_memories(model, message)
        call check_edges(model%mesh, model%edges, message)
        call check_patches(model%mesh, model%patches, message)
    end subroutine check_model

    subroutine check_mesh_sizes(model, message)
        !! Sizes of what zones are made of.
        type(model_arrays), intent(in) :: model
        character(len=:), allocatable, intent(inout) :: message
        integer :: zones, slots, domains, sets, memories

        associate (mesh => model%mesh, edges => model%edges, patches => model%patches, &
                   ground => model%ground)
            zones = size(mesh%zone_lambda)
            slots = size(mesh%slot_node)
            domains = size(mesh%domain_set)
            sets = size(ground%set_law)
            memories = size(ground%memory_rate)
            call require_size("zones", [shape(mesh%zone_slot), shape(mesh%zone_shear), &
                                        shape(mesh%zone_row), shape(mesh%zone_patch)], &
                              [zones, size(model%receivers%receiver_node, 1), zones, zones, zones], &
                              message)
            call require_size("zone laws", [shape(ground%set_form), shape(ground%set_property), &
                                            shape(ground%set_beta), shape(ground%set_branch)], &
                              [sets, n_zone_properties, 1, sets, 1, sets, 1, 2, memories, sets], &
                              message)
            call require_size("slots", [shape(mesh%slot_place), shape(mesh%domain_zone_start), &
                                        shape(mesh%domain_slot_start)], &
                              [3, slots, domains + 1, domains + 1], message)
            call require_size("edges", [shape(edges%edge_start), shape(edges%edge_spring), &
                                        shape(edges%skew_start), shape(edges%skew_slot), &
                                        shape(edges%skew_spring)], &
                              [slots + 1, 6, size(edges%edge_slot), domains + 1, &
                               2, size(edges%skew_slot, 2), 3, size(edges%skew_slot, 2)], message)
            call require_size("patches", [shape(patches%domain_patch_start), &
                                          shape(patches%patch_start), &
                                          shape(patches%patch_gradient)], &
                              [domains + 1, size(patches%patch_bulk) + 1, &
                               3, size(patches%patch_slot)], message)
        end associate
    end subroutine check_mesh_sizes

    subroutine check_packs(mesh, hexes, n_nodes, n_sets, message)
        !! Sizes and indices of packs of zones.
        type(mesh_arrays), intent(in) :: mesh
        type(hex_arrays), intent(in) :: hexes
        integer, intent(in) :: n_nodes, n_sets
        character(len=:), allocatable, intent(inout) :: message
        integer :: d, n, packs

        if (allocated(message)) return
        if (hexes%order == 0) then
            if (size(mesh%zone_slot, 2) /= n_tet15) return
            call require_size("quadratic zones", shape(hexes%pack_metric), [hex_width, 11, 1, &
                              sum([(n_zone_packs(mesh, d), d = 1, size(mesh%domain_set))])], message)
            return
        end if
        if (hexes%order < 2 .or. hexes%order > 8) message = "'arrays/hex_order' must lie in 2 to 8"
        packs = size(hexes%pack_set)
        if (hexes%n_mapped < 0 .or. hexes%n_mapped > packs) &
            message = "'arrays/n_mapped' counts more packs than there are"
        if (allocated(message)) return
        n = hexes%order + 1
        call require_size("hexahedra", [shape(hexes%hex_slope), shape(hexes%hex_weight), &
                                        shape(hexes%pack_node), shape(hexes%pack_metric), &
                                        shape(hexes%pack_brick)], &
                          [n, n, n, hex_width, n**3, packs, hex_width, 11, n**3, &
                           max(1, hexes%n_mapped), hex_width, 5, max(1, packs - hexes%n_mapped)], &
                          message)
        if (allocated(message)) return
        call within("pack_node", reshape(hexes%pack_node, [size(hexes%pack_node)]), 1, n_nodes, &
                    message)
        call within("pack_set", hexes%pack_set, 1, n_sets, message)
    end subroutine check_packs

    subroutine check_layer(layer, state, n_memory, hexes, n_nodes, n_contacts, message)
        !! Sizes and indices of the absorbing layer.
        type(layer_arrays), intent(in) :: layer
        type(layer_state), intent(in) :: state
        type(hex_arrays), intent(in) :: hexes
        integer, intent(in) :: n_memory, n_nodes, n_contacts
        character(len=:), allocatable, intent(inout) :: message
        integer :: n, packs

        if (layer%n_slabs == 0 .or. allocated(message)) return
        if (layer%n_slabs /= size(layer%slab_axis)) message = "'arrays/n_slabs' is not the number of slabs"
        if (allocated(message)) return
        n = (hexes%order + 1)**3
        packs = size(hexes%pack_set)
        associate (slabs => layer%n_slabs, nodes => size(layer%layer_node), &
                   crossings => size(layer%crossing_part))
            call require_size("absorbing layer", &
                              [shape(layer%slab_start), shape(layer%slab_axis), &
                               shape(layer%slab_stretch), shape(layer%slab_lag), &
                               shape(layer%layer_frame), shape(layer%layer_mass), &
                               shape(layer%stretch_start), shape(layer%crossing_stretch), &
                               shape(state%node_memory), shape(state%crossing_memory), n_memory], &
                              [packs + 1, slabs, hex_width, 5, hexes%order + 1, slabs, hex_width, slabs, 3, 3, &
                               nodes, nodes + 1, 5, 3, crossings, 3, size(layer%node_stretch, 2), &
                               3, 3, crossings, &
                               hex_width*10*n*slabs], message)
        end associate
        if (allocated(message)) return
        call within("slab_axis", layer%slab_axis, 1, 3, message)
        call within("slab_start", layer%slab_start, 1, layer%n_slabs + 1, message)
        call within("layer_node", layer%layer_node, 1, n_nodes, message)
        call within("crossing_part", layer%crossing_part, 1, n_contacts, message)
        call within("stretch_start", layer%stretch_start, 1, size(layer%node_stretch, 2) + 1, message)
        if (any(layer%stretch_start(2:) < layer%stretch_start(:size(layer%layer_node)))) &
            message = "'arrays/stretch_start' does not ascend"
        if (any(layer%slab_start(2:) < layer%slab_start(:packs)) &
            .or. any(layer%slab_start(2:) - layer%slab_start(:packs) > 3)) &
            message = "'arrays/slab_start' does not ascend by up to three"
    end subroutine check_layer

    subroutine check_node_sizes(model, n_steps, message)
        !! Sizes of nodes, contacts, loads, boundaries and receivers.
        type(model_arrays), intent(in) :: model
        integer, intent(in) :: n_steps
        character(len=:), allocatable, intent(inout) :: message
        integer :: nodes, contacts, joints

        nodes = size(model%nodes%node_mass)
        contacts = size(model%contacts%contact_area)
        joints = size(model%contacts%joint_law)
        associate (own => model%nodes)
            call require_size("nodes", [shape(own%node_alpha), shape(own%node_load), &
                                        shape(own%node_start)], &
                              [1, nodes, 1, 3, nodes, nodes + 1], message)
            if (model%hexes%order == 0) call require_size( &
                "parts", shape(own%node_part), [n_zone_parts(model) + 2*contacts], message)
        end associate
        associate (own => model%contacts)
            call require_size("contacts", [shape(own%contact_node), shape(own%contact_normal), &
                                           shape(own%contact_joint), shape(own%contact_initial)], &
                              [2, contacts, 3, contacts, contacts, 3, 1, contacts], message)
            call require_size("joints", [shape(own%joint_law), shape(own%joint_property)], &
                              [1, joints, n_joint_properties, 1, joints], message)
        end associate
        associate (own => model%loads, loads => size(model%loads%load_node))
            call require_size("loads", [shape(own%load_vector), shape(own%load_history), &
                                        shape(own%load_delay), shape(own%load_member), &
                                        size(own%history, 2)], &
                              [3, loads, loads, loads, loads, n_steps], message)
        end associate
        associate (own => model%boundaries, dashpots => size(model%boundaries%dashpot_node), &
                   fixed => size(model%boundaries%fixed_node))
            call require_size("dashpots", [shape(own%dashpot_impedance), &
                                           shape(own%dashpot_inverse)], &
                              [3, 3, dashpots, 3, 3, 1, dashpots], message)
            call require_size("fixed", [shape(own%fixed_direction), shape(own%fixed_history)], &
                              [3, fixed, 1, fixed], message)
        end associate
        call require_size("receivers", shape(model%receivers%receiver_weight), &
                          shape(model%receivers%receiver_node), message)
    end subroutine check_node_sizes

    subroutine check_state_sizes(model, state, message)
        !! Sizes of all that a step changes.
        type(model_arrays), intent(in) :: model
        type(model_state), intent(in) :: state
        character(len=:), allocatable, intent(inout) :: message

        associate (nodes => size(model%nodes%node_mass), rows => size(state%zones%row_lost), &
                   contacts => size(model%contacts%contact_area), joints => state%joints)
            call require_size("nodes", [shape(state%nodes%displacement), &
                                        shape(state%nodes%velocity), shape(state%nodes%memory)], &
                              [1, 3, nodes, 1, 3, nodes, &
                               1, 3, size(model%ground%memory_rate), nodes], message)
            call require_size("zone laws", [shape(state%zones%row_state), &
                                            shape(model%ground%row_initial)], &
                              [n_zone_state, 1, rows, 6, 1, rows], message)
            call require_size("contacts", [shape(joints%contact_traction), &
                                           shape(joints%contact_state), &
                                           shape(joints%contact_stored), &
                                           shape(joints%contact_dissipated)], &
                              [3, 1, contacts, n_joint_state, 1, contacts, 1, contacts, &
                               1, contacts], message)
            call require_size("sums", shape(state%sums), [n_sums, 1], message)
        end associate
    end subroutine check_state_sizes

    subroutine check_mesh_indices(model, message)
        !! Ranges of the indices of zones.
        type(model_arrays), intent(in) :: model
        character(len=:), allocatable, intent(inout) :: message
        integer :: zones, slots, rows

        associate (mesh => model%mesh, ground => model%ground)
            zones = size(mesh%zone_lambda)
            slots = size(mesh%slot_node)
            rows = size(ground%row_initial, 3)
            call within("slot_node", mesh%slot_node, 1, size(model%nodes%node_mass), message)
            call within("zone_slot", reshape(mesh%zone_slot, [size(mesh%zone_slot)]), 1, slots, &
                        message)
            call within("domain_zone_start", mesh%domain_zone_start, 1, zones + 1, message)
            call within("domain_slot_start", mesh%domain_slot_start, 1, slots + 1, message)
            call within("domain_set", mesh%domain_set, 1, size(ground%set_law), message)
            call within("zone_row", mesh%zone_row, 0, rows, message)
            call within("zone_patch", mesh%zone_patch, 0, zones, message)
            call within("set_form", ground%set_form, 1, 3, message)
            call within("set_law", ground%set_law, 1, n_zone_laws, message)
        end associate
    end subroutine check_mesh_indices

    subroutine check_node_indices(model, message)
        !! Ranges of the indices of nodes, contacts, loads, boundaries and receivers.
        type(model_arrays), intent(in) :: model
        character(len=:), allocatable, intent(inout) :: message
        integer :: nodes, histories

        nodes = size(model%nodes%node_mass)
        histories = size(model%loads%history, 1)
        associate (own => model%nodes)
            call within("node_part", own%node_part, 1, &
                        n_zone_parts(model) + 2*size(model%contacts%contact_area), message)
            call within("node_start", own%node_start, 1, size(own%node_part) + 1, message)
        end associate
        associate (own => model%contacts)
            call within("contact_node", reshape(own%contact_node, [size(own%contact_node)]), 1, &
                        nodes, message)
            call within("contact_joint", own%contact_joint, 1, size(own%joint_law), message)
            call within("joint_law", own%joint_law(1, :), 1, n_joint_laws, message)
        end associate
        associate (own => model%loads)
            if (.not. all(own%load_delay >= 0.0_dp .and. own%load_delay < longest_delay)) &
                message = "'arrays/load_delay' must lie between 0 and 10^9 steps"
            call within("load_node", own%load_node, 1, nodes, message)
            call within("load_member", own%load_member, 0, 1, message)
            call within("load_history", own%load_history, 1, histories, message)
        end associate
        associate (own => model%boundaries)
            call within("dashpot_node", own%dashpot_node, 1, nodes, message)
            call within("fixed_node", own%fixed_node, 1, nodes, message)
            call within("fixed_history", own%fixed_history(1, :), 0, histories, message)
        end associate
        associate (own => model%receivers%receiver_node)
            call within("receiver_node", reshape(own, [size(own)]), 1, nodes, message)
        end associate
    end subroutine check_node_indices

    subroutine require_size(what, given, expected, message)
        !! Compare lengths of arrays that belong together.
        character(len=*), intent(in) :: what
        integer, intent(in) :: given(:), expected(:)
        character(len=:), allocatable, intent(inout) :: message

        if (any(given /= expected) .and. .not. allocated(message)) &
            message = "the arrays of the " // what // " do not have matching lengths"
    end subroutine require_size

    subroutine within(name, indices, low, high, message)
        !! Check the range of indices.
        character(len=*), intent(in) :: name
        integer, intent(in) :: indices(:), low, high
        character(len=:), allocatable, intent(inout) :: message

        if (allocated(message)) return
        if (any(indices < low .or. indices > high)) &
            message = "'arrays/" // name // "' points outside its table"
    end subroutine within

    subroutine check_domains(mesh, node_start, message)
        !! The slots of a zone must lie within its domain, and domains and nodes cover everything.
        type(mesh_arrays), intent(in) :: mesh
        integer, intent(in) :: node_start(:)
        character(len=:), allocatable, intent(inout) :: message
        integer :: d, first, last

        associate (zone_start => mesh%domain_zone_start, slot_start => mesh%domain_slot_start)
            do d = 1, size(mesh%domain_set)
                first = zone_start(d)
                last = zone_start(d + 1) - 1
                if (last < first .or. slot_start(d + 1) < slot_start(d)) then
                    message = "'arrays/domain_zone_start' does not ascend"
                    return
                end if
                if (maxval(mesh%zone_slot(first:last, :)) > slot_start(d + 1) - slot_start(d) &
                    .or. maxval(mesh%zone_patch(first:last)) > last - first + 1) &
                    message = "'arrays/zone_slot' or 'zone_patch' points outside its domain"
            end do
            if (zone_start(1) /= 1 .or. zone_start(d) /= size(mesh%zone_patch) + 1 .or. &
                any(node_start(2:) < node_start(:size(node_start) - 1))) &
                message = "'arrays/domain_zone_start' or 'node_start' does not cover everything"
        end associate
    end subroutine check_domains

    subroutine check_implicit(zones, n_nodes, message)
        !! A block must lie in its cluster, below its column; clusters share no node.
        type(implicit_arrays), intent(in) :: zones
        integer, intent(in) :: n_nodes
        character(len=:), allocatable, intent(inout) :: message
        integer :: c, j, used(n_nodes)

        associate (n => size(zones%implicit_node), blocks => size(zones%block_row), &
                   clusters => size(zones%cluster_start) - 1)
            call require_size("implicit zones", [shape(zones%column_start), &
                                                 shape(zones%block_factor), &
                                                 shape(zones%implicit_inverse), &
                                                 shape(zones%implicit_inertia), &
                                                 shape(zones%implicit_drag)], &
                              [n + 1, 1, 9, blocks, 1, 6, n, 1, 6, n, 1, 6, n], message)
            call within("implicit_node", zones%implicit_node, 1, n_nodes, message)
            call within("cluster_start", zones%cluster_start, 1, n + 1, message)
            call within("column_start", zones%column_start, 1, blocks + 1, message)
            if (allocated(message) .or. clusters == 0) return
            used = 0
            used(zones%implicit_node) = 1
            if (any(zones%cluster_start(2:) < zones%cluster_start(:clusters)) &
                .or. any(zones%column_start(2:) < zones%column_start(:n)) .or. sum(used) /= n) &
                message = "'arrays/cluster_start', 'column_start' or 'implicit_node' does not ascend or repeats a node"
            if (allocated(message)) return
            do c = 1, clusters
                do j = zones%cluster_start(c), zones%cluster_start(c + 1) - 1
                    call within("block_row", zones%block_row(zones%column_start(j): &
                                zones%column_start(j + 1) - 1), j + 1, &
                                zones%cluster_start(c + 1) - 1, message)
                end do
            end do
        end associate
    end subroutine check_implicit

    subroutine check_memories(model, message)
        !! Zones of a law with memory must each have one.
        type(model_arrays), intent(in) :: model
        character(len=:), allocatable, intent(inout) :: message
        integer :: d

        if (allocated(message)) return
        associate (mesh => model%mesh)
            do d = 1, size(mesh%domain_set)
                if (.not. has_memory(model%ground%set_law(mesh%domain_set(d)))) cycle
                if (any(mesh%zone_row(mesh%domain_zone_start(d):mesh%domain_zone_start(d + 1) - 1) < 1)) &
                    message = "'arrays/zone_row' is 0 for zones whose law needs a memory"
            end do
        end associate
    end subroutine check_memories

    subroutine check_edges(mesh, edges, message)
        !! The ends of an edge must lie within its domain, and edges ascend with slots.
        type(mesh_arrays), intent(in) :: mesh
        type(edge_arrays), intent(in) :: edges
        character(len=:), allocatable, intent(inout) :: message
        integer :: d, e, s, slots

        if (allocated(message)) return
        call within("edge_start", edges%edge_start, 1, size(edges%edge_slot) + 1, message)
        call within("skew_start", edges%skew_start, 1, size(edges%skew_slot, 2) + 1, message)
        if (allocated(message)) return
        associate (slot_start => mesh%domain_slot_start, skew_start => edges%skew_start)
            do d = 1, size(slot_start) - 1
                slots = slot_start(d + 1) - slot_start(d)
                do s = slot_start(d), slot_start(d + 1) - 1
                    do e = edges%edge_start(s), edges%edge_start(s + 1) - 1
                        if (edges%edge_slot(e) < 1 .or. edges%edge_slot(e) > slots) &
                            message = "'arrays/edge_slot' points outside its domain"
                    end do
                end do
                do e = skew_start(d), skew_start(d + 1) - 1
                    if (any(edges%skew_slot(:, e) < 1 .or. edges%skew_slot(:, e) > slots)) &
                        message = "'arrays/skew_slot' points outside its domain"
                end do
            end do
        end associate
    end subroutine check_edges

    subroutine check_patches(mesh, patches, message)
        !! The nodes of a patch must lie within its domain.
        type(mesh_arrays), intent(in) :: mesh
        type(patch_arrays), intent(in) :: patches
        character(len=:), allocatable, intent(inout) :: message
        integer :: d, e, p, slots

        if (allocated(message)) return
        associate (domain_start => patches%domain_patch_start, start => patches%patch_start, &
                   slot_start => mesh%domain_slot_start)
            call within("domain_patch_start", domain_start, 1, size(start), message)
            call within("patch_start", start, 1, size(patches%patch_slot) + 1, message)
            if (allocated(message)) return
            do d = 1, size(slot_start) - 1
                slots = slot_start(d + 1) - slot_start(d)
                do p = domain_start(d), domain_start(d + 1) - 1
                    do e = start(p), start(p + 1) - 1
                        if (patches%patch_slot(e) < 1 .or. patches%patch_slot(e) > slots) &
                            message = "'arrays/patch_slot' points outside its domain"
                    end do
                end do
            end do
        end associate
    end subroutine check_patches

end module pyblast_model_checks
