"""What was read: file, column or channel, unit, factor, rows, losses and choices."""

from dataclasses import asdict, dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Column:
    """Quantity that was read: its source in the file, unit, and why this source was taken.

    Parameters
    ----------
    quantity : str
        Such as "charge" or "vertical".
    source : str
        Column or channel of the file, such as "column 5 'Charge (kg)'".
    unit : str
        Of the file.
    factor : float
        From that unit to SI.
    rows : int
        Values that were read.
    why : str
        Reason for the source or the unit, where the file offered another; empty otherwise.
    """

    quantity: str
    source: str
    unit: str = ""
    factor: float = 1.0
    rows: int = 0
    why: str = ""


@dataclass(frozen=True)
class Loss:
    """Part of a file that was not read ("dropped") or not used ("cut"), and why."""

    kind: str
    part: str
    why: str


@dataclass
class FileRead:
    """File that was read: its format, columns, losses and remarks."""

    file: str
    format: str = ""
    columns: list[Column] = field(default_factory=list)
    losses: list[Loss] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def column(self, quantity: str, source: str, unit: str = "", factor: float = 1.0,
               *, rows: int = 0, why: str = "") -> None:  # fmt: skip
        """Add a quantity that was read, see `Column`."""
        self.columns.append(Column(quantity, source, unit, float(factor), int(rows), why))

    def dropped(self, part: str, why: str) -> None:
        """Add a column, channel or rows that were not read."""
        self.losses.append(Loss("dropped", part, why))

    def cut(self, part: str, why: str) -> None:
        """Add samples or places that were read and not used."""
        self.losses.append(Loss("cut", part, why))

    def remark(self, text: str) -> None:
        """Add a choice that concerns the whole file, such as its byte order or decimal mark."""
        self.remarks.append(text)


class ReadLog:
    """Log of all files that were read, in their order; handed from reader to reader.

    Examples
    --------
    >>> log = ReadLog()
    >>> table = log.file("holes.csv", "table with titles")
    >>> table.column("charge", "column 5 'Actual charge (lb)'", "lb", 0.45359237, rows=12)
    >>> table.dropped("row 14", "sum of the charges")
    >>> print(*log.lines(), sep=chr(10))
    holes.csv: table with titles
      charge: column 5 'Actual charge (lb)', lb, factor 0.453592, 12 values
      dropped row 14: sum of the charges
    """

    def __init__(self) -> None:
        self._files: list[FileRead] = []

    def file(self, path: str | Path, format: str = "") -> FileRead:
        """Begin the entry of a file; later calls on the entry add to it."""
        self._files.append(FileRead(Path(path).name, format))
        return self._files[-1]

    def extend(self, other: "ReadLog") -> None:
        """Add the entries of another log."""
        self._files += other._files

    def table(self) -> list[dict]:
        """Return the entries as dicts for JSON; a file that was read twice alike stands once."""
        rows = []
        for entry in map(asdict, self._files):
            if entry not in rows:
                rows.append(entry)
        return rows

    def lines(self) -> list[str]:
        """Return the entries as lines of text."""
        return input_lines(self.table())


def input_lines(files: list[dict]) -> list[str]:
    """Return the table ``inputs`` of a summary, see `ReadLog.table`, as lines of text."""
    lines = []
    for file in files:
        lines.append(f"{file['file']}: {file['format']}".rstrip(": "))
        lines += [f"  {_sentence(**column)}" for column in file["columns"]]
        lines += [f"  {loss['kind']} {loss['part']}: {loss['why']}" for loss in file["losses"]]
        lines += [f"  {remark}" for remark in file["remarks"]]
    return lines


def _sentence(quantity, source, unit, factor, rows, why):
    """Return a column on one line."""
    parts = [source, unit, f"factor {factor:.6g}" if factor != 1.0 else "",
             f"{rows} values" if rows else ""]  # fmt: skip
    reason = f" ({why})" if why else ""
    return f"{quantity}: {', '.join(filter(None, parts))}{reason}"
