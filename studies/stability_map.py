"""Where the law loses convexity and ellipticity, over the yarn strains: maps for Table 1, other p_min, c, d, s_C, and thresholds."""

import numpy as np
from scipy.optimize import brentq

from fabric_fenicsx.errors import InputError, SolverFailure
from fabric_fenicsx.material import pointwise, stability
from fabric_fenicsx.material.closed_form import nominal_stresses
from fabric_fenicsx.material.homogeneous import lateral_strain
from fabric_fenicsx.material.parameters import WovenFabric
from fabric_fenicsx.material.paths import conjugate, gradient
from fabric_fenicsx.material.presets import PRESETS
from fabric_fenicsx.study import parser, run

LOW, HIGH = -0.20, 0.08  # yarn strains of the maps
EPS_A = 0.03  # tests of the paper end here; the worst tension-compression state is sought up to it
NOTED_AT = 0.025  # eps_a at which the figures noted for tension-compression are met
DEEPEST = -0.60
P_MIN = (0.0, 0.1, 0.25, 0.4, 0.5, 0.75, 1.0)
NOTED = {0.4: -0.007, 0.25: -0.035, 0.1: -0.08}  # reach in eps_b by p_min
AGREEMENT = 1e-9  # of the kernel's stresses with the closed form, or of s1 where they are smaller
# picture -> ({column: changed parameters}, {row: (changed parameters, gamma in deg)})
WEAK = {"as given": ({}, 0), "p_min 0.25": ({"p_min": 0.25}, 0)}
SHEARED = {f"{g} deg": ({}, g) for g in (0, 20, 40)}
PICTURES = {
    "p_min": ({f"p_min {p:g}": {"p_min": p} for p in P_MIN}, SHEARED),
    "c": ({f"c {v:g}": {"c": v} for v in (5, 10, 23.67, 40, 80)}, WEAK),
    "d": ({f"d {v:g} MPa": {"d": v} for v in (0.065, 0.65, 6.5, 65, 650)}, WEAK),
    "s_C": ({f"s_C {v:g}": {"s_C": v} for v in (0, 10, 100, 300, 1000)}, {k: v for k, v in SHEARED.items() if v[1]}),
}  # fmt: skip


def options():
    p = parser("stability_map", __doc__)
    p.add_argument_group("map").add_argument(
        "--points",
        type=int,
        choices=range(11, 2001),
        metavar="N",
        help="states along each axis, 11 to 2000 (225, with --quick 57)",
    )
    return p


def reach(fabric, eps_a, indicator):
    """eps_b to which the region that begins at eps_b = 0- goes, at each eps_a (n,); nan where none begins, -inf where it has no end above DEEPEST."""

    def value(eps_b):
        e = np.broadcast_to(np.reshape(eps_a, (-1, 1)), eps_b.shape)
        if indicator == "convexity":
            return stability.convexity(fabric, e, eps_b)
        return stability.evaluate(fabric, stability.invariants(e, eps_b)).ellipticity

    start = np.full(np.size(eps_a), -1e-9)
    end = stability.first_loss(lambda e: -value(e), start, DEEPEST)
    return np.where(value(start[:, None])[:, 0] < 0, np.nan_to_num(end, nan=-np.inf), np.nan)


def tension_tension(fabric, largest=0.3):
    """Largest e such that W is convex for all eps_a, eps_b from 0 to e, and eps_b / eps_a of the first state that is not."""
    ratio = np.concatenate(
        [np.linspace(0.01, 1, 100), 1 / np.linspace(0.01, 0.99, 99)]
    )  # not 0: the other side of that kink is compression
    along = np.stack([np.minimum(1, 1 / ratio), np.minimum(ratio, 1)])[:, :, None]
    e = stability.first_loss(lambda s: stability.convexity(fabric, *(along * s)), np.full(len(ratio), 1e-6), largest)
    if np.isnan(e).all():
        return None, None
    k = np.nanargmin(e)
    return float(e[k]), float(ratio[k])


def free_uniaxial(fabric, indicator, n=60):
    """First eps_a of free uniaxial tension along a, up to `EPS_A`, at which the indicator is lost, or None."""
    eps_a = np.linspace(0.0005, EPS_A, n)
    eps_b = lateral_strain(fabric, 0, eps_a)
    lost = getattr(stability.evaluate(fabric, stability.invariants(eps_a, eps_b)), indicator) < 0
    return float(eps_a[lost.argmax()]) if lost.any() else None


