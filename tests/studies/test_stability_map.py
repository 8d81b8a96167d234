"""The maps' thresholds are those known for Table 1."""

import csv

import pytest


@pytest.mark.versions
def test_thresholds(launch):
    done = launch("stability_map", "--quick")
    assert done.status == 0, done.err
    q = done.summary["quantities"]
    assert done.summary["converged"]
    assert done.summary["kernel_mismatch"] < 1e-12
    with open(done.folder / "thresholds.csv") as file:
        table = list(csv.DictReader(file))
    rows = {(r["quantity"], r["p_min"]): r for r in table}
    assert len(table) == len(q["thresholds"])
    region = "tension-compression: reach of lost convexity in eps_b"
    reach = {p: float(rows[region, p]["value"]) for p in ("0.4", "0.25", "0.1", "0.0")}
    assert reach == {
        "0.4": pytest.approx(-0.0066, abs=5e-5),
        "0.25": pytest.approx(-0.0353, abs=5e-5),
        "0.1": pytest.approx(-0.0798, abs=5e-5),
        "0.0": pytest.approx(-0.2158, abs=5e-5),
    }
    for p in ("0.5", "0.75", "1.0"):
        assert rows[region, p]["value"] == rows[f"{region}, worst", p]["value"] == ""
    tension = {p: float(rows["tension-tension: convex up to", p]["value"]) for p in ("0.5", "0.75")}
    assert tension["0.5"] == pytest.approx(0.0493, abs=1e-4) and tension["0.75"] >= 0.06
    assert float(rows["the same, d -> 0", ""]["value"]) == pytest.approx(0.5, abs=1e-3)
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
