"""Maps of where the law loses convexity and ellipticity."""

import pytest


@pytest.mark.versions
def test_maps(launch):
    done = launch("stability_map", "--points", 21)
    assert done.status == 0, done.err
    q = done.summary["quantities"]
    assert done.summary["converged"]
    assert done.summary["kernel_mismatch"] < 1e-12
    for name in ("p_min", "c", "d", "s_C"):
        assert (done.folder / f"{name}.png").stat().st_size > 10_000
    names = [f"0 deg, p_min {p}" for p in (0, 0.25, 0.75)]
    low, middle, high = (q["share_of_map_lost"][name]["convexity"] for name in names)
    assert low > middle > high
