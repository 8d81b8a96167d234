"""Maps of where the law loses convexity and ellipticity."""

import pytest


@pytest.mark.versions
def test_maps(launch):
    done = launch("stability_map", "--quick")
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


def test_a_material_of_curves_has_no_p_min(launch, tmp_path):
    for name, head in (
        ("warp", "eps [-], sigma [MPa]"),
        ("weft", "eps [-], sigma [MPa]"),
        ("shear", "gamma [rad], tau [MPa]"),
    ):
        (tmp_path / f"{name}.csv").write_text(f"{head}\n0, 0\n0.1, 1\n0.2, 3\n")
    (tmp_path / "table.toml").write_text(
        'model = "fabric"\nthickness_mm = 1\ndensity_g_per_cm3 = 1\nwarp = "warp.csv"\nweft '
        '= "weft.csv"\nshear = "shear.csv"\n'
    )
    done = launch("stability_map", "--material", "table.toml")
    assert done.status == 2
    assert "tabulated" in done.err
    assert done.summary is None
