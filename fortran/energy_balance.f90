module pyblast_energy_balance
    !! The energy balance: every joule that went in is somewhere; and the alarm when it is not.
    use pyblast_kinds, only : dp, n_energies, n_sums
    use pyblast_batch, only : n_batch
    use pyblast_model_types, only : contact_arrays, domain_work, model_state
    implicit none
    private
    public :: grows, insitu_work, write_energies

    real(dp), parameter :: growth_limit = 5.0_dp
        !! energy over the largest energy put in; theory.md (2.9) says why not 1.05
    real(dp), parameter :: rounding = max(1.0e-10_dp, 1.0e4_dp*epsilon(1.0_dp))
        !! of what contacts store at the start, whose sum is never nearer than that

contains

    pure subroutine write_energies(contacts, state, domains, block_energy, first, damped, before, &
                                   insitu, line)
        !! One line of the balance in the middle of a step, exact for linear models; theory.md (2.7).
        type(contact_arrays), intent(in) :: contacts
        type(model_state), intent(inout) :: state          !! its sums
        type(domain_work), intent(in) :: domains
        real(dp), intent(in) :: block_energy(:, :, :)      !! as move_nodes gives it
        logical, intent(in) :: first           !! whether this is the first line of the run
        logical, intent(in) :: damped          !! whether zones lose energy without yielding
        real(dp), intent(in) :: before(n_batch, 4)
            !! half-step work: damping, dashpots, input, on zones [J]
        real(dp), intent(in) :: insitu(n_batch)            !! of loads and contacts [J]
        real(dp), intent(out) :: line(n_energies, n_batch)
        real(dp) :: attenuated
        integer :: m

        associate (sums => state%sums, joints => state%joints, area => contacts%contact_area)
            do m = 1, n_batch
                line(1, m) = sum(block_energy(m, 1, :))
                line(2, m) = sum(domains%strain_energy(m, :))
                line(3, m) = weighted_sum(size(area), area, joints%contact_stored, m)
                line(4, m) = weighted_sum(size(area), area, joints%contact_dissipated, m)
                line(5, m) = sum(domains%plastic_work(m, :))
                attenuated = sums(4, m) + before(m, 4) - line(2, m) - line(5, m) &
                    + sum(domains%insitu_work(m, :))
                if (first) sums(7, m) = attenuated
                line(6, m) = sums(1, m) + before(m, 1)
                if (damped) line(6, m) = line(6, m) + attenuated - sums(7, m)
                line(7, m) = sums(2, m) + before(m, 2)
                line(8, m) = sums(3, m) + before(m, 3)
                line(9, m) = insitu(m) + sum(domains%insitu_work(m, :))
                line(10, m) = sum(block_energy(m, 5, :))
            end do
        end associate
    end subroutine write_energies

    pure function weighted_sum(n, weight, values, m) result(total)
        !! Sum of values times weights in model m of the batch.
        integer, intent(in) :: n, m
        real(dp), intent(in) :: weight(n), values(n_batch, n)
        real(dp) :: total

        total = sum(weight*values(m, :))
    end function weighted_sum

    pure function insitu_work(n_nodes, n_contacts, node_load, contact_node, contact_area, &
                              contact_initial, displacement) result(energy)
        !! Work that the constant loads and the initial tractions did [J].
        integer, intent(in) :: n_nodes, n_contacts, contact_node(2, n_contacts)
        real(dp), intent(in) :: node_load(n_batch, 3, n_nodes)     !! [N]
        real(dp), intent(in) :: contact_area(n_contacts), contact_initial(3, n_batch, n_contacts)
        real(dp), intent(in) :: displacement(n_batch, 3, n_nodes)  !! [m]
        real(dp) :: energy(n_batch)
        integer :: c, m

        do m = 1, n_batch
            energy(m) = sum(node_load(m, :, :)*displacement(m, :, :))
            do c = 1, n_contacts
                energy(m) = energy(m) + contact_area(c)*dot_product(contact_initial(:, m, c), &
                    displacement(m, :, contact_node(2, c)) - displacement(m, :, contact_node(1, c)))
            end do
        end do
    end function insitu_work

    pure subroutine grows(line, kinetic, coming, first, sums, alarm)
        !! Whether the energy is not finite or exceeds what was put in; theory.md (2.9).
        real(dp), intent(in) :: line(n_energies)
        real(dp), intent(in) :: kinetic            !! mean of both half-steps, never negative [J]
        real(dp), intent(in) :: coming             !! put in by the second half-step [J]
        logical, intent(in) :: first               !! whether this is the first line of the run
        real(dp), intent(inout) :: sums(n_sums)
        logical, intent(out) :: alarm
        real(dp) :: energy

        if (first) then
            sums(5) = line(3)
            sums(6) = kinetic + line(2)
        end if
        sums(8) = max(sums(8), sums(6) + line(8) + line(9) + max(0.0_dp, coming))
        energy = kinetic + line(2) + line(3) - sums(5)
        alarm = .not. energy <= growth_limit*sums(8) + rounding*abs(sums(5)) + tiny(energy)
    end subroutine grows

end module pyblast_energy_balance
