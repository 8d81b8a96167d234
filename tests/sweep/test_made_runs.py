"""What a sweep tells of runs, of made ones with known numbers."""

import csv
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from fabric_fenicsx.cli import sweep
from fabric_fenicsx.core.errors import InputError, SolverFailure
from fabric_fenicsx.sweep import results
from fabric_fenicsx.sweep.folder import Range, Run
from fabric_fenicsx.sweep.results import below
from fabric_fenicsx.sweep.runner import SweepRun


@pytest.fixture
def made(tmp_path):
    """Function that makes a run with these values and this summary."""

    def make(values, status=0, options=(), **summary):
        folder = tmp_path / f"{len([*tmp_path.iterdir()])}"
        folder.mkdir()
        usual = {"verdict": "ok", "stroke_reached": 1.0, "reasons": []}
        (folder / "summary.json").write_text(json.dumps(usual | summary))
        return Run({k: str(v) for k, v in values.items()}, folder, status, [*options])

    return make


@pytest.fixture
def line(made):
    """Function of numbers and of a quantity q there to the runs of such a sweep over p."""

    def make(p, q, **summary):
        return [made({"a.p": x}, quantities={"q": y}, **summary) for x, y in zip(p, q)]

    return make


def test_scatter_of_four_runs(made):
    """10 + 8 (a - 1/2) + 4 (b - 1/2) + 1/2 where both are on one side, else - 1/2."""
    ranges = Range("m.b", 1.0, 1e4), Range("m.a", 0.0, 4.0)  # b counts by its logarithm
    places = {(1, 10): 7.5, (3, 10): 10.5, (1, 1000): 8.5, (3, 1000): 13.5}
    runs = [made({"m.b": b, "m.a": a}, quantities={"q": q}) for (a, b), q in places.items()]
    found = results.spread(runs, ranges, "q")
    assert (found["runs"], found["mean"]) == (4, pytest.approx(10))
    assert found["deviation"] == pytest.approx(math.sqrt(4 * (4 + 1 + 0.25) / 3))
    assert found["bounds"] == pytest.approx([7.65, 13.05])  # 15 % off the ends of three intervals
    keys = "low", "high", "change", "error", "share"
    numbers = [[each[key] for key in keys] for each in found["effects"]]
    whole = 64 / 12 + 16 / 12 + 1  # one degree of freedom is left
    assert [each["name"] for each in found["effects"]] == ["a", "b"]
    assert numbers[0] == pytest.approx([0, 4, 8, 2, 64 / 12 / whole])
    assert numbers[1] == pytest.approx([1, 1e4, 4, 2, 16 / 12 / whole])
    assert found["left"] == pytest.approx(1 / whole)
    lost = made({"m.b": 10, "m.a": 2}, status=3, quantities={"q": 99})
    labels, limits = {"q": "length [mm]"}, [("q", 8.5), ("q", 8.6)]
    told, spreads = results.statistics([*runs, lost], ranges[1:], labels, limits)
    assert [*spreads] == ["q"] and told[0].splitlines() == [
        "length [mm]: mean 10, standard deviation 2.65, 90 % of 4 runs between 7.65 and 13.05",
        "  a from 0 to 4: +8 +- 3, 68 % of the variance",
        "  not explained linearly: 32 %",
    ]
    assert told[1:3] == ["q below 8.5: in 1 of 4 runs", "q below 8.6: in 2 of 4 runs"]
    assert told[3].startswith("1 of 5 runs are not valid and left out")
    with pytest.raises(SolverFailure, match="4 of 5 runs are valid, too few"):
        results.statistics([*runs, lost], ranges, labels)


def test_a_design_fills_its_ranges():
    """Each number is once in each of as many equal intervals, of logarithms from tenfold on."""
    ranges = Range("a", 2.0, 10.0), Range("b", 1.0, 9.9), Range("c", 1.0, 10.0)
    values = results.design(ranges, 16)
    a, b, c = (np.array([float(each[key]) for each in values]) for key in "abc")
    for share in (a - 2) / 8, (b - 1) / 8.9, np.log10(c):
        assert sorted((16 * share).astype(int)) == [*range(16)]
    assert results.design(ranges, 8) == values[:8]
    assert [r.share(4.0) for r in ranges] == pytest.approx([0.25, 3 / 8.9, math.log10(4)])


