module pyblast_ledger
    !! The energy ledger: every joule that went in is somewhere; and the alarm when it is not.
    use pyblast_kinds, only : dp, n_energies, n_sums
    use pyblast_lanes, only : lanes
    implicit none
    private
    public :: grows, insitu_work, write_ledger

    real(dp), parameter :: growth_limit = 5.0_dp
        !! energy over the largest energy put in; theory.md (2.9) says why not 1.05
    real(dp), parameter :: rounding = max(1.0e-10_dp, 1.0e4_dp*epsilon(1.0_dp))
        !! of what contacts store at the start, whose sum is never nearer than that

contains

    pure subroutine write_ledger(n_contacts, n_domains, n_blocks, first, damped, contact_area, &
                                 contact_stored, contact_dissipated, domain_strain, &
                                 domain_lost, domain_insitu, block_energy, before, insitu, &
                                 sums, line)
        !! One line of the ledger in the middle of a step, exact for linear models; theory.md (2.7).
        integer, intent(in) :: n_contacts, n_domains, n_blocks
        logical, intent(in) :: first           !! whether this is the first line of the run
        logical, intent(in) :: damped          !! whether zones lose energy without yielding
        real(dp), intent(in) :: contact_area(n_contacts)
        real(dp), intent(in) :: contact_stored(lanes, n_contacts)
        real(dp), intent(in) :: contact_dissipated(lanes, n_contacts)
        real(dp), intent(in) :: domain_strain(lanes, n_domains), domain_lost(lanes, n_domains)
        real(dp), intent(in) :: domain_insitu(lanes, n_domains)
        real(dp), intent(in) :: block_energy(lanes, 5, n_blocks)   !! as move_nodes gives it
        real(dp), intent(in) :: before(lanes, 4)
            !! half-step work: damping, dashpots, input, on zones [J]
        real(dp), intent(in) :: insitu(lanes)  !! of loads and contacts [J]
        real(dp), intent(inout) :: sums(n_sums, lanes)
        real(dp), intent(out) :: line(n_energies, lanes)
        real(dp) :: faded
        integer :: l

        do l = 1, lanes
            line(1, l) = sum(block_energy(l, 1, :))
            line(2, l) = sum(domain_strain(l, :))
            line(3, l) = sum(contact_area*contact_stored(l, :))
            line(4, l) = sum(contact_area*contact_dissipated(l, :))
            line(5, l) = sum(domain_lost(l, :))
            faded = sums(4, l) + before(l, 4) - line(2, l) - line(5, l) + sum(domain_insitu(l, :))
            if (first) sums(7, l) = faded
            line(6, l) = sums(1, l) + before(l, 1)
            if (damped) line(6, l) = line(6, l) + faded - sums(7, l)
            line(7, l) = sums(2, l) + before(l, 2)
            line(8, l) = sums(3, l) + before(l, 3)
            line(9, l) = insitu(l) + sum(domain_insitu(l, :))
            line(10, l) = sum(block_energy(l, 5, :))
        end do
    end subroutine write_ledger

    pure function insitu_work(n_nodes, n_contacts, node_load, contact_node, contact_area, &
                              contact_initial, displacement) result(energy)
        !! Work that the constant loads and the initial tractions did [J].
        integer, intent(in) :: n_nodes, n_contacts, contact_node(2, n_contacts)
        real(dp), intent(in) :: node_load(lanes, 3, n_nodes)      !! [N]
        real(dp), intent(in) :: contact_area(n_contacts), contact_initial(3, lanes, n_contacts)
        real(dp), intent(in) :: displacement(lanes, 3, n_nodes)
        real(dp) :: energy(lanes)
        integer :: c, l

        do l = 1, lanes
            energy(l) = sum(node_load(l, :, :)*displacement(l, :, :))
            do c = 1, n_contacts
                energy(l) = energy(l) + contact_area(c)*dot_product(contact_initial(:, l, c), &
                    displacement(l, :, contact_node(2, c)) - displacement(l, :, contact_node(1, c)))
            end do
        end do
    end function insitu_work

    pure subroutine grows(line, kinetic, coming, first, sums, alarm)
        !! Tell whether the energy is not finite or exceeds what was put in; theory.md (2.9).
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

end module pyblast_ledger
