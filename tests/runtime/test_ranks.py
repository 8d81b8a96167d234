"""How commands are started on several ranks."""

import os
from importlib.util import find_spec

import pytest

from fabric_fenicsx.runtime.ranks import RANKS_ENVIRONMENT, on_ranks

CORES = len(os.sched_getaffinity(0))


@pytest.mark.skipif(bool(find_spec("dolfinx_solver")), reason="MPICH has no such option")
@pytest.mark.parametrize("ranks, gives_up", [(1, "0"), (CORES, "0"), (CORES + 1, "1")])
def test_ranks_give_up_their_core_only_where_they_share_it(ranks, gives_up):
    words = on_ranks(ranks)
    assert words[words.index("mpi_yield_when_idle") + 1] == gives_up
    # inherited by runs on one rank, which beside other work took six times as long with it
    assert not any("yield" in name for name in RANKS_ENVIRONMENT)
