module pyblast_model_checks
    !! What the arrays of a model file must keep to, so that no kernel reads outside of them.
    implicit none
    private
    public :: check_domains, want, within

contains

    subroutine want(what, found, expected, message)
        !! Compare sizes of arrays that belong together.
        character(len=*), intent(in) :: what
        integer, intent(in) :: found(:), expected(:)
        character(len=:), allocatable, intent(inout) :: message

        if (any(found /= expected) .and. .not. allocated(message)) &
            message = "the arrays of the " // what // " do not have matching lengths"
    end subroutine want

    subroutine within(name, indices, low, high, message)
        !! Check the range of indices.
        character(len=*), intent(in) :: name
        integer, intent(in) :: indices(:), low, high
        character(len=:), allocatable, intent(inout) :: message

        if (allocated(message)) return
        if (minval(indices) < low .or. maxval(indices) > high) &
            message = "'arrays/" // name // "' points outside its table"
    end subroutine within

    subroutine check_domains(zone_start, slot_start, zone_slot, zone_patch, node_start, message)
        !! The slots of a zone must lie within its domain, and domains and nodes cover everything.
        integer, intent(in) :: zone_start(:), slot_start(:), zone_slot(:, :), zone_patch(:)
        integer, intent(in) :: node_start(:)
        character(len=:), allocatable, intent(inout) :: message
        integer :: d, first, last

        do d = 1, size(zone_start) - 1
            first = zone_start(d)
            last = zone_start(d + 1) - 1
            if (last < first .or. slot_start(d + 1) < slot_start(d)) then
                message = "'arrays/domain_zone_start' does not ascend"
                return
            end if
            if (maxval(zone_slot(first:last, :)) > slot_start(d + 1) - slot_start(d) &
                .or. maxval(zone_patch(first:last)) > last - first + 1) &
                message = "'arrays/zone_slot' or 'zone_patch' points outside its domain"
        end do
        if (zone_start(1) /= 1 .or. zone_start(d) /= size(zone_patch) + 1 .or. &
            any(node_start(2:) < node_start(:size(node_start) - 1))) &
            message = "'arrays/domain_zone_start' or 'node_start' does not cover everything"
    end subroutine check_domains

end module pyblast_model_checks
