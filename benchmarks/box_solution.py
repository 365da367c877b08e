"""Motion of boxes in closed form: a point force between rollers, a pulse across parallel joints.

Sources: Stokes (1849), Aki & Richards (2002) equation (4.23), with images; Schoenberg (1980).
"""

import numpy as np


class Ricker:
    """A Ricker pulse, its first derivative and its two first integrals, at times in s.

    Parameters
    ----------
    dominant, peak : float, Hz and s
    """

    def __init__(self, dominant, peak):
        self.rate, self.peak = np.pi * dominant, peak

    def __call__(self, times, order=0):
        """Return the derivative of an order from 1 down to -2."""
        x = self.rate * (np.asarray(times) - self.peak)
        forms = {
            1: self.rate * (4.0 * x**3 - 6.0 * x),
            0: 1.0 - 2.0 * x**2,
            -1: x / self.rate,
            -2: np.full_like(x, -0.5 / self.rate**2),
        }
        return forms[order] * np.exp(-(x**2))


def roller_box(times, size, rock, source, force, pulse, receivers, order=1):
    """Return the motion (n_times, n_receivers, 3) in a box on rollers by a point force.

    Parameters
    ----------
    times : (n_times,) float, s
    size : (3,) float, m
    rock : Material
    source, force : (3,) float, m and N
    pulse : Ricker
    receivers : (n_receivers, 3) float, m
    order : {1, 0}
        Velocity or displacement.
    """
    motion = np.zeros((len(times), len(receivers), 3))
    for place, push in _images(times[-1], np.asarray(size), rock.cp, source, force):
        for number, receiver in enumerate(receivers):
            offset = receiver - place
            distance = np.linalg.norm(offset)
            if distance < rock.cp * times[-1]:
                motion[:, number] += _full_space(times, offset, distance, rock, push, pulse, order)
    return motion / (4.0 * np.pi * rock.density)


def _images(duration, size, speed, source, force):
    """List places and forces of the images whose waves may arrive."""
    reach = np.ceil(speed * duration / (2.0 * size)).astype(int) + 1
    found = []
    for cell in np.ndindex(*(2 * reach + 1)):
        for turned in np.ndindex(2, 2, 2):
            sign = 1.0 - 2.0 * np.array(turned)
            found.append((2.0 * (cell - reach) * size + sign * source, sign * force))
    return found


def _full_space(times, offset, distance, rock, force, pulse, order):
    """Return the motion by one force, times 4 pi rho."""
    ray = offset / distance
    along = ray * (ray @ force)
    near = 0.0
    for speed, sign in ((rock.cp, 1.0), (rock.cs, -1.0)):
        delay = distance / speed
        late = times - delay
        near = near + sign * (delay * pulse(late, order - 1) + pulse(late, order - 2))
    far = np.outer(pulse(times - distance / rock.cp, order), along / rock.cp**2)
    far -= np.outer(pulse(times - distance / rock.cs, order), (along - force) / rock.cs**2)
    return np.outer(near, 3.0 * along - force) / distance**3 + far / distance


def past_joints(times, places, start, joints, speed, impedance, stiffness, pulse):
    """Return the velocity (n_times, n_places) of a P pulse that comes from below to joints.

    Parameters
    ----------
    times : (n_times,) float, s
    places : (n_places,) float, m
        Before the first joint or behind the last.
    start : float, m
        Where ``pulse`` is what passes when there are no joints.
    joints : (n,) float, m, evenly spaced
    speed, impedance, stiffness : float, m/s, Pa s/m, Pa/m
    pulse : callable
        Velocity at times.
    """
    n, dt = 1 << 14, 2.5e-4
    clock = (np.arange(n) - n // 2) * dt
    omega = 2.0 * np.pi * np.fft.rfftfreq(n, dt)
    spectrum = np.conj(np.fft.rfft(np.fft.ifftshift(pulse(clock))))
    g = 0.5 * omega * impedance / stiffness
    one = np.moveaxis(np.array([[1.0 + 1j * g, -1j * g], [1j * g, 1.0 - 1j * g]]), 2, 0)
    turn = np.exp(1j * omega * (joints[1] - joints[0]) / speed)
    way = np.stack([turn, np.conj(turn)], axis=1)[:, :, None]
    total = one
    for _ in joints[1:]:
        total = one @ (way * total)
    passing, back = 1.0 / total[:, 1, 1], -total[:, 1, 0] / total[:, 1, 1]
    motion = np.empty((len(times), len(places)))
    for number, place in enumerate(places):
        if place > joints[-1]:
            part = passing * np.exp(1j * omega * (place - joints[-1] + joints[0] - start) / speed)
        else:
            part = np.exp(1j * omega * (place - start) / speed)
            part += back * np.exp(1j * omega * (2.0 * joints[0] - place - start) / speed)
        wave = np.fft.fftshift(np.fft.irfft(np.conj(spectrum * part), n))
        motion[:, number] = np.interp(times, clock, wave)
    return motion
