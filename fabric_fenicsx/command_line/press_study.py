"""A study of a press in a file."""

from typing import Any

from ..forming.build import FormingScene
from ..forming.press import Press
from ..job.validity import WAVE
from ..material.presets import read_laws
from ..runtime.fields import declared
from ..runtime.rules import POSITIVE
from ..solve.limits import Limits
from .options import Parser, option_type, program, spelled
from .study import LAW_FILE, Study, add_output, add_solver


def press_parser(description: str | None) -> Parser:
    """The parser of a study of the press in a file."""
    usage = "%(prog)s press.toml [option ...]"
    p = Parser(prog=program(Press.NAME), usage=usage, description=description)
    words = "the press: blank, tools, holders, stages; examples: studies/presses"
    p.option("file", metavar="press.toml", help=words, free=True)
    p.group("press")
    several = {"action": "append", "metavar": "KEY=VALUE", "default": []}
    words = "change an entry of the file, as tools.punch.radius=40"
    p.option("--set", **several, help=words, free=True)
    p.option("--law-file", metavar="FILE.py", help=LAW_FILE, free=True)
    add_solver(p, Press)
    p.group("wrinkles")
    p.option(
        "--refine",
        action="store_true",
        help=f"if a wave has fewer than {WAVE:g} cells, run again with as many more as it needs",
        free=True,
    )
    p.option(
        "--disturb",
        metavar="MM",
        type=option_type(POSITIVE),
        help="run the whole blank, too, with the leading tool aside, and tell what changes [mm]",
        free=True,
    )
    add_output(p, Press.NAME)
    words = "load steps of all stages together (by default those of the stages)"
    p.change("--steps", default=None, help=words)
    p.set_defaults(_sizes={False: Press.FULL, True: Press.QUICK}, **dict(Press.SOLVER))
    for each in declared(Limits):
        words = each.metadata["help"].replace("%", "%%")
        words += f" (the press's, or {each.default:g})"
        p.change(spelled(f"max_{each.name}"), default=None, help=words)
    return p


class PressStudy(Study):
    """A running study of a press, whose file names the fabric."""

    def read_fabric(self) -> Any:
        """None: the fabric is known when the press is read."""
        if self.args.law_file:
            read_laws(self.args.law_file)

    def press(self) -> FormingScene:
        """The press of the options, built; with --quick its cells are twice as large and its steps
        a third as many."""
        args = self.args
        press = Press.read(args.file, args.set)
        for each in declared(Limits):
            name = f"max_{each.name}"
            if getattr(args, name) is None:
                setattr(args, name, getattr(press.limits, each.name))
        self.fabric = press.fabric
        for doubt in press.fabric.plausibility_warnings():
            self.warn(doubt)
        if args.quick:
            made = press.build(self.comm)
            press, stages = made.coarser() or press, made.schedule.stages
            args.steps = args.steps or max(len(stages), made.schedule.steps // 3)
        return self.build(press)
