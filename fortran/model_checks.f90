module pyblast_model_checks
    !! What the arrays of a model file must keep to, so that no kernel reads outside of them.
    implicit none
    private
    public :: check_domains, check_edges, check_patches, want, within

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

    subroutine check_edges(slot_start, edge_start, edge_slot, skew_start, skew_slot, message)
        !! The ends of an edge must lie within its domain, and edges ascend with slots.
        integer, intent(in) :: slot_start(:), edge_start(:), edge_slot(:)
        integer, intent(in) :: skew_start(:), skew_slot(:, :)
        character(len=:), allocatable, intent(inout) :: message
        integer :: d, e, s, slots

        if (allocated(message)) return
        call within("edge_start", edge_start, 1, size(edge_slot) + 1, message)
        call within("skew_start", skew_start, 1, size(skew_slot, 2) + 1, message)
        if (allocated(message)) return
        do d = 1, size(slot_start) - 1
            slots = slot_start(d + 1) - slot_start(d)
            do s = slot_start(d), slot_start(d + 1) - 1
                do e = edge_start(s), edge_start(s + 1) - 1
                    if (edge_slot(e) < 1 .or. edge_slot(e) > slots) &
                        message = "'arrays/edge_slot' points outside its domain"
                end do
            end do
            do e = skew_start(d), skew_start(d + 1) - 1
                if (minval(skew_slot(:, e)) < 1 .or. maxval(skew_slot(:, e)) > slots) &
                    message = "'arrays/skew_slot' points outside its domain"
            end do
        end do
    end subroutine check_edges

    subroutine check_patches(slot_start, domain_start, patch_start, patch_slot, message)
        !! The nodes of a patch must lie within its domain.
        integer, intent(in) :: slot_start(:), domain_start(:), patch_start(:), patch_slot(:)
        character(len=:), allocatable, intent(inout) :: message
        integer :: d, e, p

        if (allocated(message)) return
        call within("domain_patch_start", domain_start, 1, size(patch_start), message)
        call within("patch_start", patch_start, 1, size(patch_slot) + 1, message)
        if (allocated(message)) return
        do d = 1, size(slot_start) - 1
            do p = domain_start(d), domain_start(d + 1) - 1
                do e = patch_start(p), patch_start(p + 1) - 1
                    if (patch_slot(e) < 1 .or. patch_slot(e) > slot_start(d + 1) - slot_start(d)) &
                        message = "'arrays/patch_slot' points outside its domain"
                end do
            end do
        end do
    end subroutine check_patches

end module pyblast_model_checks
