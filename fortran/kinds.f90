module pyblast_kinds
    !! The one kind of real numbers, and the sizes that kernels, files and Python share.
    !! Literal, and apart from the kernels, because f2py resolves nothing else safely.
    implicit none
    private
    public :: dp

    integer, parameter :: dp = kind(1.0d0)

    integer, parameter, public :: n_joint_laws = 9
    integer, parameter, public :: n_joint_properties = 12
    integer, parameter, public :: n_joint_state = 12

    integer, parameter, public :: n_zone_laws = 3
    integer, parameter, public :: n_zone_properties = 24
    integer, parameter, public :: n_zone_state = 14

    integer, parameter, public :: n_quadratic = 15         !! nodes of a quadratic zone
    integer, parameter, public :: n_quadratic_strains = 14
    integer, parameter, public :: n_abreast = 16             !! quadratic zones side by side

    integer, public :: least_shared = 12000
        !! nodes, times lanes, of a model whose steps are worth sharing among threads; not literal,
        !! so that tests can share the steps of small ones

    integer, parameter, public :: n_energies = 10
        !! ledger columns: kinetic, strain, joint stored, joint dissipated, zone dissipated,
        !! damping, dashpots, input, in-situ work [J], sum of unbalanced force [N]
    integer, parameter, public :: n_sums = 8
        !! running: damping, dashpots, input, work on zones; fixed at the start: stored in joints,
        !! in motion and strain, work on zones not found in them; largest energy put in so far

end module pyblast_kinds
