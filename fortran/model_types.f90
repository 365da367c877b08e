module pyblast_model_types
    !! The arrays of a model and of its state, grouped by what they describe.
    !!
    !! A pointer component refers to memory that the caller owns: the border to Python associates
    !! the arrays of Python, the program pyblast-run those that it read. Indices count from 1.
    use pyblast_kinds, only : dp, hex_width
    use pyblast_batch, only : n_batch
    implicit none
    private
    public :: allocate_domain_work, n_clusters, n_zone_packs, n_zone_parts

    type, public :: mesh_arrays
        !! Zones, and the domains that hold them: neighbouring zones of one set with slots for the
        !! forces on their nodes.
        integer, contiguous, pointer :: domain_zone_start(:)     !! (n_domains + 1)
        integer, contiguous, pointer :: domain_slot_start(:)     !! (n_domains + 1)
        integer, contiguous, pointer :: domain_set(:)            !! law and damping (n_domains)
        integer, contiguous, pointer :: slot_node(:)             !! (n_slots)
        real(dp), contiguous, pointer :: slot_place(:, :)        !! from a point of the domain
                                                                 !! (3, n_slots) [m]
        integer, contiguous, pointer :: zone_slot(:, :)          !! within the domain
                                                                 !! (n_zones, 4 or 15)
        real(dp), contiguous, pointer :: zone_lambda(:)          !! first Lame modulus [Pa]
        real(dp), contiguous, pointer :: zone_shear(:)           !! shear modulus [Pa]
        integer, contiguous, pointer :: zone_row(:)              !! its memory; 0 has none
        integer, contiguous, pointer :: zone_patch(:)            !! shares its mean strain; or 0
    end type mesh_arrays

    type, public :: hex_arrays
        !! Spectral hexahedra in packs: zones of one set and form that are computed together. A model
        !! has either hexahedra or the tetrahedra of `mesh_arrays`. A pack that is not full repeats
        !! a zone without stiffness. Source: theory.md (2.44) to (2.47).
        integer :: order                                         !! of the polynomials; 0: none
        integer :: n_mapped                                      !! packs of mapped zones, the first
        real(dp), contiguous, pointer :: hex_slope(:, :)         !! of function j at node i
                                                                 !! (order + 1, order + 1)
        real(dp), contiguous, pointer :: hex_weight(:)           !! of the quadrature (order + 1)
        integer, contiguous, pointer :: pack_node(:, :, :)       !! (hex_width, (order + 1)^3,
                                                                 !! n_packs)
        integer, contiguous, pointer :: pack_set(:)              !! law and damping (n_packs)
        real(dp), contiguous, pointer :: pack_metric(:, :, :, :)
            !! of mapped zones: q d(reference)/dx, Lame moduli over q, where q is the volume of the
            !! node (hex_width, 11, (order + 1)^3, n_mapped); of quadratic tetrahedra: slopes of three
            !! axes [1/m], minus the Lame moduli times the volume [J] (hex_width, 11, 1, n_packs)
        real(dp), contiguous, pointer :: pack_brick(:, :, :)
            !! of bricks: d(reference)/dx of the axes [1/m], Lame moduli times an eighth of the
            !! volume [J] (hex_width, 5, n_packs - n_mapped)
    end type hex_arrays

    type, public :: layer_arrays
        !! Absorbing layer of hexahedra: stretches along up to three axes, as five numbers each: kappa,
        !! d [1/s], z [s], b, 1/(kappa + d z). A slab is a pack that is stretched along one axis; a pack at an edge of
        !! the model has two slabs, at a corner three. Source: theory.md (4.14) to (4.18).
        integer :: n_slabs                                       !! 0: no layer
        integer, contiguous, pointer :: slab_start(:)            !! of each pack (n_packs + 1)
        integer, contiguous, pointer :: slab_axis(:)             !! (n_slabs)
        real(dp), contiguous, pointer :: slab_stretch(:, :, :, :)
            !! at the nodes along the axis, which is that of the reference zone, too
            !! (hex_width, 5, order + 1, n_slabs)
        real(dp), contiguous, pointer :: slab_lag(:, :)          !! of the viscosity of zones
                                                                 !! (hex_width, n_slabs) [s]
        real(dp), contiguous, pointer :: layer_frame(:, :)       !! unit vectors of the axes (3, 3)
        integer, contiguous, pointer :: layer_node(:)            !! (n_layer_nodes)
        real(dp), contiguous, pointer :: layer_mass(:)           !! without stretch [kg]
        integer, contiguous, pointer :: stretch_start(:)         !! of each node (n_layer_nodes + 1)
        integer, contiguous, pointer :: stretch_row(:)           !! of nodes along axes (n_stretched)
        real(dp), contiguous, pointer :: node_stretch(:, :)      !! that differ (5, n_stretches)
        integer, contiguous, pointer :: crossing_part(:)         !! contacts in the layer (n_crossings)
        real(dp), contiguous, pointer :: crossing_stretch(:, :, :)
            !! (5, 3 axes, n_crossings)
    end type layer_arrays

    type, public :: edge_arrays
        !! Springs along edges that stand for linear zones; theory.md (2.39), (2.40).
        integer, contiguous, pointer :: edge_start(:)            !! (n_slots + 1)
        integer, contiguous, pointer :: edge_slot(:)             !! other end (n_edges)
        real(dp), contiguous, pointer :: edge_spring(:, :)       !! (6, n_edges) [N/m]
        integer, contiguous, pointer :: skew_start(:)            !! (n_domains + 1)
        integer, contiguous, pointer :: skew_slot(:, :)          !! both ends (2, n_skews)
        real(dp), contiguous, pointer :: skew_spring(:, :)       !! (3, n_skews) [N/m]
    end type edge_arrays

    type, public :: patch_arrays
        !! Zones that share their mean strain; theory.md (2.41).
        integer, contiguous, pointer :: domain_patch_start(:)    !! (n_domains + 1)
        integer, contiguous, pointer :: patch_start(:)           !! (n_patches + 1)
        integer, contiguous, pointer :: patch_slot(:)            !! within the domain (n_ends)
        real(dp), contiguous, pointer :: patch_gradient(:, :)    !! dilatation over motion
                                                                 !! (3, n_ends) [1/m]
        real(dp), contiguous, pointer :: patch_bulk(:)           !! bulk modulus times volume [J]
    end type patch_arrays

    type, public :: ground_arrays
        !! Laws and damping of the sets of zones, initial stress of zones with memory.
        integer, contiguous, pointer :: set_form(:)              !! 1 zones, 2 edges in batches,
                                                                 !! 3 edges (n_sets)
        integer, contiguous, pointer :: set_law(:)               !! (n_sets)
        real(dp), contiguous, pointer :: set_property(:, :, :)
            !! (n_zone_properties, n_batch, n_sets)
        real(dp), contiguous, pointer :: set_beta(:, :)          !! stiffness damping
                                                                 !! (n_batch, n_sets) [s]
        real(dp), contiguous, pointer :: set_branch(:, :, :, :)
            !! springs that relax, over those that stay: of shear, of compression
            !! (n_batch, 2, n_memories, n_sets)
        real(dp), contiguous, pointer :: row_initial(:, :, :)
            !! stress at no strain (6, n_batch, n_rows) [Pa]
        real(dp), contiguous, pointer :: memory_rate(:)          !! 0 is none (n_memories) [1/s]
    end type ground_arrays

    type, public :: node_arrays
        !! Nodes, and the parts that their force is summed from: slots, then sides of contacts.
        integer, contiguous, pointer :: node_start(:)            !! (n_nodes + 1)
        integer, contiguous, pointer :: node_part(:)             !! (n_parts)
        real(dp), contiguous, pointer :: node_mass(:, :)         !! (n_batch, n_nodes) [kg]
        real(dp), contiguous, pointer :: node_alpha(:, :)        !! mass damping
                                                                 !! (n_batch, n_nodes) [1/s]
        real(dp), contiguous, pointer :: node_load(:, :, :)      !! constant load
                                                                 !! (n_batch, 3, n_nodes) [N]
    end type node_arrays

    type, public :: contact_arrays
        !! Pairs of nodes across joints, and the laws of the joints.
        integer, contiguous, pointer :: contact_node(:, :)       !! minus, plus (2, n_contacts)
        real(dp), contiguous, pointer :: contact_normal(:, :)    !! unit, from minus to plus
                                                                 !! (3, n_contacts)
        real(dp), contiguous, pointer :: contact_area(:)         !! (n_contacts) [m2]
        integer, contiguous, pointer :: contact_joint(:)         !! (n_contacts)
        real(dp), contiguous, pointer :: contact_initial(:, :, :)
            !! traction at no jump (3, n_batch, n_contacts) [Pa]
        integer, contiguous, pointer :: joint_law(:, :)          !! (n_batch, n_joints)
        real(dp), contiguous, pointer :: joint_property(:, :, :)
            !! (n_joint_properties, n_batch, n_joints)
    end type contact_arrays

    type, public :: load_arrays
        !! Nodal loads: a vector times the delayed amplitude of a history.
        integer, contiguous, pointer :: load_node(:)             !! (n_loads)
        real(dp), contiguous, pointer :: load_vector(:, :)       !! force per unit of the history
                                                                 !! (3, n_loads)
        integer, contiguous, pointer :: load_history(:)          !! (n_loads)
        real(dp), contiguous, pointer :: load_delay(:)           !! steps behind its history
        integer, contiguous, pointer :: load_member(:)             !! model of the batch; 0 is all
        real(dp), contiguous, pointer :: history(:, :)           !! amplitude at each step
                                                                 !! (n_histories, n_total)
    end type load_arrays

    type, public :: boundary_arrays
        !! Viscous boundaries and nodes of prescribed motion.
        integer, contiguous, pointer :: dashpot_node(:)          !! (n_dashpots)
        real(dp), contiguous, pointer :: dashpot_impedance(:, :, :)
            !! Z, the sum of area*rho*c (3, 3, n_dashpots) [N s/m]
        real(dp), contiguous, pointer :: dashpot_inverse(:, :, :, :)
            !! inverse of m (1 + alpha dt/2) I + Z dt/2 (3, 3, n_batch, n_dashpots) [1/kg]
        integer, contiguous, pointer :: fixed_node(:)            !! (n_fixed)
        real(dp), contiguous, pointer :: fixed_direction(:, :)   !! unit (3, n_fixed)
        integer, contiguous, pointer :: fixed_history(:, :)      !! 0 is at rest
                                                                 !! (n_batch, n_fixed)
    end type boundary_arrays

    type, public :: implicit_arrays
        !! Implicit zones: nodes cluster by cluster, and the factors of their matrix; theory.md (2.53).
        integer, contiguous, pointer :: cluster_start(:)         !! (n_clusters + 1); one node: none
        integer, contiguous, pointer :: implicit_node(:)         !! (n_implicit)
        integer, contiguous, pointer :: column_start(:)          !! blocks of L (n_implicit + 1)
        integer, contiguous, pointer :: block_row(:)             !! below the diagonal (n_blocks)
        real(dp), contiguous, pointer :: block_factor(:, :, :)   !! of L, column by column
                                                                 !! (n_batch, 9, n_blocks)
        real(dp), contiguous, pointer :: implicit_inverse(:, :, :)
            !! of B, xx yy zz yz zx xy (n_batch, 6, n_implicit) [1/kg]
        real(dp), contiguous, pointer :: implicit_inertia(:, :, :)
            !! D = m (1 + alpha dt/2) I + Z dt/2 (n_batch, 6, n_implicit) [kg]
        real(dp), contiguous, pointer :: implicit_drag(:, :, :)
            !! R = m alpha I + Z (n_batch, 6, n_implicit) [N s/m]
    end type implicit_arrays

    type, public :: receiver_arrays
        !! Points inside zones whose motion is recorded.
        integer, contiguous, pointer :: receiver_node(:, :)      !! (n_corners, n_receivers)
        real(dp), contiguous, pointer :: receiver_weight(:, :)   !! shape functions, sum of 1
                                                                 !! (n_corners, n_receivers)
    end type receiver_arrays

    type, public :: model_arrays
        !! All that is fixed during a run.
        real(dp) :: dt                                           !! time step [s]
        real(dp) :: local_damping                                !! share of the force; 0 in dynamics
        type(mesh_arrays) :: mesh
        type(hex_arrays) :: hexes
        type(layer_arrays) :: layer
        type(edge_arrays) :: edges
        type(patch_arrays) :: patches
        type(ground_arrays) :: ground
        type(node_arrays) :: nodes
        type(contact_arrays) :: contacts
        type(load_arrays) :: loads
        type(boundary_arrays) :: boundaries
        type(implicit_arrays) :: implicit
        type(receiver_arrays) :: receivers
    end type model_arrays

    type, public :: nodal_state
        !! Motion of the nodes.
        real(dp), contiguous, pointer :: displacement(:, :, :)   !! (n_batch, 3, n_nodes) [m]
        real(dp), contiguous, pointer :: velocity(:, :, :)       !! half a step earlier [m/s]
        real(dp), contiguous, pointer :: memory(:, :, :, :)      !! displacement that lags behind
                                                                 !! (n_batch, 3, n_memories, n_nodes)
    end type nodal_state

    type, public :: zone_state
        !! Memory of zones.
        real(dp), contiguous, pointer :: row_state(:, :, :)      !! (n_zone_state, n_batch, n_rows)
        real(dp), contiguous, pointer :: row_lost(:, :)          !! dissipated so far
                                                                 !! (n_batch, n_rows) [J/m3]
        real(dp), contiguous, pointer :: slab_memory(:, :, :, :)
            !! of the absorbing layer (hex_width, 10, (order + 1)^3, n_slabs)
    end type zone_state

    type, public :: joint_state
        !! Tractions and memory of contacts.
        real(dp), contiguous, pointer :: contact_traction(:, :, :)
            !! (3, n_batch, n_contacts) [Pa]
        real(dp), contiguous, pointer :: contact_state(:, :, :)
            !! (n_joint_state, n_batch, n_contacts)
        real(dp), contiguous, pointer :: contact_stored(:, :)    !! (n_batch, n_contacts) [J/m2]
        real(dp), contiguous, pointer :: contact_dissipated(:, :)  !! (n_batch, n_contacts) [J/m2]
    end type joint_state

    type, public :: layer_state
        !! Memory of the absorbing layer.
        real(dp), contiguous, pointer :: node_memory(:, :)       !! (3, n_stretched)
        real(dp), contiguous, pointer :: node_past(:, :)         !! force of the past of nodes in the
                                                                 !! next step (3, n_layer_nodes) [N]
        real(dp), contiguous, pointer :: crossing_memory(:, :, :)  !! (3, 3 axes, n_crossings)
    end type layer_state

    type, public :: model_state
        !! All that a step changes.
        type(nodal_state) :: nodes
        type(zone_state) :: zones
        type(joint_state) :: joints
        type(layer_state) :: layer
        real(dp), contiguous, pointer :: sums(:, :)              !! running sums of the energy
                                                                 !! balance (n_sums, n_batch)
    end type model_state

    type, public :: run_arrays
        !! How far a model is integrated, and what is recorded.
        integer :: schema, n_steps
        integer :: fingerprint                                   !! of the model, given back in the result
        integer :: ledger_every                                  !! steps between lines of energies
        real(dp), contiguous, pointer :: motion(:, :, :, :)
            !! (n_batch, 3, n_receivers, n_steps) [m/s]
        real(dp), contiguous, pointer :: receiver_motion(:, :, :) => null()
            !! of injected sources, added to what is recorded (3, n_receivers, n_steps) [m/s]
        real(dp), contiguous, pointer :: energy(:, :, :)         !! (n_energies, n_batch, n_lines) [J]
    end type run_arrays

    type, public :: domain_range
        !! One domain: its number, its set, and the zones and slots that it holds.
        integer :: number, set, first_zone, last_zone, first_slot, last_slot, n_slots
        integer :: first_pack                                    !! of quadratic zones
    end type domain_range

    type, public :: domain_work
        !! What domains keep between the steps of one call.
        real(dp), allocatable :: displacement_at_check(:, :, :)
            !! motion when zones were last checked for yielding (n_batch, 3, n_slots) [m]
        real(dp), allocatable :: yield_margin(:, :)
            !! how far nodes may move from it before zones are checked anew; -1 at first
            !! (n_batch, n_domains) [m]
        real(dp), allocatable :: strain_energy(:, :)             !! (n_batch, n_domains) [J]
        real(dp), allocatable :: plastic_work(:, :)              !! (n_batch, n_domains) [J]
        real(dp), allocatable :: insitu_work(:, :)               !! work of the initial stress [J]
        integer, allocatable :: first_pack(:)                    !! (n_domains + 1)
    end type domain_work

    type, public :: implicit_work
        !! What implicit zones need within a step.
        real(dp), allocatable :: solution(:, :, :)
            !! acceleration, then the velocity before the step (n_batch, 3, n_implicit)
        real(dp), allocatable :: cluster_energy(:, :)            !! (n_batch, n_clusters) [J]
        integer, allocatable :: layer_place(:)
            !! number of each node among those of the absorbing layer, 0: none (n_implicit)
    end type implicit_work

    type, public :: nodal_work
        !! Forces of a step, and the sums of energy over blocks of nodes.
        real(dp), allocatable :: force(:, :, :)                  !! (n_batch, 3, n_nodes) [N]
        real(dp), allocatable :: zone_force(:, :, :)             !! of zones alone, if damped [N]
        real(dp), allocatable :: part_force(:, :, :)             !! (n_batch, 3, n_parts) [N]
        real(dp), allocatable :: block_energy(:, :, :)           !! (n_batch, 5, n_blocks) [J]
        real(dp), allocatable :: block_power(:, :)               !! (n_batch, n_blocks) [W]
        integer, allocatable :: layer_start(:)                   !! first node of the absorbing layer in
                                                                 !! each block of nodes (n_blocks + 1)
        integer, allocatable :: load_start(:)                    !! of runs of loads on one node
                                                                 !! (n_runs + 1)
        real(dp), allocatable :: load_force(:, :, :)             !! (n_batch, 3, n_runs) [N]
        real(dp), allocatable :: step_over_mass(:, :, :)         !! dt/m of each component
                                                                 !! (n_batch, 3, n_nodes) [s/kg]
        type(implicit_work) :: implicit
    end type nodal_work

