module pyblast_ledger
    !! The energy ledger: every joule that went in is somewhere; and the alarm when it is not.
    use pyblast_kinds, only : dp, n_energies, n_sums
    implicit none
    private
    public :: add_work, grows, insitu_work, write_ledger

    real(dp), parameter :: growth_limit = 5.0_dp
        !! energy over the largest energy put in; theory.md (2.9) says why not 1.05

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
        real(dp), intent(in) :: contact_stored(n_contacts), contact_dissipated(n_contacts)
        real(dp), intent(in) :: domain_strain(n_domains), domain_lost(n_domains)
        real(dp), intent(in) :: domain_insitu(n_domains)
        real(dp), intent(in) :: block_energy(5, n_blocks)   !! as move_nodes gives it
        real(dp), intent(in) :: before(4)      !! half-step work: damping, dashpots, input, on zones
        real(dp), intent(in) :: insitu         !! of loads and contacts [J]
        real(dp), intent(inout) :: sums(n_sums)
        real(dp), intent(out) :: line(n_energies)
        real(dp) :: faded

        line(1) = sum(block_energy(1, :))
        line(2) = sum(domain_strain)
        line(3) = sum(contact_area*contact_stored)
        line(4) = sum(contact_area*contact_dissipated)
        line(5) = sum(domain_lost)
        faded = sums(4) + before(4) - line(2) - line(5) + sum(domain_insitu)
        if (first) sums(7) = faded
        line(6) = sums(1) + before(1)
        if (damped) line(6) = line(6) + faded - sums(7)
        line(7) = sums(2) + before(2)
        line(8) = sums(3) + before(3)
        line(9) = insitu + sum(domain_insitu)
        line(10) = sum(block_energy(5, :))
    end subroutine write_ledger

    pure function insitu_work(n_nodes, n_contacts, node_load, contact_node, contact_area, &
                              contact_initial, displacement) result(energy)
        !! Work that the constant loads and the initial tractions did [J].
        integer, intent(in) :: n_nodes, n_contacts, contact_node(2, n_contacts)
        real(dp), intent(in) :: node_load(3, n_nodes)      !! [N]
        real(dp), intent(in) :: contact_area(n_contacts), contact_initial(3, n_contacts)
        real(dp), intent(in) :: displacement(3, n_nodes)
        real(dp) :: energy
        integer :: c

        energy = sum(node_load*displacement)
        do c = 1, n_contacts
            energy = energy + contact_area(c)*dot_product(contact_initial(:, c), &
                displacement(:, contact_node(2, c)) - displacement(:, contact_node(1, c)))
        end do
    end function insitu_work

    pure subroutine add_work(before, after, sums)
        !! Carry the work of a whole step forward.
        real(dp), intent(in) :: before(4), after(4)
        real(dp), intent(inout) :: sums(n_sums)

        sums(1:4) = sums(1:4) + before + after
    end subroutine add_work

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
        alarm = .not. energy <= growth_limit*sums(8) + tiny(energy)
    end subroutine grows

end module pyblast_ledger
