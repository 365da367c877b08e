module pyblast_internal_forces
    !! Nodal forces of the zones, domain by domain.
    !!
    !! A domain is at most a fixed number of neighbouring zones of one set: one law, one damping. It
    !! adds the forces of its zones into slots of its own, one for each of its nodes, so that no sum
    !! depends on the number of threads.
    use pyblast_kinds, only : dp, least_shared, n_tet15
    use pyblast_batch, only : n_batch
    use pyblast_model_types, only : domain_range, domain_work, mesh_arrays, model_arrays, &
        nodal_state, zone_state
    use pyblast_tet4, only : tet4_energy, tet4_forces
    use pyblast_tet4_batch, only : tet4_batch_forces
    use pyblast_tet4_general, only : tet4_general_forces
    use pyblast_tet4_plastic, only : patch_forces, plastic_forces
    use pyblast_tet15, only : tet15_energy, tet15_forces
    use pyblast_edge_springs, only : edge_forces
    use pyblast_hex_forces, only : hex_zone_forces
    use pyblast_zone_laws, only : has_memory, isotropic_law
    implicit none
    private
    public :: zone_forces

contains

    subroutine zone_forces(model, nodes, zones, with_energy, work, n_slots, slot_force)
        !! Forces of all zones into the slots, and the energies of each domain.
        !! Source: theory.md (2.1) to (2.4), (2.14), (2.41) to (2.43).
        type(model_arrays), intent(in) :: model
        type(nodal_state), intent(in) :: nodes
        type(zone_state), intent(inout) :: zones
        logical, intent(in) :: with_energy                          !! whether energies are wanted
        type(domain_work), intent(inout) :: work
        integer, intent(in) :: n_slots
        real(dp), intent(inout) :: slot_force(n_batch, 3, n_slots)  !! [N]
        type(domain_range) :: domain
        integer :: d, n_nodes

        if (model%hexes%order > 0) then
            call hex_zone_forces(model, nodes, zones, with_energy, work, n_slots, slot_force)
            return
        end if
        n_nodes = size(nodes%velocity, 3)
        !$omp parallel do schedule(dynamic) default(none) private(domain) &
        !$omp& shared(model, nodes, zones, with_energy, work, slot_force) &
        !$omp& if (n_batch*n_nodes >= least_shared)
        do d = 1, size(model%mesh%domain_set)
            domain = range_of_domain(model%mesh, d)
            domain%first_pack = work%first_pack(d)
            call domain_forces(model, domain, domain%n_slots, nodes, zones, with_energy, work, &
                               slot_force(:, :, domain%first_slot:domain%last_slot))
        end do
        !$omp end parallel do
    end subroutine zone_forces

    pure function range_of_domain(mesh, d) result(domain)
        !! The zones and slots of domain d.
        type(mesh_arrays), intent(in) :: mesh
        integer, intent(in) :: d
        type(domain_range) :: domain

        domain%number = d
        domain%set = mesh%domain_set(d)
        domain%first_zone = mesh%domain_zone_start(d)
        domain%last_zone = mesh%domain_zone_start(d + 1) - 1
        domain%first_slot = mesh%domain_slot_start(d)
        domain%last_slot = mesh%domain_slot_start(d + 1) - 1
        domain%n_slots = domain%last_slot - domain%first_slot + 1
        domain%first_pack = 1
    end function range_of_domain

    pure subroutine domain_forces(model, domain, n_slots, nodes, zones, with_energy, work, force)
        !! Forces of the zones of one domain; arguments as in zone_forces.
        type(model_arrays), intent(in) :: model
        type(domain_range), intent(in) :: domain
        integer, intent(in) :: n_slots
        type(nodal_state), intent(in) :: nodes
        type(zone_state), intent(inout) :: zones
        logical, intent(in) :: with_energy
        type(domain_work), intent(inout) :: work
        real(dp), intent(inout) :: force(n_batch, 3, n_slots)
        real(dp) :: u(n_batch, 3, n_slots), lag(n_batch, 3, n_slots, 2)
        logical :: by_edges, damped, same_field

        associate (mesh => model%mesh, ground => model%ground, set => domain%set, &
                   law => model%ground%set_law(domain%set), n_nodes => size(nodes%velocity, 3), &
                   n_memories => size(nodes%memory, 3), s1 => domain%first_slot, &
                   s2 => domain%last_slot)
            by_edges = ground%set_form(set) >= merge(2, 3, n_batch > 1)
            damped = any(ground%set_beta(:, set) > 0.0_dp) &
                .or. any(ground%set_branch(:, :, :, set) > 0.0_dp)
            same_field = has_memory(law) .or. .not. any( &
                abs(ground%set_branch(:, 1, :, set) - ground%set_branch(:, 2, :, set)) > 0.0_dp)
            call gather(n_nodes, n_slots, mesh%slot_node(s1:s2), nodes%displacement, u)
            if (damped) call damping_lag(n_nodes, n_slots, n_memories, mesh%slot_node(s1:s2), &
                                         ground%set_beta(:, set), ground%set_branch(:, :, :, set), &
                                         u, nodes%velocity, nodes%memory, lag)
            force = 0.0_dp
            if (has_memory(law)) then
                call plastic_forces(model, domain, n_slots, with_energy, nodes%velocity, u, zones, &
                                    work, force)
            else if (law /= isotropic_law .and. (with_energy .or. .not. by_edges)) then
                call general_forces(model, domain, n_slots, by_edges, damped, u, lag(:, :, :, 1), &
                                    work, force)
                if (.not. by_edges) return
            end if
            if (damped) then
                lag(:, :, :, 1) = lag(:, :, :, 1) + u
                if (.not. same_field) lag(:, :, :, 2) = lag(:, :, :, 2) + u
                call linear_forces(model, domain, n_slots, by_edges, lag(:, :, :, 1), &
                                   lag(:, :, :, 2), same_field, force)
            else
                call linear_forces(model, domain, n_slots, by_edges, u, u, .true., force)
            end if
            if (with_energy .and. law == isotropic_law) &
                call stored_energy(model, domain, n_slots, nodes, u, work%strain_energy)
        end associate
    end subroutine domain_forces

    pure subroutine linear_forces(model, domain, n_slots, by_edges, deviatoric, volumetric, &
                                  same_field, force)
        !! Add the forces of isotropic linear zones and of their patches; as elastic_forces.
        type(model_arrays), intent(in) :: model
        type(domain_range), intent(in) :: domain
        integer, intent(in) :: n_slots
        logical, intent(in) :: by_edges, same_field
        real(dp), intent(in) :: deviatoric(n_batch, 3, n_slots), volumetric(n_batch, 3, n_slots)
        real(dp), intent(inout) :: force(n_batch, 3, n_slots)      !! [N]

        associate (patches => model%patches)
            call elastic_forces(model, domain, n_slots, by_edges, deviatoric, volumetric, &
                                same_field, force)
            call patch_forces(n_slots, size(patches%patch_bulk), size(patches%patch_slot), &
                              patches%domain_patch_start(domain%number), &
                              patches%domain_patch_start(domain%number + 1) - 1, &
                              patches%patch_start, patches%patch_slot, patches%patch_gradient, &
                              patches%patch_bulk, deviatoric, force)
        end associate
    end subroutine linear_forces

    pure subroutine gather(n_nodes, n_slots, slot_node, displacement, u)
        !! Displacement of the nodes of a domain.
        integer, intent(in) :: n_nodes, n_slots, slot_node(n_slots)
        real(dp), intent(in) :: displacement(n_batch, 3, n_nodes)   !! [m]
        real(dp), intent(out) :: u(n_batch, 3, n_slots)             !! [m]
        integer :: s

        do s = 1, n_slots
            u(:, :, s) = displacement(:, :, slot_node(s))
        end do
    end subroutine gather

    pure subroutine damping_lag(n_nodes, n_slots, n_memories, slot_node, beta, branch, u, &
                                velocity, memory, lag)
        !! What damping and memory add to the motion that shear and compression see; (2.14).
        integer, intent(in) :: n_nodes, n_slots, n_memories, slot_node(n_slots)
        real(dp), intent(in) :: beta(n_batch), branch(n_batch, 2, n_memories)
        real(dp), intent(in) :: u(n_batch, 3, n_slots), velocity(n_batch, 3, n_nodes)
        real(dp), intent(in) :: memory(n_batch, 3, n_memories, n_nodes)
        real(dp), intent(out) :: lag(n_batch, 3, n_slots, 2)
        real(dp) :: deviatoric(n_batch, 3), volumetric(n_batch, 3), behind(n_batch)
        integer :: s, k, n, i, used

        used = merge(n_memories, 0, any(branch > 0.0_dp))
        do s = 1, n_slots
            n = slot_node(s)
            do i = 1, 3
                deviatoric(:, i) = beta*velocity(:, i, n)
            end do
            volumetric = deviatoric
            do k = 1, used
                do i = 1, 3
                    behind = u(:, i, s) - memory(:, i, k, n)
                    deviatoric(:, i) = deviatoric(:, i) + branch(:, 1, k)*behind
                    volumetric(:, i) = volumetric(:, i) + branch(:, 2, k)*behind
                end do
            end do
            lag(:, :, s, 1) = deviatoric
            lag(:, :, s, 2) = volumetric
        end do
    end subroutine damping_lag

    pure subroutine general_forces(model, domain, n_slots, by_edges, damped, u, lag, work, force)
        !! Forces of zones of a linear law that is not isotropic, or by edges their energy alone.
        type(model_arrays), intent(in) :: model
        type(domain_range), intent(in) :: domain
        integer, intent(in) :: n_slots
        logical, intent(in) :: by_edges, damped
        real(dp), intent(in) :: u(n_batch, 3, n_slots), lag(n_batch, 3, n_slots)   !! [m]
        type(domain_work), intent(inout) :: work
        real(dp), intent(inout) :: force(n_batch, 3, n_slots)                      !! [N]
        real(dp) :: own(3, n_slots)
        integer :: m

        associate (mesh => model%mesh, ground => model%ground)
            do m = 1, n_batch
                own = 0.0_dp
                call tet4_general_forces(size(mesh%zone_lambda), n_slots, domain%first_zone, &
                                         domain%last_zone, ground%set_law(domain%set), &
                                         ground%set_property(:, m, domain%set), mesh%zone_slot, &
                                         mesh%zone_lambda, mesh%zone_shear, &
                                         mesh%slot_place(:, domain%first_slot:domain%last_slot), &
                                         u(m, :, :), damped, lag(m, :, :), own, &
                                         work%strain_energy(m, domain%number))
                if (.not. by_edges) force(m, :, :) = own
            end do
        end associate
    end subroutine general_forces

    pure subroutine elastic_forces(model, domain, n_slots, by_edges, deviatoric, volumetric, &
                                   same_field, force)
        !! Add the forces of isotropic linear zones, by edges or by zones; zones of a patch leave
        !! their mean stress to it.
        type(model_arrays), intent(in) :: model
        type(domain_range), intent(in) :: domain
        integer, intent(in) :: n_slots
        logical, intent(in) :: by_edges, same_field
        real(dp), intent(in) :: deviatoric(n_batch, 3, n_slots)    !! [m]
        real(dp), intent(in) :: volumetric(n_batch, 3, n_slots)    !! [m]
        real(dp), intent(inout) :: force(n_batch, 3, n_slots)      !! [N]
        real(dp) :: lambda(domain%first_zone:domain%last_zone)

        associate (mesh => model%mesh, edges => model%edges, d => domain%number, &
                   first => domain%first_zone, last => domain%last_zone, &
                   position => model%mesh%slot_place(:, domain%first_slot:domain%last_slot), &
                   n_corners => size(model%mesh%zone_slot, 2))
            if (n_corners == n_tet15) then
                call quadratic_forces(model, domain, n_slots, deviatoric, volumetric, same_field, &
                                      force)
            else if (by_edges) then
                call edge_forces(n_slots, size(edges%edge_slot), size(edges%skew_slot, 2), &
                                 edges%edge_start(domain%first_slot:domain%last_slot + 1), &
                                 edges%edge_slot, edges%edge_spring, edges%skew_start(d), &
                                 edges%skew_start(d + 1) - 1, edges%skew_slot, edges%skew_spring, &
                                 deviatoric, force)
            else if (has_memory(model%ground%set_law(domain%set))) then
                lambda = merge(-2.0_dp/3.0_dp*mesh%zone_shear(first:last), &
                               mesh%zone_lambda(first:last), mesh%zone_patch(first:last) > 0)
                call element_forces(size(lambda), n_slots, 1, size(lambda), &
                                    mesh%zone_slot(first:last, :), lambda, &
                                    mesh%zone_shear(first:last), position, deviatoric, volumetric, &
                                    same_field, force)
            else
                call element_forces(size(mesh%zone_lambda), n_slots, first, last, &
                                    mesh%zone_slot, mesh%zone_lambda, mesh%zone_shear, position, &
                                    deviatoric, volumetric, same_field, force)
            end if
        end associate
    end subroutine elastic_forces

    pure subroutine quadratic_forces(model, domain, n_slots, deviatoric, volumetric, same_field, &
                                     force)
        !! Add the forces of quadratic zones; arguments as in elastic_forces.
        type(model_arrays), intent(in) :: model
        type(domain_range), intent(in) :: domain
        integer, intent(in) :: n_slots
        logical, intent(in) :: same_field
        real(dp), intent(in) :: deviatoric(n_batch, 3, n_slots), volumetric(n_batch, 3, n_slots)
        real(dp), intent(inout) :: force(n_batch, 3, n_slots)      !! [N]
        real(dp) :: own(3, n_slots)
        integer :: m, n_packs

        associate (mesh => model%mesh, n_zones => size(model%mesh%zone_lambda), &
                   metric => model%hexes%pack_metric(:, :, 1, domain%first_pack:))
            n_packs = size(metric, 3)
            if (n_batch == 1) then
                call tet15_forces(n_zones, n_slots, n_packs, domain%first_zone, domain%last_zone, &
                                  mesh%zone_slot, metric, deviatoric, volumetric, same_field, force)
            else
                do m = 1, n_batch
                    own = 0.0_dp
                    call tet15_forces(n_zones, n_slots, n_packs, domain%first_zone, &
                                      domain%last_zone, mesh%zone_slot, metric, &
                                      deviatoric(m, :, :), volumetric(m, :, :), same_field, own)
                    force(m, :, :) = own
                end do
            end if
        end associate
    end subroutine quadratic_forces

    pure subroutine element_forces(n_zones, n_slots, first, last, zone_slot, &
                                   zone_lambda, zone_shear, position, deviatoric, volumetric, &
                                   same_field, force)
        !! Add the forces of zones first to last by the routine of their element.
        integer, intent(in) :: n_zones, n_slots, first, last, zone_slot(n_zones, 4)
        real(dp), intent(in) :: zone_lambda(n_zones), zone_shear(n_zones), position(3, n_slots)
        real(dp), intent(in) :: deviatoric(n_batch, 3, n_slots), volumetric(n_batch, 3, n_slots)
        logical, intent(in) :: same_field
        real(dp), intent(inout) :: force(n_batch, 3, n_slots)

        if (n_batch == 1) then
            call tet4_forces(n_zones, n_slots, first, last, zone_slot, zone_lambda, zone_shear, &
                             position, deviatoric, volumetric, same_field, force)
        else
            call tet4_batch_forces(n_zones, n_slots, first, last, zone_slot, zone_lambda, &
                                   zone_shear, position, deviatoric, volumetric, same_field, force)
        end if
    end subroutine element_forces

    pure subroutine stored_energy(model, domain, n_slots, nodes, u, energy)
        !! Energy that linear zones hold in springs that stay and in those that relax; (2.17).
        type(model_arrays), intent(in) :: model
        type(domain_range), intent(in) :: domain
        integer, intent(in) :: n_slots
        type(nodal_state), intent(in) :: nodes
        real(dp), intent(in) :: u(n_batch, 3, n_slots)
        real(dp), intent(inout) :: energy(:, :)        !! (n_batch, n_domains) [J]
        integer :: m, k

        associate (branch => model%ground%set_branch(:, :, :, domain%set), d => domain%number, &
                   node => model%mesh%slot_node(domain%first_slot:domain%last_slot))
            do m = 1, n_batch
                energy(m, d) = spring_energy(model, domain, n_slots, u(m, :, :), &
                                             [1.0_dp, 1.0_dp])
                do k = 1, size(branch, 3)
                    if (.not. any(branch(m, :, k) > 0.0_dp)) cycle
                    energy(m, d) = energy(m, d) &
                        + spring_energy(model, domain, n_slots, &
                                        u(m, :, :) - nodes%memory(m, :, k, node), branch(m, :, k))
                end do
            end do
        end associate
    end subroutine stored_energy

    pure function spring_energy(model, domain, n_slots, field, share) result(energy)
        !! Energy of one field in springs that have a share of both moduli of the zones [J].
        type(model_arrays), intent(in) :: model
        type(domain_range), intent(in) :: domain
        integer, intent(in) :: n_slots
        real(dp), intent(in) :: field(3, n_slots), share(2)
        real(dp) :: energy

        associate (mesh => model%mesh, n_zones => size(model%mesh%zone_lambda), &
                   first => domain%first_zone, last => domain%last_zone, &
                   position => model%mesh%slot_place(:, domain%first_slot:domain%last_slot))
            if (size(mesh%zone_slot, 2) == n_tet15) then
                energy = tet15_energy(n_zones, n_slots, &
                                      size(model%hexes%pack_metric, 4) - domain%first_pack + 1, &
                                      first, last, mesh%zone_slot, &
                                      model%hexes%pack_metric(:, :, 1, domain%first_pack:), &
                                      field, share)
            else
                energy = tet4_energy(n_zones, n_slots, first, last, mesh%zone_slot, &
                                     mesh%zone_lambda, mesh%zone_shear, position, field, share)
            end if
        end associate
    end function spring_energy

end module pyblast_internal_forces
