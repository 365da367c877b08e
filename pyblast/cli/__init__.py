"""Command line; importing it before numpy gives BLAS one thread.

Matrices are small here, and BLAS threads that wait for work take time from other processes: a
posterior of two parameters takes 7 s beside two busy processes, and 53 s with such threads. Worker
processes inherit the setting. A script that imports pyblast keeps its own.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
