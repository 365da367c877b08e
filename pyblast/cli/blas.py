"""One thread for BLAS, wherever this is imported before numpy is.

Matrices are small here, and threads of BLAS that wait for work take it from others: a posterior of
two unknowns takes 7 s beside two busy processes, and 53 s with them.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
