"""Benchmarks of the program against itself and others, and what their scripts share."""

from fabric_fenicsx.cli.study import parser
from fabric_fenicsx.coupons.coupon import Coupon


def options(name, description, **defaults):
    """Parser of the benchmark `name`, for its own options; defaults: of those of all studies."""
    p = parser(Coupon, description, name, **defaults)
    p.group("test")
    return p


def finish(study, tables, converged=True, **facts):
    """Write the `tables` {name: rows} as CSV and the summary with these `facts`."""
    folder = study.folder()
    for name, rows in tables.items():
        study.write_table(folder / f"{name}.csv", rows)
    study.summarise(folder, converged=converged, stroke_reached=1.0, **facts)
