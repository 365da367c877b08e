"""What a diagnosis counts of its runs."""

from small_site import recorded, small_site

from pyblast.diagnosis.forward import Forward


def test_a_run_counts_as_kept_once_and_only_if_it_was_there_before(tmp_path):
    case = recorded(small_site())
    made, after = (Forward(case, tmp_path) for _ in range(2))

    for forward in (made, after):
        for _ in range(2):
            forward.simulate([(case.project, "S1")])
    whole = after.run([after.model(case.project, "S1")])[0].wall_seconds

    assert (made.runs, made.cached, made.cached_s) == (2, 0, 0.0)
    assert (after.runs, after.cached, after.cached_s) == (3, 1, whole)