contains

    pure function n_zone_parts(model) result(n_parts)
        !! Parts of the nodal forces that come from zones: slots, or nodes of packs.
        type(model_arrays), intent(in) :: model
        integer :: n_parts

        n_parts = size(model%mesh%slot_node)
        if (model%hexes%order > 0) n_parts = size(model%hexes%pack_node)
    end function n_zone_parts

    pure function n_clusters(zones) result(n)
        !! Clusters of implicit zones.
        type(implicit_arrays), intent(in) :: zones
        integer :: n

        n = size(zones%cluster_start) - 1
    end function n_clusters

    pure function n_zone_packs(mesh, d) result(n_packs)
        !! Packs of hex_width that the zones of domain d fill, the last in part.
        type(mesh_arrays), intent(in) :: mesh
        integer, intent(in) :: d
        integer :: n_packs

        n_packs = (mesh%domain_zone_start(d + 1) - mesh%domain_zone_start(d) + hex_width - 1)/hex_width
    end function n_zone_packs

    pure subroutine allocate_domain_work(mesh, hexes, work)
        !! Allocate the work of domains or packs before the first check of any zone.
        type(mesh_arrays), intent(in) :: mesh
        type(hex_arrays), intent(in) :: hexes
        type(domain_work), intent(out) :: work
        integer :: d, n_domains

        n_domains = size(mesh%domain_set)
        allocate (work%first_pack(n_domains + 1))
        work%first_pack(1) = 1
        do d = 1, n_domains
            work%first_pack(d + 1) = work%first_pack(d) + n_zone_packs(mesh, d)
        end do
        if (hexes%order > 0) n_domains = size(hexes%pack_set)
        allocate (work%displacement_at_check(n_batch, 3, size(mesh%slot_node)))
        allocate (work%yield_margin(n_batch, n_domains), work%strain_energy(n_batch, n_domains))
        allocate (work%plastic_work(n_batch, n_domains), work%insitu_work(n_batch, n_domains))
        work%yield_margin = -1.0_dp
        work%strain_energy = 0.0_dp
        work%plastic_work = 0.0_dp
        work%insitu_work = 0.0_dp
    end subroutine allocate_domain_work

end module pyblast_model_types
