"""The stages of a press: which tools move, and how, one stage after the other."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..runtime.errors import InputError
from ..runtime.fields import KnowsItsFields, documented, number, switch
from ..runtime.rules import COUNT, FINITE, FROM_ZERO, POSITIVE, shown, unknown_key
from ..tools.values import checked_vector


@documented
@dataclass(frozen=True)
class Stage(KnowsItsFields):
    """What tools and holders do in one part of a run, all in proportion to the load.

    Parameters
    ----------
    name
        In results.
    moves
        {name of a tool: distance towards the blank, or a vector (3,)} [mm]; a distance below 0 is
        away from it.
    forces
        {name of a tool that a force moves: force on the whole blank at the end of the stage} [N].
    pressures
        {name of a holder with a pressure: pressure at the end of the stage} [MPa].
    leave
        Names of tools that go back to where they started.

    Raises
    ------
    InputError
        For values that are not allowed, and for a stage in which nothing happens.

    Examples
    --------
    >>> ff.Stage("forming", moves={"punch": 40}, steps=20).moves["punch"]
    40
    """

    name: str = ""
    moves: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    close: float | None = number(
        None, POSITIVE, "distance to which tools with a die close [thicknesses of the blank]"
    )
    forces: Mapping[str, float] = field(default_factory=dict)
    pressures: Mapping[str, float] = field(default_factory=dict)
    leave: Sequence[str] = ()
    steps: int = number(20, COUNT, "load steps")
    unload: bool = switch("take all tools and holders away, allowed in the last stage")

    def __post_init__(self) -> None:
        super().__post_init__()
        for kind, rule in (("forces", POSITIVE), ("pressures", FROM_ZERO)):
            for name, value in _table(self, kind).items():
                rule.check(f"`{kind}`.{name}", value)
        for name, value in _table(self, "moves").items():
            is_vector = isinstance(value, (list, tuple, np.ndarray))
            (checked_vector if is_vector else FINITE.check)(f"`moves`.{name}", value)
        names = self.leave if isinstance(self.leave, (list, tuple)) else [None]
        if not all(isinstance(each, str) for each in names):
            raise InputError(f"`leave` is {shown(self.leave)}; allowed is a list of names of tools")
        moves = any(np.any(way) for way in self.moves.values())
        moving = moves or self.forces or self.pressures or self.leave or self.close
        if self.unload and moving:
            raise InputError("`unload` needs a stage of its own, in which nothing moves")
        if not self.unload and not moving:
            raise InputError(
                "a stage needs `moves` other than 0, `close`, `forces`, `pressures` or `leave`"
            )


def _table(stage, kind):
    table = getattr(stage, kind)
    if not isinstance(table, Mapping):
        raise InputError(f"`{kind}` is {shown(table)}; allowed is a table of names")
    return table


class Schedule:
    """What tools and holders do over the load factor, from 0 to 1 over all `stages` in proportion
    to their steps.

    towards: {name of a tool: direction to the blank (3,)}; forces, pressures: {name: value} at the
    start, of tools that a force moves [N] and of holders with a pressure [MPa]; reach: {name of a
    tool with a die: distance that it moves until it touches the die} [mm]; thickness: of the blank
    [mm]. Raises InputError for stages that name what is not there.
    """

    def __init__(
        self,
        stages: Sequence[Stage],
        towards: Mapping[str, np.ndarray],
        forces: Mapping[str, float],
        pressures: Mapping[str, float],
        reach: Mapping[str, float],
        thickness: float,
    ) -> None:
        self._towards, self._reach, self._thickness = towards, reach, thickness
        self.stages = [
            dataclasses.replace(stage, name=stage.name or f"stage {k}")
            for k, stage in enumerate(stages, 1)
            if not stage.unload
        ]
        if not self.stages:
            raise InputError(
                "stage is empty; allowed are one or more stages that form, as [[stage]]"
            )
        if any(stage.unload for stage in list(stages)[:-1]):
            raise InputError("`unload` is allowed only in the last stage")
        self.unloads = bool(stages[-1].unload)
        self.steps = sum(stage.steps for stage in self.stages)
        self.joints = np.append(0, np.cumsum([s.steps for s in self.stages])) / self.steps
        self._places = {name: [np.zeros(3)] for name in towards}
        self._forces = {name: [value] for name, value in forces.items()}
        self._pressures = {name: [value] for name, value in pressures.items()}
        names = [stage.name for stage in self.stages]
        if twice := next((name for name in names if names.count(name) > 1), ""):
            raise InputError(f"two stages are called {twice}; allowed are different names")
        for stage in self.stages:
            self._add(stage, f"stage.{stage.name.removeprefix('stage ')}", towards)
        for name, places in self._places.items():
            ways = [float(place @ towards[name]) for place in places]
            if min(ways) < 0 and max(ways) <= 0:
                raise InputError(
                    f"tools.{name} only moves away from the blank; allowed is a tool that moves "
                    "towards it: numbers above 0 in `moves`"
                )

    def _add(self, stage, label, towards):
        for kind, series in (("forces", self._forces), ("pressures", self._pressures)):
            given = getattr(stage, kind)
            if other := next((name for name in given if name not in series), ""):
                has = f"`{kind[:-1]}` from the start"
                raise InputError(
                    f"{label}.{kind}.{other} needs a {has}; those that have one are "
                    f"{', '.join(series) or 'none here'}"
                )
            for name, values in series.items():
                values.append(given.get(name, values[-1]))
        moves = dict(stage.moves) | self._closing(stage, label, towards)
        for name in (*moves, *stage.leave):
            if name not in towards:
                raise unknown_key(name, towards, f"{label}: tool {name}")
            if name in self._forces:
                raise InputError(
                    f"{label} moves {name}, which moves by its force; allowed is "
                    f"{label}.forces.{name}"
                )
        for name, places in self._places.items():
            if name in stage.leave:
                if name in moves:
                    raise InputError(
                        f"{label}.leave names {name}, which moves in this stage; allowed is a tool "
                        "that does not"
                    )
                places.append(np.zeros(3))
                continue
            move = moves.get(name, 0.0)
            along = towards[name] * move if np.ndim(move) == 0 else np.asarray(move, dtype=float)
            places.append(places[-1] + along)

    def _closing(self, stage, label, towards):
        """{name: distance} that tools with a die move in a stage that closes them [mm]."""
        if stage.close is None:
            return {}
        if not self._reach:
            raise InputError(f"{label}.close needs a tool with a die, as die_of")
        if both := next((name for name in self._reach if name in stage.moves), ""):
            raise InputError(f"{label}.moves.{both} is not allowed beside `close`, which moves it")
        left = stage.close * self._thickness
        return {
            name: reach - left - float(self._places[name][-1] @ towards[name])
            for name, reach in self._reach.items()
        }

    def path(self, name: str, start: np.ndarray) -> Callable[[float], np.ndarray]:
        """Function of the load factor to where the tool's origin is, (3,) [mm]; start (3,)."""
        places = np.array(self._places[name]) + start

        def place(load):
            return np.array([np.interp(load, self.joints, axis) for axis in places.T])

        return place

    def force(self, name: str) -> Callable[[float], float]:
        """Function of the load factor to a tool's force on the whole blank [N]."""
        return lambda load: float(np.interp(load, self.joints, self._forces[name]))

    def pressure(self, name: str) -> Callable[[float], float]:
        """Function of the load factor to a holder's pressure [MPa]."""
        return lambda load: float(np.interp(load, self.joints, self._pressures[name]))

    def is_constant(self, name: str) -> bool:
        """Whether a holder's pressure is the same all the time."""
        return len(set(self._pressures[name])) == 1

    def closes_straight(self, name: str, die: str) -> bool:
        """Whether a tool moves only along z and by no force, and its die does not move."""
        return not (
            self.is_moved(die)
            or name in self._forces
            or np.any(self._places[name], axis=0)[:2].any()
        )

    def distance(self, name: str, load: float) -> float:
        """Distance of a tool from its die at a load factor, where both are flat [mm]."""
        gone = [float(place @ self._towards[name]) for place in self._places[name]]
        return self._reach[name] - float(np.interp(load, self.joints, gone))

    def is_moved(self, name: str) -> bool:
        """Whether any stage moves the tool, or a force does."""
        return name in self._forces or bool(np.ptp(self._places[name], axis=0).any())

    def first_move(self, name: str) -> np.ndarray:
        """Displacement of the tool in the first stage that moves it (3,) [mm]."""
        steps = np.diff(self._places[name], axis=0)
        moved = steps[steps.any(1)]
        return moved[0] if len(moved) else np.zeros(3)

    def shown(self) -> np.ndarray:
        """Load factors of about six pictures: ends of stages, and equally many within each."""
        each = max(1, round(5 / len(self.stages)))
        ends = np.arange(len(self.joints))
        return np.interp(np.arange(each * ends[-1] + 1) / each, ends, self.joints)

    def leaders(self) -> list[str]:
        """For each stage the tool whose force and travel the curve shows: the one that moves
        furthest, else the one whose force changes most, or "" if none does."""
        leaders = []
        for k in range(len(self.stages)):
            for of_tools in (self._places, self._forces):
                goes = {n: float(np.linalg.norm(v[k + 1] - v[k])) for n, v in of_tools.items()}
                farthest = max(goes, key=lambda name: goes[name], default="")
                if goes.get(farthest):
                    break
            leaders.append(farthest if goes.get(farthest) else "")
        return leaders

    def stage_at(self, load: float) -> int:
        """Number of the stage at a load factor, counted from 0."""
        return int(np.clip(np.searchsorted(self.joints, load) - 1, 0, len(self.stages) - 1))

    def travel(self, load: float) -> float:
        """Travel of the leading tools in all stages up to a load factor [mm]."""
        total = 0.0
        for k, name in enumerate(self.leaders()):
            low, high = self.joints[k : k + 2]
            share = np.clip((load - low) / (high - low), 0, 1)
            if name:
                before, after = self._places[name][k : k + 2]
                total += share * float(np.linalg.norm(after - before))
        return total
