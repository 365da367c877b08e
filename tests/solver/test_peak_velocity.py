import numpy as np
import pytest

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Viscous
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver
from pyblast.model.source import PointForce, TimeFunction
from pyblast.solver.run import simulate


@pytest.fixture(scope="module")
def model():
    return Model(
        structured_box((4, 4, 4), (40.0, 40.0, 40.0)),
        {"rock": Material.from_speeds(2700.0, 5000.0, 3000.0)},
        boundaries=[Viscous("bottom")],
        sources=[PointForce((10.0, 20.0, 40.0), (0.0, 0.0, -1.0),
                            TimeFunction(1e6 * np.hanning(41), 1e-3))],
        receivers=[Receiver("R1", (30.0, 20.0, 40.0))],
    )  # fmt: skip


def test_peaks_of_nodes_are_those_of_receivers_and_change_no_bit(model):
    plain, peaks = simulate(model, 0.08), simulate(model, 0.08, peaks_to=50.0)

    node = np.linalg.norm(model.nodes.points - [30.0, 20.0, 40.0], axis=1).argmin()
    assert len(plain.peak_velocity) == 0
    np.testing.assert_array_equal(
        plain.seismograms["R1"].velocity, peaks.seismograms["R1"].velocity
    )
    assert peaks.peak_velocity[node] == pytest.approx(peaks.seismograms["R1"].pvs, rel=0.0124)
    assert peaks.peak_velocity[node] <= peaks.seismograms["R1"].pvs * (1.0 + 1e-6)


def test_peaks_go_on_from_a_checkpoint(model, tmp_path):
    whole = simulate(model, 0.08, peaks_to=50.0)
    path = tmp_path / "checkpoint.h5"

    def stop(stage, done, total):
        if stage == "dynamic" and 2 * done >= total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(model, 0.08, peaks_to=50.0, checkpoint=path, progress=stop)
    resumed = simulate(model, 0.08, peaks_to=50.0, resume=path)

    np.testing.assert_array_equal(whole.peak_velocity, resumed.peak_velocity)
