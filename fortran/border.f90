module pyblast_border
    !! The border to Python: flat lists of arrays in, types of arrays inside.
    !!
    !! f2py reads this file, and no routine of it may have a derived type among its arguments. Each
    !! routine associates its arrays with the components of the types and calls a routine of the
    !! same task. Arguments are explained at the components in `pyblast_model_types`.
    use omp_lib, only : omp_get_max_threads, omp_set_num_threads
    use pyblast_kinds, only : dp, hex_width, n_energies, n_joint_properties, n_joint_state, n_sums, &
        n_zone_properties, n_zone_state
    use pyblast_batch, only : n_batch
    use pyblast_model_types, only : allocate_domain_work, boundary_arrays, contact_arrays, &
        domain_work, edge_arrays, ground_arrays, hex_arrays, joint_state, layer_arrays, layer_state, &
        implicit_arrays, load_arrays, mesh_arrays, &
        model_arrays, model_state, nodal_state, node_arrays, patch_arrays, receiver_arrays, &
        zone_state
    use pyblast_boundaries, only : add_loads => load_forces, add_reactions => reaction_forces, &
        load_runs, &
        add_viscous => viscous_forces
    use pyblast_contacts, only : energy_at_rest => stored_at_rest
    use pyblast_internal_forces, only : add_zone_forces => zone_forces
    use pyblast_solver, only : integrate
    use pyblast_time_stepping, only : follow => update_memory
    implicit none
    private
    public :: advance, stored_at_rest
    public :: load_forces, reaction_forces, update_memory, viscous_forces, zone_forces
    public :: n_threads, use_threads

