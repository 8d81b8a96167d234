"""A study of a press in a file."""

from typing import Any

from ..forming.press import Press
from ..material.presets import read_laws
from .options import HelpFormatter, Parser, program
from .study import LAW_FILE, Study, add_output, add_solver


def press_parser(description: str | None) -> Parser:
    """The parser of a study of the press in a file."""
    p = Parser(
        prog=program(Press.NAME),
        usage="%(prog)s press.toml [option ...]",
        description=description,
        formatter_class=HelpFormatter,
    )
    words = "the press: blank, tools, holders, stages; examples: studies/presses"
    p.option("file", metavar="press.toml", help=words, free=True)
    p.group("press")
    p.option(
        "--set",
        action="append",
        metavar="KEY=VALUE",
        default=[],
        help="change an entry of the file, as tools.punch.radius=40",
        free=True,
    )
    p.option("--law-file", metavar="FILE.py", help=LAW_FILE, free=True)
    add_solver(p, Press)
    add_output(p, Press.NAME)
    p.change("--steps", default=None, help="load steps in all (those of the stages)")
    sizes = {False: Press.FULL, True: Press.QUICK}
    p.set_defaults(_sizes=sizes, **dict(Press.SOLVER))
    return p


class PressStudy(Study):
    """A study under way of a press, whose file says what the fabric is."""

    def read_fabric(self) -> Any:
        """None until the press is read."""
        if self.args.law_file:
            read_laws(self.args.law_file)

    def press(self) -> Press:
        """The press of the options; with --quick on cells twice as large, in a third of the
        steps."""
        args = self.args
        press = Press.read(args.file, args.set, comm=self.comm)
        if args.quick and press.can_be_coarser():
            press = press.coarser()
        if args.quick:
            args.steps = args.steps or max(len(press.course.stages), press.course.steps // 3)
        self.fabric = press.fabric
        for doubt in press.fabric.plausibility_warnings():
            self.warn(doubt)
        return self.build(press)
