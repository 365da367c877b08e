"""Survey: shots, the receivers that stand around them, and what these recorded."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from .errors import InputError
from .model.model import Receiver
from .recordings.recording import Recording
from .sources.shot import Shot


@dataclass(frozen=True, eq=False)
class Survey:
    """Survey: shots in one ground, receivers, and recordings.

    Parameters
    ----------
    shots : tuple of Shot
    receivers : tuple of Receiver, optional
        Of every shot; by default those that the file of each shot names, on the ground.
    recorded : dict of str to dict of str to Recording, optional
        By shot and receiver, in place of the recordings of the files.
    band : tuple of 2 float, Hz, optional
        In which records are compared, in place of ``run.compare_band_hz``.
    """

    shots: tuple[Shot, ...]
    receivers: tuple[Receiver, ...] | None = None
    recorded: Mapping[str, Mapping[str, Recording]] | None = None
    band: tuple[float, float] | None = None

    def shot(self, name: str) -> Shot:
        """Return a shot by its name.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        for shot in self.shots:
            if shot.name == name:
                return shot
        known = ", ".join(shot.name for shot in self.shots)
        raise InputError(f"case: no blast {name!r}; there are {known}")

    @property
    def recordings(self) -> dict[str, dict[str, Recording]]:
        """Recordings by shot and receiver, as their instruments wrote them."""
        if self.recorded is None:
            return {shot.name: shot.recordings for shot in self.shots}
        return {shot.name: dict(self.recorded.get(shot.name, {})) for shot in self.shots}

    def edited(self, act: Callable[[str, dict[str, Recording]], Mapping[str, Recording]]):
        """Return the survey with other recordings.

        Parameters
        ----------
        act : callable
            Takes the name of a shot and its recordings by receiver, returns those in their place.
        """
        tables = {name: act(name, table) for name, table in self.recordings.items()}
        return replace(self, recorded=tables)