def onset_p_min(fabric):
    """Largest p_min with an indefinite Hessian at eps_b = 0- for some eps_a up to EPS_A, None if there is none."""
    eps_a = np.geomspace(1e-5, EPS_A, 2000)

    def least(p):
        return stability.convexity(fabric.replace(p_min=p), eps_a, -1e-9).min()

    return brentq(least, 0.0, 1.0, xtol=1e-10) if least(0.0) < 0 < least(1.0) else None


def onset_gamma(fabric):
    """Shear angle [deg] from which W is not convex in tension-compression (eps_a to EPS_A, eps_b to LOW), None up to 60."""
    eps_a, eps_b = np.meshgrid(np.linspace(0.001, EPS_A, 16), np.linspace(LOW, -1e-6, 41))

    def least(gamma):
        return np.array([[stability.convexity(fabric, eps_a, eps_b, g).min() for g in row] for row in gamma])

    found = stability.first_loss(least, 0.0, np.radians(60), samples=121)[0]
    return None if np.isnan(found) else float(np.degrees(found))


def thresholds(fabric, noted):
    """Rows of thresholds.csv; `noted`: compare with the figures known for Table 1."""
    rows = []

    def add(quantity, value, unit, at="", note=None, agrees=None, **changed):
        rows.append(
            {
                "quantity": quantity,
                "p_min": "",
                "value": value,
                "unit": unit,
                "at": at,
                "noted": note if noted else None,
                "agrees": agrees if noted else None,
            }
            | changed
        )

    eps_a = np.linspace(0.0, EPS_A, 301)[1:]
    for p in P_MIN:
        changed = fabric.replace(p_min=p)
        for indicator in ("convexity", "ellipticity"):
            found = reach(changed, eps_a, indicator)
            begins = not np.isnan(found).all()
            worst = np.nanargmin(found) if begins else 0
            endless = np.isinf(found[worst])
            name = f"tension-compression: reach of lost {indicator} in eps_b"
            if indicator == "convexity":
                here = _plain(reach(changed, np.array([NOTED_AT]), indicator)[0])
                note = (
                    f"{NOTED[p]:g}" if p in NOTED else {0.0: "beyond -0.2", 0.5: "none", 0.75: "none", 1.0: "none"}[p]
                )
                same = (
                    here is None
                    if note == "none"
                    else here is not None and (here < LOW if p == 0 else abs(here - NOTED[p]) < 1e-3)
                )
                add(name, here, "-", f"eps_a = {NOTED_AT}", note, same, p_min=p)
                add(
                    f"{name}, d and a neglected",
                    float(np.log(p / (1 - p)) / fabric.warp.c) if 0 < p < 0.5 else None,
                    "-",
                    "eps_a -> 0+",
                    p_min=p,
                )
            at = (
                f"eps_a to {EPS_A}"
                if not begins
                else f"eps_a = {eps_a[worst]:.4f}" + (f"; no end down to {DEEPEST}" if endless else "")
            )
            add(f"{name}, worst", max(float(found[worst]), DEEPEST) if begins else None, "-", at, p_min=p)
        value, ratio = tension_tension(changed)
        note = {0.75: "at least 0.06", 0.5: "about 0.05"}.get(p)
        same = None if note is None or value is None else value >= 0.06 if p == 0.75 else abs(value - 0.05) < 2e-3
        add(
            "tension-tension: convex up to",
            value,
            "-",
            "" if ratio is None else f"eps_b / eps_a = {ratio:.3g}",
            note,
            same,
            p_min=p,
        )
        for indicator in ("convexity", "ellipticity"):
            add(
                f"free uniaxial tension: {indicator} lost from eps_a",
                free_uniaxial(changed, indicator),
                "-",
                f"eps_a to {EPS_A}",
                p_min=p,
            )
        add("tension-compression: convexity lost from gamma", onset_gamma(changed), "deg", "gamma to 60", p_min=p)
    add(
        "tension-compression: p_min below which convexity is lost at eps_b = 0-",
        onset_p_min(fabric),
        "-",
        f"eps_a to {EPS_A}",
    )
    onset = onset_p_min(fabric.replace(d=1e-9))
    add("the same, d -> 0", onset, "-", "eps_a -> 0+", "0.5", onset is not None and abs(onset - 0.5) < 1e-3)
    for gamma in (0.0, 0.111):  # at rest and at the softest shear
        for name, b in (("one yarn", 0.0), ("both yarns", 1.0)):
            value = stability.first_loss(
                lambda e: stability.evaluate(fabric, stability.invariants(e, b * e, gamma)).ellipticity, -1e-9, LOW
            )[0]
            add(f"compression along {name}: ellipticity lost from", _plain(value), "-", f"gamma = {gamma} rad")
    e = np.linspace(LOW, HIGH, 141)
    add(
        "FABRIC baseline: least convexity indicator over the map",
        float(stability.convexity(fabric.decoupled(), e[:, None], e).min() / (2 * min(fabric.warp.d, fabric.weft.d))),
        "-",
    )
    return rows


