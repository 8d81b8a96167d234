"""Bias tests of glass/PP by Cao et al. (2008): the law is fitted to one size, the forces of other
sizes and the angle in the middle are predicted, beside what picture frames measured."""

import bench
from bench.validation import FITTED, MIDDLE, fitted, frames, middle_angles, normalised, ratios

from fabric_fenicsx.cli.study import run


def options():
    p = bench.options("validation", __doc__)
    p.option("--weaves", nargs="+", choices=tuple(FITTED), default=list(FITTED))
    return p


def main(study):
    study.folder()
    tests, beside, found = [], [], {}
    for weave in study.args.weaves:
        fabric = fitted(weave)
        found[weave] = {name: getattr(fabric, name) for name in ("s1", "s2", "s3")}
        for row in ratios(weave, fabric):
            tests.append(row)
            how = "fitted   " if row["fitted"] else "predicted"
            values = " ".join(f"{v:5.2f}" for key, v in row.items() if key.endswith("deg"))
            study.say(f"{weave:16s} {row['test']:16s} {how} {values}")
        angles, forces = frames(weave)
        lows, highs = forces.min(0), forces.max(0)
        for angle, law, low, high in zip(angles, normalised(fabric, angles), lows, highs):
            row = {"weave": weave, "angle_deg": angle, "law_N_per_mm": float(law)}
            beside.append(row | {"frames_least": low, "frames_largest": high})
            study.say(
                f"{weave:16s} {angle:g} deg: frames {low:.4f} to {high:.4f} N/mm "
                f"(1 to {high / low:.1f}), the law {law:.4f} N/mm"
            )
        if weave == "plain":
            simulated = middle_angles(fabric)
            found["middle_deg"] = dict(zip(map(str, MIDDLE), simulated))
            for (d, (by_hand, by_images, formula)), angle in zip(MIDDLE.items(), simulated):
                study.say(
                    f"{d} mm: in the middle {by_hand:g} deg by hand, {by_images:g} by images, "
                    f"{angle:.1f} simulated, {formula:g} by the formula"
                )
    bench.finish(study, {"forces": tests, "frames": beside}, quantities=found)


if __name__ == "__main__":
    run("validation", options(), main)
