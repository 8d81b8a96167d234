"""What a run gives, as numbers that are compared."""

from fabric_fenicsx.results.ply import plan_area, ply_of, whole
from fabric_fenicsx.results.wrinkles import MIN_RIDGE

KINDS = ("strain", "bending", "metal", "plastic", "friction", "viscous", "external_work")
NAMES = ("shear_angle_max_deg", "shear_angle_99_percent_deg", "thickness_min_mm")
NAMES += "draw_in.largest_mm", "shortening_max", "force_of_whole_blank_N"
NAMES += "width_at_middle_mm", "springback_largest_mm"
WRINKLES = ("wrinkles.height_mm", "wrinkles.height_rms_mm", "wrinkles.rim_mm")


def outcome(result, times=1):
    """{name: number} of a result: the curve, energies, angles, draw-in, thickness and heights of
    wrinkles; forces and energies `times` as large, as of the whole blank."""
    found = {f"{k}.force": times * row["reaction_N"] for k, row in enumerate(result.rows)}
    energy = result.summary["energy"]
    found |= {f"energy.{k}": times * v for k, v in energy.items() if k in KINDS}
    if result.scene.comm.rank == 0:
        flat = [whole(ply_of(grid)) for grid in result.grids.values()]
        found["flat_mm2"] = sum(float(abs(plan_area(p.x, p.cells)).sum()) for p in flat)
    for name in (*NAMES, *WRINKLES):
        if (value := result.number(name)) is not None:
            found[name] = value
    return found


def differences(one, other, within, besides=()):
    """Sentences on numbers of two outcomes that differ by more than `within` of them, or of the
    largest of their kind."""
    largest = dict.fromkeys(("shear_angle_max_deg", "shear_angle_99_percent_deg"), 1.0)
    largest["wrinkles"] = MIN_RIDGE  # mm: lower rims are flat
    for name, value in one.items():
        largest[kind(name)] = max(largest.get(kind(name), 1e-9), abs(value))
    told = [f"{name} is there once" for name in {*one} ^ {*other}]
    for name in sorted(one.keys() & other.keys() - {*besides}):
        if abs(one[name] - other[name]) > within * largest[kind(name)]:
            told.append(f"{name} {one[name]:.12g} -> {other[name]:.12g}")
    return told


def kind(name):
    return "force" if name.endswith("force") else name.partition(".")[0]
