"""All tests with concealed effects, in turn; writes outcomes.json. Argument: the folder."""

import odd_channels
import t1b_sensor_response
import t2_air_wave
import t3_firing_times
import t4_soft_layer
import t5_clipped_and_dead
import t7_closure_law

TESTS = (
    t1b_sensor_response, t2_air_wave, t3_firing_times, t4_soft_layer, t5_clipped_and_dead,
    t7_closure_law, odd_channels,
)  # fmt: skip

if __name__ == "__main__":
    for test in TESTS:
        test.main()
