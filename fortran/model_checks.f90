module pyblast_model_checks
    !! What the arrays of a model file must keep to together, so that no kernel reads outside of them.
    use pyblast_hdf5_arrays, only : check_range
    use pyblast_kinds, only : dp, n_tet15
    use pyblast_model_arrays, only : check_indices, n_bricks, n_contacts, n_corners, n_force_parts, &
        n_hex_nodes, n_line, n_metrics, n_nodes, n_packs, n_parts, n_slabs_held, n_total
    use pyblast_model_types, only : edge_arrays, hex_arrays, implicit_arrays, layer_arrays, &
        mesh_arrays, model_arrays, n_zone_packs, n_zone_parts, patch_arrays, run_arrays
    use pyblast_zone_laws, only : has_memory
    implicit none
    private
    public :: check_model

    real(dp), parameter :: longest_delay = 1e9_dp   !! [steps], so that they can be counted

contains

    subroutine check_model(model, run, sizes, message)
        !! Refuse arrays that do not fit together in ways that their table does not tell.
        type(model_arrays), intent(in) :: model
        type(run_arrays), intent(in) :: run
        integer, intent(inout) :: sizes(0:)
        character(len=:), allocatable, intent(inout) :: message

        sizes(n_force_parts) = n_zone_parts(model) + 2*sizes(n_contacts)
        if (sizes(n_total) /= run%n_steps) message = "'run/n_steps' is not that of 'arrays/history'"
        if (any(model%loads%load_delay >= longest_delay)) &
            message = "'arrays/load_delay' must be below 10^9 steps"
        if (model%hexes%order == 0 .and. sizes(n_parts) /= sizes(n_force_parts)) &
            message = "'arrays/node_part' does not hold every part of the forces"
        call check_stiffness(model, message)
        call check_packs(model%mesh, model%hexes, sizes, message)
        call check_layer(model%layer, sizes, message)
        call check_indices(model, sizes, message)
        if (allocated(message)) return
        call check_implicit(model%implicit, sizes(n_nodes), message)
        call check_dashpots(model%boundaries%dashpot_node, sizes(n_nodes), message)
        call check_domains(model%mesh, message)
        call check_memories(model, message)
        call check_edges(model%mesh, model%edges, message)
        call check_patches(model%mesh, model%patches, message)
    end subroutine check_model

    subroutine check_stiffness(model, message)
        !! Moduli of zones must resist: neither the shear nor the bulk modulus may be negative.
        type(model_arrays), intent(in) :: model
        character(len=:), allocatable, intent(inout) :: message
        integer :: n

        associate (lambda => model%mesh%zone_lambda, shear => model%mesh%zone_shear, &
                   brick => model%hexes%pack_brick, metric => model%hexes%pack_metric)
            n = 1
            if (model%hexes%order == 0) n = -1            ! those of quadratic zones have this sign
            if (any(3.0_dp*lambda + 2.0_dp*shear < 0.0_dp) .or. any(brick(:, 5, :) < 0.0_dp) &
                .or. any(3.0_dp*brick(:, 4, :) + 2.0_dp*brick(:, 5, :) < 0.0_dp) &
                .or. any(n*metric(:, 11, :, :) < 0.0_dp) &
                .or. any(n*(3.0_dp*metric(:, 10, :, :) + 2.0_dp*metric(:, 11, :, :)) < 0.0_dp)) &
                message = "a modulus in 'arrays/zone_lambda', 'pack_brick' or 'pack_metric' is negative"
        end associate
    end subroutine check_stiffness

    subroutine check_packs(mesh, hexes, sizes, message)
        !! Sizes of packs of zones.
        type(mesh_arrays), intent(in) :: mesh
        type(hex_arrays), intent(in) :: hexes
        integer, intent(in) :: sizes(0:)
        character(len=:), allocatable, intent(inout) :: message
        integer :: d, packs

        packs = sizes(n_packs)
        if (sizes(n_line) /= hexes%order + 1 .or. sizes(n_hex_nodes) /= (hexes%order + 1)**3) &
            message = "'arrays/hex_order' is not that of the other arrays of hexahedra"
        if (hexes%order == 0) then
            if (sizes(n_corners) == n_tet15 .and. sizes(n_metrics) /= &
                sum([(n_zone_packs(mesh, d), d = 1, size(mesh%domain_set))])) &
                message = "'arrays/pack_metric' has not as many packs as the quadratic zones fill"
        else if (hexes%order == 1 .or. hexes%n_mapped > packs) then
            message = "'arrays/hex_order' is 1, or 'n_mapped' counts more packs than there are"
        else if (sizes(n_metrics) /= max(1, hexes%n_mapped) .or. &
                 sizes(n_bricks) /= max(1, packs - hexes%n_mapped)) then
            message = "'arrays/n_mapped' is not the number of mapped packs"
        end if
    end subroutine check_packs

    subroutine check_layer(layer, sizes, message)
        !! Slabs of the absorbing layer: as many as are counted, up to three in a pack.
        type(layer_arrays), intent(in) :: layer
        integer, intent(in) :: sizes(0:)
        character(len=:), allocatable, intent(inout) :: message

        if (layer%n_slabs == 0) return
        if (layer%n_slabs /= sizes(n_slabs_held)) message = "'arrays/n_slabs' is not the number of slabs"
        if (any(layer%slab_start(2:) - layer%slab_start(:sizes(n_packs)) > 3)) &
            message = "'arrays/slab_start' must ascend by up to three"
    end subroutine check_layer

    subroutine check_domains(mesh, message)
        !! Domains must cover all zones, and the slots of a zone lie within its domain.
        type(mesh_arrays), intent(in) :: mesh
        character(len=:), allocatable, intent(inout) :: message
        integer :: d, first, last, slots

        associate (zone_start => mesh%domain_zone_start, slot_start => mesh%domain_slot_start)
            do d = 1, size(mesh%domain_set)
                first = zone_start(d)
                last = zone_start(d + 1) - 1
                slots = slot_start(d + 1) - slot_start(d)
                if (any(mesh%zone_slot(first:last, :) > slots) .or. &
                    any(mesh%zone_patch(first:last) > last - first + 1)) &
                    message = "'arrays/zone_slot' or 'zone_patch' points outside its domain"
            end do
            if (zone_start(1) /= 1 .or. zone_start(d) /= size(mesh%zone_patch) + 1) &
                message = "'arrays/domain_zone_start' does not cover all zones"
        end associate
    end subroutine check_domains

    subroutine check_implicit(zones, n_nodes, message)
        !! A block must lie in its cluster, below its column; clusters share no node.
        type(implicit_arrays), intent(in) :: zones
        integer, intent(in) :: n_nodes
        character(len=:), allocatable, intent(inout) :: message
        integer :: c, j, used(n_nodes)

        associate (clusters => size(zones%cluster_start) - 1)
            if (clusters == 0) return
            used = 0
            used(zones%implicit_node) = 1
            if (sum(used) /= size(zones%implicit_node)) message = "'arrays/implicit_node' repeats a node"
            do c = 1, clusters
                do j = zones%cluster_start(c), zones%cluster_start(c + 1) - 1
                    associate (first => zones%column_start(j), last => zones%column_start(j + 1) - 1)
                        call check_range("arrays/block_row", last - first + 1, zones%block_row(first:last), &
                                         j + 1, zones%cluster_start(c + 1) - 1, .false., message)
                    end associate
                end do
            end do
        end associate
    end subroutine check_implicit

    subroutine check_dashpots(dashpot_node, n_nodes, message)
        !! A node has one dashpot: blocks of them are stepped side by side.
        integer, intent(in) :: dashpot_node(:), n_nodes
        character(len=:), allocatable, intent(inout) :: message
        integer :: used(n_nodes)

        used = 0
        used(dashpot_node) = 1
        if (sum(used) /= size(dashpot_node)) message = "'arrays/dashpot_node' repeats a node"
    end subroutine check_dashpots

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
        integer :: d, s, slots

        if (allocated(message)) return
        associate (slot_start => mesh%domain_slot_start, skew_start => edges%skew_start)
            do d = 1, size(slot_start) - 1
                slots = slot_start(d + 1) - slot_start(d)
                do s = slot_start(d), slot_start(d + 1) - 1
                    if (any(edges%edge_slot(edges%edge_start(s):edges%edge_start(s + 1) - 1) > slots)) &
                        message = "'arrays/edge_slot' points outside its domain"
                end do
                if (any(edges%skew_slot(:, skew_start(d):skew_start(d + 1) - 1) > slots)) &
                    message = "'arrays/skew_slot' points outside its domain"
            end do
        end associate
    end subroutine check_edges

    subroutine check_patches(mesh, patches, message)
        !! The nodes of a patch must lie within its domain.
        type(mesh_arrays), intent(in) :: mesh
        type(patch_arrays), intent(in) :: patches
        character(len=:), allocatable, intent(inout) :: message
        integer :: d, p, slots

        if (allocated(message)) return
        associate (domain_start => patches%domain_patch_start, start => patches%patch_start, &
                   slot_start => mesh%domain_slot_start)
            do d = 1, size(slot_start) - 1
                slots = slot_start(d + 1) - slot_start(d)
                do p = domain_start(d), domain_start(d + 1) - 1
                    if (any(patches%patch_slot(start(p):start(p + 1) - 1) > slots)) &
                        message = "'arrays/patch_slot' points outside its domain"
                end do
            end do
        end associate
    end subroutine check_patches

end module pyblast_model_checks
