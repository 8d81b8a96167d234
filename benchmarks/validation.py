"""Bias tests of glass/PP by Cao et al. (2008): the law is fitted to one size, the forces of other
sizes and the angle in the middle are predicted, beside what picture frames measured."""

from bench.validation import FITTED, MIDDLE, fitted, frames, middle_angles, normalised, ratios

from fabric_fenicsx.command_line.study import parser, run
from fabric_fenicsx.coupons.coupon import Coupon


def options():
    p = parser(Coupon, __doc__, "validation")
    p.group("test")
    p.option("--weaves", nargs="+", choices=tuple(FITTED), default=list(FITTED))
    return p


def main(study):
    folder, tests, beside, found = study.folder(), [], [], {}
    for weave in study.args.weaves:
        fabric = fitted(weave)
        found[weave] = {name: getattr(fabric, name) for name in ("s1", "s2", "s3")}
        for row in ratios(weave, fabric):
            tests.append(row)
            numbers = [value for key, value in row.items() if key.endswith("deg")]
            how = "fitted   " if row["fitted"] else "predicted"
            values = " ".join(f"{value:5.2f}" for value in numbers)
            study.say(f"{weave:16s} {row['test']:16s} {how} {values}")
        angles, forces = frames(weave)
        for angle, law, each in zip(angles, normalised(fabric, angles), forces.T):
            row = {"weave": weave, "angle_deg": angle, "law_N_per_mm": float(law)}
            row |= {"frames_least": each.min(), "frames_largest": each.max()}
            beside.append(row)
            study.say(
                f"{weave:16s} {angle:g} deg: frames {each.min():.4f} to {each.max():.4f} N/mm "
                f"(1 to {each.max() / each.min():.1f}), the law {law:.4f} N/mm"
            )
        if weave == "plain":
            simulated = middle_angles(fabric)
            found["middle_deg"] = dict(zip(map(str, MIDDLE), simulated))
            for (d, measured), angle in zip(MIDDLE.items(), simulated):
                by_hand, by_images, formula = measured
                study.say(
                    f"{d} mm: in the middle {by_hand:g} deg by hand, {by_images:g} by images, "
                    f"{angle:.1f} simulated, {formula:g} by the formula"
                )
    study.write_table(folder / "forces.csv", tests)
    study.write_table(folder / "frames.csv", beside)
    study.summarise(folder, converged=True, stroke_reached=1.0, quantities=found)


if __name__ == "__main__":
    run("validation", options(), main)
