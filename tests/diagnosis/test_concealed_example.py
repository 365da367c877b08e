"""The example that conceals an effect: what its command may read."""

from pathlib import Path

from pyblast.diagnosis.case import case_of
from pyblast.project.project import load_project, with_further

EXAMPLE = Path(__file__).parents[2] / "examples" / "concealed"


def test_the_diagnosis_reads_neither_the_truth_nor_the_blast_that_it_predicts():
    project = with_further(load_project(EXAMPLE / "B2.toml"))
    read = {name for each in project.shots for name in each.input_files}

    assert not {name for name in read if name.startswith(("truth", "further"))}
    assert "truth.toml" not in "".join(
        line for line in (EXAMPLE / "proof.py").read_text().splitlines() if "open" in line
    )
    assert case_of(project).motion.shape[:2] == (3, 9)
