"""T1b: an acoustic sensor and a laser at two places; whether the one that is not flat is named.

Hidden: that the acoustic channel is not flat. The tool is asked twice, with and without being
given that the laser is calibrated. Controls: the acoustic record replaced by the laser's, with a
gain and noise; the acoustic record corrected by the spectrum of the *other* place.
Argument: the folder.
"""

import numpy as np
from keeper import Sealed, folder_of_recordings, keep

from pyblast.line_records.quality import sensor_response

BAND, DT, PLACES = (60e3, 600e3), 1e-7, ("frontcenter", "fronttop")
NAMES = ("acoustic", "laser")


def records(folder):
    """Return the records of both sensors, (2 places, n_samples) each."""
    return [np.array([np.genfromtxt(folder / "ae_laser" / f"{kind}_{place}_S{volts}V.csv",
                                    delimiter=",", skip_header=1)[:, 1] for place in PLACES])
            for kind, volts in (("AE", 100), ("LDV", 200))]  # fmt: skip


def asked(name, truth, acoustic, laser, outcome, reference: str | None = "laser"):
    """Seal, ask, open, score."""
    sealed = Sealed(name, truth)
    said = sensor_response(acoustic, laser, DT, BAND, names=NAMES, reference=reference)
    sealed.answered([said])
    opened = sealed.opened()
    right = said.outcome == outcome and said.target == tuple(opened["target"])
    before, after = said.held_out or (0.0, 0.0)
    return sealed.scored(right, misfit_flat=before, misfit_response=after)


def main():
    """Run the test and keep its rows."""
    acoustic, laser = records(folder_of_recordings())
    rng = np.random.default_rng(1)
    truth = {"label": "instrument_response", "target": ["acoustic"]}
    none = {"label": None, "target": []}
    both = {"label": "instrument_response", "target": list(NAMES)}
    copies = 2500.0 * (laser + 0.05 * laser.std() * rng.normal(size=laser.shape))
    power = [np.abs(np.fft.rfft(one)) ** 2 for one in (acoustic, laser)]
    even = [[np.convolve(row, np.ones(41), "same") for row in one] for one in power]
    smooth = np.sqrt(np.divide(even[0], even[1]))
    restored = np.fft.irfft(np.fft.rfft(acoustic) / smooth[::-1], acoustic.shape[1])
    keep("T1b", {
        "acoustic sensor": asked("acoustic sensor", truth, acoustic, laser, "NAMED"),
        "no reference": asked("no reference", both, acoustic, laser, "CLASS", None),
        "control: laser twice": asked("laser twice", none, copies, laser, "NULL"),
        "control: put right by the other place": asked("put right", none, restored, laser, "NULL"),
    })  # fmt: skip


if __name__ == "__main__":
    main()