contains

    subroutine advance(n_nodes, n_corners, n_zones, n_domains, n_slots, n_edges, n_skews, n_sets, &
                       n_rows, n_memories, n_patches, n_ends, n_parts, n_contacts, n_joints, &
                       n_loads, n_histories, n_dashpots, n_fixed, n_receivers, n_total, n_steps, &
                       n_ledger, n_line, n_hex_nodes, n_packs, n_metrics, n_bricks, n_slabs_held, &
                       n_layer_nodes, n_stretched, n_stretches, n_crossings, n_clusters, n_implicit, n_blocks, &
                       first_step, ledger_every, dt, local_damping, &
                       hex_order, n_mapped, hex_slope, hex_weight, pack_node, pack_set, &
                       pack_metric, pack_brick, n_slabs, slab_start, slab_axis, slab_stretch, &
                       slab_lag, layer_frame, layer_node, layer_mass, stretch_start, stretch_row, node_stretch, &
                       crossing_part, crossing_stretch, &
                       domain_zone_start, domain_slot_start, domain_set, slot_node, slot_place, &
                       zone_slot, zone_lambda, zone_shear, zone_row, zone_patch, set_form, &
                       edge_start, edge_slot, edge_spring, skew_start, skew_slot, skew_spring, &
                       domain_patch_start, patch_start, patch_slot, patch_gradient, patch_bulk, &
                       set_law, set_property, set_beta, set_branch, row_initial, memory_rate, &
                       node_start, node_part, node_mass, node_alpha, node_load, &
                       contact_node, contact_normal, contact_area, contact_joint, &
                       contact_initial, joint_law, joint_property, &
                       load_node, load_vector, load_history, load_delay, load_member, history, &
                       dashpot_node, dashpot_impedance, dashpot_inverse, &
                       fixed_node, fixed_direction, fixed_history, &
                       cluster_start, implicit_node, column_start, block_row, block_factor, &
                       implicit_inverse, implicit_inertia, implicit_drag, &
                       receiver_node, receiver_weight, &
                       displacement, velocity, memory, row_state, row_lost, contact_traction, &
                       contact_state, contact_stored, contact_dissipated, slab_memory, &
                       node_memory, node_past, crossing_memory, sums, &
                       motion, energy, info, where, member)
        !! Integrate n_steps from first_step; stop early when the motion is no longer finite.
        integer, intent(in) :: n_nodes, n_zones, n_domains, n_slots, n_sets, n_rows, n_parts
        integer, intent(in) :: n_memories, n_corners, n_edges, n_skews, n_patches, n_ends
        integer, intent(in) :: n_contacts, n_joints, n_loads, n_histories, n_dashpots, n_fixed
        integer, intent(in) :: n_receivers, n_line, n_hex_nodes, n_packs, n_metrics, n_bricks
        integer, intent(in) :: n_slabs_held, n_layer_nodes, n_stretched, n_stretches, n_crossings
        integer, intent(in) :: n_clusters, n_implicit, n_blocks
        integer, intent(in) :: hex_order, n_mapped, n_slabs
        integer, intent(in) :: n_total                       !! steps that the histories cover
        integer, intent(in) :: n_steps                       !! steps of this call
        integer, intent(in) :: n_ledger                      !! lines of energies of this call
        integer, intent(in) :: first_step                    !! from 0
        integer, intent(in) :: ledger_every                  !! steps between lines of energies
        real(dp), intent(in) :: dt, local_damping
        real(dp), intent(in), target :: hex_slope(n_line, n_line), hex_weight(n_line)
        integer, intent(in), target :: pack_node(hex_width, n_hex_nodes, n_packs), pack_set(n_packs)
        real(dp), intent(in), target :: pack_metric(hex_width, 11, n_hex_nodes, n_metrics)
        real(dp), intent(in), target :: pack_brick(hex_width, 5, n_bricks)
        integer, intent(in), target :: slab_start(n_packs + 1), slab_axis(n_slabs_held)
        real(dp), intent(in), target :: slab_stretch(hex_width, 5, n_line, n_slabs_held)
        real(dp), intent(in), target :: slab_lag(hex_width, n_slabs_held), layer_frame(3, 3)
        integer, intent(in), target :: layer_node(n_layer_nodes), crossing_part(n_crossings)
        real(dp), intent(in), target :: layer_mass(n_layer_nodes)
        integer, intent(in), target :: stretch_start(n_layer_nodes + 1)
        integer, intent(in), target :: stretch_row(n_stretched)
        real(dp), intent(in), target :: node_stretch(5, n_stretches)
        real(dp), intent(in), target :: crossing_stretch(5, 3, n_crossings)
        integer, intent(in), target :: domain_zone_start(n_domains + 1)
        integer, intent(in), target :: domain_slot_start(n_domains + 1), domain_set(n_domains)
        integer, intent(in), target :: slot_node(n_slots), zone_slot(n_zones, n_corners)
        real(dp), intent(in), target :: slot_place(3, n_slots), zone_lambda(n_zones)
        real(dp), intent(in), target :: zone_shear(n_zones)
        integer, intent(in), target :: zone_row(n_zones), zone_patch(n_zones), set_law(n_sets)
        integer, intent(in), target :: set_form(n_sets), edge_start(n_slots + 1), edge_slot(n_edges)
        integer, intent(in), target :: skew_start(n_domains + 1), skew_slot(2, n_skews)
        real(dp), intent(in), target :: edge_spring(6, n_edges), skew_spring(3, n_skews)
        integer, intent(in), target :: domain_patch_start(n_domains + 1), patch_start(n_patches + 1)
        integer, intent(in), target :: patch_slot(n_ends)
        real(dp), intent(in), target :: patch_gradient(3, n_ends), patch_bulk(n_patches)
        real(dp), intent(in), target :: set_property(n_zone_properties, n_batch, n_sets)
        real(dp), intent(in), target :: set_beta(n_batch, n_sets)
        real(dp), intent(in), target :: set_branch(n_batch, 2, n_memories, n_sets)
        real(dp), intent(in), target :: row_initial(6, n_batch, n_rows), memory_rate(n_memories)
        integer, intent(in), target :: node_start(n_nodes + 1), node_part(n_parts)
        real(dp), intent(in), target :: node_mass(n_batch, n_nodes), node_alpha(n_batch, n_nodes)
        real(dp), intent(in), target :: node_load(n_batch, 3, n_nodes)
        integer, intent(in), target :: contact_node(2, n_contacts), contact_joint(n_contacts)
        real(dp), intent(in), target :: contact_normal(3, n_contacts), contact_area(n_contacts)
        real(dp), intent(in), target :: contact_initial(3, n_batch, n_contacts)
        integer, intent(in), target :: joint_law(n_batch, n_joints)
        real(dp), intent(in), target :: joint_property(n_joint_properties, n_batch, n_joints)
        integer, intent(in), target :: load_node(n_loads), load_history(n_loads), load_member(n_loads)
        real(dp), intent(in), target :: load_vector(3, n_loads), load_delay(n_loads)
        real(dp), intent(in), target :: history(n_histories, n_total)
        integer, intent(in), target :: dashpot_node(n_dashpots)
        real(dp), intent(in), target :: dashpot_impedance(3, 3, n_dashpots)
        real(dp), intent(in), target :: dashpot_inverse(3, 3, n_batch, n_dashpots)
        integer, intent(in), target :: fixed_node(n_fixed), fixed_history(n_batch, n_fixed)
        real(dp), intent(in), target :: fixed_direction(3, n_fixed)
        integer, intent(in), target :: cluster_start(n_clusters + 1), implicit_node(n_implicit)
        integer, intent(in), target :: column_start(n_implicit + 1), block_row(n_blocks)
        real(dp), intent(in), target :: block_factor(n_batch, 9, n_blocks)
        real(dp), intent(in), target :: implicit_inverse(n_batch, 6, n_implicit)
        real(dp), intent(in), target :: implicit_inertia(n_batch, 6, n_implicit)
        real(dp), intent(in), target :: implicit_drag(n_batch, 6, n_implicit)
        integer, intent(in), target :: receiver_node(n_corners, n_receivers)
        real(dp), intent(in), target :: receiver_weight(n_corners, n_receivers)
        real(dp), intent(inout), target :: displacement(n_batch, 3, n_nodes)
        real(dp), intent(inout), target :: velocity(n_batch, 3, n_nodes)
        real(dp), intent(inout), target :: memory(n_batch, 3, n_memories, n_nodes)
        real(dp), intent(inout), target :: row_state(n_zone_state, n_batch, n_rows)
        real(dp), intent(inout), target :: row_lost(n_batch, n_rows)
        real(dp), intent(inout), target :: contact_traction(3, n_batch, n_contacts)
        real(dp), intent(inout), target :: contact_state(n_joint_state, n_batch, n_contacts)
        real(dp), intent(inout), target :: contact_stored(n_batch, n_contacts)
        real(dp), intent(inout), target :: contact_dissipated(n_batch, n_contacts)
        real(dp), intent(inout), target :: slab_memory(hex_width, 10, n_hex_nodes, n_slabs_held)
        real(dp), intent(inout), target :: node_memory(3, n_stretched)
        real(dp), intent(inout), target :: node_past(3, n_layer_nodes)
        real(dp), intent(inout), target :: crossing_memory(3, 3, n_crossings)
        real(dp), intent(inout), target :: sums(n_sums, n_batch)
        real(dp), intent(inout) :: motion(n_batch, 3, n_receivers, n_steps)   !! [m/s]
        real(dp), intent(inout) :: energy(n_energies, n_batch, n_ledger)      !! [J], last one [-]
        integer, intent(out) :: info    !! steps done if all went well, else minus that number
        integer, intent(out) :: where   !! node of the largest velocity after a failure
        integer, intent(out) :: member    !! model of the batch in which it was
        !f2py threadsafe
        type(model_arrays) :: model
        type(model_state) :: state

        model%dt = dt
        model%local_damping = local_damping
        model%mesh = mesh_arrays( &
            domain_zone_start=domain_zone_start, domain_slot_start=domain_slot_start, &
            domain_set=domain_set, slot_node=slot_node, slot_place=slot_place, &
            zone_slot=zone_slot, zone_lambda=zone_lambda, zone_shear=zone_shear, &
            zone_row=zone_row, zone_patch=zone_patch)
        model%hexes = hex_arrays( &
            order=hex_order, n_mapped=n_mapped, hex_slope=hex_slope, hex_weight=hex_weight, &
            pack_node=pack_node, pack_set=pack_set, pack_metric=pack_metric, pack_brick=pack_brick)
        model%layer = layer_arrays( &
            n_slabs=n_slabs, slab_start=slab_start, slab_axis=slab_axis, &
            slab_stretch=slab_stretch, slab_lag=slab_lag, layer_frame=layer_frame, &
            layer_node=layer_node, layer_mass=layer_mass, stretch_start=stretch_start, &
            stretch_row=stretch_row, node_stretch=node_stretch, &
            crossing_part=crossing_part, crossing_stretch=crossing_stretch)
        model%edges = edge_arrays( &
            edge_start=edge_start, edge_slot=edge_slot, edge_spring=edge_spring, &
            skew_start=skew_start, skew_slot=skew_slot, skew_spring=skew_spring)
        model%patches = patch_arrays( &
            domain_patch_start=domain_patch_start, patch_start=patch_start, &
            patch_slot=patch_slot, patch_gradient=patch_gradient, patch_bulk=patch_bulk)
        model%ground = ground_arrays( &
            set_form=set_form, set_law=set_law, set_property=set_property, set_beta=set_beta, &
            set_branch=set_branch, row_initial=row_initial, memory_rate=memory_rate)
        model%nodes = node_arrays( &
            node_start=node_start, node_part=node_part, node_mass=node_mass, &
            node_alpha=node_alpha, node_load=node_load)
        model%contacts = contact_arrays( &
            contact_node=contact_node, contact_normal=contact_normal, contact_area=contact_area, &
            contact_joint=contact_joint, contact_initial=contact_initial, joint_law=joint_law, &
            joint_property=joint_property)
        model%loads = load_arrays( &
            load_node=load_node, load_vector=load_vector, load_history=load_history, &
            load_delay=load_delay, load_member=load_member, history=history)
        model%boundaries = boundary_arrays( &
            dashpot_node=dashpot_node, dashpot_impedance=dashpot_impedance, &
            dashpot_inverse=dashpot_inverse, fixed_node=fixed_node, &
            fixed_direction=fixed_direction, fixed_history=fixed_history)
        model%implicit = implicit_arrays( &
            cluster_start=cluster_start, implicit_node=implicit_node, column_start=column_start, &
            block_row=block_row, block_factor=block_factor, implicit_inverse=implicit_inverse, &
            implicit_inertia=implicit_inertia, implicit_drag=implicit_drag)
        model%receivers = receiver_arrays( &
            receiver_node=receiver_node, receiver_weight=receiver_weight)
        state%nodes = nodal_state(displacement=displacement, velocity=velocity, memory=memory)
        state%zones = zone_state(row_state=row_state, row_lost=row_lost, slab_memory=slab_memory)
        state%layer = layer_state( &
            node_memory=node_memory, node_past=node_past, crossing_memory=crossing_memory)
        state%joints = joint_state( &
            contact_traction=contact_traction, contact_state=contact_state, &
            contact_stored=contact_stored, contact_dissipated=contact_dissipated)
        state%sums => sums
        call integrate(model, state, first_step, ledger_every, motion, energy, info, where, member)
    end subroutine advance

    subroutine stored_at_rest(n_contacts, n_joints, contact_normal, contact_joint, joint_law, &
                              joint_property, contact_initial, contact_state, contact_stored)
        !! Energy that the contacts hold before anything moves.
        integer, intent(in) :: n_contacts, n_joints
        real(dp), intent(in), target :: contact_normal(3, n_contacts)
        integer, intent(in), target :: contact_joint(n_contacts), joint_law(n_batch, n_joints)
        real(dp), intent(in), target :: joint_property(n_joint_properties, n_batch, n_joints)
        real(dp), intent(in), target :: contact_initial(3, n_batch, n_contacts)
        real(dp), intent(in) :: contact_state(n_joint_state, n_batch, n_contacts)
        real(dp), intent(out) :: contact_stored(n_batch, n_contacts)           !! [J/m2]
        type(contact_arrays) :: contacts

        contacts%contact_normal => contact_normal
        contacts%contact_joint => contact_joint
        contacts%joint_law => joint_law
        contacts%joint_property => joint_property
        contacts%contact_initial => contact_initial
        call energy_at_rest(contacts, contact_state, contact_stored)
    end subroutine stored_at_rest

    subroutine zone_forces(n_nodes, n_corners, n_zones, n_domains, n_slots, n_edges, n_skews, &
                           n_patches, n_ends, n_sets, n_rows, n_memories, dt, domain_zone_start, &
                           domain_slot_start, domain_set, slot_node, slot_place, zone_slot, &
                           zone_lambda, zone_shear, zone_row, zone_patch, set_form, edge_start, &
                           edge_slot, edge_spring, skew_start, skew_slot, skew_spring, &
                           domain_patch_start, patch_start, patch_slot, patch_gradient, &
                           patch_bulk, set_law, set_property, set_beta, set_branch, row_initial, &
                           displacement, velocity, memory, row_state, row_lost, slot_force, &
                           strain_energy)
        !! Forces of all zones into the slots and the strain energy: of tests alone.
        integer, intent(in) :: n_nodes, n_corners, n_zones, n_domains, n_slots, n_edges, n_skews
        integer, intent(in) :: n_patches, n_ends, n_sets, n_rows, n_memories
        real(dp), intent(in) :: dt
        integer, intent(in), target :: domain_zone_start(n_domains + 1)
        integer, intent(in), target :: domain_slot_start(n_domains + 1), domain_set(n_domains)
        integer, intent(in), target :: slot_node(n_slots), zone_slot(n_zones, n_corners)
        real(dp), intent(in), target :: slot_place(3, n_slots), zone_lambda(n_zones)
        real(dp), intent(in), target :: zone_shear(n_zones)
        integer, intent(in), target :: zone_row(n_zones), zone_patch(n_zones), set_law(n_sets)
        integer, intent(in), target :: set_form(n_sets), edge_start(n_slots + 1), edge_slot(n_edges)
        integer, intent(in), target :: skew_start(n_domains + 1), skew_slot(2, n_skews)
        real(dp), intent(in), target :: edge_spring(6, n_edges), skew_spring(3, n_skews)
        integer, intent(in), target :: domain_patch_start(n_domains + 1), patch_start(n_patches + 1)
        integer, intent(in), target :: patch_slot(n_ends)
        real(dp), intent(in), target :: patch_gradient(3, n_ends), patch_bulk(n_patches)
        real(dp), intent(in), target :: set_property(n_zone_properties, n_batch, n_sets)
        real(dp), intent(in), target :: set_beta(n_batch, n_sets)
        real(dp), intent(in), target :: set_branch(n_batch, 2, n_memories, n_sets)
        real(dp), intent(in), target :: row_initial(6, n_batch, n_rows)
        real(dp), intent(inout), target :: displacement(n_batch, 3, n_nodes)
        real(dp), intent(inout), target :: velocity(n_batch, 3, n_nodes)
        real(dp), intent(inout), target :: memory(n_batch, 3, n_memories, n_nodes)
        real(dp), intent(inout), target :: row_state(n_zone_state, n_batch, n_rows)
        real(dp), intent(inout), target :: row_lost(n_batch, n_rows)
        real(dp), intent(inout) :: slot_force(n_batch, 3, n_slots)            !! [N]
        real(dp), intent(out) :: strain_energy(n_batch, n_domains)            !! [J]
        type(model_arrays) :: model
        type(nodal_state) :: nodes
        type(zone_state) :: zones
        type(domain_work) :: work

        model%dt = dt
        model%mesh = mesh_arrays( &
            domain_zone_start=domain_zone_start, domain_slot_start=domain_slot_start, &
            domain_set=domain_set, slot_node=slot_node, slot_place=slot_place, &
            zone_slot=zone_slot, zone_lambda=zone_lambda, zone_shear=zone_shear, &
            zone_row=zone_row, zone_patch=zone_patch)
        model%edges = edge_arrays( &
            edge_start=edge_start, edge_slot=edge_slot, edge_spring=edge_spring, &
            skew_start=skew_start, skew_slot=skew_slot, skew_spring=skew_spring)
        model%patches = patch_arrays( &
            domain_patch_start=domain_patch_start, patch_start=patch_start, &
            patch_slot=patch_slot, patch_gradient=patch_gradient, patch_bulk=patch_bulk)
        model%ground = ground_arrays( &
            set_form=set_form, set_law=set_law, set_property=set_property, set_beta=set_beta, &
            set_branch=set_branch, row_initial=row_initial, memory_rate=null())
        nodes = nodal_state(displacement=displacement, velocity=velocity, memory=memory)
        zones = zone_state(row_state=row_state, row_lost=row_lost, slab_memory=null())
        model%hexes%order = 0
        model%layer%n_slabs = 0
        call allocate_domain_work(model%mesh, model%hexes, work)
        call add_zone_forces(model, nodes, zones, .true., work, n_slots, slot_force)
        strain_energy = work%strain_energy
    end subroutine zone_forces

    subroutine load_forces(n_nodes, n_loads, n_histories, n_total, step, load_node, load_vector, &
                           load_history, load_delay, load_member, history, velocity, force, power)
        !! Forces of loads: of tests alone.
        integer, intent(in) :: n_nodes, n_loads, n_histories, n_total
        integer, intent(in) :: step                           !! from 1
        integer, intent(in), target :: load_node(n_loads), load_history(n_loads), load_member(n_loads)
        real(dp), intent(in), target :: load_vector(3, n_loads), load_delay(n_loads)
        real(dp), intent(in), target :: history(n_histories, n_total)
        real(dp), intent(in) :: velocity(n_batch, 3, n_nodes)
        real(dp), intent(inout) :: force(n_batch, 3, n_nodes)
        real(dp), intent(out) :: power(n_batch)               !! [W]
        real(dp) :: run_force(n_batch, 3, n_loads)

        call add_loads(load_arrays(load_node=load_node, load_vector=load_vector, &
                                   load_history=load_history, load_delay=load_delay, &
                                   load_member=load_member, history=history), &
                       load_runs(load_node), step, n_nodes, velocity, run_force, force, power)
    end subroutine load_forces

    subroutine viscous_forces(n_nodes, n_dashpots, dt, node_mass, node_alpha, dashpot_node, &
                              dashpot_impedance, dashpot_inverse, velocity, force, work_before, &
                              work_after)
        !! Forces of dashpots: of tests alone.
        integer, intent(in) :: n_nodes, n_dashpots
        real(dp), intent(in) :: dt
        real(dp), intent(in), target :: node_mass(n_batch, n_nodes), node_alpha(n_batch, n_nodes)
        integer, intent(in), target :: dashpot_node(n_dashpots)
        real(dp), intent(in), target :: dashpot_impedance(3, 3, n_dashpots)
        real(dp), intent(in), target :: dashpot_inverse(3, 3, n_batch, n_dashpots)
        real(dp), intent(in) :: velocity(n_batch, 3, n_nodes)
        real(dp), intent(inout) :: force(n_batch, 3, n_nodes)
        real(dp), intent(out) :: work_before(n_batch), work_after(n_batch)    !! [J]
        type(node_arrays) :: nodes
        type(boundary_arrays) :: boundaries

        nodes%node_mass => node_mass
        nodes%node_alpha => node_alpha
        boundaries%dashpot_node => dashpot_node
        boundaries%dashpot_impedance => dashpot_impedance
        boundaries%dashpot_inverse => dashpot_inverse
        call add_viscous(boundaries, nodes, dt, n_nodes, velocity, force, work_before, work_after)
    end subroutine viscous_forces

    subroutine reaction_forces(n_nodes, n_fixed, n_histories, dt, node_mass, node_alpha, &
                               fixed_node, fixed_direction, fixed_history, amplitude, velocity, &
                               force, work_before, work_after)
        !! Reactions of prescribed motion: of tests alone.
        integer, intent(in) :: n_nodes, n_fixed, n_histories
        real(dp), intent(in) :: dt
        real(dp), intent(in), target :: node_mass(n_batch, n_nodes), node_alpha(n_batch, n_nodes)
        integer, intent(in), target :: fixed_node(n_fixed), fixed_history(n_batch, n_fixed)
        real(dp), intent(in), target :: fixed_direction(3, n_fixed)
        real(dp), intent(in) :: amplitude(n_histories), velocity(n_batch, 3, n_nodes)
        real(dp), intent(inout) :: force(n_batch, 3, n_nodes)
        real(dp), intent(out) :: work_before(n_batch), work_after(n_batch)    !! [J]
        type(node_arrays) :: nodes
        type(boundary_arrays) :: boundaries

        nodes%node_mass => node_mass
        nodes%node_alpha => node_alpha
        boundaries%fixed_node => fixed_node
        boundaries%fixed_direction => fixed_direction
        boundaries%fixed_history => fixed_history
        call add_reactions(boundaries, nodes, dt, amplitude, n_nodes, velocity, force, &
                           work_before, work_after)
    end subroutine reaction_forces

    subroutine update_memory(n_nodes, n_memories, dt, memory_rate, displacement, velocity, memory)
        !! Memories after a step: of tests alone.
        integer, intent(in) :: n_nodes, n_memories
        real(dp), intent(in) :: dt, memory_rate(n_memories)
        real(dp), intent(inout), target :: displacement(n_batch, 3, n_nodes)
        real(dp), intent(inout), target :: velocity(n_batch, 3, n_nodes)
        real(dp), intent(inout), target :: memory(n_batch, 3, n_memories, n_nodes)
        type(nodal_state) :: nodes

        nodes = nodal_state(displacement=displacement, velocity=velocity, memory=memory)
        call follow(memory_rate, dt, nodes)
    end subroutine update_memory

    subroutine use_threads(count)
        !! Let runs from this thread take so many threads.
        integer, intent(in) :: count

        call omp_set_num_threads(count)
    end subroutine use_threads

    integer function n_threads()
        !! Number of threads that a run from this thread takes.
        n_threads = omp_get_max_threads()
    end function n_threads

end module pyblast_border
