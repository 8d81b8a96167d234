"""Maps of where the law loses convexity and ellipticity."""

import pytest


@pytest.mark.versions
def test_maps(launch):
    done = launch("stability_map", "--points", 21)
    assert done.status == 0, done.err
    q = done.summary["quantities"]
    assert done.summary["converged"]
    assert done.summary["kernel_mismatch"] < 1e-12
    assert all(
        (done.folder / f"{name}.png").stat().st_size > 10_000 for name in ("p_min", "c", "d", "s_C")
    )
    shares = q["share_of_map_lost"]
    assert (
        shares["0 deg, p_min 0"]["convexity"]
        > shares["0 deg, p_min 0.25"]["convexity"]
        > shares["0 deg, p_min 0.75"]["convexity"]
    )
