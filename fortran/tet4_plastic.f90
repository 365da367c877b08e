module pyblast_tet4_plastic
    !! Forces of zones that can yield, beside the elastic ones of their set; theory.md (2.41), (2.42).
    !!
    !! Patches share their mean strain: their dilatation acts on their nodes, all other strain is
    !! that of linear zones. Plastic strain acts as forces of its own. Zones are checked for yielding
    !! only when their nodes have moved far enough since the last check, so that ground which stays
    !! elastic costs no more than a look at that distance.
    use pyblast_kinds, only : dp, n_zone_properties, n_zone_state
    use pyblast_batch, only : n_batch
    use pyblast_elasticity, only : hooke_work
    use pyblast_model_types, only : domain_range, domain_work, mesh_arrays, model_arrays, &
        zone_state
    use pyblast_tet4, only : tet4_strains, tet4_stress_forces
    use pyblast_zone_laws, only : elastic_stress, strength_changes, zone_stress, zone_yield_margins
    implicit none
    private
    public :: patch_forces, plastic_forces

    real(dp), parameter :: rounding = 1e-12_dp
    real(dp), parameter :: spare = 1e-3_dp     !! share of the yield margin that is left unused

contains

    pure subroutine patch_forces(n_slots, n_patches, n_ends, first, last, patch_start, patch_slot, &
                                 patch_gradient, patch_bulk, motion, force)
        !! Add the forces of the dilatation of patches first to last; theory.md (2.41).
        integer, intent(in) :: n_slots, n_patches, n_ends, first, last
        integer, intent(in) :: patch_start(n_patches + 1), patch_slot(n_ends)
        real(dp), intent(in) :: patch_gradient(3, n_ends)      !! dilatation over motion [1/m]
        real(dp), intent(in) :: patch_bulk(n_patches)          !! bulk modulus times volume [J]
        real(dp), intent(in) :: motion(n_batch, 3, n_slots)    !! [m]
        real(dp), intent(inout) :: force(n_batch, 3, n_slots)  !! [N]
        real(dp) :: total(n_batch)
        integer :: p, e, s, m

        do p = first, last
            total = 0.0_dp
            do e = patch_start(p), patch_start(p + 1) - 1
                s = patch_slot(e)
                !$omp simd
                do m = 1, n_batch
                    total(m) = total(m) + (motion(m, 1, s)*patch_gradient(1, e) &
                                           + motion(m, 2, s)*patch_gradient(2, e) &
                                           + motion(m, 3, s)*patch_gradient(3, e))
                end do
            end do
            total = patch_bulk(p)*total
            do e = patch_start(p), patch_start(p + 1) - 1
                s = patch_slot(e)
                !$omp simd
                do m = 1, n_batch
                    force(m, 1, s) = force(m, 1, s) - total(m)*patch_gradient(1, e)
                    force(m, 2, s) = force(m, 2, s) - total(m)*patch_gradient(2, e)
                    force(m, 3, s) = force(m, 3, s) - total(m)*patch_gradient(3, e)
                end do
            end do
        end do
    end subroutine patch_forces

    pure subroutine plastic_forces(model, domain, n_slots, with_energy, velocity, u, zones, work, &
                                   force)
        !! Forces of plastic strain in the models whose nodes moved far enough for zones to yield.
        type(model_arrays), intent(in) :: model
        type(domain_range), intent(in) :: domain
        integer, intent(in) :: n_slots
        logical, intent(in) :: with_energy
        real(dp), intent(in) :: velocity(:, :, :)              !! of nodes [m/s]
        real(dp), intent(in) :: u(n_batch, 3, n_slots)         !! [m]
        type(zone_state), intent(inout) :: zones
        type(domain_work), intent(inout) :: work
        real(dp), intent(inout) :: force(n_batch, 3, n_slots)  !! [N]
        real(dp) :: moved(n_batch), own(3, n_slots), step(3, n_slots)
        logical :: due
        integer :: m

        associate (s1 => domain%first_slot, s2 => domain%last_slot, d => domain%number)
            moved = 0.0_dp
            if (any(work%yield_margin(:, d) > 0.0_dp)) &
                moved = displacement_since_check(n_slots, u, work%displacement_at_check(:, :, s1:s2))
            do m = 1, n_batch
                due = .not. moved(m) < work%yield_margin(m, d)
                if (.not. (due .or. with_energy)) cycle
                own = 0.0_dp
                step = 0.0_dp
                if (due) step = model%dt*velocity(m, :, model%mesh%slot_node(s1:s2))
                call check_zones(model, domain, m, n_slots, due, with_energy, u(m, :, :), step, &
                                 zones, work, own)
                if (due) work%displacement_at_check(m, :, s1:s2) = u(m, :, :)
                if (.not. work%yield_margin(m, d) > 0.0_dp) force(m, :, :) = own
            end do
        end associate
    end subroutine plastic_forces

    pure function displacement_since_check(n_slots, u, at_check) result(distance)
        !! Largest motion of a node since the check, less that of the first node [m].
        integer, intent(in) :: n_slots
        real(dp), intent(in) :: u(n_batch, 3, n_slots), at_check(n_batch, 3, n_slots)
        real(dp) :: distance(n_batch), first(n_batch, 3), square
        integer :: s, m

        first = u(:, :, 1) - at_check(:, :, 1)
        distance = 0.0_dp
        do s = 2, n_slots
            !$omp simd private(square)
            do m = 1, n_batch
                square = (u(m, 1, s) - at_check(m, 1, s) - first(m, 1))**2 &
                    + (u(m, 2, s) - at_check(m, 2, s) - first(m, 2))**2 &
                    + (u(m, 3, s) - at_check(m, 3, s) - first(m, 3))**2
                if (.not. square <= distance(m)) distance(m) = square
            end do
        end do
        distance = sqrt(distance)
    end function displacement_since_check

    pure subroutine check_zones(model, domain, m, n_slots, due, with_energy, motion, step, zones, &
                                work, force)
        !! Check the zones of one domain in model m of the batch: let those yield that must, find the
        !! forces of plastic strain, and how far nodes may move before another zone yields.
        type(model_arrays), intent(in) :: model
        type(domain_range), intent(in) :: domain
        integer, intent(in) :: m, n_slots
        logical, intent(in) :: due                     !! whether any zone may yield
        logical, intent(in) :: with_energy
        real(dp), intent(in) :: motion(3, n_slots)     !! [m]
        real(dp), intent(in) :: step(3, n_slots)       !! how motion grew in a step [m]
        type(zone_state), intent(inout) :: zones
        type(domain_work), intent(inout) :: work
        real(dp), intent(inout) :: force(3, n_slots)   !! [N]
        real(dp), dimension(domain%first_zone:domain%last_zone, 6) :: strain, initial
        real(dp), dimension(domain%first_zone:domain%last_zone) :: volume, reach
        integer :: z

        call mean_strains(model%mesh, domain, n_slots, motion, strain, volume, reach)
        do z = domain%first_zone, domain%last_zone
            initial(z, :) = model%ground%row_initial(:, m, model%mesh%zone_row(z))
        end do
        if (due) call yield_zones(model, domain, m, n_slots, motion, step, initial, strain, reach, &
                                  volume, zones, work%yield_margin(m, domain%number), force)
        if (with_energy) call domain_energies(model%mesh, domain, m, initial, strain, volume, zones, &
                                              work)
    end subroutine check_zones

    pure subroutine yield_zones(model, domain, m, n_slots, motion, step, initial, strain, reach, &
                                volume, zones, yield_margin, force)
        !! Let those zones yield that must; arguments as in check_zones.
        type(model_arrays), intent(in) :: model
        type(domain_range), intent(in) :: domain
        integer, intent(in) :: m, n_slots
        real(dp), intent(in) :: motion(3, n_slots), step(3, n_slots)
        real(dp), dimension(domain%first_zone:domain%last_zone, 6), intent(in) :: initial, strain
        real(dp), intent(in) :: reach(domain%first_zone:domain%last_zone)     !! [1/m]
        real(dp), intent(in) :: volume(domain%first_zone:domain%last_zone)    !! [m3]
        type(zone_state), intent(inout) :: zones
        real(dp), intent(out) :: yield_margin          !! 0 where there is plastic strain [m]
        real(dp), intent(inout) :: force(3, n_slots)
        real(dp), dimension(domain%first_zone:domain%last_zone, 6) :: before, elastic
        real(dp), dimension(domain%first_zone:domain%last_zone) :: margin, same_volume, same_reach
        logical, dimension(domain%first_zone:domain%last_zone) :: yielded, yields
        logical :: fixed
        integer :: z

        associate (mesh => model%mesh, first => domain%first_zone, last => domain%last_zone, &
                   law => model%ground%set_law(domain%set), &
                   property => model%ground%set_property(:, m, domain%set))
            fixed = .not. strength_changes(law, property)
            do z = first, last
                associate (state => zones%row_state(:, m, mesh%zone_row(z)))
                    yielded(z) = any(abs(state(7:merge(12, 14, fixed))) > 0.0_dp)
                    elastic(z, :) = strain(z, :) - state(7:12)
                end associate
            end do
            call zone_yield_margins(law, last - first + 1, property, mesh%zone_lambda(first:last), &
                                    mesh%zone_shear(first:last), initial, elastic, margin)
            yields = .not. margin > 0.0_dp .or. (yielded .and. .not. fixed)
            yield_margin = 0.0_dp
            if (.not. any(yielded .or. yields)) then
                yield_margin = max(0.0_dp, minval(margin/reach)*(1.0_dp - spare) &
                                   - rounding*maxval(abs(motion)))
                return
            end if
            if (any(yields)) call mean_strains(mesh, domain, n_slots, motion - step, before, &
                                               same_volume, same_reach)
            do z = first, last
                if (yields(z)) call yield_zone(law, property, mesh%zone_lambda(z), &
                                               mesh%zone_shear(z), initial(z, :), before(z, :), &
                                               strain(z, :), zones%row_state(:, m, mesh%zone_row(z)), &
                                               zones%row_lost(m, mesh%zone_row(z)))
            end do
            call plastic_strain_forces(model, domain, m, n_slots, volume, zones, force)
        end associate
    end subroutine yield_zones

    pure subroutine mean_strains(mesh, domain, n_slots, motion, strain, volume, reach)
        !! Strain of the zones of a domain that share the mean dilatation of their patch; (2.32).
        type(mesh_arrays), intent(in) :: mesh
        type(domain_range), intent(in) :: domain
        integer, intent(in) :: n_slots
        real(dp), intent(in) :: motion(3, n_slots)                             !! [m]
        real(dp), intent(out) :: strain(domain%first_zone:domain%last_zone, 6)
        real(dp), intent(out) :: volume(domain%first_zone:domain%last_zone)    !! [m3]
        real(dp), intent(out) :: reach(domain%first_zone:domain%last_zone)
            !! largest sum of gradients in the patch [1/m]
        real(dp), dimension(0:domain%last_zone - domain%first_zone + 1) :: whole, dilatation, largest
        integer :: z, p

        call tet4_strains(size(mesh%zone_patch), n_slots, domain%first_zone, domain%last_zone, &
                          mesh%zone_slot, mesh%slot_place(:, domain%first_slot:domain%last_slot), &
                          motion, strain, volume, reach)
        whole = 0.0_dp
        dilatation = 0.0_dp
        largest = 0.0_dp
        do z = domain%first_zone, domain%last_zone
            p = mesh%zone_patch(z)
            whole(p) = whole(p) + volume(z)
            dilatation(p) = dilatation(p) + volume(z)*(strain(z, 1) + strain(z, 2) + strain(z, 3))
            largest(p) = max(largest(p), reach(z))
        end do
        do z = domain%first_zone, domain%last_zone
            p = mesh%zone_patch(z)
            if (p == 0) cycle
            strain(z, 1:3) = strain(z, 1:3) &
                + (dilatation(p)/whole(p) - (strain(z, 1) + strain(z, 2) + strain(z, 3)))/3.0_dp
            reach(z) = largest(p)
        end do
    end subroutine mean_strains

    pure subroutine yield_zone(law, property, lambda, shear, initial, before, strain, state, lost)
        !! Let one zone yield if it must; its memory and the energy it lost follow.
        integer, intent(in) :: law
        real(dp), intent(in) :: property(n_zone_properties), lambda, shear
        real(dp), intent(in) :: initial(6), before(6), strain(6)
        real(dp), intent(inout) :: state(n_zone_state), lost
        real(dp) :: stress(6), stored

        state(1:6) = elastic_stress(law, property, lambda, shear, before - state(7:12))
        call zone_stress(law, property, lambda, shear, initial, strain, state, stress, stored, lost)
    end subroutine yield_zone

    pure subroutine plastic_strain_forces(model, domain, m, n_slots, volume, zones, force)
        !! Forces that plastic strain puts on the nodes, mean stress shared by patches; (2.42).
        type(model_arrays), intent(in) :: model
        type(domain_range), intent(in) :: domain
        integer, intent(in) :: m, n_slots
        real(dp), intent(in) :: volume(domain%first_zone:domain%last_zone)     !! [m3]
        type(zone_state), intent(in) :: zones
        real(dp), intent(inout) :: force(3, n_slots)                           !! [N]
        real(dp), dimension(0:domain%last_zone - domain%first_zone + 1) :: whole, pressure
        real(dp) :: stress(domain%first_zone:domain%last_zone, 6), mean
        integer :: z, p

        associate (mesh => model%mesh, law => model%ground%set_law(domain%set), &
                   property => model%ground%set_property(:, m, domain%set), &
                   position => model%mesh%slot_place(:, domain%first_slot:domain%last_slot))
            whole = 0.0_dp
            pressure = 0.0_dp
            do z = domain%first_zone, domain%last_zone
                p = mesh%zone_patch(z)
                whole(p) = whole(p) + volume(z)
                stress(z, :) = -elastic_stress(law, property, mesh%zone_lambda(z), &
                                               mesh%zone_shear(z), &
                                               zones%row_state(7:12, m, mesh%zone_row(z)))
                if (p == 0) cycle
                mean = (stress(z, 1) + stress(z, 2) + stress(z, 3))/3.0_dp
                pressure(p) = pressure(p) + volume(z)*mean
                stress(z, 1:3) = stress(z, 1:3) - mean
            end do
            do z = domain%first_zone, domain%last_zone
                p = mesh%zone_patch(z)
                if (p > 0) stress(z, 1:3) = stress(z, 1:3) + pressure(p)/whole(p)
            end do
            call tet4_stress_forces(size(mesh%zone_lambda), n_slots, domain%first_zone, &
                                    domain%last_zone, mesh%zone_slot, position, stress, force)
        end associate
    end subroutine plastic_strain_forces

    pure subroutine domain_energies(mesh, domain, m, initial, strain, volume, zones, work)
        !! Strain energy of a domain, its plastic work, and the work of its initial stress.
        type(mesh_arrays), intent(in) :: mesh
        type(domain_range), intent(in) :: domain
        integer, intent(in) :: m
        real(dp), dimension(domain%first_zone:domain%last_zone, 6), intent(in) :: initial, strain
        real(dp), intent(in) :: volume(domain%first_zone:domain%last_zone)     !! [m3]
        type(zone_state), intent(in) :: zones
        type(domain_work), intent(inout) :: work
        real(dp) :: elastic(domain%first_zone:domain%last_zone, 6), lost
        integer :: z

        associate (first => domain%first_zone, last => domain%last_zone, d => domain%number)
            elastic = strain
            lost = 0.0_dp
            if (.not. work%yield_margin(m, d) > 0.0_dp) then
                do z = first, last
                    elastic(z, :) = strain(z, :) - zones%row_state(7:12, m, mesh%zone_row(z))
                    lost = lost + volume(z)*zones%row_lost(m, mesh%zone_row(z))
                end do
            end if
            work%plastic_work(m, d) = lost
            call hooke_work(last - first + 1, mesh%zone_lambda(first:last), &
                            mesh%zone_shear(first:last), initial, elastic, strain, volume, &
                            work%strain_energy(m, d), work%insitu_work(m, d))
        end associate
    end subroutine domain_energies

end module pyblast_tet4_plastic