@pytest.mark.parametrize(
    "p, q, limit, told",
    [
        ((1, 2, 6), (4, 3, 1), 2.5, "from p = 3 on (between runs, interpolated)"),
        ((1, 10, 1000), (4, 3, 1), 2.5, "from p = 31.62 on (between runs, interpolated)"),
        ((1, 2, 9.9), (4, 3, 1), 2.5, "from p = 3.975 on (between runs, interpolated)"),
        ((6, 1, 2), (5, 1, 1), 2, "up to p = 3 (between runs, interpolated)"),
        ((1, 2, 4, 6), (5, 1, 1, 2), 1.5, "from p = 1.875 on and up to p = 5 (between"),
        ((1, 2), (4, 3), 4.5, "in all runs, from p = 1 on"),
        ((1, 2), (4, 3), 3, "in no run; the least is 3 at p = 2"),
    ],
)
def test_where_a_quantity_is_below_a_limit(line, p, q, limit, told):
    words = below(line(p, q), "q", limit)
    assert words.startswith(f"q below {limit}: {told}")
    is_both = {*np.sign(np.diff(np.array(q)[np.argsort(p)]))} >= {-1, 1}
    assert ("it is not monotonic" in words) == is_both


def test_runs_without_a_value_are_left_out_with_the_reason(line):
    rough = [{"text": "rough", "of": "q"}, {"text": "at the rim", "of": ""}]
    runs = line((1, 3), (4, 2)) + line((2,), (0,), reasons=rough) + line((5,), (None,))
    runs += line((4,), (0,), verdict="invalid")
    assert below(runs, "q", 3).split("; ")[:4] == [
        "q below 3: from p = 2 on (between runs, interpolated)",
        "left out (doubtful, see the table): p = 2",
        "left out (not valid): p = 4",
        "left out (without a value): p = 5",
    ]
    assert "no valid run has a value; left" in below(runs[2:], "q", 3)


def test_the_error_of_the_cells_is_told(line):
    runs = line((1,), (4,), error={"q": 0.01}) + line((2, 3), (3, 2), error={"q": -0.3})
    said = "only p was varied; the error of the cells is estimated as up to 0.3"
    assert below(runs, "q", 3.5).endswith(said)
    runs += line((4,), (1,), error={"q": None}) + line((5,), (0,))
    assert below(runs, "q", 3.5).endswith(said + ", not known in 2 of 5 runs")


def test_numbers_and_verdict_of_a_run(made):
    told = {"reaction_N": 12.5, "reaction_is": "punch force", "wall_s": {"total": 8, "compile": 3}}
    quantities = {"a": {"b": 2, "none": None, "at_mm": [1, 2], "is": True}, "c": 0.5}
    run = made({"x.k": 2}, **told, quantities=quantities, peak_memory_mib=1500, ranks=2)
    wanted = {"reaction_N": 12.5, "stroke_reached": 1, "wall_s": 8, "a.b": 2, "c": 0.5}
    assert run.numbers() == pytest.approx(wanted | {"a.none": math.nan}, nan_ok=True)
    assert run.memory() == 3000 and results.headlines([run], ["c"]) == {
        "c": "c", "reaction_N": "punch force [N]"
    }  # fmt: skip
    for status, verdict, load, *told in (
        (0, "ok", 1.0, "ok", True, True),
        (3, "ok", 1.0, "invalid", False, True),
        (0, "doubtful", 0.99, "doubtful", True, False),
    ):
        run = made({}, status, verdict=verdict, stroke_reached=load)
        assert [run.verdict(), run.is_valid(), run.is_at_full_load()] == told
    other = made({}, 3, options=["--nx=4"], stroke_reached=0.99)  # is tried again with others
    assert other.is_done(["--nx=4"]) and not other.is_done([]) and made({}, 3).is_done(["--nx=4"])
    assert not made({}, None).is_done([])


