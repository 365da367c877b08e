"""Write the Fortran module that reads, checks and writes the arrays of a model file.

python arrays.py arrays.toml kinds.f90.in joint_laws.f90 zone_laws.f90 model_arrays.f90
"""

import re
import sys
import textwrap
import tomllib
from pathlib import Path

RECORDS = "model", "run", "state"  # the other tables are components of model or of state
RANGES = {
    "finite": "finite", "not negative": "not_negative", "positive": "positive",
    "not negative, or infinite": "not_negative_or_infinite",
}  # fmt: skip
MODULE = """\
module pyblast_model_arrays
    !! The arrays of model files and results, from fortran/arrays.toml; made by fortran/arrays.py.
    use hdf5, only : hid_t
    use pyblast_kinds
    use pyblast_batch, only : n_models => n_batch
    use pyblast_hdf5_arrays
    use pyblast_joint_laws, only : n_joint_laws
    use pyblast_zone_laws, only : n_zone_laws
    use pyblast_model_types, only : model_arrays, model_state, run_arrays
    implicit none
    private
    public :: check_indices, is_finite, known_sizes, read_arrays, write_records

    integer, parameter, public :: &
        {sizes}

contains

    function known_sizes() result(sizes)
        !! Sizes before any array is read: that of a batch, and 0 beside a number.
        integer :: sizes(0:{count})

        sizes = -1
        sizes(0) = 0
        sizes(n_batch) = n_models
    end function known_sizes

    subroutine read_arrays(file, model, state, run, sizes, message)
        !! Read every array; refuse shapes that do not fit together and numbers out of range.
        integer(hid_t), intent(in) :: file
        type(model_arrays), intent(inout) :: model
        type(model_state), intent(inout) :: state
        type(run_arrays), intent(inout) :: run
        integer, intent(inout) :: sizes(0:)
        character(len=:), allocatable, intent(inout) :: message
        real(dp), contiguous, pointer :: reals(:)
        integer, contiguous, pointer :: integers(:)

{reading}
    end subroutine read_arrays

    subroutine check_indices(model, sizes, message)
        !! Refuse indices that point outside of their table, or do not ascend.
        type(model_arrays), intent(in) :: model
        integer, intent(in) :: sizes(0:)
        character(len=:), allocatable, intent(inout) :: message

{checking}
    end subroutine check_indices

    subroutine write_records(file, state, run, message)
        !! Write what a run recorded, and the state at its end.
        integer(hid_t), intent(in) :: file
        type(model_state), intent(in) :: state
        type(run_arrays), intent(in) :: run
        character(len=:), allocatable, intent(inout) :: message

{writing}
    end subroutine write_records

    logical function is_finite(state, run)
        !! Whether all that a run recorded and its state are finite.
        type(model_state), intent(in) :: state
        type(run_arrays), intent(in) :: run

        is_finite = .true.
{finite}
    end function is_finite

end module pyblast_model_arrays
"""


class Row:
    """One array of the table, and the statements for it."""

    def __init__(self, group, record, name, about, constants):
        self.path, self.about, self.constants = f"{group}/{name}", about, constants
        owner = (
            record if record in RECORDS else f"{'state' * (group == 'state') or 'model'}%{record}"
        )
        self.place = f"{owner}%{about.get('component', name)}"
        self.lengths = list(map(self._length, about["shape"].split(", "))) if about["shape"] else []
        self.high = self._sum(*self._length(str(about["points"]))) if "points" in about else ""

    def _length(self, text):
        """Return the size and the number of a length such as ``n_nodes + 1``; size 0 is none."""
        size, _, number = text.partition(" + ")
        return ("0", size) if size.isdigit() or size in self.constants else (size, number or "0")

    def _sum(self, size, number):
        """Return a length as an expression."""
        return number if size == "0" else f"sizes({size})" + f" + {number}" * (number != "0")

    def reading(self):
        """Return the statements that read the array."""
        axes = (", ".join(parts) for parts in zip(*self.lengths, strict=True))
        axes = [f"[integer :: {part}]" for part in axes] or ["[integer ::]"] * 2
        ends = ", ".join(f"1:{self._sum(*length)}" for length in self.lengths)
        kind, range_ = "integers", ""
        if "unit" in self.about:
            kind, range_ = "reals", f"{RANGES[self.about.get('range', 'finite')]}, "
        asked = f'file, "{self.path}", {", ".join(axes)}, {range_}sizes'
        lines = [f"call read_{kind}({asked}, {kind}, message)"]
        if "counts" in self.about:
            low, high = self.about["counts"]
            lines.append(
                f'call check_range("{self.path}", 1, integers, {low}, {high}, .false., message)'
            )
        lines.append("if (allocated(message)) return")
        lines.append(f"{self.place}({ends}) => {kind}" if ends else f"{self.place} = {kind}(1)")
        if "optional" not in self.about:
            return lines
        return [f'if (has_array(file, "{self.path}")) then', *lines, "end if"]

    def checking(self):
        """Return the statement that checks the indices of the array."""
        low, ascends = 1 - self.about.get("none", False), str(self.about.get("ascends", False))
        where = f'"{self.path}", size({self.place}), {self.place}'
        return [f"call check_range({where}, {low}, {self.high}, .{ascends.lower()}., message)"]

    def writing(self):
        """Return the statement that writes the array."""
        batch = next((n for n, (size, _) in enumerate(self.lengths, 1) if size == "n_batch"), 0)
        where = f'"{self.path}", shape({self.place}), {batch}, {self.place}'
        return [f"call write_reals(file, {where}, message)"]

    def finite(self):
        """Return the statement that asks whether the array is finite."""
        return [f"is_finite = is_finite .and. all(abs({self.place}) <= huge(1.0_dp))"]


def wrapped(lines, indent=8):
    """Return statements as text, in lines that Fortran takes."""
    margin = " " * indent
    options = {"width": 96, "break_long_words": False, "break_on_hyphens": False}
    broken = (f" &\n{margin}    ".join(textwrap.wrap(line, **options)) for line in lines)
    return "\n".join(margin + statement for statement in broken)


def main(table, *sources, out):
    """Write the module of a table, with the constants that Fortran sources state."""
    texts = (path.read_text(encoding="utf-8") for path in sources)
    constants = {c for text in texts for c in re.findall(r"parameter, public :: (\w+)", text)}
    groups = tomllib.loads(table.read_text(encoding="utf-8"))
    rows = [
        Row(group, record, name, about, constants)
        for group, records in groups.items()
        for record, arrays in records.items()
        for name, about in arrays.items()
    ]
    named = (
        re.findall(r"n_\w+", f"{row.about['shape']} {row.about.get('points')}") for row in rows
    )
    sizes = dict.fromkeys(["n_batch", *(n for names in named for n in names if n not in constants)])
    read = [row for row in rows if not row.path.startswith("records/")]
    written = [row for row in rows if row.path.startswith(("records/", "state/"))]
    numbers = ", ".join(f"{size} = {number}" for number, size in enumerate(sizes, 1))
    text = MODULE.format(
        sizes=wrapped([numbers], 4).strip(),
        count=len(sizes),
        reading=wrapped(line for row in read for line in row.reading()),
        checking=wrapped(line for row in read if row.high for line in row.checking()),
        writing=wrapped(line for row in written for line in row.writing()),
        finite=wrapped(line for row in written for line in row.finite()),
    )
    out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    *given, target = map(Path, sys.argv[1:])
    main(*given, out=target)