def _plain(value):
    return None if np.isnan(value) else float(value)


def mismatch(fabric, e):
    """Largest difference of the kernel's nominal stresses from the closed form over the map, relative or to s1."""
    worst = 0.0
    for gamma in np.radians((0, 20, 40)):
        strains = [v.ravel() for v in np.broadcast_arrays(e[:, None], e, gamma)]
        F = gradient(*strains)
        kernel, closed = (
            conjugate(F @ pointwise.evaluate(fabric, gradient=F).S, F),
            np.stack(nominal_stresses(fabric, *strains), -1),
        )
        worst = max(
            worst, float((np.abs(kernel - closed).max(1) / np.maximum(np.linalg.norm(closed, axis=1), fabric.s1)).max())
        )
    return worst


def main(study):
    args, fabric = study.args, study.fabric
    if not isinstance(fabric, WovenFabric):
        raise InputError(f"--material {args.material} is tabulated; allowed is a material with parameters")
    folder = study.folder()
    e = np.linspace(LOW, HIGH, args.points or (57 if args.quick else 225))
    maps, shares = {}, {}
    for name, (columns, rows) in PICTURES.items():
        maps[name] = {}
        for row, (common, gamma) in rows.items():
            for column, changed in columns.items():
                found = stability.evaluate(
                    fabric.replace(**common | changed), stability.invariants(e, e[:, None], np.radians(gamma))
                )
                maps[name][row, column] = found.convexity, found.ellipticity
                lost = {
                    "convexity": found.convexity < 0,
                    "ellipticity": found.ellipticity < 0,
                    "out_of_plane": found.out_of_plane < 0,
                }
                shares[f"{row}, {column}"] = {k: round(float(v.mean()), 4) for k, v in lost.items()}
    rows = thresholds(fabric, noted=fabric == PRESETS["komeili"])
    gap = mismatch(fabric, e[:: max(1, len(e) // 57)])
    disagree = [f"{r['quantity']}, p_min {r['p_min']}" for r in rows if r["agrees"] is False]
    study.summarise(
        folder, converged=gap <= AGREEMENT, stroke_reached=1.0, dofs=0, cells=0, terms=[], material=fabric.name, couplings=sorted(fabric.couplings),
        kernel_mismatch=gap, quantities={"states_per_map": len(e) ** 2, "thresholds": rows, "thresholds_that_differ_from_those_noted": disagree, "share_of_map_lost": shares},
    )  # fmt: skip
    study.write_table(folder / "thresholds.csv", rows)
    if study.comm.rank == 0 and not args.no_pictures:
        from fabric_fenicsx.results.pictures import regions

        for name, panels in maps.items():
            regions(folder / f"{name}.png", 100 * e, panels, r"$\varepsilon_a$ / %", r"$\varepsilon_b$ / %")
    study.say(
        f"{folder}: {sum(map(len, maps.values()))} maps, {len(rows)} thresholds; differing from those noted: {', '.join(disagree) or 'none'}"
    )
    if gap > AGREEMENT:
        raise SolverFailure(
            f"kernel and closed form differ by {gap:.1e}, more than {AGREEMENT}, so the maps can't be trusted"
        )


if __name__ == "__main__":
    run("stability_map", options(), main)