def test_results_are_those_of_the_finest_cells(made):
    for finest in ("finer", "finest"):
        run = made({}, options=["--refine"], quantities={"q": 1})
        for name, q in (("finer", 2), ("finest", 3)):
            (run.folder / name).mkdir()
            text = json.dumps({"quantities": {"q": q}})
            (run.folder / name / "summary.json").write_text(text)
            if name == finest:
                break
        assert run.number("q") == {"finer": 2, "finest": 3}[finest]
        run.options = []
        assert run.number("q") == 1


def history(run, rows):
    text = "load,displacement_mm,reaction_N\n" + "".join("{},{},{}\n".format(*r) for r in rows)
    (run.folder / "history.csv").write_text(text)


def test_curves_of_a_scatter_are_mean_and_quantiles_at_each_displacement(made, monkeypatch):
    """Forces 0 to 20 N at 10 mm, the last of a run with rows elsewhere: 5 % are below 1 N."""
    runs = [made({"k.x": k}) for k in range(5)]
    for k, run in enumerate(runs):
        half = [(0.4, 4, 2 * k)] if k == 4 else [(0.5, 5, 2.5 * k)]
        history(run, [(0, 0, 0), *half, (1, 10, 5 * k)])
    lost = made({"k.x": 9}, status=3)
    history(lost, [(0, 0, 0), (1, 10, 1000)])
    drawn = []
    monkeypatch.setattr(results, "curves", lambda path, series, x, y: drawn.append(series))
    monkeypatch.setattr(results, "_draw_trends", lambda *_: None)
    results.draw({name: Path("x.png") for name in ("curves", "trends")}, [*runs, lost], {}, True)
    forces = {name: np.array(series[1]) for name, series in drawn[0].items()}
    assert [*forces] == ["mean", "5 % of runs below", "95 % of runs below"]
    wanted = np.array([[0, 5, 10], [0, 0.5, 1], [0, 9.5, 19]])
    assert np.array([*forces.values()]) == pytest.approx(wanted)


EXAMPLE = Path(__file__).parents[2] / "studies/presses/hemisphere.toml"
PRESS = re.sub(" *#.*", "", EXAMPLE.read_text()).replace("nx = 16", "nx = 4")
PRESS = PRESS.replace("steps = 20", "steps = 2").replace("punch = 40", "punch = 4")


@pytest.fixture
def press(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("press.toml").write_text(PRESS)
    return "press.toml"


@pytest.mark.versions
def test_more_pressure_of_the_holder_draws_in_less(press, capsys):
    """Numbers in the table are those of the runs; the page has their pictures."""
    assert sweep.main([press, "--vary", "holder.pressure=0.5,0.05", "--", "--no-pictures"]) == 0
    folder = Path("results/sweep_press")
    with open(folder / "table.csv", newline="") as file:
        weak, strong = csv.DictReader(file)
    assert float(weak["draw_in.largest_mm"]) > float(strong["draw_in.largest_mm"]) > 0
    assert float(strong["reaction_N"]) > 1.5 * float(weak["reaction_N"]) > 0
    summary = json.loads((folder / "pressure=0.05/summary.json").read_text())
    assert float(weak["shortening_mean"]) == summary["quantities"]["shortening_mean"]
    page = (folder / "report.html").read_text()
    assert page.count("data:image/png") == 3 and 'href="pressure%3D0.5/report.html"' in page
    assert (folder / "maps.png").stat().st_size > 10_000


def test_the_press_of_a_run_has_its_values_and_options(press):
    form = SweepRun(Path(press), ["--nx", "8", "--fibre-angle=45", "--no-pictures"])
    (sheet,) = form.read({"blank.width": "150"}).sheets
    assert (sheet.nx, sheet.fibre_angle, sheet.width) == (8, 45, 150)
    with pytest.raises(InputError, match="width is 0; expected"):
        form.read({"blank.width": "0"})
