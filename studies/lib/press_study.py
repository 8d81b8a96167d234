"""A study of a press in a file."""

from typing import Any

from fabric_fenicsx.cli.options import Parser, program, spelled
from fabric_fenicsx.cli.study import Study, add_shared, kind_of_option
from fabric_fenicsx.core.fields import declared
from fabric_fenicsx.material.presets import read_laws
from fabric_fenicsx.press.press import Press
from fabric_fenicsx.press.schema import OF_ALL_PLIES, short_forms
from fabric_fenicsx.results.result import Result
from fabric_fenicsx.sheet.sheet import Sheet
from fabric_fenicsx.solve.limits import Limits


def press_parser(description: str | None, name: str = Press.NAME, press: str = "") -> Parser:
    """The parser of a study of the example `press`, by default of the press that is named."""
    usage = f"%(prog)s {'' if press else 'press.toml '}[option ...]"
    p = Parser(prog=program(name), usage=usage, description=description)
    if not press:
        words = "press file, or the name of one in studies/presses"
        p.option("file", metavar="press.toml", help=words, free=True)
    p.group("usual")
    p.group("press")
    several: Any = {"action": "append", "metavar": "KEY=VALUE", "default": [], "free": True}
    p.option("--set", **several, help="change an entry of the file, e.g. tools.punch.radius=40")
    p.group("all plies, overriding the press file")
    for each in declared(Sheet):
        if each.name in OF_ALL_PLIES:
            p.option(spelled(each.name), free=True, **kind_of_option(each.metadata))
    from_press = dict.fromkeys(["steps", *(f"max_{each.name}" for each in declared(Limits))])
    add_shared(p, Press, name, file=press, **from_press)
    return p


class PressStudy(Study):
    """A running study of a press, whose file names the fabric."""

    def read_fabric(self) -> None:
        """None: the fabric is known when the press is read."""
        if self.args.law_file:
            read_laws(self.args.law_file)

    def read(self, *changes: str) -> Press:
        """The press of the options, with these changes before theirs; with --quick its cells are
        twice as large and its steps a third as many."""
        args = self.args
        changes = *changes, *short_forms(vars(args)), *args.set
        press = Press.read(args.file, changes).with_fabrics(self.coupled)
        for name, value in vars(press.limits).items():
            if getattr(args, f"max_{name}") is None:
                setattr(args, f"max_{name}", value)
        args.stop_when_invalid |= press.stop_when_invalid
        self.fabric = press.fabric
        for doubt in press.fabric.plausibility_warnings():
            self.warn(doubt)
        if args.quick:
            made = press.build(self.comm)
            if coarser := made.coarser():
                press = press.replace(sheets=coarser.sheets)
            args.steps = args.steps or max(len(made.schedule.stages), made.schedule.steps // 3)
        return press

    def problem(self, setup: Any) -> dict[str, Any]:
        """As in `Study`, with the press."""
        return super().problem(setup) | setup.fingerprint()

    def run(self, setup: Any, part: str = "") -> Result:
        """As in `Study`; the press, as it was read and changed, is kept beside the results."""
        folder = self.output.path / part
        try:
            return super().run(setup, part)
        finally:
            file, is_there = folder / "press.toml", (folder / "summary.json").exists()
            if self.comm.rank == 0 and is_there and file.resolve() not in self.output.owned.inputs:
                setup.data.write(file)
