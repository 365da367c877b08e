module pyblast_hex_forces
    !! Nodal forces of spectral hexahedra, pack by pack.
    !!
    !! Each node of each zone has a part of its own among the parts of the nodal forces, so that no
    !! sum depends on the number of threads. The parts of a pack stay as its kernel leaves them:
    !! (member, component, node) in a core of one model, (model, component, member, node) in a batch.
    use pyblast_kinds, only : dp, hex_width, least_shared
    use pyblast_batch, only : kernel_width, n_batch
    use pyblast_model_types, only : domain_work, hex_arrays, model_arrays, nodal_state, zone_state
    use pyblast_processor, only : has_wide_vectors
    use pyblast_hex_kernels, only : forces_in_layer, forces_of_bricks, forces_of_mapped_zones
    implicit none
    private
    public :: hex_zone_forces

contains

    subroutine hex_zone_forces(model, nodes, zones, with_energy, work, n_parts, part_force)
        !! Forces of all zones as parts, and the energy that each pack holds.
        type(model_arrays), intent(in) :: model
        type(nodal_state), intent(in) :: nodes
        type(zone_state), intent(inout) :: zones
        logical, intent(in) :: with_energy                          !! whether energies are wanted
        type(domain_work), intent(inout) :: work
        integer, intent(in) :: n_parts
        real(dp), intent(inout) :: part_force(n_batch, 3, n_parts)  !! [N]
        integer :: first, n, n_nodes, p
        logical :: wide

        n = (model%hexes%order + 1)**3
        n_nodes = size(nodes%velocity, 3)
        wide = has_wide_vectors()
        !$omp parallel do schedule(static) default(none) private(first) &
        !$omp& shared(model, nodes, zones, with_energy, work, part_force, n, wide) &
        !$omp& if (n_batch*n_nodes >= least_shared)
        do p = 1, size(model%hexes%pack_set)
            first = (p - 1)*hex_width*n
            if (slabs_of(model, p) > 0) then
                call layer_forces(model, p, n, wide, nodes, zones, &
                                  part_force(:, :, first + 1:first + hex_width*n))
            else
                call pack_forces(model, p, n, wide, nodes, with_energy, work, &
                                 part_force(:, :, first + 1:first + hex_width*n))
            end if
        end do
        !$omp end parallel do
    end subroutine hex_zone_forces

    pure function slabs_of(model, p) result(n_slabs)
        !! Axes along which a pack is stretched; 0 outside of the absorbing layer.
        type(model_arrays), intent(in) :: model
        integer, intent(in) :: p
        integer :: n_slabs

        n_slabs = 0
        if (model%layer%n_slabs > 0) &
            n_slabs = model%layer%slab_start(p + 1) - model%layer%slab_start(p)
    end function slabs_of

    pure subroutine layer_forces(model, p, n, wide, nodes, zones, force)
        !! Forces of a pack of the absorbing layer, of one model; what it holds counts as damping.
        type(model_arrays), intent(in) :: model
        integer, intent(in) :: p, n
        logical, intent(in) :: wide
        type(nodal_state), intent(in) :: nodes
        type(zone_state), intent(inout) :: zones
        real(dp), intent(inout) :: force(kernel_width, 3, n)
        real(dp), dimension(kernel_width, 3, n) :: u, v, deviatoric, volumetric
        integer :: c, first, last, most, n_nodes
        logical :: apart, turned

        associate (ground => model%ground, set => model%hexes%pack_set(p), layer => model%layer, &
                   node => model%hexes%pack_node(:, :, p))
            most = size(model%hexes%pack_metric, 4)
            first = layer%slab_start(p)
            last = layer%slab_start(p + 1) - 1
            n_nodes = size(nodes%velocity, 3)
            turned = any([(abs(layer%layer_frame(c, c) - 1.0_dp) > 0.0_dp, c=1, 3)])
            if (any(ground%set_beta(:, set) > 0.0_dp) &
                .or. any(ground%set_branch(:, :, :, set) > 0.0_dp)) then
                call gather(n, 0, n_nodes, node, nodes%displacement, u)
                call gather(n, 0, n_nodes, node, nodes%velocity, v)
                call damped_fields(n, 0, n_nodes, size(nodes%memory, 3), node, &
                                   ground%set_beta(:, set), ground%set_branch(:, :, :, set), u, &
                                   nodes%velocity, nodes%memory, deviatoric, volumetric)
                call add_lag(n, layer%slab_lag(:, first), v, deviatoric)
                call add_lag(n, layer%slab_lag(:, first), v, volumetric)
            else
                call gather_lagging(n, n_nodes, node, layer%slab_lag(:, first), &
                                    nodes%displacement, nodes%velocity, deviatoric)
            end if
            apart = any(abs(ground%set_branch(:, 1, :, set) - ground%set_branch(:, 2, :, set)) &
                        > 0.0_dp)
            if (turned) call turn(n, layer%layer_frame, deviatoric)
            if (turned .and. apart) call turn(n, layer%layer_frame, volumetric)
            call forces_in_layer(model%hexes, n, wide, &
                                 model%hexes%pack_metric(:, :, :, min(p, most)), &
                                 model%hexes%pack_brick(:, :, max(1, p - model%hexes%n_mapped)), &
                                 p > model%hexes%n_mapped, last - first + 1, &
                                 layer%slab_axis(first:last), &
                                 layer%slab_stretch(:, :, :, first:last), deviatoric, apart, &
                                 volumetric, zones%slab_memory(:, :, :, first:last), force)
            if (turned) call turn(n, transpose(layer%layer_frame), force)
        end associate
    end subroutine layer_forces

    pure subroutine add_lag(n, lag, velocity, field)
        !! Add the viscosity of each zone to the motion that its ground sees.
        integer, intent(in) :: n
        real(dp), intent(in) :: lag(hex_width), velocity(kernel_width, 3, n)
        real(dp), intent(inout) :: field(kernel_width, 3, n)
        integer :: a, c

        do a = 1, n
            do c = 1, 3
                field(:hex_width, c, a) = field(:hex_width, c, a) + lag*velocity(:hex_width, c, a)
            end do
        end do
    end subroutine add_lag

    pure subroutine turn(n, frame, field)
        !! Components along the axes (3, axis) of a frame, in place.
        integer, intent(in) :: n
        real(dp), intent(in) :: frame(3, 3)
        real(dp), intent(inout) :: field(kernel_width, 3, n)
        real(dp) :: own(kernel_width, 3)
        integer :: a, c

        do a = 1, n
            own = field(:, :, a)
            do c = 1, 3
                field(:, c, a) = frame(1, c)*own(:, 1) + frame(2, c)*own(:, 2) &
                    + frame(3, c)*own(:, 3)
            end do
        end do
    end subroutine turn

    pure subroutine pack_forces(model, p, n, wide, nodes, with_energy, work, force)
        !! Forces of one pack: of its zones together, or for each of them of the models of a batch.
        type(model_arrays), intent(in) :: model
        integer, intent(in) :: p, n
        logical, intent(in) :: wide, with_energy
        type(nodal_state), intent(in) :: nodes
        type(domain_work), intent(inout) :: work
        real(dp), intent(inout) :: force(n_batch, 3, hex_width*n)
        real(dp) :: own(n_batch, 3, n), energy(n_batch)
        integer :: member

        if (n_batch == 1) then
            call forces_of_members(model, p, 0, n, wide, nodes, with_energy, &
                                 work%strain_energy(1, p), force)
            return
        end if
        energy = 0.0_dp
        if (with_energy) work%strain_energy(:, p) = 0.0_dp
        do member = 1, hex_width
            call forces_of_members(model, p, member, n, wide, nodes, with_energy, energy(1), own)
            force(:, :, member::hex_width) = own
            if (with_energy) work%strain_energy(:, p) = work%strain_energy(:, p) + energy
        end do
    end subroutine pack_forces

    pure subroutine forces_of_members(model, p, member, n, wide, nodes, with_energy, energy, force)
        !! Forces of the zones of a pack, or of one of its zones in the models of a batch.
        type(model_arrays), intent(in) :: model
        integer, intent(in) :: p, member, n
        logical, intent(in) :: wide, with_energy
        type(nodal_state), intent(in) :: nodes
        real(dp), intent(inout) :: energy(n_batch)                  !! [J]
        real(dp), intent(out) :: force(kernel_width, 3, n)          !! [N]
        real(dp) :: u(kernel_width, 3, n), deviatoric(kernel_width, 3, n)
        real(dp) :: volumetric(kernel_width, 3, n)
        logical :: apart

        associate (ground => model%ground, set => model%hexes%pack_set(p), &
                   node => model%hexes%pack_node(:, :, p))
            call gather(n, member, size(nodes%velocity, 3), node, nodes%displacement, u)
            if (.not. (any(ground%set_beta(:, set) > 0.0_dp) &
                       .or. any(ground%set_branch(:, :, :, set) > 0.0_dp))) then
                call kernel(model%hexes, p, member, n, wide, u, u, .false., force)
                if (with_energy) energy = half_work(n, u, force)
                return
            end if
            apart = any(abs(ground%set_branch(:, 1, :, set) - ground%set_branch(:, 2, :, set)) &
                        > 0.0_dp)
            call damped_fields(n, member, size(nodes%velocity, 3), size(nodes%memory, 3), node, &
                               ground%set_beta(:, set), ground%set_branch(:, :, :, set), u, &
                               nodes%velocity, nodes%memory, deviatoric, volumetric)
            call kernel(model%hexes, p, member, n, wide, deviatoric, volumetric, apart, force)
            if (with_energy) call stored_energy(model, p, member, n, wide, nodes, u, energy)
        end associate
    end subroutine forces_of_members

    pure subroutine gather(n, member, n_nodes, node, field, u)
        !! Motion of the nodes of a pack, or of one of its zones.
        integer, intent(in) :: n, member, n_nodes, node(hex_width, n)
        real(dp), intent(in) :: field(n_batch, 3, n_nodes)
        real(dp), intent(out) :: u(kernel_width, 3, n)
        integer :: a, c, l

        if (n_batch == 1) then
            do a = 1, n
                do l = 1, hex_width
                    u(l, 1, a) = field(1, 1, node(l, a))
                    u(l, 2, a) = field(1, 2, node(l, a))
                    u(l, 3, a) = field(1, 3, node(l, a))
                end do
            end do
        else
            do a = 1, n
                do c = 1, 3
                    u(:n_batch, c, a) = field(:, c, node(member, a))
                end do
            end do
        end if
    end subroutine gather

    pure subroutine gather_lagging(n, n_nodes, node, lag, displacement, velocity, field)
        !! Motion that undamped ground in the layer sees at the nodes of a pack, with its viscosity.
        integer, intent(in) :: n, n_nodes, node(hex_width, n)
        real(dp), intent(in) :: lag(hex_width), displacement(3, n_nodes), velocity(3, n_nodes)
        real(dp), intent(out) :: field(kernel_width, 3, n)
        integer :: a, l

        do a = 1, n
            do l = 1, hex_width
                field(l, 1, a) = displacement(1, node(l, a)) + lag(l)*velocity(1, node(l, a))
                field(l, 2, a) = displacement(2, node(l, a)) + lag(l)*velocity(2, node(l, a))
                field(l, 3, a) = displacement(3, node(l, a)) + lag(l)*velocity(3, node(l, a))
            end do
        end do
    end subroutine gather_lagging

    pure subroutine damped_fields(n, member, n_nodes, n_memories, node, beta, branch, u, velocity, &
                                  memory, deviatoric, volumetric)
        !! Motion that shear and compression see, with damping and memory; theory.md (2.14).
        integer, intent(in) :: n, member, n_nodes, n_memories, node(hex_width, n)
        real(dp), intent(in) :: beta(n_batch), branch(n_batch, 2, n_memories)
        real(dp), intent(in) :: u(kernel_width, 3, n), velocity(n_batch, 3, n_nodes)
        real(dp), intent(in) :: memory(n_batch, 3, n_memories, n_nodes)
        real(dp), intent(out) :: deviatoric(kernel_width, 3, n), volumetric(kernel_width, 3, n)
        real(dp) :: behind
        integer :: a, c, k, l, m, own

        do a = 1, n
            do l = 1, kernel_width
                m = merge(l, 1, n_batch > 1)
                own = node(merge(member, l, n_batch > 1), a)
                do c = 1, 3
                    deviatoric(l, c, a) = u(l, c, a) + beta(m)*velocity(m, c, own)
                    volumetric(l, c, a) = deviatoric(l, c, a)
                    do k = 1, n_memories
                        behind = u(l, c, a) - memory(m, c, k, own)
                        deviatoric(l, c, a) = deviatoric(l, c, a) + branch(m, 1, k)*behind
                        volumetric(l, c, a) = volumetric(l, c, a) + branch(m, 2, k)*behind
                    end do
                end do
            end do
        end do
    end subroutine damped_fields

    pure subroutine stored_energy(model, p, member, n, wide, nodes, u, energy)
        !! Energy in springs that stay and in those that relax; theory.md (2.17).
        type(model_arrays), intent(in) :: model
        integer, intent(in) :: p, member, n
        logical, intent(in) :: wide
        type(nodal_state), intent(in) :: nodes
        real(dp), intent(in) :: u(kernel_width, 3, n)
        real(dp), intent(out) :: energy(n_batch)
        real(dp), dimension(kernel_width, 3, n) :: behind, of_shear, of_compression, force
        integer :: k, l

        call kernel(model%hexes, p, member, n, wide, u, u, .false., force)
        energy = half_work(n, u, force)
        associate (branch => model%ground%set_branch(:, :, :, model%hexes%pack_set(p)))
            do k = 1, size(branch, 3)
                if (.not. any(branch(:, :, k) > 0.0_dp)) cycle
                call gather(n, member, size(nodes%velocity, 3), model%hexes%pack_node(:, :, p), &
                            nodes%memory(:, :, k, :), behind)
                behind = u - behind
                do l = 1, kernel_width
                    of_shear(l, :, :) = branch(merge(l, 1, n_batch > 1), 1, k)*behind(l, :, :)
                    of_compression(l, :, :) = branch(merge(l, 1, n_batch > 1), 2, k)*behind(l, :, :)
                end do
                call kernel(model%hexes, p, member, n, wide, of_shear, of_compression, .true., force)
                energy = energy + half_work(n, behind, force)
            end do
        end associate
    end subroutine stored_energy

    pure function half_work(n, u, force) result(work)
        !! Half of the work of forces on a motion, of each model: what the zones hold.
        integer, intent(in) :: n
        real(dp), intent(in) :: u(kernel_width, 3, n), force(kernel_width, 3, n)
        real(dp) :: work(n_batch), by_member(kernel_width)
        integer :: a, c

        by_member = 0.0_dp
        do a = 1, n
            do c = 1, 3
                by_member = by_member - 0.5_dp*u(:, c, a)*force(:, c, a)
            end do
        end do
        if (n_batch == 1) then
            work = sum(by_member)
        else
            work = by_member(:n_batch)
        end if
    end function half_work

    pure subroutine kernel(hexes, p, member, n, wide, deviatoric, volumetric, apart, force)
        !! Call the kernel of the order of the zones, for the vectors of the processor.
        type(hex_arrays), intent(in) :: hexes
        integer, intent(in) :: p, member, n
        logical, intent(in) :: wide, apart
        real(dp), intent(in) :: deviatoric(kernel_width, 3, n), volumetric(kernel_width, 3, n)
        real(dp), intent(out) :: force(kernel_width, 3, n)
        real(dp) :: metric(kernel_width, 11, n), brick(kernel_width, 5)
        integer :: a, c

        if (n_batch == 1 .and. p <= hexes%n_mapped) then
            call forces_of_mapped_zones(hexes, n, wide, hexes%pack_metric(:, :, :, p), deviatoric, volumetric, &
                        apart, force)
        else if (n_batch == 1) then
            call forces_of_bricks(hexes, n, wide, hexes%pack_brick(:, :, p - hexes%n_mapped), deviatoric, &
                        volumetric, apart, force)
        else if (p <= hexes%n_mapped) then
            do a = 1, n
                do c = 1, 11
                    metric(:, c, a) = hexes%pack_metric(member, c, a, p)
                end do
            end do
            call forces_of_mapped_zones(hexes, n, wide, metric, deviatoric, volumetric, apart, force)
        else
            do c = 1, 5
                brick(:, c) = hexes%pack_brick(member, c, p - hexes%n_mapped)
            end do
            call forces_of_bricks(hexes, n, wide, brick, deviatoric, volumetric, apart, force)
        end if
    end subroutine kernel

end module pyblast_hex_forces
