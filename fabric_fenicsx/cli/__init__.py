"""Command lines, outermost: options, what is printed, exit status. Nothing that computes imports
it."""

import gc
import os
import sys

# Open MPI starts a daemon for a process without mpirun, which takes 0.2 s and serves MPI_Comm_spawn
os.environ.setdefault("OMPI_MCA_ess_singleton_isolated", "1")
# modules are no garbage, and looking for it takes a tenth of their import
gc.set_threshold(100_000)
# what a terminal cannot show is shown as \xe4, and ends no run
for stream in (sys.stdout, sys.stderr):
    if hasattr(stream, "reconfigure"):
        stream.reconfigure(errors="backslashreplace")
