"""The picture frame's force is the closed form's, with pre-tension too."""

import pytest


@pytest.mark.versions
@pytest.mark.parametrize(
    "options",
    [
        pytest.param((), marks=pytest.mark.mpi),
        ("--pre-tension", 0.01),
        ("--element", "Q2", "--angle", 60),
    ],
)
def test_normalised_shear_force(launch, options):
    drawn = not options  # one picture will do
    pictures = () if drawn else ("--no-pictures",)
    done = launch("picture_frame", "--quick", "--steps", 10, *options, *pictures)
    assert done.status == 0, done.err
    s, q = done.summary, done.summary["quantities"]
    force, angle = q["normalised_shear_force_N_per_mm"], q["shear_angle_deg"] / 57.29577951308232
    assert force == pytest.approx(q["closed_form_N_per_mm"], rel=1e-8)
    assert q["shear_angle"] == pytest.approx([angle] * 2, abs=1e-7)
    pre = options[1] if "--pre-tension" in options else 0
    assert q["eps_a"] + q["eps_b"] == pytest.approx([pre] * 4, abs=1e-7)
    assert s["kernel_mismatch"] <= 1e-10
    assert not drawn or (done.folder / "shear_force.png").stat().st_size > 10_000
