"""What the program costs, measured by commands that anyone can run."""

import os

# Matrices are small here, and threads of BLAS that wait for work take it from others.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
